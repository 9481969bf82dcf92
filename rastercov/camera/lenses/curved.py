"""A lens that is no pinhole, as the loops over faces take it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import read_only
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import lens_of, planes_of
from rastercov.camera.models import MODELS
from rastercov.kernels.cameras import MOST_SIDES, CurvedLens

FloatArray = NDArray[np.float64]


def curved_lens(camera: Camera) -> CurvedLens:
    """Lens of a camera for the loops."""
    lens, records = lens_of(camera), [record for _, record in planes_of(camera)]

    def padded(polygons: list[FloatArray]) -> tuple[Any, Any]:
        rows = np.zeros((len(polygons), MOST_SIDES, 2))
        for row, polygon in zip(rows, polygons, strict=True):
            row[: len(polygon)] = polygon
        return read_only(rows), read_only(np.array([len(each) for each in polygons], np.int64))

    regions, region_sides = padded([record.region for record in records])
    holes, hole_sides = padded([record.hole for record in records])
    return CurvedLens(
        code=lens.code,
        params=read_only(lens.params),
        width=float(camera.width),
        height=float(camera.height),
        by_distance=not MODELS[camera.model].is_planar,
        frames=read_only(np.stack([record.frame for record in records])),
        own_params=read_only(np.stack([record.params for record in records])),
        regions=regions,
        region_sides=region_sides,
        holes=holes,
        hole_sides=hole_sides,
        longest=read_only(np.stack([record.longest for record in records])),
        parts_of=read_only(np.array([record.parts_of for record in records], np.int64)),
        is_graded=read_only(np.array([record.is_graded for record in records])),
        bends=read_only(np.array([record.bend for record in records])),
        tolerance=records[0].tolerance,
    )
