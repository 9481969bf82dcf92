"""Set-covering problems in two published formats, for comparison with the best known costs."""

import lzma
from pathlib import Path

import numpy as np

from rastercov.placement.select.problem import Goal, Problem, problem_of_matrix


def read_set_cover(path: str | Path, goal: Goal | None = None) -> Problem:
    """Selection problem of a file in OR-Library's format of set covering.

    Numbers between white space: rows m and columns n; the cost of each column; then for each row
    how many columns cover it, and which, counted from 1. Rows become faces, columns candidates. A
    file whose name ends in .xz is unpacked.

    J. E. Beasley. OR-Library: distributing test problems by electronic mail. 1990.
    """
    with lzma.open(path) if Path(path).suffix == ".xz" else Path(path).open("rb") as file:
        numbers = [int(word) for word in file.read().split()]
    n_faces, n_candidates = numbers[:2]
    at = 2 + n_candidates
    covers = np.zeros((n_candidates, n_faces), np.bool_)
    for row in range(n_faces):
        covers[np.array(numbers[at + 1 : at + 1 + numbers[at]]) - 1, row] = True
        at += 1 + numbers[at]
    assert at == len(numbers)
    return problem_of_matrix(covers, goal, costs=numbers[2 : 2 + n_candidates])


def read_camera_cover(path: str | Path) -> Problem:
    """Selection problem of a file in the format of the camera-placement competitions of GECCO.

    Numbers between white space: samples m and candidate cameras n; then for each sample its index
    from 0, how many cameras cover it, and which, counted from 0. All costs are 1.

    M. Brévilliers, J. Lepagnot, L. Idoumghar. GECCO 2020 competition on the optimal camera
    placement problem and the unicost set covering problem.
    """
    numbers = [int(word) for word in Path(path).read_text(encoding="ascii").split()]
    n_faces, n_candidates = numbers[:2]
    at = 2
    covers = np.zeros((n_candidates, n_faces), np.bool_)
    for _ in range(n_faces):
        row, n_covering = numbers[at : at + 2]
        at += 2
        covers[numbers[at : at + n_covering], row] = True
        at += n_covering
    assert at == len(numbers)
    return problem_of_matrix(covers)
