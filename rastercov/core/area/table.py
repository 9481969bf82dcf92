"""Regions of poses as one table of convex pieces, and the parts that k poses of a group cover.

Records of regions for the engine: faces in their planes, and criteria.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    check_array,
    check_kind,
    dots,
    finite_number,
    frozen_record,
    members,
    offsets_of,
    shown,
)
from rastercov.core.area import polygons
from rastercov.core.area.criteria import MOST_DEVICES, AreaCriterion
from rastercov.core.area.cut import Kept, parts_where
from rastercov.core.area.polygons import FacePolygons, Overlay, frames_of
from rastercov.core.camera import Camera, Cameras, Poses
from rastercov.core.coverage.task import Rules, Task
from rastercov.core.mesh import Mesh


class Planes(NamedTuple):
    """Frames of the faces of a mesh; `is_asked` are those to be measured."""

    origin: FloatArray
    x_axis: FloatArray
    y_axis: FloatArray
    normal: FloatArray
    corners: FloatArray
    areas: FloatArray
    two_sided: BoolArray
    is_asked: BoolArray


class Criteria(NamedTuple):
    """Pointwise criteria of a task in the image of a pinhole.

    Attributes
    ----------
    lens : Lens
    rules : Rules
    gap : float
        Largest distance between the arc of the incidence criterion and its chords, and mean width
        of the strips that no test decides, relative to the diagonal of the mesh.
    """

    lens: Any
    rules: Rules
    gap: float


class LensCriteria(NamedTuple):
    """Pointwise criteria of a task in one ideal plane of a lens.

    Attributes
    ----------
    pinhole : Criteria
        What a surface must meet in the plane itself: to be in its image, the angle of incidence.
    rules : Rules
        All.
    by_distance : bool
        Distances are in focus; if not, depths along `axis` are.
    axis : (3,) float64
        Of the lens, in the axes of the plane.
    gap : float
        Mean width of the strips that no test decides, relative to the diagonal of the mesh.
    tree : Tree
        The field of view.
    code, params, frame
        The lens.
    slopes : Slopes
        Bounds of its derivatives.
    has_border : bool
        The image may show the border of its valid region in the plane.
    unit : float
        Length of a unit of the plane of parallel rays, metres; 0 of rays through a point.
    """

    pinhole: Criteria
    rules: Rules
    by_distance: bool
    axis: FloatArray
    gap: float
    tree: Any
    code: int
    params: FloatArray
    frame: FloatArray
    slopes: Any
    has_border: bool
    unit: float


Cut = Callable[["Regions", bool], "Regions"]
"""Cuts regions on the front of their faces, or on the rear where it is true."""


class Finder(Protocol):
    """Finder of the regions of poses of a condition, such as a `RegionPass`."""

    method: str
    """Method of visibility."""

    @property
    def cameras(self) -> Sequence[Camera]:
        """Those of the poses."""

    @property
    def mesh(self) -> Mesh:
        """Mesh that they look at."""

    def find(self, poses: Poses, /) -> "Regions":
        """Regions of some poses, each by itself."""

    def set_mesh(self, mesh: Mesh) -> None:
        """Look at the mesh with bodies elsewhere."""

    def close(self) -> None:
        """Release the scratch memory."""


class Condition(Protocol):
    """A condition on what cameras see, beyond their thresholds; for any number of threads.

    Attributes
    ----------
    reason : int
        Row of `REASONS` of faces of which it leaves too little.
    _finder : Finder, optional
        Pass of its own regions.
    """

    reason: int
    _finder: Finder | None

    def of_cameras(self, regions: "Regions", camera: Cameras, poses: Poses) -> "Regions":
        """Part that it leaves to each of P poses, before a rule counts them."""
        return regions

    def of_rows(self, regions: "Regions", camera: Cameras, poses: Poses, leads: Poses) -> "Regions":
        """Part that it leaves of rows of single cameras, by the first pose of each."""
        cut = regions._by_side(self.cut_of(leads))
        return replace(cut, eyes=regions.eyes, columns=regions.columns)

    def cut_of(self, leads: Poses) -> Cut:
        """Function that cuts rows that a rule has counted, by the first pose of each."""
        raise NotImplementedError  # each table has its own

    def in_scene(self, mesh: Mesh) -> "Condition":
        """The same condition after bodies of the mesh have moved."""
        raise NotImplementedError  # each table has its own

    def find_by(self, find: Callable[["Finder", Poses], "Regions"]) -> "Condition":
        """The same, with regions of its own poses by a function of their pass."""
        raise NotImplementedError  # each table has its own

    def close(self) -> None:
        """Release the scratch memory."""
        if self._finder is not None:
            self._finder.close()


@frozen_record(repr=False)
class Regions(FacePolygons):
    """Parts of the faces that cameras cover: P poses, N convex pieces of C corners in all.

    The pieces of a pose do not overlap, and lie in their faces. Pieces are ordered by pose, then by
    face. For each pair of pose and face, `|area - exact area| <= bound`, and at most `excess` of
    `area` is in fact not covered: `area - exact area <= excess <= bound`.

    Attributes
    ----------
    pose_ids : (P,) int64
        Row of each pose in the input.
    xy : (C, 2) float64
        Corners in the plane coordinates of the faces (`rastercov.core.area.polygons`), metres,
        counter-clockwise seen from the front; at most 20 per piece.
    starts : (N + 1,) int64
        The corners of piece i are xy[starts[i]] ... xy[starts[i + 1] - 1].
    face, pose : (N,) int32
        Face of each piece, and row of its pose in `pose_ids`.
    pair_pose, pair_face : (M,) int32
        Pose and face of each pair with a piece or a bound, in the same order.
    area, bound : (M,) float64
        Covered area of each pair, and the bound of its error, m^2.
    eyes : (P, 3) float64
        Centre of the camera of each pose, metres; NaN for a row of several cameras.
    conditions : tuple of Condition
        Further conditions, such as light, by which the pieces are not cut yet.
    devices : (N,) int64, optional
        Sensors that see each piece, as bits, where criteria depend on them.
    columns : (P, 3) float64, optional
        Direction of the image columns of the camera of each pose: y of its axes.
    excess : (M,) float64, optional
        Bound of the area that is wrongly counted as covered, m^2; equal to `bound` unless given. It
        is smaller than `bound` where rounding decides whether the camera is in front of the face:
        such a face counts as not covered.
    cut_short : float
        Area of all poses that criteria leave undecided because subdivision reached its limit, m^2;
        it is included in `bound`.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> seen = rc.regions(mesh, camera, rc.look_at([(0.6, 0, 0), (0.15, 0, 0)], (0, 0, 0)))
    >>> seen.areas().shape, seen.areas().sum(axis=1).round(4).tolist()  # m^2 by each pose
    ((2, 12), [0.04, 0.0025])
    >>> seen.points().shape[1]  # x, y, z of the corners of its polygons
    3
    """

    camera: Cameras
    task: Task
    pose_ids: IntArray
    pose: Int32Array
    pair_pose: Int32Array
    pair_face: Int32Array
    area: FloatArray
    bound: FloatArray
    eyes: FloatArray
    conditions: tuple[Condition, ...] = ()
    devices: IntArray | None = None
    columns: FloatArray | None = None
    excess: FloatArray = None  # type: ignore[assignment] # set below
    cut_short: float = 0.0

    def __post_init__(self) -> None:
        """Fill in the excess."""
        if self.excess is None:
            object.__setattr__(self, "excess", self.bound)

    def areas(self) -> FloatArray:
        """(P, F) covered area of each face by each pose, m^2."""
        return self._dense(self.area)

    def bounds(self) -> FloatArray:
        """(P, F) bound of the error of each of `areas`, m^2."""
        return self._dense(self.bound)

    def of_poses(self, chosen: BoolArray) -> "Regions":
        """Regions of the poses that `chosen`, (P,) bool, marks; ConfigError for another mask."""
        wanted = f"({len(self.pose_ids)},) True or False"
        chosen = check_array("chosen", chosen, "b", wanted, ConfigError)
        if chosen.shape != self.pose_ids.shape or chosen.dtype != np.bool_:
            raise ConfigError(f"expected chosen as {wanted}, got shape {chosen.shape}; select rows")
        return take_rows(self, np.flatnonzero(chosen))

    def _of_faces(self, chosen: BoolArray) -> "Regions":
        """Regions of some of the faces, (F,) bool, in all poses."""
        return self._with(np.flatnonzero(chosen[self.face]), np.flatnonzero(chosen[self.pair_face]))

    def _at_rest(self, mesh: Mesh, kept: IntArray) -> "Regions":
        """The same on a mesh at rest, where neither sides nor conditions are known."""
        return replace(
            self,
            mesh=mesh,
            face=kept[self.face].astype(np.int32),
            pair_face=kept[self.pair_face].astype(np.int32),
            eyes=np.full_like(self.eyes, np.nan),
            conditions=(),
        )

    def at_least(self, k: int, of: ArrayLike | None = None, *, one_side: bool = True) -> "Regions":
        """Regions that at least k poses of each group cover, one row per group.

        With k = 2, parts of a camera and a projector are those that both cover. The bound of an
        area is the sum of the bounds in the group, at most the area of the face.

        Parameters
        ----------
        k : int
            Poses of a group that must cover a part.
        of : (P,) int array_like, optional
            Group of each pose; those below 0 are left out. Rows of the result are groups in
            ascending order, and their `pose_ids` those of the first pose of each. All poses are one
            group unless given.
        one_side : bool
            True if the k poses that cover a part of a two-sided face must be on one side of it;
            False to count the poses on both sides together, as `unite` does.

        Raises
        ------
        ConfigError
            For k below 1, for invalid groups, and for rows of several cameras on two-sided faces.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> eyes = [(0.6, 0, 0), (0.6, 0.05, 0), (0, 0.6, 0)]
        >>> seen = rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0)))
        >>> [seen.at_least(k).areas().sum().round(4).item() for k in (1, 2, 3)]  # m^2
        [0.08, 0.04, 0.0]
        """
        number = finite_number(k)
        if not number.is_integer() or number < 1:
            raise ConfigError(f"expected k of 1 or more, got {shown(k)}; give a whole number")
        count = partial(_count, k=int(number), of=self._groups(of))
        if not one_side or number == 1:
            return count(self)
        return self._by_side(lambda part, _: count(part))

    def by_devices(self, of: ArrayLike | None = None, *, needs: Sequence[int] = ()) -> "Regions":
        """Regions that any pose of each group covers, cut by the set of poses that cover them.

        `Regions.devices` of the result has a bit for each pose of the group, in their order.
        Criteria of several sensors, such as summed light, apply to those of each piece. The bound
        of an area is the sum over the group; it holds for the area of any set of poses.

        Parameters
        ----------
        of : (P,) int array_like, optional
            Group of each pose, as for `at_least`; up to 64 poses each.
        needs : sequence of int
            Numbers of the poses in their group that must see a part.

        Raises
        ------
        ConfigError
            For invalid groups, and for groups of more than 64 poses.
        """
        groups = self._groups(of)
        numbers = np.zeros(len(groups), np.int64)
        for group in np.unique(groups[groups >= 0]).tolist():
            own = np.flatnonzero(groups == group)
            numbers[own] = np.arange(len(own))
        if numbers.max(initial=0) >= MOST_DEVICES:
            raise ConfigError(
                f"expected up to {MOST_DEVICES} poses per group, got {numbers.max() + 1}; split it"
            )
        wanted = members("needs", needs, (int, np.integer), "numbers of poses", ConfigError)
        if not all(0 <= each < MOST_DEVICES for each in wanted):
            raise ConfigError(
                f"expected needs from 0 to {MOST_DEVICES - 1}, got {shown(needs)}; correct them"
            )
        return _count(self, max(1, len(set(wanted))), groups, numbers, sorted(set(wanted)))

    def _groups(self, of: ArrayLike | None) -> IntArray:
        """Group of each pose, checked; see `at_least`."""
        n = len(self.pose_ids)
        wanted = f"a whole number for each of {n} poses"
        of = np.zeros(n, np.int64) if of is None else of
        groups = check_array("of", of, "iu", wanted, ConfigError)
        if groups.shape != (n,):
            raise ConfigError(
                f"expected 'of' as {wanted}, got shape {groups.shape}; -1 is no group"
            )
        return groups.astype(np.int64)

    def _by_side(self, make: Callable[["Regions", bool], "Regions"]) -> "Regions":
        """Regions made of those on each side of two-sided faces apart, and united.

        `make` gives regions of the same rows for both sides, of a side and whether it is the rear.
        A row with parts on one side is that of the side, whatever the other rows have.
        """
        sides = self._sides()
        if len(sides) == 1:
            return make(self, False)
        parts = [make(part, is_rear) for part, is_rear in zip(sides, (False, True), strict=True)]
        n = len(parts[0].pose_ids)
        front, rear = (np.isin(np.arange(n), part.pair_pose) for part in parts)
        rows = np.where(rear, n + np.arange(n), np.arange(n))
        if len(both := np.flatnonzero(front & rear)):
            of_both = [take_rows(part, both) for part in parts]
            united = _count(join(of_both), 1, np.tile(np.arange(len(both)), 2))
            rows[both] = 2 * n + np.arange(len(both))
            parts.append(united)
        result = take_rows(join(parts), rows)
        return replace(result, cut_short=sum(part.cut_short for part in parts[:2]))

    def _sides(self) -> tuple["Regions", ...]:
        """Regions from the front and from the rear of two-sided faces; one where none is."""
        two_sided, frames = self.mesh.two_sided_mask[self.pair_face], frames_of(self.mesh)
        away = self.eyes[self.pair_pose] - frames.origin[self.pair_face]
        height = dots(away, frames.normal[self.pair_face])
        if np.isnan(height[two_sided]).any():
            raise ConfigError(
                "expected rows of single cameras on two-sided faces, got rows of several; count "
                "with one_side=False, or use a Rig with a rule"
            )
        behind = two_sided & (height < 0)
        if not behind.any():
            return (self,)
        own = self._pair_of_pieces()
        return tuple(
            self._with(np.flatnonzero(side[own]), np.flatnonzero(side))
            for side in (~behind, behind)
        )

    def _pair_of_pieces(self) -> IntArray:
        """Row of the pair of pose and face that each piece is of."""
        n_faces = self.mesh.n_faces
        keys = self.pair_pose.astype(np.int64) * n_faces + self.pair_face
        return np.searchsorted(keys, self.pose.astype(np.int64) * n_faces + self.face)

    def where(self, criterion: AreaCriterion) -> "Regions":
        """Parts where a criterion holds, such as `RayAngle`.

        Their borders are curves: area closer to them than 2e-5 times the mesh diagonal is
        undecided, and included in the bounds.

        Parameters
        ----------
        criterion : RayAngle, BeamDensity, Uncertainty or another criterion
            Its values are for all rows of the regions, or one for each.

        Raises
        ------
        ConfigError
            For a criterion with another number of rows, and another object.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> seen = rc.regions(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0)))
        >>> wide = seen.where(rc.RayAngle([(0, 0, 0.6), (0.1, 0, 0.6)], degrees=11))
        >>> bool(wide.areas().sum() < seen.areas().sum())
        True
        """
        check_kind(
            "criterion", criterion, AreaCriterion, "a criterion, such as RayAngle", ConfigError
        )
        with_parts = self
        for cut in criterion._cuts(len(self.pose_ids)):
            with_parts = with_parts._with_parts(
                parts_where(with_parts, with_parts.pose, with_parts.devices, cut)
            )
        return with_parts

    def _with_parts(self, kept: Kept) -> "Regions":
        """Regions of parts of the pieces; what is undecided of these is in the bounds."""
        xy, starts, piece, area, undecided, cut_short = kept
        own, n = self._pair_of_pieces(), len(self.pair_pose)
        sums = np.bincount(own[piece], area, n).astype(np.float64)
        lost, most = np.bincount(own, undecided, n), frames_of(self.mesh).areas[self.pair_face]
        bound, excess = (np.minimum(each + lost, most) for each in (self.bound, self.excess))
        parts = replace(
            self, area=sums, bound=bound, excess=excess, cut_short=self.cut_short + cut_short
        )
        return parts._with(piece, np.flatnonzero((sums > 0) | (bound > 0)), (xy, starts))

    def _with(
        self, rows: IntArray, pairs: IntArray, own: tuple[FloatArray, IntArray] | None = None
    ) -> "Regions":
        """Regions of some rows of the pieces, and of the pairs; all poses stay.

        Pieces have corners and starts of their `own` if they are given.
        """
        xy, starts = own or polygons.choose_polygons(self.xy, self.starts, rows)
        return replace(
            self,
            xy=xy,
            starts=starts,
            face=self.face[rows],
            pose=self.pose[rows],
            devices=None if self.devices is None else self.devices[rows],
            pair_pose=self.pair_pose[pairs],
            pair_face=self.pair_face[pairs],
            area=self.area[pairs],
            bound=self.bound[pairs],
            excess=self.excess[pairs],
        )

    def _dense(self, values: FloatArray) -> FloatArray:
        full = np.zeros((len(self.pose_ids), self.mesh.n_faces))
        full[self.pair_pose, self.pair_face] = values
        return full


def join(parts: Sequence[Regions]) -> Regions:
    """Regions of all poses of several, of one mesh, in their order."""
    if len(parts) == 1:
        return parts[0]
    n = offsets_of([len(each.pose_ids) for each in parts]).astype(np.int32)
    columns: ByName = {
        name: np.concatenate([getattr(each, name) for each in parts])
        for name in ("xy", "face", "pose_ids", "pair_face", "area", "bound", "excess", "eyes")
    }
    for name in ("pose", "pair_pose"):
        rows = [getattr(each, name) + first for each, first in zip(parts, n, strict=False)]
        columns[name] = np.concatenate(rows)
    sets = [each.devices for each in parts if each.devices is not None]
    columns["devices"] = np.concatenate(sets) if len(sets) == len(parts) else None
    axes = [each.columns for each in parts if each.columns is not None]
    columns["columns"] = np.concatenate(axes) if len(axes) == len(parts) else None
    columns["cut_short"] = float(sum(each.cut_short for each in parts))
    counts = np.concatenate([np.diff(each.starts) for each in parts])
    return replace(parts[0], starts=offsets_of(counts), **columns)


def any_of(parts: Sequence[Regions], *, one_side: bool = True) -> Regions:
    """Union of several parts of the same rows; see `Regions.at_least`."""
    rows = np.tile(np.arange(len(parts[0].pose_ids)), len(parts))
    return join(parts).at_least(1, rows, one_side=one_side)


def take_rows(regions: Regions, rows: IntArray) -> Regions:
    """Regions of some rows, (Q,), in this order."""
    every = np.arange(len(regions.pose_ids) + 1)
    if np.array_equal(rows, every[:-1]):
        return regions

    def gather(pose: Int32Array) -> tuple[IntArray, Int32Array]:
        ends = np.searchsorted(pose, every)
        counts = np.diff(ends)[rows]
        first = np.repeat(ends[rows] - offsets_of(counts)[:-1], counts)
        return first + np.arange(len(first)), np.repeat(
            np.arange(len(rows), dtype=np.int32), counts
        )

    pieces, pose = gather(regions.pose)
    pairs, pair_pose = gather(regions.pair_pose)
    return replace(
        regions._with(pieces, pairs),
        pose_ids=regions.pose_ids[rows],
        pose=pose,
        pair_pose=pair_pose,
        eyes=regions.eyes[rows],
        columns=None if regions.columns is None else regions.columns[rows],
    )


def _count(
    regions: Regions,
    k: int,
    of: IntArray,
    number: IntArray | None = None,
    needs: Sequence[int] = (),
) -> Regions:
    """Regions that at least k poses of each group cover, whatever their sides; see `at_least`.

    With numbers of poses in their groups, (P,), by the sets of poses, see `by_devices`.
    """
    mesh, n_faces = regions.mesh, regions.mesh.n_faces
    groups, first = np.unique(of[of >= 0], return_index=True)
    first = np.flatnonzero(of >= 0)[first]
    row = np.searchsorted(groups, of)
    is_used = of >= 0
    # A face of a group with fewer than k poses is not covered, and that is exact.
    keys = row[regions.pair_pose] * n_faces + regions.pair_face
    keys[~is_used[regions.pair_pose]] = -1
    slots, slot, counts = np.unique(keys, return_inverse=True, return_counts=True)
    is_asked = (slots >= 0) & (counts >= k)
    place = np.cumsum(is_asked) - 1
    pairs = is_asked[slot]
    pose_face = regions.pose.astype(np.int64) * n_faces + regions.face
    own = slot[
        np.searchsorted(regions.pair_pose.astype(np.int64) * n_faces + regions.pair_face, pose_face)
    ]
    chosen = np.flatnonzero(is_asked[own])
    slots = slots[is_asked]
    face, frames = slots % n_faces, frames_of(mesh)
    views = k if number is None else None
    overlay = Overlay(frames.corners[face], frames.areas[face], mesh.opaque.diagonal, views)
    overlay.add(
        (
            *polygons.choose_polygons(regions.xy, regions.starts, chosen),
            place[own][chosen],
            regions.pose[chosen],
        ),
        (
            regions.pair_pose[pairs],
            place[slot[pairs]],
            regions.area[pairs],
            regions.bound[pairs],
            regions.excess[pairs],
        ),
        number,
    )
    eyes = np.full((len(groups), 3), np.nan)
    lone = np.bincount(row[is_used], minlength=len(groups)) == 1
    eyes[lone] = regions.eyes[first[lone]]
    rows = replace(regions, pose_ids=regions.pose_ids[first], eyes=eyes, columns=None)
    if number is None:
        return _with_overlay(rows, overlay, lambda tag: tag >= k, slots)
    wanted = np.bitwise_or.reduce(np.int64(1) << np.array(needs, np.int64))
    return _with_overlay(rows, overlay, lambda tag: (tag & wanted) == wanted, slots, by_tag=True)


def _with_overlay(
    rows: Regions,
    overlay: Overlay,
    is_kept: Callable[[IntArray], BoolArray],
    slots: IntArray,
    *,
    by_tag: bool = False,
) -> Regions:
    """Regions of these rows: pieces of an overlay whose tags are kept, of slots (row, face)."""
    group, face = np.divmod(slots, rows.mesh.n_faces)
    partition = overlay.partition()
    kept = np.flatnonzero(is_kept(partition.tag))
    own, (bound, excess) = partition.face[kept], overlay.bounds
    area = np.bincount(own, partition.area[kept], len(face)).astype(np.float64)
    xy, starts = polygons.choose_polygons(partition.xy, partition.starts, kept)
    is_listed = (area > 0) | (bound > 0)
    return replace(
        rows,
        xy=xy,
        starts=starts,
        face=face[own].astype(np.int32),
        pose=group[own].astype(np.int32),
        pair_pose=group[is_listed].astype(np.int32),
        pair_face=face[is_listed].astype(np.int32),
        area=area[is_listed],
        bound=bound[is_listed],
        excess=excess[is_listed],
        devices=partition.tag[kept] if by_tag else None,
    )
