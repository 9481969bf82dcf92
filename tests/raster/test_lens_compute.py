"""Lenses by the plan "compute": counts and images are those of the CPU, bit for bit on llvmpipe."""

import dataclasses
from contextlib import ExitStack

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_laws import assert_same, assert_same_counts, everything
from lens_cameras import CAMERAS, SIDE
from nightly import examples, nightly
from processes import TESTS, run_python
from scenes import joined, large_and_small
from target_scenes import some_as_targets

from rastercov.base.errors import DeviceError, ResourceError
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses
from rastercov.camera.viewpoints import look_at, sphere_of_poses
from rastercov.mesh import Mesh, shapes
from rastercov.raster.cpu.lens_rasterizer import LensRasterizer
from rastercov.raster.cpu.lens_samples import tables_of
from rastercov.raster.gl import GLRasterizer, compute, lens_compute, lens_places
from rastercov.raster.gl.context import open_context
from rastercov.raster.gl.resources import Resources
from rastercov.raster.several import Rasterizers

STRONG = Camera(**SIDE, fx=640, fy=640, model="opencv", distortion=(-0.45, 0.25, 0, 0))
FOLDED = Camera(**SIDE, fx=600, fy=600, model="opencv", distortion=(-0.35, 0, 0, 0))
PRISM_AND_TILT = Camera(
    **SIDE,
    fx=700,
    fy=700,
    model="opencv",
    distortion=(0.5, 0.1, 1e-3, -5e-4, 0.01, 0.8, 0.2, 0.02, 1e-3, 2e-4, -1e-3, 1e-4, 0.03, -0.02),
)
LENSES = {
    "strong": STRONG,
    "folded": FOLDED,  # corners without a ray
    "prism and tilt": PRISM_AND_TILT,
    **{name: CAMERAS[name] for name in ("wide fisheye", "division", "double sphere", "skew")},
    "equirectangular": CAMERAS["equirectangular"],
}
LENSES = {name: camera.resized(0.08) for name, camera in LENSES.items()}
GRIDS = [(1, 0.0), (2, 0.0), (1, 0.4), (3, -1.1)]
LARGE_AND_SMALL = large_and_small()
SCENES = {
    "large and small": (LARGE_AND_SMALL[0], LARGE_AND_SMALL[1][::3]),
    "closed": (
        shapes.torus(20, 10),
        look_at([(4, 0, 1), (1, 0, 0.1), (0, 3, 2), (0.9, 0.2, 0)], [(0, 0, 0), (0, 1, 0)] * 2),
    ),
    "room": (shapes.room(4), look_at([(0, 0, 1.5), (2.5, 2, 0.3)], [(1, 1, 1), (-3, 0, 1)])),
}


def assert_as_on_the_cpu(context, mesh, camera, poses, **options):
    with (
        GLRasterizer(mesh, camera, device=context, **options) as found,
        LensRasterizer(mesh, camera, **options) as expected,
    ):
        assert found.info.plan == "compute"
        assert_same(everything(found, poses), everything(expected, poses))


ALL = [(scene, lens) for lens in LENSES for scene in SCENES]
EACH_ONCE = [
    # Quickly, one scene for each lens.
    pytest.param(*pair, marks=() if row % 3 == row // 3 % 3 else pytest.mark.slow)
    for row, pair in enumerate(ALL)
]


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "lens"), EACH_ONCE)
def test_it_draws_what_the_cpu_draws(device, scene, lens):
    mesh, poses = SCENES[scene]
    supersample, roll = GRIDS[ALL.index((scene, lens)) % len(GRIDS)]
    assert_as_on_the_cpu(device, mesh, LENSES[lens], poses, supersample=supersample, roll=roll)


HOSTILE = {name: camera.resized(0.4) for name, camera in LENSES.items()}


