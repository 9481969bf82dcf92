"""Installed cameras: their poses from photographs, and what they cover now."""
