"""Trajectories of TUM RGB-D: "timestamp tx ty tz qx qy qz qw" on each line.

Poses are world_from_camera, in metres, with our axes unless `--pose-convention` says otherwise: the
benchmark has those of the optical center of the camera.

Source: TUM RGB-D benchmark, "File Formats".
"""

from rastercov.base import CameraError, shown
from rastercov.core.camera import Border, Views
from rastercov.core.camera.conventions import from_quaternions
from rastercov.formats.cameras.source import Source, check_array_of, number_of


def _rows(text: str) -> list[list[str]]:
    lines = text.replace(",", " ").splitlines()
    return [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def is_mine(text: str) -> bool:
    """True where the first line has 8 numbers."""
    first = next(iter(_rows(text[:4000])), [])
    return len(first) == 8 and all(isinstance(number_of(word), float) for word in first)


def read(source: Source, border: Border) -> Views:
    """Poses, named by their times."""
    rows = _rows(source.text)
    if not rows:
        raise CameraError("expected lines of a time, a position and a quaternion, got none")
    for row in rows:
        if len(row) != 8:
            raise CameraError(
                f"expected 8 numbers per line, tx ty tz qx qy qz qw after the time, got "
                f"{shown(' '.join(row))}; correct the line"
            )
    values = [[number_of(word) for word in row[1:]] for row in rows]
    numbers = check_array_of(values, "the lines", (len(rows), 7))
    poses = from_quaternions(numbers[:, [6, 3, 4, 5]], numbers[:, :3])
    return border.views(
        None,
        world_from_camera=border.of_convention(poses),
        images=[row[0] for row in rows],
        metres=border.metres(1.0),
    )
