"""Parts, laws, and the hybrid system that they make."""
