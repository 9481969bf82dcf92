"""Coverage models of the literature behind one signature, and ours.

    MODELS[name](mesh, camera, poses, task) -> (P, F) float64

One file per row of Tables 2.1 and 3.1 of E. S. Eissa. Image Space Coverage Model. 2020, each headed
by its equations, its paper and its caveats. A new model is a new file of this package with a
function `coverage` decorated by `base.coverage_model`, and its name in `NAMES`.
docs/appendix/models.md compares the criteria of the models.
"""

from importlib import import_module

from rastercov.reference.models.base import CoverageModel

NAMES = ("tarabanis", "scott", "mavrinac", "alarcon", "zhang", "image_space")
MODELS: dict[str, CoverageModel] = {
    name: import_module(f"{__name__}.{name}").coverage for name in NAMES
}
"""The models by name, in the order of the tables."""

__all__ = ["MODELS", "CoverageModel"]
