"""Coverage that errors of installation cannot take away."""
