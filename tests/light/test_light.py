"""Lamps: by area what cameras see and lamps reach, against points, and by laws."""

import json
import re

import numpy as np
import pytest
from commands import done, enter
from exact_cases import box
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount
from surface_cases import cut_at_random, in_regions, room

import rastercov as rc
from rastercov.base.errors import CameraError, ConfigError, PoseError
from rastercov.core.area.cells import cells
from rastercov.core.area.features import values_of
from rastercov.core.area.stages import CentrePass, failures_of_rows
from rastercov.core.camera.rig import with_equipment
from rastercov.core.coverage.task import NAMES, Reason
from rastercov.light.lamp_file import lamp_of, lamps_of
from rastercov.light.lamps import illuminances, intensities_of, lamps_of_json, points_of
from rastercov.light.points import OfLight
from rastercov.light.regions import HIGHLIGHT, TOO_BRIGHT, TOO_DARK, UNLIT
from rastercov.reference.regions import covers_points, points_on, rig_covers_points
from rastercov.report.modes import MODES

TASK = rc.Task(max_incidence_deg=75)
CAMERA = rc.Camera(width=200, height=160, fx=150, fy=150)
ABOVE = rc.look_at((0.5, 0.5, 2), (0.5, 0.5, 0), (0, 1, 0))
FACES = [(0, 1, 2), (0, 2, 3)]
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def sheet(*, two_sided=False):
    """One square metre at z = 0, its front upwards."""
    return rc.Mesh(CORNERS, FACES, [rc.Group("sheet", is_two_sided=two_sided)])


def three_lamps():
    places = rc.look_at([(4, 2.5, 2.9), (1, 1, 2.5), (6, 4, 2)], (4.2, 2.4, 0.2))
    lamps = [
        rc.Lamp.point(intensity=5), rc.Lamp.spot(40, intensity=5),
        rc.Lamp.area(0.6, points=9, intensity=3),
    ]  # fmt: skip
    return rc.Lamps(lamps, places, ["bulb", "spot", "panel"])


def reached(mesh, poses, eyes, points, face):
    """(2, N) points that the points of lamps reach from the front and from the rear, (2, K, N)."""
    sees = np.array([
        covers_points(mesh, eyes[at], pose[None], rc.Task(), points, face)[0]
        for pose, at in zip(poses.world_from_camera, poses.camera, strict=True)
    ])  # fmt: skip
    away = poses.world_from_camera[:, None, :3, 3] - points
    front = np.einsum("kni,ni->kn", away, mesh.normals[face]) > 0
    return sees & front, sees & ~front


def lit_points(mesh, lamps, camera, poses, points, face):
    """(P, N) points that are seen, and lit on the side of the camera, one by one."""
    return rig_covers_points(
        mesh, with_equipment(camera, {"lamps": lamps}, mesh), poses, TASK, points, face
    )


@pytest.mark.parametrize("two_sided", [False, True])
def test_what_is_seen_and_lit_is_as_by_points(two_sided):
    mesh, camera, poses = room()
    mesh = mesh.with_groups([], [each.name for each in mesh.groups] if two_sided else [])
    points, face = points_on(mesh, amount(1000, at_night=3000))
    lamps = three_lamps()
    regions = rc.regions(mesh, camera, poses, TASK, lamps=lamps)
    truth = lit_points(mesh, lamps, camera, poses, points, face)
    for row in range(len(poses)):
        wrong = int((in_regions(regions, row, points, face) != truth[row]).sum())
        assert wrong <= 2 + regions.bounds()[row].sum() / mesh.areas.sum() * len(points)
    share = regions.areas().sum(axis=1) / mesh.areas.sum()
    assert share == pytest.approx(truth.mean(axis=1), abs=0.03)
    assert np.array_equal(regions.pose_ids, np.arange(6))
    assert regions.eyes.tolist() == poses[:, :3, 3].tolist()


@pytest.mark.slow
def test_a_lamp_of_size_is_as_by_many_rays():
    """Half of a square lamp of 0.6 m, 16 points of it and hundreds of rays a point."""
    mesh, _, _ = room()
    place = rc.look_at((4, 2.5, 2.6), (4, 2.5, 0), (0, 1, 0))
    lamps = rc.Lamps([rc.Lamp.area(0.6, intensity=1)], place)
    own = rc.Camera(width=2000, height=2000, fx=500, fy=500)  # sees nearly all that it lights
    points, face = points_on(mesh, amount(700, at_night=1500))
    lit = lit_points(mesh, lamps, own, place, points, face)[0]
    rng = np.random.default_rng(3)
    sees, n = np.zeros(len(points)), amount(18, at_night=32)
    for cell in np.ndindex(n, n):
        at = place[0].copy()
        at[:3, 3] += place[0, :3, :2] @ ((np.array(cell) + rng.random(2)) / n - 0.5) * 0.6
        sees += covers_points(mesh, lamps.eyes[0], at[None], rc.Task(), points, face)[0]
    seen = covers_points(mesh, own, place, TASK, points, face)[0]
    assert abs(lit.mean() - (seen & (sees >= n**2 / 2)).mean()) < 0.005


def test_lamp_and_camera_on_both_sides_of_a_sheet_light_nothing():
    below = rc.look_at((0.5, 0.5, -1), (0.5, 0.5, 0), (0, 1, 0))
    mesh, lamp = sheet(two_sided=True), rc.Lamp.point(intensity=1)
    assert rc.regions(mesh, CAMERA, ABOVE, lamps=rc.Lamps([lamp], below)).area.sum() == 0
    lit = rc.regions(mesh, CAMERA, ABOVE, lamps=rc.Lamps([lamp] * 2, [ABOVE[0], below[0]]))
    assert lit.area.sum() == pytest.approx(1)


