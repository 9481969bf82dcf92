"""Visibility methods compared with a reference, see `comparison`."""

from rastercov.validation.methods.comparison import compare
from rastercov.validation.methods.results import Comparison

__all__ = ["Comparison", "compare"]
