"""Base of generators of candidates: their entries in a plan, and the objects they are made from.

A generator is an entry with `made`, derived from a class here, and a member of a union of
`generators`. Plans, their schema and its page, `place`, `check` and viewer have it automatically.
Sections of features, which these entries have, import `entries` alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

from pydantic import model_validator

from rastercov.base import ByName
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates import mounting
from rastercov.placement.candidates.pool import Candidates, Framing
from rastercov.placement.candidates.rooms import Room
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.entries import (
    Direction,
    Entry,
    Limits,
    Name,
    NotNegative,
    Number,
    Positive,
    Some,
    Triple,
    extend_entry,
    only_one,
)


@dataclass(frozen=True)
class GeneratorScene:
    """Scene and camera that the generator of an entry makes candidates for.

    Attributes
    ----------
    mesh : Mesh
    mounts : Mounts
        Cameras and rigs of the plan.
    index : int
        The one that is placed.
    framing : Framing
    folder : Path
        Folder that files are relative to.
    room : callable
        Room by its name.
    clearance : float
        That of the constraints, metres.
    """

    mesh: Mesh
    mounts: Mounts
    index: int
    framing: Framing
    folder: Path
    room: Callable[[str], Room]
    clearance: float

    @property
    def view(self) -> tuple[Mesh, Camera, Framing]:
        """First arguments of a generator."""
        return self.mesh, self.mounts.first_camera(self.index), self.framing


BESIDE = extend_entry("candidates")
"""Entries of what is placed beside cameras."""


class Generator(extend_entry("candidates")):  # type: ignore[misc] # a base made of fields
    """Entries of all generators of candidate poses."""

    rolls_deg: Some[Number] = [0.0]
    """Roll angles, degrees; one candidate for each."""
    up: Direction = [0.0, 0.0, 1.0]
    """Direction that is up in the image."""
    cost: NotNegative | None = None
    """Cost of a place of this entry, added to that of the camera; 1 if neither has one."""
    cameras: list[Name] = []
    """Cameras and rigs at these places; if empty, all rigs, and cameras that are on none."""

    @property
    def is_of_cameras(self) -> bool:
        """True unless something else is placed here."""
        return all(getattr(self, name) is None for name in BESIDE.model_fields)

    @property
    def is_carried(self) -> bool:
        """True for cameras that a `Carrier` moves."""
        return False

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """Candidates of a mount, once for each aim; each generator has its own."""
        raise NotImplementedError  # of what is carried, which the plan makes

    def sampling_text(self, mesh: Mesh) -> str:
        """Sentence on the surface at which its sampling distance holds, if it has one."""
        return ""

    def _own(self, base: type["Generator"]) -> ByName:
        """Entries that a base class lacks: arguments of the generator."""
        return self.model_dump(exclude={"generator", *base.model_fields})


class Framed(Generator):
    """Views at the distance that their target needs."""

    stand_off: Limits | None = None
    """[least, greatest] distance to the target, m; inf for no limit."""
    margin: Positive = 1.0
    """Size of the image relative to the target."""


class Square(Framed):
    """Views square to parts of the surface."""

    fit: Literal["extent", "vertices"] = "vertices"
    """Distance by eq. (6.7), or such that all vertices are in view."""


class Aim(Entry):
    """Direction of view of a mounted camera: one of the four."""

    middle: Literal[True] | None = None
    """Look at the middle of the scene, or of the room."""
    point: Triple | None = None
    """Point to look at, m."""
    direction: Direction | None = None
    """Direction of view."""
    nearest: list[Name] | None = None
    """Look at the nearest surface of these groups; of all evaluated ones if empty."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("middle", "point", "direction", "nearest"))
        return self

    def rule(self) -> mounting.Aim:
        """The rule of the direction."""
        if self.point is not None:
            return mounting.at_point(self.point)
        if self.direction is not None:
            return mounting.along(self.direction)
        if self.nearest is not None:
            return mounting.at_nearest_surface(self.nearest or None)
        return mounting.at_middle()


class Aimed(Generator):
    """Views from mounting positions, each by a rule."""

    spacing: Positive
    """Maximum distance between neighbours, m; for in_room, from anywhere on its walls to one."""
    aim: Some[Aim] = [Aim(middle=True)]
    """Points to look at; a candidate for each."""
