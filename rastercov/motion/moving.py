"""Motion of bodies as an argument of queries: frames are phases of the scene."""

from pathlib import Path
from typing import TYPE_CHECKING

from rastercov.base import frozen_record
from rastercov.core.area.table import Regions
from rastercov.core.camera import Cameras, Poses
from rastercov.core.coverage.phases import Phased
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.motion.over_time import OverTime, TimeAreas, check_over_time, regions_in_shards
from rastercov.motion.regions import (
    MotionQuery,
    MovingFrames,
    carriers,
    query_of,
    regions_of_frames,
)
from rastercov.shards import Staff

if TYPE_CHECKING:
    from rastercov.motion.plan_over_time import PlanMotion


@frozen_record
class OfFrames:
    """Frames of a motion as `Phases`."""

    asked: MotionQuery

    def check(self, mesh: Mesh, camera: Cameras, poses: Poses, task: Task) -> None:
        """See `Phases`."""
        check_over_time(task)
        query_of(self.asked, mesh)
        carriers(self.asked, camera, poses[:0])  # refuses bodies

    def check_motion(self, placed: Poses) -> None:
        """See `Phases`."""
        self.asked._check_motion(placed)

    def images(self, placed: Poses) -> int:
        """See `Phases`."""
        return len(self.asked.motion) * len(placed)

    def regions(self, camera: Cameras, placed: Poses, task: Task, engine: Engine) -> Regions:
        """See `Phases`."""
        return regions_of_frames(self.asked, camera, placed, task, engine)

    def network(
        self, scene: tuple[Cameras, Poses, Task], engine: Engine, folder: Path | None, staff: Staff
    ) -> TimeAreas:
        """See `Phases`.

        Shards of some frames each stay in the folder, so that a run that was ended continues, and
        any number of frames is taken: docs/scale.md. The figures are the same to the bit.
        """
        if folder is None:
            return OverTime(self.asked, *scene, self.regions(*scene, engine)).areas
        job = MovingFrames.of(self.asked, *scene, engine)
        return OverTime(self.asked, *scene, regions_in_shards(job, folder, staff)).areas


class OfMotion(Phased):
    """Motion of bodies, see `rastercov.motion.motion`."""

    word = "motion"
    help = "Motion file: TOML with [[bodies]] and [motion], or poses (JSON, CSV, animated glTF)."
    key = "over_time"

    def phases_of(self, mesh: Mesh, value: object) -> OfFrames:
        """See `Phased`."""
        return OfFrames(query_of(value, mesh))

    def read(self, path: Path, mesh: Mesh, method: str) -> "PlanMotion":
        """See `Phased`."""
        from rastercov.motion.plan_over_time import PlanMotion

        return PlanMotion.read(path, mesh, method)


HOOKS = OfMotion()
