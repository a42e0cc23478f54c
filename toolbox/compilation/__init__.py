"""A hybrid system as machine code."""
