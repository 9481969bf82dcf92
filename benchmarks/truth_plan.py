"""Isovists of pysovist against the floor that a camera sees in an extruded room.

Where walls and pillars reach the ceiling, a point of the floor is visible from an eye exactly if
it is so in the plan. pysovist sweeps wedges of angles in the plane; ours is `rc.regions` of a
camera that looks straight down. Its documentation gives 1e-9 relative as its accuracy.
"""

import numpy as np
import shapely
from compared import Compared, Comparison, amount

import rastercov as rc

ROOMS, EYES = 200, 10
CEILING = 3.0
CLEAR = 0.02
"""Distance of an eye from walls, and of pillars from each other, metres."""
THEIR_BOUND = 1e-9
CAMERA = rc.Camera.from_fov(1000, 1000, hfov_deg=172)
"""Its image contains the floor within 14 times the height of the eye."""


def random_plan(rng: np.random.Generator) -> shapely.Polygon:
    """Room of 5 to 14 corners around the origin, some of them concave, with up to 8 pillars."""
    n = int(rng.integers(5, 15))
    angles = np.sort(rng.uniform(0, 2 * np.pi, n)) if rng.random() < 0.3 else _spread(n, rng)
    ring = _ring(angles, rng.uniform(2.5, 6, n))
    plan = shapely.Polygon(ring)
    if not plan.is_valid or not plan.buffer(-0.5).contains(shapely.Point(0, 0)):
        return random_plan(rng)
    for _ in range(int(rng.integers(1, 9))):
        corners = int(rng.integers(3, 9))
        centre, radius = rng.uniform(-4, 4, 2), rng.uniform(0.1, 0.6)
        pillar = shapely.Polygon(centre + _ring(_spread(corners, rng), np.full(corners, radius)))
        if plan.buffer(-CLEAR).contains(pillar):
            plan = plan.difference(pillar)
    return plan


def _spread(n: int, rng: np.random.Generator) -> np.ndarray:
    return 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.8, n)) / n


def _ring(angles: np.ndarray, radii: np.ndarray) -> np.ndarray:
    return np.column_stack((np.cos(angles), np.sin(angles))) * radii[:, None]


def extruded(plan: shapely.Polygon) -> tuple[rc.Mesh, np.ndarray]:
    """Floor, and walls from floor to ceiling; the segments of the plan."""
    corners = [
        np.array(part.exterior.coords)[:3]
        for part in shapely.constrained_delaunay_triangles(plan).geoms
    ]
    flat = np.concatenate([_upward(three) for three in corners])
    floor = np.column_stack((flat, np.zeros(len(flat))))
    segments = np.concatenate(
        [
            np.stack((r[:-1], r[1:]), axis=1)
            for r in map(_coordinates, (plan.exterior, *plan.interiors))
        ]
    )
    low = np.concatenate((segments, np.zeros((len(segments), 2, 1))), axis=2)
    high = low + np.array((0, 0, CEILING))
    walls = np.stack((low[:, 0], low[:, 1], high[:, 1], low[:, 0], high[:, 1], high[:, 0]), axis=1)
    vertices = np.concatenate((floor, walls.reshape(-1, 3)))
    return rc.Mesh(vertices, np.arange(len(vertices)).reshape(-1, 3)), segments


def _coordinates(ring: shapely.LinearRing) -> np.ndarray:
    return np.array(ring.coords)


def _upward(three: np.ndarray) -> np.ndarray:
    one, other = three[1] - three[0], three[2] - three[0]
    return three if one[0] * other[1] > one[1] * other[0] else three[::-1]


def eyes_in(plan: shapely.Polygon, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 2) points of the room away from its walls."""
    low_x, low_y, high_x, high_y = plan.bounds
    free, items = plan.buffer(-CLEAR), []
    while len(items) < count:
        point = rng.uniform((low_x, low_y), (high_x, high_y))
        if free.contains(shapely.Point(point)):
            items.append(point)
    return np.array(items)


def isovists(effort: float) -> list[Compared]:
    """Visible floor of random rooms with pillars."""
    import pysovist

    compared = Compared("visible floors of 200 rooms", "m²")
    for seed in range(amount(ROOMS, effort)):
        rng = np.random.default_rng(seed)
        plan = random_plan(rng)
        mesh, segments = extruded(plan)
        points = eyes_in(plan, EYES, rng)
        eyes = np.column_stack((points, rng.uniform(1.2, 2.8, EYES)))
        poses = rc.look_at(eyes, eyes - (0, 0, 1), up=(0, 1, 0))
        n_floor = mesh.n_faces - 2 * len(segments)
        seen = rc.regions(mesh, CAMERA, poses)
        ours, bounds = (part[:, :n_floor].sum(axis=1) for part in (seen.areas(), seen.bounds()))
        sections = pysovist.Plan(segments)
        theirs = np.array([pysovist.isovist(sections, point).area for point in points])
        beyond = compared.add(ours, theirs, bounds + THEIR_BOUND * theirs)
        for eye in np.flatnonzero(beyond):
            compared.faults.append(f"room {seed}, eye {eyes[eye]}: {ours[eye]}, {theirs[eye]}")
    return [compared]


COMPARISONS = [Comparison("pysovist", "pysovist", isovists)]
