"""Laws of the rasteriser, against the reference where it has a say, up to ambiguous samples.

Laws of counts, edges, depths and clipping hold under all plans; the others are shown for plan
"pipeline" and the CPU, since `test_image_and_counts_equal_reference` ties all plans together.
"""

from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
import pytest
from exact_cases import AHEAD, triangles
from gl_device import IN_SOFTWARE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from image_laws import (
    EDGE,
    GAP,
    ambiguous,
    assert_same_counts,
    assert_same_image,
    is_ambiguous,
    reference_view,
    shown_by_two,
)
from scenes import joined, soup, square
from solids import tessellated_plane

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import Mesh, shapes
from rastercov.gl import rasterizer as rasterizer_module
from rastercov.gl.strategy import Strategy
from rastercov.reference import samples

CAMERA = Camera(width=160, height=120, fx=150, fy=140, cx=81.3, cy=58.2)
SQUARE = Camera(width=200, height=200, fx=100, fy=100)
SMALL = Camera(width=40, height=30, fx=38, fy=36, cx=19.3, cy=15.2)


def moved(mesh, motion):
    return Mesh(vertices=mesh.vertices @ motion[:3, :3].T + motion[:3, 3], faces=mesh.faces)


def dyadic(mesh):
    """The mesh with coordinates that are whole multiples of 2^-20, so that sums stay exact."""
    return Mesh(vertices=np.round(mesh.vertices * 2**20) / 2**20, faces=mesh.faces)


def around(mesh, n=4):
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    return sphere_of_poses(centre, 1.1 * size, n)


# Small scenes that between them have every property: closed, open, self-crossing, seen from inside.
SCENES = {
    "torus": lambda: (shapes.torus(20, 10), sphere_of_poses((0, 0, 0), 4, 3)),
    "torus from inside": lambda: (
        shapes.torus(20, 10),
        look_at([(1, 0, 0.1), (0.9, 0.2, 0)], [(0, 1, 0), (-1, 1, 0.1)]),
    ),
    "room": lambda: (
        shapes.room(4),
        look_at([(0, 0, 1.5), (2.5, 2, 0.3)], [(1, 1, 1), (-3, 0, 1)]),
    ),
    "teapot": lambda: (shapes.teapot(3), around(shapes.teapot(3), 3)),
    "open plane": lambda: (
        tessellated_plane(seed=3),
        look_at([(0.3, 0.2, 0.8), (0.1, 0.3, -0.7), (0.6, 0, 0.01)], (0, 0, 0)),
    ),
}


@cache
def scene_of(name):
    return SCENES[name]()


@pytest.fixture(params=SCENES)
def scene(request):
    return scene_of(request.param)


# --- samples and faces ----------------------------------------------------------------------------


@pytest.mark.slow
def test_image_and_counts_equal_reference(open_raster, scene):
    mesh, poses = scene
    with open_raster(mesh, CAMERA) as rasterizer:
        counts, images = rasterizer.count(poses), [rasterizer.render(pose) for pose in poses]
    for row, (pose, item) in enumerate(zip(poses, images, strict=True)):
        expected = reference_view(mesh, CAMERA, pose)
        assert_same_image(item.face, expected.face, mesh, CAMERA, pose)
        assert np.array_equal(np.isinf(item.depth), item.face < 0)
        alike = (item.face == expected.face) & (item.face >= 0)
        off = alike & ~np.isclose(item.depth, expected.depth, rtol=1e-5, atol=0)
        if rasterizer.info.plan == "pipeline" and not IN_SOFTWARE:
            off &= False  # a GPU interpolates depth between corners that it has rounded
        # Where a face is seen at a grazing angle, rounding its corners moves its depth.
        assert off.sum() <= 0.002 * alike.sum()
        points = np.argwhere(off)[:, ::-1] + 0.5
        steps = np.array([(x, y) for x in (-EDGE, EDGE) for y in (-EDGE, EDGE)])
        depths = samples.at_points(mesh, CAMERA, pose, points + steps[:, None]).depth
        assert (item.depth[off] >= np.min(depths, axis=0) * (1 - 1e-5)).all()
        assert (item.depth[off] <= np.max(depths, axis=0) * (1 + 1e-5)).all()
        owned = np.bincount(item.face.ravel() + 1, minlength=mesh.n_faces + 1)
        np.testing.assert_array_equal(owned, np.append(counts.background[row], counts.visible[row]))
        # An ambiguous sample may be one for several faces that lie behind each other.
        off = np.abs(counts.drawn[row] - expected.drawn)
        assert off.max() <= 2
        assert off.sum() <= 0.02 * expected.drawn.sum()


