"""Generators of candidates in plan files: the entries of each, and what it makes of them.

The union at the end has them and those of features, see `PlanSections`; see `generator`.
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Literal, Union, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    model_validator,
)

from rastercov.base import hooks_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.mesh import faces_of_groups
from rastercov.formats.cameras import read_views
from rastercov.placement.candidates import mounting, pool
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.plan.entries import (
    Count,
    File,
    Name,
    Number,
    Pair,
    PlanSections,
    Positive,
    Some,
    Triple,
    ascending,
    both_or_none,
    one_or_two,
)
from rastercov.placement.plan.generator import Aimed, Framed, Generator, GeneratorScene, Square


class PerSegment(Square):
    """A view square to each segment, eq. (6.1) to (6.11)."""

    generator: Literal["per_segment"]
    alpha_deg: Annotated[float, Field(ge=0, lt=90)] = 15.0
    """Largest angle between two normals of a segment that grows."""
    beta_deg: Annotated[float, Field(ge=0, lt=90)] = 25.0
    """Largest angle between average normals that are merged."""
    merge: Literal["leader", "closest", "none"] = "leader"
    """Method of merging segments."""

    def segment(self, mesh: Mesh) -> Segmentation:
        """Segments of a mesh."""
        if self.merge == "none":
            return segment(mesh, self.alpha_deg, None)
        return segment(mesh, self.alpha_deg, self.beta_deg, merge=self.merge)

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        yield pool.per_segment(*spot.view, segmentation=self.segment(spot.mesh))


class PerFace(Square):
    """A view square to each evaluated face."""

    generator: Literal["per_face"]
    groups: list[Name] = []
    """Faces of these groups only; all if empty."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        mesh = spot.mesh
        faces = mesh.task_mask
        if self.groups:
            faces = faces & faces_of_groups(mesh, self.groups)
        yield pool.per_face(*spot.view, faces=faces)


class PerCavity(Square):
    """Views into what no candidate of the other entries sees, along directions that are open."""

    generator: Literal["per_cavity"]
    views: Count = 3
    """Maximum number of candidates per face."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """None: they depend on the visibility of the others."""
        return iter(())


class Around(Framed):
    """Views from around the part, looking at its centre."""

    generator: Literal["on_sphere", "on_hemisphere"]
    count: Count
    """Positions on each sphere."""
    centre: Triple | None = None
    """Centre of the spheres, m; by default that of the scene."""
    distances: Some[Positive] | None = None
    """Radii, m; by default one at which the whole part is in view."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        yield getattr(mounting, self.generator)(*spot.view, **self._own(Framed))


Heights = Annotated[Pair, AfterValidator(ascending), BeforeValidator(one_or_two)]


class InRoom(Aimed):
    """Mounting positions on the walls and the ceiling of the mesh, in a room; z is up."""

    generator: Literal["in_room"]
    room: Name
    """Name of the room, in whose middle the default aim is."""
    inset: Positive = 0.1
    """Distance from the mesh, m."""
    heights: Heights | None = None
    """[lowest, highest] z of positions, or one z, m; by default all of the room."""
    on: Some[Literal["walls", "ceiling"]] = ["walls", "ceiling"]
    """Faces to use: walls are steep faces, the ceiling is the others that face down."""
    groups: list[Name] = []
    """Faces of these groups only; all if empty."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        room = spot.room(self.room)
        aims = [mounting.at_point(room.middle) if aim.middle else aim.rule() for aim in self.aim]
        own = self._own(Aimed) | {"room": room}
        yield mounting.in_room(*spot.view, spacing=self.spacing, aims=aims, **own)


class MountingGrid(Aimed):
    """Views from a grid of mounting positions."""

    low: Triple | None = None
    """Lowest corner of the box, m; by default that of the scene."""
    high: Triple | None = None
    """Highest corner of the box, m; by default that of the scene."""
    _check = model_validator(mode="after")(both_or_none)

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        mount = MOUNTS[type(self)]
        bounds = None if self.low is None else np.array([self.low, self.high])
        given = {"spacing": self.spacing, "bounds": bounds} | self._own(MountingGrid)
        for aim in self.aim:
            yield mount(*spot.view, aim=aim.rule(), **given)


Side = Literal["-x", "+x", "-y", "+y", "-z", "+z"]


class OnBox(MountingGrid):
    """Mounting positions on the sides of a box."""

    generator: Literal["on_box"]
    outward: Number = 0.0
    """Distance by which the box is enlarged on all sides, m."""
    sides: Some[Side] = list(get_args(Side))
    """Sides to use."""


class OnWalls(MountingGrid):
    """Mounting positions on the four walls of a room; z is up."""

    generator: Literal["on_walls"]
    inset: Number = 0.1
    """Distance from walls, floor and ceiling, m."""
    heights: Heights | None = None
    """[lowest, highest] z of positions, or one z, m; by default from floor to ceiling."""


class OnCeiling(MountingGrid):
    """Mounting positions under the ceiling of a room; z is up."""

    generator: Literal["on_ceiling"]
    inset: Number = 0.1
    """Distance from ceiling and walls, m."""


MOUNTS: dict[type[MountingGrid], Callable[..., Candidates]] = {
    OnBox: mounting.on_box,
    OnWalls: mounting.on_walls,
    OnCeiling: mounting.on_ceiling,
}


class PoseFile(Generator):
    """The poses of a file."""

    generator: Literal["poses"]
    file: File
    """Pose file: .json or .npy of rastercov, or of another program that states its unit."""

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        from_poses, mounts = pool.from_poses(*spot.view, poses=spot.folder / self.file), spot.mounts
        views = read_views(spot.folder / self.file)
        if len(mounts) > 1 and views.camera_names:  # each pose has its own camera
            from_poses = from_poses.take(mounts.place(views).camera[from_poses.index] == spot.index)
        yield from_poses


OF_PLACES = (Around, InRoom, OnBox, OnWalls, OnCeiling, PoseFile)
if TYPE_CHECKING:
    Reachable = Generator
else:
    _own = [kind for each in hooks_of(PlanSections) for kind in each.generators()]
    Reachable = Union[(PerSegment, PerFace, *OF_PLACES, *_own)]
