"""Coverage with whole arrays: the twin of `engine/coverage/figures.cpp` and `network.cpp`.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
"""

import math
from collections.abc import Mapping
from fractions import Fraction

import numpy as np

from rastercov.base import AnyArray, BoolArray, ByteArray, FloatArray
from rastercov.core.camera import Camera, near_limit, to_image
from rastercov.core.coverage.coverage import Coverage
from rastercov.core.coverage.face_pass import FIGURES, ROW_TYPES, PairRows
from rastercov.core.coverage.task import BITS, ROW_OF, STEEP, Reason, Task, own_reasons
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import BoundKind, Observation
from rastercov.engine.coverage_figures import BORDER_ROUNDING, MOST_DOUBTFUL, SIDE_ROUNDING
from rastercov.reference.criteria import (
    FaceGeometry,
    clip_near,
    clip_to_image,
    face_geometry,
    in_focus,
)

LARGEST_RESOLUTION = 1e300
"""Of one face; a smaller R_min gives no more."""
ROUNDING = 2.0**-52
"""Rounding of a quotient."""


def figures_of_pose(
    mesh: Mesh,
    camera: Camera,
    task: Task,
    pose: FloatArray,
    seen: Observation,
    row: int,
) -> dict[str, AnyArray]:
    """Every figure of one pose, by the names of `rastercov.core.coverage.coverage.FIGURES`."""
    geometry = face_geometry(mesh, camera, pose)
    visibility, bound, kind = visible_fraction(mesh, camera, pose, geometry, seen, row)
    drawn = seen.drawn_pixels[row]
    with np.errstate(over="ignore"):  # for the least R_min; sums over faces stay finite
        resolution = np.minimum(drawn / task.min_pixels, LARGEST_RESOLUTION)
    limits = camera.depth_of_field(task.max_blur)
    figures: dict[str, AnyArray] = {
        "in_view": geometry.in_view,
        "in_view_fraction": geometry.in_view_fraction,
        "projected_area": geometry.projected_area,
        "visible_pixels": seen.visible_pixels[row],
        "drawn_pixels": drawn,
        "resolution": resolution,
        "pixel_density": geometry.pixel_density,
        "facing_density": geometry.facing_density,
        "in_focus": in_focus(geometry.depth, limits, task.focus_rule),
        "visibility": visibility,
        "visibility_bound": bound,
        "visibility_kind": kind,
        "incidence": geometry.incidence,
    }
    per_m2 = {"pixels_per_m2": pixels_per_m2(mesh, camera, pose, geometry)}
    coverage, reason = classify(task, camera, own_reasons(mesh, task), geometry, figures | per_m2)
    return figures | {"coverage": coverage, "reason": reason}


def pixels_per_m2(
    mesh: Mesh, camera: Camera, pose: FloatArray, geometry: FaceGeometry
) -> FloatArray:
    """Pixels per square metre of each face at its deepest vertex: fx fy h / z^3."""
    away = mesh.vertices[mesh.faces[:, 0]] - pose[:3, 3]
    height = np.abs(np.einsum("fi,fi->f", away, mesh.normals))
    z = geometry.depth.max(axis=1)
    with np.errstate(all="ignore"):
        return np.where(z > 0, (camera.fx / z) * (camera.fy / z) * (height / z), 0.0)


def visible_fraction(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    geometry: FaceGeometry,
    seen: Observation,
    row: int,
) -> tuple[FloatArray, FloatArray, ByteArray]:
    """Visible fraction (3.14) of each face in one pose: value, bound and kind, (F,) each.

    Where samples were counted, `visible / drawn` is exactly 1 for a face that nothing hides and
    exactly 0 for a hidden one, whatever the resolution: both counts come from the same samples.
    """
    drawn, kind = seen.drawn_pixels[row], seen.kind[row]
    has_image = drawn > 0
    value = np.divide(seen.visible_pixels[row], drawn, out=np.zeros(len(drawn)), where=has_image)
    # Nothing is known of a face whose image rounds to nothing, or that owns no sample.
    bound = np.where(has_image, 0.0, 1.0)
    computed = (kind == BoundKind.EXACT) & has_image
    # |v/d - v'/d'| <= (|v - v'| + |d - d'|) / d, with d the true area
    error, least = seen.area_error[row][computed], (drawn - seen.area_error[row])[computed]
    bound[computed] = np.divide(error, least, out=np.ones(len(error)), where=least > 0) + ROUNDING
    counted = (kind == BoundKind.STATISTICAL) & has_image
    length = geometry.perimeter[counted] * np.sqrt(seen.samples_per_pixel)
    deviation = 3 * 0.27 * np.sqrt(1.25 * length + 1) + length / 20
    bound[counted] = deviation / (drawn[counted] * seen.samples_per_pixel)
    # A face seen from behind is not seen, by definition, and one outside the image neither.
    nothing = ~geometry.is_front | ((geometry.in_view_fraction == 0) & ~geometry.in_view)
    value[nothing], bound[nothing] = 0.0, 0.0
    doubt, unseen = is_uncertain(mesh, camera, pose, geometry, seen, row)
    bound[doubt], bound[unseen] = 1.0, 0.0
    return value, np.minimum(bound, 1.0), np.where(nothing, BoundKind.EXACT, kind).astype(np.uint8)


