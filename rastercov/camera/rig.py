"""Rigs: several cameras that do one job, each with a name and its place on the rig.

Wherever a camera is asked for, a sequence of cameras or a `Rig` may be given; `Poses.camera` then
says which of them is in each pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import check_kind, members
from rastercov.base.checks import shown
from rastercov.base.errors import CameraError, MeshError
from rastercov.base.format import InOneLine
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


def only_camera(cameras: Cameras) -> Camera:
    """The camera where there is one; `CameraError` where there are several."""
    found = cameras_of(cameras)
    if len(found) > 1:
        raise CameraError(f"one camera is wanted here, got {len(found)}; give the one to be used")
    return found[0]


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
