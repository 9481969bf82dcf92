"""Networks of cameras: made-up coverage added up by hand, and one real scene from end to end."""

from contextlib import closing
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from rastercov.base.errors import ConfigError
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.union import unite
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import FIGURES, Coverage, open_observer
from rastercov.core.coverage.face_pass import Sums, no_sums
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.shards import EvaluationShards, Wanted, classify_parts
from rastercov.core.coverage.task import Engine, Reason, Task, nearer
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.engine.coverage_network import add_sums
from rastercov.placement.plan.network import Measured, with_areas
from rastercov.shards import ALONE

CAMERA = Camera(width=200, height=200, fx=100, fy=100)
#  3---2        6   9  12
#  | / |  and   |\  |\  |\   : faces 0, 1 of area 2, faces 2, 3, 4 of area 1/2
#  0---1        4-5 7-8 10-11
POINTS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)] + [
    (x + dx, dy, 0) for x in (3, 5, 7) for dx, dy in ((0, 0), (1, 0), (0, 1))
]
FACES = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (7, 8, 9), (10, 11, 12)]
PART = Mesh(POINTS, FACES)
TOTAL = 5.5


def judged(coverage, task=None, *, mesh=PART, reason=None, pose_ids=None, clipped=None, **others):
    """A Coverage that says no more than what a network takes from it."""
    task, values = task or Task(), np.array(coverage, dtype=np.float64)
    if reason is None:
        covered = (values >= task.min_coverage) & (values > 0)
        reason = np.where(covered, Reason.COVERED, Reason.OCCLUDED)
    figures = {name: np.zeros(values.shape, kind) for name, kind in FIGURES.items()}
    figures |= {"coverage": values, "reason": np.array(reason, np.uint8)}
    figures |= {name: np.array(value) for name, value in others.items()}
    ids = np.arange(len(values)) if pose_ids is None else np.array(pose_ids, np.int64)
    clipped = np.zeros(len(values), bool) if clipped is None else np.array(clipped)
    return Coverage(mesh, CAMERA, task, None, ids, clipped, **figures)


def network_of(*coverages, mesh=PART, task=None):
    network = Network(mesh, task or Task())
    for coverage in coverages:
        network.add(coverage)
    return network


def share(faces, percent, area_percent):
    shares = {"percent": pytest.approx(percent), "area_percent": pytest.approx(area_percent)}
    return {"faces": faces} | shares


def state(network):
    arrays = {n: v.tolist() for n, v in vars(network).items() if isinstance(v, np.ndarray)}
    lists = {n: v for n, v in vars(network).items() if isinstance(v, list | float)}
    return arrays | lists | {"covered": network.covered.tolist()}


# --- by face --------------------------------------------------------------------------------------


def test_views_best_and_best_pose_of_each_face():
    rows = [[0.9, 0.4, 0, 0.6, 0.5], [0.8, 0.6, 0, 0.6, 0.4], [1.0, 0.3, 0, 0.2, 0.5]]
    network = network_of(judged(rows, pose_ids=[3, 5, 8]))
    assert network.views.tolist() == [3, 1, 0, 2, 2]
    assert network.best.tolist() == [1, 0.6, 0, 0.6, 0.5]
    assert network.best_pose.tolist() == [8, 5, -1, 3, 3]
    assert network.pose_ids == [3, 5, 8]
    assert network.covered_faces == [3, 3, 2]
    assert network.mean_coverage == pytest.approx([0.48, 0.48, 0.4])


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_covered_takes_k_views(k):
    task = Task(views=k)
    rows = [[1, 1, 1, 0, 0], [1, 1, 0, 0, 0], [1, 0, 0, 0.4, 0]]
    network = network_of(judged(rows, task), task=task)
    assert network.covered.tolist() == [k <= n for n in (3, 2, 1, 0, 0)]
    summary = network.summary()
    assert summary["required_views"] == k
    reasons = {name: entry["faces"] for name, entry in summary["not_covered_because"].items()}
    assert reasons == {"occluded": 2} | ({"too_few_views": min(k - 1, 3)} if k > 1 else {})


def test_the_reason_is_that_of_the_camera_that_came_nearest():
    rows = [
        [Reason.BACK_FACING, Reason.OUTSIDE, Reason.OCCLUDED, Reason.COVERED, Reason.DEGENERATE],
        [Reason.OUT_OF_FOCUS, Reason.BACK_FACING, Reason.UNSAMPLED, Reason.OUTSIDE, 0],
    ]
    network = network_of(*(judged(np.zeros((1, 5)), reason=[row]) for row in rows))
    assert network.reason.tolist() == [
        *(Reason.OUT_OF_FOCUS, Reason.OUTSIDE, Reason.OCCLUDED, Reason.COVERED, Reason.DEGENERATE)
    ]


