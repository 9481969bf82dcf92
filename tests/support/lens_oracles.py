"""Pixels of OpenCV and COLMAP for the lenses of `lens_cases`; they share no code with ours."""

import numpy as np
from lens_cases import COLMAP, HEIGHT, WIDTH
from wheels import with_wheel


def opencv_pixels(matrix, distortion, rays):
    """Pixels (N, 2) of rays (N, 3) by cv2.projectPoints, with our origin."""
    import cv2

    return _of_opencv(cv2.projectPoints, matrix, distortion, rays)


def opencv_fisheye_pixels(matrix, distortion, rays):
    """Pixels (N, 2) of rays (N, 3) by cv2.fisheye.projectPoints, with our origin."""
    import cv2

    return _of_opencv(cv2.fisheye.projectPoints, matrix, distortion, rays)


def _of_opencv(project, matrix, distortion, rays):
    none, distortion = np.zeros(3), np.array(distortion, np.float64)
    return project(rays[:, None], none, none, np.array(matrix), distortion)[0][:, 0] + 0.5


def colmap_camera(model):
    """pycolmap's camera of `lens_cases.COLMAP`."""
    pycolmap = with_wheel("pycolmap")
    return pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=COLMAP[model])


def colmap_pixels(model, rays):
    """Pixels (N, 2) of rays (N, 3) by COLMAP; NaN where it has none, or is known to be coarse."""
    camera = colmap_camera(model)
    items = [camera.img_from_cam(ray) for ray in rays]
    pixels = np.array([(np.nan, np.nan) if pixel is None else pixel for pixel in items])
    if model == "FOV":  # a short series where r^2 < 1e-4, off by up to 1e-10 px
        pixels[np.hypot(rays[:, 0], rays[:, 1]) < 0.011 * np.abs(rays[:, 2])] = np.nan
    return pixels
