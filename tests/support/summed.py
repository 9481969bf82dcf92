"""The sums of the engine over parts of a surface, by numpy."""

import numpy as np


def sums_of(levels, bounds, areas, part, views):
    """Covered areas of parts, their bound, what may be covered besides, and their area."""
    rows = []
    for number, own in enumerate(views):
        mine = part == number
        whole = areas[mine].sum()
        top = levels[own - 1][mine]
        most, surely = (np.minimum(top + each[mine], areas[mine]) for each in bounds)
        covered = [min(level[mine].sum(), whole) for level in levels]
        rows.append([*covered, min(bounds[1][mine].sum(), whole), (most - surely).sum(), whole])
    return np.array(rows).reshape(len(views), len(levels) + 3)
