"""Entries on lamps in the sections of a plan."""

from datetime import datetime
from pathlib import Path
from typing import Annotated, Self

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from rastercov.base import ByName
from rastercov.core.camera.catalogue import KINDS
from rastercov.core.camera.exposure import GLOSSES, Exposure
from rastercov.light.lamp_file import ANGLES, MOMENT, lamps_of
from rastercov.light.lamps import SUN
from rastercov.placement.plan.entries import (
    Count,
    Entry,
    File,
    Name,
    NotNegative,
    Pair,
    PlanSections,
    Positive,
    Some,
    Triple,
    among,
    fields_of,
    value_of,
)


def _text_of(value: object) -> object:
    """Text of a time, as JSON has it; any other value as it is."""
    return value.isoformat() if isinstance(value, datetime) else value


class SunOfLamp(Entry):
    """Entries of a lamp of kind sun, which has no position."""

    illuminance_lx: Positive | None = None
    """Illuminance of a sun across its rays, lx, for thresholds in lx."""
    irradiance_w_m2: Positive | None = None
    """Irradiance of a sun across its rays, W/m2, for thresholds in W/m2."""
    azimuth_deg: float | None = None
    """Azimuth of a sun, degrees clockwise from north."""
    elevation_deg: float | None = None
    """Elevation of a sun above the horizon, degrees."""
    latitude: float | None = None
    """Latitude, degrees, north positive; with longitude and time in place of the angles. By default
    that of an IFC file."""
    longitude: float | None = None
    """Longitude, degrees, east positive; by default that of an IFC file."""
    time: Annotated[str, BeforeValidator(_text_of)] | None = None
    """Date and time with its zone, 2026-06-21T12:00:00+02:00."""
    north_deg: float | None = None
    """Direction of north, degrees from +x towards +y; by default that of an IFC file, or +y."""
    radius_deg: Positive | None = None
    """Radius of the disc of a sun, degrees, for several points."""


class LampSection(SunOfLamp, Entry):
    """A lamp, or several of one kind at `positions`, that must light what cameras see.

    Candidates that name a lamp without a position are places to choose from.
    """

    preset: Name | None = None
    """Lamp of the catalogue; other entries change it."""
    kind: Annotated[str, *among(KINDS)] | None = None
    """Kind: point, spot, bar, ring, dome, area or sun."""
    intensity_cd: Positive | None = None
    """Luminous intensity on its axis, cd, for thresholds in lx."""
    power_w_sr: Positive | None = None
    """Radiant intensity on its axis, W/sr, for thresholds in W/m2."""
    range: Positive | str | None = None
    """Range of an infrared lamp, such as "20 m", up to which it suffices; in place of a power."""
    half_angle_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    """Angle from its axis beyond which it emits nothing; for a spot."""
    inner_angle_deg: NotNegative | None = None
    """Angle up to which a spot is even; it falls to 0 at half_angle_deg, as in glTF."""
    exponent: NotNegative | None = None
    """m of I cos^m t, with t the angle from its axis: 0 is isotropic, 1 Lambertian."""
    size: Positive | Pair | None = None
    """Length of a bar, diameter of a ring or dome, side or [width, height] of an area, m."""
    points: Count | None = None
    """Sample points of a lamp with a size, up to 36."""
    share: Annotated[float, Field(gt=0, le=1)] | None = None
    """Share of its sample points that a point must see to count as lit."""
    ies: File | None = None
    """IES LM-63 or EULUMDAT (.ldt) file, in place of kind, intensity and size."""
    position: Triple | None = None
    """Position, m; on the rig for a lamp that a rig carries."""
    positions: Some[Triple] | None = None
    """Positions, m; a lamp at each."""
    aim: Triple | None = None
    """Point that it is aimed at; by default straight down, or along the axis of its rig."""
    spin_deg: float | None = None
    """Rotation about its axis, degrees counterclockwise seen from behind it."""
    rig: bool | Name = False
    """Rig or camera that carries it; true for a lamp on each of them."""
    cost: NotNegative | None = None
    """Cost of one, added to that of its place, for a lamp of candidates."""

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Self:
        folder = Path((info.context or {}).get("folder", "."))
        lamps_of({"lamps": {"lamp": self.entries(is_placed=not self.places)}}, folder, None)
        return self

    @property
    def places(self) -> list[str]:
        """Entries given that are of its place."""
        return [
            name
            for name in ("position", "positions", "aim", "spin_deg", "rig", *ANGLES, *MOMENT)
            if getattr(self, name)
        ]

    def entries(self, *, is_placed: bool = False) -> ByName:
        """Entries of a file of lamps; with a place at the origin where it has none."""
        own = self.model_dump(exclude_defaults=True, exclude={"cost"})
        return own | ({"position": [0.0, 0.0, 0.0]} if is_placed and self.kind != SUN else {})


class ExposureSection(fields_of(Exposure)):  # type: ignore[misc] # a base made of fields
    """Sensor, lens and time of the cameras, and the surface before them."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        value_of(self, Exposure)
        return self


class LampsOfPlan(Entry):
    """Entries of a plan."""

    lamps: dict[Name, LampSection] = Field(default={})
    """Lamps by name; at least one must light what is covered."""
    ambient: Annotated[float, Field(ge=0, allow_inf_nan=False)] | str = 0.0
    """Ambient illuminance, a number or text such as "50 lx"; with lamps."""
    exposure: ExposureSection | None = None
    """Sensor and exposure of the cameras: limits of signal and saturation limit illuminance."""


class LightOfTask(Entry):
    """Entries of its task."""

    gloss: Annotated[str, *among(tuple(GLOSSES))] | None = None
    """Gloss of the surface: matt, satin or polished, in place of max_highlight_deg."""


class LampsOfSelection(Entry):
    """Entries of a selection of the best coverage."""

    lamps: Count | None = None
    """Maximum number of lamps, if candidates name lamps."""


class LampOfCandidates(Entry):
    """Entries of candidates."""

    lamp: Name | None = None
    """Lamp to place here instead of cameras; a lamp of the plan without a position."""


HOOKS = PlanSections(LampsOfPlan, LightOfTask, LampsOfSelection, LampOfCandidates)
