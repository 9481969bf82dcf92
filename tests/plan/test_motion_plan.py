"""Plans with bodies that move: cameras are chosen, checked and reported over time."""

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from commands import done, refusal
from scenes import joined
from timed import evaluate_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.cli.inputs import SceneOptions
from rastercov.cli.options import CameraOptions, EquipmentOptions
from rastercov.cli.view import open_scene
from rastercov.core.camera.conventions import Conventions
from rastercov.motion.plan_over_time import PlanMotion
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import name_scene
from rastercov.report.plan import lines

PART = rc.shapes.by_name("icosahedron")
PLATE = rc.shapes.box((2, 2, 0.02), centre=(-2, 0, 1.6))
BELT = {"body": "plate", "steps": 5, "direction": [1.0, 0.0, 0.0], "distance": 4.0}
PLAN = {
    "meshes": [{"path": "cell.obj", "groups": ["part"]}],
    "motion": {"conveyor": BELT},
    "camera": {"width": 320, "height": 240, "hfov_deg": 60.0},
    "task": {"over": 0.9, "max_incidence_deg": 75.0, "resolution_of_result": 0.3},
    "candidates": [{"generator": "on_sphere", "count": 12, "distances": [4.0]}],
    "selection": {"goal": "best_coverage", "cameras": 3},
    "outputs": {"page": False},
}


def obj(**parts):
    lines, first = [], 1
    for name, mesh in parts.items():
        lines += [f"o {name}", *(f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist())]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + first).tolist()]
        first += mesh.n_vertices
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def cell(folder):
    Path("cell.obj").write_text(obj(part=PART, plate=PLATE))


def changed(**sections):
    return PLAN | sections


def exact(placed, over=0.9):
    """Covered share of the chosen cameras, from the regions of the same motion."""
    mesh, plan, _ = name_scene(plan_of(PLAN))
    motion = PlanMotion.of(plan, mesh).motion
    result = evaluate_over_time(motion, plan.rig, placed, plan.build_task(), over)
    return result.share()


def test_cameras_are_chosen_for_what_they_see_long_enough():
    placement = rc.place(PLAN)
    assert placement.cameras.share == pytest.approx(exact(placement.cameras.placed))
    assert (np.diff(placement.cameras.curve) >= -1e-12).all()
    every = rc.place(changed(selection={"goal": "best_coverage", "cameras": 12}))
    assert 0 < placement.cameras.share <= every.cameras.share + 1e-9
    summary = placement.cameras.areas.over_time.summary()
    assert summary["frames"] == 5
    assert summary["covered"]["percent"] == pytest.approx(100 * placement.cameras.share)


def test_the_fewest_cameras_reach_a_share_of_what_all_see_long_enough():
    wanted = {"goal": "fewest_cameras", "coverage": 0.8, "of_reachable": True}
    placement = rc.place(changed(selection=wanted))
    every = placement.prepared.reachable
    assert placement.is_met
    assert placement.cameras.share >= 0.8 * every.over_time.share() - 1e-9
    n = len(placement.cameras.placed)
    assert placement.cameras.curve[n - 2] < 0.8 * every.over_time.share()
    assert len(placement.chosen) == n
    # All candidates are measured the same way as those that are chosen.
    all_of = exact(placement.prepared.measured)
    assert every.over_time.share() == pytest.approx(all_of, abs=1e-9)


def test_in_some_frame_cells_are_chosen_on_once():
    placement = rc.place(changed(task=PLAN["task"] | {"over": "some"}))
    assert placement.prepared.problem.bits.n_faces == len(placement.prepared.cells)
    always = rc.place(changed(task=PLAN["task"] | {"over": "all"}))
    assert always.prepared.problem.bits.n_faces == 5 * len(always.prepared.cells)
    assert always.cameras.share <= placement.cameras.share + 1e-9


