"""Matrices of covered pairs alone: as those with coverage, and no larger than a bit a pair."""

import numpy as np
import pytest
from gl_device import DEVICE
from scenes import joined, soup, square

import rastercov as rc
from rastercov.gl import GLRasterizer
from rastercov.placement import (
    BestCoverage,
    FewestCameras,
    VisibilityMatrix,
    build_matrix,
    problem_of,
    select_greedy,
)
from rastercov.placement.uncovered import CandidateBounds

pytestmark = pytest.mark.matter("opengl")
CAMERA = rc.Camera(width=64, height=48, fx=40, fy=44)
TASK = rc.Task(min_pixels=2, max_incidence_deg=70, min_visibility=0.3)
N = 70


@pytest.fixture(autouse=True)
def software_judges(monkeypatch):
    """Software is given the plan of GPUs."""
    monkeypatch.setattr(GLRasterizer, "_choose_plan", lambda self, plan: "compute")


def scene_of(seed):
    """Small and large triangles of three groups, one of them an occluder, and poses around them."""
    rng = np.random.default_rng(seed)
    mesh = joined(soup(rng, int(rng.integers(40, 140))), square(1.0, 3.0))
    roles = [rc.Group("body"), rc.Group("wall", is_occluder=True), rc.Group("leaf")]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, roles, rng.integers(0, 3, mesh.n_faces))
    return mesh, rc.look_at(rng.normal(size=(N, 3)), np.add(rng.normal(size=(N, 3)), (0, 0, 2)))


def open_sampled(mesh, device, camera=CAMERA):
    return rc.open_observer(mesh, camera, rc.Engine("sampled", device))


def matrices(seed, folder=None, **options):
    """Matrix of bits by the device, and that with coverage by the CPU."""
    mesh, poses = scene_of(seed)
    with open_sampled(mesh, DEVICE) as observer:
        ours = build_matrix(observer, poses, TASK, folder, bits=True, **options)
    with open_sampled(mesh, "cpu") as observer:
        return mesh, ours, build_matrix(observer, poses, TASK)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [None, 9])
def test_a_matrix_of_bits_gives_the_problem_and_choice_of_one_with_coverage(seed, size, tmp_path):
    mesh, ours, theirs = matrices(seed, tmp_path / "m" if size else None, poses_a_shard=size)
    bits, expected = ours.bits(), theirs.bits()
    every = np.arange(N)
    np.testing.assert_array_equal(bits.take(every).parts[0], expected.take(every).parts[0])
    assert "bits" in ours.header
    assert ours.n_pairs == int(theirs.covered.sum()) > 0
    for goal in (BestCoverage(cameras=5), FewestCameras(0.9, of_reachable=True)):
        chosen, wanted = (select_greedy(problem_of(each, mesh, goal)) for each in (ours, theirs))
        assert chosen.chosen.tolist() == wanted.chosen.tolist()
        assert chosen.share == wanted.share


@pytest.mark.every_day
def test_a_folder_holds_little_more_than_a_bit_a_pair_and_is_read_again(tmp_path):
    mesh, ours, _ = matrices(1, tmp_path)
    shards = sum(each.stat().st_size for each in (tmp_path / "pairs").iterdir())
    assert shards < N * 8 * (-(-mesh.n_faces // 64) + 1) + 4096  # bits, counts, and a header
    again = VisibilityMatrix.load(tmp_path)
    every = np.arange(N)
    np.testing.assert_array_equal(
        again.bits().take(every).parts[0], ours.bits().take(every).parts[0]
    )
    assert again.n_pairs == ours.n_pairs
    with open_sampled(mesh, "cpu") as observer, pytest.raises(rc.ConfigError, match="a matrix of"):
        build_matrix(observer, ours.poses, TASK, tmp_path, bits=True)


def test_a_matrix_of_bits_refuses_what_it_does_not_hold():
    mesh, ours, _ = matrices(2)
    with pytest.raises(rc.ConfigError, match="expected coverage of pairs, got bits"):
        _ = ours.coverage
    with pytest.raises(rc.ConfigError, match="a matrix with coverage for min_coverage"):
        problem_of(ours, mesh, BestCoverage(1), min_coverage=0.9)


def test_bits_are_kept_with_coverage_where_no_device_judges():
    mesh, poses = scene_of(3)
    with open_sampled(mesh, "cpu", [CAMERA, CAMERA.resized(0.5)]) as observer:
        matrix = build_matrix(observer, poses, rc.Task(min_angle_deg=5), bits=True)
        assert "bits" not in matrix.header
    whole = build_matrix((mesh, CAMERA), poses, TASK, bits=True)
    assert "bits" not in whole.header
    assert whole.coverage.min() > 0


def test_bounds_count_the_candidates_that_cover_a_face_and_claim_nothing():
    mesh, poses = scene_of(0)
    bounds = CandidateBounds(mesh.n_faces, mesh.task_mask)
    with open_sampled(mesh, DEVICE) as observer:
        matrix = build_matrix(observer, poses, TASK, bits=True, bounds=bounds)
    assert bounds.n_poses == N
    views = matrix.bits().counts_up_to(N)
    np.testing.assert_array_equal(bounds.covering, views)
    assert set(bounds.claims(N).tolist()) == {rc.placement.Sight.UNKNOWN}
