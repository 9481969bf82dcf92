"""Single points of the surface: why they are not covered, and the pieces they lie in; by numba.

Occlusion is a segment from the near plane to the point, traced through a tree of triangles.
`rastercov.reference.regions` judges points without a tree.
"""

import math
from collections import namedtuple

import numpy as np
from numpy.typing import NDArray

from rastercov.kernels.decision import COVERED, OCCLUDED, TOO_OBLIQUE, judge_point
from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free
from rastercov.kernels.mesh_tree import distance_to, hit_of

FloatArray = NDArray[np.float64]


Points = namedtuple("Points", "points normals two_sided own")
"""Points in a scene of diagonal 1 about the origin, their unit normals, and their triangles.

`own` is the triangle of each point in the order of the tree, -1 where it is not in it;
`two_sided` says whether either side counts.
"""


@allocation_free
def judge_points(
    points, lens, rules, corners, nodes, rotation, eye, near, margin, is_nearest, stack, reason,
    hider,
):  # fmt: skip
    """Find the first criterion that each point fails in one pose.

    Parameters
    ----------
    points, lens, rules
        Points; Lens or CurvedLens; `coverage.task.Rules` in a scene of diagonal 1.
    corners, nodes : (T, 3, 3), (2 L, 6) float64
        Tree of the triangles that hide.
    rotation, eye : (3, 3), (3,) float64
        world_from_camera of the pose; `eye` in the scene of diagonal 1.
    near, margin : float
        Depth of the near plane; distance from the point up to which a surface hides nothing.
    is_nearest : bool
        `hider` is the nearest triangle in front of each point. If not, it is any, and points beyond
        the largest angle of incidence are not asked.
    stack : (STACK_SIZE,) int64
        Scratch.
    reason, hider : (N,) uint8, (N,) int64
        Out: `Reason`, and the triangle that hides, -1 for none.
    """
    last = -1
    for i in range(points.points.shape[0]):
        x, y = points.points[i, 0] - eye[0], points.points[i, 1] - eye[1]
        z = points.points[i, 2] - eye[2]
        reason[i], depth = judge_point(
            lens, rules, rotation, near, x, y, z, points.normals, i, points.two_sided[i]
        )
        hider[i] = -1
        if reason[i] != COVERED and not (is_nearest and reason[i] == TOO_OBLIQUE):
            continue
        length, share = math.sqrt(x * x + y * y + z * z), near / depth
        reach = length * (1.0 - share) - margin
        if not reach > 0.0:
            continue
        at_x, at_y, at_z = eye[0] + share * x, eye[1] + share * y, eye[2] + share * z
        x, y, z, own = x / length, y / length, z / length, points.own[i]
        # What hides the point before it often hides this one, too.
        hit = last if not is_nearest and last != own else -1
        if hit < 0 or not 0.0 <= distance_to(corners, hit, at_x, at_y, at_z, x, y, z) <= reach:
            hit = hit_of(at_x, at_y, at_z, x, y, z, reach, own, is_nearest, corners, nodes, stack)
        if hit >= 0:
            reason[i], hider[i], last = OCCLUDED, hit, hit


@allocation_free
def find_covering(xy, face, order, of_face, corners, starts, boxes, row, slack, out):
    """Mark the poses that cover points of faces.

    Parameters
    ----------
    xy, face : (N, 2) float64, (N,) int32
        Points in the planes of their faces, metres.
    order, of_face : (M,) int64, (F + 1,) int64
        Pieces sorted by face; those of face f are order[of_face[f]] ... order[of_face[f + 1] - 1].
    corners, starts, row : (C, 2) float64, (M + 1,) int64, (M,) int32
        Pieces, counter-clockwise, and the row of the pose of each.
    boxes : (M, 4) float64
        Least and most x, least and most y of each piece.
    slack : float
        Distance beyond a side up to which a point is inside, metres.
    out : (N, P) bool
        Set to True where the pose covers the point.
    """
    for i in range(face.shape[0]):
        f, x, y = face[i], xy[i, U], xy[i, V]
        for at in range(of_face[f], of_face[f + 1]):
            piece = order[at]
            if x < boxes[piece, 0] - slack or x > boxes[piece, 1] + slack:
                continue
            if y < boxes[piece, 2] - slack or y > boxes[piece, 3] + slack or out[i, row[piece]]:
                continue
            first, last = starts[piece], starts[piece + 1]
            is_inside = True
            p = last - 1
            for q in range(first, last):
                along_x, along_y = corners[q, U] - corners[p, U], corners[q, V] - corners[p, V]
                value = along_x * (y - corners[p, V]) - along_y * (x - corners[p, U])
                if value < -slack * (abs(along_x) + abs(along_y)):
                    is_inside = False
                    break
                p = q
            if is_inside:
                out[i, row[piece]] = True
