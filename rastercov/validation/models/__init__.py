"""Coverage models compared with each other."""
