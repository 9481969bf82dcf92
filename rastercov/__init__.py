"""Coverage of a triangle mesh by cameras, with error bounds, and placement of cameras.

Begin with `evaluate`, `place`, `check` or `audit`.
"""

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPE_CHECKING, Any as _Any

if _TYPE_CHECKING:
    from rastercov.base.errors import (
        CameraError as CameraError,
        ConfigError as ConfigError,
        DeviceError as DeviceError,
        MeshError as MeshError,
        PoseError as PoseError,
        RastercovError as RastercovError,
        ResourceError as ResourceError,
    )
    from rastercov.camera.camera import Camera as Camera
    from rastercov.camera.exposure import Exposure as Exposure
    from rastercov.camera.formats import read_views as read_views, write_views as write_views
    from rastercov.camera.formats.conventions import Conventions as Conventions
    from rastercov.camera.lamp_file import load_lamps as load_lamps
    from rastercov.camera.lamps import Lamp as Lamp, Lamps as Lamps
    from rastercov.camera.pose import Poses as Poses
    from rastercov.camera.pose_file import read_poses as read_poses, write_poses as write_poses
    from rastercov.camera.rig import Rig as Rig, Views as Views
    from rastercov.camera.rule import All as All, Any as Any, AtLeast as AtLeast
    from rastercov.camera.sun import sun_directions as sun_directions
    from rastercov.camera.viewpoints import look_at as look_at, sphere_of_poses as sphere_of_poses
    from rastercov.coverage.area.cells import (
        Cells as Cells,
        CellShares as CellShares,
        cells as cells,
    )
    from rastercov.coverage.area.criteria import (
        BeamDensity as BeamDensity,
        RayAngle as RayAngle,
        Uncertainty as Uncertainty,
    )
    from rastercov.coverage.area.light_criteria import (
        Highlight as Highlight,
        Illuminance as Illuminance,
    )
    from rastercov.coverage.area.laser import LaserLine as LaserLine
    from rastercov.coverage.area.motion import MotionQuery as MotionQuery
    from rastercov.coverage.area.over_time import OverTime as OverTime
    from rastercov.coverage.area.sure import tolerance as tolerance
    from rastercov.coverage.area.table import Regions as Regions
    from rastercov.coverage.area.union import (
        Covered as Covered,
        RegionUnion as RegionUnion,
        unite as unite,
    )
    from rastercov.coverage.area.zones import DeadZones as DeadZones, dead_zones as dead_zones
    from rastercov.coverage.coverage import Coverage as Coverage
    from rastercov.coverage.engine import Engine as Engine
    from rastercov.coverage.evaluation import Evaluation as Evaluation, regions as regions
    from rastercov.coverage.job import evaluate as evaluate
    from rastercov.coverage.network import Network as Network
    from rastercov.coverage.observer import Observer as Observer, open_observer as open_observer
    from rastercov.coverage.reasons import Reason as Reason
    from rastercov.coverage.sunlight import Sunlight as Sunlight, sunlit as sunlit
    from rastercov.coverage.task import Task as Task
    from rastercov.coverage.visibility import Visibility as Visibility, visibility as visibility
    from rastercov.mesh import Group as Group, Mesh as Mesh, shapes as shapes
    from rastercov.mesh.collisions import Collisions as Collisions
    from rastercov.mesh.motion import Motion as Motion, conveyor as conveyor, turntable as turntable
    from rastercov.mesh.motion_file import load_motion as load_motion
    from rastercov.mesh.robot import Robot as Robot
    from rastercov.raster import (
        FaceCounts as FaceCounts,
        Rasterizer as Rasterizer,
        RasterizerInfo as RasterizerInfo,
        VisibilityBuffer as VisibilityBuffer,
        open_rasterizer as open_rasterizer,
    )
    from rastercov.raster.observation import BoundKind as BoundKind, Observation as Observation
    from rastercov.report.jobs import audit as audit, check as check, place as place
    from rastercov.report.notebook import show as show, table as table
    from rastercov.shards import Workers as Workers

    __version__: str

_NAMES = {
    "base.errors": "CameraError ConfigError DeviceError MeshError PoseError RastercovError "
    "ResourceError",
    "camera.camera": "Camera",
    "camera.formats": "read_views write_views",
    "camera.formats.conventions": "Conventions",
    "camera.exposure": "Exposure",
    "camera.lamp_file": "load_lamps",
    "camera.lamps": "Lamp Lamps",
    "camera.pose": "Poses",
    "camera.pose_file": "read_poses write_poses",
    "camera.rig": "Rig Views",
    "camera.rule": "All Any AtLeast",
    "camera.sun": "sun_directions",
    "camera.viewpoints": "look_at sphere_of_poses",
    "shards": "Workers",
    "coverage.area.cells": "Cells CellShares cells",
    "coverage.area.criteria": "BeamDensity RayAngle Uncertainty",
    "coverage.area.light_criteria": "Highlight Illuminance",
    "coverage.area.laser": "LaserLine",
    "coverage.area.motion": "MotionQuery",
    "coverage.area.over_time": "OverTime",
    "coverage.area.sure": "tolerance",
    "coverage.area.table": "Regions",
    "coverage.area.union": "Covered RegionUnion unite",
    "coverage.area.zones": "DeadZones dead_zones",
    "coverage.coverage": "Coverage",
    "coverage.engine": "Engine",
    "coverage.evaluation": "Evaluation regions",
    "coverage.job": "evaluate",
    "coverage.network": "Network",
    "coverage.observer": "Observer open_observer",
    "coverage.reasons": "Reason",
    "coverage.sunlight": "Sunlight sunlit",
    "coverage.task": "Task",
    "coverage.visibility": "Visibility visibility",
    "mesh": "Group Mesh",
    "mesh.collisions": "Collisions",
    "mesh.motion": "Motion conveyor turntable",
    "mesh.motion_file": "load_motion",
    "mesh.robot": "Robot",
    "raster": "FaceCounts Rasterizer RasterizerInfo VisibilityBuffer open_rasterizer",
    "raster.observation": "BoundKind Observation",
    "report.jobs": "audit check place",
    "report.notebook": "show table",
}
"""Modules and their public names."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)
_RETIRED = {
    "evaluate_batches": "evaluate(..., fields=()) has the sums of any number of poses",
    "evaluate_over_time": "evaluate(mesh, ..., motion=MotionQuery(motion, over)).over_time is that",
    "laser_line": "LaserLine.of is that",
    "over_time": "MotionQuery(motion, over).long_enough(regions, views) is that",
    "regions_over_time": "regions(mesh, ..., motion=motion) is that",
}
"""Names of the last version, and what to call instead."""


def __getattr__(name: str) -> _Any:
    if name in _HOME:
        from rastercov.base.typed import guarded_name

        found = globals()[name] = guarded_name(_import_module(f"rastercov.{_HOME[name]}"), name)
        return found
    if name == "__version__":
        from importlib.metadata import version  # that of pyproject.toml

        return version("rastercov")
    if name == "shapes":
        return _import_module("rastercov.mesh.shapes")
    if name in _RETIRED:
        raise AttributeError(f"rastercov.{name} is retired: rastercov.{_RETIRED[name]}")
    if not name.startswith("_") and _find_spec(f"rastercov.{name}"):
        return _import_module(f"rastercov.{name}")
    raise AttributeError(f"module 'rastercov' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