@pytest.mark.slow
def test_counts_add_up_and_do_not_depend_on_each_other(open_raster, scene):
    (mesh, poses), supersample = scene, 2
    with open_raster(mesh, CAMERA, supersample=supersample) as rasterizer:
        mixed = rasterizer.count(np.concatenate((poses, poses[::-1])))
        alone, counts = rasterizer.count(poses, drawn=False), rasterizer.count(poses)
    n_samples = CAMERA.width * CAMERA.height * supersample**2
    assert (counts.visible.sum(axis=1) + counts.background == n_samples).all()
    assert (counts.visible <= counts.drawn).all()
    assert counts.visible_pixels.sum() == pytest.approx(counts.visible.sum() / supersample**2)
    assert alone.drawn is None
    np.testing.assert_array_equal(alone.visible, counts.visible)
    for name in ("visible", "drawn", "background", "clipped"):
        once = getattr(counts, name)
        np.testing.assert_array_equal(getattr(mixed, name), np.concatenate((once, once[::-1])))


@shown_by_two
def test_finer_samples_are_those_of_a_larger_image(open_raster):
    mesh, poses = SCENES["teapot"]()
    large = Camera(width=480, height=360, fx=450, fy=420, cx=3 * CAMERA.cx, cy=3 * CAMERA.cy)
    with open_raster(mesh, CAMERA, supersample=3) as fine, open_raster(mesh, large) as whole:
        assert_same_counts(fine.count(poses), whole.count(poses))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "supersample"), [(0, 1), (1, 2), (2, 3)])
def test_shared_edge_samples_belong_to_exactly_one_face(open_raster, seed, supersample):
    mesh = tessellated_plane(30, 20, 4.0, 3.0, seed=seed)
    rng = np.random.default_rng(seed)
    eyes = np.concatenate(([(0, 0, 1)], rng.uniform((-0.1, -0.1, 0.8), (0.1, 0.1, 1.2), (3, 3))))
    poses = look_at(eyes, eyes * (1, 1, 0) * 0.5, up=rng.normal(size=3))
    counts = open_raster(mesh, CAMERA, supersample=supersample).count(poses)
    n_samples = CAMERA.width * CAMERA.height * supersample**2
    np.testing.assert_array_equal(counts.drawn.sum(axis=1), n_samples)
    np.testing.assert_array_equal(counts.visible, counts.drawn)


def grid(cx, cy):
    """Squares of 16 x 16 px whose sides lie on pixel borders, or through pixel centres."""
    camera = Camera(width=128, height=96, fx=64, fy=64, cx=cx, cy=cy)
    pose = look_at((0, 0, 2), (0, 0, 0))
    return tessellated_plane(10, 8, 5.0, 4.0, jitter=0), camera, pose


@pytest.mark.slow
@shown_by_two
@pytest.mark.parametrize("centre", [(64, 48), (64.5, 48.5), (64.25, 48.5)])
def test_edges_through_pixel_centres_share_their_samples_once(open_raster, centre):
    mesh, camera, pose = grid(*centre)
    expected, _ = samples.count(mesh, camera, pose[0])
    counts = open_raster(mesh, camera).count(pose)
    assert counts.drawn.sum() == counts.visible.sum() == camera.width * camera.height
    assert expected.sum() == camera.width * camera.height
    # Inner squares have 256 samples, whichever of their two faces takes the diagonal.
    pairs = counts.drawn.reshape(8, 10, 2).sum(axis=2)
    assert (pairs[2:-2, 2:-2] == 256).all()


# --- samples in rolled rows -----------------------------------------------------------------------

ROLLS = (0.4, -0.3, np.pi / 4, 1.9)


