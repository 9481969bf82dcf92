"""COLMAP models written: cameras, images and an empty list of points, as text or binary.

Images carry their own poses, which every version of COLMAP reads. Rigs and frames are written where
the views have frames; else COLMAP makes a rig of each camera. The images of a frame were taken at
the same instant by cameras of one rig, and COLMAP takes their poses from the frame: rig_from_world,
and sensor_from_rig of each camera. The first camera of a rig is its reference, at the rig's origin.

Source: COLMAP documentation, "Output Format"; src/colmap/scene/reconstruction_io_{text,binary}.cc.
"""

import struct
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.base.files import printable
from rastercov.base.output import writing
from rastercov.camera.formats.colmap import MODELS
from rastercov.camera.formats.conventions import to_quaternions, unique
from rastercov.camera.formats.equivalents import is_whole_panorama, model_in, no_model
from rastercov.camera.pose import inverse
from rastercov.camera.views import Views

FloatArray = NDArray[np.float64]

HEADS = {
    "cameras": "# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {}",
    "images": "# Image list: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D\n"
    "# Number of images: {}",
    "points3D": "# 3D point list: none",
    "rigs": "# Rigs: RIG_ID, NUM_SENSORS, REF_SENSOR, SENSORS[]: TYPE, ID, HAS_POSE, Q, T",
    "frames": "# Frames: FRAME_ID, RIG_ID, RIG_FROM_WORLD Q, T, NUM_DATA_IDS, TYPE, ID, DATA_ID",
}
"""Files of a model, and how each begins as text."""
PLACE_TOLERANCE = 1e-9
"""Difference of two poses of a rig by two of its cameras: of rotations, and of positions relative
to their extent. At it a point moves by less than 1e-5 px."""


@dataclass(frozen=True)
class Frame:
    """A frame: its rig, world_from_rig, and the rows of its images."""

    rig: int
    world_from_rig: FloatArray
    rows: list[int]


@dataclass(frozen=True)
class Rigs:
    """Cameras of each rig, the reference first, and the frames.

    Attributes
    ----------
    cameras : list of list of int
        Indices into the rig of the views.
    sensor_from_rig : (N, 4, 4) float64
        Of each camera.
    frames : list of Frame
    """

    cameras: list[list[int]]
    sensor_from_rig: FloatArray
    frames: list[Frame]


def _rigs_of(views: Views, notes: list[str]) -> Rigs | None:
    """Rigs and frames of these views; None where there are none, or they do not fit together.

    Cameras that share a frame are on one rig.
    """
    if not views.frames or views.rig is None:
        return None
    index = views.poses.camera
    rows_of: dict[str, list[int]] = {}
    for row, frame in enumerate(views.frames):
        rows_of.setdefault(frame, []).append(row)
    if any(len({int(index[row]) for row in rows}) < len(rows) for rows in rows_of.values()):
        notes.append("frames are left out: one of them has two images of a camera")
        return None
    # Cameras on one rig have the number of its first camera.
    first = list(range(len(views.rig)))
    for rows in rows_of.values():
        joined = {first[index[row]] for row in rows}
        first = [min(joined) if each in joined else each for each in first]
    places = views.rig.rig_from_camera
    camera_from_reference = inverse(places) @ places[first]
    world_from_rig = views.poses.world_from_camera @ camera_from_reference[index]
    centres = views.poses.world_from_camera[:, :3, 3]
    extent = max(1e-30, float(np.ptp(centres, axis=0).max()), float(np.abs(places[:, :3, 3]).max()))
    scale = np.ones((4, 4))
    scale[:3, 3] = extent
    heads = sorted(set(first))
    frames = []
    for rows in rows_of.values():
        of_frame = world_from_rig[rows]
        if (np.abs(of_frame - of_frame[0]) > PLACE_TOLERANCE * scale).any():
            notes.append(
                "frames are left out: their images are not where the places of the cameras on the "
                "rig put them; each image has its own pose"
            )
            return None
        frames.append(Frame(heads.index(first[index[rows[0]]]), of_frame[0], rows))
    cameras = [[row for row, head in enumerate(first) if head == each] for each in heads]
    return Rigs(cameras, camera_from_reference, frames)


class Word(NamedTuple):
    """A value that is another one in binary than in text."""

    code: Any
    text: str


CAMERA = Word(0, "CAMERA")
Record = tuple[str, Sequence[Any]]
"""Form of a record in `struct`, and its values."""


