"""Comparison of methods, coverage models and detectors with a reference."""
