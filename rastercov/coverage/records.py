"""Meshes and cameras as the loops over faces take them, and memory for those loops."""

from typing import Any

import numpy as np

from rastercov.base.memory import aligned_array, read_only
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import curved_lens
from rastercov.kernels.cameras import COLUMNS, CurvedLens, Lens
from rastercov.kernels.criteria import MOST_CORNERS, MOST_DOUBTFUL, SIDE_ROUNDING, Scene, Workspace
from rastercov.kernels.decision import AT_A_TIME, BLOCK_ROWS
from rastercov.kernels.lens_faces import CurvedWorkspace, curved_workspace
from rastercov.mesh import Mesh


def scene_of(mesh: Mesh) -> Scene:
    """Arrays of a `Mesh`."""
    return Scene(
        read_only(mesh.vertices, np.float64),
        read_only(mesh.faces.view(np.uint64), np.uint64),
        read_only(mesh.normals, np.float64),
        read_only(mesh.degenerate_mask, np.bool_),
        read_only(mesh.two_sided_mask, np.bool_),
        read_only(mesh.plane_offsets, np.float64),
        float(np.abs(mesh.bounds).max()),
        min(SIDE_ROUNDING / mesh.least_sine, MOST_DOUBTFUL),
    )


def lens_of(camera: Camera) -> Lens | CurvedLens:
    """Numbers of a `Camera`; the loops are compiled for either kind."""
    return pinhole_of(camera) if camera.is_pinhole else curved_lens(camera)


def pinhole_of(camera: Camera) -> Lens:
    """Numbers of a `Camera` without distortion, or of an ideal plane."""
    size = float(camera.width), float(camera.height)
    return Lens(float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy), *size)


def workspace(n_vertices: int, lens: Any = None) -> Workspace | CurvedWorkspace:
    """Memory for one thread, for a lens."""
    block = aligned_array((BLOCK_ROWS, AT_A_TIME), np.float64)
    if isinstance(lens, CurvedLens):
        return curved_workspace(n_vertices, block)
    polygon, spare = np.empty((2, MOST_CORNERS, 2))
    return Workspace(aligned_array((n_vertices, COLUMNS), np.float64), polygon, spare, block)
