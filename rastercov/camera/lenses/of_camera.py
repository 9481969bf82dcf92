"""Lens of a camera, with all that loops over its images need.

What an image shows of an ideal plane is bounded by curves. `fields_of` divides each plane once for
a camera, so that loops over surfaces cut by straight lines only (`kernels.lens_field`).
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import read_only
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.areas import record_of
from rastercov.camera.lenses.lens import Lens, make_lens
from rastercov.camera.lenses.planes import IdealPlane, keep
from rastercov.camera.lenses.quadrature import edge_table
from rastercov.camera.lenses.slopes import slopes_in
from rastercov.camera.models import MODELS, lens_terms
from rastercov.kernels import lens_field as kernels
from rastercov.kernels.cameras import MOST_SIDES, CurvedLens
from rastercov.kernels.lens import project_many
from rastercov.kernels.lens_field import Slopes, side_of_image
from rastercov.kernels.lens_planes import PlaneRecord
from rastercov.kernels.lens_polygons import edge_scratch

FloatArray = NDArray[np.float64]

TOLERANCE = 1e-9
"""Bound of the error of each edge or part of an edge, px^2."""
MOST_LENSES = 1024
"""Lenses that are kept: a reconstruction may have one for each image."""
FIELD_TOLERANCE = 5e-6
"""Mean width of the undecided cells along a border of the image, in units of the plane."""
FIRST_NODES = 4096
SAMPLES = 64
"""Points along a side of a plane's box at which the field of view is looked for."""
GUARDS, GUARD_STEPS = 16, 2.0
"""Directions of the lines around it, and their distance from it, in steps between points."""


def optics_of(camera: Camera) -> Camera:
    """A camera with the same lens that is in focus everywhere and has no near plane.

    Cameras that differ in those alone share what is found of their lens, which takes seconds.
    """
    return Camera(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        skew=camera.skew,
        model=camera.model,
        distortion=camera.distortion,
        max_angle_deg=camera.max_angle_deg,
    )


@lru_cache(maxsize=MOST_LENSES)
def lens_of(camera: Camera) -> Lens:
    """Lens of a camera, the pinhole's own for one without distortion.

    Raises
    ------
    CameraError
        For coefficients that make no lens, or one that folds at its axis.
    """
    if (optics := optics_of(camera)) != camera:
        return lens_of(optics)
    return make_lens(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        skew=camera.skew,
        max_angle_deg=camera.max_angle_deg,
        **lens_terms(camera.model, camera.distortion),
    )


@lru_cache(maxsize=MOST_LENSES)
def planes_of(camera: Camera) -> tuple[tuple[IdealPlane, PlaneRecord], ...]:
    """Ideal planes of the lens of a camera, and the same for the loops.

    Their pinholes end where the image of the lens does: those of one frame together, because they
    are solved once.
    """
    if (optics := optics_of(camera)) != camera:
        return planes_of(optics)
    planes = lens_of(camera).planes
    records = [
        record_of(plane, camera.width, camera.height, edge_table(plane, TOLERANCE))
        for plane in planes
    ]
    found = []
    for plane, record in zip(planes, records, strict=True):
        windows = [other.window for other in records if np.array_equal(other.frame, record.frame)]
        pinhole = cropped(plane.camera, np.concatenate(windows))
        own = record._replace(cx=float(pinhole.cx), cy=float(pinhole.cy))
        found.append((replace(plane, camera=pinhole), own))
    return tuple(found)


def cropped(pinhole: Camera, points: FloatArray) -> Camera:
    """Pinhole with the pixels of its image that hold some points of its plane; all for none."""
    if len(points) == 0:
        return pinhole
    size = np.array([pinhole.width, pinhole.height])
    pixels = points * (pinhole.fx, pinhole.fy) + (pinhole.cx, pinhole.cy)
    low = np.maximum(np.floor(pixels.min(axis=0)), 0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0)), size).astype(int)
    width, height = np.maximum(high - low, 1).tolist()
    left, top = low.tolist()
    return replace(pinhole, width=width, height=height, cx=pinhole.cx - left, cy=pinhole.cy - top)


@lru_cache(maxsize=MOST_LENSES)
def slopes_of(camera: Camera) -> tuple[Slopes, ...]:
    """Bounds of derivatives in each plane of a camera, in the order of `planes_of`."""
    if (optics := optics_of(camera)) != camera:
        return slopes_of(optics)
    # Those planes that `planes_of` has asked for its records, whose slopes are kept.
    return tuple(slopes_in(plane) for plane in lens_of(camera).planes)


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


def fields_of(camera: Camera, tolerance: float = FIELD_TOLERANCE) -> tuple[kernels.Tree, ...]:
    """Field of view of a camera in each of its ideal planes, in the order of `planes_of`."""
    return _fields_of(optics_of(camera), tolerance)


