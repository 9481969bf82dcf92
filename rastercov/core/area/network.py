"""Area that a network of cameras covers: exact, with its bound, for 1 ... k views and by group."""

from collections.abc import Callable, Hashable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ByName,
    ConfigError,
    FloatArray,
    is_one_of,
    shown,
)
from rastercov.base.format import area as area_text
from rastercov.base.format import percent_of
from rastercov.core.area.feature import DOUBTFUL
from rastercov.core.area.polygons import frames_of
from rastercov.core.area.regions import check_pointwise
from rastercov.core.area.remedies import ANY, Allowed
from rastercov.core.area.spread import BETWEEN_CAMERAS, check_poses, union_of
from rastercov.core.area.table import Regions
from rastercov.core.area.union import Covered
from rastercov.core.area.zones import DeadZones, areas_by_reason, dead_zones, summary_of
from rastercov.core.camera import Cameras, Poses, gates_of, is_joint, led_by
from rastercov.core.coverage.judging import OF_PARTS
from rastercov.core.coverage.network import percent_of_seeable
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import parts_of
from rastercov.engine import area_sums
from rastercov.shards import Progress, silent

UNITS = ("area", "face")
"""Units of a result: exact area, or whole faces as in the thesis."""


def unit_of_result(
    by: str | None,
    task: Task,
    engine: Engine,
    camera: Cameras | None = None,
    n_poses: int | None = None,
) -> tuple[str, str]:
    """Unit of a result, "area" or "face"; and the reason for "face" if it was not chosen.

    Without a choice it is "area", unless a threshold of the task applies to faces or to pairs of
    poses, or the method counts samples. Rigs with a rule or equipment need "area".

    Raises
    ------
    ConfigError
        For an unknown unit, or by area where that is impossible.
    """
    if by is not None and not is_one_of(by, UNITS):
        raise ConfigError(f"expected 'by' to be {' or '.join(UNITS)}, got {shown(by)}")
    is_gated = camera is not None and is_joint(camera)
    if is_gated and by == "face":
        raise ConfigError(OF_PARTS)
    if by == "face":
        return by, ""
    obstacle = ""
    try:
        if engine.method == "sampled":
            raise ConfigError(
                "expected an exact method for a result by area, got sampled: method sampled counts "
                "whole faces; by area, use certified or exact"
            )
        check_pointwise(task)
        if task.min_angle_deg > 0:
            _check_pairs(by, is_gated, n_poses)
    except ConfigError as error:
        if by == "area" or is_gated:
            raise
        obstacle = str(error).rpartition(": ")[2]  # the reason, in which there is no colon
    return "face" if obstacle else "area", obstacle


def _check_pairs(by: str | None, is_gated: bool, n_poses: int | None) -> None:
    if is_gated:
        raise ConfigError(BETWEEN_CAMERAS)
    if by is None:
        raise ConfigError(
            "expected an explicit by, got none: min_angle_deg by area is slow (all pairs of "
            "poses); request it with by area"
        )
    check_poses(n_poses or 0)


