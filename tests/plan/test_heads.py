"""Rigs with a rule from camera files and plans to reports: evaluate, place, check."""

import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import call, enter
from edited import Session
from nightly import amount
from plans import placed, told
from rich.console import Console

import rastercov as rc
from rastercov.base.errors import CameraError, ConfigError
from rastercov.base.format import area
from rastercov.core.area.cells import cells
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.rows import rule_reasons, with_rule
from rastercov.core.area.stages import CentrePass
from rastercov.core.camera.rig import names_of_poses, rig_of_json, rig_to_json, with_places
from rastercov.core.coverage.shards import EvaluationShards, Wanted, make, open_for
from rastercov.core.coverage.task import NAMES, Reason
from rastercov.formats.cameras.own import content_of
from rastercov.page.measurements import NetworkFigures
from rastercov.page.rig_state import RigState
from rastercov.page.scene import open_mesh
from rastercov.page.session import remove_head
from rastercov.placement import build_matrix
from rastercov.placement.mounts import Mounts
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.report import modes, overview
from rastercov.report import placement as placement_page
from rastercov.report import plan as plan_report
from rastercov.report.coverage import html_of, network_of, regions_of
from rastercov.report.modes import MODES, mode_picture
from rastercov.report.tables import summary_table
from rastercov.shards import Staff, silent

CAMERA = rc.Camera(width=96, height=72, fx=90, fy=90)
MESH = rc.shapes.icosahedron()
TASK = rc.Task(max_incidence_deg=75)
POSES = rc.sphere_of_poses((0, 0, 0), 4.0, 5)
PROJECTOR = {"max_incidence_deg": 55.0}
PLAN = {
    "meshes": [{"built_in": "icosahedron"}],
    "cameras": {"cam": {"width": 96, "height": 72, "fx": 90, "fy": 90}},
    "rigs": {
        "fringe": {
            "rule": "all",
            "cameras": [
                {"camera": "cam"},
                {"camera": "cam", "name": "proj", "translation": [0.5, 0, 0], "task": PROJECTOR},
            ],
        }
    },
    "task": {"max_incidence_deg": 75.0},
    "candidates": [{"generator": "on_sphere", "count": 12, "distances": [4.0]}],
    "selection": {"goal": "fewest_cameras", "coverage": 0.5},
    "outputs": {"page": False},
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)


def head(rule=None, **more):
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.5
    tasks = {"proj": rc.Task(**PROJECTOR)}
    return rc.Rig([CAMERA] * 2, ["cam", "proj"], places, rule=rule or rc.All(), tasks=tasks, **more)


def test_a_rig_is_evaluated_by_what_its_cameras_cover_together():
    rig = head()
    result = rc.evaluate(MESH, rig, rig.poses(POSES), TASK)
    parts = rc.regions(MESH, rig, rig.poses(POSES), TASK)
    union = rc.unite(parts)
    assert result.by == "area"
    assert np.allclose(result.covered.area, union.area, atol=1e-12)
    summary = result.summary()
    assert summary["poses"] == len(summary["per_pose"]) == 5
    assert [each["pose"] for each in summary["per_pose"]] == [0, 2, 4, 6, 8]
    share = parts.areas() / MESH.areas
    assert summary["per_pose"][0]["covered_faces"] == (share[0] >= 0.5).sum()
    assert summary["mean_best_coverage"] == pytest.approx(share.max(axis=0).mean(), abs=1e-9)


def test_what_is_missed_by_one_camera_alone_is_what_the_other_covers_besides():
    rig = head()
    summary = rc.evaluate(MESH, rig, rig.poses(POSES), TASK).summary()
    both = summary["covered_area"]["m2"]
    alone = {each["camera"]: each["covered_area"]["m2"] for each in summary["by_camera"]}
    missed = {each["device"]: each["missed"]["m2"] for each in summary["by_device"]}
    assert missed["proj"] == pytest.approx(alone["cam"] - both, abs=1e-9)
    assert missed["cam"] == pytest.approx(alone["proj"] - both, abs=1e-9)
    assert missed["proj"] > missed["cam"] >= 0
    assert {each["device"]: each["sees"]["m2"] for each in summary["by_device"]} == alone


def test_what_is_missed_by_one_of_three_is_by_the_rule_of_the_others():
    places = np.repeat(np.eye(4)[None], 3, axis=0)
    places[:, 0, 3] = (-0.5, 0.0, 0.5)
    rig = rc.Rig([CAMERA] * 3, list("apb"), places, rule=rc.AtLeast(2, needs=["p"]))
    summary = rc.evaluate(MESH, rig, rig.poses(POSES), TASK).summary()
    alone = {each["camera"]: each["covered_area"]["m2"] for each in summary["by_camera"]}
    missed = {each["device"]: each["missed"]["m2"] for each in summary["by_device"]}
    assert summary["covered_area"]["m2"] + missed["a"] == pytest.approx(alone["p"], abs=1e-9)
    either = rc.Rig([CAMERA] * 2, list("ab"), places[[0, 2]], rule=rc.AtLeast(1))
    without = rc.unite(rc.regions(MESH, either, either.poses(POSES), TASK)).area.sum()
    assert summary["covered_area"]["m2"] + missed["p"] == pytest.approx(without, abs=1e-9)


