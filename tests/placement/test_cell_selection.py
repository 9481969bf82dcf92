"""Selection on cells: as good as on exact areas, and independent of the triangles of the scene."""

from functools import cache

import numpy as np
import pytest
from nightly import nightly
from surface_cases import bisected, cut_at_random, room
from union_greedy import area_of, greedy_by_area, room_candidates

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.cells import USUAL_CELLS, usual_size
from rastercov.core.area.regions import RegionPass
from rastercov.placement.improve.objective import CellObjective
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.methods import select_greedy
from rastercov.placement.select.problem import BestCoverage, problem_of
from rastercov.placement.uncovered import CandidateBounds

TASK = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000)
MESH, CAMERA, _ = room()
DIAGONAL = float(np.linalg.norm(np.ptp(MESH.bounds, axis=0)))
SIZE = 0.05 * DIAGONAL
POSES = room_candidates(100)
CAMERAS = 6


def chosen_on_cells(mesh, size=SIZE, poses=POSES):
    """Network that the greedy selection takes on cells, and the share that cells give it."""
    cells = rc.cells(mesh, size)
    matrix = build_matrix((mesh, CAMERA), poses, TASK, cells=cells)
    selection = select_greedy(problem_of(matrix, cells, BestCoverage(cameras=CAMERAS)))
    return poses[selection.chosen], selection.share


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=nightly) for n in (2, 3))])
@pytest.mark.parametrize("rel", [0.05, 0.03])
def test_cells_up_to_a_twentieth_of_the_diagonal_lose_half_a_point_at_most(seed, rel):
    network, share = chosen_on_cells(MESH, rel * DIAGONAL, room_candidates(60, seed))
    exact = area_of(MESH, CAMERA, network, TASK)
    assert exact >= best_of_60(seed) - 0.005
    assert abs(exact - share) <= 0.015


@cache
def best_of_60(seed):
    """Share that the greedy selection on exact areas gives."""
    return greedy_by_area(MESH, CAMERA, room_candidates(60, seed), TASK, CAMERAS)[1]


@pytest.mark.slow
def test_the_choice_does_not_depend_on_the_triangles():
    finer = [MESH, cut_at_random(MESH, 1, 200)[0], bisected(MESH, DIAGONAL / 8)[0]]
    shares = [area_of(MESH, CAMERA, chosen_on_cells(mesh)[0], TASK) for mesh in finer]
    assert max(shares) - min(shares) <= 0.01


@pytest.mark.slow
def test_shares_of_cells_add_up_to_the_exact_area_of_each_pose():
    cells = rc.cells(MESH, SIZE)
    regions = rc.regions(MESH, CAMERA, POSES, TASK)
    shares = cells.share(regions)
    row = np.repeat(np.arange(len(POSES)), np.diff(shares.starts))
    areas = np.bincount(row, shares.share * cells.area[shares.cell], len(POSES))
    np.testing.assert_allclose(areas, regions.areas().sum(axis=1), rtol=1e-9)
    matrix = build_matrix((MESH, CAMERA), POSES, TASK, cells=cells)
    np.testing.assert_array_equal(matrix.indptr, shares.starts)
    np.testing.assert_array_equal(matrix.face, shares.cell)
    np.testing.assert_array_equal(matrix.covered, shares.share >= 0.5)
    np.testing.assert_allclose(matrix.coverage, shares.share, rtol=1e-7)


def test_an_objective_on_cells_counts_as_the_problem_does():
    cells = rc.cells(MESH, SIZE)
    matrix = build_matrix((MESH, CAMERA), POSES[:8], TASK, cells=cells)
    views = {MESH.groups[0].name: 2}
    problem = problem_of(matrix, cells, BestCoverage(cameras=8), views=views)
    finder = RegionPass(MESH, CAMERA, TASK)
    with rc.open_observer(MESH, CAMERA) as observer:
        objective = CellObjective.of_cells(observer, finder, cells, views=views)
        covers = objective.covers(POSES[:8])
        covered = objective.covered(covers, POSES[:8, :3, 3])
    finder.close()
    np.testing.assert_array_equal(covered, problem.covered_by(np.arange(8))[1])
    assert objective.share(objective.worth(covered)) == problem.share(problem.reachable)


def test_bounds_of_faces_come_with_a_matrix_of_cells():
    items = []
    for cells in (None, rc.cells(MESH, SIZE)):
        bounds = CandidateBounds(MESH.n_faces, MESH.task_mask)
        build_matrix((MESH, CAMERA), POSES[:8], TASK, cells=cells, bounds=bounds)
        items.append(bounds)
    for name in ("low", "high", "covering", "n_poses"):
        np.testing.assert_array_equal(getattr(items[0], name), getattr(items[1], name))


def test_matrices_of_faces_and_of_cells_are_not_mistaken_for_each_other(tmp_path):
    poses, goal = POSES[:2], BestCoverage(cameras=1)
    cells, larger = (rc.cells(MESH, size) for size in (SIZE, 2 * SIZE))
    made = {}
    for name, own, others in (("cells", cells, (None, larger)), ("faces", None, (cells,))):
        made[name] = build_matrix((MESH, CAMERA), poses, TASK, tmp_path / name, cells=own)
        for other in others:
            with pytest.raises(ConfigError, match="for faces, or for patches of another size"):
                build_matrix((MESH, CAMERA), poses, TASK, tmp_path / name, cells=other)
    for name, elements, words in (
        ("cells", MESH, "expected patches, got a mesh"),
        ("faces", cells, "expected a mesh, got patches"),
        ("cells", larger, "faces, got one of"),
    ):
        with pytest.raises(ConfigError, match=words):
            problem_of(made[name], elements, goal)


@pytest.mark.parametrize(
    ("mesh", "method", "task", "words"),
    [
        (room()[0], "certified", None, "use the same"),
        (MESH, "sampled:cpu", None, "got sampled"),
        (MESH, "certified", rc.Task(min_pixels=3), "min_pixels applies to faces"),
    ],
)
def test_cells_need_exact_visibility_of_their_own_mesh(mesh, method, task, words):
    cells = rc.cells(MESH, SIZE)
    with (
        rc.open_observer(mesh, CAMERA, method) as observer,
        pytest.raises(ConfigError, match=words),
    ):
        build_matrix(observer, POSES[:1], task, cells=cells)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_usual_size_gives_thousands_of_cells_of_large_faces(scale):
    mesh = rc.Mesh(MESH.vertices * scale, MESH.faces)
    size = usual_size(mesh)
    assert size == float(f"{size:.1e}")
    assert USUAL_CELLS / 4 <= len(rc.cells(mesh, size)) <= USUAL_CELLS + 2 * mesh.n_faces
