"""A lens as one row of numbers, for `rc_lens_create` of rastercov.h and for live pages.

Planes, field of view and bounds of derivatives as `of_camera` makes them; `native/c/lens.cpp` reads
them in this order.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import fields_of, lens_of, planes_of, slopes_of
from rastercov.camera.lenses.records import PlaneRecord, Slopes, Tree
from rastercov.camera.models import MODELS
from rastercov.coverage.area.regions import STRIP_REL, _has_closed_form
from rastercov.exact.cameras import pinhole_numbers

SHAPE_OF_PLANE = (
    "width",
    "height",
    "bend",
    "stretch",
    "speed",
    "tolerance",
    "arc_half",
    "arc_bend",
)


def packed(camera: Camera) -> FloatArray:
    """(N,) numbers of the lens of a camera that is no pinhole.

    Examples
    --------
    >>> import rastercov as rc
    >>> camera = rc.Camera(
    ...     width=640, height=480, fx=600, fy=600, model="opencv", distortion=(-0.1, 0.01, 0, 0)
    ... )
    >>> from rastercov.report.packed_lens import packed
    >>> packed(camera)[3]  # planes
    1.0
    """
    lens, planes = lens_of(camera), planes_of(camera)
    is_by_distance = not MODELS[camera.model].is_planar
    head = (lens.code, is_by_distance, _has_closed_form(camera), len(planes))
    rows: list[Any] = [head, (camera.width, camera.height), lens.params]
    each = zip(planes, fields_of(camera, STRIP_REL / 4), slopes_of(camera), strict=True)
    for (plane, record), tree, slopes in each:
        rows += [*_of_record(record), pinhole_numbers(plane.camera), *_of_tree(tree)]
        rows += _of_slopes(slopes)
    return np.concatenate([np.asarray(row, np.float64).ravel() for row in rows])


def _of_record(record: PlaneRecord) -> Iterator[Any]:
    polygons = record.region, record.hole, record.window
    yield from ((record.code,), record.params, record.frame)
    yield record.fx, record.fy, record.cx, record.cy
    yield [len(each) for each in polygons]
    yield from polygons
    yield from (record.longest, (record.parts_of, record.is_graded))
    yield [getattr(record, name) for name in SHAPE_OF_PLANE]


def _of_tree(tree: Tree) -> Iterator[Any]:
    yield len(tree.lines), tree.root
    yield from (tree.lines, tree.children, tree.kinds)


def _of_slopes(slopes: Slopes) -> Iterator[Any]:
    yield slopes.low_x, slopes.low_y, slopes.per_x, slopes.per_y
    yield from (slopes.second, slopes.third, slopes.sizes, slopes.near_axis)
