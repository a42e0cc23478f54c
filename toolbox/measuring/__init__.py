"""Numbers read off runs."""
