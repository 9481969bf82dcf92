"""Cameras with every model of lens, for laws that hold for all of them."""

import numpy as np

from rastercov.camera.camera import Camera

SIDE = {"width": 1280, "height": 1024}
CAMERAS = {
    "skew": Camera(**SIDE, fx=900, fy=910, skew=3),
    "brown": Camera(
        **SIDE, fx=900, fy=900, model="opencv", distortion=(-0.28, 0.09, 1e-3, -5e-4, -0.01)
    ),
    "rational and prism": Camera(
        **SIDE,
        fx=700,
        fy=700,
        model="opencv",
        distortion=(0.5, 0.1, 1e-3, -5e-4, 0.01, 0.8, 0.2, 0.02, 1e-3, 2e-4, -1e-3, 1e-4),
    ),
    "tilted sensor": Camera(
        **SIDE,
        fx=900,
        fy=900,
        model="opencv",
        distortion=(-0.2, 0.05, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.03, -0.02),
    ),
    "fisheye": Camera(
        **SIDE, fx=600, fy=600, model="opencv_fisheye", distortion=(-0.02, 0.005, -0.002, 0.0003)
    ),
    "wide fisheye": Camera(
        **SIDE, fx=330, fy=330, model="opencv_fisheye", distortion=(0.01, 0, 0, 0)
    ),
    "thin prism fisheye": Camera(
        **SIDE,
        fx=500,
        fy=500,
        model="thin_prism_fisheye",
        distortion=(-0.02, 0.003, 1e-3, -5e-4, 0, 0, 1e-3, -1e-3),
    ),
    "division": Camera(**SIDE, fx=600, fy=600, model="division", distortion=(-0.2,)),
    "fov": Camera(**SIDE, fx=600, fy=600, model="fov", distortion=(0.8,)),
    "omni": Camera(**SIDE, fx=900, fy=900, model="omni", distortion=(1.2, -0.1, 0.02, 0, 0)),
    "eucm": Camera(**SIDE, fx=400, fy=400, model="eucm", distortion=(0.6, 1.1)),
    "double sphere": Camera(**SIDE, fx=350, fy=350, model="double_sphere", distortion=(-0.2, 0.55)),
    "metashape": Camera(
        **SIDE,
        fx=900,
        fy=900,
        model="metashape",
        distortion=(-0.2, 0.05, -0.01, 0.001, 1e-3, 2e-4),
    ),
    "equirectangular": Camera(
        width=1280, height=640, fx=640 / np.pi, fy=640 / np.pi, model="equirectangular"
    ),
}
"""By name; all see something in every pixel."""
