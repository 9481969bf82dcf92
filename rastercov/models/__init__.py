"""Coverage models of the literature behind one signature, and ours.

    coverage(mesh, camera, poses, task, *, parameters) -> (P, F) float64

One file per row of Tables 2.1 and 3.1 of E. S. Eissa. Image Space Coverage Model. 2020, each headed
by its equations, its paper and its caveats. A new model is a new file with a function decorated by
`base.coverage_model`, and a row of `MODELS`. docs/models.md compares the criteria of the models.
"""

from typing import Any

from rastercov.models import alarcon, image_space, mavrinac, scott, tarabanis, zhang
from rastercov.models.base import CoverageModel

MODELS: dict[str, CoverageModel[Any]] = {
    "tarabanis": tarabanis.coverage,
    "scott": scott.coverage,
    "mavrinac": mavrinac.coverage,
    "alarcon": alarcon.coverage,
    "zhang": zhang.coverage,
    "image_space": image_space.coverage,
}
"""The models by name, in the order of the tables."""

__all__ = ["MODELS", "CoverageModel"]
