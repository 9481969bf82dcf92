"""Table of features: the best camera of each, by formulas of a pinhole, and its files."""

import csv
import json
import math

import numpy as np
import pytest
from commands import call, write_part
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.core.area.advice import focus_in_words
from rastercov.core.mesh import shapes
from rastercov.report.coverage import html_of, network_of
from rastercov.report.feature_table import FeatureRow, feature_rows, table_of

SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")


def box_of_sides(size):
    """A box about the origin whose sides are groups, each of four triangles."""
    box = shapes.box(size)
    normal = box.normals
    side = 2 * abs(normal).argmax(axis=1) + (normal.sum(axis=1) > 0)
    return rc.Mesh(
        box.vertices,
        box.faces,
        groups=[rc.Group(name) for name in SIDES],
        face_group=side.astype(np.int32),
    )


@examples(12, at_night=200)
@given(seed=st.integers(0, 10**6))
def test_figures_of_features_are_those_of_the_best_camera_by_formula(seed):
    rng = np.random.default_rng(seed)
    mesh = box_of_sides(tuple(rng.uniform(0.2, 1.0, 3)))
    low = rng.uniform(1.0, 4.0)
    high = low + rng.uniform(0.1, 3.0)
    camera = rc.Camera(width=320, height=240, fx=250, fy=260, focus_range=(low, high))
    ways = rng.normal(size=(5, 3))
    eyes = rng.uniform(1.5, 3.5, (5, 1)) * ways / np.linalg.norm(ways, axis=1)[:, None]
    poses = rc.look_at(eyes, rng.uniform(-0.1, 0.1, (5, 3)))
    result = rc.evaluate(mesh, camera, poses)
    names = [f"eye {row}" for row in range(5)]
    rows = feature_rows(mesh, camera, rc.Poses.of(poses), rc.Task(), names, result.summary())
    shares = [each.covered_percent for each in rows]
    assert shares == sorted(shares)
    assert {each.name for each in rows} == set(SIDES)
    for each in rows:
        of_group = np.flatnonzero(mesh.face_group == SIDES.index(each.name))
        assert each.area_m2 == pytest.approx(mesh.areas[of_group].sum())
        at, normal = mesh.centroids[of_group], mesh.normals[of_group[0]]
        best = []  # at either centroid: both are as near to the middle
        for point in at:
            local = np.einsum("pji,pj->pi", poses[:, :3, :3], point - poses[:, :3, 3])
            x, y, z = local.T
            is_in = (abs(250 * x / z) < 160) & (abs(260 * y / z) < 120) & (z > 0)
            front = (eyes - point) @ normal > 0
            slopes = np.zeros((5, 2, 3))
            slopes[:, 0, 0], slopes[:, 1, 1] = 250 / z, 260 / z
            slopes[:, 0, 2], slopes[:, 1, 2] = -250 * x / z**2, -260 * y / z**2
            on = (
                slopes
                @ poses[:, :3, :3].transpose(0, 2, 1)
                @ (np.eye(3) - np.outer(normal, normal))
            )
            density = np.linalg.svd(on, compute_uv=False)[:, 1]
            covers = is_in & front & (low <= z) & (z <= high)
            angle = np.degrees(np.arccos((eyes - point) @ normal / np.linalg.norm(local, axis=1)))
            row = int(np.where(covers, density, -1).argmax())
            if covers.any():
                best.append((names[row], density[row], angle[row], True))
            elif front.any():
                best.append(None)  # of those that fail, the nearest by their criterion
            else:
                best.append(("", 0.0, 90.0, None))
        own = each.camera, each.px_per_m, each.incidence_deg, each.in_focus
        assert None in best or any(
            one[0] == own[0] and one[3] == own[3] and one[1:3] == pytest.approx(own[1:3], rel=1e-6)
            for one in best
        )
        assert each.in_focus or each.missing


