"""Cuts by light: parts on both sides of a limit are the whole, once; and what lamps cost."""

from dataclasses import replace

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples, nightly
from surface_cases import hostile_scene, room

import rastercov as rc
from rastercov.core.area import cut
from rastercov.core.area import regions as area_regions
from rastercov.core.area import stages as area_stages
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.table import Regions
from rastercov.light.regions import Light


def lit_scene(seed):
    """What a camera sees and one lamp lights in a hostile scene, eye, lamp and diagonal."""
    rng = np.random.default_rng(seed)
    mesh, camera, pose = hostile_scene(seed)
    if seed % 2:
        mesh = mesh.with_groups([], [group.name for group in mesh.groups])
    pose, size = np.reshape(pose, (1, 4, 4)), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    place = pose[0].copy()
    place[:3, 3] += rng.normal(size=3) * size * 10 ** rng.uniform(-2, -0.5)
    lamps = rc.Lamps([rc.Lamp.point(10)], [place])
    return mesh, camera, pose, lamps, rng


def pairs_of_limits(pose, lamps, regions, rng):
    """Highlights off and on, enough light and not more than that."""
    eye, at = pose[0, :3, 3], lamps.places[:, :3, 3]
    degrees, limit = rng.uniform(3, 60), 10.0
    if len(regions):
        corner = regions.points()[int(rng.integers(len(regions.xy)))]
        limit = 10 / max(np.sum((corner - at[0]) ** 2), 1e-30) * rng.uniform(0.1, 1)
    return [
        (rc.Highlight(eye, at, degrees), rc.Highlight(eye, at, degrees, is_least=False)),
        (rc.Illuminance(at, limit, 10), rc.Illuminance(at, limit, 10, is_least=False)),
    ]


def off(areas, wanted, *regions):
    """Largest distance of areas of faces beyond the bounds of regions, of the largest face."""
    bound = sum(each.bounds() for each in regions)
    return (np.abs(areas - wanted) - bound).max() / regions[0].mesh.areas.max()


@given(SEEDS)
@examples(40)
def test_parts_on_both_sides_of_a_limit_of_light_are_the_whole(seed):
    """By area within the bounds, with nothing in both of them."""
    mesh, camera, pose, lamps, rng = lit_scene(seed)
    whole = rc.regions(mesh, camera, pose, lamps=lamps)
    whole = replace(whole, bound=np.zeros_like(whole.bound), excess=None)
    for criteria in pairs_of_limits(pose, lamps, whole, rng):
        parts = [whole.where(criterion) for criterion in criteria]
        together = parts[0].areas() + parts[1].areas()
        assert off(together, whole.areas(), *parts) <= 1e-9
        assert (together <= whole.areas() + 1e-9 * mesh.areas.max()).all()
        both = parts[0].where(criteria[1])
        assert off(both.areas(), 0, both) <= 1e-9


@given(SEEDS)
@examples(40)
def test_a_cut_by_light_that_is_made_again_changes_nothing(seed):
    mesh, camera, pose, lamps, rng = lit_scene(seed)
    whole = rc.regions(mesh, camera, pose, lamps=lamps)
    for criterion in np.ravel(pairs_of_limits(pose, lamps, whole, rng)):
        once = whole.where(criterion)
        again = once.where(criterion)
        grown = np.abs(again.bounds() - once.bounds())
        lost = np.abs(again.areas() - once.areas())
        assert (lost <= grown + 1e-9 * mesh.areas.max()).all()
        assert lost.sum() <= 1e-4 * mesh.areas.sum()


@given(SEEDS)
@examples(20)
def test_a_task_without_highlights_is_a_cut_of_what_is_lit(seed):
    mesh, camera, pose, lamps, rng = lit_scene(seed)
    degrees = rng.uniform(3, 60)
    lit = rc.regions(mesh, camera, pose, lamps=lamps)
    cut = lit.where(rc.Highlight(pose[0, :3, 3], lamps.places[:, :3, 3], degrees))
    regions = rc.regions(mesh, camera, pose, rc.Task(max_highlight_deg=degrees), lamps=lamps)
    assert off(regions.areas(), cut.areas(), regions, cut) <= 1e-9


def test_parts_of_a_room_on_both_sides_of_limits_are_not_empty():
    mesh, camera, poses = room()
    place = rc.look_at((4, 2.5, 2.5), (4, 2, 0))
    lamps, size = rc.Lamps([rc.Lamp.point(10)], place), frames_of(mesh).areas.sum()
    whole = rc.regions(mesh, camera, poses[:1], lamps=lamps)
    for criteria in pairs_of_limits(poses, lamps, whole, np.random.default_rng(4)):
        areas = [whole.where(each).area.sum() for each in criteria]
        assert min(areas) > 1e-3 * size
        assert sum(areas) == pytest.approx(whole.area.sum(), abs=1e-3 * size)


@pytest.fixture
def solved(monkeypatch):
    """Eyes whose regions are found, and gates, in lists that grow."""
    eyes, gates = [], []
    run, gate = area_regions.RegionPass._run, Regions.at_least

    def runs(self, poses, seen, find):
        def finds(placed, figures):
            eyes.extend(self.cameras[at].model for at in placed.camera[placed.rows])
            return find(placed, figures)

        return run(self, poses, seen, finds)

    def counts(self, *args, **options):
        gates.append(len(self.pose_ids))
        return gate(self, *args, **options)

    monkeypatch.setattr(area_regions.RegionPass, "_run", runs)
    monkeypatch.setattr(Regions, "at_least", counts)
    return eyes, gates


BAR = rc.Lamp.bar(0.5, 20, points=4)


