"""Lines about a mesh that was probably read in another unit, and poses in another convention.

A pose file of bare matrices does not state its convention. Where few cameras have a part of the
mesh in their images, and nearly all would in another convention, a line names that one.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    TINY,
    BoolArray,
    FloatArray,
    arccos,
    arcsin,
    arctan2,
    dots,
    norm,
    size_in_words,
)
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.conventions import POSE_CONVENTIONS, in_convention
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.camera.rig import Cameras, cameras_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.contacts import TriangleTree

UNLIKELY_RATIO = 300.0
"""Distance of the nearest camera by the size of the mesh above which the unit is asked for."""
UNLIKELY_DEPTH_RATIO, UNLIKELY_BEYOND_RATIO = 100.0, 30.0
"""Size of the mesh by the greatest depth in focus, and where all of it is beyond that: a thousand
is the usual slip, and a part of a mesh may be meant."""
PARTS, FEW = 2.0, 3
"""Distance at which parts are looked at, m, and number of cameras from which it tells the unit."""
LEAST_IN_MM = 5.0
"""Size of a mesh, m, from which it may be a part that was meant in mm."""
UNLIKELY_SIZE, MOST_SIZE_AROUND = 1e-3, 1e3
"""Size of a mesh, m, below which its unit is asked for: metres that were read as mm; and above
which it is where cameras are on all sides of it, below it, too."""
MM = 1e-3
LEAST_SHARE_IN_MM, MOST_SHARE_IN_METRES = 0.9, 0.5
"""Shares of the cameras that have the whole mesh before them, read in mm and in metres."""
LEAST_SIZE_IN_IMAGE = 0.05
"""Angle of a mesh, by that of the image, above which it is what the camera looks at."""
MOST_SHARE_GIVEN = 0.5
"""Share of the poses that look at the mesh above which nothing is doubted; a third do by chance."""
LEAST_SHARE_OTHERWISE = 0.9
"""Share of the poses that must look at it in another convention."""
MOST_POSES, MOST_POINTS = 100, 500
"""Poses and vertices that are looked at, spread evenly: about 5 ms."""


def size_warnings(mesh: Mesh, least: float, most: float) -> list[str]:
    """A line where a mesh with a size is smaller or larger than it may be, metres."""
    size = float(np.ptp(mesh.bounds, axis=0).max())
    if least <= size <= most or not size:
        return []
    return [f"the mesh measures {mesh.size_in_words}: check --unit"]


def unit_warnings(mesh: Mesh, camera: Cameras, poses: Poses, reach: float = math.inf) -> list[str]:
    """A line where the size of the mesh is unlikely beside what its cameras look at; often none.

    Parameters
    ----------
    mesh : Mesh
    camera : Camera, or several
        Their depth of field is compared with the size.
    poses : Poses
        Cameras, or places where they may be.
    reach : float
        Greatest distance from the mesh that is allowed, m.
    """
    size = float(np.ptp(mesh.bounds, axis=0).max())
    if size < UNLIKELY_SIZE:
        return size_warnings(mesh, UNLIKELY_SIZE, math.inf)
    cameras, words = cameras_of(camera), f"the mesh measures {mesh.size_in_words}"
    eyes, used, nearest = poses.eyes, [*range(len(cameras))], 0.0
    if len(poses):
        used = np.unique(poses.camera).tolist()
        nearest = float(norm(_beyond(mesh.bounds, eyes)).min())
    far = max((float(cameras[index].depth_of_field()[1]) for index in used), default=math.inf)
    ratio = UNLIKELY_BEYOND_RATIO if nearest > far else UNLIKELY_DEPTH_RATIO

    def times(away: float) -> str:
        return f"{words}, {size / away:.0f} times the {size_in_words(away)}"

    if size > ratio * far:
        return [f"{times(far)} up to which the camera is in focus: --unit mm?"]
    if size > UNLIKELY_DEPTH_RATIO * reach:
        return [f"{times(reach)} within which cameras are: --unit mm?"]
    if not len(poses):
        return []
    margins = (mesh.bounds - (eyes.min(axis=0), eyes.max(axis=0))) * [[1], [-1]]
    if size > MOST_SIZE_AROUND and margins.min() > 0:
        return size_warnings(mesh, UNLIKELY_SIZE, MOST_SIZE_AROUND)
    if nearest > UNLIKELY_RATIO * size:
        return [
            f"{words}, but the nearest camera is {size_in_words(nearest)} away, "
            f"{nearest / size:.0f} times as far: check --unit and --pose-unit"
        ]
    if size > LEAST_IN_MM and size > UNLIKELY_DEPTH_RATIO * (away := _ahead(mesh, poses)):
        return [f"{times(away)} at which cameras look at it: --unit mm?"]
    if any(camera.is_parallel for camera in cameras):
        return []  # whose images have no angle
    tangents = [min(each.width, each.height) / 2 / min(each.fx, each.fy) for each in cameras]
    half = arctan2(tangents, 1.0)[poses.camera]
    in_mm, in_metres = (_before(mesh.bounds * scale, poses, half) for scale in (MM, 1.0))
    if in_mm.mean() >= LEAST_SHARE_IN_MM and in_metres.mean() <= MOST_SHARE_IN_METRES:
        away = float(np.median(norm(eyes - MM * mesh.centre)))
        return [
            f"{times(away)} of cameras around it in mm, where {in_mm.sum()} of {len(eyes)} look "
            f"at it, and {in_metres.sum()} in metres: --unit mm?"
        ]
    return []


def _beyond(bounds: FloatArray, eyes: FloatArray) -> FloatArray:
    """(P, 3) distances of eyes from a box along each axis, metres, 0 within it."""
    return np.maximum(np.maximum(bounds[0] - eyes, eyes - bounds[1]), 0)


def _ahead(mesh: Mesh, poses: Poses) -> float:
    """Median distance at which cameras look at a mesh, m; inf for few, and beyond `PARTS`.

    Only of meshes that are wide and high, too: a road or a tunnel is long.
    """
    sides = np.sort(np.ptp(mesh.bounds, axis=0))
    reach = min(PARTS, float(sides[1]) / UNLIKELY_BEYOND_RATIO)
    placed = poses.world_from_camera[:: max(1, len(poses) // MOST_POSES)]
    eyes, axes = placed[:, :3, 3], np.ascontiguousarray(placed[:, :3, 2])
    away = norm(_beyond(mesh.bounds, eyes))
    if len(poses) < FEW or np.median(away) > reach:
        return math.inf
    rows, diagonal = np.flatnonzero(~mesh.degenerate_mask), mesh.diagonal
    middle = mesh.centre
    tree = TriangleTree.over((mesh.vertices - middle) / diagonal, mesh.faces[rows])
    starts, reaches = (eyes - middle) / diagonal, np.full(len(eyes), reach / diagonal)
    hit = tree.first_hits(starts, axes, reaches, np.full(len(eyes), -1))
    face = rows[hit]
    normal, corner = mesh.normals[face], mesh.vertices[mesh.faces[face, 0]]
    with np.errstate(all="ignore"):
        away = dots(corner - eyes, normal) / dots(axes, normal)
    return float(np.median(np.where(hit < 0, math.inf, away)))


def _before(bounds: FloatArray, poses: Poses, half: FloatArray) -> BoolArray:
    """(P,) cameras well outside the box of a mesh that look at it, with a good part of the image.

    `half` is half of the angle of each image, radians.
    """
    radius = norm(np.ptp(bounds, axis=0)) / 2
    eyes = poses.eyes
    to_middle = bounds.mean(axis=0) - eyes
    distance = norm(to_middle)
    is_outside = (
        _beyond(bounds, eyes).max(axis=1) > np.ptp(bounds, axis=0).max() / UNLIKELY_DEPTH_RATIO
    )
    away = np.maximum(distance, TINY)
    along = dots(to_middle, poses.world_from_camera[:, :3, 2]) / away
    angle = arcsin(np.minimum(radius / away, 1.0))
    seen = arccos(np.clip(along, -1, 1)) < np.maximum(half, angle)
    return is_outside & seen & (angle > LEAST_SIZE_IN_IMAGE * half)


def convention_warnings(mesh: Mesh, camera: Cameras, poses: ArrayLike | Poses) -> list[str]:
    """A line where the poses look away from the mesh and would not in another convention.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera, or several
        Its image is what a part of the mesh must be in.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera as it was taken.
    """
    placed, cameras = Poses.of(poses), cameras_of(camera)
    if not len(placed):
        return []
    rows = np.linspace(0, len(placed) - 1, min(len(placed), MOST_POSES)).astype(np.int64)
    own = [cameras[index] for index in placed.camera[rows]]
    matrices = placed.world_from_camera[rows]
    used = np.unique(mesh.faces)
    points = mesh.vertices[used[:: max(1, len(used) // MOST_POINTS)]]
    seen = _looking(points, own, matrices)
    if seen > MOST_SHARE_GIVEN * len(rows):
        return []
    table = {
        name: _looking(points, own, in_convention(matrices, name)) for name in POSE_CONVENTIONS
    }
    name = max(table, key=table.__getitem__)
    if table[name] < LEAST_SHARE_OTHERWISE * len(rows):
        return []
    return [
        f"{seen} of {len(rows)} cameras look at the mesh, and {table[name]} would with another "
        f"convention of poses: give --pose-convention {name}, or leave it out if you gave it"
    ]


def _looking(points: FloatArray, cameras: Sequence[Camera], poses: FloatArray) -> int:
    """Number of poses with a point in the image; in front, for a lens that is no plane."""
    count = 0
    for pose, camera in zip(poses, cameras, strict=True):  # 100 at most
        inside = to_camera(points, pose)
        ahead = inside[inside[:, 2] > 0]
        if MODELS[camera.model].is_planar:
            with np.errstate(all="ignore"):
                pixels = to_image(ahead, camera)
            ahead = ahead[((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)]
        count += len(ahead) > 0
    return count
