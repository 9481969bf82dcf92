"""Visible polygons of faces by polygon Booleans: a reference, written for clarity.

Beyond the near plane and inside the image rectangle every face has a convex image. On it 1/depth,
w, is affine, so where face M is nearer than face T is a half-plane of the image, and

    visible(T) = image(T)  minus the union over M of  image(T) n image(M) n {w_M > w_T}.

No sorting: it holds for faces that run through one another and for cycles. Of two faces whose w
differs by 1e-10 of the greater one or less at every corner of image(T) n image(M), the lower index
is in front there. Targets hide nothing, and nothing at their depth hides them. Faces seen edge-on
or without area see and hide nothing.

The Booleans are GEOS' by way of shapely, with corners rounded to a fine grid (2^-37 px in an image
1280 px wide): then GEOS does them by snap rounding, at five times the cost. Without a grid it was
wrong without an error in one of ten thousand intersections of triangles that share a corner or an
edge, and gave one of them whole, or nothing; and a union can lose a piece. So each Boolean is
checked: the union and the intersection of two images have the area of both, and the rest of a face
is computed again by Clipper2, or piece by piece where that is not installed. What differs is an
error.

Differs from exact arithmetic (`rastercov.reference.rational`) by less than 1e-7 px^2 per face and
megapixel, unless two faces are so nearly coplanar that floats cannot say where they cross. Under a
millisecond per face. Shares nothing with the fast path but mesh, camera and near limit.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from rastercov.base import BoolArray, FloatArray, IntArray, RastercovError, frozen_record
from rastercov.core.camera import Camera, box_corners, near_limit
from rastercov.core.camera.pose import sides_of
from rastercov.core.mesh import Mesh

clipper2: Any
try:
    import clipper2
except ImportError:
    clipper2 = None

__all__ = ["PolygonError", "image_area", "visible_area", "visible_polygons"]

Geometries = NDArray[np.object_]

TIE = 1e-10
"""Relative difference up to which two depths are equal."""
GRID_BITS = 48
"""Bits of a coordinate; 53 leave GEOS no room and make it fail."""
AREA_TOLERANCE = 1e-7
"""Square pixels that a Boolean, or the repair of its input, may gain or lose per megapixel."""
BLOCK = 2048  # faces asked for at once: about 100 MB of polygons


class PolygonError(RastercovError, ArithmeticError):
    """GEOS could not do a Boolean, or gave one that is wrong by its areas or a second way."""


def visible_area(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    cull: bool = False,
    near: float | None = None,
) -> FloatArray:
    """Area of the image in which each face is the nearest surface, px^2.

    Parameters
    ----------
    mesh, camera, pose
        Scene and camera; world_from_camera, (4, 4).
    faces : (N,) int, optional
        Faces to measure; all unless given. All faces of the mesh hide.
    cull : bool
        True to leave out back faces, which then do not hide either.
    near : float, optional
        Depth in metres below which nothing is seen; `near_limit` unless given.

    Returns
    -------
    (N,) float64
        In the order of `faces`; 0 for faces that are hidden, outside or seen edge-on.

    Raises
    ------
    PolygonError
        A Boolean failed; the message names the faces.
    """
    polygons = visible_polygons(mesh, camera, pose, faces, cull=cull, near=near)
    return np.asarray(shapely.area(polygons), np.float64)


def image_area(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    cull: bool = False,
    near: float | None = None,
) -> FloatArray:
    """Area of each face that would be visible were it alone, (N,) px^2; see `visible_area`."""
    images = images_of(mesh, camera, pose, cull=cull, near=near)
    return np.asarray(shapely.area(images.polygons[_faces_to_evaluate(faces, mesh)]), np.float64)


def visible_polygons(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    cull: bool = False,
    near: float | None = None,
) -> list[BaseGeometry]:
    """Part of the image, in pixels, in which each face is the nearest surface.

    Arguments and errors as for `visible_area`. Polygons and multipolygons, N of them; empty for
    faces that are not seen.
    """
    images = images_of(mesh, camera, pose, cull=cull, near=near)
    asked = _faces_to_evaluate(faces, mesh)
    tree = shapely.STRtree(images.polygons)
    visible: list[BaseGeometry] = []
    for start in range(0, len(asked), BLOCK):
        visible += visible_in(images, tree, asked[start : start + BLOCK])
    return visible


@frozen_record
class Images:
    """Faces in the image of one camera.

    Attributes
    ----------
    polygons : (F,) Polygon
        Convex; empty where there is nothing to see.
    normal, distance : (F, 3), (F,) float64
        normal . p = distance on the plane of the face, in camera axes.
    camera : Camera
    is_target : (F,) bool
        Faces that hide nothing.
    """

    polygons: Geometries
    normal: FloatArray
    distance: FloatArray
    camera: Camera
    is_target: BoolArray

    def inverse_depth(self, face: IntArray, points: FloatArray) -> FloatArray:
        """1/depth of faces at image points (..., 2): (n . r) / d on the ray r through a point."""
        camera = self.camera
        x, y = ((points - (camera.cx, camera.cy)) / (camera.fx, camera.fy)).T
        n = self.normal[face].T
        return (n[0] * x + n[1] * y + n[2]) / self.distance[face]

    @property
    def grid(self) -> float:
        """Pixels to which Booleans round: a power of two, so that coordinates scale exactly."""
        side = max(self.camera.width, self.camera.height)
        return 2.0 ** (side.bit_length() - GRID_BITS)

    @property
    def tolerance(self) -> float:
        """Square pixels by which areas may fail to add up."""
        return AREA_TOLERANCE * max(1.0, self.camera.width * self.camera.height / 1e6)

    def inverse_depth_range(self) -> tuple[FloatArray, FloatArray]:
        """Greatest and least 1/depth in the image of each face, (F,) each."""
        points, face = shapely.get_coordinates(self.polygons, return_index=True)
        inverse = self.inverse_depth(face, points)
        near, far = np.full((2, len(self.polygons)), np.nan)
        np.fmax.at(near, face, inverse)
        np.fmin.at(far, face, inverse)
        return near, far


def visible_from(
    mesh: Mesh, camera: Camera, pose: ArrayLike, near: float | None
) -> tuple[FloatArray, float]:
    """Pose of a pinhole as a matrix, and the depth below which nothing is seen, metres."""
    if camera.is_curved:
        camera.check_pinhole(
            "expected a pinhole for a reference", "use rastercov.reference.rational"
        )
    matrix = np.asarray(pose, np.float64)
    if near is None:
        near = float(near_limit(camera, mesh.opaque.bounds, matrix[None])[0])
    if not near > 0:
        raise ValueError(f"expected near above 0 m, got {near}; give a depth")
    return matrix, near


def farthest_of(mesh: Mesh, pose: FloatArray, near: float) -> float:
    """C of parallel rays, metres: beyond the deepest corner of the bounding box by a diagonal."""
    depths = (box_corners(mesh.bounds) - pose[:3, 3]) @ pose[:3, 2]
    size = float(np.linalg.norm(np.ptp(mesh.opaque.bounds, axis=0)))
    return max(float(depths.max()), near) + (max(size, float(np.ptp(depths))) or 1.0)


def as_central(points: FloatArray, farthest: float) -> FloatArray:
    """Points (..., 3) that a pinhole at the origin sees as parallel rays see those in camera axes.

    By the homography (x, y, z) -> (x, y, 1) / (C - z), which keeps lines and their order.
    """
    w = farthest - points[..., 2:]
    return np.concatenate((points[..., :2] / w, 1 / w), axis=-1)


def images_of(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    *,
    cull: bool = False,
    near: float | None = None,
) -> Images:
    """Image of each face: cut in space by near plane and viewing pyramid, then projected.

    Parallel rays are those of a pinhole to points in other places, see `as_central`.
    """
    matrix, near = visible_from(mesh, camera, pose, near)
    points = (mesh.vertices - matrix[:3, 3]) @ matrix[:3, :3]
    if camera.is_parallel:
        farthest = farthest_of(mesh, matrix, near)
        points, near = as_central(points, farthest), 1 / (farthest - near)
        own = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
        camera = Camera(**own)
    corners = points[mesh.faces]
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    distance = (normal * a).sum(axis=1)
    # 0 is edge-on, < 0 seen from the front
    is_drawn = (distance < 0) | (mesh.target_mask & (distance > 0)) if cull else distance != 0

    # A point (x, y, z) is in view where all of these are >= 0: beyond near, and within the image.
    sides = np.array([(0, 0, 1), *sides_of(camera)])
    offsets = np.array((near, 0, 0, 0, 0))
    inside = corners @ sides.T - offsets >= 0
    polygons = np.full(mesh.n_faces, shapely.Polygon(), dtype=object)
    whole = np.flatnonzero(is_drawn & inside.all(axis=(1, 2)))
    polygons[whole] = shapely.linearrings(_project(corners[whole], camera))
    # Faces that no side has wholly beyond it: a loop over those on the border, 0.1 ms each.
    border = is_drawn & inside.any(axis=1).all(axis=1) & ~inside.all(axis=(1, 2))
    for face in np.flatnonzero(border):
        points = corners[face]
        for side, offset in zip(sides, offsets, strict=True):
            points = _clip(points, points @ side - offset)
        if len(points) >= 3:
            polygons[face] = shapely.linearrings(_project(points, camera))
    return Images(_convex(polygons), normal, distance, camera, mesh.target_mask)


def _project(points: FloatArray, camera: Camera) -> FloatArray:
    """Image points, in pixels, of points (..., 3) in camera axes with z > 0."""
    tangents = points[..., :2] / points[..., 2:]
    return tangents * (camera.fx, camera.fy) + (camera.cx, camera.cy)


def _clip(points: FloatArray, values: FloatArray) -> FloatArray:
    """Convex polygon (K, D) cut to where an affine function, known at its corners, is >= 0."""
    kept = []
    for i, (point, value) in enumerate(zip(points, values, strict=True)):
        if (values[i - 1] >= 0) != (value >= 0):
            share = value / (value - values[i - 1])
            kept.append(point + share * (points[i - 1] - point))
        if value >= 0:
            kept.append(point)
    return np.array(kept).reshape(-1, points.shape[1])


def _convex(shapes: Geometries) -> Geometries:
    """Polygons that are convex by definition, made so and valid where rounding spoilt it.

    What has no area becomes an empty polygon.
    """
    hulls = np.asarray(shapely.convex_hull(shapes), object)
    return np.where(shapely.area(hulls) > 0, hulls, shapely.Polygon())


def visible_in(images: Images, tree: shapely.STRtree, faces: IntArray) -> list[BaseGeometry]:
    """Visible part of each of some faces."""
    rows, others = tree.query(images.polygons[faces], predicate="intersects")
    order = np.lexsort((others, rows))
    rows, others = rows[order], others[order]
    # Neighbours only touch, and many others are wholly behind: not worth an intersection.
    near, far = images.inverse_depth_range()
    is_pair = (faces[rows] != others) & ~images.is_target[others]
    is_pair &= near[others] >= far[faces[rows]] * (1 - 2 * TIE)
    rows, others = rows[is_pair], others[is_pair]
    is_pair = ~shapely.touches(images.polygons[faces[rows]], images.polygons[others])
    rows, others = rows[is_pair], others[is_pair]

    common = _convex(_intersection(images, faces[rows], others))
    has_area = ~shapely.is_empty(common)
    rows, others, common = rows[has_area], others[has_area], common[has_area]
    hidden = _where_nearer(images, common, others, faces[rows])
    is_hiding = ~shapely.is_empty(hidden)
    rows, others, hidden = rows[is_hiding], others[is_hiding], hidden[is_hiding]

    visible = []
    ends = np.searchsorted(rows, np.arange(len(faces) + 1))
    for face, low, high in zip(faces, ends, ends[1:], strict=False):  # some 0.5 ms each
        names = [int(face), *others[low:high].tolist()]
        visible.append(_minus(images, images.polygons[face], hidden[low:high], names))
    return visible


def _where_nearer(
    images: Images, common: Geometries, faces: IntArray, others: IntArray
) -> Geometries:
    """Part of each polygon `common` in which a face is nearer than the other one."""
    points, which = shapely.get_coordinates(common, return_index=True)
    ours = images.inverse_depth(faces[which], points)
    theirs = images.inverse_depth(others[which], points)

    def at_every_corner(holds: BoolArray) -> BoolArray:
        failures = np.bincount(which, ~holds, minlength=len(common))
        return np.asarray(failures == 0)

    is_tied = at_every_corner(np.abs(ours - theirs) <= TIE * np.maximum(ours, theirs))
    is_first = (faces < others) & ~images.is_target[others]
    is_nearer = np.where(is_tied, is_first, at_every_corner(ours >= theirs))
    nearer = np.where(is_nearer, common, shapely.Polygon())
    is_mixed = ~is_tied & ~is_nearer & ~at_every_corner(ours <= theirs)
    for pair in np.flatnonzero(is_mixed):  # a loop over pairs that cross, 30 us each
        at = slice(*np.searchsorted(which, (pair, pair + 1)))
        part = _clip(points[at][:-1], (ours - theirs)[at][:-1])  # a ring repeats its first corner
        nearer[pair] = shapely.MultiPoint(part)
    nearer[is_mixed] = _convex(nearer[is_mixed])
    return nearer


def _intersection(images: Images, one: IntArray, other: IntArray) -> Geometries:
    """Common part of each pair of faces' images."""
    polygons, pairs = images.polygons, zip(one.tolist(), other.tolist(), strict=True)
    try:
        common = shapely.intersection(polygons[one], polygons[other], grid_size=images.grid)
        either = shapely.union(polygons[one], polygons[other], grid_size=images.grid)
    except shapely.GEOSException:
        common = [_intersection_of_pair(images, i, j) for i, j in pairs]
        return np.asarray(common, object)
    both = shapely.area(polygons[one]) + shapely.area(polygons[other])
    excess = shapely.area(common) + shapely.area(either) - both
    for pair in np.flatnonzero(~(np.abs(excess) <= images.tolerance)):
        common[pair] = _intersection_of_pair(images, int(one[pair]), int(other[pair]))
    return np.asarray(common, object)


