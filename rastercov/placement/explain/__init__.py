"""Reasons why faces stay uncovered."""
