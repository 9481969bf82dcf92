"""Coverage models of the literature behind one signature, and ours.

    coverage(mesh, camera, poses, task, *, parameters) -> (P, F) float64

One file per row of Tables 2.1 and 3.1 of E. S. Eissa. Image Space Coverage Model. 2020, each headed
by its equations, its paper and its caveats. Beside the chain: nothing in it imports them.
docs/models.md compares what they look at.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rastercov.models import alarcon, image_space, mavrinac, scott, tarabanis, zhang

CoverageModel = Callable[..., NDArray[np.float64]]

MODELS: dict[str, CoverageModel] = {
    "tarabanis": tarabanis.coverage,
    "scott": scott.coverage,
    "mavrinac": mavrinac.coverage,
    "alarcon": alarcon.coverage,
    "zhang": zhang.coverage,
    "image_space": image_space.coverage,
}
"""The models by name, in the order of the tables."""

__all__ = ["MODELS", "CoverageModel"]
