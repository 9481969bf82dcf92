"""Targets in the rasterisers: counted one by one, and nothing else changes."""

from contextlib import ExitStack
from functools import cache

import numpy as np
import pytest
import triangle_samples as twin
from exact_cases import AHEAD, triangles
from gl_device import DEVICE
from hostile_scenes import scene
from hypothesis import given
from hypothesis import strategies as st
from image_laws import EDGE, assert_same_counts
from nightly import examples
from scenes import joined, square
from target_scenes import beside, only, some_as_targets

from rastercov.base.errors import DeviceError, MeshError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import limits
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.engine.raster_parts import count_triangle
from rastercov.engine.solver_raster import TIE_REL
from rastercov.gl import GLRasterizer
from rastercov.reference import samples

SMALL = Camera(width=40, height=30, fx=38, fy=36, cx=19.3, cy=15.2)
SQUARE = Camera(width=200, height=200, fx=100, fy=100)
PARALLEL = Camera(width=40, height=30, fx=9, fy=8, model="telecentric", near=0.01)
ROOM = shapes.room(4)
VIEWS = look_at([(0, 0, 1.5), (2.5, 2, 0.3), (-2.5, -2, 2.5)], [(1, 1, 1), (-3, 0, 1), (0, 0, 0)])


@pytest.fixture
def open_raster():
    """Open the rasteriser that counts targets; it is closed when the test ends."""
    with ExitStack() as stack:
        yield lambda *args, **options: stack.enter_context(CPURasterizer(*args, **options))


