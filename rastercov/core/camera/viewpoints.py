"""Poses from eyes and targets or on a sphere, and the distance at which a mesh fills the image."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    ConfigError,
    FloatArray,
    PoseError,
    arctan2,
    cos,
    finite_number,
    hypot,
    matmul,
    norm,
    shown,
    sin,
    tan,
)
from rastercov.base.arguments import MOST_POSES, own_array
from rastercov.core.camera.camera import Camera, border_of
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.pose import Poses, error_of, real_numbers
from rastercov.core.camera.projection import rays_of, to_image
from rastercov.core.mesh import Mesh
from rastercov.engine import camera_pose

WIDEST_DEG = 60.0
"""Angle from the axis of a lens without an ideal plane up to which targets are framed."""
LARGEST_ANGLE = math.radians(89.0)
"""Radians from the axis up to which a tangent is a length."""
BORDER_SAMPLES, ZOOMS = 257, 4
"""Samples of a border of the image, and how often it is sampled: the last time 2e-9 of the side
apart, and the error of a least value falls with its square."""

Z_IS_UP, LEAST_UP = 0.1, 0.5
"""Worth of z as the direction upwards beside the mean of cosines, and the least mean of others."""


def upwards(poses: ArrayLike | Poses) -> FloatArray:
    """The axis of the world, or its opposite, that is up by most poses, (P, 4, 4); (3,).

    Up by poses is the mean direction of the upper edge of their images, or where that does not
    oppose it the one behind them, as of images from above. z where they do not say: without poses,
    and where they turn in any way.
    """
    given = poses.world_from_camera if isinstance(poses, Poses) else poses
    matrices = np.asarray(given, np.float64).reshape(-1, 4, 4)
    axes = np.concatenate((np.eye(3)[::-1], -np.eye(3)))
    upper, behind = matmul((-matrices[:, :3, 1:3].sum(axis=0) / max(1, len(matrices))).T, axes.T)
    of_axes: FloatArray = np.where(upper < -Z_IS_UP, upper, np.maximum(upper, behind))
    of_axes[0] = max(of_axes[0] + Z_IS_UP, LEAST_UP)
    return np.array(axes[of_axes.argmax()])


def look_at(eyes: ArrayLike, targets: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> FloatArray:
    """Poses at `eyes` that look at `targets` with `up` upwards in the image.

    By (6.8)-(6.11) of E. S. Eissa (2020). Where the view is parallel to `up`, (6.10) is undefined;
    then the world axis furthest from the view takes its place: y for a view along z, z for one
    along y or x. The same applies if `up` is zero.

    Parameters
    ----------
    eyes, targets, up : (3,) or (P, 3) array_like
        Points and a direction in the world, metres; broadcast against each other.

    Returns
    -------
    (P, 4, 4) float64
        world_from_camera; P is 1 when all inputs are single.

    Raises
    ------
    PoseError
        Where an eye is its own target, or a value is not finite or beyond 1e30 m; `pose_ids` names
        the rows.

    Examples
    --------
    >>> import rastercov as rc
    >>> pose = rc.look_at((0, -2, 1), (0, 0, 1))[0]
    >>> pose[:3, 3].tolist()  # the eye
    [0.0, -2.0, 1.0]
    >>> pose[:3, 2].round(6).tolist()  # z of the camera is the direction of view
    [0.0, 1.0, 0.0]
    >>> pose[:3, 1].round(6).tolist()  # y of the camera is downwards in the image
    [0.0, 0.0, -1.0]
    """
    eye, target, upward = (
        _triples(name, a) for name, a in (("eyes", eyes), ("targets", targets), ("up", up))
    )
    try:
        eye, target, upward = np.broadcast_arrays(eye, target, upward)
    except ValueError:
        shapes = f"{eye.shape}, {target.shape}, {upward.shape}"
        raise PoseError(
            f"expected eyes, targets and 'up' of shapes that broadcast to (P, 3), got {shapes}"
        ) from None
    finite = np.isfinite(eye) & np.isfinite(target) & np.isfinite(upward)
    _refuse(~finite.all(axis=1), "expected finite eye, target and up, got inf or NaN")
    far = np.maximum(np.abs(eye), np.abs(target)) > LARGEST_COORDINATE
    _refuse(
        far.any(axis=1),
        f"expected eye and target within ±{LARGEST_COORDINATE:g} m, got larger coordinates",
    )

    same = (eye == target).all(axis=1)
    _refuse(same, "expected eye and target at different points, got the same")
    poses = np.empty((len(eye), 4, 4))
    eye, target, upward = map(np.ascontiguousarray, (eye, target, upward))
    camera_pose.look_at(eye, target, upward, poses)
    return poses


def cone_of_directions(axes: FloatArray, count: int, radius_deg: float) -> FloatArray:
    """(N, count, 3) unit vectors to the corners of polygons around cones of unit vectors (N, 3).

    The sides of the polygons touch the cones of that half angle.
    """
    across = look_at(np.zeros(3), axes)[:, :3, :2]
    turn = 2 * np.pi * (np.arange(count) + 0.5) / count
    radius = tan(math.radians(radius_deg)) / cos(math.pi / count)
    rim = radius * np.stack((cos(turn), sin(turn)), axis=-1)
    values = axes[:, None] + matmul(rim, np.swapaxes(across, 1, 2))
    return values / norm(values)[..., None]


def sphere_of_poses(centre: ArrayLike, distance: float, count: int) -> FloatArray:
    """Poses spread evenly over a sphere (a Fibonacci lattice), all looking at its centre.

    Parameters
    ----------
    centre : (3,) array_like
        What the cameras look at, metres.
    distance : float
        Radius of the sphere, metres, > 0.
    count : int
        Number of poses, >= 0.

    Returns
    -------
    (count, 4, 4) float64
        world_from_camera.

    Raises
    ------
    PoseError
        For a value outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> import rastercov as rc
    >>> poses = rc.sphere_of_poses((0, 0, 1), distance=2, count=100)
    >>> poses.shape
    (100, 4, 4)
    >>> np.linalg.norm(poses[:, :3, 3] - (0, 0, 1), axis=1).round(6).max().item()  # metres
    2.0
    """
    away = finite_number(distance)
    if not 0 < away <= LARGEST_COORDINATE:
        raise PoseError(
            f"expected distance to be above 0, at most {LARGEST_COORDINATE:g} m, got "
            f"{shown(distance)}"
        )
    number = finite_number(count)
    if not number.is_integer() or not 0 <= number <= MOST_POSES:
        raise PoseError(
            f"expected count to be a whole number from 0 to {MOST_POSES}, got {shown(count)}"
        )
    middle = _triples("centre", centre)
    if len(middle) != 1:
        raise PoseError(f"expected centre of shape (3,), got {middle.shape}")
    return look_at(middle + away * fibonacci_sphere(int(number)), middle)


def fibonacci_sphere(count: int, height: float = 2.0) -> FloatArray:
    """Unit vectors spread evenly over the part of a sphere from z = 1 down to 1 - `height`, (N, 3).

    A Fibonacci lattice: equal steps in z, and the golden angle in azimuth.
    """
    index = np.arange(count)
    z = 1 - height * (index + 0.5) / max(count, 1)
    azimuth = index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack((ring * cos(azimuth), ring * sin(azimuth), z), axis=1)


def enclosing_distance(
    mesh: Mesh, camera: Camera, centre: FloatArray, margin: float = 1.0
) -> tuple[float, float]:
    """Radius of the ball about `centre` that holds the mesh, and its viewing distance, metres.

    At this distance the ball touches the borders of the narrower field of view, where that is
    `margin` times smaller than the image. Parallel rays look from their working distance.
    """
    used = mesh.vertices[np.unique(mesh.faces)]
    radius = float(norm(used - centre).max())
    if camera.is_parallel:
        return radius, depth_of_targets(camera, radius)
    angle = arctan2(min(half_angles(camera)) / margin, 1.0)
    return radius, float(radius / sin(angle))


def depth_of_targets(camera: Camera, away: float, max_blur: float | None = None) -> float:
    """Depth at which parallel rays look at a target, metres.

    The working distance, the middle of the depths in focus, or where there is no limit `away` from
    the first of them.
    """
    z_n, z_f = camera.depth_of_field(max_blur)
    at = camera.focus_distance
    if at is None:
        at = max(z_n, camera.near) + away if math.isinf(z_f) else (z_n + z_f) / 2
    return at


CAMERA_SIZE = 0.05
"""Distance from every surface that a proposed camera keeps, for its body, metres."""


def distance_to_keep(cameras: Iterable[Camera]) -> float:
    """Distance from every surface that proposed cameras keep, metres.

    `CAMERA_SIZE`, or less for a lens that is in focus only nearer than twice that.
    """
    return min([CAMERA_SIZE, *(each.depth_of_field()[1] / 2 for each in cameras)])


SLANTED = 1.5
"""Times the distance that cameras keep, from which a place along a slanted direction keeps it."""
SPREAD = 0.7
"""Largest component across the normal of a face of the direction in which a camera is tried."""


def distances_to_try(
    size: float, whole: float, focus: Sequence[float], near: float, kept: float
) -> tuple[float, float]:
    """Least and greatest distance from which a camera is tried, metres.

    Parameters
    ----------
    size : float
        Diagonal of the surface, metres.
    whole : float
        Distance from which a camera sees all of it, metres.
    focus : (2,) sequence of float
        As of `Camera.depth_of_field`.
    near : float
        Depth of its near plane, metres.
    kept : float
        Distance that it keeps from the surface, metres.
    """
    least = max(0.02 * size, SLANTED * kept, 1.01 * near, 1.01 * focus[0])
    most = min(1.2 * max(whole, 0.5 * size), 0.99 * focus[1])
    return least, max(most, 1.01 * least)


def half_angles(camera: Camera) -> tuple[float, float]:
    """Tangents across and down of the pyramid around the optical axis that is all in view.

    A point with |x| <= across z and |y| <= down z is in the image. Where the axis of a pinhole is
    in the middle, these are the halves of its fields of view. Of other lenses they are the least
    tangents at which the rays of the borders leave the axis: the borders are curves that no point
    of the pyramid meets. Lenses without an ideal plane are aimed as if they saw no further than
    `WIDEST_DEG`: near their horizon, a surface that faces the camera is seen flatly. Of parallel
    rays, halves of the sides of the rectangle that is in view at any depth, metres.

    Raises
    ------
    ConfigError
        Where the axis is not in the image.
    """
    if camera.is_curved and camera.is_parallel:
        from rastercov.core.camera.lenses.of_camera import optics_of, unit_of

        tangents = half_angles(optics_of(camera))
        across, down = (unit_of(camera) * each for each in tangents)
        return across, down
    if not camera.is_curved:
        across = min(camera.cx, camera.width - camera.cx) / camera.fx
        down = min(camera.cy, camera.height - camera.cy) / camera.fy
        axis = camera.cx, camera.cy
        is_inside = across > 0 and down > 0
    else:
        axis = tuple(to_image(np.array((0.0, 0.0, 1.0)), camera).tolist())
        is_inside = 0 < axis[0] < camera.width and 0 < axis[1] < camera.height
        across, down = _inscribed_cone(camera) if is_inside else (0.0, 0.0)
    if not is_inside:
        raise ConfigError(
            f"expected the optical axis inside the image of {camera.width} x {camera.height} px, "
            f"got ({axis[0]:g}, {axis[1]:g}) px; correct cx and cy"
        )
    return across, down


def _inscribed_cone(camera: Camera) -> tuple[float, float]:
    """Tangents of `half_angles` of a lens that is no pinhole."""
    from rastercov.core.camera.lenses.of_camera import lens_of

    lens = lens_of(camera)
    top, right, bottom, left = (
        _least_tangent(camera, ends, axis)
        for axis, ends in zip((1, 0, 1, 0), border_of(camera.width, camera.height, 2), strict=True)
    )
    most = tan(math.radians(WIDEST_DEG))
    if MODELS[camera.model].is_planar:
        most = tan(min(lens.valid_angle, LARGEST_ANGLE))
    across, down = min(left, right, most), min(top, bottom, most)
    if not lens.is_whole and lens.valid_angle < LARGEST_ANGLE:
        # The valid region ends inside the image.
        cone = tan(lens.valid_angle)
        across, down = (side * min(1.0, cone / hypot(across, down)) for side in (across, down))
    return across, down


def _least_tangent(camera: Camera, ends: FloatArray, axis: int) -> float:
    """Least |x / z|, of axis 0, or |y / z| of the rays of a border (2, 2); inf if all are behind.

    The curve is sampled, and again on both sides of the least sample, until they agree.
    """
    first, last = 0.0, 1.0
    for _ in range(ZOOMS):
        steps = np.linspace(first, last, BORDER_SAMPLES)
        pixels = (1 - steps[:, None]) * ends[0] + steps[:, None] * ends[1]
        rays = rays_of(pixels, camera)
        with np.errstate(divide="ignore", invalid="ignore"):
            tangents = np.where(rays[:, 2] > 0, np.abs(rays[:, axis] / rays[:, 2]), np.inf)
        least = int(tangents.argmin())
        first, last = steps[max(least - 1, 0)], steps[min(least + 1, BORDER_SAMPLES - 1)]
    return float(tangents[least])


def _triples(name: str, value: ArrayLike) -> FloatArray:
    array = np.atleast_2d(real_numbers(name, value, "(3,) or (P, 3)"))
    if array.ndim != 2 or array.shape[1] != 3:
        raise PoseError(f"expected {name} of shape (3,) or (P, 3), got {array.shape}")
    return own_array(name, array, np.float64)


def _refuse(mask: ArrayLike, text: str) -> None:
    if rows := tuple(np.flatnonzero(mask).tolist()):
        raise error_of(rows, f": {text}")
