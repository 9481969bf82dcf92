"""Criteria of all faces of one pose with whole arrays: the twin of `engine/coverage/criteria.hpp`.

The same figures in the same order of operations, so both give the same bits, except angles of
incidence, for which numpy and the C library have different arccosines, and areas of faces that the
near plane or the image border cuts, whose terms numpy may add in another order.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
"""

import numpy as np

from rastercov.base import BoolArray, ByName, FloatArray, IntArray, frozen_record
from rastercov.core.camera import MODELS, Camera, Poses, near_limit, to_camera, to_image
from rastercov.core.camera.lenses.of_camera import planes_of
from rastercov.core.coverage.face_pass import FIGURES, FacePass
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import BoundKind, Observation


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
        Camera z of the vertices, metres.
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
    seen = Observation(none, none, kind, none, np.zeros(1, np.bool_))
    FacePass(mesh, camera, 1).fill(seen, Poses.of(pose), table)
    figures: ByName = {name: values[0] for name, values in table.items()}
    is_front = figures.pop("reason") > Reason.BACK_FACING
    outline = np.full(mesh.n_faces, np.nan)
    points = to_camera(mesh.vertices, pose)
    by_distance = not (camera.is_pinhole or MODELS[camera.model].is_planar)
    depth = np.linalg.norm(points, axis=1) if by_distance else points[:, 2]
    return FaceGeometry(is_front=is_front, perimeter=outline, depth=depth[mesh.faces], **figures)


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


def in_focus(depth: FloatArray, limits: tuple[float, float], rule: str = "vertices") -> BoolArray:
    """Mask of the faces within the depth of field, (3.12).

    Parameters
    ----------
    depth : (F, 3) float64
        Camera z of the vertices, metres.
    limits : (float, float)
        z_n and z_f of (3.10) and (3.11), metres.
    rule : {"vertices", "centroid"}
        Definition 1 asks it of every vertex; (3.12), read exactly, of the centroid.
    """
    z_n, z_f = limits
    if rule == "centroid":
        centre = (depth[:, 0] + depth[:, 1] + depth[:, 2]) / 3
        return (z_n <= centre) & (centre <= z_f)
    return np.all((z_n <= depth) & (depth <= z_f), axis=1)
