"""The pose of an installed camera from one photograph: `rastercov.locate`."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from rastercov.asbuilt import resection
from rastercov.asbuilt.alignment import MOST_SPREAD, Aligner, Optimum
from rastercov.asbuilt.photograph import brightness, read_photograph
from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InOneLine,
    PoseError,
    finite_number,
    frozen_record,
    norm,
    plural,
    shown,
)
from rastercov.base.files import file_text
from rastercov.base.typed import typed
from rastercov.core.camera import Camera, check_scene, valid_poses
from rastercov.core.mesh import Mesh

LEAST_RIGHT = 0.8
"""Share of the pairs that must agree."""
RIVAL = 2.0
"""Deviations, of points or of chance, by which any other optimum must be worse."""
LEAST_Z = 8.0
"""Deviations above chance that edges must agree."""
LEAST_EXPLAINED = 0.4
"""Share of the predicted edges that the photograph must show."""
MOST_TURNED_DEG = 8.0
"""Turn from the plan up to which a pose by edges is believed: twice the range that is searched."""
MOST_APART = 3.4
"""Pixels within which 95 % of the poses by halves of the edges must lie.

Of rendered photographs, those of wrong poses that the other conditions let pass lay 3.5 px away or
more.
"""
MOST_SPREAD_OF_POINTS = 0.01
"""Largest standard deviation of a pixel by points, as a share of the image's width."""
LEAST_ERROR = 1e-3
"""Least expected standard deviation of a pixel, px."""
POINTS = "u", "v", "x", "y", "z"
"""Columns of a file of points."""
CLICK = "click eight corners, at least four, in rastercov view, Photograph, for --points"


