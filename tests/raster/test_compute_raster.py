"""What only the plan "compute" has: lists by tile, two ways to a nearest face, the CPU's bits."""

import dataclasses

import hostile_scenes
import numpy as np
import pytest
import scenes_of_devices
from gl_device import IN_SOFTWARE
from image_laws import assert_same, assert_same_counts, everything
from processes import TESTS, run_python
from scenes import large_and_small
from test_parallel_samples import views_of
from test_raster_laws import SCENES as LAWS

from rastercov.base.errors import DeviceError, ResourceError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import PLANS, GLRasterizer, compute
from rastercov.gl.context import open_context
from rastercov.gl.strategy import Strategy

pytestmark = pytest.mark.matter("opengl")
CAMERA = Camera(width=160, height=120, fx=150, fy=140, cx=81.3, cy=58.2)
EVERY_DAY = pytest.mark.every_day


SCENES = {"large and small": large_and_small} | LAWS


@pytest.fixture(
    params=[
        pytest.param(name, marks=EVERY_DAY if name == "large and small" else ()) for name in SCENES
    ]
)
def scene(request):
    return SCENES[request.param]()


@pytest.fixture
def open_compute(device):
    def open_one(mesh, camera=CAMERA, **options):
        return GLRasterizer(mesh, camera, device=device, plan="compute", **options)

    return open_one


@pytest.mark.slow
@pytest.mark.parametrize(("supersample", "roll"), [(1, 0.0), (2, 0.0), (1, 0.4), (3, -1.1)])
def test_it_fills_what_the_cpu_fills(open_compute, scene, supersample, roll):
    mesh, poses = scene
    options = {"supersample": supersample, "roll": roll}
    with (
        open_compute(mesh, **options) as compute,
        CPURasterizer(mesh, CAMERA, **options) as expected,
    ):
        assert_same(everything(compute, poses), everything(expected, poses))


@pytest.mark.slow
@pytest.mark.parametrize(
    "sizes",
    [
        {"SMALL": -1},  # all by 32 invocations
        {"SMALL": 1 << 30},  # none
        {"MAX_POSES": 1},
        {"MAX_GROUPS": 1},
        {"GROUP_IN_SOFTWARE": 32},
        {"GROUP_IN_SOFTWARE": 256},
    ],
)
def test_how_triangles_are_shared_out_changes_nothing(open_compute, monkeypatch, sizes):
    mesh, poses = large_and_small()
    with open_compute(mesh) as rasterizer:
        expected = everything(rasterizer, poses)
    for name, value in sizes.items():
        assert hasattr(compute, name)
        monkeypatch.setattr(compute, name, value)
    with open_compute(mesh) as rasterizer:
        assert_same(everything(rasterizer, poses), expected)


@pytest.fixture
def many_large():
    """Triangles that all fill the image and reach behind the camera."""
    rng = np.random.default_rng(2)
    centre = np.concatenate((rng.normal(size=(1000, 1, 2)), np.full((1000, 1, 1), 4.0)), axis=2)
    points = centre + rng.normal(size=(1000, 3, 3)) * (30, 30, 2)
    return Mesh(vertices=points.reshape(-1, 3), faces=np.arange(3000).reshape(-1, 3))


@pytest.mark.slow
@pytest.mark.parametrize("n_bytes", [1 << 27, 200_000, 40_000])
def test_lists_have_the_room_they_need_or_the_work_is_divided(open_compute, many_large, n_bytes):
    # The block holds all poses, some, or a part of the image of one.
    camera = Camera(width=640, height=480, fx=600, fy=560)
    mesh = Mesh(vertices=many_large.vertices, faces=many_large.faces[:400])
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.linspace(-1, 1, 6)
    with open_compute(mesh, camera) as result, CPURasterizer(mesh, camera) as expected:
        strategy, turns = result._strategy, []
        draw = strategy._draw
        strategy.block = n_bytes
        strategy._draw = lambda *arguments: turns.append(arguments[1:3]) or draw(*arguments)
        assert_same_counts(result.count(poses), expected.count(poses))
        assert (len(turns) == 1) == (n_bytes == 1 << 27)
        assert any(part[2] < 640 for _, part in turns) == (n_bytes == 40_000)
        assert_same(vars(result.render(poses[3])), vars(expected.render(poses[3])))


