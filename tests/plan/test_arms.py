"""Plans with robots: cameras on an arm, and an arm that moves before cameras."""

import csv
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nightly import amount
from plans import told
from robots import seven_axes
from timed import over_time, regions_over_time
from tours import best_of

import rastercov as rc
from rastercov import placement
from rastercov.base.format import distance
from rastercov.core.area.remedies import TURN
from rastercov.page.scene import scene_of_place
from rastercov.placement.plan.entries import Table
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.report import overview, panorama
from rastercov.report.placement import _turns, change_of
from rastercov.report.plan import summary
from rastercov.robots import plan_arm as plan_arm
from rastercov.robots.collisions import SORTS
from rastercov.robots.kinematics import pose_error
from rastercov.robots.robot import FLOOR

ARM = Path(__file__).parents[2] / "examples" / "arm.urdf"
MOUNT = {"translation": [0, 0, 0.06]}
AROUND = {"generator": "on_hemisphere", "count": 12, "distances": [0.4]}
CANDIDATES = {
    "generator": "on_arm", "body": "arm/head", "mount": MOUNT, "of": AROUND, "clearance": 0.004,
    "rolls_deg": [0, 90],
}  # fmt: skip
PLAN = {
    "meshes": [
        {"built_in": "icosahedron", "transform": {"scale": 0.08, "translation": [0.5, 0.1, 0.2]}}
    ],
    "camera": {"width": 320, "height": 256, "hfov_deg": 40},
    "task": {"max_incidence_deg": 70, "resolution_of_result": 0.03},
    "bodies": [{"name": "arm", "urdf": "arm.urdf"}],
    "candidates": [CANDIDATES],
    "selection": {"goal": "best_coverage", "cameras": 2},
    "outputs": {"page": False},
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ARM, tmp_path / "arm.urdf")


def part():
    return rc.shapes.by_name("icosahedron").moved(scale=0.08, translation=(0.5, 0.1, 0.2))


CENTRE = np.array([0.5, 0.1, 0])
TIP = np.eye(4)
TIP[:3, 3] = MOUNT["translation"]


def poses_of(robot, joints, tip=TIP):
    return robot.frames(joints)["head"] @ tip


def areas_with_arm(robot, poses, joints, camera, task, **given):
    """Area of the part that each camera covers, in a scene of its own with the arm."""
    total = []
    for pose, angles in zip(poses, joints, strict=True):
        scene = rc.Mesh.joined([part(), rc.Robot.load(ARM, rest=angles, name="arm").mesh])
        regions = rc.regions(scene, camera, pose[None], task, **given)
        total.append(regions.area.sum())
        own = np.arange(scene.n_faces) < part().n_faces
        assert not len(regions._of_faces(~own).face)
    return total


def test_chosen_poses_have_joint_angles_that_lead_there():
    selection = PLAN["selection"] | {"refine": True, "refine_budget": 60}
    placed = rc.place(PLAN | {"selection": selection}, out="out")
    robot, written = rc.Robot.load(ARM), told("poses.json")
    joints = np.array(written["joints"])
    assert written["joint_names"] == list(robot.joint_names)
    ends = poses_of(robot, joints)
    assert np.abs(pose_error(ends, rc.read_poses("out/poses.json"))).max() <= 1e-6
    assert (joints >= robot.limits[:, 0]).all()
    assert (joints <= robot.limits[:, 1]).all()
    cell = rc.Collisions(robot, [part()])
    for of, word in (("scene", "clearance"), ("links", "link_clearance")):
        free = cell.clearance(joints, of=of)
        assert np.abs(free - written[f"{word}_m"]).max() <= 1e-9
        assert [[e.link, e.body] for e in cell.contacts(joints, of)] == written[f"{word}_pair"]
        assert free.min() >= (0.004 if of == "scene" else 1e-6)
    assert np.array_equal(robot.read_path("out/joints.csv").joints, joints[written["tour"]])
    assert sorted(written["tour"]) == [0, 1]
    assert told()["arm"]["tour"] == written["tour"]
    ways = np.abs(np.diff(np.concatenate([robot.rest[None], joints[written["tour"]]]), axis=0))
    assert written["tour_length"] == pytest.approx(ways.max(axis=1).sum())
    assert 0 <= written["wrist_flips"] <= 2
    assert placed.refined.share >= placed.refined.start_share
    assert all("hemisphere on arm" in each for each in written["origin"])
    assert rc.read_views("out/poses.json").notes == ()


def test_figures_are_those_of_scenes_with_the_arm():
    """A camera behind the plane of the head's front, beside it: the head is in its picture."""
    entry = CANDIDATES | {"mount": {"translation": [0, -0.04, 0.02]}}
    camera = {"width": 320, "height": 256, "hfov_deg": 90}
    plan = PLAN | {"candidates": [entry], "camera": camera}
    placed = rc.place(plan | {"selection": {"goal": "best_coverage", "cameras": 1}}, out="out")
    robot, written = rc.Robot.load(ARM), told("poses.json")
    pose, joints = rc.read_poses("out/poses.json"), np.array(written["joints"])
    task, seen = rc.Task(max_incidence_deg=70), rc.Camera.from_fov(320, 256, hfov_deg=90)
    alone = rc.regions(part(), seen, pose, task).area.sum()
    with_arm = areas_with_arm(robot, pose, joints, seen, task)[0]
    whole = part().areas.sum()
    assert abs(told()["share"] - with_arm / whole) <= 1e-5
    assert abs(written["hidden_by_arm_percent"][0] - 100 * (alone - with_arm) / whole) <= 1e-3
    assert placed.cameras.areas.covered.share() == pytest.approx(with_arm / whole, abs=1e-5)