@frozen_record(repr=False)
class Located(InOneLine):
    """Pose of a camera as built.

    Attributes
    ----------
    pose : (4, 4) float64
        world_from_camera, the best found; that of the plan where none was.
    covariance : (6, 6) float64
        Of a small rotation (radians) and translation (metres) in camera axes, which multiply the
        pose from the right; inf where nothing is known.
    residuals : (N, 2) float64
        Reprojection errors of the pairs of points, px; (0, 2) by edges alone.
    is_inlier : (N,) bool
        Pairs that agree with the pose.
    accepted : bool
        True where the pose is believed.
    why : str
        Why not; "" if it is.
    poses : (K, 4, 4) float64
        All optima, the believed one first.
    spread : float
        Largest standard deviation of the pixel of a visible point of the model, px.
    explained : float
        Share of the predicted edges that the photograph shows; NaN by points alone.
    near : (4, 4) float64 or None
        Pose of the plan.
    distance : float
        Typical distance of the surface from the camera, metres.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=40)
    >>> corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0.5)]
    >>> pairs = np.hstack(([(320, 240), (400, 250), (310, 320), (390, 330)], corners))
    >>> located = rc.locate(rc.shapes.box(), camera, np.zeros((480, 640)), points=pairs)
    >>> located.pose.shape, located.covariance.shape
    ((4, 4), (6, 6))
    """

    pose: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    is_inlier: BoolArray
    accepted: bool
    why: str
    poses: FloatArray
    spread: float
    explained: float
    near: FloatArray | None
    distance: float

    @property
    def is_distance_open(self) -> bool:
        """True of parallel rays: no picture depends on the distance, which is that of the plan."""
        return np.isinf(np.diag(self.covariance)).tolist() == [False] * 5 + [True]

    @property
    def moved(self) -> float:
        """Distance of the camera from that of the plan, metres; NaN without one.

        Across the axis, where the distance along it is open.
        """
        return float(norm(self._to_plan()[3 : 5 if self.is_distance_open else 6]))

    @property
    def turned_deg(self) -> float:
        """Angle between the axes of the camera and of the plan's, degrees; NaN without a plan."""
        return math.degrees(float(norm(self._to_plan()[:3])))

    def _to_plan(self) -> FloatArray:
        """Step (6,) to the plan's pose; NaN without one."""
        return (
            np.full(6, np.nan) if self.near is None else resection.difference(self.pose, self.near)
        )

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of the place, metres, and of the direction, degrees."""
        variances = np.diag(self.covariance)[: 5 if self.is_distance_open else 6]
        place, turn = float(variances[3:].sum()), float(variances[:3].sum())
        return math.sqrt(place), math.degrees(math.sqrt(turn))

    def to_plan_deg(self) -> tuple[float, float, float]:
        """Turns that bring the camera's axes back to the plan's: right, up, clockwise, degrees."""
        back = resection.displaced(np.eye(4), self._to_plan())
        ahead, right = back[:3, 2], back[:3, 0]
        across = ahead[0], -ahead[1], right[1]
        along = ahead[2], math.hypot(ahead[0], ahead[2]), math.hypot(right[0], right[2])
        yaw, pitch, roll = np.degrees(np.arctan2(across, along)).tolist()
        return yaw, pitch, roll

    def words(self) -> str:
        """The pose beside the plan in one line, or why there is none."""
        if not self.accepted:
            return self.why
        place, turn = (2 * each for each in self.deviations)
        found = f"± {_length(place)}, ± {turn:.2g} deg, two standard deviations"
        if self.is_distance_open:
            found += "; the distance along parallel rays is open, that of the plan is kept"
        if self.near is None:
            return f"found ({found})"
        sides = ("right", "left"), ("up", "down"), ("clockwise", "counter-clockwise")
        turns = [
            f"{abs(angle):.2g} deg {side[angle < 0]}"
            for angle, side in zip(self.to_plan_deg(), sides, strict=True)
            if abs(angle) >= 0.05
        ]
        back = f": turn {', '.join(turns)}" if turns else ""
        return (
            f"{_length(self.moved)} from the plan, turned {self.turned_deg:.2g} deg ({found}){back}"
        )

    def to_json(self) -> ByName:
        """The record of a file; numbers may be infinite or NaN."""
        place, turn = self.deviations
        return {
            "accepted": self.accepted,
            "why": self.why,
            "world_from_camera": self.pose.tolist(),
            "covariance": np.where(np.isfinite(self.covariance), self.covariance, -1).tolist(),
            "place_deviation_m": place,
            "turn_deviation_deg": turn,
            "pixel_deviation_px": self.spread,
            "explained": self.explained,
            "moved_m": self.moved,
            "turned_deg": self.turned_deg,
            "residuals_px": self.residuals.tolist(),
            "is_inlier": self.is_inlier.tolist(),
            "poses": self.poses.tolist(),
        }


def _length(metres: float) -> str:
    """A length in millimetres, or in metres from one on."""
    return f"{metres:.3g} m" if metres >= 1 else f"{metres * 1000:.3g} mm"


@typed
def locate(
    mesh: Mesh,
    camera: Camera,
    photo: Path | ArrayLike,
    near: ArrayLike | None = None,
    points: Path | ArrayLike | None = None,
    *,
    pixel_error: float = 1.0,
) -> Located:
    """Pose from which a photograph of a mesh was taken.

    With points the pose is that of least reprojection errors; without, that in which the edges of
    the mesh lie on edges of the photograph, near the pose of the plan (within about 4 degrees and
    6 % of the distance). It is `accepted` only where the photograph decides it.

    Parameters
    ----------
    mesh : Mesh
    camera : Camera
        Calibrated, of the size of the photograph.
    photo : path or (H, W) or (H, W, 3) array_like
        Picture file, or brightness or colours.
    near : (4, 4) array_like, optional
        Pose of the plan, world_from_camera. Needed without points, and for parallel rays.
    points : path or (N, 5) array_like, optional
        Pairs u, v, x, y, z: pixel from the top-left corner of the image, and point of the model in
        metres; a CSV file with these columns.
    pixel_error : float
        Expected standard deviation of a coordinate of these pixels, px.

    Raises
    ------
    ConfigError
        For a picture of another size, fewer than four points, or no pose to begin with.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.3, 0.1))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=40)
    >>> pose = rc.look_at((0.6, 0.5, 0.4), (0, 0, 0))[0]
    >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
    ...     face = rasterizer.render(pose).face
    >>> photo = np.append(mesh.normals @ (0.3, 0.5, 0.8) + 1, 0)[face]  # the last is background
    >>> planned = rc.look_at((0.605, 0.5, 0.4), (0, 0.002, 0))[0]
    >>> found = rc.locate(mesh, camera, photo, planned)
    >>> found.accepted, round(found.moved * 1000)
    (True, 5)
    """
    check_scene(mesh, camera)
    if not LEAST_ERROR <= finite_number(pixel_error) < camera.width:
        raise ConfigError(
            f"expected pixel_error from {LEAST_ERROR} px to the width of the image, got "
            f"{pixel_error}"
        )
    starts = [] if near is None else list(valid_poses(near))
    if len(starts) > 1:
        raise PoseError(f"near: expected one pose, got {len(starts)}; give that of the plan")
    start = next(iter(starts), None)
    pairs = None if points is None else read_points(points)
    if isinstance(photo, (str, Path)):
        grey = read_photograph(photo, camera)
    else:
        grey = brightness(cast("ArrayLike", photo), camera)
    if pairs is not None:
        return _by_points(mesh, camera, pairs, start, pixel_error)
    if start is None:
        raise ConfigError(
            "expected a pose to begin with, or points, got neither; give near= or points="
        )
    return _by_edges(Aligner(mesh, camera, grey), start)


def read_points(points: Path | ArrayLike) -> FloatArray:
    """Pairs (N, 5) of pixels and points, of an array or a CSV file with columns u, v, x, y, z."""
    if isinstance(points, (str, Path)):
        pairs = _read_csv(Path(points))
    else:
        pairs = np.asarray(points, np.float64)
    if pairs.ndim != 2 or pairs.shape[1] != len(POINTS) or not np.isfinite(pairs).all():
        raise ConfigError(
            f"expected points as (N, 5) finite numbers u, v, x, y, z, got {pairs.shape}"
        )
    if len(pairs) < resection.LEAST_PAIRS:
        raise ConfigError(
            f"expected at least {resection.LEAST_PAIRS} points, got {len(pairs)}; eight are better"
        )
    return pairs


def _read_csv(path: Path) -> FloatArray:
    """Pairs of a CSV file."""
    try:
        rows = list(csv.DictReader(file_text(path).splitlines()))
    except (ValueError, csv.Error) as error:
        wanted = f"expected points in {shown(str(path))}"
        raise ConfigError(f"{wanted}, got: {error}") from error
    missing = [name for name in POINTS if not rows or name not in rows[0]]
    if missing:
        raise ConfigError(f"{path}: expected columns {', '.join(POINTS)} (px, m), got no {missing}")
    try:
        return np.array([[float(row[name]) for name in POINTS] for row in rows])
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: expected numbers in every row, got: {error}") from error


def _by_points(
    mesh: Mesh, camera: Camera, pairs: FloatArray, near: FloatArray | None, sigma: float
) -> Located:
    """Pose by pairs of points."""
    pixels, points = pairs[:, :2], pairs[:, 2:]
    if near is None and camera.is_parallel:
        raise ConfigError(
            "expected the pose of the plan for a camera of parallel rays, got none; give near="
        )
    starts = resection.starts_of(points, pixels, camera, near, sigma)
    optima = resection.fit(points, pixels, camera, starts, sigma)
    if not optima:
        return _nothing(len(pairs), near, "the points have no pose from which they are seen so")
    best = optima[0]
    spread = resection.spread_of(best.covariance, points, camera, best.pose)
    pose = best.pose
    if near is not None and camera.is_parallel:
        along = resection.difference(pose, near)[5]
        pose = resection.displaced(pose, np.array((0, 0, 0, 0, 0, along)))
    return Located(
        pose,
        best.covariance,
        best.residuals,
        best.is_inlier,
        not (why := _doubt_of_points(optima, camera, spread)),
        why,
        np.array([each.pose for each in optima]),
        spread,
        math.nan,
        near,
        float(norm(points - pose[:3, 3]).mean()),
    )


def _nothing(n: int, near: FloatArray | None, why: str) -> Located:
    """No pose was found."""
    pose = np.eye(4) if near is None else near
    return Located(
        pose, np.full((6, 6), np.inf), np.full((n, 2), np.nan), np.zeros(n, bool), False, why,
        np.empty((0, 4, 4)), math.inf, math.nan, near, math.nan,
    )  # fmt: skip


def _doubt_of_points(optima: Sequence[resection.Fit], camera: Camera, spread: float) -> str:
    """Reason why a pose by points is not believed; "" if it is."""
    best = optima[0]
    right, n = int(best.is_inlier.sum()), len(best.is_inlier)
    wrong = [str(row + 1) for row in np.flatnonzero(~best.is_inlier).tolist()]
    if right < resection.LEAST_PAIRS or right < LEAST_RIGHT * n:
        return f"only {right} of {plural(n, 'point')} agree with one pose; check {', '.join(wrong)}"
    if not spread <= MOST_SPREAD_OF_POINTS * camera.width:
        return "the points do not fix the pose: they lie on a line, or too close together"
    rivals = [
        each
        for each in optima[1:]
        if each.is_inlier.sum() == right and each.cost - best.cost < RIVAL**2
    ]
    if rivals:
        return f"{plural(len(rivals) + 1, 'pose')} explain the points as well; add points elsewhere"
    return ""


def _by_edges(aligner: Aligner, near: FloatArray) -> Located:
    """Pose by edges."""
    optima, distance = aligner.find(near)
    if not optima:
        return _nothing(0, near, f"the plan's pose shows too few edges of the model; {CLICK}")
    best = optima[0]
    why = _doubt_of_edges(aligner, optima, distance)
    found = Located(
        best.pose,
        best.covariance,
        np.empty((0, 2)),
        np.empty(0, bool),
        not why,
        why,
        np.array([each.pose for each in optima]),
        best.spread,
        best.explained,
        near,
        distance,
    )
    if found.turned_deg > MOST_TURNED_DEG:
        return replace(found, accepted=False, why=f"edges do not tell so large a turn; {CLICK}")
    return found


def _doubt_of_edges(aligner: Aligner, optima: Sequence[Optimum], distance: float) -> str:
    """Reason why a pose by edges is not believed; "" if it is."""
    best = optima[0]
    if not best.explained >= LEAST_EXPLAINED:
        return f"the photograph shows {100 * best.explained:.0f} % of the expected edges; {CLICK}"
    if not best.spread <= MOST_SPREAD:
        return f"its edges fix the pose to ± {best.spread:.2g} px only; {CLICK}"
    chance = aligner.chance(best.pose, distance)
    deviation = max(chance.std(), 1e-9)
    if best.score - chance.mean() < LEAST_Z * deviation:
        return f"its edges agree with the photograph hardly better than displaced ones; {CLICK}"
    apart = aligner.by_halves(best.pose)
    if not apart <= MOST_APART:
        return f"poses by halves of its edges lie up to {apart:.2g} px off; {CLICK}"
    rivals = [
        each
        for each in optima[1:]
        if best.score - each.score < RIVAL * deviation
        and aligner.lead(best.pose, each.pose) < RIVAL
    ]
    if rivals:
        return f"{plural(len(rivals) + 1, 'pose')} agree as well; {CLICK}"
    return ""


@dataclass(frozen=True)
class Tolerance:
    """Within what the installed camera counts as the planned one.

    Attributes
    ----------
    place : float
        Metres.
    turn_deg : float
        Degrees.
    """

    place: float
    turn_deg: float

    def to_json(self) -> ByName:
        """The record of a file."""
        return {"place_m": self.place, "turn_deg": self.turn_deg}

    def words(self, found: Located) -> str:
        """The pose beside the plan in one line, and as much as the verdict on it asks for."""
        words, verdict = found.words(), self.verdict(found)
        if verdict == "as planned":
            return words.split(": turn")[0]
        if verdict == "undecided" and found.accepted:
            limit = f"{_length(self.place)} and {self.turn_deg:.3g} deg"
            words += f"; its error reaches across the limit of {limit}"
        return words

    def verdict(self, found: Located) -> str:
        """Verdict "as planned", "moved" or "undecided", by two standard deviations of the pose."""
        if not found.accepted:
            return "undecided"
        excess = np.array((found.moved - self.place, found.turned_deg - self.turn_deg))
        margin = 2 * np.array(found.deviations)
        if (excess > margin).any():
            return "moved"
        return "as planned" if (excess < -margin).all() else "undecided"