@pytest.mark.parametrize("focus", [(0.1378, 0.1382), (1.0, 1.0001), (0.2, 0.9), (2.0, math.inf)])
def test_a_range_in_focus_has_two_ends_that_differ(focus):
    ends = [float(end.split()[0]) for end in focus_in_words(focus).split(" to ")]
    assert len({*ends}) == (1 if math.isinf(focus[1]) else 2)
    assert ends == pytest.approx(focus[: len(ends)], rel=2e-3)


def test_the_page_has_rule_lamps_and_features(tmp_path):
    lamps = tmp_path / "lamps.toml"
    lamps.write_text('[lamps.key]\nkind = "point"\nintensity_cd = 9\nposition = [0, 0, 2]\n')
    camera = rc.Camera(width=320, height=240, fx=250, fy=260, focus_range=(0.5, 2.5))
    mesh, pose = box_of_sides((0.4, 0.4, 0.4)), rc.look_at([(0.3, 0.2, 1.5)], (0, 0, 0))
    result = rc.evaluate(mesh, camera, pose, rc.Task(min_illuminance="1 lx"), lamps=str(lamps))
    page = html_of(result)
    assert "It must be in focus, at a depth of 0.5 m to 2.5 m. Lamps: key (9 cd" in page
    assert "<h2>Features</h2>" in page
    rows = feature_rows(
        mesh, result.camera, result.poses, result.task, ["camera 1"], result.summary()
    )
    heads, cells = table_of(rows)
    assert heads[-2:] == ["in focus", "lit"]
    assert cells[-1][0] == "+z"
    assert cells[-1][-2:] == ["yes", "yes"]


