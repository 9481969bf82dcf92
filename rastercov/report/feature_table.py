"""Table of features: each group of a mesh, such as a face of a CAD part, and its best camera.

Figures of a feature are those at the centroid of the face in its middle, of the camera that covers
this point with most pixels per metre; or, where none does, of the one that fails its last criterion
there.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product

import numpy as np

from rastercov.base import (
    TINY,
    FloatArray,
    IntArray,
    ReadByName,
    dots,
    norm,
    percent,
    sort_order,
)
from rastercov.base.format import area
from rastercov.base.output import csv_text
from rastercov.core.area.advice import figures_of_point
from rastercov.core.area.features import conditions_at
from rastercov.core.area.stages import first_failures
from rastercov.core.camera import MODELS, Camera, Cameras, Poses, cameras_of
from rastercov.core.camera.rig import short_names
from rastercov.core.coverage.task import Reason, Task, density_text, nearness
from rastercov.core.mesh import Mesh
from rastercov.placement.parts import PartRow

MOST_PAIRS = 2_000_000
"""Pairs of pose and feature up to which there is a table."""
MOST_JUDGED = 64
"""Cameras of a feature whose pixels are compared: those that would have most in their axis."""


@dataclass(frozen=True)
class FeatureRow:
    """A group, what of it is covered, and figures at its middle in its best camera.

    Attributes
    ----------
    name : str
    area_m2, covered_percent : float
    missing : str
        Reason of most of what is not covered; "" where all is.
    camera : str
        Name of the camera; "" for none.
    px_per_m : float
        Least density of pixels on the surface; of a target that faces the camera if `is_facing`.
    incidence_deg : float
        Angle to the normal of the surface.
    in_focus, lit : bool or None
        None where the task asks for neither.
    is_facing : bool
        True where the task asks for more of this density.
    """

    name: str
    area_m2: float
    covered_percent: float
    missing: str
    camera: str = ""
    px_per_m: float = 0.0
    incidence_deg: float = 90.0
    in_focus: bool | None = None
    lit: bool | None = None
    is_facing: bool = False


def feature_rows(
    mesh: Mesh, camera: Cameras, poses: Poses, task: Task, names: Sequence[str], summary: ReadByName
) -> list[FeatureRow]:
    """Rows of the evaluated groups, those with the largest missing share, and the largest, first.

    `names` are those of the poses, and `summary` is that of their network. None for very many.
    """
    groups = [each for each in summary["groups"] if "covered" in each]
    rows = {group.name: row for row, group in enumerate(mesh.groups)}
    if len(groups) * len(poses) > MOST_PAIRS:
        return []
    face = np.array([_middle(mesh, rows[each["name"]]) for each in groups], np.int64)
    points, known = mesh.centroids[face], PartRow.of
    reasons = np.full((len(poses), len(face)), Reason.DEGENERATE, np.uint8)
    for row, (reason, _) in enumerate(first_failures(mesh, camera, task, poses, points, face)):
        reasons[row] = reason
    conditions, sees = (
        conditions_at(mesh, camera, task, points, face),
        np.ones((1, len(face)), bool),
    )
    is_lit = np.ones(reasons.shape, bool)
    for row, each in product(range(len(poses)), conditions):
        is_lit[row] &= each.reasons(poses[row : row + 1], sees) == Reason.COVERED
    made = []
    for at, (part, entry) in enumerate(zip(map(known, groups), groups, strict=True)):
        own = entry["name"], part.area_m2, part.percent, part.reason
        ranks = nearness(reasons[:, at])
        if ranks.max(initial=0) <= Reason.BACK_FACING:
            made.append(FeatureRow(*own))
            continue
        ranks = 2 * ranks + is_lit[:, at]
        is_facing = task.min_facing_density > task.min_pixel_density
        density = "facing_density" if is_facing else "pixel_density"
        row, figures = _best(camera, poses, ranks, points[at], mesh.normals[face[at]], density)
        angle = math.degrees(figures["incidence"])
        eye = cameras_of(camera)[poses.camera[row]]
        focus = _in_focus(eye, poses.world_from_camera[row], points[at], task)
        lit = bool(is_lit[row, at]) if conditions else None
        made.append(FeatureRow(*own, names[row], figures[density], angle, focus, lit, is_facing))
    return sorted(made, key=lambda each: (each.covered_percent, -each.area_m2))


def _middle(mesh: Mesh, group: int) -> int:
    """Face of a group whose centroid is nearest to that of all of it."""
    faces = np.flatnonzero(mesh.face_group == group)
    weights = np.maximum(mesh.areas[faces], 1e-300)[:, None]
    mean = (weights * mesh.centroids[faces]).sum(axis=0) / weights.sum()
    away = norm(mesh.centroids[faces] - mean)
    return int(faces[np.where(mesh.areas[faces] > 0, away, np.inf).argmin()])


def _best(
    camera: Cameras,
    poses: Poses,
    ranks: IntArray,
    point: FloatArray,
    normal: FloatArray,
    density: str,
) -> tuple[int, ReadByName]:
    """Pose of the highest rank at a point, with most of a density, and its figures."""
    near = np.flatnonzero(ranks == ranks.max())
    focal = np.array([each.fx for each in cameras_of(camera)])[poses.camera[near]]
    rays = poses.eyes[near] - point
    away = np.maximum(norm(rays), TINY)
    shown = focal / away
    if density == "pixel_density":
        shown *= abs(dots(rays, normal)) / away
    near = near[sort_order(-shown)[:MOST_JUDGED]]
    every = [
        (figures_of_point(cameras_of(camera)[poses.camera[row]], pose, point, normal), row)
        for row, pose in zip(near.tolist(), poses.world_from_camera[near], strict=True)
    ]
    figures, row = max(every, key=lambda each: each[0][density])
    return row, figures


def _in_focus(camera: Camera, pose: FloatArray, point: FloatArray, task: Task) -> bool | None:
    """True where a point is in the depth of field; None for a camera without an end of it."""
    low, high = camera.depth_of_field(task.max_blur)
    if not low > 0 and math.isinf(high):
        return None
    ray = point - pose[:3, 3]
    away = ray @ pose[:3, 2] if MODELS[camera.model].is_planar else norm(ray)
    return bool(low <= away <= high)


def table_of(rows: Sequence[FeatureRow], unit: str = "m") -> tuple[list[str], list[list[str]]]:
    """Headings and cells of a table, without columns that no row has."""
    said = {None: "", True: "yes", False: "no"}
    most = max((each.px_per_m for each in rows), default=0.0)  # one unit for the column
    columns = {
        "feature": [each.name for each in rows],
        "area": [area(each.area_m2, unit) for each in rows],
        "covered": [percent(each.covered_percent / 100) for each in rows],
        "missing": [each.missing for each in rows],
        "best camera": short_names([each.camera for each in rows]),
        "pixels": [
            (density_text(each.px_per_m, f"px/{unit}", most) + " facing" * each.is_facing)
            * bool(each.camera)
            for each in rows
        ],
        "incidence": [f"{each.incidence_deg:.1f}°" * bool(each.camera) for each in rows],
        "in focus": [said[each.in_focus] for each in rows],
        "lit": [said[each.lit] for each in rows],
    }
    kept = {name: cells for name, cells in columns.items() if any(cells)}
    return list(kept), [list(cells) for cells in zip(*kept.values(), strict=True)]


def csv_of(rows: Sequence[FeatureRow]) -> str:
    """The rows as CSV, with the names of their attributes."""
    return csv_text(FeatureRow.__dataclass_fields__, map(asdict, rows))
