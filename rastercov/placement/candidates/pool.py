"""Candidate poses, most of them square to a part of the surface, (6.4)-(6.11).

Every generator, here and in `mounting`, is called as `generator(mesh, camera, framing, ...)` and
returns `Candidates`, poses with their sources; those of several generators are added with `+`. The
framing of a target is stand-off, roll and up, (6.5)-(6.11).

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section
6.3.2. W. R. Scott. Model-based View Planning. 2009 (one view per face).

Views that a carrier or a constraint rejects, each with its reason.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    ByName,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    PoseError,
    cos,
    dots,
    frozen_record,
    hypot,
    matmul,
    norm,
    sin,
    size_in_words,
    sort_order,
)
from rastercov.base.format import number
from rastercov.base.typed import check_fields, typed
from rastercov.core.camera import MODELS, Camera, Poses, look_at, valid_poses
from rastercov.core.camera.viewpoints import depth_of_targets, half_angles
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen, matrices_of
from rastercov.formats.cameras import read_views
from rastercov.placement.candidates.segments import Segmentation

MOST_REASONS = 6
"""Reasons that a line names."""


class Refusal(NamedTuple):
    """A rejected view.

    Attributes
    ----------
    pose : (4, 4) float64
        world_from_camera.
    source : str
        Its generator.
    reason : str
        Kind of the reason, such as "out_of_reach" or "collision".
    words : str
        In words, such as "head collides with table".
    lack : float
        Minimum amount by which the view fails; 0 if unknown.
    unit : {"m", "deg"}
    camera : int
        Index of the camera.
    """

    pose: FloatArray
    source: str
    reason: str
    words: str
    lack: float = 0.0
    unit: str = "m"
    camera: int = 0


def by_words(refusals: Sequence[Refusal]) -> list[ByName]:
    """Number of views by reason in words, and the smallest lack among them; most first."""
    figures_by_key: dict[str, ByName] = {}
    for each in refusals:
        new = {"reason": each.reason, "what": each.words, "views": 0, "unit": each.unit}
        entry = figures_by_key.setdefault(each.words, new | {"least_lack": each.lack})
        entry["views"] += 1
        entry["least_lack"] = min(entry["least_lack"], each.lack)
    return sorted(figures_by_key.values(), key=lambda each: -int(each["views"]))


def in_words(refusals: Sequence[Refusal]) -> str:
    """Counts of reasons: "22 out of reach, 8 head collides with table (by 3 mm or more)"."""
    parts, every = list[str](), by_words(refusals)
    for each in every[:MOST_REASONS]:
        least = each["least_lack"]
        by = size_in_words(least) if each["unit"] == "m" else f"{number(least)} degrees"
        parts.append(f"{each['views']} {each['what']}" + (f" (by {by} or more)" if least else ""))
    if len(every) > MOST_REASONS:
        parts.append(f"{sum(each['views'] for each in every[MOST_REASONS:])} for other reasons")
    return ", ".join(parts)


FRAMING_MARGIN_REL = 1e-9
"""Relative margin that keeps targets inside the image and the depth of field after rounding."""
MOST_VIEWS = 1_000_000
"""Views of targets larger than the image."""


def check_stand_off(stand_off: tuple[float, float]) -> None:
    """Raise ConfigError unless the two distances are a range."""
    if len(stand_off) != 2 or not 0 <= stand_off[0] <= stand_off[1]:
        raise ConfigError(f"expected stand_off 0 <= least <= greatest, got {stand_off}; sort it")


def check_up(up: tuple[float, float, float]) -> None:
    """Raise ConfigError unless it is a direction."""
    if np.shape(up) != (3,) or not np.isfinite(up).all() or not any(up):
        raise ConfigError(f"expected up as a direction (3,), got {up}; give a vector other than 0")


@dataclass(frozen=True, kw_only=True)
class Framing:
    """Distance and rotation at which a candidate views its target.

    Attributes
    ----------
    stand_off : (float, float)
        Minimum and maximum distance from the camera centre to its target, metres. A camera without
        depth of field has no minimum of its own, and is placed as near to a small face as its field
        of view allows.
    fit : {"extent", "vertices"}
        Distance from the target. extent: (6.7), from the width and height of the target, as if it
        were flat and centred. vertices: the least distance at which all vertices are in view and
        beyond the near limit of the depth of field.
    margin : float
        Size of the image over that of the target, along both axes; > 0. 1 fills the image.
    rolls_deg : tuple of float
        Rotations about the optical axis, degrees, clockwise seen from behind the camera; one
        candidate for each.
    up : (float, float, float)
        Direction that is up in the image, (6.10); where the view is parallel to it, `look_at` takes
        another axis.
    max_blur : float, optional
        Limit of the blur circle for the depth of field, pixels; the camera's own unless given.

    Raises
    ------
    ConfigError
        For a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, per_face
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> framing = Framing(stand_off=(0.5, 3), fit="vertices", rolls_deg=(0, 90))
    >>> len(per_face(mesh, camera, framing))
    24
    """

    stand_off: tuple[float, float] = (0.0, np.inf)
    fit: Literal["extent", "vertices"] = "extent"
    margin: float = 1.0
    rolls_deg: tuple[float, ...] = (0.0,)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    max_blur: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        check_stand_off(self.stand_off)
        if not 0 < self.margin < np.inf:
            raise ConfigError(f"expected margin above 0, got {self.margin}; 1 fills the image")
        if not len(self.rolls_deg) or not np.isfinite(self.rolls_deg).all():
            raise ConfigError(
                f"expected rolls_deg of one angle or more, got {self.rolls_deg}; give 0"
            )
        check_up(self.up)

    def limits(self, camera: Camera) -> tuple[float, float]:
        """Minimum and maximum distance by `stand_off` and the depth of field, metres.

        ConfigError if they exclude each other.
        """
        z_n, z_f = camera.depth_of_field(self.max_blur)
        least = max(self.stand_off[0], z_n, camera.near)
        greatest = min(self.stand_off[1], z_f)
        if not least <= greatest:
            raise ConfigError(
                f"expected a stand-off in the depth of field {max(z_n, camera.near):g} to {z_f:g} "
                f"m, got {self.stand_off[0]:g} to {self.stand_off[1]:g} m; change it or the focus"
            )
        return least, greatest


DEFAULT = Framing()


def square_views(
    mesh: Mesh,
    camera: Camera,
    framing: Framing,
    faces: IntArray,
    group: IntArray,
) -> tuple[FloatArray, IntArray]:
    """Poses (N, 4, 4) of views square to groups of faces, each roll of each, and their groups (N,).

    Parallel rays see a group larger than the image in several views, side by side.

    Parameters
    ----------
    faces, group : (N,) int64
        Members of each group; a face may be in several, and no group is empty.
    """
    least, greatest = framing.limits(camera)
    half_angles(camera)  # raises for a camera that cannot be aimed, even without groups
    n_groups, n_rolls = int(group.max(initial=-1)) + 1, len(framing.rolls_deg)
    if not n_groups:
        return np.zeros((0, 4, 4)), np.zeros(0, np.int64)
    order = sort_order(group)
    faces, group = faces[order], group[order]
    starts = np.searchsorted(group, np.arange(n_groups))
    total = np.bincount(group)[:, None]
    # Relative to the centre of the mesh, because a far offset costs precision.
    middle = mesh.centre
    target = np.add.reduceat(mesh.centroids[faces] - middle, starts) / total
    normal = np.add.reduceat(mesh.normals[faces], starts)
    normal /= norm(normal)[..., None]
    upright = look_at(normal, np.zeros(3), framing.up)[:, :3, :3]
    frames = roll_frames(upright, framing.rolls_deg)
    corners = (mesh.vertices[mesh.faces[faces]] - middle) - target[group][:, None]
    if camera.is_parallel:
        views = [
            _side_by_side(
                camera, framing, matmul(corners, frames[group, roll]), starts, mesh.diagonal
            )
            for roll in range(n_rolls)
        ]
        owner = np.concatenate([own for own, _ in views])
        turns = np.repeat(np.arange(n_rolls), [len(own) for own, _ in views])
        order = sort_order(owner)
        places = np.concatenate([places for _, places in views])[order]
        axes, owner = frames[owner, turns][order], owner[order]
        shifts = dots(axes, places[:, None])
        return matrices_of(axes, middle + target[owner] + shifts), owner
    distance = np.empty((n_groups, n_rolls))
    for roll in range(n_rolls):
        seen = matmul(corners, frames[group, roll])
        fitting = fit_vertices if framing.fit == "vertices" else _fit_extent
        distance[:, roll] = fitting(camera, framing, seen, starts)
    distance = np.clip(distance, least, greatest)
    eyes = middle + target[:, None] + distance[..., None] * normal[:, None]
    poses = matrices_of(frames, eyes).reshape(-1, 4, 4)
    return poses, np.repeat(np.arange(n_groups), n_rolls)


def _side_by_side(
    camera: Camera, framing: Framing, seen: FloatArray, starts: IntArray, away: float
) -> tuple[IntArray, FloatArray]:
    """Groups (N,) and eyes (N, 3), from their targets in camera axes, of images side by side.

    The fewest that cover the extent of (M, 3, 3) corners, and its depth in layers as deep as the
    depth of field, without those that no face is in. Each has the middle of what it shows at the
    working distance.
    """
    z_n, z_f = camera.depth_of_field(framing.max_blur)
    at = float(np.clip(depth_of_targets(camera, away, framing.max_blur), *framing.limits(camera)))
    low, high = seen.min(axis=1), seen.max(axis=1)
    first, last = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    sides = np.append(2 * np.array(half_angles(camera)) / framing.margin, z_f - z_n)
    need = np.maximum(np.ceil((last - first) / sides * (1 - FRAMING_MARGIN_REL)), 1)
    number = need.prod(axis=1)
    if not number.sum() <= MOST_VIEWS:
        raise ConfigError(
            f"expected at most {MOST_VIEWS:,} views, got {number.sum():,.0f} side by side; use a "
            "smaller magnification or on_box"
        )
    one = np.flatnonzero(number == 1)
    owner, places = [one], [((first + last) / 2 - (0, 0, at))[one]]
    ends = np.append(starts[1:], len(seen))
    for row in np.flatnonzero(number > 1).tolist():  # 50 us a group, and 10 us an image of it
        own, steps = slice(starts[row], ends[row]), (last - first)[row] / need[row]
        for cell in np.ndindex(*need[row].astype(int).tolist()):
            corner = first[row] + cell * steps
            faces = ((low[own] <= corner + steps) & (high[own] >= corner)).all(axis=1)
            if faces.any():
                front = max(corner[2], low[own][faces, 2].min())
                back = min(corner[2] + steps[2], high[own][faces, 2].max())
                middle = np.append((corner + steps / 2)[:2], (front + back) / 2 - at)
                owner.append(np.array([row]))
                places.append(middle[None])
    return np.concatenate(owner), np.concatenate(places)


def roll_frames(rotations: FloatArray, rolls_deg: ArrayLike) -> FloatArray:
    """Camera axes turned about the view: (N, 3, 3) and (R,) -> (N, R, 3, 3).

    The x axis turns towards the y axis: the camera turns clockwise seen from behind, the image
    anticlockwise.
    """
    turns = turns_about_z(np.radians(np.asarray(rolls_deg, np.float64)))
    return matmul(rotations[:, None], turns)


def turns_about_z(angles: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations about z by N angles, radians; x turns towards y."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = cos(angles)
    turns[:, 1, 0], turns[:, 0, 1] = sin(angles), -sin(angles)
    turns[:, 2, 2] = 1.0
    return turns


def _fit_extent(camera: Camera, framing: Framing, seen: FloatArray, starts: IntArray) -> FloatArray:
    """(G,) W/2 cot(HFOV/2) or H/2 cot(VFOV/2), the larger, of (N, 3, 3) corners in camera axes."""
    low = np.minimum.reduceat(seen.min(axis=1), starts)
    high = np.maximum.reduceat(seen.max(axis=1), starts)
    halves = framing.margin * (high - low)[:, :2] / 2
    return (halves / half_angles(camera)).max(axis=1)


def fit_vertices(
    camera: Camera, framing: Framing, seen: FloatArray, starts: IntArray
) -> FloatArray:
    """(G,) distance from which all of (N, 3, 3) corners, from the target, are in view and focus.

    A vertex x across and z beyond the target is in view from d where |x| <= (d + z) tan(angle).
    Where not all can be in focus, the nearest ones are. Lenses without a plane in focus are in
    focus up to a distance, and a vertex off the axis is further away than its depth. Parallel rays
    have the width of their image as the least distance, where all is in focus.
    """
    z_n, z_f = camera.depth_of_field(framing.max_blur)
    z_n = max(z_n, camera.near) * (1 + FRAMING_MARGIN_REL)
    offset = np.abs(seen[..., :2]) * (framing.margin * (1 + FRAMING_MARGIN_REL))
    depth = seen[..., 2]
    if camera.is_parallel:
        need = (z_n or min(half_angles(camera))) - depth
    else:
        need = np.maximum((offset / half_angles(camera)).max(axis=-1), z_n) - depth
    distance = np.maximum.reduceat(need.max(axis=1), starts)
    furthest = z_f - depth
    if not MODELS[camera.model].is_planar:
        off_axis = hypot(seen[..., 0], seen[..., 1])
        furthest = np.sqrt(np.maximum((z_f - off_axis) * (z_f + off_axis), 0.0)) - depth
    before = np.minimum.reduceat(depth.min(axis=1), starts)
    most = np.minimum.reduceat(furthest.min(axis=1), starts)
    return np.maximum(np.minimum(distance, most), z_n - before)


@frozen_record
class Candidates:
    """Candidate poses and their sources; add those of several generators with `+`.

    Attributes
    ----------
    poses : (C, 4, 4) float64
        world_from_camera; read-only, as all arrays.
    source_code : (C,) int16
        Index in `sources` of the generator of each pose.
    index : (C,) int64
        Segment, face, vertex or row of the pose file that each pose was made for; -1 for none.
    sources : tuple of str
        Names of the generators.
    camera : (C,) int32
        Index of the camera of each pose, where there are several; 0 unless given.
    refused : tuple of Refusal
        Views that were left out, with reasons.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, on_sphere, per_face
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> framing = Framing(stand_off=(2, 4))
    >>> values = on_sphere(mesh, camera, framing, count=8) + per_face(mesh, camera, framing)
    >>> len(values), values.sources
    (20, ('sphere', 'face'))
    """

    poses: FloatArray
    source_code: NDArray[np.int16]
    index: IntArray
    sources: tuple[str, ...]
    camera: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    refused: tuple[Refusal, ...] = ()

    def __post_init__(self) -> None:
        if len(self.camera) != len(self.poses):
            object.__setattr__(self, "camera", frozen(np.zeros(len(self.poses), np.int32)))

    @classmethod
    def of(cls, poses: FloatArray, source: str, index: ArrayLike = -1) -> "Candidates":
        """Candidates of one source; `index` is one number, or one per pose."""
        count = len(poses)
        return cls(
            poses=frozen(np.array(poses, np.float64, order="C")),
            source_code=frozen(np.zeros(count, np.int16)),
            index=frozen(np.array(np.broadcast_to(np.asarray(index, np.int64), count))),
            sources=(source,),
        )

    def __len__(self) -> int:
        return len(self.poses)

    def __add__(self, other: "Candidates") -> "Candidates":
        names = tuple(dict.fromkeys(self.sources + other.sources))
        codes = [
            np.array([names.index(name) for name in each.sources], np.int16)[each.source_code]
            for each in (self, other)
        ]
        return Candidates(
            poses=frozen(np.concatenate((self.poses, other.poses))),
            source_code=frozen(np.concatenate(codes)),
            index=frozen(np.concatenate((self.index, other.index))),
            sources=names,
            camera=frozen(np.concatenate((self.camera, other.camera))),
            refused=self.refused + other.refused,
        )

    @property
    def placed(self) -> Poses:
        """The poses with the index of the camera of each."""
        return Poses.of(self.poses, camera=self.camera)

    def of_camera(self, index: int) -> "Candidates":
        """The same poses, all of the camera with this index."""
        refused = tuple(each._replace(camera=index) for each in self.refused)
        return replace(self, camera=frozen(np.full(len(self), index, np.int32)), refused=refused)

    @property
    def source(self) -> NDArray[np.str_]:
        """(C,) name of the generator of each pose."""
        return np.array(self.sources, np.str_)[self.source_code]

    def take(self, chosen: ArrayLike) -> "Candidates":
        """Candidates that a mask, (C,), or rows, (N,), choose, in that order."""
        rows = np.atleast_1d(np.asarray(chosen))
        rows = rows if rows.size else rows.astype(np.int64)  # an empty list has dtype float64
        parts = (self.poses, self.source_code, self.index, self.camera)
        poses, codes, index, camera = (frozen(part[rows]) for part in parts)
        return Candidates(poses, codes, index, self.sources, camera, self.refused)

    def counts(self) -> dict[str, int]:
        """Number of poses of each source."""
        each = np.bincount(self.source_code, minlength=len(self.sources))
        return dict(zip(self.sources, each.tolist(), strict=True))


@typed
def per_segment(
    mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, segmentation: Segmentation
) -> Candidates:
    """Views perpendicular to each segment, (6.4)-(6.11): eye = T_S + d n.

    T_S is the average corner (6.4), n the unit average normal (6.5), and the stand-off

        d = max(z_n, W/2 cot(HFOV/2), H/2 cot(VFOV/2))

    for the segment's extent W x H along the axes of the image, limited to z_f. Eissa (2020) adds
    the direction to itself instead of to T_S (6.6), and uses the width only, which is the largest
    side of a box along the axes of the world (6.7). Where the optical axis is off the middle of the
    image, the nearer border counts.

    Parameters
    ----------
    mesh : Mesh
        The part.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Framing of the segments.
    segmentation : Segmentation
        Result of `segment` for this mesh.

    Returns
    -------
    Candidates
        One view per segment and roll, segment by segment; more with parallel rays if a segment is
        larger than the image. `index` is the segment.

    Raises
    ------
    ConfigError
        If stand-off and depth of field exclude each other, the optical axis misses the image, or
        the segmentation is of another mesh.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, per_segment, segment
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> sides = segment(mesh, 15, 25)
    >>> segments = per_segment(mesh, camera, Framing(stand_off=(1, 3)), segmentation=sides)
    >>> len(segments), segments.sources
    (6, ('segment',))
    """
    if len(segmentation.labels) != mesh.n_faces:
        raise ConfigError(
            f"expected {mesh.n_faces} faces, got {len(segmentation.labels)}; segment this mesh"
        )
    faces = np.flatnonzero(segmentation.labels >= 0)
    poses, of_segment = square_views(mesh, camera, framing, faces, segmentation.labels[faces])
    return Candidates.of(poses, "segment", of_segment)


@typed
def per_face(
    mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, faces: ArrayLike | None = None
) -> Candidates:
    """Views perpendicular to each face, as Scott: `per_segment` with one segment per face.

    A camera without depth of field is placed very near to a small face unless `framing` has a
    minimum stand-off.

    Parameters
    ----------
    mesh : Mesh
        The part.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Framing of the faces.
    faces : (F,) bool or (N,) int array_like, optional
        Mask or indices of the faces to use; all evaluated faces by default. Faces without area are
        left out.

    Returns
    -------
    Candidates
        Face by face; `index` is the face.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, per_face
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = per_face(mesh, camera, Framing(stand_off=(1, 3)))
    >>> len(result), result.index.tolist() == list(range(mesh.n_faces))
    (12, True)
    """
    rows = face_rows(mesh, mesh.task_mask if faces is None else faces)
    rows = rows[~mesh.degenerate_mask[rows]]
    poses, of_row = square_views(mesh, camera, framing, rows, np.arange(len(rows)))
    return Candidates.of(poses, "face", rows[of_row])


@typed
def from_poses(
    mesh: Mesh, camera: Camera, framing: Framing = DEFAULT, *, poses: ArrayLike | str | Path
) -> Candidates:
    """Poses of a file, or an array of them, each with every roll of `framing`.

    Parameters
    ----------
    mesh, camera
        As for `on_box`; they do not change the poses.
    framing : Framing, optional
        Only its rolls apply.
    poses : (C, 4, 4) array_like or path
        world_from_camera; or a file as for `read_views`, whose lengths must have a unit.

    Returns
    -------
    Candidates
        In their order; `index` is the row.

    Raises
    ------
    PoseError
        For a pose that is not a rigid transform, and a file without a unit.
    PoseError, CameraError
        For a file that cannot be read.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import from_poses
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=5)
    >>> result = from_poses(mesh, camera, poses=poses)
    >>> len(result), result.sources
    (5, ('poses',))
    """
    if isinstance(poses, (str, Path)):
        views = read_views(poses)
        if not views.has_unit:
            raise PoseError(
                f"{poses}: expected poses in metres, got no unit; convert with --pose-unit"
            )
        poses = views.poses
    given = valid_poses(poses)
    return roll_candidates(given, "poses", np.arange(len(given)), framing)


def roll_candidates(
    upright: FloatArray, source: str, index: ArrayLike, framing: Framing
) -> Candidates:
    """Candidates of (N, 4, 4) poses, each with every roll, and N indices or one for all."""
    n = len(framing.rolls_deg)
    eyes = np.repeat(upright[:, None, :3, 3], n, axis=1)
    poses = matrices_of(roll_frames(upright[:, :3, :3], framing.rolls_deg), eyes)
    each = np.repeat(np.broadcast_to(index, len(upright)), n)
    return Candidates.of(poses.reshape(-1, 4, 4), source, each)


def face_rows(mesh: Mesh, faces: ArrayLike) -> IntArray:
    """Rows of the faces that a mask (F,) or a list (N,) of rows chooses; ConfigError for others."""
    chosen = np.asarray(faces)
    if chosen.shape != (mesh.n_faces,) if chosen.dtype == np.bool_ else chosen.ndim != 1:
        raise ConfigError(
            f"expected faces as a mask of {mesh.n_faces} or as rows, got {chosen.shape}; give one"
        )
    rows = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen.astype(np.int64)
    if ((rows < 0) | (rows >= mesh.n_faces)).any():
        raise ConfigError(
            f"expected face indices from 0 to {mesh.n_faces - 1}, got {rows.min()} to "
            f"{rows.max()}; correct them"
        )
    return rows
