"""Area that a rig covers under any installation errors: `rastercov.tolerance`.

Bounds of `rastercov.tolerances.passes` for all cameras together, the least and the most that
draws find beside them, and the parts that are lost. Errors of cameras are independent, so a part is
covered by k cameras in every installation exactly if it is sure of k cameras.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rastercov.advice.before import lost_zones
from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    InNotebook,
    InOneLine,
    IntArray,
    check_seed,
    frozen_record,
    norm,
    percent,
    plural,
    shown,
)
from rastercov.core.area import polygons
from rastercov.core.area.polygons import frames_of, rows_at, to_world
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import CodeArray, Divided, ReasonPieces, failures_of_rows
from rastercov.core.area.table import Regions, take_rows
from rastercov.core.area.union import Covered
from rastercov.core.area.zones import DeadZones, points_of, zone_line
from rastercov.core.camera import (
    Cameras,
    Poses,
    cameras_of,
    check_scene,
    gates_of,
    names_of_poses,
)
from rastercov.core.coverage.task import BASELINE, NAMES, Reason, Task, name_of, nearer, rows_in
from rastercov.core.mesh import Mesh
from rastercov.tolerances.installation import displace
from rastercov.tolerances.passes import NO_IMAGE, Amount, Errors, TolerancePass, scale_camera, unmet
from rastercov.tolerances.turned import POSSIBLE, SURE, unite_regions

POSES_AT_ONCE = 256
"""Poses of draws whose regions are held at a time."""
HIDING, HIDING_POINTS = 16, 32
"""Displacements of a camera, and points of a zone, by which the group that hides it is found."""
MOST_LOST = 5
"""Lost zones in words."""
LEAST_LOST = 1e-5
"""Part of the nominal area from which a lost zone is named."""
NOT_SURE = len(NAMES) - 1


@dataclass(frozen=True)
class Extent:
    """An area of the evaluated faces with its bound.

    Attributes
    ----------
    m2, bound : float
        The area, and the bound of its error, m^2.
    whole : float
        Area of all evaluated faces, m^2.
    """

    m2: float
    bound: float
    whole: float

    def __float__(self) -> float:
        return self.m2

    def share(self) -> float:
        """Part of the area of the evaluated faces, [0, 1]."""
        return self.m2 / self.whole if self.whole > 0 else 0.0

    @classmethod
    def of(cls, covered: Covered, views: IntArray) -> "Extent":
        """Area that as many cameras as each face needs, (F,), cover."""
        scored = covered.mesh.task_mask
        whole = frames_of(covered.mesh).areas[scored].sum()
        bound = covered.bound[scored].sum()
        return cls(float(by_group(covered, views).sum()), float(bound), float(whole))


def by_group(covered: Covered, views: IntArray) -> FloatArray:
    """(G,) area of each evaluated group covered by the cameras each face needs, (F,), m^2."""
    mesh = covered.mesh
    m2 = covered.area[views - 1, np.arange(mesh.n_faces)] * mesh.task_mask
    return np.bincount(mesh.face_group, m2, len(mesh.groups)).astype(np.float64)


@frozen_record(repr=False)
class SureCoverage(InOneLine, InNotebook):
    """Area that a rig covers as planned, under any errors, and under some errors.

    Attributes
    ----------
    errors : Errors
        Limits of the errors, as given to `rastercov.tolerance`.
    sizes : (P, 3) float64
        Greatest errors of each pose: metres, radians, and a share of the focal length.
    nominal, sure, possible : Extent
        Area covered as planned, under any errors, and under some errors. Every installation within
        the errors covers at least `sure.m2 - sure.bound` and at most `possible.m2 +
        possible.bound`; with normal errors this holds with the probability `errors.chance`.
    draws : (N,) float64
        Area that each installation drawn at random covers, m^2.
    draws_by_group, sure_by_group : (N, G), (G,) float64
        The areas of each group, m^2; of what is sure, less their bounds.
    seed : int
        Seed of the draws.
    regions, nominal_regions : Regions
        Parts that each pose covers under any errors, and as planned.
    views : (F,) int64
        Number of cameras that must cover each face.
    nearest : (P,) float64
        Distance from each planned camera centre to the surface, metres.
    warnings : tuple of str
        Cameras of which nothing is proved, or nothing about some faces.
    """

    mesh: Mesh
    camera: Cameras
    task: Task
    poses: Poses
    errors: Errors
    sizes: FloatArray
    nominal: Extent
    sure: Extent
    possible: Extent
    draws: FloatArray
    draws_by_group: FloatArray
    sure_by_group: FloatArray
    seed: int
    regions: Regions
    nominal_regions: Regions
    views: IntArray
    nearest: FloatArray
    warnings: tuple[str, ...]

    @property
    def least(self) -> float:
        """Least area of the plan and all draws, m^2."""
        return float(self.draws.min(initial=self.nominal.m2))

    @property
    def most(self) -> float:
        """Greatest area of the plan and all draws, m^2."""
        return float(self.draws.max(initial=self.nominal.m2))

    def installation(self, row: int) -> tuple[Poses, FloatArray]:
        """Poses of the draw with index `row`, and focal lengths (P,) relative to those planned.

        ConfigError for an index beyond the draws.
        """
        for moved, scale in _draw_installations(
            self.errors, self.camera, self.poses, self.mesh.centre, len(self.draws), self.seed
        ):
            if row < len(moved):
                return Poses.of(moved[row], camera=self.poses.camera), scale[row]
            row -= len(moved)
        raise ConfigError(
            f"expected a draw below {len(self.draws)}, got {row + len(self.draws)}; choose one"
        )

    @cached_property
    def zones(self) -> DeadZones:
        """Connected parts that are covered as planned, but not under all errors; largest first.

        The reason of a part is the first criterion that some error breaks for the camera that comes
        nearest to covering it.
        """
        mesh, most = self.mesh, int(self.views.max(initial=1))
        scene = self.camera, self.poses, self.task, most
        planned = unite_regions(self.nominal_regions, *scene)
        sure = unite_regions(self.regions, *scene, (self.sizes, self.nearest, SURE))

        def divide(rest: ReasonPieces) -> Divided:
            return Divided(rest._replace(reason=_reasons(self, rest)), np.zeros(mesh.n_faces), {})

        return lost_zones(planned, sure, self.views, divide, NOT_SURE)

    def list_losses(self, n: int = MOST_LOST) -> list[ByName]:
        """Area, place, reason and hiding group of the first n zones, ready for JSON."""
        zones = self.zones
        n = min(n, int((zones.area > LEAST_LOST * self.nominal.m2).sum()))
        reasons = zones.reasons(n).tolist()
        hiders = _hiders(
            self, zones, [row for row in range(n) if Reason.OCCLUDED in rows_in(reasons[row])]
        )
        return [
            place | {"reason": name_of(reason), "hidden_by": hiders.get(row)}
            for row, (place, reason) in enumerate(zip(zones.places(n), reasons, strict=True))
        ]

    def lines(self) -> list[str]:
        """The result as lines of text."""
        sure = self.sure
        lost = 1 - sure.m2 / self.nominal.m2 if self.nominal.m2 > 0 else 0.0
        if self.errors.distribution == "normal":
            first = f"Covered in {percent(self.errors.chance)} of installations ({self.words()})"
        else:
            first = f"Covered under all errors up to {self.words()}"
        lines = [
            f"{first}: at least {self.size(sure.m2)} ({percent(sure.share())}), "
            f"{percent(lost)} less than the {self.size(self.nominal.m2)} without errors",
            f"At most {self.size(self.possible.m2)} is covered in any of these cases",
        ]
        if n := len(self.draws):
            drawn = f"{self.size(self.least)} to {self.size(self.most)}"
            lines.append(f"{plural(n, 'random installation', 'cover')} {drawn}")
        own = [zone_line(zone).removeprefix("dead zone ") for zone in self.list_losses()]
        return [*lines, *(f"may be uncovered: {line}" for line in own), *self.warnings]

    def size(self, m2: float) -> str:
        """Area as text, to a thousandth of the nominal area."""
        digits = max(0, 3 - math.floor(math.log10(self.nominal.m2))) if self.nominal.m2 > 0 else 0
        return f"{m2:,.{min(digits, 12)}f} m²"

    def words(self) -> str:
        """The errors as text, such as "2 mm, 0.2 deg per camera"."""
        return words_of(self.errors)

    def summary(self) -> ByName:
        """Figures without draws and polygons, ready for JSON."""
        given = {each.name: getattr(self.errors, each.name) for each in fields(Errors)}
        figures = {
            name: dict(amount) if isinstance(amount, Mapping) else np.asarray(amount).tolist()
            for name, amount in given.items()
        }
        figures |= {} if self.errors.distribution == "normal" else {"chance": None}
        for name in ("nominal", "sure", "possible"):
            part: Extent = getattr(self, name)
            figures[name] = {"m2": part.m2, "bound_m2": part.bound, "share": part.share()}
        figures |= {"draws": len(self.draws), "least_m2": self.least, "most_m2": self.most}
        return figures | {"lost": self.list_losses(), "warnings": list(self.warnings)}


def words_of(errors: Errors) -> str:
    """Errors in words."""
    sigma = "standard deviation " if errors.distribution == "normal" else ""
    kinds = (("position_mm", "mm"), ("angle_deg", "deg"), ("focal_percent", "% focal length"))
    every = []
    for name, unit in kinds:
        amount = getattr(errors, name)
        values = list(amount.values()) if isinstance(amount, Mapping) else np.ravel(amount).tolist()
        if values and max(values) > 0:
            low, high = f"{min(values):g}", f"{max(values):g}"
            every.append(f"{low if low == high else f'{low} to {high}'} {unit}")
    text = f"{sigma}{', '.join(every) or 'no error'} per camera"
    part = [
        f"{value:g} {unit}"
        for value, unit in ((errors.part_mm, "mm"), (errors.part_deg, "deg"))
        if value > 0
    ]
    return f"{text}; part {', '.join(part)}" if part else text


def tolerance(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    position_mm: Amount = 0.0,
    angle_deg: Amount = 0.0,
    focal_percent: Amount = 0.0,
    part_mm: float = 0.0,
    part_deg: float = 0.0,
    distribution: str = "uniform",
    chance: float = 0.99,
    draws: int = 200,
    seed: int = 0,
    threads: int | None = None,
) -> SureCoverage:
    """Area that given cameras cover under any installation errors, proved, not estimated.

    Position, rotation and focal length of each camera have errors up to the limits, independently
    of one another; so have position and rotation of the part. Form errors of the part are not
    included. Each sensor of a rig with a rule has its own errors.

    Parameters
    ----------
    mesh, camera, poses, task
        As for `evaluate`; `task.views` cameras must cover a point.
    position_mm, angle_deg, focal_percent : float, (P,) sequence, or mapping of str to float
        Maximum errors of the camera centre, mm, of the rotation about any axis, degrees, and of the
        focal length, percent: one for all cameras, one per pose, or one by name of the camera, with
        "*" for all others. 0 unless given.
    part_mm, part_deg : float
        Maximum errors of the position of the part, mm, and of its rotation about the centre of its
        bounding box, degrees; 0 unless given.
    distribution : {"uniform", "normal"}
        uniform: the values are maximum errors. normal: they are standard deviations along, or
        about, each axis, and the bounds hold with the probability `chance`.
    chance : float
        Probability for normal errors, [0.5, 1).
    draws : int
        Number of random installations that are computed as well, 0 or more; with uniform errors
        every second one has the maximum errors.
    seed : int
        The same seed gives the same draws.
    threads : int, optional
        As for `open_observer`.

    Returns
    -------
    SureCoverage
        Areas `nominal` as planned, `sure` under any errors and `possible` under some, each with
        `m2`, `bound` and `share()`; `least`, `most` and `draws` of the random installations; and
        `list_losses()`, `lines()` and `summary()`.

    Raises
    ------
    ConfigError
        For errors below 0, of 45 degrees or 50 % or more; and where there is no proof: for parallel
        rays, rigs with equipment or a limit of uncertainty, thresholds of whole faces, and pixel
        densities with distorted lenses.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=18)
    >>> poses = rc.look_at((0, 0, 0.8), (0, 0, 0))
    >>> tolerance = rc.tolerance(mesh, camera, poses, position_mm=2, angle_deg=0.2, draws=20)
    >>> tolerance.sure.m2 < tolerance.least < tolerance.nominal.m2 < tolerance.possible.m2
    True
    """
    errors = Errors(
        position_mm=position_mm,
        angle_deg=angle_deg,
        focal_percent=focal_percent,
        part_mm=part_mm,
        part_deg=part_deg,
        distribution=distribution,
        chance=chance,
    )
    task = Task() if task is None else task
    views = np.full(mesh.n_faces, task.views)
    return sure_coverage(
        mesh, camera, Poses.of(poses), task, errors, views, draws=draws, seed=seed, threads=threads
    )


def sure_coverage(
    mesh: Mesh,
    camera: Cameras,
    poses: Poses,
    task: Task,
    errors: Errors,
    views: IntArray,
    *,
    draws: int = 200,
    seed: int = 0,
    threads: int | None = None,
) -> SureCoverage:
    """As `tolerance`, with the number of cameras that each face needs, (F,)."""
    check_scene(mesh, camera)
    check_seed(seed)
    if not isinstance(draws, int | np.integer) or isinstance(draws, bool) or draws < 0:
        raise ConfigError(f"expected draws of 0 or more, got {shown(draws)}; use a whole number")
    pivot = mesh.centre
    sizes = errors.sizes(camera, poses, pivot)
    views = np.maximum(views, 2) if task.min_angle_deg > 0 else views
    most = int(views.max(initial=1))
    with closing(TolerancePass(mesh, camera, task, threads=threads)) as finder:
        nominal = finder.nominal.find(poses)
        sure = finder.sure(poses, sizes, nominal)
        possible = finder.possible(poses, sizes, sure.nearest)
        scene = camera, poses, task, most
        covered = [unite_regions(nominal, *scene)]
        for each, of in ((sure, SURE), (possible, POSSIBLE)):
            covered.append(unite_regions(each.regions, *scene, (sizes, sure.nearest, of)))
        installed = _draw_installations(errors, camera, poses, pivot, int(draws), seed)
        areas = _measure_installations(finder, camera, poses, views, installed)
    return SureCoverage(
        mesh=mesh,
        camera=camera,
        task=task,
        poses=poses,
        errors=errors,
        sizes=sizes,
        nominal=Extent.of(covered[0], views),
        sure=Extent.of(covered[1], views),
        possible=Extent.of(covered[2], views),
        draws=areas.sum(axis=1),
        draws_by_group=areas,
        sure_by_group=by_group(
            replace(covered[1], area=np.maximum(covered[1].area - covered[1].bound, 0.0)), views
        ),
        seed=seed,
        regions=sure.regions,
        nominal_regions=nominal,
        views=views,
        nearest=sure.nearest,
        warnings=tuple(_warnings(sure.figures, sizes, names_of_poses(poses))),
    )


def _warnings(figures: IntArray, sizes: FloatArray, names: tuple[str, ...]) -> Iterator[str]:
    """Cameras of which nothing is sure, or nothing of some faces."""
    for name, row, size in zip(names, figures.tolist(), sizes.tolist(), strict=True):
        if row[3] == NO_IMAGE:
            yield f"{name}: errors may move all of its view out of its image; nothing is certain"
        elif row[3]:
            yield (
                f"{name}: with its error of {1e3 * size[0]:.3g} mm, a surface may reach its centre "
                "or near plane; nothing that it covers is certain"
            )
        elif row[2]:
            yield f"{name}: {plural(row[2], 'nearly edge-on face', 'are')} left out as uncertain"


# --- draws ---

Installed = tuple[FloatArray, FloatArray]
"""Poses (k, P, 4, 4) of k installations, and their focal lengths relative to those planned."""


def _draw_installations(
    errors: Errors, camera: Cameras, poses: Poses, pivot: FloatArray, draws: int, seed: int
) -> Iterator[Installed]:
    """Installations a few at a time; of uniform errors, every other one is at the greatest."""
    rng = np.random.default_rng(seed)
    own = replace(errors, part_mm=0.0, part_deg=0.0, distribution="uniform")
    sizes = own.sizes(camera, poses, pivot)
    part = np.array([errors.part_mm * 1e-3, math.radians(errors.part_deg)])
    is_normal, n = errors.distribution == "normal", len(poses)
    step = max(1, POSES_AT_ONCE // max(1, n))

    def vectors(shape: tuple[int, ...], dims: int, at_most: BoolArray) -> FloatArray:
        normal = rng.normal(size=(*shape, dims))
        if is_normal:
            return normal
        radius = rng.random((*shape, 1)) ** (1 / dims)
        radius[at_most] = 1.0
        scaled: FloatArray = normal * radius / norm(normal)[..., None]
        return scaled

    for first in range(0, draws, step):
        k = min(step, draws - first)
        at_most = np.arange(first, first + k) % 2 == 1
        shape = (k, n)
        moved = displace(
            np.tile(poses.world_from_camera, (k, 1, 1, 1)),
            sizes[:, :1] * vectors(shape, 3, at_most),
            sizes[:, 1:2] * vectors(shape, 3, at_most),
        )
        scale = 1 + sizes[:, 2] * vectors(shape, 1, at_most)[..., 0]
        if part.any():
            # The part moves: the cameras move the other way.
            about = np.tile(np.eye(4), (k, 1, 1))
            about[:, :3, 3] = pivot
            turned = displace(
                about, part[0] * vectors((k,), 3, at_most), part[1] * vectors((k,), 3, at_most)
            )
            inverse = about @ np.linalg.inv(turned)
            moved = inverse[:, None] @ moved
        yield moved, np.maximum(scale, 1e-3)


def _measure_installations(
    tolerated: TolerancePass,
    camera: Cameras,
    poses: Poses,
    views: IntArray,
    installed: Iterator[Installed],
) -> FloatArray:
    """(N, G) area of each group in each installation, m^2."""
    finder, task = tolerated.nominal, tolerated.task
    most, areas = int(views.max(initial=1)), [np.empty((0, len(finder.mesh.groups)))]
    for moved, focal in installed:
        flat = np.tile(poses.camera, len(moved))
        placed = Poses.of(moved.reshape(-1, 4, 4), camera=flat)
        if (focal != 1).any():
            cameras = [
                scale_camera(finder.cameras[at], value)
                for at, value in zip(flat.tolist(), focal.ravel().tolist(), strict=True)
            ]
            with closing(
                RegionPass(*tolerated.alone(cameras, flat), threads=finder.threads)
            ) as own:
                result = own.find(Poses.of(placed.world_from_camera, camera=np.arange(len(flat))))
        else:
            result = finder.find(placed)
        for of in np.arange(len(flat)).reshape(len(moved), -1):
            covered = unite_regions(take_rows(result, of), camera, placed[of], task, most)
            areas.append(by_group(covered, views)[None])
    return np.concatenate(areas)


# --- what is lost ---


def _reasons(sure_coverage: SureCoverage, parts: ReasonPieces) -> CodeArray:
    """Reason of each lost piece, at its middle: of the camera that fails last."""
    areas = polygons.polygon_areas(parts.xy, parts.starts)
    middle = polygons.centroids(parts.xy, parts.starts, areas)
    points = to_world(sure_coverage.mesh, parts.face, middle)
    n, face = len(sure_coverage.poses), parts.face.astype(np.int64)
    covers, is_sure = (
        rows_at(each, each.pose, n, parts.face, points)
        for each in (sure_coverage.nominal_regions, sure_coverage.regions)
    )
    reason = np.zeros(len(points), np.uint8)
    rules = [sure_coverage.task.rules(camera) for camera in cameras_of(sure_coverage.camera)]
    for pose in range(n):
        rows = np.flatnonzero(covers[:, pose] & ~is_sure[:, pose])
        index = int(sure_coverage.poses.camera[pose])
        own = cameras_of(sure_coverage.camera)[index], rules[index]
        at = sure_coverage.poses.world_from_camera[pose]
        fails = unmet(
            sure_coverage.mesh, *own, at, sure_coverage.sizes[pose], middle[rows], face[rows]
        )
        reason[rows] = nearer(reason[rows], fails)
    has_angles = sure_coverage.task.min_angle_deg > 0 or gates_of(sure_coverage.camera)
    reason[reason == 0] = BASELINE if has_angles else Reason.OCCLUDED
    return reason.astype(np.uint32)


def _hiders(sure_coverage: SureCoverage, zones: DeadZones, rows: list[int]) -> dict[int, str]:
    """Group that hides most points of zones from displaced cameras that cover them as planned."""
    if not rows:
        return {}
    mesh, rng, hiders = sure_coverage.mesh, np.random.default_rng(0), {}
    every, piece = points_of(zones, max(rows) + 1, HIDING_POINTS)
    for row in rows:
        own = np.flatnonzero(zones.zone[piece] == row)
        points, face = every[own], zones.face[piece[own]].astype(np.int64)
        regions = sure_coverage.nominal_regions
        covers = rows_at(regions, regions.pose, len(sure_coverage.poses), face, points)
        pose = int(covers.sum(axis=0).argmax())
        steps = rng.normal(size=(HIDING, 3))
        steps *= sure_coverage.sizes[pose, 0] / norm(steps)[..., None]
        matrices = np.tile(sure_coverage.poses.world_from_camera[pose], (HIDING, 1, 1))
        moved = displace(matrices, steps, np.zeros((HIDING, 3)))
        placed = Poses.of(moved, camera=np.full(HIDING, sure_coverage.poses.camera[pose]))
        counts = np.zeros(len(mesh.groups), np.int64)
        # Each by itself, whatever the rule of their rig.
        scene = mesh, cameras_of(sure_coverage.camera), sure_coverage.task, placed, points, face
        for _, _, hidden_by in failures_of_rows(*scene):
            hit = hidden_by[hidden_by >= 0]
            counts += np.bincount(mesh.face_group[hit], minlength=len(counts))
        if counts.any():
            hiders[row] = mesh.groups[int(counts.argmax())].name
    return hiders
