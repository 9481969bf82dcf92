"""Entries on installation errors in a plan."""

from rastercov.placement.plan.entries import Count, Entry, PlanSections, fields_of
from rastercov.tolerances.installation import InstallationError


class ToleranceSection(fields_of(InstallationError)):  # type: ignore[misc] # a base made of fields
    """Installation errors, and the coverage they cost."""

    draws: Count = 200
    """Number of installations to draw."""
    proof: bool = False
    """Also prove the area that is covered under any errors; with standard deviations, in 99 % of
    installations."""


class ToleranceOfSelection(Entry):
    """Entries of every goal."""

    tolerance: ToleranceSection | None = None
    """Installation errors to simulate."""


HOOKS = PlanSections(selection=ToleranceOfSelection)
"""Hooks of this feature."""
