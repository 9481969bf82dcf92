"""Cameras and poses of a result in one file of our own, so that its folder can be opened again."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rastercov.base.output import write_json
from rastercov.camera.formats.own import content_of
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, Rig, cameras_of, names_of
from rastercov.camera.views import Views

MOST_POSES = 5_000
"""Poses up to which a result has the file: about 3 MB."""


def write_rig(path: Path, camera: Cameras, poses: Poses, names: Sequence[str] = ()) -> None:
    """Write the cameras and poses of a result; nothing for more than `MOST_POSES`.

    `names` are those of the images, their rows in the input unless given.
    """
    if not 0 < len(poses) <= MOST_POSES:
        return
    cameras = cameras_of(camera)
    used = np.unique(poses.camera).tolist()
    rig = Rig([cameras[row] for row in used], [names_of(camera)[row] for row in used])
    index = np.searchsorted(used, poses.camera)
    placed = replace(poses, camera=index.astype(np.int32), rejected={})
    images = tuple(names) or tuple(f"pose {row}" for row in poses.ids.tolist())
    write_json(path, content_of(Views(rig=rig, poses=placed, images=images)))
