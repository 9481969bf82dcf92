"""Camera poses: world_from_camera matrices, look-at, and pose files.

p_world = world_from_camera @ p_camera. Camera axes are OpenCV's: +x right, +y down, +z forward. The
thesis' frame (6.8-6.11), X left and Y up, is ours turned by 180 degrees about Z.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._arguments import LARGEST_COORDINATE, MOST_POSES, checked_array, flag, owned
from rastercov._checks import finite_number, shown
from rastercov._files import (
    LARGEST_ARRAY,
    StrPath,
    UnparsedError,
    UnreadableError,
    one_line,
    open_file,
    printable,
    read_json,
    suffix_of,
    written_file,
)
from rastercov.errors import PoseError, ResourceError

FloatArray = NDArray[np.float64]

DRIFT_TOLERANCE = 1e-6
"""A rotation further than this from orthonormal is refused; nearer, it is made orthonormal."""


def look_at(eyes: ArrayLike, targets: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> FloatArray:
    """Poses at `eyes` that look at `targets` with `up` upwards in the image, (6.8)-(6.11).

    Where the view is parallel to `up`, (6.10) is undefined; then the world axis furthest from the
    view takes its place: y for a view along z, z for one along y or x. So too where `up` is zero.

    Parameters
    ----------
    eyes, targets, up : (3,) or (P, 3) array_like
        Points and a direction in the world, metres; broadcast against each other.

    Returns
    -------
    (P, 4, 4) float64
        world_from_camera; P is 1 when all inputs are single.

    Raises
    ------
    PoseError
        Where an eye is its own target, or a value is not finite or beyond 1e30 m; `pose_ids` names
        the rows.
    """
    eye, target, upward = (
        _triples(name, a) for name, a in (("eyes", eyes), ("targets", targets), ("up", up))
    )
    try:
        eye, target, upward = np.broadcast_arrays(eye, target, upward)
    except ValueError:
        shapes = f"{eye.shape}, {target.shape}, {upward.shape}"
        raise PoseError(f"eyes, targets and up must broadcast to (P, 3), got {shapes}") from None
    finite = np.isfinite(eye) & np.isfinite(target) & np.isfinite(upward)
    _refuse(~finite.all(axis=1), "eye, target or up is not finite")
    far = np.maximum(np.abs(eye), np.abs(target)) > LARGEST_COORDINATE
    _refuse(far.any(axis=1), f"eye or target is beyond ±{LARGEST_COORDINATE:g} m")

    forward = target - eye
    _refuse(~forward.any(axis=1), "eye and target are the same point")
    forward, upward = _scaled(forward), _scaled(upward)  # no square of them can vanish or overflow
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)

    right = np.cross(forward, upward)
    parallel = np.linalg.norm(right, axis=1) <= 1e-9 * np.linalg.norm(upward, axis=1)
    # The axis furthest from the view; among equals the later one, so that z stays up if it can.
    # Rounded, so that noise does not decide between equals.
    spare = np.eye(3)[2 - np.argmin(np.abs(forward).round(6)[:, ::-1], axis=1)]
    right = np.where(parallel[:, None], np.cross(forward, spare), right)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    # A product of nearly parallel vectors is short and its rounding great: take out what is along
    # the view.
    right -= (right * forward).sum(axis=1, keepdims=True) * forward
    right /= np.linalg.norm(right, axis=1, keepdims=True)

    poses = np.zeros((len(eye), 4, 4))
    poses[:, :3, 0] = right
    poses[:, :3, 1] = np.cross(forward, right)
    poses[:, :3, 2] = forward
    poses[:, :3, 3] = eye
    poses[:, 3, 3] = 1.0
    return poses


def sphere_of_poses(centre: ArrayLike, distance: float, count: int) -> FloatArray:
    """Poses spread evenly over a sphere (a Fibonacci lattice), all looking at its centre.

    Parameters
    ----------
    centre : (3,) array_like
        What the cameras look at, metres.
    distance : float
        Radius of the sphere, metres, > 0.
    count : int
        Number of poses, >= 0.

    Returns
    -------
    (count, 4, 4) float64
        world_from_camera.

    Raises
    ------
    PoseError
        For a value outside its range.
    """
    away = finite_number(distance)
    if not 0 < away <= LARGEST_COORDINATE:
        raise PoseError(
            f"distance must be positive and finite, at most {LARGEST_COORDINATE:g} m, "
            f"got {shown(distance)}"
        )
    number = finite_number(count)
    if not number.is_integer() or not 0 <= number <= MOST_POSES:
        raise PoseError(
            f"count must be a whole number, 0 or more, at most {MOST_POSES}, got {shown(count)}"
        )
    middle = _triples("centre", centre)
    if len(middle) != 1:
        raise PoseError(f"centre must have shape (3,), got {middle.shape}")
    index = np.arange(int(number))
    height = 1 - (2 * index + 1) / max(len(index), 1)
    azimuth = index * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - height**2)
    outward = np.stack((radius * np.cos(azimuth), radius * np.sin(azimuth), height), axis=1)
    return look_at(middle + away * outward, middle)


def check_poses(poses: ArrayLike) -> tuple[FloatArray, dict[int, str]]:
    """Poses with their small rotation drift removed, and what is wrong with the others.

    Parameters
    ----------
    poses : (P, 4, 4) or (4, 4) array_like
        world_from_camera.

    Returns
    -------
    poses : (P, 4, 4) float64
        A copy; rows that are at fault are left as they came.
    faults : dict of int to str
        Row -> what is wrong with it.

    Raises
    ------
    PoseError
        When the array as a whole has the wrong shape or type.
    """
    array = _numbers("poses", poses, "(P, 4, 4)")
    out = _matrices(array[None] if array.ndim == 2 else array)
    faults: dict[int, str] = {}

    def fault(mask: ArrayLike, text: str) -> None:
        for row in np.flatnonzero(mask):
            faults.setdefault(int(row), text)

    finite = np.atleast_1d(np.isfinite(out).all(axis=(1, 2)))
    fault(~finite, "is not finite")
    far = ~(np.abs(out[:, :3, 3]) <= LARGEST_COORDINATE).all(axis=1)
    fault(far, f"is beyond ±{LARGEST_COORDINATE:g} m")
    rotation = np.where(finite[:, None, None], out[:, :3, :3], np.eye(3))
    with np.errstate(all="ignore"):  # what comes out is compared, and NaN is a fault
        drift = np.abs(rotation.transpose(0, 2, 1) @ rotation - np.eye(3)).max(
            axis=(1, 2), initial=0
        )
        reflected = np.linalg.det(rotation) < 0
    fault((out[:, 3] != (0, 0, 0, 1)).any(axis=1), "must end in the row 0 0 0 1")
    fault(~(drift <= DRIFT_TOLERANCE), "is not a rotation (scaled, sheared or drifted)")
    fault(reflected, "is a reflection, not a rotation")

    drifted = [int(row) for row in np.flatnonzero(drift > 1e-14) if int(row) not in faults]
    if drifted:
        u, _, vt = np.linalg.svd(out[drifted, :3, :3])
        out[drifted, :3, :3] = u @ vt
    return out, faults


def valid_poses(poses: "ArrayLike | Poses") -> FloatArray:
    """Poses as `check_poses` returns them; any fault is a `PoseError` that names its rows."""
    return Poses.of(poses).world_from_camera


@dataclass(frozen=True, eq=False)
class Poses:
    """Camera poses that were checked, once: every function that takes poses takes them as they are.

    Attributes
    ----------
    world_from_camera : (P, 4, 4) float64
        Rigid motions.
    ids : (P,) int64
        Row of each pose in the input.
    given : (N, 4, 4) float64
        All rows of the input, those that were rejected as they came.
    rejected : dict of int to str
        Rows that were left out, and the fault of each.
    """

    world_from_camera: FloatArray
    ids: NDArray[np.int64]
    given: FloatArray
    rejected: Mapping[int, str] = field(default_factory=dict)

    @classmethod
    def of(cls, poses: "ArrayLike | Poses", *, skip_bad: bool = False) -> "Poses":
        """Check poses.

        Parameters
        ----------
        poses : (P, 4, 4) or (4, 4) array_like, or Poses
            world_from_camera; `Poses` are returned as they are.
        skip_bad : bool
            Leave out poses that are no rigid motion instead of raising.

        Raises
        ------
        PoseError
            For a pose that is no rigid motion, naming its rows.
        """
        skip_bad = flag("skip_bad_poses", skip_bad)
        if isinstance(poses, Poses):
            return poses
        matrices, faults = check_poses(poses)
        if faults and not skip_bad:
            row, text = min(faults.items())
            others = f" (and {len(faults) - 1} more poses)" if len(faults) > 1 else ""
            raise PoseError(f"pose {row} {text}{others}", tuple(sorted(faults)))
        ids = np.delete(np.arange(len(matrices)), list(faults))
        return cls(matrices[ids] if faults else matrices, ids, matrices, faults)

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, rows: "slice | NDArray[Any]") -> "Poses":
        """Some of the poses, by their rows among the accepted ones."""
        return Poses(self.world_from_camera[rows], self.ids[rows], self.given)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        return np.array(self.world_from_camera, dtype, copy=copy)


def inverse(poses: FloatArray) -> FloatArray:
    """camera_from_world of world_from_camera, or the reverse; (..., 4, 4)."""
    out = np.zeros_like(poses)
    rotation = np.swapaxes(poses[..., :3, :3], -1, -2)
    out[..., :3, :3] = rotation
    out[..., :3, 3] = -(rotation @ poses[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def read_poses(path: StrPath) -> FloatArray:
    """Poses of a file, unchecked: `.npy` of (P, 4, 4), or JSON `{"world_from_camera": [...]}`.

    Returns
    -------
    (P, 4, 4) float64

    Raises
    ------
    PoseError
        For a file that cannot be read or holds something else.
    """
    try:
        suffix = suffix_of(path)
        if suffix not in (".npy", ".json"):
            raise PoseError("a pose file ends in .npy or .json")
        array = _read_npy(path) if suffix == ".npy" else _read_json(path)
        return _matrices(array[None] if array.shape == (4, 4) else array)
    except MemoryError:
        raise ResourceError(f"{printable(str(path))}: too large for the memory; split it") from None
    except (UnreadableError, PoseError) as error:
        raise PoseError(f"{printable(str(path))}: {error}") from None


def _read_npy(path: StrPath) -> NDArray[Any]:
    # Not np.load, which opens a zip archive or a pickle whatever its name.
    with open_file(path, LARGEST_ARRAY) as file:
        try:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        except (OSError, MemoryError):
            raise
        except Exception as error:  # the parser lets a dozen kinds through
            raise PoseError(f"not a pose file ({one_line(error)})") from None
    if array.dtype.kind not in "iuf":
        raise PoseError(f"poses must be real numbers, got {array.dtype}")
    return array


def _read_json(path: StrPath) -> NDArray[Any]:
    try:
        content = read_json(path, LARGEST_ARRAY)
    except UnparsedError as error:
        raise PoseError(f"not a pose file ({error})") from None
    if not isinstance(content, dict) or "world_from_camera" not in content:
        raise PoseError('a pose file holds {"world_from_camera": [4 x 4, ...]}')
    try:
        return _numbers("poses", content["world_from_camera"], "(P, 4, 4)")
    except PoseError as error:
        raise PoseError(f"not a pose file ({error})") from None


def write_poses(path: StrPath, poses: ArrayLike) -> None:
    """Write poses as `.npy` or `.json`; `read_poses` gives them back bit for bit.

    Raises
    ------
    PoseError
        For poses at fault, and for a file that cannot be written.
    """
    array = valid_poses(poses)
    try:
        suffix = suffix_of(path)
        if suffix not in (".npy", ".json"):
            raise PoseError("a pose file ends in .npy or .json")
        with written_file(path) as file:
            if suffix == ".npy":
                np.save(file, array)
            else:
                text = json.dumps({"world_from_camera": array.tolist()})
                file.write((text + "\n").encode())
    except ValueError as error:
        raise PoseError(f"{printable(str(path))}: {error}") from None


def _matrices(poses: NDArray[Any]) -> FloatArray:
    """Float64 copy if it is (P, 4, 4), also of no poses at all, else PoseError."""
    if poses.shape == (0,):
        return np.zeros((0, 4, 4))
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise PoseError(f"poses must have shape (P, 4, 4), got {poses.shape}")
    return owned("poses", poses, np.float64)


def _numbers(name: str, values: ArrayLike, shape: str) -> NDArray[Any]:
    """Array of real numbers of any shape, not copied; PoseError names the wanted one."""
    wanted = f"numbers and must have shape {shape}"
    return checked_array(name, values, "iuf", wanted, PoseError)


def _triples(name: str, value: ArrayLike) -> FloatArray:
    array = np.atleast_2d(_numbers(name, value, "(3,) or (P, 3)"))
    if array.ndim != 2 or array.shape[1] != 3:
        raise PoseError(f"{name} must have shape (3,) or (P, 3), got {array.shape}")
    return owned(name, array, np.float64)


def _scaled(vectors: FloatArray) -> FloatArray:
    """(P, 3) vectors over the power of two above their largest component, which rounds nothing."""
    _, exponent = np.frexp(np.abs(vectors).max(axis=1, keepdims=True))
    scaled: FloatArray = np.ldexp(vectors, -exponent)
    return scaled


def _refuse(mask: ArrayLike, text: str) -> None:
    rows = tuple(int(row) for row in np.flatnonzero(mask))
    if rows:
        raise PoseError(f"pose {rows[0]}: {text}" + _and_more(rows), rows)


def _and_more(rows: Sequence[int]) -> str:
    return f" (and {len(rows) - 1} more poses)" if len(rows) > 1 else ""