@pytest.mark.parametrize(
    ("over", "views"), [("all", 1), (1.0, 2), (0.75, 1), (0.5, 1), (0.25, 1), ("some", 2)]
)
def test_no_set_of_candidates_beats_what_is_proved_over_time(over, views):
    """Candidates are chosen by the mean over frames: against all sets of them."""
    motion = rc.Motion(PART, {"mesh": rc.turntable(4)})
    eyes = 3 * np.random.default_rng(7).normal(size=(6, 3))
    poses = rc.look_at(eyes=3 * eyes / np.linalg.norm(eyes, axis=1)[:, None], targets=(0, 0, 0))
    np.save("eyes.npy", poses)
    Path("part.obj").write_text(obj(part=PART))
    plan = PLAN | {
        "meshes": [{"path": "part.obj"}],
        "motion": {"turntable": {"body": "part", "steps": 4}},
        "task": PLAN["task"] | {"over": over, "views": views},
        "candidates": [{"generator": "poses", "file": "eyes.npy"}],
    }
    task = rc.Task(max_incidence_deg=75, views=views)
    camera = rc.Camera.from_fov(320, 240, hfov_deg=60)
    shares = {
        n: max(
            evaluate_over_time(motion, camera, poses[list(some)], task, over).share()
            for some in combinations(range(6), n)
        )
        for n in range(1, 5)
    }
    for n, best in shares.items():
        placed = rc.place(plan | {"selection": {"goal": "best_coverage", "cameras": n}})
        selection = placed.selection
        assert selection.bound >= best - 1e-6
        assert selection.status == "feasible" or placed.cameras.share >= best - 1e-6
        assert any("on average over time" in line for line in lines(placed))
    for wanted in (0.3, 0.6, 0.8):
        asked = {"goal": "fewest_cameras", "coverage": wanted, "method": "integer"}
        placed = rc.place(plan | {"selection": asked})
        least = next((n for n, share in shares.items() if share >= wanted), 5)
        selection, n_placed = placed.selection, len(placed.cameras.placed)
        assert selection.bound <= min(least, n_placed)
        assert selection.status == "feasible" or (placed.is_met and n_placed == least)


def test_a_check_judges_what_is_seen_long_enough():
    placed = rc.place(PLAN).cameras
    check_result = rc.check(PLAN, placed.placed, min_coverage=placed.share - 1e-3)
    assert check_result.is_met
    assert not rc.check(PLAN, placed.placed, min_coverage=placed.share + 1e-3).is_met
    assert "over_time" in check_result.summary()
    assert any("of the time" in line for line in check_result.lines())


def test_a_camera_on_a_body_is_carried():
    camera = PLAN["camera"] | {"body": "plate"}
    mesh, plan, _ = name_scene(plan_of(changed(camera=camera)))
    own = PlanMotion.of(plan, mesh)
    pose = rc.look_at(eyes=[(0, 0, 5)], targets=(0, 0, 0), up=(0, 1, 0))
    result = own.areas(plan.rig, rc.Poses.of(pose), plan.build_task()).over_time
    by_hand = [
        rc.regions(own.motion.frame(row)[0], plan.rig, p[None], plan.build_task()).areas().sum()
        for row, p in enumerate(own.motion.poses_of("plate") @ pose[0])
    ]
    assert result.regions.areas().sum(axis=1) == pytest.approx(by_hand, abs=1e-8)


def test_rigs_are_mounts_over_time_too():
    wide = {"cameras": {"eye": PLAN["camera"]}}
    rig = {"pair": {"cameras": [{"camera": "eye"}, {
        "camera": "eye", "name": "other", "translation": [0.3, 0.0, 0.0]}]}}  # fmt: skip
    plan = {name: value for name, value in PLAN.items() if name != "camera"} | wide
    placement = rc.place(plan | {"rigs": rig, "selection": {"goal": "best_coverage", "cameras": 2}})
    assert len(placement.cameras.placed) == 4
    assert 0 < placement.cameras.share <= 1


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"motion": {}}, "expected a body that moves"),
        ({"motion": {"conveyor": BELT | {"body": "lid"}}}, "lid"),
        (
            {"motion": {"conveyor": BELT, "turntable": {"body": "plate", "steps": 5}}},
            "one motion of body",
        ),
        ({"motion": {"conveyor": BELT, "turntable": {"body": "part", "steps": 4}}}, "as many"),
        ({"motion": {"conveyor": BELT, "animation": ""}}, "one glTF file"),
        ({"motion": {"poses": "none.json"}}, "expected a file"),
        ({"camera": PLAN["camera"] | {"body": "lid"}}, "got 'lid'"),
        ({"task": PLAN["task"] | {"over": 0.0}}, "task.over"),
        ({"task": PLAN["task"] | {"over": "ever"}}, "task.over"),
        ({"task": {"over": 0.9, "by": "face"}}, "by area"),
        ({"task": {"over": 0.9, "min_pixels": 40.0}}, "by area"),
        ({"task": {"over": 0.9, "method": "sampled"}}, "by area"),
        ({"task": {"over": 0.9, "views": {"part": 2}}}, "one number"),
        ({"selection": PLAN["selection"] | {"refine": True}}, "expected none over time"),
        (
            {
                "task": {"over": 0.9, "views": 2},
                "selection": {"goal": "fewest_cameras", "coverage": 0.5, "of_reachable": True},
            },
            "one view",
        ),
        ({"candidates": [{"generator": "per_cavity"}]}, "expected a static scene for per_cavity"),
    ],
)
def test_plans_that_cannot_be_over_time_are_refused_in_one_line(sections, words):
    with pytest.raises((PlanError, ConfigError), match=words) as error:
        rc.place(changed(**sections))
    assert "\n" not in str(error.value)


