"""What the page of a placement tells: one value that holds all that is known about a network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.network import Network
from rastercov.placement.candidates.cavities import Openings
from rastercov.placement.candidates.clearance import Dropped
from rastercov.placement.candidates.pool import Candidates
from rastercov.placement.candidates.segments import Segmentation
from rastercov.placement.explain.uncovered import Leftover
from rastercov.placement.improve.tolerance import Tolerance
from rastercov.placement.select.problem import Goal
from rastercov.placement.select.selection import Selection


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanReport:
    """Everything that a page may tell; None and empty for what is not known.

    Attributes
    ----------
    mesh, camera : Mesh, Camera
    network : Network
        To which every camera was added, in the order of `poses`.
    poses : (K, 4, 4) float64
        world_from_camera.
    title : str
    selection, goal : Selection, Goal, optional
        How the cameras were chosen, and what for; both or none.
    candidates : Candidates, optional
        All that could be chosen; the rows of `selection.chosen` count in them.
    dropped : Dropped, optional
        Candidates that were left out before.
    segmentation, leftover, openings, tolerance : optional
        What the steps of the same name gave.
    camera_names : sequence of K str
        1, 2, ... unless given.
    sources : sequence of K str
        Where each pose came from; taken from `candidates` unless given.
    made_with : mapping
        Versions, hashes, command: told at the end as it is.
    notes : sequence of str
        Sentences for the top.
    """

    mesh: Mesh
    camera: Camera
    network: Network
    poses: NDArray[np.float64]
    title: str = "Placement of cameras"
    selection: Selection | None = None
    goal: Goal | None = None
    candidates: Candidates | None = None
    dropped: Dropped | None = None
    segmentation: Segmentation | None = None
    leftover: Leftover | None = None
    openings: Openings | None = None
    tolerance: Tolerance | None = None
    camera_names: Sequence[str] = ()
    sources: Sequence[str] = ()
    made_with: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()

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
    def names(self) -> list[str]:
        """What the cameras are called."""
        return list(self.camera_names) or [str(row + 1) for row in range(len(self.poses))]

    @property
    def origins(self) -> list[str]:
        """Where each pose came from, "" where that is not known."""
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
