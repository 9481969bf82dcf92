"""Visible pieces that the solvers hand out to those who ask for them."""

import numpy as np
import pytest
from exact_cases import hostile
from exact_views import SEEDS, look, on_both_paths, see_again, soup
from hypothesis import given
from nightly import examples
from surfaces import surface_of

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at

CAMERA = Camera(width=320, height=240, fx=260, fy=270)


def pieces_of(solver):
    """Area of the pieces of each face, (F,), and their number."""
    (corners, starts, faces), area = solver.kept, np.zeros(len(solver.visible))
    for piece, face in enumerate(faces):
        own = corners[starts[piece] : starts[piece + 1]]
        u, v = (own - own[0]).T
        area[face] += (u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2
    return area, len(faces)


def solver_with_pieces(mesh, camera, pose, path):
    solver = path(surface_of(mesh), camera, keeps_pieces=True)
    see_again(solver, mesh, camera, pose)
    return solver


@pytest.mark.slow
@on_both_paths
@given(seed=SEEDS)
@examples(8, at_night=25)
def test_pieces_have_the_visible_area_and_asking_changes_no_bit(path, seed):
    case = hostile(seed)
    plain = look(case.mesh, case.camera, case.pose, path)
    asked = solver_with_pieces(case.mesh, case.camera, case.pose, path)
    for name in ("visible", "area", "area_error", "is_certified", "state"):
        assert np.array_equal(getattr(plain, name), getattr(asked, name)), name
    area, _ = pieces_of(asked)
    is_whole = asked.visible >= asked.area
    has_none = is_whole | (asked.visible == 0)
    off = np.abs(area - asked.visible)[~has_none]
    assert (off <= 1e-9 * asked.area[~has_none] + 1e-12).all()
    # The largest face of a region that counts as whole or hidden may have pieces all the same.
    assert not area[has_none & ~asked.is_certified].any()


@on_both_paths
def test_pieces_are_those_of_the_last_pose(path):
    mesh = soup(np.random.default_rng(3), n=80)
    wanted, n = pieces_of(solver_with_pieces(mesh, CAMERA, np.eye(4), path))
    assert n > 100
    solver = solver_with_pieces(mesh, CAMERA, np.eye(4), path)
    pieces, m = pieces_of(solver)
    assert m == n
    assert np.array_equal(pieces, wanted)
    see_again(solver, mesh, CAMERA, look_at(eyes=[(1, 0, 0)], targets=(0, 0, 5))[0])
    see_again(solver, mesh, CAMERA, np.eye(4))
    assert np.array_equal(pieces_of(solver)[0], wanted)


def test_a_solver_that_is_not_asked_keeps_nothing():
    solver = look(soup(np.random.default_rng(0)), CAMERA, np.eye(4))
    assert pieces_of(solver)[1] == 0
