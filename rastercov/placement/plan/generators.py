"""Generators of candidate poses: the `[[candidates]]` entries of a plan file.

Each entry names a generator of `pool`, `mounting` or `cavities` and holds its arguments.
"""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from rastercov.placement.plan.entry import (
    Count,
    Direction,
    Entry,
    File,
    Limits,
    Name,
    NotNegative,
    Number,
    Pair,
    Positive,
    Triple,
    ascending,
    both_or_none,
    one_or_two,
    only_one,
)


class Generator(Entry):
    """Entries of all generators of candidate poses."""

    rolls_deg: Annotated[list[Number], Field(min_length=1)] = Field(
        default=[0.0], description="A candidate for each: turned about its axis."
    )
    up: Direction = Field(default=[0.0, 0.0, 1.0], description="Upwards in the image.")
    cost: NotNegative | None = Field(
        default=None,
        description="Of a place of this entry, added to that of the camera; 1 where neither has "
        "one.",
    )
    cameras: list[Name] = Field(
        default=[], description="Types of cameras at these places; all if empty."
    )


class Framed(Generator):
    """Views at the distance that their target needs."""

    stand_off: Limits | None = Field(
        default=None, description="[least, greatest] distance to the target, m; inf for no limit."
    )
    margin: Positive = Field(default=1.0, description="How many times larger the image is.")


class Square(Framed):
    """Views square to parts of the surface."""

    fit: Literal["extent", "vertices"] = Field(
        default="vertices", description="Distance by (6.7), or until all vertices are in view."
    )


class PerSegment(Square):
    """A view square to each segment, (6.1)-(6.11)."""

    generator: Literal["per_segment"]
    alpha_deg: Annotated[float, Field(ge=0, lt=90)] = Field(
        default=15.0, description="Largest angle between two normals of a segment that grows."
    )
    beta_deg: Annotated[float, Field(ge=0, lt=90)] = Field(
        default=25.0, description="Largest angle between average normals that are merged."
    )
    merge: Literal["leader", "closest", "none"] = Field(
        default="leader", description="How segments are merged."
    )
    adjacent: bool = Field(default=False, description="Merge neighbours only.")


class PerFace(Square):
    """A view square to each face of the task."""

    generator: Literal["per_face"]
    groups: list[Name] = Field(default=[], description="Faces of these groups only; all if empty.")


class PerConvexRegion(Square):
    """The average view of the faces around each convex corner."""

    generator: Literal["per_convex_region"]
    least_bend_deg: Annotated[float, Field(ge=0, le=180)] = Field(
        default=10.0, description="Bend of the sharpest edge of a corner, at least."
    )


class PerCavity(Square):
    """Views into what no candidate of the other entries sees, along directions that are open."""

    generator: Literal["per_cavity"]
    views: Count = Field(default=3, description="Candidates for each face, at most.")


class Around(Framed):
    """Views from around the part, looking at its centre."""

    generator: Literal["on_sphere", "on_hemisphere"]
    count: Count = Field(description="Positions on each sphere.")
    centre: Triple | None = Field(default=None, description="The middle of the scene if left out.")
    distances: Annotated[list[Positive], Field(min_length=1)] | None = Field(
        default=None, description="Radii, m; one from where all is in view if left out."
    )


class Aim(Entry):
    """Direction of view of a mounted camera: one of the four."""

    middle: Literal[True] | None = Field(default=None, description="The middle of the scene.")
    point: Triple | None = Field(default=None, description="A point.")
    direction: Direction | None = Field(default=None, description="A direction.")
    nearest: list[Name] | None = Field(
        default=None, description="The nearest surface of these groups; of the task if empty."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        only_one(self, ("middle", "point", "direction", "nearest"))
        return self


class Mounted(Generator):
    """Views from a grid of mounting positions."""

    spacing: Positive = Field(description="Largest distance between neighbours, m.")
    aim: Annotated[list[Aim], Field(min_length=1)] = Field(
        default=[Aim(middle=True)], description="Where to look; a candidate for each."
    )
    low: Triple | None = Field(default=None, description="Corner of the box; that of the scene.")
    high: Triple | None = Field(default=None, description="The opposite corner.")
    _check = model_validator(mode="after")(both_or_none)


class OnBox(Mounted):
    """Mounting positions on the sides of a box."""

    generator: Literal["on_box"]
    outward: Number = Field(default=0.0, description="Enlarges the box on all sides, m.")
    sides: Annotated[list[Literal["-x", "+x", "-y", "+y", "-z", "+z"]], Field(min_length=1)] = (
        Field(default=["-x", "+x", "-y", "+y", "-z", "+z"], description="Sides to use.")
    )


class OnWalls(Mounted):
    """Mounting positions on the four walls of a room; z is up."""

    generator: Literal["on_walls"]
    inset: Number = Field(default=0.1, description="Distance from walls, floor and ceiling, m.")
    heights: Annotated[Pair, AfterValidator(ascending), BeforeValidator(one_or_two)] | None = Field(
        default=None,
        description="[lowest, highest] z, or one, m; from floor to ceiling if left out.",
    )


class OnCeiling(Mounted):
    """Mounting positions under the ceiling of a room; z is up."""

    generator: Literal["on_ceiling"]
    inset: Number = Field(default=0.1, description="Distance from ceiling and walls, m.")


class PoseFile(Generator):
    """The poses of a file."""

    generator: Literal["poses"]
    file: File = Field(
        description="Pose file, ours (.json, .npy) or of another program that states its unit."
    )


CandidateEntry = Annotated[
    PerSegment
    | PerFace
    | PerConvexRegion
    | PerCavity
    | Around
    | OnBox
    | OnWalls
    | OnCeiling
    | PoseFile,
    Field(discriminator="generator"),
]
