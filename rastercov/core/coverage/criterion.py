"""Criteria of the surface itself, independent of cameras, such as its slope.

A camera covers no part of a face that fails one. A criterion is a frozen dataclass with its
threshold, words and function, in a module of its own, and a base of `Task` before this one. Faces,
areas, points and cells, options, plans, reports, shards and the viewer have it automatically.
"""

from dataclasses import dataclass

from rastercov.base import BoolArray
from rastercov.core.coverage.words import Wording
from rastercov.core.mesh import Mesh


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """Base of criteria; fields are thresholds, whose defaults every face meets.

    Attributes
    ----------
    _wording : Wording
        Its reason, and the text of each threshold; without an annotation.
    """

    _wording = Wording({}, {})

    def _fails(self, mesh: Mesh) -> BoolArray:
        """(F,) faces that fail it; a mesh that moves is that of the frame."""
        raise NotImplementedError  # each criterion has its own
