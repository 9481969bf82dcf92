"""Ways to find visibility, put beside the truth: see `comparison`."""

from rastercov.compare.comparison import compare
from rastercov.compare.entrants import Candidate
from rastercov.compare.page import write_comparison
from rastercov.compare.results import Comparison

__all__ = ["Candidate", "Comparison", "compare", "write_comparison"]
