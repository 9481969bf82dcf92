"""Features that can be deleted: a line each, with the modules in which it adds to a package.

Such a module has an instance of the hooks of its package, `HOOKS`; what calls them is in the
package, and knows no feature. To delete a feature, delete its line, its files and its tests.
"""

from importlib import import_module
from typing import TypeVar

Hooks = TypeVar("Hooks")

FEATURES: dict[str, tuple[str, ...]] = {
    "rules": ("coverage.area.sensor_figures",),
    "lamps": ("coverage.area.light_points",),
}
"""Modules by the name of the feature."""


def hooks_of(package: str, kind: type[Hooks]) -> tuple[Hooks, ...]:
    """Hooks of all features in modules of a package, such as "coverage.area"."""
    names = [name for own in FEATURES.values() for name in own]
    own = [name for name in names if name.rpartition(".")[0] == package]
    found = [import_module(f"rastercov.{name}").HOOKS for name in own]
    return tuple(each for each in found if isinstance(each, kind))
