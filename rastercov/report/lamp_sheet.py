"""Lamps on plan sheets."""

import math
from collections.abc import Iterator

import numpy as np

from rastercov.camera.lamp_rig import lamps_of
from rastercov.camera.rig import Rig, names_of
from rastercov.coverage.evaluation import Evaluation
from rastercov.report.plan_sheet import Device, SheetDevices


class LampsOnSheet(SheetDevices):
    """Lamps, as circles with rays."""

    word, colour = "lamp", "#946200"

    def devices(self, found: Evaluation) -> Iterator[Device]:
        """See `SheetDevices`."""
        lamps = lamps_of(found.camera)
        if lamps is None or not isinstance(found.camera, Rig):
            return
        needed = found.task.min_illuminance
        camera_from_rig = np.linalg.inv(found.camera.rig_from_camera)
        on = lamps.carried_by(names_of(found.camera))
        for row, (lamp, place) in enumerate(zip(lamps.lamps, lamps.places, strict=True)):
            whole = lamp.intensity_of_point * lamp.points
            words = f"{whole:.3g} {lamp.unit}"
            if needed:
                words += f", reaches {math.sqrt(whole / needed):.3g} m"
            if not lamps.rides[row]:
                yield Device(lamps.names[row], place, False, words)
            for pose, index in zip(found.poses.world_from_camera, found.poses.camera, strict=True):
                if on[row, index]:
                    at = pose @ camera_from_rig[index] @ place
                    yield Device(lamps.names[row], at, True, words)

    def symbol(self, x: float, y: float) -> str:
        """See `SheetDevices`."""
        ways = [(math.cos(turn), math.sin(turn)) for turn in np.arange(8) * math.pi / 4]
        near, start, end = (
            [f"{x + size * dx:.4f},{y + size * dy:.4f}" for dx, dy in ways]
            for size in (1.0, 1.3, 2.0)
        )
        circle = "L".join(near)
        rays = "".join(f"M{one}L{other}" for one, other in zip(start, end, strict=True))
        return f"M{circle}Z{rays}"


HOOKS = LampsOnSheet()
