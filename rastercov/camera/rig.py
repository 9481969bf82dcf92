"""Rigs: several cameras that do one job, each with a name and its place on the rig; and views.

Wherever a camera is asked for, a sequence of cameras or a `Rig` may be given; `Poses.camera` then
says which of them is in each pose.

Views are cameras and poses as files of calibrations and reconstructions hold them together: between
`rastercov.camera.formats`, which reads and writes them, and whatever takes a camera or poses. All
is in the conventions of this package: axes x right, y down, z forward, world_from_camera, centre of
the top-left pixel at (0.5, 0.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind, members
from rastercov.base.checks import shown
from rastercov.base.errors import CameraError, MeshError, PoseError
from rastercov.base.format import InOneLine
from rastercov.base.typed import typed
from rastercov.camera.camera import Camera
from rastercov.camera.pose import Poses, valid_poses
from rastercov.mesh import Mesh

MOST_CAMERAS = 100_000
"""Cameras of a rig: a reconstruction may have one for each image."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Rig(InOneLine):
    """Named cameras that are mounted together, or that share one job.

    Parameters
    ----------
    cameras : sequence of Camera
        N cameras, at least one.
    names : sequence of str, optional
        Their names, all different; "camera 0", ... unless given.
    rig_from_camera : (N, 4, 4) array_like, optional
        Place of each camera on the rig; all at its origin unless given.

    Raises
    ------
    CameraError
        For no camera, or names that are no names.
    PoseError
        For a place that is no rigid motion.
    """

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    rig_from_camera: NDArray[np.float64]

    def __init__(
        self,
        cameras: Sequence[Camera],
        names: Sequence[str] | None = None,
        rig_from_camera: ArrayLike | None = None,
    ) -> None:
        found = _checked(cameras)
        n = len(found)
        if names is None:
            names = names_of(found)
        words = members("names", names, str, f"{n} texts", CameraError)
        if len(words) != n or len(set(words)) != n or not all(words):
            raise CameraError(
                f"names must be {n} different texts, one for each camera, got {shown(list(words))}"
            )
        places = np.broadcast_to(np.eye(4), (n, 4, 4))
        if rig_from_camera is not None:
            places = valid_poses(rig_from_camera)
            if len(places) != n:
                raise CameraError(
                    f"rig_from_camera must have one place for each of {n} cameras, "
                    f"got {len(places)}"
                )
        for name, value in (("cameras", found), ("names", words), ("rig_from_camera", places)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.cameras)

    def poses(self, world_from_rig: ArrayLike) -> Poses:
        """Poses of all cameras in R poses of the rig: row r N + k is camera k in pose r.

        Parameters
        ----------
        world_from_rig : (R, 4, 4) array_like
            Rigid motions.
        """
        rigs = valid_poses(world_from_rig)
        matrices = rigs[:, None] @ self.rig_from_camera[None]
        return Poses.of(matrices.reshape(-1, 4, 4), camera=np.tile(np.arange(len(self)), len(rigs)))


Cameras = Camera | Sequence[Camera] | Rig
"""Cameras as functions take them."""


def cameras_of(cameras: Any) -> tuple[Camera, ...]:
    """The cameras of a camera, a rig or a sequence of cameras; `CameraError` for anything else."""
    if isinstance(cameras, Camera):
        return (cameras,)
    return cameras.cameras if isinstance(cameras, Rig) else _checked(cameras)


def names_of(cameras: Cameras) -> tuple[str, ...]:
    """Names of the cameras; "camera 0", ... where they have none of their own."""
    if isinstance(cameras, Rig):
        return cameras.names
    return tuple(f"camera {row}" for row in range(len(cameras_of(cameras))))


def check_scene(mesh: Any, camera: Any) -> None:
    """Raise MeshError or CameraError unless they are a Mesh and a camera, or several."""
    check_kind("mesh", mesh, Mesh, "a Mesh (Mesh.load reads a file)", MeshError)
    cameras_of(camera)


def _checked(cameras: Any) -> tuple[Camera, ...]:
    wanted = "a Camera (Camera.load reads a file), a Rig, or a list of Camera values"
    found = members("camera", cameras, Camera, wanted, CameraError)
    if not 1 <= len(found) <= MOST_CAMERAS:
        raise CameraError(f"camera must be 1 to {MOST_CAMERAS:,} cameras, got {len(found)}")
    return found


MOST_NAMES = 8
"""Names of cameras that a message lists."""


