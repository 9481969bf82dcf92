"""Rigs and frames of a COLMAP model that is written: `rigs` and `frames`, as text or binary.

The images of a frame were taken at the same instant by cameras of one rig, and COLMAP takes their
poses from the frame: rig_from_world, and sensor_from_rig of each camera. The first camera of a rig
is its reference, at the rig's origin.

Source: COLMAP documentation, "Output Format"; src/colmap/scene/reconstruction_io_{text,binary}.cc.
"""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.formats.rotations import to_quaternions
from rastercov.camera.pose import inverse
from rastercov.camera.views import Views

FloatArray = NDArray[np.float64]

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


def rigs_of(views: Views, notes: list[str]) -> Rigs | None:
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


def contents_of(rigs: Rigs, camera: NDArray[np.int32], *, as_text: bool) -> dict[str, bytes]:
    """Bytes of the two files by name; `camera`, (P,), is the index of that of each image."""
    places = _motions(rigs.sensor_from_rig)
    frames = _motions(inverse(np.array([frame.world_from_rig for frame in rigs.frames])))
    if as_text:
        lines = ["# Rigs: RIG_ID, NUM_SENSORS, REF_SENSOR, SENSORS[]: TYPE, ID, HAS_POSE, Q, T"]
        for number, own in enumerate(rigs.cameras):
            words = [str(number + 1), str(len(own)), f"CAMERA {own[0] + 1}"]
            for row in own[1:]:
                words.append(f"CAMERA {row + 1} 1 {' '.join(map(repr, places[row]))}")
            lines.append(" ".join(words))
        head = "# Frames: FRAME_ID, RIG_ID, RIG_FROM_WORLD Q, T, NUM_DATA_IDS, TYPE, ID, DATA_ID"
        rows = [head]
        for number, (frame, motion) in enumerate(zip(rigs.frames, frames, strict=True)):
            data = " ".join(f"CAMERA {camera[row] + 1} {row + 1}" for row in frame.rows)
            pose = " ".join(map(repr, motion))
            rows.append(f"{number + 1} {frame.rig + 1} {pose} {len(frame.rows)} {data}")
        return {
            "rigs.txt": "\n".join([*lines, ""]).encode(),
            "frames.txt": "\n".join([*rows, ""]).encode(),
        }
    parts = [struct.pack("<Q", len(rigs.cameras))]
    for number, own in enumerate(rigs.cameras):
        parts.append(struct.pack("<IIiI", number + 1, len(own), 0, own[0] + 1))
        parts += [struct.pack("<iIB7d", 0, row + 1, 1, *places[row]) for row in own[1:]]
    pieces = [struct.pack("<Q", len(rigs.frames))]
    for number, (frame, motion) in enumerate(zip(rigs.frames, frames, strict=True)):
        pieces.append(struct.pack("<II7dI", number + 1, frame.rig + 1, *motion, len(frame.rows)))
        pieces += [struct.pack("<iIQ", 0, camera[row] + 1, row + 1) for row in frame.rows]
    return {"rigs.bin": b"".join(parts), "frames.bin": b"".join(pieces)}


def _motions(matrices: FloatArray) -> list[list[float]]:
    """Quaternion, scalar first, and translation of motions."""
    quaternions = to_quaternions(matrices[:, :3, :3])
    found: list[list[float]] = np.hstack([quaternions, matrices[:, :3, 3]]).tolist()
    return found
