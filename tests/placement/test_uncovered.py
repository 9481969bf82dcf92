"""What a network leaves uncovered: the nearest camera, the reason, what is in the way, proofs."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, sheet, soup, square
from visible_fractions import visibility

import rastercov as rc
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import REASONS, Reason, Task, nearness
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.raster.contract import BoundKind
from rastercov.engine.coverage_pairs import EDGE_ON
from rastercov.placement import uncovered
from rastercov.placement.improve.objective import Objective
from rastercov.placement.matrix import build_matrix
from rastercov.placement.matrix_folder import shorten_coverage
from rastercov.placement.plan.network import find_uncovered, measure_network
from rastercov.placement.uncovered import CandidateBounds, Sight, in_front, what_is_left

CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300, cx=160, cy=120)


def grouped(*parts):
    """Meshes as groups of one, (name, mesh, occluder)."""
    whole = joined(*(mesh for _, mesh, _ in parts))
    return Mesh(
        vertices=whole.vertices,
        faces=whole.faces,
        groups=[Group(name, is_occluder=hides) for name, _, hides in parts],
        face_group=np.repeat(np.arange(len(parts)), [mesh.n_faces for _, mesh, _ in parts]),
    )


def straight(*eyes):
    """Poses that look along +z with the axes of the world."""
    poses = np.tile(np.eye(4), (len(eyes), 1, 1))
    poses[:, :3, 3] = eyes
    return poses


def around(count, seed, radius=3.0):
    rng = np.random.default_rng(seed)
    eyes = rng.normal(size=(count, 3))
    eyes *= radius / np.linalg.norm(eyes, axis=1, keepdims=True)
    return rc.look_at(eyes, rng.uniform(-0.2, 0.2, (count, 3)))


@pytest.mark.slow
@given(seed=st.integers(0, 10_000), cameras=st.integers(1, 6))
@examples(8)
def test_the_reason_is_that_of_the_nearest_camera_and_no_camera_gets_further(seed, cameras):
    mesh = joined(shapes.torus(12, 8), shapes.box((0.4, 0.4, 0.4), centre=(1.6, 0, 0)))
    poses, task = around(cameras, seed, 4.0), Task(min_pixels=30, max_incidence_deg=70)
    rest = what_is_left((mesh, CAMERA), poses, task)
    coverage = rc.evaluate(mesh, CAMERA, poses, task, by="face")
    left = np.flatnonzero(rest.left)
    assert (rest.left == ~(coverage.reason == Reason.COVERED).any(axis=0)).all()
    ranks = nearness(coverage.reason[:, left])
    assert (nearness(rest.reason[left]) == ranks.max(axis=0)).all()
    assert (coverage.reason[rest.nearest_camera[left], left] == rest.reason[left]).all()


def test_of_cameras_before_which_a_face_is_hidden_that_which_sees_more_is_nearest():
    part, wall = sheet((-1, -1), (1, 1), 5.0), sheet((-2, -2), (0.2, 2), 4.0)
    mesh = grouped(("part", part, False), ("wall", wall, True))
    poses = straight((0.0, 0, 0), (0.3, 0, 0), (-0.3, 0, 0))
    rest = what_is_left((mesh, CAMERA), poses, Task(min_visibility=0.9))
    seen = visibility(mesh, CAMERA, poses).visibility
    assert (rest.left & (rest.reason == Reason.OCCLUDED))[:2].all()
    assert (rest.nearest_camera[:2] == seen[:, :2].argmax(axis=0)).all()
    assert len(np.unique(seen[:, 0])) == 3  # they differ, so that the choice means something


def test_the_group_that_hides_most_is_named_and_shares_add_up():
    part, pose = sheet((-1, -1), (1, 1), 8.0), straight((0, 0, 0))
    walls = {
        "left": sheet((-2, -2), (-0.1, 2), 4.0),  # hides x < -0.2 at depth 8: 0.4 of the part
        "right": sheet((0.15, -2), (2, 2), 6.0),  # hides x > 0.2 at depth 8
    }
    mesh = grouped(("part", part, False), *((name, wall, True) for name, wall in walls.items()))
    rest = what_is_left((mesh, CAMERA), pose, Task(min_visibility=0.5))
    assert rest.left[:2].all()
    wanted = mesh.areas[:2].sum() * np.array([0, 0.4, 0.4])
    assert rest.hidden_area[0] == pytest.approx(wanted, rel=0.03)
    hidden = []
    for name, wall in walls.items():
        alone = grouped(("part", part, False), (name, wall, True))
        hidden.append(1 - visibility(alone, CAMERA, pose).visibility[0, :2])
    assert (rest.occluder[:2] == 1 + np.argmax(hidden, axis=0)).all()
    assert rest.occluder_share[:2] == pytest.approx(np.max(hidden, axis=0), abs=0.03)
    assert rest.summary()["groups"][0]["hidden_by"].keys() == {"left", "right"}
    rest.summary()["groups"] = []  # figures are computed once, and each call has its own
    with pytest.MonkeyPatch.context() as patch:
        patch.delattr(type(rest), "of_groups")
        assert rest.summary()["groups"][0]["hidden_by"].keys() == {"left", "right"}


def test_a_duplicate_sheet_hides_the_second():
    part = sheet((-1, -1), (1, 1), 5.0)
    mesh = grouped(("first", part, False), ("second", part, False))
    rest = what_is_left((mesh, CAMERA), straight((0, 0, 0)))
    assert rest.left.tolist() == [False, False, True, True]
    assert (rest.occluder[2:] == 0).all()
    assert (rest.occluder_share[2:] > 0.9).all()


@given(
    scale=st.sampled_from([1e-3, 1.0, 1e4]), away=st.floats(8.0, 50.0), shift=st.floats(-0.9, 0.9)
)
@examples(10)
def test_shares_in_front_are_those_of_geometry_at_any_size_and_distance(scale, away, shift):
    part = sheet((-1, -1), (1, 1), 0.0)
    wall = sheet((-9, -9), (shift, 9), -0.5 * away)  # half-way: hides x < 2 shift of the part
    mesh = grouped(("part", part, False), ("wall", wall, True))
    mesh = Mesh(vertices=mesh.vertices * scale, faces=mesh.faces, groups=mesh.groups,
                face_group=mesh.face_group)  # fmt: skip
    eyes = np.tile([0.0, 0.0, -away * scale], (2, 1))
    shares = in_front(mesh, eyes, np.arange(2))
    hidden = np.clip((1 + 2 * shift) / 2, 0, 1)
    # The two triangles split the square along its diagonal.
    lower, upper = hidden**2, 1 - (1 - hidden) ** 2
    assert sorted(shares[:, 1]) == pytest.approx(sorted((lower, upper)), abs=0.04)
    assert (shares[:, 0] == 0).all()


def shut_box():
    """A sheet in a closed box, and one outside it."""
    inside = sheet((-0.2, -0.2), (0.2, 0.2), 0.0)
    return grouped(("inside", inside, False), ("box", shapes.box(), True))


def test_no_candidate_sees_a_shut_face_is_proved_by_bounds_and_never_by_samples():
    inside = sheet((-0.2, -0.2), (0.2, 0.2), 0.0)
    mesh = grouped(("inside", inside, False), ("box", shapes.box(), True))
    poses, network = around(40, 1), rc.look_at([0.1, 0.2, -3.0], [0, 0, 0])
    proved = what_is_left((mesh, CAMERA), network, candidates=poses)
    assert (proved.sight[:2] == Sight.NONE).all()
    assert (proved.seen_at_most[:2] <= 1e-6).all()
    told = proved.summary()
    assert told["seen_by_no_candidate"]["faces"] == 2
    assert told["groups"][0]["hidden_by"].keys() == {"box"}
    without = what_is_left((mesh, CAMERA), network)
    with rc.open_observer(mesh, CAMERA, "sampled:cpu") as observer:
        counted = what_is_left(observer, network, candidates=poses)
    for item in (without, counted):
        assert (item.sight[:2] == Sight.UNKNOWN).all()
        assert (item.seen_at_most[:2] > 1e-6).all()
    assert without.summary()["unknown"]["faces"] == 2


def test_a_candidate_in_the_plane_of_a_face_does_not_see_it():
    mesh = shapes.room(10)
    faces = np.flatnonzero((mesh.normals[:, 2] < -0.9) & (mesh.centroids[:, 2] < 0.2))
    eyes = np.stack([np.full(12, 2.9), np.linspace(-2, 2, 12), np.full(12, 0.1)], axis=1)
    poses = rc.look_at(eyes, [0, 0, 1.4])
    rest = what_is_left((mesh, CAMERA), poses[:0], candidates=poses)
    # By rounding, some of these cameras have an image of the undersides, and know nothing of it.
    assert visibility(mesh, CAMERA, poses).visibility_bound[:, faces].max() == 1
    assert (rest.sight[faces] == Sight.NONE).all()


@pytest.mark.slow
@given(seed=st.integers(0, 10_000))
@examples(5)
def test_the_bounds_hold_what_candidates_see_and_those_left_out_see_nothing(seed):
    mesh = joined(shapes.torus(10, 7), shapes.box((0.3, 0.3, 0.3), centre=(0, 0, 0)))
    task, poses = Task(min_visibility=0.6, max_incidence_deg=60), around(30, seed, 4.0)
    rest = what_is_left((mesh, CAMERA), poses[:2], task, candidates=poses)
    left, sight = rest.left, rest.sight[rest.left]
    is_covered = rc.evaluate(mesh, CAMERA, poses, task, by="face").reason == Reason.COVERED
    exact = visibility(mesh, CAMERA, poses, "exact").visibility.max(axis=0)[left]
    assert (rest.seen_at_least[left] <= exact + 1e-8).all()
    assert (rest.seen_at_most[left] >= exact - 1e-8).all()
    assert (rest.n_covering[left] == is_covered.sum(axis=0)[left]).all()
    assert (sight[exact > 1e-3] == Sight.SOME).all()
    assert (exact[sight == Sight.NONE] <= 1e-6).all()


@pytest.mark.slow
def test_no_more_than_two_batches_of_candidates_are_held_at_a_time(monkeypatch):
    batches, alive, plain = [], [], uncovered.list_pairs

    def watched(judge, poses, seen, bounds):
        batches.append(weakref.ref(seen))
        alive.append(sum(each() is not None for each in batches))
        return plain(judge, poses, seen, bounds)

    monkeypatch.setattr("rastercov.core.coverage.coverage.POSES_A_BATCH", 20)
    monkeypatch.setattr(uncovered, "list_pairs", watched)
    poses = around(300, 5, 4.0)
    rest = what_is_left((shapes.torus(10, 8), CAMERA), poses[:1], candidates=poses)
    assert rest.left.any()
    assert len(batches) == 15
    assert max(alive) <= 2


def test_a_face_with_too_few_views_says_so_and_so_do_views_that_are_too_much_alike():
    view, poses = (sheet((-1, -1), (1, 1), 5.0), CAMERA), straight((0, 0, 0))
    for item, reason in (
        (what_is_left(view, poses, Task(views=2)), "too_few_views"),
        (what_is_left(view, poses, covered=np.zeros(2, bool)), "too_few_views"),
        (what_is_left(view, poses[:0]), "no_cameras"),
    ):
        assert item.left.all()
        assert item.summary()["reasons"].keys() == {reason}
        has_camera = reason == "too_few_views"
        assert (item.views == has_camera).all()
        assert (item.nearest_camera == has_camera - 1).all()
    assert len(what_is_left(view, poses).lines()) == 1  # all is covered


def test_the_parts_of_what_is_left_add_up_and_agree_with_the_network():
    mesh, task = shapes.room(4), Task(min_pixels=5)
    poses = rc.look_at([[2.5, 2, 2.5], [-2, -2, 2.2]], [0, 0, 0.5])
    rest = what_is_left((mesh, CAMERA), poses, task, candidates=poses)
    network = Network(mesh, task)
    network.add(rc.evaluate(mesh, CAMERA, poses, task, by="face"))
    told, known = rest.summary(), network.summary()
    assert told["left"] == known["not_covered"]
    assert told["reasons"] == known["not_covered_because"]
    parts = ("could_be_covered", "seen_never_covered", "seen_by_no_candidate", "unknown")
    for entries in ([told[part] for part in parts], [each["left"] for each in told["groups"]]):
        assert sum(entry["faces"] for entry in entries) == told["left"]["faces"]
    assert told["could_be_covered"]["faces"] == 0  # the network is all the candidates
    assert all(REASONS[name].sentence in "\n".join(rest.lines()) for name in told["reasons"])


def candidate_bounds(visibility, bound, kind, drawn, reason):
    """Bounds of the greatest visible fraction of each face, (F,), and how many poses cover it.

    Figures of a `Coverage` are (P, F). An image of `EDGE_ON` square pixels or less shows nothing,
    unless it was sampled.
    """
    low = (visibility - bound).max(axis=0, initial=0).clip(0, 1)
    is_edge_on = (drawn <= EDGE_ON) & (kind != BoundKind.STATISTICAL)
    high = np.where(is_edge_on, 0.0, visibility + bound).max(axis=0, initial=0).clip(0, 1)
    return low, high, (reason == Reason.COVERED).sum(axis=0)


@pytest.mark.parametrize("method", ["certified", "sampled"])
@given(seed=st.integers(0, 2**32 - 1), n_poses=st.integers(0, 9))
@examples(15)
def test_pairs_and_bounds_of_candidates_are_those_of_the_figures(method, seed, n_poses):
    rng = np.random.default_rng(seed)
    mesh = joined(soup(rng, 60), square(1.0, 3.0))
    size = 10 ** rng.uniform(-5, 0)  # images of a millionth of a pixel, too
    mesh = rc.Mesh(mesh.vertices * (size, 1, 1), mesh.faces)
    poses = rc.look_at(rng.normal(size=(n_poses, 3)), (0, 0, 3)) if n_poses else np.empty((0, 4, 4))
    task = Task(min_pixels=float(rng.choice([0.5, 3])))
    plain = rc.evaluate(mesh, CAMERA, poses, task, method=method, by="face").coverage
    some = np.append(plain[(plain > 0) & (plain < 1)], [0, 0.4])  # one is the threshold itself
    task = replace(task, min_coverage=float(rng.choice(some)))
    chosen = rng.random(mesh.n_faces) < 0.8
    bounds = CandidateBounds(mesh.n_faces, chosen)
    with rc.open_observer(mesh, CAMERA, method, threads=2) as observer:
        matrix = build_matrix(observer, poses[:4], task, bounds=bounds)
        matrix = matrix.joined(build_matrix(observer, poses[4:], task, bounds=bounds))
    figures = rc.evaluate(mesh, CAMERA, poses, task, method=method, by="face")
    names = ("visibility", "visibility_bound", "visibility_kind", "drawn_pixels", "reason")
    expected = candidate_bounds(*(getattr(figures, name) for name in names))
    for one, other in zip((bounds.low, bounds.high, bounds.covering), expected, strict=True):
        np.testing.assert_array_equal(one, np.where(chosen, other, 0))
    assert bounds.n_poses == n_poses
    pose, face = np.nonzero(figures.coverage)
    np.testing.assert_array_equal(np.repeat(np.arange(n_poses), np.diff(matrix.indptr)), pose)
    np.testing.assert_array_equal(matrix.face, face)
    short, is_covered = shorten_coverage(figures.coverage[pose, face], task.min_coverage)
    np.testing.assert_array_equal(matrix.coverage, short)
    np.testing.assert_array_equal(matrix.covered, is_covered)


def test_what_a_matrix_measured_need_not_be_measured_again(monkeypatch):
    mesh, poses = shapes.torus(10, 7), around(30, 3, 4.0)
    task = Task(max_incidence_deg=50)
    with rc.open_observer(mesh, CAMERA) as observer:
        bounds = CandidateBounds(mesh.n_faces, mesh.task_mask)
        build_matrix(observer, poses, task, bounds=bounds)
        objective = Objective.of(observer, task)
        cameras = measure_network(objective, poses[:2])
        again = find_uncovered(observer, cameras, lambda *_: None, poses)
        monkeypatch.setattr(uncovered, "measurements", None)  # raises when it is called
        rest = find_uncovered(observer, cameras, lambda *_: None, poses, bounds)
    assert rest.summary() == again.summary()
    for name in ("n_covering", "sight", "seen_at_least", "seen_at_most"):
        one, other = (getattr(each, name)[rest.left] for each in (rest, again))
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("rule", [None, rc.All(), rc.AtLeast(1)])
def test_a_rig_with_a_rule_counts_once(rule):
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.3
    rig = rc.Rig([CAMERA, CAMERA], rig_from_camera=places, rule=rule)
    network, others = rig.poses(around(2, 0)), rig.poses(around(5, 1))
    rest = what_is_left((shapes.torus(12, 8), rig), network, candidates=others)
    each = 2 if rule is None else 1
    assert (rest.n_cameras, rest.n_candidates) == (2 * each, 5 * each)
    line = f"Of these, judged by {5 * each} candidate poses:"
    assert line in rest.lines()
