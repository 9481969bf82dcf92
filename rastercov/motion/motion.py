"""Rigid bodies of a mesh and their poses, frame by frame: turntables, conveyors, tables of poses.

A body is a group, or all groups of a file; what no body names is the world, which never moves. A
vertex belongs to one body: shared ones are doubled. In a frame a body may be absent: it hides
nothing, and is not evaluated.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    AnyArray,
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    MeshError,
    Once,
    check_array,
    finite_number,
    finite_points,
    frozen_record,
    is_one_of,
    shown,
)
from rastercov.base.format import base64_of
from rastercov.core.mesh.arrays import check_poses, frozen, rotation_about, unit
from rastercov.core.mesh.bodies import Rest, diagonal_of
from rastercov.core.mesh.columns import MOST_FRAMES
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import Mesh, names_of

MOST_UNITS = 10_000
"""Units of time of all frames together."""
MOST_RESTS = 8
"""Sets of bodies that are there together whose data at rest are kept."""
ROUNDING = 1e-9
"""Difference of a duration from a multiple of the unit, relative to it, that is rounding."""


@frozen_record(init=False, repr=False)
class Motion(InOneLine):
    """Poses of bodies of a mesh over T frames.

    Parameters
    ----------
    mesh : Mesh
        In its rest pose.
    bodies : mapping of str to (T, 4, 4) or (4, 4) array_like
        world_from_body of each body, by the name of a group or file: rigid transforms from the rest
        pose, such as `turntable` and `conveyor` return. A body with one pose has it in all frames.
    present : mapping of str to (T,) bool array_like, optional
        Frames in which a body is present; all unless given.
    durations : (T,) float array_like, optional
        Duration or weight of each frame, above 0: whole multiples of one unit, at most 10,000 units
        in all. 1 each unless given.
    groups : mapping of str to iterable of str, optional
        Names of the groups or files of each body whose own name is not that of a group or file.

    Attributes
    ----------
    names : tuple of str
        Names of the B bodies; "world", which never moves, is the first.
    body : (F,) int64
        Row in `names` of the body of each face.
    world_from_body : (T, B, 4, 4) float64
        Pose of each body in each frame.
    present : (T, B) bool
        Frames in which each body is present.
    durations : (T,) float64
        Duration of each frame.

    Raises
    ------
    MeshError
        For an unknown name, and for a group that belongs to two bodies.
    ConfigError
        For poses that are not rigid transforms, or differ in their number of frames.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> motion = rc.Motion(mesh, {"mesh": rc.turntable(4)})
    >>> moved, _ = motion.frame(1)  # a quarter of the rotation
    >>> moved.n_faces, len(motion.poses_of("mesh"))
    (12, 4)
    """

    mesh: Mesh
    names: tuple[str, ...]
    body: IntArray
    world_from_body: FloatArray
    present: BoolArray
    durations: FloatArray
    _rests: dict[bytes, Once[Rest]]

    def __init__(
        self,
        mesh: Mesh,
        bodies: Mapping[str, ArrayLike],
        present: Mapping[str, ArrayLike] | None = None,
        durations: ArrayLike | None = None,
        groups: Mapping[str, Iterable[str]] | None = None,
    ) -> None:
        if not isinstance(bodies, Mapping) or not bodies:
            raise ConfigError(
                f"expected bodies to be poses by names of groups, got {shown(bodies)}"
            )
        of_group = np.zeros(len(mesh.groups), np.int64)
        tables = [check_poses(f"poses of {shown(name)}", given) for name, given in bodies.items()]
        n = max(len(table) for table in tables)
        for row, (name, table) in enumerate(zip(bodies, tables, strict=True), start=1):
            own = (
                names_of_groups("bodies", (groups or {}).get(name, [name]), names_of(mesh)) or set()
            )
            members = np.array([group.name in own for group in mesh.groups])
            if (taken := of_group[members]).any():
                other = list(bodies)[taken.max() - 1]
                raise MeshError(
                    f"expected groups of one body each, got some of {shown(name)} and "
                    f"{shown(other)}; name one"
                )
            of_group[members] = row
            if len(table) not in (1, n):
                raise ConfigError(
                    f"expected bodies to have one pose, or as many as the others, {n}, got "
                    f"{len(table)} for {shown(name)}"
                )
        if not n <= MOST_FRAMES:
            raise ConfigError(
                f"expected at most {MOST_FRAMES:,} frames of a motion, got {n:,}; use fewer"
            )
        still = np.broadcast_to(np.eye(4), (n, 4, 4))
        poses = np.stack([still, *(np.broadcast_to(each, (n, 4, 4)) for each in tables)], axis=1)
        is_there = np.ones((n, len(tables) + 1), bool)
        weights = np.ones(n) if durations is None else _durations(durations, n)
        for name, given in (present or {}).items():
            if name not in bodies:
                raise ConfigError(
                    f"expected present to name bodies, {', '.join(bodies)}, got {shown(name)}"
                )
            mask = check_array("present", given, "b", f"({n},) True or False", ConfigError)
            if mask.shape != (n,) or mask.dtype != np.bool_:
                raise ConfigError(
                    f"expected present to be ({n},) True or False, got shape {mask.shape}"
                )
            is_there[:, 1 + list(bodies).index(name)] = mask
        values: ByName = {
            "mesh": mesh,
            "names": ("world", *bodies),
            "body": of_group[mesh.face_group],
            "world_from_body": poses,
            "present": is_there,
            "durations": weights,
            "_rests": {},
        }
        for name, value in values.items():
            self.__dict__[name] = frozen(value) if hasattr(value, "flags") else value

    def __len__(self) -> int:
        return len(self.world_from_body)

    def _of_frames(self, rows: BoolArray) -> "Motion":
        """Some of the frames, (T,) bool, of the same bodies."""
        tables = (self.world_from_body[rows], self.present[rows], self.durations[rows])
        return Motion._make(self.mesh, self.names, self.body, *tables)

    @classmethod
    def _make(cls, mesh: Mesh, names: Sequence[str], *tables: AnyArray) -> "Motion":
        """Motion of arrays of another one: the attributes `body` to `durations`."""
        other = object.__new__(cls)
        columns = zip(("body", "world_from_body", "present", "durations"), tables, strict=True)
        own = {name: frozen(table) for name, table in columns}
        other.__dict__.update(own, mesh=mesh, names=tuple(names), _rests={})
        return other

    @cached_property
    def units(self) -> IntArray:
        """(T,) durations as multiples of their greatest common unit."""
        return frozen(_units(self.durations))

    def _rows_for(self, over: str | float) -> IntArray:
        """(F,) units of time in which a point is covered, of those in which its body is there.

        `over` is "some", "all", or a share of these, (0, 1]; ConfigError for another.
        """
        share = (
            {"some": 0.0, "all": 1.0}.get(over) if isinstance(over, str) else finite_number(over)
        )
        if share is None or not (0 < share <= 1 or is_one_of(over, ("some",))):
            raise ConfigError(
                f"expected over to be 'some', 'all' or a share in (0, 1], got {shown(over)}"
            )
        there = self.units @ self.present
        least: IntArray = np.maximum(1, np.ceil(share * there - 1e-9)).astype(np.int64)
        return least[self.body]

    def __getstate__(self) -> ByName:  # locks of what is kept stay here
        return vars(self) | {"_rests": {}}

    def poses_of(self, body: str) -> FloatArray:
        """(T, 4, 4) world_from_body of a body by its name; ConfigError for another name."""
        if not is_one_of(body, self.names):
            raise ConfigError(f"expected a body ({', '.join(self.names)}), got {shown(body)}")
        return self.world_from_body[:, self.names.index(body)]

    def frame(self, row: int) -> tuple[Mesh, IntArray]:
        """The mesh as it is in a frame, and the index at rest, (F',), of each of its faces.

        Faces of absent bodies are left out. ConfigError for a row beyond the frames.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2), centre=(1, 0, 0))
        >>> motion = rc.Motion(mesh, {"mesh": rc.turntable(4)})
        >>> moved, _ = motion.frame(1)
        >>> moved.bounds.mean(axis=0).round(6).tolist()  # a quarter of the rotation
        [0.0, 1.0, 0.0]
        """
        number = finite_number(row)
        if not number.is_integer() or not 0 <= number < len(self):
            raise ConfigError(
                f"expected row to be a whole number below {len(self)}, got {shown(row)}"
            )
        return self._at(int(number), of_occluders=True)

    def _at(self, row: int, *, of_occluders: bool) -> tuple[Mesh, IntArray]:
        """See `frame` and `Rest.at`."""
        if self._is_still:
            return self.mesh, np.arange(self.mesh.n_faces)
        poses, is_there = self.world_from_body[row], self.present[row]
        return self._place(poses, is_there, of_occluders=of_occluders)

    def _place(
        self, poses: FloatArray, is_there: BoolArray, *, of_occluders: bool = True
    ) -> tuple[Mesh, IntArray]:
        """See `frame`, by poses (B, 4, 4) of bodies, of which (B,) are there."""
        if not is_there[self.body].any():
            raise ConfigError("expected a body in each frame, got none; add one that stays")
        rest = self._rest_of(is_there)
        return rest.at(poses, self._diagonal, of_occluders=of_occluders), rest.kept

    def _rest_of(self, is_there: BoolArray) -> Rest:
        """Bodies that are there, (B,) bool, at rest."""
        key = is_there.tobytes()
        once: Once[Rest] = self._rests.setdefault(key, Once())
        for other in list(self._rests)[: -1 - MOST_RESTS]:
            self._rests.pop(other, None)
        return once.get(lambda: Rest.of(self.mesh, self.body, is_there))

    @cached_property
    def _is_still(self) -> bool:
        """True where no body ever moves or leaves: each frame is the mesh itself."""
        return bool(self.present.all() and (self.world_from_body == np.eye(4)).all())

    @cached_property
    def boxes(self) -> FloatArray:
        """(B, 8, 3) corners of the box of each body at rest; NaN for one without faces."""
        return frozen(self._rest_of(np.ones(len(self.names), bool)).boxes)

    @cached_property
    def _diagonal(self) -> float:
        """Greatest diagonal of the boxes of all bodies in a frame, metres."""
        return max(diagonal_of(self.boxes, poses) for poses in self.world_from_body)


def _durations(given: ArrayLike, n: int) -> FloatArray:
    wanted = f"({n},) numbers above 0, {LARGEST_COORDINATE:g} at most"
    with np.errstate(over="ignore"):
        values = check_array("durations", given, "iuf", wanted, ConfigError).astype(np.float64)
    if values.shape != (n,) or not ((values > 0) & (values <= LARGEST_COORDINATE)).all():
        raise ConfigError(f"expected durations to be {wanted}, got {shown(given)}")
    _units(values)
    return values.copy()


def _units(durations: FloatArray) -> IntArray:
    """(T,) durations in the greatest unit that all are multiples of, within `ROUNDING`.

    Shares of the shortest have denominators up to `MOST_UNITS`, and are 1e-8 of it apart.
    """
    with np.errstate(over="ignore"):
        shares = np.minimum(durations / durations.min(), 2.0 * MOST_UNITS)
    exact = [Fraction(each).limit_denominator(MOST_UNITS) for each in shares.tolist()]
    scale = math.lcm(*(each.denominator for each in exact))
    whole = [int(each * scale) for each in exact]
    if sum(whole) > MOST_UNITS or not np.allclose(np.array(exact, float), shares, ROUNDING, 0):
        raise ConfigError(
            f"expected durations in whole multiples of one unit within {ROUNDING:g}, "
            f"{MOST_UNITS:,} in all, got {shown(durations.tolist())}; round them"
        )
    return np.array(whole, np.int64)


def turntable(
    steps: int,
    *,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    centre: ArrayLike = (0.0, 0.0, 0.0),
    degrees: float = 360.0,
) -> FloatArray:
    """(steps, 4, 4) poses of a body rotated in equal steps about an axis through a point.

    Parameters
    ----------
    steps : int
        Number of poses; the first is the rest pose.
    axis, centre : (3,) float array_like
        Direction of the axis, about which angles are right-handed, and a point on it, metres.
    degrees : float
        Total angle; each step rotates by degrees / steps.

    Raises
    ------
    ConfigError
        For a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> poses = rc.turntable(4, axis=(0, 0, 1))
    >>> ((poses @ (1, 0, 0, 1))[:, :2].round(6) + 0).tolist()  # where the point (1, 0, 0) goes
    [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]
    """
    direction = finite_points("axis", axis, (3,), "a direction", ConfigError)
    point = finite_points("centre", centre, (3,), "three finite numbers", ConfigError)
    if not direction.any():
        raise ConfigError(f"expected axis to be a direction, got {direction.tolist()}")
    poses = _still(steps)
    for row, angle in enumerate(_steps(degrees, len(poses), is_closed=True)):
        poses[row, :3, :3] = rotation_about(direction, math.radians(angle)) if row else np.eye(3)
        poses[row, :3, 3] = point - poses[row, :3, :3] @ point
    return poses


def conveyor(steps: int, *, direction: ArrayLike, distance: float) -> FloatArray:
    """(steps, 4, 4) poses of a body that moves a distance, metres, in equal steps.

    The first is the rest pose, the last at the full distance. `direction` is (3,), of any length.
    ConfigError for a value outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> poses = rc.conveyor(5, direction=(1, 0, 0), distance=0.4)
    >>> poses[:, 0, 3].round(6).tolist()  # metres along x
    [0.0, 0.1, 0.2, 0.3, 0.4]
    """
    along = finite_points("direction", direction, (3,), "a direction", ConfigError)
    if not along.any():
        raise ConfigError(f"expected direction not to be zero, got {along.tolist()}")
    poses = _still(steps)
    away = _steps(distance, len(poses), is_closed=False)
    poses[:, :3, 3] = away[:, None] * unit(along)
    return poses


def check_steps(steps: int) -> int:
    """Number of frames; ConfigError for what is none."""
    number = finite_number(steps)
    if not number.is_integer() or not 1 <= number <= MOST_FRAMES:
        raise ConfigError(
            f"expected steps to be a whole number from 1 to {MOST_FRAMES:,}, got {shown(steps)}"
        )
    return int(number)


def _still(steps: int) -> FloatArray:
    return np.tile(np.eye(4), (check_steps(steps), 1, 1))


def _steps(total: float, n: int, *, is_closed: bool) -> FloatArray:
    """(n,) equal steps to a total, the last of which a closed motion leaves out."""
    whole = finite_number(total)
    if not math.isfinite(whole):
        raise ConfigError(f"expected a finite length or angle of the motion, got {shown(total)}")
    return np.linspace(0.0, whole, n, endpoint=not is_closed)


def describe_motion(motion: Motion) -> ByName:
    """Poses of the bodies of a mesh in each frame, ready for JSON; see `time.js`."""
    groups, first = np.unique(motion.mesh.face_group, return_index=True)
    bodies = np.zeros(len(motion.mesh.groups), np.int64)
    bodies[groups] = motion.body[first]
    matrices = np.ascontiguousarray(motion.world_from_body[:, :, :3])
    return {
        "durations": motion.durations.tolist(),
        "bodies": bodies.tolist(),
        "poses": base64_of(matrices.tobytes()),
        "present": base64_of(motion.present.astype(np.uint8).tobytes()),
    }