def test_points_of_a_rig_around_a_sheet_are_lit_on_the_side_where_its_rule_holds():
    """The first camera is above, the lamp and the second below: as by area, all is covered."""
    mesh, below = sheet(two_sided=True), rc.look_at((0.5, 0.5, -2), (0.5, 0.5, 0), (0, 1, 0))
    rig = rc.Rig([CAMERA] * 2, None, [ABOVE[0], below[0]], rule=rc.AtLeast(1))
    lit, poses = (
        with_equipment(rig, {"lamps": rc.Lamps([rc.Lamp.point(intensity=1)], below)}, mesh),
        rig.poses(np.eye(4)),
    )
    assert rc.regions(mesh, lit, poses).area.sum() == pytest.approx(1)
    own = rc.cells(mesh, 0.5)
    assert len(CentrePass(own, lit, rc.Task()).find(poses).row(0)) == len(own)
    ((_, reason, _),) = failures_of_rows(mesh, lit, rc.Task(), poses, mesh.centroids, np.arange(2))
    assert (reason == Reason.COVERED).all()


def test_a_lamp_in_a_closed_box_lights_nothing_for_a_camera_outside():
    mesh = box((0, 0, 0), (1, 1, 1))
    inside = np.eye(4)
    inside[:3, 3] = 0.5
    poses = rc.sphere_of_poses((0.5, 0.5, 0.5), 4, 6)
    lamps = rc.Lamps([rc.Lamp.point(intensity=1)], [inside], ["bulb"])
    for two_sided in (False, True):
        scene = rc.Mesh(mesh.vertices, mesh.faces, [rc.Group("box", is_two_sided=two_sided)])
        assert rc.regions(scene, CAMERA, poses, lamps=lamps).area.sum() == 0
    summary = rc.evaluate(mesh, CAMERA, poses, by="area", lamps=lamps).summary()
    assert summary["covered_area"]["m2"] == 0
    assert summary["light"]["unlit"]["percent"] == pytest.approx(100, abs=1e-3)
    assert any("lamp bulb lights no evaluated surface" in line for line in summary["doubts"])


def test_what_is_lit_does_not_depend_on_the_triangles():
    mesh, camera, poses = room()
    lamps = three_lamps()
    parts, _ = cut_at_random(mesh, 5, 30)
    whole, cut = (rc.regions(each, camera, poses, TASK, lamps=lamps) for each in (mesh, parts))
    shares = [each.areas().sum(axis=1) / mesh.areas.sum() for each in (whole, cut)]
    assert shares[0] == pytest.approx(shares[1], abs=1e-6)


def test_a_lamp_at_the_camera_lights_what_the_camera_sees():
    """Fixed at the place of the camera, or riding on its rig: nothing is lost, to the bound."""
    mesh, camera, poses = room()
    alone = rc.regions(mesh, camera, poses, TASK)
    lamp = rc.Lamp.point(intensity=1)
    on_rig = rc.regions(mesh, camera, poses, TASK, lamps=rc.Lamps([lamp], rides=[True]))
    total = alone.areas().sum(axis=1)
    assert on_rig.areas().sum(axis=1) == pytest.approx(total, rel=1e-9)
    fixed = rc.regions(mesh, camera, poses[:1], TASK, lamps=rc.Lamps([lamp], poses[:1]))
    assert fixed.area.sum() == pytest.approx(total[0], rel=1e-9)


def test_lamps_on_a_rig_go_with_each_of_its_poses():
    """One lamp beside the camera is the same as a fixed lamp at each of its places."""
    mesh, camera, poses = room()
    place = np.eye(4)
    place[0, 3] = 0.4
    lamp, rig = rc.Lamp.spot(35, intensity=1), rc.Rig([camera], None, [np.eye(4)])
    regions = rc.regions(mesh, rig, poses, TASK, lamps=rc.Lamps([lamp], [place], rides=[True]))
    for row, pose in enumerate(poses):
        fixed = rc.Lamps([lamp], [pose @ place])
        own = rc.regions(mesh, camera, pose, TASK, lamps=fixed)
        assert regions.areas()[row].sum() == pytest.approx(own.area.sum(), rel=1e-9)


def test_a_rig_with_a_rule_is_lit_as_a_whole():
    mesh, camera, poses = room()
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.3
    rig = rc.Rig([camera, camera], ["left", "right"], places, rule=rc.All())
    lamps = three_lamps()
    regions = rc.regions(mesh, rig, rig.poses(poses[:2]), TASK, lamps=lamps)
    points, face = points_on(mesh, 3000)
    alone = [lit_points(mesh, lamps, camera, poses[:2] @ place, points, face) for place in places]
    for row in range(2):
        wrong = int((in_regions(regions, row, points, face) != alone[0][row] & alone[1][row]).sum())
        assert wrong <= 2


def test_reasons_of_points_name_light():
    mesh, camera, poses = room()
    lamps = three_lamps()
    rig = rc.Rig([camera])
    points, face = points_on(mesh, 1500)
    lit = lit_points(mesh, lamps, camera, poses, points, face)
    seen = covers_points(mesh, camera, poses, TASK, points, face)
    with_light = with_equipment(rig, {"lamps": lamps}, mesh)
    rows = failures_of_rows(mesh, with_light, TASK, rc.Poses.of(poses), points, face)
    for row, (_, reason, _) in enumerate(rows):
        assert ((reason == Reason.COVERED) == lit[row]).mean() > 0.998
        assert ((reason == UNLIT) == (seen[row] & ~lit[row])).mean() > 0.998
    cells = rc.cells(mesh, 0.5)
    near = CentrePass(cells, with_light, TASK).find(poses)
    exact = cells.share(rc.regions(mesh, camera, poses, TASK, lamps=lamps))
    both = np.isin(near.row(0), exact.cell[: exact.starts[1]])
    assert both.all()
    assert len(both) > 10


