"""Option of a motion file."""

from pathlib import Path
from typing import TYPE_CHECKING

from rastercov.cli.scene_files import SceneFile
from rastercov.core.mesh import Mesh

if TYPE_CHECKING:
    from rastercov.motion.plan_over_time import PlanMotion


class MotionOption(SceneFile):
    """Motion of bodies."""

    word = "motion"
    help = "Motion file: TOML with [[bodies]] and [motion], or poses (JSON, CSV, animated glTF)."

    def phases(self, path: Path, mesh: Mesh, method: str) -> "PlanMotion":
        """See `SceneFile`."""
        from rastercov.motion.plan_over_time import PlanMotion

        return PlanMotion.read(path, mesh, method)


HOOKS = MotionOption()
