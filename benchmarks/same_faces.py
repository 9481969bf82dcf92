"""Comparison of two images of face indices, up to what rounding may decide."""

import numpy as np

from rastercov.core.camera.projection import to_camera, to_image

EDGE = 4e-3
"""Pixels from an edge within which either side may be met."""
TIE = 1e-4
"""Of the depth: surfaces that are closer than this may change places."""


def wrong_pixels(mesh, camera, pose, one: np.ndarray, other: np.ndarray) -> tuple[int, int]:
    """Pixels where two images differ, and those of them that nothing excuses.

    A pixel is excused when its centre is within `EDGE` of an edge of one of its two faces, or
    when these are as deep there, within `TIE`.
    """
    y, x = np.nonzero(one != other)
    points = np.stack((x + 0.5, y + 0.5), axis=-1)
    faces = one[y, x], other[y, x]
    depths, distances = zip(*(_meet(mesh, camera, pose, points, f) for f in faces), strict=True)
    on_edge = np.minimum(*distances) < EDGE
    both = (faces[0] >= 0) & (faces[1] >= 0)
    apart = np.abs(depths[0] - depths[1])
    tied = both & (apart < TIE * np.minimum(*np.abs(depths)))
    return len(points), int(np.count_nonzero(~on_edge & ~tied))


def _meet(mesh, camera, pose, points, faces) -> tuple[np.ndarray, np.ndarray]:
    """Depth of each face's plane at a point, and the point's distance from its edges, in pixels."""
    corners = to_camera(mesh.vertices[mesh.faces[faces]].reshape(-1, 3), pose).reshape(-1, 3, 3)
    ahead = np.roll(corners, -1, axis=1)
    rays = np.ones((len(points), 3))
    rays[:, 0] = (points[:, 0] - camera.cx) / camera.fx
    rays[:, 1] = (points[:, 1] - camera.cy) / camera.fy
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = (normals * corners[:, 0]).sum(-1) / (normals * rays).sum(-1)
        # An edge that reaches behind the camera: distance from its line, which is a plane's.
        planes = np.cross(corners, ahead)
        slopes = np.hypot(planes[..., 0] / camera.fx, planes[..., 1] / camera.fy)
        distances = np.abs((planes * rays[:, None]).sum(-1)) / slopes
    in_front = corners[..., 2].min(axis=1) > 0
    image = to_image(corners[in_front].reshape(-1, 3), camera).reshape(-1, 3, 2)
    along = np.roll(image, -1, axis=1) - image
    away = points[in_front][:, None] - image
    share = (away * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-30)
    nearest = away - np.clip(share, 0, 1)[..., None] * along
    distances[in_front] = np.linalg.norm(nearest, axis=-1)
    missing = faces < 0
    return np.where(missing, np.inf, depths), np.where(missing, np.inf, distances.min(axis=1))
