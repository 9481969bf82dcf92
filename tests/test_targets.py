"""Targets by all methods: what is scored, what nothing else notices, and how networks count."""

import itertools

import numpy as np
import pytest
from exact_cases import hostile
from hypothesis import example, given
from hypothesis import strategies as st
from nightly import examples
from target_scenes import beside, only, sheet_at, some_as_targets
from visible_fractions import FRACTION, visibility

import rastercov as rc
from rastercov.base.errors import MeshError
from rastercov.core.coverage.coverage import FIGURES
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import shapes
from rastercov.placement import what_is_left
from rastercov.placement.targets import faces_on, sheet_above, with_target
from rastercov.reference.algorithm1 import occlusion
from rastercov.reference.coverage import figures_of_pose
from rastercov.reference.models import MODELS

METHODS = ("certified", "exact", "sampled:cpu", "sampled:cpu@3", "sampled:surfaceless")
ROOM = shapes.room(4)
CAMERA = rc.Camera(width=80, height=60, fx=50, fy=50)
VIEWS = rc.look_at([(2.7, 2.2, 2.6), (-2.7, -2.2, 2.6), (0, 0, 2.7)], [(0, 0, 0.5)] * 3)
TASK = rc.Task(min_coverage=0.3, max_incidence_deg=80)


def scene(seed=0):
    """The room with a sheet above its floor, a box, and a sheet under the floor."""
    return beside(
        ROOM,
        sheet_at((-2, -2), (2, 2), 1.6),
        shapes.box((1, 1, 1)),
        sheet_at((-0.3, -0.3), (0.3, 0.3), -0.5),
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_coverage_of_a_face_has_the_same_bits_with_and_without_targets(method):
    mesh = scene()
    result = rc.evaluate(mesh, CAMERA, VIEWS, TASK, method=method, by="face")
    for stays in (mesh.face_group < 2, mesh.face_group != 3):
        expected = rc.evaluate(only(mesh, stays), CAMERA, VIEWS, TASK, method=method, by="face")
        for name in FIGURES:
            np.testing.assert_array_equal(
                getattr(result, name)[:, stays], getattr(expected, name), err_msg=name
            )


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@example(seed=52)  # faces that are edge-on to rounding, judged in lanes and one by one
@example(seed=652)
@examples(7)
def test_visibility_of_hostile_scenes_has_the_same_bits(seed):
    case, rng = hostile(seed), np.random.default_rng(seed)
    is_target = rng.random(case.mesh.n_faces) < 0.5
    if is_target.all() or not is_target.any():
        return
    mesh = some_as_targets(case.mesh, is_target)
    for method in ("certified", "exact", "sampled:cpu"):
        observation = visibility(mesh, case.camera, [case.pose], method)
        expected = visibility(only(mesh, ~is_target), case.camera, [case.pose], method)
        for name in FRACTION:
            np.testing.assert_array_equal(
                getattr(observation, name)[:, ~is_target], getattr(expected, name), err_msg=name
            )


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_sheet_is_covered_from_its_front_only_unless_it_is_two_sided(method):
    below = rc.look_at([(0, 0.1, 0.5)], [(0, 0, 3)])
    above = rc.look_at([(0, 0.1, 2.7)], [(0, 0, 0)])
    sheet = sheet_at((-0.2, -0.2), (0.2, 0.2), 1.6)
    for two_sided, reasons in ((False, (True, False)), (True, (True, True))):
        mesh = beside(ROOM, sheet, is_two_sided=two_sided)
        poses = np.concatenate((above, below))
        table = rc.evaluate(mesh, CAMERA, poses, TASK, method=method, by="face")
        covered = table.reason[:, -2:] == Reason.COVERED
        assert covered.all(axis=1).tolist() == list(reasons)
        if not two_sided:
            assert (table.reason[1, -2:] == Reason.BACK_FACING).all()


def test_the_criteria_are_those_of_the_reference():
    mesh = scene()
    with rc.open_observer(mesh, CAMERA, "exact") as observer:
        observed = observer.observe(VIEWS)
    result = rc.evaluate(mesh, CAMERA, VIEWS, TASK, method="exact", by="face")
    for row, pose in enumerate(VIEWS):
        expected = figures_of_pose(mesh, CAMERA, TASK, pose, observed, row)
        np.testing.assert_array_equal(result.reason[row], expected["reason"])
        np.testing.assert_allclose(result.coverage[row], expected["coverage"], rtol=0, atol=1e-12)


def test_a_network_lists_targets_with_their_role():
    mesh = scene()
    table = rc.evaluate(mesh, CAMERA, VIEWS, TASK, by="face")
    network = rc.Network(mesh, TASK)
    network.add(table)
    summary = network.summary()
    assert [group["role"] for group in summary["groups"]] == ["task"] * 2 + ["target"] * 3
    assert summary["task_faces"] == mesh.n_faces
    assert summary["groups"][2]["covered"]["faces"] == 2
    assert summary["groups"][4]["covered"]["faces"] == 0


def test_what_hides_a_target_is_in_front_of_it():
    # The sheet under the floor is hidden by the room, the one above it by nothing.
    mesh = scene()
    left = what_is_left((mesh, CAMERA), VIEWS[:1], TASK)
    hidden = left.left & (left.reason == Reason.OCCLUDED)
    assert hidden[-2:].any()
    names = np.array([group.name for group in mesh.groups])
    assert set(names[left.occluder[hidden & mesh.target_mask]]) <= {"room", "crates"}


@pytest.mark.parametrize("name", MODELS)
def test_a_target_changes_no_model_of_any_other_face(name):
    result = MODELS[name](scene(), CAMERA, VIEWS, TASK)
    expected = MODELS[name](ROOM, CAMERA, VIEWS, TASK)
    np.testing.assert_array_equal(result[:, : ROOM.n_faces], expected)
    assert result[:, ROOM.n_faces :].any()


def test_algorithm_1_refuses_targets():
    with pytest.raises(ValueError, match=r"a mesh without targets.*pass mesh\.opaque"):
        occlusion(scene(), CAMERA, VIEWS[0])
    assert len(occlusion(scene().opaque, CAMERA, VIEWS[0])) == ROOM.n_faces


# --- what coincides -------------------------------------------------------------------------------


def _tiles(rng, n=6):
    """Rectangles of two slopes one above another, turned, in some triangles; and their faces."""
    parts = []
    for _ in range(n):
        low, size = rng.uniform(0, 5, 2), rng.uniform(1, 6, 2)
        x, y = (np.linspace(0, 1, k + 1) for k in rng.integers(1, 4, 2))
        xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) * size + low
        turn = rng.uniform(0, 6)
        xy = xy @ np.array([(np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))])
        at = np.arange((len(x) - 1) * (len(y) - 1))
        first = at // (len(x) - 1) * len(x) + at % (len(x) - 1)
        corners = first[:, None] + (0, 1, len(x) + 1, len(x))
        z = xy @ (0.3, 0.1) + rng.integers(0, 2)
        faces = np.concatenate((corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]))
        parts.append((np.column_stack((xy, z)), faces))
    starts = np.cumsum([0, *(len(v) for v, _ in parts)])
    vertices = np.concatenate([v for v, _ in parts])
    return rc.Mesh(
        vertices, np.concatenate([f + k for (_, f), k in zip(parts, starts, strict=False)])
    )


