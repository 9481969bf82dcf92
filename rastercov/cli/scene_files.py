"""Further files of a scene, such as features read: an option of `evaluate` each."""

from pathlib import Path
from typing import TYPE_CHECKING

from rastercov.base import hooks_of
from rastercov.core.mesh import Mesh

if TYPE_CHECKING:
    from rastercov.placement.plan.phases import PlanPhases


class SceneFile:
    """Hooks of a feature that reads a file, which do nothing here."""

    word = ""
    """Name of the option."""
    help = ""
    """Its words."""

    def phases(self, path: Path, mesh: Mesh, method: str) -> "PlanPhases | None":
        """Phases of a scene by the file; ConfigError where it is none."""
        return None


class SceneFiles(dict[str, Path | None]):
    """Files by the names of their options, None for those that are not given."""

    def phases(self, mesh: Mesh, method: str = "certified") -> "PlanPhases | None":
        """Phases of a scene by the file that gives some; None without."""
        for each in scene_files():
            if (path := self.get(each.word)) is not None:
                return each.phases(path, mesh, method)
        return None


def scene_files() -> tuple[SceneFile, ...]:
    """Hooks of all features."""
    return hooks_of(SceneFile)
