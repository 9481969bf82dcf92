"""Hours and energy of sun on a surface, and their report."""
