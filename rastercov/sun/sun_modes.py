"""Hours of sun as colours of faces."""

from numpy.typing import ArrayLike

from rastercov.core.mesh import Mesh
from rastercov.report.modes import Mode, Painted, ReportHooks, up_to_most


def by_hours(mesh: Mesh, hours: ArrayLike) -> Painted:
    """Hours, (F,), on a scale from 0 to the most of a face."""
    return up_to_most(mesh, hours, 1.0, "h", "no sun")


SUN = Mode("Sunlight", "Hours of sun, mean over each part.", by_hours, of="")
HOOKS = ReportHooks(sun=SUN)
