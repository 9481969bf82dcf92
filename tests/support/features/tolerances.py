"""Errors of installation in tests of all public names."""

NAMES = ["tolerance"]
CALLS = {"InstallationError": {"position_mm": 1.0, "angle_deg": 1.0}, "tolerance": {"draws": 3}}
