"""The rasteriser of any lens: each sample shows what its own ray meets first."""

import math
from contextlib import ExitStack
from itertools import cycle, product

import lens_cameras
import lens_cases
import lens_rooms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount, examples, nightly
from scenes import joined, square
from target_scenes import some_as_targets
from visible_fractions import fractions_of
from wheels import with_wheel

from rastercov import (
    Camera,
    CameraError,
    Mesh,
    engine,
    look_at,
    open_observer,
    open_rasterizer,
)
from rastercov.base.threads import once_each
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.pose import near_limit
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.mesh import shapes
from rastercov.core.raster import cpu
from rastercov.core.raster import lens as lens_module
from rastercov.core.raster.contract import BoundKind
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.core.raster.lens import SampleViews, views_of
from rastercov.core.raster.sample_grid import SampleGrid
from rastercov.gl import GLRasterizer

SCALE = 0.1
EDGE_PX = 4e-3
"""Px from an edge within which a pixel may show either side: places are rounded to 1/1024 px."""
BIG = {"width": 1280, "height": 1024, "cx": 655.25, "cy": 500.5}
LENSES = {
    "brown": Camera(**BIG, fx=900, fy=880, model="opencv", distortion=lens_cases.BROWN),
    "rational": Camera(**BIG, fx=900, fy=880, model="opencv", distortion=lens_cases.RATIONAL),
    "kannala": Camera(**BIG, fx=700, fy=690, model="opencv_fisheye", distortion=lens_cases.KANNALA),
    "wide": Camera(**BIG, fx=330, fy=330, model="opencv_fisheye", distortion=(0.01, 0, 0, 0)),
    "skew": Camera(**BIG, fx=900, fy=880, skew=30),
    "equirectangular": Camera(
        width=1280, height=640, fx=640 / math.pi, fy=640 / math.pi, model="equirectangular"
    ),
}
CAMERAS = {name: camera.resized(SCALE) for name, camera in LENSES.items()}
FAMILIES = {name: camera.resized(SCALE) for name, camera in lens_cameras.CAMERAS.items()}


def around(mesh, n=5):
    """Poses around a mesh that see all of it."""
    centre, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    return sphere_of_poses(centre, 0.75 * size, n)


INSIDE = look_at([(0.2, 0.1, 1.5)], [(1, 1, 1)])
SCENES = {
    "torus": (shapes.torus(14, 28), around(shapes.torus(14, 28))[1:2]),
    "aeroplane": (shapes.aeroplane(), around(shapes.aeroplane())[1:2]),
    "room": (shapes.room(6), INSIDE),
}


@pytest.fixture
def open_lens():
    """Open rasterisers; they are closed when the test ends."""
    with ExitStack() as stack:
        yield lambda mesh, camera, **options: stack.enter_context(
            open_rasterizer(mesh, camera, "cpu", **options)
        )


EACH_LENS = amount(
    list(zip(lens_cameras.CAMERAS, cycle(["torus", "room"]), strict=False)),
    at_night=list(product(lens_cameras.CAMERAS, ["torus", "room"])),
)
"""By day each lens in one scene, at night in both."""
SAMPLES = [(1, 0.0), (2, 0.0), (1, 0.4), (3, -1.1)]
"""Supersampling and roll."""


def pixels(camera):
    """Pixel centres (H W, 2)."""
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack((u.ravel(), v.ravel()), axis=1)


def rays(camera, points):
    """Unit rays (N, 3) in camera axes, NaN where there is none."""
    return lens_of(camera).unproject(points)


