"""Generators of candidates in plan files: the entries of each, and what it makes of them.

The unions at the end have all of them, and name each once; see `generator`.
"""

from collections.abc import Callable, Iterator
from typing import Annotated, Literal, Self, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    model_validator,
)

from rastercov.base.format import sampling
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.mesh import faces_named
from rastercov.formats.cameras import read_views
from rastercov.placement.candidates import mounting, pool
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.plan.entries import (
    BaseEntry,
    Count,
    File,
    Name,
    NotNegative,
    Number,
    Pair,
    Positive,
    Some,
    Triple,
    ascending,
    both_or_none,
    one_or_two,
    only_one,
    value_of,
)
from rastercov.placement.plan.generator import Aimed, Framed, Generator, Spot, Square
from rastercov.survey.facade import above_ground, facade
from rastercov.survey.orbit import Circles, orbit
from rastercov.survey.strips import Survey, mean_level, strips


class PerSegment(Square):
    """A view square to each segment, eq. (6.1) to (6.11)."""

    generator: Literal["per_segment"]
    alpha_deg: Annotated[float, Field(ge=0, lt=90)] = 15.0
    """Largest angle between two normals of a segment that grows."""
    beta_deg: Annotated[float, Field(ge=0, lt=90)] = 25.0
    """Largest angle between average normals that are merged."""
    merge: Literal["leader", "closest", "none"] = "leader"
    """Method of merging segments."""

    def segmented(self, mesh: Mesh) -> Segmentation:
        """Segments of a mesh."""
        if self.merge == "none":
            return segment(mesh, self.alpha_deg, None)
        return segment(mesh, self.alpha_deg, self.beta_deg, merge=self.merge)

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        yield pool.per_segment(*spot.view, segmentation=self.segmented(spot.mesh))


class PerFace(Square):
    """A view square to each evaluated face."""

    generator: Literal["per_face"]
    groups: list[Name] = []
    """Faces of these groups only; all if empty."""

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        mesh = spot.mesh
        faces = mesh.task_mask
        if self.groups:
            faces = faces & faces_named(mesh, self.groups)
        yield pool.per_face(*spot.view, faces=faces)


class PerCavity(Square):
    """Views into what no candidate of the other entries sees, along directions that are open."""

    generator: Literal["per_cavity"]
    views: Count = 3
    """Maximum number of candidates per face."""

    def made(self, spot: Spot) -> Iterator[Candidates]:
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

    def made(self, spot: Spot) -> Iterator[Candidates]:
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

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        room = spot.room(self.room)
        aims = [mounting.at_point(room.middle) if aim.middle else aim.rule() for aim in self.aim]
        own = self._own(Aimed) | {"room": room}
        yield mounting.in_room(*spot.view, spacing=self.spacing, aims=aims, **own)


class Mounted(Aimed):
    """Views from a grid of mounting positions."""

    low: Triple | None = None
    """Lowest corner of the box, m; by default that of the scene."""
    high: Triple | None = None
    """Highest corner of the box, m; by default that of the scene."""
    _check = model_validator(mode="after")(both_or_none)

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        mount = MOUNTS[type(self)]
        bounds = None if self.low is None else np.array([self.low, self.high])
        given = {"spacing": self.spacing, "bounds": bounds} | self._own(Mounted)
        for aim in self.aim:
            yield mount(*spot.view, aim=aim.rule(), **given)


Side = Literal["-x", "+x", "-y", "+y", "-z", "+z"]


class OnBox(Mounted):
    """Mounting positions on the sides of a box."""

    generator: Literal["on_box"]
    outward: Number = 0.0
    """Distance by which the box is enlarged on all sides, m."""
    sides: Some[Side] = list(get_args(Side))
    """Sides to use."""


class OnWalls(Mounted):
    """Mounting positions on the four walls of a room; z is up."""

    generator: Literal["on_walls"]
    inset: Number = 0.1
    """Distance from walls, floor and ceiling, m."""
    heights: Heights | None = None
    """[lowest, highest] z of positions, or one z, m; by default from floor to ceiling."""


class OnCeiling(Mounted):
    """Mounting positions under the ceiling of a room; z is up."""

    generator: Literal["on_ceiling"]
    inset: Number = 0.1
    """Distance from ceiling and walls, m."""


MOUNTS: dict[type[Mounted], Callable[..., Candidates]] = {
    OnBox: mounting.on_box,
    OnWalls: mounting.on_walls,
    OnCeiling: mounting.on_ceiling,
}


Share = Annotated[float, Field(ge=0, lt=1)]
Corners = Annotated[list[Pair], Field(min_length=3)]


class Flown(Generator):
    """Views from a pattern of flight, in its order."""

    front: Share = 0.8
    """Overlap of neighbours along the flight."""


