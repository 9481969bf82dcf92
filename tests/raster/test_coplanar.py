"""Surfaces within 1e-10 of each other's depth count as one, and the lower face is seen.

On all rasterisers; and which faces OpenGL's plans draw with a depth of their own for it.
"""

from itertools import product

import numpy as np
import pytest
from coplanar_scenes import CAMERA, SCENES, scene_of, wrong_samples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import joined, sheet, square
from solids import tessellated_plane

from rastercov.core.mesh import Mesh, contacts, shapes
from rastercov.gl.coplanar import coplanar_overlaps
from rastercov.gl.strategy import Strategy

AHEAD = np.eye(4)


def assert_lowest_seen(open_raster, mesh, poses):
    with open_raster(mesh, CAMERA) as rasterizer:
        for pose in poses:
            wrong = wrong_samples(mesh, CAMERA, pose, rasterizer.render(pose).face)
            assert not len(wrong), f"{len(wrong)} samples, the first at {wrong[0]}"


CUT = [("polygons", 210), *(("triangulations", seed) for seed in (163, 238, 304, 391))]
"""Each has a face that reaches behind the eye and is cut a millionth of its size before it."""


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [*product(SCENES, range(2)), *CUT])
def test_of_overlapping_faces_of_one_plane_the_lowest_is_seen(open_raster, kind, seed):
    assert_lowest_seen(open_raster, *scene_of(kind, seed))


@pytest.mark.slow
@settings(
    max_examples=12,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.integers(0, 2**32), st.sampled_from(sorted(SCENES)))
def test_any_assembly_of_coplanar_faces_is_seen_as_by_the_reference(open_raster, seed, kind):
    mesh, (pose,) = scene_of(kind, seed, 1)
    with open_raster(mesh, CAMERA) as rasterizer:
        wrong = wrong_samples(mesh, CAMERA, pose, rasterizer.render(pose).face)
        # Doubles 1e-13 apart round to different floats at one sample in a million.
        assert len(wrong) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"supersample": 2}, {"supersample": 2, "roll": 0.4}])
def test_overlaps_are_counted_as_they_are_drawn(open_raster, options):
    # The lower sheet hides the upper one wherever both are.
    below, above = sheet((-1, -1), (0.5, 0.4), 3.0), sheet((-0.3, -0.2), (1.1, 1.2), 3.0)
    with open_raster(joined(below, above), CAMERA, **options) as rasterizer:
        counts = rasterizer.count(AHEAD)
    np.testing.assert_array_equal(counts.visible[0, :2], counts.drawn[0, :2])
    with open_raster(joined(above, below), CAMERA, **options) as rasterizer:
        swapped = rasterizer.count(AHEAD)
    np.testing.assert_array_equal(swapped.visible[0, :2], swapped.drawn[0, :2])
    np.testing.assert_array_equal(swapped.drawn[0, 2:], counts.drawn[0, :2])
    assert counts.visible[0].sum() == swapped.visible[0].sum()
    assert counts.visible[0, 2:].sum() < counts.drawn[0, 2:].sum()


@pytest.mark.slow
def test_tiles_change_nothing_where_faces_overlap(open_gl, monkeypatch):
    mesh, poses = scene_of("triangulations", 3)
    whole = open_gl(mesh, CAMERA)
    monkeypatch.setattr(Strategy, "max_tile", 32)
    with whole, open_gl(mesh, CAMERA) as parts:
        for pose in poses:
            face = parts.render(pose).face
            assert not len(wrong_samples(mesh, CAMERA, pose, face))
            assert (face == whole.render(pose).face).mean() > 0.99