@pytest.mark.parametrize("seed", range(20))
def test_what_coincides_in_a_sheet_counts_once_and_is_said(seed):
    """Against the unions of GEOS, floor by floor."""
    import shapely

    mesh = _tiles(np.random.default_rng(seed))
    sheet = sheet_above(mesh, "mesh", 1.6)
    corners = mesh.vertices[mesh.faces]
    floor = np.round(corners[:, 0] @ (-0.3, -0.1, 1.0))
    united = sum(
        shapely.union_all(shapely.polygons(corners[floor == level, :, :2])).area for level in (0, 1)
    )
    assert (sheet.areas * sheet.normals[:, 2]).sum() == pytest.approx(united, rel=1e-9)
    is_less = sheet.areas.sum() < mesh.areas.sum() * (1 - 1e-9)
    assert is_less == any("the highest counts" in note for note in sheet.notes)


def _heights(mesh, xy):
    """Heights of the faces above each point of the plan, and True where one ends nearby."""
    import shapely

    corners, points = mesh.vertices[mesh.faces], shapely.points(xy)
    plan = shapely.polygons(corners[..., :2])
    face, point = shapely.STRtree(points).query(plan, predicate="contains")
    near = shapely.STRtree(shapely.boundary(plan)).query(points, "dwithin", 1e-5)[0]
    slope = -mesh.normals[face, :2] / mesh.normals[face, 2:]
    z = corners[face, 0, 2] + (slope * (xy[point] - corners[face, 0, :2])).sum(axis=1)
    return [np.sort(z[point == row]) for row in range(len(xy))], np.isin(range(len(xy)), near)


def _storeys(rng):
    """Floors with layers that cover a part, levels and slopes, and copies of some, in any order."""
    floors = []
    for level in rng.choice([0, 0.08, 0.2, 0.29, 0.31, 0.45, 2.9, 3.1], rng.integers(2, 9)):
        corners = rng.uniform(-4, 4, (2, 2))
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        xy = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        slope = rng.choice([0, 1]) * rng.uniform(-0.2, 0.2, 2)
        floors.append(rc.Mesh(np.insert(xy, 2, level + xy @ slope, axis=1), [(0, 1, 2), (0, 2, 3)]))
    floors += [floors[row] for row in rng.integers(0, len(floors), 2)]
    return rc.Mesh.joined([floors[row] for row in rng.permutation(len(floors))])


