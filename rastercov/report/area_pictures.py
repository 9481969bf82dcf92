"""Pictures by area: each pixel has the colour of its own point of the surface, not of its face."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.area.points import covering_poses
from rastercov.area.regions import Regions
from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.projection import to_camera
from rastercov.raster.contract import VisibilityBuffer

FloatArray = NDArray[np.float64]
PIXELS_AT_A_TIME = 1 << 16
"""Pixels whose points are looked up together."""


class SeenArea(NamedTuple):
    """Regions, and the poses (P, 4, 4) that they are of."""

    regions: Regions
    poses: FloatArray


def best_and_views(
    seen: SeenArea, camera: Camera, pose: ArrayLike, buffer: VisibilityBuffer
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Poses that cover the surface at the centre of each pixel.

    Parameters
    ----------
    seen : SeenArea
        Regions of the mesh in the image.
    camera, pose
        Of the image, (H, W).
    buffer : VisibilityBuffer
        The image.

    Returns
    -------
    best, views : (H, W) int64
        The pose with most pixels on a m^2 there, -1 where none covers the point; and the number of
        poses that do.
    """
    regions = seen.regions
    best = np.full(buffer.face.shape, -1, np.int64)
    views = np.zeros(buffer.face.shape, np.int64)
    mesh = regions.mesh
    rows, columns = np.nonzero(np.append(mesh.task_mask, False)[buffer.face])
    for at in range(0, len(rows), PIXELS_AT_A_TIME):
        pixel = rows[at : at + PIXELS_AT_A_TIME], columns[at : at + PIXELS_AT_A_TIME]
        face = buffer.face[pixel]
        points = points_of_pixels(mesh, camera, np.asarray(pose, np.float64), face, *pixel)
        covers = covering_poses(regions, face, points)
        views[pixel] = covers.sum(axis=1)
        worth = np.where(covers, _density(mesh, seen.poses, face, points), -np.inf)
        if worth.shape[1]:
            best[pixel] = np.where(covers.any(axis=1), worth.argmax(axis=1), -1)
    return best, views


def points_of_pixels(
    mesh: Mesh,
    camera: Camera,
    pose: FloatArray,
    face: NDArray[np.int32],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
) -> FloatArray:
    """(N, 3) points where the rays through the centres of pixels meet the planes of faces (N,)."""
    across = (columns + 0.5 - camera.cx) / camera.fx
    down = (rows + 0.5 - camera.cy) / camera.fy
    rays = np.stack((across, down, np.ones(len(rows))), axis=1) @ pose[:3, :3].T
    normals, eye = mesh.normals[face], pose[:3, 3]
    slope = np.einsum("ni,ni->n", normals, rays)
    height = np.einsum("ni,ni->n", normals, mesh.vertices[mesh.faces[face, 0]] - eye)
    with np.errstate(divide="ignore", invalid="ignore"):
        points: FloatArray = eye + np.nan_to_num(height / slope)[:, None] * rays
    return points


def _density(
    mesh: Mesh, poses: FloatArray, face: NDArray[np.int32], points: FloatArray
) -> FloatArray:
    """(N, P) pixels on a m^2 of each pose at points of faces, up to a common factor."""
    found = np.empty((len(points), len(poses)))
    for column, pose in enumerate(poses):  # few cameras, many points
        away = points - pose[:3, 3]
        height = abs(np.einsum("ni,ni->n", mesh.normals[face], away))
        with np.errstate(divide="ignore", invalid="ignore"):
            found[:, column] = np.nan_to_num(height / to_camera(points, pose)[:, 2] ** 3)
    return found
