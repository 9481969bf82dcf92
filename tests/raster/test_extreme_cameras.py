"""Cameras far from any that was ever built: right on all rasterisers, or refused in one line."""

from itertools import product

import numpy as np
import pytest
from image_laws import is_ambiguous, reference_view

from rastercov.base.arguments import LONGEST as LONGEST_LENS
from rastercov.base.arguments import SHORTEST as SHORTEST_LENS
from rastercov.base.errors import CameraError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import shapes
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import GLRasterizer
from rastercov.gl import rasterizer as gl_module

MESH = shapes.torus(16, 8)


def assert_right(rasterizer, camera, pose):
    """The image is the reference's, but for ambiguous samples, and so are the counts."""
    face = rasterizer.render(pose).face
    expected = reference_view(MESH, camera, pose)
    clear = ~is_ambiguous(expected)
    np.testing.assert_array_equal(face[clear], expected.face[clear])
    counts = rasterizer.count(pose)
    owned = np.bincount(face.ravel() + 1, minlength=MESH.n_faces + 1)
    np.testing.assert_array_equal(owned[1:], counts.visible[0])
    assert counts.background[0] == owned[0]


def seen_through(camera, size=64):
    """A pose from which the mesh fills about half of an image about the principal point."""
    distance = max(4.0, 2 * 2.6 * max(camera.fx, camera.fy) / size)
    pose = look_at(np.array((0.6, 0.3, 0.7)) * distance, (0, 0, 0))[0]
    ray = np.array(((camera.width / 2 - camera.cx) / camera.fx,
                    (camera.height / 2 - camera.cy) / camera.fy, 1))  # fmt: skip
    axis = ray / np.linalg.norm(ray)
    across = np.cross(axis, (0, 0, 1))
    sine, cosine = np.linalg.norm(across), axis[2]
    if sine > 0:
        x, y, z = across / sine
        k = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
        pose[:3, :3] = pose[:3, :3] @ (np.eye(3) + sine * k + (1 - cosine) * k @ k)
    return pose


LENSES = {
    "ordinary": {"fx": 80, "fy": 80},
    "short": {"fx": 1e-3, "fy": 1e-3},
    "the shortest": {"fx": SHORTEST_LENS, "fy": SHORTEST_LENS},
    "long": {"fx": 3e4, "fy": 3e4},
    "as long as float32 goes": {"fx": gl_module.MAX_FOCAL_LENGTH, "fy": gl_module.MAX_FOCAL_LENGTH},
    "narrow and wide": {"fx": 6e4, "fy": 2.0},
    "shifted": {"fx": 80, "fy": 80, "cx": 500, "cy": -300},
    "shifted far": {"fx": 2e4, "fy": 2e4, "cx": 6e4, "cy": -1e4},
}
LONG_LENSES = {
    "of a telescope": {"fx": 1e6, "fy": 1e6},
    "longer": {"fx": 1e9, "fy": 1e9},
    "shifted farther": {"fx": 1e6, "fy": 1e6, "cx": -3e6, "cy": 2e6},
    "shifted out of sight": {"fx": 80, "fy": 80, "cx": 1e12},
    "the longest in one direction": {"fx": LONGEST_LENS, "fy": 100},
}


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
def test_any_lens_is_right_on_all_rasterisers(open_raster, lens):
    camera = Camera(width=64, height=48, **LENSES[lens])
    with open_raster(MESH, camera) as rasterizer:
        assert_right(rasterizer, camera, seen_through(camera))


@pytest.mark.slow
@pytest.mark.parametrize("plan", ["threads", "compute", "auto"])
@pytest.mark.parametrize("lens", LONG_LENSES)
def test_a_very_long_lens_is_right_where_corners_are_projected_in_doubles(device, lens, plan):
    camera = Camera(width=64, height=48, **LONG_LENSES[lens])
    pose = seen_through(camera)
    with CPURasterizer(MESH, camera) as cpu:
        expected = cpu.render(pose).face
        if lens != "the longest in one direction":  # whose margins the reference cannot tell
            assert_right(cpu, camera, pose)
    if plan != "threads":
        with GLRasterizer(MESH, camera, device=device, plan=plan) as rasterizer:
            assert rasterizer.info.plan == "compute"
            np.testing.assert_array_equal(rasterizer.render(pose).face, expected)


@pytest.mark.parametrize("lens", LONG_LENSES)
def test_a_lens_too_long_for_float32_is_not_left_to_the_graphics_pipeline(device, lens):
    camera = Camera(width=64, height=48, **LONG_LENSES[lens])
    with GLRasterizer(MESH, camera, device=device, plan="pipeline") as rasterizer:
        assert rasterizer.info.plan == "compute"


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1, 1), (1, 700), (700, 1), (2, 3), (16385, 1), (1, 17000)])
def test_any_size_is_right_on_all_rasterisers(open_raster, size):
    focal = 0.6 * max(size)
    camera = Camera(width=size[0], height=size[1], fx=focal, fy=focal)
    pose = look_at((3, 2, 1), (0.02, 0.01, 0.03))[0]
    with open_raster(MESH, camera) as rasterizer:
        assert_right(rasterizer, camera, pose)


@pytest.mark.parametrize(
    ("names", "values", "line"),
    [
        (
            ("fx", "fy"),
            (1e13, 1e308, 9e-13, 5e-324),
            r"to be from 1e-12 to 1e\+12 px, got [^\n]*unit$",
        ),
        (("cx", "cy"), (1.1e12, -1e13, -1e308), r"to be within 1e\+12 px of the image, got "),
    ],
)
def test_a_lens_beyond_reason_is_refused(names, values, line):
    for name, value in product(names, values):
        with pytest.raises(CameraError, match=f"^expected {name} {line}"):
            Camera(width=64, height=48, **{"fx": 50, "fy": 50, name: value})
