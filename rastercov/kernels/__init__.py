"""Compiled loops over arrays, and the compiler's settings; they import only one another."""