@pytest.mark.slow
@examples(12)
@given(seed=st.integers(0, 2**32 - 1), lens=st.sampled_from(list(HOSTILE)))
def test_hostile_meshes_are_drawn_as_by_the_cpu(gl_context, seed, lens):
    """Slivers, faces edge-on, behind, through the near cube and over the border of the image."""
    rng = np.random.default_rng(seed)
    n, size = int(rng.integers(1, 40)), 10.0 ** rng.uniform(-6, 6)
    points = rng.normal(size=(n, 1, 3)) * 10.0 ** rng.uniform(-4, 2, (n, 1, 1))
    points = points + rng.normal(size=(n, 3, 3)) * 10.0 ** rng.uniform(-5, 2, (n, 1, 1))
    is_sliver = rng.random(n) < 0.3
    points[is_sliver, 2] = points[is_sliver, 0] * 1.001 + points[is_sliver, 1] * 1e-3
    is_edge_on = rng.random(n) < 0.2
    points[is_edge_on, 2] = points[is_edge_on, 0] - points[is_edge_on, 1] * rng.uniform(0, 2)
    if rng.random() < 0.3:
        points = np.round(points * 4) / 4  # coincident, aligned, degenerate, through the eye
    mesh = Mesh(vertices=points.reshape(-1, 3) * size, faces=np.arange(3 * n).reshape(n, 3))
    near = float(rng.choice((0, size * 10.0 ** rng.uniform(-3, 1))))
    camera = dataclasses.replace(HOSTILE[lens], near=near)
    here, there = rng.normal(size=(2, 3)) * size * ((rng.choice((0, 0.1, 1, 30)),), (1,))
    poses = look_at((here, there), (there, here))
    options = {"supersample": int(rng.integers(1, 3)), "roll": float(rng.choice((0, 0.3)))}
    assert_as_on_the_cpu(gl_context, mesh, camera, poses, **options)


@pytest.mark.slow
@pytest.mark.parametrize("small", [512, -1])
def test_samples_on_edges_and_corners_belong_to_the_faces_of_the_cpu(device, monkeypatch, small):
    """A sheet whose corners are places of samples, all numbers of which are exact."""
    camera = LENSES["strong"]
    (patch,) = tables_of(camera, 1, 0.0).band(0, 1)
    assert (patch.frame == np.eye(3)).all()
    x, y = (each.reshape(-1, 8, 8) for each in lens_places._in_blocks(patch))
    rng = np.random.default_rng(4)
    # The first three and the middle samples of each block: edges along samples, and across.
    corners = np.stack((x, y, np.ones_like(x)), axis=3)[:, [0, 1, 2, 5]][:, :, [0, 1, 2, 5]]
    corners = corners[np.isfinite(corners).all(axis=(1, 2, 3))]
    corners = corners * 2.0 ** rng.integers(-1, 2, (len(corners), 4, 4, 1))
    number = np.arange(corners[..., 0].size).reshape(-1, 4, 4)
    a, b, c, d = (number[:, i : i + 3, j : j + 3].ravel() for i in (0, 1) for j in (0, 1))
    faces = np.vstack((np.stack((a, b, d), axis=1), np.stack((a, d, c), axis=1)))
    points = corners.reshape(-1, 3)
    # And the same behind the camera, so that the centre of the mesh is 0.
    mesh = Mesh(
        vertices=np.vstack((points, -points)), faces=np.vstack((faces, faces + len(points)))
    )
    assert (mesh.bounds.mean(axis=0) == 0).all()
    monkeypatch.setattr(lens_compute, "SMALL", small)
    with (
        GLRasterizer(mesh, camera, device=device) as found,
        LensRasterizer(mesh, camera) as expected,
    ):
        counts = everything(found, np.eye(4)[None])
        assert_same(counts, everything(expected, np.eye(4)[None]))
    assert counts["visible"].sum() == counts["drawn"].sum()  # none belongs to two
    # A block has 5 x 5 samples on its sheet, without two borders.
    assert counts["visible"].sum() >= 25 * len(corners) * 0.8


