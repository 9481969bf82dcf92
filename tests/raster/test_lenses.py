"""The rasteriser of any lens: each sample shows what a ray meets first, within 1 px of its own."""

import math
from contextlib import ExitStack
from itertools import product

import lens_cameras
import lens_cases
import lens_rooms
import numpy as np
import pytest
from scenes import joined, square
from target_scenes import some_as_targets
from visible_fractions import fractions_of

from rastercov import (
    Camera,
    CameraError,
    Mesh,
    look_at,
    open_observer,
    open_rasterizer,
)
from rastercov.camera.lenses.of_camera import lens_of
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.mesh import shapes
from rastercov.raster import lens as lens_module
from rastercov.raster.cpu import CPURasterizer
from rastercov.raster.gl import WAYS, GLRasterizer
from rastercov.raster.lens import Views
from rastercov.raster.observation import BoundKind
from rastercov.raster.sample_grid import SampleGrid

SCALE = 0.1
EDGE_PX = 0.4
"""Px from an edge within which a pixel may show either side: half a sample of a view, across."""
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


def opened(by, context, mesh, camera, **options):
    """Rasteriser on the CPU, or by a plan of OpenGL."""
    if by == "cpu":
        return open_rasterizer(mesh, camera, "cpu", **options)
    return open_rasterizer(mesh, camera, "gl", device=context, **WAYS[by], **options)


def on_pipeline(counts, number):
    """A number where the graphics pipeline drew, whose positions are float32; else 0."""
    return 0 if counts.info.plan in ("threads", "compute") else number


SAMPLES = [(1, 0.0), (2, 0.0), (1, 0.4), (3, -1.1)]
"""Supersampling and roll."""


def on_the_cpu_and_once_by_each_way(first, second, cases, by_each_way=None):
    """Cases of a law for `open_lens`: all on the CPU, one of them on OpenGL.

    What looks samples up is the same; the images in which it does have tests of their own.
    """
    cases = list(cases)
    rows = [("cpu", *case) for case in cases]
    rows += [(way, *(by_each_way or cases[0])) for way in WAYS]
    return pytest.mark.parametrize(("open_lens", first, second), rows, indirect=["open_lens"])


@pytest.fixture(params=["cpu", *WAYS])
def open_lens(request, device):
    """Open rasterisers of either kind; they are closed when the test ends."""
    with ExitStack() as stack:
        yield lambda mesh, camera, **options: stack.enter_context(
            opened(request.param, device, mesh, camera, **options)
        )


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
        found = t[nearest, np.arange(len(r))]
        distance[start : start + 128] = found
        face[start : start + 128] = np.where(np.isfinite(found), nearest, -1)
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
@on_the_cpu_and_once_by_each_way("scene", "lens", product(SCENES, CAMERAS), ("torus", "brown"))
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
        # The lens is denser than its views near a pole.
        assert len(wrong) <= (0.01 * is_live.sum() if lens == "equirectangular" else 3)
        assert (expected >= 0).mean() > (0.99 if scene == "room" else 0.005)
        same = (shown[is_live] == expected) & (expected >= 0)
        if lens not in ("wide", "equirectangular"):
            distance = distance * directions[is_live, 2]
        np.testing.assert_allclose(depth[is_live][same], distance[same], rtol=2e-6)
        assert np.isinf(depth[shown < 0]).all()


@pytest.mark.slow
@on_the_cpu_and_once_by_each_way("lens", "samples", product(CAMERAS, SAMPLES), ("wide", (1, 0.4)))
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
    off = counts.drawn.sum() - counts.visible.sum()
    assert 0 <= off <= on_pipeline(counts, 1e-4 * grid.n_samples)


@pytest.mark.slow
@on_the_cpu_and_once_by_each_way("lens", "nears", product(["brown", "wide"], [(0.0, 0.9)]))
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
@pytest.mark.parametrize("lens", lens_cameras.CAMERAS)
@pytest.mark.parametrize("scene", ["torus", "room"])
def test_sampled_areas_are_within_their_bound_of_certified_ones(scene, lens):
    (mesh, poses), camera = SCENES[scene], lens_cameras.CAMERAS[lens].resized(0.2)
    with open_observer(mesh, camera, "certified") as exact:
        expected, areas = fractions_of(exact, poses), exact.observe(poses)
    with open_observer(mesh, camera, "sampled:cpu@3") as sampled:
        found, counts = fractions_of(sampled, poses), sampled.observe(poses)
    assert (found.visibility_kind == BoundKind.STATISTICAL).any()
    error = np.abs(found.visibility - expected.visibility)
    assert (error <= found.visibility_bound + expected.visibility_bound).mean() > 0.998
    is_informed = (found.visibility_bound < 0.5) & (areas.drawn_pixels > 1)
    assert is_informed.sum() > 20
    assert error[is_informed].mean() < 0.02
    assert counts.visible_pixels.sum() == pytest.approx(areas.visible_pixels.sum(), rel=2e-3)


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
        rasterizer._views = Views(camera, 2, 0.3, most_rows=9000)
        monkeypatch.setattr(lens_module, "MOST_KEPT", 20_000)
        parts = [rasterizer.count(poses) for _ in range(2)][1]
        assert 1 < len(rasterizer._views._kept) < len(list(rasterizer._views.bands(1)))
        no_drawn = rasterizer.count(poses, drawn=False)
    # Views of a band are as fine as that band of the lens is.
    most = np.maximum(whole.drawn, parts.drawn)
    assert (np.abs(whole.visible - parts.visible) <= 5 + 2 * np.sqrt(most)).all()
    assert abs(whole.visible.sum() - parts.visible.sum()) <= 0.01 * whole.visible.sum()
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


@pytest.mark.parametrize("lens", ["brown", "skew"])
def test_rasterisers_of_pinholes_name_what_draws_a_lens(device, lens):
    mesh, camera = SCENES["room"][0], CAMERAS[lens]
    for kind, options in ((GLRasterizer, {"device": device}), (CPURasterizer, {})):
        line = r"draws pinholes only, got a lens of .*take open_rasterizer, which draws any lens"
        with pytest.raises(CameraError, match=line) as caught:
            kind(mesh, camera, **options)
        assert "\n" not in str(caught.value)
