"""Laws of parallel rays: areas within their bounds of whole numbers, and closed forms."""

import numpy as np
import pytest
from exact_views import assert_within_bounds, on_both_paths, soup
from nightly import amount
from target_scenes import beside, sheet_at

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.mesh import shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.reference import polygons, rational

pytestmark = pytest.mark.native

SCENES = {
    "torus": lambda: shapes.torus(20, 12),
    "teapot": lambda: shapes.by_name("teapot"),
    "box": lambda: shapes.box((0.2, 0.3, 0.1)),
    "soup": lambda: soup(np.random.default_rng(3)),
    "pierced": lambda: soup(np.random.default_rng(4), n=30, size=2.0),
}
REFERENCES = polygons, rational
WINDOWS = (1, 8, 64)
"""Sides of the mesh over those of the image."""
AXES = [
    np.array(((x, 0, 0), (0, y, 0), (0, 0, x * y)), np.float64)[:, order]
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    for x in (1, -1)
    for y in (1, -1)
]


def view_of(mesh, rng, window, rotation=None, *, near=0.0, away=1.0):
    """Camera and pose that show a window of a mesh, from `away` diagonals before its middle."""
    low, high = mesh.bounds
    diagonal, side = float(np.linalg.norm(high - low)), int(rng.integers(80, 700))
    at = mesh.vertices[rng.integers(mesh.n_vertices)] if window > 1 else (low + high) / 2
    camera = Camera.orthographic(
        side,
        side + 7,
        px_per_m=side * window / diagonal * rng.uniform(0.8, 1.1),
        near=near * diagonal,
    )
    axis = rng.normal(size=3) if rotation is None else rotation[:, 2]
    axis /= np.linalg.norm(axis)
    pose = look_at(at - axis, at)[0]
    pose[:3, 3] = at - away * diagonal * axis
    if rotation is not None:
        pose[:3, :3] = rotation
    return camera, pose


@pytest.mark.parametrize("name", SCENES)
def test_polygon_booleans_agree_with_whole_numbers(name):
    mesh, rng = SCENES[name](), np.random.default_rng(len(name))
    for near, window in ((0.0, 1), (1.0, 2)):
        camera, pose = view_of(mesh, rng, window, near=near)
        faces = rng.choice(mesh.n_faces, min(40, mesh.n_faces), replace=False)
        for of in ("visible_area", "image_area"):
            one, other = (getattr(each, of)(mesh, camera, pose, faces) for each in REFERENCES)
            assert one == pytest.approx(other, abs=1e-5)


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("name", SCENES)
def test_areas_are_within_their_bounds_of_whole_numbers(name, window):
    mesh, rng = SCENES[name](), np.random.default_rng(len(name) + window)
    for turn in range(amount(2, 20)):
        near = (0.0, 1.0)[turn % 2]  # through the middle of the mesh
        camera, pose = view_of(mesh, rng, window, near=near)
        faces = rng.permutation(mesh.n_faces)[:40]
        views = assert_within_bounds(mesh, camera, pose, faces)
        assert views[0].visible.max() > 0 or window > 1


@pytest.mark.parametrize("name", ["torus", "box", "soup"])
def test_rays_along_the_axes_are_exact(name):
    mesh, rng = SCENES[name](), np.random.default_rng(7)
    for rotation in AXES[:: 1 if name == "box" else 5]:
        camera, pose = view_of(mesh, rng, 1, rotation)
        assert_within_bounds(mesh, camera, pose, rng.permutation(mesh.n_faces)[:40])


def test_a_lens_inside_a_mesh_sees_the_backs_of_faces_beyond_it():
    mesh, rng = shapes.torus(20, 12), np.random.default_rng(2)
    for away in (0.0, 0.1, -0.2):
        camera, pose = view_of(mesh, rng, 1, away=away)
        assert_within_bounds(mesh, camera, pose, rng.permutation(mesh.n_faces)[:60])


@pytest.mark.parametrize("method", ["certified", "exact"])
def test_a_cube_has_the_area_of_the_sum_of_its_normals(method):
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(20, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    camera = Camera.orthographic(400, 400, px_per_m=200)
    cube = shapes.box((1, 1, 1))
    with open_observer(cube, camera, method) as observer:
        seen = observer.observe(look_at(-2 * axes, (0, 0, 0)))
    areas = seen.visible_pixels.sum(axis=1) / 200**2
    assert np.abs(areas - np.abs(axes).sum(axis=1)).max() <= 1e-12
    whole = seen.drawn_pixels.sum(axis=1) / 200**2
    assert np.abs(whole - 2 * areas).max() <= 1e-12  # with the backs


@on_both_paths
def test_moving_along_the_axis_by_a_power_of_two_changes_nothing_beyond_bounds(path):
    mesh = shapes.torus(24, 16)
    camera = Camera.orthographic(300, 300, px_per_m=300 / float(np.ptp(mesh.bounds, axis=0).max()))
    method = "certified" if path.is_certifying else "exact"
    for axis in np.random.default_rng(5).normal(size=(5, 3)):
        poses = np.repeat(look_at(-2 * axis / np.linalg.norm(axis), (0, 0, 0)), 4, axis=0)
        for row, away in enumerate((0, 2, 16, 1024)):
            poses[row, :3, 3] -= away * poses[row, :3, 2]
        with open_observer(mesh, camera, method) as observer:
            seen = observer.observe(poses)
        bound = seen.area_error + seen.area_error[:1] + 1e-12
        assert (np.abs(seen.visible_pixels - seen.visible_pixels[:1]) <= bound).all()
        sure = (seen.kind == BoundKind.CERTIFIED).all(axis=0)
        assert sure.any() == path.is_certifying
        share = seen.visible_pixels / np.maximum(seen.drawn_pixels, 1e-300)
        assert np.isin(np.round(share[:, sure], 9), (0, 1)).all()


def test_a_target_hides_nothing_and_is_hidden():
    mesh = beside(sheet_at((-1, -1), (1, 1), 0), sheet_at((-0.5, -0.5), (0.5, 0.5), -1))
    camera = Camera.orthographic(100, 100, px_per_m=50)
    poses = look_at([(0, 0, 3.0), (0, 0, -3.0)], (0, 0, 0))
    with open_observer(mesh, camera, "certified") as observer:
        seen = observer.observe(poses).visible_pixels
    aim = mesh.target_mask
    assert seen[:, aim].sum(axis=1) == pytest.approx([0, 50**2])
    assert seen[:, ~aim].sum(axis=1) == pytest.approx([100**2, 100**2])
