"""Field of view of a face through a lens, with its area known and without."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples

from rastercov import Task
from rastercov.core.camera.projection import rays_of
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.face_pass import (
    ObservationRecord,
    figures_of,
    lens_of,
    scene_of,
    workspace,
)
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.engine.coverage_figures import judge_poses
from rastercov.engine.coverage_lens_faces import polygon_areas

pytestmark = pytest.mark.native
NEAR = 0.05
AHEAD = np.eye(4)


def figures(mesh, camera, pose, points, names, drawn=None):
    """Figures of the faces in one pose, (F,) each, with an area in the image where it is known."""
    shape = 1, mesh.n_faces
    kind = (
        np.empty((0, 0), np.uint8) if drawn is None else np.full(shape, BoundKind.EXACT, np.uint8)
    )
    areas = np.zeros(shape) if drawn is None else drawn[None]
    seen = ObservationRecord(
        pose[None], np.array([NEAR]), np.zeros(shape), areas, 1.0, kind, np.empty((0, 0)), 1.0
    )
    out = {name: np.empty(shape, np.bool_ if name == "in_view" else np.float64) for name in names}
    rules = Task().rules(camera)
    scope = scene_of(mesh), lens_of(camera), seen, points
    judge_poses(0, 1, scope, rules, figures_of(out))
    return [out[name][0] for name in names]


def fields_of_view(mesh, camera, points, known=None):
    """Whether faces are in view, their part in view, and their area, px^2: (F, 3)."""
    names = "in_view", "in_view_fraction", "projected_area"
    return np.stack(figures(mesh, camera, AHEAD, points, names, known), axis=1)


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
@examples(2, at_night=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_known_area_changes_no_field_of_view(lens, seed):
    """With it faces are decided by their corners, where no edge can leave the image."""
    camera, rng = CAMERAS[lens], np.random.default_rng(seed)
    mesh, sizes = faces_along_the_border(camera, rng)
    points = workspace(mesh.n_vertices, lens_of(camera))
    measured = fields_of_view(mesh, camera, points)
    known = 2 * measured[:, 2]  # unlike any that is measured
    decided = fields_of_view(mesh, camera, points, known)
    np.testing.assert_array_equal(decided[:, :2], measured[:, :2])
    is_short = (decided[:, 2] == known) & (known > 0)
    assert decided[is_short, 0].all()
    np.testing.assert_array_equal(decided[~is_short], measured[~is_short])
    small = (measured[:, 0] == 1) & (sizes.ravel() < 0.01)
    assert is_short[small].any() or small.sum() < 20


@pytest.mark.slow
@pytest.mark.parametrize("lens", [*CAMERAS])
@examples(2, at_night=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_an_area_by_edges_is_that_of_the_polygon(lens, seed):
    """A face that stays inside the image is its triangle and the bulges of three edges."""
    camera = CAMERAS[lens]
    mesh, sizes = faces_along_the_border(camera, np.random.default_rng(seed))
    numbers, scene = lens_of(camera), scene_of(mesh)
    points, polygons = workspace(mesh.n_vertices, numbers), np.empty(mesh.n_faces)
    fields = fields_of_view(mesh, camera, points)
    polygon_areas(scene.vertices, scene.faces, AHEAD, NEAR, numbers, points, polygons)
    is_inside = (fields[:, 0] == 1) & (polygons > 0)
    error = np.abs(fields[:, 2] - polygons)[is_inside]
    assert (error <= 6 * numbers.tolerance + 1e-11 * (1 + polygons[is_inside])).all()
    assert (polygons[is_inside & (sizes.ravel() < 0.1)] > 0).any()


def test_no_derivative_is_left_from_another_pose():
    """It is found once for each vertex, and kept until the next pose."""
    mesh, camera = shapes.box(), next(iter(CAMERAS.values()))
    kept = workspace(mesh.n_vertices, lens_of(camera))
    poses = sphere_of_poses((0, 0, 0), 5.0, 4)
    values, fresh = np.empty((2, len(poses), mesh.n_faces))
    for pose, one, other in zip(poses, values, fresh, strict=True):
        (one[:],) = figures(mesh, camera, pose, kept, ["facing_density"])
        new = workspace(mesh.n_vertices, lens_of(camera))
        (other[:],) = figures(mesh, camera, pose, new, ["facing_density"])
    np.testing.assert_array_equal(values, fresh)
    assert len(np.unique(fresh[fresh > 0])) > 4


@pytest.mark.parametrize("rule", [-1, 0, 1, 12])
def test_a_rule_of_edges_that_is_none_is_refused(rule):
    mesh, lens = shapes.box(), lens_of(next(iter(CAMERAS.values())))
    wrong = lens._replace(parts_of=np.full_like(lens.parts_of, rule))
    scene, points = scene_of(mesh), workspace(mesh.n_vertices, lens)
    with pytest.raises(ValueError, match="parts_of must be a rule"):
        polygon_areas(
            scene.vertices, scene.faces, AHEAD, NEAR, wrong, points, np.empty(mesh.n_faces)
        )