def test_dead_zones_name_the_camera_that_fails():
    rig = head()
    summary = rc.evaluate(MESH, rig, rig.poses(POSES[:1]), TASK).summary()
    zone = summary["dead_zones"][0]
    assert zone["device"] in ("cam", "proj")
    sheet = rc.Mesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)],
        [rc.Group("sheet", is_two_sided=True)],
    )  # fmt: skip
    eyes = [(0.5, 0.5, 2), (0.5, 0.5, -2)]
    apart = rc.look_at(eyes=eyes, targets=(0.5, 0.5, 0), up=(0, 1, 0))
    beside = rc.Rig([CAMERA] * 2, ["cam", "proj 2"], apart, rule=rc.All())
    summary = rc.evaluate(sheet, beside, beside.poses(np.eye(4))).summary()
    assert summary["covered_area"]["m2"] == 0
    [zone] = summary["dead_zones"]
    assert (zone["reason"], zone["area_m2"]) == ("back_facing", pytest.approx(1))


def test_the_change_of_a_head_that_cannot_meet_its_limit_is_that_of_the_advice():
    """It was "none is known" above advice on the baseline, distance or noise."""
    fringe = PLAN["rigs"]["fringe"] | {"max_uncertainty": "1 mm", "noise_px": 0.2}
    plan = PLAN | {"rigs": {"fringe": fringe}}
    rc.place(PLAN, out="out")
    _, change, *rest = rc.check(plan, "out/poses.json", min_coverage=0.5).first_lines()
    needs = change.removeprefix("best change known: half of a dead zone needs ")
    assert needs != change
    assert rest[-1].endswith(f": half of the zone needs {needs}")


def test_by_face_and_by_samples_rules_are_refused():
    rig = head()
    for given in ({"by": "face"}, {"method": "sampled"}):
        with pytest.raises(ConfigError):
            rc.evaluate(MESH, rig, rig.poses(POSES), TASK, **given)
    with pytest.raises(ConfigError, match="min_pixels applies to faces"):
        rc.evaluate(MESH, rig, rig.poses(POSES), rc.Task(min_pixels=4))


def test_batches_and_shards_keep_the_poses_of_a_rig_together(monkeypatch):
    rig, items = head(), []
    for size in (256, 3, 1):
        monkeypatch.setattr("rastercov.core.coverage.coverage.POSES_A_BATCH", size)
        items.append(rc.evaluate(MESH, rig, rig.poses(POSES), TASK).summary())
    for each in items[1:]:
        assert each["covered_area"]["m2"] == pytest.approx(items[0]["covered_area"]["m2"])
        assert each["per_pose"] == items[0]["per_pose"]


@pytest.mark.parametrize("rule", [rc.All(), rc.AtLeast(2, needs=["proj"]), rc.Any()])
def test_rules_and_thresholds_survive_a_file(rule):
    rig = head(rule)
    views = rc.Views(rig, rig.poses(POSES), images=[f"{row}" for row in range(10)])
    rc.write_views("rig.json", views)
    again = rc.read_views("rig.json").rig
    assert again.rule == (rc.AtLeast(2, needs=["proj"]) if rule.__class__ is rc.AtLeast else rule)
    assert again.gates == rig.gates
    assert again.tasks["proj"]["max_incidence_deg"] == 55
    regions = [rc.regions(MESH, each, rig.poses(POSES), TASK) for each in (rig, again)]
    assert np.array_equal(regions[0].xy, regions[1].xy)


@pytest.mark.parametrize(
    "entries",
    [
        {"rule": "both"},
        {"rule": "at_least"},
        {"rule": "all", "k": 2},
        {"rule": "at_least", "k": 9},
        {"rule": "all", "tasks": {"proj 2": {}}},
        {"rule": 3},
        {"rule": "at_least", "k": "2"},
    ],
)
def test_rules_of_a_file_that_cannot_be_are_refused_in_one_line(entries):
    views = rc.Views(head(), head().poses(POSES), images=[f"{row}" for row in range(10)])
    Path("rig.json").write_text(json.dumps(content_of(views) | {"k": 2, "needs": []} | entries))
    content = json.loads(Path("rig.json").read_text())
    for name in ("k", "needs"):
        if name not in entries:
            content.pop(name)
    Path("rig.json").write_text(json.dumps(content))
    with pytest.raises(CameraError) as error:
        rc.read_views("rig.json")
    assert "\n" not in str(error.value)


def test_pictures_and_the_page_name_the_device_of_each_zone(monkeypatch):
    hatches = []
    answer = overview.hatch_pixels

    def kept(pixels, hatch, *where):
        hatches.append(set(np.unique(hatch).tolist()))
        return answer(pixels, hatch, *where)

    monkeypatch.setattr(overview, "hatch_pixels", kept)
    rig = head()
    result = rc.evaluate(MESH, rig, rig.poses(POSES[:2]), TASK)
    said = result.summary()
    devices = overview.device_hatches(said["dead_zones"])
    of_zones = {f"{zone['device']} fails" for zone in said["dead_zones"] if "device" in zone}
    assert set(devices) == of_zones
    assert of_zones <= {"cam fails", "proj fails"}
    shown = network_of(result, said, "heads", regions_of(result))
    assert [shown.noun, *shown.names] == ["head", "head 1", "head 2"]
    drawn = shown.draw()
    assert {"overview", "zones"} <= drawn.keys()
    every = {0, *devices.values()}
    assert len(hatches) >= 4  # two sides of both
    assert all(one <= every for one in hatches)
    assert set().union(*hatches) == every
    page = html_of(result)
    for name in ("cam", "proj"):
        lost = next(each for each in said["by_device"] if each["device"] == name)
        assert re.search(
            rf">{name}</t[dh]>\s*<td[^>]*>{re.escape(area(lost['missed']['m2']))}<", page
        )
    view = shown.view
    assert view is not None
    assert "Failing sensor or lamp" in view


