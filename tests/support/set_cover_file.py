"""Set-covering problems in OR-Library's format, for comparison with published optima."""

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
