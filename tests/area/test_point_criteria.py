"""Smooth criteria: values by their definitions, slopes and doubts, cut regions by points."""

from dataclasses import replace

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import amount, examples
from surface_cases import PANORAMA, assert_pointwise, hostile_scene, in_regions, room, whole

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area import cut
from rastercov.core.area.cut import values_of
from rastercov.core.area.polygons import frames_of, to_world
from rastercov.reference.regions import points_on

pytestmark = pytest.mark.native


def by_definition(criterion, points, normals, sees=None):
    """(N,) values g of a criterion of one row, from its definition; `sees` (N, n) of devices."""
    if isinstance(criterion, rc.RayAngle):
        rays = np.asarray(criterion.eyes)[:, None] - points
        rays /= np.linalg.norm(rays, axis=2, keepdims=True)
        angle = np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1), -1, 1))
        off = np.cos(np.radians(criterion.degrees)) - np.cos(angle)
        return off if criterion.is_least else -off
    if isinstance(criterion, rc.BeamDensity):
        away = points - criterion.centres
        d, axis = np.linalg.norm(away, axis=1), np.asarray(criterion.axes)
        rho = np.linalg.norm(away - (away @ axis)[:, None] * axis, axis=1)
        height = np.abs((away * normals).sum(axis=1))
        return height / (d**2 * rho) / np.radians(criterion.step_deg) ** 2 - criterion.limit
    return DEFINED[type(criterion)](criterion, points, normals, sees)


DEFINED, MADE = {}, {}
"""Values by definition of criteria of features by their type; and random ones by their kind."""


def random_criterion(kind, rng, size=1.0, centre=(0, 0, 0)):
    """A criterion of random devices around a place."""
    at = centre + size * rng.normal(size=(3, 3)) * 10 ** rng.uniform(-1, 0.5)
    axes = rng.normal(size=(3, 3))
    if kind == "angle":
        return rc.RayAngle(at[:2], rng.uniform(0, 180), is_least=bool(rng.integers(2)))
    if kind == "beams":
        return rc.BeamDensity(at[0], axes[0], 0.5, 10 ** rng.uniform(2, 5) / size**2)
    return MADE[kind](rng, at, axes, size)


KINDS = ("angle", "beams")


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_and_doubts_hold_on_random_pieces(kind):
    assert_slopes(kind)