@pytest.mark.slow
def test_the_command_takes_poses_of_the_rig_and_reports_each_camera(capsys):
    rig = head()
    rc.write_views("rig.json", rc.Views(rig, rc.Poses.of(np.zeros((0, 4, 4)))))
    rc.write_poses("poses.json", POSES)
    code, out, err = call(
        capsys, "evaluate icosahedron -c rig.json -p poses.json -o out --max-incidence-deg 75"
    )
    assert code == 0, err
    assert "missed only by proj" in out
    summary = told("summary.json")
    assert summary["poses"] == 5
    assert Path("out", "report.html").exists()
    code, _, err = call(
        capsys, "evaluate icosahedron -c rig.json -p sphere:3 -o other --pictures 0"
    )
    assert code == 0, err
    code, _, err = call(capsys, "evaluate icosahedron -c rig.json -p sphere:3 --by face -o third")
    assert code != 0
    assert "got one by face; leave out" in err


def viewed(rig, mesh=MESH, poses=POSES):
    """Session of a viewer with a rig."""
    n = len(poses) * len(rig)
    views = rc.Views(rig, rig.poses(poses), images=[f"{row}" for row in range(n)])
    return Session(open_mesh(mesh, views, TASK, "heads"))


def test_the_page_colours_faces_by_the_device_that_fails():
    rig = head()
    session = viewed(rig)
    assert "device" in session.scene.modes
    figures = session.figures()
    reason, device, names = figures.failing
    by_face, is_measured = np.ones((len(POSES), MESH.n_faces), np.bool_), reason == Reason.COVERED
    for row, task in enumerate((TASK, rc.Task(**PROJECTOR))):
        poses = rig.poses(POSES).world_from_camera[row::2]
        by_face &= (
            rc.evaluate(MESH, CAMERA, poses, task, by="face", fields=("reason",)).reason
            == Reason.COVERED
        )
    assert is_measured.any()
    assert np.array_equal(is_measured, by_face.any(axis=0))
    assert names == rig.names
    painted = MODES["device"].paint(MESH, figures.values["device"]())
    assert {entry["label"] for entry in painted.legend} <= {
        "covered", "cam fails", "proj fails", "ray angle out of range",
    }  # fmt: skip
    face = int(np.flatnonzero(~is_measured & (device == 1))[0])
    said = session.why(face)
    assert "proj fails" in said["words"]
    assert [each["name"] for each in said["cameras"]] == [f"{row}" for row in range(10)]
    told, levels = remove_head(session.frame("device", {}))
    assert len(levels) == MESH.n_faces
    assert told["legend"] == painted.legend
    session.close()


def test_the_page_goes_by_the_angle_and_by_rigs_that_are_whole():
    session = viewed(head(rc.All(min_baseline_deg=60)))
    reason, device, _ = session.figures().failing
    assert NAMES[reason.max()] == "baseline"
    assert (device[reason == reason.max()] == -1).all()
    session.close()
    session = viewed(head(), poses=POSES[:1])
    state = session.state
    rest = replace(state, stations=(state.stations[0], *state.stations[2:]))
    assert NetworkFigures(MESH, rest, session.measurements.rows(rest, rest.on)).failing[2] == ()
    session.close()


def test_the_page_of_cameras_without_a_rule_has_no_devices():
    session = viewed(head(rc.Any()))
    assert "device" not in session.scene.modes
    session.close()


def test_a_network_by_face_refuses_a_rule():
    network = rc.Network(MESH, TASK)
    with rc.open_observer(MESH, head()) as observer, pytest.raises(ConfigError, match="by area"):
        list(network.judge(observer, head().poses(POSES)))


def test_shards_of_a_long_run_give_the_same(monkeypatch, tmp_path):
    rig = head()
    poses = rig.poses(POSES)
    summary = rc.evaluate(MESH, rig, poses, TASK).summary()
    monkeypatch.setattr("rastercov.core.coverage.shards.PAIRS_A_SHARD", 5 * MESH.n_faces)
    wanted = Wanted(rc.Engine(), by_area=True, apart=True)
    with open_for(MESH, rig, TASK, wanted) as observer:
        shards = EvaluationShards(tmp_path, observer, poses, TASK, wanted)
        assert shards.store.poses_a_shard == 4
        network, areas = rc.Network(MESH, TASK), AreaNetwork(MESH, TASK)
        for batch in shards.parts(Staff()):
            network.add(batch)
            areas.add(with_rule(batch.regions, rig, batch.poses))
        folder = next(path for path in tmp_path.iterdir() if path.is_dir())
        again = make(folder, 0, np.arange(4))
    assert areas.summary()["m2"] == pytest.approx(summary["covered_area"]["m2"])
    assert network.covered_faces == [each["covered_faces"] for each in summary["per_pose"]]
    assert again == (folder / shards.store.name(0)).read_bytes()


