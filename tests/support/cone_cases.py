"""Areas of triangles within cones by integrals along lines, which share no code with ours."""

import math
from itertools import pairwise

import numpy as np

import rastercov as rc

NODES, WEIGHTS = np.polynomial.legendre.leggauss(96)


def between(places, function):
    """Integral of a function, given arrays, from the first to the last of some sorted places.

    At the places it may be as steep as a square root.
    """
    total = 0.0
    for a, b in pairwise(places):
        if b - a > 1e-15:
            turn = np.pi / 2 * (NODES + 1)
            at = a + (b - a) * (1 - np.cos(turn)) / 2
            total += (function(at) * np.sin(turn) * (b - a) / 2) @ WEIGHTS * np.pi / 2
    return total


def roots(square, slope, value):
    """Roots of a polynomial of degree 2, real ones."""
    values = np.roots((square, slope, value))
    return values[np.abs(values.imag) < 1e-12].real


def quadratic(first, last, axis, cosine):
    """Coefficients of (axis . x)^2 - cos^2 |x|^2 along points x of a line, t^2 first."""
    step = last - first
    a, b, c = (
        (p @ axis) * (q @ axis) - cosine**2 * (p @ q)
        for p, q in ((step, step), (first, step), (first, first))
    )
    return a, 2 * b, c


def area_in_cone(corners, eye, axis, angle):
    """Area of a triangle (3, 3) within an angle of an axis from an eye, by lines across it."""
    a, b, c = np.asarray(corners) - eye
    cosine = math.cos(angle)

    def shares(s):
        first, last = (a + s[:, None] * (end - a) for end in (b, c))
        step, square = last - first, cosine**2
        p, q, r = (
            (x @ axis) * (y @ axis) - square * (x * y).sum(axis=1)
            for x, y in ((step, step), (first, step), (first, first))
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            t = -(q + np.copysign(np.sqrt(q**2 - p * r), q))
            cuts = np.clip(np.nan_to_num([t / p, r / t, 0 * s, 0 * s + 1]), 0, 1)
        cuts = np.sort(cuts, axis=0)
        middle = first + ((cuts[1:] + cuts[:-1]) / 2)[..., None] * step
        is_in = middle @ axis >= cosine * np.linalg.norm(middle, axis=-1)
        return (np.diff(cuts, axis=0) * is_in).sum(axis=0) * s

    # Lines through a corner, where the cone meets two sides, and those that touch it.
    places = [*roots(*quadratic(a, b, axis, cosine)), *roots(*quadratic(a, c, axis, cosine))]
    s = np.array([0.25, 0.5, 0.75])
    along = np.array([quadratic(a + t * (b - a), a + t * (c - a), axis, cosine) for t in s])
    touching = (along[:, 1] ** 2 - 4 * along[:, 0] * along[:, 2]) / s**2
    places += [*roots(*np.polyfit(s, touching, 2))]
    places = np.array([0, 1, *(each for each in places if 0 < each < 1)])
    return np.linalg.norm(np.cross(b - a, c - a)) * between(np.sort(places), shares)


def image_in_cone(corners, angle, radius):
    """Area of the image of a triangle (3, 3), in axes of a lens, within an angle of its axis, px^2.

    `radius` is the distance from the centre of the image by the angle, px; by meridians.
    """
    corners = np.asarray(corners)
    sides = [(corners[k], corners[(k + 1) % 3]) for k in range(3)]

    def along(turn):
        return np.array([share(each) for each in turn])

    def share(turn):
        out = corners @ (math.cos(turn), math.sin(turn), 0)
        off = corners @ (-math.sin(turn), math.cos(turn), 0)
        ends = []
        for k in range(3):
            j = (k + 1) % 3
            if (off[k] > 0) != (off[j] > 0):
                t = off[k] / (off[k] - off[j])
                ends.append(
                    (
                        out[k] + t * (out[j] - out[k]),
                        corners[k, 2] + t * (corners[j, 2] - corners[k, 2]),
                    )
                )
        if len(ends) < 2 or max(ends)[0] <= 0:
            return 0.0
        (r0, z0), (r1, z1) = sorted(ends)
        first = math.atan2(r0, z0)
        if r0 <= 0:
            first = 0.0 if z0 - r0 * (z1 - z0) / (r1 - r0) > 0 else math.pi
        low, high = sorted((first, math.atan2(r1, z1)))
        return (radius(min(high, angle)) ** 2 - radius(min(low, angle)) ** 2) / 2

    places = [-math.pi, math.pi, *np.arctan2(corners[:, 1], corners[:, 0])]
    z = np.array((0, 0, 1.0))
    for a, b in sides:
        cuts = roots(*quadratic(a, b, z, math.cos(angle)))
        step = (b - a)[:2]
        cuts = [
            *cuts[(cuts > 0) & (cuts < 1)],
            *np.clip(-(a[:2] @ step) / (step @ step) + np.array([-0.1, 0, 0.1]), 0, 1),
        ]
        points = a + np.array(cuts)[:, None] * (b - a)
        places += [*np.arctan2(points[:, 1], points[:, 0])]
    return between(np.sort(places), along)


def cone_camera(half_angle_deg):
    """Camera that sees a cone."""
    side = 2 * (math.ceil(1000 * math.radians(half_angle_deg)) + 64)
    lens = {"model": "opencv_fisheye", "max_angle_deg": half_angle_deg}
    return rc.Camera(width=side, height=side, fx=1000, fy=1000, **lens)


def triangle_case(rng):
    """A triangle from a few metres away, an eye and a pose of it, random."""
    corners = rng.normal(size=(3, 3)) * 10 ** rng.uniform(-0.5, 0.7)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    height = 10 ** rng.uniform(-1, 0.7)
    middle = rng.dirichlet((1, 1, 1)) @ corners
    beside = (corners[1] - corners[0]) * rng.choice([0, 0.5, 2]) * rng.normal()
    eye = middle + beside + height * normal / np.linalg.norm(normal)
    towards = rng.dirichlet((1, 1, 1)) @ corners + rng.normal(size=3) * rng.choice([0.01, 1, 5])
    return corners, eye, rc.look_at(eye, towards, rng.normal(size=3))