@lru_cache(maxsize=64)
def rolled_reference(mesh, camera, pose, supersample, roll):
    """Samples of a rolled grid, those on the border of the image, and what is in them.

    For the scene, and then for each face alone: clear samples of each face, number of unclear ones.
    """
    pose = np.frombuffer(pose).reshape(4, 4)
    points = samples.grid_points(camera, supersample, roll)
    from_border = np.minimum(points, (camera.width, camera.height) - points).min(axis=1)
    on_border = from_border <= EDGE
    near = max(camera.near, 1e-6 * np.linalg.norm(np.abs(mesh.bounds - pose[:3, 3]).max(axis=0)))
    items = []
    for faces in (np.arange(mesh.n_faces), *np.arange(mesh.n_faces)[:, None]):
        part = Mesh(vertices=mesh.vertices, faces=mesh.faces[faces])
        view = samples.at_points(part, camera, pose, points, near)
        unclear = is_ambiguous(view) | on_border
        clear = np.bincount(view.face[~unclear & (view.face >= 0)], minlength=len(faces))
        items.append((clear, unclear.sum()))
    return len(points), on_border.sum(), items


def assert_rolled_counts(counts, mesh, camera, pose, supersample, roll):
    """Counts are the reference's, up to ambiguous samples and those on the border of the image."""
    scene = mesh, camera, np.asarray(pose, np.float64).tobytes()
    n_points, n_on_border, (whole, *alone) = rolled_reference(*scene, supersample, roll)
    n_inside = counts.visible[0].sum() + counts.background[0]
    assert abs(n_inside - n_points) <= 2 * n_on_border  # as many may be just outside

    def check(result, clear, n_unclear, what):
        more = result - clear
        assert (more >= 0).all(), f"{what} misses {-more.min()} samples of face {more.argmin()}"
        assert (more <= n_unclear + n_on_border).all(), f"{what} adds {more.max()} samples"

    check(counts.visible[0], *whole, "visible")
    for index, expected in enumerate(alone):
        check(counts.drawn[0, [index]], *expected, f"face {index} drawn")


@pytest.mark.slow
@pytest.mark.parametrize("roll", ROLLS)
def test_rolled_samples_are_given_out_exactly_once(open_raster, roll):
    mesh = tessellated_plane(30, 20, 4.0, 3.0, seed=1)
    pose = look_at((0.1, 0, 1), (0, 0, 0))
    with open_raster(mesh, CAMERA, supersample=2, roll=roll) as rasterizer:
        counts = rasterizer.count(pose)
        alone = rasterizer.count(pose, drawn=False)
    assert counts.roll == roll
    n_samples = counts.visible.sum()
    assert counts.background[0] == 0  # the plane fills the image
    assert counts.drawn.sum() == n_samples
    np.testing.assert_array_equal(counts.visible, counts.drawn)
    np.testing.assert_array_equal(alone.visible, counts.visible)
    # As many as the image has room for: the border is some 1100 spacings long.
    assert abs(n_samples - 4 * CAMERA.width * CAMERA.height) <= 40


@pytest.mark.slow
@shown_by_two
def test_rolling_by_quarter_turns_changes_nothing_and_by_less_no_picture(open_raster, scene):
    mesh, poses = scene
    plain, rolled = open_raster(mesh, CAMERA), open_raster(mesh, CAMERA, roll=0.4)
    for quarters in (-1, 2):
        turned = open_raster(mesh, CAMERA, roll=quarters * np.pi / 2)
        assert_same_counts(turned.count(poses), plain.count(poses))
    rolled.count(poses[0])
    image, expected = rolled.render(poses[0]), plain.render(poses[0])
    np.testing.assert_array_equal(image.face, expected.face)
    np.testing.assert_array_equal(image.depth, expected.depth)


COARSE_TORUS = shapes.torus(12, 6)


@pytest.mark.slow
def test_rolled_counts_are_those_of_tiles_together(open_gl, monkeypatch):
    mesh = COARSE_TORUS
    poses = mixed_poses(mesh)[:3]
    monkeypatch.setattr(Strategy, "max_tile", 37)
    with open_gl(mesh, SMALL, roll=0.4) as rasterizer:
        for pose in poses:
            assert_rolled_counts(rasterizer.count(pose), mesh, SMALL, pose, 1, 0.4)


# --- motions --------------------------------------------------------------------------------------


