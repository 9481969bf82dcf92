"""Field of view, resolution, focus and view angle as graded ramps, after Mavrinac et al.

For a point p of a face, with depth z, in the image at distance d from the border, and theta the
angle between the normal and the ray from p to the camera centre:

    C_V = ramp from d = 0 to d = padding                                     px
    C_R = ramp of z / f from acceptable to ideal                             mm per px
    C_F = ramp of A f |z - z_s| / (z (z_s - f)) from acceptable to ideal     px of blur circle
    C_D = (cos theta - cos acceptable) / (cos ideal - cos acceptable)
    C(p) = C_V C_R C_F C_D, and 0 where a face is between p and the camera centre
    C = mean of C(p) over the three vertices
    k-ocular: max over subsets of k cameras of min over cameras of the subset of C(p)

each clipped to [0, 1], a step where both limits are equal; f is in pixels, the smaller of fx and
fy, except C_F, which is the lens'. Through other lenses z / f is 1 / `base.facing_density`, and d
is measured in their image.

A. Mavrinac. Modeling and Optimizing the Coverage of Multi-Camera Systems. PhD dissertation,
University of Windsor, 2012.
A. Mavrinac, J. L. Alarcon Herrera, X. Chen. A Fuzzy Model for Coverage Evaluation of Cameras and
Multi-Camera Networks. Proc. 4th ACM/IEEE Int. Conf. on Distributed Smart Cameras, 95-102, 2010.
A. Mavrinac, X. Chen. Modeling Coverage in Camera Networks: A Survey. International Journal of
Computer Vision 101(1), 205-226, 2013.

Caveats
-------
- Table 2.1 of the thesis marks field of view alone as graded, Table 3.1 resolution alone. His own
  software, Adolphus, grades these two, focus and the angle; so does this file.
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
- Where a task gives no ideal value, the default is the strictest one: head-on, without blur; and a
  step for the border and for resolution, which have no strictest value.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import ConfigError
from rastercov.base.memory import BoolArray, FloatArray
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera, to_image
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.reference.criteria import depth_from_near
from rastercov.reference.criteria import measured_geometry as face_geometry
from rastercov.reference.models.base import (
    Criteria,
    check_number,
    coverage_model,
    each_pose,
    facing_density,
    focus_depth,
    ramp,
    required_density,
    seen_normals,
)
from rastercov.reference.models.line_of_sight import LineOfSight, check_tracer

LIMITS = {
    "padding": (1e9, "0 or more pixels"),
    "ideal_mm_per_px": (math.inf, "0 or more mm per px, or None"),
    "acceptable_mm_per_px": (math.inf, "0 or more mm per px, or None"),
    "ideal_blur": (math.inf, "0 or more pixels"),
    "acceptable_blur": (math.inf, "0 or more pixels, or None"),
    "ideal_incidence_deg": (90.0, "0 to 90"),
    "acceptable_incidence_deg": (90.0, "0 to 90, or None"),
}
"""Greatest value of each parameter (the least is 0), and the range in words."""


@dataclass(frozen=True, kw_only=True)
class MavrinacParameters:
    """Ideal and acceptable limits of the ramps, and the tracer of the model.

    Parameters
    ----------
    padding : float
        Distance from the border at which field of view is 1, px; 0 makes a step.
    ideal_mm_per_px, acceptable_mm_per_px : float, optional
        Length on the surface that one pixel covers. The acceptable one follows from the task unless
        given, see `base.required_density`; the ideal one equals the acceptable one unless given.
    ideal_blur, acceptable_blur : float
        Diameter of the blur circle, px; the acceptable one is the task's, or the camera's, unless
        given.
    ideal_incidence_deg, acceptable_incidence_deg : float
        View angle, degrees; the acceptable one is the task's `max_incidence_deg` unless given.
    tracer : {"auto", "embree", "own"}
        Implementation that traces the segments, see `LineOfSight`.

    Raises
    ------
    ConfigError
        For a value outside its range, or an ideal value worse than the acceptable one.
    """

    padding: float = 0.0
    ideal_mm_per_px: float | None = None
    acceptable_mm_per_px: float | None = None
    ideal_blur: float = 0.0
    acceptable_blur: float | None = None
    ideal_incidence_deg: float = 0.0
    acceptable_incidence_deg: float | None = None
    tracer: str = "auto"

    def __post_init__(self) -> None:
        for name, (high, words) in LIMITS.items():
            if getattr(self, name) is not None:
                check_number(name, getattr(self, name), 0.0, high, words)
        for what in ("mm_per_px", "blur", "incidence_deg"):
            ideal = getattr(self, f"ideal_{what}")
            acceptable = getattr(self, f"acceptable_{what}")
            if ideal is not None and acceptable is not None and ideal > acceptable:
                raise ConfigError(
                    f"ideal_{what} must not exceed acceptable_{what}, got {ideal:g} and "
                    f"{acceptable:g}"
                )
        check_tracer(self.tracer)


@coverage_model(
    MavrinacParameters(),
    Criteria(
        field_of_view="graded",
        resolution="graded",
        focus="graded",
        occlusion="vertices",
        angle="graded",
    ),
)
def coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: MavrinacParameters
) -> FloatArray:
    """Coverage of each face in each pose, (P, F) in [0, 1].

    Depends on `min_pixels`, `min_pixel_density`, `max_blur` and `max_incidence_deg` of the task.
    """
    points = strength_of_points(mesh, camera, poses, task, parameters=parameters)
    return points.mean(axis=2)


@coverage_model(MavrinacParameters())
def network_coverage(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: MavrinacParameters
) -> FloatArray:
    """Coverage of each face by all poses together, (F,): `Task.views`-ocular, point by point."""
    points = strength_of_points(mesh, camera, poses, task, parameters=parameters)
    return k_ocular(points, task.views).mean(axis=1)


def k_ocular(strength: ArrayLike, k: int) -> FloatArray:
    """Strength of the weakest of the best k cameras: (P, ...) -> (...).

    The maximum over subsets of k cameras of the minimum over each subset is the k-th greatest
    value. 0 where there are fewer than k cameras.

    Parameters
    ----------
    strength : (P, ...) array_like
        By camera.
    k : int
        At least 1.
    """
    values = np.asarray(strength, np.float64)
    check_number("k", k, 1, math.inf, "a whole number, 1 or more")
    if k != int(k):
        raise ConfigError(f"k must be a whole number, 1 or more, got {k}")
    if k > len(values):
        return np.zeros(values.shape[1:])
    return np.partition(values, len(values) - int(k), axis=0)[len(values) - int(k)]


@coverage_model(MavrinacParameters())
def strength_of_points(
    mesh: Mesh, camera: Camera, poses: ArrayLike, task: Task, parameters: MavrinacParameters
) -> FloatArray:
    """C(p) of the three vertices of each face, in the order of `mesh.faces`, (P, F, 3)."""
    with np.errstate(divide="ignore"):
        coarsest = (1e3 / required_density(mesh, task))[:, None]
    if parameters.acceptable_mm_per_px is not None:
        coarsest = np.full((mesh.n_faces, 1), parameters.acceptable_mm_per_px)
    finest = coarsest
    if parameters.ideal_mm_per_px is not None:
        finest = np.minimum(coarsest, parameters.ideal_mm_per_px)
    blurriest = _first(parameters.acceptable_blur, task.max_blur, camera.max_blur)
    flattest = _first(parameters.acceptable_incidence_deg, task.max_incidence_deg)
    steepest = min(parameters.ideal_incidence_deg, flattest)
    tracer = LineOfSight(mesh, parameters.tracer)

    def strength(pose: FloatArray, near: float) -> FloatArray:
        points = to_camera(mesh.vertices, pose)
        ahead = depth_from_near(points, camera) >= near
        points = np.where(ahead[:, None], points, (0.0, 0.0, 1.0))
        image = to_image(points, camera)
        ahead &= np.isfinite(image).all(axis=1)  # in the valid region of a lens
        image = np.where(ahead[:, None], image, 0.0)
        of_point = np.where(ahead, _within(image, camera, parameters.padding), 0)
        blur, in_range = blur_circle(camera, focus_depth(points, camera))
        of_point *= in_range * ramp(blur, blurriest, min(parameters.ideal_blur, blurriest))

        corners = points[mesh.faces]
        with np.errstate(divide="ignore"):
            coarseness = (1e3 / facing_density(points, camera))[mesh.faces]
        view = face_geometry(mesh, camera, pose)
        cosine = _cosine(corners, seen_normals(mesh, pose))
        graded = of_point[mesh.faces] * ramp(coarseness, coarsest, finest)
        graded *= ramp(-cosine, -_cos(flattest), -_cos(steepest))
        graded[~view.is_front] = 0.0

        # Only faces covered so far can be hidden: most segments need not be traced.
        graded[tracer.hides(mesh, graded > 0, pose, near, camera)] = 0.0
        return graded

    return each_pose(mesh, camera, poses, strength, (mesh.n_faces, 3))


def blur_circle(camera: Camera, depth: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Diameter of the blur circle in px at each depth, and the mask of depths in focus.

    A f |z - z_s| / (z (z_s - f)) over the smaller side of a pixel; 0 for a camera without a lens.
    A camera with a `focus_range` is in focus within that range only.
    """
    if camera.aperture is None or camera.focus_distance is None:
        z_n, z_f = camera.depth_of_field()
        return np.zeros_like(depth), (z_n <= depth) & (depth <= z_f)
    assert camera.focal_length is not None
    assert camera.pixel_size is not None
    size = camera.aperture / min(camera.pixel_size) * camera.focal_length
    size /= camera.focus_distance - camera.focal_length
    return size * np.abs(depth - camera.focus_distance) / depth, np.ones(depth.shape, dtype=bool)


def _within(image: FloatArray, camera: Camera, padding: float) -> FloatArray:
    """C_V of image points: (N, 2) -> (N,)."""
    u, v = image.T
    margin = np.minimum(np.minimum(u, camera.width - u), np.minimum(v, camera.height - v))
    return ramp(-margin, 0.0, -padding)


def _cosine(corners: FloatArray, normals: FloatArray) -> FloatArray:
    """Cosine between the normal and the ray from each corner to the camera centre, (F, 3)."""
    reach = np.linalg.norm(corners, axis=2)
    against = -np.einsum("fci,fi->fc", corners, normals)
    return np.divide(against, reach, out=np.zeros_like(reach), where=reach > 0)


def _cos(angle_deg: float) -> float:
    """Cosine of an angle, exactly 0 at 90 degrees."""
    return math.sin(math.radians(90.0 - angle_deg))


def _first(*values: float | None) -> float:
    """First value that is not None."""
    return next(value for value in values if value is not None)