@pytest.mark.slow
@pytest.mark.parametrize("small", [512, -1])
def test_faces_as_thin_as_rounding_cover_the_samples_of_the_cpu(device, monkeypatch, small):
    """Faces along the rays of samples, 1e-16 wide, the sign of whose area is that of rounding."""
    camera = LENSES["strong"].resized(1.2)
    (patch,) = tables_of(camera, 1, 0.0).band(0, 1)
    x, y = lens_places._in_blocks(patch)
    rng = np.random.default_rng(6)
    is_live = np.isfinite(x) & (rng.random(x.shape) < 0.5)
    rays = np.stack((x[is_live], y[is_live], np.ones(is_live.sum())), axis=1)[:, None]
    corners = rays * 2.0 ** rng.integers(-2, 3, (len(rays), 3, 1))
    corners[..., :2] += rng.normal(size=(len(rays), 3, 2)) * 2e-16
    points = corners.reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)
    mesh = Mesh(
        vertices=np.vstack((points, -points)), faces=np.vstack((faces, faces + len(points)))
    )
    assert (mesh.bounds.mean(axis=0) == 0).all()
    monkeypatch.setattr(lens_compute, "SMALL", small)
    with (
        GLRasterizer(mesh, camera, device=device) as found,
        LensRasterizer(mesh, camera) as expected,
    ):
        counts = everything(found, np.eye(4)[None])
        assert_same(counts, everything(expected, np.eye(4)[None]))
    assert counts["drawn"].max() == 1
    assert 100 < counts["drawn"].sum() < 0.9 * len(rays)
    rows, columns = (each[is_live] for each in lens_places._samples_of(patch))
    image = counts["face"][0]
    own = image[rows + 4 * patch.first_row, columns + 4 * patch.first_column]
    assert (own == np.arange(len(rays))).sum() == (image >= 0).sum()  # none shows beside its ray


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sizes", "lens"),
    [
        ({"SMALL": -1}, "strong"),  # all by way of the queue
        ({"SMALL": 1 << 30}, "strong"),  # none
        ({"SMALL": -1, "PIECE_BLOCKS": 1}, "strong"),
        ({"PIECE_BLOCKS": 3, "LOOKUPS": 1}, "strong"),
        ({"LOOKUPS": 1 << 20}, "strong"),
        # A lens of many planes, by both ways.
        pytest.param({"SMALL": -1, "PIECE_BLOCKS": 1}, "wide fisheye", marks=pytest.mark.slow),
        pytest.param({"SMALL": 1 << 30, "LOOKUPS": 1}, "wide fisheye", marks=pytest.mark.slow),
    ],
)
def test_how_faces_are_shared_out_changes_nothing(device, monkeypatch, lens, sizes):
    mesh, poses = SCENES["large and small"]
    for name, value in sizes.items():
        assert hasattr(lens_compute, name)
        monkeypatch.setattr(lens_compute, name, value)
    assert_as_on_the_cpu(device, mesh, LENSES[lens], poses)


@pytest.mark.slow
@pytest.mark.parametrize(
    "limits",
    [
        {"max_tile": 24},
        {"max_tile": 1},
        {"max_faces_a_draw": 7},
        {"image_budget": 1},
        {"image_budget": 200_000},
    ],
)
def test_limits_of_the_device_change_nothing(device, monkeypatch, limits):
    mesh, poses = SCENES["room"]
    camera = LENSES["wide fisheye"]
    monkeypatch.setattr(lens_places, "MAX_RESIDENT", 100_000)  # some bands stay, others are resent
    with (
        GLRasterizer(mesh, camera, device=device, roll=0.3, **limits) as found,
        LensRasterizer(mesh, camera, roll=0.3) as expected,
    ):
        n_bands = len(list(found._strategy.tiles(found._scene, found._scene.grid)))
        assert (n_bands > 2) == ("max_tile" in limits)
        for _ in range(2):
            assert_same(everything(found, poses), everything(expected, poses))


@pytest.mark.slow
def test_bands_without_a_ray_are_background(device):
    mesh, poses = SCENES["room"]
    camera = dataclasses.replace(LENSES["strong"], max_angle_deg=15)
    with (
        GLRasterizer(mesh, camera, device=device, max_tile=30) as found,
        LensRasterizer(mesh, camera) as expected,
    ):
        places = found._strategy._places_of(camera, found._scene.grid)
        assert len(places.band(places.tiles()[0]).views) == 0
        assert_same(everything(found, poses), everything(expected, poses))


