"""Coverage of Blender's active mesh by the cameras of its scene, as a face attribute `coverage`.

In Blender, with rastercov in its Python: `blender scene.blend --background --python FILE`. Without
Blender it computes the same for a sphere and two cameras with the settings below.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

import rastercov as rc

try:
    import bpy
except ImportError:
    bpy = None

CV_FROM_BLENDER = np.diag((1.0, -1.0, -1.0, 1.0))  # Blender's cameras look along -z, y up


@dataclass
class Settings:
    """Values of Blender's `scene.render` and `camera.data`, under their names."""

    resolution_x: int = 1280
    resolution_y: int = 720
    resolution_percentage: int = 100
    pixel_aspect_x: float = 1.0
    pixel_aspect_y: float = 1.0
    lens: float = 50.0
    sensor_fit: str = "AUTO"
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.1


def camera_of(render: Any, data: Any) -> rc.Camera:
    """The pinhole of a perspective camera of Blender: sensor fit, shift and aspect of pixels."""
    width, height = (
        round(side * render.resolution_percentage / 100)
        for side in (render.resolution_x, render.resolution_y)
    )
    aspect = render.pixel_aspect_y / render.pixel_aspect_x
    is_wide = data.sensor_fit == "HORIZONTAL" or (
        data.sensor_fit == "AUTO" and width >= aspect * height
    )
    side = width if is_wide else aspect * height  # in widths of a pixel
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    fx = data.lens / sensor * side
    return rc.Camera(
        width=width,
        height=height,
        fx=fx,
        fy=fx / aspect,
        cx=width / 2 - data.shift_x * side,
        cy=height / 2 + data.shift_y * side / aspect,
        near=data.clip_start,
    )


def covered_shares(mesh: rc.Mesh, cameras: list[rc.Camera], poses: list[Any]) -> np.ndarray:
    """(F,) covered share of each face, and a line on all of them."""
    rig = rc.Rig(cameras, [f"camera {row}" for row in range(len(cameras))])
    world = np.array(poses) @ CV_FROM_BLENDER
    placed = rc.Poses.of(world, camera=np.arange(len(cameras)))
    covered = rc.evaluate(mesh, rig, placed, rc.Task(max_incidence_deg=75)).covered
    print(f"covered: {100 * covered.share():.1f} % of the area")
    return covered.area[0] / mesh.areas


def cover_active_mesh() -> None:
    """Store the shares in the active object of Blender."""
    scene, graph = bpy.context.scene, bpy.context.evaluated_depsgraph_get()
    target = bpy.context.active_object
    data = target.evaluated_get(graph).to_mesh()
    data.calc_loop_triangles()
    to_world = np.array(target.matrix_world)
    points = np.array([each.co for each in data.vertices]) @ to_world[:3, :3].T + to_world[:3, 3]
    faces = np.array([each.vertices for each in data.loop_triangles])
    polygon = np.array([each.polygon_index for each in data.loop_triangles])
    mesh = rc.Mesh(vertices=points, faces=faces)
    eyes = [each for each in scene.objects if each.type == "CAMERA" and each.data.type == "PERSP"]
    cameras = [camera_of(scene.render, eye.data) for eye in eyes]
    # A camera may be scaled; its pose is not.
    poses = [np.array(eye.matrix_world.normalized()) for eye in eyes]
    shares = covered_shares(mesh, cameras, poses)
    sums = np.bincount(polygon, shares * mesh.areas) / np.bincount(polygon, mesh.areas)
    attribute = target.data.attributes.new("coverage", "FLOAT", "FACE")
    attribute.data.foreach_set("value", sums.astype(np.float32))


if __name__ == "__main__":
    if bpy is not None:
        cover_active_mesh()
    else:
        views = rc.look_at([(0.0, -4.0, 1.0), (3.0, 2.0, 0.0)], (0, 0, 0)) @ CV_FROM_BLENDER
        own = [Settings(), Settings(sensor_fit="VERTICAL", shift_y=0.05, pixel_aspect_x=1.2)]
        covered_shares(rc.shapes.sphere(3), [camera_of(each, each) for each in own], list(views))
