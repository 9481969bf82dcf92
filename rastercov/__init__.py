"""Coverage of a triangle mesh by cameras, with error bounds, and placement of cameras.

Begin with `evaluate`, `place`, `check` or `audit`.
"""

from importlib import import_module as _import_module
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPE_CHECKING, Any as _Any

__version__ = "1.0.0rc2"
"""The version, also where no metadata are found: pyproject.toml takes it from here."""

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
    from rastercov.core.camera.camera import Camera as Camera
    from rastercov.core.camera.exposure import Exposure as Exposure
    from rastercov.formats.cameras import read_views as read_views, write_views as write_views
    from rastercov.light.lamp_file import load_lamps as load_lamps
    from rastercov.light.lamps import Lamp as Lamp, Lamps as Lamps
    from rastercov.core.camera.pose import Poses as Poses
    from rastercov.core.camera.conventions import (
        Conventions as Conventions,
        read_poses as read_poses,
        write_poses as write_poses,
    )
    from rastercov.core.camera.rig import Rig as Rig, Views as Views
    from rastercov.core.camera.rule import All as All, Any as Any, AtLeast as AtLeast
    from rastercov.core.camera.sun import sun_directions as sun_directions
    from rastercov.core.camera.viewpoints import (
        look_at as look_at,
        sphere_of_poses as sphere_of_poses,
    )
    from rastercov.core.area.cells import Cells as Cells, CellShares as CellShares, cells as cells
    from rastercov.core.area.criteria import (
        BeamDensity as BeamDensity,
        RayAngle as RayAngle,
        Uncertainty as Uncertainty,
    )
    from rastercov.light.criteria import Highlight as Highlight, Illuminance as Illuminance
    from rastercov.sensors.laser import LaserLine as LaserLine
    from rastercov.motion.regions import MotionQuery as MotionQuery
    from rastercov.motion.over_time import OverTime as OverTime
    from rastercov.asbuilt.located import Located as Located, locate as locate
    from rastercov.tolerances.sure import tolerance as tolerance
    from rastercov.core.area.union import (
        Covered as Covered,
        RegionUnion as RegionUnion,
        unite as unite,
    )
    from rastercov.core.area.table import Regions as Regions
    from rastercov.core.area.zones import DeadZones as DeadZones, dead_zones as dead_zones
    from rastercov.core.coverage.evaluation import Evaluation as Evaluation, regions as regions
    from rastercov.core.coverage.job import evaluate as evaluate
    from rastercov.core.coverage.network import Network as Network
    from rastercov.core.coverage.coverage import (
        Coverage as Coverage,
        Observer as Observer,
        open_observer as open_observer,
    )
    from rastercov.sun.sunlight import Sunlight as Sunlight, sunlit as sunlit
    from rastercov.survey.viewshed import Viewshed as Viewshed, viewshed as viewshed
    from rastercov.core.coverage.task import Engine as Engine, Reason as Reason, Task as Task
    from rastercov.core.coverage.visibility import (
        Visibility as Visibility,
        visibility as visibility,
    )
    from rastercov.core.mesh import Group as Group, Mesh as Mesh, shapes as shapes
    from rastercov.robots.collisions import Collisions as Collisions
    from rastercov.motion.motion import (
        Motion as Motion,
        conveyor as conveyor,
        turntable as turntable,
    )
    from rastercov.motion.motion_file import load_motion as load_motion
    from rastercov.robots.robot import Robot as Robot
    from rastercov.core.raster import (
        FaceCounts as FaceCounts,
        Rasterizer as Rasterizer,
        RasterizerInfo as RasterizerInfo,
        VisibilityBuffer as VisibilityBuffer,
        open_rasterizer as open_rasterizer,
    )
    from rastercov.core.raster.contract import (
        BoundKind as BoundKind,
        CoverageBits as CoverageBits,
        Observation as Observation,
    )
    from rastercov.report.jobs import audit as audit, check as check, place as place
    from rastercov.report.notebook import show as show, table as table
    from rastercov.shards import Workers as Workers

_NAMES = {
    "base.errors": "CameraError ConfigError DeviceError MeshError PoseError RastercovError "
    "ResourceError",
    "core.camera.camera": "Camera",
    "formats.cameras": "read_views write_views",
    "core.camera.conventions": "Conventions read_poses write_poses",
    "core.camera.exposure": "Exposure",
    "light.lamp_file": "load_lamps",
    "light.lamps": "Lamp Lamps",
    "core.camera.pose": "Poses",
    "core.camera.rig": "Rig Views",
    "core.camera.rule": "All Any AtLeast",
    "core.camera.sun": "sun_directions",
    "core.camera.viewpoints": "look_at sphere_of_poses",
    "shards": "Workers",
    "core.area.cells": "Cells CellShares cells",
    "core.area.criteria": "BeamDensity RayAngle Uncertainty",
    "light.criteria": "Highlight Illuminance",
    "sensors.laser": "LaserLine",
    "motion.regions": "MotionQuery",
    "motion.over_time": "OverTime",
    "asbuilt.located": "Located locate",
    "tolerances.sure": "tolerance",
    "core.area.table": "Regions",
    "core.area.union": "Covered RegionUnion unite",
    "core.area.zones": "DeadZones dead_zones",
    "core.coverage.coverage": "Coverage Observer open_observer",
    "core.coverage.evaluation": "Evaluation regions",
    "core.coverage.job": "evaluate",
    "core.coverage.network": "Network",
    "sun.sunlight": "Sunlight sunlit",
    "survey.viewshed": "Viewshed viewshed",
    "core.coverage.task": "Engine Reason Task",
    "core.coverage.visibility": "Visibility visibility",
    "core.mesh": "Group Mesh",
    "robots.collisions": "Collisions",
    "motion.motion": "Motion conveyor turntable",
    "motion.motion_file": "load_motion",
    "robots.robot": "Robot",
    "core.raster": "FaceCounts Rasterizer RasterizerInfo VisibilityBuffer open_rasterizer",
    "core.raster.contract": "BoundKind CoverageBits Observation",
    "report.jobs": "audit check place",
    "report.notebook": "show table",
}
"""Modules and their public names."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> _Any:
    if name in _HOME:
        from rastercov.base.typed import guarded_name

        result = globals()[name] = guarded_name(_import_module(f"rastercov.{_HOME[name]}"), name)
        return result
    if name == "shapes":
        return _import_module("rastercov.core.mesh.shapes")
    if not name.startswith("_") and _find_spec(f"rastercov.{name}"):
        return _import_module(f"rastercov.{name}")
    raise AttributeError(f"module 'rastercov' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
