"""Blocks of faces: what is decided for a block at once is what each of its faces gives alone."""

import numpy as np
import pytest
from exact_cases import grid
from exact_views import SEEDS, Certificate, look, regions_of, see_again, soup
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined
from surfaces import Surface, surface_of

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.engine import solver_parts
from rastercov.engine.solver_parts import (
    BLOCK,
    LIVE,
    MIXED,
    SUM_OF_WIDTHS,
    U_MAX,
    U_MIN,
    UNEVEN,
    V_MAX,
    V_MIN,
)

CAMERA = Camera(width=320, height=240, fx=300, fy=300)


def scene(rng):
    """Two rings, of which one may be open or turned inside out, and a few faces among them."""
    rings = []
    for _ in range(2):
        size = rng.integers((12, 8), (60, 30)) if rng.random() < 0.3 else rng.integers(60, 120, 2)
        ring = shapes.torus(int(size[0]), int(size[1]))
        faces = ring.faces[rng.random(ring.n_faces) < 0.98] if rng.random() < 0.5 else ring.faces
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rings.append(Mesh(ring.vertices @ turn + rng.normal(size=3) * 0.7, faces))
    if rng.random() < 0.5:
        rings.append(soup(rng, 12))
    return joined(*rings)


def view_of(mesh, rng):
    """A pose near a mesh, within its box or outside, so that blocks lie in, across and beyond."""
    centre, size = mesh.bounds.mean(axis=0), np.ptp(mesh.bounds, axis=0).max()
    direction = rng.normal(size=3)
    eye = centre + direction / np.linalg.norm(direction) * size * rng.uniform(0.2, 2.5)
    return look_at(eye, centre + rng.normal(size=3) * size * 0.2, rng.normal(size=3))[0]


def one_by_one(mesh):
    """Surface of a mesh that says of no block that its faces can be decided together."""
    return Surface(solver_parts.one_by_one(surface_of(mesh).native))


@pytest.mark.slow
@given(seed=SEEDS, front_only=st.booleans())
@examples(4, at_night=25)
def test_blocks_change_no_figure(seed, front_only):
    rng = np.random.default_rng(seed)
    mesh = scene(rng)
    # What the pose before has left must not matter.
    assert_same(mesh, [view_of(mesh, rng) for _ in range(2)], front_only)


def assert_same(mesh, poses, front_only=False):
    """With blocks and without them, poses have the same figures, one after the other."""
    together = Certificate(surface_of(mesh), CAMERA)
    apart = Certificate(one_by_one(mesh), CAMERA)
    for pose in poses:
        for view in (together, apart):
            see_again(view, mesh, CAMERA, pose, front_only=front_only)
        assert_same_figures(together, apart)


def assert_same_figures(together, apart):
    """Two solvers have the same figures, and the second decided no block at once."""
    assert (apart.block_state & UNEVEN).all()
    for name in ("area", "state", "side", "is_certified"):
        assert np.array_equal(getattr(together, name), getattr(apart, name)), name
    assert together.n_events == apart.n_events
    assert np.array_equal(regions_of(together), regions_of(apart))
    # The grids may differ, and with them the order of sums: in the last bit, or where a block
    # counts faces that are left out.
    if together.side.all():
        np.testing.assert_allclose(together.extent, apart.extent, rtol=1e-12)
    ours, theirs = together.extent, apart.extent
    more = 1 + 1e-12
    assert (ours[[U_MIN, V_MIN]] <= theirs[[U_MIN, V_MIN]]).all()
    assert (ours[[U_MAX, V_MAX]] >= theirs[[U_MAX, V_MAX]]).all()
    assert (ours[SUM_OF_WIDTHS:] * more >= theirs[SUM_OF_WIDTHS:]).all()
    off = np.abs(together.visible - apart.visible)
    assert (off <= together.area_error + apart.area_error).all()
    some = np.flatnonzero(together.state & LIVE)
    assert np.array_equal(together.boxes[some], apart.boxes[some])


@pytest.mark.slow
@given(seed=SEEDS, front_only=st.booleans())
@examples(5, at_night=15)
def test_regions_end_where_whole_blocks_of_two_sides_meet(seed, front_only):
    """Each side of the box is two blocks, some turned inside out: contours run between blocks."""
    rng = np.random.default_rng(seed)
    box = shapes.box(n=8)
    faces = box.faces.reshape(6, 2 * BLOCK, 3).copy()
    turned = rng.random(6) < 0.3
    faces[turned] = faces[turned][:, :, ::-1]
    mesh = Mesh(box.vertices, faces.reshape(-1, 3))
    direction = rng.normal(size=3)
    eye = mesh.bounds.mean(axis=0) + direction / np.linalg.norm(direction) * rng.uniform(4, 8)
    pose = look_at(eye, mesh.bounds.mean(axis=0), rng.normal(size=3))[0]
    assert_same(mesh, [pose], front_only)


@pytest.mark.parametrize("height", [0.0, 1e-15, 1e-9])
def test_a_plate_seen_edge_on_is_looked_at_face_by_face(height):
    flat, faces = grid(20)
    mesh = Mesh(np.column_stack((flat, np.zeros(len(flat)))), faces)
    pose = look_at((0.0, -4.0, height), (0.0, 0.0, height), (0.0, 0.0, 1.0))[0]
    assert_same(mesh, [pose])


def test_most_blocks_of_a_fine_mesh_are_decided_together():
    mesh = shapes.torus(240, 120)
    pose = look_at(np.array((3.0, 2.0, 4.0)), mesh.bounds.mean(axis=0), (0, 0, 1))[0]
    for front_only in (True, False):
        view = look(mesh, CAMERA, pose, front_only=front_only)
        state, side = view.block_state, view.block_side
        assert ((state == LIVE) & (side != MIXED)).mean() > 0.3
        assert view.n_regions < 10
