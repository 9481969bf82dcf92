"""Generators of candidates along flights, in plan files."""

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rastercov.base import sampling
from rastercov.core.mesh import Mesh
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.plan.entries import (
    Count,
    Name,
    Number,
    Pair,
    Positive,
    Some,
    Triple,
    only_one,
    value_of,
)
from rastercov.placement.plan.generator import Generator, GeneratorScene
from rastercov.survey.patterns import (
    Circles,
    Survey,
    above_ground,
    facade,
    mean_level,
    orbit,
    strips,
)

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

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        yield strips(*spot.view, survey=value_of(self, Survey))

    def sampling_text(self, mesh: Mesh) -> str:
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

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
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

    def make(self, spot: GeneratorScene) -> Iterator[Candidates]:
        """See `Generator`."""
        result = facade(*spot.view, **self._own(Generator))
        yield above_ground(spot.mesh, result, spot.clearance)

    def sampling_text(self, mesh: Mesh) -> str:
        """See `Generator`."""
        at = "holds at the part of the facade that protrudes most"
        return f"gsd of facade, {sampling(self.gsd)}, {at}" if self.gsd else ""