def assert_slopes(kind, *, is_one=True):
    """Slopes and doubts; and values by the definition, where the criterion is one function."""
    rng, n_directions, tight = np.random.default_rng(1), 40, []
    for _ in range(amount(70, at_night=200)):
        mesh = rc.Mesh(rng.normal(size=(150, 3)), np.arange(150).reshape(50, 3))
        criterion = random_criterion(kind, rng)
        face = np.arange(50)
        corners = frames_of(mesh).corners
        weights = rng.dirichlet((1, 1, 1), 50)
        xy = np.einsum("fc,fci->fi", weights, corners)
        r = 10 ** rng.uniform(-5, 0, 50)
        angle = rng.uniform(0, 2 * np.pi, (n_directions, 50))
        step = np.stack([np.cos(angle), np.sin(angle)], axis=2)
        step[1::2] *= np.sqrt(rng.uniform(size=(n_directions // 2, 50, 1)))
        off = r[:, None] * step
        for own in criterion._cuts(1):
            here = values_of(mesh, own, face, xy, radius=r)
            there = np.array([values_of(mesh, own, face, xy + each)[:, 0] for each in off])
            sure = here[:, 3] == 0  # the same sign within the radius
            assert (np.sign(there[:, sure]) == np.sign(here[sure, 0])).all()
            known = np.isfinite(here[:, 3]) & ~sure
            linear = here[:, 0] + np.einsum("nki,ki->nk", off, here[:, 1:3])
            error = np.abs(there - linear)[:, known]
            rounding = 1e-12 * (1 + np.abs(there[:, known]) + np.abs(linear[:, known]))
            assert (error <= here[known, 3] + rounding).all()
            tight.append((error / np.maximum(here[known, 3], 10 * rounding)).max(initial=0.0))
        if is_one:
            points = to_world(mesh, face, xy)
            truth = by_definition(criterion, points, mesh.normals)
            scale = 1 + np.abs(truth)
            assert (np.abs(values_of(mesh, criterion._cuts(1)[0], face, xy)[:, 0] - truth)
                    <= 1e-9 * scale).all()  # fmt: skip
    assert max(tight) > 0.2


def assert_where(criterion, regions, n, seed=0):
    """Points of regions of one row are on the right side of a criterion, up to the bound."""
    mesh = regions.mesh
    part = regions.where(criterion)
    points, face = points_on(mesh, n, seed)
    before = in_regions(regions, 0, points, face)
    holds = by_definition(criterion, points, mesh.normals[face]) >= 0
    wrong = int((in_regions(part, 0, points, face) != (before & holds)).sum())
    e = (part.bound.sum() + regions.bound.sum()) / mesh.areas.sum() * n
    assert wrong <= 2 + e + 6 * np.sqrt(e)
    assert (part.area <= frames_of(mesh).areas[part.pair_face] * (1 + 1e-9)).all()
    return part


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_regions_of_a_room_are_as_by_points(kind, seed):
    rng = np.random.default_rng(seed)
    criterion = random_criterion(kind, rng, 3.0, (4, 2.5, 1.5))
    assert_where(criterion, whole(room()[0]), 8000)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@examples(10)
@given(seed=SEEDS)
def test_regions_of_hostile_scenes_are_as_by_points(kind, seed):
    assert_hostile(kind, seed)


def assert_hostile(kind, seed):
    mesh, _, pose = hostile_scene(seed)
    rng = np.random.default_rng(seed)
    size = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    centre = mesh.bounds.mean(axis=0) if seed % 2 else pose[:3, 3]
    if frames_of(mesh).areas.sum() > 0:
        assert_where(random_criterion(kind, rng, size, centre), whole(mesh), 500)


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_fall_with_the_width_of_what_is_undecided(kind, monkeypatch):
    place, other = (1.0, 1.2, 2.5), (5.5, 3.5, 2.2)
    beams = rc.BeamDensity(place, (0, 0.1, 1), 0.2, 4000)
    assert_tighter({"angle": rc.RayAngle([place, other], 60), "beams": beams}[kind], monkeypatch)


def assert_tighter(criterion, monkeypatch):
    mesh, items = room()[0], []
    for width in (2e-3, 2e-4, 2e-5):
        monkeypatch.setattr(cut, "STRIP_REL", width)
        items.append(whole(mesh).where(criterion))
    bounds = [each.bound.sum() for each in items]
    assert bounds[0] > 3 * bounds[1] > 9 * bounds[2] > 0
    for each in items[:2]:
        assert abs(each.area.sum() - items[2].area.sum()) <= each.bound.sum() + bounds[2]


def test_beams_of_a_scanner_are_pixels_of_its_panorama():
    mesh, place = room()[0], np.array((4.0, 2.5, 1.5))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], place
    px = 1 / np.radians(0.2)
    scan = rc.Camera(width=1800, height=900, fx=px, fy=px, model="equirectangular")
    by_lens = rc.regions(mesh, scan, pose[None], rc.Task(min_pixels_per_m2=2000))
    part = rc.regions(mesh, scan, pose[None]).where(rc.BeamDensity(place, (0, 0, 1), 0.2, 2000))
    assert abs(part.area.sum() - by_lens.area.sum()) <= part.bound.sum() + by_lens.bound.sum()


def test_joined_regions_keep_their_devices():
    from rastercov.core.area.table import join

    mesh = room()[0]
    one = replace(whole(mesh), devices=np.arange(48))
    assert join([one, one]).devices.tolist() == [*range(48)] * 2
    assert join([one, whole(mesh)]).devices is None
    assert join([one, one]).of_poses(np.array([False, True])).devices.tolist() == [*range(48)]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: rc.RayAngle([(0, 0, 0)], 20), "coordinates"),
        (lambda: rc.RayAngle(np.zeros((2, 3)), 181), "0.001 to 180"),
        (lambda: rc.RayAngle(np.zeros((2, 3)), float("nan")), "0.001 to 180"),
        (lambda: rc.BeamDensity((0, 0, 0), (0, 0, 0), 1, 1), "length 0"),
        (lambda: rc.BeamDensity((0, 0, 0), (0, 0, 1), 0, 1), "above 0"),
        (lambda: rc.BeamDensity((0, 0, 0), (0, 0, 1), 1, float("inf")), "limit"),
        (lambda: whole(room()[0]).where(3), "criterion"),
        (lambda: whole(room()[0]).where(rc.RayAngle(np.zeros((2, 2, 3)), 3)), "1 rows"),
    ],
)
def test_criteria_that_cannot_be_are_refused(make, text):
    with pytest.raises(ConfigError, match=text):
        make()


EQUAL_AREA = rc.Camera(
    width=4096, height=4096, fx=1000, fy=1000, model="metashape_equisolid", distortion=(0,) * 6
)


@pytest.mark.parametrize(("camera", "least"), [(PANORAMA, 20_000), (EQUAL_AREA, 120_000)])
def test_pixels_of_panoramas_and_lenses_of_equal_area_are_as_by_points(camera, least):
    mesh, _, poses = room()
    task = rc.Task(min_pixels_per_m2=least, max_incidence_deg=75)
    result, _ = assert_pointwise(mesh, camera, poses[:2], task, 4000)
    assert result.bound.sum() <= 1e-4 * mesh.areas.sum()
    assert 0 < result.area.sum() < rc.regions(mesh, camera, poses[:2]).area.sum() * 0.9


def test_pixels_of_lenses_are_limited_each_by_its_own_camera():
    mesh, camera, poses = room()
    cameras = [camera, PANORAMA, EQUAL_AREA]
    task, placed = rc.Task(min_pixels_per_m2=50_000), rc.Poses.of(poses[:3], camera=[0, 1, 2])
    regions = rc.regions(mesh, cameras, placed, task)
    for row, each in enumerate(cameras):
        alone = rc.regions(mesh, each, poses[row : row + 1], task)
        assert np.array_equal(regions.areas()[row], alone.areas()[0])