# --- totals ---------------------------------------------------------------------------------------


def test_percentages_by_count_and_by_area():
    summary = network_of(judged([[1, 0.4, 1, 0, 0]])).summary()
    assert summary["faces"] == summary["task_faces"] == 5
    assert summary["covered"] == share(2, 40, 100 * 2.5 / TOTAL)
    assert summary["not_covered"] == share(3, 60, 100 * 3 / TOTAL)
    assert summary["zero_in_every_camera"] == share(2, 40, 100 * 1 / TOTAL)
    why = summary["not_covered_because"]
    assert why["occluded"].pop("gain") == share(3, 60, 100 * 3 / TOTAL)
    assert why == {"occluded": share(3, 60, 100 * 3 / TOTAL)}
    assert summary["mean_best_coverage"] == pytest.approx(0.48)
    assert summary["mean_views"] == pytest.approx(0.4)


def test_groups_are_counted_apart_and_occluders_not_at_all():
    groups = [Group("big"), Group("crate", is_occluder=True), Group("small", False, True)]
    mesh = Mesh(POINTS, FACES, groups, [0, 1, 2, 2, 2])
    summary = network_of(judged([[1, 1, 1, 0.1, 0]], mesh=mesh), mesh=mesh).summary()
    assert (summary["faces"], summary["task_faces"]) == (5, 4)
    assert summary["covered"] == share(2, 50, 100 * 2.5 / 3.5)
    assert summary["zero_in_every_camera"] == share(1, 25, 100 * 0.5 / 3.5)
    assert summary["mean_best_coverage"] == pytest.approx(2.1 / 4)
    big, crate, small = summary["groups"]
    assert big["covered_faces"] == big["covered"] == share(1, 100, 100)
    assert big["zero_in_every_camera"] == share(0, 0, 0)
    assert crate == {"name": "crate", "role": "occluder", "two_sided": False, "faces": 1}
    assert small["covered"] == share(1, 100 / 3, 100 / 3)
    assert small["zero_in_every_camera"] == share(1, 100 / 3, 100 / 3)
    assert (small["role"], small["two_sided"], small["faces"]) == ("task", True, 3)


def test_covered_and_the_reasons_make_up_the_task():
    result = evaluate(shapes.teapot(3), CAMERA, sphere_of_poses((0, 0, 0.08), 0.4, 4), by="face")
    summary = network_of(result, mesh=result.mesh, task=result.task).summary()
    reasons = summary["not_covered_because"].values()
    for unit in ("faces", "percent", "area_percent"):
        uncovered = sum(entry[unit] for entry in reasons)
        assert uncovered == pytest.approx(summary["not_covered"][unit])
        whole = summary["task_faces"] if unit == "faces" else 100
        assert summary["covered"][unit] + uncovered == pytest.approx(whole)


def test_clipped_poses_and_the_largest_bound_are_kept():
    one = judged(np.ones((2, 5)), clipped=[True, False], visibility_bound=np.full((2, 5), 0.25))
    two = judged(np.ones((1, 5)), clipped=[True], visibility_bound=[[0.5] * 5], pose_ids=[7])
    summary = network_of(one, two).summary()
    assert summary["near_clipped_poses"] == [0, 7]
    assert summary["largest_visibility_bound_of_covered"] == 0.5


def test_figures_of_faces_in_view_are_counted_by_kind():
    kinds = [[0, 1, 2, 2, 1], [2, 2, 1, 1, 1]]
    reason = np.full((2, 5), Reason.OCCLUDED)
    reason[1, 0] = Reason.BACK_FACING
    figures = {
        "visibility_bound": [[0.5, 0, 1e-9, 1e-9, 0], [1, 1e-9, 0, 0, 0]],
        "in_view_fraction": [[1, 1, 1, 1, 1], [1, 1, 1, 0, 0.5]],
    }
    one = judged(np.zeros((2, 5)), reason=reason, visibility_kind=kinds, **figures)
    summary = network_of(one).summary()
    assert summary["visibility_figures"] == {"exact": 3, "certified": 4, "statistical": 1}
    assert summary["largest_visibility_bound"] == 0.5
    assert summary["largest_visibility_bound_of_covered"] == 0


