"""Numbers of a law that do best."""
