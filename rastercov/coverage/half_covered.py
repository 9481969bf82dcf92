"""Line about large faces that cameras cover in part: counted by face, they are not covered at all.

A sample of points on the faces that are not covered as a whole is judged point by point, as by area
(docs/area.md). A threshold of pixels of a face becomes pixels per m^2 of that face.
"""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.format import percent
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.failures import first_failures, pixels_per_m2
from rastercov.coverage.area.network import unit_of_result
from rastercov.coverage.area.regions import OF_A_FACE
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import Network
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAST_SHARE = 0.05
"""Share of the area in such parts from which there is a line."""
MOST_POINTS, LEAST_POINTS = 2000, 200
"""Points that are judged; fewer for many poses."""
MOST_POSES, PAIRS = 1000, 200_000
"""Poses, spread evenly, and pairs of point and pose that are judged: about 0.2 s."""


def half_covered(
    network: Network, camera: Cameras, poses: ArrayLike | Poses, method: str = "certified"
) -> list[str]:
    """Line about parts of faces that cameras cover and no count of whole faces has; often none.

    Parameters
    ----------
    network : Network
        The result, by face.
    camera : Camera, or several
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of the network.
    method : str
        Method of visibility of the network.
    """
    share = share_in_parts(network, camera, poses)
    if share < LEAST_SHARE:
        return []
    _, obstacle = unit_of_result(None, network.task, Engine.of(method))
    return [
        f"about {percent(round(share, 2))} of the area is covered point by point, but in faces "
        "that are not covered as a whole: use --by area" + (f" ({obstacle})" if obstacle else "")
    ]


def share_in_parts(network: Network, camera: Cameras, poses: ArrayLike | Poses) -> float:
    """Share of the task's area that is covered in faces that are not covered as a whole.

    At least: of more than `MOST_POSES` poses some are left out.
    """
    mesh, task, placed, cameras = network.mesh, network.task, Poses.of(poses), cameras_of(camera)
    scored = mesh.task_mask & ~mesh.degenerate_mask
    left = np.flatnonzero(scored & (network.views < task.views))
    total, area = float(mesh.areas[scored].sum()), float(mesh.areas[left].sum())
    if not len(placed) or not area or area < LEAST_SHARE * total:
        return 0.0
    some = placed[np.unique(np.linspace(0, len(placed) - 1, MOST_POSES).astype(np.int64))]
    n = int(np.clip(PAIRS // len(some), LEAST_POINTS, MOST_POINTS))
    face = left[_at_equal_steps(mesh.areas[left], n)]
    points = _within(mesh, face)
    normals = mesh.normals[face]
    wanted = task.min_pixels * task.min_coverage / mesh.areas[face]
    found = np.zeros(n, np.int64)
    failures = first_failures(mesh, cameras, _pointwise(task), some, points, face)
    eyes = zip(some.world_from_camera, some.camera, strict=True)
    for (pose, index), (reason, _) in zip(eyes, failures, strict=True):
        per_m2 = pixels_per_m2(
            cameras[index], (points - pose[:3, 3]) @ pose[:3, :3], normals @ pose[:3, :3]
        )
        found += (reason == Reason.COVERED) & (per_m2 >= wanted)
    return float((found >= task.views).mean()) * area / total


def _pointwise(task: Task) -> Task:
    """The task without its thresholds of a face."""
    default = Task()
    of_a_face = {each.name for each in fields(Task)} & set(OF_A_FACE)
    return replace(task, **{name: getattr(default, name) for name in of_a_face})


def _at_equal_steps(areas: FloatArray, n: int) -> IntArray:
    """(n,) rows, at equal steps of the sum of their areas."""
    total = np.cumsum(areas)
    rows = np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1])
    last: IntArray = np.minimum(rows, len(areas) - 1)
    return last


def _within(mesh: Mesh, face: IntArray) -> FloatArray:
    """(N, 3) a point in each of (N,) faces, evenly over those of one face.

    M. Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018 (R2).
    """
    k = np.arange(len(face)) + 1
    x, y = k * 0.7548776662466927 % 1, k * 0.5698402909980532 % 1
    over = x + y > 1
    x[over], y[over] = 1 - x[over], 1 - y[over]
    a, b, c = mesh.vertices[mesh.faces[face]].transpose(1, 0, 2)
    points: FloatArray = a + x[:, None] * (b - a) + y[:, None] * (c - a)
    return points