def test_an_evaluation_says_what_is_unlit_and_by_which_lamps_it_is_lit():
    mesh, camera, poses = room()
    result = rc.evaluate(mesh, camera, poses, TASK, by="area", lamps=three_lamps())
    summary = result.summary()
    seen = rc.evaluate(mesh, camera, poses, TASK, by="area").areas.summary()
    light = summary["light"]
    lost = seen["m2"] - summary["covered_area"]["m2"]
    assert light["unlit"]["m2"] == pytest.approx(lost, abs=1e-9)
    assert [each["lamp"] for each in light["lamps"]] == ["bulb", "spot", "panel"]
    assert all(5 < each["lit_percent"] < 100 for each in light["lamps"])
    assert "unlit" in summary["not_covered_because"]
    unlit = [zone for zone in summary["dead_zones"] if zone["reason"] == "unlit"]
    assert unlit
    assert all(zone["device"] in ("bulb", "spot", "panel") for zone in unlit)
    said = {(zone["advice"], zone["nearest"], zone["tried"]) for zone in unlit}
    assert said == {("add a lamp that reaches this surface, or remove the obstacle", None, None)}
    strict = rc.Task(max_incidence_deg=75, min_illuminance=0.5)
    result = rc.evaluate(mesh, camera, poses, strict, by="area", lamps=three_lamps()).summary()
    assert result["light"]["unlit"]["m2"] == pytest.approx(light["unlit"]["m2"], abs=1e-9)
    lost = summary["covered_area"]["m2"] - result["covered_area"]["m2"]
    assert result["light"]["out_of_limits"]["m2"] == pytest.approx(lost, abs=1e-9)
    assert lost > 0.1


def test_the_command_takes_a_file_of_lamps(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    (tmp_path / "lamps.toml").write_text(
        '[lamps.left]\nkind = "spot"\nintensity_cd = 900\nhalf_angle_deg = 30\n'
        "positions = [[0.5, 0.4, 0.5], [-0.5, 0.4, 0.5]]\naim = [0, 0, 0.07]\n"
        '[lamps.ring]\nkind = "ring"\nsize = 0.1\nintensity_cd = 20\nrig = true\n'
        "[exposure]\nexposure_time = 0.05\nf_number = 4\npixel_size = 5e-6\n"
        "quantum_efficiency = 0.6\nfull_well = 20000\nmin_snr = 20\n"
    )
    line = (
        "evaluate teapot-5 -c khepra -p sphere:2 --lamps lamps.toml -o out --max-incidence-deg 75"
    )
    out, _ = done(capsys, line)
    assert "exposure: SNR 20 or more and saturation 1 or less is " in out
    assert "visible but unlit: " in out
    assert "by left 0" in out
    content = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [each["lamp"] for each in content["light"]["lamps"]] == ["left 0", "left 1", "ring"]
    assert 0 < content["light"]["lamps"][2]["lit_percent"] < 100
    assert "Visible but unlit: " in (tmp_path / "out" / "report.html").read_text()
    assert "Illuminance" in (tmp_path / "out" / "view.html").read_text()
    again = rc.load_lamps(tmp_path / "out" / "network.glb")
    given = rc.load_lamps(tmp_path / "lamps.toml")
    assert again.names == given.names[:2]
    assert again.places == pytest.approx(given.places[:2], abs=1e-6)
    assert [lamp.intensity for lamp in again.lamps] == [900, 900]
    assert [lamp.half_angle_deg for lamp in again.lamps] == pytest.approx([30, 30])
    assert rc.Mesh.load(tmp_path / "out" / "network.glb").n_faces > 0


def test_a_lamp_on_a_rig_reaches_what_it_reaches_from_any_pose():
    mesh, camera, poses = room()
    lamps = [rc.Lamp.spot(25, intensity=5), rc.Lamp.area(0.6, points=9, intensity=3)]
    on_rig = rc.Lamps(lamps, names=["spot", "panel"], rides=[True, True])
    summary = rc.evaluate(mesh, camera, poses, TASK, by="area", lamps=on_rig).summary()["light"]
    assert "illuminance" not in summary
    for lamp, told in zip(lamps, summary["lamps"], strict=True):
        fixed = rc.Lamps([lamp] * len(poses), poses)
        union = rc.RegionUnion(mesh)
        finder = rc.regions(mesh, lamps_seen(fixed), points_of(fixed, np.ones(len(poses), bool)))
        of_lamp = np.repeat(np.arange(len(poses)), lamp.points)
        union.add(finder.at_least(lamp.points_needed, of_lamp, one_side=False))
        assert abs(told["lit_percent"] - 100 * union.covered().share()) <= told["bound_percent"] < 1


def lamps_seen(lamps):
    return list(lamps.eyes)


def test_illuminance_is_given_beside_the_share_and_in_dark_zones():
    lamps = rc.Lamps([rc.Lamp.point(100)], rc.look_at((0.5, 0.5, 1), (0.5, 0.5, 0), (0, 1, 0)))
    task = rc.Task(min_illuminance=80)
    summary = rc.evaluate(sheet(), CAMERA, ABOVE, task, by="area", lamps=lamps).summary()
    lux = summary["light"]["illuminance"]
    assert lux["most"] == pytest.approx(100, rel=1e-3)
    assert lux["least"] == pytest.approx(100 / 1.5**1.5, rel=0.05)  # in a corner
    assert lux["unit"] == "lx"
    own = summary["dead_zones"][0]["illuminance"]
    assert 50 < own["least"] < own["most"] < 80
    advice = summary["dead_zones"][0]["advice"]
    assert re.match(r"down to 5[\d.]+ lx, 80 lx required: move a lamp closer", advice)


# Thresholds of light


def adding_lamps():
    places = rc.look_at([(4.1, 2.45, 2.9), (1, 1.1, 2.5), (6.1, 4.1, 2)], (4.2, 2.4, 0.2))
    lamps = [rc.Lamp.point(30), rc.Lamp.spot(40, 40, exponent=3), rc.Lamp.bar(0.8, 30, points=2)]
    return rc.Lamps(lamps, places, ambient=0.5)


def mirrored(eye, lamp, points, normals, degrees):
    rays = [at - points for at in (eye, lamp)]
    half = sum(ray / np.linalg.norm(ray, axis=1)[:, None] for ray in rays)
    cosine = np.abs(np.einsum("ni,ni->n", half, normals)) / np.linalg.norm(half, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))) < degrees


