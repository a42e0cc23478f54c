"""Runs: what is asked, the loops that step, the result."""
