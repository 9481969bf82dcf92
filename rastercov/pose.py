"""Camera poses: world_from_camera matrices, look-at, and pose files.

p_world = world_from_camera @ p_camera. Camera axes are OpenCV's: +x right, +y down, +z forward. The
thesis' frame (6.8-6.11), X left and Y up, is ours turned by 180 degrees about Z.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.errors import PoseError

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
        Where an eye is its own target, or a value is not finite; `pose_ids` names the rows.
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

    forward = target - eye
    length = np.linalg.norm(forward, axis=1, keepdims=True)
    _refuse(length[:, 0] == 0, "eye and target are the same point")
    forward = forward / length

    right = np.cross(forward, upward)
    scale = np.maximum(np.linalg.norm(upward, axis=1), np.finfo(np.float64).tiny)
    parallel = np.linalg.norm(right, axis=1) <= 1e-9 * scale
    # The axis furthest from the view; among equals the later one, so that z stays up if it can.
    # Rounded, lest noise decide between equals.
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
    if not 0 < distance < np.inf:
        raise PoseError(f"distance must be positive and finite, got {distance}")
    if count < 0 or count != int(count):
        raise PoseError(f"count must be a whole number, 0 or more, got {count}")
    middle = _triples("centre", centre)
    if len(middle) != 1:
        raise PoseError(f"centre must have shape (3,), got {middle.shape}")
    index = np.arange(count)
    height = 1 - (2 * index + 1) / max(count, 1)
    azimuth = index * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - height**2)
    outward = np.stack((radius * np.cos(azimuth), radius * np.sin(azimuth), height), axis=1)
    return look_at(middle + distance * outward, middle)


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
    try:
        out = np.array(poses, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise PoseError("poses must be numbers of shape (P, 4, 4)") from None
    if out.shape == (0,):
        out = np.zeros((0, 4, 4))
    if out.ndim == 2:
        out = out[None]
    if out.ndim != 3 or out.shape[1:] != (4, 4):
        raise PoseError(f"poses must have shape (P, 4, 4), got {out.shape}")
    faults: dict[int, str] = {}

    def fault(mask: ArrayLike, text: str) -> None:
        for row in np.flatnonzero(mask):
            faults.setdefault(int(row), text)

    finite = np.atleast_1d(np.isfinite(out).all(axis=(1, 2)))
    fault(~finite, "is not finite")
    rotation = np.where(finite[:, None, None], out[:, :3, :3], np.eye(3))
    with np.errstate(over="ignore", invalid="ignore"):
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


def valid_poses(poses: ArrayLike) -> FloatArray:
    """Poses as `check_poses` returns them; any fault is a `PoseError` that names its rows."""
    out, faults = check_poses(poses)
    if faults:
        row, text = min(faults.items())
        others = f" (and {len(faults) - 1} more poses)" if len(faults) > 1 else ""
        raise PoseError(f"pose {row} {text}{others}", tuple(sorted(faults)))
    return out


def inverse(poses: FloatArray) -> FloatArray:
    """camera_from_world of world_from_camera, or the reverse; (..., 4, 4)."""
    out = np.zeros_like(poses)
    rotation = np.swapaxes(poses[..., :3, :3], -1, -2)
    out[..., :3, :3] = rotation
    out[..., :3, 3] = -(rotation @ poses[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def read_poses(path: str | Path) -> FloatArray:
    """Poses of a file, unchecked: `.npy` of (P, 4, 4), or JSON `{"world_from_camera": [...]}`.

    Returns
    -------
    (P, 4, 4) float64
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".npy":
            # Not np.load, which opens a zip archive or a pickle whatever its name.
            with path.open("rb") as file:
                array = np.lib.format.read_array(file, allow_pickle=False)
            if array.dtype.kind not in "iuf":
                raise PoseError(f"{path}: poses must be real numbers, got {array.dtype}")
        elif path.suffix.lower() == ".json":
            content = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(content, dict) or "world_from_camera" not in content:
                raise PoseError(f'{path}: a pose file holds {{"world_from_camera": [4 x 4, ...]}}')
            array = np.array(content["world_from_camera"], dtype=np.float64)
            if array.shape == (0,):
                array = np.zeros((0, 4, 4))
        else:
            raise PoseError(f"{path}: a pose file ends in .npy or .json")
        array = np.asarray(array, dtype=np.float64)
    except OSError as error:
        raise PoseError(f"{path}: cannot be read ({error.strerror or error})") from None
    except PoseError:
        raise
    except Exception as error:  # the parsers let a dozen kinds through
        raise PoseError(f"{path}: not a pose file ({_one_line(error)})") from None
    if array.shape == (4, 4):
        array = array[None]
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        raise PoseError(f"{path}: poses must have shape (P, 4, 4), got {array.shape}")
    return array


def write_poses(path: str | Path, poses: ArrayLike) -> None:
    """Write poses as `.npy` or `.json`; `read_poses` gives them back bit for bit."""
    path = Path(path)
    array = valid_poses(poses)
    if path.suffix.lower() == ".npy":
        with path.open("wb") as file:  # np.save would add .npy to a name that ends in .NPY
            np.save(file, array)
    elif path.suffix.lower() == ".json":
        text = json.dumps({"world_from_camera": array.tolist()})
        path.write_text(text + "\n", encoding="utf-8")
    else:
        raise PoseError(f"{path}: a pose file ends in .npy or .json")


def _triples(name: str, value: ArrayLike) -> FloatArray:
    try:
        array = np.atleast_2d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        raise PoseError(f"{name} must be numbers of shape (3,) or (P, 3)") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise PoseError(f"{name} must have shape (3,) or (P, 3), got {array.shape}")
    return array


def _one_line(error: Exception) -> str:
    return " ".join((str(error) or type(error).__name__).split())


def _refuse(mask: ArrayLike, text: str) -> None:
    rows = tuple(int(row) for row in np.flatnonzero(mask))
    if rows:
        raise PoseError(f"pose {rows[0]}: {text}" + _and_more(rows), rows)


def _and_more(rows: Sequence[int]) -> str:
    return f" (and {len(rows) - 1} more poses)" if len(rows) > 1 else ""
