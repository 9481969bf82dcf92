"""A ROS 2 node: CameraInfo and the frame of a camera in, the covered triangles as a marker out.

It needs rclpy and this file: `python3 ros_coverage.py MESH UNIT`. Without ROS it
computes the same for a torus and a message like the one below.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml

import rastercov as rc

try:
    import rclpy
except ImportError:
    rclpy = None

WORLD = "map"
INFO = SimpleNamespace(
    width=640,
    height=480,
    distortion_model="plumb_bob",
    k=[500.0, 0.0, 319.5, 0.0, 500.0, 239.5, 0.0, 0.0, 1.0],
    d=[-0.1, 0.02, 0.001, -0.001, 0.0],
)
"""Message of a camera, sensor_msgs/CameraInfo."""


def camera_of(info: Any) -> rc.Camera:
    """Camera of a CameraInfo, as rastercov reads it from a file of camera_calibration."""
    coefficients = [float(each) for each in info.d] or [0.0] * 5
    content = {
        "image_width": int(info.width),
        "image_height": int(info.height),
        "camera_name": "camera",
        "distortion_model": info.distortion_model or "plumb_bob",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [float(each) for each in info.k]},
        "distortion_coefficients": {
            "rows": 1, "cols": len(coefficients), "data": coefficients
        },
    }  # fmt: skip
    with TemporaryDirectory() as folder:
        path = Path(folder) / "camera.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return rc.read_views(path, format="ros").camera()


def pose_of(translation: Any, rotation: Any) -> np.ndarray:
    """world_from_camera of a geometry_msgs/Transform to an optical frame: z forward, y down."""
    x, y, z, w = np.array([rotation.x, rotation.y, rotation.z, rotation.w], np.float64)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = translation.x, translation.y, translation.z
    return pose


def covered_triangles(mesh: rc.Mesh, camera: rc.Camera, pose: np.ndarray) -> np.ndarray:
    """(3 N, 3) corners of the faces that are covered by half or more, and a line on the area."""
    covered = rc.evaluate(mesh, camera, pose[None], rc.Task(max_incidence_deg=75)).covered
    print(f"covered: {100 * covered.share():.1f} % of the area")
    return mesh.vertices[mesh.faces[covered.area[0] >= 0.5 * mesh.areas]].reshape(-1, 3)


def spin(mesh: rc.Mesh) -> None:
    """Publish a marker for each CameraInfo, with the transform of its frame."""
    from geometry_msgs.msg import Point
    from rclpy.node import Node
    from sensor_msgs.msg import CameraInfo
    from tf2_ros import Buffer, TransformListener
    from visualization_msgs.msg import Marker

    rclpy.init()
    node, buffer = Node("rastercov"), Buffer()
    listener = TransformListener(buffer, node)
    markers = node.create_publisher(Marker, "coverage", 1)

    def take(info: Any) -> None:
        if not buffer.can_transform(WORLD, info.header.frame_id, rclpy.time.Time()):
            return
        found = buffer.lookup_transform(WORLD, info.header.frame_id, rclpy.time.Time()).transform
        corners = covered_triangles(
            mesh, camera_of(info), pose_of(found.translation, found.rotation)
        )
        marker = Marker(type=Marker.TRIANGLE_LIST, action=Marker.ADD)
        marker.header.frame_id, marker.header.stamp = WORLD, info.header.stamp
        marker.scale.x = marker.scale.y = marker.scale.z = marker.pose.orientation.w = 1.0
        marker.color.g, marker.color.a = 0.8, 1.0
        marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners.tolist()]
        markers.publish(marker)

    node.create_subscription(CameraInfo, "camera_info", take, 1)
    rclpy.spin(node)
    del listener


if __name__ == "__main__":
    if rclpy is not None:
        spin(rc.Mesh.load(sys.argv[1], unit=sys.argv[2]))
    else:
        place = SimpleNamespace(x=0.0, y=0.0, z=-4.0)
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        covered_triangles(rc.shapes.torus(), camera_of(INFO), pose_of(place, turn))
