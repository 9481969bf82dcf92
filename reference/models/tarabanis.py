"""Field of view and resolution, after Tarabanis et al.

    V = 1 where |x| <= t z and |y| <= t z at every vertex, t the tangent of half the smaller angle
    R = min over edges AB of w(AB) / |AB|,   w(AB) = f |((A - o) x u) x v| / ((A - o).v (B - o).v)
    C = V min(1, R / R_req)

with o the camera centre, v the optical axis, u the direction of the edge, and w the length of the
edge in the image, in pixels, computed here as the distance of its end points in the image, which is
equal. R_req follows from the task, see `base.required_density`.

K. A. Tarabanis, R. Y. Tsai, P. K. Allen. The MVP Sensor Planning System for Robotic Vision Tasks.
IEEE Transactions on Robotics and Automation 11(1), 72-85, 1995.
K. A. Tarabanis, P. K. Allen, R. Y. Tsai. A Survey of Sensor Planning in Computer Vision. The same,
86-104, 1995.

Caveats
-------
- The tables of the thesis (2.1, 3.1) mark field of view and resolution only, and this file follows
  them. The MVP system itself also plans for focus and for occlusion; the tables understate it.
- In the papers resolution is a binary constraint on edges that the user chooses. It is graded here,
  as in the tables, and applied to all three edges of a face.
- The field of view is the pyramid of the smaller angle of view (thesis, 2.2.4.1), so a face at the
  long sides of the image is outside. With a principal point off the centre it is the widest such
  pyramid within the image.
- A face seen from behind is not covered. This is our addition; the tables mark no such criterion.
"""

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import to_image
from rastercov.reference.models.base import ModelCriteria, ModelView, coverage_model


@coverage_model(
    ModelCriteria(
        field_of_view="pyramid of the smaller angle of view",
        resolution="px/m along the worst edge, graded",
    ),
    pinhole_because="its edges are straight in the image",
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,) in [0, 1].

    Depends on `min_pixels` and `min_pixel_density` of the task.
    """
    camera, points, faces = view.camera, view.points, view.mesh.faces
    slope = min(
        min(camera.cx, camera.width - camera.cx) / camera.fx,
        min(camera.cy, camera.height - camera.cy) / camera.fy,
    )
    ahead = points[:, 2] >= view.near
    within = ahead & (np.abs(points[:, :2]).max(axis=1) <= slope * points[:, 2])
    seen = view.faces.is_front & within[faces].all(axis=1)
    image = to_image(np.where(ahead[:, None], points, (0.0, 0.0, 1.0)), camera)[faces]
    corners = points[faces]
    length = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    pixels = np.linalg.norm(np.roll(image, -1, axis=1) - image, axis=2)
    density = np.divide(pixels, length, out=np.zeros_like(pixels), where=length > 0)
    return np.where(seen, view.share(density.min(axis=1)), 0.0)
