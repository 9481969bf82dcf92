"""Graded per-face visibility and coverage of a mesh by cameras, and camera placement."""

import warnings as _warnings
from typing import Any as _Any

from rastercov import _moved as _moved
from rastercov._typed import guard as _guard
from rastercov.area.cells import Cells, CellShares, cells
from rastercov.area.regions import Regions, regions
from rastercov.area.union import Covered, RegionUnion, unite
from rastercov.area.zones import DeadZones, dead_zones
from rastercov.camera import Camera
from rastercov.camera_formats import read_views, write_views
from rastercov.camera_formats.conventions import Conventions
from rastercov.cluster import Workers
from rastercov.coverage import Coverage, evaluate, evaluate_batches
from rastercov.engine import Engine
from rastercov.errors import (
    CameraError,
    ConfigError,
    DeviceError,
    MeshError,
    PoseError,
    RastercovError,
    ResourceError,
)
from rastercov.jobs import audit, check, place
from rastercov.mesh import Group, Mesh
from rastercov.network import Network
from rastercov.observation import BoundKind, Observation, Visibility
from rastercov.observer import Observer, open_observer, visibility
from rastercov.pose import Poses
from rastercov.pose_file import read_poses, write_poses
from rastercov.raster import (
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
    open_rasterizer,
)
from rastercov.rig import Rig
from rastercov.task import Reason, Task
from rastercov.viewpoints import look_at, sphere_of_poses
from rastercov.views import Views

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
_guard(__name__)


def __getattr__(name: str) -> _Any:
    if name == "Kind":
        _warnings.warn("rastercov.Kind is now BoundKind", DeprecationWarning, stacklevel=2)
        return BoundKind
    raise AttributeError(f"module 'rastercov' has no attribute {name!r}")
