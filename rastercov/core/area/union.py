"""Area that a network covers: the union of regions, and the parts that several cameras cover."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    Int32Array,
    check_array,
    finite_number,
    frozen_record,
    once_each,
    shown,
)
from rastercov.base.typed import typed
from rastercov.core.area import polygons
from rastercov.core.area.polygons import FacePolygons, Overlay, Progress, frames_of
from rastercov.core.area.table import Regions
from rastercov.core.mesh import Mesh
from rastercov.engine.solver_union import FEW_FACES, POSES_TOGETHER


@frozen_record(repr=False)
class Covered(FacePolygons):
    """Area of each face that at least 1 ... k cameras cover, divided into pieces.

    For every row of `area`, `|area - exact area| <= bound`, and at most `excess` of `area` is in
    fact not covered: `area - exact area <= excess <= bound`.

    Attributes
    ----------
    area : (k, F) float64
        Row j: area of each face that at least j + 1 cameras cover, m^2.
    bound, excess : (F,) float64
        Bounds of the error of these areas, m^2. `excess` is smaller than `bound` only where
        rounding decides whether a camera is in front of the face.
    xy : (C, 2) float64
        Corners in the plane coordinates of the faces, metres, counter-clockwise.
    starts : (N + 1,) int64
        The corners of piece i are xy[starts[i]] ... xy[starts[i + 1] - 1].
    face, views : (N,) int32
        Face of each piece, in ascending order, and number of cameras that cover it; k means k
        or more.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.look_at([(0.6, 0, 0), (0.6, 0.05, 0), (0, 0, 0.6)], (0, 0, 0))
    >>> covered = rc.unite(rc.regions(mesh, camera, poses), views=2)
    >>> round(covered.share(1), 3), round(covered.share(2), 3)  # by one camera, by two
    (0.333, 0.167)
    >>> covered.area.sum(axis=1).round(6).tolist()  # m^2
    [0.08, 0.04]
    """

    area: FloatArray
    bound: FloatArray
    excess: FloatArray
    views: Int32Array

    def share(self, views: int = 1) -> float:
        """Part of the area of the evaluated faces that at least `views` cameras cover, [0, 1].

        ConfigError for `views` beyond the k that are counted.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> eyes = [(0.6, 0, 0), (0.6, 0.05, 0)]
        >>> covered = rc.unite(rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0))), views=2)
        >>> round(covered.share(), 3), round(covered.share(2), 3)  # one side of six, by both
        (0.167, 0.167)
        """
        number = finite_number(views)
        k = len(self.area)
        if number not in range(1, k + 1):
            raise ConfigError(
                f"expected views of 1{f' to {k}' if k > 1 else ''}, got {shown(views)}; for "
                "more, give a Task with these views, or unite with them"
            )
        scored = self.mesh.task_mask
        total = frames_of(self.mesh).areas[scored].sum()
        return float(self.area[int(number) - 1][scored].sum() / total) if total > 0 else 0.0


class RegionUnion:
    """Union of regions, added a few poses at a time; one thread at a time may use it.

    A face that k cameras cover completely is finished: later poses cost nothing there.

    Parameters
    ----------
    mesh : Mesh
        Mesh of the regions.
    views : int
        k: cameras that cover a point are counted up to this number.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> union = rc.RegionUnion(mesh)
    >>> for x in (0.6, -0.6):
    ...     union.add(rc.regions(mesh, camera, rc.look_at((x, 0, 0), (0, 0, 0))))
    ...     print(round(union.covered().share(), 3))
    0.167
    0.333
    """

    def __init__(self, mesh: Mesh, views: int = 1) -> None:
        self.mesh, frames = mesh, frames_of(mesh)
        together = POSES_TOGETHER if mesh.n_faces <= FEW_FACES else 1
        size = mesh.opaque.diagonal
        self._overlay = Overlay(frames.corners, frames.areas, size, views, together)
        self.views = int(views)

    @property
    def closed(self) -> BoolArray:
        """(F,) mask of the faces that k cameras cover completely."""
        return self._overlay.closed

    def add(self, regions: Regions, progress: Progress | None = None) -> None:
        """Add the regions of further poses; `ConfigError` for those of another mesh.

        `progress` is called with the number of pieces done and of all, a few times a second.
        """
        self.mesh._check_same(regions.mesh)
        pieces = regions.xy, regions.starts, regions.face, regions.pose
        figures = regions.area, regions.bound, regions.excess
        pairs = regions.pair_pose, regions.pair_face, *figures
        self._overlay.add(pieces, pairs, progress=progress)

    @classmethod
    def of(cls, covered: Covered, views: int) -> "RegionUnion":
        """Union that starts with an earlier result and counts up to `views` cameras."""
        union = cls(covered.mesh, views)
        pieces = covered.xy, covered.starts, covered.face, covered.views
        union._overlay.begin(pieces, covered.bound, covered.excess)
        return union

    def add_parts(self, covered: "Covered", chosen: BoolArray) -> None:
        """Add the pieces of `covered` marked in `chosen`, (N,), as the area of one camera."""
        rows = np.flatnonzero(_mask(chosen, len(covered.face), "pieces"))
        xy, starts = polygons.choose_polygons(covered.xy, covered.starts, rows)
        face, own = covered.face[rows], polygons.polygon_areas(xy, starts)
        faces, at = np.unique(face, return_inverse=True)
        zero = np.zeros(len(faces))
        pairs = np.zeros(len(faces), np.int32), faces, np.bincount(at, own, len(faces)), zero, zero
        self._overlay.add((xy, starts, face, np.zeros(len(face), np.int32)), pairs)

    def fill(self, chosen: BoolArray) -> None:
        """Add a camera that covers the faces marked in `chosen`, (F,), completely."""
        self._overlay.united.fill(_mask(chosen, self.mesh.n_faces, "faces"))

    def covered(self) -> Covered:
        """Area that the regions added so far cover, and its pieces."""
        pieces, (bound, excess) = self._overlay.partition(), self._overlay.bounds
        area, views = self._overlay.areas(self.views), pieces.tag.astype(np.int32)
        return Covered(self.mesh, pieces.xy, pieces.starts, pieces.face, area, bound, excess, views)


def _mask(chosen: BoolArray, count: int, of: str) -> BoolArray:
    """A mask of `count` faces or pieces, (count,); ConfigError for anything else."""
    wanted = f"a mask of {count} {of}"
    mask = check_array("chosen", chosen, "b", wanted, ConfigError)
    if mask.shape != (count,):
        raise ConfigError(f"expected chosen as {wanted}, got shape {mask.shape}; select {of}")
    return np.ascontiguousarray(mask, np.bool_)


@typed
def unite(
    regions: Regions | Sequence[Regions],
    views: int = 1,
    *,
    progress: Progress | None = None,
) -> Covered:
    """Area of each face that at least 1 ... `views` poses cover.

    Parameters
    ----------
    regions : Regions, or sequence of Regions
        Regions of one mesh; several of them are united, such as those of different cameras.
    views : int
        k: poses that cover a point are counted up to this number.
    progress : callable, optional
        Called with the number of pieces done and the total, for each of the regions.

    Raises
    ------
    ConfigError
        For no regions, and for regions of different meshes.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eyes = [(0.6, 0, 0), (0.6, 0.05, 0), (0, 0, 0.6)]
    >>> covered = rc.unite(rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0))), views=2)
    >>> [round(covered.share(n), 3) for n in (1, 2)]  # by that many cameras or more
    [0.333, 0.167]
    """
    parts: list[Any] = [regions] if isinstance(regions, Regions) else list(regions)
    if not parts:
        raise ConfigError("expected regions of one camera or more, got none; give some")
    union = RegionUnion(parts[0].mesh, views)
    for part in parts:
        union.add(part, progress)
    return union.covered()


@once_each
def with_rest(covered: Covered) -> Covered:
    """The partition with the rest of the evaluated faces, as further pieces of 0 views.

    Their areas are sums of the same cuts: with the others they make up the faces, up to rounding.
    Computed at the first call, since dead zones and the coloured mesh both want it.
    """
    mesh, k = covered.mesh, len(covered.area)
    union = RegionUnion.of(covered, k + 1)
    # One more camera, which covers every face as a whole: what only it covers is the rest.
    is_asked = mesh.task_mask & (frames_of(mesh).areas > 0)
    union.fill(is_asked)
    whole = union.covered()
    return replace(
        covered, xy=whole.xy, starts=whole.starts, face=whole.face, views=whole.views - 1
    )
