"""Constraints on the positions and directions of cameras that are moved continuously.

Serves `search` and `refine`; `mounting` and `clearance` apply the same constraints to a finite list
of candidates. A pose is a camera centre, a direction and a roll relative to `up`.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByteArray,
    ConfigError,
    FloatArray,
    arctan2,
    dots,
    draw_between,
    frozen_record,
    matmul,
    shown,
)
from rastercov.base.typed import check_fields
from rastercov.core.camera import look_at, valid_poses
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.placement.candidates.pool import check_stand_off, check_up, turns_about_z
from rastercov.placement.candidates.rooms import (
    KeepOut,
    NearestSurface,
    Place,
    check_clearance,
    nearest_obstacle,
    place_of,
)

POSITION_TOLERANCE_REL = 1e-9
"""Position tolerance relative to the mesh's diagonal, for cameras on the border of a box."""
TRIES = 4
"""Greatest number of projections of a position onto the allowed space."""


@frozen_record(kw_only=True)
class PoseSpace:
    """Allowed positions and directions of cameras, for `optimise` and `refine`.

    Attributes
    ----------
    mesh : Mesh
        The scene; all its faces are surfaces, as for `filter_candidates`.
    boxes : (2, 3) or (B, 2, 3) array_like, optional
        Lowest and highest corners of boxes in which camera centres must be, metres; a box may be
        flat, as a wall is. By default the bounding box of the evaluated faces, enlarged by the
        maximum stand-off on all sides.
    stand_off : (float, float)
        Minimum and maximum distance from a camera centre to the nearest evaluated face, metres.
    clearance : float
        Minimum distance from any surface, metres.
    keep_out : sequence of KeepOut
        Volumes without cameras.
    aim : (2, 3) array_like, optional
        Lowest and highest corner of a box of points that `optimise` aims cameras at, metres; that
        of the evaluated faces by default. It does not limit the rotations of `refine`.
    up : (float, float, float)
        Direction that is up in the image at zero roll.
    is_roll_free : bool
        True if cameras may be rolled. Otherwise each keeps its roll.

    Raises
    ------
    ConfigError
        For values outside their range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import PoseSpace
    >>> space = PoseSpace(mesh=rc.shapes.box(), stand_off=(1, 3), clearance=0.2)
    >>> space.allows([(0, 0, 0.6), (0, 0, 2), (0, 0, 9)]).tolist()
    [False, True, False]
    """

    mesh: Mesh
    boxes: ArrayLike | None = None
    stand_off: tuple[float, float] = (0.0, np.inf)
    clearance: float = 0.0
    keep_out: Sequence[KeepOut] = ()
    aim: ArrayLike | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    is_roll_free: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        check_stand_off(self.stand_off)
        check_clearance(self.clearance)
        check_up(self.up)
        if not self.mesh.task_mask.any():
            raise ConfigError("expected faces to evaluate, got occluders only; change a role")
        corners = self.mesh.vertices[np.unique(self.mesh.faces[self.mesh.task_mask])]
        task = np.stack((corners.min(axis=0), corners.max(axis=0)))
        boxes = self.boxes
        if boxes is None:
            if not np.isfinite(self.stand_off[1]):
                raise ConfigError("expected boxes or a greatest stand-off, got neither; give one")
            boxes = task + self.stand_off[1] * np.array([[-1.0], [1.0]])
        aim = _boxes("aim", task if self.aim is None else self.aim)
        object.__setattr__(self, "boxes", frozen(_boxes("boxes", boxes)))
        object.__setattr__(self, "aim", frozen(aim[0]))

    @cached_property
    def hull(self) -> FloatArray:
        """(2, 3) bounding box of all boxes."""
        boxes = np.asarray(self.boxes)
        return frozen(np.stack((boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0))))

    def judge(self, eyes: ArrayLike) -> ByteArray:
        """`Place` of each of (N, 3) camera centres."""
        points = np.asarray(eyes, np.float64).reshape(-1, 3)
        if not len(points):
            return np.zeros(0, np.uint8)
        surface = self._surface if self.clearance > 0 else None
        place = place_of(self.mesh, points, surface, self.clearance, self.keep_out)
        distance = self._task.query(points).distance
        place[(distance > self.stand_off[1]) & (place == Place.ALLOWED)] = Place.TOO_FAR
        place[(distance < self.stand_off[0]) & (place < Place.TOO_NEAR)] = Place.TOO_NEAR
        slack = POSITION_TOLERANCE_REL * self.mesh.diagonal
        missed = np.abs(points - self.nearest_in_boxes(points)).max(axis=1)
        place[~(missed <= slack)] = Place.OUTSIDE
        return place

    def allows(self, eyes: ArrayLike) -> BoolArray:
        """(N,) mask of the allowed positions among (N, 3)."""
        return self.judge(eyes) == Place.ALLOWED

    def require(self, poses: FloatArray, what: str) -> None:
        """Raise ConfigError for forbidden positions of (N, 4, 4) poses, naming the first.

        `what` is the noun for a pose, such as "camera".
        """
        place = self.judge(poses[:, :3, 3])
        bad = np.flatnonzero(place != Place.ALLOWED)
        if len(bad):
            why = Place(place[bad[0]]).name.lower().replace("_", " ")
            others = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
            raise ConfigError(
                f"expected {what} {bad[0]} in an allowed place, got one {why}{others}; move it"
            )

    def distance(self, eyes: FloatArray) -> FloatArray:
        """(N,) distance of (N, 3) camera centres from the nearest evaluated face, metres."""
        return self._task.query(eyes).distance

    def nearest_in_boxes(self, eyes: FloatArray) -> FloatArray:
        """(N, 3) nearest point in any of the boxes to each of (N, 3) points."""
        best = np.array(eyes, np.float64)
        least = np.full(len(best), np.inf)
        for low, high in np.asarray(self.boxes):
            within = np.clip(eyes, low, high)
            distance = ((within - eyes) ** 2).sum(axis=1)
            nearer = distance < least
            best[nearer], least[nearer] = within[nearer], distance[nearer]
        return best

    def project_to_allowed(self, eyes: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Allowed positions near given ones, (N, 3), and the mask, (N,), of those that were found.

        Alternating projections: out of solids and into the stand-off along the line to the nearest
        surface, then into the boxes. Allowed positions are not moved. Positions in keep-out volumes
        are not moved out of them.
        """
        points = self.nearest_in_boxes(np.asarray(eyes, np.float64).reshape(-1, 3))
        place = self.judge(points)
        for _ in range(TRIES):
            bad = np.flatnonzero(place != Place.ALLOWED)
            if not len(bad):
                break
            points[bad] = self.nearest_in_boxes(self._push(points[bad], place[bad]))
            place[bad] = self.judge(points[bad])
        return points, place == Place.ALLOWED

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count, 3) random allowed positions.

        Raises
        ------
        ConfigError
            If almost none of the positions tried is allowed.
        """
        values: list[FloatArray] = []
        low, high = self.hull
        for _ in range(64):
            points, allowed = self.project_to_allowed(
                draw_between(low, high, (max(count, 64), 3), rng)
            )
            values.append(points[allowed])
            if sum(map(len, values)) >= count:
                return np.concatenate(values)[:count]
        raise ConfigError(
            f"expected places for {count} cameras within boxes, stand-off and clearance, outside "
            "keep-outs, got fewer; allow more"
        )

    def composed(self, eyes: FloatArray, forwards: FloatArray, rolls: FloatArray) -> FloatArray:
        """(N, 4, 4) poses from centres, directions, (N, 3), and rolls from `up`, radians."""
        poses = look_at(np.zeros(3), forwards, self.up)
        poses[:, :3, :3] = matmul(poses[:, :3, :3], turns_about_z(rolls))
        poses[:, :3, 3] = eyes
        return poses

    def decomposed(self, poses: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Centres (N, 3), directions (N, 3) and rolls (N,) of poses: the inverse of `composed`."""
        matrices = valid_poses(poses)
        level = look_at(np.zeros(3), matrices[:, :3, 2], self.up)[:, :3, :3]
        across = dots(level.swapaxes(1, 2), matrices[:, None, :3, 0])
        return (
            matrices[:, :3, 3].copy(),
            matrices[:, :3, 2].copy(),
            arctan2(across[:, 1], across[:, 0]),
        )

    @cached_property
    def _task(self) -> NearestSurface:
        return NearestSurface(self.mesh, self.mesh.task_mask)

    @cached_property
    def _surface(self) -> NearestSurface | None:
        return nearest_obstacle(self.mesh)

    def _push(self, points: FloatArray, place: ByteArray) -> FloatArray:
        """Points moved along the line to the nearest evaluated face, or to the nearest surface."""
        least, greatest = self.stand_off
        near = self._task.query(points)
        wanted = np.clip(near.distance, min(max(least, self.clearance), greatest), greatest)
        point, distance = near.point, near.distance
        crowded = (place == Place.TOO_NEAR) & (distance >= least)
        crowded |= place == Place.IN_SOLID
        if crowded.any() and self._surface is not None:
            other = self._surface.query(points)
            point = np.where(crowded[:, None], other.point, point)
            distance = np.where(crowded, other.distance, distance)
            wanted = np.where(crowded, max(self.clearance, least), wanted)
        outward = points - point
        outward[place == Place.IN_SOLID] *= -1
        # A margin above rounding, so that the constraint holds afterwards.
        wanted = wanted + np.sign(wanted - distance) * POSITION_TOLERANCE_REL * np.maximum(
            1.0, wanted
        )
        scale = np.where(distance > 0, wanted / np.where(distance > 0, distance, 1.0), 0.0)
        moved: FloatArray = point + outward * scale[:, None]
        return np.where((distance > 0)[:, None], moved, points)


def _boxes(name: str, value: ArrayLike) -> FloatArray:
    boxes = np.array(value, np.float64)
    boxes = boxes[None] if boxes.ndim == 2 else boxes
    if boxes.ndim != 3 or boxes.shape[1:] != (2, 3) or not len(boxes):
        raise ConfigError(f"expected {name} (2, 3), got shape {np.shape(value)}; give two corners")
    if not np.isfinite(boxes).all() or not (boxes[:, 0] <= boxes[:, 1]).all():
        raise ConfigError(f"expected low <= high in {name}, got {shown(value)}; swap them")
    return boxes
