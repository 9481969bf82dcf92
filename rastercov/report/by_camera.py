"""Figures of each camera of a rig alone, beside those of all cameras together.

A point, or a face, counts for a camera where any of its poses covers it, whatever number of views
the task wants of all cameras together.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, names_of
from rastercov.coverage.area.by_camera import AreasByCamera, cameras_apart
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.judged_poses import JudgedPoses
from rastercov.coverage.network import Network
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh


class ByCamera:
    """Networks of the poses of each camera; of no camera where there is one, or too many.

    Parameters
    ----------
    mesh, task
        As of the network of all cameras.
    camera : Camera, Rig or sequence of Camera
        The cameras.
    poses : Poses
        All poses of the run.
    by_area : bool
        True where the result is by area.
    """

    def __init__(
        self, mesh: Mesh, task: Task, camera: Cameras, poses: Poses, *, by_area: bool
    ) -> None:
        self.names, indices = names_of(camera), cameras_apart(camera, poses)
        self._networks = {
            index: Network(mesh, replace(task, views=1, min_angle_deg=0.0)) for index in indices
        }
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

    def summary(self) -> list[dict[str, Any]]:
        """Figures of each camera, ready for JSON."""
        found = []
        for index, network in self._networks.items():
            whole = network.summary()
            entry = {
                "camera": self.names[index],
                "poses": whole["poses"],
                "covered": whole["covered"],
            }
            found.append(entry | self._areas.entry(index))
        return found
