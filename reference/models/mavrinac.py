"""Field of view, resolution, focus and view angle as graded ramps, after Mavrinac et al.

For a point p of a face, with depth z, theta the angle between the normal and the ray from p to the
camera centre:

    C_V = 1 where p is in the image
    C_R = 1 where z / f is at most the acceptable                            mm per px
    C_F = ramp of A f |z - z_s| / (z (z_s - f)) from acceptable to 0         px of blur circle
    C_D = (cos theta - cos acceptable) / (1 - cos acceptable)
    C(p) = C_V C_R C_F C_D, and 0 where a face is between p and the camera centre
    C = mean of C(p) over the three vertices

each clipped to [0, 1]; f is in pixels, the smaller of fx and fy, except C_F, which is the lens'.
Through other lenses z / f is 1 / `base.facing_density`. The acceptable values are those of the
task, see `base.required_density`.

A. Mavrinac. Modeling and Optimizing the Coverage of Multi-Camera Systems. PhD dissertation,
University of Windsor, 2012.
A. Mavrinac, J. L. Alarcon Herrera, X. Chen. A Fuzzy Model for Coverage Evaluation of Cameras and
Multi-Camera Networks. Proc. 4th ACM/IEEE Int. Conf. on Distributed Smart Cameras, 95-102, 2010.
A. Mavrinac, X. Chen. Modeling Coverage in Camera Networks: A Survey. International Journal of
Computer Vision 101(1), 205-226, 2013.

Caveats
-------
- Table 2.1 of the thesis marks field of view alone as graded, Table 3.1 resolution alone. His own
  software, Adolphus, grades these two, focus and the angle.
- The focus ramp of Adolphus is linear in depth between the depths where the blur circle has its two
  limits; here it is linear in the blur circle itself. They agree at the limits.
- Until 11 December 2012 Adolphus used 2 atan(w / 2) for the half angle of view whose tangent is w,
  which is wider than a pinhole's, and compared its sine with x / z (a border within the image's),
  since January 2012 its tangent (one beyond it). Since then it uses atan(w), and its border is the
  image's, as here.
- The strength of a face is the mean over its points, as in his task models: with one hidden vertex
  of three it keeps two thirds, where Zhang gives 0. The points are the vertices of the face with
  the normal of the face.
- Resolution depends on the depth alone; the orientation of a face enters by the angle. Adolphus
  also has an upper limit on resolution, for surfaces that are too near; a task has none, so it is
  left out.
- In his software the border and resolution are ramps, too, to a padding and an ideal. A task gives
  neither: ideal is the strictest value, head-on and without blur, and the border and resolution,
  which have no strictest value, are steps.
"""

import math

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import to_image
from rastercov.reference.coverage import blur_circle, depth_from_near
from rastercov.reference.models.base import (
    ModelCriteria,
    ModelView,
    coverage_model,
    facing_density,
    focus_depth,
    ramp,
    required_density,
)


@coverage_model(
    ModelCriteria(
        field_of_view="image",
        resolution="mm per px",
        focus="blur circle, graded",
        occlusion="bivalent, per vertex",
        angle="graded",
    )
)
def coverage(view: ModelView) -> FloatArray:
    """Coverage of each face, (F,) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `max_incidence_deg` of the task.
    """
    return strength_of_points(view).mean(axis=1)


def strength_of_points(view: ModelView) -> FloatArray:
    """C(p) of the three vertices of each face, in the order of `mesh.faces`, (F, 3)."""
    camera, faces = view.camera, view.mesh.faces
    ahead = depth_from_near(view.points, camera) >= view.near
    points = np.where(ahead[:, None], view.points, (0.0, 0.0, 1.0))
    corners = points[faces]
    image = to_image(points, camera)
    with np.errstate(invalid="ignore"):  # outside the valid region of a lens
        inside = (image >= 0) & (image <= (camera.width, camera.height))
    graded = ((ahead & inside.all(axis=1)) * _sharpness(view, points))[faces]
    # Not finer than required: coarseness may be at most 1 / required.
    with np.errstate(divide="ignore"):
        coarseness = (1.0 / facing_density(points, camera))[faces]
        graded *= coarseness <= (1.0 / required_density(view.mesh, view.task))[:, None]
    reach = np.linalg.norm(corners, axis=2)
    against = -np.einsum("fci,fi->fc", corners, view.normals)
    cosine = np.divide(against, reach, out=np.zeros_like(reach), where=reach > 0)
    # The cosine of 90 degrees is exactly 0.
    flattest = math.sin(math.radians(90.0 - view.task.max_incidence_deg))
    graded *= ramp(-cosine, -flattest, -1.0)
    graded[~view.faces.is_front] = 0.0
    # Only faces covered so far can be hidden: most segments need not be traced.
    graded[view.find_hidden(graded > 0)] = 0.0
    return graded


def _sharpness(view: ModelView, points: FloatArray) -> FloatArray:
    """C_F of points in camera axes, (N,); a camera with a `focus_range` is sharp within it."""
    camera, depth = view.camera, focus_depth(points, view.camera)
    if camera.aperture is None or camera.focus_distance is None:
        z_n, z_f = camera.depth_of_field()
        return ((z_n <= depth) & (depth <= z_f)).astype(np.float64)
    limit = camera.max_blur if view.task.max_blur is None else view.task.max_blur
    return ramp(np.abs(blur_circle(camera, depth)), limit, 0.0)
