"""Observer that finds the regions of each face beside its areas: visibility is computed once."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.camera.pose import Poses
from rastercov.camera.rig import Cameras
from rastercov.coverage.area.regions import RegionPass, Regions
from rastercov.coverage.engine import Engine
from rastercov.coverage.observer import OBSERVED, ExactObserver
from rastercov.coverage.task import Task
from rastercov.exact.figures import Figures
from rastercov.mesh import Mesh
from rastercov.raster.observation import Observation


@dataclass(frozen=True, eq=False)
class RegionObservation(Observation):
    """An `Observation`, and the regions that the same poses cover."""

    regions: Regions = field(kw_only=True)


class RegionObserver(ExactObserver):
    """Observer by method "certified" or "exact" whose observations are `RegionObservation`.

    One thread at a time may use it. With `only_task`, nothing is known of the visibility of
    occluders, by their bounds.

    Attributes
    ----------
    closed : (F,) bool
        Faces whose regions are left out from now on, such as those of `RegionUnion.closed`.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Cameras,
        task: Task,
        engine: Engine,
        *,
        only_task: bool = False,
    ) -> None:
        super().__init__(mesh, camera, engine)
        self._finder = RegionPass(mesh, camera, task, method=engine, only_task=only_task)
        self.closed: NDArray[np.bool_] = np.zeros(mesh.n_faces, np.bool_)

    def observe(self, poses: ArrayLike | Poses) -> RegionObservation:
        """Areas and regions of every face in each pose."""
        accepted = self._accepted(poses, OBSERVED)
        figures = Figures.room(len(accepted), self.mesh.n_faces)
        found = self._finder.find(accepted, closed=self.closed, figures=figures)
        visible, area, error, kind, clipped = figures
        return RegionObservation(visible, area, kind, error, clipped, regions=found)

    def close(self) -> None:
        """Release the memory."""
        super().close()
        self._finder.close()