def test_triangles_that_fit_in_no_block_are_refused(open_compute, many_large):
    mesh = Mesh(vertices=many_large.vertices, faces=many_large.faces[:400])
    with open_compute(mesh) as rasterizer:
        rasterizer._strategy.block = 64 * 30
        with pytest.raises(ResourceError, match="expected room for the triangles of a tile of 32"):
            rasterizer.count(np.eye(4))


@pytest.mark.slow
def test_large_images_are_filled_whole(open_compute, many_large):
    # llvmpipe lets no invocation loop for more than 65,535 turns, and says nothing.
    camera = Camera(width=2400, height=1800, fx=2000, fy=2000)
    mesh = Mesh(vertices=many_large.vertices, faces=many_large.faces[:40])
    with open_compute(mesh, camera) as compute, CPURasterizer(mesh, camera) as expected:
        counts, truth = compute.count(np.eye(4)), expected.count(np.eye(4))
    assert_same_counts(counts, truth)
    assert counts.drawn.max() > 1_000_000


@pytest.mark.slow
@pytest.mark.parametrize("max_tile", [64, 37])
@pytest.mark.parametrize("roll", [0.0, 0.4])
def test_triangles_over_the_borders_of_tiles_change_not_one_sample(
    open_compute, monkeypatch, max_tile, roll
):
    # Corners are rounded on the canvas, not in the tile, so this holds without exception.
    mesh, poses = large_and_small()
    whole = open_compute(mesh, roll=roll)
    monkeypatch.setattr(Strategy, "max_tile", max_tile)
    with whole, open_compute(mesh, roll=roll) as t:
        assert_same(everything(t, poses), everything(whole, poses))


def placed_elsewhere(bounds):
    bounds[:3] += 1e6


def turned_round(bounds):
    """Cones of normals that all turn away from the poses."""
    bounds[4:7] *= -1


@EVERY_DAY
@pytest.mark.parametrize("change", [placed_elsewhere, turned_round])
def test_clusters_that_are_out_of_view_or_turn_away_are_left_out(open_compute, monkeypatch, change):
    # By bounds that are wrong: with right ones nothing changes, as the laws below say.
    mesh, poses = shapes.sphere(3), sphere_of_poses((0, 0, 0), 4, 3)
    honest = compute.clusters_of

    def changed(mesh):
        *others, bounds = honest(mesh)
        bounds = bounds.copy()
        change(bounds)
        return *others, bounds

    with open_compute(mesh) as rasterizer:
        before = rasterizer.count(poses)
        monkeypatch.setattr(compute, "clusters_of", changed)
        scene = rasterizer._scene
        rasterizer._scene = compute.ComputeScene(
            rasterizer._resources, scene.mesh, scene.camera, scene.grid
        )
        alone, with_drawn = rasterizer.count(poses, drawn=False), rasterizer.count(poses)
    left = alone.visible > 0
    if change is turned_round:  # those whose faces are drawn need to be counted
        assert_same_counts(with_drawn, before)
        assert left.sum() < (before.visible > 0).sum() / 2
    else:
        assert not left.any()
        assert not with_drawn.drawn.any()


@EVERY_DAY
@pytest.mark.slow
def test_hostile_scenes_are_filled_as_by_the_cpu(open_compute):
    rng = np.random.default_rng(0)
    for _ in range(60):
        mesh, camera, poses, supersample = hostile_scenes.scene(rng)
        with (
            open_compute(mesh, camera, supersample=supersample) as rasterizer,
            CPURasterizer(mesh, camera, supersample=supersample) as cpu,
        ):
            assert_same(everything(rasterizer, poses), everything(cpu, poses))


