"""Field of view, focus and resolution with its cosine, after Scott.

    V = 1 where all vertices are inside the image (3.7)
    F = 1 where all vertices are within the depth of field (3.10)-(3.12)
    R = f cos(theta) / z at the centroid, theta between the normal and the ray to the camera centre
    C = V F min(1, R / R_req)

with f the smaller of fx and fy, and R_req in pixels per metre, see `base.required_density`. Through
other lenses f / z is `base.facing_density`.

W. R. Scott. Model-based view planning. Machine Vision and Applications 20(1), 47-69, 2009.
W. R. Scott, G. Roth, J.-F. Rivest. View Planning for Automated Three-Dimensional Object
Reconstruction and Inspection. ACM Computing Surveys 35(1), 64-96, 2003.

Caveats
-------
- Scott plans for range sensors, and his measurability matrix is binary: a point is measured where
  sampling density and precision are sufficient. Here the density along the surface's worst
  direction is graded, for a plain camera and including the cosine; his precision is a property of
  triangulation and does not apply to one camera.
- The tables of the thesis (2.1, 3.1) mark no occlusion. His matrix excludes shadowed points, so the
  tables understate it; this file follows the tables.
- f cos(theta) / z is the density along the worst direction of a face on the optical axis; off it
  the exact one differs (`criteria.face_geometry` has it).
"""

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import to_camera
from rastercov.reference.models.base import ModelCriteria, ModelView, coverage_model, facing_density


@coverage_model(
    ModelCriteria(
        field_of_view="image",
        resolution="px/m at the centroid, graded",
        focus="depth of field",
        angle="part of resolution",
    )
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `focus_rule` of the task.
    """
    # A face of a two-sided group may be seen from either side.
    cosine = np.abs(np.cos(view.faces.incidence))
    density = cosine * facing_density(to_camera(view.mesh.centroids, view.pose), view.camera)
    return np.where(view.in_view_and_focus, view.share(density), 0.0)
