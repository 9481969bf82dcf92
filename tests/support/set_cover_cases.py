"""Set-cover problems whose optimum is known: published files, triple systems, brute force."""

from functools import partial
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
from set_cover_file import read_set_cover as read_set_cover

from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of_matrix

FOLDER = Path(__file__).parents[1] / "data" / "set_cover"
OPTIMA = {"scp41": 429, "scp42": 512, "scp51": 253, "scpa1": 253, "scpe1": 5}
"""Least costs of the problems of OR-Library in `FOLDER`, as published."""
COVERS = {9: 5, 15: 9, 27: 18, 45: 30}
"""Fewest points that meet every triple of `steiner_triples`."""


def steiner_triples(n_points):
    """Triples of a Steiner system: every two points lie in exactly one.

    A9 is the affine plane of order 3, A15 is Bose's system, A27 and A45 are three of either.

    D. R. Fulkerson, G. L. Nemhauser, L. E. Trotter. Two computationally difficult set covering
    problems that arise in computing the 1-width of incidence matrices of Steiner triple systems.
    1974.
    """
    if n_points in (9, 15):
        q = n_points // 3
        half = pow(2, -1, q)
        triples = [[i, i + q, i + 2 * q] for i in range(q)]
        for level in range(3):
            for i, j in combinations(range(q), 2):
                third = (i + j) * half % q + (level + 1) % 3 * q
                triples.append([i + level * q, j + level * q, third])
        return np.array(triples)
    m = n_points // 3
    triples = [[i, i + m, i + 2 * m] for i in range(m)]
    for triple in steiner_triples(m):
        triples += [list(triple + level * m) for level in range(3)]
        triples += [list(order) for order in permutations(triple)]
        triples[-6:] = [[i, j + m, k + 2 * m] for i, j, k in triples[-6:]]
    return np.array(triples)


def steiner(n_points):
    """(n_points, triples) whether a point lies in a triple."""
    triples = steiner_triples(n_points)
    covers = np.zeros((n_points, len(triples)), np.uint8)
    covers[triples.T, np.arange(len(triples))] = 1
    return covers


def random_cover(n_candidates, n_faces, share, goal=None, *, angle_deg=0.0, seed=1):
    """A problem in which each candidate covers about a share of the faces, at random.

    With an angle, each face takes two views from directions that differ by it.
    """
    rng = np.random.default_rng(seed)
    covers = np.zeros((n_candidates, n_faces), np.uint8)
    for row in covers:
        row[rng.integers(0, n_faces, int(share * n_faces))] = 1
    options = {}
    if angle_deg:
        options = {
            "views": 2,
            "min_angle_deg": angle_deg,
            "eyes": 4 * rng.normal(size=(n_candidates, 3)),
            "centroids": rng.normal(size=(n_faces, 3)) / 2,
        }
    return problem_of_matrix(covers, goal or FewestCameras(of_reachable=True), **options)


HARD_FOR_THE_CLOCK = {
    "many cameras to improve and to order": partial(random_cover, 4000, 4000, 0.0025),
    "a presolve that does not listen": partial(
        random_cover, 1000, 2000, 0.1, BestCoverage(20), angle_deg=40
    ),
    "directions to separate": partial(random_cover, 300, 2000, 0.1, angle_deg=20),
}
"""Functions that make a problem of which some part takes long without a look at the clock."""
