"""A flash on each camera."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt, Le
from typing_extensions import Doc

from rastercov.core.camera.camera import Camera
from rastercov.core.coverage.criterion import Words
from rastercov.core.coverage.device import Carried, Device


@dataclass(frozen=True)
class Flash(Carried):
    """A flash: its reach and the angle of its beam."""

    reach: Annotated[float, Gt(0), Doc("Depth that it reaches, m.")]
    beam_deg: Annotated[float, Gt(0), Le(120), Doc("Angle of its beam, deg.")] = 90.0

    @property
    def eye(self) -> Camera:
        """See `Carried`."""
        return Camera.from_fov(1000, 1000, hfov_deg=self.beam_deg, focus_range=(0.0, self.reach))


WORDS = Words("not flashed", "are not reached by the flash", "come closer", (40, 90, 40), 19)
HOOKS = Device(Flash, "not_flashed", WORDS)