def enough_light(mesh, lamps, camera, poses, task, points, face, eyes=None):
    """(P, N) points that are seen, and have light as a task asks, one by one."""
    of_points = points_of(lamps, np.ones(len(lamps), bool))
    normals, result = mesh.normals[face], lit_points(mesh, lamps, camera, poses, points, face)
    sides = reached(mesh, of_points, lamps.eyes, points, face)
    light = [np.full(len(points), lamps.ambient) for _ in sides]
    for k, pose in enumerate(of_points.world_from_camera):
        lamp, away = lamps.lamps[of_points.camera[k]], pose[:3, 3] - points
        d = np.linalg.norm(away, axis=1)
        intensity = (lamp.intensity or lamp.power_w_sr) / lamp.points
        intensity *= (
            np.maximum(-(away @ pose[:3, 2]) / d, 0 if lamp.exponent else 1) ** lamp.exponent
        )
        cosine = np.abs(np.einsum("ni,ni->n", away, normals)) / d
        for own, sees in zip(light, sides, strict=True):
            own += sees[k] * intensity * cosine / d**2
    for row, eye in enumerate((poses if eyes is None else eyes)[:, :3, 3]):
        front = np.einsum("ni,ni->n", eye - points, normals) > 0
        own = np.where(front, *light)
        result[row] &= own >= task.min_illuminance
        result[row] &= own <= (task.max_illuminance or np.inf)
        for k, place in enumerate(of_points.world_from_camera[:, :3, 3]):
            bad = mirrored(eye, place, points, normals, task.max_highlight_deg)
            result[row] &= ~(bad & np.where(front, *(sees[k] for sees in sides)))
    return result


TASKS = [
    {"min_illuminance": 4},
    {"min_illuminance": "3 lx", "max_illuminance": 9},
    {"min_illuminance": 2, "max_highlight_deg": 12},
    {"max_highlight_deg": "polished"},
]
CASES = amount(
    [(own, row % 2 == 1) for row, own in enumerate(TASKS)],
    at_night=[(own, sides) for own in TASKS for sides in (False, True)],
)
"""Tasks, by day with one or two sides of all faces, at night with both."""


@pytest.mark.parametrize(("own", "two_sided"), CASES)
def test_light_that_adds_up_is_as_by_points(own, two_sided):
    mesh, camera, poses = room()
    mesh = mesh.with_groups([], [each.name for each in mesh.groups] if two_sided else [])
    points, face = points_on(mesh, amount(500, at_night=3000))
    lamps, task = adding_lamps(), rc.Task(max_incidence_deg=75, **own)
    regions = rc.regions(mesh, camera, poses, task, lamps=lamps)
    truth = enough_light(mesh, lamps, camera, poses, task, points, face)
    total = mesh.areas.sum()
    assert regions.bounds().sum(axis=1).max() / total < 2e-3
    for row in range(len(poses)):
        wrong = int((in_regions(regions, row, points, face) != truth[row]).sum())
        e = regions.bounds()[row].sum() / total * len(points)
        assert wrong <= 2 + e + 6 * np.sqrt(e)
    assert truth.any(axis=1).all()
    rows = failures_of_rows(
        mesh, with_equipment(camera, {"lamps": lamps}, mesh), task, rc.Poses.of(poses), points, face
    )
    reasons = [reason for _, reason, _ in rows]
    assert (np.equal(reasons, Reason.COVERED) == truth).mean() > 0.999
    wanted = {"min_illuminance": TOO_DARK, "max_illuminance": TOO_BRIGHT}
    for name in own:
        assert (np.array(reasons) == wanted.get(name, HIGHLIGHT)).any()


@pytest.mark.parametrize("height", [0.2, 0.7])
def test_light_of_one_lamp_is_a_disc_around_its_foot(height):
    """E >= E0 where r^2 <= (h I / E0)^(2/3) - h^2."""
    place = rc.look_at((0.5, 0.5, height), (0.5, 0.5, 0), (0, 1, 0))
    lamps, limit = rc.Lamps([rc.Lamp.point(10)], place), 100 if height < 0.5 else 12
    disc = np.pi * ((height * 10 / limit) ** (2 / 3) - height**2)
    eye = rc.look_at((0.5, 0.5, 5), (0.5, 0.5, 0), (0, 1, 0))
    regions = rc.regions(sheet(), CAMERA, eye, rc.Task(min_illuminance=limit), lamps=lamps)
    assert 0.05 < disc < 0.7
    assert abs(regions.area.sum() - disc) <= regions.bound.sum() + 1e-12
    assert regions.bound.sum() < 1e-3
    rest = rc.regions(sheet(), CAMERA, eye, rc.Task(max_illuminance=limit), lamps=lamps)
    assert rest.area.sum() + regions.area.sum() == pytest.approx(1, abs=2 * regions.bound.sum())


