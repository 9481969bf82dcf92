"""Old module paths, kept for one release: each import warns once and gives the module that moved.

A finder in `sys.meta_path`, ahead of Python's own, because an old package is now an alias whose
path would give its modules a second time.
"""

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

MOVED = {
    "rastercov.markers": "rastercov.validation.markers",
    "rastercov.markers.detect": "rastercov.validation.markers.detect",
    "rastercov.markers.render": "rastercov.validation.markers.render",
    "rastercov.markers.requirement": "rastercov.validation.markers.requirement",
    "rastercov.markers.scene": "rastercov.validation.markers.scene",
    "rastercov.placement.cavities": "rastercov.placement.candidates.cavities",
    "rastercov.placement.clearance": "rastercov.placement.candidates.clearance",
    "rastercov.placement.framing": "rastercov.placement.candidates.framing",
    "rastercov.placement.leftover": "rastercov.placement.explain.uncovered",
    "rastercov.placement.mounting": "rastercov.placement.candidates.mounting",
    "rastercov.placement.objective": "rastercov.placement.improve.objective",
    "rastercov.placement.optimise": "rastercov.placement.improve.search",
    "rastercov.placement.page": "rastercov.report.placement",
    "rastercov.placement.pictures": "rastercov.report.placement_pictures",
    "rastercov.placement.problem": "rastercov.placement.select.problem",
    "rastercov.placement.refine": "rastercov.placement.improve.refine",
    "rastercov.placement.segments": "rastercov.placement.candidates.segments",
    "rastercov.placement.select_greedy": "rastercov.placement.select.greedy",
    "rastercov.placement.select_integer": "rastercov.placement.select.integer",
    "rastercov.placement.space": "rastercov.placement.improve.pose_space",
    "rastercov.placement.tolerance": "rastercov.placement.improve.tolerance",
    "rastercov.raster.egl": "rastercov.raster.gl.context",
}
"""New path of each module that the documentation of an earlier release names."""


def former_names(module: str, moved: Mapping[str, str]) -> Callable[[str], Any]:
    """`__getattr__` of a module whose names have moved: each use warns and gives the name.

    `moved` has the new modules and the names that are there now.
    """
    places = {name: new for new, names in moved.items() for name in names.split()}

    def attribute(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        text = f"{module}.{name} is now in {places[name]}"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return getattr(import_module(places[name]), name)

    return attribute


class _Package(ModuleType):
    """Package whose functions are not replaced by old modules of the same names."""

    def __setattr__(self, name: str, value: object) -> None:
        old = f"{self.__name__}.{name}"
        if not (old in MOVED and isinstance(value, ModuleType) and name in vars(self)):
            super().__setattr__(name, value)


class _Finder(MetaPathFinder, Loader):
    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        old = module.__name__
        text = f"{old} is now {MOVED[old]}; the old path goes with the next release"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        sys.modules[old] = import_module(MOVED[old])
        package = sys.modules[old.rpartition(".")[0]]
        if type(package) is ModuleType:
            package.__class__ = _Package


sys.meta_path.insert(0, _Finder())
