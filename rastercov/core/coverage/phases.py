"""Phases of a scene, such as frames in which its bodies move; a feature may ask for them.

What is covered is counted over all phases. Regions of each are on the mesh of the query, which is
the scene at rest.
"""

from pathlib import Path
from typing import Protocol

from rastercov.base import ReadByName
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
from rastercov.core.camera.rig import phased_features
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.shards import Staff

MOST_IMAGES = 10_000
"""Phases times cameras whose regions are held at once."""


class Phases(Protocol):
    """Phases of a scene, and the number of them in which a point must be covered."""

    def check(self, mesh: Mesh, camera: Cameras, poses: Poses, task: Task) -> None:
        """Raise `ConfigError` for phases of another mesh, and for what does not go with them."""

    def check_motion(self, placed: Poses) -> None:
        """Raise `ConfigError` for more than `MOST_IMAGES`."""

    def images(self, placed: Poses) -> int:
        """Number of images of placed cameras."""

    def regions(self, camera: Cameras, placed: Poses, task: Task, engine: Engine) -> Regions:
        """Regions of rows of cameras, phase after phase."""

    def network(
        self, scene: tuple[Cameras, Poses, Task], engine: Engine, folder: Path | None, staff: Staff
    ) -> AreaNetwork:
        """Area that is covered in enough phases, by way of shards in a folder if one is given."""


def question_in(summary: ReadByName) -> ReadByName:
    """Entry on phases of a summary; empty where the scene has one."""
    return next((summary[each.key] for each in phased_features() if each.key in summary), {})