@pytest.mark.slow
@shown_by_two
@pytest.mark.parametrize("seed", range(2))
def test_moving_mesh_and_camera_together_changes_nothing(open_raster, scene, seed):
    mesh, poses = scene
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    motion = np.eye(4)
    motion[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    motion[:3, 3] = rng.normal(scale=10, size=3)
    with open_raster(mesh, CAMERA) as here, open_raster(moved(mesh, motion), CAMERA) as there:
        for pose in poses:
            face, expected = there.render(motion @ pose).face, here.render(pose).face
            assert_same_image(face, expected, mesh, CAMERA, pose)


@pytest.mark.slow
@shown_by_two
@pytest.mark.parametrize(
    ("scale", "offset"),
    [(1.0, (4.0, -8.0, 0.5)), (1.0, (1e7, -2e7, 5e6)), (2.0**-20, 0.0), (2.0**12, 0.0)],
)
def test_exact_translation_and_scaling_change_not_one_sample(open_raster, scene, scale, offset):
    mesh, poses = scene
    mesh, poses = dyadic(mesh), poses.copy()
    poses[:, :3, 3] = np.round(poses[:, :3, 3] * 2**20) / 2**20
    far, motion = poses.copy(), np.diag((scale, scale, scale, 1.0))
    far[:, :3, 3] = scale * poses[:, :3, 3] + offset
    motion[:3, 3] = offset
    with open_raster(mesh, CAMERA) as here, open_raster(moved(mesh, motion), CAMERA) as there:
        assert_same_counts(there.count(far), here.count(poses))
        depth = here.render(poses[0]).depth
        np.testing.assert_array_equal(there.render(far[0]).depth, depth * np.float32(scale))


# --- hiding ---------------------------------------------------------------------------------------


@pytest.mark.slow
@shown_by_two
@pytest.mark.parametrize("name", ["box", "sphere", "icosahedron"])
def test_convex_body_shows_its_front_whole_and_its_back_not_at_all(open_raster, name):
    mesh = shapes.by_name(name)
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), 3.5, 6)
    counts = open_raster(mesh, CAMERA).count(poses)
    for row, eye in enumerate(poses[:, :3, 3]):
        height = np.sum(mesh.normals * (eye - mesh.centroids), axis=1)
        front, back = height > 1e-9, height < -1e-9
        np.testing.assert_array_equal(counts.visible[row, front], counts.drawn[row, front])
        assert (counts.visible[row, back] == 0).all()
        assert counts.drawn[row, back].sum() > 500


def sampling_bound(segments, supersample):
    """Most samples by which a count can miss the area of a region with these sides (N, 2, 2).

    Each side of length L in samples (the larger coordinate difference) adds L/2 + 1.25, and the
    rounding of corners to 1/256 px moves each border by 2/256 px at most.
    """
    steps = np.abs(segments[:, 0] - segments[:, 1])
    ideal = steps.max(axis=1) * supersample / 2 + 1.25
    return ideal.sum() + 2 / 256 * np.hypot(*steps.T).sum() * supersample**2


def sides_of(corners):
    """Sides of polygons (..., N, 2), as segments."""
    return np.stack((corners, np.roll(corners, -1, axis=-2)), axis=-2).reshape(-1, 2, 2)


LEFT = np.array([(-2, -2, 4), (-2, 2, 4), (2.5, 0, 6)])
BAR, QUARTER = (
    np.array([(-3, -1, 5), (3, -0.75, 7), (-3, -0.5, 5)]),
    [(0, 1, 0), (-1, 0, 0), (0, 0, 1)],
)
BARS = [BAR @ np.linalg.matrix_power(QUARTER, k) for k in range(4)]
FRACTIONS = {
    "a square before a square": (joined(square(2, 4), square(0.5, 2)), (3 / 4, 3 / 4, 1, 1), []),
    "a pair through each other": (
        *(triangles(LEFT, LEFT * (-1, 1, 1)), (96 / 121, 96 / 121)),
        [((100, 60), (100, 140))],
    ),
    "four bars in a pinwheel": (triangles(*BARS), (1742750798191 / 1796713050031,) * 4, []),
}
"""Mesh, visible fractions of its faces, and lines in px where faces cross."""


