"""Section of a lamp of a plan, and the work that it asks for."""

from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, ValidationInfo, model_validator

from rastercov.camera.lamp_file import lamps_of
from rastercov.camera.lamps import KINDS
from rastercov.placement.plan.entries import (
    Count,
    Entry,
    File,
    Name,
    NotNegative,
    Pair,
    Positive,
    Some,
    Triple,
    among,
)


class LampSection(Entry):
    """A lamp, or several of one kind at `positions`, that must light what cameras see.

    Candidates that name a lamp without a position are places to choose from.
    """

    kind: Annotated[str, *among(KINDS)] | None = None
    """Kind: point, spot, bar, ring, dome or area."""
    intensity_cd: Positive | None = None
    """Luminous intensity on its axis, cd, for thresholds in lx."""
    power_w_sr: Positive | None = None
    """Radiant intensity on its axis, W/sr, for thresholds in W/m2."""
    range: Positive | str | None = None
    """Range of an infrared lamp, such as "20 m", in place of a power: light is enough there."""
    half_angle_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    """Angle from its axis beyond which it emits nothing; for a spot."""
    exponent: NotNegative | None = None
    """m of I cos^m of the angle from its axis: 0 is isotropic, 1 Lambertian."""
    size: Positive | Pair | None = None
    """Length of a bar, diameter of a ring or dome, side or [width, height] of an area, m."""
    points: Count | None = None
    """Sample points of a lamp with a size, up to 36."""
    share: Annotated[float, Field(gt=0, le=1)] | None = None
    """Share of its sample points that a point must see to count as lit."""
    ies: File | None = None
    """IES LM-63 or EULUMDAT (.ldt) file, instead of all entries above."""
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
        lamps_of({"lamps": {"lamp": self.entries(is_placed=not self.places)}}, folder)
        return self

    @property
    def places(self) -> list[str]:
        """Entries given that are of its place."""
        return [
            name
            for name in ("position", "positions", "aim", "spin_deg", "rig")
            if getattr(self, name)
        ]

    def entries(self, *, is_placed: bool = False) -> dict[str, Any]:
        """Entries of a file of lamps; with a place at the origin where it has none."""
        own = self.model_dump(exclude_none=True, exclude={"cost"})
        return own | ({"position": [0.0, 0.0, 0.0]} if is_placed else {})

    @property
    def lighting(self) -> Any:
        """Class that chooses such lamps; its module imports that of plans, which have sections."""
        return import_module("rastercov.placement.plan.lamps").Lighting
