"""poses_bounds.npy of LLFF: a row of 17 numbers for each image.

The first 15 are a matrix of 3 x 5: world_from_camera with the columns down, right and backward, the
center, and height, width and focal length. The last two are depths, which are not used. There is
no unit, and the principal point is the middle of the image.

Source: Fyusion/LLFF, README, "Using your own poses without running COLMAP".
"""

import numpy as np

from rastercov.base import CameraError, PoseError, errors_as, shown
from rastercov.core.camera import Border, Views, lens_camera
from rastercov.core.camera.conventions import motions, read_npy
from rastercov.formats.cameras.source import Source

NAME = "poses_bounds.npy"


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the images."""
    with errors_as(CameraError, caught=PoseError):
        rows = np.asarray(read_npy(source.path), np.float64)
    if rows.ndim != 2 or rows.shape[1] != 17 or not np.isfinite(rows).all():
        raise CameraError(f"expected rows of 17 finite numbers, got {shown(rows.shape)}; rename it")
    matrices = rows[:, :15].reshape(-1, 3, 5)
    down, right, back, center = (matrices[:, :, column] for column in range(4))
    poses = motions(np.stack([right, down, -back], axis=2), center)
    cameras = [
        lens_camera("opencv", (int(width), int(height)), {"f": focal})
        for height, width, focal in matrices[:, :, 4].tolist()
    ]
    images = [f"image {row}" for row in range(len(rows))]
    return border.views_of_images(cameras, images, world_from_camera=poses)
