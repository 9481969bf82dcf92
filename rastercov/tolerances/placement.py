"""Coverage of a network under installation errors.

Errors are drawn at random (Monte Carlo) and all disturbed poses are measured in batches. Each draw
is used twice, for all cameras together and for each camera alone among others at their planned
poses, so that the second use costs nothing. Leaving out each camera shows which one is critical.

N. Metropolis, S. Ulam. The Monte Carlo Method. 1949.
"""

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ByName, ConfigError, FloatArray, Lists, check_seed, frozen_record
from rastercov.base.typed import typed
from rastercov.core.camera import Poses, renumber
from rastercov.core.mesh.arrays import frozen
from rastercov.placement.improve.objective import Objective
from rastercov.tolerances.installation import InstallationError, disturb_poses

LEVELS = (0.0, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
"""Reported quantiles; the first is the worst of all draws."""
PAIRS_AT_ONCE = 1 << 24
"""Pose-face pairs held at a time: 16 MB."""


@frozen_record
class Spread:
    """Shares that a network covers in all draws.

    Attributes
    ----------
    shares : (N,) float64
        Share in each draw.
    mean : float
        Mean of the shares.
    quantiles : tuple of float
        Quantiles of the shares at 0, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95 and 1, without
        interpolation; the first is the worst of all draws.
    """

    shares: FloatArray
    mean: float
    quantiles: tuple[float, ...]

    @property
    def worst(self) -> float:
        """Least share of all draws."""
        return self.quantiles[0]

    @classmethod
    def of(cls, shares: FloatArray) -> "Spread":
        """Distribution of one share for each draw."""
        quantiles = np.quantile(shares, LEVELS, method="inverted_cdf")
        return cls(frozen(shares.copy()), float(shares.mean()), tuple(quantiles.tolist()))

    def summary(self) -> ByName:
        """Figures without the draws, ready for JSON."""
        quantiles = {f"{level:g}": q for level, q in zip(LEVELS, self.quantiles, strict=True)}
        return {"mean": self.mean, "worst": self.worst, "quantiles": quantiles}


@frozen_record
class CameraTolerance:
    """Dependence of the coverage on one camera.

    Attributes
    ----------
    without : float
        Share that the other cameras cover at their planned poses.
    alone : Spread
        Shares when only this camera is mounted with an error.
    own_faces : int
        Number of evaluated faces that the network covers only with this camera.
    """

    without: float
    alone: Spread
    own_faces: int


@frozen_record
class Tolerance:
    """Coverage of a network under installation errors.

    Attributes
    ----------
    error : InstallationError
        Distribution of the errors.
    draws, seed, evaluations : int
        Number of draws N, their seed, and number of poses that were measured: k (N + 1).
    nominal : float
        Share that the network covers as planned.
    together : Spread
        Shares when all cameras have errors, each its own.
    cameras : tuple of CameraTolerance
        Dependence on each of the k cameras.
    face_chance : (F,) float64
        Share of the draws in which the network covers each face.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import InstallationError, Objective, tolerance
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=3)
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     result = tolerance(objective, poses, InstallationError(position_mm=2), draws=5)
    >>> result.draws, len(result.cameras)
    (5, 3)
    """

    error: InstallationError
    draws: int
    seed: int
    evaluations: int
    nominal: float
    together: Spread
    cameras: tuple[CameraTolerance, ...]
    face_chance: FloatArray

    @property
    def critical(self) -> int:
        """Index of the camera whose removal costs most, the first of equals; -1 for no camera."""
        return _first_least([camera.without for camera in self.cameras])

    @property
    def most_sensitive(self) -> int:
        """Index of the camera whose own error costs most on average, the first of equals; or -1."""
        return _first_least([camera.alone.mean for camera in self.cameras])

    def summary(self) -> ByName:
        """Figures without draws and faces, ready for JSON."""
        return {
            "position_mm": self.error.position_mm,
            "angle_deg": self.error.angle_deg,
            "distribution": self.error.distribution,
            "draws": self.draws,
            "seed": self.seed,
            "nominal": self.nominal,
            "together": self.together.summary(),
            "critical": self.critical,
            "most_sensitive": self.most_sensitive,
            "cameras": [
                {"without": each.without, "own_faces": each.own_faces} | each.alone.summary()
                for each in self.cameras
            ],
        }


def _first_least(values: list[float]) -> int:
    return int(np.argmin(values)) if values else -1


@typed
def tolerance(
    objective: Objective,
    poses: ArrayLike | Poses,
    error: InstallationError,
    *,
    draws: int = 200,
    seed: int = 0,
) -> Tolerance:
    """Coverage of a network when its cameras are mounted with errors, by random draws.

    Mounting constraints are not applied to disturbed poses. `rastercov.tolerance` proves bounds
    instead.

    Parameters
    ----------
    objective : Objective
        Share of the weight that a network covers.
    poses : (k, 4, 4) array_like, or Poses
        world_from_camera, as planned; `Poses.camera` is the index of the camera of each.
    error : InstallationError
        Distribution of the errors; each camera has its own error.
    draws : int
        Number N of disturbed networks, 1 or more. With 200, at least 99 % of installations cover
        more than the worst share, at a confidence of 87 %.
    seed : int
        The same seed gives the same draws.

    Raises
    ------
    ConfigError
        For a number of draws below 1.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import InstallationError, Objective, tolerance
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=3)
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     result = tolerance(objective, poses, InstallationError(position_mm=2), draws=5)
    >>> result.draws, result.together.worst <= result.nominal
    (5, True)
    """
    check_seed(seed)
    if draws < 1:
        raise ConfigError(f"expected draws of 1 or more, got {draws}; increase it")
    placed = renumber(poses)
    planned = placed.world_from_camera
    eyes, width = objective.eyes(placed), objective.width
    covers = objective.covers(placed)
    covered = objective.covered(covers, eyes)
    disturbed = disturb_poses(planned, error, draws, np.random.default_rng(seed))

    together = np.empty(draws, np.int64)
    alone = np.empty((len(planned), draws), np.int64)
    times = np.zeros(covers.shape[1], np.int64)
    others = [np.repeat(np.arange(len(planned)) != row, width) for row in range(len(planned))]
    step = max(1, PAIRS_AT_ONCE // max(1, covers.size))
    for begin in range(0, draws, step):
        part = slice(begin, min(begin + step, draws))
        seen, seen_from = objective.networks(disturbed[part], placed.camera)
        covered_now = objective.covered(seen, seen_from)
        together[part] = objective.worth(covered_now)
        times += covered_now.sum(axis=0)
        for row, rest in enumerate(others):
            own = slice(row * width, (row + 1) * width)
            trials = seen[:, own].reshape(-1, covers.shape[1])
            lists = Lists.of([np.flatnonzero(trial) for trial in trials])
            trial_eyes = seen_from[:, own].reshape(-1, 3)
            alone[row, part] = objective.worth_added(covers[rest], eyes[rest], lists, trial_eyes)

    cameras = []
    for row, rest in enumerate(others):
        left = objective.covered(covers[rest], eyes[rest])
        without = objective.worth(left)
        cameras.append(
            CameraTolerance(
                without=float(objective.share(without)),
                alone=Spread.of(objective.share(without + alone[row])),
                own_faces=int((covered & ~left & (objective.integer_weights > 0)).sum()),
            )
        )
    return Tolerance(
        error=error,
        draws=draws,
        seed=seed,
        evaluations=len(planned) * (draws + 1),
        nominal=float(objective.share(objective.worth(covered))),
        together=Spread.of(objective.share(together)),
        cameras=tuple(cameras),
        face_chance=frozen(times / draws),
    )