@shown_by_two
@pytest.mark.parametrize("name", FRACTIONS)
def test_visible_fractions_are_the_analytic_ones_within_a_rigorous_bound(open_raster, name):
    mesh, fractions, crossings = FRACTIONS[name]
    image = (mesh.vertices[:, :2] / mesh.vertices[:, 2:] * 100 + 100)[mesh.faces]
    counts = open_raster(mesh, SQUARE, supersample=16).count(AHEAD)
    (ax, ay), (bx, by) = (image[:, 1:] - image[:, :1]).transpose(1, 2, 0)
    n_samples = np.abs(ax * by - ay * bx) / 2 * 16**2
    # All sides and crossings of all faces: what borders a visible part is among them.
    bound = sampling_bound(np.concatenate((sides_of(image), np.reshape(crossings, (-1, 2, 2)))), 16)
    for face, fraction in enumerate(fractions):
        lone = sampling_bound(sides_of(image[face]), 16)
        assert abs(counts.drawn[0, face] - n_samples[face]) <= lone
        assert (
            abs(counts.visible[0, face] - fraction * n_samples[face])
            <= bound
            < 0.1 * n_samples[face]
        )


@shown_by_two
@pytest.mark.parametrize("tilt", [0, 0.3])
def test_surfaces_1e_5_apart_are_told_apart_a_thousand_times_beyond_the_nearest(open_raster, tilt):
    nearest = triangles(((0, 0, 0.02), (0.002, 0, 0.02), (0, 0.002, 0.02)))
    sheet = square(30, 20)
    far = Mesh(vertices=sheet.vertices * (1, 1, 1 + 1e-5), faces=sheet.faces)
    lean = np.array([(1, 0, 0), (0, 1, 0), (tilt, 0, 1)]).T  # depth grows with x
    mesh = joined(nearest, far, sheet)
    mesh = Mesh(vertices=mesh.vertices @ lean, faces=mesh.faces)
    counts = open_raster(mesh, SQUARE).count(AHEAD)
    assert counts.visible[0, 0] > 0
    assert (counts.visible[0, 1:3] == 0).all()
    assert counts.visible[0, 3:].sum() + counts.visible[0, 0] + counts.background[0] == 200 * 200
    assert (counts.visible[0, 3:] > 10000).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_of_coincident_faces_the_lowest_index_owns_every_sample_wherever_they_stand(
    open_raster, seed
):
    # Copies in any order of their corners, of the same vertices and of others.
    rng = np.random.default_rng(seed)
    mesh = soup(rng, 100)
    lone = open_raster(mesh, SMALL).count(AHEAD)
    of = rng.permutation(np.tile(np.arange(100), 3))
    copies = np.take_along_axis(mesh.faces[of], rng.random((300, 3)).argsort(axis=1), axis=1)
    copies[::2] += mesh.n_vertices
    vertices, faces = np.tile(mesh.vertices, (2, 1)), np.concatenate((mesh.faces, copies))
    counts = open_raster(Mesh(vertices=vertices, faces=faces), SMALL).count(AHEAD)
    np.testing.assert_array_equal(counts.visible[:, :100], lone.visible)
    assert not counts.visible[:, 100:].any()
    np.testing.assert_array_equal(counts.drawn, lone.drawn[:, np.append(np.arange(100), of)])


# --- the near plane -------------------------------------------------------------------------------


@shown_by_two
def test_face_through_the_near_plane_is_cut_there(open_raster):
    mesh = triangles(((-0.5, 0.25, 3), (0.5, 0.25, 3), (0, 0.25, -1)))
    camera = Camera(width=400, height=400, fx=100, fy=100, cx=200, cy=100, near=1 / 8)
    counts = open_raster(mesh, camera, supersample=4).count(AHEAD)
    assert counts.clipped[0]
    cut = [(200 - 112.5, 300), (200 + 112.5, 300), (200 + 50 / 3, 325 / 3), (200 - 50 / 3, 325 / 3)]
    assert abs(counts.drawn[0, 0] - 16 * 445625 / 18) <= sampling_bound(sides_of(np.array(cut)), 4)
    np.testing.assert_array_equal(counts.visible, counts.drawn)


