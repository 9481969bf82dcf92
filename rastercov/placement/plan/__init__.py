"""Plan files and their execution: `rastercov place` and `rastercov check`."""
