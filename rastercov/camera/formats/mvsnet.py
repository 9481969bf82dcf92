"""Cameras of MVSNet: one text file an image, or a folder of them, with extrinsic and intrinsic.

Axes are ours and the matrix is camera_from_world. The file has no image size and no unit, and does
not say where pixels are counted from; its last line, the depths of the sweep, is left out.

Source: Y. Yao et al. MVSNet. 2018, README of the code, "File Formats".
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rastercov.base.errors import CameraError
from rastercov.base.files import printable
from rastercov.camera.camera import Camera
from rastercov.camera.formats.conventions import Border, inverse_of
from rastercov.camera.formats.entries import checked
from rastercov.camera.formats.source import Source
from rastercov.camera.views import Views

PATTERN = "*cam.txt"
MOST_FILES = 100_000


def is_mine(text: str) -> bool:
    """True for text that begins with the word extrinsic."""
    return text[:200].split(maxsplit=1)[:1] == ["extrinsic"]


def files_of(folder: Path) -> list[Path]:
    """Camera files of a folder, in order."""
    return sorted(path for path in folder.glob(PATTERN) if path.is_file())[:MOST_FILES]


def read(sources: Sequence[Source], border: Border) -> Views:
    """Cameras and poses of these files."""
    width, height = border.image_size("an MVSNet file")
    shift = border.pixel_shift("an MVSNet file")
    cameras: dict[Camera, int] = {}
    index, poses, images = [], [], []
    for source in sources:
        name = printable(source.path.name)
        words = source.text[:10_000].split()
        if len(words) < 27 or words[0] != "extrinsic" or words[17] != "intrinsic":
            raise CameraError(
                f"{name}: extrinsic with 16 numbers and intrinsic with 9 wanted, got "
                f"{len(words)} words"
            )
        extrinsic = checked(_numbers(words[1:17]), f"{name}: extrinsic", (16,)).reshape(4, 4)
        k = checked(_numbers(words[18:27]), f"{name}: intrinsic", (9,)).reshape(3, 3)
        if k[1, 0] or not np.array_equal(k[2], (0, 0, 1)):
            raise CameraError(f"{name}: intrinsic must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
        (fx, skew, cx), (_, fy, cy) = k[:2].tolist()
        camera = Camera(
            width=width,
            height=height,
            fx=fx,
            fy=fy,
            cx=cx + shift,
            cy=cy + shift,
            skew=skew,
        )
        index.append(cameras.setdefault(camera, len(cameras)))
        poses.append(extrinsic)
        images.append(source.path.stem.removesuffix("cam").rstrip("_") or source.path.stem)
    return border.views(
        list(cameras),
        world_from_camera=inverse_of(np.array(poses)),
        camera=index,
        images=images,
    )


def _numbers(words: list[str]) -> list[float | str]:
    found: list[float | str] = []
    for word in words:
        try:
            found.append(float(word if "_" not in word else "x"))
        except ValueError:
            found.append(word)
    return found
