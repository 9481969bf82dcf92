"""Entries on the rule of a rig in a plan."""

from typing import Literal

from rastercov.placement.plan.entries import Angle, Count, Entry, Name, PlanSections, Positive, Some


class RuleOfRig(Entry):
    """Entries of a rig: its rule."""

    rule: Literal["any", "all", "at_least"] | None = None
    """Cameras that must see a point together: all, at_least k, or any; by default of the file."""
    k: Count | None = None
    """Number of cameras, for rule at_least."""
    needs: Some[Name] | None = None
    """Cameras that must be among them, for rule at_least."""
    min_baseline_deg: Angle | None = None
    """Minimum angle between the rays to the widest pair of cameras, degrees, for rule all."""
    max_baseline_deg: Angle | None = None
    """Maximum angle between the rays to any two cameras, degrees, for rule all."""
    max_uncertainty: Positive | str | None = None
    """Maximum standard deviation of a point, m or text such as "50 um", for rule all."""
    noise_px: Positive | dict[str, Positive] | None = None
    """Standard deviation of image positions, px, one or a table by camera; for max_uncertainty."""
    stripes: Some[Name] | None = None
    """Devices that measure x alone: projectors of stripes along y, laser sheets."""


HOOKS = PlanSections(rig=RuleOfRig)
