"""Area that a network covers: the union of regions, and the parts that several cameras cover."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov._arguments import check_kind
from rastercov._checks import finite_number, shown
from rastercov._memory import check_memory
from rastercov._typed import typed
from rastercov.area.frames import check_same_mesh, frames_of, to_world
from rastercov.area.regions import Regions
from rastercov.errors import ConfigError, MeshError
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]

FLOOR_REL = 1e-15
"""Least distance of two corners that do not coincide, relative to the diagonal of the mesh."""
MOST_VIEWS = 10_000
"""Cameras up to which they may be counted."""
WHOLE_PAIR_REL = 1e-9
"""Part of the area of a face that a camera may miss and still count as covering all of it."""


@dataclass(frozen=True, eq=False)
class Covered:
    """Area of each face that at least 1 ... k cameras cover, and a partition of it.

    `bound` holds for every row of `area`: |area - exact area| <= bound.

    Attributes
    ----------
    area : (k, F) float64
        Row j: m^2 that at least j + 1 cameras cover.
    bound : (F,) float64
        m^2.
    xy : (C, 2) float64
        Corners in the plane coordinates of the faces, metres, counter-clockwise.
    starts : (N + 1,) int64
        The corners of piece i are xy[starts[i]] ... xy[starts[i + 1] - 1].
    face, views : (N,) int32
        Face of each piece, in ascending order, and cameras that cover it, k for k or more.
    """

    mesh: Mesh
    area: FloatArray
    bound: FloatArray
    xy: FloatArray
    starts: NDArray[np.int64]
    face: NDArray[np.int32]
    views: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.face)

    def share(self, views: int = 1) -> float:
        """Part of the area of the task faces that at least `views` cameras cover, [0, 1]."""
        number = finite_number(views)
        if number not in range(1, len(self.area) + 1):
            raise ConfigError(f"views must be 1 ... {len(self.area)}, got {shown(views)}")
        scored = self.mesh.task_mask
        total = frames_of(self.mesh).areas[scored].sum()
        return float(self.area[int(number) - 1][scored].sum() / total) if total > 0 else 0.0

    def points(self) -> FloatArray:
        """(C, 3) corners in space, metres."""
        return to_world(self.mesh, np.repeat(self.face, np.diff(self.starts)), self.xy)


class RegionUnion:
    """Union of regions, added a few poses at a time; one thread at a time may use it.

    A face that k cameras cover as a whole is closed: it is one piece from then on, and costs
    nothing more, however many poses follow.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the regions.
    views : int
        k: cameras up to which they are counted.
    """

    def __init__(self, mesh: Mesh, views: int = 1) -> None:
        from rastercov.area import union_kernels
        from rastercov.criteria_kernels import read_only

        check_kind("mesh", mesh, Mesh, "a Mesh", MeshError)
        number = finite_number(views)
        if not number.is_integer() or not 1 <= number <= MOST_VIEWS:
            raise ConfigError(
                f"views must be a whole number of 1 to {MOST_VIEWS}, got {shown(views)}"
            )
        check_memory(
            f"areas of {int(number)} numbers of views x {mesh.n_faces:,} faces",
            8 * int(number) * mesh.n_faces,
            "count fewer views",
        )
        self.mesh, self.views = mesh, int(views)
        self._kernels, self._read_only = union_kernels, read_only
        frames = frames_of(mesh)
        self._corners = read_only(frames.corners, np.float64)
        self._areas = read_only(frames.areas, np.float64)
        self._floor = diagonal_floor(mesh)
        self._bound = np.zeros(mesh.n_faces)
        self._is_closed = np.zeros(mesh.n_faces, np.bool_)
        self._old, self._spare = (union_kernels.room_for_partition(64, 512) for _ in range(2))
        self._pool = union_kernels.pool_of(64)

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that k cameras cover as a whole."""
        return self._is_closed.copy()

    def add(self, regions: Regions) -> None:
        """Take in the regions of further poses; `ConfigError` where they are of another mesh."""
        check_kind("regions", regions, Regions, "Regions", ConfigError)
        check_same_mesh(self.mesh, regions.mesh)
        read_only, n_faces = self._read_only, self.mesh.n_faces
        is_open = ~self._is_closed[regions.pair_face]
        is_whole = regions.area >= (1 - WHOLE_PAIR_REL) * self._areas[regions.pair_face]
        whole = np.bincount(regions.pair_face[is_whole & is_open], minlength=n_faces)
        bound = self._bound.copy()
        missing = np.where(is_whole, self._areas[regions.pair_face] - regions.area, 0.0)
        lost = (regions.bound + np.maximum(missing, 0.0))[is_open]
        bound += np.bincount(regions.pair_face[is_open], lost, minlength=n_faces)
        keys = regions.pair_pose.astype(np.int64) * n_faces + regions.pair_face
        chosen = np.flatnonzero(~self._is_closed[regions.face])
        own = regions.pose[chosen].astype(np.int64) * n_faces + regions.face[chosen]
        chosen = chosen[~is_whole[np.searchsorted(keys, own)]]
        areas = polygon_areas(*_taken(regions.xy, regions.starts, chosen))
        order = chosen[np.lexsort((-areas, regions.face[chosen]))]
        new = (
            read_only(regions.xy, np.float64),
            read_only(regions.starts, np.int64),
            read_only(regions.face, np.int32),
        )
        order = read_only(order, np.int64)
        whole = read_only(whole, np.int64)
        while True:
            is_closed, more = self._is_closed.copy(), bound.copy()
            done = self._kernels.unite_faces(
                self._corners, self._areas, self._floor, self.views, self._old, new, order,
                whole, self._pool, is_closed, more, self._spare,
            )  # fmt: skip
            n, corners = self._spare.used.tolist()
            if not done:
                self._pool = self._kernels.pool_of(2 * len(self._pool.views))
            elif n > len(self._spare.face) or corners > len(self._spare.xy):
                self._spare = self._kernels.room_for_partition(n * 3 // 2, corners * 3 // 2)
            else:
                break
        self._old, self._spare = self._spare, self._old
        self._is_closed, self._bound = is_closed, np.minimum(more, self._areas)

    def covered(self) -> Covered:
        """Area that the regions so far cover, and its pieces."""
        n, corners = self._old.used.tolist()
        face, views = self._old.face[:n].copy(), self._old.views[:n].copy()
        xy, starts = self._old.xy[:corners].copy(), self._old.starts[: n + 1].copy()
        areas = polygon_areas(xy, starts)
        area = np.zeros((self.views, self.mesh.n_faces))
        for level in range(self.views):
            rows = views > level
            area[level] = np.bincount(face[rows], areas[rows], minlength=self.mesh.n_faces)
        return Covered(self.mesh, area, self._bound.copy(), xy, starts, face, views)


def diagonal_floor(mesh: Mesh) -> float:
    """Least distance of two corners that do not coincide, metres."""
    return FLOOR_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))


