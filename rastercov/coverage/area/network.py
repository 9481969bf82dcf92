"""Area that a network of cameras covers: exact, with its bound, for 1 ... k views and by group.

There are figures of each camera of a rig, and of all cameras together. A point counts for a
camera where any of its poses covers it, whatever number of views the task wants of all.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import plural
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.regions import Regions, check_pointwise
from rastercov.coverage.area.union import Covered, RegionUnion
from rastercov.coverage.area.zones import DeadZones, dead_zones, summary_of
from rastercov.coverage.engine import Engine
from rastercov.coverage.network import JudgedPoses, Network, percent_of_seeable, share_of_faces
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.groups import parts_of

UNITS = ("area", "face")
"""Units of a result: exact area, or whole faces as in the thesis."""


def unit_of_result(by: str | None, task: Task, engine: Engine) -> tuple[str, str]:
    """Unit of a result, "area" or "face"; and the reason for "face" where it was not chosen.

    Without a choice it is "area", unless a threshold of the task is of a face or the method counts
    samples.

    Raises
    ------
    ConfigError
        For an unknown unit, or by area where that cannot be.
    """
    if by is not None and by not in UNITS:
        raise ConfigError(f"by must be one of {', '.join(UNITS)}, got {shown(by)}")
    if by == "face":
        return by, ""
    obstacle = ""
    try:
        if engine.method == "sampled":
            raise ConfigError("method sampled counts whole faces; by area, use certified or exact")
        check_pointwise(task)
    except ConfigError as error:
        if by == "area":
            raise
        obstacle = str(error)
    return "face" if obstacle else "area", obstacle


class AreaNetwork:
    """Area that cameras cover together, added up batch by batch.

    Faces that enough cameras cover as a whole are closed, so that the cost of further poses falls.

    Parameters
    ----------
    mesh : Mesh
        Mesh of all regions.
    task : Task
        Its `views` is the largest number of views that is counted.
    """

    def __init__(self, mesh: Mesh, task: Task) -> None:
        check_pointwise(task)
        self.mesh, self.task, self.views = mesh, task, task.views
        self._union = RegionUnion(mesh, task.views)
        self._kept: dict[Any, Any] = {}
        """Figures computed since regions were added."""

    @property
    def closed(self) -> NDArray[np.bool_]:
        """(F,) faces that need no further regions."""
        return self._union.closed

    @property
    def covered(self) -> Covered:
        """Area of each face that the regions so far cover, and its pieces."""
        found: Covered = self._once("covered", self._union.covered)
        return found

    def add(self, regions: Regions) -> None:
        """Take in the regions of further poses."""
        self._union.add(regions)
        self._kept.clear()

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def summary(
        self, views: Mapping[str, int] | None = None, rows: Iterable[int] | None = None
    ) -> dict[str, Any]:
        """Covered area of all task faces, or of those of the groups of some rows, ready for JSON.

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
        percent = 100 / whole["of_m2"] if whole["of_m2"] > 0 else 0.0
        own = {every[i].name: views[every[i].name] for i in scored if every[i].name in views}
        return whole | {"percent": percent * area, "m2": area, "views": own}

    def add_to(self, summary: dict[str, Any], views: Mapping[str, int] | None = None) -> None:
        """Add `covered_area` to the summary of a `Network`, and to its scored groups and parts."""
        summary["covered_area"] = self.summary(views)
        for index, group in enumerate(summary["groups"]):
            if "covered" in group:
                wanted = None if views is None else views.get(group["name"], 1)
                members = self.mesh.face_group == index
                group["covered_area"] = self.of_faces(members, wanted)
        for part, rows in zip(summary["parts"], parts_of(self.mesh.groups).values(), strict=True):
            if "covered" in part:
                part["covered_area"] = self.summary(views, rows)
        for entry in (summary, *summary["groups"], *summary["parts"]):
            if "covered_area" in entry:
                m2 = entry["covered_area"]["m2"]
                entry["covered_of_seeable_percent"] = percent_of_seeable(m2, entry)

    def dead_zones(
        self, camera: Cameras, poses: ArrayLike | Poses, views: Mapping[str, int] | None = None
    ) -> dict[str, Any]:
        """Dead zones with their reasons, ready for JSON; see `rastercov.coverage.area.zones`.

        `camera`, one or several, and `poses`, (P, 4, 4) or `Poses`, are those of the regions;
        `views` as for `summary`. The result is kept until regions are added.
        """
        zones = self.zones(views)
        found: dict[str, Any] = self._once(
            zones, lambda: summary_of(zones, camera, self.task, poses)
        )
        return found

    def zones(self, views: Mapping[str, int] | None = None) -> DeadZones:
        """Dead zones, kept like their summary; `views` as for `summary`."""
        names = [group.name for group in self.mesh.groups]
        wanted = [self.views if views is None else views.get(name, 1) for name in names]
        of_face = np.minimum(wanted, self.views)[self.mesh.face_group]
        found: DeadZones = self._once(tuple(wanted), lambda: dead_zones(self.covered, of_face))
        return found

    def of_faces(self, members: NDArray[np.bool_], views: int | None = None) -> dict[str, Any]:
        """Covered area of some faces, (F,) bool: by at least `views` cameras, and by 1 ... views.

        Percentages are of the area of the faces. The true area is within `bound_m2` of each.
        `views` is that of the task unless given.
        """
        views = self.views if views is None else views
        total = float(frames_of(self.mesh).areas[members].sum())
        found, bound = self.covered.area[:views], float(self.covered.bound[members].sum())
        square_metres = [min(float(row[members].sum()), total) for row in found]
        bound = min(bound, total)
        percent = 100 / total if total > 0 else 0.0
        return {
            "percent": percent * square_metres[-1],
            "bound_percent": percent * bound,
            "m2": square_metres[-1],
            "bound_m2": bound,
            "of_m2": total,
            "views": views,
            "by_views": [
                {"views": number, "percent": percent * area, "m2": area}
                for number, area in enumerate(square_metres, start=1)
            ],
        }


