"""Content of a placement page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras, names_of
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.area.zones import DeadZones
from rastercov.coverage.network import Network
from rastercov.mesh import Mesh
from rastercov.placement.candidates.cavities import Openings
from rastercov.placement.candidates.clearance import Dropped
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.explain.uncovered import Leftover
from rastercov.placement.improve.tolerance import Tolerance
from rastercov.placement.select.problem import Goal
from rastercov.placement.select.selection import Selection
from rastercov.report.overview import CameraColours, best_covering, camera_colours


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanReport:
    """Content of a placement page; None and empty for unknown parts."""

    mesh: Mesh
    camera: Cameras
    network: Network  # of all cameras, in the order of `poses`
    poses: NDArray[np.float64]  # world_from_camera, (K, 4, 4)
    camera_of: NDArray[np.int32] | None = None  # index of the camera of each pose, (K,)
    mount_of: NDArray[np.int64] | None = None  # row of the rig that each camera is on, (K,)
    title: str = "Placement of cameras"
    selection: Selection | None = None  # with its goal; both or none
    goal: Goal | None = None
    candidates: Candidates | None = None  # all of them; `selection.chosen` has rows of them
    dropped: Dropped | None = None  # candidates that were rejected before the selection
    segmentation: Segmentation | None = None
    leftover: Leftover | None = None
    openings: Openings | None = None
    tolerance: Tolerance | None = None
    camera_names: Sequence[str] = ()  # K; 1, 2, ... unless given
    sources: Sequence[str] = ()  # of each pose, K; taken from `candidates` unless given
    made_with: Mapping[str, Any] = field(default_factory=dict)  # for the end of the page
    notes: Sequence[str] = ()  # sentences for the top of the page
    summary: Mapping[str, Any] | None = None  # figures; those of the network unless given
    regions: Regions | None = None  # of the poses, where the result is by area
    zones: DeadZones | None = None  # of them, with `dead_zones` in `summary`

    def __post_init__(self) -> None:
        count = len(self.network.pose_ids)
        if len(self.poses) != count:
            raise ConfigError(
                f"the network has {count} cameras, got {len(self.poses)} poses; add each to it"
            )
        for name in ("camera_names", "sources"):
            if len(getattr(self, name)) not in (0, count):
                raise ConfigError(
                    f"{name} must be {count} words, one a camera, got {len(getattr(self, name))}"
                )

    @property
    def placed(self) -> Poses:
        """The poses with the camera of each."""
        return Poses.of(self.poses, camera=self.camera_of)

    @property
    def types(self) -> list[str]:
        """Name of the camera of each pose; "" where there is one."""
        names = names_of(self.camera)
        return [names[index] if len(names) > 1 else "" for index in self.placed.camera]

    @property
    def mounts(self) -> NDArray[np.int64]:
        """(K,) row of the rig that each camera is on; its own where there are no rigs."""
        return np.arange(len(self.poses)) if self.mount_of is None else self.mount_of

    @property
    def mount_names(self) -> list[str]:
        """Names of the cameras of each rig, as one text."""
        rows, names = self.mounts, self.names
        count = int(rows.max(initial=-1)) + 1
        return [
            ", ".join(name for name, row in zip(names, rows, strict=True) if row == mount)
            for mount in range(count)
        ]

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return list(self.camera_names) or [str(row + 1) for row in range(len(self.poses))]

    @property
    def colours(self) -> CameraColours:
        """Colours of the surface by its cameras."""
        best = best_covering(self.network)
        return camera_colours(self.mesh, self.placed, best, self.names, self.regions)

    @property
    def origins(self) -> list[str]:
        """Source of each pose, "" where it is unknown."""
        if self.sources:
            return list(self.sources)
        if self.candidates is None or self.selection is None:
            return [""] * len(self.poses)
        chosen = self.candidates.take(self.selection.chosen)
        if len(chosen) != len(self.poses):
            return [""] * len(self.poses)
        return [
            f"{source} {index}" if index >= 0 else str(source)
            for source, index in zip(chosen.source, chosen.index, strict=True)
        ]
