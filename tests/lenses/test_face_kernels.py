"""Field of view of a face through a lens, with its area known and without."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples

from rastercov.camera.projection import rays_of
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.records import lens_of, scene_of, workspace
from rastercov.kernels.cameras import INSIDE
from rastercov.kernels.criteria import densities as worst_densities
from rastercov.kernels.criteria import image_of_face, project
from rastercov.kernels.jit import allocation_free
from rastercov.kernels.lens_faces import curved_areas
from rastercov.mesh import Mesh, shapes

NEAR = 0.05


@allocation_free
def fields_of_view(scene, pose, lens, work, known, out):
    project(scene.vertices, pose, NEAR, lens, work.points)
    for f in range(scene.faces.shape[0]):
        i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
        state, part, area = image_of_face(work.points, i, j, k, NEAR, lens, work, known[f])
        out[f, 0], out[f, 1], out[f, 2] = state, part, area


def faces_along_the_border(camera, rng, n=300):
    """Loose faces around a camera, and their sizes; every third has an edge along a side.

    From that side of the image the lens bends it.
    """
    centres = rng.normal(size=(n, 1, 3))
    centres[::2, :, 2] = abs(centres[::2, :, 2])
    sizes = 10 ** rng.uniform(-3, 0.7, (n, 1, 1))
    corners = centres + sizes * rng.normal(size=(n, 3, 3))
    pixels = rng.uniform(0, 1, (n // 3, 3, 2)) * (camera.width, camera.height)
    size, side = (camera.width, camera.height), rng.integers(0, 2, n // 3)
    inward = 10 ** rng.uniform(-3, 1.5, (n // 3, 2))
    for row, axis in enumerate(side):
        at_end = rng.uniform() < 0.5
        pixels[row, :2, axis] = size[axis] - inward[row] if at_end else inward[row]
    corners[::3] = rays_of(pixels, camera) * rng.uniform(0.5, 4, (n // 3, 1, 1))
    corners[::3][~np.isfinite(corners[::3]).all(axis=(1, 2))] = 0
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    return mesh, sizes


@pytest.mark.slow
@pytest.mark.parametrize("lens", [*CAMERAS])
@examples(4, at_night=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_known_area_changes_no_field_of_view(lens, seed):
    """With it faces are decided by their corners, where no edge can leave the image."""
    camera, rng = CAMERAS[lens], np.random.default_rng(seed)
    mesh, sizes = faces_along_the_border(camera, rng)
    n = mesh.n_faces
    numbers = lens_of(camera)
    scene, work = scene_of(mesh), workspace(mesh.n_vertices, numbers)
    measured, decided = np.empty((2, n, 3))
    fields_of_view(scene, np.eye(4), numbers, work, np.full(n, -1.0), measured)
    known = 2 * measured[:, 2]  # unlike any that is measured
    fields_of_view(scene, np.eye(4), numbers, work, known, decided)
    np.testing.assert_array_equal(decided[:, :2], measured[:, :2])
    is_short = (decided[:, 2] == known) & (known > 0)
    assert (decided[is_short, 0] == INSIDE).all()
    np.testing.assert_array_equal(decided[~is_short], measured[~is_short])
    small = (measured[:, 0] == INSIDE) & (sizes.ravel() < 0.01)
    assert is_short[small].any() or small.sum() < 20


@allocation_free
def areas_by_polygons(scene, pose, lens, work, out):
    project(scene.vertices, pose, NEAR, lens, work.points)
    for f in range(scene.faces.shape[0]):
        i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
        out[f], _ = curved_areas(work.points, i, j, k, NEAR, lens, work)


@pytest.mark.slow
@pytest.mark.parametrize("lens", [*CAMERAS])
@examples(2, at_night=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_an_area_by_edges_is_that_of_the_polygon(lens, seed):
    """A face that stays inside the image is its triangle and the bulges of three edges."""
    mesh, sizes = faces_along_the_border(CAMERAS[lens], np.random.default_rng(seed))
    numbers = lens_of(CAMERAS[lens])
    scene, work = scene_of(mesh), workspace(mesh.n_vertices, numbers)
    found, polygons = np.empty((mesh.n_faces, 3)), np.empty(mesh.n_faces)
    fields_of_view(scene, np.eye(4), numbers, work, np.full(mesh.n_faces, -1.0), found)
    areas_by_polygons(scene, np.eye(4), numbers, work, polygons)
    is_inside = (found[:, 0] == INSIDE) & (polygons > 0)
    error = np.abs(found[:, 2] - polygons)[is_inside]
    assert (error <= 6 * numbers.tolerance + 1e-11 * (1 + polygons[is_inside])).all()
    assert (polygons[is_inside & (sizes.ravel() < 0.1)] > 0).any()


@allocation_free
def densities(scene, pose, lens, work, out):
    project(scene.vertices, pose, NEAR, lens, work.points)
    for f in range(scene.faces.shape[0]):
        i, j, k = scene.faces[f, 0], scene.faces[f, 1], scene.faces[f, 2]
        asked = False, True, False
        out[f] = worst_densities(work.points, i, j, k, (0.0, 0.0, 1.0), lens, *asked)[1]


def test_no_derivative_is_left_from_another_pose():
    """It is found once for each vertex, and kept until the next pose."""
    mesh, numbers = shapes.box(), lens_of(next(iter(CAMERAS.values())))
    scene, kept = scene_of(mesh), workspace(mesh.n_vertices, numbers)
    poses = sphere_of_poses((0, 0, 0), 5.0, 4)
    found, fresh = np.empty((2, len(poses), mesh.n_faces))
    for pose, one, other in zip(poses, found, fresh, strict=True):
        densities(scene, pose, numbers, kept, one)
        densities(scene, pose, numbers, workspace(mesh.n_vertices, numbers), other)
    np.testing.assert_array_equal(found, fresh)
    assert len(np.unique(fresh[fresh > 0])) > 4
