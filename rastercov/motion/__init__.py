"""Parts that move, and coverage over time."""
