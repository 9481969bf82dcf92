"""Rays that a lens surely shows: faces among them are judged without their images."""

from dataclasses import replace

import numpy as np
import pytest
from judged_scenes import compare
from lens_cameras import CAMERAS, camera

import rastercov as rc
from rastercov.core.camera.lenses.of_camera import lens_of

PARALLEL = rc.Camera(
    width=128,
    height=102,
    fx=60,
    fy=60,
    model="telecentric",
    skew=2,
)
OTHERS = {
    "off centre": camera(900, "opencv", -0.2, 0.05, 0, 0, 0, cx=300, cy=900),
    "narrow": camera(90_000, "opencv", 0.1, 0, 0, 0, 0),
    "skewed parallel rays": PARALLEL,
}
CURVED = {name: each for name, each in (CAMERAS | OTHERS).items() if each.is_curved}
WITHOUT = ("equirectangular",)


def rays_at(slope):
    turn = np.random.default_rng(0).uniform(0, 2 * np.pi, np.shape(slope))
    return np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones_like(turn)], axis=-1)


@pytest.mark.parametrize("name", CURVED)
def test_rays_of_the_core_are_in_the_image_and_those_far_beyond_it_are_not(name):
    lens = lens_of(CURVED[name])
    core, size = lens.core, (lens.width, lens.height)
    assert (core == 0) == (name in WITHOUT)
    within = core * np.sqrt(np.random.default_rng(1).uniform(0, 1, 20_000))
    pixels = lens.project(rays_at(within))[within > 0]
    assert ((pixels > 0) & (pixels < size)).all()
    if 0 < core < 7:
        pixels = lens.project(rays_at(np.full(2000, 1.2 * core)))
        assert not ((pixels > 0) & (pixels < size)).all()


@pytest.mark.parametrize("at", [(-50, 500), (700, 1400)])
def test_a_lens_whose_axis_is_beside_the_image_has_no_core(at):
    assert lens_of(camera(900, "opencv", -0.05, 0, 0, 0, 0, cx=at[0], cy=at[1])).core == 0


@pytest.mark.native
@pytest.mark.parametrize("name", CURVED)
def test_faces_within_and_across_the_core_are_judged_as_by_their_images(name):
    rng = np.random.default_rng(2)
    small = CURVED[name].resized(0.06) if name != "skewed parallel rays" else PARALLEL
    small = replace(small, near=0.4)
    around = rc.shapes.box((3, 3, 3))
    mesh = rc.Mesh.joined([rc.shapes.torus(24, 16), around])
    poses = rc.look_at(rng.normal(size=(4, 3)) * 1.5, rng.normal(size=(4, 3)))
    with rc.open_rasterizer(mesh, small, "cpu", roll=0.4, threads=1) as rasterizer:
        assert compare(rasterizer, poses) > 0 or name == "narrow"
        for _ in range(3):
            compare(rasterizer, poses, rng=rng)
