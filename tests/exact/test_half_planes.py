"""The analytic path: scratch memory that grows, odd cameras, extremes, and what culling may do."""

import memory_scenes
import numpy as np
import pytest
from exact_cases import AHEAD, triangles, window
from exact_views import (
    SEEDS,
    HalfPlanes,
    assert_within_bounds,
    look,
    on_both_paths,
    see_again,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh
from rastercov.reference import rational

CAMERA = Camera(width=320, height=240, fx=260, fy=270)


# --- memory ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.native
@pytest.mark.parametrize("scenes", ["find_contacts", "look_at_scenes", "cover_scenes"])
def test_no_scene_reaches_past_the_arrays_of_exact_and_contact_loops(scenes):
    getattr(memory_scenes, scenes)()


@on_both_paths
def test_faces_cut_in_space_make_room_for_themselves(path):
    # 300 faces around the eye, of which all reach behind it: far more than there is room for.
    rng = np.random.default_rng(2)
    mesh = triangles(*(rng.normal(size=(300, 3, 3)) * 3))
    view = look(mesh, CAMERA, AHEAD, path)
    assert view.n_clipped > 100
    visible = view.visible
    see_again(view, mesh, CAMERA, AHEAD)  # which has room for them
    assert np.array_equal(view.visible, visible)


# --- cameras --------------------------------------------------------------------------------------


@pytest.mark.slow
@on_both_paths
@given(
    seed=SEEDS,
    width=st.sampled_from((1, 2, 7, 200, 3000)),
    height=st.sampled_from((1, 3, 50, 2000)),
    cx=st.floats(-20, 20),
    cy=st.floats(-20, 20),
    focal=st.floats(-1, 2),
    stretch=st.floats(-1, 1),
)
@examples(5, at_night=15)
def test_any_camera_sees_as_in_exact_arithmetic(path, seed, width, height, cx, cy, focal, stretch):
    # One pixel, a strip, a principal point many widths outside, pixels ten times as wide as high.
    rng = np.random.default_rng(seed)
    camera = Camera(
        width=width,
        height=height,
        fx=width * 10**focal,
        fy=width * 10 ** (focal + stretch),
        cx=cx * width,
        cy=cy * height,
    )
    ray = np.array(((0.5 - cx) * width / camera.fx, (0.5 - cy) * height / camera.fy, 1.0))
    faces = rng.normal(size=(20, 3, 3)) * 0.7 + ray * rng.uniform(0.5, 3, (20, 1, 1))
    mesh = triangles(*faces)
    assert_within_bounds(mesh, camera, AHEAD, paths=[path])


@on_both_paths
def test_coordinates_up_to_the_largest_allowed(path):
    # A ground of 1e30 m under a unit square: the square is nearer than the near limit.
    ground = triangles([(-1e30, 1, -1e30), (1e30, 1, -1e30), (0, 1, 1e30)])
    view = look(joined(ground, square(1, 2)), CAMERA, AHEAD, path)
    assert np.isfinite(view.visible).all()
    assert (view.visible[1:] == 0).all()
    # Alone it ends at 1 / 1e24 below the horizon, which nothing tells from the horizon.
    near = joined(triangles([(-1e6, 1, -1e6), (1e6, 1, -1e6), (0, 1, 1e6)]), square(1, 2))
    view = look(near, CAMERA, AHEAD, path)
    exact = rational.visible_area(near, CAMERA, AHEAD)
    assert np.abs(view.visible - exact).max() <= 1e-5


# --- culling --------------------------------------------------------------------------------------


@on_both_paths
def test_culled_back_faces_neither_hide_nor_are_seen(path):
    facing, turned = square(1, 2), square(2, 4)
    screen = Mesh(vertices=facing.vertices, faces=facing.faces[:, ::-1])
    view = look(joined(screen, turned), window(), AHEAD, path, front_only=True)
    assert view.visible.tolist() == pytest.approx([0, 0, 5000, 5000])
    assert view.area.tolist() == pytest.approx([5000] * 4)  # alone, each would be drawn
    view = look(joined(screen, turned), window(), AHEAD, path)
    assert view.visible.tolist() == pytest.approx([5000, 5000, 0, 0])


# --- what is visible is a part of what there is ---------------------------------------------------


# --- where it failed once -------------------------------------------------------------------------


@given(seed=SEEDS)
@settings(max_examples=15)
def test_sheets_folded_flat_come_out_as_in_exact_arithmetic(seed):
    # Faces on both sides of an edge, 1e-8 ... 1e-6 rad apart: which is before is clear but at the
    # edge, where both are at one depth exactly.
    rng = np.random.default_rng(seed)
    angle = 10 ** rng.uniform(-7.5, -6)
    corners = np.array([(-1, 0, 0), (1, 0, 0), (rng.uniform(-1, 1), 1, 0)])
    under = np.array([(-1, 0, 0), (1, 0, 0), (rng.uniform(-1, 1), 1.5, 1.5 * angle)])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    mesh = triangles(corners @ turn.T, under @ turn.T)
    tilt = np.pi / 2 - 10 ** rng.uniform(-5, 0)  # to grazing, where 1/z is noisiest
    away = turn[:, 2] * np.cos(tilt) + turn[:, 1] * np.sin(tilt)
    pose = look_at(away * rng.choice((-1, 1)) * 2, (0, 0, 0))[0]
    exact = rational.visible_area(mesh, CAMERA, pose)
    assert np.abs(look(mesh, CAMERA, pose, HalfPlanes).visible - exact).max() <= 1e-9


def test_a_fan_of_needles_cuts_a_face_into_few_pieces():
    # 40 needles, 1e-4 rad each: 16,384 pieces; 80 of them would be 8 million, and 8 GB.
    angle = 0.3 + np.arange(41) * 1e-4
    rim = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(41)))
    order = np.random.default_rng(0).permutation(40)
    fan = triangles(*[((0, 0, 0), rim[i], rim[i + 1]) for i in order])
    fan = Mesh(vertices=fan.vertices * 0.9 + (0.0123, 0.0371, 2), faces=fan.faces)
    view = look(joined(square(1.7, 4), fan), window(), AHEAD, HalfPlanes)
    assert view.room_for_pieces <= 1024


@on_both_paths
def test_a_strip_of_denormal_height_is_looked_at(path):
    # All there is in view lies between the rows 0 and 1e-308.
    mesh = triangles(
        [(-1, 1e-309, 1), (1, 1e-309, 1), (0, -1, 1)], [(0, 1, -1), (0.5, 0.5, -1), (0, 0.7, -1)]
    )
    look(mesh, Camera(width=4, height=4, fx=4, fy=4, cx=2, cy=0), AHEAD, path)