def is_uncertain(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    geometry: FaceGeometry,
    seen: Observation,
    row: int,
) -> tuple[BoolArray, BoolArray]:
    """(F,) faces of which rounding may decide whether they are seen from the front, in the image.

    Their image is within its rounding; or their side is; or they are just outside the image. And
    (F,) those of which nothing is seen for certain, whatever rounding says of them.
    """
    corners = mesh.vertices[mesh.faces]
    points = (corners - pose[:3, 3]) @ pose[:3, :3]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    unit = np.abs([first, second]).max(axis=(0, 2))[:, None]
    first, second = (
        np.divide(each, unit, where=unit > 0, out=0 * each) for each in (first, second)
    )
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    sine /= np.maximum(np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1), 1e-300)
    size = np.abs(points).sum(axis=(1, 2))
    height = np.abs(np.cos(geometry.incidence)) * np.linalg.norm(points.sum(axis=1), axis=1)
    is_clear = height > min(SIDE_ROUNDING / mesh.least_sine, MOST_DOUBTFUL) * size
    is_clear &= geometry.in_view | (SIDE_ROUNDING / mesh.least_sine < MOST_DOUBTFUL)
    is_edge_on = ~is_clear & (height * sine <= SIDE_ROUNDING * size) | mesh.degenerate_mask
    drawn = seen.drawn_pixels[row]
    has_part = (geometry.in_view_fraction != 0) | geometry.in_view
    has_image = has_part | (drawn > 0)
    doubt: BoolArray = has_image & (is_edge_on & ~(mesh.two_sided_mask & geometry.is_front))
    doubt |= has_image & ~has_part & geometry.is_front
    if any(seen.area_error.strides):
        is_small = (drawn <= seen.area_error[row]) & (seen.area_error[row] > 0)
        doubt |= has_image & is_small & (seen.kind[row] == BoundKind.EXACT)
    outside = np.flatnonzero(~has_image & (geometry.is_front | is_edge_on))
    doubt[outside] = _reach_image(points[outside], camera, _near(mesh, camera, pose))
    return doubt, surely_unseen(mesh, pose, is_edge_on & ~(drawn > 0))


def surely_unseen(mesh: Mesh, pose: FloatArray, is_edge_on: BoolArray) -> BoolArray:
    """(F,) of faces that are edge-on to rounding those that the camera is not before, exactly."""
    mask = np.zeros(mesh.n_faces, np.bool_)
    eye = [Fraction(x) for x in pose[:3, 3].tolist()]
    for face in np.flatnonzero(is_edge_on):  # few, 20 us each
        a, b, c = (
            [Fraction(x) - at for x, at in zip(corner, eye, strict=True)]
            for corner in mesh.vertices[mesh.faces[face]].tolist()
        )
        side = -sum(a[k] * (b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2]) for k in range(3))
        mask[face] = side == 0 if mesh.two_sided_mask[face] else side <= 0
    return mask


def _near(mesh: Mesh, camera: Camera, pose: FloatArray) -> float:
    return float(near_limit(camera, mesh.opaque.bounds, pose[None])[0])


def _reach_image(points: FloatArray, camera: Camera, near: float) -> BoolArray:
    """True for faces (N, 3, 3), in camera axes, that reach into the image, a little larger."""
    width, height, fx, fy = (float(x) for x in (camera.width, camera.height, camera.fx, camera.fy))
    numbers = width + height + fx + fy + abs(camera.cx) + abs(camera.cy)
    numbers += width * width / fx + height * height / fy
    polygons, counts = clip_near(points, near * (1 - BORDER_ROUNDING))
    image = to_image(polygons, camera)
    is_corner = np.arange(image.shape[1]) < counts[:, None]
    largest = np.where(is_corner[:, :, None], np.abs(image), 0.0).max(axis=(1, 2), initial=0.0)
    margin = BORDER_ROUNDING * np.maximum(numbers, largest)[:, None]
    sides = np.array((width, height))
    image = (image + margin[:, None]) * (sides / (sides + 2 * margin))[:, None]
    return clip_to_image(image, counts, camera)[1] > 0


