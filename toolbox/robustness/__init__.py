"""How far a closed loop is from failing: margins at steady running, the best that any law can have, and the worst case of the machine itself."""
