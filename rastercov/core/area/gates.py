"""Areas that cameras of a rig cover together, from what each of them covers.

Cameras that count together, see `rastercov.core.camera.rule`, are on one side of the face, by the
sign of their height over its plane. Results have a row for each pose of such a rig, and one for
each pose of another camera: `rastercov.core.camera.rig.rows_of_result`.
"""

from collections.abc import Sequence

import numpy as np

from rastercov.base import hooks_of
from rastercov.core.area.feature import Feature
from rastercov.core.area.table import Cut, Regions, join
from rastercov.core.camera import Gate


def through(
    regions: Regions,
    gate: Gate,
    without: int = -1,
    cuts: Sequence[Cut] = (),
    *,
    one_side: bool = True,
) -> Regions:
    """Regions of rigs of one gate, whose cameras follow one another.

    With `without`, a camera, by the others: as if that camera covered everything. `cuts` are those
    of conditions, see `Condition.cut_of`.
    Without `one_side`, devices on both sides of a face count together.
    """
    n_rigs = len(regions.pose_ids) // gate.n
    rig, device = np.divmod(np.arange(len(regions.pose_ids)), gate.n)
    needs = np.isin(device, gate.needs)
    needed = np.where(needs, rig, -1)
    others = np.where(needs | (device == without), -1, rig)
    k = gate.k - len(gate.needs)

    def count(part: Regions, is_rear: bool) -> Regions:
        parts = count_part(part)
        for cut in cuts:
            parts = cut(parts, is_rear)
        for each in hooks_of(Feature):
            parts = each.cut_rigs(parts, gate, regions, without)
        return parts

    def count_part(part: Regions) -> Regions:
        if not gate.needs:
            return part.at_least(k, others, one_side=False)
        at_least = part.at_least(len(gate.needs), needed, one_side=False)
        if k <= 0:
            return at_least
        both = join([at_least, part.at_least(k, others, one_side=False)])
        return both.at_least(2, np.tile(np.arange(n_rigs), 2), one_side=False)

    return regions._by_side(count) if one_side else count(regions, False)
