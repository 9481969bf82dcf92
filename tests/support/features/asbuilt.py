"""Cameras as built in tests of all public names."""

import numpy as np
from misuse_values import MESH

import rastercov as rc
from rastercov.asbuilt.resection import pixels_of

CAMERA = rc.Camera(width=24, height=18, fx=20, fy=20)
PHOTO = np.linspace(0, 1, 24 * 18).reshape(18, 24)
PAIRS = [(5, 5, 0, 0, 0), (9, 6, 1, 0, 0), (4, 9, 0, 1, 0), (8, 9, 0.2, 1, 1)]
NAMES = ["Located", "locate"]
OBJECTS = [rc.locate(MESH, CAMERA, PHOTO, points=PAIRS)]
SHOWN = OBJECTS
CALLS = {"locate": {"camera": CAMERA, "photo": PHOTO, "points": PAIRS, "pixel_error": 1.0}}
PLANNED = rc.sphere_of_poses((0, 0, 0), distance=0.3, count=6)[0]
CORNERS = np.array([(x, y, z) for x in (-0.04, 0.05) for y in (-0.03, 0.03) for z in (0, 0.02)])
PIXELS = pixels_of(CORNERS, rc.Camera.from_fov(320, 240, hfov_deg=46), PLANNED)
ROWS = "\n".join(" ".join(str((7 * x + 3 * y) % 256) for x in range(320)) for y in range(240))
POINTS = [",".join(map(str, row)) for row in np.hstack((PIXELS, CORNERS)).tolist()]
OF_LINES = {
    "photo.pgm": f"P2\n320 240\n255\n{ROWS}\n",
    "points.csv": "\n".join(("u,v,x,y,z", *POINTS, "")),
}
LINES = {
    "locate": "locate photo.pgm plan.toml -p poses.json --of 1 --points points.csv "
    "--pixel-error 0.05"
}
