"""Features that can be deleted: a line each, with the modules in which it adds to the others.

Hooks are a class of a package, which calls them and knows no feature; a module of a feature has an
instance, `HOOKS`. To delete a feature, delete its line, its files and its tests.
"""

from importlib import import_module
from typing import TypeVar

Hooks = TypeVar("Hooks")
DEVICE = ("EquipmentKind", "Wording", "Device")
"""Hooks of a device on cameras, `rastercov.coverage.device`."""
FEATURES: dict[str, dict[str, str]] = {
    "rules": {
        "RigEntries": "camera.rule_entries",
        "GateLimits": "coverage.area.sensors",
        "Feature": "coverage.area.sensor_figures",
        "PlanSections": "placement.plan.rule_section",
        "FeatureModes": "report.rule_modes",
        "GateTwin": "reference.rules",
    },
    "lamps": {
        "EquipmentKind": "camera.lamp_rig",
        "Wording": "coverage.lamp_words",
        "Feature": "coverage.area.light_points",
        "PlanSections": "placement.plan.lamp_section",
        "PlanFeature": "placement.plan.lamp_plan",
        "Chooser": "placement.plan.lamps",
        "FeatureModes": "report.lamp_modes",
        "PointTwin": "reference.lamps",
    },
    "motion": {
        "Phased": "coverage.moving",
        "PlanSections": "placement.plan.motion_section",
        "PlanFeature": "placement.plan.over_time",
        "PlanPhased": "placement.plan.over_time",
        "FeatureModes": "report.time_modes",
        "ReportHooks": "report.over_time",
        "SceneFile": "cli.motion",
        "page": "time",
    },
    "sun": {"FeatureModes": "report.sun_modes"},
    "robots": {
        "PlanSections": "placement.plan.robot_section",
        "PlanFeature": "placement.plan.arm",
        "CarrierHooks": "placement.plan.arm",
        "page": "joints",
    },
}
"""Modules of each feature, by the class of their hooks; "page" is one of the viewer's page."""


def hooks_of(kind: type[Hooks]) -> tuple[Hooks, ...]:
    """Hooks of a class, of all features that have some."""
    modules = [own[kind.__name__] for own in FEATURES.values() if kind.__name__ in own]
    return tuple(import_module(f"rastercov.{name}").HOOKS for name in modules)
