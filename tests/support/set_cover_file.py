"""Set-covering problems in OR-Library's format, for comparison with published optima."""

import lzma
from pathlib import Path

import numpy as np

from rastercov.base.errors import ConfigError
from rastercov.placement.select.problem import Goal, Problem, problem_of_matrix


def read_set_cover(path: str | Path, goal: Goal | None = None) -> Problem:
    """Selection problem of a file in OR-Library's format of set covering.

    Numbers between white space: rows m and columns n; the cost of each column; then for each row
    how many columns cover it, and which, counted from 1. Rows become faces, columns candidates. A
    file whose name ends in .xz is unpacked.

    J. E. Beasley. OR-Library: distributing test problems by electronic mail. 1990.
    """
    path = Path(path)
    try:
        with lzma.open(path) if path.suffix == ".xz" else path.open("rb") as file:
            numbers = [int(word) for word in file.read().split()]
        n_faces, n_candidates = numbers[:2]
        at = 2 + n_candidates
        covers = np.zeros((n_candidates, n_faces), np.bool_)
        for row in range(n_faces):
            columns = np.array(numbers[at + 1 : at + 1 + numbers[at]], np.int64)
            if len(columns) != numbers[at] or columns.min(initial=1) < 1:
                raise ValueError
            covers[columns - 1, row] = True
            at += 1 + numbers[at]
        if at != len(numbers):
            raise ValueError
    except OSError as error:
        raise ConfigError(f"{path}: the file cannot be read ({error.strerror})") from None
    except (ValueError, IndexError, EOFError, lzma.LZMAError):
        raise ConfigError(f"{path}: this is no set-covering file of OR-Library's format") from None
    return problem_of_matrix(covers, goal, costs=numbers[2 : 2 + n_candidates])
