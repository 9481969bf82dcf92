"""Phases of a scene, such as frames in which its bodies move; a feature may ask for them.

What is covered is counted over all phases. Regions of each are on the mesh of the query, which is
the scene at rest.
"""

from pathlib import Path
from typing import Any, Protocol

from rastercov.base import ReadByName, hooks_of
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
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


class Phased:
    """Hooks of a feature that asks for phases."""

    word = ""
    """Its argument of `evaluate`."""
    help = ""
    """Words of its file, an option of the same name."""
    key = ""
    """Its entry of a summary: `in_words`, on the phases in which parts are covered, and `lines`."""

    def phases_of(self, mesh: Mesh, value: object) -> Phases:
        """The phases of that argument; ConfigError for another value."""
        raise NotImplementedError  # each feature has its own

    def read(self, path: Path, mesh: Mesh, method: str) -> Any:
        """Phases of a scene by that file, `PlanPhases`; ConfigError where it is none."""
        raise NotImplementedError  # each feature has its own


def phased_features() -> tuple[Phased, ...]:
    """Hooks of all features."""
    return hooks_of(Phased)


def question_in(summary: ReadByName) -> ReadByName:
    """Entry on phases of a summary; empty where the scene has one."""
    return next((summary[each.key] for each in phased_features() if each.key in summary), {})
