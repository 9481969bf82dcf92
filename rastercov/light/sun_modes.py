"""Hours of sun as colours of faces."""

import numpy as np
from numpy.typing import ArrayLike

from rastercov.core.mesh import Mesh
from rastercov.report.modes import FeatureModes, Mode, Painted, on_scale


def by_hours(mesh: Mesh, hours: ArrayLike) -> Painted:
    """Hours, (F,), on a scale from 0 to the most of a face."""
    values = np.asarray(hours, np.float64)
    high = float(values[mesh.task_mask].max(initial=0.0)) or 1.0
    return on_scale(mesh, values / high, (0.0, high), "h", "no sun")


SUN = Mode("Sunlight", "Hours of sun, mean over each face.", by_hours, of="")
HOOKS = FeatureModes(sun=SUN)
