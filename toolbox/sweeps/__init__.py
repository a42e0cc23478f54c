"""Runs by the thousand."""
