"""Targets by area: their regions are exact, and those of the surface are as without them."""

import numpy as np
import pytest
from exact_cases import hostile
from exact_views import SEEDS
from hypothesis import assume, given
from nightly import examples
from surface_cases import assert_pointwise, room
from target_scenes import beside, only, sheet_at, some_as_targets

import rastercov as rc
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.union import with_rest
from rastercov.core.camera import Poses
from rastercov.core.mesh.unseeable import unseeable_areas
from rastercov.placement.targets import with_target

TASK = rc.Task(max_incidence_deg=80)


def room_with_sheet():
    """The room, with a sheet at 1.6 m in the middle of it."""
    mesh, camera, poses = room()
    return beside(mesh, sheet_at((0.5, 0.5), (7.5, 4.5), 1.6)), camera, poses


def split(seed):
    case = hostile(seed)
    rng = np.random.default_rng(seed)
    is_target = rng.random(case.mesh.n_faces) < 0.4
    assume(is_target.any() and not is_target.all())
    mesh = some_as_targets(case.mesh, is_target)
    return mesh, is_target, case.camera, np.asarray(case.pose, float).reshape(-1, 4, 4)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(13, at_night=40)
def test_targets_change_no_region_of_the_surface(seed):
    mesh, is_target, camera, poses = split(seed)
    bare = only(mesh, ~is_target)
    regions, expected = (rc.regions(each, camera, poses) for each in (mesh, bare))
    assert regions.areas()[:, ~is_target] == pytest.approx(expected.areas(), rel=1e-9, abs=1e-300)


LAMP = rc.Lamps([rc.Lamp.spot(60, intensity=100)], rc.look_at((0.3, 0.2, 2.5), (0.3, 0.2, 0)))
HEAD = rc.Rig([rc.Camera.from_fov(640, 480, hfov_deg=60)] * 2, rule=rc.All(min_baseline_deg=22))


@pytest.mark.parametrize("size", [20, 2000, 1e6])
@pytest.mark.parametrize(
    ("camera", "task", "lamps"),
    [
        (HEAD.cameras[0], rc.Task(min_illuminance=22), LAMP),
        (HEAD.cameras[0], rc.Task(views=2, min_angle_deg=22), None),
        (HEAD, rc.Task(), None),
    ],
    ids=["illuminance", "angle", "rule"],
)
def test_targets_of_any_size_leave_bounds_as_they_are(camera, task, lamps, size):
    """Their widths were parts of a diagonal that a sky volume makes large: 0.38 +- 0.82 m2."""
    part = rc.shapes.box((1, 1, 1))
    scene = with_target(part, rc.shapes.box((size,) * 3), "sky", two_sided=True)
    poses = rc.look_at([(0, 0.01, 3), (1, 0.01, 3)], (0, 0, 0.5))
    placed = Poses.of(poses, camera=[0, 1] if camera is HEAD else [0, 0])
    more = {} if lamps is None else {"lamps": lamps}
    found = [rc.evaluate(each, camera, placed, task, by="area", **more) for each in (part, scene)]
    one, other = (each.covered for each in found)
    np.testing.assert_allclose(other.area[:, : part.n_faces], one.area, rtol=1e-9)
    np.testing.assert_allclose(other.bound[: part.n_faces], one.bound, rtol=1e-3, atol=1e-14)
    assert one.area[-1].sum() > 0.05


@pytest.mark.parametrize("size", [3, 200, 20_000])
def test_targets_leave_what_bodies_hide(size):
    lower, upper = (
        rc.shapes.box((edge,) * 3, centre=(0, 0, z)) for edge, z in ((1, 0), (0.5, 0.75))
    )
    stack = rc.Mesh.joined([lower, upper])
    scene = with_target(stack, rc.shapes.box((size,) * 3), "sky", two_sided=True)
    hidden = unseeable_areas(stack)
    assert hidden.sum() > 0.2
    np.testing.assert_array_equal(unseeable_areas(scene)[: stack.n_faces], hidden)


@pytest.mark.slow
@given(seed=SEEDS)
@examples(8, at_night=25)
def test_regions_of_hostile_targets_hold_their_covered_points(seed):
    mesh, _, camera, poses = split(seed)
    assert_pointwise(mesh, camera, poses, rc.Task(), 1000, seed)


def test_targets_are_scored_by_area_and_have_a_rest():
    mesh, camera, poses = room_with_sheet()
    areas = AreaNetwork(mesh, TASK)
    areas.add(rc.regions(mesh, camera, poses, TASK))
    sheet = mesh.face_group == len(mesh.groups) - 1
    of_faces = areas.of_faces(sheet)
    assert of_faces["of_m2"] == pytest.approx(28)
    assert 50 < of_faces["percent"] < 100
    parts = with_rest(areas.covered)
    assert set(np.flatnonzero(sheet)) <= set(parts.face[parts.views == 0].tolist())
