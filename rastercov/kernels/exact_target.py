"""Visible areas of targets by half planes, compiled by numba.

A target is scored but hides nothing, so no event edge of it exists: what is visible of it follows
from the opaque faces in front of it. They alone are listed in the grid.
"""

from rastercov.kernels.exact_grid import cell_at
from rastercov.kernels.exact_half_plane import visible_areas
from rastercov.kernels.exact_records import U_MAX, U_MIN, V_MAX, V_MIN
from rastercov.kernels.jit import allocation_free


@allocation_free
def target_areas(targets, first, camera, projected, grid, marks, pieces, work, visible, area_error):
    """Visible areas of targets; arguments and result as of `exact_half_plane.visible_areas`.

    The face that hid another target there is forgotten before each: the figures of a target, and
    their bounds, must not depend on other targets.
    """
    box = projected.box
    for index in range(first, targets.shape[0]):
        t = targets[index]
        u, v = (box[t, U_MIN] + box[t, U_MAX]) / 2, (box[t, V_MIN] + box[t, V_MAX]) / 2
        grid.hider[cell_at(u, v, grid)] = -1
        done = visible_areas(
            targets[index : index + 1], 0, camera, projected, grid, marks, pieces, work, visible,
            area_error,
        )  # fmt: skip
        if done == 0:
            return index
    return targets.shape[0]
