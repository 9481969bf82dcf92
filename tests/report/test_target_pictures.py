"""Targets in pictures: hatched, so that what is behind them shows."""

import numpy as np
import pytest
import trimesh
from exact_cases import AHEAD
from scenes import square
from target_scenes import beside

from rastercov.core.camera.camera import Camera
from rastercov.core.raster import open_rasterizer
from rastercov.reference.methods.report import neighbourhood
from rastercov.reference.models.report import coverage_pixels, difference_picture, look_at_part
from rastercov.report import theme
from rastercov.report.coverage_files import write_coloured_mesh
from rastercov.report.images import hatch_over, targets_in_view
from rastercov.report.panorama import draw_scene

CAMERA = Camera(width=80, height=80, fx=80, fy=80)
WALL = square(2, 4)
SCENE = beside(WALL, square(0.25, 2), square(0.25, 6, (0.3, 0)))


def buffer_of(mesh):
    with open_rasterizer(mesh, CAMERA, "cpu") as rasterizer:
        return rasterizer.render(AHEAD)


def scene_of(mesh):
    return draw_scene(mesh, CAMERA, AHEAD, buffer_of(mesh))


def test_targets_in_view_are_those_before_the_surface():
    targets = targets_in_view(SCENE, CAMERA, AHEAD, buffer_of(SCENE).depth)
    assert set(np.unique(targets)) == {-1, 2, 3}
    assert (targets >= 0).sum() == 20 * 20
    assert targets_in_view(WALL, CAMERA, AHEAD, buffer_of(WALL).depth) is None


@pytest.mark.parametrize("value", [0.0, 0.5])
def test_a_picture_shows_what_is_behind_a_target(value):
    scene = scene_of(SCENE)
    without = coverage_pixels(scene_of(beside(WALL)), np.ones(2)).astype(int)
    pixels = coverage_pixels(scene, np.array([1, 1, *[value] * 4])).astype(int)
    changed = (pixels != without).any(axis=2)
    assert not changed[scene.targets < 0].any()
    assert 0.4 < changed[35:45, 46:49].mean() < 0.75  # away from outlines


def test_coloured_meshes_have_translucent_targets(tmp_path):
    write_coloured_mesh(tmp_path / "mesh.glb", SCENE, np.ones(6))
    parts = trimesh.load_scene(tmp_path / "mesh.glb").geometry
    table = {name: part.visual.material for name, part in parts.items()}
    modes = {name: each.alphaMode for name, each in table.items()}
    assert modes == {"mesh": None, "target 0": "BLEND", "target 1": "BLEND"}
    assert table["mesh"].baseColorFactor is None
    assert {table[f"target {row}"].baseColorFactor[3] for row in (0, 1)} == {102}


def test_a_face_beside_a_target_is_seen_whole_in_its_close_up():
    square_behind = square(2, 4)
    scene = beside(square_behind, square(0.25, 2))
    for mesh in (square_behind, scene):
        around = neighbourhood(mesh, CAMERA, AHEAD, 0)
        assert around.hidden.area == pytest.approx(0, abs=1e-9)
        assert all(shape.area > 0 for shape in around.others)
    assert neighbourhood(scene, CAMERA, AHEAD, 2).seen.area > 0


def test_the_difference_of_models_shows_targets_and_what_is_behind_them():
    look = look_at_part(SCENE, CAMERA, AHEAD)
    bare = look_at_part(beside(WALL), CAMERA, AHEAD)
    graded, bivalent = np.ones(6), np.ones(6)
    bivalent[2:4] = 0.0
    changed = difference_picture(look, bivalent, graded)
    plain = difference_picture(bare, np.ones(2), np.ones(2))
    pixels, expected = (np.asarray(image.convert("RGB"), int) for image in (changed, plain))
    inside = look.targets >= 0
    top = (pixels != expected[: len(pixels)]).any(axis=2)[: inside.shape[0]]
    assert top[inside].mean() > 0.9
    assert top[~inside].mean() < 0.05


def test_hatching_leaves_every_other_stripe_as_it_is():
    pixels = np.full((60, 60, 3), 200, np.uint8)
    targets = np.full((60, 60), -1, np.int32)
    targets[10:50, 10:50] = 0
    hatch_over(pixels, targets, lambda face, at: np.full((len(at), 3), (7, 8, 9), np.uint8), 4)
    inside = pixels[12:48, 12:48].reshape(-1, 3)
    own = (inside == (7, 8, 9)).all(axis=1)
    assert own.mean() == pytest.approx(0.5, abs=0.05)
    assert (inside[~own] == 200).all()
    assert (pixels[10, 10:50] == theme.OUTLINE_3D).all()
    assert (pixels[targets < 0] == 200).all()