# --- batches, nothing, JSON -----------------------------------------------------------------------


def test_a_network_of_no_cameras_covers_nothing_and_says_why():
    for network in (network_of(), network_of(judged(np.zeros((0, 5))))):
        summary = network.summary()
        assert summary["poses"] == 0
        assert summary["covered"] == share(0, 0, 0)
        assert summary["zero_in_every_camera"] == share(5, 100, 100)
        assert summary["not_covered_because"] == {"no_cameras": share(5, 100, 100)}
        assert not network.covered.any()
        assert (network.best_pose == -1).all()


def test_a_mesh_of_occluders_has_no_task():
    mesh = PART.with_groups(occluders=["mesh"])
    network = network_of(judged(np.ones((2, 5)), mesh=mesh), mesh=mesh)
    summary = network.summary()
    assert summary["task_faces"] == 0
    assert summary["covered"] == summary["not_covered"] == share(0, 0, 0)
    assert summary["not_covered_because"] == {}
    assert (summary["mean_best_coverage"], summary["mean_views"]) == (0, 0)
    assert network.mean_coverage == [0, 0]


def test_faces_without_area_have_no_share_of_it():
    mesh = Mesh([(0, 0, 0), (1, 0, 0)], [(0, 1, 0), (0, 0, 1)])
    reason = [[Reason.DEGENERATE] * 2]
    summary = network_of(judged([[0, 0]], mesh=mesh, reason=reason), mesh=mesh).summary()
    assert summary["not_covered_because"] == {"degenerate": share(2, 100, 0)}


# --- measured and added up in threads -------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "sampled:cpu"])
@pytest.mark.parametrize("threads", [1, 3])
def test_poses_added_in_threads_or_by_shards_make_the_network_of_their_coverage(
    method, threads, monkeypatch, tmp_path
):
    mesh = shapes.teapot(3).with_groups(occluders=[])
    camera = Camera(width=48, height=40, fx=45, fy=42, focus_range=(0.3, 0.5))
    poses = np.concatenate([sphere_of_poses((0, 0, 0.08), 0.43, 11)] * 2)
    poses[3, 0, 0] = np.nan
    task = Task(min_pixels=3, max_incidence_deg=60)
    whole = evaluate(mesh, camera, Poses.of(poses, skip_bad=True), task, method=method, by="face")
    expected = network_of(whole, mesh=mesh, task=task)
    monkeypatch.setattr("rastercov.core.coverage.coverage.POSES_A_BATCH", 8)
    result = Network(mesh, task)
    with open_observer(mesh, camera, method, threads=threads) as observer:
        for batch in result.judge(observer, Poses.of(poses[:5], skip_bad=True)):
            result.add(batch)
        assert result.pose_ids == [0, 1, 2, 4]
        result = Network(mesh, task)
        for batch in result.judge(observer, Poses.of(poses, skip_bad=True)):
            result.add(batch)
        accepted, wanted = Poses.of(poses, skip_bad=True), Wanted(Engine.of(method), False, "seen")
        stored = Network(mesh, task)  # one shard of several batches
        shards = EvaluationShards(tmp_path, observer, accepted, task, wanted)
        for batch in classify_parts(stored, observer, accepted, wanted, shards, ALONE):
            stored.add(batch)
    for network in (result, stored):
        assert state(network) == state(expected)
        assert network.summary() == expected.summary()


def test_a_network_of_another_mesh_is_not_measured():
    with (
        open_observer(PART, CAMERA) as observer,
        pytest.raises(ConfigError, match="the mesh and task of the network"),
    ):
        Network(shapes.box(), Task()).judge(observer, Poses.of(np.eye(4)))


def test_areas_of_a_camera_are_those_of_its_poses_alone_whatever_others_covered_before():
    mesh, rig = shapes.box(), Rig([CAMERA, CAMERA], ["one", "other"])
    around = sphere_of_poses((0, 0, 0), 4.0, 3)
    poses = Poses.of(np.concatenate((around, around)), camera=[0, 0, 0, 1, 1, 1])
    plan = SimpleNamespace(
        rig=rig, task=SimpleNamespace(views=1), build_task=lambda views: Task(views=views)
    )
    unused = dict.fromkeys(field.name for field in fields(Measured))
    with closing(RegionPass(mesh, rig, Task())) as finder:
        network = with_areas(plan, Measured(**unused | {"placed": poses}), finder, has_curve=True)
        for index in (0, 1):
            alone = unite(finder.find(poses[poses.camera == index])).area[0].sum()
            assert network.per_camera.entry(index)["covered_area"]["m2"] == pytest.approx(alone)


