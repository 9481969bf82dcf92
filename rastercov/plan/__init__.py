"""A plan file and what is done with it: `rastercov place` and `rastercov check`."""