def in_room(seed, n=12):
    """The room and random targets across it, some of which reach through its walls."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(*(ROOM.bounds * 1.3), (n, 3, 3))
    return beside(ROOM, *[triangles(corners) for corners in points])


def targets_of(mesh):
    return np.flatnonzero(mesh.target_mask)


def ambiguous_counts(mesh, camera, pose, row):
    """Samples of a target that may count either way: near its edges, or those of what is before it.

    And those of a surface within the tie tolerance of its depth.
    """
    points = samples.grid_points(camera)
    # With the one target as a face, the reference measures the distance to its edges, too.
    alone = some_as_targets(only(mesh, ~mesh.target_mask | (np.arange(mesh.n_faces) == row)), [0])
    view = samples.at_points(Mesh(alone.vertices, alone.faces), camera, pose, points)
    return int((view.edge_distance <= EDGE).sum() + (view.depth_gap <= 2 * TIE_REL).sum())


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"supersample": 2, "roll": 0.4}], ids=["plain", "rolled"])
def test_counts_of_opaque_faces_are_those_without_targets(open_raster, options):
    mesh = in_room(1)
    raster = open_raster(mesh, SMALL, **options)
    alone = open_raster(ROOM, SMALL, **options)
    counts, expected = raster.count(VIEWS), alone.count(VIEWS)
    opaque = ~mesh.target_mask
    np.testing.assert_array_equal(counts.visible[:, opaque], expected.visible)
    np.testing.assert_array_equal(counts.drawn[:, opaque], expected.drawn)
    np.testing.assert_array_equal(counts.background, expected.background)
    np.testing.assert_array_equal(counts.clipped, expected.clipped)
    assert counts.visible.dtype == expected.visible.dtype
    image, without = raster.render(VIEWS[0]), alone.render(VIEWS[0])
    np.testing.assert_array_equal(image.face, without.face)
    np.testing.assert_array_equal(image.depth, without.depth)


@cache
def reference_counts():
    """Of the targets of `in_room(2)`: pose, face, visible, drawn, samples that count either way.

    Kept, because it takes a hundred times as long as the counts that are compared with it.
    """
    mesh, items = in_room(2), []
    for row, pose in enumerate(VIEWS):
        visible, drawn = samples.count(mesh, SMALL, pose)
        for face in targets_of(mesh):
            slack = ambiguous_counts(mesh, SMALL, pose, face)
            items.append((row, face, visible[face], drawn[face], slack))
    return items


@pytest.mark.slow
def test_counts_of_targets_equal_those_of_the_reference(open_raster):
    mesh = in_room(2)
    counts = open_raster(mesh, SMALL).count(VIEWS)
    for row, face, visible, drawn, slack in reference_counts():
        assert abs(counts.visible[row, face] - visible) <= slack
        assert abs(counts.drawn[row, face] - drawn) <= slack
    assert counts.visible[:, mesh.target_mask].any()


@pytest.mark.matter("opengl")
@pytest.mark.every_day
@pytest.mark.parametrize("camera", [SMALL, PARALLEL], ids=["pinhole", "parallel rays"])
def test_targets_are_counted_on_the_cpu_in_place_of_a_device_and_a_line_says_so(camera, caplog):
    mesh, options = in_room(4), {"supersample": 2, "roll": 0.4}
    with (
        open_rasterizer(mesh, camera, "gl", device=DEVICE, plan="compute", **options) as named,
        CPURasterizer(mesh, camera, **options) as cpu,
    ):
        assert caplog.messages == ["the CPU draws targets in place of OpenGL"]
        assert named.info == cpu.info
        assert_same_counts(named.count(VIEWS), cpu.count(VIEWS))
    with pytest.raises(DeviceError, match="expected a device"):
        open_rasterizer(mesh, camera, "gl", device="egl:99")
    with pytest.raises(MeshError, match="expected a mesh without targets for GLRasterizer, got"):
        GLRasterizer(mesh, camera, device=DEVICE)


def test_counts_without_drawn_are_those_with_it(open_raster):
    rasterizer = open_raster(in_room(5), SMALL)
    alone = rasterizer.count(VIEWS, drawn=False)
    assert alone.drawn is None
    np.testing.assert_array_equal(alone.visible, rasterizer.count(VIEWS).visible)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@examples(20)
def test_drawn_samples_are_those_of_a_face_that_hides(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, poses, scale = scene(rng)
    roll = float(rng.uniform(-2, 2))
    # A face without area keeps the bounding box, and with it the near plane.
    low, high = mesh.bounds
    frame = Mesh([low, high, low], [(0, 1, 2)])
    options = {"supersample": scale, "roll": roll, "threads": 1}
    with (
        CPURasterizer(beside(frame, mesh), camera, **options) as as_targets,
        CPURasterizer(joined(frame, mesh), camera, **options) as as_surface,
    ):
        counts, expected = as_targets.count(poses), as_surface.count(poses)
    np.testing.assert_array_equal(counts.drawn, expected.drawn)
    np.testing.assert_array_equal(counts.visible, counts.drawn)  # nothing is in front
    np.testing.assert_array_equal(counts.clipped, limits(frame, camera, poses)[2])


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@examples(20)
def test_opaque_faces_and_other_targets_keep_their_counts(seed):
    rng = np.random.default_rng(seed)
    mesh, camera, poses, scale = scene(rng)
    is_target = rng.random(mesh.n_faces) < 0.5
    if is_target.all() or not is_target.any():
        return
    mesh = some_as_targets(mesh, is_target)
    stays = ~is_target | (rng.random(mesh.n_faces) < 0.5)
    options = {"supersample": scale, "roll": 0.4, "threads": 1}
    with (
        CPURasterizer(mesh, camera, **options) as whole,
        CPURasterizer(only(mesh, stays), camera, **options) as part,
    ):
        counts, expected = whole.count(poses), part.count(poses)
    np.testing.assert_array_equal(counts.visible[:, stays], expected.visible)
    np.testing.assert_array_equal(counts.drawn[:, stays], expected.drawn)
    np.testing.assert_array_equal(counts.background, expected.background)
    assert (counts.visible <= counts.drawn).all()


WALL, SHEET = square(1.1, 3), square(0.53, 3, (0.1, 0.07))
# At an odd distance and angle, so that the depths of a sheet on a wall are rounded differently.
TURNED = look_at((0.3, -0.2, 0.1), (0.4, 0.3, 3.1))[0]
BEFORE_ALL = {
    "two at the same place": (beside(square(3, 5), square(0.4, 2), square(0.4, 2)), AHEAD),
    "on a wall": (some_as_targets(joined(WALL, SHEET), [False, False, True, True]), TURNED),
    "on a wall, first": (some_as_targets(joined(SHEET, WALL), [True, True, False, False]), TURNED),
    "alone": (some_as_targets(joined(square(1, 3), square(1, 2), square(2, 4)), [True] * 6), AHEAD),
    "around the eye": (beside(square(3, 5), shapes.box((2, 2, 2))), AHEAD),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BEFORE_ALL)
def test_targets_that_no_surface_is_before_count_in_full_and_are_in_no_image(open_raster, name):
    mesh, pose = BEFORE_ALL[name]
    rasterizer = open_raster(mesh, SQUARE)
    counts, image = rasterizer.count([pose]), rasterizer.render(pose)
    np.testing.assert_array_equal(counts.visible, counts.drawn)
    is_in_view = (counts.visible > 0)[0]
    assert is_in_view[~mesh.target_mask].all()
    assert is_in_view.all() or name == "around the eye"
    assert not counts.clipped.any()
    assert set(np.unique(image.face)) - {-1} == set(np.flatnonzero(~mesh.target_mask))
    assert counts.background[0] == (image.face < 0).sum()


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@examples(67, at_night=200)
def test_samples_of_a_triangle_are_those_of_the_twin(seed):
    rng = np.random.default_rng(seed)
    width, height = (int(side) for side in rng.integers(1, rng.choice((40, 120)), 2))
    top, below = 4 * int(rng.integers(0, 8)), int(rng.choice((0, 7)))
    height += -height % 4 if below else 0  # bands end with a row of blocks, or the image
    size = 256 * (max(width, top + height) + 1)
    x, y = rng.integers(-size // 2, size, (2, 3))
    if rng.random() < 0.3:  # corners and edges on samples
        x, y = x // 128 * 128, y // 128 * 128
    first = rng.integers(0, min(5, width), top + height + below)
    last = np.maximum(first, width - rng.integers(0, 9, len(first)).clip(0, width))
    plane = 1.0, *rng.uniform(-0.05, 0.05, 2)
    inverse = rng.choice((2, 1.1, 1, 0.9, 0), (height, width)).astype(np.float32)
    runs = np.stack((first, last)).astype(np.int32)
    arguments = x, y, plane, 0.8, 1.2, runs, top, inverse
    assert count_triangle(*arguments) == twin.count_triangle(*arguments)