def _intersection_of_pair(images: Images, i: int, j: int) -> BaseGeometry:
    reason: object = None
    for a, b in _repair(images, list(images.polygons[[i, j]]), [i, j]):
        try:
            common = shapely.intersection(a, b, grid_size=images.grid)
            either = shapely.union(a, b, grid_size=images.grid)
        except shapely.GEOSException as error:
            reason = error
            continue
        excess = common.area + either.area - a.area - b.area
        if abs(excess) <= images.tolerance:
            return common
        reason = f"with the union it has {excess:.3g} px^2 too much"
    raise PolygonError(
        f"expected an intersection of the images of faces {i} and {j}, got none: {reason}"
    )


def _minus(
    images: Images, whole: BaseGeometry, pieces: Geometries, faces: Sequence[int]
) -> BaseGeometry:
    """Difference of a polygon and pieces of it; errors name `faces`, that of `whole` first.

    GEOS gives the union and the difference, so their areas must add up to the whole; and a second
    way must leave as much.
    """
    if len(pieces) == 0:
        return whole
    reason: object = None
    for body, *parts in _repair(images, [whole, *pieces], faces):
        try:
            hidden = shapely.union_all(parts, grid_size=images.grid)
            left = shapely.difference(body, hidden, grid_size=images.grid)
        except shapely.GEOSException as error:
            reason = error
            continue
        excess = left.area + hidden.area - whole.area
        if not abs(excess) <= images.tolerance:
            reason = f"parts add up to {excess:.3g} px^2 too much"
            continue
        for again in _cover_again(body, parts, images):
            apart = left.area - again
            if abs(apart) <= images.tolerance:
                return left
        reason = f"GEOS leaves {apart:.3g} px^2 more than a second way"
    raise PolygonError(
        f"expected a visible part of face {faces[0]} behind {faces[1:]}, got none: {reason}"
    )


