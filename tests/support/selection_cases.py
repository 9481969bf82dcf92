"""Random selection problems, and the definition of what covers a face, without the package."""

import math
from itertools import combinations

import numpy as np
from hypothesis import strategies as st

from rastercov.placement.select.methods import select_greedy, select_integer
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of_matrix
from rastercov.reference.thesis import select_thesis

QUICK = 200_000
"""Effort of the greedy search in tests."""
SELECTORS = {
    "plain": lambda problem: select_greedy(problem, effort=0),
    "greedy": lambda problem: select_greedy(problem, effort=QUICK),
    "integer": select_integer,
    "thesis": lambda problem: select_thesis(problem, sizes_of(problem)),
}


def sizes_of(problem):
    """(C,) faces of each candidate, as its mean coverage."""
    return [len(problem.faces_of(row)) for row in range(problem.n_candidates)]


def sign_of(problem):
    """1 where more is better, -1 where less is."""
    return 1 if isinstance(problem.goal, BestCoverage) else -1


def covers_faces(problem, chosen):
    """(F,) whether the chosen cover each face: the definition, with nothing from the package."""
    result, dense = [], rows_of(problem)
    rows = [row for c in chosen for row in range(problem.rows[c], problem.rows[c + 1])]
    for f in range(problem.n_faces):
        seeing = [row for row in rows if dense[row, f]]  # each camera of a rig
        enough = len(seeing) >= problem.views[f]
        if problem.min_angle > 0:
            rays = [problem.eyes[c] - problem.centroids[f] for c in seeing]
            rays = [ray / np.linalg.norm(ray) for ray in rays]
            angles = [math.acos(np.clip(a @ b, -1, 1)) for a, b in combinations(rays, 2)]
            enough &= any(angle >= problem.min_angle - 1e-9 for angle in angles)
        result.append(enough)
    return np.array(result, bool)


def share(problem, covered, of=True):
    whole = problem.weights[np.broadcast_to(of, len(covered))].sum()
    return problem.weights[covered & of].sum() / whole if whole else 1.0


def is_met(problem, covered):
    goal = problem.goal
    reachable = covers_faces(problem, range(problem.n_candidates))
    counted = reachable if goal.of_reachable else np.ones(len(covered), bool)
    met = share(problem, covered, counted) >= goal.coverage - 1e-6
    for name, least in goal.groups.items():
        rows = [f"{group}/".startswith(f"{name}/") for group in problem.groups]
        members = np.array(rows)[problem.face_group]
        met &= share(problem, covered, counted & members) >= least - 1e-6
    return met


def best_by_trying_all(problem):
    """The best objective of all sets of candidates."""
    goal, items = problem.goal, []
    for n in range(problem.n_candidates + 1):
        for chosen in combinations(range(problem.n_candidates), n):
            covered = covers_faces(problem, chosen)
            cost = problem.costs[list(chosen)].sum()
            if isinstance(goal, FewestCameras):
                if is_met(problem, covered):
                    items.append(-cost)
            elif n <= (goal.cameras if goal.cameras is not None else n) and cost <= (
                math.inf if goal.budget is None else goal.budget + 1e-9
            ):
                items.append(share(problem, covered))
    return abs(max(items))


@st.composite
def problems(
    draw,
    goals=("best", "budget", "fewest"),
    max_views=2,
    angles=(0, 0, 40, 90),
    sizes=(1, 3, 5, 7),
    faces=(1, 4, 9),
):
    """Selection problems, most of them with ties."""
    n, m = draw(st.sampled_from(sizes)), draw(st.sampled_from(faces))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    covers = rng.random((n, m)) < draw(st.sampled_from([0.2, 0.5, 0.8]))
    groups = ("left", "right/far", "right/near", "right/near/top")
    options = {
        "weights": draw(st.sampled_from([None, rng.integers(0, 4, m), rng.random(m)])),
        "views": rng.integers(1, max_views + 1, m),
        "costs": draw(st.sampled_from([None, rng.integers(1, 4, n), rng.random(n)])),
        "groups": groups,
        "face_group": rng.integers(0, len(groups), m),
        "min_angle_deg": draw(st.sampled_from(angles)),
        "eyes": rng.normal(size=(n, 3)) * 4,
        "centroids": rng.normal(size=(m, 3)),
    }
    kind = draw(st.sampled_from(goals))
    if kind == "best":
        goal = BestCoverage(int(rng.integers(0, n + 1)))
    elif kind == "budget":
        cameras = draw(st.sampled_from([None, n - 1]))
        goal = BestCoverage(cameras, budget=float(rng.uniform(0, 1.2 * n)))
    else:
        places = (*groups, "right")
        named = {name: float(rng.choice([0.3, 0.6, 1])) for name in places if rng.random() < 0.4}
        goal = FewestCameras(float(rng.choice([1e-9, 0.5, 0.9, 1])), named, of_reachable=True)
    return problem_of_matrix(covers, goal, **options)


def rows_of(problem):
    """(K, F) whether a camera covers a face."""
    dense = np.zeros((problem.bits.n_rows, problem.n_faces), np.uint8)
    for row in range(len(dense)):
        dense[row, problem.bits.faces_of(row)] = 1
    return dense


def dense_of(problem):
    """(C, F) whether a candidate covers a face."""
    rows = rows_of(problem)
    spans = zip(problem.rows[:-1], problem.rows[1:], strict=True)
    return np.array([rows[a:b].any(axis=0) for a, b in spans], np.uint8).reshape(
        problem.n_candidates, problem.n_faces
    )


def changed(problem, covers, **changes):
    """A problem with other covers, and some other values."""
    same = ("weights", "views", "costs", "groups", "face_group", "eyes", "centroids")
    options = {name: getattr(problem, name) for name in same} | changes
    angle = math.degrees(problem.min_angle)
    return problem_of_matrix(covers, problem.goal, min_angle_deg=angle, **options)