def test_over_without_a_motion_is_refused():
    still = {name: value for name, value in PLAN.items() if name != "motion"}
    with pytest.raises(PlanError, match="expected a motion for"):
        rc.place(still)


TOML = """
over = 0.5
[[bodies]]
name = "cover"
groups = ["plate"]
[motion]
conveyor = { body = "cover", steps = 5, direction = [1, 0, 0], distance = 4 }
"""


def evaluated(motion, *more):
    Path("camera.toml").write_text("width = 320\nheight = 240\nhfov_deg = 60\n")
    words = "evaluate cell.obj --occluder plate -c camera.toml -p sphere:3 -o report --table none"
    return " ".join((words, "--motion", motion, *more))


def shown_words(page):
    """Text of a page, without styles, scripts and the page of the viewer in it."""
    page = re.sub(r"(?s)<(style|script)\b.*?</\1>|data-scene='[^']*'", "", page)
    return re.sub(r"(?s)<[^>]*>", " ", page)


@pytest.mark.slow
def test_the_command_evaluates_over_time_and_leaves_its_files(capsys):
    Path("m.toml").write_text(TOML)
    out, _ = done(capsys, evaluated("m.toml"))
    assert re.search(
        r"for at least 50 % of the time; 95.0 % at some time in 5 frames, .* in all 5", out
    )
    summary = json.loads(Path("report/summary.json").read_text())
    said = summary["over_time"]
    assert said["frames"] == 5
    assert summary["covered_area"]["percent"] == pytest.approx(said["covered"]["percent"])
    assert [each["percent"] for each in said["curve"]] == sorted(
        (each["percent"] for each in said["curve"]), reverse=True
    )
    import pyarrow.parquet as pq

    frames = pq.read_table("report/frames.parquet").to_pylist()
    assert [each["covered_m2"] for each in frames] == pytest.approx(
        [each["covered_m2"] for each in said["by_frame"]]
    )
    assert "of the area" in out
    assert "whole faces" not in out
    page = Path("report/report.html").read_text(encoding="utf-8")
    assert "Over time" in page
    assert "<polyline" in page
    words = shown_words(page)
    assert "of the area for at least 50 % of the time" in words
    assert "covers for at least 50 % of the time" in words
    assert "as a whole" not in words
    assert "Whole faces" not in words
    assert not set("{}") & set(words)
    for name in ("time.png", "frames.png", "view.html", "network.glb"):
        assert Path("report", name).stat().st_size > 0


@pytest.mark.parametrize(
    ("name", "text", "more", "words"),
    [
        ("m.toml", "over = 2\n[motion]\n", (), "over"),
        ("m.toml", "[motion]\nspin = 1\n", (), "got 'spin'"),
        ("m.toml", "[motion]\n", (), "expected a body that moves"),
        ("m.toml", "[motion\n", (), "TOML"),
        ("m.json", '{"bodies": {"plate": {}}, "times": [1, 0]}', (), "strictly increasing"),
        ("m.toml", TOML, ("--by", "face"), "by area"),
    ],
)
def test_motions_that_cannot_be_are_refused_by_the_command(name, text, more, words, capsys):
    Path(name).write_text(text)
    assert words in refusal(capsys, evaluated(name, *more))
    assert not Path("report").exists()


ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"
ROBOT = """
body = "arm/head"
[[bodies]]
name = "arm"
urdf = "arm.urdf"
base = { translation = [0, 0, 1.3] }
[motion]
joints = "path.csv"
"""
BENT = (0.6, 0.9, 1.0, 0.3, 0.2, 0.5)


