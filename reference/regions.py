"""Coverage of single points, by definition: the twin of `rastercov.coverage.area`.

Each point is tested against every triangle, and each criterion is evaluated from its formula. There
are no polygons, planes in the image or event edges here. The near plane, ties at equal depth and
the side that counts are those of docs/conventions.md.
"""

import math
from typing import Any

import numpy as np

from rastercov.base.features import hooks_of
from rastercov.base.memory import AnyArray, BoolArray, ByteArray, FloatArray, IntArray
from rastercov.camera.camera import Camera
from rastercov.camera.gate import Gate
from rastercov.camera.lenses.of_camera import lens_of
from rastercov.camera.models import MODELS
from rastercov.camera.near_plane import near_limit
from rastercov.camera.pose import valid_poses
from rastercov.camera.rig import Rig, eyes_of
from rastercov.coverage.area.rows import tasks_of
from rastercov.coverage.reasons import BASELINE, NAMES, Reason
from rastercov.coverage.surface import own_reasons
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
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
    """Hooks of a feature with equipment, by points."""

    word: str
    reason: str
    """Name of that of points where it does not hold."""

    def holds(
        self, mesh: Mesh, own: Any, points: FloatArray, face: IntArray, world_from_rig: FloatArray
    ) -> BoolArray:
        """(2, N) whether it does at points of faces, on their front and rear."""
        raise NotImplementedError  # each criterion has its own


class GateTwin:
    """Hooks of a feature with gates that ask for more than a count, by points."""

    def holds(self, gate: Gate, rays: FloatArray) -> BoolArray:
        """(R, N) whether it does, by the rays from N points to n devices in R poses."""
        raise NotImplementedError  # each feature has its own


