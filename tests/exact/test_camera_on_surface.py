"""Cameras mounted on what they look at: on a vertex, an edge, a face, or a digit beside it."""

import numpy as np
import pytest
from exact_cases import AHEAD, box, triangles, window
from exact_views import SEEDS, HalfPlanes, assert_agree, look, on_both_paths
from hypothesis import example, given
from nightly import amount, examples
from scenes import joined, square

import rastercov as rc
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.mesh import Mesh, shapes
from rastercov.reference import rational

CAMERA = rc.Camera(width=640, height=512, fx=400, fy=400)


@pytest.mark.slow
def test_a_camera_that_the_least_number_of_all_divides_from_a_corner():
    # Products of such numbers underflow, and with them the bounds of relative errors.
    solid, other = box((0, 0, 0), (0.5, 0.5, 0.25)), box((1.25, -1, -0.5), (2, 0.5, 0.5))
    mesh, rng = joined(solid, other), np.random.default_rng(0)
    for _ in range(amount(100, at_night=500)):
        eye, target = rng.integers(-3, 4, 3) * 5e-324, rng.uniform(*other.bounds)
        pose = look_at(eye, target, rng.normal(size=3))[0]
        assert_agree(mesh, CAMERA, pose)


@pytest.mark.slow
@given(seed=SEEDS)
@example(seed=757)
@example(seed=1402)
@example(seed=2873)
@example(seed=3805)
@examples(20, at_night=20000)
def test_a_camera_in_the_plane_of_the_first_face_of_a_strip(seed):
    # That face is a sliver, which is clipped, and passes through the last one.
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, 3))
    eye = a + (a - b) * rng.uniform(0.1, 2)
    d = b + rng.normal(size=3) * 0.02
    e = d + rng.normal(size=3) * 0.3
    mesh = Mesh(vertices=np.array((a, b, c, d, e)), faces=[(0, 1, 2), (0, 2, 3), (0, 3, 4)])
    pose = look_at(eye, (a + d) / 2 + rng.normal(size=3) * 0.3, rng.normal(size=3))[0]
    assert_agree(mesh, CAMERA, pose)


@on_both_paths
@pytest.mark.parametrize("height", [0.0, 1e-30, 1e-17, 1e-14, 1e-10, 1e-6])
def test_a_wall_that_all_but_holds_the_camera_leaves_bounds_small(path, height):
    # The bound of a face beyond it was the whole face: 1.0, for 1/z of the wall was not known.
    wall = triangles([(-3, height, -1), (3, height, -1), (0.1, height, 6)])
    mesh = joined(wall, square(2, 4))
    view = look(mesh, CAMERA, AHEAD, path)
    assert view.area_error[1:].max() < 1e-6
    visible = rational.visible_area(mesh, CAMERA, AHEAD)
    area = rational.image_area(mesh, CAMERA, AHEAD)
    off = np.abs(view.visible - visible) + np.abs(view.area - area)
    assert (off <= view.area_error + 1e-12).all()


@pytest.mark.slow
@pytest.mark.parametrize("height", [0.0, 5e-324, 1e-300, 1e-17, 1e-12, 1e-8, 1e-5])
def test_a_camera_on_the_outside_of_a_solid_looks_through_the_face_it_is_on(height):
    # It is outside the bounding box, and nothing was found cut: back faces had been left out, and
    # the inside of the solid, which fills the image, was not seen.
    mesh = box((-1, -1, -1), (1, 1, 0))
    pose = rc.look_at((0.25, 0.125, height), (0.3, 0.2, -1), (0, 1, 0))[0]
    visible = rational.visible_area(mesh, CAMERA, pose)
    assert visible.sum() > 0.99 * CAMERA.width * CAMERA.height
    for method in ("certified", "exact"):
        with rc.open_observer(mesh, CAMERA, method) as observer:
            seen = observer.observe(pose)
        assert (np.abs(seen.visible_pixels[0] - visible) <= seen.area_error[0] + 1e-9).all()
    with rc.open_rasterizer(mesh, CAMERA, "cpu") as rasterizer:
        assert np.abs(rasterizer.count(pose).visible[0] - visible).max() < 2000


# --- faces that rounding decides over -------------------------------------------------------------


def test_a_face_whose_image_rounds_to_nothing_stands_in_the_bounds_of_those_behind_it():
    behind = square(1, 4)
    alone = look(behind, window(), AHEAD, HalfPlanes)
    #   A blade along a ray of sight: its image has no width, to rounding.
    blade = triangles([(0.1, -0.2, 1), (0.1 * 1.5, 0.1, 1.5), (0.2, 0.3, 2)])
    view = look(joined(behind, blade), window(), AHEAD, HalfPlanes)
    assert view.area[2] < 1e-12
    assert (view.area_error[:2] > alone.area_error[:2]).all()
    assert view.area_error[2] > 0
    assert (view.area_error < 1e-9).all()


@on_both_paths
@pytest.mark.parametrize("name", ["aeroplane", "torus", "sphere"])
def test_culling_of_a_closed_mesh_changes_no_figure(path, name):
    mesh = shapes.by_name(name)
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    for pose in rc.sphere_of_poses(mesh.bounds.mean(axis=0), 1.1 * size, 4):
        whole, culled = (look(mesh, CAMERA, pose, path, front_only=cull) for cull in (False, True))
        assert np.array_equal(whole.area, culled.area)
        assert (culled.area_error[(culled.state == 0) & (culled.area > 0)] > 0).all()
        # Of a back face next to the outline rounding may leave a trace.
        assert np.abs(culled.visible - whole.visible).max() <= 1e-9
        sure = whole.is_certified & culled.is_certified
        assert np.array_equal(culled.visible[sure], whole.visible[sure])