@EVERY_DAY
@pytest.mark.slow
@pytest.mark.parametrize("roll", [0.0, 0.3])
def test_parallel_rays_are_filled_as_by_the_cpu(open_compute, roll):
    rng, mesh = np.random.default_rng(3), large_and_small()[0]
    for window in (1.0, 30.0):
        camera, poses = views_of(mesh, rng, window)
        with (
            open_compute(mesh, camera, roll=roll) as rasterizer,
            CPURasterizer(mesh, camera, roll=roll) as cpu,
        ):
            assert_same(everything(rasterizer, poses), everything(cpu, poses))


@pytest.mark.slow
@pytest.mark.skipif(not IN_SOFTWARE, reason="Mesa is told what to offer")
def test_atomics_of_32_and_of_64_bits_find_the_same():
    # Mesa can do the latter and only says so when told to, once a process.
    code = """
import dataclasses
import numpy as np
import test_compute_raster as t
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl.context import open_context
from rastercov.gl import GLRasterizer

with open_context("surfaceless") as context:
    wide = context.info
    narrow = dataclasses.replace(wide, extensions=frozenset(wide.extensions - {t.ATOMICS}))
    print(wide.has_int64_atomics, narrow.has_int64_atomics)
    for make in t.SCENES.values():
        mesh, poses = make()
        faces = np.concatenate((mesh.faces, mesh.faces[::-1]))
        double = t.Mesh(vertices=mesh.vertices, faces=faces)
        for mesh in (mesh, double):
            found = []
            for context.info in (wide, narrow):
                with GLRasterizer(mesh, t.CAMERA, device=context, plan="compute") as rasterizer:
                    found.append(t.everything(rasterizer, poses))
            with CPURasterizer(mesh, t.CAMERA) as rasterizer:
                t.assert_same(found[0], found[1])
                t.assert_same(found[0], t.everything(rasterizer, poses))
"""
    override = {"MESA_EXTENSION_OVERRIDE": f"+{ATOMICS}"}
    run = run_python("-c", code, paths=[TESTS / "raster"], **override)
    assert run.stdout == "True False\n"


ATOMICS = "GL_NV_shader_atomic_int64"


@EVERY_DAY
@pytest.mark.parametrize("kind", scenes_of_devices.KINDS)
def test_a_device_counts_and_judges_a_scene_of_each_kind_as_the_cpu_does(device, kind):
    found = scenes_of_devices.compare_kind(device, kind, 1, 3)
    assert found["samples"] > 0
    assert found["wrong"] == found["wrong_bits"] == 0
    assert found["pairs"] > 0


@pytest.mark.hardware
@pytest.mark.parametrize("plan", PLANS)
def test_a_graphics_card_sees_what_the_cpu_sees(scene, plan):
    try:
        context = open_context("hardware")
    except DeviceError as error:
        pytest.skip(str(error))
    mesh, poses = scene
    with (
        context,
        GLRasterizer(mesh, CAMERA, device=context, plan=plan) as glrasterizer,
        CPURasterizer(mesh, CAMERA) as expected,
    ):
        glrasterizer, expected = everything(glrasterizer, poses), everything(expected, poses)
    if plan == "compute":
        assert_same(glrasterizer, expected)
    different = glrasterizer["face"] != expected["face"]
    assert different.mean() <= 0.005
    assert (glrasterizer["visible"] <= glrasterizer["drawn"]).all()


@pytest.mark.slow
def test_storage_blocks_that_hold_little_are_used_in_tiles_or_refused(device, monkeypatch):
    mesh, poses = large_and_small()

    def open_with(max_ssbo_bytes):
        limits = info.limits | {"max_ssbo_bytes": max_ssbo_bytes}
        monkeypatch.setattr(device, "info", dataclasses.replace(info, limits=limits))
        return GLRasterizer(mesh, CAMERA, device=device, plan="compute")

    info, needed = device.info, max(24 * mesh.n_vertices, 16 * mesh.n_faces + 16)
    with open_with(info.limits["max_ssbo_bytes"]) as whole, open_with(100_000) as tiled:
        assert tiled._strategy.tile == (160, 78)
        assert_same(everything(tiled, poses), everything(whole, poses))
    line = rf"at most {needed - 1:,} bytes .* got {needed:,} for"
    with pytest.raises(ResourceError, match=line):
        open_with(needed - 1)