@pytest.mark.slow
def test_an_edge_on_face_does_not_come_before_what_hides_it(open_gl):
    # Two panels of one plane through the eye, behind a screen: their edges may not shine through.
    panel = np.array(((0, -1, 3), (0, 1, 3), (0, 1, 5), (0, -1, 3), (0, 1, 5), (0, -1, 5.0)))
    shifted = panel + np.array((0, 0.3, 0.5))
    points = np.concatenate((square(2, 2.0).vertices, panel, shifted))
    faces = np.concatenate((square(2, 2.0).faces, 4 + np.arange(12).reshape(4, 3)))
    mesh = Mesh(vertices=points, faces=faces)
    assert coplanar_overlaps(mesh)[2:].all()
    for shift in (0.0, 1e-12, 1e-9, 1e-6, 1e-4):
        pose = AHEAD.copy()
        pose[0, 3] = shift
        with open_gl(mesh, CAMERA) as rasterizer:
            buffer = rasterizer.render(pose)
        assert (buffer.face < 2).all()
        np.testing.assert_allclose(buffer.depth[buffer.face >= 0], 2, rtol=1e-6)


# --- which faces overlap --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.torus(40, 20),
        shapes.box(n=4),
        shapes.room(6),
        tessellated_plane(30, 20, seed=2),
        tessellated_plane(30, 20, jitter=0),
        shapes.teapot(4),
        shapes.sphere(3),
        shapes.aeroplane(1970),
    ],
)
def test_a_mesh_whose_faces_only_meet_has_no_overlaps(mesh):
    assert not coplanar_overlaps(mesh).any()


def test_copies_of_faces_are_not_overlaps_but_copies_of_overlapping_ones_are():
    lone, pair = square(1, 2), joined(square(1, 2), square(0.5, 2, (0.7, 0)))
    assert not coplanar_overlaps(joined(lone, lone)).any()
    np.testing.assert_array_equal(
        coplanar_overlaps(joined(pair, pair)), np.tile(coplanar_overlaps(pair), 2)
    )
    assert coplanar_overlaps(pair)[2:].all()


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (square(1, 2, (0.5, 0.5)), True),
        (square(0.1, 2 + 1e-13, (0.5, 0.2)), True),  # wholly within one face
        (square(1, 2, (2, 0)), False),  # side by side, with an edge in common
        (square(1, 2, (2, 0.7)), False),  # with a part of an edge
        (square(1, 2, (5, 0)), False),
        (square(1, 2.001), False),
    ],
)
def test_overlaps_are_of_positive_area_and_in_one_plane(other, expected):
    for mesh in (joined(square(1, 2), other), joined(other, square(1, 2))):
        assert coplanar_overlaps(mesh).any() == expected


def test_faces_folded_onto_each_other_overlap():
    folded = Mesh(vertices=[(0, 0, 1), (1, 0, 1), (0.2, 1, 1), (0.8, 1, 1)],
                  faces=[(0, 1, 2), (1, 0, 3)])  # fmt: skip
    assert coplanar_overlaps(folded).all()


@pytest.mark.slow
def test_overlaps_are_found_in_any_position():
    rng = np.random.default_rng(0)
    pair = joined(square(1, 2), square(0.2, 2, (0.7, -0.5)))
    expected = coplanar_overlaps(pair)
    assert expected.any()
    assert not expected.all()
    for _ in range(60):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        where = rng.normal(size=3) * 10.0 ** rng.uniform(-2, 4)
        mesh = Mesh(vertices=pair.vertices @ turn + where, faces=pair.faces)
        np.testing.assert_array_equal(coplanar_overlaps(mesh), expected)


def test_faces_with_more_contacts_than_are_listed_count_as_overlaps(monkeypatch):
    rng = np.random.default_rng(1)
    corners = rng.uniform(-1, 1, (60, 3, 2))
    points = np.dstack((corners, np.ones((60, 3)))).reshape(-1, 3)
    mesh = Mesh(vertices=points, faces=np.arange(180).reshape(-1, 3))
    expected = coplanar_overlaps(mesh)
    monkeypatch.setattr(contacts, "MOST_PARTNERS", 2)
    again = coplanar_overlaps(Mesh(vertices=points, faces=mesh.faces))
    assert (again | ~expected).all()