def test_an_arm_that_hides_too_much_leads_to_other_candidates(monkeypatch):
    before = rc.place(PLAN, out="out")
    monkeypatch.setattr(plan_arm, "MOST_LOST", -1.0)  # whatever is chosen
    after = rc.place(PLAN, out="out")
    assert "arm" in after.steps
    (note,) = set(after.prepared.notes) - set(before.prepared.notes)
    assert note.startswith(f"the arm hides up to {after.carried.lost.max():.2f} % of the area")
    assert after.cameras.share >= before.cameras.share - 1e-12
    assert after.worth >= before.worth


def test_rigs_ride_on_the_arm():
    camera = {"width": 320, "height": 256, "hfov_deg": 40}
    rig = {"rule": "all", "cameras": [
        {"camera": "eye", "name": "left", "translation": [-0.04, 0, 0]},
        {"camera": "eye", "name": "right", "translation": [0.04, 0, 0]},
    ]}  # fmt: skip
    plan = {k: v for k, v in PLAN.items() if k != "camera"}
    plan |= {"cameras": {"eye": camera}, "rigs": {"head": rig}}
    rc.place(plan | {"candidates": [CANDIDATES | {"cameras": ["head"]}]}, out="out")
    written = told("poses.json")
    mounts = np.array([each["world_from_mount"] for each in written["mounts"]])
    ends = poses_of(rc.Robot.load(ARM), np.array(written["joints"]))
    assert np.abs(ends - mounts).max() <= 1e-6
    assert 0 < told()["share"] < 1


def test_a_part_is_to_be_turned_over_for_what_no_arm_sees_from_below():
    """Only for zones of its lower side that no tried position covers."""
    placed = rc.place(PLAN)
    middle, turned = part().centre[2], []
    for zone in summary(placed)["dead_zones"]:
        turned.append(TURN in zone["advice"])
        if turned[-1]:
            assert not zone["tried"]
            assert zone["centroid"][2] < middle
    assert any(turned)
    asked = PLAN | {"selection": {"goal": "fewest_cameras", "coverage": 0.999}}
    (line,) = change_of(rc.place(asked))
    assert TURN in line


def test_an_arm_keeps_what_it_reaches_without_a_collision():
    robot, mesh = rc.Robot.load(ARM), part()
    candidates = placement.on_sphere(mesh, rc.Camera.from_fov(320, 256, hfov_deg=40), count=40)
    arm = placement.Arm(robot, "head", mesh)
    kept = placement.on_arm(candidates, arm)
    assert 0 < len(kept) < 40
    reached = arm.reach(kept.poses)
    assert set(reached.pose) == set(range(len(kept)))
    assert (reached.clearance > 0).all()
    assert np.abs(pose_error(arm.poses(reached.joints), kept.poses[reached.pose])).max() <= 1e-6
    wall = placement.KeepOutBox(low=(0.2, -9, 0.3), high=(9, 9, 9), name="above")
    ball = placement.KeepOutSphere(centre=(0.25, 0, 0.4), radius=0.3, name="ball")
    for volume in (wall, ball):
        less = placement.on_arm(candidates, placement.Arm(robot, "head", mesh, keep_out=[volume]))
        assert len(less) < len(kept)


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_reason_why_an_arm_does_not_take_a_view_is_true(tmp_path, seed):
    """In random cells: a table, a press to keep out of, an arm of six or seven axes."""
    rng = np.random.default_rng(seed)
    (tmp_path / "seven.urdf").write_text(seven_axes())
    file, link = [(ARM, "head"), (tmp_path / "seven.urdf", "link_7")][seed % 2]
    table = rc.Mesh.joined([rc.shapes.box((0.5, 0.5, 0.5), 1, (0.6, 0, -0.3))], ["table"])
    ball = rc.Mesh.joined([rc.shapes.sphere(1, 0.12).moved(translation=(0.2, 0.2, 0.6))], ["ball"])
    low = rng.uniform((0.3, 0.1, 0.1), (0.5, 0.3, 0.3))
    press = placement.KeepOutBox(tuple(low.tolist()), tuple((low + 0.3).tolist()), "press")
    scene, robot = rc.Mesh.joined([table, ball]), rc.Robot.load(file)
    arm = placement.Arm(robot, link, scene, TIP, 0.02, [press])
    n = amount(30, at_night=60)
    eyes = rng.uniform((-0.9, -0.9, -0.2), (1.2, 0.9, 1.1), (n, 3))
    poses = rc.look_at(eyes, rng.uniform((0.4, -0.2, 0), (0.7, 0.2, 0.3), (n, 3)))
    reached = arm.reach(poses)
    missed = reached.missed
    assert set(missed) | set(reached.pose.tolist()) == set(range(n))
    assert not set(missed) & set(reached.pose.tolist())
    kinds = {each.reason for each in missed.values()}
    assert kinds >= {"out_of_reach", "collision"}
    for row, (reason, words, lack, unit) in missed.items():
        # From other starts than those of the arm.
        solved = robot.kinematics.solve(poses[row : row + 1], link, TIP, (64,), 9, 64)
        assert not arm.is_free(solved.joints).any(), (row, reason)
        assert (len(solved.pose) > 0) == (reason not in ("out_of_reach", "joint_limits"))
        if reason == "out_of_reach":
            assert np.isinf(solved.beyond).all()
        elif reason == "joint_limits":
            name = words.removesuffix(" beyond its limit")
            assert name in robot.joint_names
            assert unit == "deg"
            assert lack > 0
        elif reason == "clearance":
            assert 0 < lack <= 0.02
        else:
            is_kept_out = reason == "keep_out"
            own, _, body = words.partition(" in " if is_kept_out else " collides with ")
            assert own in robot.links
            assert (
                body == "keep-out volume press"
                if is_kept_out
                else body in {"table", "ball", *robot.links}
            )