class Strips(Flown):
    """Aerial survey: parallel strips over a polygon."""

    generator: Literal["strips"]
    height: Positive | None = None
    """Height above the mean of the ground in the polygon, m."""
    gsd: Positive | None = None
    """Ground sampling distance, m per pixel, instead of height."""
    side: Share = 0.6
    """Overlap of neighbouring strips."""
    heading_deg: Number = 0.0
    """Direction of the first strip, degrees clockwise from +y."""
    polygon: Corners | None = None
    """Corners [x, y], m; by default the convex outline of the evaluated surface."""
    follow: bool = False
    """True to keep the height above the ground below each image."""
    tilt_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    """Tilt of the views, forward from straight down."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("height", "gsd"))
        return self

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        yield strips(*spot.view, survey=value_of(self, Survey))

    def sampled_at(self, mesh: Mesh) -> str:
        """See `Generator`."""
        if self.gsd is None:
            return ""
        at = f"the mean height of the ground, {mean_level(mesh, self.polygon):.4g} m"
        at = "the height of the ground below each image" if self.follow else at
        return f"gsd of strips, {sampling(self.gsd)}, holds at {at}"


class Orbit(Flown):
    """Circles around a point, with views inwards."""

    generator: Literal["orbit"]
    radius: Positive
    """Radius of the circles, m."""
    heights: Some[Number]
    """z of each circle, m."""
    centre: Triple | None = None
    """Point to look at, m; by default the middle of the scene."""
    tilt_deg: Annotated[float, Field(gt=-90, lt=90)] | None = None
    """Tilt of the views, down from level; by default they look at the centre."""
    count: Count | None = None
    """Images per circle, instead of front."""

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        yield orbit(*spot.view, circles=value_of(self, Circles))


class Facade(Flown):
    """Rows of level views square to a facade."""

    generator: Literal["facade"]
    distance: Positive | None = None
    """Distance from the part that protrudes most, m."""
    gsd: Positive | None = None
    """Sampling distance on the facade, m per pixel, instead of distance."""
    side: Share = 0.6
    """Overlap of neighbouring rows."""
    groups: list[Name] = []
    """Groups of the facade; the task if empty."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("distance", "gsd"))
        return self

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        found = facade(*spot.view, **self._own(Generator))
        yield above_ground(spot.mesh, found, spot.clearance)

    def sampled_at(self, mesh: Mesh) -> str:
        """See `Generator`."""
        at = "holds at the part of the facade that protrudes most"
        return f"gsd of facade, {sampling(self.gsd)}, {at}" if self.gsd else ""


class PoseFile(Generator):
    """The poses of a file."""

    generator: Literal["poses"]
    file: File
    """Pose file: .json or .npy of rastercov, or of another program that states its unit."""

    def made(self, spot: Spot) -> Iterator[Candidates]:
        """See `Generator`."""
        found, mounts = pool.from_poses(*spot.view, poses=spot.folder / self.file), spot.mounts
        views = read_views(spot.folder / self.file)
        if len(mounts) > 1 and views.camera_names:  # each pose has its own camera
            found = found.take(mounts.placed(views).camera[found.index] == spot.index)
        yield found


OfSurface = PerSegment | PerFace | PerCavity
OfPlaces = Around | InRoom | OnBox | OnWalls | OnCeiling | Strips | Orbit | Facade | PoseFile
Reachable = PerSegment | PerFace | OfPlaces


class OnArm(Generator):
    """Views of another generator that the arm of a robot reaches without a collision."""

    generator: Literal["on_arm"]
    body: Name
    """Link that carries the camera: NAME/LINK of a body with urdf."""
    of: Annotated[Reachable, Field(discriminator="generator")]
    """Generator of the poses, without entries for rolls, up, cost and cameras."""
    rolls_deg: Some[Number] = [0.0, 90.0, 180.0, 270.0]
    """Roll angles, degrees; one candidate for each."""
    mount: BaseEntry = BaseEntry()
    """Pose of the camera on the link; axes: x right, y down, z forward."""
    clearance: NotNegative = 0.0
    """Minimum distance of links from the scene and keep-out volumes, m."""
    link_clearance: NotNegative = 0.0
    """Minimum distance of links from each other, m; at 0 they may not touch."""
    allowed: list[Annotated[list[Name], Field(min_length=2, max_length=2)]] = []
    """Pairs of links that may touch, besides neighbours."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if own := sorted(self.of.model_fields_set & set(Generator.model_fields)):
            raise ValueError(f"expected {own[0]} in on_arm, got it in its generator; move it")
        return self

    @property
    def is_carried(self) -> bool:
        """See `Generator`."""
        return True

    def views(self) -> Reachable:
        """The other generator, with rolls and up of this one."""
        return self.of.model_copy(update={"rolls_deg": self.rolls_deg, "up": self.up})


CandidateEntry = Annotated[OfSurface | OfPlaces | OnArm, Field(discriminator="generator")]
