"""How figures look, and curves and bands that several of them draw."""
