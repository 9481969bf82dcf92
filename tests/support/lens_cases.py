"""Lenses that the tests of `rastercov.core.camera.lenses` share, and rays for them."""

from functools import cache
from typing import NamedTuple

import numpy as np

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.lenses import BASES, LensModel
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.engine import lens_proof
from rastercov.engine import solver_lens as formulas
from rastercov.engine.lens_polygons import measure_polygons
from rastercov.formats.cameras.colmap import camera_of
from rastercov.reference.lenses import project

WIDTH, HEIGHT = 1280, 1024
FOCAL, CENTRE = (900.0, 880.0), (655.25, 500.5)
K = np.array([[900.0, 0, 654.75], [0, 880.0, 500.0], [0, 0, 1]])
BROWN = (-0.28, 0.09, 8e-4, -5e-4, -0.01)
RATIONAL = (*BROWN[:4], 0.03, 0.12, -0.05, 0.01)
PRISM = (*RATIONAL, 1e-3, -2e-4, 5e-4, 1e-4)
TILTED = (*PRISM, 0.06, -0.04)
KANNALA = (0.03, -0.012, 0.004, -0.001)

COLMAP = {
    "SIMPLE_PINHOLE": (900, *CENTRE),
    "PINHOLE": (*FOCAL, *CENTRE),
    "SIMPLE_RADIAL": (900, *CENTRE, -0.1),
    "RADIAL": (900, *CENTRE, -0.2, 0.05),
    "OPENCV": (*FOCAL, *CENTRE, *BROWN[:4]),
    "OPENCV_FISHEYE": (480, 470, *CENTRE, *KANNALA),
    "FULL_OPENCV": (*FOCAL, *CENTRE, *RATIONAL),
    "FOV": (*FOCAL, *CENTRE, 0.9),
    "SIMPLE_RADIAL_FISHEYE": (600, *CENTRE, 0.02),
    "RADIAL_FISHEYE": (600, *CENTRE, 0.02, -0.003),
    "THIN_PRISM_FISHEYE": (600, 590, *CENTRE, 0.03, -0.01, 1e-3, -2e-3, 0.004, -0.001, 2e-3, -1e-3),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *(600, 590, *CENTRE, 0.03, -0.01, 0.004, -0.001, 2e-4, -1e-5),
        *(1e-3, -2e-3, 2e-3, -1e-3, 5e-4, 3e-4),
    ),
    "SIMPLE_DIVISION": (800, *CENTRE, -0.2),
    "DIVISION": (*FOCAL, *CENTRE, 0.1),
    "SIMPLE_FISHEYE": (600, *CENTRE),
    "FISHEYE": (600, 590, *CENTRE),
    "EUCM": (420, 430, *CENTRE, 0.6, 1.1),
    "EQUIRECTANGULAR": (WIDTH, HEIGHT),
}
"""A camera of each of COLMAP's models."""


def opencv(matrix, distortion=(), width=WIDTH, height=HEIGHT, fisheye=False):
    """Lens of OpenCV's camera matrix and coefficients."""
    return lens_of(Camera.from_opencv(matrix, width, height, distortion, fisheye=fisheye))


def colmap(model):
    """Lens of the camera of a model of COLMAP."""
    return lens_of(camera_of(model, WIDTH, HEIGHT, COLMAP[model]))


def lens(model, distortion=(), *, f=420, size=(WIDTH, HEIGHT), **fields):
    """Lens of a model of ours."""
    sides = dict(zip(("width", "height"), size, strict=True))
    focal = {"fx": f, "fy": f}
    return lens_of(Camera(**(sides | focal | fields), model=model, distortion=distortion))


def make_lens(
    base, width=WIDTH, height=HEIGHT, *, fx, fy, cx=None, cy=None, radial=(), denominator=(),
    tangential=(0.0, 0.0), prism=(), tilt=(0.0, 0.0), of_base=(), is_late=False, max_angle_deg=None,
):  # fmt: skip
    """Lens of the terms of its equations (appendix/lenses.md); `of_base` as they take it."""
    p, (x, y) = np.zeros(formulas.LATE + 1), tilt
    p[:4] = fx, fy, width / 2 if cx is None else cx, height / 2 if cy is None else cy
    for first, values in (
        (formulas.K1, radial),
        (formulas.D1, denominator),
        (formulas.P1, tangential),
        (formulas.S1, prism),
        (formulas.T00, (np.cos(x), -np.sin(x) * np.sin(y), np.cos(y))),
        (formulas.T20, (np.sin(y), -np.cos(y) * np.sin(x), np.cos(y) * np.cos(x))),
        (formulas.B0, of_base),
        (formulas.LATE, (is_late,)),
    ):
        p[first : first + len(values)] = values
    return LensModel(width, height, BASES.index(base), tuple(p.tolist()), max_angle_deg)