def _taken(
    xy: FloatArray, starts: NDArray[np.int64], chosen: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Corners and starts of some polygons."""
    counts = starts[chosen + 1] - starts[chosen]
    ends = np.concatenate([np.zeros(1, np.int64), counts.cumsum()])
    return xy[np.repeat(starts[chosen] - ends[:-1], counts) + np.arange(ends[-1])], ends


def polygon_areas(xy: FloatArray, starts: NDArray[np.int64]) -> FloatArray:
    """(N,) areas of polygons in the plane, from their first corner on."""
    counts = np.diff(starts)
    first = np.repeat(starts[:-1], counts)
    following = np.arange(1, len(xy) + 1)
    following[starts[1:] - 1] = starts[:-1]
    away = xy - xy[first]
    after = away[following] if len(xy) else away
    twice = away[:, 0] * after[:, 1] - away[:, 1] * after[:, 0]
    found: FloatArray = np.add.reduceat(twice, starts[:-1]) / 2 if len(counts) else np.zeros(0)
    return found


@typed
def unite(regions: Regions | Sequence[Regions], views: int = 1) -> Covered:
    """Area of each face that at least 1 ... `views` poses cover.

    Parameters
    ----------
    regions : Regions, or sequence of Regions
        Of one mesh; several where there are several cameras.
    views : int
        k: poses up to which they are counted.

    Raises
    ------
    ConfigError
        For regions of different meshes, or none.
    """
    parts: list[Any] = [regions] if isinstance(regions, Regions) else list(regions)
    if not parts:
        raise ConfigError("regions must be of one camera or more, got none")
    union = RegionUnion(parts[0].mesh, views)
    for part in parts:
        union.add(part)
    return union.covered()
