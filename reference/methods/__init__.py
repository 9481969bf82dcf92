"""Visibility methods compared with a reference, see `comparison`."""

from rastercov.reference.methods.comparison import compare
from rastercov.reference.methods.error_statistics import Comparison

__all__ = ["Comparison", "compare"]
