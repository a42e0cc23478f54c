"""Where stick-slip begins and where it ends."""
