"""Columns of a projected vertex, for the loops over faces in one pose."""

X, Y, Z, RIGHT, DOWN, U, V, STATE = range(8)
"""Camera axes, metres; x/z and y/z, for a pinhole; pixels; and the state of the vertex."""
COLUMNS = 8
"""Columns in all."""
BEHIND, AHEAD, INSIDE = 0.0, 1.0, 2.0
"""States: before the near plane, or outside the valid region of the lens; beyond it; beyond it and
inside the image."""
