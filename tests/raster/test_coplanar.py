"""Surfaces within 1e-10 of each other's depth count as one, and the lower face is seen.

On all rasterisers.
"""

from itertools import product

import numpy as np
import pytest
from coplanar_scenes import CAMERA, SCENES, scene_of, wrong_samples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import joined, sheet, square

from rastercov.core.mesh import Mesh
from rastercov.gl import GLRasterizer
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
    for shift in (0.0, 1e-12, 1e-9, 1e-6, 1e-4):
        pose = AHEAD.copy()
        pose[0, 3] = shift
        with open_gl(mesh, CAMERA) as rasterizer:
            buffer = rasterizer.render(pose)
        assert (buffer.face < 2).all()
        np.testing.assert_allclose(buffer.depth[buffer.face >= 0], 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (square(1, 2, (0.5, 0.5)), "compute"),
        (square(0.1, 2 + 1e-13, (0.5, 0.2)), "compute"),  # wholly within one face
        (square(1, 2, (5, 0)), "pipeline"),
        (square(1, 2.001), "pipeline"),
    ],
)
def test_faces_of_one_plane_are_not_left_to_the_pipeline(device, other, expected):
    for mesh in (joined(square(1, 2), other), joined(other, square(1, 2))):
        with GLRasterizer(mesh, CAMERA, device=device, plan="pipeline") as rasterizer:
            assert rasterizer.info.plan == expected