class Read(np.ndarray):
    """Array of faces that counts the entries of what it is indexed by."""

    total = 0

    def __getitem__(self, key):
        Read.total += np.size(key)
        return np.asarray(super().__getitem__(key))


@pytest.mark.parametrize("n_groups", [4, 64])
def test_figures_of_groups_read_each_face_a_few_times(n_groups):
    """Also of those that many groups have, in any order."""
    torus, poses = shapes.torus(32, 16), sphere_of_poses((0, 0, 0), 3.0, 2)
    labels = np.random.default_rng(n_groups).permutation(torus.n_faces) % n_groups
    groups = [Group(f"g{row}") for row in range(n_groups)]
    mesh = Mesh(torus.vertices, torus.faces, groups, labels)
    network = evaluate(mesh, CAMERA, poses, by="face").network
    wanted = network.summary()
    areas, kept = mesh.areas, vars(mesh)["_normals_and_areas"]
    counted = (each.view(Read) if each is areas else each for each in kept)
    vars(mesh)["_normals_and_areas"] = tuple(counted)
    Read.total = 0
    summary = network.summary()
    assert summary == wanted
    assert 0 < Read.total <= 16 * mesh.n_faces
    for row, entry in enumerate(summary["groups"]):
        own = labels == row
        assert entry["faces"] == own.sum()
        assert entry["area_m2"] == areas[own].sum()
        assert entry["covered"]["faces"] == (own & network.covered).sum()


@pytest.mark.parametrize("are_later", [False, True])
def test_sums_of_other_poses_are_added_face_by_face(are_later):
    rng = np.random.default_rng(are_later)
    for n in (0, 1, 7, 8, 9, 250):
        ours, theirs = no_sums(n, 9), no_sums(n, 5)
        for sums, n_poses in ((ours, 9), (theirs, 5)):
            sums.views[:] = rng.integers(0, 9, n)
            sums.best[:] = rng.choice([0.0, 0.25, 0.5, 1.0], n)  # many are equal
            sums.best_row[:] = rng.integers(0, n_poses, n)
            sums.reason[:] = rng.integers(0, 40, n)
            sums.alone[:] = rng.integers(0, 32, n)
            sums.kinds[:] = rng.integers(0, 9, 3)
            sums.bounds[:] = rng.random(2)
        before = Sums(*(array.copy() for array in ours))
        add_sums(ours, theirs, 4, are_later)
        rows = theirs.best_row + 4
        ties = (theirs.best == before.best) & (rows < before.best_row) & (theirs.best > 0)
        better = (theirs.best > before.best) | (ties & (not are_later))
        expected = {
            "views": before.views + theirs.views,
            "best": np.maximum(before.best, theirs.best),
            "best_row": np.where(better, rows, before.best_row),
            "reason": nearer(before.reason, theirs.reason),
            "alone": before.alone | theirs.alone,
            "kinds": before.kinds + theirs.kinds,
            "bounds": np.maximum(before.bounds, theirs.bounds),
        }
        for name, array in expected.items():
            np.testing.assert_array_equal(getattr(ours, name), array, err_msg=name)
    with pytest.raises(ValueError, match="one row for each face"):
        add_sums(no_sums(3, 1), no_sums(4, 1), 0, are_later)


def test_the_first_of_equal_poses_is_the_best_in_any_batches(monkeypatch):
    mesh = shapes.torus(12, 8)
    eyes = sphere_of_poses((0, 0, 0), 3 * mesh.diagonal, 4)
    poses = Poses.of(np.repeat(eyes, 3, axis=0))[np.random.default_rng(1).permutation(12)]
    engine = Engine("sampled", "cpu", threads=2)
    found = []
    for pairs in (1, 3 * mesh.n_faces, 1 << 19):
        monkeypatch.setattr("rastercov.core.coverage.coverage.PAIRS_A_BATCH", pairs)
        found.append(evaluate(mesh, CAMERA, poses, Task(min_pixels=1), method=engine))
    first = found[0]
    at = np.argmax(first.coverage == first.network.best, axis=0)
    expected = np.where(first.network.best > 0, poses.ids[at], -1)
    assert (expected >= 0).any()
    for each in found:
        np.testing.assert_array_equal(each.network.best_pose, expected)
        assert each.network.summary() == first.network.summary()
