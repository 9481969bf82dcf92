"""Camera poses: world_from_camera matrices, checked once.

p_world = world_from_camera @ p_camera. Camera axes are OpenCV's: +x right, +y down, +z forward. The
thesis' frame (6.8-6.11), X left and Y up, is ours turned by 180 degrees about Z.

Near plane: its depth, what it cuts away, and when back faces may be culled.

Surfaces nearer than `near_limit` are cut away by every method. Targets hide nothing, so they change
none of this: all is decided by the other faces, `Mesh.opaque`. Where nothing in view is cut and the
camera is outside a closed mesh, faces seen from behind cannot be the nearest surface. The engine
decides, see `engine/solver/limits.hpp`, of cameras as it takes them: pinholes, parallel rays, and
lenses with ideal planes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from rastercov.base import (
    LARGEST_COORDINATE,
    AnyArray,
    BoolArray,
    FloatArray,
    InOneLine,
    Int32Array,
    IntArray,
    PoseError,
    check_array,
    flag,
    frozen_record,
    plural,
    read_only,
)
from rastercov.base.arguments import own_array
from rastercov.base.typed import check_fields
from rastercov.core.camera.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import nearest_rotations
from rastercov.engine import camera_pose, solver_visibility

DRIFT_TOLERANCE, ROUNDING = 1e-6, 1e-14
"""A rotation further than the first from orthonormal is refused; nearer, and further than the
second, it is made orthonormal."""
LIMITS = LARGEST_COORDINATE, DRIFT_TOLERANCE, ROUNDING
OF_LAST_ROW = "does not end in the row 0 0 0 1"
FAULTS = (
    *(
        "",
        "is not finite",
        f"is beyond ±{LARGEST_COORDINATE:g} m",
        OF_LAST_ROW,
    ),
    *("is not a rotation (scaled, sheared or drifted)", "is a reflection, not a rotation"),
)
DRIFTED = camera_pose.DRIFTED
"""Index of a pose that has drifted; those below are of `FAULTS`."""


def check_poses(poses: ArrayLike) -> tuple[FloatArray, dict[int, str]]:
    """Poses with their small rotation drift removed, and what is wrong with the others.

    Of (P, 4, 4) or (4, 4) world_from_camera: a copy, in which rows at fault are left as they came,
    and the fault of each of these by its row. PoseError for an array of the wrong shape or type.
    """
    array = real_numbers("poses", poses, "(P, 4, 4) (rc.read_poses reads a file)")
    out = as_matrices(array[None] if array.ndim == 2 else array)
    values = np.empty(len(out), np.uint8)
    camera_pose.find_faults(out, LIMITS, values)
    if not values.any():
        return out, {}
    faults = {row: FAULTS[at] for row, at in enumerate(values.tolist()) if 0 < at < DRIFTED}
    for row, text in faults.items():
        if text == OF_LAST_ROW and np.array_equal(out[row, :, 3], (0, 0, 0, 1)):
            faults[row] = f"{text}, but its transpose does"
    drifted = np.flatnonzero(values == DRIFTED)
    if len(drifted):
        out[drifted, :3, :3] = nearest_rotations(out[drifted, :3, :3])
    return out, faults


def error_of(rows: tuple[int, ...], text: str) -> PoseError:
    """Error of some poses: the first by its number, before the text, and how many others."""
    others = f" (and {plural(len(rows) - 1, 'more pose')})" if len(rows) > 1 else ""
    return PoseError(f"pose {rows[0]} (from 0){text}{others}", rows)


def valid_poses(poses: "ArrayLike | Poses") -> FloatArray:
    """Poses as `check_poses` returns them; any fault is a `PoseError` that names its rows."""
    return Poses.of(poses).world_from_camera


def renumber(poses: "ArrayLike | Poses") -> "Poses":
    """Valid poses that are numbered from 0, each with its camera; faults as for `valid_poses`."""
    placed = Poses.of(poses)
    n, matrices = len(placed), placed.world_from_camera
    return Poses(matrices, np.arange(n), matrices, {}, placed.camera)


@frozen_record(repr=False)
class Poses(InOneLine):
    """Validated camera poses; functions that take poses do not check them again. See `Poses.of`.

    Attributes
    ----------
    world_from_camera : (P, 4, 4) float64
        Rigid transforms.
    ids : (P,) int64
        Row of each pose in the input.
    given : (N, 4, 4) float64
        All rows of the input, including rejected ones.
    rejected : dict of int to str
        Rows that were skipped, and the reason for each.
    camera : (P,) int32
        Index of the camera of each pose, where there are several; 0 unless given.

    Examples
    --------
    >>> import rastercov as rc
    >>> eyes = [(0.6, 0, 0), (0, 0.6, 0)]
    >>> poses = rc.Poses.of(rc.look_at(eyes, (0, 0, 0)), camera=[0, 1])
    >>> len(poses), poses.eyes.tolist(), poses.camera.tolist()
    (2, [[0.6, 0.0, 0.0], [0.0, 0.6, 0.0]], [0, 1])
    """

    world_from_camera: FloatArray
    ids: IntArray
    given: FloatArray
    rejected: Mapping[int, str] = field(default_factory=dict)
    camera: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))

    def __post_init__(self) -> None:
        arrays = (self.world_from_camera, self.ids, self.given, self.camera)
        if not all(isinstance(each, np.ndarray) and each.ndim for each in arrays):
            check_fields(self)  # takes ten times as long as all else, and each batch makes some
        if len(self.camera) != len(self.ids):
            object.__setattr__(self, "camera", np.zeros(len(self.ids), np.int32))

    @classmethod
    def of(
        cls,
        poses: "ArrayLike | Poses",
        *,
        camera: ArrayLike | None = None,
        skip_bad: bool = False,
    ) -> "Poses":
        """Checked poses; `Poses` are not checked again.

        Parameters
        ----------
        poses : (P, 4, 4) or (4, 4) array_like, or Poses
            world_from_camera.
        camera : int or (P,) int array_like, optional
            Index of the camera of each pose, or of all of them; 0, or that of the `Poses`, unless
            given.
        skip_bad : bool
            Leave out poses that are not rigid transforms instead of raising.

        Raises
        ------
        PoseError
            For a pose that is not a rigid transform, with its rows, and for invalid camera indices.

        Examples
        --------
        >>> import numpy as np
        >>> import rastercov as rc
        >>> rows = [np.eye(4), np.diag((2, 2, 2, 1))]
        >>> poses = rc.Poses.of(rows, skip_bad=True)
        >>> poses.ids.tolist(), list(poses.rejected)
        ([0], [1])
        """
        skip_bad = flag("skip_bad_poses", skip_bad)
        if isinstance(poses, Poses):
            if camera is not None:
                indices = _camera_indices(camera, len(poses))
                return Poses(poses.world_from_camera, poses.ids, poses.given, {}, indices)
            return poses
        matrices, faults = check_poses(poses)
        if faults and not skip_bad:
            raise error_of(
                tuple(sorted(faults)),
                f": expected a rigid transform, got one that {faults[min(faults)]}; correct or "
                "skip it (skip_bad_poses)",
            )
        ids = np.arange(len(matrices))
        indices = np.zeros(len(ids), np.int32)
        if camera is not None:
            indices = _camera_indices(camera, len(ids))
        if not faults:
            return cls(matrices, ids, matrices, {}, indices)
        ids = np.delete(ids, list(faults))
        return cls(matrices[ids], ids, matrices, faults, indices[ids])

    @property
    def eyes(self) -> FloatArray:
        """(P, 3) camera centres, metres."""
        return self.world_from_camera[:, :3, 3]

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, rows: "slice | AnyArray") -> "Poses":
        """Some of the poses, by their rows among the accepted ones."""
        matrices, ids, camera = self.world_from_camera[rows], self.ids[rows], self.camera[rows]
        return Poses(matrices, ids, self.given, {}, camera)

    def by_camera(self) -> "Iterator[tuple[int, slice | IntArray]]":
        """Index of each camera in use, and the rows of its poses; a slice if it has all poses."""
        used = np.unique(self.camera)
        if len(used) == 1:
            yield int(used[0]), slice(None)
            return
        for index in used:
            yield int(index), np.flatnonzero(self.camera == index)

    def check_cameras(self, n_cameras: int) -> set[int]:
        """Indices of the cameras of the poses; `PoseError` for one beyond these."""
        used: set[int] = set(self.camera.tolist())
        if used and max(used) >= n_cameras:
            row = int(self.camera.argmax())
            raise PoseError(
                f"expected camera indices below {n_cameras}, got {self.camera[row]} for pose "
                f"{self.ids[row]}; give all cameras, or correct the index"
            )
        return used

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> FloatArray:
        if copy is None:  # an argument since numpy 2.0
            return np.asarray(self.world_from_camera, dtype)
        return np.array(self.world_from_camera, dtype, copy=copy)


def _camera_indices(camera: ArrayLike, n_poses: int) -> Int32Array:
    """(P,) indices of cameras; one number serves all poses."""
    indices = check_array(
        "camera", camera, "iu", f"{n_poses} indices, one for each pose", PoseError
    )
    if indices.ndim == 0:
        indices = np.broadcast_to(indices, n_poses)
    if indices.shape != (n_poses,):
        raise PoseError(
            f"expected camera to have one index for each of {n_poses} poses, got shape "
            f"{indices.shape}"
        )
    if n_poses and not 0 <= int(indices.min()) <= int(indices.max()) < 2**31:
        raise PoseError(f"expected camera indices of 0 or more, got {int(indices.min())}")
    return indices.astype(np.int32)


def as_matrices(poses: AnyArray) -> FloatArray:
    """Float64 copy if it is (P, 4, 4), also of no poses at all, else PoseError."""
    if poses.shape == (0,):
        return np.zeros((0, 4, 4))
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise PoseError(f"expected poses of shape (P, 4, 4), got {poses.shape}")
    return own_array("poses", poses, np.float64)


def real_numbers(name: str, values: ArrayLike, shape: str) -> AnyArray:
    """Array of real numbers of any shape, not copied; PoseError names the wanted one."""
    return check_array(name, values, "iuf", f"numbers of shape {shape}", PoseError)


NEAR_TO_FAR = camera_pose.NEAR_TO_FAR
"""Least depth that is seen, relative to the farthest depth, whatever `Camera.near` is."""


@lru_cache(maxsize=8)
def engine_camera(camera: Camera) -> solver_visibility.Camera:
    """Camera for the solvers of the engine; that of a lens takes seconds the first time."""
    kind = float(camera.near), camera.is_parallel
    own = solver_visibility.Camera(pinhole_numbers(camera), *kind)
    if camera.is_curved:
        from rastercov.core.camera.lenses.of_camera import ideal_camera, planes_of

        for each in planes_of(camera):
            own.add_plane(each.record, pinhole_numbers(ideal_camera(camera, each)))
    return own


def pinhole_numbers(camera: Camera) -> tuple[float, float, float, float, float, float]:
    """Focal lengths, principal point and size of an image, px; of parallel rays px/m first."""
    focal, centre = (float(camera.fx), float(camera.fy)), (float(camera.cx), float(camera.cy))
    return *focal, *centre, float(camera.width), float(camera.height)


def limits(
    mesh: Mesh, camera: Camera, poses: FloatArray, *, asks_cut: bool = True
) -> tuple[FloatArray, BoolArray, BoolArray]:
    """Near plane, whether back faces can be left out, and whether a surface is cut; (P,) each.

    Back faces can be where this cannot change the nearest surface: the mesh is closed and outward,
    and the camera is outside it with nothing cut open; and no two of its surfaces are so close
    together that they count as one from where the camera is. Unless `asks_cut`, which takes longer,
    the last is not known of all cameras inside the bounding box.
    """
    mesh, clipped = mesh.opaque, np.empty(len(poses), bool)
    near, away = np.empty((2, len(poses)))
    solver_visibility.find_limits(
        (read_only(mesh.vertices, np.float64), read_only(mesh.faces, np.int64)),
        np.ascontiguousarray(mesh.bounds),
        engine_camera(camera),
        np.ascontiguousarray(poses),
        asks_cut,
        near,
        away,
        clipped,
    )
    cull = (away > 0) & mesh.can_cull_back_faces
    for row in np.flatnonzero(cull & (away > mesh.contacts.reach)):
        cull[row] = hides_its_back(mesh, away[row])
    return near, cull, clipped


def near_limits(cameras: Sequence[Camera], bounds: FloatArray, poses: Poses) -> FloatArray:
    """`near_limit` of poses that may have different cameras."""
    of_cameras = np.array([camera.near for camera in cameras], np.float64)[poses.camera]
    return _near_limits(of_cameras, bounds, poses.world_from_camera)


def near_limit(camera: Camera, bounds: FloatArray, poses: FloatArray) -> FloatArray:
    """Depth of the near plane of each pose, (P,), metres: surfaces nearer than it are cut away.

    It is max(camera.near, 1e-6 times the distance to the farthest corner of `bounds`), which are
    those of the opaque part of a mesh.
    """
    return _near_limits(np.full(len(poses), float(camera.near)), bounds, poses)


def _near_limits(of_cameras: FloatArray, bounds: FloatArray, poses: FloatArray) -> FloatArray:
    """`near_limit` of poses with the `near` of the camera of each."""
    near_limits, matrices = np.empty(len(poses)), np.ascontiguousarray(poses)
    camera_pose.find_near_limits(matrices, np.ascontiguousarray(bounds), of_cameras, near_limits)
    return near_limits


def hides_its_back(mesh: Mesh, distance: float) -> bool:
    """True if no camera outside, with no surface beyond a distance, sees a back; see `limits`."""
    mesh = mesh.opaque
    if not mesh.can_cull_back_faces:
        return False
    is_near = distance <= mesh.contacts.reach
    return is_near or not mesh.contacts.faces_within_components(distance).any()


def sides_of(camera: Camera) -> list[tuple[float, float, float]]:
    """Half-spaces of the viewing pyramid: a point (x, y, z) is in view where none is below 0."""
    return [
        (camera.fx, 0, camera.cx),
        (-camera.fx, 0, camera.width - camera.cx),
        (0, camera.fy, camera.cy),
        (0, -camera.fy, camera.height - camera.cy),
    ]
