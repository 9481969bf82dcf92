"""Population search over the poses of a network: particle swarm, genetic, differential evolution.

The usual method of the literature, for comparison and for mounting spaces that a list of candidates
does not represent. The poses of all cameras are the variables of one problem, and a generation of
networks is measured as one batch of poses. The algorithms are those of pymoo.

J. Kennedy, R. Eberhart. Particle Swarm Optimization. 1995.
R. Storn, K. Price. Differential Evolution. 1997.
J. Blank, K. Deb. pymoo: Multi-objective Optimization in Python. 2020.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import check_seed
from rastercov.base.errors import ConfigError
from rastercov.base.interrupts import interrupts_held
from rastercov.base.memory import FloatArray, IntArray
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses, valid_poses
from rastercov.mesh.arrays import frozen
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace

METHODS = ("random", "pso", "ga", "de")
KNOWN_PLACES = 256
"""Allowed positions that replace forbidden ones, the nearest each."""


@dataclass(frozen=True, eq=False)
class Optimised:
    """Best network of a search.

    Attributes
    ----------
    method : str
        One of `METHODS`.
    poses : (k, 4, 4) float64
        world_from_camera.
    share : float
        Share of the weight that it covers, [0, 1].
    trace : (N,) float64
        Best share after each measured network; after network n, k (n + 1) poses were evaluated.
    evaluations : int
        Poses that were measured: k N.
    generations : int
        Number of batches.
    seed : int
    seconds : float
    is_interrupted : bool
        An interrupt ended the search before the budget was spent.
    """

    method: str
    poses: FloatArray
    share: float
    trace: FloatArray
    evaluations: int
    generations: int
    seed: int
    seconds: float
    is_interrupted: bool = False


@typed
def optimise(
    objective: Objective,
    space: PoseSpace,
    cameras: int,
    method: str = "pso",
    *,
    budget: int = 20_000,
    population: int = 24,
    seed: int = 0,
    candidates: ArrayLike | None = None,
    start: ArrayLike | None = None,
    camera: ArrayLike = 0,
) -> Optimised:
    """Best network of a number of cameras found by a search within a budget.

    For comparison every method measures exactly `budget // cameras` networks and starts from the
    same ones. Each camera has six variables, its position in the boxes and its target in
    `space.aim`, and its roll where that is free. A camera at a forbidden position is moved to an
    allowed one. An interrupt (Ctrl-C) after the first generation ends the search and returns the
    best so far.

    Parameters
    ----------
    cameras : int
        Cameras k of the network, 1 or more.
    method : {"random", "pso", "ga", "de"}
        random draws each network anew; the others are pymoo's PSO, GA and DE with its defaults.
    budget : int
        Poses to measure.
    population : int
        Networks in a generation, 4 or more.
    seed : int
        The same seed gives the same network.
    candidates : (C, 4, 4) array_like, optional
        Poses for the first networks, k at random each. Those at forbidden positions are left
        out.
    start : (k, 4, 4) array_like, optional
        A network among the first; the result is no worse.
    camera : int or (k,) int array_like
        Index of the camera of each, where the observer has several.

    Raises
    ------
    ConfigError
        For a value outside its range, a start at a forbidden position, or without pymoo.
    """
    began = time.perf_counter()
    networks = _checked(cameras, method, budget, population)
    check_seed(seed)
    own = Poses.of(np.tile(np.eye(4), (cameras, 1, 1)), camera=camera).camera
    rng = np.random.default_rng(seed)
    code = _Code(space, cameras, space.sample(KNOWN_PLACES, rng))
    first = rng.random((population, code.n_variables))
    given = _given(space, cameras, candidates, start, population, rng)
    for row, poses in enumerate(given):
        first[row] = code.remember(poses)
    ask, tell = _random(first, rng) if method == "random" else _pymoo(method, first, seed)

    best, best_worth = np.zeros((cameras, 4, 4)), -1
    worths: list[IntArray] = []
    left, generations = networks, 0
    is_interrupted = False
    try:
        while left > 0:
            variables = ask()
            poses = code.poses(variables)[:left]  # the last generation may be cut short
            worth = objective.worth(objective.covered(*objective.networks(poses, own)))
            with interrupts_held():
                top = int(np.argmax(worth))
                if int(worth[top]) > best_worth:
                    best, best_worth = poses[top], int(worth[top])
                worths.append(worth)
                left -= len(poses)
                generations += 1
            if left > 0:
                tell(objective.share(worth))
    except KeyboardInterrupt:
        if not worths:
            raise
        is_interrupted = True
    trace = objective.share(np.maximum.accumulate(np.concatenate(worths)))
    return Optimised(
        method=method,
        poses=frozen(best.copy()),
        share=float(objective.share(best_worth)),
        trace=frozen(trace),
        evaluations=(networks - left) * cameras,
        generations=generations,
        seed=seed,
        seconds=time.perf_counter() - began,
        is_interrupted=is_interrupted,
    )


class _Code:
    """Encoding of networks as rows of numbers in [0, 1]."""

    def __init__(self, space: PoseSpace, cameras: int, known: FloatArray) -> None:
        self.space, self.cameras, self.known = space, cameras, known
        self.a_camera = 7 if space.is_roll_free else 6
        self.n_variables = cameras * self.a_camera
        self.aim = np.asarray(space.aim, np.float64)
        self._exact: dict[bytes, FloatArray] = {}

    def poses(self, variables: FloatArray) -> FloatArray:
        """(N, k, 4, 4) poses of (N, variables), all at allowed positions."""
        values = variables.reshape(-1, self.a_camera)
        hull, aim = self.space.hull, self.aim
        eyes, allowed = self.space.project_to_allowed(hull[0] + values[:, :3] * (hull[1] - hull[0]))
        for row in np.flatnonzero(~allowed).tolist():  # some ten microseconds each
            nearest = ((self.known - eyes[row]) ** 2).sum(axis=1).argmin()
            eyes[row] = self.known[nearest]
        forwards = aim[0] + values[:, 3:6] * (aim[1] - aim[0]) - eyes
        forwards[(forwards == 0).all(axis=1)] = (1.0, 0.0, 0.0)
        rolls = np.zeros(len(eyes))
        if self.space.is_roll_free:
            rolls = (values[:, 6] - 0.5) * (2 * np.pi)
        composed = self.space.composed(eyes, forwards, rolls)
        poses: FloatArray = composed.reshape(-1, self.cameras, 4, 4)
        for row, of_network in enumerate(variables):
            poses[row] = self._exact.get(of_network.tobytes(), poses[row])
        return poses

    def remember(self, poses: FloatArray) -> FloatArray:
        """(variables,) nearest encoding of a network, which `poses` decodes exactly."""
        eyes, forwards, rolls = self.space.decomposed(poses)
        hull, aim = self.space.hull, self.aim
        targets = np.clip(eyes + _depths(eyes, forwards, aim)[:, None] * forwards, aim[0], aim[1])
        columns = [_parts(eyes, hull), _parts(targets, aim)]
        if self.space.is_roll_free:
            columns.append(rolls[:, None] / (2 * np.pi) + 0.5)
        row: FloatArray = np.concatenate(columns, axis=1).reshape(-1)
        self._exact[row.tobytes()] = poses
        return row


def _depths(eyes: FloatArray, forwards: FloatArray, box: FloatArray) -> FloatArray:
    """(N,) depth of the midpoint of each axis in the box, or nearest to its centre if it misses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (box[:, None] - eyes) / forwards
    ends = np.sort(np.where(np.isnan(ends), 0.0, ends), axis=0)
    enters = np.maximum(ends[0].max(axis=1), 0.0)
    leaves = ends[1].min(axis=1)
    passes = np.einsum("ni,ni->n", box.mean(axis=0) - eyes, forwards)
    return np.where(leaves > enters, (enters + leaves) / 2, np.maximum(passes, 0.0))


