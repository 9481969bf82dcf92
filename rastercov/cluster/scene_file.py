"""Mesh and cameras of a job in one file, so that each worker reads them once."""

import io
import json
from collections.abc import Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.camera import Camera
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.mesh import Group, Mesh
from rastercov.mesh.mesh import MeshSource

EMPTY: Mapping[str, Any] = MappingProxyType({})
ARRAYS = ("vertices", "faces", "face_group", "source_face")


class Scene(NamedTuple):
    """Mesh and its cameras, and further arrays by name."""

    mesh: Mesh
    cameras: tuple[Camera, ...]
    more: dict[str, NDArray[Any]]


def scene_bytes(mesh: Mesh, cameras: Cameras, more: Mapping[str, NDArray[Any]] = EMPTY) -> bytes:
    """File of a scene; equal scenes give the same bytes."""
    words = {
        "groups": [group.to_json() for group in mesh.groups],
        "sources": [asdict(source) for source in mesh.sources],
        "notes": list(mesh.notes),
        "cameras": [camera.to_json() for camera in cameras_of(cameras)],
    }
    arrays = {name: getattr(mesh, name) for name in ARRAYS}
    arrays |= {f"more.{name}": array for name, array in more.items()}
    file = io.BytesIO()
    text = np.frombuffer(json.dumps(words, sort_keys=True).encode(), np.uint8)
    np.savez(file, words=text, **arrays)
    return file.getvalue()


def read_scene(data: bytes) -> Scene:
    """Scene of a file that `scene_bytes` made."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: file[name] for name in ARRAYS}
        words = json.loads(file["words"].tobytes())
        named = (name for name in file.files if name.startswith("more."))
        more = {name.removeprefix("more."): file[name] for name in named}
    mesh = Mesh(
        **arrays,
        groups=[Group(**group) for group in words["groups"]],
        sources=[MeshSource(**source) for source in words["sources"]],
        notes=words["notes"],
    )
    return Scene(mesh, tuple(Camera(**camera) for camera in words["cameras"]), more)