def test_storage_blocks_that_hold_little_change_nothing_or_are_refused(device, monkeypatch):
    mesh, poses = SCENES["room"]
    camera = LENSES["strong"]
    for n_bytes, refused in ((60_000, False), (8 * 8 * camera.width - 1, True)):
        limits = device.info.limits | {"max_ssbo_bytes": n_bytes}
        monkeypatch.setattr(device, "info", dataclasses.replace(device.info, limits=limits))
        if not refused:
            assert_as_on_the_cpu(device, mesh, camera, poses)
            continue
        few = shapes.box((1, 1, 1))
        with pytest.raises(ResourceError, match=r"eight rows of samples .* lower supersample, or"):
            GLRasterizer(few, camera, device=device)


@pytest.mark.slow
@pytest.mark.parametrize("n_faces", [60, pytest.param(400, marks=nightly)])
def test_a_queue_that_is_too_small_is_filled_again_with_less(device, monkeypatch, n_faces):
    rng = np.random.default_rng(2)
    middle = np.concatenate(
        (rng.normal(size=(n_faces, 1, 2)), np.full((n_faces, 1, 1), 4.0)), axis=2
    )
    points = middle + rng.normal(size=(n_faces, 3, 3)) * (30, 30, 2)
    mesh = Mesh(vertices=points.reshape(-1, 3), faces=np.arange(3 * n_faces).reshape(-1, 3))
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = np.linspace(-1, 1, 4)
    monkeypatch.setattr(compute, "MAX_PIECES", 1)
    monkeypatch.setattr(lens_compute, "PIECE_BLOCKS", 5)
    camera = LENSES["double sphere"]
    with (
        GLRasterizer(mesh, camera, device=device) as found,
        LensRasterizer(mesh, camera) as expected,
    ):
        before = found._strategy._faces_at_once, found._strategy._poses_at_once
        assert_same(everything(found, poses), everything(expected, poses))
        assert (found._strategy._faces_at_once, found._strategy._poses_at_once) < before


def test_the_smallest_queue_holds_the_faces_of_a_narrow_image(device, monkeypatch):
    for module, name, value in ((compute, "MAX_PIECES", 1), (lens_compute, "SMALL", -1)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(lens_compute, "PIECE_BLOCKS", 1)
    camera = dataclasses.replace(LENSES["skew"], width=3, height=600, cx=1.3, cy=290)
    mesh, poses = SCENES["room"]
    assert_as_on_the_cpu(device, mesh, camera, poses[:1])


def test_a_queue_that_is_always_full_is_not_waited_for(device, monkeypatch):
    read = Resources.read_words

    def full(self, buffer, *shape):
        words = read(self, buffer, *shape)
        return np.ones_like(words) if shape == (compute.HEAD_WORDS,) else words

    monkeypatch.setattr(Resources, "read_words", full)
    with pytest.raises(DeviceError, match=r"has no room for the pieces of 64 faces; its answers"):
        GLRasterizer(shapes.box(), LENSES["strong"], device=device)


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["strong", "equirectangular"])
@pytest.mark.parametrize(
    "limits", [pytest.param({}, marks=pytest.mark.slow), {"max_faces_a_draw": 7, "max_tile": 32}]
)
def test_targets_are_counted_as_on_the_cpu(device, lens, limits):
    rng = np.random.default_rng(5)
    room, poses = SCENES["room"]
    points = rng.uniform(*(room.bounds * 1.3), (30, 1, 3)) + rng.normal(size=(30, 3, 3)) * 0.7
    loose = Mesh(vertices=points.reshape(-1, 3), faces=np.arange(90).reshape(-1, 3))
    # Some lie in the walls, where they are at equal depth, and are seen.
    in_wall = Mesh(vertices=room.vertices, faces=room.faces[:20, ::-1])
    plain = joined(room, loose, in_wall)
    mesh = some_as_targets(plain, np.arange(plain.n_faces) >= room.n_faces)
    with (
        GLRasterizer(mesh, LENSES[lens], device=device, supersample=2, **limits) as found,
        LensRasterizer(mesh, LENSES[lens], supersample=2) as expected,
    ):
        counts = everything(found, poses)
        assert_same(counts, everything(expected, poses))
    visible, drawn = (counts[name] for name in ("visible", "drawn"))
    np.testing.assert_array_equal(visible[:, -20:], visible[:, :20])
    assert visible[:, -20:].any()
    hidden = slice(room.n_faces, -20)
    assert 0 < (visible[:, hidden] < drawn[:, hidden]).sum() < 60


