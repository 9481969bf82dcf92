"""Densities by area through panoramas and wide fisheyes: bounds that reach their target, and lines.

The target is 2e-5 of the diagonal of the mesh times the length of the border; borders of these
scenes are shorter than 12 diagonals a pose.
"""

import numpy as np
import pytest
from exact_cases import box
from hypothesis import given
from hypothesis import strategies as st
from lens_cases import rays_of_plane
from nightly import amount, examples, nightly
from scenes import joined
from surface_cases import assert_pointwise

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.engine.lens_field import bounds_within

pytestmark = pytest.mark.native
CAMERAS = {
    "panorama": rc.Camera(width=1440, height=720, fx=720 / np.pi, fy=720 / np.pi,
                          model="equirectangular"),
    "280 degrees": rc.Camera(width=1024, height=1024, fx=200, fy=200, model="opencv_fisheye",
                             distortion=(0, 0, 0, 0)),
    "340 degrees": rc.Camera(width=1024, height=1024, fx=172, fy=170, model="opencv_fisheye",
                             distortion=(0.002, 0, 0, 0)),
}  # fmt: skip
MOST_BORDER = 12.0
"""Length of the borders of what a pose covers, in diagonals."""


def room_with_crate(rng):
    size = rng.uniform(2, 8, 3)
    low = rng.uniform(0.1, 0.5, 3) * size
    crate = box(low, low + rng.uniform(0.1, 0.35, 3) * size)
    walls = box((0, 0, 0), size)
    mesh = joined(rc.Mesh(walls.vertices, walls.faces[:, ::-1]), crate)
    eye = low - rng.uniform(0.1, 0.9, 3) * low
    return mesh, rc.look_at(eye[None], low[None] + rng.uniform(0, 0.1, 3))


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("seed", range(amount(2, at_night=30)))
def test_the_bound_of_a_density_reaches_its_target(name, seed):
    rng = np.random.default_rng(seed)
    mesh, pose = room_with_crate(rng)
    diagonal = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    near = CAMERAS[name].fy / diagonal
    for task in (
        rc.Task(min_pixel_density=near * rng.uniform(0.3, 3)),
        rc.Task(min_facing_density=near * rng.uniform(0.5, 4)),
        rc.Task(min_pixels_per_m2=near**2 * rng.uniform(0.2, 5)),
    ):
        regions = rc.regions(mesh, CAMERAS[name], pose, task)
        assert regions.bound.sum() <= 2e-5 * diagonal * MOST_BORDER * diagonal
        assert regions.cut_short == 0
        assert len(regions) < 100_000


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(list(CAMERAS)))
@examples(3)
def test_points_of_random_rooms_lie_in_a_region_exactly_if_the_densities_hold(seed, name):
    rng = np.random.default_rng(seed)
    mesh, pose = room_with_crate(rng)
    near = CAMERAS[name].fy / np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    for task in (
        rc.Task(min_pixel_density=near * rng.uniform(0.3, 3)),
        rc.Task(min_facing_density=near * rng.uniform(0.5, 4), max_incidence_deg=80),
    ):
        assert_pointwise(mesh, CAMERAS[name], pose, task, amount(1000, at_night=3000), seed % 1000)


@pytest.mark.parametrize("name", CAMERAS)
def test_no_difference_of_the_inverse_is_above_its_bound_near_an_axis(name):
    """Also of log |det A|; at distances down to a thousandth of the plane."""
    lens, rng, step = lens_of(CAMERAS[name]), np.random.default_rng(3), 1e-3
    n_tried = 0
    for proved in lens.proved:
        plane, slopes = proved.record, proved.slopes
        if not np.isfinite(slopes.near_axis).all():
            continue
        distance = np.geomspace(0.003, 1.0, 400)
        turn = rng.uniform(0, 2 * np.pi, 400)
        for x, y, d in zip(distance * np.cos(turn), distance * np.sin(turn), distance, strict=True):
            along = rng.normal(size=2)
            along *= step * d / np.hypot(*along)
            points = np.array((x, y)) + np.array((-1, 0, 1))[:, None] * along
            A = lens.jacobian(rays_of_plane(plane, points)) @ plane.frame[:, :2]
            if not np.isfinite(A).all():
                continue
            n_tried += 1
            B, L = np.linalg.inv(A), np.log(np.abs(np.linalg.det(A)))
            true = [
                (np.linalg.norm(B[2] - B[0], 2) / 2, np.linalg.norm(B[2] - 2 * B[1] + B[0], 2)),
                (abs(L[2] - L[0]) / 2, abs(L[2] - 2 * L[1] + L[0])),
            ]
            bounds = bounds_within(slopes, x, x, y, y)[1]
            for (one, two), (first, second) in zip(true, bounds, strict=True):
                assert one <= first * step * d * 1.01
                assert two <= second * (step * d) ** 2 * 1.02 + 1e-12
    assert n_tried > 150


@nightly
@pytest.mark.slow
def test_what_divisions_leave_is_said():
    """Tangential terms of a lens that sees far behind have no bounds near the opposite ray."""
    camera = rc.Camera(width=1024, height=1024, fx=190, fy=190, model="thin_prism_fisheye",
                       distortion=(0, 0, 1e-3, 1e-3, 0, 0, 1e-3, 1e-3))  # fmt: skip
    walls = box((0, 0, 0), (6, 5, 3))
    mesh = rc.Mesh(walls.vertices, walls.faces[:, ::-1])
    pose = rc.look_at(np.array([[2.0, 1.8, 1.5]]), np.array([[4.0, 3.0, 1.0]]))
    task = rc.Task(min_pixel_density=30)
    regions = rc.regions(mesh, camera, pose, task)
    assert 0 < regions.cut_short <= regions.bound.sum()
    lines = rc.evaluate(mesh, camera, pose, task, by="area", fields=()).summary()["doubts"]
    assert any("undecided and added to the bound" in line for line in lines)