def in_words(figures: Mapping[str, Any]) -> str:
    """Covered area with its bound, in words."""
    bound = max(figures["bound_percent"], 1e-12)
    digits = min(max(1, -math.floor(math.log10(bound)) - 1), 6)
    text = f"{figures['percent']:.{digits}f} % of the area, within {bound:.1g} % of it"
    if isinstance(figures["views"], int) and figures["views"] > 1:
        text += f", by {plural(figures['views'], 'camera')} or more; " + ", ".join(
            f"{each['percent']:.1f} % by {each['views']}" for each in figures["by_views"][:-1]
        )
    return text


MOST_CAMERAS = 64
"""Cameras with figures of their own, which take 50 bytes a face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none where there is one, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


class ByCamera:
    """Figures of each camera alone; of no camera where there is one, or too many.

    A point, or a face, counts for a camera where any of its poses covers it, whatever number of
    views the task wants of all cameras together.

    Parameters
    ----------
    mesh, task, camera
        As of the network of all cameras.
    poses : Poses
        All of the run.
    by_area, by_face : bool
        Whether there are figures of areas, and of faces.
    """

    def __init__(
        self, mesh: Mesh, task: Task, camera: Cameras, poses: Poses, *,
        by_area: bool, by_face: bool = True,
    ) -> None:  # fmt: skip
        self.names, indices = names_of(camera), cameras_apart(camera, poses)
        one = replace(task, views=1, min_angle_deg=0.0)
        self._areas = {index: AreaNetwork(mesh, one) for index in indices if by_area}
        self._networks = {index: Network(mesh, one) for index in indices if by_face}

    @property
    def is_asked(self) -> bool:
        """True where there are figures of faces by camera."""
        return bool(self._networks)

    def closed(self, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Those of some faces, (F,) bool, that no camera needs regions of any more."""
        for areas in self._areas.values():
            closed = closed & areas.closed
        return closed

    def add(self, regions: Regions, camera: NDArray[np.int32]) -> None:
        """Take in the regions of P further poses, of cameras (P,)."""
        for index, areas in self._areas.items():
            if (own := camera == index).any():
                areas.add(regions.of_poses(own))

    def add_batch(self, batch: JudgedPoses) -> None:
        """Take in a batch of poses, and their regions where the result is by area."""
        for index, network in self._networks.items():
            network.add(batch, index)
        if batch.regions is not None:
            self.add(batch.regions, batch.poses.camera)

    def summary(self) -> list[dict[str, Any]]:
        """Figures of each camera, ready for JSON."""
        found = []
        for index, network in self._networks.items():
            mesh, task = network.mesh, network.mesh.task_mask
            covered = share_of_faces(mesh, network.covered & task, task)
            entry = {"camera": self.names[index], "poses": len(network.pose_ids)}
            found.append(entry | {"covered": covered} | self.entry(index))
        return found

    def entry(self, index: int) -> dict[str, Any]:
        """Entry `covered_area` of a camera, ready for JSON; none where it has no areas."""
        return {"covered_area": self._areas[index].summary()} if index in self._areas else {}
