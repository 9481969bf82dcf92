"""Fields of view in ideal planes: each cell is on the side of the image that it says."""

import numpy as np
import pytest
from lens_cameras import CAMERAS
from lens_cases import heights, rays_of_plane

from rastercov import Camera
from rastercov.core.camera.lenses.of_camera import lens_of
from rastercov.core.camera.lenses.planes import planes_in
from rastercov.engine import lens_field as kernels

pytestmark = pytest.mark.native
TOLERANCE = 1e-4


def leaves_at(tree, points):
    """(N,) leaf of each point of a plane."""
    nodes = np.full(len(points), tree.root)
    while (open_ := nodes >= 0).any():
        lines = tree.lines[nodes[open_]]
        values = (lines[:, :2] * points[open_]).sum(axis=1) + lines[:, 2]
        nodes[open_] = tree.children[nodes[open_], (values < 0).astype(int)]
    return nodes


def check_cells(camera, seed, tolerance=TOLERANCE, n=4000):
    """Points of each plane are where their leaf says; returns the undecided share."""
    rng, lens = np.random.default_rng(seed), lens_of(camera)
    undecided, total = 0, 0
    for proved in planes_in(lens.row_within(1e-9, tolerance)):
        plane, tree, pinhole = proved.record, proved.field, proved.camera
        low = -np.array([pinhole.cx / pinhole.fx, pinhole.cy / pinhole.fy])
        size = np.array([pinhole.width / pinhole.fx, pinhole.height / pinhole.fy])
        points = low + size * rng.random((n, 2))
        # Half of them next to the border of the image.
        border = np.concatenate([rng.random((n, 2))]) * (camera.width, camera.height)
        side = rng.integers(4, size=n)
        border[side == 0, 0], border[side == 1, 0] = 0, camera.width
        border[side == 2, 1], border[side == 3, 1] = 0, camera.height
        rays = lens.unproject(border) @ plane.frame
        near = rays[:, :2] / rays[:, 2:] + rng.normal(size=(n, 2)) * 10.0 ** -rng.uniform(2, 7)
        is_there = (rays[:, 2] > 0) & ((near >= low) & (near <= low + size)).all(axis=1)
        points = np.concatenate((points, near[is_there]))
        pixels = lens.project(rays_of_plane(plane, points))
        seen = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)
        seen &= heights(points, plane.region) >= 0
        leaf = leaves_at(tree, points)
        assert (leaf[seen] != kernels.OUTSIDE).all()
        assert (leaf[~seen] != kernels.INSIDE).all()
        undecided, total = undecided + int((leaf[:n] == kernels.UNDECIDED).sum()), total + n
    return undecided / total


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_points_are_on_the_side_of_the_image_that_their_cell_says(name):
    assert check_cells(CAMERAS[name], 0) < 0.01


def test_a_lens_without_distortion_has_four_lines_and_no_band():
    camera = Camera(width=640, height=480, fx=500, fy=500, model="metashape", distortion=(0,) * 6)
    (proved,) = lens_of(camera).proved
    tree = proved.field
    assert not (tree.kinds == kernels.BAND).any()
    scale = 500
    points = np.random.default_rng(1).uniform(-1, 1, (20_000, 2))
    inside = (np.abs(points) <= (320 / scale, 240 / scale)).all(axis=1)
    pinhole = proved.camera
    box = np.abs(points) <= (pinhole.cx / scale, pinhole.cy / scale)
    rows = box.all(axis=1)
    np.testing.assert_array_equal(leaves_at(tree, points[rows]) == kernels.INSIDE, inside[rows])


@pytest.mark.slow
def test_undecided_cells_are_as_narrow_as_the_tolerance():
    lens = lens_of(CAMERAS["brown"])
    items = [planes_in(lens.row_within(1e-9, tolerance))[0] for tolerance in (1e-2, 1e-4, 1e-6)]
    counts = [len(each.field.lines) for each in items]
    assert counts[0] < counts[1] < counts[2]
    assert check_cells(CAMERAS["brown"], 3, tolerance=1e-6) <= 1e-3
