"""Poses of KITTI's odometry benchmark: the 12 numbers of three rows of world_from_camera a line.

They are in metres, of the left camera, with our axes.

Source: A. Geiger et al. Are we ready for autonomous driving? The KITTI vision benchmark suite.
2012.
"""

import numpy as np

from rastercov.base import CameraError
from rastercov.core.camera import Border, Views
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import Source, check_array_of, number_of


def is_mine(text: str) -> bool:
    """True where the first line has 12 numbers."""
    words = text[:4000].partition("\n")[0].split()
    return len(words) == 12 and all(isinstance(number_of(word), float) for word in words)


def read(source: Source, border: Border) -> Views:
    """Poses, by their lines."""
    rows = [line.split() for line in source.text.splitlines() if line.strip()]
    if not rows:
        raise CameraError("expected lines of 12 numbers, got none; name another file")
    values = [[number_of(word) for word in row] for row in rows]
    matrices = np.array([check_array_of(row, "a line", (12,)) for row in values]).reshape(-1, 3, 4)
    poses = motions(matrices[:, :, :3], matrices[:, :, 3])
    return border.views(
        None,
        world_from_camera=border.of_convention(poses),
        images=[f"line {row + 1}" for row in range(len(rows))],
        metres=border.metres(1.0),
    )
