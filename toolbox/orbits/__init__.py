"""Variational equations, sensitivities, limit cycles and their branches."""
