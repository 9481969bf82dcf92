"""Area that a network covers: the union of regions, and the parts that several cameras cover."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rastercov.base.arguments import checked_array
from rastercov.base.checks import finite_number, shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray
from rastercov.base.threads import Once
from rastercov.base.typed import typed
from rastercov.coverage.area.division import NO_PIECES, Pieces, Progress
from rastercov.coverage.area.frames import FacePolygons, check_same_mesh, frames_of
from rastercov.coverage.area.overlay import Overlay
from rastercov.coverage.area.table import Regions
from rastercov.mesh import Mesh


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

    A face that k cameras cover as a whole is closed; see `Overlay`.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the regions.
    views : int
        k: cameras up to which they are counted.
    """

    def __init__(self, mesh: Mesh, views: int = 1) -> None:
        self.mesh, every = mesh, np.arange(mesh.n_faces)
        diagonal = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        self._overlay = Overlay(frames_of(mesh), every, diagonal, views)
        self.views = int(views)

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that k cameras cover as a whole."""
        return self._overlay.closed

    def add(self, regions: Regions, progress: Progress = lambda done, total: None) -> None:
        """Take in the regions of further poses; `ConfigError` where they are of another mesh.

        `progress` is called with the number of pieces done and of all, a few times a second.
        """
        check_same_mesh(self.mesh, regions.mesh)
        pairs = regions.pair_pose, regions.pair_face, regions.area, regions.bound
        self._overlay.add(regions._pieces(regions.face), regions.pose, pairs, progress)

    @classmethod
    def of(cls, covered: Covered, views: int) -> "RegionUnion":
        """Union of what was covered before, to which more is added."""
        union = cls(covered.mesh, views)
        face = covered.face.astype(np.int64)
        union._overlay.begin(
            Pieces(covered.xy, covered.starts, face, covered.views.astype(np.int64))
        )
        return union

    def fill(self, chosen: NDArray[np.bool_]) -> None:
        """Take in one more camera, which covers all of some faces: a mask, (F,)."""
        n_faces = self.mesh.n_faces
        wanted = f"a mask of {n_faces} faces"
        mask = checked_array("chosen", chosen, "b", wanted, ConfigError)
        if mask.shape != (n_faces,):
            raise ConfigError(f"chosen must be {wanted}, got shape {mask.shape}")
        self._overlay.unite(NO_PIECES, mask.astype(np.int64), np.zeros(n_faces))

    def covered(self) -> Covered:
        """Area that the regions so far cover, and its pieces."""
        pieces = self._overlay.partition()
        levels = range(1, self.views + 1)
        area = np.array([self._overlay.areas(pieces, pieces.tag >= level) for level in levels])
        face, bound = pieces.cell.astype(np.int32), self._overlay.bound
        return Covered(
            self.mesh, pieces.xy, pieces.starts, face, area, bound, pieces.tag.astype(np.int32)
        )


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
    union.fill(is_asked)
    whole = union.covered()
    return replace(
        covered, xy=whole.xy, starts=whole.starts, face=whole.face, views=whole.views - 1
    )
