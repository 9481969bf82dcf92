"""Drawings of a building with its cameras."""