@pytest.mark.parametrize("own", [{}, {"min_illuminance": 2}, {"max_highlight_deg": 12}])
@pytest.mark.parametrize("n", [1, 3, 6])
def test_a_fixed_lamp_is_solved_once_for_all_poses(solved, own, n):
    """Regions of an eye for each point of it, and the poses; no more gates for more poses."""
    mesh, camera, poses = room()
    lamps = rc.Lamps([rc.Lamp.point(20), BAR], rc.look_at([(4, 2.5, 2.5), (2, 2, 2)], (4, 2, 0)))
    eyes, gates = solved
    rc.regions(mesh, camera, poses[:n], rc.Task(**own), lamps=lamps, threads=1)
    assert len(eyes) == n + 1 + BAR.points
    assert eyes.count("pinhole") == n
    assert len(gates) <= 4


@pytest.mark.parametrize("own", [{}, {"min_illuminance": 2}, {"max_highlight_deg": 12}])
def test_a_lamp_on_a_rig_is_solved_once_a_pose(solved, own):
    mesh, camera, poses = room()
    panel = rc.look_at((4, 2.5, 2.5), (4, 2, 0))[0]
    lamps = rc.Lamps([rc.Lamp.point(20), BAR], [panel, np.eye(4)], rides=[False, True])
    eyes, _ = solved
    rc.regions(mesh, camera, poses, rc.Task(**own), lamps=lamps, threads=1)
    assert len(eyes) == 6 + 1 + 6 * BAR.points


def test_light_that_is_not_decided_on_a_sliver_is_in_the_bounds_beside_highlights():
    """Narrower than what a cut decides, and in no highlight: the same bound with and without."""
    corners = [
        (0, 0, 0),
        (1, 0, 0),
        (0, 1, 0),
        (0.1, 0.1, 0.1),
        (0.9, 0.1, 0.1),
        (0.5, 0.1 + 2e-6, 0.1),
    ]
    mesh = rc.Mesh(corners, [(0, 1, 2), (3, 4, 5)])
    camera = rc.Camera(width=200, height=160, fx=150, fy=150)
    pose = rc.look_at((0.3, 0.3, 2), (0.3, 0.3, 0), (0, 1, 0))
    lamps = rc.Lamps([rc.Lamp.point(10)], rc.look_at((0.5, 2, 1), (0.5, 0.1, 0)))
    height, d = 0.9, np.linalg.norm((0.2, 1.9, 0.9))
    light = {"min_illuminance": float(10 * height / d**3)}
    task = rc.Task(**light, max_highlight_deg=2)
    plain = rc.regions(mesh, camera, pose, rc.Task(**light), lamps=lamps)
    regions = rc.regions(mesh, camera, pose, task, lamps=lamps)
    whole = rc.regions(mesh, camera, pose, lamps=lamps)
    assert whole.areas()[0, 1] == pytest.approx(mesh.areas[1])
    assert plain.bounds()[0, 1] > 0.1 * mesh.areas[1]
    sure = [each.areas()[0, 1] + each.bounds()[0, 1] for each in (plain, regions)]
    assert sure[1] >= sure[0] - 1e-9 * mesh.areas[1]


def seen_triangle():
    mesh = rc.Mesh([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], [(0, 1, 2)])
    camera = rc.Camera(width=300, height=300, fx=200, fy=200)
    return mesh, rc.regions(mesh, camera, rc.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0)))


@nightly
@pytest.mark.slow
def test_what_cuts_of_light_leave_is_in_the_bound(monkeypatch):
    """A curve that is to be as thin as 1e-10 of the diagonal takes more cuts than there may be."""
    monkeypatch.setattr(cut, "STRIP_REL", 1e-10)
    _, seen = seen_triangle()
    part = seen.by_devices().where(rc.Illuminance([(0.1, 0, 0.5)], limit=3))
    assert 0 < part.cut_short <= part.bound.sum()
    true = np.pi * ((0.5 / 3) ** (2 / 3) - 0.25)
    assert abs(part.area.sum() - true) <= part.bound.sum()


def test_what_cuts_leave_is_said():
    mesh, seen = seen_triangle()
    network = AreaNetwork(mesh, rc.Task())
    assert network.doubts() == []
    network.add(replace(seen, bound=seen.bound + 0.5, cut_short=0.2))
    (line,) = network.doubts()
    assert "0.2 m²" in line
    assert "undecided and added to the bound" in line


def test_reasons_find_what_lamps_on_a_rig_light_once_for_the_same_light(monkeypatch):
    """Each set of criteria asks for it; only thresholds of light change it."""
    asked, stages = [], []
    rows, passes = Light._rows, area_stages.passes

    def counted(self, leads, world):
        own = self.task.min_illuminance, self.task.max_illuminance, self.task.max_highlight_deg
        asked.append((own, world.tobytes()))
        return rows(self, leads, world)

    def staged(*own):
        stages.append(own[2].rows)
        return passes(*own)

    monkeypatch.setattr(Light, "_rows", counted)
    monkeypatch.setattr("rastercov.core.area.zones.passes", staged)
    mesh, camera = rc.shapes.teapot(3), rc.Camera.from_fov(320, 240, hfov_deg=46)
    lamps = rc.Lamps([rc.Lamp.point(10)], rides=[True])
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 0.6, count=2)
    task = rc.Task(max_incidence_deg=60, min_illuminance=20, max_highlight_deg=12)
    regions = rc.regions(mesh, camera, poses, task, lamps=lamps)
    network = AreaNetwork(mesh, regions.task)
    network.add(regions)
    assert network.zones(regions.camera, poses).count()
    assert len(stages) > 2 * len(asked) > 0
    assert len(asked) == len(set(asked))
