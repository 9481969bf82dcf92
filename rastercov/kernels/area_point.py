"""Points in convex pieces of faces, compiled by numba."""

from rastercov.kernels.exact_records import U, V
from rastercov.kernels.jit import allocation_free


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
