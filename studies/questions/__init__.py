"""Questions of the field, each answered with its numbers."""