@pytest.mark.slow
@pytest.mark.parametrize("near", [0.0, 3.7, 4.9])
def test_near_plane_cuts_as_in_the_reference(open_raster, near):
    mesh, _ = scene_of("torus")
    no_near = Camera(width=80, height=60, fx=75, fy=70)
    camera = replace(no_near, near=near)
    for pose in look_at([(4, 0, 1), (0, 0.2, 0)], [(0, 0, 0), (1, 0, 0)]):
        expected = reference_view(mesh, camera, pose)
        whole = reference_view(mesh, no_near, pose)
        with open_raster(mesh, camera) as rasterizer:
            image = rasterizer.render(pose)
            counts = rasterizer.count(pose)
        assert_same_image(image.face, expected.face, mesh, camera, pose)
        assert (image.depth >= np.float32(near * (1 - 1e-6))).all()
        is_cut = near > whole.depth.min()
        assert counts.clipped[0] == is_cut


@pytest.mark.slow
def test_clipped_says_whether_a_surface_in_view_was_cut(open_raster):
    camera = Camera(width=200, height=200, fx=100, fy=100, near=1.0)
    meshes = {
        "beyond": (square(1, 2), False),
        "wholly nearer": (joined(square(0.1, 0.5), square(1, 2)), True),
        "only that, nearer": (square(0.1, 0.5), True),
        "through": (triangles(((0, 0.1, 0.5), (0, 0.1, 2), (0.1, 0.1, 2))), True),
        "nearer, out of view": (joined(square(0.1, 0.5, (5, 0)), square(1, 2)), False),
        "behind": (square(1, -2), False),
        "behind and before": (joined(square(1, -2), square(1, 2)), False),
        "beside the eye": (triangles(((3, 1, -2), (3, -1, 2), (4, 0, 0))), False),
    }
    for name, (mesh, expected) in meshes.items():
        with open_raster(mesh, camera) as rasterizer:
            assert rasterizer.count(AHEAD).clipped[0] == expected, name


# --- poses, batches, tiles ------------------------------------------------------------------------


def test_no_poses_and_one_pose(open_raster):
    with open_raster(shapes.box(), CAMERA) as rasterizer:
        none = rasterizer.count(np.zeros((0, 4, 4)))
        assert none.visible.shape == none.drawn.shape == (0, 12)
        assert none.background.shape == none.clipped.shape == (0,)
        pose = look_at((3, 2, 1), (0, 0, 0))
        assert_same_counts(rasterizer.count(pose[0]), rasterizer.count(pose))
        assert rasterizer.count(pose).visible.shape == (1, 12)


def mixed_poses(mesh):
    """Some from outside, where back faces may be culled, and some from inside, where not."""
    inside = look_at([(1, 0, 0.1), (0.9, 0.2, 0)], [(0, 1, 0), (-1, 1, 0.1)])
    return np.concatenate((sphere_of_poses((0, 0, 0), 4, 3), inside))[[0, 3, 1, 4, 2]]


@pytest.mark.slow
@pytest.mark.parametrize("images", [1, 2, 3])
def test_poses_a_batch_and_checks_between_change_nothing(open_gl, monkeypatch, images):
    mesh = shapes.torus(20, 10)
    poses = mixed_poses(mesh)
    whole = open_gl(mesh, CAMERA)
    monkeypatch.setattr(Strategy, "image_budget", 8 * CAMERA.width * CAMERA.height * images)
    parts = open_gl(mesh, CAMERA)
    monkeypatch.setattr(rasterizer_module, "SELF_TEST_INTERVAL", 2)
    assert_same_counts(parts.count(poses), whole.count(poses))
    np.testing.assert_array_equal(parts.render(poses[0]).face, whole.render(poses[0]).face)


@pytest.mark.slow
def test_tiles_make_the_whole_image(open_gl, scene, monkeypatch):
    mesh, poses = scene
    whole = open_gl(mesh, CAMERA)
    monkeypatch.setattr(Strategy, "max_tile", 64)
    with whole, open_gl(mesh, CAMERA) as tiled:
        for pose in poses:
            image, expected = tiled.render(pose), whole.render(pose)
            assert_same_image(image.face, expected.face, mesh, CAMERA, pose)
        n_ambiguous = np.array([ambiguous(mesh, CAMERA, pose).sum() for pose in poses])
        counts, expected = tiled.count(poses), whole.count(poses)
    assert (np.abs(counts.visible - expected.visible).sum(axis=1) <= 2 * n_ambiguous).all()
    assert (np.abs(counts.drawn - expected.drawn).max(axis=1) <= 2).all()
    np.testing.assert_array_equal(counts.clipped, expected.clipped)


