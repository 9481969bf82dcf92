"""rastercov."""
