"""The image space coverage model: field of view, resolution, focus and graded occlusion; ours.

    C = C_FOV C_R C_F C_V                                                                     (3.6)

with C_FOV (3.7), C_R = min(1, projected area / R_min) (3.8), C_F (3.12), and C_V the visible part
of the face's image (3.13), (3.14), computed with a proof or to rounding. `coverage.coverage` has
the criteria that we added, docs/appendix/equations.md the departures from the source.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. MASc thesis,
University of Windsor, 2020, section 3.3.

Caveats
-------
- The only model here that measures the hidden area of a face instead of testing vertices or
  centroids.
- With `Task(cap_resolution=False)`, as `Task.thesis()` has it, coverage can exceed 1.
"""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray
from rastercov.camera.camera import Camera
from rastercov.coverage.engine import METHODS
from rastercov.coverage.job import evaluate
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.models.base import Criteria, coverage_model


@dataclass(frozen=True, kw_only=True)
class ImageSpaceParameters:
    """Method of the model.

    Parameters
    ----------
    method : {"certified", "exact", "sampled"}
        Method that measures visibility, see `open_observer`.
    """

    method: str = "certified"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ConfigError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}")


@coverage_model(
    ImageSpaceParameters(),
    Criteria(
        field_of_view="yes",
        resolution="pixels",
        focus="yes",
        occlusion="graded area",
        angle="limit",
    ),
)
def coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: ImageSpaceParameters
) -> FloatArray:
    """Coverage of each face in each pose, (P, F), in [0, 1] where resolution is capped.

    Depends on all of the task.
    """
    method = parameters.method
    found = evaluate(mesh, camera, poses, task, by="face", method=method, fields=("coverage",))
    return found.coverage
