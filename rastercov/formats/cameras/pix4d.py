"""PROJECT_calibrated_camera_parameters.txt of Pix4Dmapper.

Each image has its name and size, K, k1 k2 k3, p1 p2, the center t and the rotation R of
m = K [R | -R t] X, camera_from_world with our axes. Lengths are metres in the frame that
PROJECT_offset.xyz moves; where pixels are counted from is not stated.

Source: Pix4Dmapper manual, "How are the internal and external camera parameters defined?".
"""

import numpy as np

from rastercov.base import CameraError, matmul, shown
from rastercov.core.camera import Border, Views, inverse_of, lens_camera
from rastercov.core.camera.conventions import motions
from rastercov.formats.cameras.source import Source, check_array_of, number_of

HEADER = "fileName imageWidth imageHeight"
LINES = (3, 3, 3, 3, 2, 3, 3, 3, 3)
"""Numbers on the lines of an image after its name: K, k, p, t, R."""


def is_mine(text: str) -> bool:
    """True for the first line that Pix4Dmapper writes."""
    return text.startswith(HEADER)


def read(source: Source, border: Border) -> Views:
    """Cameras and poses of the images."""
    lines = [line.split() for line in source.text.splitlines() if line.strip()]
    first = next((row for row, line in enumerate(lines) if _is_image(line)), len(lines))
    shift = border.pixel_shift()
    cameras, images, rotations, translations = [], [], [], []
    for start in range(first, len(lines), 10):
        *name, width, height = lines[start]
        label = " ".join(name)
        block = lines[start + 1 : start + 10]
        if not _is_image(lines[start]) or tuple(map(len, block)) != LINES:
            raise CameraError(
                f"expected 9 lines of numbers for each image, got other text at {shown(label)}; "
                "export the file again"
            )
        rows = [
            check_array_of([*map(number_of, words)], f"{label}: the numbers", (count,))
            for words, count in zip(block, LINES, strict=True)
        ]
        k, r = np.array(rows[:3]), np.array(rows[6:])
        p = {"fx": k[0, 0], "fy": k[1, 1], "skew": k[0, 1]}
        p |= {"cx": k[0, 2] + shift, "cy": k[1, 2] + shift}
        p |= dict(zip(("k1", "k2", "k3", "p1", "p2"), np.concatenate(rows[3:5]), strict=True))
        size = (int(width), int(height))
        cameras.append(lens_camera("opencv", size, {key: float(each) for key, each in p.items()}))
        images.append(label)
        rotations.append(r)
        translations.append(matmul(-r, rows[5]))
    if not images:
        raise CameraError("expected images after the header, got none; export the file again")
    poses = inverse_of(motions(rotations, translations))
    return border.views_of_images(cameras, images, world_from_camera=poses, metres=1.0)


def _is_image(line: list[str]) -> bool:
    return len(line) > 2 and line[-1].isdecimal() and line[-2].isdecimal()