@lru_cache(maxsize=MOST_LENSES)
def _fields_of(camera: Camera, tolerance: float) -> tuple[kernels.Tree, ...]:
    return tuple(field_of(plane, record, tolerance) for plane, record in planes_of(camera))


def field_of(plane: IdealPlane, record: PlaneRecord, tolerance: float) -> kernels.Tree:
    """Field of view in one plane, within the image of its pinhole.

    Parameters
    ----------
    plane, record
        The plane.
    tolerance : float
        Mean width of undecided cells, in units of the plane.
    """
    pinhole = plane.camera
    left, top = -pinhole.cx / pinhole.fx, -pinhole.cy / pinhole.fy
    right, bottom = left + pinhole.width / pinhole.fx, top + pinhole.height / pinhole.fy
    box = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    region, hole = _lines(record.region), _lines(record.hole)
    guards = _guards(plane, record, box)
    inner = box
    for line in guards:
        inner = keep(inner, *line)
    region = np.concatenate((guards, _cutting(region, inner)))
    work, n = kernels.tree_scratch(len(region), len(hole)), FIRST_NODES
    while True:
        tree = kernels.room_for_tree(n)
        kernels.divide(record, box, region, hole, tolerance, work, tree)
        root, n_nodes = tree.root.tolist()
        if n_nodes <= n:
            break
        n = n_nodes
    grown = kernels.Tree(
        tree.lines[:n_nodes].copy(),
        tree.children[:n_nodes].copy(),
        tree.kinds[:n_nodes].copy(),
        root,
    )
    for array in (grown.lines, grown.children, grown.kinds):
        array.flags.writeable = False
    return grown


def _guards(plane: IdealPlane, record: PlaneRecord, box: FloatArray) -> FloatArray:
    """Lines (K, 3) around the field of view that cut off corners of a box, far from the image.

    The region may have a hundred sides there, by which all surfaces would be cut.
    """
    t = (np.arange(SAMPLES) + 0.5) / SAMPLES
    low, high = box.min(axis=0), box.max(axis=0)
    points = np.stack(np.meshgrid(*(low + (high - low) * t[:, None]).T), axis=-1).reshape(-1, 2)
    is_valid = (points @ (lines := _lines(record.region))[:, :2].T + lines[:, 2] > 0).all(axis=1)
    if len(record.hole):
        lines = _lines(record.hole)
        is_valid &= (points @ lines[:, :2].T + lines[:, 2] < 0).any(axis=1)
    points = points[is_valid]
    pixels = np.empty((len(points), 2))
    rays = np.column_stack((points, np.ones(len(points)))) @ plane.frame.T
    project_many(record.code, record.params, np.ascontiguousarray(rays), pixels)
    seen = points[((pixels >= 0) & (pixels <= (record.width, record.height))).all(axis=1)]
    if not len(seen):
        return np.empty((0, 3))
    angle = 2 * np.pi * np.arange(GUARDS) / GUARDS
    normals = np.column_stack((np.cos(angle), np.sin(angle)))
    offsets = (seen @ normals.T).max(axis=0) + GUARD_STEPS * np.max(high - low) / SAMPLES
    guards = _cutting(np.column_stack((-normals, offsets)), box)
    return guards[[_is_outside(record, box, line) for line in guards]]


def _is_outside(record: PlaneRecord, box: FloatArray, line: FloatArray) -> bool:
    """True where the image shows nothing of what is beyond a line."""
    beyond = keep(box, *-line)
    for side in _lines(record.region):
        beyond = keep(beyond, *side)
    if len(beyond) < 3:
        return True
    inner = beyond
    for side in _lines(record.hole):
        inner = keep(inner, *side)
    if len(record.hole) and len(inner) >= 3:
        return False
    edges = edge_scratch()
    found: int = side_of_image(record, beyond, len(beyond), record.fx, edges)
    return found == -1


def _cutting(lines: FloatArray, polygon: FloatArray) -> FloatArray:
    """The lines that have a corner of a polygon outside."""
    values = polygon @ lines[:, :2].T + lines[:, 2]
    return lines[(values < -kernels.ON_LINE).any(axis=0)]


def _lines(polygon: FloatArray) -> FloatArray:
    """Lines (K, 3) along the sides of a polygon, positive inside, with normals of unit length."""
    side = np.roll(polygon, -1, axis=0) - polygon
    size = np.hypot(side[:, 0], side[:, 1])
    side, start = side[size > 0] / size[size > 0, None], polygon[size > 0]
    a, b = -side[:, 1], side[:, 0]
    return np.column_stack((a, b, -(a * start[:, 0] + b * start[:, 1])))
