"""Figures of each camera of a rig alone, beside those of all cameras together.

A point counts for a camera where any of its poses covers it, whatever number of views the task
wants of all cameras together.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of, names_of
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.coverage import FIGURES, Coverage
from rastercov.coverage.judged_poses import SUMMED, JudgedPoses
from rastercov.coverage.network import Network
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

MOST_CAMERAS = 64
"""Cameras with figures of their own, which take 50 bytes a face and camera."""


def cameras_apart(camera: Cameras, poses: Poses) -> list[int]:
    """Indices of the cameras with figures of their own: none where there is one, or too many."""
    if len(cameras_of(camera)) == 1:
        return []
    used: list[int] = np.unique(poses.camera).tolist()
    return used if len(used) <= MOST_CAMERAS else []


class AreasByCamera:
    """Areas that the poses of each camera cover, added up batch by batch.

    Parameters
    ----------
    mesh, task
        As of the network of all cameras.
    indices : list of int
        Cameras, of `cameras_apart`.
    """

    def __init__(self, mesh: Mesh, task: Task, indices: list[int]) -> None:
        one = replace(task, views=1)
        self._areas = {index: AreaNetwork(mesh, one) for index in indices}

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

    def entry(self, index: int) -> dict[str, Any]:
        """Entry `covered_area` of a camera, ready for JSON; none where it has no areas."""
        return {"covered_area": self._areas[index].summary()} if index in self._areas else {}


class ByCamera:
    """Figures of each camera alone; of no camera where there is one, or too many.

    A point, or a face, counts for a camera where any of its poses covers it, whatever number of
    views the task wants of all cameras together. Parameters are those of the network of all
    cameras, and all poses of the run.
    """

    def __init__(
        self, mesh: Mesh, task: Task, camera: Cameras, poses: Poses, *, by_area: bool
    ) -> None:
        self.names, indices = names_of(camera), cameras_apart(camera, poses)
        one = replace(task, views=1, min_angle_deg=0.0)
        self._networks = {index: Network(mesh, one) for index in indices}
        self._areas = AreasByCamera(mesh, task, indices if by_area else [])

    @property
    def is_asked(self) -> bool:
        """True where there are figures by camera."""
        return bool(self._networks)

    def closed(self, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Those of some faces, (F,) bool, that no camera needs regions of any more."""
        return self._areas.closed(closed)

    def add(self, batch: JudgedPoses, regions: Regions | None) -> None:
        """Take in a batch of poses, and their regions where the result is by area."""
        for index, network in self._networks.items():
            network.add(batch, index)
        if regions is not None:
            self._areas.add(regions, batch.poses.camera)

    def add_figures(self, coverage: Coverage, poses: Poses) -> None:
        """Take in the figures of all poses, where these were not judged."""
        for index, network in self._networks.items():
            own = poses.camera == index
            figures: dict[str, Any] = dict.fromkeys(FIGURES)
            figures |= {name: getattr(coverage, name)[own] for name in SUMMED}
            network.add(
                Coverage(
                    coverage.mesh, coverage.camera, network.task, coverage.info,
                    coverage.pose_ids[own], coverage.clipped[own],
                    **figures, eyes=coverage.eyes[own],
                )
            )  # fmt: skip

    def summary(self) -> list[dict[str, Any]]:
        """Figures of each camera, ready for JSON."""
        found = []
        for index, network in self._networks.items():
            whole = {"camera": self.names[index]} | network.summary()
            entry = {name: whole[name] for name in ("camera", "poses", "covered")}
            found.append(entry | self._areas.entry(index))
        return found
