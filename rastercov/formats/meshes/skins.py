"""Skins of glTF and COLLADA: vertices that the joints of a skeleton place, by linear blending.

x' = sum_k w_k M_k x / sum_k w_k, where M_k = world_from_joint @ joint_from_shape of the k-th
influence of a vertex. The node of a skinned mesh does not place it.

Sources: Khronos Group. glTF 2.0 Specification. 2021. Section 3.7.3. COLLADA - Digital Asset Schema
Release 1.4.1. 2008. Chapter 4, "Skin Deformation".
"""

from typing import NamedTuple

import numpy as np

from rastercov.base import BoolArray, FloatArray, WholeArray, dots
from rastercov.formats.meshes.polygons import check

BYTES_PER_POINT, BYTES_PER_INFLUENCE, BYTES_PER_JOINT = 250, 60, 1000
"""Memory while vertices are placed."""
SUM_TOLERANCE = 0.01
"""Difference of the sum of weights from 1 that is rounding."""


class Influences(NamedTuple):
    """Vertex, joint and weight of each influence, (N,)."""

    vertex: WholeArray
    joint: WholeArray
    weight: FloatArray


def place_skin(
    where: str, points: FloatArray, world_from_shape: FloatArray, by: Influences
) -> tuple[FloatArray, BoolArray, str]:
    """Points in the world, those where the skin is mirrored, and a note, or "".

    Parameters
    ----------
    where : str
        Name of the skin, for errors.
    points : (V, 3) float64
    world_from_shape : (J, 4, 4) float64
        By joint.
    by : Influences
    """
    n, n_joints = len(points), len(world_from_shape)
    is_used = by.weight != 0
    vertex, joint, weight = by.vertex[is_used], by.joint[is_used], by.weight[is_used]
    check(
        not len(joint) or (joint.min() >= 0 and joint.max() < n_joints),
        f"{where}: expected joints in 0 ... {n_joints - 1}, got {joint.min(initial=0)} ... "
        f"{joint.max(initial=0)}",
    )
    check(
        (weight > 0).all() and np.isfinite(weight).all(),
        f"{where}: expected finite weights of 0 or more, got others",
    )
    total = np.bincount(vertex, weight, n)
    check(
        (total > 0).all(),
        f"{where}: expected a weight above 0 of each vertex, got none of vertex {total.argmin()}",
    )
    entries = [
        np.bincount(vertex, weight * world_from_shape[joint, row, column], n) / total
        for row in range(3)
        for column in range(4)
    ]
    blend = np.stack(entries, axis=1).reshape(n, 3, 4)
    moved = dots(blend[:, :, :3], points[:, None]) + blend[:, :, 3]
    note = ""
    if (np.abs(total - 1) > SUM_TOLERANCE).any():
        sums = f"{total.min():.3g} to {total.max():.3g}"
        note = f"divided the weights of {where} by their sums, {sums}; they should be 1"
    return moved, np.linalg.det(blend[:, :, :3]) < 0, note
