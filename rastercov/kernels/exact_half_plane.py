"""Visible areas by half planes, compiled by numba.

One pose runs through four passes: `exact_setup.project` and `exact_setup.set_up`;
`exact_grid.fill_grid`; and `visible_areas`, which takes one face at a time, finds its occluders
in the grid cells it touches, and subtracts from its image the part that each of them hides.

In the image w = 1/z is affine on a face, so the part of face T that face M hides is
T n M n {w_M > w_T}: a convex polygon. Subtracting a convex polygon from a convex piece leaves
convex pieces: each of its sides slices off the part beyond it. The pieces of T partition its
visible part, whatever the order of the occluders; a misjudged cut misplaces area, it never loses
any, so that the error is of the order of the rounding. No topology is kept that could become
inconsistent.

A target is scored but hides nothing, so no event edge of it exists: what is visible of it follows
from the opaque faces in front of it. They alone are listed in the grid.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np

from rastercov.kernels.exact_grid import cell, cells_of_box, likely_hider, sort_cell
from rastercov.kernels.exact_polygon import (
    clip,
    clip_subtract,
    contains,
    copy_polygon,
    drop_pieces,
    extent_of,
    keep_inside,
    length,
    outline,
    outline_error,
    plane_of,
    separates,
    separates_box,
    store_piece,
    twice_area,
)
from rastercov.kernels.exact_records import (
    BEHIND,
    DEPTH_TIE_REL,
    DOUBTFUL,
    DU,
    DV,
    IN_FRONT,
    IN_FRONT_IN_PART,
    LIVE,
    OFFSET,
    PARTLY,
    STACK_ROOM,
    THIN,
    TIED,
    TRANSPARENT,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    W_MAX,
    W_MIN,
    U,
    V,
)
from rastercov.kernels.exact_setup import EDGE_ON_FACTOR, OUTLINE_ERROR_FACTOR
from rastercov.kernels.jit import allocation_free, part_with_arrays

MOST_CELLS_OF_PART = 12
"""Cells of the grid that a face covers, beyond which it is taken apart by them."""
MOST_PIECES = 48
"""Pieces of a part of a face beyond which it is halved: each occluder is taken from each piece."""
MOST_HALVINGS = 6
"""Times that a part is halved: occluders with a common corner are not separated by any number."""
MOST_NUMBERS = 2**31 - 1
"""Numbers of targets, see `take_number`."""
NO_ROOM, ALL_HIDDEN, TOO_MANY = -1, -2, -3
"""Results of `visible_in_cells` other than an area."""


@part_with_arrays
def depth_order(t, m, n, n_sides, view, is_first):
    """Depth order of face m relative to face t, over the overlap of their images.

    The order is unknown where w differs by less than its error, a strip along the line of equal
    depth. The smaller the angle at which faces pierce each other, the wider the strip. Its area is
    added to `area_error` of t if `is_first`: the two are compared for the first time.

    `work.target` has the n corners of t, `work.lines` the `n_sides` lines that bound m. The result
    is `BEHIND`, `IN_FRONT`, `IN_FRONT_IN_PART` or `TIED`; for the third, the line of equal depth is
    appended to `work.lines`.
    """
    camera, projected, work, area_error = view.camera, view.projected, view.work, view.area_error
    faces, box, lines, spare = projected.faces, projected.box, work.lines, work.spare
    if box[m, W_MIN] > box[t, W_MAX] * (1 + 2 * DEPTH_TIE_REL):
        return IN_FRONT
    # The overlap, and the difference of w at its corners.
    copy_polygon(work.target, n, spare)
    n = clip(spare, n, lines, n_sides, work.other)
    if n < 3:
        return BEHIND
    u_t, v_t, w_t, a_t, b_t, error_t = plane_of(t, camera, projected)
    u_m, v_m, w_m, a_m, b_m, error_m = plane_of(m, camera, projected)
    least, most, first, apart = np.inf, -np.inf, 0.0, -np.inf
    for p in range(n):
        u, v = spare[p, U], spare[p, V]
        mine = w_t + a_t * (u - u_t) + b_t * (v - v_t)
        its = w_m + a_m * (u - u_m) + b_m * (v - v_m)
        nearer = its - mine
        if p == 0:
            first = nearer
        apart = max(apart, abs(nearer) - DEPTH_TIE_REL * max(mine, its))
        least, most = min(least, nearer), max(most, nearer)
    # The planes of two faces that share an edge meet along that edge and nowhere else.
    i, j, k = faces[t, 0], faces[t, 1], faces[t, 2]
    shared = 0
    for p in range(3):
        if faces[m, p] in (i, j, k):
            shared += 1
    error = error_t + error_m
    common = abs(twice_area(spare, n)) / 2
    if not is_first:
        pass
    elif abs(apart) <= error or (apart > 0 and max(most, -least) <= error):
        area_error[t] += common
    elif apart > 0 and shared < 2 and least <= error and most >= -error:
        u_min, u_max, v_min, v_max = extent_of(spare, n)
        extent = length(u_max - u_min, v_max - v_min, 0.0)
        strip = error / length(a_m - a_t, b_m - b_t, 0.0) * extent
        area_error[t] += min(strip, common)
    if apart <= 0:
        return TIED
    if shared >= 2:
        return IN_FRONT if most > -least else BEHIND
    if most <= 0:
        return BEHIND
    if least >= 0:
        return IN_FRONT
    # first + (a_m - a_t)(u - u0) + (b_m - b_t)(v - v0) >= 0
    lines[n_sides, U], lines[n_sides, V] = spare[0, U], spare[0, V]
    lines[n_sides, DU], lines[n_sides, DV], lines[n_sides, OFFSET] = b_m - b_t, a_t - a_m, first
    return IN_FRONT_IN_PART


@part_with_arrays
def lines_of_cell(column, row, grid, lines):
    """Lines that bound a cell of the grid; those at the border of the grid bound nothing."""
    left, right = grid.left + column / grid.per_u, grid.left + (column + 1) / grid.per_u
    top, bottom = grid.top + row / grid.per_v, grid.top + (row + 1) / grid.per_v
    set_line(lines, 0, left, 0.0, 0.0, -1.0, 0.0 if column > 0 else np.inf)
    set_line(lines, 1, right, 0.0, 0.0, 1.0, 0.0 if column + 1 < grid.columns else np.inf)
    set_line(lines, 2, 0.0, top, 1.0, 0.0, 0.0 if row > 0 else np.inf)
    set_line(lines, 3, 0.0, bottom, -1.0, 0.0, 0.0 if row + 1 < grid.rows else np.inf)


@part_with_arrays
def set_line(lines, row, u, v, du, dv, offset):
    """Fill a row of lines."""
    lines[row, U], lines[row, V] = u, v
    lines[row, DU], lines[row, DV], lines[row, OFFSET] = du, dv, offset


@part_with_arrays
def hides_all(m, t, n, view):
    """True if face m hides all of face t, whose n corners `work.target` has."""
    projected, work = view.projected, view.work
    box = projected.box
    if (
        m == t
        or box[m, U_MIN] > box[t, U_MIN]
        or box[m, U_MAX] < box[t, U_MAX]
        or box[m, V_MIN] > box[t, V_MIN]
        or box[m, V_MAX] < box[t, V_MAX]
        or box[m, W_MAX] < box[t, W_MIN] * (1 - 2 * DEPTH_TIE_REL)
        or projected.state[m] & (LIVE | DOUBTFUL) != LIVE
    ):
        return False
    _, n_sides = outline(m, projected, work.corners, work.lines)
    return (
        contains(work.lines, n_sides, work.target, n)
        and depth_order(t, m, n, n_sides, view, True) == IN_FRONT
    )


@part_with_arrays
def visible_in_cells(t, n, n_own, part, n_part, cells, limit, view, marks, pieces):
    """Twice the area that the faces listed in some cells leave of a part of face t.

    Parameters
    ----------
    t, n, n_own
        The face, its corners in `work.target`, and its lines in `work.own`.
    part, n_part : (24, 2) float64, int
        The part, within the cells.
    cells : tuple
        First and last column, first and last row.
    limit : int
        Number of pieces beyond which the part is left to be halved.
    view, marks, pieces
        As for `visible_areas`.

    Returns
    -------
    twice : float
        px^2; `NO_ROOM` if there are too many pieces for `pieces`; `TOO_MANY` if they are more than
        `limit`; `ALL_HIDDEN` if one face hides all of t.
    face : int
        The last face that hides something.
    """
    camera, projected, grid, work = view.camera, view.projected, view.grid, view.work
    box, state, area_error = projected.box, projected.state, view.area_error
    target, own, lines, corners = work.target, work.own, work.lines, work.corners
    farthest = box[t, W_MIN] * (1 - 2 * DEPTH_TIE_REL)
    u_t, v_t, w_t, a_t, b_t, error_t = plane_of(t, camera, projected)
    u_min, u_max, v_min, v_max = extent_of(part, n_part)
    copy_polygon(part, n_part, pieces.corners[0])
    pieces.n_corners[0], count = n_part, np.int64(1)
    last, number = np.int64(-1), marks[marks.shape[0] - 1]
    left, right, top, bottom = cells
    for at_cell in range((right - left + 1) * (bottom - top + 1)):
        column, row = left + at_cell % (right - left + 1), top + at_cell // (right - left + 1)
        at = row * grid.columns + column
        if not grid.is_sorted[at]:
            sort_cell(at, box, grid)
        for entry in range(grid.starts[at], grid.stops[at]):
            if grid.nearest[entry] < farthest:
                break
            m = grid.entries[entry]
            if box[m, U_MIN] >= u_max or box[m, U_MAX] <= u_min or m == t:
                continue
            if box[m, V_MIN] >= v_max or box[m, V_MAX] <= v_min:
                continue
            # Each face once: in the first of the cells that list it.
            if column != max(
                cell(box[m, U_MIN], grid.left, grid.per_u, grid.columns), left
            ) or row != max(cell(box[m, V_MIN], grid.top, grid.per_v, grid.rows), top):
                continue
            if separates_box(
                own, n_own, box[m, U_MIN], box[m, U_MAX], box[m, V_MIN], box[m, V_MAX]
            ):
                continue
            is_first = marks[m] != number
            around = common_extent(t, m, box)
            if state[m] & DOUBTFUL:
                if is_first:
                    marks[m] = number
                    error = outline_error(m, camera, projected)
                    area_error[t] += 4 * EDGE_ON_FACTOR * around * error
                if state[m] & THIN:
                    continue
            # The plane of t where it is farthest within the box of m: most faces that are before t
            # somewhere are far behind it here.
            u = max(box[m, U_MIN], u_min) if a_t > 0 else min(box[m, U_MAX], u_max)
            v = max(box[m, V_MIN], v_min) if b_t > 0 else min(box[m, V_MAX], v_max)
            along_u, along_v = a_t * (u - u_t), b_t * (v - v_t)
            rounding = error_t + 4 * DEPTH_TIE_REL * (abs(w_t) + abs(along_u) + abs(along_v))
            if box[m, W_MAX] < w_t + along_u + along_v - rounding:
                continue
            k, n_sides = outline(m, projected, corners, lines)
            if separates(lines, n_sides, target, n) or separates(own, n_own, corners, k):
                continue
            marks[m] = number
            order = depth_order(t, m, n, n_sides, view, is_first)
            if order == TIED:
                is_before = not state[t] & TRANSPARENT and projected.rank[m] < projected.rank[t]
                order = IN_FRONT if is_before else BEHIND
            if order == BEHIND:
                continue
            if order == IN_FRONT and contains(lines, n_sides, target, n):
                return ALL_HIDDEN, m
            if is_first:
                area_error[t] += 4 * around * outline_error(m, camera, projected)
            n_lines = n_sides + 1 if order == IN_FRONT_IN_PART else n_sides
            count = clip_subtract(
                pieces, count, lines, n_sides, n_lines, camera.pixel_error, work.spare, work.values
            )
            last = np.int64(m)
            if count == 0:
                return 0.0, last
            if count < 0:
                return NO_ROOM, last
            if count > limit:
                return TOO_MANY, last
    twice = 0.0
    for p in range(count):
        twice_piece = max(twice_area(pieces.corners[p], pieces.n_corners[p]), 0.0)
        twice += twice_piece
        if twice_piece > 0:
            store_piece(t, pieces.corners[p], pieces.n_corners[p], work.kept)
    return twice, last


@allocation_free
def halve(top, work):
    """Replace the part on top of the stack by its halves; returns how many that are."""
    parts, levels, spare = work.parts, work.levels, work.spare
    n, level = parts.n_corners[top], levels[top] + 1
    copy_polygon(parts.corners[top], n, spare)
    u_min, u_max, v_min, v_max = extent_of(spare, n)
    u, v = (u_min + u_max) / 2, (v_min + v_max) / 2
    is_across = u_max - u_min >= v_max - v_min
    n_halves = 0
    for half in range(2):
        inward = -1.0 if half == 0 else 1.0
        line = (u, v, 0.0, inward, 0.0) if is_across else (u, v, inward, 0.0, 0.0)
        kept = keep_inside(spare, n, line, parts.corners[top + n_halves])
        if kept >= 3:
            parts.n_corners[top + n_halves] = kept
            levels[top + n_halves] = level
            n_halves += 1
    return n_halves


@part_with_arrays
def take_number(marks):
    """Take the next number for a target, the last of `marks`, which are of zeros at first.

    The others are the numbers of the targets for which each face was looked at last.
    """
    last = marks.shape[0] - 1
    if marks[last] == MOST_NUMBERS:
        marks[:] = 0
    marks[last] += 1


@part_with_arrays
def visible_twice_area(t, n, n_own, view, marks, pieces):
    """Twice the visible area of face t, or `NO_ROOM`.

    A large face is taken apart by the cells of the grid, and parts of many pieces are halved.
    """
    grid, work = view.grid, view.work
    parts, levels = work.parts, work.levels
    left, right, top_row, bottom = cells_of_box(view.projected.box, t, grid)
    is_large = (right - left + 1) * (bottom - top_row + 1) > MOST_CELLS_OF_PART
    width, height = (1, 1) if is_large else (right - left + 1, bottom - top_row + 1)
    twice = 0.0
    for row in range(top_row, bottom + 1, height):
        for column in range(left, right + 1, width):
            cells = (column, column + width - 1, row, row + height - 1)
            middle = (row + height // 2) * grid.columns + column + width // 2
            copy_polygon(work.target, n, parts.corners[0])
            parts.n_corners[0] = n
            if is_large:
                lines_of_cell(column, row, grid, work.cell)
                parts.n_corners[0] = clip(parts.corners[0], n, work.cell, 4, work.spare)
                if parts.n_corners[0] < 3:
                    continue
            levels[0], top = 0, 1
            while top > 0:
                top -= 1
                can_halve = levels[top] < MOST_HALVINGS and top + 2 < STACK_ROOM
                limit = np.int64(MOST_PIECES) if can_halve else pieces.corners.shape[0]
                rest, face = visible_in_cells(
                    t, n, n_own, parts.corners[top], parts.n_corners[top], cells, limit, view,
                    marks, pieces,
                )  # fmt: skip
                if rest == ALL_HIDDEN:
                    grid.hider[middle] = face
                    return 0.0
                if rest == NO_ROOM:
                    return float(NO_ROOM)
                if rest == TOO_MANY:
                    top += halve(top, work)
                else:
                    twice += rest
                if rest == 0:
                    grid.hider[middle] = face
    return twice


@part_with_arrays
def common_extent(t, m, box):
    """Width and height together of the rectangle that the boxes of two faces share, pixels."""
    across = min(box[t, U_MAX], box[m, U_MAX]) - max(box[t, U_MIN], box[m, U_MIN])
    down = min(box[t, V_MAX], box[m, V_MAX]) - max(box[t, V_MIN], box[m, V_MIN])
    return across + down


@part_with_arrays
def extent_in_image(t, view):
    """Width and height together of the part of the box of a face that is in the image, pixels."""
    box, camera = view.projected.box, view.camera
    width = min(box[t, U_MAX], camera.width) - max(box[t, U_MIN], 0.0)
    return width + (min(box[t, V_MAX], camera.height) - max(box[t, V_MIN], 0.0))


@part_with_arrays
def take_target(t, view):
    """Fill `work.target` and `work.own` with the image of a face; its corners and its lines.

    Its own error begins the bound of the face. There are fewer than 3 corners outside the image.
    """
    camera, projected, work = view.camera, view.projected, view.work
    error = outline_error(t, camera, projected)
    view.area_error[t] = OUTLINE_ERROR_FACTOR * extent_in_image(t, view) * error
    n, n_own = outline(t, projected, work.target, work.own)
    if projected.state[t] & PARTLY:
        n = clip(work.target, n, camera.border, camera.border.shape[0], work.spare)
    return n, n_own


@part_with_arrays
def is_hidden_by_one(t, n, view):
    """True if a face that hid another one there hides all of a face, see `take_target`.

    Faces beside each other often have the same face before them. The figures of a target, and their
    bounds, must not depend on other targets.
    """
    if view.projected.state[t] & TRANSPARENT:
        return False
    hider = likely_hider(t, view.projected.box, view.grid)
    return hider >= 0 and hides_all(hider, t, n, view)


@part_with_arrays
def settle_area(t, seen, view, n_kept, n_kept_corners):
    """Store the visible area of a face, px^2, and drop its pieces if it is all or nothing.

    Remainders up to the rounding count as nothing, both of the visible and of the hidden part.
    """
    box, area, visible = view.projected.box, view.projected.area, view.visible
    tolerance = view.camera.pixel_error * (
        box[t, U_MAX] - box[t, U_MIN] + box[t, V_MAX] - box[t, V_MIN]
    )
    visible[t] = 0.0
    if seen > tolerance:
        visible[t] = area[t] if seen >= area[t] - tolerance else seen
    if visible[t] == 0 or visible[t] == area[t]:
        drop_pieces(view.work.kept, n_kept, n_kept_corners)


@allocation_free
def visible_areas(targets, first, view, marks, pieces):
    """Visible areas of some faces; returns how many of `targets` are done.

    If not all are, there is too little scratch memory, or room in `work.kept` where its `used` says
    so: call again with more and that number.

    Parameters
    ----------
    targets : (N,) int32
        Faces.
    first : int
        Those before this one are done.
    view : View
        With `Projected` as filled by `set_up`. Out: `visible` and `area_error` of the targets.
    marks : (F + 1,) int32
        Scratch, see `take_number`. `pieces` are scratch, too.
    """
    state, kept = view.projected.state, view.work.kept
    for index in range(first, targets.shape[0]):
        t = targets[index]
        n_kept, n_kept_corners = kept.used[0], kept.used[1]
        view.visible[t] = view.area_error[t] = 0.0
        if not state[t] & (LIVE | THIN):
            continue
        if state[t] & THIN:
            error = outline_error(t, view.camera, view.projected)
            view.area_error[t] = 4 * EDGE_ON_FACTOR * extent_in_image(t, view) * error
            continue
        n, n_own = take_target(t, view)
        if n < 3 or is_hidden_by_one(t, n, view):
            continue
        take_number(marks)
        twice = visible_twice_area(t, n, n_own, view, marks, pieces)
        if twice == NO_ROOM or kept.used[2]:
            drop_pieces(kept, n_kept, n_kept_corners)
            return index
        settle_area(t, twice / 2, view, n_kept, n_kept_corners)
    return targets.shape[0]
