"""Robots before cameras, and cameras on robots."""
