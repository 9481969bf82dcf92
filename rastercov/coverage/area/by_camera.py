"""Area that each camera of a rig covers alone, beside that of all cameras together.

A point counts for a camera where any of its poses covers it, whatever number of views the task
wants of all cameras together.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, cameras_of
from rastercov.coverage.area.network import AreaNetwork
from rastercov.coverage.area.regions import Regions
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
