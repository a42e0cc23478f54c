"""Runs: what is asked, how it is carried out, the result."""
