"""Uncertainties as colours of faces."""

from rastercov.core.mesh import Mesh
from rastercov.report.modes import Mode, OfUnit, Painted, ReportHooks, by_density, invert


def by_deviation(mesh: Mesh, deviation: OfUnit) -> Painted:
    """Standard deviations by factors, up to the largest; the least is coloured as covered."""
    return invert(by_density(mesh, deviation, (0.0, 1.0)))


WORDS = "Largest standard deviation of measured points on each face, of any pose."
HOOKS = ReportHooks(uncertainty=Mode("Uncertainty", WORDS, by_deviation, of="gates"))
