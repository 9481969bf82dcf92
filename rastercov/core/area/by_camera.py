"""Figures of each camera of a network, and those of features, such as of each device of rigs.

A point counts for a camera where any of its poses covers it, however many views the task requires
of all cameras together.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from rastercov.base import BoolArray, ByName, FloatArray, IntArray, ReadByName, matmul
from rastercov.core.area import polygons
from rastercov.core.area.features import FEATURES
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.polygons import to_world
from rastercov.core.area.regions import covering_poses
from rastercov.core.area.table import Regions
from rastercov.core.area.union import unite
from rastercov.core.camera import Cameras, Poses, cameras_of, is_joint, names_of
from rastercov.core.coverage.judging import JudgedPoses
from rastercov.core.coverage.network import Network, share_of_faces
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh

FIGURES = [each.figures for each in FEATURES]
"""Further figures, of features."""
LEAST_LOST_REL = 1e-9
"""Area, relative to the task, below which a camera could be left out: rounding of the union."""
MOST_CAMERAS = 64
"""Cameras with figures of their own; they take 50 bytes per face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none for one camera, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


class ByCamera:
    """Figures per camera; of none if there is one camera, or too many.

    A point, or a face, counts for a camera where any of its poses covers it, however many views the
    task requires of all cameras together.

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
        self,
        mesh: Mesh,
        task: Task,
        camera: Cameras,
        poses: Poses,
        *,
        by_area: bool,
        by_face: bool = True,
    ) -> None:
        self.names, indices = names_of(camera), cameras_apart(camera, poses)
        self._camera = camera
        of_several = is_joint(camera)
        if indices or of_several:
            task = replace(task, views=1, min_angle_deg=0.0)
        self._areas = {index: AreaNetwork(mesh, task) for index in indices if by_area}
        self._networks = {index: Network(mesh, task) for index in indices if by_face}
        new = partial(AreaNetwork, mesh, task)
        self._further = [
            each(new, camera, task, indices) for each in FIGURES if by_area and of_several
        ]

    @property
    def is_asked(self) -> bool:
        """True if faces have figures by camera."""
        return bool(self._networks)

    def closed_by_camera(self, closed: BoolArray) -> BoolArray:
        """Those of some faces, (F,) bool, that no camera needs regions of any more.

        None where figures of a feature need the regions of all.
        """
        if any(each.needs_all for each in self._further):
            return np.zeros_like(closed)
        further = (areas for each in self._further for areas in each.networks())
        for areas in (*self._areas.values(), *further):
            closed = closed & areas.closed
        return closed

    def add(self, regions: Regions, poses: Poses) -> None:
        """Add the regions of further poses."""
        camera = poses.camera
        for index, areas in self._areas.items():
            if (own := camera == index).any():
                areas.add(regions.of_poses(own))
        for each in self._further:
            each.add(regions, self._camera, poses)

    def add_batch(self, batch: JudgedPoses) -> None:
        """Add a batch of poses, with their regions if the result is by area."""
        for index, network in self._networks.items():
            network.add(batch, index)
        if batch.regions is not None:
            self.add(batch.regions, batch.poses)

    @property
    def of_faces(self) -> dict[str, FloatArray]:
        """(2, F) further figures of faces and their bounds by names with units; see `Figures`."""
        return {name: own for each in self._further for name, own in each.of_faces().items()}

    def summary(self) -> list[ByName]:
        """Figures of each camera, ready for JSON."""
        items = []
        for index, network in self._networks.items():
            mesh, task = network.mesh, network.mesh.task_mask
            covered = share_of_faces(mesh, network.covered & task, task)
            entry = {"camera": self.names[index], "poses": len(network.pose_ids)}
            items.append(entry | {"covered": covered} | self.entry(index))
        return items

    def further(self) -> ByName:
        """Entries of further figures of features, ready for JSON."""
        every = (each.summary(lambda at: self._areas[at].summary()) for each in self._further)
        return {name: own for some in every for name, own in some.items()}

    def entry(self, index: int) -> ByName:
        """Entry `covered_area` of a camera, ready for JSON; none where it has no areas."""
        return {"covered_area": self._areas[index].summary()} if index in self._areas else {}


def lines_of(summary: ReadByName) -> list[str]:
    """Lines on further figures, such as what is lost by one camera alone; often none."""
    return [line for each in FIGURES for line in each.lines(summary)]


def warnings_of(summary: ReadByName) -> list[str]:
    """Warnings about further figures."""
    return [line for each in FIGURES for line in each.doubts(summary)]


def lose_without(parts: Regions, need: IntArray) -> FloatArray:
    """(P,) area that too few cameras cover without each one; `need`, (F,), are those wanted."""
    covered = unite(parts, int(need.max(initial=1)) + 1)
    tight = np.flatnonzero(covered.views == need[covered.face])
    xy, starts = polygons.choose_polygons(covered.xy, covered.starts, tight)
    areas, face = polygons.polygon_areas(xy, starts), covered.face[tight]
    points = to_world(parts.mesh, face, polygons.centroids(xy, starts, np.maximum(areas, 1e-300)))
    return matmul(areas, covering_poses(parts, face, points))
