"""Geometry of faces as the loops of `evaluate` find it, under the names of the reference."""

from dataclasses import replace

import numpy as np

from rastercov.camera.pose import Poses
from rastercov.coverage.coverage import FIGURES
from rastercov.coverage.face_pass import FacePass
from rastercov.coverage.task import Reason
from rastercov.raster.observation import BoundKind, Observation
from rastercov.reference import criteria

NAMES = (
    "in_view",
    "in_view_fraction",
    "projected_area",
    "pixel_density",
    "facing_density",
    "incidence",
    "reason",
)


def face_geometry(mesh, camera, pose):
    """`FaceGeometry` of one pose; outlines and depths are those of the reference."""
    none = np.zeros((1, mesh.n_faces))
    kind = np.full(none.shape, BoundKind.EXACT, np.uint8)
    found = {name: np.empty(none.shape, FIGURES[name]) for name in NAMES}
    seen = Observation(none, none, kind, none, np.zeros(1, bool))
    FacePass(mesh, camera, 1).fill(seen, Poses.of(pose), found)
    figures = {name: values[0] for name, values in found.items()}
    is_front = figures.pop("reason") > Reason.BACK_FACING
    with np.errstate(all="ignore"):
        whole = criteria.face_geometry(mesh, camera, pose)
    return replace(whole, is_front=is_front, **figures)
