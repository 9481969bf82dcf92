"""Features that can be deleted: a line each, with the modules in which it adds to the others.

Hooks are a class of a package, which calls them and knows no feature; a module of a feature has an
instance, `HOOKS`. To delete a feature, delete its line, its files and its tests.
"""

from importlib import import_module
from typing import TypeVar

Hooks = TypeVar("Hooks")
DEVICE = ("RigEntries", "Wording")
"""Hooks of a device on cameras, `rastercov.core.coverage.device`."""
FEATURES: dict[str, dict[str, str]] = {
    "rules": {
        "RigEntries": "sensors.rule_entries",
        "Feature": "sensors.figures",
        "PlanSections": "sensors.plan_section",
        "FeatureModes": "sensors.rule_modes",
        "PointTwin": "reference.rules",
    },
    "lamps": {
        "RigEntries": "light.lamp_file",
        "Wording": "light.lamp_words",
        "Feature": "light.points",
        "PlanSections": "light.plan_section",
        "PlanFeature": "light.lamp_plan",
        "Products": "light.lamp_choice",
        "FeatureModes": "light.lamp_modes",
        "PointTwin": "reference.lamps",
    },
    "motion": {
        "Phased": "motion.moving",
        "PlanSections": "motion.plan_section",
        "PlanFeature": "motion.plan_over_time",
        "FeatureModes": "motion.time_modes",
        "ReportHooks": "motion.report",
        "page": "time",
    },
    "sun": {"FeatureModes": "sun.sun_modes"},
    "formats": {"MeshFiles": "formats.meshes"},
    "clusters": {"Elsewhere": "cluster.scheduler"},
    "gl": {"Drawer": "gl"},
    "survey": {
        "PlanSections": "survey.plan_section",
        "OwnGenerators": "survey.generators",
        "Products": "survey.flights",
    },
    "tolerances": {
        "PlanSections": "tolerances.plan_section",
        "Products": "tolerances.plan_step",
        "Demand": "tolerances.assured",
    },
    "robots": {
        "PlanSections": "robots.plan_section",
        "PlanFeature": "robots.plan_arm",
        "CarriedGenerators": "robots.generators",
        "page": "joints",
    },
    "asbuilt": {"page": "photograph"},
}
"""Modules of each feature, by the class of their hooks; "page" is one of the viewer's page."""


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
