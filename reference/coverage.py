"""Coverage and criteria of all faces of one pose with whole arrays.

The twin of `engine/coverage/figures.cpp`, `network.cpp` and `criteria.hpp`. Criteria are the same
figures in the same order of operations, so both give the same bits, except angles of incidence, for
which numpy and the C library have different arccosines, and areas of faces that the near plane or
the image border cuts, whose terms numpy may add in another order.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
"""

import math
from collections.abc import Mapping
from fractions import Fraction

import numpy as np

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    FloatArray,
    IntArray,
    frozen_record,
)
from rastercov.core.camera import MODELS, Camera, Poses, near_limit, to_camera, to_image
from rastercov.core.camera.lenses.of_camera import planes_of
from rastercov.core.coverage.coverage import Coverage
from rastercov.core.coverage.face_pass import FIGURES, ROW_TYPES, FacePass, PairRows
from rastercov.core.coverage.task import BITS, ROW_OF, STEEP, Reason, Task, own_reasons
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import BoundKind, Observation
from rastercov.engine.coverage_figures import BORDER_ROUNDING, MOST_DOUBTFUL, SIDE_ROUNDING


@frozen_record
class FaceGeometry:
    """Geometry of every face as one camera has it; all arrays (F,) unless noted.

    Attributes
    ----------
    is_front : bool
        The face is seen against its normal, or its group is two-sided. Never for a degenerate face.
    in_view : bool
        All three vertices inside the image and beyond the near plane, (3.7).
    in_view_fraction : float64
        Part of the projected area inside the image; 0 where there is no area.
    projected_area : float64
        (3.9) of the part beyond the near plane, px^2, not cut at the image border.
    perimeter : float64
        Length of its outline, px; inf where the near plane cuts the face.
    pixel_density : float64
        Pixels per metre on the surface along its worst direction, at its worst vertex; 0 for faces
        that are not front or not wholly beyond the near plane.
    facing_density : float64
        Pixels per metre along the worst direction of a target that faces the camera at the deepest
        vertex, min(fx, fy) / z; 0 for faces not wholly beyond the near plane.
    depth : (F, 3) float64
        Camera z of the vertices, or their distance, by which the lens is sharp, metres.
    centre_depth : float64
        The same of the centroid.
    incidence : float64
        Angle between normal and ray from the centroid to the camera centre, radians, [0, pi]; of
        two-sided faces with the normal of the side that is seen, [0, pi/2].
    """

    is_front: BoolArray
    in_view: BoolArray
    in_view_fraction: FloatArray
    projected_area: FloatArray
    perimeter: FloatArray
    pixel_density: FloatArray
    facing_density: FloatArray
    depth: FloatArray
    centre_depth: FloatArray
    incidence: FloatArray


MEASURED = (
    "in_view",
    "in_view_fraction",
    "projected_area",
    "pixel_density",
    "facing_density",
    "incidence",
    "reason",
)
"""Figures that `measure_geometry` asks of the compiled loops."""


def measure_geometry(mesh: Mesh, camera: Camera, pose: FloatArray) -> FaceGeometry:
    """Geometry of every face for one pose, by the loops of `evaluate`, through any lens.

    Without outlines, which are NaN.
    """
    none = np.zeros((1, mesh.n_faces))
    kind = np.full(none.shape, BoundKind.EXACT, np.uint8)
    table = {name: np.empty(none.shape, FIGURES[name]) for name in MEASURED}
    seen = Observation(none, none, kind, none, np.zeros(1, bool))
    FacePass(mesh, camera, 1).fill(seen, Poses.of(pose), table)
    figures: ByName = {name: values[0] for name, values in table.items()}
    is_front = figures.pop("reason") > Reason.BACK_FACING
    outline = np.full(mesh.n_faces, np.nan)
    corners = to_camera(mesh.vertices, pose)[mesh.faces.T]
    by_distance = not (camera.is_pinhole or MODELS[camera.model].is_planar)
    points = np.stack((*corners, _sum3(corners) / 3))
    depth = np.linalg.norm(points, axis=2) if by_distance else points[..., 2]
    figures |= {"depth": depth[:3].T, "centre_depth": depth[3]}
    return FaceGeometry(is_front=is_front, perimeter=outline, **figures)