def first_hits(corners, directions):
    """Nearest face of corners (F, 3, 3) on each of some rays (N, 3), -1 for none, and distances."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    height = np.einsum("fk,fk->f", normal, a)
    sides = np.stack((np.cross(b, c), np.cross(c, a), np.cross(a, b)))
    sides *= np.sign(height)[None, :, None]
    face, distance = np.full(len(directions), -1), np.full(len(directions), np.inf)
    for start in range(0, len(directions), 128):
        r = directions[start : start + 128]
        inside = (sides[0] @ r.T >= 0) & (sides[1] @ r.T >= 0) & (sides[2] @ r.T >= 0)
        with np.errstate(all="ignore"):
            t = np.where(inside, height[:, None] / (normal @ r.T), np.inf)
        nearest = t.argmin(axis=0)
        result = t[nearest, np.arange(len(r))]
        distance[start : start + 128] = result
        face[start : start + 128] = np.where(np.isfinite(result), nearest, -1)
    return face, distance


def edge_distance(camera, corners, ray):
    """Distance of a ray from the nearest edge of a face (3, 3), px of the image, to first order."""
    planes = np.cross(corners, np.roll(corners, -1, axis=0))
    pixel = lens_of(camera).jacobian(ray)
    slope = planes @ np.linalg.pinv(pixel)
    return np.min(np.abs(planes @ ray) / np.linalg.norm(slope, axis=1))


def wrong_samples(camera, corners, directions, shown):
    """Samples that show another face than their ray meets, further than `EDGE_PX` from an edge."""
    expected, distance = first_hits(corners, directions)
    wrong = []
    for n in np.flatnonzero(shown != expected):
        named = [f for f in (shown[n], expected[n]) if f >= 0]
        if min(edge_distance(camera, corners[f], directions[n]) for f in named) <= EDGE_PX:
            continue
        if len(named) == 2:
            _, own = first_hits(corners[[shown[n]]], directions[n : n + 1])
            if own[0] <= distance[n] * (1 + 1e-6):
                continue
        wrong.append(n)
    return wrong, expected, distance


def in_camera(mesh, pose):
    """Corners (F, 3, 3) in camera axes."""
    return ((mesh.vertices - pose[:3, 3]) @ pose[:3, :3])[mesh.faces]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "lens"), list(product(SCENES, CAMERAS)))
def test_each_sample_shows_the_face_its_ray_meets(open_lens, scene, lens):
    (mesh, poses), camera = SCENES[scene], CAMERAS[lens]
    directions = rays(camera, pixels(camera))
    is_live = ~np.isnan(directions[:, 0])
    rasterizer = open_lens(mesh, camera)
    for pose in poses:
        image = rasterizer.render(pose)
        shown, depth = image.face.ravel(), image.depth.ravel()
        assert (shown[~is_live] == -1).all()
        corners = in_camera(mesh, pose)
        wrong, expected, distance = wrong_samples(
            camera, corners, directions[is_live], shown[is_live]
        )
        assert len(wrong) <= 3
        assert (expected >= 0).mean() > (0.99 if scene == "room" else 0.005)
        same = (shown[is_live] == expected) & (expected >= 0)
        if lens not in ("wide", "equirectangular"):
            distance = distance * directions[is_live, 2]
        np.testing.assert_allclose(depth[is_live][same], distance[same], rtol=2e-6)
        assert np.isinf(depth[shown < 0]).all()


@pytest.mark.slow
@pytest.mark.parametrize("lens", FAMILIES)
def test_each_family_of_lenses_shows_what_its_rays_meet_from_random_poses(open_lens, lens):
    camera, mesh = FAMILIES[lens], shapes.torus(24, 12)
    directions = rays(camera, pixels(camera))
    rng = np.random.default_rng(len(lens))
    n = amount(1, at_night=2)
    eyes = rng.normal(size=(n, 3)) * (2.0, 2.0, 1.0)
    rasterizer = open_lens(mesh, camera)
    for pose in look_at(eyes, rng.normal(size=(n, 3)) * 0.3):
        shown = rasterizer.render(pose).face.ravel()
        wrong, expected, _ = wrong_samples(camera, in_camera(mesh, pose), directions, shown)
        assert len(wrong) <= 1e-4 * len(directions)
        assert (expected >= 0).mean() > 0.005


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "samples"), list(product(CAMERAS, SAMPLES)))
def test_closed_room_leaves_no_live_sample_without_a_face(open_lens, lens, samples):
    supersample, roll = samples
    corners, camera = lens_rooms.room(5, seed=2), CAMERAS[lens]
    mesh = Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * len(corners)).reshape(-1, 3))
    grid = SampleGrid(camera, supersample, roll)
    counts = open_lens(mesh, camera, supersample=supersample, roll=roll).count(np.eye(4)[None])
    places = grid.positions(0, grid.height)
    column = np.arange(grid.width)
    inside = (column >= grid.runs[0][:, None]) & (column < grid.runs[1][:, None])
    dead = np.isnan(rays(camera, places[inside])[:, 0]).sum()
    assert counts.background[0] == dead
    assert counts.visible.sum() + dead == grid.n_samples
    # One surface a ray: each live sample is drawn once, so no edge is owned twice.
    np.testing.assert_array_equal(counts.drawn, counts.visible)


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "nears"), list(product(["brown", "wide"], [(0.0, 0.9)])))
def test_near_plane_cuts_as_in_the_exact_method(open_lens, lens, nears):
    camera = CAMERAS[lens]
    # A ramp that begins behind the camera, 0.3 m below it.
    ramp = Mesh(
        vertices=[(-1, 0.3, -2), (1, 0.3, -2), (1, 0.4, 4), (-1, 0.4, 4)],
        faces=[(0, 1, 2), (0, 2, 3)],
    )
    for near in nears:
        cut = Camera(**{**camera.to_json(), "near": near})
        with open_observer(ramp, cut, "certified") as exact:
            area = exact.observe(np.eye(4)[None]).drawn_pixels[0]
        counts = open_lens(ramp, cut, supersample=4).count(np.eye(4)[None])
        assert counts.clipped[0] == (near > 0)
        np.testing.assert_allclose(counts.drawn_pixels[0], area, rtol=0.01, atol=2)
        assert area.sum() > 100


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "scene"), EACH_LENS)
def test_sampled_areas_are_within_their_bound_of_certified_ones(scene, lens):
    (mesh, poses), camera = (
        SCENES[scene],
        lens_cameras.CAMERAS[lens].resized(amount(0.09, at_night=0.2)),
    )
    with open_observer(mesh, camera, "certified") as exact:
        expected, areas = fractions_of(exact, poses), exact.observe(poses)
    with open_observer(mesh, camera, "sampled:cpu@3") as sampled:
        fractions, counts = fractions_of(sampled, poses), sampled.observe(poses)
    assert (fractions.visibility_kind == BoundKind.STATISTICAL).any()
    error = np.abs(fractions.visibility - expected.visibility)
    assert (error <= fractions.visibility_bound + expected.visibility_bound).mean() > 0.998
    is_informed = (fractions.visibility_bound < 0.5) & (areas.drawn_pixels > 1)
    assert is_informed.sum() > 20
    assert error[is_informed].mean() < 0.02
    assert counts.visible_pixels.sum() == pytest.approx(areas.visible_pixels.sum(), rel=2e-3)


@pytest.mark.parametrize("lens", ["brown", "skew"])
def test_faces_of_any_size_cover_the_samples_that_their_exact_edges_do(open_lens, lens):
    """As surfaces, in 32 bits of 16-bit products, and as targets, in 64 bits sample by sample."""
    rng = np.random.default_rng(22)
    n, camera = 200, LENSES[lens].resized(0.4)
    sizes = 10 ** rng.uniform(-2.5, 1.5, (n, 1, 1)) * (1, 1, 0.02)
    corners = rng.uniform(-0.5, 0.5, (n, 1, 3)) + sizes * rng.normal(size=(n, 3, 3))
    corners[..., 2] = 1.5 + np.abs(corners[..., 2])
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    beyond = square(0.01, 1000)
    targets = some_as_targets(joined(mesh, beyond), [True] * n + [False] * 2)
    drawn = open_lens(mesh, camera).count(np.eye(4)).drawn[0]
    expected = open_lens(targets, camera).count(np.eye(4)).drawn[0, :n]
    assert (expected > 10_000).sum() > 20 < (expected[expected < 100] > 0).sum()
    np.testing.assert_array_equal(drawn, expected)


def test_targets_hide_nothing_and_are_counted_against_surfaces(open_lens):
    camera, wall = CAMERAS["brown"], square(9, 2)
    plain = joined(square(0.3, 1), wall, square(0.5, 3))
    mesh = some_as_targets(plain, [True, True, False, False, True, True])
    rasterizer = open_lens(mesh, camera)
    counts, image = rasterizer.count(np.eye(4)), rasterizer.render(np.eye(4))
    alone = open_lens(wall, camera).count(np.eye(4))
    np.testing.assert_array_equal(counts.visible[0, 2:4], alone.visible[0])
    np.testing.assert_array_equal(counts.background, alone.background)
    assert set(np.unique(image.face)) - {-1} == {2, 3}
    np.testing.assert_allclose(image.depth[image.face >= 0], 2, rtol=1e-6)
    assert (counts.visible[0, :2] == counts.drawn[0, :2]).all()
    assert counts.drawn.min() > 50
    assert (counts.visible[0, 4:] == 0).all()


@pytest.mark.slow
def test_bands_of_rows_add_up_to_the_whole(monkeypatch):
    (mesh, poses), camera = SCENES["torus"], CAMERAS["wide"]
    with open_rasterizer(mesh, camera, "cpu", supersample=2, roll=0.3) as rasterizer:
        whole = rasterizer.count(poses)
        rasterizer._views = SampleViews(camera, 2, 0.3, most_rows=9000)
        monkeypatch.setattr(lens_module, "MOST_KEPT", 20_000)
        parts = [rasterizer.count(poses) for _ in range(2)][1]
        assert 1 < len(rasterizer._views._kept) < len(list(rasterizer._views.bands(1)))
        no_drawn = rasterizer.count(poses, drawn=False)
    # Places are rounded in the steps of their views, which differ.
    assert np.abs(whole.visible - parts.visible).sum() <= 2e-3 * whole.visible.sum()
    np.testing.assert_array_equal(parts.visible, no_drawn.visible)
    assert (parts.visible.sum(axis=1) + parts.background == rasterizer._views.grid.n_samples).all()
    assert no_drawn.drawn is None


@pytest.mark.slow
def test_pixels_without_a_ray_are_background(open_lens):
    camera = Camera(
        width=200, height=160, fx=110, fy=110, model="opencv", distortion=(-0.35, 0, 0, 0)
    )
    directions = rays(camera, pixels(camera))
    dead = np.isnan(directions[:, 0]).sum()
    assert dead > 100
    assert open_lens(shapes.room(3), camera).count(INSIDE).background[0] == dead


@given(seed=st.integers(0, 2**32 - 1))
@examples(20)
def test_a_face_alone_is_drawn_where_its_own_rays_meet_it(seed):
    """Visible is drawn, however small, thin, near or far beside the image the face is."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-2, 1) + (
        0,
        0,
        10.0 ** rng.uniform(-1, 1),
    )
    corners[2] += (corners[1] - corners[2]) * rng.choice((0, 0, 0.999))
    camera, roll = FAMILIES[rng.choice([*FAMILIES])], float(rng.choice((0, 0.4)))
    mesh = Mesh(vertices=corners, faces=[(0, 1, 2)])
    with open_rasterizer(mesh, camera, "cpu", roll=roll) as rasterizer:
        counts = rasterizer.count(np.eye(4))
        near = near_limit(camera, mesh.bounds, np.eye(4)[None])[0]
    np.testing.assert_array_equal(counts.visible, counts.drawn)
    if (corners[:, 2] < near).any():
        return
    grid = SampleGrid(camera, 1, roll)
    column, places = np.arange(grid.width), grid.positions(0, grid.height)
    inside = (column >= grid.runs[0][:, None]) & (column < grid.runs[1][:, None])
    directions = rays(camera, places[inside])
    directions = directions[~np.isnan(directions[:, 0])]
    result, _ = first_hits(corners[None], directions)
    edges = [edge_distance(camera, corners, ray) for ray in directions[result >= 0]]
    doubtful = np.count_nonzero(np.array(edges) <= EDGE_PX)
    off = counts.drawn[0, 0] - np.count_nonzero(result >= 0)
    assert -doubtful <= off <= 5


