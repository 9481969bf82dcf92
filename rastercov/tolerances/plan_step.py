"""Step of a placement: coverage of its cameras under installation errors, drawn and proved."""

from dataclasses import dataclass, replace

import numpy as np

from rastercov.base import ByName, percent, plural
from rastercov.core.camera import Poses
from rastercov.placement.plan.entries import value_of
from rastercov.placement.plan.file import Plan, errors_at
from rastercov.placement.plan.goals import Objectives
from rastercov.placement.plan.phases import Product
from rastercov.placement.plan.run import Placement, Products, with_progress
from rastercov.shards import Progress
from rastercov.tolerances.assured import Assured, UnderErrors
from rastercov.tolerances.installation import InstallationError
from rastercov.tolerances.passes import Errors
from rastercov.tolerances.placement import Tolerance, tolerance

STEP = "tolerance"


@dataclass(frozen=True, eq=False)
class Tolerated(Product):
    """Coverage of placed cameras under installation errors.

    Attributes
    ----------
    placement : Placement
    drawn : Tolerance
        By random draws.
    proved : Assured or None
        Coverage that is certain, if the plan asks for a proof.
    """

    placement: Placement
    drawn: Tolerance
    proved: Assured | None

    word = STEP

    def summary(self) -> ByName:
        """See `Product`."""
        proof = {} if self.proved is None else {"proof": self.proved.summary()}
        return self.drawn.summary() | proof

    def lines(self) -> list[str]:
        """See `Product`."""
        proved = [] if self.proved is None else self.proved.lines()
        prepared, drawn = self.placement.prepared, self.drawn
        if not drawn.cameras:
            return proved
        error = f"{drawn.error.position_mm:g} mm, {drawn.error.angle_deg:g} deg"
        error += "" if prepared.cells is None else " (on patches)"
        kind = "of standard deviation" if drawn.error.distribution == "normal" else "up to"
        text = (
            f"with installation errors {kind} {error}: {percent(drawn.together.mean)} on average, "
            f"{percent(drawn.together.worst)} in the worst of {plural(drawn.draws, 'draw')}"
        )
        left = percent(drawn.cameras[drawn.critical].without)
        text += f"; losing {prepared.noun} {drawn.critical + 1} costs most: {left} remains"
        return [text, *proved]

    def section(self) -> str:
        """See `Product`."""
        from rastercov.report.pages import render  # with a page only

        return render(
            "tolerance.html",
            "rastercov.tolerances",
            tolerance=self.summary(),
            owner=self.placement.cameras.owner.tolist(),
            by_area=self.placement.prepared.cells is not None,
        )


def _tolerate(placement: Placement, objectives: Objectives, progress: Progress) -> Placement:
    prepared, cameras = placement.prepared, placement.cameras
    poses, selection = cameras.mounted, prepared.selection
    asked, proved = selection.tolerance, None
    error = value_of(asked, InstallationError)
    watched = with_progress(objectives.chosen, progress, len(poses) * (asked.draws + 1))
    drawn = tolerance(watched, poses, error, draws=asked.draws, seed=selection.seed)
    if asked.proof:  # nothing is selected by the proved area
        proved = UnderErrors(value_of(asked, Errors)).verdicts(
            prepared.plan, prepared.mesh, cameras.placed, placement.requirements, draws=0
        )
    made = Tolerated(placement, drawn, proved)
    return replace(placement, made={**placement.made, STEP: made})


class OfTolerance(Products):
    """Hooks of this feature."""

    demand = UnderErrors()
    steps = ((STEP, lambda result: result.prepared.selection.tolerance, _tolerate),)

    def check_before(self, plan: Plan) -> None:
        """See `Products`."""
        asked = plan.selection and plan.selection.tolerance
        if asked and asked.proof:
            with errors_at(plan.name, "selection.tolerance.proof"):
                n = len(plan.rig)
                poses = Poses.of(np.tile(np.eye(4), (n, 1, 1)), camera=range(n))
                UnderErrors(value_of(asked, Errors)).check(plan, poses)


HOOKS = OfTolerance()
