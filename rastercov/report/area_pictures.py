"""Pictures by area: each pixel has the colour of its own point of the surface, not of its face."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.area.points import covering_poses
from rastercov.area.regions import Regions
from rastercov.camera import Camera
from rastercov.mesh import Mesh
from rastercov.pose import Poses
from rastercov.projection import to_camera
from rastercov.rays import rays_of
from rastercov.rig import cameras_of

FloatArray = NDArray[np.float64]
PIXELS_AT_A_TIME = 1 << 16
"""Pixels whose points are looked up together."""


class SeenArea(NamedTuple):
    """Regions, and the poses that they are of, (P, 4, 4) or with the camera of each."""

    regions: Regions
    poses: FloatArray | Poses


def best_and_views(
    seen: SeenArea, camera: Camera, pose: ArrayLike, face: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Poses that cover the surface at the centre of each pixel.

    Parameters
    ----------
    seen : SeenArea
        Regions of the mesh in the image.
    camera, pose
        Of the image, (H, W).
    face : (H, W) int32
        Face at each pixel, -1 for none.

    Returns
    -------
    best, views : (H, W) int64
        The pose with most pixels on a m^2 there, -1 where none covers the point; and the number of
        poses that do.
    """
    best = np.full(face.shape, -1, np.int64)
    views = np.zeros(face.shape, np.int64)
    mesh = seen.regions.mesh
    pixel = np.nonzero(np.append(mesh.task_mask, False)[face])
    points = points_of_pixels(mesh, camera, np.asarray(pose, np.float64), face[pixel], *pixel)
    best[pixel], views[pixel] = best_and_views_at(seen, face[pixel], points)
    return best, views


def best_and_views_at(
    seen: SeenArea, face: NDArray[np.int32], points: FloatArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Poses that cover points (N, 3) of faces (N,): the best and their number, (N,) each."""
    best = np.full(len(face), -1, np.int64)
    views = np.zeros(len(face), np.int64)
    mesh, cameras = seen.regions.mesh, cameras_of(seen.regions.camera)
    placed = Poses.of(seen.poses)
    matrices = placed.world_from_camera
    if not len(placed):
        return best, views
    pixels = [each.fx * each.fy if each.is_pinhole else 1.0 for each in cameras]
    scales = [pixels[index] / pixels[0] for index in placed.camera]
    for at in range(0, len(face), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        covers = covering_poses(seen.regions, face[part], points[part])
        views[part] = covers.sum(axis=1)
        worth = np.full(len(covers), -np.inf)
        for pose in np.flatnonzero(covers.any(axis=0)).tolist():  # few cameras, many points
            rows = np.flatnonzero(covers[:, pose])
            camera = cameras[placed.camera[pose]]
            density = _density(mesh, camera, matrices[pose], face[part][rows], points[part][rows])
            density *= scales[pose]
            is_better = density > worth[rows]
            worth[rows[is_better]] = density[is_better]
            best[at + rows[is_better]] = pose
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
    rotation, eye = pose[:3, :3], pose[:3, 3]
    normals = mesh.normals @ rotation
    heights = np.einsum("fi,fi->f", mesh.normals, mesh.vertices[mesh.faces[:, 0]] - eye)
    points = np.empty((len(face), 3))
    for at in range(0, len(face), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        rays = rays_of(np.stack((columns[part] + 0.5, rows[part] + 0.5), axis=1), camera)
        slope = np.einsum("ni,ni->n", normals[face[part]], rays)
        with np.errstate(divide="ignore", invalid="ignore"):
            rays *= np.nan_to_num(heights[face[part]] / slope)[:, None]
        # Column by column: threads of a matrix product wait for each other where cores are busy.
        for axis in range(3):
            points[part, axis] = eye[axis] + rays[:, 0] * rotation[axis, 0]
            points[part, axis] += rays[:, 1] * rotation[axis, 1] + rays[:, 2] * rotation[axis, 2]
    return points


def _density(
    mesh: Mesh, camera: Camera, pose: FloatArray, face: NDArray[np.int32], points: FloatArray
) -> FloatArray:
    """(N,) pixels on a m^2 of a pose at points of faces; through a pinhole, divided by fx fy."""
    away = points - pose[:3, 3]
    if not camera.is_pinhole:
        from rastercov.lenses.of_camera import lens_of  # loads numba

        slopes = lens_of(camera).jacobian(to_camera(points, pose))
        across = np.cross(slopes[:, 0], slopes[:, 1])
        normals = mesh.normals[face] @ pose[:3, :3]
        of_lens: FloatArray = np.nan_to_num(np.abs(np.einsum("ni,ni->n", normals, across)))
        return of_lens
    height = abs(np.einsum("ni,ni->n", mesh.normals[face], away))
    with np.errstate(divide="ignore", invalid="ignore"):
        found: FloatArray = np.nan_to_num(height / np.einsum("ni,i->n", away, pose[:3, 2]) ** 3)
    return found
