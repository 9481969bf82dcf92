"""Coverage over time: regions of the frames of a motion, on the mesh in its rest pose.

Plane coordinates of a face move with it. So regions of all frames are of one mesh, and time is a
count: `Regions.at_least` over frames is what is covered in some frame, in a share of them, always.
Frames of faces are chosen at rest and turned: chosen anew, rounding would decide between edges of
equal length, and regions of two frames would have other coordinates.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    check_choice,
    frozen_record,
    norm,
    owners_of,
    shown,
)
from rastercov.core.area.features import FEATURES
from rastercov.core.area.regions import GAP_REL, RegionPass
from rastercov.core.area.rows import with_rule
from rastercov.core.area.table import Finder, Regions, any_of, join, take_rows
from rastercov.core.camera import (
    Cameras,
    Poses,
    axes_of,
    cameras_of,
    eyes_of,
    is_joint,
    near_limits,
)
from rastercov.core.coverage.evaluation import MOST_IMAGES
from rastercov.core.coverage.task import Engine, Task, key_of, tasks_of
from rastercov.core.exact.surface import surface_of
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import boxes_of, corners_of, move_boxes
from rastercov.motion.motion import Motion

BESIDE_REL = 1e-9
"""Margin of boxes of bodies that are compared in an image, relative to the greatest diagonal."""
PARALLEL = 1e-12
"""Sine of the angle between two directions through which no plane is laid."""
FAR = 1e3
"""Distance of bodies, in near limits, from which on the near plane cuts nothing of them."""
POSES_A_TURN = 64
"""Poses whose keys are made at a time."""
MOST_OF_CONDITIONS = 1024
"""Images of conditions that are kept for later frames."""


@frozen_record(repr=False)
class MotionQuery(InOneLine):
    """Motion of a scene, and the share of its time in which a point must be covered.

    Parameters
    ----------
    motion : Motion
        Motion of T frames.
    over : {"some", "all"} or float
        A point must be covered in some frame; in all frames in which its body is present; or for
        that share of their time, (0, 1].
    views_at : {"one time", "any time"}
        Several cameras must cover a point at the same time; or each long enough, at any time.
    body : str, or sequence of str
        Body to which all cameras are fixed, or one per camera; their poses are those at rest.
        Cameras are fixed in the world unless given.

    Raises
    ------
    ConfigError
        For other values.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eye = rc.look_at((0.6, 0, 0), (0, 0, 0))
    >>> motion = rc.Motion(mesh, {"mesh": rc.turntable(4)})
    >>> queries = [rc.MotionQuery(motion, over) for over in ("some", "all")]
    >>> results = [rc.evaluate(mesh, camera, eye, motion=query) for query in queries]
    >>> [round(each.over_time.share(), 3) for each in results]  # four sides of six, and none
    [0.667, 0.0]
    """

    motion: Motion
    over: str | float = "some"
    views_at: str = "one time"
    body: str | Sequence[str] = "world"

    def __post_init__(self) -> None:
        self.motion._rows_for(self.over)
        check_choice("views_at", self.views_at, ("one time", "any time"))

    def long_enough(self, regions: Regions, views: int = 1) -> Regions:
        """Parts that at least `views` cameras cover for long enough; one row.

        Parameters
        ----------
        regions : Regions
            Result of `rastercov.regions` with the same motion.
        views : int
            Number of cameras that must cover a point, as `views_at` counts them.
        """
        if self.views_at == "one time":
            return for_long_enough(by_time(regions, self.motion, views), self)
        return self._alone(regions).at_least(views, one_side=False)

    def _check_motion(self, placed: Poses) -> None:
        """Raise `ConfigError` for regions of more images than are held at once."""
        if len(self.motion) * len(placed) > MOST_IMAGES:
            raise ConfigError(
                f"expected at most {MOST_IMAGES:,} images, got {len(self.motion):,} frames of "
                f"{len(placed):,} cameras; use fewer frames, or evaluate with a folder for shards"
            )

    def _alone(self, regions: Regions) -> Regions:
        """Parts that each camera covers long enough by itself; rows of a frame."""
        if not len(regions.pose_ids):
            return regions
        n = _rows_a_frame(regions, self.motion)
        rows = np.arange(len(regions.pose_ids)).reshape(-1, n)
        parts = [for_long_enough(take_rows(regions, own), self) for own in rows.T]
        return replace(join(parts), pose_ids=regions.pose_ids[:n])


def query_of(motion: object, mesh: Mesh) -> MotionQuery:
    """The query itself, of a motion, or of poses of bodies; ConfigError for another mesh."""
    if isinstance(motion, Mapping):
        motion = Motion(mesh, motion)
    asked = MotionQuery(motion) if isinstance(motion, Motion) else motion
    if not isinstance(asked, MotionQuery):
        raise ConfigError(
            f"expected motion to be a Motion or MotionQuery, got {shown(motion)}; correct it"
        )
    if asked.motion.mesh is not mesh:
        raise ConfigError("expected the mesh of the motion, at rest, got another; give motion.mesh")
    return asked


def regions_of_frames(
    asked: MotionQuery, camera: Cameras, placed: Poses, task: Task, engine: Engine
) -> Regions:
    """Regions of each of R rows of cameras in each of T frames, on the mesh at rest.

    Row t R + r is row r in frame t; `pose_ids` are those of each frame. Rows are those of an
    earlier frame where the task, the camera, and every body in front of the task or beside it in
    the image, are as they were there; so is what lights it from its place. Bodies that are
    absent have none.
    """
    asked._check_motion(placed)
    job = MovingFrames.of(asked, camera, placed, task, engine)
    return job.regions(np.arange(len(job.source)))


class MovingFrames(NamedTuple):
    """Scene, cameras and task of the regions of frames.

    Attributes
    ----------
    motion, camera, placed, task, engine
        As for `regions_of_frames`; equipment is that of the cameras.
    carried : (P, T, 4, 4) float64
        Of `carriers`.
    source : (T, P) int64
        Frame whose regions a pose has in each: the first, of `one_by_one`, of equal `ViewKeys`.
    relaxed : collection of str or None
        As of `RegionPass`.
    faces : (F,) bool, or None
        Those that are asked, all for None.
    """

    motion: Motion
    camera: Cameras
    placed: Poses
    task: Task
    engine: Engine
    carried: FloatArray
    source: IntArray
    relaxed: Collection[str] | None = None
    faces: BoolArray | None = None

    @classmethod
    def of(
        cls,
        asked: MotionQuery,
        camera: Cameras,
        placed: Poses,
        task: Task,
        engine: Engine,
        relaxed: Collection[str] | None = None,
        faces: BoolArray | None = None,
    ) -> "MovingFrames":
        """Frames of cameras on bodies."""
        motion = asked.motion
        carried, sights = carriers(asked, camera, placed), ViewKeys(motion, faces)
        tasks = tasks_of(camera, task)
        first: dict[bytes, int] = {}
        source = np.empty((len(motion), len(placed)), np.int64)
        for row in one_by_one(motion).tolist():
            mesh, _ = motion._at(row, of_occluders=False)
            moved = move_with_carrier(carried[:, row], placed)
            near = near_limits(cameras_of(camera), mesh.opaque.bounds, moved)
            surface = key_of(mesh, tasks)
            keys = sights.of(row, moved, near, axes_of(camera, moved))
            source[row] = [first.setdefault(key + surface, row) for key in keys]
        return cls(motion, camera, placed, task, engine, carried, source, relaxed, faces)

    def regions(self, rows: IntArray) -> Regions:
        """Regions of each pose in some frames, (K,), to the bit those of a run over all."""
        motion, camera, placed, source = self.motion, self.camera, self.placed, self.source
        has_rules = is_joint(camera)
        conditions, is_found = OfConditions(motion), np.zeros(source.shape, bool)
        is_found[source[rows], np.arange(len(placed))] = True
        is_used = np.asarray(is_found.any(axis=1))
        is_used[rows if has_rules else rows[:1]] = True
        known: dict[tuple[int, int], Regions] = {}
        none: list[Regions] = []  # a table of no poses, where there are none
        frames: dict[int, Regions] = {}

        def rows_of(row: int) -> list[Regions]:
            return [
                known[key] for key in zip(source[row].tolist(), range(len(placed)), strict=True)
            ]

        for of_bodies in _by_presence(motion):
            finder: RegionPass | None = None
            with ExitStack() as stack:
                for row in of_bodies[is_used[of_bodies]].tolist():
                    mesh, kept = motion._at(row, of_occluders=False)
                    if finder is None:
                        finder = RegionPass(
                            mesh, camera, self.task, method=self.engine, relaxed=self.relaxed
                        )
                        stack.callback(finder.close)
                    finder.set_mesh(mesh)
                    moved = move_with_carrier(self.carried[:, row], placed)
                    if is_found[row].any() or not none:
                        closed = None if self.faces is None else ~self.faces[kept]
                        own = finder.find(moved[is_found[row]], closed)._at_rest(motion.mesh, kept)
                        none = none or [take_rows(own, np.arange(0))]
                        new = enumerate(np.flatnonzero(is_found[row]).tolist())
                        known |= {(row, pose): take_rows(own, np.array([at])) for at, pose in new}
                    if has_rules and row in rows:
                        find = partial(conditions.find, row, kept)
                        there = tuple(each.find_by(find) for each in finder.conditions)
                        eyes = eyes_of(camera, moved)
                        own = _in_frame(join(none + rows_of(row)), mesh, kept, (moved, eyes))
                        union = with_rule(replace(own, conditions=there), camera, moved)
                        frames[row] = union._at_rest(motion.mesh, kept)
        if has_rules:
            return join([frames[row] for row in rows.tolist()])
        union = join(none + [each for row in rows.tolist() for each in rows_of(row)])
        return replace(union, pose_ids=np.tile(placed.ids, len(rows)))


def carriers(asked: MotionQuery, camera: Cameras, poses: Poses) -> FloatArray:
    """(P, T, 4, 4) poses of the body that each camera is fixed to; ConfigError for no body."""
    n, body = len(cameras_of(camera)), asked.body
    names = [body] * n if isinstance(body, str) else body
    if not isinstance(names, list | tuple) or len(names) != n:
        raise ConfigError(
            f"expected one body, or one for each of {n} cameras, got {shown(body)}; name them"
        )
    tables = np.stack([asked.motion.poses_of(name) for name in names])
    for each in FEATURES:
        each.check_bodies(camera, names)
    poses.check_cameras(n)
    return tables[poses.camera]


def move_with_carrier(carrier: FloatArray, poses: Poses) -> Poses:
    """Poses of cameras on bodies by the poses of these, (P, 4, 4)."""
    if (carrier == np.eye(4)).all():
        return poses
    matrices = carrier @ poses.world_from_camera
    return Poses(matrices, poses.ids, matrices, {}, poses.camera)


def one_by_one(motion: Motion) -> IntArray:
    """(T,) frames in the order in which their regions are found."""
    return np.concatenate(_by_presence(motion))


def _by_presence(motion: Motion) -> list[IntArray]:
    """Frames by the bodies that are there."""
    which = np.unique(motion.present, axis=0, return_inverse=True)[1].ravel()
    return [np.flatnonzero(which == index) for index in range(which.max() + 1)]


def _in_frame(
    regions: Regions, mesh: Mesh, kept: IntArray, seen_from: tuple[Poses, FloatArray]
) -> Regions:
    """The reverse of `Regions._at_rest`, by poses and their `eyes_of`."""
    place = np.zeros(regions.mesh.n_faces, np.int32)
    place[kept] = np.arange(len(kept))
    poses, eyes = seen_from
    return replace(
        regions,
        mesh=mesh,
        face=place[regions.face],
        pair_face=place[regions.pair_face],
        eyes=eyes,
        pose_ids=poses.ids,
    )


class ViewKeys:
    """Poses of all that a camera's regions depend on: those of equal keys have equal regions.

    These are the camera, bodies with evaluated faces, and bodies whose box no plane through the
    eye, or along parallel rays, separates from that of such a body; and the near plane, where a
    surface is not far beyond it.
    """

    def __init__(self, motion: Motion, faces: BoolArray | None = None) -> None:
        self._motion, scored = motion, motion.mesh.task_mask if faces is None else faces
        diagonal = motion._diagonal
        self._boxes = _grow_boxes(motion.boxes, BESIDE_REL * diagonal)
        hides = np.unique(motion.body[scored | ~motion.mesh.target_mask])
        self._boxes[np.isin(np.arange(len(motion.names)), hides, invert=True)] = np.nan
        used = motion.mesh.vertices[motion.mesh.faces[scored]]
        boxes = boxes_of(motion.body[scored], used, len(motion.names))
        self._task = _grow_boxes(corners_of(*boxes), BESIDE_REL * diagonal)
        self._has_task = ~np.isnan(self._task[:, 0, 0])

    def of(self, row: int, placed: Poses, near: FloatArray, axes: FloatArray) -> list[bytes]:
        """Key of each of P camera poses in a frame, by near limits (P,) and `axes_of`."""
        poses = placed.world_from_camera
        bodies, is_there = self._motion.world_from_body[row], self._motion.present[row]
        is_there = is_there & ~np.isnan(self._boxes[:, 0, 0])
        matters = np.repeat((is_there & self._has_task)[None], len(poses), axis=0)
        others = np.flatnonzero(is_there & ~self._has_task)
        boxes = move_boxes(self._boxes, bodies)
        scored = move_boxes(self._task, bodies)[is_there & self._has_task]
        for part in range(0, len(poses), POSES_A_TURN):
            some = slice(part, part + POSES_A_TURN)
            ways = partial(self._ways, poses[some, :3, 3], axes[some])
            for each in scored:
                matters[some, others] |= ~_are_separate(ways(each), ways(boxes[others]))
        local = (
            np.swapaxes(bodies[:, :3, :3], 1, 2)
            @ (poses[:, None, :3, 3] - bodies[:, :3, 3])[..., None]
        )
        low, high = self._boxes.min(axis=1), self._boxes.max(axis=1)
        away = np.maximum(low - local[..., 0], local[..., 0] - high).clip(0)
        is_far = ~(matters & ~(norm(away) > FAR * near[:, None])).any(axis=1)
        limits = np.where(is_far, 0.0, near)
        return [
            b"".join(each.tobytes() for each in (camera, pose, own, bodies[own], limit))
            for camera, pose, own, limit in zip(placed.camera, poses, matters, limits, strict=True)
        ]

    def _ways(self, eyes: FloatArray, axes: FloatArray, corners: FloatArray) -> FloatArray:
        """(P, N, 8, 3) ways from eyes to corners of boxes.

        Parallel rays meet a plane across them where the rays of an eye do: planes along them are
        those through that eye.
        """
        ways = corners - eyes[:, None, None]
        axes = axes[:, None, None]
        along = (ways * axes).sum(axis=-1, keepdims=True)
        moved: FloatArray = ways + (self._motion._diagonal - along) * axes
        return moved


class OfConditions:
    """Regions of poses of conditions in frames of a motion, at rest; equal sights are found once.

    To the bit: the size of the scene cuts only their border, and by its power of two.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion, self._sights = motion, ViewKeys(motion)
        self._known: dict[bytes, Regions] = {}

    def find(self, row: int, kept: IntArray, finder: Finder, poses: Poses) -> Regions:
        """Regions of poses that stay in their places, in a frame, which is the mesh of the finder.

        `kept` are the faces at rest of its faces.
        """
        near = near_limits(finder.cameras, finder.mesh.opaque.bounds, poses)
        gap = GAP_REL * surface_of(finder.mesh.opaque).diagonal
        size = math.frexp(gap)[1].to_bytes(2, signed=True)
        sights = self._sights.of(row, poses, near, axes_of(finder.cameras, poses))
        keys, known = [size + key for key in sights], self._known
        if new := {key: at for at, key in enumerate(keys) if key not in known}:
            result = finder.find(poses[np.array(list(new.values()))])
            result = result._at_rest(self._motion.mesh, kept)
            known |= {key: take_rows(result, np.array([at])) for at, key in enumerate(new)}
        own = {key: known.pop(key) for key in dict.fromkeys(keys)}
        known |= own  # last, and so kept longest
        for key in list(known)[: -(MOST_OF_CONDITIONS + len(own))]:
            del known[key]
        seen_from = poses, eyes_of(finder.cameras, poses)
        return _in_frame(join([own[key] for key in keys]), finder.mesh, kept, seen_from)


