"""Framing of a target by a view: stand-off, roll and up, (6.5)-(6.11).

Serves the generators of candidates: from groups of faces, camera axes and centres.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section
6.3.2.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.errors import ConfigError
from rastercov.base.typed import check_fields
from rastercov.camera.camera import Camera
from rastercov.camera.models import MODELS
from rastercov.camera.viewpoints import half_angles, look_at
from rastercov.mesh import Mesh
from rastercov.placement._arrays import FloatArray, IntArray

FITS = ("extent", "vertices")
FRAMING_MARGIN_REL = 1e-9
"""Relative margin that keeps targets inside the image and the depth of field after rounding."""


def check_stand_off(stand_off: tuple[float, float]) -> None:
    """Raise ConfigError unless the two distances are a range."""
    if len(stand_off) != 2 or not 0 <= stand_off[0] <= stand_off[1]:
        raise ConfigError(f"stand_off must be 0 <= least <= greatest, got {stand_off}")


def check_up(up: tuple[float, float, float]) -> None:
    """Raise ConfigError unless it is a direction."""
    if np.shape(up) != (3,) or not np.isfinite(up).all() or not any(up):
        raise ConfigError(f"up must be a direction of three numbers, got {up}")


@dataclass(frozen=True, kw_only=True)
class Framing:
    """Framing of the target of a candidate.

    Attributes
    ----------
    stand_off : (float, float)
        Least and greatest distance from the camera centre to its target, metres. A camera without
        depth of field has no least distance of its own, and is placed as near to a small face as
        its field of view allows.
    fit : {"extent", "vertices"}
        extent: (6.7), from the width and height of the target, as if it were flat and centred.
        vertices: the nearest distance at which all vertices are in view and beyond the near limit
        of the depth of field.
    margin : float
        Size of the image relative to the target, along both axes; > 0.
    rolls_deg : tuple of float
        Rotations about the optical axis, clockwise seen from behind; one candidate for each.
    up : (float, float, float)
        Up of (6.10); where the view is parallel to it, `look_at` takes another axis.
    max_blur : float, optional
        Blur limit in pixels for the depth of field; the camera's own unless given.
    """

    stand_off: tuple[float, float] = (0.0, np.inf)
    fit: str = "extent"
    margin: float = 1.0
    rolls_deg: tuple[float, ...] = (0.0,)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    max_blur: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        check_stand_off(self.stand_off)
        if self.fit not in FITS:
            raise ConfigError(f"fit must be {' or '.join(FITS)}, got {self.fit!r}")
        if not 0 < self.margin < np.inf:
            raise ConfigError(f"margin must be positive and finite, got {self.margin}")
        if not len(self.rolls_deg) or not np.isfinite(self.rolls_deg).all():
            raise ConfigError(f"rolls_deg must be one angle or more, got {self.rolls_deg}")
        check_up(self.up)

    def limits(self, camera: Camera) -> tuple[float, float]:
        """Least and greatest stand-off: within `stand_off` and the depth of field, metres."""
        z_n, z_f = camera.depth_of_field(self.max_blur)
        least = max(self.stand_off[0], z_n, camera.near)
        greatest = min(self.stand_off[1], z_f)
        if not least <= greatest:
            raise ConfigError(
                f"the stand-off {self.stand_off[0]:g} ... {self.stand_off[1]:g} m must meet the "
                f"depths {max(z_n, camera.near):g} ... {z_f:g} m that the camera sees sharply"
            )
        return least, greatest


DEFAULT = Framing()


def square_views(
    mesh: Mesh,
    camera: Camera,
    framing: Framing,
    faces: IntArray,
    group: IntArray,
    weights: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Axes (G, R, 3, 3) and eyes (G, R, 3) of views square to groups of faces, R rolls each.

    Parameters
    ----------
    faces, group : (N,) int64
        Members of each group; a face may be in several, and no group is empty.
    weights : (N,) float64, optional
        Weight of each member in the averages; all equal by default, as in the thesis.
    """
    least, greatest = framing.limits(camera)
    half_angles(camera)  # raises for a camera that cannot be aimed, even without groups
    n_groups, n_rolls = int(group.max(initial=-1)) + 1, len(framing.rolls_deg)
    if not n_groups:
        return np.zeros((0, n_rolls, 3, 3)), np.zeros((0, n_rolls, 3))
    order = np.argsort(group, kind="stable")
    faces, group = faces[order], group[order]
    starts = np.searchsorted(group, np.arange(n_groups))
    weight = np.ones((len(group), 1)) if weights is None else weights[order, None]
    total = np.add.reduceat(weight, starts)
    # Relative to the centre of the mesh, because a far offset costs precision.
    middle = mesh.bounds.mean(axis=0)
    target = np.add.reduceat(weight * (mesh.centroids[faces] - middle), starts) / total
    normal = np.add.reduceat(weight * mesh.normals[faces], starts)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    upright = look_at(normal, np.zeros(3), framing.up)[:, :3, :3]
    frames = rolled_frames(upright, framing.rolls_deg)
    corners = (mesh.vertices[mesh.faces[faces]] - middle) - target[group][:, None]
    distance = np.empty((n_groups, n_rolls))
    for roll in range(n_rolls):
        seen = corners @ frames[group, roll]
        fitting = fit_vertices if framing.fit == "vertices" else _fit_extent
        distance[:, roll] = fitting(camera, framing, seen, starts)
    distance = np.clip(distance, least, greatest)
    eyes = middle + target[:, None] + distance[..., None] * normal[:, None]
    return frames, eyes


