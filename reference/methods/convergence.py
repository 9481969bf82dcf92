"""Convergence of counted figures: their error over the density of samples.

The same partly hidden faces are counted with more samples per pixel and in larger images. The error
of a count along an edge at an irrational slope is random, so that of a fraction falls as the power
1.5 of the samples per side: a face of n samples per side has n^2 of them, of which the n along its
edges are uncertain, sqrt(n) / n^2.

D. G. Kendall. On the Number of Lattice Points Inside a Random Oval. 1948.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rastercov.base import ByteArray, FloatArray, IntArray, frozen_record
from rastercov.core.camera import Camera, Poses
from rastercov.core.coverage.coverage import Observer, arrays_for
from rastercov.core.coverage.face_pass import FacePass, Measured
from rastercov.core.mesh import Mesh

SWEEPS = {"supersampling": (1.0, 2.0, 4.0, 8.0), "resolution": (0.5, 1.0, 2.0, 4.0)}
"""Samples along a side of a camera pixel: S, or the scale of its width and height."""
MAX_SAMPLES = 1 << 27
"""Largest number of samples of an image; denser levels are left out."""
N_POSES = 8
"""Poses that are swept, spread over all."""
MIN_SAMPLES = 16
"""Samples of a face at the coarsest level of a sweep: the law holds for large numbers only."""
MIN_FACES = 20
"""Least number of faces for a fit."""
WANTED_FACES = 200
"""Number of faces below which smaller ones are added, down to 1 sample."""
GROUPS = 20
"""Groups of faces that are left out in turn for the standard error of the slope."""


def fractions(
    judge: FacePass, seen: Measured, poses: Poses
) -> tuple[FloatArray, FloatArray, ByteArray]:
    """Visible fraction (3.14) of each face: value, bound and kind, (P, F) each."""
    names = "visibility", "visibility_bound", "visibility_kind"
    figures = arrays_for(names, (len(poses), judge.mesh.n_faces))
    judge.fill(seen, poses, figures)
    value, bound, kind = figures.values()
    return value, bound, kind


@dataclass(frozen=True)
class Convergence:
    """Errors of the same partly hidden faces at L densities of samples."""

    method: str  # name of the rasteriser, such as `sampled:cpu`
    sweep: str  # key of `SWEEPS`: more samples a pixel, or more pixels
    samples_per_side: tuple[float, ...]  # along a side of a pixel of the camera, L
    rms: tuple[float, ...]  # of |value - truth| over the faces, L
    seconds_per_pose: tuple[float, ...]  # L
    poses: int
    faces: int
    least_area: float  # of the image of a face, px^2 of the camera
    slope: float | None  # of log rms over log samples_per_side; None with too few faces or levels
    slope_error: float | None  # its standard error


Opener = Callable[[Mesh, Camera, int], Observer]
"""Opens the rasteriser of a candidate for another camera, with another supersample."""


@frozen_record
class KnownFaces:
    """Partly hidden faces of one pose, (N,) each."""

    pose: FloatArray
    face: IntArray
    area: FloatArray
    truth: FloatArray


def levels(sweep: str, camera: Camera) -> tuple[float, ...]:
    """Levels of a sweep within `MAX_SAMPLES`."""
    most = math.sqrt(MAX_SAMPLES / (camera.width * camera.height))
    return tuple(scale for scale in SWEEPS[sweep] if scale <= max(most, SWEEPS[sweep][0]))


def converge(
    name: str,
    opener: Opener,
    sweep: str,
    mesh: Mesh,
    camera: Camera,
    known: Sequence[KnownFaces],
    step: Callable[[], None],
) -> Convergence:
    """Errors of counted figures at each level of a sweep, and the power law through them.

    `name` is that of the method, `sweep` a key of `SWEEPS`, `known` has true fractions of faces in
    some poses, and `step` is called after each pose of each level.
    """
    scales = levels(sweep, camera)
    least = MIN_SAMPLES / scales[0] ** 2
    while least * scales[0] ** 2 > 1 and sum((k.area >= least).sum() for k in known) < WANTED_FACES:
        least /= 4
    chosen = [np.flatnonzero(k.area >= least) for k in known]
    square = np.zeros((len(scales), sum(map(len, chosen))))
    seconds = []
    for level, scale in enumerate(scales):
        lens, supersample = camera, round(scale)
        if sweep == "resolution":
            lens, supersample = camera.resized(scale), 1
        spent, done = 0.0, 0
        with opener(mesh, lens, supersample) as observer:
            for faces, rows in zip(known, chosen, strict=True):
                began = time.perf_counter()
                seen = observer.observe(faces.pose[None])
                spent += time.perf_counter() - began
                value = fractions(FacePass(mesh, (lens,), 1), seen, Poses.of(faces.pose))[0][0]
                off = value[faces.face[rows]] - faces.truth[rows]
                square[level, done : done + len(rows)] = off**2
                done += len(rows)
                step()
        seconds.append(spent / max(1, len(known)))
    rms = np.sqrt(square.mean(axis=1)) if square.size else np.zeros(len(scales))
    slope, slope_error = _fit(scales, square)
    return Convergence(
        method=name,
        sweep=sweep,
        samples_per_side=scales,
        rms=tuple(rms.tolist()),
        seconds_per_pose=tuple(seconds),
        poses=len(known),
        faces=square.shape[1],
        least_area=least,
        slope=slope,
        slope_error=slope_error,
    )


def _fit(scales: Sequence[float], square: FloatArray) -> tuple[float | None, float | None]:
    """Slope of log rms over log scale by least squares, and its error by leaving out groups."""
    if len(scales) < 3 or square.shape[1] < MIN_FACES or (square.mean(axis=1) == 0).any():
        return None, None
    groups = np.arange(square.shape[1]) % GROUPS
    sums = np.stack([square[:, groups == group].sum(axis=1) for group in range(GROUPS)])
    without = sums.sum(axis=0) - sums
    if (without <= 0).any():
        return _slope(scales, square.mean(axis=1)), None
    slopes = np.array([_slope(scales, rest) for rest in without])
    error = math.sqrt((GROUPS - 1) * float(slopes.var()))
    return _slope(scales, square.mean(axis=1)), error


def _slope(scales: Sequence[float], square: FloatArray) -> float:
    return float(np.polyfit(np.log(scales), np.log(square) / 2, 1)[0])
