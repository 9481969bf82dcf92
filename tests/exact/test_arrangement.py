"""Crossed faces divided by event edges: which edges count, and what half planes say of the rest."""

import numpy as np
import pytest
from exact_cases import AHEAD, window
from exact_views import SEEDS, assert_agree, assert_within_bounds, look, soup
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet, square

from rastercov.core.mesh import Mesh, contacts, shapes
from rastercov.engine.solver_parts import CROSSED


def test_edges_behind_a_wall_cross_nothing():
    """
    A wall hides a soup of triangles: none of their edges is visible, so none is crossed.
    """
    wall = sheet((-9, -9), (9, 9), 1.0)
    mesh = joined(wall, soup(np.random.default_rng(1), n=80, size=0.1))
    view = look(mesh, window(), AHEAD)
    marked = view.state[wall.n_faces :] & CROSSED != 0
    in_contact = view.surface.contacts(0.0)[0][wall.n_faces :]
    assert view.n_events > 100
    assert not (marked & ~in_contact).any()
    assert view.visible[wall.n_faces :].max() == 0


def test_neighbours_that_abut_are_divided_although_they_touch():
    """Faces along a T-junction touch each other without passing through each other."""
    tile, row = sheet((-1, -1), (1, 0), 4.0), [sheet((x, 0), (x + 0.5, 1), 4.0) for x in (-1, -0.5)]
    shade = sheet((-0.7, -0.3), (0.1, 0.4), 3.0)
    mesh = joined(tile, *row, sheet((0, 0), (1, 1), 4.0), shade)
    view = assert_agree(mesh, window(), AHEAD)
    assert view.surface.contacts(0.0)[0].sum() >= 5
    assert view.n_left == 0


def test_faces_that_pass_through_each_other_are_divided_along_their_intersection():
    tilted = shapes.box((1.0, 1.0, 0.02))
    turn = np.array([(1, 0, 0), (0, 0.8, -0.6), (0, 0.6, 0.8)])
    tilted = type(tilted)(vertices=tilted.vertices @ turn.T + (0, 0, 4), faces=tilted.faces)
    view = assert_agree(joined(square(1.0, 4.0), tilted), window(), AHEAD)
    assert view.n_crossed > 2
    assert view.n_left == 0


@pytest.mark.slow
@given(seed=SEEDS)
@examples(7, at_night=20)
def test_faces_that_pass_through_each_other_are_as_good_as_their_bounds(seed):
    rng = np.random.default_rng(seed)
    mesh = joined(square(2.0, 4.0), soup(rng, n=int(rng.integers(2, 40)), size=rng.uniform(0.3, 2)))
    assert_agree(mesh, window(), AHEAD)
    assert_within_bounds(mesh, window(), AHEAD, np.arange(4))


def bent(*rows):
    """Welded strip of quads between rows of points, (N, 2, 3)."""
    quads = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(rows) - 1)]
    faces = [half for a, b, c, d in quads for half in ((a, b, c), (a, c, d))]
    return Mesh(vertices=np.array(rows, float).reshape(-1, 3), faces=np.array(faces))


def test_a_sheet_that_passes_through_a_face_along_a_seam_is_left_to_half_planes():
    r"""
    ____/____  tile     None of its faces passes through the tile: one is before it, one
       /                behind, and their common edge, which is no event edge, lies in it.
      /  sheet
    """
    rows = [[(x, y, 4 - x / 3) for y in (-3, 3)] for x in (3, 0, -3)]
    view = assert_agree(joined(square(1, 4), bent(*rows)), window(), AHEAD)
    assert view.n_left > 0
    assert view.visible[:2].sum() == pytest.approx(1250)  # half of 50 x 50 px


@pytest.mark.slow
@pytest.mark.parametrize("width", [1e-12, 1e-11, 1e-10, 1e-8, 1e-5, -1e-11, -1e-8])
@given(tilt=st.floats(-0.3, 0.3))
@settings(max_examples=10)
def test_a_sheet_that_passes_through_a_face_by_a_sliver_hides_its_part(width, tilt):
    r"""
    tile _______|______      Its part before the tile is joined to its border behind it by faces
                |            along the rays of the camera: slivers in the image.
     sheet _____/
    """
    ends = np.array([(tilt, -2), (-tilt, 2)])
    before = np.column_stack((ends * 3, (3.0, 3.0)))
    far = np.column_stack((5 * (ends + np.array((width, 0))), (5.0, 5.0)))
    left = before - (6, 0, 0)
    mesh = joined(square(1, 4), bent(left, before, far))
    view = assert_agree(mesh, window(), AHEAD)
    hidden = 2500 - view.visible[:2].sum()
    assert hidden == pytest.approx(1250, abs=5e3 * abs(width) + 1e-9)
    assert_within_bounds(mesh, window(), AHEAD)


def test_a_face_with_too_many_partners_lists_none():
    mesh = joined(*(square(size, 4) for size in np.linspace(0.2, 1, contacts.MOST_PARTNERS)))
    starts, _ = mesh.contacts.partners_for(0.0)
    assert mesh.contacts.faces_for(0.0).all()
    assert np.diff(starts).min() == 0
    assert_agree(mesh, window(), AHEAD)