def test_light_on_a_rig_adds_to_light_of_the_cell():
    """A lamp that rides beside one in the cell is as two in the cell, at each pose."""
    mesh, camera, poses = room()
    place = np.eye(4)
    place[0, 3] = 0.4
    panel = rc.look_at((4.1, 2.4, 2.5), (4, 2, 0))[0]
    lamps, task = [rc.Lamp.spot(35, 60), rc.Lamp.point(40)], rc.Task(min_illuminance=5)
    rides = rc.Lamps(lamps, [place, panel], rides=[True, False])
    regions = rc.regions(mesh, camera, poses[:3], task, lamps=rides)
    for row, pose in enumerate(poses[:3]):
        fixed = rc.Lamps(lamps, [pose @ place, panel])
        own = rc.regions(mesh, camera, pose, task, lamps=fixed)
        assert regions.areas()[row].sum() == pytest.approx(own.area.sum(), abs=2 * own.bound.sum())
        assert own.area.sum() > 0.1


@pytest.mark.parametrize("rule", [rc.Any(), rc.All()])
@pytest.mark.parametrize("apart", ["a", "ab"])
def test_a_camera_without_a_limit_of_highlights_sees_what_is_lit(rule, apart):
    lamps = rc.Lamps([rc.Lamp.spot(25, intensity=100)], rc.look_at([(0.5, -0.5, 0.6)], (0, 0, 0)))
    mesh, plain = rc.shapes.teapot(3), rc.Task(max_incidence_deg=75)
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.1
    camera = rc.Camera.from_fov(640, 512, hfov_deg=46)
    rig = rc.Rig([camera, camera], ["a", "b"], places, rule=rule, tasks=dict.fromkeys(apart, plain))
    poses = rig.poses(rc.sphere_of_poses((0, 0, 0.07), 0.6, 3))
    limited = rc.Task(max_incidence_deg=75, max_highlight_deg="satin")
    items, lit = (
        rc.unite(rc.regions(mesh, rig, poses, task, lamps=lamps)).area[0]
        for task in (limited, plain)
    )
    assert lit.sum() > 0
    assert (items <= lit + 1e-9).all()
    if apart == "ab":
        assert np.allclose(items, lit, atol=1e-9)


def test_a_rig_with_a_rule_sees_no_highlight_in_any_of_its_cameras():
    mesh, camera, poses = room()
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.3
    task = rc.Task(max_incidence_deg=75, max_highlight_deg=20)
    lamps = adding_lamps()
    points, face = points_on(mesh, 3000)
    for tasks, asked in (({}, (task, task)), ({"b": {"max_incidence_deg": 75}}, (task, TASK))):
        rig = rc.Rig([camera, camera], ["a", "b"], places, rule=rc.All(), tasks=tasks)
        regions = rc.regions(mesh, rig, rig.poses(poses[:1]), task, lamps=lamps)
        alone = [
            enough_light(mesh, lamps, camera, poses[:1] @ place, own, points, face)[0]
            for place, own in zip(places, asked, strict=True)
        ]
        wrong = (in_regions(regions, 0, points, face) != alone[0] & alone[1]).sum()
        assert wrong <= 3


OVER = st.tuples(*map(st.floats, (-1, -1, 1), (1, 1, 2)))
"""Places around the sheet, all above it."""


@given(
    still=OVER, eyes=st.lists(OVER, min_size=1, max_size=2), offset=OVER,
    order=st.permutations(["moves", "still", "too"]), k=st.integers(1, 3),
    rides=st.sampled_from([True, "moves", "still", "too"]),
)  # fmt: skip
def test_a_lamp_on_a_rig_is_as_one_in_the_cell_for_fixed_cameras_too(
    still, eyes, offset, order, k, rides
):
    """For each of its poses, by area and by points."""
    mesh, task = sheet(two_sided=True), rc.Task(min_illuminance=1, max_highlight_deg=15)
    places = {"moves": np.eye(4), "still": rc.look_at([still], (0.5, 0.5, 0))[0]}
    places["too"] = rc.look_at([(0.2, 0, 0)], (0.2, 0, 1))[0]
    rig = rc.Rig(
        [CAMERA] * 3, order, [places[each] for each in order], rule=rc.AtLeast(k), fixed=["still"]
    )
    poses = rc.look_at(eyes, (0.5, 0.5, 0))
    place = np.eye(4)
    place[:2, 3] = offset[:2]
    lamp, own = [rc.Lamp.point(intensity=9)], cells(mesh, 0.1)
    lamps = rc.Lamps(lamp, [place], rides=[rides])
    regions = rc.regions(mesh, rig, rig.poses(poses), task, lamps=lamps)
    lit = CentrePass(own, with_equipment(rig, {"lamps": lamps}, mesh), task).find(rig.poses(poses))
    for row, pose in enumerate(poses):
        cell = rc.Lamps(lamp, [pose @ place])
        one = rc.regions(mesh, rig, rig.poses(pose), task, lamps=cell)
        off = abs(regions.areas()[row] - one.areas()[0])
        assert (off <= regions.bounds()[row] + one.bounds()[0] + 1e-9).all()
        same = CentrePass(own, with_equipment(rig, {"lamps": cell}, mesh), task)
        assert np.setxor1d(lit.row(row), same.find(rig.poses(pose)).row(0)).size <= 1