def _cover_again(
    whole: BaseGeometry, pieces: list[BaseGeometry], images: Images
) -> Iterator[float]:
    """Area of a polygon without pieces of it, px^2, by other ways than a union of GEOS.

    Clipper2 rounds corners to whole numbers, on several grids in turn.
    """
    if clipper2 is None:
        for piece in pieces:
            left = shapely.difference(whole, piece, grid_size=images.grid)
            whole = shapely.MultiPolygon([each for each in shapely.get_parts(left) if each.area])
        yield whole.area
        return
    for bits in (0, 3, 6):
        scale = 2.0**-bits / images.grid
        body, *parts = (
            [np.rint(ring * scale).astype(np.int64) for ring in _rings(each)]
            for each in (whole, *pieces)
        )
        job = clipper2.Clipper64()
        job.add_subject(body)
        job.add_clip([ring for rings in parts for ring in rings])
        rings, _ = job.execute(clipper2.ClipType.DIFFERENCE, clipper2.FillRule.NON_ZERO)
        yield sum(_area_with_sign(np.asarray(ring)) for ring in rings) / scale**2


def _rings(polygon: BaseGeometry) -> list[FloatArray]:
    """Outer corners of the parts of a polygon, which have no holes, counter-clockwise."""
    parts = shapely.orient_polygons(shapely.get_parts(polygon))
    return [shapely.get_coordinates(part)[:-1] for part in parts if part.area > 0]