def face_geometry(mesh: Mesh, camera: Camera, pose: FloatArray) -> FaceGeometry:
    """Geometry of every face for one pose, world_from_camera (4, 4)."""
    camera.check_pinhole("expected a pinhole for a reference")
    near = float(near_limit(camera, mesh.opaque.bounds, pose[None])[0])
    points = _rotate(mesh.vertices - pose[:3, 3], pose)
    ahead_points = points[:, 2] >= near
    safe = np.where(ahead_points[:, None], points, (0.0, 0.0, 1.0))
    u, v = to_image(safe, camera).T
    inside_points = ahead_points & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)

    # Corners as rows, (3, F): numpy is quick along long rows and slow along rows of three.
    corners = np.ascontiguousarray(mesh.faces.T)
    ahead = _all3(ahead_points[corners])
    in_view = _all3(inside_points[corners])
    u, v = u[corners], v[corners]
    du, dv = u[[1, 2, 0]] - u, v[[1, 2, 0]] - v
    area = np.abs(du[0] * dv[1] - dv[0] * du[1]) / 2
    with np.errstate(over="ignore", under="ignore"):
        perimeter = _sum3(np.sqrt(du * du + dv * dv))
    fraction = (in_view & (area > 0)).astype(np.float64)

    # The rest is for the faces that cross the near plane or the image border, usually few.
    cut = np.flatnonzero(~ahead)
    area[cut], perimeter[cut] = 0.0, np.inf
    crossing = cut[ahead_points[mesh.faces[cut]].any(axis=1)]
    maybe = np.flatnonzero(ahead & ~in_view & (area > 0))
    low_u, high_u = u[:, maybe].min(axis=0), u[:, maybe].max(axis=0)
    low_v, high_v = v[:, maybe].min(axis=0), v[:, maybe].max(axis=0)
    touching = (high_u > 0) & (low_u < camera.width) & (high_v > 0) & (low_v < camera.height)
    partly = np.concatenate((crossing, maybe[touching]))
    if partly.size:
        polygons, counts = clip_near(points[mesh.faces[partly]], near)
        image = to_image(polygons, camera)
        whole = np.abs(polygon_area(image, counts))
        shown = np.abs(polygon_area(*clip_to_image(image, counts, camera)))
        area[partly] = whole
        fraction[partly] = np.divide(shown, whole, out=np.zeros_like(whole), where=whole > 0)

    # In camera axes the ray from the centroid to the centre is minus the centroid itself, and three
    # times the centroid has its direction.
    normals = _rotate(mesh.normals, pose)
    x, y, z = (_sum3(column[corners]) for column in points.T)
    against = -(normals[:, 0] * x + normals[:, 1] * y + normals[:, 2] * z)
    reach = np.sqrt(x * x + y * y + z * z)
    cosine = np.divide(against, reach, out=np.zeros_like(reach), where=reach > 0)
    cosine = np.where(mesh.two_sided_mask, np.abs(cosine), cosine)
    is_front = ~mesh.degenerate_mask & (cosine > 0)

    density = np.zeros(mesh.n_faces)
    counted = np.flatnonzero(is_front & ahead & (fraction > 0))
    density[counted] = _pixel_density(safe, mesh.faces[counted], normals[counted], camera)
    facing = np.where(ahead, min(camera.fx, camera.fy) / safe[:, 2][corners].max(axis=0), 0.0)
    return FaceGeometry(
        is_front=is_front,
        in_view=in_view,
        in_view_fraction=np.minimum(fraction, 1.0),
        projected_area=area,
        perimeter=perimeter,
        pixel_density=density,
        facing_density=facing,
        depth=points[:, 2][corners].T,
        centre_depth=_sum3(points[:, 2][corners]) / 3,
        incidence=np.arccos(np.clip(cosine, -1.0, 1.0)),
    )


