"""Ways to find visibility, put beside the truth: see `comparison`."""

from rastercov.validation.methods.comparison import compare
from rastercov.validation.methods.contenders import Candidate
from rastercov.validation.methods.results import Comparison

__all__ = ["Candidate", "Comparison", "compare"]
