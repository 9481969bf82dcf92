"""Light of lamps at single points, by definition: the twin of `rastercov.light.regions`."""

import numpy as np

from rastercov.base import BoolArray, FloatArray, IntArray
from rastercov.core.camera import Poses, eyes_of
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.light.lamps import Lamps
from rastercov.reference.regions import PointTwin, covers_points


def light_points(
    mesh: Mesh, lamps: Lamps, points: FloatArray, face: IntArray, world_from_rig: FloatArray
) -> BoolArray:
    """Mask of the points of faces that lamps light from the front, and from the rear, (2, N).

    A lamp that rides does so on the rig at (4, 4) `world_from_rig`. One lamp lights a point that
    enough of its own points see.
    """
    lit, lamps = np.zeros((2, len(points)), bool), lamps._around(mesh.bounds)
    for lamp, place, rides in zip(lamps.lamps, lamps.places, lamps.rides, strict=True):
        matrices = (world_from_rig @ place if rides else place) @ lamp.lamp_from_point
        sees = covers_points(mesh, lamp.eye, matrices, Task(), points, face)
        away = eyes_of(lamp.eye, Poses.of(matrices))[:, None] - points
        front = np.einsum("kpi,pi->kp", away, mesh.normals[face]) > 0
        for side, own in zip((front, ~front), lit, strict=True):
            own |= (sees & side).sum(axis=0) >= lamp.points_needed
    return lit


class LampTwin(PointTwin):
    """Lamps."""

    word, reason = "lamps", "unlit"

    def holds(
        self, mesh: Mesh, own: Lamps, points: FloatArray, face: IntArray, world_from_rig: FloatArray
    ) -> BoolArray:
        """See `PointTwin`."""
        return light_points(mesh, own, points, face, world_from_rig)


TWIN = LampTwin()
