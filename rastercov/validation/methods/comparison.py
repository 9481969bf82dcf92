"""The comparison harness: ways to find visibility against the truth, and a verdict on their bounds.

Beside the chain: it opens observers and the authority in `rastercov.reference`, gives both the same
poses, and adds up how far they are apart, pose by pose, so that memory does not grow with poses.
Compared are the faces in view from the front, those that are partly outside the image included:
their visible fraction (3.14), with its bound, and the visible area in px^2.

`write_comparison` in `page` makes a page of it.
"""

import hashlib
import math
import platform
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._interrupts import interrupts_held
from rastercov.camera import Camera
from rastercov.criteria import view_faces
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.pose import valid_poses
from rastercov.validation.methods.contenders import TRUTHS, Candidate, entered, open_truth
from rastercov.validation.methods.convergence import N_POSES as SWEPT_POSES
from rastercov.validation.methods.convergence import (
    SWEEPS,
    Convergence,
    KnownFaces,
    converge,
    levels,
)
from rastercov.validation.methods.error_statistics import ROUNDING
from rastercov.validation.methods.results import MUST_HOLD, Check, Comparison, Score

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CANDIDATES = ("certified", "sampled", "sampled@4")
"""What is compared unless something is asked for."""
ENOUGH = 1000
"""Partly hidden faces that it takes to say that a statistical bound holds as often as it must."""
CHANCE = 0.01
"""How likely it may be that a good bound is found to hold too rarely."""
PAIRS_A_BATCH = 1 << 19
"""Pose-face pairs observed at a time: about 10 MB for each candidate."""
POSES_A_BATCH = 16
"""Most poses observed at a time."""