def classify(
    task: Task,
    camera: Camera,
    own: ByteArray,
    geometry: FaceGeometry,
    figures: Mapping[str, AnyArray],
) -> tuple[FloatArray, ByteArray]:
    """Coverage (3.6) of each face by one camera, and its `Reason`, (F,) each.

    `own` are reasons of the surface itself; `figures` holds the criteria of the pose, by the names
    of `Coverage`; and for a task with `min_pixels_per_m2` those of `pixels_per_m2`.
    """
    resolution, visibility = figures["resolution"], figures["visibility"]
    enough = np.minimum(resolution, 1.0) if task.cap_resolution else resolution
    is_dense = figures["pixel_density"] >= task.min_pixel_density
    is_dense &= figures["facing_density"] >= task.min_facing_density
    if task.min_pixels_per_m2 > 0:
        is_dense &= figures["pixels_per_m2"] >= task.min_pixels_per_m2
    is_visible = visibility >= task.min_visibility
    shown = np.where(is_visible, visibility, 0.0)
    is_flat = figures["incidence"] <= math.radians(task.max_incidence_deg)

    def fails(score: FloatArray) -> BoolArray:
        return (score < task.min_coverage) | (score == 0)

    dense = np.where(is_dense, enough, 0.0)
    is_coarse = fails(dense)
    is_hidden = fails(np.where(is_coarse, 1.0, dense) * shown)
    # A steep view has the density of one at the largest angle that is allowed.
    rules = task.rules(camera)
    if rules.cos_incidence > 0:
        with np.errstate(all="ignore"):
            tilted = resolution * rules.cos_incidence / np.cos(figures["incidence"])
        least = rules.without([STEEP], camera).min_facing_density
        is_enough = ~fails(np.minimum(tilted, 1.0)) & (figures["facing_density"] >= least)
        is_coarse &= is_flat | ~is_enough
    bits = np.zeros(len(visibility), np.uint32)
    for row, fail in (
        (Reason.OUT_OF_FOCUS, ~figures["in_focus"]),
        (Reason.TOO_COARSE, is_coarse),
        (Reason.OCCLUDED, is_hidden),
        (Reason.TOO_OBLIQUE, ~is_flat),
    ):
        bits[fail] |= BITS[row]
    reason = np.array(
        [ROW_OF[each] if each else Reason.COVERED for each in bits.tolist()], np.uint8
    )
    reason = np.where(reason == Reason.COVERED, own, reason)
    reason[~(figures["drawn_pixels"] > 0)] = Reason.UNSAMPLED
    reason[~geometry.in_view] = Reason.OUTSIDE
    reason[~geometry.is_front] = Reason.BACK_FACING
    reason[own == Reason.DEGENERATE] = Reason.DEGENERATE
    is_met = (own == Reason.COVERED) & geometry.is_front & geometry.in_view & is_flat
    is_met &= figures["in_focus"] & (figures["drawn_pixels"] > 0)
    return dense * shown * is_met, reason


def rows_of(coverage: Coverage, choice: str) -> PairRows:
    """Rows of the pairs of a table, of the choices of `rastercov.core.coverage.network`."""
    is_seen = (coverage.in_view_fraction > 0) & (coverage.reason > Reason.BACK_FACING)
    chosen = {
        "none": np.zeros(is_seen.shape, np.bool_),
        "covered": coverage.reason == Reason.COVERED,
        "seen": is_seen,
        "all": np.ones(is_seen.shape, np.bool_),
    }[choice]
    pose, face = np.nonzero(chosen)
    figures = {name: getattr(coverage, name)[chosen] for name in FIGURES}
    with np.errstate(over="ignore"):  # values beyond float32 become inf
        columns = {name: values.astype(ROW_TYPES[name]) for name, values in figures.items()}
    # The bound includes the rounding of the visible fraction, so that it still holds.
    off = np.abs(columns["visibility"] - figures["visibility"])
    bound = figures["visibility_bound"] + off
    short = bound.astype(np.float32)
    up = np.nextafter(short, np.float32(np.inf))
    columns["visibility_bound"] = np.where(short < bound, up, short)
    ids = coverage.pose_ids[pose].astype(np.int32)
    return {"pose": ids, "face": face.astype(np.int32)} | columns