def contents_of(views: Views, *, as_text: bool, notes: list[str]) -> dict[str, bytes]:
    """Bytes of each file of a model, by name; what is lost is added to `notes`."""
    rig = views.rig
    assert rig is not None
    cameras: list[Record] = []
    for number, (camera, label) in enumerate(zip(rig.cameras, rig.names, strict=True)):
        found = model_in("colmap", camera)
        if is_whole_panorama(camera):
            found = "EQUIRECTANGULAR", {"w": float(camera.width), "h": float(camera.height)}
        if found is None or camera.skew:
            raise no_model("COLMAP", camera, label)
        name, p = found
        model = Word(MODELS.index(name), name)
        values = [number + 1, model, camera.width, camera.height, *p.values()]
        cameras.append((f"IiQQ{len(p)}d", values))
    names = unique([printable(name).replace("\0", "") for name in views.images], "image")
    if names != list(views.images):
        notes.append("names of images are made different from one another")
    index = views.poses.camera.tolist()
    images: list[Record] = []
    motions = _motions(inverse(views.poses.world_from_camera))
    for number, (motion, name) in enumerate(zip(motions, names, strict=True)):
        # A zero byte ends the name, and a count of points follows; in text, a line of them.
        end = Word(name.encode() + bytes(9), f"{name}\n")
        values = [number + 1, *motion, index[number] + 1, end]
        images.append((f"I7dI{len(end.code)}s", values))
    parts: dict[str, list[Record]] = {"cameras": cameras, "images": images, "points3D": []}
    rigs = _rigs_of(views, notes)
    if rigs is not None:
        parts |= _records_of(rigs, index)
    elif len(set(index)) > 1 and (rig.rig_from_camera[1:] != rig.rig_from_camera[:1]).any():
        notes.append("places of cameras on the rig are left out: each image has its own pose")
    if as_text and any(" " in name for name in names):
        notes.append("COLMAP ends names of a text model at spaces; write the binary one")
    suffix, write = ("txt", _as_text) if as_text else ("bin", _as_binary)
    return {f"{part}.{suffix}": write(part, records) for part, records in parts.items()}


def _as_text(part: str, records: Sequence[Record]) -> bytes:
    lines = [
        " ".join(value.text if isinstance(value, Word) else repr(value) for value in values)
        for _, values in records
    ]
    return "\n".join([HEADS[part].format(len(records)), *lines, ""]).encode()


def _as_binary(part: str, records: Sequence[Record]) -> bytes:
    packed = [
        struct.pack(f"<{form}", *(v.code if isinstance(v, Word) else v for v in values))
        for form, values in records
    ]
    return b"".join([struct.pack("<Q", len(records)), *packed])


def _records_of(rigs: Rigs, camera: Sequence[int]) -> dict[str, list[Record]]:
    """Rigs and frames; `camera` has the index of that of each image."""
    places = _motions(rigs.sensor_from_rig)
    of_rigs: list[Record] = []
    for number, (first, *others) in enumerate(rigs.cameras):
        values = [number + 1, 1 + len(others), CAMERA, first + 1]
        for row in others:
            values += [CAMERA, row + 1, 1, *places[row]]
        of_rigs.append((f"IIiI{'iIB7d' * len(others)}", values))
    of_frames: list[Record] = []
    motions = _motions(inverse(np.array([frame.world_from_rig for frame in rigs.frames])))
    for number, (frame, motion) in enumerate(zip(rigs.frames, motions, strict=True)):
        values = [number + 1, frame.rig + 1, *motion, len(frame.rows)]
        for row in frame.rows:
            values += [CAMERA, camera[row] + 1, row + 1]
        of_frames.append((f"II7dI{'iIQ' * len(frame.rows)}", values))
    return {"rigs": of_rigs, "frames": of_frames}


def _motions(matrices: FloatArray) -> list[list[float]]:
    """Quaternion, scalar first, and translation of motions."""
    quaternions = to_quaternions(matrices[:, :3, :3])
    found: list[list[float]] = np.hstack([quaternions, matrices[:, :3, 3]]).tolist()
    return found


def write(folder: Path, contents: Mapping[str, bytes], *, overwrite: bool) -> None:
    """Write the files of a model; a model that is there is replaced as a whole, if at all."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError("a folder for the COLMAP model wanted, got a file; give another name")
    others = [folder / f"{name}.{end}" for name in HEADS for end in ("bin", "txt")]
    there = [path for path in others if path.exists()]
    if there and not overwrite:
        raise ConfigError(f"{there[0].name} is there already; give another folder, or --overwrite")
    is_new = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        with ExitStack() as stack:  # all are written before any takes its place
            for name, data in contents.items():
                stack.enter_context(writing(folder / name)).write_bytes(data)
    except BaseException:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()
        raise
    for path in there:
        if path.name not in contents:
            path.unlink()  # of the model that was replaced: the new one has no such part
