"""Lines about a result that is probably not meant: a wrong unit, faces that are turned around.

Between a finished network and the commands that print it. Every line is a guess by figures of the
scene, says so by the figure, and names what to try.

One is about large faces that cameras cover in part: counted by face, they are not covered at all. A
sample of points on the faces that are not covered as a whole is judged point by point, as by area
(docs/area.md). A threshold of pixels of a face becomes pixels per m^2 of that face.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.format import percent
from rastercov.camera.camera import Camera
from rastercov.camera.formats.doubts import convention_doubts, unit_doubts
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.failures import first_failures, pixels_per_m2
from rastercov.coverage.area.network import unit_of_result
from rastercov.coverage.area.polygons import even_points
from rastercov.coverage.area.regions import OF_A_FACE
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import Network
from rastercov.coverage.task import Reason, Task

LEAST_UNSEEN_SHARE = 0.5
"""Share of the area with coverage 0 in every camera above which its sides are looked at."""
LEAST_SHARE_FROM_BEHIND = 0.8
"""Share seen from behind, of all area that is seen, above which there is a line about normals."""
LEAST_DEAD_SHARE, WIDE = 0.01, math.radians(80)
"""Share of an image without rays above which there is a line; a lens that sees that far from its
axis is a fisheye, whose image may be a disc, and has a line above `MOST_DEAD_SHARE` alone."""
MOST_DEAD_SHARE = 0.9
MOST_FACES, MOST_POSES = 2000, 16
"""Faces and cameras whose lines of sight are traced, spread evenly: about 0.1 s."""


def doubts(network: Network, camera: Cameras, poses: ArrayLike | Poses) -> list[str]:
    """Lines about the unit of the mesh and the side that its faces show; often none.

    Parameters
    ----------
    network : Network
        The result.
    camera : Camera, or several
        Its depth of field is compared with the size of the mesh.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of the network.
    """
    placed, cameras = Poses.of(poses), cameras_of(camera)
    if not len(placed):
        return []
    lines = [
        *unit_doubts(network.mesh, camera, placed),
        *_sides(network, cameras, placed[_spread(len(placed), MOST_POSES)]),
        *convention_doubts(network.mesh, cameras, placed),
    ]
    for index in np.unique(placed.camera):
        lines += _lens_line(names_of(camera)[index], cameras[index])
    return lines


def dead_pixels(camera: Cameras) -> dict[str, float]:
    """Area of the image without rays, px^2, of each camera that has any, by its name.

    No direction in the valid region of the lens is seen there, see docs/cameras.md.
    """
    cameras = zip(names_of(camera), cameras_of(camera), strict=True)
    return {name: area for name, each in cameras if (area := _dead_area(each)) > 0}


def _dead_area(camera: Camera) -> float:
    if camera.is_pinhole:
        return 0.0
    from rastercov.camera.lenses.of_camera import blind_area, lens_of  # compiles loops

    lens = lens_of(camera)
    return 0.0 if lens.is_whole else blind_area(lens)


def _lens_line(name: str, camera: Camera) -> list[str]:
    """A line on a camera whose lens gives no rays for a part of the image that is no border."""
    share = _dead_area(camera) / (camera.width * camera.height)
    if share <= LEAST_DEAD_SHARE:
        return []
    from rastercov.camera.lenses.of_camera import lens_of

    angle = lens_of(camera).valid_angle
    if angle >= WIDE and share <= MOST_DEAD_SHARE:
        return []
    return [
        f"{share:.0%} of the image of {name} sees nothing: its lens is known to "
        f"{math.degrees(angle):.0f} degrees from its axis: check its model and coefficients"
    ]


def _spread(n_rows: int, most: int) -> NDArray[np.int64]:
    """Indices of rows, `most` or fewer, evenly spread."""
    return np.linspace(0, n_rows - 1, min(n_rows, most)).astype(np.int64)


def _sides(network: Network, cameras: Sequence[Camera], poses: Poses) -> list[str]:
    """A line where most of what the cameras look at is seen from behind.

    The reasons of the faces do not tell it: a closed surface that is inside out is back-facing on
    the near side and occluded on the far one. So the lines of sight to some centroids are traced.
    """
    mesh = network.mesh
    scored = mesh.task_mask & ~mesh.two_sided_mask & ~mesh.degenerate_mask
    area = float(mesh.areas[scored].sum())
    if not area or mesh.areas[scored & (network.best == 0)].sum() < LEAST_UNSEEN_SHARE * area:
        return []
    faces = np.flatnonzero(scored)
    faces = faces[_spread(len(faces), MOST_FACES)]
    points = mesh.centroids[faces]
    areas = np.zeros(2)  # seen from behind, and from the front
    sharp = [
        replace(each, aperture=None, focus_distance=None, focus_range=None) for each in cameras
    ]
    both_sides = mesh.with_groups(two_sided="all")
    failures = first_failures(both_sides, sharp, Task(), poses, points, faces)
    for pose, (reason, _) in zip(poses.world_from_camera, failures, strict=True):
        seen = reason == Reason.COVERED
        to_eye = pose[:3, 3] - points[seen]
        is_front = np.einsum("fi,fi->f", mesh.normals[faces[seen]], to_eye) > 0
        areas += np.bincount(is_front, mesh.areas[faces[seen]], 2)
    share = areas[0] / areas.sum() if areas[0] else 0.0
    if share < LEAST_SHARE_FROM_BEHIND:
        return []
    return [
        f"{share:.0%} of what the cameras look at is seen from behind: "
        "normals point inwards, or the surface is open: use two_sided"
    ]


LEAST_SHARE = 0.05
"""Share of the area in such parts from which there is a line."""
MOST_POINTS, LEAST_POINTS = 2000, 200
"""Points that are judged; fewer for many poses."""
MOST_JUDGED, PAIRS = 1000, 200_000
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

    At least: of more than `MOST_JUDGED` poses some are left out.
    """
    mesh, task, placed, cameras = network.mesh, network.task, Poses.of(poses), cameras_of(camera)
    scored = mesh.task_mask & ~mesh.degenerate_mask
    left = np.flatnonzero(scored & (network.views < task.views))
    total, area = float(mesh.areas[scored].sum()), float(mesh.areas[left].sum())
    if not len(placed) or not area or area < LEAST_SHARE * total:
        return 0.0
    some = placed[_spread(len(placed), MOST_JUDGED)]
    n = int(np.clip(PAIRS // len(some), LEAST_POINTS, MOST_POINTS))
    sums = np.cumsum(mesh.areas[left])
    steps = np.searchsorted(sums, (np.arange(n) + 0.5) / n * sums[-1])
    face = left[np.minimum(steps, len(left) - 1)]
    a, b, c = mesh.vertices[mesh.faces[face]].transpose(1, 0, 2)
    x, y = even_points(n)
    points = a + x[:, None] * (b - a) + y[:, None] * (c - a)
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
    return replace(task, **{name: getattr(Task(), name) for name in OF_A_FACE})
