"""Cameras and poses that the command line names by `--camera` and `--poses`.

Between `cli` and `camera_formats`: presets, files of this and other programs, poses on a sphere;
one file may give both.
"""

import os
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from rastercov.camera import Camera
from rastercov.camera_file import PRESETS
from rastercov.camera_formats import read_through
from rastercov.camera_formats.conventions import Border, Conventions
from rastercov.cli.inputs import poses_around
from rastercov.errors import CameraError, PoseError
from rastercov.mesh import Mesh
from rastercov.pose import Poses
from rastercov.rig import Rig
from rastercov.views import Views


def read_eyes(
    mesh: Mesh,
    camera: str | None,
    poses: str,
    conventions: Conventions,
    camera_name: str | None = None,
) -> Views:
    """The one camera of a command, and its poses.

    Parameters
    ----------
    mesh : Mesh
        The scene, for poses around it.
    camera : str, optional
        A preset or a file; the file of the poses unless given.
    poses : str
        A file, or sphere:N.
    conventions : Conventions
        Answers to what the files leave open.
    camera_name : str, optional
        Camera of a file with several.

    Raises
    ------
    CameraError
        Where there is no camera, or several to choose from.
    PoseError
        For poses without a unit, and for what is no pose file.
    """
    border = Border(conventions)
    cameras = None if camera is None else _cameras(camera, poses, border)
    if poses.startswith("sphere:"):
        if cameras is None:
            raise CameraError("--poses sphere:N needs a camera; give --camera")
        found = cameras.of_camera(camera_name)
        around = Poses.of(poses_around(poses, mesh, found.camera()))
        names = tuple(f"pose {row}" for row in range(len(around)))
        return replace(found, poses=around, images=names, has_unit=True)
    views = cameras if _is_same(camera, poses) and cameras else read_through(poses, border)
    if not len(views.poses) and not views.poses.rejected and views.rig is not None:
        raise PoseError(f"{poses}: there are cameras and no poses; give a pose file as --poses")
    if cameras is None and views.rig is None:
        raise CameraError(f"{poses} has poses and no camera; give --camera")
    if not views.has_unit:
        raise PoseError(
            f"{poses}: the poses have no unit, and the mesh is in metres; give --pose-unit, 1 if "
            "they are in metres"
        )
    if cameras is None or cameras is views:
        found = _of_one(views, camera_name)
    else:
        found = _with_camera(views, cameras, camera_name)
    notes = list(dict.fromkeys([*found.notes, *border.unused()]))
    return replace(found, notes=tuple(notes))


def poses_of(
    path: Path, conventions: Conventions, camera_name: str | None = None
) -> tuple[Poses, tuple[str, ...]]:
    """Poses of a file in metres, of one camera where it has several, and notes about them."""
    border = Border(conventions)
    views = read_through(path, border)
    if camera_name is not None:
        views = views.of_camera(camera_name)
    if not views.has_unit:
        raise PoseError(f"{path}: the poses have no unit; give --pose-unit, 1 if it is metres")
    return views.poses, (*views.notes, *border.unused())


def _cameras(camera: str, poses: str, border: Border) -> Views:
    if camera in PRESETS:
        return _alone(Camera.preset(camera), camera)
    if "=" in camera and not os.path.exists(camera):  # noqa: PTH110 - of a text
        return _alone(_of_entries(camera), "camera")
    found = read_through(camera, border)
    if found.rig is None:
        raise CameraError(f"{camera} has poses and no camera; give a camera file")
    return found


def _of_entries(text: str) -> Camera:
    """Camera of the entries of a camera file, as one line."""
    inside = text.strip().removeprefix("{").removesuffix("}")
    try:
        entries = tomllib.loads(f"camera = {{ {inside} }}")["camera"]
        return Camera.from_dict(entries)
    except CameraError as error:
        raise CameraError(f"--camera {text}: {error}") from None
    except (tomllib.TOMLDecodeError, RecursionError, AttributeError):
        raise CameraError(
            f'--camera {text}: a file, a preset, or entries such as \'preset = "khepra", near = '
            "0.1' wanted; correct it"
        ) from None


def _alone(camera: Camera, name: str) -> Views:
    return Views(rig=Rig([camera], [name]), poses=Poses.of(np.zeros((0, 4, 4))))


def _is_same(camera: str | None, poses: str) -> bool:
    try:
        return camera is not None and os.path.samefile(camera, poses)  # noqa: PTH121 - of two texts
    except OSError:
        return False


def _of_one(views: Views, name: str | None) -> Views:
    """Views of the chosen camera, of the only one that has poses, or of the only one."""
    used = np.unique(views.poses.camera)
    if name is None and len(used) == 1 and views.rig is not None:
        name = views.rig.names[int(used[0])]
    return views.of_camera(name)


def _with_camera(views: Views, cameras: Views, name: str | None) -> Views:
    """Poses of one file with the camera of another."""
    chosen = cameras.of_camera(name)
    if name is not None and views.rig is not None and name in views.rig.names:
        views = views.of_camera(name)
    return Views(
        rig=chosen.rig,
        poses=replace(views.poses, camera=np.zeros(len(views.poses), np.int32)),
        images=views.images,
        notes=(*cameras.notes, *views.notes),
    )