def test_a_mount_with_a_rule_has_one_row_of_what_its_cameras_cover_together():
    own = cells(MESH, 0.4)
    rig = head()
    mounts = Mounts.of({"fringe": rig, "lone": CAMERA})
    placed = rc.Poses.of(POSES, camera=[0, 1, 0, 0, 1])
    matrix = build_matrix((MESH, mounts.rig), placed, TASK, cells=own, mounts=mounts)
    for row in range(5):
        part = POSES[row : row + 1]
        regions = rc.regions(MESH, CAMERA, part, TASK)
        if placed.camera[row] == 0:
            regions = rc.regions(MESH, rig, rig.poses(part), TASK)
        shares = own.share(regions)
        pairs = slice(*matrix.indptr[row : row + 2])
        assert matrix.face[pairs].tolist() == shares.cell.tolist()
        assert np.allclose(matrix.coverage[pairs], shares.share)
    assert not matrix.on_rig.any()


def test_centres_are_covered_by_the_rule():
    own, rig = cells(MESH, 0.4), head()
    placed = rig.poses(POSES)
    together = CentrePass(own, rig, TASK).find(placed)
    tasks = (TASK, rc.Task(**PROJECTOR))
    each = [
        CentrePass(own, CAMERA, task).find(placed.world_from_camera[row::2])
        for row, task in enumerate(tasks)
    ]
    for row in range(5):
        both = np.intersect1d(each[0].row(row), each[1].row(row))
        assert together.row(row).tolist() == both.tolist()


@pytest.mark.slow
def test_a_plan_places_a_head_and_a_check_finds_the_same():
    plan = PLAN | {"selection": PLAN["selection"] | {"refine": True, "refine_budget": 60}}
    placement = placed(plan)
    assert placement.is_met
    content = told()
    names = [each["camera"] for each in content["cameras"]]
    assert names == ["fringe/cam", "fringe/proj"] * len(content["cameras"][::2])
    missed = content["network"]["by_device"]
    assert [each["device"] for each in missed] == ["fringe/cam", "fringe/proj"]
    assert all(zone["device"] in names for zone in content["dead_zones"])
    checked = rc.check(PLAN, "out/poses.json", min_coverage=0.5)
    assert checked.is_met
    assert checked.whole.share == pytest.approx(content["share"], abs=1e-12)
    rig = head()
    mounted = np.array(json.loads(Path("out/poses.json").read_text())["world_from_camera"])[::2]
    exact = rc.unite(rc.regions(placement.prepared.mesh, rig, rig.poses(mounted), TASK)).share()
    assert content["share"] == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize(
    ("rig", "words"),
    [
        ({"rule": "both"}, "rule"),
        ({"rule": "at_least"}, "expected k, a number of sensors"),
        ({"rule": "all", "k": 2}, "k and needs"),
        ({"rule": "at_least", "k": 3}, "1 to 2"),
        ({"rule": "at_least", "k": 2, "needs": ["proj 2"]}, "some of"),
        ({"cameras": PLAN["rigs"]["fringe"]["cameras"][:1]}, "2 to 64"),
    ],
)
def test_rules_of_a_plan_that_cannot_be_are_refused(rig, words):
    plan = PLAN | {"rigs": {"fringe": PLAN["rigs"]["fringe"] | rig}}
    with pytest.raises(ConfigError, match=words):
        placed(plan)


def test_an_audit_of_a_rig_with_a_rule_is_refused():
    with pytest.raises(ConfigError, match="images of single cameras"):
        rc.audit(MESH, head(), head().poses(POSES), TASK)


def test_a_plan_by_face_with_a_rule_is_refused():
    for task in ({"by": "face"}, {"min_pixels": 3.0}, {"weight_by": "count"}):
        with pytest.raises(ConfigError):
            placed(PLAN, task=task)


def test_reasons_of_a_rig_are_those_of_the_camera_that_is_missed_most():
    reasons = np.array([[8, 8, 2, 1], [8, 6, 6, 8]], np.uint8)
    poses, points = head().poses(POSES[:1]), np.zeros((4, 3))
    normals = np.repeat(poses.world_from_camera[:1, :3, 3], 4, axis=0)
    (result,), (pose,) = rule_reasons(reasons, head(), poses, points, normals)
    names = ["covered", "occluded", "occluded+outside", "back_facing"]
    assert [NAMES[each] for each in result] == names
    assert pose.tolist() == [-1, 1, 0, 0]


CELL = rc.look_at([(2.5, 1.5, 3.0)], (0, 0, 0))[0]


def cell(**more):
    """A camera that moves, and a projector of the cell."""
    tasks = {"proj": rc.Task(**PROJECTOR)}
    places = np.stack((np.eye(4), CELL))
    return rc.Rig(
        [CAMERA] * 2, ["cam", "proj"], places, rule=rc.All(), tasks=tasks, fixed=["proj"], **more
    )


