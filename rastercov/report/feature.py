"""Additions of features to the page of a network, and to its files; see `modes.ReportHooks`."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from PIL import Image

from rastercov.base import FloatArray, IntArray, ReadByName
from rastercov.core.area.network import AreaNetwork
from rastercov.report.coverage_files import Addition
from rastercov.report.modes import REPORTS

MOST_LEVELS = 2_000_000
"""Faces of all phases up to which a page has what is covered in each."""


class InPhases(NamedTuple):
    """Phases of a scene on a page: its entries, and the values of a mode in each phase."""

    entries: ReadByName
    mode: str
    values: Sequence[FloatArray] | FloatArray


class NetworkPart(Protocol):
    """Additions of a feature to a network whose area is over phases of a scene.

    Attributes
    ----------
    words : str
        On the phases in which parts are covered.
    is_any : bool
        True where one phase is enough.
    most : str
        Words on the camera that covers a part in most phases.
    package, template : str
        Section of the page, in the templates of a package, whose values `section` gives.
    pictures : mapping of str to callable
        Each with its words in `ReportHooks.pictures`.
    """

    words: str
    is_any: bool
    most: str
    package: str
    template: str
    pictures: Mapping[str, Callable[[], Image.Image]]

    def modes(self) -> ReadByName:
        """Values of faces by modes."""

    def best(self) -> IntArray:
        """(F,) row of the result that covers each face in most phases, -1 for none."""

    def tables(self) -> Mapping[str, ReadByName]:
        """Columns of further tables."""

    def additions(self) -> Sequence[Addition]:
        """To the glTF file."""

    def view(self) -> InPhases:
        """Phases on a page."""

    def section(self, summary: ReadByName) -> ReadByName:
        """Values for the template, by a summary of the network."""


def part_of(areas: AreaNetwork | None) -> NetworkPart | None:
    """Additions of a feature to the page of a network; None where none does."""
    return next((part for each in REPORTS if (part := each.part(areas)) is not None), None)
