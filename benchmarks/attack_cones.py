"""Attack on cones and conics: random faces in the cones of random lenses and tilts.

Areas of faces, m^2, are held against integrals along lines across them; areas in images, px^2,
against integrals along the meridians of the lens. Neither shares code with rastercov. One figure
beyond its bound is wrong, as is a bound that is wider than arcs may be.
"""

import math

import numpy as np
from cone_cases import area_in_cone, cone_camera, image_in_cone, triangle_case
from rows import Report

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import lens_of

LENSES, FACES = 60, 40
FOCAL = 300.0
WIDEST_DEG = 170.0
WIDTH_REL = 1e-6
"""Largest mean width of what is undecided along an arc, relative to the diagonal of the mesh."""
ROUNDING = 1e-10
PX2 = 1e-6
"""Rounding of areas in m^2, relative to the square of the diagonal, and in px^2."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 60 cones and lenses of 40 faces each."""
    rng = np.random.default_rng(55)
    n, wrong, wide, in_images = 0, 0, 0, 0
    for _ in range(max(2, round(LENSES * effort))):
        angle_deg = float(10 ** rng.uniform(-0.5, math.log10(WIDEST_DEG)))
        k = float(rng.choice([0, rng.uniform(0, 0.02)]))
        cone, angle = cone_camera(angle_deg), math.radians(angle_deg)
        side = 2 * math.ceil(FOCAL * angle * (1 + k * angle**2) + 2)
        camera = rc.Camera(
            width=side, height=side, fx=FOCAL, fy=FOCAL, model="opencv_fisheye",
            distortion=(k, 0, 0, 0), max_angle_deg=angle_deg,
        )  # fmt: skip
        valid = lens_of(camera).valid_angle
        for _ in range(FACES):
            corners, eye, pose = triangle_case(rng)
            mesh = rc.Mesh(corners, [(0, 1, 2)])
            size = float(np.linalg.norm(np.ptp(corners, axis=0)))
            regions = rc.regions(mesh, cone, pose, rc.Task())
            true = area_in_cone(corners, eye, pose[0, :3, 2], angle)
            bound = float(regions.bound.sum())
            wrong += abs(float(regions.area.sum()) - true) > bound + ROUNDING * size**2
            wide += bound > 4 * WIDTH_REL * size**2
            n += 1
            own = (corners - eye) @ pose[0, :3, :3]
            true = image_in_cone(own, valid, lambda t, k=k: FOCAL * t * (1 + k * t**2))
            seen = rc.open_observer(mesh, camera, "exact").observe(pose)
            wrong += abs(float(seen.visible_pixels[0, 0]) - true) > PX2 + 1e-8 * true
            in_images += 1
    report.add("cones: areas of faces", n, "areas")
    report.add("cones: areas in images", in_images, "areas")
    report.add("cones: bounds wider than of arcs", wide, "areas", at_most=0)
    report.add("cones: wrong", wrong, "areas", at_most=0)
