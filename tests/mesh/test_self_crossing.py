"""Closed meshes that cut themselves: their backs may show, so nothing is left out unproved."""

import numpy as np
import pytest
from exact_cases import box
from exact_views import HalfPlanes, fractions, look
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined
from visible_fractions import visibility

import rastercov as rc
from rastercov.core.camera.pose import limits
from rastercov.core.mesh import shapes
from rastercov.reference import rational

CAMERA = rc.Camera(width=320, height=320, fx=300, fy=300)
METHODS = ("certified", "exact")
OUTSIDE = rc.look_at([(9.0, 0.5, 0.3)], (0, 0, 0))
BOW_TIE = [(-3, -3), (1, 1), (1, -1), (-3, 3)]


def prism(ring):
    """Closed, consistently wound prism from z = -1 to 1 over a ring, which may cross itself."""
    n = len(ring)
    points = [(x, y, z) for z in (-1.0, 1.0) for x, y in ring]
    sides = []
    for i in range(n):
        j = (i + 1) % n
        sides += [(i, j, n + j), (i, n + j, n + i)]
    bottom = [(0, i + 1, i) for i in range(1, n - 1)]
    top = [(n, n + i, n + i + 1) for i in range(1, n - 1)]
    return rc.Mesh(vertices=points, faces=sides + bottom + top)


def assert_right(mesh, poses):
    for method in METHODS:
        observation = visibility(mesh, CAMERA, poses, method)
        for row, pose in enumerate(poses):
            is_front = observation.visibility[row] > 0
            off = np.abs(observation.visibility[row] - fractions(mesh, CAMERA, pose)[0])[is_front]
            assert (off <= observation.visibility_bound[row][is_front] + 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("open_raster", ["pipeline", "cpu"], indirect=True)
def test_rasterisers_see_the_back_of_a_bow_tie(open_raster):
    mesh = prism(BOW_TIE)
    area = rational.visible_area(mesh, CAMERA, OUTSIDE[0])
    counts = open_raster(mesh, CAMERA).count(OUTSIDE)
    assert np.abs(counts.visible[0] - area).max() < 0.02 * area.sum()


def test_the_diagnosis_names_the_faces_that_cut_each_other():
    assert not prism(BOW_TIE).can_cull_back_faces
    assert_right(prism(BOW_TIE), OUTSIDE)
    assert "intersects or touches itself at 8 faces, such as face 0" in " ".join(
        prism(BOW_TIE).warnings
    )
    assert not any("itself" in line for line in prism(BOW_TIE[:3]).warnings)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@examples(4, at_night=12)
def test_prisms_over_any_ring_are_seen_as_fractions_say(seed):
    rng = np.random.default_rng(seed)
    mesh = prism([tuple(p) for p in rng.normal(size=(int(rng.integers(4, 8)), 2))])
    away = rng.normal(size=(2, 3))
    eyes = 6 * away / np.linalg.norm(away, axis=1, keepdims=True)
    assert_right(mesh, rc.look_at(eyes, (0, 0, 0)))


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@examples(5, at_night=15)
def test_culling_changes_no_area_of_solids_that_cross_one_another(seed):
    """Each is closed and outward by itself, so the winding number is nowhere negative."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(int(rng.integers(2, 5))):
        low = rng.uniform(-1.5, 0, 3)
        part = (box(low, low + rng.uniform(0.2, 1.5, 3)), shapes.torus(7, 5), shapes.sphere(1))[
            rng.integers(3)
        ]
        parts.append(rc.Mesh(vertices=part.vertices + rng.normal(size=3) / 2, faces=part.faces))
    mesh = joined(*parts)
    away = rng.normal(size=(3, 3))
    poses = rc.look_at(9 * away / np.linalg.norm(away, axis=1, keepdims=True), (0, 0, 0))
    assert mesh.can_cull_back_faces
    assert limits(mesh, CAMERA, poses)[1].all()
    for pose in poses:
        culled, whole = (
            look(mesh, CAMERA, pose, HalfPlanes, front_only=cull) for cull in (True, False)
        )
        assert (
            np.abs(culled.visible - whole.visible) <= culled.area_error + whole.area_error
        ).all()


def test_a_thin_plate_is_culled_from_near_and_not_from_where_its_sides_are_one_depth():
    mesh = box((-1, -1, 0), (1, 1, 1e-6))
    near, far = rc.look_at([(0, 0, 5)], (0, 0, 0)), rc.look_at([(0, 0, 5e5)], (0, 0, 0))
    assert limits(mesh, CAMERA, near)[1].all()
    assert not limits(mesh, CAMERA, far)[1].any()


def test_one_component_that_touches_itself_is_kept_whole():
    # A ring of boxes' outline that comes back to where it started: two of its walls are one plane.
    ring = [(0, 0), (3, 0), (3, 3), (1, 3), (1, 1), (2, 1), (2, 2), (1, 2), (1, 3), (0, 3)]
    mesh = prism(ring)
    assert not mesh.can_cull_back_faces
    assert mesh.self_contact_mask.any()