def test_a_fixed_camera_stays_and_is_solved_once(monkeypatch):
    rig, solved = cell(), []
    poses = rig.poses(POSES)
    assert np.array_equal(poses.world_from_camera[1::2], np.repeat(CELL[None], len(POSES), axis=0))
    moving = head()  # without a word of what is fixed, the same poses are solved one by one
    assert np.array_equal(poses.world_from_camera[::2], POSES)
    run = RegionPass._run

    def runs(self, poses, seen, find):
        def counted(placed, figures):
            solved.extend(placed.camera[placed.rows].tolist())
            return find(placed, figures)

        return run(self, poses, seen, counted)

    monkeypatch.setattr(RegionPass, "_run", runs)
    once = rc.regions(MESH, rig, poses, TASK)
    assert sorted(solved) == [0] * len(POSES) + [1]
    each = rc.regions(MESH, moving, poses, TASK)
    assert len(solved) == 3 * len(POSES) + 1
    for name in ("xy", "starts", "face", "pose", "area", "bound", "pair_face"):
        assert np.array_equal(getattr(once, name), getattr(each, name)), name
    summaries = [
        rc.evaluate(MESH, own, poses, TASK, fields=("visibility",)) for own in (rig, moving)
    ]
    a, b = (one.summary() for one in summaries)
    for zone in (*a["dead_zones"], *b["dead_zones"]):
        del zone["advice"], zone["tried"]  # a fixed camera does not move with the rig
    for name in ("covered_area", "per_pose", "by_device", "by_camera", "dead_zones"):
        assert a[name] == b[name], name
    assert np.array_equal(*(one.visibility for one in summaries))


def test_a_fixed_camera_survives_files_and_plans():
    rig = cell()
    rc.write_views("rig.json", rc.Views(rig, rc.Poses.of(np.zeros((0, 4, 4)))))
    again = rc.read_views("rig.json").rig
    assert again.fixed == ("proj",)
    assert np.allclose(again.poses(POSES).world_from_camera, rig.poses(POSES).world_from_camera)
    cameras = [
        {"camera": "cam"},
        {"camera": "cam", "name": "proj", "fixed": True, "translation": [2.5, 1.5, 3.0],
         "target": [0, 0, 0], "task": PROJECTOR},
    ]  # fmt: skip
    plan = plan_of(
        PLAN | {"rigs": {"cell": {"rule": "all", "cameras": cameras}}}, Path("plan.toml")
    )
    assert plan.rig.fixed == ("cell/proj",)
    mounted = rc.Poses.of(POSES, camera=[1] * len(POSES))
    placed, _ = plan.mounts.cameras(mounted)
    assert np.allclose(placed.world_from_camera, rig.poses(POSES).world_from_camera)
    shared = rig_of_json([CAMERA] * 3, json.loads(json.dumps(rig_to_json(plan.rig))))
    assert with_places(shared, plan.rig.rig_from_camera).fixed == plan.rig.fixed


@pytest.mark.parametrize(
    ("fixed", "words"),
    [
        (["proj 2"], "some of the cameras"),
        (["cam", "proj"], "not all"),
        ("cam", "names"),
        (3, "fixed"),
    ],
)
def test_what_cannot_be_fixed_is_one_line(fixed, words):
    with pytest.raises(CameraError, match=words) as error:
        rc.Rig([CAMERA] * 2, ["cam", "proj"], fixed=fixed)
    assert "\n" not in str(error.value)


def test_a_target_of_a_camera_that_moves_is_refused():
    cameras = [{"camera": "cam"}, {"camera": "cam", "name": "b", "target": [0, 0, 0]}]
    with pytest.raises(ConfigError, match="expected target of a fixed camera"):
        placed(PLAN | {"rigs": {"fringe": {"rule": "all", "cameras": cameras}}})


@pytest.mark.slow
def test_a_plan_with_a_projector_of_the_cell_moves_the_camera_alone():
    cameras = [
        {"camera": "cam"},
        {"camera": "cam", "name": "proj", "fixed": True, "translation": [2.5, 1.5, 3.0],
         "target": [0, 0, 0]},
    ]  # fmt: skip
    selection = PLAN["selection"] | {"coverage": 0.25, "refine": True, "refine_budget": 40}
    placement = placed(
        PLAN | {"rigs": {"cell": {"rule": "all", "cameras": cameras}}}, selection=selection
    )
    assert placement.is_met
    poses = np.array(json.loads(Path("out/poses.json").read_text())["world_from_camera"])
    assert np.allclose(poses[1::2], CELL)
    assert not np.allclose(poses[::2], CELL)


def test_a_plan_limits_the_uncertainty_of_what_its_rigs_measure():
    rule = {"max_uncertainty": "300 mm", "noise_px": {"cam": 0.3, "proj": 0.5}, "stripes": ["proj"]}
    shares = []
    for limit in ("300 mm", "60 mm"):
        own = PLAN["rigs"]["fringe"] | rule | {"max_uncertainty": limit}
        placement = placed(
            PLAN | {"rigs": {"fringe": own}}, selection={"goal": "best_coverage", "cameras": 2}
        )
        (gate,) = placement.prepared.plan.rig.gates.values()
        assert gate.most_deviation == pytest.approx(float(limit.split()[0]) / 1000)
        assert (gate.noise, gate.stripes) == ((0.3 / 90, 0.5 / 90), (1,))
        shares.append(placement.cameras.share)
    assert shares[0] > shares[1]


