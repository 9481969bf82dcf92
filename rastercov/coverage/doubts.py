"""Lines about a result that is probably not meant: a wrong unit, faces that are turned around.

Between a finished network and the commands that print it. Every line is a guess by figures of the
scene, says so by the figure, and names what to try.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.formats.doubts import convention_doubts, unit_doubts
from rastercov.camera.near_plane import depth_from_near, near_limits
from rastercov.camera.pose import Poses
from rastercov.camera.projection import to_camera, to_image
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.network import Network

FloatArray = NDArray[np.float64]

LEAST_UNSEEN_SHARE = 0.5
"""Share of the area with coverage 0 in every camera above which its sides are looked at."""
LEAST_SHARE_FROM_BEHIND = 0.8
"""Share seen from behind, of all area that is seen, above which there is a line about normals."""
LEAST_DEAD_SHARE, WIDE = 0.01, math.radians(80)
"""Share of an image without rays above which there is a line; a lens that sees that far from its
axis is a fisheye, whose image may be a disc, and has a line above `MOST_DEAD_SHARE` alone."""
MOST_DEAD_SHARE = 0.9
MARGIN = 1e-4
"""Distance from a point, in diagonals of the mesh, up to which a surface hides nothing."""
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
    used = np.unique(placed.camera)
    return [
        *unit_doubts(network.mesh, camera, placed),
        *_sides(network, cameras, placed[_spread(len(placed), MOST_POSES)]),
        *convention_doubts(network.mesh, cameras, placed),
        *_lenses([cameras[index] for index in used], [names_of(camera)[index] for index in used]),
    ]


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


def _lenses(cameras: Sequence[Camera], names: Sequence[str]) -> list[str]:
    """Lines on cameras whose lens gives no rays for a part of the image that is no border."""
    lines = []
    for name, camera in zip(names, cameras, strict=True):
        share = _dead_area(camera) / (camera.width * camera.height)
        if share <= LEAST_DEAD_SHARE:
            continue
        from rastercov.camera.lenses.of_camera import lens_of

        angle = lens_of(camera).valid_angle
        if angle < WIDE or share > MOST_DEAD_SHARE:
            lines.append(
                f"{share:.0%} of the image of {name} sees nothing: its lens is known to "
                f"{math.degrees(angle):.0f} degrees from its axis: check its model and coefficients"
            )
    return lines


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
    from rastercov.coverage.line_of_sight import LineOfSight  # compiles loops

    faces = np.flatnonzero(scored)
    faces = faces[_spread(len(faces), MOST_FACES)]
    points, sight = mesh.centroids[faces], LineOfSight(mesh)
    front = behind = 0.0
    near_of = near_limits(cameras, mesh.bounds, poses)
    for pose, index, near in zip(poses.world_from_camera, poses.camera, near_of, strict=True):
        camera = cameras[index]
        in_camera = to_camera(points, pose)
        seen = depth_from_near(in_camera, camera) > near
        pixel = to_image(np.where(seen[:, None], in_camera, (0.0, 0.0, 1.0)), camera)
        seen &= ((pixel >= 0) & (pixel <= (camera.width, camera.height))).all(axis=1)
        seen[seen] = ~sight.hidden(points[seen], pose, float(near), camera)
        to_eye = pose[:3, 3] - points[seen]
        is_front = np.einsum("fi,fi->f", mesh.normals[faces[seen]], to_eye) > 0
        front += float(mesh.areas[faces[seen]][is_front].sum())
        behind += float(mesh.areas[faces[seen]][~is_front].sum())
    if not behind or behind < LEAST_SHARE_FROM_BEHIND * (front + behind):
        return []
    return [
        f"{behind / (front + behind):.0%} of what the cameras look at is seen from behind: "
        "normals point inwards, or the surface is open: use two_sided"
    ]
