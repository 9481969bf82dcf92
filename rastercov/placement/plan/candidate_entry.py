"""An entry of `candidates` in a plan: one of all generators, those of features included."""

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from rastercov.base import hooks_of
from rastercov.placement.plan.entries import PlanSections
from rastercov.placement.plan.generator import Generator
from rastercov.placement.plan.generators import PerCavity, Reachable

if TYPE_CHECKING:
    CandidateEntry = Generator
else:
    _carried = [kind for each in hooks_of(PlanSections) for kind in each.carried()]
    _every = Union[(PerCavity, Reachable, *_carried)]
    CandidateEntry = Annotated[_every, Field(discriminator="generator")]
