"""Graded per-face visibility and coverage of a mesh by cameras, and camera placement.

A name is imported from its module at its first use: the command prints its help without numpy.
"""

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from rastercov.base.errors import (
        CameraError,
        ConfigError,
        DeviceError,
        MeshError,
        PoseError,
        RastercovError,
        ResourceError,
    )
    from rastercov.camera.camera import Camera
    from rastercov.camera.formats import read_views, write_views
    from rastercov.camera.formats.conventions import Conventions
    from rastercov.camera.pose import Poses
    from rastercov.camera.pose_file import read_poses, write_poses
    from rastercov.camera.rig import Rig, Views
    from rastercov.camera.viewpoints import look_at, sphere_of_poses
    from rastercov.cluster import Workers
    from rastercov.coverage.area.cells import Cells, CellShares, cells
    from rastercov.coverage.area.regions import Regions, regions
    from rastercov.coverage.area.union import Covered, RegionUnion, unite
    from rastercov.coverage.area.zones import DeadZones, dead_zones
    from rastercov.coverage.coverage import Coverage, evaluate_batches
    from rastercov.coverage.engine import Engine
    from rastercov.coverage.evaluation import Evaluation
    from rastercov.coverage.job import evaluate
    from rastercov.coverage.network import Network
    from rastercov.coverage.observer import Observer, open_observer, visibility
    from rastercov.coverage.task import Reason, Task
    from rastercov.mesh import Group, Mesh
    from rastercov.raster import (
        FaceCounts,
        Rasterizer,
        RasterizerInfo,
        VisibilityBuffer,
        open_rasterizer,
    )
    from rastercov.raster.observation import BoundKind, Observation, Visibility
    from rastercov.report.jobs import audit, check, place

__all__ = [
    "BoundKind",
    "Camera",
    "CameraError",
    "CellShares",
    "Cells",
    "ConfigError",
    "Conventions",
    "Coverage",
    "Covered",
    "DeadZones",
    "DeviceError",
    "Engine",
    "Evaluation",
    "FaceCounts",
    "Group",
    "Mesh",
    "MeshError",
    "Network",
    "Observation",
    "Observer",
    "PoseError",
    "Poses",
    "RastercovError",
    "Rasterizer",
    "RasterizerInfo",
    "Reason",
    "RegionUnion",
    "Regions",
    "ResourceError",
    "Rig",
    "Task",
    "Views",
    "Visibility",
    "VisibilityBuffer",
    "Workers",
    "audit",
    "cells",
    "check",
    "dead_zones",
    "evaluate",
    "evaluate_batches",
    "look_at",
    "open_observer",
    "open_rasterizer",
    "place",
    "read_poses",
    "read_views",
    "regions",
    "sphere_of_poses",
    "unite",
    "visibility",
    "write_poses",
    "write_views",
]
__version__ = "0.1.0"

_NAMES = {
    "base.errors": "CameraError ConfigError DeviceError MeshError PoseError RastercovError "
    "ResourceError",
    "camera.camera": "Camera",
    "camera.formats": "read_views write_views",
    "camera.formats.conventions": "Conventions",
    "camera.pose": "Poses",
    "camera.pose_file": "read_poses write_poses",
    "camera.rig": "Rig Views",
    "camera.viewpoints": "look_at sphere_of_poses",
    "cluster": "Workers",
    "coverage.area.cells": "Cells CellShares cells",
    "coverage.area.regions": "Regions regions",
    "coverage.area.union": "Covered RegionUnion unite",
    "coverage.area.zones": "DeadZones dead_zones",
    "coverage.coverage": "Coverage evaluate_batches",
    "coverage.engine": "Engine",
    "coverage.evaluation": "Evaluation",
    "coverage.job": "evaluate",
    "coverage.network": "Network",
    "coverage.observer": "Observer open_observer visibility",
    "coverage.task": "Reason Task",
    "mesh": "Group Mesh",
    "raster": "FaceCounts Rasterizer RasterizerInfo VisibilityBuffer open_rasterizer",
    "raster.observation": "BoundKind Observation Visibility",
    "report.jobs": "audit check place",
}
"""Modules and their public names."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> _Any:
    if name in _HOME:
        from rastercov.base.typed import guarded_name

        found = globals()[name] = guarded_name(_import_module(f"rastercov.{_HOME[name]}"), name)
        return found
    if name == "shapes":
        return _import_module("rastercov.mesh.shapes")
    if not name.startswith("_") and _find_spec(f"rastercov.{name}"):
        return _import_module(f"rastercov.{name}")
    raise AttributeError(f"module 'rastercov' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