@dataclass(frozen=True, eq=False, repr=False)
class Views(InOneLine):
    """Cameras with names, poses, and a name for the image of each pose.

    Parameters
    ----------
    rig : Rig, optional
        The cameras, with their names and places; None for a file of poses alone.
    poses : Poses
        world_from_camera, with the index of the camera of each; none for a file of cameras alone.
    images : tuple of str
        Name of the image of each pose.
    notes : tuple of str
        What was converted, and what could not be kept.
    has_unit : bool
        True where lengths are metres; False where the file does not state its unit.
    camera_names : tuple of str
        Names of the cameras that `Poses.camera` counts, where the file names them and has none of
        them; with a rig they are those of the rig.
    frames : tuple of str
        Name of the frame of each pose, where the file has frames: the images of one frame were
        taken at the same instant. Empty where it has none.

    Raises
    ------
    CameraError
        For something else than a rig and texts.
    PoseError
        For a pose with a camera that the rig does not have, or another number of images or frames.
    """

    rig: Rig | None
    poses: Poses
    images: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    has_unit: bool = True
    camera_names: tuple[str, ...] = ()
    frames: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_kind("poses", self.poses, Poses, "Poses (Poses.of makes them)", PoseError)
        if self.rig is not None:
            check_kind("rig", self.rig, Rig, "a Rig, or None", CameraError)
            self.poses.check_cameras(len(self.rig))
            object.__setattr__(self, "camera_names", self.rig.names)
        elif self.camera_names:
            self.poses.check_cameras(len(self.camera_names))
        for name in ("images", "notes", "camera_names", "frames"):
            words = members(name, getattr(self, name), str, "texts", CameraError)
            object.__setattr__(self, name, words)
        n = len(self.poses)
        for name, words in (("images", self.images), ("frames", self.frames or self.images)):
            if len(words) != n:
                raise PoseError(f"{name} must have a name for each of {n} poses, got {len(words)}")

    @typed
    def camera(self, name: str | None = None) -> Camera:
        """The camera of that name; the only one if no name is given.

        Raises
        ------
        CameraError
            Where there is none, or several to choose from.
        """
        return self.cameras()[self._index(name)]

    def cameras(self) -> tuple[Camera, ...]:
        """All cameras; CameraError where the file has poses alone."""
        if self.rig is None:
            raise CameraError("there are poses and no camera; give a camera as well")
        return self.rig.cameras

    @typed
    def of_camera(self, name: str | None = None) -> "Views":
        """Views of one camera: the camera and its poses.

        Without a name it is the only camera that has poses, or the only one. `Poses.ids` are still
        rows of the file, and what was rejected is still named.
        """
        is_alone = self.rig is not None and name is None and self.n_used == 1
        index = int(self.poses.camera[0]) if is_alone else self._index(name)
        assert self.rig is not None
        rig = Rig(
            [self.rig.cameras[index]],
            [self.rig.names[index]],
            self.rig.rig_from_camera[index][None],
        )
        return self._with_rows(np.flatnonzero(self.poses.camera == index), rig)

    def _with_rows(self, rows: NDArray[np.intp], rig: "Rig | None") -> "Views":
        """These poses, all of the only camera of a rig; `Poses.rejected` is kept."""
        camera, rejected = np.zeros(len(rows), np.int32), self.poses.rejected
        return replace(
            self,
            rig=rig,
            poses=replace(self.poses[rows], camera=camera, rejected=rejected),
            images=tuple(self.images[row] for row in rows),
            frames=tuple(self.frames[row] for row in rows) if self.frames else (),
        )

    def check_unit(self) -> None:
        """Raise `PoseError` unless lengths are metres."""
        if not self.has_unit:
            raise PoseError(
                "the poses have no unit; read them with Conventions(pose_unit=), 1 if it is metres"
            )

    @typed
    def with_cameras(self, rig: Rig) -> "Views":
        """The same poses, each with the camera of its name in a rig.

        Raises
        ------
        PoseError
            Where the poses name no cameras, or one that the rig does not have.
        """
        known = _listed(rig.names)
        if not self.camera_names:
            raise PoseError(
                f"the poses do not say which camera each is of, and there are {len(rig)}, {known}; "
                "name them under camera in the pose file, or choose one by --camera-name"
            )
        row_of = {name: row for row, name in enumerate(rig.names)}
        index = np.zeros(len(self.camera_names), np.int32)
        for row in np.unique(self.poses.camera):
            if (name := self.camera_names[row]) not in row_of:
                raise PoseError(
                    f"the poses are of a camera {shown(name)}, and cameras are {known}; give it, "
                    "or correct the name"
                )
            index[row] = row_of[name]
        poses = replace(self.poses, camera=index[self.poses.camera])
        return replace(self, rig=rig, poses=poses)

    @typed
    def through(
        self, cameras: "Views", name: str | None = None, *, by_name: bool = False
    ) -> "Views":
        """The same poses with cameras of another file.

        Parameters
        ----------
        cameras : Views
            Cameras; their notes come before those of the poses.
        name : str, optional
            The camera to take: for the poses that name it, or for all where none does. Without a
            name, the only one.
        by_name : bool
            Take all cameras, unless one is named, each for the poses that name it.

        Raises
        ------
        CameraError, PoseError
            As `of_camera` and `with_cameras` do.
        """
        notes = (*cameras.notes, *self.notes)
        if by_name and name is None:
            cameras.cameras()  # refuses poses alone
            assert cameras.rig is not None
            return replace(self.with_cameras(cameras.rig), notes=notes)
        chosen = cameras.of_camera(name)
        rows = np.arange(len(self.poses))
        if name in self.camera_names:
            rows = np.flatnonzero(self.poses.camera == self.camera_names.index(name))
        return replace(self._with_rows(rows, chosen.rig), notes=notes)

    @property
    def n_used(self) -> int:
        """Number of cameras that have poses."""
        return len(np.unique(self.poses.camera))

    def _index(self, name: str | None) -> int:
        n = len(self.cameras())
        assert self.rig is not None
        if name is None and n == 1:
            return 0
        known = _listed(self.rig.names)
        if name is None:
            raise CameraError(f"there are {n} cameras, {known}; choose one by --camera-name")
        if name not in self.rig.names:
            raise CameraError(f"there is no camera {shown(name)}; cameras are {known}")
        return self.rig.names.index(name)


def _listed(names: Sequence[str]) -> str:
    """Names for a message, at most `MOST_NAMES`."""
    return ", ".join(map(shown, names[:MOST_NAMES])) + (", ..." if len(names) > MOST_NAMES else "")