def test_features_are_a_file_of_the_result(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_part("part.obj")
    line = "evaluate part.obj -c khepra -p sphere:6 --pictures 0 -o out --output features"
    assert call(capsys, line)[0] == 0
    rows = list(csv.DictReader((tmp_path / "out/features.csv").read_text().splitlines()))
    assert len(rows) == len({each["name"] for each in rows}) > 1
    shares = [float(each["covered_percent"]) for each in rows]
    assert shares == sorted(shares)
    code, out, _ = call(capsys, "evaluate part.obj -c khepra -p sphere:6 --pictures 1 -o o --json")
    assert code == 0
    told = json.loads(out)["features"]
    assert told == json.loads((tmp_path / "o/summary.json").read_text())["features"]
    cells = [{k: "" if v is None else str(v) for k, v in each.items()} for each in told]
    assert cells == rows


GOALS = """
[[meshes]]
path = "box.obj"
[camera]
width = 640
height = 480
hfov_deg = 60.0
[task]
max_incidence_deg = 60.0
[[candidates]]
generator = "on_sphere"
count = 8
distances = [3.0]
[selection]
goal = "fewest_cameras"
coverage = 0.3
[goals.top]
groups = ["{}"]
coverage = 0.5
"""


@pytest.mark.parametrize("goal", ["z_high", "x_low"])
def test_answers_of_plans_and_checks_have_all_features_those_of_goals_too(
    capsys, tmp_path, monkeypatch, goal
):
    """In JSON of place and check as on their pages, in one table, the least covered first."""
    monkeypatch.chdir(tmp_path)
    lines, n = [], 0
    box = box_of_sides((1.0, 1.2, 0.8))
    names = [f"{side[1]}_{'low' if side[0] == '-' else 'high'}" for side in SIDES]
    lines += [f"v {x} {y} {z}" for x, y, z in box.vertices]
    for row, name in enumerate(names):
        faces = box.faces[box.face_group == row] + 1
        lines += [f"g {name}", *(f"f {a} {b} {c}" for a, b, c in faces)]
        n += len(faces)
    (tmp_path / "box.obj").write_text("\n".join(lines))
    (tmp_path / "plan.toml").write_text(GOALS.replace("{}", goal))
    for line, page in (
        ("place plan.toml --out placed", "placed/page.html"),
        ("check plan.toml -p placed/poses.json --out checked", "checked/check.html"),
    ):
        code, out, err = call(capsys, f"{line} --json")
        assert code in (0, 1), err
        told = json.loads(out)["features"]
        file = "plan.json" if "place" in line.split()[0] else "check.json"
        assert json.loads((tmp_path / page).with_name(file).read_text())["features"] == told
        assert {each["name"] for each in told} == set(names)
        shares = [each["covered_percent"] for each in told]
        assert shares == sorted(shares)
        text = (tmp_path / page).read_text()
        assert text.count("<h2>Features</h2>") == 1
        assert "<h2>Parts</h2>" not in text
        table = text[text.index("<h2>Features</h2>") :]
        places = [table.index(f">{each['name']}</td>") for each in told]
        assert places == sorted(places)


@pytest.mark.parametrize("most", [1.0, 700.0, 1e3, 5e4])
def test_pixels_of_a_table_have_one_unit(most):
    densities = most * np.geomspace(1e-3, 1, 7)
    rows = [FeatureRow("a", 1.0, 50.0, "", "1", px, 10.0) for px in densities.tolist()]
    heads, cells = table_of(rows)
    texts = [row[heads.index("pixels")] for row in cells]
    assert len({text.partition(" ")[2] for text in texts}) == 1
    factor = 1e3 if texts[0].endswith("px/mm") else 1.0
    assert [factor * float(text.split()[0]) for text in texts] == pytest.approx(densities, rel=1e-2)


def test_what_must_not_be_seen_has_no_best_camera_and_targets_have_one_row(tmp_path, monkeypatch):
    """A private window was listed by what it lacks, and each target as a part and a feature."""
    monkeypatch.chdir(tmp_path)
    plan = {
        "meshes": [{"built_in": "box", "role": "occluder"}],
        "camera": {"width": 640, "height": 480, "hfov_deg": 60.0},
        "targets": [
            {"name": name, "above": "mesh", "height": height}
            for name, height in (("lobby", 0.2), ("desk", 0.4), ("private", 0.6))
        ],
        "candidates": [{"generator": "on_hemisphere", "count": 6, "distances": [3.0]}],
        "selection": {"goal": "fewest_cameras", "coverage": 0.3},
        "goals": {"private": {"groups": ["private"], "at_most": 0.9}},
        "task": {"resolution_of_result": 0.5},
    }
    rc.place(plan, out="out")
    told = json.loads((tmp_path / "out/plan.json").read_text())["features"]
    assert {each["name"] for each in told} == {"lobby", "desk"}
    text = (tmp_path / "out/page.html").read_text()
    table = text[text.index("<h2>Features</h2>") :]
    assert [table.count(f">{name}") for name in ("lobby", "desk")] == [1, 1]


def test_parts_and_their_features_are_one_table(tmp_path):
    """Parts, whose groups are CAD faces of several bodies, stand before their features."""
    parts = ("bolt", "nut", "plate")
    sizes = (0.4, 0.4, 0.4), (0.2, 0.2, 0.3), (0.3, 0.5, 0.4)
    boxes = [box_of_sides(s).moved(translation=(k, 0, 0)) for k, s in enumerate(sizes)]
    names = [f"{part}/face {k}" for part in parts for k in range(6)]
    mesh = rc.Mesh.joined(boxes, names)
    camera = rc.Camera.from_fov(640, 480, hfov_deg=70)
    result = rc.evaluate(mesh, camera, rc.look_at([(2, 2, 2), (-2, 1, 1)], (0.5, 0, 0)))
    text = html_of(result)
    table = text[text.index("<h2>Parts and features</h2>") :]
    at = {name: table.index(f">{name}</td>") for name in (*parts, *names)}
    assert max(at[part] for part in parts) < min(at[name] for name in names)
    assert text.count("<h2>Parts") == 1
    assert "<h2>Features</h2>" not in text


@pytest.mark.parametrize("tilt", [0, 30, 55, 75])
@pytest.mark.parametrize("name", ["min_facing_density", "min_pixel_density"])
def test_the_density_of_a_row_is_the_one_that_the_task_limits(name, tilt):
    """So what is covered at its middle never has fewer pixels than are asked for."""
    mesh = box_of_sides((0.02, 0.02, 0.02))
    angle = math.radians(tilt)
    eye = np.array([math.sin(angle), 0.0, math.cos(angle)])
    pose = rc.look_at([eye], (0, 0, 0.01))
    camera = rc.Camera(width=320, height=240, fx=250, fy=250)
    task = rc.Task(max_incidence_deg=85, **{name: 60.0})
    result = rc.evaluate(mesh, camera, pose, task)
    rows = feature_rows(mesh, camera, result.poses, task, ["camera 1"], result.summary())
    (top,) = (each for each in rows if each.name == "+z")
    ray = eye - (0, 0, 0.01)
    away = np.linalg.norm(ray)
    expected = 250 / away * (1 if name == "min_facing_density" else ray[2] / away)
    assert top.px_per_m == pytest.approx(expected, rel=0.02)
    assert top.px_per_m >= 60 or top.covered_percent == 0
    text = table_of(rows)[1][rows.index(top)][table_of(rows)[0].index("pixels")]
    assert text.endswith(" facing") == (name == "min_facing_density")


@pytest.mark.parametrize("intensity", [4, 4000])
def test_the_best_camera_of_a_feature_is_one_that_its_light_reaches(intensity):
    """The nearer camera has the most pixels, and its lamp is too weak or is not."""
    lamps = [rc.Lamp.ring(0.02, each, points=8) for each in (intensity, 4000)]
    names = ["near", "far"]
    eye = rc.Camera(width=320, height=240, fx=160, fy=160)
    rig = rc.Rig([eye, eye], names)
    lamps = rc.Lamps(lamps, [np.eye(4)] * 2, ["weak", "strong"], rides=names)
    pane = np.array([(0, 0, 0), (0.2, 0, 0), (0.2, 0, 0.2), (0, 0, 0.2)])
    parts = [rc.Mesh(pane + np.array((x, 0, 0)), [(0, 1, 2), (0, 2, 3)]) for x in (-0.1, 0.2)]
    poses = rc.look_at([(0.1, -1, 0.2), (0.1, -2, 0.4)], (0.1, 0, 0))
    task = rc.Task(min_illuminance=100)
    mesh = rc.Mesh.joined(parts, ["a", "b"])
    result = rc.evaluate(mesh, rig, rc.Poses.of(poses, camera=[0, 1]), task, lamps=lamps)
    rows = network_of(result, result.summary()).features
    assert len(rows) == 2
    for row in rows:
        assert row.lit
        assert row.camera == f"camera {1 if intensity > 100 else 2}"


def test_the_best_camera_has_most_of_the_density_that_counts_however_many_are_nearer():
    """Twenty oblique cameras are nearer than one in front; and one of two that are oblique."""
    plate = box_of_sides((0.2, 0.2, 0.002))
    camera = rc.Camera.from_fov(1280, 960, hfov_deg=40)
    turns, tilt = np.arange(20) * np.pi / 10, 1.3
    around = [(np.cos(a) * np.sin(tilt), np.sin(a) * np.sin(tilt), np.cos(tilt)) for a in turns]
    eyes = np.concatenate([1.9 * np.array(around), [(0, 0, 2.0)]])
    oblique = np.array([(0, 0, 2.0), (1.4 * np.sin(1.2), 0, 1.4 * np.cos(1.2))])
    for places, task, best in (
        (eyes, rc.Task(), "20"),
        (oblique, rc.Task(), "0"),
        (oblique, rc.Task(min_facing_density=500), "1"),
    ):
        poses = rc.look_at(places, (0, 0, 0))
        summary = rc.evaluate(plate, camera, poses, task).summary()
        names = [str(row) for row in range(len(places))]
        rows = feature_rows(plate, camera, rc.Poses.of(poses), task, names, summary)
        (top,) = [each for each in rows if each.name == "+z"]
        assert top.camera == best
        focal = camera.fx / np.linalg.norm(places, axis=1)
        assert top.px_per_m == pytest.approx(focal[int(best)], rel=0.05) or task != rc.Task()