def test_a_lamp_on_a_rig_lights_nothing_for_fixed_cameras_without_a_rule():
    places = [np.eye(4), ABOVE[0]]
    rig = rc.Rig([CAMERA] * 2, ["moves", "still"], places, fixed=["still"])
    lamps = rc.Lamps([rc.Lamp.point(intensity=9)], rides=[True])
    regions = rc.regions(sheet(), rig, rig.poses(ABOVE), lamps=lamps)
    assert regions.areas().sum(axis=1).round(6).tolist() == [1, 0]


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("on_rig", [False, True])
def test_the_points_of_a_lamp_light_a_sheet_from_one_side(two_sided, on_rig):
    """Half of a bar is before the sheet and half behind: neither side gets enough of it."""
    across = np.array([(0, 0, 1, -1), (0, 1, 0, 0.5), (-1, 0, 0, 0), (0, 0, 0, 1.0)])  # along z
    for share, lit in ((1, 0), (0.5, 100)):
        bar = rc.Lamp.bar(1, intensity=9, points=2, share=share)
        own = np.linalg.inv(ABOVE[0]) @ across if on_rig else across
        lamps = rc.Lamps([bar], [own], rides=[on_rig])
        result = rc.evaluate(sheet(two_sided=two_sided), CAMERA, ABOVE, lamps=lamps, fields=())
        (entry,) = result.summary()["light"]["lamps"]
        assert entry["lit_percent"] == pytest.approx(lit, abs=1e-6)
        assert result.covered.share() == pytest.approx(lit / 100, abs=1e-6)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_camera_that_a_lamp_dazzles_leaves_the_others_of_its_rig(k):
    """By area, and by points: the rule holds of the cameras that see no highlight there."""
    mesh = sheet()
    eyes = [(0.5, 0.5, 2), (2, 0.5, 2), (-1, 2, 2)]
    rig = rc.Rig(
        [CAMERA] * 3, ["a", "b", "c"], rc.look_at(eyes, (0.5, 0.5, 0), up=(0, 1, 0)),
        rule=rc.AtLeast(k),
    )  # fmt: skip
    lamps = rc.Lamps([rc.Lamp.point(intensity=9)], rc.look_at((0.5, 0.5, 3), (0.5, 0.5, 0)))
    task = rc.Task(max_highlight_deg=15)
    regions = rc.regions(mesh, rig, rig.poses(np.eye(4)[None]), task, lamps=lamps)
    own = cells(mesh, 0.05)
    by_points = CentrePass(own, with_equipment(rig, {"lamps": lamps}, mesh), task).find(
        rig.poses(np.eye(4)[None])
    )
    covered = np.zeros(len(own), np.bool_)
    covered[by_points.row(0)] = True
    centres = own.vertices.reshape(-1, 3, 3).mean(axis=1)
    by_area = in_regions(regions, 0, centres, own.source_face)
    assert (covered != by_area).mean() < 0.01
    if k < 3:
        assert covered.mean() > 0.3
    else:
        assert covered.mean() < 0.9


@pytest.mark.parametrize(
    ("task", "words"),
    [
        (
            {"min_illuminance": "3 W/m2"},
            "expected min_illuminance in lx, the unit of the lamps, got W/m2",
        ),
        ({"max_illuminance": 0.4}, "above the ambient 0.5 lx, got 0.4"),
    ],
)
def test_thresholds_in_another_unit_and_below_ambient_light_are_refused(task, words):
    mesh, camera, poses = room()
    with pytest.raises((CameraError, ConfigError), match=words):
        rc.regions(mesh, camera, poses, rc.Task(**task), lamps=adding_lamps())


@pytest.mark.parametrize(
    "task", [{"min_illuminance": 3}, {"max_illuminance": 3}, {"max_highlight_deg": "satin"}]
)
def test_thresholds_of_light_without_lamps_are_refused(task):
    for call in (rc.regions, rc.evaluate):
        with pytest.raises(
            ConfigError, match=r"expected lamps for m.*; give lamps, or leave it out"
        ):
            call(sheet(), CAMERA, ABOVE, rc.Task(**task))
    rig = rc.Rig([CAMERA], tasks={"camera 1": task})
    with pytest.raises(ConfigError, match=r"expected no m.* of 'camera 1'"):
        rc.regions(sheet(), rig, ABOVE)


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ({"min_illuminance": "bright"}, "min_illuminance to be a number, lx or W/m2"),
        ({"min_illuminance": 5, "max_illuminance": 5}, "above min_illuminance 5, got 5"),
        ({"max_highlight_deg": "shiny"}, "degrees, or one of matt, satin, polished"),
        ({"min_illuminance": -1}, "min_illuminance to be 0 or more"),
    ],
)
def test_wrong_thresholds_of_light_are_refused_in_one_line(task, words):
    with pytest.raises(ConfigError, match=words):
        rc.Task(**task)


def test_a_map_of_illuminance_has_the_thresholds_as_its_borders():
    mesh, camera, _ = room()
    lamps = adding_lamps()
    task = rc.Task(min_illuminance=2.0, max_illuminance=8.0)
    light, *limits = values_of(mesh, with_equipment(camera, {"lamps": lamps}, mesh), task)["lux"]
    assert limits == ["lx", 2.0, 8.0]
    of_points = points_of(lamps, np.ones(3, bool))
    face = np.arange(mesh.n_faces)
    sees = reached(mesh, of_points, lamps.eyes, mesh.centroids, face)[0]
    truth = illuminances(lamps, of_points, sees, mesh.centroids, mesh.normals)
    assert light == pytest.approx(truth)
    assert values_of(mesh, camera, rc.Task()) == {}
    painted = MODES["lux"].paint(mesh, OfLight(light, "lx", 2.0, 8.0))
    shares = {entry["label"]: entry["percent"] for entry in painted.legend}
    areas = mesh.areas / mesh.areas.sum() * 100
    assert shares["below 2 lx"] == pytest.approx(areas[light < 2].sum())
    assert shares["above 8 lx"] == pytest.approx(areas[light > 8].sum())
    assert painted.scale["is_log"]
    assert painted.scale["unit"] == "lx"