def path_of(robot, steps=4, **columns):
    rows = np.linspace(robot.rest, BENT, steps)
    columns = dict(zip(robot.joint_names, rows.T, strict=True)) | columns
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in zip(*(
        np.asarray(each).tolist() for each in columns.values()), strict=True))]  # fmt: skip
    Path("path.csv").write_text("\n".join(lines))
    return rows


def robot_of_the_file(text=ROBOT):
    Path("arm.urdf").write_bytes(ARM.read_bytes())
    Path("m.toml").write_text(text)
    base = np.eye(4)
    base[2, 3] = 1.3
    return rc.Robot.load("arm.urdf", base=base, name="arm")


def by_hand(robot, row, mesh):
    """The part and the robot in a configuration, as one mesh, and the pose of its head."""
    frames = robot.frames(row)
    links = [
        rc.Mesh(shape.vertices @ frames[link][0, :3, :3].T + frames[link][0, :3, 3], shape.faces,
                groups=[rc.Group(f"arm/{link}", is_occluder=True)])
        for link, shape in robot.shapes.items()
    ]  # fmt: skip
    head = frames["head"][0] @ np.linalg.inv(robot.frames(robot.rest)["head"][0])
    return rc.Mesh.joined([mesh, *links]), head


@pytest.mark.parametrize("body", ["arm/head", "world"])
def test_a_robot_of_a_file_is_the_mesh_moved_by_hand(body):
    robot = robot_of_the_file(ROBOT.replace("arm/head", body))
    rows = path_of(robot, duration=[1, 1, 2, 1])
    mesh = rc.Mesh(PART.vertices, PART.faces)
    own = PlanMotion.read(Path("m.toml"), mesh)
    camera, task = rc.Camera.from_fov(320, 256, hfov_deg=50), rc.Task(max_incidence_deg=80)
    poses = rc.look_at([(0.3, -0.4, 4), (2.4, 1, 0.5)], (0, 0, 0.3))
    result = own.areas(camera, rc.Poses.of(poses), task).over_time
    areas, bounds = result.regions.areas(), result.regions.bounds()
    for frame, row in enumerate(rows):
        moved, head = by_hand(robot, row, mesh)
        placed = head @ poses if body == "arm/head" else poses
        still = rc.regions(moved, camera, placed, task)
        off = np.abs(areas[2 * frame : 2 * frame + 2] - still.areas())[:, : PART.n_faces]
        both = bounds[2 * frame : 2 * frame + 2] + still.bounds()
        assert (off <= both[:, : PART.n_faces] + 1e-12).all()
    assert own.motion.durations.tolist() == [1, 1, 2, 1]
    assert result.share() > 0.1
    alone = rc.regions(mesh, camera, poses, task).areas().sum()
    assert alone - areas[:2, : PART.n_faces].sum() > 1e-3  # the robot hides something


@pytest.mark.slow
def test_a_result_with_a_robot_is_read_again(capsys):
    robot = robot_of_the_file(ROBOT.replace("arm/head", "world"))
    path_of(robot)
    Path("camera.toml").write_text("width = 320\nheight = 240\nhfov_deg = 60\n")
    words = "evaluate cell.obj --occluder plate -c camera.toml -p sphere:3 --table none"
    done(capsys, f"{words} -o report --motion m.toml --pictures 0")
    summary = json.loads(Path("report/summary.json").read_text())
    assert summary["run"]["options"]["scene"]["motion"] == "m.toml"
    groups = [group["name"] for group in summary["run"]["scene"]["groups"]]
    assert "arm/head" in groups
    for given in ([Path("report")], [Path("report"), Path("cell.obj"), Path("m.toml")]):
        own = SceneOptions(), Conventions(), rc.Task(), CameraOptions(), None, EquipmentOptions()
        scene = open_scene(given, *own)
        assert [group.name for group in scene.mesh.groups] == groups
        assert len(scene.phases.motion) == 4
    Path("m.toml").rename("other.toml")
    line = refusal(capsys, "view report --no-browser")
    assert "expected mesh file m.toml of report" in line


