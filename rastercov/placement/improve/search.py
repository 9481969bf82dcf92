"""Search for a network among free poses: drawn at random, measured once, chosen by exchanges.

For mounting spaces that a list of candidates does not represent. The cameras of a network are
replaced one by one by the measured pose that adds most to the others, until none adds more. With
refinement after it, that reaches what swarms and evolution of the poses reach, or more, with as
many measured poses.

M. B. Teitz, P. Bart. Heuristic Methods for Estimating the Generalized Vertex Median of a Weighted
Graph. 1968.
"""

import time

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ConfigError,
    FloatArray,
    Lists,
    check_seed,
    frozen_record,
)
from rastercov.base.typed import typed
from rastercov.core.camera import Poses, valid_poses
from rastercov.core.mesh.arrays import frozen
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace

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
    rolls = rng.uniform(-np.pi, np.pi, count) * space.is_roll_free
    return space.composed(eyes, rng.uniform(low, high, eyes.shape) - eyes, rolls)