@pytest.mark.parametrize("noise", amount([0.5], at_night=[0.5, 0.02]))
def test_a_limit_that_no_rig_meets_is_named_with_the_best_value_and_what_would_help(noise):
    def result(limit, factor=1.0):
        own = {"max_uncertainty": limit, "noise_px": factor * noise, "stripes": ["proj"]}
        rigs = {"fringe": PLAN["rigs"]["fringe"] | own}
        return placed(PLAN | {"rigs": rigs})

    first = result(1e-3 * noise)
    (line,) = [each for each in first.prepared.notes if each.startswith("rig fringe: uncertainty")]
    words = r"uncertainty ([\d.]+) (m?m) at the best point \(median .*\), .*: .*"
    words += r"noise ([\d.]+) times as large"
    assert first.leftover.summary()["could_be_covered"]["faces"] == 0  # single cameras do
    assert first.prepared.bounds.covering.any()
    value, unit, factor = re.search(words, line).groups()
    best = float(value) * (1e-3 if unit == "mm" else 1.0)
    assert result(1.3 * best).cameras.share > 0
    assert result(0.9 * best).cameras.share == 0
    assert result(1e-3 * noise, 0.7 * float(factor)).cameras.share > 0
    checked = rc.check(first.prepared.plan, first.prepared.measured, min_coverage=0.5)
    assert f"  {line}" in checked.lines()
    nearest = checked.summary()["dead_zones"][0]["nearest"]["pose"]
    assert f"advice: head {nearest // 2 + 1} comes" in "\n".join(checked.first_lines())


def test_a_plan_in_which_no_rig_meets_a_limit_has_a_page_without_cameras():
    own = PLAN["rigs"]["fringe"] | {"max_uncertainty": 1e-9, "noise_px": 0.5}
    placement = placed(PLAN | {"rigs": {"fringe": own}}, outputs={"page": True})
    assert not len(placement.cameras.placed)
    assert (
        len([x for x in placement.prepared.notes if x.endswith("; no camera is chosen by them")])
        == 1
    )
    page = Path("out/page.html").read_text()
    assert "too uncertain" in page
    assert "0 heads cover 0 % of the area" in page
    (limit,) = (each for each in placement.prepared.notes if each.startswith("rig fringe: unc"))
    verdict = page[page.index('<div class="verdict') :].partition("</div>")[0]
    assert limit.partition(":")[2].strip() in verdict.replace("&#39;", "'")
    # The camera alone would cover a zone from many of the places, and is no candidate.
    zones = told()["dead_zones"]
    assert not any(each["tried"] for each in zones)
    # Zones have the reason of the candidates, and what the best of these misses.
    best = [each for each in zones if each["reason"] == "uncertain"]
    assert best
    assert {each["reason"].split("+")[0] for each in zones} <= {"uncertain", "back_facing"}
    values = r"uncertainty [\d.]+ m?m at the best point \(median [\d.]+ m?m\), "
    assert all(re.search(values, each["advice"]) for each in best)
    assert not any("no position" in each["advice"] for each in zones)


def test_a_baseline_that_is_too_short_is_named():
    rigs = {"fringe": PLAN["rigs"]["fringe"] | {"min_baseline_deg": 25.0}}
    (line,) = [each for each in placed(PLAN | {"rigs": rigs}).prepared.notes if "baseline" in each]
    angle, metres = re.search(
        r"at most ([\d.]+) degrees apart.*a baseline of ([\d.]+) m instead of", line
    ).groups()
    assert 5 < float(angle) < 25
    cameras = [dict(each) for each in PLAN["rigs"]["fringe"]["cameras"]]
    cameras[1]["translation"] = [1.2 * float(metres), 0, 0]
    wider = {"fringe": rigs["fringe"] | {"cameras": cameras}}
    assert placed(PLAN | {"rigs": wider}).cameras.share > 0


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"max_uncertainty": "5 parsec", "noise_px": 1}, "m, mm or um"),
        ({"max_uncertainty": 1e-4}, "noise_px to be from 1e-06 to"),
        (
            {"max_uncertainty": 1e-4, "noise_px": 1, "stripes": ["cam", "proj"]},
            "expected a sensor without stripes",
        ),
        ({"rule": "any", "max_uncertainty": 1e-4, "noise_px": 1}, "max_uncertainty"),
        ({"min_baseline_deg": 1e-6}, "min_baseline_deg to be 0, or from 0.001 to 180 degrees"),
    ],
)
def test_uncertainties_that_cannot_be_are_refused_in_one_line(entries, words):
    plan = PLAN | {"rigs": {"fringe": PLAN["rigs"]["fringe"] | entries}}
    with pytest.raises(PlanError, match=words) as caught:
        plan_of(plan, Path("plan.toml")).rig  # noqa: B018 - it raises
    assert "\n" not in str(caught.value)


def test_several_rules_of_a_file_are_those_of_check():
    one = rc.Rig([CAMERA] * 2, ["left", "right"], rule=rc.All(min_baseline_deg=5))
    other = rc.Rig([CAMERA] * 2, ["eye", "laser"], rule=rc.AtLeast(2, needs=["laser"]))
    rig = rc.Rig.of_several([one, other], ["left", "right", "eye", "laser"])
    poses = rc.Poses.of(POSES[:4], camera=[0, 1, 2, 3])
    Path("rig.json").write_text(json.dumps(content_of(rc.Views(rig, poses, tuple("abcd")))))
    plan = {name: each for name, each in PLAN.items() if name not in ("cameras", "rigs")}
    shares = rc.check(plan, "rig.json", min_coverage=0.1).whole.share
    truth = rc.evaluate(MESH, rig, poses, TASK).areas.summary()
    alone = rc.evaluate(MESH, rig.cameras, poses, TASK).areas.summary()
    assert shares == pytest.approx(truth["percent"] / 100, abs=1e-9)
    assert shares < alone["percent"] / 100 - 0.01


