"""Pose files: `.npy` or JSON of (P, 4, 4), or `{"world_from_camera": [...], "camera": [...]}`.

`camera`, the name of the camera of each pose, may be left out.
"""

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    ByName,
    FloatArray,
    PoseError,
    ResourceError,
    StrPath,
    UnreadableError,
    errors_as,
    members,
    one_line,
    printable,
    read_json,
    shown,
    suffix_of,
)
from rastercov.base.files import LARGEST_ARRAY, open_file, write_file
from rastercov.core.camera.pose import as_matrices, real_numbers, valid_poses


def read_poses(path: StrPath) -> FloatArray:
    """Poses of a file, not checked to be rigid transforms.

    The file is `.npy` of (P, 4, 4), or `.json`: a list of matrices, or
    `{"world_from_camera": [...]}`.

    Returns
    -------
    (P, 4, 4) float64

    Raises
    ------
    PoseError
        For a file that cannot be read or holds something else.
    ResourceError
        For more poses than fit in memory.

    Examples
    --------
    >>> import rastercov as rc
    >>> rc.write_poses("poses.npy", rc.sphere_of_poses((0, 0, 0), distance=1, count=3))
    >>> rc.read_poses("poses.npy").shape
    (3, 4, 4)
    """
    try:
        array = read_npy(path) if _is_npy(path) else _read_json(path)
        return as_matrices(array[None] if array.shape == (4, 4) else array)
    except MemoryError:
        raise ResourceError(
            f"{printable(str(path))}: expected poses that fit in memory, got more; split the file"
        ) from None
    except (UnreadableError, PoseError) as error:
        raise PoseError(f"{printable(str(path))}: {error}") from None


def _is_npy(path: StrPath) -> bool:
    """True for a file of numpy, False for one of JSON, by its name; PoseError for another."""
    suffix = suffix_of(path)
    if suffix not in (".npy", ".json"):
        raise PoseError(
            "expected a pose file .npy or .json, got another suffix; rename or convert it"
        )
    return suffix == ".npy"


def read_npy(path: StrPath) -> AnyArray:
    """Array of real numbers of a `.npy` file, in any shape."""
    # Not np.load, which opens a zip archive or a pickle whatever its name.
    with open_file(path, LARGEST_ARRAY) as file:
        try:
            array: AnyArray = np.lib.format.read_array(file, allow_pickle=False)
        except (OSError, MemoryError):
            raise
        except Exception as error:  # the parser lets a dozen kinds through
            raise PoseError(f"expected a NumPy array, got: {one_line(error)}") from None
    if array.dtype.kind not in "iuf":
        raise PoseError(f"expected poses to be real numbers, got {array.dtype}")
    return array


def _read_json(path: StrPath) -> AnyArray:
    content = read_json(path, LARGEST_ARRAY)
    if isinstance(content, list) and content:
        return real_numbers("poses", content, "(P, 4, 4)")
    if not isinstance(content, dict) or "world_from_camera" not in content:
        raise PoseError(
            'expected {"world_from_camera": [4 x 4, ...]}, got other entries; correct the file'
        )
    return real_numbers("poses", content["world_from_camera"], "(P, 4, 4)")


def write_poses(path: StrPath, poses: ArrayLike, camera: Sequence[str] | None = None) -> None:
    """Write poses as `.npy` or `.json`; `read_poses` restores them bit for bit.

    Parameters
    ----------
    path : str or Path
        File to write.
    poses : (P, 4, 4) array_like
        world_from_camera.
    camera : sequence of str, optional
        Name of the camera of each pose, for JSON; `read_views` reads it.

    Raises
    ------
    PoseError
        For invalid poses, a wrong number of names, any names for a `.npy` file, and a file that
        cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> poses = rc.sphere_of_poses((0, 0, 0), distance=1, count=3)
    >>> rc.write_poses("poses.json", poses)
    >>> bool(np.allclose(rc.read_poses("poses.json"), poses))
    True
    """
    array = valid_poses(poses)
    content: ByName = {"world_from_camera": array.tolist()}
    if camera is not None:
        content["camera"] = members("camera", camera, str, "the name of each camera", PoseError)
        if len(content["camera"]) != len(array) or not all(content["camera"]):
            raise PoseError(
                f"expected camera to have a name for each of {len(array)} poses, got "
                f"{shown(camera)}"
            )
    with errors_as(PoseError, printable(str(path)), ValueError):
        is_npy = _is_npy(path)
        if camera is not None and is_npy:
            raise PoseError("expected a .json file for names of cameras, got .npy; rename it")
        with write_file(path) as file:
            if is_npy:
                np.save(file, array)
            else:
                file.write((json.dumps(content) + "\n").encode())
