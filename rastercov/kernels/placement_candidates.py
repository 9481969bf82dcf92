"""Compiled loop of `candidate_visibility`; `rastercov.reference.views` is the twin."""

from rastercov.kernels.decision import COVERED, STATISTICAL
from rastercov.kernels.jit import compiled


@compiled
def add_bounds(visibility, bound, kind, drawn, reason, edge_on, chosen, low, high, covering):
    """Add candidates to the bounds of the greatest visible fraction of some faces.

    Parameters
    ----------
    visibility, bound, kind, drawn, reason : (P, F)
        Figures of a `Coverage`: visible fraction, its bound and its kind, pixels, reason.
    edge_on : float
        Square pixels: an image of at most this area shows nothing, unless it was sampled.
    chosen : (F,) bool
        Faces to add to.
    low, high : (F,) float64
        Out: bounds, [0, 1].
    covering : (F,) int64
        Out: number of candidates that cover the face.
    """
    for p in range(visibility.shape[0]):
        for f in range(visibility.shape[1]):
            if not chosen[f]:
                continue
            value, error = visibility[p, f], bound[p, f]
            if value + error > high[f] and (drawn[p, f] > edge_on or kind[p, f] == STATISTICAL):
                high[f] = min(value + error, 1.0)
            if value - error > low[f]:
                low[f] = min(value - error, 1.0)
            covering[f] += reason[p, f] == COVERED