def test_the_bodies_in_the_way_are_named_with_what_is_missing():
    """A head of 50 mm whose front is a known way in a table, or before it."""
    robot = rc.Robot.load(ARM)
    joints = np.array([0, 0.2, 1.2, 0.3, 0, 0])
    rest = robot.frames(joints)["head"][0]
    front = rest @ (0, 0, 0.05, 1)
    for way, side in ((0.013, 1), (-0.005, 1), (0.001, 4)):
        table = rc.shapes.box((side,) * 3, 1, (0, 0, side / 2)).vertices - (0, 0, way)
        box = rc.shapes.box((side,) * 3, 1)
        pose = rest.copy()
        pose[:3, 3] = front[:3]
        placed = rc.Mesh(table @ pose[:3, :3].T + pose[:3, 3], box.faces)
        scene = rc.Mesh.joined([placed, rc.shapes.sphere(1, 0.1).moved(translation=(3, 3, 3))],
                               ["table", "ball"])  # fmt: skip
        contacts = rc.Collisions(robot, [scene]).contacts(joints)[0]
        assert (contacts.link, contacts.body) == ("head", "table")
        assert contacts.depth == pytest.approx(max(way, 0), abs=1e-9)
        assert contacts.distance == pytest.approx(max(-way, 0), abs=1e-9)


@pytest.mark.parametrize("limit", [0.0, 0.01, 0.03])
def test_the_clearance_of_links_is_apart_from_that_of_the_scene(limit):
    """Upper arm and base of the arm are 15.2 mm apart, whatever its joint angles."""
    robot, mesh, scene_limit = rc.Robot.load(ARM), part(), 0.05
    poses = rc.look_at(eyes=[(0.4, -0.2, 0.5), (0.5, 0.1, 0.6), (0.3, 0.3, 0.5)], targets=CENTRE)
    arm = placement.Arm(robot, "head", mesh, TIP, scene_limit, link_clearance=limit)
    reached, cell = arm.reach(poses), rc.Collisions(robot, [mesh])
    if limit > 0.016:
        assert {each.reason for each in reached.missed.values()} == {"clearance"}
        for row, each in reached.missed.items():
            assert re.fullmatch(r"\w+ too close to \w+", each.words)
            assert 0 < each.lack <= limit, row
        return
    assert set(reached.pose) == {0, 1, 2}
    assert (cell.clearance(reached.joints, of="scene") >= scene_limit).all()
    assert (cell.clearance(reached.joints, of="links") > limit).all()
    both = np.minimum(*(cell.clearance(reached.joints, of=of) for of in ("scene", "links")))
    assert np.array_equal(cell.clearance(reached.joints), both)
    for of in ("scene", "links"):
        contacts = cell.contacts(reached.joints, of)
        assert (
            np.abs([e.distance for e in contacts] - cell.clearance(reached.joints, of=of)).max()
            == 0
        )
        assert all((each.body in robot.links) == (of == "links") for each in contacts)


def test_candidates_are_counted_by_the_reasons_of_the_arm():
    press = {"name": "press", "low": [0.55, -0.5, 0.0], "high": [1.2, 0.5, 0.9]}
    of = AROUND | {"generator": "on_sphere", "count": 18}
    entry = CANDIDATES | {"of": of}
    placed = rc.place(
        PLAN | {"candidates": [entry], "constraints": {"keep_out": [press]}}, out="out"
    )
    pool, written = placed.prepared.pool, told()["candidates"]
    n_refused = sum(each["views"] for each in written["why"])
    assert n_refused == sum(written["dropped"].values()) == len(pool.refused) > 0
    assert sum(written["made"].values()) == 36 == n_refused + sum(written["left"].values())
    assert {"out_of_reach", "keep_out"} <= set(written["dropped"])
    line = pool.lines()[0]
    assert line.startswith("36 candidates: ")
    assert line.endswith(f"; {36 - n_refused} remain")
    assert f"{written['dropped']['out_of_reach']} out of reach" in line
    assert "in keep-out volume press" in line


def test_rows_of_a_pose_file_in_reach_of_the_arm_are_named():
    rc.place(PLAN, out="out")
    reached = rc.read_poses("out/poses.json")
    assert "rows_left" not in told()["candidates"]
    rc.write_poses("views.npy", [rc.look_at((9, 0, 0), (0, 0, 0)).reshape(4, 4), reached[0]])
    rc.place(
        PLAN | {"candidates": [CANDIDATES | {"of": {"generator": "poses", "file": "views.npy"}}]},
        out="out",
    )
    assert told()["candidates"]["rows_left"] == [1]


def test_a_tour_goes_the_shorter_way_round_and_counts_wrist_flips():
    """The last joint of the arm has no limits; the two before it are of the wrist, too."""
    robot = rc.Robot.load(ARM)
    arm = placement.Arm(robot, "head", part())
    own = plan_arm.PlanArm(plan_of(PLAN), arm)
    angles = np.radians([[0] * 5 + [170], [0] * 5 + [-160], [0, 0, 0, 100, 0, 0], [10] * 6])
    before = robot.frames(angles)["head"]
    order, given, chosen = own._tour([each[None] for each in angles])
    assert np.array_equal(given, angles)
    assert chosen.tolist() == [0] * 4
    length, flips = own._walk(order, angles)
    assert np.abs(robot.frames(angles)["head"] - before).max() <= 1e-12
    ways = np.abs(np.diff(np.concatenate([robot.rest[None], angles[order]]), axis=0))
    assert length == pytest.approx(ways.max(axis=1).sum())
    assert abs(angles[1, 5] - angles[0, 5]) == pytest.approx(np.radians(30))
    assert flips == (ways[:, 3:] > np.pi / 2).any(axis=1).sum() > 0
    order, none, chosen = own._tour([])
    assert (len(order), none.shape, len(chosen)) == (0, (0, 6), 0)
    assert own._walk(order, none) == (0, 0)