@cache
def of_all_kinds():
    """Lenses of all bases and distortions by name, each of which sees the whole image."""
    lenses = {f"colmap {name}": colmap(name) for name in COLMAP}
    for name, distortion in (("brown", BROWN), ("prism", PRISM), ("tilted", TILTED)):
        lenses[f"opencv {name}"] = opencv(K, distortion)
    wide = K * [[0.55, 1, 1], [1, 0.55, 1], [1, 1, 1]]
    lenses["opencv fisheye"] = opencv(wide, KANNALA, fisheye=True)
    lenses["opencv skew"] = opencv(np.add(K, [[0, 7.5, 0], [0, 0, 0], [0, 0, 0]]), BROWN)
    lenses["kalibr omni"] = lens("omni", (1.2, -0.2, 0.05, 1e-3, -2e-3), fx=1000, fy=1010)
    # Beyond 90 degrees, with a pole behind the image that sides of the cube reach.
    lenses["kalibr wide omni"] = lens("omni", (0.6,), fx=380, fy=385)
    lenses["kalibr ds"] = lens("double_sphere", (-0.2, 0.55), fy=425)
    lenses["metashape frame"] = lens(
        "metashape", (-0.1, 0.05, -0.02, 0.003, 1e-3, -5e-4), f=1100, fx=1103, skew=-2,
        cx=WIDTH / 2 + 7, cy=HEIGHT / 2 - 4,
    )  # fmt: skip
    lenses["metashape equisolid"] = lens("metashape_equisolid", (0.01, 0, 0, 0, 1e-4, 0), f=430)
    lenses["wide equidistant"] = make_lens("equidistant", fx=300, fy=300, radial=(0.01,))
    return lenses


def heights(points, polygon):
    """Least distance (..., N) of points from the sides of a convex polygon, > 0 inside."""
    side = np.roll(polygon, -1, axis=0) - polygon
    away = points[..., None, :] - polygon
    height = side[:, 0] * away[..., 1] - side[:, 1] * away[..., 0]
    return (height / np.hypot(*side.T)).min(axis=-1)


def is_outside_hole(plane, points, margin=0.0):
    """True for points (N, 2) that are farther than a margin from the hole of a plane."""
    if not len(plane.hole):
        return np.ones(len(points), np.bool_)
    return -heights(points, plane.hole) > margin


def rays_of_plane(plane, points):
    """Rays (..., 3) of the lens through points (..., 2) of one of its planes."""
    return points @ plane.frame[:, :2].T + plane.frame[:, 2]


def pixels_of_plane(plane, points):
    """Pixels (..., 2) of points (..., 2) of a plane, by the equations of the lens alone."""
    x, y, z = np.moveaxis(rays_of_plane(plane, points), -1, 0)
    return np.stack(project(plane.code, plane.params, x, y, z), axis=-1)


def bounds_of(plane):
    """Reaches (N, 3) of a plane, and bounds (2, ORDER + 1) of its Taylor coefficients."""
    reaches, taylor = np.empty((36, 3)), np.empty((2, lens_proof.ORDER + 1))
    return reaches[: lens_proof.bounds_of(plane, reaches, taylor)], taylor


def points_of(plane, n, rng):
    """Random points (N, 2) of the region of a plane, many near its border."""
    return rng.dirichlet(np.full(len(plane.region), 0.05), n) @ plane.region


def on_planes(lens, rays):
    """Each plane of a lens, and the points (N, 2) of rays that are in its region."""
    for plane in lens.planes:
        x, y, z = (rays @ plane.frame).T
        points = np.column_stack((x[z > 0], y[z > 0])) / z[z > 0, None]
        yield plane, points[heights(points, plane.region) > 1e-12]


def rays_of_image(lens):
    """Rays (N, 3) of all parts of the image, its border among them."""
    grid = np.stack(np.meshgrid(np.linspace(0, lens.width, 97), np.linspace(0, lens.height, 83)))
    rays = lens.unproject(grid.reshape(2, -1).T)
    return rays[np.isfinite(rays).all(axis=1)]


def pixels(n, seed=0, margin=0.0):
    """`n` random pixels of the image, (n, 2), at least a margin from its border."""
    rng = np.random.default_rng(seed)
    return rng.uniform((margin, margin), (WIDTH - margin, HEIGHT - margin), (n, 2))


def rays(n, seed=0, least_z=-1.0):
    """`n` random directions of unit length, (n, 3), with Z of at least `least_z`."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(least_z, 1, n)
    turn = rng.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z * z)
    return np.column_stack((r * np.cos(turn), r * np.sin(turn), z))


class PolygonAreas(NamedTuple):
    """Signed areas (N,) of polygons of an ideal plane in the image of a lens, px^2.

    `inside` is the part within 0 <= u <= width and 0 <= v <= height. `bound` is that of the error
    of the quadrature of both; it leaves out rounding, and the places where `inside` is cut at the
    border of the image.
    """

    whole: np.ndarray
    inside: np.ndarray
    bound: np.ndarray


def polygon_areas(proved, polygons):
    """Areas of polygons, (K, 2) each, of a plane, within its region and outside its hole."""
    starts = np.cumsum([0, *map(len, polygons)])
    corners = np.concatenate([np.empty((0, 2)), *polygons])
    out = np.empty((len(polygons), 3))
    measure_polygons(proved.record, corners, starts, out)
    return PolygonAreas(out[:, 0], out[:, 1], out[:, 2] * proved.record.tolerance)
