"""Figures of each camera of a rig alone, beside those of all cameras together.

A point, or a face, counts for a camera where any of its poses covers it, whatever number of views
the task wants of all cameras together.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text

from rastercov._format import area
from rastercov.area.network import AreaNetwork
from rastercov.area.regions import Regions
from rastercov.mesh import Mesh
from rastercov.network import JudgedPoses, Network
from rastercov.pose import Poses
from rastercov.rig import Cameras, cameras_of, names_of
from rastercov.task import Task

MOST = 64
"""Cameras with figures of their own: each takes 50 bytes a face."""


class ByCamera:
    """Networks of the poses of each camera; empty for one camera, and for more than `MOST`.

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
        one = replace(task, views=1)
        used = np.unique(poses.camera).tolist() if len(cameras_of(camera)) > 1 else []
        self.names, self.left_out = names_of(camera), len(used) > MOST
        self._networks = {index: Network(mesh, one) for index in used if not self.left_out}
        self._areas = {index: AreaNetwork(mesh, one) for index in self._networks if by_area}

    @property
    def is_asked(self) -> bool:
        """True where there are figures by camera."""
        return bool(self._networks)

    def closed(self, closed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Those of some faces, (F,) bool, that no camera needs regions of any more."""
        for areas in self._areas.values():
            closed = closed & areas.closed
        return closed

    def add(self, batch: JudgedPoses, regions: Regions | None) -> None:
        """Take in a batch of poses, and their regions where the result is by area."""
        for index, network in self._networks.items():
            own = batch.poses.camera == index
            if not own.any():
                continue
            network.add(batch, index)
            if regions is not None and index in self._areas:
                self._areas[index].add(regions.of_poses(own))

    def summary(self) -> list[dict[str, Any]]:
        """Figures of each camera, ready for JSON."""
        found = []
        for index, network in self._networks.items():
            whole = network.summary()
            entry = {
                "camera": self.names[index],
                "poses": whole["poses"],
                "covered": whole["covered"],
                "mean_best_coverage": whole["mean_best_coverage"],
            }
            if index in self._areas:
                entry["covered_area"] = self._areas[index].summary()
            found.append(entry)
        return found


def camera_table(summary: Mapping[str, Any], rows: int = 20) -> Table | None:
    """Figures by camera for a terminal of 80 columns; None where there are none."""
    entries = summary.get("by_camera")
    if not entries:
        return None
    table = Table(title="Covered by each camera alone", title_justify="left")
    table.add_column("camera", no_wrap=True, max_width=30)
    by_area = "covered_area" in entries[0]
    for name in ("poses", "area" if by_area else "faces", "covered %"):
        table.add_column(name, justify="right", no_wrap=True)
    for entry in entries[:rows]:
        covered = entry["covered_area"] if by_area else entry["covered"]
        size = area(covered["m2"]) if by_area else str(covered["faces"])
        table.add_row(Text(entry["camera"]), str(entry["poses"]), size, f"{covered['percent']:.1f}")
    if entries[rows:]:
        table.add_row(f"... {len(entries) - rows} more", style="dim")
    return table
