"""Equipment of features beside the cameras of a rig, on which it depends what these see."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from numpy.typing import ArrayLike

from rastercov.base import BoolArray, ByName, FloatArray, ReadByName


class Equipment(Protocol):
    """Equipment of one feature, in N pieces; what a feature leaves out is as here."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the pieces."""

    @property
    def places(self) -> FloatArray:
        """(N, 4, 4) poses, in the world or on the rig."""

    @property
    def rides(self) -> tuple[bool | str, ...]:
        """True for each that is on the rig of the cameras, or the name of its carrier camera."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Content of its file that does not count."""
        return ()

    @property
    def _units(self) -> Mapping[str, str]:
        """Units of thresholds that need it."""
        return {}

    def _check(self, thresholds: ReadByName) -> None:
        """Raise `ConfigError` for thresholds of a task that do not go with it."""

    def _describe(self, row: int) -> ByName:
        """Words on a piece, its points, metres in its frame, and the half angle of its cone."""

    def _words(self, row: int, thresholds: ReadByName) -> str:
        """Words on a piece in a table, by the thresholds of a task."""
        return ""

    def _has_position(self, row: int) -> bool:
        """False for a piece at infinity, of which only the direction counts."""
        return True

    def carried_by(self, cameras: Sequence[str]) -> BoolArray:
        """(N, C) pieces that ride on cameras of these names; `CameraError` for others."""

    def at(self, row: int, place: ArrayLike) -> "Equipment":
        """The same with another place of a piece; what rides stays."""
        return self

    def to_json(self) -> ByName:
        """Entries, ready for JSON; see `EquipmentKind.of_json`."""

    def _to_gltf(self, _: object, nodes: list[ByName], roots: list[int]) -> ByName:
        """Add it to a glTF scene."""
        return {}
