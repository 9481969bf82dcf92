"""Plain text: Bundler's bundle.out, problems of Bundle Adjustment in the Large (BAL), and MVSNet.

The first two have the same camera: looking along -z with y up, camera_from_world, a focal length,
two radial coefficients, and pixels from the middle of the image, whose size they do not have; nor a
unit. MVSNet has one file per image, or a folder of them, with extrinsic and intrinsic.

Sources: N. Snavely. Bundler v0.4 User's Manual. 2010. S. Agarwal et al. Bundle Adjustment in the
Large. 2010. Y. Yao et al. MVSNet. 2018, README of the code, "File Formats".
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rastercov.base import (
    CameraError,
    FloatArray,
    dots,
    errors_as,
    matmul,
    norm,
    plural,
    printable,
    shown,
)
from rastercov.core.camera import Border, Views, from_vectors, inverse_of, lens_camera
from rastercov.core.camera.conventions import OPENGL_AXES, motions
from rastercov.formats.cameras.source import Source, check_array_of, number_of

HEADER = "# Bundle file"
MOST_COMPARED = 20_000
"""Points and observations of a problem of BAL that are compared with its cameras."""
FEWEST_COMPARED = 8
CLEARLY_LESS = 0.5
"""Share of one error that another is below where a file decides between two readings."""
PATTERN = "*cam.txt"
MOST_FILES = 100_000


def is_bal(text: str) -> bool:
    """True for text that begins with three counts on a line, then the ids of an observation."""
    return re.match(r"\s*(\d+[^\S\n]+){2}\d+\s*\n\s*\d+\s+\d+\s", text[:400]) is not None


def read_bundler(source: Source, border: Border) -> Views:
    """Cameras and poses of a bundle.out; cameras with focal length 0 were not found."""
    (n_cameras, n_points), rest = _counts(source.text.partition("\n")[2], "cameras and points")
    values = _numbers(rest, n_cameras, 15)
    n_lines = sum(bool(line.strip()) for line in rest.split("\n"))
    if n_lines != (wanted := 5 * n_cameras + 3 * n_points):
        border.note(
            f"{n_cameras} cameras and {n_points} points need {wanted} lines, the file has "
            f"{n_lines}; cameras may be missing"
        )
    is_found = values[:, 0] != 0
    if not is_found.any():
        raise CameraError(
            "expected cameras with a focal length, got none; export the cameras again"
        )
    if not is_found.all():
        border.note(
            f"{plural((~is_found).sum(), 'image')} without a camera left out: their focal length "
            "is 0"
        )
    rows = np.flatnonzero(is_found)
    poses = motions(values[rows, 3:12].reshape(-1, 3, 3), values[rows, 12:15])
    return _views(values[rows, :3], poses, [f"image {row}" for row in rows], border)


def read_bal(source: Source, border: Border) -> Views:
    """Cameras and poses of a problem of BAL.

    The documented radii are in units of the focal length; the observations of a file show where
    its coefficients are of radii in pixels, see `_by_focal_length`.
    """
    counts, rest = _counts(source.text, "cameras, points and observations")
    n_cameras, n_points, n_observations = counts
    lines = rest.split("\n", n_observations)
    if len(lines) <= n_observations:
        raise CameraError(
            f"expected {n_observations} lines of observations, got {len(lines) - 1}; the file is "
            "truncated, export it again"
        )
    values = _numbers(lines[-1], n_cameras, 9)
    poses = from_vectors(values[:, :3], values[:, 3:6])
    lenses, n_compared = values[:, 6:9], min(n_points, MOST_COMPARED)
    words = lines[-1].split(maxsplit=values.size + 3 * MOST_COMPARED)[values.size :]
    points = _matrix([words[3 * row : 3 * row + 3] for row in range(n_compared)], 3)
    observations = _matrix([line.split() for line in lines[:-1][:MOST_COMPARED]], 4)
    if len(points) and len(observations):
        lenses = _by_focal_length(lenses, poses, points, observations, border)
    return _views(lenses, poses, [f"image {row}" for row in range(n_cameras)], border)


def _matrix(rows: list[list[str]], columns: int) -> FloatArray:
    """(N, columns) float64; (0, columns) where a word is no number, or one is missing."""
    try:
        return np.array(rows, np.float64).reshape(-1, columns)
    except ValueError:
        return np.empty((0, columns))


def _by_focal_length(
    lenses: FloatArray,
    camera_from_world: FloatArray,
    points: FloatArray,
    observations: FloatArray,
    border: Border,
) -> FloatArray:
    """f, k1 and k2 of cameras, (N, 3), of radii in units of the focal length.

    A published problem, dubrovnik-3-7-pre.txt, has k1 and k2 of radii in pixels, whatever the
    formula of its page: with it, observations near the border are missed by tens of pixels. So both
    readings project the points, and that of pixels is taken where it meets the observations
    (camera, point, u, v) clearly better.
    """
    which = observations[:, :2]  # NaN is nowhere
    exists = ((which >= 0) & (which < [len(lenses), len(points)])).all(axis=1)
    (row, point), seen = which[exists].astype(np.int64).T, observations[exists, 2:]
    f, k1, k2 = lenses[row].T
    with np.errstate(all="ignore"):
        motion = camera_from_world[row]
        inside = dots(motion[:, :3, :3], points[point][:, None]) + motion[:, :3, 3]
        p = -inside[:, :2] / inside[:, 2:]
        errors = []
        for scale in (np.ones_like(f), f):
            r2 = dots(p, p) * scale**2
            values = (f * (1 + k1 * r2 + k2 * r2 * r2))[:, None] * p
            error = norm(values - seen)[inside[:, 2] < 0]
            errors.append(float(np.median(error)) if len(error) >= FEWEST_COMPARED else np.nan)
    documented, in_pixels = errors
    if not in_pixels < CLEARLY_LESS * documented:
        return lenses
    border.note(
        f"took k1 and k2 for radii in pixels: the median reprojection error is "
        f"{in_pixels:.2g} px, against {documented:.2g} px by the documented formula"
    )
    return lenses * np.column_stack([lenses[:, 0] ** power for power in (0, 2, 4)])


def _counts(text: str, what: str) -> tuple[list[int], str]:
    """Numbers with which a text begins, one for each word of `what`, and the rest of it."""
    n = what.count(" ") + 1 - what.count(" and ")
    words = text.split(maxsplit=n)
    if len(words) < n or not all(word.isdecimal() and len(word) < 10 for word in words[:n]):
        raise CameraError(
            f"expected the numbers of {what}, got {shown(' '.join(words[:n]))}; export the file "
            "again"
        )
    return [int(word) for word in words[:n]], "".join(words[n:])


def _numbers(text: str, n_cameras: int, per_camera: int) -> FloatArray:
    """(n_cameras, per_camera) of the words of a text."""
    wanted = n_cameras * per_camera
    words = text.split(maxsplit=wanted)[:wanted] if 2 * wanted - 1 <= len(text) else []
    if n_cameras < 1 or len(words) < wanted:
        raise CameraError(
            f"expected {n_cameras} cameras, got numbers for fewer; the file is truncated, export "
            "it again"
        )
    return check_array_of([*map(number_of, words)], "numbers of cameras", (wanted,)).reshape(
        n_cameras, per_camera
    )


def _views(lenses: FloatArray, poses: FloatArray, images: list[str], border: Border) -> Views:
    """Views of f k1 k2 and camera_from_world with OpenGL axes."""
    size, cameras = border.image_size(), []
    for image, (f, k1, k2) in zip(images, lenses.tolist(), strict=True):
        with errors_as(CameraError, image):
            cameras.append(lens_camera("opencv", size, {"f": f, "k1": k1, "k2": k2}))
    poses = matmul(inverse_of(poses), OPENGL_AXES)
    return border.views_of_images(cameras, images, world_from_camera=poses)


def is_mvsnet(text: str) -> bool:
    """True for text that begins with the word extrinsic."""
    return text[:200].split(maxsplit=1)[:1] == ["extrinsic"]


def mvsnet_files(folder: Path) -> list[Path]:
    """Camera files of a folder, in order."""
    return sorted(path for path in folder.glob(PATTERN) if path.is_file())[:MOST_FILES]


def read_mvsnet(sources: Sequence[Source], border: Border) -> Views:
    """Cameras and poses of these files.

    Axes are ours and the matrix is camera_from_world. A file has no image size and no unit, and
    does not say where pixels are counted from; its last line, the depths of the sweep, is left out.
    """
    size = border.image_size("an MVSNet file")
    shift = border.pixel_shift("an MVSNet file")
    cameras, poses, images = [], [], []
    for source in sources:
        name = printable(source.path.name)
        words = source.text[:10_000].split()
        if len(words) < 27 or words[0] != "extrinsic" or words[17] != "intrinsic":
            raise CameraError(
                f"{name}: expected extrinsic with 16 numbers and intrinsic with 9, got "
                f"{len(words)} words; correct it"
            )
        numbers = [number_of(word) for word in words]
        poses.append(check_array_of(numbers[1:17], f"{name}: extrinsic", (16,)).reshape(4, 4))
        k = check_array_of(numbers[18:27], f"{name}: intrinsic", (9,)).reshape(3, 3)
        if k[1, 0] or not np.array_equal(k[2], (0, 0, 1)):
            raise CameraError(
                f"{name}: expected intrinsic to be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], got "
                f"{k.tolist()}"
            )
        (fx, skew, cx), (_, fy, cy) = k[:2].tolist()
        p = {"fx": fx, "fy": fy, "cx": cx + shift, "cy": cy + shift, "skew": skew}
        cameras.append(lens_camera("pinhole", size, p))
        images.append(source.path.stem.removesuffix("cam").rstrip("_") or source.path.stem)
    inverse = inverse_of(np.array(poses))
    return border.views_of_images(cameras, images, world_from_camera=inverse)
