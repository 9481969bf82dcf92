"""Inputs of a job in the folder of its shards, so that each worker reads them once.

header.json   all that the shards depend on, with hashes
scene.npz     mesh and cameras
poses.npz     poses, (P, 4, 4) world_from_camera; ids and camera, (P,) each; further tables
"""

import io
import json
import zipfile
from collections.abc import Callable, Collection
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from rastercov.base import ByName, ReadByName, json_text
from rastercov.core.camera import Camera, Cameras, Poses, cameras_of
from rastercov.core.camera.rig import rig_of_json, rig_to_json
from rastercov.core.mesh import Group, Mesh
from rastercov.core.mesh.mesh import MeshSource
from rastercov.shards.store import DamagedError, Note, renew, whole
from rastercov.shards.work import FolderLostError

T = TypeVar("T")
ARRAYS = ("vertices", "faces", "face_group", "source_face")
HEADER, SCENE, POSES = "header.json", "scene.npz", "poses.npz"
INPUTS = (SCENE, POSES, HEADER)
"""Files in the order in which they are written: where the last one is, all are."""
OPEN = 2
"""Jobs that a worker keeps open: those of a plan, and of its cavities."""


class Inputs(NamedTuple):
    """Header of a job, its mesh, cameras and poses."""

    header: ByName
    mesh: Mesh
    cameras: Cameras
    poses: Poses


def header_bytes(header: ReadByName) -> bytes:
    """File of a header; equal headers give the same bytes."""
    return json_text(header).encode() + b"\n"


def write_inputs(
    folder: Path,
    header: ReadByName,
    mesh: Mesh,
    cameras: Cameras,
    poses: Poses,
    note: Note,
    **arrays: object,
) -> None:
    """Write all files that are not there with this content; `note` names damaged ones.

    Other arrays go to the file of poses.
    """
    placed = {"poses": poses.world_from_camera, "ids": poses.ids, "camera": poses.camera}
    files = (_scene_bytes(mesh, cameras), npz_bytes(placed | arrays), header_bytes(header))
    for name, data in zip(INPUTS, files, strict=True):
        renew(folder, name, data, note)


def _scene_bytes(mesh: Mesh, cameras: Cameras) -> bytes:
    words = {
        "groups": [group.to_json() for group in mesh.groups],
        "sources": [source.to_json() for source in mesh.sources],
        "notes": list(mesh.notes),
        "cameras": [camera.to_json() for camera in cameras_of(cameras)],
        **({"rules": rules} if (rules := rig_to_json(cameras)) else {}),
    }
    arrays = {name: getattr(mesh, name) for name in ARRAYS}
    text = np.frombuffer(json.dumps(words, sort_keys=True).encode(), np.uint8)
    return npz_bytes(arrays | {"words": text})


def npz_bytes(arrays: ReadByName, *, level: int = 0) -> bytes:
    """File of arrays by their names, as `numpy.load` reads it; equal arrays give the same bytes.

    `level` is that of zlib, 0 for none.
    """
    file = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if level else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", kind, compresslevel=level) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)
    return file.getvalue()


def read_npz(data: bytes, names: Collection[str] | None = None) -> ByName:
    """Arrays of a file that `npz_bytes` made, or those of some names that are there."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file if names is None or name in names}


def read_poses(folder: Path) -> Poses:
    """Poses of a job; DamagedError as of `whole`."""
    npz = read_npz(whole(folder, POSES))
    return Poses(npz["poses"], npz["ids"], npz["poses"], {}, npz["camera"])


def read_inputs(folder: Path) -> Inputs:
    """All inputs of a job; DamagedError as of `whole`."""
    arrays = read_npz(whole(folder, SCENE))
    words = json.loads(arrays.pop("words").tobytes())
    mesh = Mesh(
        **arrays,
        groups=[Group(**group) for group in words["groups"]],
        sources=[MeshSource(**source) for source in words["sources"]],
        notes=words["notes"],
    )
    cameras = rig_of_json([Camera(**each) for each in words["cameras"]], words.get("rules", {}))
    return Inputs(json.loads(whole(folder, HEADER)), mesh, cameras, read_poses(folder))


def open_once(open_job: Callable[[Path, Inputs], T]) -> Callable[[Path], T]:
    """Function of a folder that opens a job; it stays open in this process, until two others are.

    Raises
    ------
    FolderLostError
        By the function, where the inputs are not there.
    """

    @lru_cache(OPEN)
    def open_inputs(folder: Path, modified: int) -> T:
        try:
            inputs = read_inputs(folder)
        except DamagedError as error:
            raise FolderLostError(str(error)) from None
        return open_job(folder, inputs)

    def of(folder: Path) -> T:
        try:
            modified = (folder / HEADER).stat().st_mtime_ns
        except OSError:
            raise FolderLostError(f"{folder}: expected {HEADER}, got no such file") from None
        return open_inputs(folder, modified)

    return of
