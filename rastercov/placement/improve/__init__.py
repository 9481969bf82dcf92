"""Continuous improvement of the poses of a network."""
