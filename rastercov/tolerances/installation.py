"""Errors of the installation of cameras, and disturbed poses."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge
from typing_extensions import Doc

from rastercov.base import FloatArray, check_limits, norm
from rastercov.core.camera import from_vectors


@dataclass(frozen=True, kw_only=True)
class InstallationError:
    """Distribution of the deviation of a camera from its planned pose.

    Attributes
    ----------
    position_mm : float
        Error of the camera centre, millimetres.
    angle_deg : float
        Error of the rotation, about an axis of random direction, degrees.
    distribution : {"normal", "uniform"}
        normal: standard deviation along, and about, each of the three axes. uniform: the greatest
        error; displacement and rotation vector lie anywhere in a ball of that radius.

    Raises
    ------
    ConfigError
        For values outside their range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import InstallationError
    >>> error = InstallationError(position_mm=2, angle_deg=0.5)
    >>> error.distribution
    'normal'
    """

    position_mm: Annotated[float, Ge(0), Doc("Error of the camera centre, mm.")] = 0.0
    angle_deg: Annotated[float, Ge(0), Doc("Error of the direction, degrees.")] = 0.0
    distribution: Annotated[Literal["normal", "uniform"], Doc("Distribution of errors.")] = "normal"

    def __post_init__(self) -> None:
        check_limits(self)

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> tuple[FloatArray, ...]:
        """Displacements in metres and rotation vectors in radians, `(*shape, 3)` each."""
        vectors = []
        for size in (self.position_mm / 1000, np.radians(self.angle_deg)):
            vector = rng.normal(size=(*shape, 3))
            radius = np.cbrt(rng.random((*shape, 1)))
            if self.distribution == "uniform":
                vector *= radius / norm(vector)[..., None]
            vectors.append(size * vector)
        return tuple(vectors)


def disturb_poses(
    poses: FloatArray, error: InstallationError, draws: int, rng: np.random.Generator
) -> FloatArray:
    """(N, k, 4, 4) poses with errors: displaced in the world, turned about the camera centre."""
    displacement, turn = error.draw((draws, len(poses)), rng)
    return displace(np.tile(poses, (draws, 1, 1, 1)), displacement, turn)


def displace(poses: FloatArray, displacement: FloatArray, turn: FloatArray) -> FloatArray:
    """Poses (..., 4, 4) moved by metres in the world and turned by radians in camera axes."""
    out = poses.copy()
    out[..., :3, 3] += displacement
    turns = from_vectors(turn, np.zeros((turn[..., 0].size, 3)))[:, :3, :3]
    out[..., :3, :3] = out[..., :3, :3] @ turns.reshape(*turn.shape, 3)
    return out