def _area_with_sign(ring: IntArray) -> float:
    u, v = (ring - ring[0]).T.astype(np.float64)
    return float(u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2


def _repair(
    images: Images, polygons: list[BaseGeometry], faces: Sequence[int]
) -> Iterator[list[BaseGeometry]]:
    """Yield the polygons as they are, then, for whom that was not good enough, made valid.

    Very thin images fail in GEOS; on the grid they do not.
    """
    yield polygons
    valid = (shapely.make_valid(polygon) for polygon in polygons)
    repaired = [shapely.set_precision(polygon, images.grid) for polygon in valid]
    for before, after, face in zip(polygons, repaired, faces, strict=True):
        if not abs(before.area - after.area) <= images.tolerance:
            raise PolygonError(
                f"expected an area of {before.area} px^2 of face {face} when made valid, got "
                f"{after.area}"
            )
    yield repaired


def _faces_to_evaluate(faces: ArrayLike | None, mesh: Mesh) -> IntArray:
    """Face indices as an array; IndexError for one that is not there."""
    if faces is None:
        return np.arange(mesh.n_faces)
    indices = np.asarray(faces, np.int64).ravel()
    if ((indices < 0) | (indices >= mesh.n_faces)).any():
        raise IndexError(f"expected faces of 0 to {mesh.n_faces - 1}, got {indices}; correct them")
    return indices