OTHER = '[[bodies]]\nname = "b"\nurdf = "arm.urdf"\n[motion]'
SPOILT = {
    "m.toml: no.urdf": ("m.toml", "arm.urdf", "no.urdf", "no.urdf"),
    "no mesh": ("arm.urdf", '<box size="0.2 0.05 0.05"/>', '<mesh filename="a.stl"/>', "a.stl"),
    "cycle": ("arm.urdf", '<parent link="base"/>', '<parent link="head"/>', "expected no cycle"),
    "column": ("path.csv", "elbow", "knee", "columns pan, lift, elbow"),
    "time": ("path.csv", "3.0", "0.5", "times to be strictly increasing"),
    "two": ("m.toml", "[motion]", OTHER, "one body with joints, got 2"),
    "no body": ("m.toml", "arm/head", "arm/foot", "got 'arm/foot'"),
    "no robot": ("m.toml", 'urdf = "arm.urdf"', 'groups = ["plate"]', "urdf"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_robots_of_a_file_that_cannot_be_are_refused_by_the_command(name, capsys):
    path_of(robot_of_the_file(), time=[0.0, 1.0, 2.0, 3.0])
    path, old, new, words = SPOILT[name]
    text = Path(path).read_text()
    assert old in text
    Path(path).write_text(text.replace(old, new, 1))
    assert words in refusal(capsys, evaluated("m.toml", "--pictures 0"))
    assert not Path("report").exists()


def test_the_cell_is_the_part_and_the_plate():
    assert name_scene(plan_of(PLAN))[0].n_faces == joined(PART, PLATE).n_faces


@pytest.mark.slow
def test_pages_of_plans_show_the_figures_over_time(capsys):
    Path("plan.json").write_text(json.dumps(PLAN))
    placement = rc.place(PLAN | {"outputs": {"page": True}}, out="out")
    page = Path("out/page.html").read_text(encoding="utf-8")
    assert "<polyline" in page
    assert "camera with least coverage" in page
    assert "of the area for at least 90 % of the time" in shown_words(page)
    assert not set("{}") & set(shown_words(page))
    rc.check(PLAN, placement.cameras.placed, min_coverage=0.1, out="checked")
    assert "<polyline" in Path("checked/check.html").read_text(encoding="utf-8")
    summary = json.loads(Path("checked/check.json").read_text())["network"]["over_time"]
    assert summary["frames"] == 5
    assert summary["not_always"]


def test_shares_of_the_coverable_area_leave_out_what_is_hidden_in_every_frame():
    # The hood around the part moves away; the tub around the core never does.
    hood, tub = (rc.shapes.box((3, 3, 3), centre=(0, y, 0)) for y in (0, 10))
    core = rc.Mesh(PART.vertices + np.array([0, 10, 0]), PART.faces)
    Path("cell.obj").write_text(obj(part=PART, plate=hood, tub=tub, core=core))
    plan = changed(
        meshes=[{"path": "cell.obj", "groups": ["part", "core"]}],
        motion={"conveyor": BELT | {"distance": 40.0}},
        task={"over": "some", "weight_by": "seeable", "resolution_of_result": 0.3},
    )
    eye = rc.look_at([(0.1, 0.1, 6)], (0, 0, 0), up=(0, 1, 0))
    (whole,) = rc.check(plan, eye, min_coverage=0.2).requirements
    assert whole.of_m2 == pytest.approx(PART.areas.sum(), rel=2e-3)
    assert whole.share > 0.2
    wanted = {"goal": "fewest_cameras", "coverage": 0.4}
    (reached,) = rc.place(plan | {"selection": wanted}).requirements
    assert reached.of_m2 == pytest.approx(whole.of_m2)
    assert reached.share >= 0.4


def test_a_plan_whose_cameras_see_nothing_has_its_page():
    task = PLAN["task"] | {"min_pixel_density": "1000 px/mm"}
    placed = rc.place(changed(task=task, outputs={"page": True}), out="placed")
    assert placed.cameras.share == 0
    assert {each["worst_pose"] for each in placed.cameras.areas.over_time.table()} == {-1}
    assert Path("placed/page.html").exists()