@pytest.mark.parametrize("seed", range(40))
def test_of_layers_of_a_floor_the_highest_counts_at_every_point(seed):
    rng = np.random.default_rng(seed)
    mesh, xy = _storeys(rng), rng.uniform(-4, 4, (400, 2))
    sheet = sheet_above(mesh, [group.name for group in mesh.groups], 1.6)
    (whole, is_near), (result, is_cut) = _heights(mesh, xy), _heights(sheet, xy)
    for z, left in itertools.compress(zip(whole, result, strict=True), ~(is_near | is_cut)):
        z = z[np.diff(z, append=np.inf) > 1e-5]
        rise = np.diff(z, append=np.inf)
        if (abs(rise - 0.3) < 1e-5).any():
            continue
        np.testing.assert_allclose(left - 1.6, z[rise > 0.3], atol=1e-6)
    assert any("of faces up to 0.3 m apart the highest counts, " in each for each in sheet.notes)


def test_a_sheet_without_faces_that_coincide_stays_as_it_is():
    hall = rc.Mesh.load("room")
    sheet = sheet_above(hall, "room", 1.6)
    assert not sheet.notes
    assert set(sheet.vertices[:, 2]) <= set(hall.vertices[:, 2] + 1.6)


def test_equal_floors_any_number_of_times_are_one():
    one = _tiles(np.random.default_rng(1), 1)
    many = rc.Mesh(
        np.concatenate([one.vertices + np.array((0, 0, k * 1e-9)) for k in range(30)]),
        np.concatenate([one.faces + k * one.n_vertices for k in range(30)]),
    )
    assert sheet_above(many, "mesh", 1).areas.sum() == pytest.approx(one.areas.sum(), rel=1e-6)


def test_squares_for_faces_stand_on_every_level_of_a_sheet():
    floor = rc.Mesh([(0, 0, 0), (4, 0, 0), (4, 3, 0.8), (0, 3, 0.8)], [(0, 1, 2), (0, 2, 3)])
    sheet = rc.Mesh.joined([floor, floor.moved(translation=(0, 0, 3))])
    faces = faces_on(sheet, 6, spacing=1.0, size=0.25)
    centres = faces.vertices.reshape(-1, 4, 3).mean(axis=1)
    assert len(centres) == 6 * 2 * 4 * 3  # on the diagonal of the floor, too
    normal = faces.normals[::2]
    np.testing.assert_allclose(normal, faces.normals[1::2], atol=1e-12)
    np.testing.assert_allclose(normal[:, 2], 0, atol=1e-12)
    heads = centres - 0.125 * normal
    np.testing.assert_allclose(heads[:, 2] % 3, heads[:, 1] * 0.8 / 3, atol=1e-6)
    assert np.unique(heads[:, :2].round(9), axis=0).tolist() == [
        [x + 0.5, y + 0.5] for x in range(4) for y in range(3)
    ]
    angle = np.degrees(np.arctan2(normal[:, 1], normal[:, 0])).round().reshape(6, -1)
    assert (angle % 360 == 60 * np.arange(6)[:, None]).all()
    assert faces.areas.sum() == pytest.approx(len(centres) * 0.25**2)
    one = faces_on(sheet, [(0, -2, 5)], spacing=1.0)
    np.testing.assert_allclose(one.normals, [[0, -1, 0]] * one.n_faces, atol=1e-12)


def test_a_face_is_seen_from_its_front_alone():
    hall = shapes.room().with_groups(occluders=["room", "crates"])
    sheet = sheet_above(hall, "room", 1.6)
    scene = with_target(hall, faces_on(sheet, [(1, 0, 0)], spacing=2.0), "faces")
    eyes = [(2.9, 0, 1.7), (-2.9, 0, 1.7)]
    camera = rc.Camera(width=400, height=300, fx=200, fy=200)
    seen = [
        rc.evaluate(scene, camera, rc.look_at([eye], [(0, 0, 1.6)])).areas.summary() for eye in eyes
    ]
    assert seen[0]["percent"] > 50
    assert seen[1]["percent"] == 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"facing": 0}, "expected from 1 to 360 directions in facing, got 0"),
        ({"facing": 10**12}, "expected from 1 to 360 directions in facing, got 1000000000000"),
        ({"facing": [(0, 0, 1)]}, "expected level directions in facing, got none, or one along z"),
        ({"spacing": 0.0}, "expected spacing above 0 m, got 0"),
        ({"size": 0.0}, "expected at most 100,000 squares of a size above 0 m, got 960 of 0 m"),
        ({"spacing": 1e-4}, "expected at most 100,000 squares of a size above 0 m, got"),
    ],
)
def test_wrong_squares_are_refused(changes, words):
    with pytest.raises(MeshError, match=words):
        faces_on(sheet_above(shapes.room(), "room", 1.6), **changes)
