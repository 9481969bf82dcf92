"""The covered area does not depend on the triangles that a surface is cut into."""

import numpy as np
import pytest
from surface_cases import building, cut_at_random, room, turned

import rastercov as rc

TASKS = [
    rc.Task(max_incidence_deg=75, min_pixels_per_m2=2000),
    rc.Task(max_incidence_deg=60, min_pixel_density=30),
    rc.Task(max_incidence_deg=75, min_facing_density=100),
]
POINTS = 1e-4
"""Percentage points of all area that another cut may change."""


def shares(mesh, camera, poses, task, views):
    """Percent of all area that 1 ... k cameras cover, m^2 of each face, and the bound, percent."""
    covered = rc.unite(rc.regions(mesh, camera, poses, task), views)
    total = mesh.areas.sum()
    percent = [100 * covered.share(k + 1) for k in range(views)]
    return np.array(percent), covered.area[0], 100 * covered.bound.sum() / total


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS, ids=["per m^2", "density", "facing"])
@pytest.mark.parametrize("scene", [room, building])
def test_another_cut_of_the_same_surface_has_the_same_covered_area(scene, task):
    mesh, camera, poses = scene()
    whole, of_face, bound = shares(mesh, camera, poses, task, 3)
    assert 1 < whole[0] < 99
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    fine = rc.cells(mesh, size / 12)
    cuts = [
        cut_at_random(mesh, 1, 150),
        cut_at_random(mesh, 2, 150),
        (fine.elements, fine.source_face),
    ]
    for other, origin in cuts:
        assert other.n_faces > 2 * mesh.n_faces
        assert np.allclose(np.bincount(origin, other.areas), mesh.areas, rtol=1e-13)
        percent, of_part, other_bound = shares(other, camera, poses, task, 3)
        assert np.abs(percent - whole).max() <= POINTS
        together = np.bincount(origin, of_part, minlength=mesh.n_faces)
        off = 100 * np.abs(together - of_face) / mesh.areas.sum()
        assert off.max() <= POINTS
        assert off.sum() <= 2 * (bound + other_bound) + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_cuts_rounded_off_the_surface_keep_the_area_within_bounds(seed):
    mesh, camera, poses = room()
    there, theirs = turned(mesh, poses)  # points of its edges lie off them by rounding
    whole, of_face, bound = shares(there, camera, theirs, TASKS[0], 2)
    other, origin = cut_at_random(there, seed, 150)
    percent, of_part, other_bound = shares(other, camera, theirs, TASKS[0], 2)
    assert np.abs(percent - whole).max() <= 1e-3
    off = np.abs(np.bincount(origin, of_part, minlength=mesh.n_faces) - of_face)
    assert 100 * off.sum() / mesh.areas.sum() <= 2 * (bound + other_bound) + 1e-6