@pytest.mark.parametrize("lens", ["brown", "wide", "equirectangular"])
def test_counts_are_those_of_the_picture_bit_for_bit_on_all_levels_and_threads(lens, monkeypatch):
    (mesh, poses), camera = SCENES["torus"], CAMERAS[lens]
    answers = set()
    for level in set(engine.built_modules()) & set(engine.runnable()):
        module = engine.load(f"_{level}")
        monkeypatch.setattr(cpu, "solver_raster", module.solver_raster)
        monkeypatch.setattr(cpu, "_scene_of", once_each(cpu._scene_of.__wrapped__))
        views_of.cache_clear()
        for threads in (1, 3):
            with open_rasterizer(mesh, camera, "cpu", threads=threads) as rasterizer:
                counts = rasterizer.count(np.repeat(poses, 5, axis=0))
                image = rasterizer.render(poses[0])
            shown = np.bincount(image.face[image.face >= 0], minlength=mesh.n_faces)
            assert np.abs(counts.visible - shown).sum() == 0
            assert (counts.visible <= counts.drawn).all()
            parts = image.face, image.depth, counts.visible, counts.drawn, counts.background
            answers.add(b"".join(part.tobytes() for part in parts))
    assert len(answers) == 1


@pytest.mark.parametrize("n_faces", [1970, pytest.param(9856, marks=nightly)])
def test_a_picture_differs_from_rays_of_opencv_and_embree_in_sixty_pixels(n_faces):
    cv2, embree = with_wheel("cv2"), with_wheel("embreex.rtcore_scene")
    mesh = shapes.aeroplane(n_faces)
    camera = Camera(
        width=1280, height=1024, fx=1100, fy=1100, model="opencv", distortion=(-0.24, 0, 0, 0)
    )
    scale = amount(0.5, at_night=1.0)
    camera = camera.resized(scale)
    k = np.array(((camera.fx, 0, camera.cx), (0, camera.fy, camera.cy), (0, 0, 1)))
    criteria = cv2.TERM_CRITERIA_COUNT, 300, 0
    own = pixels(camera)[:, None], k, np.array(camera.distortion)
    if before_5 := getattr(cv2, "undistortPointsIter", None):
        ideal = before_5(*own, np.eye(3), np.eye(3), criteria)
    else:
        ideal = cv2.undistortPoints(*own, criteria=criteria)
    directions = np.column_stack((ideal[:, 0], np.ones(len(ideal))))
    pose = around(mesh)[1]
    scene = embree.EmbreeScene(robust=True)
    around_eye = (mesh.vertices - pose[:3, 3]).astype(np.float32)
    with_wheel("embreex.mesh_construction").TriangleMesh(
        scene, around_eye, mesh.faces.astype(np.int32)
    )
    turned = np.ascontiguousarray(directions @ pose[:3, :3].T, np.float32)
    traced = scene.run(np.zeros_like(turned), turned)
    with open_rasterizer(mesh, camera, "cpu") as rasterizer:
        shown = rasterizer.render(pose).face.ravel()
    assert (traced >= 0).mean() > 0.1
    assert np.count_nonzero(shown != traced) <= 60 * scale


@pytest.mark.parametrize("lens", ["brown", "wide", "skew"])
def test_opengl_draws_a_lens_on_the_cpu_and_says_so(lens, caplog):
    (mesh, poses), camera = SCENES["torus"], CAMERAS[lens]
    with open_rasterizer(mesh, camera, "gl") as one, open_rasterizer(mesh, camera, "cpu") as other:
        (line,) = caplog.messages
        assert line == f"the CPU draws the lens {camera.model} in place of OpenGL"
        assert one.info == other.info
        assert one.info.backend == "cpu"
        np.testing.assert_array_equal(one.count(poses).visible, other.count(poses).visible)


@pytest.mark.parametrize("lens", ["brown", "skew"])
def test_rasterisers_of_pinholes_name_what_draws_a_lens(device, lens):
    mesh, camera = SCENES["room"][0], CAMERAS[lens]
    for kind, options in ((GLRasterizer, {"device": device}), (CPURasterizer, {})):
        line = "expected a pinhole for (GL|CPU)Rasterizer, got a lens of model"
        with pytest.raises(CameraError, match=line) as caught:
            kind(mesh, camera, **options)
        assert "\n" not in str(caught.value)