def _grow_boxes(boxes: FloatArray, margin: float) -> FloatArray:
    """Boxes (B, 8, 3) with a margin on each side."""
    return corners_of(boxes.min(axis=1) - margin, boxes.max(axis=1) + margin)


def _are_separate(one: FloatArray, others: FloatArray) -> BoolArray:
    """(P, N) whether a plane through the eye separates two sets of directions.

    `one`, (P, 1, 8, 3), and `others`, (P, N, 8, 3), are corners of boxes from each eye. If there is
    such a plane, there is one through a corner of each.
    """
    normal = np.cross(one[..., :, None, :], others[..., None, :, :])
    shape = normal.shape[:2]
    normal = normal.reshape(*shape, 64, 3)
    size = norm(normal)[..., None]
    scale = norm(one).max(axis=-1) * norm(others).max(axis=-1)
    is_plane = size[..., 0] > PARALLEL * scale[..., None]
    normal = np.swapaxes(normal / np.where(size > 0, size, 1.0), -1, -2)
    heights = [each @ normal / norm(each).max(axis=-1)[..., None, None] for each in (one, others)]
    above, below = ([h.min(axis=-2) for h in heights], [h.max(axis=-2) for h in heights])
    parts = (above[0] >= -PARALLEL) & (below[1] <= PARALLEL)
    parts |= (below[0] <= PARALLEL) & (above[1] >= -PARALLEL)
    return (parts & is_plane).any(axis=-1)


