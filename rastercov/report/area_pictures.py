"""Pictures by area: each pixel has the colour of its own point of the surface, not of its face."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.projection import rays_of, to_camera
from rastercov.camera.rig import cameras_of
from rastercov.coverage.area.points import covering_poses
from rastercov.coverage.area.regions import Regions
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]
PIXELS_AT_A_TIME = 1 << 16
"""Pixels whose points are looked up together."""


WHOLE_REL = 1e-6
"""Area up to which a face may be uncovered and counts as wholly covered here, relative."""


def covered_pixels(
    regions: Regions, camera: Camera, pose: ArrayLike, face: NDArray[np.int32]
) -> NDArray[np.bool_]:
    """Pixels at whose centre the surface is covered by a pose of some regions.

    Parameters
    ----------
    regions : Regions
        Of few poses, of the mesh in the image.
    camera, pose
        Of the image, (H, W).
    face : (H, W) int32
        Face at each pixel, -1 for none.

    Returns
    -------
    (H, W) bool
        False where no task face is.
    """
    mesh, area = regions.mesh, regions.areas().max(axis=0, initial=0.0)
    is_whole = (area > 0) & (area >= (1 - WHOLE_REL) * mesh.areas)
    covered = np.append(is_whole, False)[face]
    # Only faces that are covered in part have to be asked point by point.
    partly = np.append((area > 0) & ~is_whole, False)[face]
    pixel = np.divmod(np.flatnonzero(partly), face.shape[1])
    faces = face[pixel]
    points = points_of_pixels(mesh, camera, np.asarray(pose, np.float64), faces, *pixel)
    for at in range(0, len(faces), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        found = covering_poses(regions, faces[part], points[part]).any(axis=1)
        covered[pixel[0][part], pixel[1][part]] = found
    return covered


def best_pose_at(
    regions: Regions, placed: Poses, face: NDArray[np.int32], points: FloatArray
) -> NDArray[np.int64]:
    """(N,) pose with most pixels on a m^2 at points (N, 3) of faces (N,), -1 where none covers it.

    `placed` are the P poses of the regions, each with its camera.
    """
    best = np.full(len(face), -1, np.int64)
    mesh, cameras = regions.mesh, cameras_of(regions.camera)
    if not len(placed):
        return best
    pixels = [each.fx * each.fy if each.is_pinhole else 1.0 for each in cameras]
    scales = [pixels[index] / pixels[0] for index in placed.camera]
    for at in range(0, len(face), PIXELS_AT_A_TIME):
        part = slice(at, at + PIXELS_AT_A_TIME)
        covers = covering_poses(regions, face[part], points[part])
        worth = np.full(len(covers), -np.inf)
        for pose in np.flatnonzero(covers.any(axis=0)).tolist():  # few cameras, many points
            rows = np.flatnonzero(covers[:, pose])
            camera, matrix = cameras[placed.camera[pose]], placed.world_from_camera[pose]
            density = _density(mesh, camera, matrix, face[part][rows], points[part][rows])
            density *= scales[pose]
            is_better = density > worth[rows]
            worth[rows[is_better]] = density[is_better]
            best[at + rows[is_better]] = pose
    return best


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
        from rastercov.camera.lenses.of_camera import lens_of  # loads numba

        slopes = lens_of(camera).jacobian(to_camera(points, pose))
        across = np.cross(slopes[:, 0], slopes[:, 1])
        normals = mesh.normals[face] @ pose[:3, :3]
        of_lens: FloatArray = np.nan_to_num(np.abs(np.einsum("ni,ni->n", normals, across)))
        return of_lens
    # The height of the camera above the plane of each face is that above all its points.
    heights = np.einsum("fi,fi->f", mesh.normals, mesh.vertices[mesh.faces[:, 0]] - pose[:3, 3])
    depth = away[:, 0] * pose[0, 2] + away[:, 1] * pose[1, 2] + away[:, 2] * pose[2, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        found: FloatArray = np.nan_to_num(np.abs(heights)[face] / depth**3)
    return found
