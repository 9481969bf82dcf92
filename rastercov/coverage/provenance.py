"""Provenance of a result: inputs with their hashes, thresholds, device and versions."""

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.raster.contract import RasterizerInfo


@dataclass(frozen=True, eq=False)
class Provenance:
    """Inputs of a result, and the device that measured it.

    Attributes
    ----------
    mesh : Mesh
    camera : Camera, Rig or sequence of Camera
        Entry "camera" of the one camera, or "cameras" of all, with their names where they have any.
    poses : (P, 4, 4) float64
        world_from_camera, those that were rejected included.
    task : Task or None
        Thresholds, where the result has any.
    options : mapping or None
        Options of the run, ready for JSON.
    measured_by : RasterizerInfo or None
    packages : tuple of str
        Packages whose versions are recorded; None for one that is not installed.
    """

    mesh: Mesh
    camera: Cameras
    poses: NDArray[np.float64]
    task: Task | None = None
    options: Mapping[str, Any] | None = None
    measured_by: RasterizerInfo | None = None
    packages: tuple[str, ...] = ("rastercov", "moderngl", "numpy")

    def as_dict(self) -> dict[str, Any]:
        """Entries ready for JSON; "mesh" has the files as read, "scene" the faces in metres."""
        return dict(self._entries)

    @cached_property
    def _entries(self) -> dict[str, Any]:
        mesh = self.mesh
        optional = {
            "task": asdict(self.task) if self.task else None,
            "options": dict(self.options) if self.options is not None else None,
            "measured_by": asdict(self.measured_by) if self.measured_by else None,
        }
        return {
            "mesh": [asdict(source) for source in mesh.sources] or [{"name": "arrays"}],
            "scene": {
                "sha256": sha256(mesh.vertices, mesh.faces, mesh.face_group),
                "n_faces": mesh.n_faces,
                "groups": [group.to_json() for group in mesh.groups],
            },
            "poses": {"sha256": sha256(self.poses), "n_poses": len(self.poses)},
            **plain_cameras(self.camera),
            **{name: entry for name, entry in optional.items() if entry is not None},
            "versions": {
                "python": platform.python_version(),
                **{name: _version(name) for name in self.packages},
            },
        }


def plain_cameras(camera: Cameras) -> dict[str, Any]:
    """Entry "camera" of one camera, or "cameras" with the names of all, ready for JSON."""
    cameras = cameras_of(camera)
    if len(cameras) == 1:
        return {"camera": cameras[0].to_json()}
    return {
        "cameras": [
            {"name": name} | each.to_json()
            for name, each in zip(names_of(camera), cameras, strict=True)
        ]
    }


def sha256(*parts: NDArray[Any] | str) -> str:
    """SHA-256 of arrays, their dtypes and shapes, and texts."""
    total = hashlib.sha256()
    for part in parts:
        if isinstance(part, str):
            total.update(part.encode())
        else:
            total.update(f"{part.dtype.str} {part.shape}".encode())
            total.update(np.ascontiguousarray(part).data)
    return total.hexdigest()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