def _rotate(vectors: FloatArray, pose: FloatArray) -> FloatArray:
    """World vectors (N, 3) in camera axes; a product of matrices would add in another order."""
    a, b, c = vectors.T
    return np.stack([a * r[0] + b * r[1] + c * r[2] for r in pose[:3, :3].T], axis=1)


def _sum3(rows: FloatArray) -> FloatArray:
    return rows[0] + rows[1] + rows[2]


def _all3(rows: BoolArray) -> BoolArray:
    return rows[0] & rows[1] & rows[2]


def _pixel_density(
    points: FloatArray, faces: IntArray, normals: FloatArray, camera: Camera
) -> FloatArray:
    """Least singular value of the projection restricted to the face's plane, px/m.

    With tangents e_1, e_2 of the face and p = (x, y, z) a vertex, column i of the Jacobian is ((fx
    (e_ix - x/z e_iz))/z, (fy (e_iy - y/z e_iz))/z). Its singular values are the pixels per metre
    along the best and the worst direction on the surface.
    """
    # Two tangents of a unit normal without a branch (Duff et al. Building an Orthonormal Basis,
    # Revisited. 2017).
    x, y, z = normals.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack((1 + sign * x * x * a, sign * b, -sign * x), axis=1)
    second = np.stack((b, sign + y * y * a, -y), axis=1)
    worst = np.full(len(faces), np.inf)
    for corner in range(3):
        u, v, w = points[faces[:, corner]].T
        right, down = u / w, v / w
        a1 = camera.fx * (first[:, 0] - right * first[:, 2])
        a2 = camera.fx * (second[:, 0] - right * second[:, 2])
        b1 = camera.fy * (first[:, 1] - down * first[:, 2])
        b2 = camera.fy * (second[:, 1] - down * second[:, 2])
        total = a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2
        det = np.abs(a1 * b2 - a2 * b1)
        greatest = np.sqrt((total + np.sqrt(np.maximum(total**2 - 4 * det**2, 0))) / 2)
        # The square of the depth would underflow for a very small mesh.
        worst = np.minimum(worst, det / (greatest * w))
    return worst


def polygon_area(corners: FloatArray, counts: IntArray) -> FloatArray:
    """Area of each polygon by (3.9), px^2, positive where it runs clockwise in the image (v down).

    Corners are padded as `clip_polygons` returns them, (N, K, 2); fewer than 3 have no area.
    """
    local = corners - corners[:, :1]  # differences first: no cancellation far from the origin
    ahead = np.roll(local, -1, axis=1)
    twice = (local[..., 0] * ahead[..., 1] - local[..., 1] * ahead[..., 0]).sum(axis=1)
    return np.where(counts >= 3, twice / 2, 0.0)


