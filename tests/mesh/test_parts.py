"""Parts: the tree of groups by their names, and faces that no camera can ever see."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nightly import examples
from plans import write_obj
from scenes import joined
from scipy.spatial.transform import Rotation

import rastercov as rc
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.mesh.groups import FileGroups, Names
from rastercov.core.mesh.unseeable import GAP_REL, INSET_REL, unseeable_areas
from rastercov.formats.meshes.polygons import names_in_tree
from rastercov.placement.parts import PartRow, part_rows
from rastercov.placement.plan.network import classify_network
from rastercov.placement.select.methods import select_greedy
from rastercov.placement.select.problem import (
    FewestCameras,
    problem_of_matrix,
)
from rastercov.report.plan import lines

ENDS = st.tuples(st.integers(0, 3), st.integers(1, 3)).map(lambda at: (at[0], sum(at)))


def boxes(*ends, names=(), turn=None):
    """A group for each box between two corners, `ends` (3, 2)."""
    each = [shapes.box(np.ptp(at, axis=1), 1, np.mean(at, axis=1)) for at in ends]
    mesh = joined(*each)
    points = mesh.vertices if turn is None else turn.apply(mesh.vertices.copy())
    groups = [Group(name) for name in names or map(str, range(len(each)))]
    return Mesh(points, mesh.faces, groups, np.repeat(np.arange(len(each)), each[0].n_faces))


@given(st.lists(st.tuples(ENDS, ENDS, ENDS), min_size=2, max_size=4), st.integers(0, 9))
@examples(50, at_night=300)
def test_a_face_is_unseeable_only_where_all_in_front_of_it_is_in_another_body(ends, seed):
    """Boxes in contact, one in another, or through each other; of two, it is then found, too."""
    rng = np.random.default_rng(seed)
    mesh = boxes(*ends, turn=Rotation.random(None, rng))
    flat, is_met = boxes(*ends), unseeable_areas(mesh) > 0
    diagonal = np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    corners = flat.vertices[flat.faces] + GAP_REL * diagonal * flat.normals[:, None]
    middle = corners.mean(axis=1, keepdims=True)
    weights = np.concatenate([np.eye(3), rng.dirichlet(np.ones(3), 30)])
    points = middle + (weights @ corners - middle) * (1 - 30 * INSET_REL)
    low, high = np.array(ends, float).transpose(2, 0, 1)[:, :, None, None]
    is_in = ((points > low) & (points < high)).all(axis=-1)
    assert is_in.any(axis=0)[is_met].all()
    if len(ends) == 2:
        np.testing.assert_array_equal(is_met, is_in.all(axis=-1).any(axis=0))
        np.testing.assert_allclose(unseeable_areas(mesh)[is_met], mesh.areas[is_met], rtol=1e-3)


@pytest.mark.parametrize("is_target", [True, False])
def test_a_two_sided_face_is_unseeable_where_both_sides_are_inside(is_target):
    """A sheet in a body, one on its top, one through it, and one outside."""
    body = shapes.box((2, 2, 2))
    sheets = [
        Mesh([(-0.5, -0.5, z), (0.5, -0.5, z), (0, 0.5, z + dz)], [(0, 1, 2)])
        for z, dz in ((0.3, 0), (1.0, 0), (0.5, 1), (1.4, 0))
    ]
    names = ["in", "on", "through", "out"]
    mesh = Mesh.joined([body, *sheets], names=["body", *names])
    mesh = mesh.with_groups(two_sided=names, targets=names if is_target else ())
    result = unseeable_areas(mesh)[12:]
    assert result.tolist() == [pytest.approx(0.5, rel=1e-3), 0, 0, 0]
    one_sided = mesh.with_groups(two_sided=[])
    assert (unseeable_areas(one_sided)[12:] > 0).tolist() == [True, False, False, False]


def test_a_sealed_cavity_can_be_seen_and_so_can_all_where_a_camera_is_inside():
    mesh = boxes([(0, 9)] * 3, [(1, 8)] * 3, [(2, 4)] * 3)
    faces = np.where(mesh.face_group[:, None] == 1, mesh.faces[:, ::-1], mesh.faces)
    assert unseeable_areas(mesh).any()
    assert not unseeable_areas(Mesh(mesh.vertices, faces, mesh.groups, mesh.face_group)).any()
    pose = rc.look_at((6, 6, 6), (3, 3, 3))
    result = rc.evaluate(mesh, rc.Camera.from_fov(200, 200, hfov_deg=60), pose, by="face")
    assert result.network.summary()["unseeable_m2"] == 0


@pytest.mark.parametrize("is_beside", [False, True])
def test_what_is_outside_of_a_room_that_holds_all_is_a_body(is_beside):
    # A room, a cupboard in its corner, a box in the cupboard; and another box, beside the room.
    beside = [[(-3, -1), (0, 1), (0, 1)]] * is_beside
    mesh = boxes([(0, 9)] * 3, [(0, 2)] * 3, [(0.5, 1)] * 3, *beside)
    room = mesh.face_group == 0
    faces = np.where(room[:, None], mesh.faces[:, ::-1], mesh.faces)
    result = unseeable_areas(Mesh(mesh.vertices, faces, mesh.groups, mesh.face_group))
    areas = np.bincount(mesh.face_group, result, len(mesh.groups))
    # Three sides of the cupboard are on walls; where a box is beside, there may be cameras, too.
    expected = [0, 0, 0, 0] if is_beside else [0, 12, 1.5]
    np.testing.assert_allclose(areas, expected, rtol=1e-3)


def test_figures_of_a_part_are_those_of_its_faces_as_one_group():
    ends = [[(-4, 4), (-4, 4), (-1, 0)], [(0, 1)] * 3, [(0, 1), (0, 1), (1, 2)], [(-2, -1)] * 3]
    mesh = boxes(*ends, names=["table", "arm/base", "arm/tool/tip", "arm/tool"])
    merged = Mesh(
        mesh.vertices, mesh.faces, [Group("table"), Group("arm")], np.minimum(mesh.face_group, 1)
    )
    camera, poses = rc.Camera.from_fov(300, 200, hfov_deg=50), rc.look_at((7, 6, 5), (0, 0, 0))
    parts, whole = (
        rc.evaluate(each, camera, poses, by="area").summary() for each in (mesh, merged)
    )
    expected = whole["groups"][1] | {"level": 1, "groups": 3}
    assert [part["name"] for part in parts["parts"]] == ["arm", "arm/tool"]
    assert parts["parts"][0].keys() == expected.keys()
    for key in ("area_m2", "unseeable_m2", "covered_of_seeable_percent", "faces", "level"):
        assert parts["parts"][0][key] == pytest.approx(expected[key])
    assert parts["parts"][0]["covered_area"]["m2"] == pytest.approx(expected["covered_area"]["m2"])
    assert expected["unseeable_m2"] == pytest.approx(4, rel=1e-3)
    assert [row.name for row in part_rows(parts, 1)] == [row.name for row in part_rows(whole)]
    occluders = mesh.with_groups(occluders=["arm/to*"]).groups
    assert [group.is_occluder for group in occluders] == [False, False, True, True]


def test_names_are_places_in_the_tree_below_what_all_share():
    names = ["cell", "arm", "bolt", "bolt", "", "a/b", "arm", "bolt"]
    parents = [-1, 0, 1, 1, 1, 4, 0, 6]
    result = names_in_tree(parents, names, [2, 3, 5, 7])
    expected = ["arm/bolt", "arm/bolt #2", "arm/a\u2215b", "arm #2/bolt"]
    assert [result[row] for row in (2, 3, 5, 7)] == expected
    assert names_in_tree([-1, 0, 0], ["root", "a/b", "c"], [1, 2])[1:] == ["a/b", "c"]
    taken = names_in_tree([-1] * 3, ["bolt", "bolt", "bolt #2"], range(3))
    assert taken == ["bolt", "bolt #2", "bolt #2 #2"]
    deep = [f"level {row}" for row in range(1000)]
    assert names_in_tree(range(-1, 999), deep, [999])[999] == "level 999"


NAMES = ["arm/base", "arm/tool/tip", "arm/tool", "table"]


@given(st.lists(st.tuples(ENDS, ENDS, ENDS), min_size=4, max_size=4), st.permutations(range(4)))
@examples(5, at_night=15)
def test_a_part_is_the_sum_of_its_groups_in_any_order(ends, order):
    camera, poses = rc.Camera.from_fov(200, 200, hfov_deg=60), rc.look_at((9, 8, 10), (2, 2, 2))
    ends = np.array(ends) + 0.013 * np.arange(4)[:, None, None]  # no two faces coincide
    told = []
    for rows in (range(4), order):
        mesh = boxes(*(ends[row] for row in rows), names=[NAMES[row] for row in rows])
        summary = rc.evaluate(mesh, camera, poses, by="area").summary()
        told.append({each["name"]: each for each in summary["groups"]})
        parts = {each["name"]: each for each in summary["parts"]}
        for name, own in {"arm": NAMES[:3], "arm/tool": NAMES[1:3]}.items():
            each = [told[-1][group] for group in own]
            for key in ("area_m2", "unseeable_m2", "faces"):
                assert parts[name][key] == pytest.approx(sum(one[key] for one in each))
            covered = sum(one["covered_area"]["m2"] for one in each)
            assert parts[name]["covered_area"]["m2"] == pytest.approx(covered, abs=1e-9)
        for one in (summary, *summary["groups"], *summary["parts"]):
            of_seeable = one["covered_of_seeable_percent"]
            assert of_seeable is None or of_seeable >= one["covered_area"]["percent"] - 1e-9
        dead = sum(each["area_m2"] for each in summary["dead_zones"])
        left = summary["area_m2"] - summary["covered_area"]["m2"]
        assert dead + summary["other_dead_zones"]["area_m2"] == pytest.approx(left, rel=1e-9)
    one, other = told
    for name in NAMES:
        for key in ("area_m2", "unseeable_m2", "covered_of_seeable_percent"):
            assert one[name][key] == pytest.approx(other[name][key], abs=1e-6)


CANDIDATES = {"generator": "on_sphere", "count": 15, "distances": [9.0]}
GOALS = st.dictionaries(st.sampled_from([*NAMES, "arm"]), st.floats(0.7, 0.98), max_size=3)


@pytest.mark.slow
@given(
    st.lists(st.tuples(ENDS, ENDS, ENDS), min_size=4, max_size=4), GOALS, st.floats(0.3, 0.98),
    st.sampled_from(["face", "area"]), st.integers(1, 2), st.booleans(),
)  # fmt: skip
@settings(examples(4, at_night=100), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_place_and_check_agree_on_each_goal(tmp_path, ends, groups, share, by, views, refine):
    """Goals are shares of what all candidates cover, which a check of these says."""
    ends = np.array(ends) + 0.013 * np.arange(4)[:, None, None]
    write_obj(
        tmp_path / "boxes.obj", boxes(*ends), {name: 12 * row for row, name in enumerate(NAMES)}
    )
    task = {"by": by, "views": views} | ({"resolution_of_result": 0.6} if by == "area" else {})
    plan = {"meshes": [{"path": str(tmp_path / "boxes.obj")}], "task": task}
    plan |= {"camera": {"width": 200, "height": 150, "hfov_deg": 60.0}, "candidates": [CANDIDATES]}
    every = rc.place(plan | {"selection": {"goal": "best_coverage", "cameras": 99}})
    most = rc.check(
        plan, every.prepared.measured, min_coverage=1e-9, groups=dict.fromkeys(groups, 1e-9)
    )
    wanted = {
        each.group: float(np.floor(1e4 * (groups.get(each.group, share)) * each.low) / 1e4) or 1e-6
        for each in most.requirements
    }
    goal = {"goal": "fewest_cameras", "coverage": wanted.pop(None), "groups": wanted}
    plan["selection"] = goal | {"refine": refine, "refine_budget": 200}
    placed = rc.place(plan)
    checked = rc.check(plan, placed.cameras.placed)
    assert placed.is_met == checked.is_met >= (by == "face")
    for one, other in zip(placed.requirements, checked.requirements, strict=True):
        assert (one.group, one.status, one.uncovered) == (
            other.group,
            other.status,
            other.uncovered,
        )
        np.testing.assert_allclose([one.low, one.share], [other.low, other.share], atol=1e-9)
        assert one.short_by < 0.03
    assert ("further selections" in " ".join(lines(placed))) == (not placed.is_met)


def test_a_name_means_all_groups_that_have_it():
    """Not the first alone: those that follow have another name only in the scene."""
    groups = ["a/bolt", "a/bolt #2", "a/lid", "a #2/bolt", "a #2/cap", "bolt 3", "nut #2"]
    bolts = ["a/bolt", "a/bolt #2", "a #2/bolt"]
    for files in ([], [FileGroups("s.glb", groups)]):
        names = Names(groups, files)
        assert names.groups_of("a/bolt") == names.groups_of("bolt") == bolts
        assert names.groups_of("bolt #2") == names.groups_of("a/bolt #2") == ["a/bolt #2"]
        assert names.groups_of("a #2/bolt") == ["a #2/bolt"]
        assert names.groups_of("cap") == ["a #2/cap"]
        assert names.groups_of("nut") == ["nut #2"]
        assert names.places_of("a/bolt") == bolts
        assert names.by_group({"bolt": 1, "a/bolt #2": 2})["a/bolt #2"] == 2
        assert Names(groups, files, group_first=True).groups_of("a/bolt") == ["a/bolt"]
    assert Names(groups, [FileGroups("s.glb", groups)]).groups_of("a") == groups[:5]
    assert Names(groups, [FileGroups("s.glb", groups)]).groups_of("s/a/bolt") == bolts


def test_goals_of_parts_and_of_parts_in_parts_are_reached_and_reported():
    covers, shares = np.eye(4), {"arm": 0.5, "arm/tool": 1.0}
    goal = FewestCameras(0.0, shares)
    problem = problem_of_matrix(covers, goal, groups=NAMES, face_group=range(4))
    selection = select_greedy(problem)
    assert sorted(selection.chosen.tolist()) == [1, 2]  # and arm lacks nothing then
    names = Names(NAMES)
    assert names.places_of("arm") == ["arm"]
    assert names.places_of("arm/*") == ["arm/base", "arm/tool"]
    assert names.places_of("*") == ["arm", "table"]
    mesh = boxes(*([(row, row + 1)] * 3 for row in range(4)), names=NAMES)
    faces = mesh.face_group == 1
    of_arm, of_tool = classify_network(
        mesh, np.ones(48, np.int64), {"arm": 0.3, "arm/tool": 0.6}, faces
    )
    assert (of_arm.status, of_arm.share, of_arm.n_groups) == ("holds", pytest.approx(1 / 3), 3)
    assert of_tool.words().startswith("part arm/tool: 50.0 % covered, 60.0 % required")


@pytest.mark.parametrize(("percent", "reason"), [(100.0, ""), (99.9, "resolution too low")])
def test_a_part_of_which_every_point_is_covered_has_no_reason_why_not(percent, reason):
    entry = {
        "area_m2": 1.0, "covered": {"percent": 98.0}, "covered_area": {"percent": percent},
        "covered_of_seeable_percent": percent,
        "seeable_not_covered_because": {"too_coarse": {"area_percent": 2.0}},  # as a whole face
    }  # fmt: skip
    assert PartRow.of(entry).reason == reason


def test_no_room_is_looked_for_around_faces_within_its_walls(monkeypatch):
    """It takes longest of a goal on a panel in a room."""
    walls = shapes.box((4.0, 4.0, 3.0))
    inwards = Mesh(walls.vertices, walls.faces[:, ::-1])
    panel = Mesh([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    mesh = Mesh.joined([inwards, panel], ["walls", "panel"]).with_groups(occluders=["walls"])
    monkeypatch.setattr("rastercov.core.mesh.unseeable._has_room", lambda *_: 1 / 0)
    assert not unseeable_areas(mesh).any()
