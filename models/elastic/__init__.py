"""Elastic bodies in contact: matrices of finite elements, their reduction to a few coordinates, and parts of a plant made of them."""
