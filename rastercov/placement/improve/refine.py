"""Refinement of a network by a compass search over the pose of one camera at a time.

After selection, which is limited to given poses. Every camera tries small moves while the others
are fixed; the move with the largest gain is made; where no move gains, the step is halved. Random
moves are among them, because a count of covered faces has plateaus where no move along an axis
gains. All trials of all cameras are one batch. The share never falls, and the search ends where no
move of one camera at any step gains: a local optimum with respect to those moves only.

Where the objective has an estimate that is cheaper than a measurement, trials are estimated, and
those that seem to gain are measured, the best first: a camera moves only where a measured trial
gains. What a trial covers does not depend on the other cameras, so nothing is measured twice.

R. Hooke, T. A. Jeeves. "Direct Search" Solution of Numerical and Statistical Problems. 1961.
T. G. Kolda, R. M. Lewis, V. Torczon. Optimization by Direct Search. 2003.

Search for a network among free poses: drawn at random, measured once, chosen by exchanges.

For mounting spaces that a list of candidates does not represent. The cameras of a network are
replaced one by one by the measured pose that adds most to the others, until none adds more. With
refinement after it, that reaches what swarms and evolution of the poses reach, or more, with as
many measured poses.

M. B. Teitz, P. Bart. Heuristic Methods for Estimating the Generalized Vertex Median of a Weighted
Graph. 1968.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    AnyArray,
    BoolArray,
    ConfigError,
    FloatArray,
    IntArray,
    Lists,
    check_seed,
    draw_between,
    frozen_record,
    matmul,
    tan,
)
from rastercov.base.interrupts import hold_interrupts
from rastercov.base.typed import typed
from rastercov.core.camera import Poses, renumber, valid_poses
from rastercov.core.mesh.arrays import frozen
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace

LOCAL_OPTIMUM = "local optimum"
BUDGET_SPENT = "budget spent"
EVERYTHING = "everything covered"
INTERRUPTED = "interrupted"
BUDGET = 50_000
"""Poses to measure, unless given."""
STEP = 0.25
"""First step relative to the distance from the camera to the nearest evaluated face."""
TURN_DEG = 16.0
LEAST_TURN_DEG = 1e-9
"""A smaller turn, halved, moves no pixel, and its reach overflows."""
HALVINGS = 5
RANDOM_MOVES = 24
"""Random moves of a camera at each step that combine all axes, besides the 18 or 20 along them."""
ALONG = np.concatenate((np.eye(6)[:3], -np.eye(6)[:3]))
SIDEWAYS = ALONG[ALONG[:, 2] == 0]
AROUND = np.array(
    [(0, 0, 0, *each, 0) for each in product((-1.0, 0.0, 1.0), repeat=2) if any(each)]
)
TAIL = 3.65
"""Limit of random moves: beyond it numpy draws them by logarithms, which differ by the library."""
ROLLED = np.outer((-1.0, 1.0), np.eye(6)[5])
"""Moves of a camera: steps along its axes, and turns across, along and about its view."""


@dataclass(eq=False)
class _Trials:
    """Poses one move away from a camera, (M, 4, 4), faces of their rows, (M, width, 3) centres.

    Rows are those of an `Objective`. `measured` are those of the trials whose faces in `covers` are
    an estimate and that were measured since.
    """

    poses: FloatArray
    covers: Lists
    eyes: FloatArray
    measured: dict[int, Lists] = field(default_factory=dict)


@frozen_record
class Refined:
    """A network after its cameras were moved.

    Attributes
    ----------
    poses : (k, 4, 4) float64
        world_from_camera, in the order of the start.
    share, start_share : float
        Share of the weight covered at the end and at the start; never less than at the start.
    trace : (N,) float64
        Share at the start and after each move.
    moved : (k,) bool
        True for cameras whose pose changed.
    status : {"local optimum", "everything covered", "budget spent", "interrupted"}
        No move of one camera gains at any step; all of the weight is covered; or the budget or an
        interrupt ended the search.
    evaluations : int
        Number of poses that were measured or estimated.
    seconds : float
        Time of the search.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Objective, PoseSpace, refine
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=2)
    >>> space = PoseSpace(mesh=mesh, stand_off=(1, 4))
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     refinement = refine(objective, space, poses, budget=200)
    >>> refinement.moved.tolist(), refinement.share > refinement.start_share
    ([True, True], True)
    """

    poses: FloatArray
    share: float
    start_share: float
    trace: FloatArray
    moved: BoolArray
    status: str
    evaluations: int
    seconds: float


@typed
def refine(
    objective: Objective,
    space: PoseSpace,
    poses: ArrayLike | Poses,
    *,
    step: float | Sequence[float] | None = None,
    turn_deg: float = TURN_DEG,
    halvings: int = HALVINGS,
    budget: int = BUDGET,
    seed: int = 0,
    fixed: ArrayLike = False,
) -> Refined:
    """Move the cameras of a network until no move increases the share; never worse than the start.

    A camera is translated along its axes, rotated about them, and translated sideways with the
    rotation that keeps the centre of its image. The result is deterministic. An interrupt (Ctrl-C)
    ends the search and returns the best so far, with status "interrupted".

    Parameters
    ----------
    objective : Objective
        Share to increase.
    space : PoseSpace
        Allowed positions.
    poses : (k, 4, 4) array_like, or Poses
        Start: the poses of a selection, of a search, or of a rig. `Poses.camera` is the index of
        the camera of each pose, which it keeps.
    step : float or (k,) floats, optional
        First translation of each camera, metres; a quarter of its distance to the nearest evaluated
        face by default.
    turn_deg : float
        First rotation, degrees, (0, 90].
    halvings : int
        Number of times that translations and rotations are halved.
    budget : int
        Maximum number of poses to measure or estimate.
    seed : int
        Seed of the random moves. The same start and seed give the same network.
    fixed : bool or (k,) bool array_like
        True for cameras that are not moved, which may be at forbidden positions.

    Raises
    ------
    ConfigError
        For another camera at a forbidden position, or a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Objective, PoseSpace, refine
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=2)
    >>> space = PoseSpace(mesh=mesh, stand_off=(1, 4))
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     refinement = refine(objective, space, poses, budget=200)
    >>> refinement.share >= refinement.start_share, refinement.status
    (True, 'budget spent')
    """
    began = time.perf_counter()
    placed = renumber(poses)
    start = placed.world_from_camera
    steps = _steps(space, start, step)
    check_seed(seed)
    if not LEAST_TURN_DEG <= turn_deg <= 90:
        raise ConfigError(
            f"expected turn_deg of {LEAST_TURN_DEG:g} to 90, got {turn_deg}; give degrees"
        )
    for name, value, low in (("halvings", halvings, 0), ("budget", budget, len(start))):
        if value < low:
            raise ConfigError(f"expected {name} of {low} or more, got {value}; increase it")
    is_fixed = np.asarray(fixed)
    if is_fixed.dtype != np.bool_ or is_fixed.shape not in ((), (len(start),)):
        raise ConfigError(
            f"expected fixed as a bool or {len(start)} of them, got {is_fixed.dtype} of shape "
            f"{is_fixed.shape}; give one per camera"
        )
    is_fixed = np.broadcast_to(is_fixed, len(start))
    space.require(start[~is_fixed], "camera")

    search = NetworkSearch(objective, space, placed, budget, seed, is_fixed)
    try:
        status = _descend(search, steps, np.radians(turn_deg), halvings)
    except KeyboardInterrupt:
        status = INTERRUPTED
    trace = objective.share(np.array(search.trace, np.int64))
    return Refined(
        poses=frozen(search.poses),
        share=float(trace[-1]),
        start_share=float(trace[0]),
        trace=frozen(trace),
        moved=frozen((search.poses != start).any(axis=(1, 2))),
        status=status,
        evaluations=search.evaluations,
        seconds=time.perf_counter() - began,
    )


def _descend(search: "NetworkSearch", steps: FloatArray, turn: float, halvings: int) -> str:
    """Move cameras until no level gains; the status."""
    level = fails = 0
    # All levels in turn, until every one has failed since the last gain.
    while search.has_room and fails <= halvings and len(search.poses):
        scale = 0.5**level
        if not search.sharpen(level, steps * scale, turn * scale):
            return BUDGET_SPENT
        if search.improve(level):
            fails = 0
        else:
            fails += 1
            level = (level + 1) % (halvings + 1)
    return LOCAL_OPTIMUM if search.has_room else EVERYTHING


class NetworkSearch:
    """A network, the faces it covers, and the measured trials around each camera."""

    def __init__(
        self, objective: Objective, space: PoseSpace, placed: Poses, budget: int, seed: int,
        is_fixed: BoolArray,
    ) -> None:  # fmt: skip
        self.objective, self.space, self.budget, self.seed = objective, space, budget, seed
        self.is_fixed = is_fixed
        start, self.camera = placed.world_from_camera, placed.camera
        self.poses = start.copy()
        # (k, width, F) faces and (k, width, 3) centres: the cameras of rigs may count one by one.
        self.width = objective.width
        covers, eyes = objective.networks(start[None], self.camera)
        self.covers = covers[0].reshape(len(start), self.width, covers.shape[-1])
        self.eyes = eyes[0].reshape(len(start), self.width, 3).copy()
        self.evaluations = len(start)
        # What a trial is estimated to cover is compared with the same estimate of the camera.
        self._own: list[Lists | None] = [None] * len(start)
        if objective.is_estimated:
            estimate = objective.estimated(placed)
            self._own = [self._rows(estimate, row) for row in range(len(start))]
        self.worth = self._worth()
        self.trace = [self.worth]
        self._moves_made = np.zeros(len(start), np.int64)
        # Trials of each camera and level, until the camera moves.
        self._trials: list[dict[int, _Trials]] = [{} for _ in start]

    def _rows(self, lists: Lists, row: int, count: int = 1) -> Lists:
        """Faces of all rows of some poses."""
        return lists.part(row * self.width, (row + count) * self.width)

    @property
    def has_room(self) -> bool:
        """True while some weight is uncovered."""
        return self.worth < self.objective.total

    def sharpen(self, level: int, steps: FloatArray, turn: float) -> bool:
        """Estimate the unknown trials of a level; False where the budget does not suffice."""
        missing = [row for row in range(len(self.poses)) if level not in self._trials[row]]
        moves = []
        for row in missing:
            if self.is_fixed[row]:
                moves.append(np.zeros((0, 4, 4)))
                continue
            rng = np.random.default_rng((self.seed, row, level, int(self._moves_made[row])))
            moves.append(_moves(self.space, self.poses[row], steps[row], turn, rng))
        counts = [len(poses) for poses in moves]
        if self.evaluations + sum(counts) > self.budget:
            return False
        if not missing:
            return True
        camera = np.repeat(self.camera[missing], counts)
        estimate = self.objective.estimated(Poses.of(np.concatenate(moves), camera=camera))
        self.evaluations += sum(counts)
        ends = np.cumsum(counts).tolist()
        for row, poses, end in zip(missing, moves, ends, strict=True):
            own = self._rows(estimate, end - len(poses), len(poses))
            eyes = self.objective.eyes(Poses.of(poses, camera=int(self.camera[row])))
            self._trials[row][level] = _Trials(poses, own, eyes.reshape(-1, self.width, 3))
        return True

    def improve(self, level: int) -> bool:
        """Move cameras to the trials that gain most, each at most once; True where any moved."""
        waiting = set(range(len(self.poses)))
        while waiting:
            gains = {row: self._best(row, level) for row in sorted(waiting)}
            if self._measure({row: best for row, (gain, best) in gains.items() if gain > 0}, level):
                continue
            row = max(gains, key=lambda row: (gains[row][0], -row))
            gain, trial = gains[row]
            if gain <= 0:
                break
            self._move(row, level, trial)
            waiting.remove(row)
        return len(waiting) < len(self.poses)

    def _worth(self) -> int:
        covers = self.covers.reshape(-1, len(self.objective.integer_weights))
        covered = self.objective.covered(covers, self.eyes.reshape(-1, 3))
        return int(self.objective.worth(covered))

    def _best(self, row: int, level: int) -> tuple[int, int]:
        """Weight that the best trial of a camera gains, and the index of that trial.

        Trials that were measured are judged by that, the others by their estimates.
        """
        trials = self._trials[row][level]
        if not len(trials.poses):
            return -1, -1
        covers, eyes = (np.delete(each, row, axis=0) for each in (self.covers, self.eyes))
        rest = covers.reshape(-1, covers.shape[-1]), eyes.reshape(-1, 3)

        def gains_of(lists: Lists, trial_eyes: FloatArray) -> IntArray:
            return self.objective.worth_added(*rest, lists, trial_eyes.reshape(-1, 3))

        gains = gains_of(trials.covers, trials.eyes)
        exact = Lists.of([np.flatnonzero(each) for each in self.covers[row]])
        gains -= gains_of(self._own[row] or exact, self.eyes[row])
        if trials.measured:
            rows = list(trials.measured)
            known = [part.row(at) for part in trials.measured.values() for at in range(part.n)]
            gains[rows] = gains_of(Lists.of(known), trials.eyes[rows])
            gains[rows] -= gains_of(exact, self.eyes[row])
        best = int(gains.argmax())
        return int(gains[best]), best

    def _measure(self, chosen: dict[int, int], level: int) -> bool:
        """Measure those of some trials that are estimates, one per camera; True where any was.

        Where the budget does not suffice they count as no gain.
        """
        if not self.objective.is_estimated:
            return False
        missing = {
            row: trial
            for row, trial in chosen.items()
            if trial not in self._trials[row][level].measured
        }
        if not missing:
            return False
        if self.evaluations + len(missing) > self.budget:
            for row, trial in missing.items():
                nothing = [np.empty(0, np.int32)] * self.width
                self._trials[row][level].measured[trial] = Lists.of(nothing)
            return True
        poses = np.array([self._trials[row][level].poses[trial] for row, trial in missing.items()])
        result = self.objective.listed(Poses.of(poses, camera=self.camera[list(missing)]))
        self.evaluations += len(poses)
        for at, (row, trial) in enumerate(missing.items()):
            self._trials[row][level].measured[trial] = self._rows(result, at)
        return True

    def _move(self, row: int, level: int, trial: int) -> None:
        trials = self._trials[row][level]
        with hold_interrupts():
            self.poses[row] = trials.poses[trial]
            entry = trials.measured.get(trial, self._rows(trials.covers, trial))
            self.covers[row] = False
            for at in range(self.width):
                self.covers[row, at, entry.row(at)] = True
            self.eyes[row] = trials.eyes[trial]
            if self.objective.is_estimated:
                self._own[row] = self._rows(trials.covers, trial)
            self._trials[row].clear()
            self._moves_made[row] += 1
            self.worth = self._worth()
            self.trace.append(self.worth)


def _moves(
    space: PoseSpace, pose: FloatArray, step: float, turn: float, rng: np.random.Generator
) -> FloatArray:
    """(M, 4, 4) poses one move away from a pose, at allowed positions."""
    eyes, forwards, rolls = space.decomposed(pose)
    eye, forward, tangent = eyes[0], forwards[0], tan(turn)
    drawn = np.clip(rng.normal(size=(RANDOM_MOVES, 6)), -TAIL, TAIL) / np.sqrt([3, 3, 3, 2, 2, 2])
    moves = np.concatenate((ALONG, SIDEWAYS, AROUND, ROLLED[: 2 * space.is_roll_free], drawn))
    shifts = matmul(step * moves[:, :3], pose[:3, :3].T)
    directions = forward + matmul(tangent * moves[:, 3:5], pose[:3, :2].T)
    # Some shifts are compensated by a turn: at this depth the image stays.
    is_held = np.zeros(len(moves), bool)
    is_held[len(ALONG) : len(ALONG) + len(SIDEWAYS)] = True
    is_held[len(moves) - RANDOM_MOVES :: 2] = True
    directions[is_held] = step / tangent * directions[is_held] - shifts[is_held]
    turns = rolls[0] + turn * moves[:, 5] * space.is_roll_free
    places = eye + shifts
    shifted = (places != eye).any(axis=1)
    places[shifted] = space.nearest_in_boxes(places[shifted])
    allowed = (directions != 0).any(axis=1)
    allowed[shifted] &= space.allows(places[shifted])  # its present position is allowed
    return space.composed(places[allowed], directions[allowed], turns[allowed])


def _steps(space: PoseSpace, start: FloatArray, step: float | Sequence[float] | None) -> FloatArray:
    if step is None:
        return STEP * space.distance(start[:, :3, 3])
    steps = np.asarray(step, np.float64)
    if steps.shape not in ((), (len(start),)):
        raise ConfigError(
            f"expected step as one number or {len(start)}, got shape {steps.shape}; give metres"
        )
    if not ((steps > 0) & (steps <= LARGEST_COORDINATE)).all():
        raise ConfigError(
            f"expected step above 0 and up to {LARGEST_COORDINATE:g} m, got {step}; give metres"
        )
    return np.broadcast_to(steps, len(start)).astype(np.float64)


POSES_AT_ONCE = 256
"""Poses measured between two chances to keep what is there on an interrupt."""


@frozen_record
class Optimised:
    """Best network of a search.

    Attributes
    ----------
    poses : (k, 4, 4) float64
        world_from_camera.
    share : float
        Share of the weight that it covers, [0, 1].
    trace : (N,) float64
        Share of the first network and after each exchange.
    evaluations : int
        Number of poses that were measured.
    generations : int
        Number of rounds of exchanges.
    seed : int
        Seed of the drawn poses.
    seconds : float
        Time of the search.
    is_interrupted : bool
        True if an interrupt ended the search before the budget was spent.
    method : str
        "exchanges".

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Objective, PoseSpace, optimise
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> space = PoseSpace(mesh=mesh, stand_off=(1, 4))
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     result = optimise(objective, space, cameras=2, budget=200)
    >>> result.share, result.method
    (1.0, 'exchanges')
    """

    poses: FloatArray
    share: float
    trace: FloatArray
    evaluations: int
    generations: int
    seed: int
    seconds: float
    is_interrupted: bool = False
    method: str = "exchanges"


@typed
def optimise(
    objective: Objective,
    space: PoseSpace,
    cameras: int,
    *,
    budget: int = 20_000,
    seed: int = 0,
    start: ArrayLike | None = None,
    camera: ArrayLike = 0,
) -> Optimised:
    """Best network of k cameras found by exchanges among measured poses.

    An interrupt (Ctrl-C) after the first poses were measured ends the search and returns the best
    network of these.

    Parameters
    ----------
    objective : Objective
        Share to increase.
    space : PoseSpace
        Allowed positions and directions.
    cameras : int
        Number k of cameras of the network, 1 or more.
    budget : int
        Number of poses to measure: those of the start, and drawn ones up to this number.
    seed : int
        The same seed gives the same network.
    start : (k, 4, 4) array_like, optional
        The first network, such as that of a selection; the result is no worse.
    camera : int or (k,) int array_like
        Index of the camera of each pose, where the observer has several.

    Raises
    ------
    ConfigError
        For a value outside its range, or a start at a forbidden position.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Objective, PoseSpace, optimise
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> space = PoseSpace(mesh=mesh, stand_off=(1, 4))
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     result = optimise(objective, space, cameras=2, budget=200)
    >>> result.poses.shape, result.share
    ((2, 4, 4), 1.0)
    """
    began = time.perf_counter()
    for name, value, low in (("cameras", cameras, 1), ("budget", budget, cameras)):
        if value < low:
            raise ConfigError(f"expected {name} of {low} or more, got {value}; increase it")
    check_seed(seed)
    poses = np.zeros((0, 4, 4))
    if start is not None:
        if np.shape(start) != (cameras, 4, 4):
            raise ConfigError(
                f"expected start ({cameras}, 4, 4), got shape {np.shape(start)}; give a pose each"
            )
        poses = valid_poses(start)
        space.require(poses, "camera")
    rng = np.random.default_rng(seed)
    poses = np.concatenate((poses, _draw_poses(space, budget - len(poses), rng)))
    own = Poses.of(poses[:cameras], camera=camera).camera
    placed = Poses.of(poses, camera=np.resize(own, budget))
    rows: list[AnyArray] = []
    is_interrupted = False
    try:
        for at in range(0, budget, POSES_AT_ONCE):
            result = objective.listed(placed[at : at + POSES_AT_ONCE])
            rows += [result.row(row) for row in range(result.n)]
    except KeyboardInterrupt:
        if len(rows) < cameras * objective.width:
            raise
        is_interrupted = True
    placed = placed[: len(rows) // objective.width]
    chosen, trace, rounds = _exchange_cameras(objective, placed, rows, cameras)
    shares = objective.share(np.array(trace))
    return Optimised(
        poses=frozen(placed.world_from_camera[chosen]),
        share=float(shares[-1]),
        trace=frozen(shares),
        evaluations=len(placed),
        generations=rounds,
        seed=seed,
        seconds=time.perf_counter() - began,
        is_interrupted=is_interrupted,
    )


def _exchange_cameras(
    objective: Objective, placed: Poses, rows: list[AnyArray], cameras: int
) -> tuple[list[int], list[int], int]:
    """Poses of a network, its worth after each exchange, and the number of rounds.

    The first network is that of the first poses. `rows` are the faces of each row of the poses, as
    of `Objective.listed`.
    """
    width = objective.width
    eyes = objective.eyes(placed).reshape(-1, width, 3)

    def of(poses: list[int]) -> tuple[Lists, FloatArray]:
        every = [row for at in poses for row in rows[at * width : (at + 1) * width]]
        return Lists.of(every), eyes[poses].reshape(-1, 3)

    def covers(poses: list[int]) -> tuple[BoolArray, FloatArray]:
        lists, places = of(poses)
        return objective.dense(lists), places

    trials = [np.flatnonzero(placed.camera == each).tolist() for each in placed.camera[:cameras]]
    chosen, rounds, gains = list(range(cameras)), 0, True
    trace = [int(objective.worth(objective.covered(*covers(chosen))))]
    while gains:
        gains, rounds = False, rounds + 1
        for place, own in enumerate(trials):
            rest = chosen[:place] + chosen[place + 1 :]
            added = objective.worth_added(*covers(rest), *of(own))
            best, now = int(added.argmax()), own.index(chosen[place])
            if added[best] > added[now]:
                chosen[place], gains = own[best], True
                trace.append(trace[-1] + int(added[best] - added[now]))
    return chosen, trace, rounds


def _draw_poses(space: PoseSpace, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, 4, 4) poses at random allowed positions, towards random points of `space.aim`."""
    eyes = space.sample(count, rng)
    low, high = np.asarray(space.aim)
    rolls = draw_between(-np.pi, np.pi, count, rng) * space.is_roll_free
    return space.composed(eyes, draw_between(low, high, eyes.shape, rng) - eyes, rolls)
