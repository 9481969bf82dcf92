"""Parts of the faces that no camera covers: what a partition of covered parts leaves."""

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov._once import Once
from rastercov.area.frames import frames_of
from rastercov.area.union import Covered, diagonal_floor

_WHOLE: WeakKeyDictionary[Covered, Once[Covered]] = WeakKeyDictionary()


def with_rest(covered: Covered) -> Covered:
    """The partition with the rest of the task faces, as further pieces of 0 views.

    Their areas are sums of the same cuts: with the others they make up the faces, to rounding.
    Computed at the first call, since dead zones and the coloured mesh both want it.
    """
    return _WHOLE.setdefault(covered, Once()).get(lambda: _with_rest(covered))


def _with_rest(covered: Covered) -> Covered:
    """See `with_rest`."""
    from rastercov.area import union_kernels as kernels
    from rastercov.criteria_kernels import read_only

    mesh, k = covered.mesh, len(covered.area)
    frames = frames_of(mesh)
    is_asked = mesh.task_mask & (frames.areas > 0)
    old = kernels.Partition(
        covered.xy, covered.starts, covered.face, covered.views,
        np.array([len(covered), len(covered.xy)], np.int64),
    )  # fmt: skip
    none = (
        read_only(np.empty((0, 2)), np.float64),
        read_only(np.zeros(1), np.int64),
        read_only(np.empty(0), np.int32),
    )
    order: NDArray[np.int64] = read_only(np.empty(0, np.int64), np.int64)
    # One more camera, which covers every face as a whole: what only it covers is the rest.
    whole = read_only(is_asked.astype(np.int64), np.int64)
    room = kernels.room_for_partition(2 * len(covered) + mesh.n_faces, 4 * len(covered.xy) + 64)
    pool = kernels.pool_of(64)
    while True:
        done = kernels.unite_faces(
            read_only(frames.corners, np.float64), read_only(frames.areas, np.float64),
            diagonal_floor(mesh), k + 1, old, none, order, whole, pool,
            np.zeros(mesh.n_faces, np.bool_), np.zeros(mesh.n_faces), room,
        )  # fmt: skip
        n, corners = room.used.tolist()
        if not done:
            pool = kernels.pool_of(2 * len(pool.views))
        elif n > len(room.face) or corners > len(room.xy):
            room = kernels.room_for_partition(n, corners)
        else:
            break
    return replace(
        covered,
        xy=room.xy[:corners].copy(),
        starts=room.starts[: n + 1].copy(),
        face=room.face[:n].copy(),
        views=room.views[:n] - 1,
    )
