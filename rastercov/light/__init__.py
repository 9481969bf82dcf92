"""Lamps: light as a condition on what cameras cover."""