def clip_polygons(
    corners: FloatArray, counts: IntArray, distance: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Clip each convex polygon to where `distance` is not negative (Sutherland-Hodgman).

    Parameters
    ----------
    corners : (N, K, D) float64
        Corners in order; rows past a polygon's count repeat its last corner.
    counts : (N,) int
        Corners in use, 0 for an empty polygon.
    distance : (N, K) float64
        Signed distance of each corner from the clipping plane, affine along the edges.

    Returns
    -------
    corners : (N, K + 1 or more, D) float64
        Padded like the input.
    counts : (N,) int
    """
    n, k, d = corners.shape
    used = np.arange(k) < counts[:, None]
    following = np.where(np.arange(k) + 1 < counts[:, None], np.arange(k) + 1, 0)
    next_corner = np.take_along_axis(corners, following[:, :, None], axis=1)
    next_distance = np.take_along_axis(distance, following, axis=1)
    kept = used & (distance >= 0)
    crossed = used & ((distance >= 0) != (next_distance >= 0))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(crossed, distance / (distance - next_distance), 0.0)
    cut = corners + t[:, :, None] * (next_corner - corners)

    # Each corner is followed by the cut on the edge that leaves it; then close the gaps.
    both = np.stack((corners, cut), axis=2).reshape(n, 2 * k, d)
    alive = np.stack((kept, crossed), axis=2).reshape(n, 2 * k)
    new_counts = alive.sum(axis=1)
    # A convex polygon gains a corner at most; one that lies in the cut itself, where rounding
    # decides the signs, can gain more.
    width = max(k + 1, int(new_counts.max(initial=0)))
    order = np.argsort(~alive, axis=1, kind="stable")[:, :width]
    last = np.maximum(new_counts - 1, 0)[:, None]
    order = np.take_along_axis(order, np.minimum(np.arange(width), last), axis=1)
    return np.take_along_axis(both, order[:, :, None], axis=1), new_counts


def clip_near(corners: FloatArray, near: float) -> tuple[FloatArray, IntArray]:
    """Faces cut at the near plane: (N, 3, 3) in camera axes -> (N, 4, 3) and their counts."""
    counts = np.full(len(corners), 3)
    return clip_polygons(corners, counts, corners[..., 2] - near)


def clip_to_image(
    corners: FloatArray, counts: IntArray, camera: Camera
) -> tuple[FloatArray, IntArray]:
    """Image polygons cut at the image border: (N, K, 2) -> (N, K + 4, 2) and their counts."""
    for axis, side in ((0, camera.width), (1, camera.height)):
        corners, counts = clip_polygons(corners, counts, corners[..., axis])
        corners, counts = clip_polygons(corners, counts, side - corners[..., axis])
    return corners, counts


def depth_from_near(points: FloatArray, camera: Camera) -> FloatArray:
    """(...) depth of points (..., 3) in camera axes that is compared with the near limit, metres.

    z, or the greatest coordinate for a lens of several ideal planes, whose near planes are the
    sides of a cube.
    """
    planes = planes_of(camera) if camera.is_curved else ()
    if len({each.record.frame.tobytes() for each in planes}) > 1:
        return np.abs(points).max(axis=-1)
    return points[..., 2]


def blur_circle(camera: Camera, depth: FloatArray) -> FloatArray:
    """Diameter of the blur circle at some depths, px, limited by (3.10) and (3.11).

    A f (z - z_s) / (z (z_s - f)) over the smaller side of a pixel, so that it is negative before
    the plane in focus; 0 for a camera without a lens.
    """
    if camera.aperture is None or camera.focus_distance is None:
        return np.zeros_like(depth)
    assert camera.focal_length is not None
    assert camera.pixel_size is not None
    size = camera.aperture / min(camera.pixel_size) * camera.focal_length
    size /= camera.focus_distance - camera.focal_length
    return size * (depth - camera.focus_distance) / depth


def in_focus(
    geometry: FaceGeometry, limits: tuple[float, float], rule: str = "vertices"
) -> BoolArray:
    """Mask of the faces within the depth of field, (3.12).

    Parameters
    ----------
    geometry : FaceGeometry
        Its depths are compared.
    limits : (float, float)
        z_n and z_f of (3.10) and (3.11), metres.
    rule : {"vertices", "centroid"}
        Definition 1 asks it of every vertex; (3.12), read exactly, of the centroid.
    """
    z_n, z_f = limits
    depth = geometry.centre_depth[:, None] if rule == "centroid" else geometry.depth
    return np.all((z_n <= depth) & (depth <= z_f), axis=1)


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
        "in_focus": in_focus(geometry, limits, task.focus_rule),
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
    mask = np.zeros(mesh.n_faces, bool)
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
        "none": np.zeros(is_seen.shape, bool),
        "covered": coverage.reason == Reason.COVERED,
        "seen": is_seen,
        "all": np.ones(is_seen.shape, bool),
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