def covers_points(
    mesh: Mesh,
    camera: Camera,
    poses: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> BoolArray:
    """Mask of the points of faces that each pose covers, (P, N); see `reasons_in_poses`."""
    found = reasons_in_poses(mesh, camera, poses, task, points, face)
    return np.asarray(found == Reason.COVERED)


def reasons_in_poses(
    mesh: Mesh,
    camera: Camera,
    poses: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> ByteArray:
    """`Reason` of the points of faces in each pose, (P, N): the first criterion that fails.

    Parameters
    ----------
    mesh, camera, task
        Scene, camera, thresholds of `rastercov.regions`.
    poses : (P, 4, 4) float64
        world_from_camera.
    points, face : (N, 3) float64, (N,) int
        Points of faces, metres.
    """
    matrices = valid_poses(poses)
    near = near_limit(camera, mesh.bounds, matrices)
    is_wide = _is_wide(camera)
    found = np.empty((len(matrices), len(points)), np.uint8)
    for row, pose in enumerate(matrices):
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        corners = (mesh.vertices[mesh.faces] - pose[:3, 3]) @ pose[:3, :3]
        criteria = meets_criteria(mesh, camera, task, pose, near[row], local, face)
        oblique = ~criteria.pop(Reason.TOO_OBLIQUE)
        meets = np.logical_and.reduce(list(criteria.values()))
        is_open, its_near = mesh.degenerate_mask | mesh.target_mask, float(near[row])
        if camera.is_parallel:
            farthest = farthest_of(mesh, pose, its_near)
            corners, local = (as_central(each, farthest) for each in (corners, local))
            its_near = 1 / (farthest - its_near)
        depth = _depth(local, is_wide=is_wide)
        hidden = _find_hidden(
            corners,
            is_open,
            mesh.target_mask,
            its_near,
            local,
            depth,
            face.astype(np.int64),
            np.flatnonzero(meets),
        )
        found[row] = np.where(oblique, np.uint8(Reason.TOO_OBLIQUE), own_reasons(mesh, task)[face])
        found[row][hidden] = Reason.OCCLUDED
        for reason in reversed(criteria):
            found[row][~criteria[reason]] = reason
    return found


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
    placed = rig.poses(world_from_rig)
    gate, n = rig.gates.get(0), len(rig)
    sees = np.empty((n, len(placed) // n, len(points)), np.bool_)
    tasks = tasks_of(rig, task)
    for row, (camera, own) in enumerate(zip(rig.cameras, tasks, strict=True)):
        matrices = placed.world_from_camera[row::n]
        sees[row] = covers_points(mesh, camera, matrices, own, points, face)
    eyes = eyes_of(rig, placed).reshape(-1, n, 1, 3).transpose(1, 0, 2, 3)
    front = np.einsum("nrpi,pi->nrp", eyes - points, mesh.normals[face]) > 0
    allowed = np.ones((2, *sees.shape[1:]), np.bool_)
    for twin in hooks_of(PointTwin):
        if (equipment := rig.equipment.get(twin.word)) is not None:
            on = [twin.holds(mesh, equipment, points, face, at) for at in world_from_rig]
            allowed &= np.stack(on, axis=1)
    if gate is None:
        alone = np.asarray(sees & np.where(front, *allowed), np.bool_)
        return alone.swapaxes(0, 1).reshape(-1, len(points))
    found = np.zeros(sees.shape[1:], np.bool_)
    for side, is_allowed in zip((front, ~front), allowed, strict=True):
        counts = (sees & side).sum(axis=0) >= gate.k
        for row in gate.needs:
            counts &= (sees & side)[row]
        found |= counts & is_allowed
    for each in hooks_of(GateTwin):
        found &= each.holds(gate, eyes - points)
    return found


def reasons_of_points(
    mesh: Mesh,
    camera: Camera | Rig,
    world_from_camera: AnyArray,
    task: Task,
    points: FloatArray,
    face: IntArray,
) -> ByteArray:
    """(N,) row of `REASONS` of points: the criterion that fails last in any pose; or `COVERED`.

    Poses are those of the camera, or of the rig. A rig with a rule has met a criterion where enough
    of its cameras, on one side of the face, have.
    """
    if not isinstance(camera, Rig):
        found = reasons_in_poses(mesh, camera, world_from_camera, task, points, face)
        return np.max(found, axis=0, initial=Reason.BACK_FACING)
    best, n = np.full(len(points), Reason.BACK_FACING, np.uint8), len(camera)
    eyes = eyes_of(camera, camera.poses(world_from_camera)).reshape(-1, n, 3)
    gate, tasks = camera.gates.get(0), tasks_of(camera, task)
    for at, own in zip(world_from_camera, eyes, strict=True):
        placed = camera.poses(at[None]).world_from_camera
        cameras = zip(camera.cameras, placed, tasks, strict=True)
        reason = np.concatenate(
            [reasons_in_poses(mesh, c, p[None], t, points, face) for c, p, t in cameras]
        )
        front = np.einsum("npi,pi->np", own[:, None] - points, mesh.normals[face]) > 0
        for last in sorted({each for each in Reason if each > Reason.BACK_FACING}):
            sides = [(reason >= last) & side for side in (front, ~front)]
            if gate is None:
                passes = sides[0].any(axis=0) | sides[1].any(axis=0)
            else:
                passes = np.logical_or(
                    *((s.sum(axis=0) >= gate.k) & s[list(gate.needs)].all(axis=0) for s in sides)
                )
            best[passes & (best < last)] = last
    passed = best == Reason.COVERED
    rig = camera._with(equipment={})
    rigs = [(rig, BASELINE)]
    for twin in hooks_of(PointTwin):
        rig = rig._equipped(twin.word, camera.equipment.get(twin.word))
        rigs.append((rig, NAMES.index(twin.reason)))
    for rig, failed in rigs:
        covered = rig_covers_points(mesh, rig, world_from_camera, task, points, face)
        passes = covered.any(axis=0)
        best[passed & ~passes] = failed
        passed &= passes
    return best


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
        is_steep = (task.max_incidence_deg >= 90) | (facing >= distance * cosine)
        is_fine = np.ones(len(local), np.bool_)
        if task.min_pixels_per_m2 > 0:
            is_fine &= per_m2 >= task.min_pixels_per_m2
        if task.min_facing_density > 0:
            is_fine &= least >= task.min_facing_density
    if task.min_pixel_density > 0:
        rows = np.flatnonzero(is_fine & front & is_in)
        jacobians = jacobian(camera, local[rows], normal[rows])
        worst = np.linalg.svd(jacobians, compute_uv=False)[:, 1]
        is_fine[rows] &= worst >= task.min_pixel_density
    return {
        Reason.BACK_FACING: front,
        Reason.OUTSIDE: is_in,
        Reason.OUT_OF_FOCUS: (z_n <= sharp) & (sharp <= z_f),
        Reason.TOO_COARSE: is_fine,
        Reason.TOO_OBLIQUE: is_steep,
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