def rolled_frames(rotations: FloatArray, rolls_deg: ArrayLike) -> FloatArray:
    """Camera axes turned about the view: (N, 3, 3) and (R,) -> (N, R, 3, 3).

    The x axis turns towards the y axis: the camera turns clockwise seen from behind, the image
    anticlockwise.
    """
    turns = turns_about_z(np.radians(np.asarray(rolls_deg, np.float64)))
    rolled: FloatArray = rotations[:, None] @ turns
    return rolled


def turns_about_z(angles: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations about z by N angles, radians; x turns towards y."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angles), -np.sin(angles)
    turns[:, 2, 2] = 1.0
    return turns


def _fit_extent(camera: Camera, framing: Framing, seen: FloatArray, starts: IntArray) -> FloatArray:
    """(G,) W/2 cot(HFOV/2) or H/2 cot(VFOV/2), the larger, of (N, 3, 3) corners in camera axes."""
    low = np.minimum.reduceat(seen.min(axis=1), starts)
    high = np.maximum.reduceat(seen.max(axis=1), starts)
    halves = framing.margin * (high - low)[:, :2] / 2
    distance: FloatArray = (halves / half_angles(camera)).max(axis=1)
    return distance


def fit_vertices(
    camera: Camera, framing: Framing, seen: FloatArray, starts: IntArray
) -> FloatArray:
    """(G,) distance from which all of (N, 3, 3) corners, from the target, are in view and focus.

    A vertex x across and z beyond the target is in view from d where |x| <= (d + z) tan(angle).
    Where not all can be in focus, the nearest ones are. Lenses without a plane in focus are in
    focus up to a distance, and a vertex off the axis is further away than its depth.
    """
    z_n, z_f = camera.depth_of_field(framing.max_blur)
    z_n = max(z_n, camera.near) * (1 + FRAMING_MARGIN_REL)
    offset = np.abs(seen[..., :2]) * (framing.margin * (1 + FRAMING_MARGIN_REL))
    depth = seen[..., 2]
    need = np.maximum((offset / half_angles(camera)).max(axis=-1), z_n) - depth
    distance = np.maximum.reduceat(need.max(axis=1), starts)
    furthest = z_f - depth
    if not MODELS[camera.model].is_planar:
        off_axis = np.hypot(seen[..., 0], seen[..., 1])
        furthest = np.sqrt(np.maximum((z_f - off_axis) * (z_f + off_axis), 0.0)) - depth
    before = np.minimum.reduceat(depth.min(axis=1), starts)
    most = np.minimum.reduceat(furthest.min(axis=1), starts)
    focused: FloatArray = np.maximum(np.minimum(distance, most), z_n - before)
    return focused