# --- anything at all ------------------------------------------------------------------------------

IN_DOUBLES = ("threads", "compute")
"""Plans that project in double precision: the CPU's, and compute shaders."""

few = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
COORDINATES = st.floats(-2, 2, width=32)
KINDS = (
    *("any", "needle", "edge-on", "huge", "through"),
    *("behind", "degenerate", "duplicate", "tiny"),
)
TRIANGLES = st.tuples(
    st.sampled_from(KINDS),
    st.lists(COORDINATES, min_size=9, max_size=9),
)


def hostile(drawn):
    """A soup about (0, 0, 4) from drawn kinds and coordinates."""
    soup = []
    for kind, numbers in drawn:
        p = np.array((0, 0, 4)) + np.reshape(numbers, (3, 3))
        if kind == "needle":
            p[2] = (p[0] + p[1]) / 2 + (p[2] - p[1]) * 1e-4
        elif kind == "edge-on":
            p[1], p[2] = p[0] * 1.75, p[0] * 0.5 + (p[2] - p[1]) * 1e-3
        elif kind == "huge":
            p = (p - (0, 0, 4)) * 1e4 + (0, 0, 4)
        elif kind == "through":
            p[0, 2] -= 6
        elif kind == "behind":
            p[:, 2] *= -1
        elif kind == "degenerate":
            p[1] = p[0]
        elif kind == "duplicate" and soup:
            p = soup[len(soup) // 2][[1, 0, 2]]
        elif kind == "tiny":
            p = p[0] + (p - p[0]) * 0.02
        soup.append(p)
    return triangles(*soup)


@pytest.mark.slow
@settings(few, max_examples=25)
@given(st.lists(TRIANGLES, min_size=1, max_size=12))
def test_any_soup_is_seen_as_by_the_reference(open_raster, drawn):
    # Where a face passes the camera centre itself, OpenGL cuts it in float32 at a near limit of a
    # millionth of the scene, and its rim can be a pixel off; what projects in doubles has no such
    # excuse.
    mesh = hostile(drawn)
    with open_raster(mesh, SMALL) as rasterizer:
        in_doubles = rasterizer.info.plan in IN_DOUBLES
    camera = SMALL if in_doubles else replace(SMALL, near=0.05)
    expected = samples.render(mesh, camera, AHEAD)
    with open_raster(mesh, camera) as rasterizer:
        face = rasterizer.render(AHEAD).face
        counts = rasterizer.count(AHEAD)
    clear = (expected.edge_distance > EDGE) & (expected.depth_gap > GAP)
    np.testing.assert_array_equal(face[clear], expected.face[clear])
    np.testing.assert_array_equal(
        np.bincount(face.ravel() + 1, minlength=mesh.n_faces + 1)[1:], counts.visible[0]
    )
    assert (counts.visible <= counts.drawn).all()


@pytest.mark.slow
@settings(few, max_examples=12)
@given(st.lists(TRIANGLES, min_size=1, max_size=8), st.floats(-4, 4), st.integers(1, 2))
def test_any_soup_is_counted_as_by_the_reference_when_rolled(open_raster, drawn, roll, supersample):
    # OpenGL's float32 moves what is seen edge-on for kilometres by a pixel, in any direction but
    # along the axes, so it is spared that.
    camera = replace(SMALL, near=0.05)
    with open_raster(triangles(np.eye(3)), camera) as rasterizer:
        in_doubles = rasterizer.info.plan in IN_DOUBLES
    mesh = hostile(drawn if in_doubles else [("any" if k == "huge" else k, p) for k, p in drawn])
    with open_raster(mesh, camera, supersample=supersample, roll=roll) as rasterizer:
        counts = rasterizer.count(AHEAD)
    assert (counts.visible <= counts.drawn).all()
    assert_rolled_counts(counts, mesh, camera, AHEAD, supersample, roll)
