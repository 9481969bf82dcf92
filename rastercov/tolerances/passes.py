"""Coverage that is certain under all installation errors, and that is possible under some.

Each camera is off by up to a distance, an angle and a share of its focal length, independently of
the others. A part of a face is sure if its camera covers it with all of these errors, and possible
if with some. The lower bound of each criterion is exact, except for two densities; the upper bound
is not. `rastercov/engine/tolerance` computes both, and docs/appendix/tolerance.md has the proof.
Nothing is searched: draws are given beside the bounds, and only they find an installation that
fails.

Images of lenses less a border, whose rays stay in the image whatever the errors of a camera.

A turn of a ray by an angle t moves its pixel by at most K t, K the most pixels per radian that the
lens has in its image, as long as the pixel stays there. The image alone bounds what such a lens
sees, so what an image less a border of K t shows is in the image with all errors. A focal length
that is longer by a share p is an image that is smaller by 1 + p. See docs/appendix/tolerance.md.
"""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rastercov.base import (
    TINY,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    FloatArray,
    IntArray,
    WholeArray,
    finite_number,
    norm,
    read_only,
    shown,
    sort_order,
)
from rastercov.core.area.polygons import frames_of, to_world
from rastercov.core.area.regions import GAP_REL, RegionPass
from rastercov.core.area.swept import MARGINS, from_both_sides, table_of
from rastercov.core.area.table import Criteria, Planes, Regions, join, take_rows
from rastercov.core.camera import (
    MODELS,
    Camera,
    Cameras,
    Poses,
    Rig,
    cameras_of,
    equipment_on,
    gates_of,
    names_of,
)
from rastercov.core.camera.lenses.of_camera import OPTICS, lens_of, planes_of
from rastercov.core.camera.lenses.planes import first_derivatives
from rastercov.core.camera.pose import pinhole_numbers
from rastercov.core.coverage.task import Reason, Rules, Task, tasks_of
from rastercov.core.mesh import Mesh
from rastercov.engine import solver_tolerance
from rastercov.tolerances.turned import nearest_of

MOST_LENSES = 256
STEPS = 8
"""Widths of borders are whole pixels, rounded up to an eighth of a power of two: cameras share
lenses."""


def check_lens(name: str, camera: Camera) -> None:
    """ConfigError for a lens of which more than the border of its image bounds what it sees."""
    if len(lens_of(camera).planes) > 1:
        raise ConfigError(
            "expected lenses up to 72 degrees off their axis with installation errors, got "
            f"{shown(name)}; check it without installation errors"
        )
    if any(each.record.arc_half > 0 for each in planes_of(camera)) or not lens_of(camera).is_whole:
        raise ConfigError(
            "expected lenses that are valid in all of the image with installation errors, got "
            f"{shown(name)}; crop its image"
        )


def scale_camera(camera: Camera, scale: float) -> Camera:
    """The camera with other focal lengths, and the depths in focus of its own."""
    near, far = camera.depth_of_field(None)
    focus = None if near <= 0 and math.isinf(far) else (float(near), float(far))
    kept = {name: getattr(camera, name) for name in (*OPTICS, "near")}
    focal = {"fx": camera.fx * scale, "fy": camera.fy * scale, "skew": camera.skew * scale}
    return Camera(**kept | focal, focus_range=focus)


def is_centred(camera: Camera) -> bool:
    """True where the image holds its principal point: a shorter focal length then shows more."""
    return 0 < camera.cx < camera.width and 0 < camera.cy < camera.height


def around_lens(camera: Camera, focal: float) -> tuple[Camera, bool]:
    """Pinhole whose image holds what a lens shows with errors of its focal length up to a share.

    And False where none does; the camera itself without distortion.
    """
    if not camera.is_curved:
        return camera, True
    first, *others = planes_of(scale_camera(camera, 1 - focal))
    holds_all = not others and (focal == 0 or is_centred(camera))
    return replace(first.camera, near=camera.near), holds_all


