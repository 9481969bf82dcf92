"""Cameras and poses that the command line names by `--camera` and `--poses`.

Between `cli` and `camera.formats`: presets, files of this and other programs, poses on a sphere;
one file may give both.
"""

import os
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rastercov.base.errors import CameraError, PoseError
from rastercov.camera.camera import Camera
from rastercov.camera.camera_file import PRESETS
from rastercov.camera.formats import read_through
from rastercov.camera.formats.conventions import Border, Conventions
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Rig
from rastercov.camera.views import Views
from rastercov.cli.inputs import poses_around
from rastercov.mesh import Mesh

MOST_WARNINGS = 5
"""Rejected poses that are named one by one."""


def left_out(poses: Poses, more: str = "") -> list[str]:
    """Lines on poses that are no rigid motion and were left out; `more` ends that of many."""
    rejected = sorted(poses.rejected.items())
    lines = [f"pose {row} left out: it {text}" for row, text in rejected[:MOST_WARNINGS]]
    others = len(rejected) - MOST_WARNINGS
    return lines + ([f"{others} more poses left out{more}"] if others > 0 else [])


def read_eyes(
    mesh: Mesh,
    camera: str | Sequence[str] | None,
    poses: str,
    conventions: Conventions,
    camera_name: str | None = None,
    *,
    several: bool = False,
) -> Views:
    """Camera of a command, or its cameras, and the poses.

    Parameters
    ----------
    mesh : Mesh
        The scene, for poses around it.
    camera : str or sequence of str, optional
        A preset or a file, or NAME=FILE for each of several; the file of the poses unless given.
    poses : str
        A file, or sphere:N.
    conventions : Conventions
        Answers to what the files leave open.
    camera_name : str, optional
        Camera of a file with several.
    several : bool
        Take all cameras unless one is named; the poses then name theirs.

    Raises
    ------
    CameraError
        Where there is no camera, or several to choose from.
    PoseError
        For poses without a unit, and for what is no pose file.
    """
    border = Border(conventions)
    given = [camera] if isinstance(camera, str) else list(camera or ())
    cameras = read_cameras(given, border)
    if poses.startswith("sphere:"):
        if cameras is None:
            raise CameraError("--poses sphere:N needs a camera; give --camera")
        found = cameras.of_camera(camera_name)
        around = Poses.of(poses_around(poses, mesh, found.camera()))
        names = tuple(f"pose {row}" for row in range(len(around)))
        return replace(found, poses=around, images=names, has_unit=True)
    is_same = len(given) == 1 and _is_same(given[0], poses)
    views = cameras if is_same and cameras else read_through(poses, border)
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
        found = _chosen(views, camera_name, several=several)
    else:
        by_name = several and (len(cameras.cameras()) > 1 or _named(given[0]) is not None)
        found = _with_cameras(views, cameras, camera_name, by_name=by_name)
    notes = list(dict.fromkeys([*found.notes, *border.unused()]))
    return replace(found, notes=tuple(notes))


def read_rig(
    camera: Sequence[str], poses: Path, conventions: Conventions, camera_name: str | None = None
) -> Views:
    """Poses of a file in metres, with cameras where any are given or the file has them.

    `camera` replaces the cameras of the file; arguments as for `read_eyes`.
    """
    border = Border(conventions)
    cameras = read_cameras(camera, border)
    views = read_through(poses, border)
    if not views.has_unit:
        raise PoseError(f"{poses}: the poses have no unit; give --pose-unit, 1 if it is metres")
    if cameras is not None:
        by_name = len(cameras.cameras()) > 1 or _named(camera[0]) is not None
        views = _with_cameras(views, cameras, camera_name, by_name=by_name)
    elif camera_name is not None:
        views = views.of_camera(camera_name)
    return replace(views, notes=(*views.notes, *border.unused()))


def read_cameras(given: Sequence[str], border: Border) -> Views | None:
    """Cameras of the option --camera: of one file, or NAME=FILE for each; None where none is.

    Raises
    ------
    CameraError
        For several without names, for two of one name, and for files without a camera.
    """
    if not given:
        return None
    if len(given) == 1 and _named(given[0]) is None:
        return _cameras(given[0], border)
    found: dict[str, Camera] = {}
    for text in given:
        if (pair := _named(text)) is None:
            raise CameraError(
                f"--camera {text}: of several cameras each wants a name and a file or preset, "
                "--camera left=left.yaml; correct it"
            )
        name, source = pair
        if name in found:
            raise CameraError(f"--camera {text}: there is a camera {name!r} already; rename it")
        views = _cameras(source, border)
        assert views.rig is not None
        found[name] = views.camera(name if name in views.rig.names else None)
    rig = Rig(list(found.values()), list(found))
    return Views(rig=rig, poses=Poses.of(np.zeros((0, 4, 4))))


def _named(text: str) -> tuple[str, str] | None:
    """Name and file, or preset, of NAME=FILE; None for anything else."""
    name, equals, source = text.partition("=")
    is_known = source in PRESETS or os.path.exists(source)  # noqa: PTH110 - of a text
    is_file = os.path.exists(text)  # noqa: PTH110 - a name with = in it
    return (name, source) if name and equals and is_known and not is_file else None


def _cameras(camera: str, border: Border) -> Views:
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


def _chosen(views: Views, name: str | None, *, several: bool) -> Views:
    """Views of the chosen camera, of the only one that has poses, of the only one, or of all."""
    used = np.unique(views.poses.camera)
    if name is None and len(used) == 1 and views.rig is not None:
        name = views.rig.names[int(used[0])]
    return views if several and name is None else views.of_camera(name)


def _with_cameras(views: Views, cameras: Views, name: str | None, *, by_name: bool) -> Views:
    """Poses of one file with the camera of another, or each with that of its name."""
    assert cameras.rig is not None
    notes = (*cameras.notes, *views.notes)
    if name is None and by_name:
        return _chosen(replace(views.with_cameras(cameras.rig), notes=notes), None, several=True)
    chosen = cameras.of_camera(name)
    rows = np.arange(len(views.poses))
    if name in views.camera_names:
        rows = np.flatnonzero(views.poses.camera == views.camera_names.index(name))
    poses = replace(views.poses[rows], camera=np.zeros(len(rows), np.int32))
    return Views(
        rig=chosen.rig,
        poses=replace(poses, rejected=views.poses.rejected),
        images=tuple(views.images[row] for row in rows),
        notes=notes,
    )
