"""Fit of the thresholds of `requirement.DETECTOR` on scenes of their own.

    python -m rastercov.reference.markers.fit  # 2,000 scenes of seed 1, which no validation uses

The combination of a few round values that predicts most of those scenes is taken. Contour length
and border distance are not fitted: they follow from the detector's settings.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

from rastercov.reference.markers.detect import patterns
from rastercov.reference.markers.random_scenes import Outcome, run_random
from rastercov.reference.markers.render import MarkerRenderer
from rastercov.reference.markers.requirement import DETECTOR, Requirement

SEED, SCENES = 1, 2000
CELLS_WIDE = (0.0, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5)
BLURS = (1.2, 1.3, 1.4, 1.5, 1.6, 1.7)
VISIBILITIES = (0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995, 1.0)


def fitted(outcomes: Sequence[Outcome]) -> tuple[Requirement, int]:
    """The requirement that predicts most of some scenes, and their number; the first of equals."""
    best, most = DETECTOR, -1
    for cell, blur, visible in product(CELLS_WIDE, BLURS, VISIBILITIES):
        tried = replace(DETECTOR, min_cell=cell, max_blur_cells=blur, min_visibility=visible)
        right = sum(outcome.is_right(tried) for outcome in outcomes)
        if right > most:
            best, most = tried, right
    return best, most


def main() -> None:
    """Print the fit."""
    with MarkerRenderer(patterns()) as renderer:
        outcomes = run_random(renderer, SCENES, SEED, {}).outcomes
    best, right = fitted(outcomes)
    for name in ("min_cell", "max_blur_cells", "min_visibility"):
        print(f"{name:15} {getattr(best, name):g}")
    now = sum(outcome.is_right(DETECTOR) for outcome in outcomes)
    print(f"foretells {right} of {len(outcomes)}, those in use {now}")


if __name__ == "__main__":
    main()