def compare(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    candidates: Sequence[str | Candidate] = CANDIDATES,
    against: str = "exact",
    *,
    worst: int = 6,
    convergence: bool = True,
    batch: int = POSES_A_BATCH,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Comparison:
    """Errors of several ways to find visibility, and whether their bounds hold.

    An interrupt (Ctrl-C) ends it after the pose that is done; the comparison then covers the poses
    so far. Before the first one is done, the interrupt is raised.

    Parameters
    ----------
    mesh, camera
        Any scene.
    poses : (P, 4, 4) array_like
        world_from_camera.
    candidates : sequence of str or Candidate
        What to compare; strings as for `Candidate.parse`.
    against : {"exact", "polygons", "rational"}
        The truth: the analytic method; polygon Booleans or exact rational arithmetic, which share
        nothing with it and take milliseconds a face.
    worst : int
        Faces to keep by name for each candidate.
    convergence : bool
        Measure how errors fall with the density of samples, too.
    batch : int
        Most poses observed at a time; it changes no result.
    progress : callable
        Called with the poses done and the poses in all, those of `convergence` among them.

    Raises
    ------
    ConfigError
        For a candidate or truth that does not exist, a candidate that is the truth or comes twice,
        or where there is nothing to compare.
    PoseError
        For a pose that is no rigid motion.
    """
    named = [Candidate.parse(c) if isinstance(c, str) else c for c in candidates]
    matrices = valid_poses(poses)
    _check_arguments(named, against, matrices)
    swept = list(
        {c.device: replace(c, supersample=1) for c in named if c.method == "sampled"}.values()
    )
    chosen = np.unique(np.linspace(0, len(matrices) - 1, SWEPT_POSES).astype(int)).tolist()
    sweeps = [(c, sweep) for c in swept for sweep in SWEEPS if convergence]
    total = len(matrices) + len(chosen) * sum(len(levels(sweep, camera)) for _, sweep in sweeps)
    done, interrupted = 0, False
    known: list[KnownFaces] = []
    found: list[Convergence] = []
    with ExitStack() as stack:
        truth = stack.enter_context(open_truth(against, mesh, camera))
        entrants = [stack.enter_context(entered(c, mesh, camera, matrices, worst)) for c in named]
        at_once = max(1, min(batch, PAIRS_A_BATCH // max(1, mesh.n_faces)))
        try:
            progress(0, total)
            for start in range(0, len(matrices), at_once):
                of_batch = matrices[start : start + at_once]
                for entrant in entrants:
                    entrant.look(of_batch)
                truth.look(of_batch)
                for row, pose in enumerate(of_batch):
                    view = view_faces(mesh, camera, pose)
                    face = np.flatnonzero(view.is_front & (view.in_view_fraction > 0))
                    visible, area, error = truth.areas(row, face)
                    with interrupts_held():
                        for entrant in entrants:
                            entrant.judge(start + row, row, view, face, visible, area, error)
                        if start + row in chosen and sweeps:
                            known.append(_partly_hidden(pose, face, visible, area, error))
                        done += 1
                    progress(done, total)
        except KeyboardInterrupt:
            if not done:
                raise
            interrupted = True
    counter = iter(range(done + 1, total + 1))
    try:
        for candidate, sweep in sweeps if not interrupted else ():
            step = lambda: progress(next(counter), total)  # noqa: E731 - two words
            found.append(converge(candidate.name, candidate.open, sweep, mesh, camera, known, step))
    except KeyboardInterrupt:
        interrupted = True
    scores = tuple(entrant.score() for entrant in entrants)
    if not any(score.all_sizes.figures for score in scores):
        raise ConfigError("no face is in view from the front in any pose: nothing to compare")
    checks = tuple(check for score in scores for check in _checks(score))
    return Comparison(
        against=against,
        truth_error=truth.error,
        truth_seconds_per_pose=truth.seconds / truth.poses,
        faces=mesh.n_faces,
        poses=len(matrices),
        poses_done=done,
        passed=all(check.passed is not False for check in checks),
        checks=checks,
        scores=scores,
        convergence=tuple(found),
        interrupted=interrupted,
        run=_describe(mesh, camera, matrices),
    )


def _check_arguments(candidates: Sequence[Candidate], against: str, poses: FloatArray) -> None:
    if against not in TRUTHS:
        raise ConfigError(f"the truth must be {', '.join(TRUTHS)}, got {against!r}")
    names = [candidate.name for candidate in candidates]
    if not names:
        raise ConfigError("name at least one method to compare")
    if twice := sorted(name for name in set(names) if names.count(name) > 1):
        raise ConfigError(f"{twice[0]} is named twice; once is enough")
    if against in names:
        raise ConfigError(f"{against} is the truth here; compare it against polygons")
    if not len(poses):
        raise ConfigError("there are no poses, so there is nothing to compare")


def _checks(score: Score) -> Iterator[Check]:
    for bound in score.bounds:
        if bound.kind == "statistical":
            held, n = bound.partly_hidden_held, bound.partly_hidden
            yield Check(score.name, bound.kind, held, n, MUST_HOLD, _often_enough(held, n))
        else:
            passed = bound.held == bound.figures
            yield Check(score.name, bound.kind, bound.held, bound.figures, 1.0, passed)


def _often_enough(held: int, n: int) -> bool | None:
    """Whether a bound held for `MUST_HOLD` of n faces; None where chance may have decided."""
    broken, expected = n - held, (1 - MUST_HOLD) * n
    if held >= MUST_HOLD * n:
        return True if n >= ENOUGH else None
    if broken > expected + 10 * math.sqrt(expected) + 20:
        return False
    # Poisson: how likely so many or more are broken where the bound is just good enough.
    fewer = sum(expected**k / math.factorial(k) for k in range(broken)) * math.exp(-expected)
    return False if 1 - fewer < CHANCE else None


def _partly_hidden(
    pose: FloatArray, face: IntArray, visible: FloatArray, area: FloatArray, error: FloatArray
) -> KnownFaces:
    least = np.maximum(ROUNDING, error) + ROUNDING * area
    rows = (area >= 1) & (visible > least) & (visible < area - least)
    return KnownFaces(pose, face[rows], area[rows], visible[rows] / area[rows])


def _describe(mesh: Mesh, camera: Camera, poses: FloatArray) -> dict[str, Any]:
    return {
        "mesh": [asdict(source) for source in mesh.sources] or [{"name": "arrays"}],
        "camera": {k: v for k, v in asdict(camera).items() if v not in (None, ())},
        "poses": {"sha256": hashlib.sha256(poses.tobytes()).hexdigest(), "n_poses": len(poses)},
        "machine": {"system": platform.platform(), "processor": platform.machine()},
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in ("rastercov", "numba", "numpy", "shapely")},
        },
    }
