"""Scenes and cameras without a criterion that is not of a task."""

from dataclasses import replace

from rastercov.base import once_each
from rastercov.base.arguments import MAX_IMAGE_SIDE
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh


@once_each
def without_occlusion(mesh: Mesh) -> Mesh:
    """The mesh, of which nothing hides anything."""
    groups = (replace(group, is_occluder=False, is_target=True) for group in mesh.groups)
    return mesh._with_flags(tuple(groups))


def without_borders(camera: Camera) -> Camera:
    """A camera with the largest image that one may have; of a lens, that which it has."""
    if camera.is_curved:
        return camera
    right, down = ((MAX_IMAGE_SIDE - side) // 2 for side in (camera.width, camera.height))
    width, height = camera.width + 2 * right, camera.height + 2 * down
    cx, cy = camera.cx + right, camera.cy + down
    return replace(camera, width=width, height=height, cx=cx, cy=cy)
