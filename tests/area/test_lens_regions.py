"""Regions through lenses: what they hold, point by point, and the laws that they obey."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import amount, examples
from surface_cases import assert_pointwise, cut_at_random, hostile_scene, room

import rastercov as rc
from rastercov.core.area import regions as area_regions
from rastercov.core.area.stages import CentrePass
from rastercov.reference.regions import covers_points

pytestmark = pytest.mark.native

MESH, PINHOLE, POSES = room()
TASKS = {
    "visible": rc.Task(),
    "oblique": rc.Task(max_incidence_deg=60),
    "per m^2": rc.Task(min_pixels_per_m2=4000),
    "density": rc.Task(min_pixel_density=60),
    "facing": rc.Task(min_facing_density=150),
    "all": rc.Task(max_incidence_deg=70, min_pixels_per_m2=4000, min_pixel_density=55),
}
N_POINTS = amount(700, at_night=5000)
FEW = ("brown", "fisheye", "equirectangular")


def flat(camera):
    """A lens without distortion: a pinhole by another name."""
    return replace(camera, model="metashape", distortion=(0.0,) * 6)


# --- against the definition -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("lens", CAMERAS)
def test_a_point_is_in_a_region_exactly_if_the_image_of_the_lens_shows_it(lens):
    assert_pointwise(MESH, CAMERAS[lens], POSES[:3], TASKS["visible"], N_POINTS)


@pytest.mark.slow
@pytest.mark.parametrize("lens", FEW)
@pytest.mark.parametrize("task", TASKS)
def test_every_criterion_is_that_of_the_lens(lens, task):
    camera = replace(CAMERAS[lens], focus_range=(1.0, 6.0))
    assert_pointwise(MESH, camera, POSES[:1], TASKS[task], N_POINTS)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), lens=st.sampled_from(list(CAMERAS)))
@examples(7)
def test_regions_of_hostile_scenes_hold_their_covered_points(seed, lens):
    mesh, _, pose = hostile_scene(seed)
    density = 10.0 ** np.random.default_rng(seed).uniform(0, 3)
    for task in (rc.Task(max_incidence_deg=65), rc.Task(min_pixels_per_m2=density**2)):
        assert_pointwise(mesh, CAMERAS[lens], pose[None], task, 2000, seed % 1000)


# --- laws -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("task", ["visible", "oblique", "all"])
def test_a_lens_without_distortion_has_the_regions_of_the_pinhole(task):
    pinhole = rc.regions(MESH, PINHOLE, POSES, TASKS[task])
    lens = rc.regions(MESH, flat(PINHOLE), POSES, TASKS[task])
    off = np.abs(pinhole.areas() - lens.areas())
    assert (off <= pinhole.bounds() + lens.bounds() + 1e-12).all()
    if task != "all":  # whose strips of density are left undecided
        assert off.sum() <= 1e-9 * pinhole.area.sum()


@pytest.mark.slow
@pytest.mark.parametrize("lens", FEW)
def test_the_same_surface_in_other_triangles_has_the_same_area(lens):
    other, origin = cut_at_random(MESH, 5, 60)
    one, two = (rc.regions(mesh, CAMERAS[lens], POSES[:2]) for mesh in (MESH, other))
    area, bound = np.zeros((2, 2, MESH.n_faces))
    for row in range(2):
        area[row] = np.bincount(origin, two.areas()[row], MESH.n_faces)
        bound[row] = np.bincount(origin, two.bounds()[row], MESH.n_faces)
    assert (np.abs(area - one.areas()) <= bound + one.bounds() + 1e-9).all()
    assert one.bound.sum() <= 1e-4 * one.area.sum()


def test_bounds_shrink_with_the_tolerance(monkeypatch):
    bounds = []
    for strip in (1e-3, 1e-4, 1e-5):
        monkeypatch.setattr(area_regions, "STRIP_REL", strip)
        regions = rc.regions(MESH, CAMERAS["brown"], POSES[:2], TASKS["density"])
        bounds.append(regions.bound.sum())
    assert bounds[1] < 0.3 * bounds[0]
    assert bounds[2] < 0.3 * bounds[1]


@pytest.mark.slow
def test_pieces_are_ordered_by_face_and_add_up_to_its_area():
    regions = rc.regions(MESH, CAMERAS["wide fisheye"], POSES[:2])
    for row in range(2):
        assert (np.diff(regions.face[regions.pose == row]) >= 0).all()
    area = np.zeros((2, MESH.n_faces))
    for piece in range(len(regions)):
        x, y = regions.xy[regions.starts[piece] : regions.starts[piece + 1]].T
        area[regions.pose[piece], regions.face[piece]] += (
            x @ np.roll(y, -1) - y @ np.roll(x, -1)
        ) / 2
    np.testing.assert_allclose(area, regions.areas(), rtol=0, atol=1e-9)


def test_a_mixed_rig_has_the_regions_of_each_camera():
    cameras = [PINHOLE, CAMERAS["brown"]]
    mixed = rc.regions(MESH, cameras, rc.Poses.of(POSES[:2], camera=[0, 1]))
    for row, camera in enumerate(cameras):
        alone = rc.regions(MESH, camera, POSES[row : row + 1])
        np.testing.assert_array_equal(mixed.areas()[row], alone.areas()[0])


# --- single points --------------------------------------------------------------------------------


@pytest.mark.parametrize("lens", FEW)
@pytest.mark.parametrize("task", ["oblique", "density", "facing"])
def test_a_centre_is_covered_exactly_where_the_definition_says_so(lens, task):
    camera = replace(CAMERAS[lens], focus_range=(0.5, 7.0))
    cells = rc.cells(MESH, 0.7)
    lists = CentrePass(cells, camera, TASKS[task]).find(POSES[:3])
    mask = np.zeros((3, len(cells)), np.bool_)
    for row in range(3):
        mask[row, lists.row(row)] = True
    centres = cells.vertices.reshape(-1, 3, 3).mean(axis=1)
    truth = covers_points(MESH, camera, POSES[:3], TASKS[task], centres, cells.source_face)
    np.testing.assert_array_equal(mask, truth)