@pytest.mark.parametrize("seed", range(amount(2, at_night=10)))
def test_the_tour_of_an_arm_takes_the_best_order_and_the_best_joint_angles(seed):
    """Against all orders and all joint angles, by sets of poses; of six axes that turn twice."""
    rng, turn = np.random.default_rng(seed), 2 * np.pi
    Path("arm.urdf").write_text(ARM.read_text().replace("3.1", "6.28"))
    robot = rc.Robot.load("arm.urdf")
    arm = placement.Arm(robot, "head", part(), TIP)
    eyes = np.add(CENTRE, (0, 0, 0.25)) + 0.35 * rng.normal(size=(9, 3)) * (1, 1, 0.3)
    poses = rc.look_at(eyes, np.add(CENTRE, (0, 0, 0.2)))
    reached = arm.reach(poses)
    options = [reached.joints[reached.pose == row] for row in np.unique(reached.pose)]
    own = plan_arm.PlanArm(plan_of(PLAN), arm)
    order, joints, chosen = own._tour(options)
    for given, option, row in zip(joints, options, chosen, strict=True):
        turns = (given - option[row]) / turn
        assert np.abs(turns - np.round(turns)).max() <= 1e-12
        assert (given >= robot.limits[:, 0] - 1e-12).all()
        assert (given <= robot.limits[:, 1] + 1e-12).all()
    length, _ = own._walk(order, joints)
    nodes = np.concatenate([robot.rest[None], *options])
    stop = np.repeat(np.arange(len(options)), list(map(len, options)))
    ways = nodes[:, None] - nodes[None]
    ways[..., 5] -= turn * np.round(ways[..., 5] / turn)  # without limits
    assert length <= 1.03 * best_of(np.abs(ways).max(axis=2), stop) + 1e-9


def test_the_tour_is_shorter_where_the_first_joint_angles_are_far_apart():
    selection = PLAN["selection"] | {"cameras": 5}
    rc.place(PLAN | {"selection": selection}, out="out")
    written, robot = told("poses.json"), rc.Robot.load(ARM)
    arm = placement.Arm(robot, "head", part(), TIP, 0.004)
    reached = arm.reach(rc.read_poses("out/poses.json"))
    stop, nodes = reached.pose, np.concatenate([robot.rest[None], reached.joints])
    ways = nodes[:, None] - nodes[None]
    ways[..., 5] -= 2 * np.pi * np.round(ways[..., 5] / (2 * np.pi))
    assert written["tour_length"] <= 1.03 * best_of(np.abs(ways).max(axis=2), stop)
    assert written["tour_length_unit"] == "rad"
    rows = list(csv.DictReader(Path("out/joints.csv").read_text().splitlines()))
    assert [int(each["position"]) - 1 for each in rows] == written["tour"]
    names = np.array(written["camera"])[written["tour"]].tolist()
    assert [each["camera"] for each in rows] == names
    items = [[float(each[name]) for name in robot.joint_names] for each in rows]
    assert np.array_equal(items, np.array(written["joints"])[written["tour"]])


TABLE = """
  <link name="platter"/>
  <link name="floor"/>
  <joint name="table" type="revolute">
    <parent link="platter"/><child link="floor"/>
    <origin xyz="0.5 0.1 0"/><axis xyz="0 0 -1"/><limit lower="-3.2" upper="3.2"/>
  </joint>
  <joint name="stand" type="fixed">
    <parent link="floor"/><child link="base"/><origin xyz="-0.5 -0.1 0"/>
  </joint>
</robot>"""
"""A turntable in the URDF, below the part, about which the robot goes round."""


def test_a_turntable_is_an_axis_of_the_robot():
    text = Path("arm.urdf").read_text()
    Path("cell.urdf").write_text(text.replace("</robot>", TABLE))
    still, cell = rc.Robot.load("arm.urdf"), rc.Robot.load("cell.urdf", name="arm")
    assert cell.joint_names == (*still.joint_names, "table")
    angles = np.array([0.1, 0.3, 1.1, 0.2, 0.1, 0.3])
    turned = rc.Robot.load(
        "arm.urdf",
        base=[[0, 1, 0, 0.4], [-1, 0, 0, 0.6], [0, 0, 1, 0], [0, 0, 0, 1]],  # by -90 degrees
    )
    own = cell.frames(np.append(angles, np.pi / 2))["head"][0]
    assert np.abs(own - turned.frames(angles)["head"][0]).max() <= 1e-12
    of = AROUND | {"generator": "on_sphere", "count": 24, "distances": [0.35]}
    plan = PLAN | {"candidates": [CANDIDATES | {"of": of}]}
    without = rc.place(plan)
    plan["bodies"] = [{"name": "arm", "urdf": "cell.urdf"}]
    placed = rc.place(plan, out="out")
    assert len(placed.prepared.pool.candidates) > len(without.prepared.pool.candidates)
    written = told("poses.json")
    ends = cell.frames(written["joints"])["head"] @ TIP
    assert np.abs(pose_error(ends, rc.read_poses("out/poses.json"))).max() <= 1e-6
    assert (
        Path("out/joints.csv")
        .read_text()
        .startswith("position,camera,pan,lift,elbow,bend,turn,roll,table\n")
    )


