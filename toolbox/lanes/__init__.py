"""Many runs side by side in vector lanes."""
