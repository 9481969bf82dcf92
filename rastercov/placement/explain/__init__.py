"""Explanation of uncovered faces: reasons, blocking groups, candidates that see them."""