def by_time(regions: Regions, motion: Motion, views: int = 1) -> Regions:
    """Parts that at least `views` rows of a frame cover, (T,) rows; none of no cameras."""
    if not len(regions.pose_ids):
        nowhere = np.full((len(motion), 3), np.nan)
        frames = np.arange(len(motion))
        return replace(regions, pose_ids=frames, eyes=nowhere, columns=None, conditions=())
    frame = np.arange(len(regions.pose_ids)) // _rows_a_frame(regions, motion)
    if views == 1 and len(frame) == len(motion):
        return regions
    return regions.at_least(views, frame, one_side=False)


def in_units(frames: Regions, motion: Motion) -> Regions:
    """Rows of `by_time`, one for each unit of time."""
    return take_rows(frames, owners_of(motion.units))


def _rows_a_frame(regions: Regions, motion: Motion) -> int:
    n_rows = len(regions.pose_ids)
    if regions.mesh is not motion.mesh or n_rows % len(motion):
        raise ConfigError("expected regions of this motion, got those of another; give its own")
    return n_rows // len(motion)


def for_long_enough(frames: Regions, asked: MotionQuery) -> Regions:
    """Parts that rows of `by_time` cover long enough; one row."""
    motion = asked.motion
    needed, units = motion._rows_for(asked.over), in_units(frames, motion)
    parts = [
        units._of_faces(needed == k).at_least(k, one_side=False) for k in np.unique(needed).tolist()
    ]
    return any_of(parts, one_side=False)
