"""Candidate poses before a facade: rows of a grid parallel to it, in the order of flight."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rastercov.base import ConfigError, members
from rastercov.base.typed import typed
from rastercov.core.camera import Camera, look_at
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.groups import names_of_groups
from rastercov.core.mesh.mesh import faces_of_groups, names_of
from rastercov.placement.candidates.ground import heights_at
from rastercov.placement.candidates.pool import DEFAULT, Candidates, Framing, roll_candidates
from rastercov.placement.candidates.refusals import Refusal
from rastercov.survey.strips import (
    check_count,
    check_overlap,
    distance_for,
    growth,
    image_sides,
)

LEAST_UPRIGHT = 0.1
"""Least length of the mean normal of a facade on the plan."""


@typed
def facade(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    distance: float | None = None,
    gsd: float | None = None,
    front: float = 0.8,
    side: float = 0.6,
    groups: Sequence[str] = (),
) -> Candidates:
    """Level views perpendicular to a facade, in rows of a grid before the plane of the facade.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls apply.
    distance : float, optional
        Distance from the part of the facade that protrudes most, metres; give this or `gsd`.
    gsd : float, optional
        Ground sampling distance there, on the optical axis, metres per pixel.
    front, side : float
        Overlap of neighbours in a row, and of neighbouring rows, as shares, [0, 1).
    groups : sequence of str
        Groups of the facade; all evaluated faces by default.

    Returns
    -------
    Candidates
        Row by row from the lowest, back and forth; `index` counts them. None is below the ground:
        see `above_ground`.

    Raises
    ------
    ConfigError
        For a value outside its range, and for faces whose mean normal is not to one side.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import facade
    >>> wall = rc.Mesh([(0, 0, 0), (10, 0, 0), (10, 0, 6), (0, 0, 6)], [(0, 1, 2), (0, 2, 3)])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = facade(wall, camera, distance=8)
    >>> len(result), result.sources
    (28, ('facade',))
    """
    check_overlap(front=front, side=side)
    away = distance_for(camera, distance, gsd, "distance")
    chosen = mesh.task_mask
    if names := members("groups", groups, str, "names of groups", ConfigError):
        wanted = names_of_groups("groups", names, names_of(mesh)) or set()
        chosen = faces_of_groups(mesh, wanted)
    normal = (mesh.areas[chosen, None] * mesh.normals[chosen])[:, :2].sum(axis=0)
    length = float(np.linalg.norm(normal))
    if not length > LEAST_UPRIGHT * float(mesh.areas[chosen].sum()):
        raise ConfigError(
            "expected faces of one side of a building, got some of all sides; name their groups"
        )
    outward = np.append(normal / length, 0.0)
    right = np.array((-outward[1], outward[0], 0.0))  # for who looks at it
    used = mesh.vertices[np.unique(mesh.faces[chosen])]
    across, down = image_sides(camera, framing)
    reach = growth(camera, away)
    u, v = used @ right, used[:, 2]
    columns = _places(u.min(), u.max(), (1 - front) * across * reach)
    rows = _places(v.min(), v.max(), (1 - side) * down * reach)
    check_count(len(columns) * len(rows))
    grid = [
        np.column_stack((columns[:: 1 - row % 2 * 2], np.full(len(columns), level)))
        for row, level in enumerate(rows.tolist())
    ]
    places = np.concatenate(grid)
    depth = float((used @ outward).max()) + away
    eyes = places[:, :1] * right + depth * outward + places[:, 1:] * np.array((0.0, 0.0, 1.0))
    poses = look_at(eyes, eyes - outward * away)
    return above_ground(mesh, roll_candidates(poses, "facade", np.arange(len(poses)), framing))


def above_ground(mesh: Mesh, candidates: Candidates, clearance: float = 0.0) -> Candidates:
    """Level views raised to a clearance, metres, above the ground below them.

    The ground is the lowest surface there, or the lowest level of the mesh beside it. Of views that
    are raised to the same place, the first stays; the others are refused.
    """
    ground = heights_at(mesh, candidates.poses[:, :2, 3], is_lowest=True)
    ground = np.where(np.isnan(ground), mesh.bounds[0, 2], ground)
    poses = candidates.poses.copy()
    poses[:, 2, 3] = np.maximum(poses[:, 2, 3], ground + clearance)
    kept = np.sort(np.unique(poses, axis=0, return_index=True)[1])
    left_out = candidates.take(np.setdiff1d(np.arange(len(candidates)), kept))
    refused = (
        Refusal(pose, name, "below_ground", "below the ground")
        for pose, name in zip(left_out.poses, left_out.source.tolist(), strict=True)
    )
    return replace(
        candidates.take(kept), poses=frozen(poses[kept]), refused=(*candidates.refused, *refused)
    )


def _places(low: float, high: float, step: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Places at equal steps, the first and the last at the ends or beyond."""
    span = high - low
    count = np.ceil(span / step * (1 - 1e-12)) + 1 if step > span / 1e12 else np.inf
    check_count(count)
    return (low + high) / 2 + (np.arange(int(count)) - (count - 1) / 2) * step
