"""Coverage of single points, by definition: the twin of `rastercov.core.area`.

Each point is tested against every triangle, and each criterion is evaluated from its formula. There
are no polygons, planes in the image or event edges here. The near plane, ties at equal depth and
the side that counts are those of docs/conventions.md.
"""

import math
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base import AnyArray, BoolArray, ByteArray, FloatArray, IntArray
from rastercov.base.features import FEATURES
from rastercov.core.area.relaxed import without_borders
from rastercov.core.camera import MODELS, Camera, Gate, Rig, eyes_of, near_limit, valid_poses
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.coverage.task import (
    BASELINE,
    BITS,
    CRITERIA,
    NAMES,
    ROW_OF,
    Reason,
    Task,
    code_of,
    own_reasons,
    tasks_of,
)
from rastercov.core.mesh import Mesh
from rastercov.reference.coverage import surely_unseen
from rastercov.reference.polygons import as_central, farthest_of
from rastercov.reference.telecentric import image_of, slopes_of

AT_ONCE = 1 << 16
"""Pairs of point and face that are judged together."""
DEPTH_TIE_REL = 1e-10
"""Relative difference of 1/z up to which two surfaces coincide: the lower index is in front."""


def points_on(mesh: Mesh, n: int, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """Quasi-random points on the surface, in proportion to area: (n, 3) metres, and their faces.

    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018 (R2).
    """
    total = np.cumsum(mesh.areas)
    at = (np.arange(n) + 0.5) / n * total[-1]
    face = np.minimum(np.searchsorted(total, at), mesh.n_faces - 1)
    k = np.arange(n) - np.searchsorted(face, face) + 1
    offset = np.random.default_rng(seed).random((2, mesh.n_faces))[:, face]
    x = (offset[0] + k * 0.7548776662466927) % 1
    y = (offset[1] + k * 0.5698402909980532) % 1
    over = x + y > 1
    x[over], y[over] = 1 - x[over], 1 - y[over]
    weights = np.stack([1 - x - y, x, y], axis=1)
    return np.einsum("nk,nki->ni", weights, mesh.vertices[mesh.faces[face]]), face


class PointTwin:
    """Twin of a feature with equipment, or gates that ask for more than a count, by points.

    Module `rastercov.reference.NAME` has that of the feature NAME, `TWIN`.
    """

    word = ""
    """Of its equipment, if any."""
    reason: str
    """Name of that of points where it does not hold."""

    def holds(
        self, mesh: Mesh, own: Any, points: FloatArray, face: IntArray, world_from_rig: FloatArray
    ) -> BoolArray:
        """(2, N) whether it does at points of faces, on their front and rear."""
        raise NotImplementedError  # each criterion has its own

    def holds_together(self, gate: Gate, rays: FloatArray) -> bool | BoolArray:
        """(R, N) whether a gate does, by the rays from N points to n devices in R poses."""
        return True


@cache
def point_twins() -> tuple[PointTwin, ...]:
    """Twins of all features that have one."""
    modules = (f"rastercov.reference.{name}" for name in FEATURES)
    return tuple(import_module(each).TWIN for each in modules if find_spec(each))


def covers_points(
    mesh: Mesh,
    camera: Camera,
    poses: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> BoolArray:
    """Mask of the points of faces that each pose covers, (P, N); see `reasons_in_poses`."""
    reasons = reasons_in_poses(mesh, camera, poses, task, points, face)
    return np.asarray(reasons == Reason.COVERED)


def reasons_in_poses(
    mesh: Mesh,
    camera: Camera,
    poses: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> ByteArray:
    """(P, N) row of `REASONS` of points of faces in each pose: all criteria that fail.

    Parameters
    ----------
    mesh, camera, task
        Scene, camera, thresholds of `rastercov.regions`.
    poses : (P, 4, 4) float64
        world_from_camera.
    points, face : (N, 3) float64, (N,) int
        Points of faces, metres.
    """
    bits, alone = _fails_in_poses(mesh, camera, poses, task, points, face)
    result = _ROWS[bits]
    result[alone > 0] = alone[alone > 0]
    own = own_reasons(mesh, task)[face]
    return np.where(result == Reason.COVERED, own, result).astype(np.uint8)


_ROWS = np.array([Reason.COVERED, *(ROW_OF[bits] for bits in range(1, 32))], np.uint8)
"""Rows of `REASONS` by the bits of the criteria that fail."""


def _fails_in_poses(
    mesh: Mesh,
    camera: Camera,
    poses: NDArray[Any],
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> tuple[ByteArray, ByteArray]:
    """Bits of the criteria that points fail in each pose, (P, N), and reasons of one alone."""
    matrices = valid_poses(poses)
    near = near_limit(camera, mesh.bounds, matrices)
    is_wide = _is_wide(camera)
    bits = np.zeros((len(matrices), len(points)), np.uint8)
    alone = np.zeros_like(bits)
    for row, pose in enumerate(matrices):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        corners = (mesh.vertices[mesh.faces] - pose[:3, 3]) @ pose[:3, :3]
        criteria = meets_criteria(mesh, camera, task, pose, near[row], local, face)
        wide = without_borders(camera)
        ahead = meets_criteria(mesh, wide, Task(), pose, near[row], local, face)[Reason.OUTSIDE]
        is_open, its_near = mesh.degenerate_mask | mesh.target_mask, float(near[row])
        if camera.is_parallel:
            farthest = farthest_of(mesh, pose, its_near)
            corners, local = (as_central(each, farthest) for each in (corners, local))
            its_near = 1 / (farthest - its_near)
        depth = _depth(local, is_wide=is_wide)
        front = criteria.pop(Reason.BACK_FACING)
        criteria[Reason.OCCLUDED] = ~_find_hidden(
            corners,
            is_open,
            mesh.target_mask,
            its_near,
            local,
            depth,
            face.astype(np.int64),
            np.flatnonzero(front & ahead),
        )
        for reason, meets in criteria.items():
            bits[row][~meets] |= np.uint8(BITS[reason])
        alone[row][~ahead] = Reason.OUTSIDE
        alone[row][~front] = Reason.BACK_FACING
    return bits, alone


def rig_covers_points(
    mesh: Mesh,
    rig: Rig,
    world_from_rig: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> BoolArray:
    """Mask of the points of faces that each row of the result of a rig covers, (R, N).

    Each camera by itself as in `covers_points`; then those on either side of the face, counted, and
    the equipment of the rig on that side. A row is a pose of a rig with a rule, or of each camera.
    """
    placed, n = rig.poses(world_from_rig), len(rig)
    sees = np.empty((n, len(placed) // n, len(points)), bool)
    tasks = tasks_of(rig, task)
    for row, (camera, own) in enumerate(zip(rig.cameras, tasks, strict=True)):
        matrices = placed.world_from_camera[row::n]
        sees[row] = covers_points(mesh, camera, matrices, own, points, face)
    return _of_rig(mesh, rig, world_from_rig, sees, (points, face), ())


def _of_rig(
    mesh: Mesh,
    rig: Rig,
    world_from_rig: NDArray[Any],
    sees: BoolArray,
    on: tuple[FloatArray, IntArray],
    left: tuple[int, ...],
) -> BoolArray:
    """(R, N) points of faces that a rig covers, of what its cameras see, (n, R, N).

    `left` are rows of reasons of features that are not asked.
    """
    (points, face), n = on, len(rig)
    gate, placed = rig.gates.get(0), rig.poses(world_from_rig)
    eyes = eyes_of(rig, placed).reshape(-1, n, 1, 3).transpose(1, 0, 2, 3)
    front = np.einsum("nrpi,pi->nrp", eyes - points, mesh.normals[face]) > 0
    allowed = np.ones((2, *sees.shape[1:]), bool)
    for twin in point_twins():
        equipment = rig.equipment.get(twin.word)
        if equipment is not None and NAMES.index(twin.reason) not in left:
            own = [twin.holds(mesh, equipment, points, face, at) for at in world_from_rig]
            allowed &= np.stack(own, axis=1)
    if gate is None:
        alone = np.asarray(sees & np.where(front, *allowed), np.bool_)
        return alone.swapaxes(0, 1).reshape(-1, len(points))
    of_rig = np.zeros(sees.shape[1:], bool)
    for side, is_allowed in zip((front, ~front), allowed, strict=True):
        counts = (sees & side).sum(axis=0) >= gate.k
        for row in gate.needs:
            counts &= (sees & side)[row]
        of_rig |= counts & is_allowed
    for each in point_twins() if BASELINE not in left else ():
        of_rig &= each.holds_together(gate, eyes - points)
    return of_rig


def reasons_of_points(
    mesh: Mesh,
    camera: Camera | Rig,
    world_from_camera: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> NDArray[np.uint32]:
    """(N,) code of the reasons of points: the fewest criteria that must be met; or `COVERED`.

    Poses are those of the camera, or of the rig. A rig with a rule fails the criteria that enough
    of its cameras, on one side of the face, would have to meet. Of equally many criteria the later
    ones count.
    """
    passes = passing(mesh, camera, world_from_camera, task, points, face)
    first = tasks_of(camera, task)[0]
    own = own_reasons(mesh, first)[face]
    return reasons_by(lambda left: np.asarray(passes(left).any(axis=0)), own)


def passing(
    mesh: Mesh,
    camera: Camera | Rig,
    world_from_camera: NDArray[Any],
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> Callable[[tuple[int, ...] | None], BoolArray]:
    """Function of criteria for the points, (R, N), that rows of the result cover without these.

    For None it is true for points that they are in front of.
    """
    rig = camera if isinstance(camera, Rig) else Rig([camera])
    n, tasks = len(rig), tasks_of(rig, task)
    placed = rig.poses(world_from_camera).world_from_camera
    judged = [
        _fails_in_poses(mesh, one, placed[row::n], own, points, face)
        for row, (one, own) in enumerate(zip(rig.cameras, tasks, strict=True))
    ]
    bits, alone = (np.stack(each) for each in zip(*judged, strict=True))

    def passes(left: tuple[int, ...] | None) -> BoolArray:
        """(R, N) points that rows of the result cover; for None, that they are in front of."""
        some = np.bitwise_or.reduce(BITS[[*left]]) if left else np.uint32(0)
        sees = (
            (alone == 0) & (bits & ~some == 0) if left is not None else alone != Reason.BACK_FACING
        )
        left = CRITERIA if left is None else left
        return _of_rig(mesh, rig, world_from_camera, sees, (points, face), left)

    return passes


def reasons_by(
    passes: Callable[[tuple[int, ...] | None], BoolArray], own: ByteArray
) -> NDArray[np.uint32]:
    """(N,) code of the reasons of points: the fewest criteria without which they are covered.

    `passes` is true for points without some criteria, and `own` the reasons of their surface.
    """
    reasons = np.full(len(own), Reason.BACK_FACING, np.uint32)
    reasons[passes(None)] = Reason.OUTSIDE
    twins = {NAMES.index(each.reason) for each in point_twins()}
    every = [row for row in reversed(CRITERIA) if row < Reason.COVERED or row in twins]
    is_open = np.ones(len(own), bool)
    for left in (each for k in range(len(every) + 1) for each in combinations(every, k)):
        at = is_open & passes(left)
        is_open &= ~at
        for row in np.unique(own[at]).tolist():
            rows = left if row == Reason.COVERED else (*left, row)
            reasons[at & (own == row)] = code_of(rows) if rows else Reason.COVERED
    return reasons


def meets_criteria(
    mesh: Mesh,
    camera: Camera,
    task: Task,
    pose: FloatArray,
    near: float,
    local: FloatArray,
    face: IntArray,
) -> dict[Reason, BoolArray]:
    """Masks of the points, in camera axes, (N,), that meet each criterion but occlusion.

    By the reason of those that do not, in the order of `Reason`.
    """
    normal = mesh.normals[face] @ pose[:3, :3]
    z_n, z_f = camera.depth_of_field(task.max_blur)
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(local, axis=1)
        height = -np.einsum("ni,ni->n", normal, local)
        two_sided = mesh.two_sided_mask[face]
        facing = np.where(two_sided, np.abs(height), height)
        if camera.is_parallel:
            distance, facing = np.ones(len(local)), np.abs(normal[:, 2])
            facing = np.where(two_sided, facing, -normal[:, 2])
            is_in, per_m2, least = _along_rays(camera, local, facing, near)
            sharp = local[:, 2]
        elif camera.is_pinhole:
            is_in, per_m2, least = _through_pinhole(camera, local, facing, near)
            sharp = local[:, 2]
        else:
            is_in, per_m2, least = _through_lens(camera, local, normal, near)
            sharp = local[:, 2] if MODELS[camera.model].is_planar else distance
        front = (facing > 0) & mesh.task_mask[face] & ~mesh.degenerate_mask[face]
        away = mesh.vertices[mesh.faces[:, 0]] - pose[:3, 3]
        is_near = np.abs((mesh.normals * away).sum(axis=1)) <= 1e-9 * np.linalg.norm(away, axis=1)
        if not camera.is_parallel:
            front &= ~surely_unseen(mesh, pose, is_near)[face]
        cosine = math.cos(math.radians(task.max_incidence_deg))
        is_flat = (task.max_incidence_deg >= 90) | (facing >= distance * cosine)
        is_fine = np.ones(len(local), bool)
        if task.min_pixels_per_m2 > 0:
            is_fine &= per_m2 >= task.min_pixels_per_m2
        if task.min_facing_density > 0:
            is_fine &= least >= task.min_facing_density
    if task.min_pixel_density > 0:
        rows = np.flatnonzero(is_fine & front)
        with np.errstate(all="ignore"):
            jacobians = jacobian(camera, local[rows], normal[rows])
        has_image = np.isfinite(jacobians).all(axis=(1, 2))
        worst = np.linalg.svd(jacobians[has_image], compute_uv=False)[:, 1]
        is_fine[rows[has_image]] &= worst >= task.min_pixel_density
    if task.max_incidence_deg < 90:
        # A steep view counts as one at the largest angle that is allowed.
        focal = camera.fx, camera.fy
        across = 1.0 if camera.is_curved else min(focal) / math.sqrt(focal[0] * focal[1])
        wanted = (
            task.min_pixel_density / cosine,
            across * math.sqrt(task.min_pixels_per_m2 / cosine),
        )
        is_fine |= ~is_flat & (least >= max(task.min_facing_density, *wanted))
    return {
        Reason.BACK_FACING: front,
        Reason.OUTSIDE: is_in,
        Reason.OUT_OF_FOCUS: (z_n <= sharp) & (sharp <= z_f),
        Reason.TOO_COARSE: is_fine,
        Reason.TOO_OBLIQUE: is_flat,
    }


def _along_rays(
    camera: Camera, local: FloatArray, facing: FloatArray, near: float
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """As `_through_pinhole`, of parallel rays; `facing` is the cosine of the angle of incidence."""
    u, v = image_of(camera, local[:, 0], local[:, 1])
    J = slopes_of(camera, local[:, 0], local[:, 1])
    is_in = (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
    least = np.linalg.svd(J, compute_uv=False)[:, 1].astype(np.float64)
    per_m2: FloatArray = np.abs(np.linalg.det(J)) * facing
    return is_in & (local[:, 2] >= near), per_m2, least


def _through_pinhole(
    camera: Camera, local: FloatArray, facing: FloatArray, near: float
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Points in the image, pixels per m^2 of their planes, and pixels per metre facing the camera.

    The last is min(fx, fy) / z, the density of a target parallel to the image.
    """
    x, y, z = local.T
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    is_in = (z >= near) & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
    return is_in, camera.fx * camera.fy * facing / z**3, min(camera.fx, camera.fy) / z


def _through_lens(
    camera: Camera, local: FloatArray, normal: FloatArray, near: float
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """The same for a lens, by its derivative."""
    lens = lens_of(camera)
    (u, v), J = lens.project(local).T, lens.jacobian(local)
    is_in = (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
    is_in &= _depth(local, is_wide=_is_wide(camera)) >= near
    per_m2 = np.abs(np.einsum("ni,ni->n", np.cross(J[:, 0], J[:, 1]), normal))
    least = np.zeros(len(local))
    rows = np.isfinite(J).all(axis=(1, 2))
    least[rows] = np.linalg.svd(J[rows], compute_uv=False)[:, 1]
    return is_in, per_m2, least


def _is_wide(camera: Camera) -> bool:
    """True for a lens with several ideal planes: its near planes are a cube."""
    return camera.is_curved and len(lens_of(camera).planes) > 1


def _depth(local: FloatArray, *, is_wide: bool) -> FloatArray:
    """Depth that the near plane cuts, of points in camera axes."""
    return np.abs(local).max(axis=1) if is_wide else local[:, 2]


def jacobian(camera: Camera, local: FloatArray, normal: FloatArray) -> FloatArray:
    """Derivatives of the image position along two tangents of the surface, (N, 2, 2), px/m."""
    x, y, z = local.T
    axis = np.where(np.abs(normal[:, :1]) < 0.6, np.eye(3)[:1], np.eye(3)[1:2])
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(normal, first)], axis=2)
    if camera.is_parallel:
        return slopes_of(camera, x, y) @ tangents[:, :2]
    if not camera.is_pinhole:
        return lens_of(camera).jacobian(local) @ tangents
    projection = np.zeros((len(local), 2, 3))
    projection[:, 0, 0], projection[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    projection[:, 1, 1], projection[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    return projection @ tangents


def _find_hidden(
    corners: FloatArray,
    is_open: BoolArray,
    is_target: BoolArray,
    near: float,
    local: FloatArray,
    depth: FloatArray,
    face: IntArray,
    rows: IntArray,
) -> BoolArray:
    """Mask of the points, in camera axes, that some face in front of them hides, (N,).

    The ray through a point crosses a face if it is on the inner side of the planes through its
    edges and the camera centre. `is_open` are faces that hide nothing; of the points only `rows`
    are asked for. (N F) operations.
    """
    hidden = np.zeros(len(local), bool)
    edges = np.cross(corners, np.roll(corners, -1, axis=1))
    normals = edges[:, 0] + edges[:, 1] + edges[:, 2]
    heights = normals[:, 0] * corners[:, 0, 0] + normals[:, 1] * corners[:, 0, 1]
    heights += normals[:, 2] * corners[:, 0, 2]
    front = np.flatnonzero(~is_open & (heights != 0))
    step = max(1, AT_ONCE // max(1, len(rows)))
    for start in range(0, len(front), step):
        some, at = front[start : start + step], rows[~hidden[rows]]
        x, y, z = local[at].T
        sides = [
            np.sign(a * x + b * y + c * z) for a, b, c in edges[some].transpose(1, 2, 0)[..., None]
        ]
        row, column = np.nonzero(np.abs(sides[0] + sides[1] + sides[2]) == 3)
        m, n = some[row], at[column]
        (x, y, z), (a, b, c), w = local[n].T, normals[m].T, 1 / depth[n]
        its = (a * x * w + b * y * w + c * (z * w)) / heights[m]  # 1/depth of the face on the ray
        apart = its - w
        is_tied = np.abs(apart) <= DEPTH_TIE_REL * np.maximum(its, w)
        wins_tie = (m < face[n]) & ~is_target[face[n]]
        hides = (its > 0) & (its * near <= 1) & np.where(is_tied, wins_tie, apart > 0)
        hidden[n[hides & (face[n] != m)]] = True
    return hidden
