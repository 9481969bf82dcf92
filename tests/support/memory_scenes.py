"""Hostile scenes for the loops of exact/, area/ and mesh/: `make sanitize` checks each index."""

import numpy as np
from exact_cases import hostile
from exact_views import PATHS, look
from nightly import amount

import rastercov as rc
from rastercov.core.area.zones import summary_of
from rastercov.core.mesh.contacts import touching_faces

SCENES = amount(40, at_night=100)


def look_at_scenes():
    """Look in both ways; sizes of scratch memory start as small as they can."""
    for seed in range(SCENES):
        case = hostile(seed)
        one, other = (look(case.mesh, case.camera, case.pose, path) for path in PATHS)
        assert np.allclose(one.visible, other.visible, rtol=0, atol=1e-9), case


def find_contacts():
    rng = np.random.default_rng(0)
    for n in [1, 2, 3, 4, 5, 8, 9, 31, 32, 33, 500, *rng.integers(1, 70, 200)]:
        points = rng.normal(size=(3 * n, 3)) * 10.0 ** rng.uniform(-9, 9, (3 * n, 1))
        if rng.random() < 0.5:
            points = rng.integers(0, 3, (3 * n, 3)) * 1.0
        faces = rng.integers(0, 3 * n, (n, 3))
        for tolerance in (0, 1e-3, np.inf):
            assert touching_faces(points, faces, tolerance).sum() != 1


def cover_scenes():
    """Regions, unions, dead zones and cells of the scenes, of each mesh by three tasks at once."""
    for seed in range(SCENES):
        case = hostile(seed)
        density = 10.0 ** np.random.default_rng(seed).uniform(-1, 3)
        tasks = (
            rc.Task(),
            rc.Task(max_incidence_deg=60),
            rc.Task(min_pixel_density=density, min_pixels_per_m2=density**2 / 2),
        )
        parts = [rc.regions(case.mesh, case.camera, case.pose, task) for task in tasks]
        covered = rc.unite(parts, 2)
        assert (covered.area[1] <= covered.area[0] + 1e-12 * case.mesh.areas).all(), case
        zones = rc.dead_zones(covered)
        summary_of(zones, case.camera, tasks[0], case.pose[None])
        own = case.mesh.task_mask
        scored = case.mesh.areas[own].sum() - covered.area[1, own].sum()
        assert abs(zones.area.sum() - scored) <= covered.bound.sum() + 1e-9 * case.mesh.areas.sum()
        size = np.linalg.norm(np.ptp(case.mesh.bounds, axis=0))
        cells = rc.cells(case.mesh, size / 10)
        for part in parts:
            assert (cells.share(part).share <= 1).all(), case
