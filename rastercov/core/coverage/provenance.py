"""Provenance of a result: inputs with their hashes, thresholds, device and versions."""

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

import rastercov
from rastercov.base import AnyArray, ByName, ReadByName
from rastercov.base.versions import version_of
from rastercov.core.camera import Cameras, Rig, cameras_of, names_of
from rastercov.core.camera.rig import entries_of
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import RasterizerInfo


def provenance_of(
    mesh: Mesh,
    camera: Cameras,
    poses: NDArray[np.float64],
    task: Task | None = None,
    options: ReadByName | None = None,
    measured_by: RasterizerInfo | None = None,
    packages: Sequence[str] = ("moderngl", "numpy"),
) -> ByName:
    """Inputs of a result, and the device that measured it, ready for JSON.

    "mesh" has the files as read, "scene" the faces in metres; "camera" is the one camera, "cameras"
    are several, with their names where they have any.

    Parameters
    ----------
    mesh, camera
        The scene, and the camera that sees it, or several.
    poses : (P, 4, 4) float64
        world_from_camera, with those that were rejected.
    task : Task, optional
        Thresholds, where the result has any.
    options : mapping, optional
        Options of the run, ready for JSON.
    measured_by : RasterizerInfo, optional
    packages : sequence of str
        Packages whose versions are recorded beside ours; None for one that is not installed.
    """
    optional = {
        "task": task._entries() if task else None,
        "options": dict(options) if options is not None else None,
        "measured_by": asdict(measured_by) if measured_by else None,
    }
    return {
        "mesh": [source.to_json() for source in mesh.sources] or [{"name": "arrays"}],
        "scene": {
            "sha256": sha256(mesh.vertices, mesh.faces, mesh.face_group),
            "n_faces": mesh.n_faces,
            "groups": [group.to_json() for group in mesh.groups],
        },
        "poses": {"sha256": sha256(poses), "n_poses": len(poses)},
        **plain_cameras(camera),
        **{name: entry for name, entry in optional.items() if entry is not None},
        "versions": {
            "python": platform.python_version(),
            "rastercov": rastercov.__version__,
            **{name: version_of(name) for name in packages},
        },
    }


def plain_cameras(camera: Cameras) -> ByName:
    """Entry "camera" of one camera, or "cameras" with the names of all, ready for JSON.

    Of a rig with a rule, that and the thresholds of its cameras, too.
    """
    cameras = cameras_of(camera)
    return {"camera": cameras[0].to_json()} if len(cameras) == 1 else name_cameras(camera)


def name_cameras(camera: Cameras) -> ByName:
    """Entry "cameras" with the names of all, as of `plain_cameras` of several."""
    entries = [
        {"name": name} | each.to_json()
        for name, each in zip(names_of(camera), cameras_of(camera), strict=True)
    ]
    return {"cameras": entries} | (entries_of(camera) if isinstance(camera, Rig) else {})


def sha256(*parts: AnyArray | str) -> str:
    """SHA-256 of arrays, their dtypes and shapes, and texts."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            total.update(part.encode())
        else:
            total.update(f"{part.dtype.str} {part.shape}".encode())
            total.update(np.ascontiguousarray(part).data)
    return total.hexdigest()
