"""The errors a caller may want to tell apart.

Every message says what was wanted, what came, and what to do, in one line. The command line
prints that line without a traceback and exits with code 2.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

OUT_OF_MEMORY = re.compile(
    "bad_alloc|[Cc]annot allocate|allocation still failed|failed to map segment|start new thread"
)
"""Words of libraries for want of memory, in errors of other kinds and in what they print."""
Kinds = type[Exception] | tuple[type[Exception], ...]


class RastercovError(Exception):
    """Root of every error rastercov raises on purpose.

    Examples
    --------
    >>> import rastercov as rc
    >>> for wrong in ({"views": 0}, {"min_pixels": -1}):
    ...     try:
    ...         rc.Task(**wrong)
    ...     except rc.RastercovError as error:
    ...         print(type(error).__name__)
    ConfigError
    ConfigError
    """


class MeshError(RastercovError, ValueError):
    """A mesh or mesh file that cannot be used as it is.

    Examples
    --------
    >>> import rastercov as rc
    >>> try:
    ...     rc.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 3)])
    ... except rc.MeshError as error:
    ...     print(type(error).__name__)
    MeshError
    """


class CameraError(RastercovError, ValueError):
    """Camera parameters that describe no camera, or one that is not supported.

    Examples
    --------
    >>> import rastercov as rc
    >>> try:
    ...     rc.Camera(width=0, height=480, fx=600, fy=600)
    ... except rc.CameraError as error:
    ...     print(type(error).__name__, "width" in str(error))
    CameraError True
    """


class PoseError(RastercovError, ValueError):
    """A pose that is not a rigid transform, or a pose file that cannot be used.

    Attributes
    ----------
    pose_ids : tuple of int
        The invalid rows; empty when the error is not about single rows.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> try:
    ...     rc.Poses.of([np.eye(4), np.diag((2, 2, 2, 1))])
    ... except rc.PoseError as error:
    ...     print(error.pose_ids)
    (1,)
    """

    def __init__(self, message: str, pose_ids: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.pose_ids = pose_ids


class ConfigError(RastercovError, ValueError):
    """A threshold or option outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> try:
    ...     rc.Task(max_incidence_deg=120)
    ... except rc.ConfigError as error:
    ...     print(type(error).__name__, "max_incidence_deg" in str(error))
    ConfigError True
    """


class DeviceError(RastercovError, RuntimeError):
    """No usable graphics device, or a device that returns wrong results.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> rasterizer = rc.open_rasterizer(mesh, camera, "cpu")
    >>> rasterizer.close()
    >>> try:
    ...     rasterizer.count(np.eye(4))
    ... except rc.DeviceError as error:
    ...     print("closed" in str(error))
    True
    """


class ResourceError(RastercovError, MemoryError):
    """More memory, faces or pairs than the machine, the device or a limit allows.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> try:
    ...     rc.cells(mesh, size=1e-6)
    ... except rc.ResourceError as error:
    ...     print(type(error).__name__)  # the message has a size that fits
    ResourceError
    """


def is_out_of_memory(error: BaseException | None) -> bool:
    """True for an error that is, or follows from, want of memory; an import fails of it, too."""
    return error is not None and (
        isinstance(error, MemoryError)
        or OUT_OF_MEMORY.search(str(error)) is not None
        or is_out_of_memory(error.__cause__ or error.__context__)
    )


@contextmanager
def errors_as(
    kind: Callable[[str], Exception], where: object = None, caught: Kinds | None = None
) -> Iterator[None]:
    """Errors within, of `kind` unless others are given, as one of `kind` that says where it is."""
    own: Any = kind if caught is None else caught
    try:
        yield
    except own as error:
        raise kind(str(error) if where is None else f"{where}: {error}") from None


class PartMadeError(RastercovError):
    """The shards of a part are made; the message says what finishes the run."""


class PoolLostError(Exception):
    """Processes on other machines do not answer any more."""
