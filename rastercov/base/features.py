"""Features that can be deleted: a line each, with the modules in which it adds to the others.

Hooks are a class of a package, which calls them and knows no feature; a module of a feature has an
instance, `HOOKS`. To delete a feature, delete its line, its files and its tests.
"""

from importlib import import_module
from typing import TypeVar

Hooks = TypeVar("Hooks")
DEVICE = ("Inputs", "Wording")
"""Hooks of a device on cameras, `rastercov.core.coverage.device`."""
FEATURES: dict[str, dict[str, str]] = {
    "rules": {
        "Inputs": "sensors.rule_entries",
        "Feature": "sensors.figures",
        "PlanSections": "sensors.plan_section",
        "ReportHooks": "sensors.rule_modes",
    },
    "lamps": {
        "Inputs": "light.lamp_file",
        "Wording": "light.lamp_words",
        "Feature": "light.points",
        "PlanSections": "light.plan_section",
        "PlanFeature": "light.lamp_choice",
        "ReportHooks": "light.lamp_modes",
    },
    "motion": {
        "Inputs": "motion.moving",
        "PlanSections": "motion.plan_section",
        "PlanFeature": "motion.plan_over_time",
        "ReportHooks": "motion.time_modes",
        "page": "time",
    },
    "sun": {"ReportHooks": "sun.sun_modes"},
    "formats": {"service": "formats.meshes"},
    "clusters": {"service": "cluster.scheduler"},
    "gl": {"service": "gl"},
    "survey": {"PlanSections": "survey.plan_section", "PlanFeature": "survey.flights"},
    "tolerances": {
        "PlanSections": "tolerances.plan_section",
        "PlanFeature": "tolerances.plan_step",
    },
    "robots": {
        "PlanSections": "robots.plan_section",
        "PlanFeature": "robots.plan_arm",
        "page": "joints",
    },
    "asbuilt": {"page": "photograph"},
}
"""Modules of each feature, by the class of their hooks; "page" is one of the viewer's page, and
"service" what a package asks for by the name of the feature."""


def hooks_of(kind: type[Hooks]) -> tuple[Hooks, ...]:
    """Hooks of a class, of all features that have some, registered by it or by its base."""
    names = {each.__name__ for each in kind.__mro__}
    hooks = []
    for own in FEATURES.values():
        for name in names & own.keys():
            each = import_module(f"rastercov.{own[name]}").HOOKS
            if name == kind.__name__ or isinstance(each, kind):
                hooks.append(each)
    return tuple(hooks)


def service_of(name: str, default: Hooks) -> Hooks:
    """Hooks of a feature that does what a package cannot; `default` where it is not there."""
    own = FEATURES.get(name, {}).get("service")
    return default if own is None else import_module(f"rastercov.{own}").HOOKS
