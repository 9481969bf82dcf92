"""Devices on cameras, such as a flash, that must reach what the cameras cover.

A device is a module of `coverage/` with a frozen dataclass of its entries, derived from `Carried`,
and `HOOKS`, its `Device`, and a line of `rastercov.base.features`. `evaluate`, options, plans,
`check`, reports, shards and the viewer have it automatically.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields
from os import PathLike
from typing import ClassVar

import numpy as np

from rastercov.base import (
    BoolArray,
    ByName,
    CameraError,
    ConfigError,
    FloatArray,
    ReadByName,
    UnreadableError,
    arctan2,
    check_limits,
    errors_as,
    hooks_of,
    read_json,
    read_toml,
    shown,
    suffix_of,
)
from rastercov.core.camera import Camera, EquipmentKind
from rastercov.core.camera.equipment import Equipment
from rastercov.core.coverage.criterion import Words
from rastercov.core.mesh.files import NOWHERE, Site


@dataclass(frozen=True)
class Carried(Equipment):
    """A device on each camera, where it looks; fields are entries of its file, as of a `Task`."""

    def __post_init__(self) -> None:
        check_limits(self)

    @property
    def eye(self) -> Camera:
        """Camera of its point: what this does not see is not covered."""
        raise NotImplementedError  # each device has its own

    @property
    def names(self) -> tuple[str, ...]:
        """See `Equipment`."""
        return (type(self).__name__.lower(),)

    @property
    def places(self) -> FloatArray:
        """See `Equipment`."""
        return np.eye(4)[None]

    @property
    def rides(self) -> tuple[bool | str, ...]:
        """See `Equipment`."""
        return (True,)

    def carried_by(self, cameras: Sequence[str]) -> BoolArray:
        """See `Equipment`."""
        return np.ones((1, len(cameras)), bool)

    def to_json(self) -> ByName:
        """See `Equipment`."""
        return asdict(self)

    def _describe(self, row: int) -> ByName:
        half = math.degrees(arctan2(self.eye.width / self.eye.fx / 2, 1.0))
        return {"half_angle_deg": half, "words": self.names[0], "points": [[0.0, 0.0, 0.0]]}


class Device(EquipmentKind):
    """Hooks of a device, whose word is the name of its class; with the reason where it fails."""

    thresholds: ClassVar[ReadByName] = {}

    def __init__(self, own: type[Carried], reason: str, words: Words) -> None:
        self._own, self.reasons = own, {reason: words}
        self.word = self.entry = own.__name__.lower()
        self.help = (
            f"File of the {self.word} on each camera (.toml), which must reach covered points."
        )

    def of(self, given: object, site: Site = NOWHERE) -> Carried:
        """See `EquipmentKind`."""
        if isinstance(given, str | PathLike):
            with errors_as(CameraError, given, (UnreadableError, CameraError)):
                return self.of_json(
                    (read_json if suffix_of(given) == ".json" else read_toml)(given)
                )
        if not isinstance(given, self._own):
            raise CameraError(
                f"expected {self.word} to be a {self._own.__name__} or a file, got {shown(given)}"
            )
        return given

    def of_json(self, entries: ReadByName) -> Carried:
        """See `EquipmentKind`."""
        known = {each.name: each.default is MISSING for each in fields(self._own)}
        if not isinstance(entries, Mapping) or (wrong := sorted(entries.keys() - known)):
            got = wrong[0] if isinstance(entries, Mapping) else entries
            raise CameraError(
                f"expected entries of a {self.word} ({', '.join(known)}), got {shown(got)}; "
                "correct them"
            )
        if missing := [name for name, needed in known.items() if needed and name not in entries]:
            raise CameraError(f"expected {missing[0]} of a {self.word}, got none; add it")
        with errors_as(CameraError, self.word, ConfigError):
            return self._own(**entries)


def devices() -> list[Device]:
    """Devices among the equipment of features."""
    return [each for each in hooks_of(EquipmentKind) if isinstance(each, Device)]
