"""Entries on flights in a plan."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rastercov.base import RastercovError, errors_as
from rastercov.placement.georeference import GeoReference
from rastercov.placement.plan.entries import (
    Entry,
    Name,
    NotNegative,
    Number,
    PlanSections,
    Positive,
    Triple,
)


class FlightSection(Entry):
    """Flight to the chosen positions, and their place on the Earth; z is up."""

    crs: Name | None = None
    """Coordinate reference system, such as EPSG:32632; without it only the CSV is written."""
    origin: Annotated[list[Number], Field(min_length=2, max_length=3)] | None = None
    """Local origin in the CRS: [easting, northing, height], or [latitude, longitude, height]."""
    home: Triple | None = None
    """Place of take-off and landing, m, such as [0, -30, 0]; by default on the ground below the
    first waypoint. The vehicle climbs and lands straight up and down."""
    speed: Positive = 5.0
    """Speed between positions, m/s."""
    hover: NotNegative = 0.0
    """Stop for each image, s; 0 for images in passing, by distance along straight lines."""
    battery: Positive | None = None
    """Flight time of a battery, min; a longer flight is divided into missions from and to home."""
    firmware: Literal["px4", "ardupilot"] = "px4"
    """Firmware of the vehicle, for QGroundControl."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.crs is None and self.origin is not None:
            raise ValueError("expected crs with origin, got none; give the CRS")
        with errors_as(ValueError, caught=RastercovError):
            self.place  # noqa: B018 - refuses what is no CRS
        return self

    @property
    def place(self) -> GeoReference | None:
        """Place of local coordinates on the Earth."""
        if self.crs is None:
            return None
        x, y, z = (*(self.origin or ()), 0.0, 0.0, 0.0)[:3]
        return GeoReference(self.crs, (x, y, z))


class FlightOfPlan(Entry):
    """Entry of a plan: the flight."""

    flight: FlightSection | None = None
    """Flight to the positions: files for QGroundControl and others."""


def _generators() -> tuple[type[Entry], ...]:
    from rastercov.survey.generators import Facade, Orbit, Strips  # entries of candidates

    return (Strips, Orbit, Facade)


HOOKS = PlanSections(plan=FlightOfPlan, generators=_generators)
"""Hooks of this feature."""
