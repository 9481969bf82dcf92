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

from rastercov.base import FloatArray
from rastercov.core.coverage.job import evaluate
from rastercov.reference.models.base import ModelCriteria, ModelView, coverage_model


@coverage_model(
    ModelCriteria(
        field_of_view="image",
        resolution="pixels of the face, graded",
        focus="depth of field",
        occlusion="visible area, graded",
        angle="limit",
    )
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,), in [0, 1] where resolution is capped; method certified.

    Depends on all of the task.
    """
    scene = view.mesh, view.camera, view.pose
    return evaluate(*scene, view.task, by="face", fields=("coverage",)).coverage[0]
