"""Compiled loops of ear clipping.

An ear is a convex corner whose triangle contains no other corner. Removing one ear after the other
leaves n - 2 triangles; each removal makes it necessary to test its two neighbours again, so 3 n
corners are tested in all. Only concave corners can lie in an ear's triangle. They are kept in a
complete binary tree of boxes, in the order of a Morton curve: node k has the children 2 k and
2 k + 1, leaf `size + i` has corner i of that order.

The winding number of the polygon is the sum of those of its triangles. If no triangle is wound
backwards, it is nowhere negative; if the same is true of the polygon's complement in a frame, it
is nowhere greater than one. Together they prove that the triangles cover the polygon exactly once
and that it does not cross itself.

Sources: G. H. Meisters. Polygons Have Ears. 1975. D. Eberly. Triangulation by Ear Clipping. 2002.
G. M. Morton. A Computer Oriented Geodetic Data Base. 1966.
"""

import numpy as np

from rastercov.kernels.jit import compiled, part_of

ROUNDING = 32 * float(np.finfo(np.float64).eps)
"""Error of a coordinate in the polygon's plane; coordinates are within about ±1."""
MOST_STEPS, FREE_STEPS = 1 << 11, 1 << 24
"""Most nodes of the tree visited, per corner of a polygon on average, and for any polygon; polygons
that need more keep their fan."""
SIMPLE, CROSSING, TOO_INTRICATE, UNPROVEN = 0, 1, 2, 3
STRICT, TOUCHING, FLAT, ANY = 0, 1, 2, 3  # criteria for an ear, tried in this order


@part_of
def turn(ax, ay, bx, by, cx, cy):
    """Twice the signed area of the triangle a b c; 0 where rounding decides its sign."""
    ux, uy, vx, vy = bx - ax, by - ay, cx - ax, cy - ay
    area = ux * vy - uy * vx
    limit = ROUNDING * (abs(ux) + abs(uy) + abs(vx) + abs(vy))
    return area if abs(area) > limit else 0.0


@part_of
def skip(node):
    """Next node of a traversal that skips the descendants of `node`; 1 at the end."""
    node += 1
    while node % 2 == 0:
        node //= 2
    return node


@compiled
def join_boxes(box, node):
    """Set the box of a node to the union of those of its children."""
    left, right = box[2 * node], box[2 * node + 1]
    box[node, 0] = min(left[0], right[0])
    box[node, 1] = min(left[1], right[1])
    box[node, 2] = max(left[2], right[2])
    box[node, 3] = max(left[3], right[3])


@compiled
def enters(xy, before, after, q, o, p, r):
    """True if an edge at corner q, which lies on p, points between the sides p o and p r."""
    px, py = xy[p, 0], xy[p, 1]
    for k in (before[q], after[q]):
        x, y = xy[k, 0], xy[k, 1]
        if (
            turn(xy[o, 0], xy[o, 1], px, py, x, y) > 0
            and turn(px, py, xy[r, 0], xy[r, 1], x, y) > 0
        ):
            return True
    return False


@compiled
def is_empty(xy, box, corner, before, after, a, b, c, level):
    """True if no corner of the tree lies in the triangle a b c; and the number of steps.

    The border belongs to the triangle if `level` is STRICT. A corner at one of its points lies in
    it if an edge continues from there into the triangle.
    """
    size = len(box) // 2
    ax, ay, bx, by, cx, cy = xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1], xy[c, 0], xy[c, 1]
    low_x, low_y = min(ax, bx, cx), min(ay, by, cy)
    high_x, high_y = max(ax, bx, cx), max(ay, by, cy)
    node, steps = 1, 0
    while True:
        steps += 1
        at = box[node]
        if at[0] <= high_x and at[1] <= high_y and at[2] >= low_x and at[3] >= low_y:
            if node < size:
                # the box is outside an edge if its nearest point is
                is_outside = False
                for px, py, qx, qy in ((ax, ay, bx, by), (bx, by, cx, cy), (cx, cy, ax, ay)):
                    x = at[0] if qy - py > 0 else at[2]
                    y = at[3] if qx - px > 0 else at[1]
                    if (qx - px) * (y - py) - (qy - py) * (x - px) < -ROUNDING:
                        is_outside = True
                if not is_outside:
                    node *= 2
                    continue
            else:
                q = corner[node - size]
                x, y = xy[q, 0], xy[q, 1]
                first = turn(ax, ay, bx, by, x, y)
                second = turn(bx, by, cx, cy, x, y)
                third = turn(cx, cy, ax, ay, x, y)
                if abs(x - ax) + abs(y - ay) <= ROUNDING:
                    is_inside = enters(xy, before, after, q, c, a, b)
                elif abs(x - bx) + abs(y - by) <= ROUNDING:
                    is_inside = enters(xy, before, after, q, a, b, c)
                elif abs(x - cx) + abs(y - cy) <= ROUNDING:
                    is_inside = enters(xy, before, after, q, b, c, a)
                elif level == STRICT:
                    is_inside = first >= 0 and second >= 0 and third >= 0
                else:
                    is_inside = first > 0 and second > 0 and third > 0
                if is_inside:
                    return False, steps
        node = skip(node)
        if node == 1:
            return True, steps


