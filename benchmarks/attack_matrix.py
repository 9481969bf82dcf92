"""Attack on what placement keeps and decides: damaged matrices, and integer programs out of time.

`damage` flips bits of a matrix on the disk, cuts, zeroes, deletes, exchanges and replaces its
files, and builds it again; `limits` holds `select_integer` to its time limits.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from matrix_damage import campaign
from rows import Report
from set_cover_cases import (
    FOLDER,
    HARD_FOR_THE_CLOCK,
    OPTIMA,
    random_cover,
    read_set_cover,
    steiner,
)

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.select.methods import select_greedy, select_integer
from rastercov.placement.select.problem import BestCoverage, Problem, problem_of_matrix

TRIALS = 3000
"""Damaged folders of the whole campaign, of eleven kinds of damage."""
LIMITS = (0.5, 1.0, 2.0, 5.0)
"""Seconds."""
ALLOWANCE = 0.2
"""Seconds beyond a tenth of the limit."""


def attack(report: Report, effort: float) -> None:
    """All of it; `effort` 1 is the whole campaign, 0.05 a trial run."""
    wrong = damage(max(1, round(effort * TRIALS)))
    for what, verdict in list(wrong.items())[:10]:
        print(f"{what}: {verdict}", file=sys.stderr)
    report.add("damaged matrices", max(1, round(effort * TRIALS)), "folders")
    report.add(
        "damaged matrices believed, not mended, or not refused", len(wrong), "folders", at_most=0
    )
    report.check("a damaged matrix is refused when read, and mended when built", not wrong)
    limits(report, effort)


def damage(trials: int, seed: int = 0) -> dict[str, str]:
    """Faults of damaged matrices, by the damage."""
    poses = rc.sphere_of_poses((0, 0, 0), 4.2, 11)
    task = rc.Task(min_coverage=0.3, max_incidence_deg=80)
    camera = rc.Camera(width=64, height=64, fx=70, fy=70)
    with (
        rc.open_observer(shapes.torus(12, 8), camera) as observer,
        tempfile.TemporaryDirectory() as folder,
    ):
        inputs = {"view": observer, "poses": poses, "task": task, "poses_a_shard": 4}
        return campaign(Path(folder), inputs, poses[::-1], trials, seed)


def limits(report: Report, effort: float) -> None:
    """Hold the integer program to its limits, on problems of 1,000 to 2 million pairs."""
    seconds = LIMITS if effort >= 0.5 else LIMITS[:1]
    problems: dict[str, Callable[[], Problem]] = {
        name: partial(read_set_cover, FOLDER / f"{name}.txt.xz") for name in OPTIMA
    }
    problems |= HARD_FOR_THE_CLOCK
    problems["Steiner A45"] = lambda: problem_of_matrix(steiner(45))
    if effort >= 0.05:
        large = partial(random_cover, 10_000, 10_000)
        problems["10,000 x 10,000, sparse"] = partial(large, 0.001)
        problems["10,000 x 10,000"] = partial(large, 0.02)
        problems["10,000 x 10,000, best 20"] = partial(large, 0.02, BestCoverage(20))
    for make in problems.values():  # load every loop
        select_integer(make(), time_limit=1e-3)
    for name, make in problems.items():
        problem = make()
        plain = select_greedy(problem, effort=0)
        sign = 1 if isinstance(problem.goal, BestCoverage) else -1
        for limit in seconds:
            started = time.perf_counter()
            selection = select_integer(problem, time_limit=limit)
            beyond = time.perf_counter() - started - 1.1 * limit
            report.add(
                f"{name}, limit {limit:g} s: beyond 1.1 times it", beyond, "s", at_most=ALLOWANCE
            )
            report.check(
                f"{name}, limit {limit:g} s: not worse than plain greedy, within its bound",
                sign * plain.objective <= sign * selection.objective <= sign * selection.bound,
            )
    for name in ("scp41", "scp42"):
        selection = select_integer(problems[name](), time_limit=1.0)
        proved = selection.objective == selection.bound == OPTIMA[name]
        report.check(f"{name}: proved within 1 s, HiGHS alone takes 0.02 s", proved)
