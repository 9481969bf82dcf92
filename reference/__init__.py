"""The authority: what the fast paths must agree with, written to be read and not to be fast."""
