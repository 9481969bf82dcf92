"""Parts of the faces that no camera covers: what a partition of covered parts leaves."""

from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from rastercov.base.threads import Once
from rastercov.coverage.area.division import NO_PIECES
from rastercov.coverage.area.frames import frames_of
from rastercov.coverage.area.union import Covered, RegionUnion

_WHOLE: WeakKeyDictionary[Covered, Once[Covered]] = WeakKeyDictionary()


def with_rest(covered: Covered) -> Covered:
    """The partition with the rest of the task faces, as further pieces of 0 views.

    Their areas are sums of the same cuts: with the others they make up the faces, to rounding.
    Computed at the first call, since dead zones and the coloured mesh both want it.
    """
    return _WHOLE.setdefault(covered, Once()).get(lambda: _with_rest(covered))


def _with_rest(covered: Covered) -> Covered:
    """See `with_rest`."""
    mesh, k = covered.mesh, len(covered.area)
    union = RegionUnion.of(covered, k + 1)
    # One more camera, which covers every face as a whole: what only it covers is the rest.
    is_asked = mesh.task_mask & (frames_of(mesh).areas > 0)
    union.unite(NO_PIECES, is_asked.astype(np.int64), np.zeros(mesh.n_faces))
    whole = union.covered()
    return replace(
        covered, xy=whole.xy, starts=whole.starts, face=whole.face, views=whole.views - 1
    )