def test_an_uncertainty_with_installation_errors_is_refused_before_any_work(monkeypatch):
    def works(*_):
        raise AssertionError("it was measured first")

    monkeypatch.setattr("rastercov.placement.plan.check._check_rig", works)
    own = PLAN["rigs"]["fringe"] | {"max_uncertainty": "1 mm", "noise_px": 0.5}
    with pytest.raises(ConfigError, match="expected no max_uncertainty with installation errors"):
        rc.check(PLAN | {"rigs": {"fringe": own}}, POSES, min_coverage=0.1, tolerance="1 mm")


def test_heads_that_are_placed_are_counted_and_named_as_heads():
    """A page has a row, a colour and a caption a head, whose covered area grows to that of all."""
    result = rc.place(PLAN)
    shown = placement_page.network_of(result, plan_report.summary(result))
    n = len(result.cameras.mounted)
    assert 2 * n == len(result.cameras.placed) > 2
    assert [shown.noun, *shown.labels] == ["head", *map(str, range(1, n + 1))]
    assert len(shown.seen_m2) == len(shown.lost_m2) == n
    assert max(shown.seen_m2) <= sum(shown.seen_m2) <= n * shown.task_m2
    assert shown._used == [1, 2]  # not the type of which no camera is placed by itself
    sensors = {f"{at} {name}" for at in shown.labels for name in ("fringe/cam", "fringe/proj")}
    best = {each.camera for each in shown._features()} - {""}
    assert best <= sensors, best
    assert best
    page = placement_page.pages_of(result, plan_report.summary(result), [], silent)["page.html"]
    assert f"{n} heads cover " in page
    assert f"{len(result.cameras.placed)} cameras" not in page


def test_every_door_counts_and_names_heads_and_signs_what_they_measure_together(capsys):
    """The sheet had the rows, and the area, of single sensors."""
    placement = placed(PLAN)
    out = "\n".join(plan_report.head_lines(placement))
    told_ = told()
    n = len({each["mount"] for each in told_["cameras"]})
    assert len(told_["cameras"]) == 2 * n > 2
    assert told_["network"]["heads"] == n
    assert out.splitlines()[0].endswith(f" of the area by {n} heads")
    console = Console(file=io.StringIO(), width=80)
    console.print(plan_report.cameras_table(placement), summary_table(told_["network"]))
    table, _, others = console.file.getvalue().partition("Covered by")
    assert others.startswith(f" {n} heads together")
    assert re.findall(r"^│ +(\d+) │ fringe +│", table, re.MULTILINE) == [*map(str, range(1, n + 1))]
    adds = re.findall(r"([\d.]+) % │ +([\d.]+) % │$", table, re.MULTILINE)
    assert sum(float(each) for each, _ in adds) == pytest.approx(float(adds[-1][1]), abs=0.1 * n)
    assert all(float(each) > 0 for each, _ in adds)
    out = rc.check(placement.prepared.plan, "out/poses.json", min_coverage=0.5).lines()[0]
    share = re.match(r"covered: (.*) % of the area by (\d+) heads$", out)
    assert int(share[2]) == n
    assert call(capsys, "sheet out --out s.svg")[0] == 0
    svg = Path("s.svg").read_text()
    texts = re.findall(r">([^<>]*)</text>", svg)
    assert [f"head {row}" for row in range(1, n + 1)] == [
        each for each in dict.fromkeys(texts) if re.fullmatch("head \\d+", each)
    ]
    assert not any(re.fullmatch("camera \\d+", each) for each in texts)
    assert texts.count("head") == 1
    assert {"fringe/cam", "fringe/proj"} <= set(texts)
    assert texts[texts.index("Covered") + 1] == f"{share[1]} % of the area"


def test_maps_leave_out_what_the_headline_leaves_out():
    """Faces that are covered in part counted as wholes."""
    own = {"max_uncertainty": 1.0, "noise_px": 0.5}
    rig = head(rc.All(**own))
    result = rc.evaluate(MESH, rig, rig.poses(POSES[:2]), TASK)
    shown = network_of(result, result.summary(), "heads", regions_of(result))
    percents = []
    add_frame = modes.add_frame

    def kept(pixels, title, keys):
        percents.extend(key.name for key in keys if key.name.startswith("not covered"))
        return add_frame(pixels, title, keys)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modes, "add_frame", kept)
        picture = shown.draw()["uncertainty"]
    missing = 100 - result.summary()["covered_area"]["percent"]
    assert percents == [f"not covered, {missing:.1f} %"]
    whole = mode_picture("uncertainty", MESH, shown.values["uncertainty"], POSES[:2])
    pixels = [np.asarray(each.convert("RGB")).astype(int) for each in (picture, whole)]
    red = [(each[..., 0] > 2 * each[..., 1:].max(axis=-1)).sum() for each in pixels]
    assert red[0] > red[1] > 0


