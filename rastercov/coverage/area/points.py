"""Points of a surface that poses cover, by their exact regions: for pictures and samples."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.memory import check_memory, read_only
from rastercov.coverage.area.frames import to_plane
from rastercov.coverage.area.polygons import boxes
from rastercov.coverage.area.regions import Regions
from rastercov.coverage.area.union import Covered, with_rest
from rastercov.coverage.area.zones import DeadZones

SLACK_REL = 1e-9
"""Distance outside a piece up to which a point counts as inside, relative to the diagonal: rounding
of points that lie on an outline."""


def covering_poses(regions: Regions, face: ArrayLike, points: ArrayLike) -> NDArray[np.bool_]:
    """Poses that cover points of the surface.

    Parameters
    ----------
    regions : Regions
        Of P poses.
    face : (N,) int array_like
        Face of each point.
    points : (N, 3) array_like
        Points on the faces, metres.

    Returns
    -------
    (N, P) bool
        Row i, column j: the pose `regions.pose_ids[j]` covers point i.
    """
    n_points, n_poses = len(np.asarray(face)), len(regions.pose_ids)
    check_memory(
        f"coverage of {n_points:,} points by {n_poses:,} poses",
        n_points * n_poses,
        "ask for fewer points at a time",
    )
    return _rows_at(regions, regions.pose, n_poses, face, points)


def zones_at(zones: DeadZones, face: ArrayLike, points: ArrayLike, n: int) -> NDArray[np.int64]:
    """(N,) dead zone of each point of faces (N,): its row, n for the n-th or later, -1 for none.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    face, points
        As for `covering_poses`.
    n : int
        Zones that are distinguished.
    """
    row = np.minimum(zones.zone, n).astype(np.int32)
    found = _rows_at(zones, row, n + 1, face, points)
    return np.where(found.any(axis=1), found.argmax(axis=1), -1)


def views_at(covered: Covered, face: ArrayLike, points: ArrayLike) -> NDArray[np.int64]:
    """(N,) cameras that cover each point of faces (N,), k of `covered` for k or more."""
    whole = with_rest(covered)
    found = _rows_at(whole, whole.views, len(covered.area) + 1, face, points)
    # On an outline a point is in several pieces.
    found[:, 0] |= ~found.any(axis=1)
    most: NDArray[np.int64] = len(covered.area) - found[:, ::-1].argmax(axis=1)
    return most


def _rows_at(
    pieces: Regions | DeadZones | Covered,
    row: NDArray[np.int32],
    n_rows: int,
    face: ArrayLike,
    points: ArrayLike,
) -> NDArray[np.bool_]:
    """(N, n_rows) whether points of faces lie in a piece of each row."""
    from rastercov.kernels import area_point

    mesh, faces = pieces.mesh, np.asarray(face, np.int64)
    found = np.zeros((len(faces), n_rows), np.bool_)
    order = np.argsort(pieces.face, kind="stable")
    of_face = np.searchsorted(pieces.face[order], np.arange(mesh.n_faces + 1))
    area_point.find_covering(
        read_only(to_plane(mesh, faces, points), np.float64), read_only(faces, np.int32),
        read_only(order, np.int64), read_only(of_face, np.int64),
        read_only(pieces.xy, np.float64), read_only(pieces.starts, np.int64),
        read_only(boxes(pieces.xy, pieces.starts), np.float64), read_only(row, np.int32),
        SLACK_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))), found,
    )  # fmt: skip
    return found
