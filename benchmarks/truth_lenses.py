"""Pixels of rays through lenses: OpenCV and COLMAP against `project`, for each lens model."""

import lens_cases
import numpy as np
from compared import Compared, Comparison, amount
from lens_cases import BROWN, KANNALA, PRISM, RATIONAL, TILTED, K, rays
from lens_oracles import colmap_pixels, opencv_fisheye_pixels, opencv_pixels

from rastercov.core.camera.lenses.of_camera import LensModel

RAYS, RAYS_OF_COLMAP = 100_000, 5_000
THEIR_BOUND = 1e-11
"""Rounding of OpenCV and COLMAP in pixels."""
OURS = 2e-12
"""Bound of a projected pixel."""
FISHEYE = K * [[0.55, 1, 1], [1, 0.55, 1], [1, 1, 1]]


def of_opencv(effort: float) -> list[Compared]:
    """Both coordinates of pixels of random rays in front of the camera."""
    compared = Compared("pixels of rays, 6 models", "px")
    models = {"none": (), "brown": BROWN, "rational": RATIONAL, "prism": PRISM, "tilted": TILTED}
    for name, distortion in models.items():
        lens = lens_cases.opencv(K, distortion)
        given = seen_by(lens, amount(RAYS, effort))
        compare(compared, name, lens, given, opencv_pixels(K, distortion, given))
    lens = lens_cases.opencv(FISHEYE, KANNALA, fisheye=True)
    given = seen_by(lens, amount(RAYS, effort))
    given = given[given[:, 2] > 0.05]
    compare(compared, "fisheye", lens, given, opencv_fisheye_pixels(FISHEYE, KANNALA, given))
    return [compared]


def of_colmap(effort: float) -> list[Compared]:
    """The same for all models of COLMAP."""
    compared = Compared("pixels of rays, 18 models", "px")
    for model in lens_cases.COLMAP:
        lens = lens_cases.colmap(model)
        given = seen_by(lens, amount(RAYS_OF_COLMAP, effort))
        theirs = colmap_pixels(model, given)
        known = np.isfinite(theirs).all(axis=1)
        compare(compared, model, lens, given[known], theirs[known])
    return [compared]


def seen_by(lens: LensModel, count: int) -> np.ndarray:
    """Rays of which the lens has pixels."""
    given = rays(3 * count)
    return given[np.isfinite(lens.project(given)).all(axis=1)][:count]


def compare(
    compared: Compared, name: str, lens: LensModel, given: np.ndarray, theirs: np.ndarray
) -> None:
    if compared.add(lens.project(given), theirs, OURS + THEIR_BOUND).any():
        off = np.abs(lens.project(given) - theirs).max(axis=1)
        compared.faults.append(f"{name}: {given[off.argmax()]} off by {off.max():.2g} px")


COMPARISONS = [
    Comparison("OpenCV", "opencv-python-headless", of_opencv),
    Comparison("COLMAP", "pycolmap", of_colmap),
]