def test_stations_of_the_page_are_named_by_their_heads_and_sensors():
    rig = head()
    stations = RigState.of(rig, rig.poses(POSES[:3])).stations
    own = [f"head {n}/{name}" for n in (1, 2, 3) for name in rig.names]
    assert [each.name for each in stations] == own
    given = tuple("abcdef")
    assert [each.name for each in RigState.of(rig, rig.poses(POSES[:3]), given).stations] == [
        *given
    ]
    poses = rig.poses(POSES[:3])[np.array([0, 2, 3])]  # a projector is missing
    names = [each.name for each in RigState.of(rig, poses).stations]
    assert names == list(names_of_poses(poses))


def test_errors_of_a_kind_of_camera_without_a_pose_are_refused():
    """A plan has the kind of a sensor beside the sensors: errors of it would be of nothing."""
    rig = plan_of(PLAN).rig
    own = rig._only(range(1, len(rig))).poses(POSES)
    poses = rc.Poses.of(own.world_from_camera, camera=own.camera + 1)
    for name in ("cam", "no such"):
        with pytest.raises(ConfigError, match=rf"a pose \(fringe/cam, fringe/proj\), .* '{name}'"):
            rc.check(PLAN, poses, min_coverage=0.1, tolerance=f"3 mm, {name} 50 mm")
    narrow = PLAN["rigs"]["fringe"] | {"max_baseline_deg": 40.0}
    plan, share = PLAN | {"rigs": {"fringe": narrow}}, []
    for words in ("3 mm", "3 mm, fringe/proj 50 mm"):
        share.append(rc.check(plan, poses, min_coverage=0.1, tolerance=words).assured.found.sure.m2)
    assert share[1] < share[0]


def test_other_cameras_by_name_keep_the_rule_of_a_head():
    views = rc.Views(head(), head().poses(POSES), [str(row) for row in range(10)])
    narrow = rc.Camera(width=96, height=72, fx=900, fy=900)
    given = rc.Views(rc.Rig([CAMERA, narrow], ["cam", "proj"]), rc.Poses.of(()))
    other = views.through(given, by_name=True)
    assert other.rig.rule == head().rule
    assert other.rig.tasks == head().tasks
    assert other.rig.cameras == (CAMERA, narrow)
    area = [
        rc.evaluate(MESH, each.rig, each.poses, TASK, fields=()).areas.summary()["m2"]
        for each in (views, other)
    ]
    assert area[1] < 0.2 * area[0]
    alone = rc.Views(rc.Rig([CAMERA], ["x"]), rc.Poses.of(()))
    with pytest.raises(CameraError, match="for each of a rig with a rule, 'cam', 'proj', got one"):
        views.through(alone)
    with pytest.raises(rc.PoseError, match="got camera 'proj'"):
        views.through(rc.Views(rc.Rig([CAMERA], ["cam"]), rc.Poses.of(())), by_name=True)


def test_what_poses_state_beside_cameras_is_not_lost_in_a_plan_with_cameras():
    """They would be criteria that nothing asks; without cameras in the plan they count."""
    own = PLAN["cameras"]["cam"]
    plain = PLAN | {"rigs": {}, "cameras": {"cam": own, "proj": own}}
    names = [str(row) for row in range(10)]
    views = rc.Views(head(), head().poses(POSES), names)
    alone = replace(views, rig=head(rc.Any()))
    lamps = rc.Lamps([rc.Lamp.spot(25, intensity=100)], POSES[:1])
    lit = rc.Rig([CAMERA] * 2, ["cam", "proj"])._with(equipment={"lamps": lamps})
    for given, word in (
        (views, "the rule"),
        (alone, "the thresholds"),
        (replace(views, rig=lit), "lamps"),
    ):
        with pytest.raises(rc.PoseError, match=rf"expected {word} of (cam|proj) in .*, got none"):
            rc.check(plain, given, min_coverage=0.1)
    bare = {key: value for key, value in plain.items() if key != "cameras"}
    assert rc.check(bare, views, min_coverage=0.1).plan.rig.gates == views.rig.gates
    without = rc.Views(rc.Rig([CAMERA] * 2, ["cam", "proj"]), views.poses, names)
    assert rc.check(plain, without, min_coverage=0.1).is_met


@pytest.mark.parametrize("name", ["rig.json", "rig.npy", "transforms.json", "rig.glb", "model"])
def test_a_file_that_cannot_hold_a_rule_says_so(name):
    views = rc.Views(head(), head().poses(POSES), [f"{row}.jpg" for row in range(10)])
    format = {"model": "colmap", "transforms.json": "nerfstudio"}.get(name)
    notes = rc.write_views(name, views, format=format)
    assert any("rule of the rig, thresholds" in note for note in notes) == (name != "rig.json")


def test_a_camera_of_a_file_in_a_plan_leaves_none_of_its_thresholds_there():
    rc.write_views("head.json", rc.Views(head(), rc.Poses.of(())))
    bare = {key: value for key, value in PLAN.items() if key not in ("cameras", "rigs")}
    own = {"cam": {"file": "head.json", "name": "cam"}}
    assert plan_of(bare | {"cameras": own}, Path("plan.toml")).rig.cameras == (CAMERA,)
    with pytest.raises(PlanError, match=r"head.json: expected a camera without thresholds"):
        plan_of(bare | {"camera": {"file": "head.json", "name": "proj"}}, Path("plan.toml"))
    rigs = {"fringe": {"file": "head.json"}}
    assert plan_of(bare | {"rigs": rigs}, Path("plan.toml")).rig.tasks.keys() == {"fringe/proj"}