def test_points_of_lamps_of_size():
    bar = rc.Lamp.bar(0.8, points=4, intensity=8).lamp_from_point
    assert bar[:, 0, 3] == pytest.approx([-0.3, -0.1, 0.1, 0.3])
    ring = rc.Lamp.ring(0.2, points=5, intensity=1).lamp_from_point
    assert np.linalg.norm(ring[:, :3, 3], axis=1) == pytest.approx([0.1] * 5)
    assert (ring[:, :3, :3] == np.eye(3)).all()
    dome = rc.Lamp.dome(0.4, points=20, intensity=1).lamp_from_point
    assert (dome[:, 2, 3] < 0).all()
    assert np.einsum("nij,j->ni", dome, [0, 0, 0.2, 1])[:, :3] == pytest.approx(0, abs=1e-12)
    area = rc.Lamp.area(0.4, 0.1, points=16, intensity=1)
    assert np.unique(area.lamp_from_point[:, 1, 3].round(9)).tolist() == [-0.025, 0.025]
    assert area.intensity_of_point == 1 / 16
    assert area.points_needed == 8


IES = """IESNA:LM-63-2002
[TEST] a narrow lamp
TILT=NONE
1 1000 2 6 1 1 2 0 0 0 1 1 50
0 15 30 45 60 80
0
400 380 240 100 30 0
"""


def test_a_luminaire_of_an_ies_file_lights_by_its_profile(tmp_path):
    (tmp_path / "lamp.ies").write_text(IES)
    (tmp_path / "lamps.toml").write_text('[lamps.a]\nies = "lamp.ies"\nposition = [0.5, 0.5, 1]\n')
    lamps = rc.load_lamps(tmp_path / "lamps.toml")
    lamp = lamps.lamps[0]
    assert lamp.intensity == 800
    assert lamp.half_angle_deg == 80
    at = np.cos(np.radians([0, 15, 30, 45, 60, 80]))
    wanted = [800, 760, 480, 200, 60, 0]
    assert intensities_of(lamp, at, at) == pytest.approx(wanted, abs=1e-9)
    eye = rc.look_at((0.5, 0.5, 5), (0.5, 0.5, 0), (0, 1, 0))
    points, face = points_on(sheet(), 4000)
    regions = rc.regions(sheet(), CAMERA, eye, rc.Task(min_illuminance=400), lamps=lamps)
    away = points - [0.5, 0.5, 1]
    d = np.linalg.norm(away, axis=1)
    truth = np.interp(np.degrees(np.arccos(1 / d)), [0, 15, 30, 45, 60, 80], wanted) / d**3 >= 400
    assert 0.2 < truth.mean() < 0.9
    assert (in_regions(regions, 0, points, face) != truth).sum() <= 2
    again = lamps_of_json(json.loads(json.dumps(lamps.to_json())))
    assert again.lamps == lamps.lamps


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("TILT=NONE", "TILT=INCLUDE"), "expected lamp geometry 1 to 3, angles and factors"),
        (("TILT=NONE", "TILT=a.tlt"), "expected TILT=NONE or INCLUDE, got TILT=a.tlt; copy"),
        (("TILT=NONE", "KIPP"), "expected an IES LM-63 file, with a line TILT="),
        (("240", ""), "expected as many numbers as declared, got fewer or more, or words"),
        (("240", "x"), "expected numbers after its header, got words"),
        (("1 1000 2 6 1 1", "1 1000 2 6 1 4"), "expected photometric type 1, 2 or 3, got 4"),
        (("1 1000 2 6 1 1", "1 1000 2 6 1 2"), "expected angles of type A or B from -90 or 0"),
        (("400 380 240 100 30 0", "0 0 0 0 0 0"), "all zero"),
        (("0 15 30", "5 15 30"), "ascend from 0"),
        (("1 1000 2 6 1 1 2 0 0 0 1 1 50\n0 15 30 45 60 80\n0\n400 380 240 100 30 0",
          "1 1000 2 6 2 1 2 0 0 0 1 1 50\n0 15 30 45 60 80\n0 77\n4 4 4 4 4 0\n4 4 4 4 4 0"),
         "expected horizontal angles that ascend over 90, 180 or 360"),
        (("1 1000 2 6 1 1 2 0 0 0 1 1 50\n0 15 30 45 60 80\n0\n400 380 240 100 30 0",
          "1 1000 2 6 3 1 2 0 0 0 1 1 50\n0 15 30 45 60 80\n0 0 90\n" + 3 * "4 4 4 4 4 0\n"),
         "expected horizontal angles that ascend over 90, 180 or 360"),
        (("2 6 1 1", "2 inf 1 1"), "expected as many numbers as declared, got fewer or more"),
        (("1 1000 2", "1 1000 1e200"), r"0 or more, within 1e\+12"),
        (("400 380", "1.7e308 1.7e308"), r"0 or more, within 1e\+12"),
        (("0 15 30", "0 1e-9 30"), "each 0.001 degrees or more above the last"),
    ],
)  # fmt: skip
def test_ies_files_that_cannot_be_used_are_one_line(change, words, tmp_path):
    (tmp_path / "lamp.ies").write_text(IES.replace(*change))
    with pytest.raises(CameraError, match=words) as caught:
        rc.Lamp.from_ies(tmp_path / "lamp.ies")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "profile", [[(0, 1), (1e-9, 0), (90, 0)], [(0, 1), (90, 1e308)], [(0, 1)], [(1, 1), (2, 1)]]
)
def test_a_profile_made_by_hand_keeps_to_the_limits_of_those_of_files(profile):
    with pytest.raises(CameraError, match=r"profile to have shares from 0 to 1e\+12"):
        rc.Lamp(kind="spot", intensity=5, half_angle_deg=90, profile=profile)


