"""Motion of bodies as an argument of queries: frames are phases of the scene."""

from pathlib import Path
from typing import TYPE_CHECKING

from rastercov.core.camera.rig import Phased
from rastercov.core.mesh import Mesh

if TYPE_CHECKING:
    from rastercov.motion.over_time import OfFrames
    from rastercov.motion.plan_over_time import PlanMotion


class OfMotion(Phased):
    """Motion of bodies, see `rastercov.motion.motion`."""

    word = "motion"
    help = "Motion file: TOML with [[bodies]] and [motion], or poses (JSON, CSV, animated glTF)."
    key = "over_time"

    def phases_of(self, mesh: Mesh, value: object) -> "OfFrames":
        """See `Phased`."""
        from rastercov.motion.over_time import OfFrames
        from rastercov.motion.regions import query_of

        return OfFrames(query_of(value, mesh))

    def read(self, path: Path, mesh: Mesh, method: str) -> "PlanMotion":
        """See `Phased`."""
        from rastercov.motion.plan_over_time import PlanMotion

        return PlanMotion.read(path, mesh, method)


HOOKS = OfMotion()
