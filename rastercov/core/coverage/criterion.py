"""Criteria of the surface itself, independent of cameras, such as its slope.

A camera covers no part of a face that fails one. A criterion is a frozen dataclass with its
threshold, words and function, in a module of its own, and a base of `Task` before this one. Faces,
areas, points and cells, options, plans, reports, shards and the viewer have it automatically.

Words on reasons and thresholds, and those of features.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from rastercov.base import BoolArray
from rastercov.core.mesh import Mesh


class Words(NamedTuple):
    """Words on a reason, and its colour and hatch in pictures.

    Attributes
    ----------
    label : str
        Of a legend, and after a number or a colon.
    sentence : str
        After a number of faces.
    advice : str
        For one camera to cover a face; names in braces are figures of the face.
    colour : (3,) int
        sRGB.
    hatch : int
        Over the colour, a sum of 1 for lines /, 2 for the other diagonal, 4 for | and 8 for -, and
        16 for dots.
    nearest : str
        Where another camera does not help: what comes before the name of the nearest device.
    """

    label: str
    sentence: str
    advice: str
    colour: tuple[int, int, int]
    hatch: int = 0
    nearest: str = ""


class Wording(NamedTuple):
    """Words of a feature.

    Attributes
    ----------
    reasons : dict of str to Words
        By the name of the reason, in the order in which its criteria are asked.
    thresholds : dict of str to callable
        Words of the value of a threshold of a `Task` that differs from its default; they follow "a
        camera sees it, ".
    """

    reasons: Mapping[str, Words]
    thresholds: Mapping[str, Callable[[Any], str]]


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
