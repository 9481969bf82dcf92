"""Visible fractions of faces alone, for laws about them."""

from rastercov.core.coverage.coverage import evaluate_batches, open_observer

FRACTION = "visibility", "visibility_bound", "visibility_kind"


def visibility(mesh, camera, poses, method="certified"):
    with open_observer(mesh, camera, method) as observer:
        return fractions_of(observer, poses)


def fractions_of(observer, poses):
    """`Coverage` of one batch, with the figures of `FRACTION` alone."""
    (result,) = evaluate_batches(observer, poses, fields=FRACTION)
    return result