def test_a_turntable_of_the_motion_is_an_axis_of_the_arm():
    """As if each camera had been placed by the arm in front of the part turned by its angle."""
    of = AROUND | {"generator": "on_sphere", "count": 24, "distances": [0.35]}
    plan = PLAN | {"candidates": [CANDIDATES | {"of": of}]}
    without = rc.place(plan)
    table = {"body": "mesh", "steps": 8, "centre": [0.5, 0.1, 0]}
    placed = rc.place(plan | {"motion": {"turntable": table}}, out="out")
    n_before, n_now = (len(each.prepared.pool.candidates) for each in (without, placed))
    assert n_now > n_before
    written = told("poses.json")
    assert written["joint_names"][-1] == "turntable"
    poses, robot = rc.read_poses("out/poses.json"), rc.Robot.load(ARM)
    for pose, (*angles, turn) in zip(poses, written["joints"], strict=True):
        turned = np.eye(4)
        turned[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        there, back = np.eye(4), np.eye(4)
        there[:3, 3], back[:3, 3] = (0.5, 0.1, 0), (-0.5, -0.1, 0)
        seen = there @ turned @ back @ pose  # of the camera when the part is turned
        assert np.abs(seen - poses_of(robot, angles)[0]).max() <= 1e-6
        moved = part().moved(axis=(0, 0, 1), angle_deg=0)
        corners = moved.vertices @ turned[:3, :3].T + (there @ turned @ back)[:3, 3]
        cell = rc.Collisions(robot, [rc.Mesh(corners, moved.faces)])
        assert cell.clearance(angles)[0] >= 0.004 - 1e-9
    limited = rc.Robot.load(ARM).on_turntable((0, 0, 1), degrees=90)
    assert limited.limits[-1].tolist() == [0, np.pi / 2]
    table["body"] = "icosahedron"
    beside = PLAN["meshes"] + [{"built_in": "box", "transform": {"translation": [0, 1, 0]}}]
    with pytest.raises(rc.RastercovError, match="expected group box on the turntable or as an occ"):
        rc.place(plan | {"motion": {"turntable": table}, "meshes": beside})
    with pytest.raises(rc.RastercovError, match="a turntable alone for cameras"):
        rc.place(plan | {"motion": {"turntable": table, "poses": "arm.urdf"}})


def turned_by(angle):
    """Motion of what is on the turntable."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turn[:3, 3] = CENTRE - turn[:3, :3] @ CENTRE
    return turn


def in_the_cell(joints, around, of="scene"):
    """Clearance in the frame of the robot: the part turns, and nothing else."""
    robot, items = rc.Robot.load(ARM), []
    for *angles, turn in joints:
        motion = turned_by(turn)
        there = rc.Mesh(part().vertices @ motion[:3, :3].T + motion[:3, 3], part().faces)
        items.append(rc.Collisions(robot, [there, *around]).clearance(angles, 0.1, of)[0])
    return np.array(items)


def random_cell(rng):
    """A wall, a box around the base and a ball, all beside the table."""
    side, away = rng.choice((-1, 1)), rng.uniform(0.05, 0.25)
    wall = rc.shapes.box((1.5, 0.1, 1.5), 1, (0.4, side * (0.3 + away), 0.5))
    base = placement.KeepOutBox((-0.2, -0.2, -0.2), (0.2, 0.2, 0.05), "base")
    centre = (*rng.uniform((0.3, -0.4), (0.9, 0.5)), rng.uniform(0.5, 0.7))
    ball = placement.KeepOutSphere(tuple(map(float, centre)), 0.15, "ball")
    solids = [rc.shapes.box((0.4, 0.4, 0.25), 1, (0, 0, -0.075)),
              rc.shapes.sphere(3, 0.15).moved(translation=centre)]  # fmt: skip
    return wall, [base, ball], solids


@pytest.mark.parametrize("seed", range(amount(2, at_night=12)))
def test_what_is_beside_a_turntable_is_met_in_the_frame_of_the_robot(seed):
    rng = np.random.default_rng(seed)
    wall, volumes, solids = random_cell(rng)
    robot = rc.Robot.load(ARM).on_turntable((0, 0, 1), CENTRE, 100)
    given = {"keep_out": volumes, "stationary": wall, "camera_clearance": 0.03}
    tip = TIP.copy()
    tip[2, 3] = 0.2  # no link is where the camera is
    arm = placement.Arm(robot, "head", part(), tip, 0.02, **given)
    middle = np.add(CENTRE, (0, 0, 0.2))
    poses = rc.look_at(middle + 0.35 * rng.normal(size=(9, 3)) * (1, 1, 0.5), middle)
    reached = arm.reach(poses)
    assert len(reached.pose) > 4
    assert len(reached.missed) > 1

    def is_free(joints, slack):
        """The same in the frame of the robot, where only the part turns."""
        is_met = in_the_cell(joints, [wall, *solids]) >= 0.02 + slack
        is_met &= in_the_cell(joints, [], "links") > 0
        places = poses_of(rc.Robot.load(ARM), joints[:, :-1], tip)[:, :3, 3]
        is_met &= placement.NearestSurface(wall).query(places).distance >= 0.03
        return is_met & ~np.any([each.contains(places) for each in volumes], axis=0)

    assert is_free(reached.joints, -1e-9).all()
    solved = robot.kinematics.solve(poses[sorted(reached.missed)], "head", tip, (24,), 9, 24)
    assert not is_free(solved.joints, 2e-3).any()  # of the ball's facets
    at = poses_of(rc.Robot.load(ARM), reached.joints[:, :-1], tip)[:, :3, 3]
    there = placement.KeepOutSphere(tuple(at[0].tolist()), 0.05, "there")
    is_there = there.contains(at)
    result = replace(arm, keep_out=[*volumes, there]).is_free(reached.joints)
    assert not result[is_there].any()
    own = plan_arm.PlanArm(plan_of(PLAN), arm)
    moves = np.concatenate([own._moves(each, 0.3) for each in reached.joints[:3]])
    assert is_free(moves, -1e-9).all()
    tried = reached.joints[:3, None] + 0.3 * np.concatenate([np.eye(7), -np.eye(7)])
    tried = tried.reshape(-1, 7)
    tried = tried[((tried >= robot.limits[:, 0]) & (tried <= robot.limits[:, 1])).all(axis=1)]
    assert is_free(tried, 2e-3).sum() <= len(moves) < len(tried)
    words = " ".join(each.words for each in reached.missed.values())
    assert "base in" not in words  # it never moves


@pytest.mark.parametrize("seed", range(amount(2, at_night=8)))
def test_a_cell_with_a_turntable_is_planned_in_the_frame_of_the_robot(seed):
    """The wall does not turn, and hides: candidates, refinement, tour and figures know it."""
    wall, volumes, solids = random_cell(np.random.default_rng(seed))
    over = [rc.shapes.box(size, 1, (0.5, 0.1, 0.33)) for size in ((1, 0.02, 0.02), (0.02, 1, 0.02))]
    wall = rc.Mesh.joined([wall, *over])
    corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in wall.vertices.tolist())
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in (wall.faces + 1).tolist())
    Path("wall.obj").write_text(corners + faces)
    entry = CANDIDATES | {"of": AROUND | {"count": 16, "distances": [0.35]}, "clearance": 0.01}
    box, ball = volumes
    keep_out = [
        {"name": "base", "low": list(box.low), "high": list(box.high)},
        {"name": "ball", "centre": list(ball.centre), "radius": ball.radius},
    ]
    plan = PLAN | {
        "meshes": [*PLAN["meshes"], {"path": "wall.obj", "role": "occluder"}],
        "motion": {"turntable": {"body": "icosahedron", "steps": 8, "centre": CENTRE.tolist()}},
        "constraints": {"keep_out": keep_out, "clearance": 0.02}, "candidates": [entry],
        "camera": PLAN["camera"] | {"hfov_deg": 90},
        "selection": {"goal": "best_coverage", "cameras": 1, "refine": True, "refine_budget": 40},
    }  # fmt: skip
    placed = rc.place(plan, out="out")
    written, (pose,) = told("poses.json"), rc.read_poses("out/poses.json")
    joints = np.array(written["joints"])
    assert (in_the_cell(joints, [wall, *solids]) >= 0.01 - 1e-9).all()
    assert placed.prepared.mesh.n_faces == part().n_faces
    back = np.linalg.inv(turned_by(joints[0, -1]))
    bodies = [rc.Robot.load(ARM, rest=joints[0, :-1], name="arm").mesh, wall]
    bodies = [rc.Mesh(each.vertices @ back[:3, :3].T + back[:3, 3], each.faces) for each in bodies]
    scene = rc.Mesh.joined([part(), *bodies], ["part", "arm", "wall"])
    scene = scene.with_groups(occluders=["arm", "wall"])
    camera, task = rc.Camera.from_fov(320, 256, hfov_deg=90), rc.Task(max_incidence_deg=70)
    covered = rc.regions(scene, camera, pose[None], task).area.sum()
    assert told()["share"] == pytest.approx(covered / part().areas.sum(), abs=1e-5)


@pytest.mark.parametrize("seed", range(amount(2, at_night=8)))
def test_spaces_beside_a_turntable_hold_the_camera_in_the_frame_of_the_robot(seed):
    """In candidates, in moves of a refinement, and in all results."""
    rng = np.random.default_rng(seed)
    low, high = [0.1, -0.5, 0.1], rng.uniform((0.4, 0.3, 0.5), (0.6, 0.6, 0.9)).tolist()
    entry = CANDIDATES | {"of": AROUND | {"count": 16}}
    plan = PLAN | {
        "candidates": [entry],
        "constraints": {"spaces": [{"low": low, "high": high}]},
        "motion": {"turntable": {"body": "mesh", "steps": 8, "centre": CENTRE.tolist()}},
        "selection": {"goal": "best_coverage", "cameras": 3, "refine": True, "refine_budget": 40},
    }
    placed = rc.place(plan, out="out")
    written = told("poses.json")

    def is_within(joints):
        eyes = poses_of(rc.Robot.load(ARM), np.array(joints)[:, :-1])[:, :3, 3]
        return ((eyes >= low) & (eyes <= high)).all(axis=1)

    assert is_within(written["joints"]).all()
    assert "camera outside the spaces" in {each.words for each in placed.prepared.pool.refused}
    (arm,) = plan_arm.arms_of(placed.prepared.plan, placed.prepared.mesh)
    tried = rng.uniform(*np.clip(arm.robot.limits.T, -3, 3), (200, 7))
    assert not arm.is_free(tried[~is_within(tried)]).any()
    assert replace(arm, spaces=()).is_free(tried[~is_within(tried)]).any()


REFUSED = {
    "others": ({"candidates": [CANDIDATES, AROUND]}, "expected only on_arm"),
    "no robot": ({"bodies": []}, "expected 'arm' as the only body with urdf"),
    "link": ({"candidates": [CANDIDATES | {"body": "arm/hand"}]}, "got 'hand'"),
    "fixed": ({"candidates": [CANDIDATES | {"body": "arm/base"}]}, "a link that a joint moves"),
    "rolls": (
        {"candidates": [CANDIDATES | {"of": AROUND | {"rolls_deg": [1]}}]},
        "expected rolls_deg in on_arm"),
    "cavities": (
        {"candidates": [CANDIDATES | {"of": {"generator": "per_cavity"}}]}, "got 'per_cavity'"),
    "search": (
        {"selection": {"goal": "best_coverage", "cameras": 1, "optimise": {}}}, "optimise"),
    "faces": ({"task": {"by": "face"}}, "result by area"),
    "groups": (
        {"bodies": [{"name": "arm", "urdf": "arm.urdf", "groups": ["a"]}]}, "urdf or groups"),
    "base": ({"bodies": [{"name": "arm", "base": {"angle_deg": 1}}]}, "expected urdf with base"),
    "file": ({"bodies": [{"name": "arm", "urdf": "none.urdf"}]}, "which does not exist"),
    "folder": ({"bodies": [{"name": "arm", "urdf": "."}]}, "which is a folder"),
    "too long": ({"bodies": [{"name": "arm", "urdf": 300 * "a"}]}, "which does not exist"),
    "out of reach": (
        {"candidates": [CANDIDATES | {"of": AROUND | {"distances": [9]}}]},
        r"expected candidates, got none \(.*; relax constraints, .*, move the base"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_go_with_an_arm_is_refused_in_one_line(name):
    changes, words = REFUSED[name]
    with pytest.raises(rc.RastercovError, match=words) as caught:
        rc.place(PLAN | changes)
    assert str(caught.value).isprintable()


def test_a_robot_that_moves_by_a_path_is_in_front_of_cameras():
    robot = rc.Robot.load(ARM)
    rows = np.linspace(robot.rest, (0.6, 0.9, 1.0, 0.3, 0, 0), 5)
    lines = [",".join(robot.joint_names), *(",".join(map(repr, row)) for row in rows.tolist())]
    Path("path.csv").write_text("\n".join(lines))
    plan = PLAN | {
        "motion": {"joints": "path.csv"}, "task": PLAN["task"] | {"over": "all"},
        "candidates": [{"generator": "on_hemisphere", "count": 8, "distances": [1.5]}],
    }  # fmt: skip
    rc.place(plan, out="out")
    pose = rc.read_poses("out/poses.json")
    mesh = rc.Mesh.joined([part(), robot.mesh])
    camera, task = rc.Camera.from_fov(320, 256, hfov_deg=40), rc.Task(max_incidence_deg=70)
    motion = rc.Motion(mesh, robot.poses(rows))
    regions = regions_over_time(motion, camera, pose, task)
    assert told()["share"] == pytest.approx(rc.unite(over_time(regions, motion, "all")).share())
    shown, equipment = scene_of_place(Path("out"))
    assert np.array_equal(shown.motion.mesh.vertices, mesh.vertices)
    assert equipment == {}
    with pytest.raises(rc.RastercovError, match="one body with joints, got 0"):
        rc.place(plan | {"bodies": [{"name": "icosahedron"}]})
    Path("path.csv").write_text("a\n1\n")
    with pytest.raises(rc.RastercovError, match="columns pan"):
        rc.place(plan)


@pytest.mark.slow
def test_the_example_reaches_what_it_asks_for_and_tells_its_tour(monkeypatch, capsys):
    monkeypatch.syspath_prepend(ARM.parent)
    from inspect_by_robot import main

    place, results = rc.place, []
    monkeypatch.setattr(rc, "place", lambda plan: results.append(place(plan)) or results[0])
    main()
    placed = results[0]
    of = placed.prepared.reachable.summary()["percent"] / 100
    assert placed.cameras.share >= 0.9 * of > 0.5
    assert not placed.carried.is_hidden.any()
    assert placed.is_met
    told = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in told[-len(placed.carried.order) :]] == [
        f"  pose {row}" for row in placed.carried.order
    ]


def test_a_camera_rides_on_a_link_of_a_robot_that_moves():
    """Its poses are those at rest; the part is seen by the head that the path moves over it."""
    robot = rc.Robot.load(ARM)
    goals = rc.look_at(eyes=[(0.45, 0.1, 0.6), (0.6, 0.2, 0.55)], targets=(0.5, 0.1, 0.2))
    solution = robot.solve(goals, "head", TIP)
    joints = np.array([solution.joints[solution.pose == row][0] for row in (0, 1)])
    lines = [",".join(robot.joint_names), *(",".join(map(repr, row)) for row in joints.tolist())]
    Path("path.csv").write_text("\n".join(lines))
    at_rest = poses_of(robot, robot.rest)
    rc.write_poses("rest.json", at_rest)
    plan = PLAN | {
        "motion": {"joints": "path.csv"}, "camera": PLAN["camera"] | {"body": "arm/head"},
        "candidates": [{"generator": "poses", "file": "rest.json"}],
        "selection": {"goal": "best_coverage", "cameras": 1},
    }  # fmt: skip
    rc.place(plan, out="out")
    camera, task = rc.Camera.from_fov(320, 256, hfov_deg=40), rc.Task(max_incidence_deg=70)
    wanted = rc.unite(rc.regions(part(), camera, goals, task)).share()
    assert told()["share"] == pytest.approx(wanted, abs=1e-4)
    assert wanted > 0.3


def test_an_arm_that_reaches_no_pose_has_no_infinite_clearance():
    none = np.zeros((0, 6))
    near = {"scene": [], "links": []}
    carried_poses = plan_arm.CarriedPoses(
        (),
        none,
        near,
        none[:, 0],
        (),
        none[:, 0].astype(int),
        0.0,
        none[0:0, 0] < 0,
        0,
        none[0:0, 0],
    )
    assert "inf" not in carried_poses.line()


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0)])
def test_the_sense_of_a_turntable_is_that_of_its_joint(axis):
    """At positive angles the part goes counter-clockwise about the axis, before the arm."""
    robot = rc.Robot.load(ARM).on_turntable(axis, CENTRE, 90)
    joints = np.append(np.zeros(len(robot.joint_names) - 1), np.pi / 2)
    ends = [robot.frames(each)[FLOOR][0] for each in (0 * joints, joints)]
    part = ends[0] @ np.linalg.inv(ends[1])  # of the stand, at 0
    turned = part[:3, :3] @ np.cross(axis, (0.3, 0.5, 0.7))
    assert turned == pytest.approx(np.cross(axis, np.cross(axis, (0.3, 0.5, 0.7))), abs=1e-9)
    assert part[:3, :3] @ CENTRE + part[:3, 3] == pytest.approx(CENTRE)
    words = _turns(Table(axis, CENTRE.tolist(), 90, None))
    assert f"about ({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f}), through (" in words
    assert "counter-clockwise as seen from where this axis points" in words
    assert _turns(None) == ""


def test_a_camera_on_a_frame_without_a_mesh_has_a_page():
    """As `tool0`, the flange of robots of ROS."""
    robot = Path("arm.urdf").read_text()
    flange = (
        '<link name="tool0"/><joint name="flange" type="fixed"><parent link="head"/>'
        '<child link="tool0"/></joint></robot>'
    )
    Path("arm.urdf").write_text(robot.replace("</robot>", flange))
    entry = CANDIDATES | {"body": "arm/tool0"}
    rc.place(PLAN | {"candidates": [entry], "outputs": {"page": True}}, out="out")
    assert "Stops of the arm" in Path("out/page.html").read_text(encoding="utf-8")


def test_a_mesh_that_is_missing_is_an_error_of_its_body():
    """It was one of candidates[0], which has no packages."""
    text, mesh = Path("arm.urdf").read_text(), '<mesh filename="package://ur/x.stl"/>'
    Path("arm.urdf").write_text(text.replace('<box size="0.2 0.05 0.05"/>', mesh))
    with pytest.raises(PlanError, match=r"^plan: bodies\[0\]: arm\.urdf: expected the folder of "):
        rc.place(PLAN)


def test_an_arm_that_collides_at_rest_is_named():
    """Its row of the table of stops was blank."""
    block = {"built_in": "box", "transform": {"scale": 0.06, "translation": [0, 0, 0.8]}}
    placed = rc.place(PLAN | {"meshes": [*PLAN["meshes"], block | {"role": "occluder"}]})
    _, (rest, *_) = placed.carried.table()
    assert re.fullmatch(r"collision(, .* deep)? \(\w+ to box\)", rest[-2])
    assert re.search(r"; at rest \w+ collides with box", placed.carried.line())


def test_the_page_has_the_stops_of_the_tour_and_the_arm_at_the_first(monkeypatch):
    """Angles to what can be set, with the pairs that come nearest; nothing was on the page."""
    drawn, build, draw, pictures = [], plan_arm.PlanArm.parts, panorama.draw_bodies, []
    monkeypatch.setattr(
        plan_arm.PlanArm, "parts", lambda *args: drawn.append(build(*args)) or drawn[-1]
    )

    def draw_bodies(image, scene, bodies):
        made = draw(image, scene, bodies)
        pictures.append((np.array(image, int), np.array(made[0], int), bodies))
        return made

    monkeypatch.setattr(overview, "draw_bodies", draw_bodies)
    selection = {"goal": "best_coverage", "cameras": 3}
    rc.place(PLAN | {"selection": selection, "outputs": {"page": True}}, out="out")
    written, page = told("poses.json"), Path("out/page.html").read_text()
    table = page[page.index("<h2>Stops of the arm</h2>") :].partition("</table>")[0]
    table = table.replace("<wbr>", "")
    heads = re.findall(r"<th[^>]*>([^<]*)</th>", table)
    names = written["joint_names"]
    assert heads == ["camera", *names, "clearance to the scene", "between links"]
    rows = [
        re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in re.findall(r"<tr>(<td.*?)</tr>", table)
    ]
    rest = rows.pop(0)  # where the tour starts
    assert rest[:-2] == ["rest", *["0.0°"] * len(names)]
    arm = rc.Robot.load(ARM, name="arm")
    around = rc.Collisions(arm, [part()])
    for cell, of in zip(rest[-2:], SORTS, strict=True):  # it was blank
        (near,) = around.contacts(arm.rest, of)
        assert cell == f"{distance(near.distance)} ({near.link} to {near.body})"
    assert [int(row[0]) - 1 for row in rows] == written["tour"]
    for row, at in zip(rows, written["tour"], strict=True):
        angles = [float(each.removesuffix("°")) for each in row[1 : 1 + len(names)]]
        assert np.abs(np.array(angles) - np.rad2deg(written["joints"][at])).max() <= 0.05 + 1e-9
        for word, cell in zip(("clearance", "link_clearance"), row[-2:], strict=True):
            size, unit, one, other = re.fullmatch(
                r"([\d.]+) (m|mm) \((.*) to (.*)\)", cell
            ).groups()
            metres = float(size) * (1e-3 if unit == "mm" else 1.0)
            assert metres == pytest.approx(written[f"{word}_m"][at], rel=6e-3)
            assert [one, other] == written[f"{word}_pair"][at]
    robot = rc.Robot.load(ARM, rest=written["joints"][written["tour"][0]], name="arm")
    links = [mesh.vertices[np.unique(mesh.faces)] for mesh in drawn[0]]
    away = np.linalg.norm(np.concatenate(links)[:, None] - robot.mesh.vertices[None], axis=2)
    assert away.min(axis=1).max() < 1e-6
    of_tool = robot.mesh.face_group == [g.name for g in robot.mesh.groups].index("arm/head")
    assert drawn[0][-1].n_faces == of_tool.sum()
    assert sum(mesh.n_faces for mesh in drawn[0]) == robot.mesh.n_faces
    ((before, after, bodies),) = [each for each in pictures if each[-1]]
    shown = after[(before != after).any(axis=2)]
    assert len({colour for _, colour in bodies}) == 3
    for _, colour in bodies:  # each as bright as it is lit, in its own hue
        lit = shown[:, :1] * np.array(colour) / colour[0]
        assert (np.abs(shown - lit).max(axis=1) <= 2).sum() > 5
