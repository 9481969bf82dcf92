"""Points of a surface that poses cover, by their exact regions: for pictures and samples."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._memory import check_memory
from rastercov.area.frames import to_plane
from rastercov.area.regions import Regions

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
    from rastercov._jit import announce_compilation
    from rastercov.area import point_kernels
    from rastercov.criteria_kernels import read_only

    mesh, faces = regions.mesh, np.asarray(face, np.int64)
    n_poses = len(regions.pose_ids)
    check_memory(
        f"coverage of {len(faces):,} points by {n_poses:,} poses",
        len(faces) * n_poses,
        "ask for fewer points at a time",
    )
    announce_compilation(point_kernels.find_covering)
    found = np.zeros((len(faces), n_poses), np.bool_)
    order = np.argsort(regions.face, kind="stable")
    of_face = np.searchsorted(regions.face[order], np.arange(mesh.n_faces + 1))
    point_kernels.find_covering(
        read_only(to_plane(mesh, faces, points), np.float64), read_only(faces, np.int32),
        read_only(order, np.int64), read_only(of_face, np.int64),
        read_only(regions.xy, np.float64), read_only(regions.starts, np.int64),
        read_only(regions.pose, np.int32),
        SLACK_REL * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))), found,
    )  # fmt: skip
    return found