GLTF = {
    "asset": {"version": "2.0"},
    "extensions": {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 40}, {"type": "spot", "spot": {"outerConeAngle": 0.5}},
    ]}},
    "nodes": [
        {"name": name, **more, "extensions": {"KHR_lights_punctual": {"light": row}}}
        for row, (name, more) in enumerate(
            [("a", {"translation": [1, 2, 3]}), ("b", {"scale": [2, 2, 2]})]
        )
    ],
}  # fmt: skip


def test_lights_of_a_scene_are_lamps(tmp_path):
    (tmp_path / "scene.gltf").write_text(json.dumps(GLTF))
    lamps = rc.load_lamps(tmp_path / "scene.gltf")
    assert [lamp.intensity for lamp in lamps.lamps] == [40, 1]
    assert lamps.places[0, :3, 3].tolist() == [1, 2, 3]
    assert lamps.places[1, :3, 2].tolist() == [0, 0, -1]
    assert lamps.lamps[1].half_angle_deg == pytest.approx(np.degrees(0.5))


@pytest.mark.parametrize(
    ("light", "words"),
    [
        ({"type": "area"}, "expected light 'a' to be of type point, spot or directional, got"),
        ({"type": "point", "intensity": 0}, "intensity of light 'a' to be positive"),
        ({"type": "spot", "spot": {"outerConeAngle": "wide"}}, "outerConeAngle of light 'a'"),
        ({"type": "spot", "spot": {"outerConeAngle": 9}}, "up to pi / 2, got 0 and 9"),
        ({"type": "spot", "spot": {"outerConeAngle": 0}}, "above 0, up to pi / 2, got 0 and 0"),
        ({"type": "spot", "spot": {"innerConeAngle": -0.1}}, "innerConeAngle from 0 to outerCone"),
        ({"type": "spot", "spot": {"innerConeAngle": 1}}, "got 1 and 0.785398"),
    ],
)
def test_lights_that_cannot_be_lamps_are_one_line(light, words, tmp_path):
    lights = {"KHR_lights_punctual": {"lights": [light, light]}}
    (tmp_path / "scene.gltf").write_text(json.dumps(GLTF | {"extensions": lights}))
    with pytest.raises(CameraError, match=words) as caught:
        rc.load_lamps(tmp_path / "scene.gltf")
    assert str(caught.value).isprintable()


def test_lamps_are_the_same_after_a_file_of_their_own():
    lamps = three_lamps()
    again = lamps_of_json(json.loads(json.dumps(lamps.to_json())))
    assert again.lamps == lamps.lamps
    assert np.array_equal(again.places, lamps.places)
    assert again.names == lamps.names


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rc.Lamp.point(intensity=0), "intensity of a lamp to be positive, got 0"),
        (
            lambda: rc.Lamp.point(),
            r"power_w_sr \(W/sr\) or range_m \(m\) of a lamp, got none",
        ),
        (lambda: rc.Lamp.point(intensity=1, power_w_sr=1), "one of them"),
        (lambda: rc.Lamp.spot(0, intensity=1), "expected half_angle_deg of a lamp above 0"),
        (
            lambda: rc.Lamp.area(1, points=49, intensity=1),
            "expected points of a lamp of kind area to be from 1 to 36, got 49",
        ),
        (lambda: rc.Lamp.bar(0, intensity=1), "expected size of a lamp of kind bar, its length in"),
        (lambda: rc.Lamp(kind="moon", intensity=1), "kind of a lamp to be point, spot"),
        (lambda: rc.Lamp(intensity=1, exponent=2), "up to 90"),
        (lambda: rc.Lamps([]), "1 to 64 points"),
        (
            lambda: rc.Lamps([rc.Lamp.point(intensity=1), rc.Lamp.point(power_w_sr=1)]),
            "lx and W/m2 do not add up",
        ),
        (lambda: rc.Lamps([rc.Lamp.point(intensity=1)], names=["a", "b"]), "1 distinct strings"),
        (
            lambda: lamps_of({"lamps": {"a": {"kind": "spot"}}}),
            "expected position, rig = true, or candidates in a plan, got none",
        ),
        (lambda: lamp_of({"kind": "ring", "intensity_cd": 1}), "ring, its diameter in metres, got"),
        (
            lambda: lamp_of({"kind": "bar", "size": [0.3, 0.1], "intensity_cd": 1}),
            r"bar, its length in metres, got \[0.3, 0.1\]",
        ),
        (
            lambda: lamp_of({"kind": "point", "size": 1.0, "intensity_cd": 1}),
            r"expected no size of kind point, got 1.0; remove it",
        ),
        (
            lambda: lamp_of({"size": [0.1, 0.2], "intensity_cd": 1}),
            r"expected no size of kind point, got \[0.1, 0.2\]; remove it",
        ),
        (
            lambda: lamp_of({"kind": "spot", "size": 0, "half_angle_deg": 30, "intensity_cd": 1}),
            r"expected no size of kind spot, got 0; remove it",
        ),
    ],
)
def test_wrong_lamps_are_refused_in_one_line(make, words):
    with pytest.raises((CameraError, PoseError), match=words) as caught:
        make()
    assert str(caught.value).isprintable()


def test_light_by_face_is_refused():
    lamps = rc.Lamps([rc.Lamp.point(intensity=1)], ABOVE)
    for options in ({"by": "face"}, {"method": "sampled"}):
        with pytest.raises(ConfigError, match=r"by area|whole faces"):
            rc.evaluate(sheet(), CAMERA, ABOVE, lamps=lamps, **options)
    with pytest.raises(CameraError, match="lamps to be Lamps"):
        rc.regions(sheet(), CAMERA, ABOVE, lamps=3)
    assert NAMES[UNLIT] == "unlit"