@pytest.mark.slow
def test_each_pose_of_a_rig_has_the_counts_of_its_camera(device):
    mesh, _ = SCENES["closed"]
    pinhole = Camera(width=100, height=80, fx=90, fy=95)
    cameras = [LENSES["strong"], LENSES["wide fisheye"], pinhole]
    poses = Poses.of(sphere_of_poses((0, 0, 0), 4, 6), camera=[0, 1, 2, 1, 0, 0])
    with ExitStack() as stack:
        both = [
            Rasterizers(mesh, cameras, backend, supersample=2, roll=0.3, **options)
            for backend, options in (("gl", {"device": device, "plan": "compute"}), ("cpu", {}))
        ]
        for each in both:
            stack.callback(each.close)
        found, expected = (each.count(poses) for each in both)
    for name in ("visible", "drawn", "background", "clipped"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.visible.any(axis=1).all()


@pytest.mark.slow
def test_many_poses_count_as_each_one_alone(device):
    mesh, camera = SCENES["closed"][0], HOSTILE["wide fisheye"]
    rng = np.random.default_rng(3)
    eyes = rng.normal(size=(601, 3)) * rng.uniform(0.5, 4, (601, 1))
    poses = look_at(eyes, rng.normal(size=(601, 3)))
    with LensRasterizer(mesh, camera) as rasterizer:
        expected = rasterizer.count(poses)
    for options in ({}, {"image_budget": 500_000}):
        with GLRasterizer(mesh, camera, device=device, **options) as rasterizer:
            found = rasterizer.count(poses)
        for name in ("visible", "drawn", "background", "clipped"):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.slow
def test_large_images_are_filled_whole(device):
    # llvmpipe lets no invocation loop for more than 65,535 turns, and says nothing. The image has
    # more blocks of 8 x 8 samples.
    camera = dataclasses.replace(CAMERAS["fov"], width=2360, height=1800, fx=1650, fy=1650)
    assert camera.width * camera.height > 64 * 65_535
    rng = np.random.default_rng(2)
    points = np.concatenate((rng.normal(size=(4, 1, 2)), np.full((4, 1, 1), 4.0)), axis=2)
    points = points + rng.normal(size=(4, 3, 3)) * (30, 30, 2)
    mesh = Mesh(vertices=points.reshape(-1, 3), faces=np.arange(12).reshape(-1, 3))
    with (
        GLRasterizer(mesh, camera, device=device) as found,
        LensRasterizer(mesh, camera) as expected,
    ):
        counts, truth = (each.count(np.eye(4)[None]) for each in (found, expected))
    assert_same_counts(counts, truth)
    assert counts.drawn.max() > 0.9 * camera.width * camera.height


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
def test_cells_hold_the_samples_of_the_plane(lens):
    """In each cell of each level: first and last column, first and last row of its samples."""
    tables = tables_of(LENSES[lens], 1, 0.2)
    (whole,) = lens_places.Places(None, tables).tiles()
    patches = tables.band(0, 1)
    _, views, (blocks, cells) = lens_places._arrays(patches, 0)
    n_live = 0
    for patch, view in zip(patches, views, strict=True):
        x, y = lens_places._in_blocks(patch)
        rows, columns = lens_places._samples_of(patch)
        is_live = ~np.isnan(x)
        n_live += is_live.sum()
        its = blocks[view["first_block"] :][: len(x)]
        assert ((its["places"][..., 0] < 1e30) == is_live).all()
        at = its["middle"][:, None] + its["places"].astype(np.float64)
        np.testing.assert_array_equal(at[is_live], np.stack((x, y), axis=2)[is_live])
        away = np.where(is_live[..., None], np.abs(its["places"]), 0)
        assert (away <= np.maximum(its["reach"], 0)[:, None]).all()
        assert ((its["reach"][:, 0] >= 0) == is_live.any(axis=1)).all()
        of_sample = np.add.outer(2 * (np.arange(8) // 4), np.arange(8) // 4).ravel()
        tile = its["tiles"][:, of_sample].astype(np.float64)
        away = np.where(is_live[..., None], np.abs(its["places"] - tile[..., :2]), 0)
        assert (away <= np.maximum(tile[..., 2:], 0)).all()
        (width, height), first = view["cells"], view["first_cell"]
        i = np.clip((x[is_live] - view["low"][0]) * view["cells_a_unit"], 0, width - 1).astype(int)
        j = np.clip((y[is_live] - view["low"][1]) * view["cells_a_unit"], 0, height - 1).astype(int)
        while True:
            level = cells[first : first + width * height].reshape(height, width, 4)
            for value, least in zip(
                (columns, -columns, rows, -rows), np.moveaxis(level, 2, 0), strict=True
            ):
                expected = np.full((height, width), lens_places.EMPTY)
                np.minimum.at(expected, (j, i), value[is_live])
                np.testing.assert_array_equal(least, expected)
            if max(width, height) == 1:
                break
            first += width * height
            width, height, i, j = (width + 1) // 2, (height + 1) // 2, i // 2, j // 2
        is_here = (whole[0] <= view["origin"][0] + columns) & (
            view["origin"][0] + columns < whole[2]
        )
        assert is_here[is_live].all()
    assert n_live > 0.2 * whole[2] * whole[3]


ATOMICS = "GL_NV_shader_atomic_int64"


@pytest.mark.slow
def test_atomics_of_32_and_of_64_bits_find_the_same():
    # Mesa can do the latter and only says so when told to, once a process.
    code = """
import dataclasses
import numpy as np
import test_lens_compute as t
from rastercov.raster.gl.context import open_context

with open_context("surfaceless") as context:
    wide = context.info
    narrow = dataclasses.replace(wide, extensions=frozenset(wide.extensions - {t.ATOMICS}))
    print(wide.has_int64_atomics, narrow.has_int64_atomics)
    for mesh, poses in t.SCENES.values():
        faces = np.concatenate((mesh.faces, mesh.faces[::-1]))
        double = t.Mesh(vertices=mesh.vertices, faces=faces)
        targets = t.some_as_targets(double, np.arange(double.n_faces) % 5 == 0)
        for mesh in (double, targets):
            for context.info in (wide, narrow):
                with t.GLRasterizer(mesh, t.LENSES["strong"], device=context) as rasterizer:
                    assert rasterizer._strategy._n_passes == (2 if context.info is narrow else 1)
                t.assert_as_on_the_cpu(context, mesh, t.LENSES["wide fisheye"], poses[:1])
"""
    override = {"MESA_EXTENSION_OVERRIDE": f"+{ATOMICS}"}
    run = run_python("-c", code, paths=[TESTS / "raster"], **override)
    assert run.stdout == "True False\n"


@pytest.mark.slow
@pytest.mark.hardware
@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("scene", SCENES)
def test_a_graphics_card_sees_through_a_lens_what_the_cpu_sees(scene, lens):
    try:
        context = open_context(require_hardware=True)
    except DeviceError as error:
        pytest.skip(str(error))  # It asks a GPU; the tests above ask the same of Mesa.
    mesh, poses = SCENES[scene]
    with (
        context,
        GLRasterizer(mesh, LENSES[lens], device=context, supersample=2) as found,
        LensRasterizer(mesh, LENSES[lens], supersample=2) as expected,
    ):
        assert found.info.plan == "compute"
        found, expected = everything(found, poses), everything(expected, poses)
    # Coverage has no division, so it is the same to the bit; 1/z may round otherwise.
    np.testing.assert_array_equal(found["drawn"], expected["drawn"])
    different = found["face"] != expected["face"]
    assert different.sum() <= 3
    depth, its_depth = found["depth"][~different], expected["depth"][~different]
    is_seen = np.isfinite(its_depth)
    np.testing.assert_array_equal(np.isfinite(depth), is_seen)
    np.testing.assert_allclose(depth[is_seen], its_depth[is_seen], rtol=2.5e-7)