class AreaNetwork:
    """Area that cameras cover together, added up batch by batch.

    Faces that enough cameras cover completely are finished, so that the cost of further poses
    falls.

    Parameters
    ----------
    mesh : Mesh
        Mesh of all regions.
    task : Task
        Its `views` is the largest number of views that is counted.

    Attributes
    ----------
    least, views : int
        Smallest and largest number of cameras that may be required: 2 and more with
        `min_angle_deg`.
    cut_short : float
        Sum of `Regions.cut_short`, m^2.
    allowed : Allowed
        Cameras that advice may name.
    instead : Poses or None
        Candidates that cover nothing, whose reasons zones have in place of those of no camera.
    """

    allowed: Allowed = ANY
    instead: Poses | None = None

    def __init__(self, mesh: Mesh, task: Task) -> None:
        check_pointwise(task)
        self.mesh, self.task = mesh, task
        self.least = 2 if task.min_angle_deg > 0 else 1
        self.views = max(task.views, self.least)
        self.cut_short = 0.0
        self._union = union_of(mesh, self.views, task.min_angle_deg)
        self._kept: dict[Any, Any] = {}
        """Figures computed since regions were added."""

    @property
    def closed(self) -> BoolArray:
        """(F,) mask of the faces that need no further regions."""
        return self._union.closed

    @property
    def covered(self) -> Covered:
        """Area of each face that the regions so far cover, and its pieces."""
        return self._once("covered", self._union.covered)

    def add(self, regions: Regions) -> None:
        """Add the regions of further poses."""
        self._union.add(regions)
        # Rows of light that cameras share may count twice there, in the bound they do not.
        self.cut_short += min(regions.cut_short, float(regions.bound.sum()))
        self._kept.clear()

    def doubts(self) -> list[str]:
        """A warning about area that criteria leave undecided; usually none."""
        if not self.cut_short > 0:
            return []
        return [
            f"criteria: {area_text(self.cut_short)}, summed over all cameras, is undecided and "
            "added to the bound; divide large faces, or relax a threshold"
        ]

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def summary(
        self, views: Mapping[str, int] | None = None, rows: Iterable[int] | None = None
    ) -> ByName:
        """Covered area of all evaluated faces, or of the groups of some rows, ready for JSON.

        `views` are those of groups by name, 1 for the others; those of the task unless given.
        """
        every = self.mesh.groups
        scored = [i for i in rows or range(len(every)) if not every[i].is_occluder]
        whole = self.of_faces(np.isin(self.mesh.face_group, scored))
        if views is None:
            return whole
        parts = [
            self.of_faces(self.mesh.face_group == i, views.get(every[i].name, 1)) for i in scored
        ]
        area = sum(part["m2"] for part in parts)
        total = whole["of_m2"]
        own = {every[i].name: views[every[i].name] for i in scored if every[i].name in views}
        values = whole | {"percent": percent_of(area, total), "m2": area, "views": own}
        doubtful = sum(part.get("doubtful_m2", 0.0) for part in parts)
        return {name: values[name] for name in values if name not in DOUBTFUL} | _doubtful(
            doubtful, total
        )

    def add_to(
        self,
        summary: ByName,
        camera: Cameras,
        poses: ArrayLike | Poses,
        views: Mapping[str, int] | None = None,
    ) -> None:
        """Add `covered_area` and reasons to the summary of a `Network`, its groups and parts.

        Parameters are those of `dead_zones`.
        """
        summary["covered_area"] = self.summary(views)
        if gates_of(camera):
            summary["heads"] = len(led_by(camera, Poses.of(poses)))
        members = {id(summary): self.mesh.task_mask}
        for index, group in enumerate(summary["groups"]):
            if "covered" in group:
                wanted = None if views is None else views.get(group["name"], 1)
                own = members[id(group)] = self.mesh.face_group == index
                group["covered_area"] = self.of_faces(own, wanted)
        for part, rows in zip(summary["parts"], parts_of(self.mesh.groups).values(), strict=True):
            if "covered" in part:
                members[id(part)] = np.isin(self.mesh.face_group, rows) & self.mesh.task_mask
                part["covered_area"] = self.summary(views, rows)
        zones, unseeable = self.zones(camera, poses, views), self._unseeable()
        for entry in (summary, *summary["groups"], *summary["parts"]):
            if "covered_area" in entry:
                m2 = entry["covered_area"]["m2"]
                if unseeable is not None:
                    entry["unseeable_m2"] = float(unseeable[members[id(entry)]].sum())
                entry["covered_of_seeable_percent"] = percent_of_seeable(m2, entry)
                why = areas_by_reason(zones, members[id(entry)])
                if entry is summary:
                    entry["not_covered_because"] = why
                entry["seeable_not_covered_because"] = {
                    name: each for name, each in why.items() if name != "unseeable"
                }

    def _unseeable(self) -> FloatArray | None:
        """(F,) area that no camera can see, m^2; None where that of the `Network` holds."""
        return None

    def unseen_areas(self) -> tuple[FloatArray, FloatArray] | None:
        """(F,) areas that no camera can see here and anywhere, of several phases; else None."""
        return None

    def of_phases(self) -> ByName:
        """Entries of a summary on phases of the scene, whose figures are then the only ones."""
        return {}

    def parts(self, make: Callable[[], Regions]) -> Regions:
        """Parts that each camera covers; `make` finds them."""
        return make()

    def dead_zones(
        self,
        camera: Cameras,
        poses: ArrayLike | Poses,
        views: Mapping[str, int] | None = None,
        progress: Progress = silent,
    ) -> ByName:
        """Dead zones with their reasons, ready for JSON; see `rastercov.core.area.zones`.

        `camera`, one or several, and `poses`, (P, 4, 4) or `Poses`, are those of the regions;
        `views` as for `summary`, and `progress` as for `zones.summary_of`. The result is kept until
        regions are added.
        """
        zones = self.zones(camera, poses, views)
        placed = self.instead or Poses.of(poses)
        own = camera, self.task, placed, self.allowed, progress, placed is self.instead
        return self._once(zones, lambda: summary_of(zones, *own))

    def zones(
        self, camera: Cameras, poses: ArrayLike | Poses, views: Mapping[str, int] | None = None
    ) -> DeadZones:
        """Dead zones, kept like their summary; parameters as for it."""
        names = [group.name for group in self.mesh.groups]
        wanted = [self.views if views is None else views.get(name, 1) for name in names]
        of_face = np.clip(wanted, self.least, self.views)[self.mesh.face_group]
        network = camera, self.task, self.instead or Poses.of(poses)
        return self._once(tuple(wanted), lambda: dead_zones(self.covered, of_face, network))

    def of_faces(self, members: BoolArray, views: int | None = None) -> ByName:
        """Covered area of some faces, (F,) bool: by at least `views` cameras, and by 1 ... views.

        Percentages are of the area of the faces. The true area is within `bound_m2` of each, except
        for faces that a camera sees edge-on to within rounding error: of these up to `doubtful_m2`
        may be covered besides, where it is given. `views` is that of the task unless given.
        """
        views = self.views if views is None else max(views, self.least)
        covered, part = self.covered, np.where(members, 0, -1).astype(np.int32)
        levels, bounds = covered.area[:views], np.array([covered.bound, covered.excess])
        sums = np.empty((1, views + 3))
        faces = np.ascontiguousarray(levels), bounds, frames_of(self.mesh).areas
        area_sums.sum_areas(faces, part, np.array([views], np.int32), sums)
        *square_metres, bound, doubtful, total = sums[0].tolist()
        return {
            "percent": percent_of(square_metres[-1], total),
            "bound_percent": percent_of(bound, total),
            "m2": square_metres[-1],
            "bound_m2": bound,
            "of_m2": total,
            "views": views,
            "by_views": [
                {"views": number, "percent": percent_of(area, total), "m2": area}
                for number, area in enumerate(square_metres, start=1)
            ],
            **_doubtful(doubtful, total),
        }


def _doubtful(m2: float, total: float) -> dict[str, float]:
    """Entries of what may be covered besides of a total, m^2, where there is any."""
    return dict(zip(DOUBTFUL, (percent_of(m2, total), m2), strict=True)) if m2 > 0 else {}
