"""Area that a network covers: the union of regions, and the parts that several cameras cover."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import check_memory
from rastercov.base.threads import Once
from rastercov.base.typed import typed
from rastercov.coverage.area.division import (
    NO_PIECES,
    PIECES_A_STEP,
    Cells,
    Pieces,
    Progress,
    joined,
)
from rastercov.coverage.area.frames import FacePolygons, check_same_mesh, frames_of
from rastercov.coverage.area.polygons import polygon_areas
from rastercov.coverage.area.regions import Regions
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]


FLOOR_REL = 1e-15
"""Least distance of two corners that do not coincide, relative to the diagonal of the mesh."""
MOST_VIEWS = 10_000
"""Cameras up to which they may be counted."""
WHOLE_PAIR_REL = 1e-9
"""Part of the area of a face that a camera may miss and still count as covering all of it."""


@dataclass(frozen=True, eq=False, repr=False)
class Covered(FacePolygons):
    """Area of each face that at least 1 ... k cameras cover, and a partition of it.

    `bound` holds for every row of `area`: `|area - exact area| <= bound`.

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

    area: FloatArray
    bound: FloatArray
    views: NDArray[np.int32]

    def share(self, views: int = 1) -> float:
        """Part of the area of the task faces that at least `views` cameras cover, [0, 1]."""
        number = finite_number(views)
        if number not in range(1, len(self.area) + 1):
            raise ConfigError(f"views must be 1 ... {len(self.area)}, got {shown(views)}")
        scored = self.mesh.task_mask
        total = frames_of(self.mesh).areas[scored].sum()
        return float(self.area[int(number) - 1][scored].sum() / total) if total > 0 else 0.0


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
        from rastercov.kernels import area_union
        from rastercov.kernels.area_plane import COINCIDENT_REL

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
        self.mesh, self.views, self._kernels = mesh, int(views), area_union
        frames, diagonal = frames_of(mesh), float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        self._areas, self._bound = frames.areas, np.zeros(mesh.n_faces)
        self._nearest = np.maximum(COINCIDENT_REL * frames.corners[:, 1, 0], FLOOR_REL * diagonal)
        self._cells = Cells(frames.corners, self._nearest)
        self._pieces, self._pool = NO_PIECES, area_union.pool_of(64)

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that k cameras cover as a whole."""
        return self._cells.is_closed[: self.mesh.n_faces].copy()

    def add(self, regions: Regions, progress: Progress = lambda done, total: None) -> None:
        """Take in the regions of further poses; `ConfigError` where they are of another mesh.

        `progress` is called with the number of pieces done and of all, a few times a second.
        """
        check_same_mesh(self.mesh, regions.mesh)
        n_faces, is_closed = self.mesh.n_faces, self.closed
        is_open = ~is_closed[regions.pair_face]
        is_whole = regions.area >= (1 - WHOLE_PAIR_REL) * self._areas[regions.pair_face]
        whole = np.bincount(regions.pair_face[is_whole & is_open], minlength=n_faces)
        missing = np.maximum(self._areas[regions.pair_face] - regions.area, 0.0)
        lost = (regions.bound + np.where(is_whole, missing, 0.0))[is_open]
        bound = self._bound + np.bincount(regions.pair_face[is_open], lost, minlength=n_faces)
        keys = regions.pair_pose.astype(np.int64) * n_faces + regions.pair_face
        chosen = np.flatnonzero(~is_closed[regions.face] & (whole[regions.face] < self.views))
        own = regions.pose[chosen].astype(np.int64) * n_faces + regions.face[chosen]
        chosen = chosen[~is_whole[np.searchsorted(keys, own)]]
        tags = np.zeros(len(regions), np.int32)
        new = Pieces(regions.xy, regions.starts, regions.face.astype(np.int64), tags)
        self.unite(new.taken(chosen), whole, bound, progress)

    @classmethod
    def of(cls, covered: Covered, views: int) -> "RegionUnion":
        """Union of what was covered before, to which more is added."""
        union = cls(covered.mesh, views)
        face = covered.face.astype(np.int64)
        union._pieces = Pieces(covered.xy, covered.starts, face, covered.views)
        return union

    def unite(
        self,
        new: Pieces,
        whole: NDArray[np.int64],
        bound: FloatArray,
        progress: Progress = lambda done, total: None,
    ) -> None:
        """Take in pieces, tag 0, of faces; and (F,) cameras that cover all of each face, besides.

        `bound` is that of the union without what is lost here.
        """
        n_faces, cells = self.mesh.n_faces, self._cells.copy()
        pieces = cells.place(joined([self._pieces, new]), bound)
        asked = cells.of_faces(np.flatnonzero(whole > 0))
        used = np.unique(np.concatenate([pieces.cell, asked]))
        used = used[np.lexsort((used, cells.face[used]))]
        place = np.zeros(len(cells.face), np.int64)
        place[used] = np.arange(len(used))
        at = place[pieces.cell]
        is_old = pieces.tag > 0
        old_rows, new_rows = np.flatnonzero(is_old), np.flatnonzero(~is_old)
        old = pieces.taken(old_rows[np.argsort(at[old_rows], kind="stable")])
        areas = polygon_areas(pieces.xy, pieces.starts)
        order = new_rows[np.lexsort((-areas[new_rows], at[new_rows]))]
        xy, starts = cells.polygons(used)
        own_bound, own_closed = np.zeros(len(used)), cells.is_closed[used]
        found = self._united(
            (xy, starts, polygon_areas(xy, starts)), self._nearest[cells.face[used]],
            self._kernels.Partition(
                old.xy, old.starts, place[old.cell], old.tag,
                np.array([len(old.cell), len(old.xy)], np.int64),
            ),
            (pieces.xy, pieces.starts, at), order, whole[cells.face[used]], own_closed, own_bound,
            progress,
        )  # fmt: skip
        bound += np.bincount(cells.face[used], own_bound, minlength=n_faces)
        cells.is_closed[used] = own_closed
        n, corners = found.used.tolist()
        pieces = Pieces(
            found.xy[:corners].copy(), found.starts[: n + 1].copy(), used[found.cell[:n]],
            found.views[:n].copy(),
        )  # fmt: skip
        self._pieces = self._without_closed_cells(cells, pieces)
        self._cells, self._bound = cells, np.minimum(bound, self._areas)

    def _united(
        self, cells: Any, nearest: FloatArray, old: Any, new: Any, order: Any, whole: Any,
        is_closed: Any, bound: FloatArray, progress: Progress,
    ) -> Any:  # fmt: skip
        """Partition by `unite_cells`, a few cells at a time: Ctrl-C waits for no more."""
        kernels, n_cells, n = self._kernels, len(nearest), len(order)
        out = kernels.room_for_partition(2 * (n + len(old.cell)) + 64, 2 * len(new[0]) + 512)
        span = np.zeros(4, np.int64)
        last = np.searchsorted(new[2][order], np.arange(n_cells), side="right")
        while span[0] < n_cells:
            at = max(int(np.searchsorted(last, span[2] + PIECES_A_STEP)), int(span[0])) + 1
            span[3] = min(at, n_cells)
            state = kernels.unite_cells(
                cells, nearest, self.views, old, new, order, whole, self._pool, is_closed, bound,
                out, span,
            )  # fmt: skip
            if state == kernels.POOL_TOO_SMALL:
                self._pool = kernels.pool_of(2 * len(self._pool.views))
            elif state == kernels.PARTITION_TOO_SMALL:
                out = kernels.more_room(out, len(self._pool.views))
            progress(int(span[2]), n)
        return out

    def _without_closed_cells(self, cells: Cells, pieces: Pieces) -> Pieces:
        """Pieces, where faces of which all cells are closed become one piece and one cell."""
        divided = np.flatnonzero(cells.division[: self.mesh.n_faces] >= 0)
        if len(divided) == 0:
            return pieces
        parts = cells.of_faces(divided)
        is_open = np.zeros(self.mesh.n_faces, np.bool_)
        is_open[cells.face[parts[~cells.is_closed[parts]]]] = True
        done = divided[~is_open[divided]]
        rest = pieces.taken(np.flatnonzero(~np.isin(cells.face[pieces.cell], done)))
        cells.close(done)
        xy, starts = cells.polygons(done)
        whole = Pieces(xy, starts, done, np.full(len(done), self.views, np.int32))
        both = joined([rest, whole])
        return both.taken(np.argsort(cells.face[both.cell], kind="stable"))

    def covered(self) -> Covered:
        """Area that the regions so far cover, and its pieces."""
        xy, starts, cell, views = self._pieces
        face, areas = self._cells.face[cell].astype(np.int32), polygon_areas(xy, starts)
        area = np.zeros((self.views, self.mesh.n_faces))
        for level in range(self.views):
            rows = views > level
            area[level] = np.bincount(face[rows], areas[rows], minlength=self.mesh.n_faces)
        bound = self._bound.copy()
        return Covered(self.mesh, xy.copy(), starts.copy(), face, area, bound, views)


@typed
def unite(
    regions: Regions | Sequence[Regions],
    views: int = 1,
    *,
    progress: Progress = lambda done, total: None,
) -> Covered:
    """Area of each face that at least 1 ... `views` poses cover.

    Parameters
    ----------
    regions : Regions, or sequence of Regions
        Of one mesh; several where there are several cameras.
    views : int
        k: poses up to which they are counted.
    progress : callable
        Called with the number of pieces done and of all, of each of the regions.

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
        union.add(part, progress)
    return union.covered()


_WHOLE: WeakKeyDictionary[Covered, Once[Covered]] = WeakKeyDictionary()


def with_rest(covered: Covered) -> Covered:
    """The partition with the rest of the task faces, as further pieces of 0 views.

    Their areas are sums of the same cuts: with the others they make up the faces, to rounding.
    Computed at the first call, since dead zones and the coloured mesh both want it.
    """
    return _WHOLE.setdefault(covered, Once()).get(lambda: _with_rest(covered))


def _with_rest(covered: Covered) -> Covered:
    """See `with_rest`."""
    mesh, k = covered.mesh, len(covered.area)
    union = RegionUnion.of(covered, k + 1)
    # One more camera, which covers every face as a whole: what only it covers is the rest.
    is_asked = mesh.task_mask & (frames_of(mesh).areas > 0)
    union.unite(NO_PIECES, is_asked.astype(np.int64), np.zeros(mesh.n_faces))
    whole = union.covered()
    return replace(
        covered, xy=whole.xy, starts=whole.starts, face=whole.face, views=whole.views - 1
    )