@lru_cache(maxsize=MOST_LENSES)
def pixels_a_radian(camera: Camera) -> float:
    """Bound of the pixels by which a turn of a ray moves it, a radian, where the image shows it.

    In parts of the ideal plane. A turn at the distance r from its middle moves the place by
    T = (1 + r^2)^(1/2) across and 1 + r^2 along; within a distance e, T changes by at most
    4 (r + e) e, and the first derivative J of pixels by e times the bound of the second.
    """
    plane, slopes = planes_of(camera)[0].record, planes_of(camera)[0].slopes
    rows, columns = np.indices(slopes.second.shape).reshape(2, -1)
    per = np.array([slopes.per_x, slopes.per_y])
    middle = np.column_stack([columns, rows]) + 0.5
    middle = np.array([slopes.low_x, slopes.low_y]) + middle / per
    is_met = plane.meets(middle[:, 0], middle[:, 1], (0.5 / per[0], 0.5 / per[1]))
    middle, second = middle[is_met], slopes.second[rows[is_met], columns[is_met]]
    e = float(np.hypot(*(0.5 / per)))
    J = first_derivatives(plane, middle).reshape(-1, 2, 2)
    size = np.linalg.norm(J, 2, axis=(1, 2)) if len(J) else np.zeros(0)
    pixels = lens_of(camera).project(np.column_stack([middle, np.ones(len(middle))]))
    reach = (size + second * e) * e
    beyond = np.maximum(-pixels, pixels - (camera.width, camera.height)).max(axis=1)
    is_shown = ~(beyond > reach)
    r = np.hypot(*middle.T)
    along = middle / np.maximum(r, TINY)[:, None]
    s = np.sqrt(1 + r * r)
    T = (
        s[:, None, None] * np.eye(2)
        + ((1 + r * r) - s)[:, None, None] * along[:, :, None] * along[:, None, :]
    )
    most = np.linalg.norm(J @ T, 2, axis=(1, 2)) + second * e * (1 + (r + e) ** 2)
    most += size * 4 * (r + e) * e
    value = float(most[is_shown].max(initial=0.0))
    if not value < math.inf:
        raise ConfigError(
            "expected a lens of bounded pixels per radian, got none; omit the installation errors"
        )
    return value


