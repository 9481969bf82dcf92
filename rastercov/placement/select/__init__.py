"""Selection of cameras from a visibility matrix."""