@compiled
def clip_ears(xy, leaf, box, triangles, most_steps):
    """Fill the (n - 2, 3) triangles of a polygon; CROSSING if one of them is wound backwards."""
    n, size = len(xy), len(box) // 2
    before, after = np.arange(-1, n - 1), np.arange(1, n + 1)
    before[0], after[n - 1] = n - 1, 0
    is_left, is_tested = np.ones(n, np.bool_), np.zeros(n, np.bool_)
    corner = np.empty(size, np.int64)
    box[:, :2], box[:, 2:] = np.inf, -np.inf
    for i in range(n):
        a, c = before[i], after[i]
        corner[leaf[i]] = i
        if turn(xy[a, 0], xy[a, 1], xy[i, 0], xy[i, 1], xy[c, 0], xy[c, 1]) <= 0:
            is_tested[i] = True
            at = box[size + leaf[i]]
            at[0], at[1], at[2], at[3] = xy[i, 0], xy[i, 1], xy[i, 0], xy[i, 1]
    for node in range(size - 1, 0, -1):
        join_boxes(box, node)

    queue = np.empty(3 * n, np.int64)
    n_left, n_cut, steps, first = n, 0, 0, 0
    is_folded = False
    for level in range(ANY + 1):
        head, tail, i = 0, 0, first
        for _ in range(n_left):
            queue[tail] = i
            tail += 1
            i = after[i]
        while head < tail and n_left > 2:
            i = queue[head]
            head += 1
            if not is_left[i]:
                continue
            a, c = before[i], after[i]
            area = turn(xy[a, 0], xy[a, 1], xy[i, 0], xy[i, 1], xy[c, 0], xy[c, 1])
            if n_left > 3 and level < ANY:
                if area < 0 or (area == 0 and level < FLAT):
                    continue
                if area > 0:
                    is_ear, more = is_empty(xy, box, corner, before, after, a, i, c, level)
                    steps += more
                    if steps > most_steps:
                        return TOO_INTRICATE
                    if not is_ear:
                        continue
            is_folded |= area < 0
            triangles[n_cut, 0], triangles[n_cut, 1], triangles[n_cut, 2] = a, i, c
            n_cut += 1
            n_left -= 1
            after[a], before[c] = c, a
            is_left[i], first = False, a
            for k in (i, a, c):
                if is_tested[k]:
                    p, q = before[k], after[k]
                    bend = turn(xy[p, 0], xy[p, 1], xy[k, 0], xy[k, 1], xy[q, 0], xy[q, 1])
                    if k == i or bend > 0:
                        is_tested[k] = False
                        node = size + leaf[k]
                        box[node, :2], box[node, 2:] = np.inf, -np.inf
                        node //= 2
                        while node:
                            join_boxes(box, node)
                            node //= 2
            queue[tail], queue[tail + 1] = a, c
            tail += 2
        if n_left <= 2:
            break
    return CROSSING if is_folded else SIMPLE


@compiled
def complement(xy, leaf):
    """Corners of a frame around a polygon and of the reversed polygon; and their leaves.

    A cut from the frame to the leftmost corner and back joins them into one polygon of n + 7
    corners.
    """
    n, leftmost = len(xy), 0
    for i in range(n):
        if xy[i, 0] < xy[leftmost, 0]:
            leftmost = i
    cut_y = xy[leftmost, 1]
    low_x, high_x = xy[:, 0].min() - 1, xy[:, 0].max() + 1
    low_y, high_y = xy[:, 1].min() - 1, xy[:, 1].max() + 1
    around, place = np.empty((n + 7, 2)), np.arange(n + 7)
    frame_x = (low_x, low_x, high_x, high_x, low_x, low_x)
    frame_y = (cut_y, low_y, low_y, high_y, high_y, cut_y)
    for i in range(6):
        around[i, 0], around[i, 1] = frame_x[i], frame_y[i]
    for i in range(n + 1):
        j = (leftmost - i) % n
        around[6 + i, 0], around[6 + i, 1] = xy[j, 0], xy[j, 1]
        if i < n:
            place[6 + i] = 7 + leaf[j]
    place[n + 6] = 6
    return around, place


@compiled
def cut_polygons(xy, leaf, starts, triangles, verdicts):
    """Triangulate every polygon; see `rastercov.mesh.formats.polygons.cut_concave`.

    Polygon p has the corners starts[p] ... starts[p + 1] - 1; its triangles, as indices into its
    own corners, begin at row starts[p] - 2 p. A polygon is UNPROVEN if none of its triangles is
    wound backwards, but one of its complement is: it overlaps or touches itself.
    """
    for p in range(len(starts) - 1):
        low, high = starts[p], starts[p + 1]
        n, size = high - low, 1
        while size < n + 7:
            size *= 2
        box = np.empty((2 * size, 4))
        most_steps = max(MOST_STEPS * n, FREE_STEPS)
        rows = triangles[low - 2 * p : high - 2 * p - 2]
        verdicts[p] = clip_ears(xy[low:high], leaf[low:high], box, rows, most_steps)
        if verdicts[p] == SIMPLE:
            around, place = complement(xy[low:high], leaf[low:high])
            rest = np.empty((n + 5, 3), np.int64)
            if clip_ears(around, place, box, rest, most_steps) != SIMPLE:
                verdicts[p] = UNPROVEN
