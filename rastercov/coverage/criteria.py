"""The criteria of coverage that follow from geometry alone, for all faces of one pose.

Field of view (3.7), projected area for the resolution criterion (3.8, 3.9), focus (3.12), and ours:
the part of a face inside the image, pixel density on the surface, and incidence angle. Occlusion
needs the rasteriser and lives in `visibility`.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
X. Zhang et al. Coverage enhancement for deployment of multi-camera networks. 2019 (pixel density).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import read_only
from rastercov.camera.camera import Camera
from rastercov.camera.near_plane import near_limit
from rastercov.mesh import Mesh

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FaceGeometry:
    """Geometry of every face as one camera has it; all arrays (F,) unless noted.

    Attributes
    ----------
    is_front : bool
        The face is seen against its normal, or its group is two-sided. Never for a degenerate face.
    in_view : bool
        All three vertices inside the image and beyond the near plane, (3.7).
    in_view_fraction : float64
        Part of the projected area inside the image; 0 where there is no area.
    projected_area : float64
        (3.9) of the part beyond the near plane, px^2, not cut at the image border.
    perimeter : float64
        Length of its outline, px; inf where the near plane cuts the face.
    pixel_density : float64
        Pixels a metre on the surface along its worst direction, at its worst vertex; 0 for faces
        that are not front or not wholly beyond the near plane.
    facing_density : float64
        Pixels a metre along the worst direction of a target that faces the camera at the deepest
        vertex, min(fx, fy) / z; 0 for faces not wholly beyond the near plane.
    depth : (F, 3) float64
        Camera z of the vertices, metres.
    incidence : float64
        Angle between normal and ray from the centroid to the camera centre, radians, [0, pi]; of
        two-sided faces with the normal of the side that is seen, [0, pi/2].
    """

    is_front: BoolArray
    in_view: BoolArray
    in_view_fraction: FloatArray
    projected_area: FloatArray
    perimeter: FloatArray
    pixel_density: FloatArray
    facing_density: FloatArray
    depth: FloatArray
    incidence: FloatArray


def face_geometry(mesh: Mesh, camera: Camera, pose: FloatArray) -> FaceGeometry:
    """Geometry of every face for one pose, world_from_camera (4, 4)."""
    from rastercov.coverage.records import arrays_for, lens_of, scene_of, workspace  # loads numba
    from rastercov.kernels.criteria import measure

    near = float(near_limit(camera, mesh.opaque.bounds, pose[None])[0])
    found = arrays_for(mesh.n_faces)
    scene, lens = scene_of(mesh), lens_of(camera)
    work = workspace(mesh.n_vertices, lens)
    measure(scene, read_only(pose, np.float64), near, lens, work, found)
    return FaceGeometry(*found)


def in_focus(depth: FloatArray, limits: tuple[float, float], rule: str = "vertices") -> BoolArray:
    """Mask of the faces within the depth of field, (3.12).

    Parameters
    ----------
    depth : (F, 3) float64
        Camera z of the vertices, metres.
    limits : (float, float)
        z_n and z_f of (3.10) and (3.11), metres.
    rule : {"vertices", "centroid"}
        Definition 1 asks it of every vertex; (3.12) to the letter, of the centroid.
    """
    z_n, z_f = limits
    if rule == "centroid":
        centre = (depth[:, 0] + depth[:, 1] + depth[:, 2]) / 3
        return (z_n <= centre) & (centre <= z_f)
    every: BoolArray = np.all((z_n <= depth) & (depth <= z_f), axis=1)
    return every