def inset(camera: Camera, size: FloatArray, nearest: float) -> Camera | None:
    """The lens with the part of its image that stays in the image of points that far, or farther.

    `size` are errors of a pose, (3,); None where no part does.
    """
    d, a, p = size.tolist()
    turn = a + (math.asin(min(1.0, d / nearest)) if nearest > 0 else math.pi / 2)
    border = math.ceil(pixels_a_radian(camera) * turn)
    step = max(1, 2 ** (border.bit_length() - 1) // STEPS)
    border = step * math.ceil(border / step)
    left, top = camera.cx / (1 + p) - border, camera.cy / (1 + p) - border
    width = math.floor(left + (camera.width - camera.cx) / (1 + p) - border)
    height = math.floor(top + (camera.height - camera.cy) / (1 + p) - border)
    if min(width, height) < 1 or (p > 0 and not is_centred(camera)):
        return None
    return replace(camera, width=width, height=height, cx=left, cy=top)


def shows(camera: Camera, points: FloatArray) -> BoolArray:
    """(N,) points in camera axes, (N, 3), that are in the image of a lens."""
    pixels = lens_of(camera).project(points)
    u, v = pixels[:, 0], pixels[:, 1]
    return (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)


MOST_ANGLE_DEG, MOST_FOCAL_PERCENT = 45.0, 50.0
"""Errors of a camera must be below them."""
LEAST_CHANCE = 0.5
OTHERS = "*"
"""All cameras that errors by name do not have."""
WIDE_PX = 4000
"""Longer side of the image that holds those of all errors, px; it has no criteria of pixels."""
ENDLESS = 1e9
"""Metres."""
NO_IMAGE = 2
SLOPE_MARGIN = 1.001
"""Factor on the size of that image: rounding."""


Amount = float | Sequence[float] | Mapping[str, float] | FloatArray
"""Error of all cameras, of each pose, or of each camera by name."""


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Greatest errors of an installation, or their standard deviations.

    Attributes
    ----------
    position_mm, angle_deg, focal_percent : float, (P,) sequence, or mapping of str to float
        Errors of the camera centre, of its rotation about any axis, and of its focal length: of all
        cameras, of each pose, or of each camera by its name, "*" for those that are not named.
    part_mm, part_deg : float
        Errors of the place of the part, and of its rotation about its middle.
    distribution : {"uniform", "normal"}
        uniform: errors are at most these. normal: these are standard deviations along, or about,
        each axis, and coverage is certain with the probability `chance`.
    chance : float
        Probability of the installations that count, [0.5, 1); for "normal".
    """

    position_mm: Amount = 0.0
    angle_deg: Amount = 0.0
    focal_percent: Amount = 0.0
    part_mm: float = 0.0
    part_deg: float = 0.0
    distribution: str = "uniform"
    chance: float = 0.99

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        if self.distribution not in ("uniform", "normal"):
            raise ConfigError(
                f"expected distribution uniform or normal, got {shown(self.distribution)}; use one"
            )
        chance = finite_number(self.chance)
        if not LEAST_CHANCE <= chance < 1:
            raise ConfigError(
                f"expected chance from {LEAST_CHANCE} to below 1, got {shown(self.chance)}; use "
                "0.99"
            )
        for name in ("position_mm", "angle_deg", "focal_percent", "part_mm", "part_deg"):
            given = getattr(self, name)
            _check_values(name, list(given.values()) if isinstance(given, Mapping) else given)

    def sizes(self, camera: Cameras, poses: Poses, pivot: FloatArray) -> FloatArray:
        """(P, 3) greatest errors of each pose: metres, radians, and a share of the focal length.

        Those of the part are errors of all cameras about the pivot, (3,), metres. Normal errors
        have a ball of each camera and kind; all hold together with the probability `chance`.
        """
        names = names_of(camera)
        columns = [
            _of_poses(name, getattr(self, name), names, poses)
            for name in ("position_mm", "angle_deg", "focal_percent")
        ]
        sizes = np.stack(columns, axis=1) * (1e-3, math.pi / 180, 1e-2)
        part = np.array([self.part_mm * 1e-3, math.radians(self.part_deg)])
        if self.distribution == "normal":
            n_balls = int((sizes > 0).sum() + (part > 0).sum())
            radius = _radii(self.chance ** (1 / max(n_balls, 1)))
            sizes, part = sizes * radius, part * radius[:2]
        away = norm(poses.eyes - pivot)
        sizes[:, 0] += part[0] + 2 * math.sin(part[1] / 2) * away
        sizes[:, 1] += part[1]
        if not (sizes[:, 1:] < (math.radians(MOST_ANGLE_DEG), 0.5)).all():
            raise ConfigError(
                f"expected errors below {MOST_ANGLE_DEG:g} degrees and {MOST_FOCAL_PERCENT:g} % of "
                f"the focal length, got {shown(self.angle_deg)} and {shown(self.focal_percent)}"
            )
        return sizes


def _radii(share: float) -> FloatArray:
    """Radii of the balls of a normal position and rotation vector, and of a normal number."""

    def within(radius: float) -> tuple[float, float]:
        """Probability that a vector of three normal numbers, and one number, are within it."""
        one = math.erf(radius / math.sqrt(2))
        return one - math.sqrt(2 / math.pi) * radius * math.exp(-radius * radius / 2), one

    items = []
    for kind in (0, 0, 1):
        low, high = 0.0, 40.0
        while high - low > 1e-12 * high:
            middle = (low + high) / 2
            low, high = (low, middle) if within(middle)[kind] >= share else (middle, high)
        items.append(high)
    return np.array(items)


def _check_values(name: str, given: object) -> FloatArray:
    """Errors as numbers, of one or a sequence; ConfigError for one below 0 or none."""
    is_one = isinstance(given, str) or not isinstance(given, Sequence | np.ndarray)
    values: Any = [given] if is_one else given
    result = np.array([finite_number(value) for value in values])
    if result.ndim != 1 or not ((result >= 0) & np.isfinite(result)).all():
        raise ConfigError(f"expected {name} of 0 or more, got {shown(given)}; correct it")
    return result


def _of_poses(name: str, given: Amount, names: Sequence[str], poses: Poses) -> FloatArray:
    """(P,) error of each pose, of a number for all, one for each, or one for each camera."""
    if isinstance(given, Mapping):
        if unknown := sorted(map(str, set(given) - {*names, OTHERS})):
            raise ConfigError(
                f"expected {name} of a camera of the rig ({', '.join(names[:5])}), got "
                f"{shown(unknown[0])}; correct the name"
            )
        by_camera = _check_values(name, [given.get(each, given.get(OTHERS, 0.0)) for each in names])
        return by_camera[poses.camera]
    if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str):
        values = _check_values(name, given)
        if len(values) != len(poses):
            raise ConfigError(
                f"expected {name} as a number, or one for each of {len(poses)} poses, got "
                f"{len(values)}"
            )
        return values
    return np.repeat(_check_values(name, given), len(poses))


class MountedRegions(NamedTuple):
    """Regions of P poses with errors, and what is known of each pose.

    Attributes
    ----------
    regions : Regions
    nearest : (P,) float64
        Distance of the surface from the camera centre, metres.
    figures : (P, 4) int64
        Edges that are an event for some camera centre, shadows, faces on which a shadow has no end,
        and where nothing is sure: 1 where the surface may reach the camera centre, `NO_IMAGE` where
        a lens has no part of its image that is far enough from the border.
    """

    regions: Regions
    nearest: FloatArray
    figures: IntArray


class TolerancePass:
    """Sure and possible regions of one mesh through its cameras by one task.

    Parameters are those of `RegionPass`.

    Raises
    ------
    ConfigError
        For what has no proof; see `check_provable`.
    """

    def __init__(
        self, mesh: Mesh, camera: Cameras, task: Task, *, threads: int | None = None
    ) -> None:
        self.mesh, self.camera, self.task = mesh, camera, task
        self.nominal = RegionPass(mesh, camera, task, threads=threads)
        check_provable(camera, task)
        if self.nominal.conditions:
            raise ConfigError(
                "expected no equipment with installation errors, got "
                f"{', '.join(equipment_on(camera))}; omit it"
            )

    def close(self) -> None:
        """Release the scratch memory."""
        self.nominal.close()

    def sure(self, poses: Poses, sizes: FloatArray, nominal: Regions) -> MountedRegions:
        """Parts covered with all errors, (P, 3), of the nominal regions of the same poses."""
        if not sizes.any():
            return MountedRegions(
                nominal, np.full(len(poses), np.inf), np.zeros((len(poses), 4), np.int64)
            )
        inside, is_blind = self._inset(poses, sizes, nominal)
        # An error without end leaves nothing.
        sizes = np.where(is_blind[:, None] & (np.arange(3) == 0), ENDLESS, sizes)
        result = self._find_mounted(poses, sizes, inside, inside.excess, is_sure=True)
        result.figures[is_blind, 3] = NO_IMAGE
        return result

    def alone(self, cameras: Sequence[Camera], index: WholeArray) -> tuple[Mesh, Cameras, Task]:
        """Scene of cameras in place of those of an index, which keep the thresholds of these."""
        rig, names = self.camera, [f"{row}" for row in range(len(cameras))]
        if not isinstance(rig, Rig) or not rig.tasks:
            return self.mesh, cameras, self.task
        own = zip(names, index.tolist(), strict=True)
        tasks = {name: rig.tasks[rig.names[at]] for name, at in own if rig.names[at] in rig.tasks}
        return self.mesh, Rig(cameras, names, tasks=tasks), self.task

    def _inset(
        self, poses: Poses, sizes: FloatArray, nominal: Regions
    ) -> tuple[Regions, BoolArray]:
        """The regions, of lenses those within the border of all errors; lenses with none, (P,)."""
        index = poses.camera
        curved = [at for at in range(len(poses)) if self.nominal.cameras[index[at]].is_curved]
        is_blind = np.zeros(len(poses), bool)
        if not curved:
            return nominal, is_blind
        rows, nearest, images = np.array(curved), nearest_of(nominal), []
        for at in curved:
            own = self.nominal.cameras[index[at]]
            image = inset(own, sizes[at], nearest[at])
            is_blind[at] = image is None
            images.append(image or own)
        scene = self.alone(images, index[rows])
        with closing(RegionPass(*scene, threads=self.nominal.threads)) as finder:
            result = finder.find(
                Poses.of(poses.world_from_camera[rows], camera=np.arange(len(rows)))
            )
        order = np.arange(len(poses))
        order[rows] = len(poses) + np.arange(len(rows))
        result = take_rows(join([nominal, result]), order)
        return replace(result, pose_ids=nominal.pose_ids), is_blind

    def possible(self, poses: Poses, sizes: FloatArray, nearest: FloatArray) -> MountedRegions:
        """Parts that are covered with some errors; `nearest` is that of `sure`."""
        cameras, focal = self.nominal.cameras, _focal_of(self.camera, poses, sizes)
        wide = [
            _wide_camera(
                around_lens(cameras[at], focal[at])[0],
                (d, a, p * (not cameras[at].is_curved)),
                away,
            )
            for at, (d, a, p), away in zip(
                poses.camera.tolist(), sizes.tolist(), nearest.tolist(), strict=True
            )
        ]
        finder = RegionPass(from_both_sides(self.mesh), wide, Task(), threads=self.nominal.threads)
        seen = finder.find(Poses.of(poses.world_from_camera, camera=np.arange(len(poses))))
        finder.close()
        return self._find_mounted(poses, sizes, seen, seen.bound, is_sure=False)

    def _find_mounted(
        self, poses: Poses, sizes: FloatArray, source: Regions, bound: FloatArray, *, is_sure: bool
    ) -> MountedRegions:
        """Regions of the engine, camera by camera, in the order of the poses."""
        own, order, parts = self.nominal, [], []
        focal = _focal_of(self.camera, poses, sizes)
        nearest, figures = np.empty(len(poses)), np.empty((len(poses), 4), np.int64)
        with_bound = replace(source, excess=bound)
        for index in np.unique(poses.camera).tolist():
            rows = np.flatnonzero(poses.camera == index)
            some, camera = poses[rows], own.cameras[index]
            pinhole, holds_all = around_lens(camera, focal[index])
            # With an error without end all is possible.
            errors = sizes[rows] + (0 if holds_all or is_sure else ENDLESS, 0, 0)
            criteria = Criteria(pinhole_numbers(pinhole), own._rules[index], GAP_REL)
            result = solver_tolerance.find(
                own._surface,
                own._planes(own._is_asked & own._is_left[index]),
                criteria,
                _mounts(some.world_from_camera, errors, camera),
                table_of(take_rows(with_bound, rows)),
                is_sure,
                own.threads,
            )
            arrays, nearest[rows], figures[rows] = result
            parts.append(own._join(some, arrays))
            order.append(rows)
        regions = take_rows(join(parts), sort_order(np.concatenate(order)))
        return MountedRegions(regions, nearest, figures)


def _focal_of(camera: Cameras, poses: Poses, sizes: FloatArray) -> FloatArray:
    """Greatest error of the focal length of each camera, (C,)."""
    focal = np.zeros(len(cameras_of(camera)))
    np.maximum.at(focal, poses.camera, sizes[:, 2])
    return focal


def _mounts(
    world_from_camera: FloatArray, sizes: FloatArray, camera: Camera
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """Poses of a camera for the engine; the pinhole around a lens has the errors of its focus."""
    errors = read_only(sizes * (1, 1, not camera.is_curved), np.float64)
    return read_only(world_from_camera, np.float64), errors, float(camera.near), MARGINS


def check_provable(camera: Cameras, task: Task) -> None:
    """ConfigError, in one line, for what the proof does not hold for."""
    tasks = tasks_of(camera, task)
    for name, each, its in zip(names_of(camera), cameras_of(camera), tasks, strict=True):
        if each.is_parallel:
            raise ConfigError(
                "expected central cameras with installation errors, got parallel rays of "
                f"{shown(name)}; check it without installation errors"
            )
        if not each.is_curved:
            continue
        check_lens(name, each)
        own = its.rules(each)
        if max(own.min_pixels_per_m2, own.min_pixel_density, own.min_facing_density) > 0:
            raise ConfigError(
                "expected no density threshold with a distorted lens and installation errors, got "
                f"one of {shown(name)}; undistort its images, or leave it out"
            )
        if not MODELS[each.model].is_planar and (own.z_n > 0 or own.z_f < math.inf):
            raise ConfigError(
                f"expected no focus limits with lens model {each.model} and installation errors, "
                f"got some of {shown(name)}; leave them out"
            )
    for gate in gates_of(camera).values():
        if gate.unproved:
            raise ConfigError(gate.unproved)


def _wide_camera(camera: Camera, size: Sequence[float], nearest: float) -> Camera:
    """Pinhole whose image holds every point that the camera may see with some errors.

    A direction turns by t = angle + asin(position / nearest) at most. For a border at the angle b
    from the axis, and directions within c of it, x / z is at most tan b + sin t / (cos b cos c).
    """
    position, angle, focal = size
    shift = 0.0 if position == 0 else math.asin(min(1.0, position / max(nearest, position)))
    turn = angle + shift
    halves = [
        math.atan(max(at, size - at) / (length * (1 - focal)))
        for at, size, length in (
            (camera.cx, camera.width, camera.fx),
            (camera.cy, camera.height, camera.fy),
        )
    ]
    corner = math.atan(math.hypot(*map(math.tan, halves))) + turn
    if corner >= 1.5:  # nothing is known of what is beside it: the engine leaves the pose out
        return Camera(width=8, height=8, fx=8, fy=8)
    slopes = [
        SLOPE_MARGIN * (math.tan(half) + math.sin(turn) / (math.cos(half) * math.cos(corner)))
        for half in halves
    ]
    focal_px = WIDE_PX / (2 * max(slopes))
    width, height = (math.ceil(2 * slope * focal_px) for slope in slopes)
    return Camera(width=width, height=height, fx=focal_px, fy=focal_px)


def unmet(
    mesh: Mesh,
    camera: Camera,
    rules: Rules,
    pose: FloatArray,
    size: FloatArray,
    points: FloatArray,
    face: IntArray,
) -> ByteArray:
    """(N,) first `Reason` that some errors of a pose, (3,), break at points that it covers.

    It is OCCLUDED where all other criteria hold with all errors: those of the table of
    docs/appendix/tolerance.md. Points, (N, 2), are in the planes of faces.
    """
    planes = Planes(*frames_of(mesh), mesh.two_sided_mask, mesh.task_mask)
    criteria = Criteria(pinhole_numbers(around_lens(camera, float(size[2]))[0]), rules, GAP_REL)
    result = np.empty(len(points), np.uint8)
    mount = _mounts(pose[None], size[None], camera)
    solver_tolerance.find_unmet(planes, criteria, mount, points, face, result)
    if camera.is_curved:
        at = (to_world(mesh, face, points) - pose[:3, 3]) @ pose[:3, :3]
        image = inset(camera, size, float(norm(at).min(initial=np.inf)))
        is_shown = np.array(image is not None and shows(image, at))
        result[(result > Reason.OUTSIDE) & ~is_shown] = Reason.OUTSIDE
    return result


UNITS = {
    "mm": ("position_mm", 1.0),
    "cm": ("position_mm", 10.0),
    "m": ("position_mm", 1e3),
    "deg": ("angle_deg", 1.0),
    "degrees": ("angle_deg", 1.0),
    "%": ("focal_percent", 1.0),
}
"""Units of errors in a text, and what they are of."""
IN_WORDS = re.compile(
    r"(?:(.+?)\s+)?([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(mm|cm|m|degrees|deg|%)"
)


def errors_in(text: str) -> Errors:
    """Errors of a text such as "2 mm, 0.2 deg, tripod 5 mm", "0.5 %, part 3 mm, normal".

    Raises
    ------
    ConfigError
        For a text that is something else.
    """
    figures: ByName = {}
    by_camera: dict[str, dict[str, float]] = {}
    for term in map(str.strip, re.split("[,;]", str(text))):
        if term in ("normal", "uniform"):
            figures["distribution"] = term
            continue
        match = IN_WORDS.fullmatch(term)
        of, number, unit = match.groups() if match else (None, "inf", "mm")
        name, factor = UNITS[unit]
        size = factor * float(number)
        if of == "part":
            name = name.replace("position", "part").replace("angle", "part")
        own = figures if of in (None, OTHERS, "part") else by_camera.setdefault(name, {})
        key = name if own is figures else of
        if not size < math.inf or key in own or (name == "focal_percent" and of == "part"):
            raise ConfigError(
                'expected errors of cameras, "2 mm, 0.2 deg, 1 %" (focal length), and "part 3 mm", '
                f"got {shown(text)}; give each kind once, in {', '.join(UNITS)}"
            )
        own[str(key)] = size
    if not (by_camera or figures.keys() - {"distribution"}):
        raise ConfigError(f'expected errors such as "2 mm, 0.2 deg", got {shown(text)}; add a size')
    for name, errors in by_camera.items():
        figures[name] = errors | {OTHERS: figures.get(name, 0.0)}
    return Errors(**figures)
