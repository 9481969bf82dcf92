"""Lamps and the sun: light as a condition on what cameras cover."""