def _parts(points: FloatArray, box: FloatArray) -> FloatArray:
    """Relative position of points in a box, [0, 1]; 0.5 along axes where it is flat."""
    size = box[1] - box[0]
    parts = (points - box[0]) / np.where(size > 0, size, 1.0)
    return np.clip(np.where(size > 0, parts, 0.5), 0.0, 1.0)


def _given(
    space: PoseSpace,
    cameras: int,
    candidates: ArrayLike | None,
    start: ArrayLike | None,
    population: int,
    rng: np.random.Generator,
) -> list[FloatArray]:
    """Initial networks: those of the caller, then random sets of candidates."""
    networks: list[FloatArray] = []
    if start is not None:
        if np.shape(start) != (cameras, 4, 4):
            raise ConfigError(f"start must have shape ({cameras}, 4, 4), got {np.shape(start)}")
        networks = [valid_poses(start)]
        space.require(networks[0], "camera")
    if candidates is not None:
        poses = valid_poses(candidates)
        poses = poses[space.allows(poses[:, :3, 3])]
        if not len(poses):
            raise ConfigError(
                "cameras may stand at none of the candidates; allow more, or add some"
            )
        while len(networks) < population:
            drawn = rng.choice(len(poses), cameras, replace=len(poses) < cameras)
            networks.append(poses[drawn])
    return networks


Ask = Callable[[], FloatArray]
Tell = Callable[[FloatArray], None]


def _random(first: FloatArray, rng: np.random.Generator) -> tuple[Ask, Tell]:
    generations = chain([first], (rng.random(first.shape) for _ in repeat(None)))
    return lambda: next(generations), lambda shares: None


def _pymoo(method: str, first: FloatArray, seed: int) -> tuple[Ask, Tell]:
    """Functions `ask` and `tell` of an algorithm of pymoo: next generation, and its shares."""
    try:
        from pymoo.algorithms.soo.nonconvex.de import DE
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.algorithms.soo.nonconvex.pso import PSO
        from pymoo.config import Config
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination
        from pymoo.problems.static import StaticProblem
    except ImportError:
        raise ConfigError(
            f"method {method} needs pymoo; install rastercov[place], or use method random"
        ) from None
    Config.warnings["not_compiled"] = False  # it would be on standard output
    algorithm: Any = {"pso": PSO, "ga": GA, "de": DE}[method](pop_size=len(first), sampling=first)
    problem = Problem(n_var=first.shape[1], n_obj=1, xl=0.0, xu=1.0)
    algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)
    asked: list[Any] = []

    def ask() -> FloatArray:
        asked.append(algorithm.ask())
        return np.ascontiguousarray(asked[-1].get("X"), np.float64)

    def tell(shares: FloatArray) -> None:
        generation = asked.pop()
        known = StaticProblem(problem, F=-shares[:, None])  # pymoo minimises
        algorithm.evaluator.eval(known, generation, skip_already_evaluated=False)
        algorithm.tell(infills=generation)

    return ask, tell


def _checked(cameras: int, method: str, budget: int, population: int) -> int:
    """Number of networks to measure; ConfigError for a value outside its range."""
    if method not in METHODS:
        raise ConfigError(f"method must be {', '.join(METHODS)}, got {method!r}")
    least = {"cameras": (cameras, 1), "population": (population, 4), "budget": (budget, cameras)}
    for name, (value, low) in least.items():
        if value < low:
            raise ConfigError(f"{name} must be a whole number, {low} or more, got {value}")
    return budget // cameras
