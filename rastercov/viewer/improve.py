"""Better cameras for a state: one camera refined, or the best next one added.

Both count what the cameras that are on cover together, by the area of whole faces. They report
progress after every few poses, and end where `Progress` raises `Cancelled`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.viewpoints import look_at
from rastercov.coverage.coverage import evaluate_batches
from rastercov.coverage.spread import least_cosine
from rastercov.coverage.task import Reason
from rastercov.mesh import Mesh
from rastercov.placement.candidates.framing import turns_about_z
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import refine
from rastercov.viewer.measurements import Measurements, NetworkFigures, of_one_camera
from rastercov.viewer.rig_state import RigState, Station

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Progress = Callable[[int, int], None]
"""Called with the poses done and the total; may raise `Cancelled`."""

BUDGET = 2_000
"""Poses that a refinement of one camera measures at most."""
TRIES = 600
"""Poses that are tried for the next camera where the plan has no candidates."""
POSES_AT_ONCE = 32
SPREAD = 0.7
"""Largest component across the normal of a face of the direction in which a camera is tried."""


class Cancelled(Exception):  # noqa: N818 - no error: someone asked for it
    """The work was to end."""


def refined(
    measurements: Measurements,
    state: RigState,
    station: int,
    space: PoseSpace,
    progress: Progress = lambda done, total: None,
    budget: int = BUDGET,
) -> tuple[RigState, float]:
    """A station moved by a compass search while all others stay; and the area it gained, m^2.

    Raises
    ------
    ConfigError
        For a station that is gone or off, and one at a forbidden place.
    Cancelled
        As `progress` does.
    """
    own = state.station(station)
    if not own.is_on:
        raise ConfigError(f"{own.name} is off; switch it on to refine it")
    mesh, camera, task = measurements.mesh, state.camera_of(own), of_one_camera(state.task)
    others = [each for each in state.on if each.id != station]
    rest = _figures(measurements, state, others)
    need = np.ones(mesh.n_faces, np.int64)
    is_open = ~rest.covered & mesh.task_mask & (rest.views >= rest.need - 1)
    done = 0

    def watch(count: int) -> None:
        nonlocal done
        done += count
        progress(min(done, budget), budget)

    whole = Objective.of(measurements.observer(camera), task)
    weights = np.where(is_open, whole.integer_weights, 0)
    objective = replace(
        whole, integer_weights=weights, need=need, min_cosine=least_cosine(0.0), watch=watch
    )
    progress(0, budget)
    start = own.pose.copy()
    eyes, is_allowed = space.project_to_allowed(start[None, :3, 3])
    if not is_allowed[0]:
        raise ConfigError(f"{own.name} is far from any allowed place; move it to one to refine it")
    start[:3, 3] = eyes[0]
    found = refine(objective, space, start[None], budget=budget)
    moved = state.with_pose(station, found.poses[0])
    before, after = (_covered_area(measurements, each) for each in (state, moved))
    return (moved, after - before) if after > before else (state, 0.0)


def with_next(
    measurements: Measurements,
    state: RigState,
    camera: str,
    candidates: FloatArray,
    progress: Progress = lambda done, total: None,
) -> tuple[RigState, float]:
    """With the candidate of a camera that covers most of what is not covered; and that area, m^2.

    Parameters
    ----------
    camera : str
        Name of the camera.
    candidates : (C, 4, 4) float64
        world_from_camera; of equals the first is taken.

    Raises
    ------
    ConfigError
        Where no candidate covers more.
    Cancelled
        As `progress` does.
    """
    mesh, task = measurements.mesh, of_one_camera(state.task)
    rest = _figures(measurements, state, list(state.on))
    # Each further view of a face that lacks some counts.
    is_open = mesh.task_mask & (rest.views < rest.need)
    worth = np.where(is_open, np.asarray(mesh.areas), 0.0)
    observer = measurements.observer(state.cameras[camera])
    best, gain = -1, 0.0
    progress(0, len(candidates))
    for at in range(0, len(candidates), POSES_AT_ONCE):
        some = candidates[at : at + POSES_AT_ONCE]
        for batch in evaluate_batches(observer, some, task, fields=("reason",)):
            gains = (batch.reason == Reason.COVERED) @ worth
            top = int(gains.argmax())
            if gains[top] > gain:
                best, gain = at + int(batch.pose_ids[top]), float(gains[top])
        progress(min(at + POSES_AT_ONCE, len(candidates)), len(candidates))
    if best < 0:
        raise ConfigError(
            f"none of {len(candidates)} poses tried covers more; change the lens or the thresholds"
        )
    return state.with_new(camera, candidates[best]), gain


def tries(
    measurements: Measurements,
    state: RigState,
    camera: str,
    space: PoseSpace,
    count: int = TRIES,
    seed: int = 0,
) -> FloatArray:
    """Poses that look at faces which are not covered, (C, 4, 4), at allowed places.

    Faces are drawn by their area, and places in the directions around their normals, at distances
    from which the lens shows a fraction to all of the part.

    Raises
    ------
    ConfigError
        Where all is covered, or no place is allowed.
    """
    mesh = measurements.mesh
    rest = _figures(measurements, state, list(state.on))
    weight = np.where(mesh.task_mask & ~rest.covered, np.asarray(mesh.areas), 0.0)
    if not weight.sum() > 0:
        raise ConfigError("every face is covered; there is nothing for a further camera")
    rng = np.random.default_rng(seed)
    faces = rng.choice(mesh.n_faces, count, p=weight / weight.sum())
    normals = np.asarray(mesh.normals)[faces]
    flips = mesh.two_sided_mask[faces] & (rng.random(count) < 0.5)
    normals = np.where(flips[:, None], -normals, normals)
    slopes = rng.uniform(-SPREAD, SPREAD, (count, 3))
    directions = normals + slopes - (slopes * normals).sum(axis=1, keepdims=True) * normals
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    near, far = _distances(mesh, state.cameras[camera])
    reach = np.exp(rng.uniform(np.log(near), np.log(far), count))
    targets = np.asarray(mesh.centroids)[faces]
    eyes, is_allowed = space.project_to_allowed(targets + reach[:, None] * directions)
    is_allowed &= np.linalg.norm(eyes - targets, axis=1) > 1e-9
    if not is_allowed.any():
        raise ConfigError("no place for a further camera is allowed; allow more")
    poses = look_at(eyes[is_allowed], targets[is_allowed], space.up)
    if space.is_roll_free:
        poses[:, :3, :3] = poses[:, :3, :3] @ turns_about_z(rng.uniform(0, np.pi, len(poses)))
    return poses


def _distances(mesh: Mesh, camera: Camera) -> tuple[float, float]:
    """Least and greatest distance from which a camera is tried, metres."""
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    whole = size * max(camera.fx, camera.fy) / min(camera.width, camera.height)
    z_n, z_f = camera.depth_of_field()
    near = max(0.02 * size, 1.01 * camera.near, 1.01 * float(z_n))
    far = min(1.2 * max(whole, 0.5 * size), 0.99 * float(z_f))
    return near, max(far, 1.01 * near)


def _figures(
    measurements: Measurements, state: RigState, stations: Sequence[Station]
) -> NetworkFigures:
    """Figures of some of the stations."""
    some = replace(state, stations=tuple(stations))
    return NetworkFigures(measurements.mesh, some, measurements.rows(state, stations))


def _covered_area(measurements: Measurements, state: RigState) -> float:
    figures = _figures(measurements, state, list(state.on))
    areas: FloatArray = np.asarray(measurements.mesh.areas)
    return float(areas[figures.covered & measurements.mesh.task_mask].sum())


def default_space(mesh: Mesh, state: RigState) -> PoseSpace:
    """Places of cameras where no plan limits them: around the part, or within the room."""
    low, high = np.asarray(mesh.bounds)
    eyes = np.array([each.pose[:3, 3] for each in state.stations]).reshape(-1, 3)
    is_inside = ((eyes > low) & (eyes < high)).all(axis=1)
    size = float(np.linalg.norm(high - low))
    reach = 0.0 if len(eyes) and is_inside.mean() > 0.5 else 2.0 * size
    box = np.stack((low - reach, high + reach))
    if len(eyes):
        box = np.stack((np.minimum(box[0], eyes.min(axis=0)), np.maximum(box[1], eyes.max(axis=0))))
    return PoseSpace(mesh=mesh, boxes=box, clearance=1e-3 * size)


def poses_of_camera(poses: Poses, index: int) -> FloatArray:
    """(C, 4, 4) poses of one camera among candidates of several."""
    matrices: FloatArray = poses.world_from_camera[poses.camera == index]
    return matrices
