"""Which faces of a mesh does each camera see, how well, and where should the cameras go."""

from rastercov import _moved as _moved
from rastercov.camera import Camera
from rastercov.coverage import Coverage, Reason, Task, evaluate, evaluate_batches
from rastercov.errors import (
    CameraError,
    ConfigError,
    DeviceError,
    MeshError,
    PoseError,
    RastercovError,
    ResourceError,
)
from rastercov.mesh import Group, Mesh
from rastercov.network import Network
from rastercov.observer import Kind, Observation, Observer, Visibility, open_observer, visibility
from rastercov.pose import look_at, read_poses, sphere_of_poses, write_poses
from rastercov.raster.contract import (
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
    open_rasterizer,
)

__all__ = [
    "Camera",
    "CameraError",
    "ConfigError",
    "Coverage",
    "DeviceError",
    "FaceCounts",
    "Group",
    "Kind",
    "Mesh",
    "MeshError",
    "Network",
    "Observation",
    "Observer",
    "PoseError",
    "RastercovError",
    "Rasterizer",
    "RasterizerInfo",
    "Reason",
    "ResourceError",
    "Task",
    "Visibility",
    "VisibilityBuffer",
    "evaluate",
    "evaluate_batches",
    "look_at",
    "open_observer",
    "open_rasterizer",
    "read_poses",
    "sphere_of_poses",
    "visibility",
    "write_poses",
]
__version__ = "0.1.0"
