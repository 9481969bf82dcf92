"""Cameras with every model of lens, for laws that hold for all of them."""

import numpy as np

from rastercov.core.camera.camera import Camera

SIDE = {"width": 1280, "height": 1024}


def camera(f, model="pinhole", *distortion, **others):
    return Camera(**SIDE | {"fx": f, "fy": f, "model": model, "distortion": distortion} | others)


CAMERAS = {
    "skew": camera(900, fy=910, skew=3),
    "brown": camera(900, "opencv", -0.28, 0.09, 1e-3, -5e-4, -0.01),
    "rational and prism": camera(
        *(700, "opencv", 0.5, 0.1, 1e-3, -5e-4, 0.01, 0.8, 0.2, 0.02, 1e-3, 2e-4, -1e-3, 1e-4)
    ),
    "tilted sensor": camera(900, "opencv", -0.2, 0.05, *[0] * 10, 0.03, -0.02),
    "fisheye": camera(600, "opencv_fisheye", -0.02, 0.005, -0.002, 0.0003),
    "wide fisheye": camera(330, "opencv_fisheye", 0.01, 0, 0, 0),
    "thin prism fisheye": camera(
        *(500, "thin_prism_fisheye", -0.02, 0.003, 1e-3, -5e-4, 0, 0, 1e-3, -1e-3)
    ),
    "division": camera(600, "division", -0.2),
    "fov": camera(600, "fov", 0.8),
    "omni": camera(900, "omni", 1.2, -0.1, 0.02, 0, 0),
    "eucm": camera(400, "eucm", 0.6, 1.1),
    "double sphere": camera(350, "double_sphere", -0.2, 0.55),
    "metashape": camera(900, "metashape", -0.2, 0.05, -0.01, 0.001, 1e-3, 2e-4),
    "equirectangular": camera(640 / np.pi, "equirectangular", height=640),
}
"""By name; all see something in every pixel."""
