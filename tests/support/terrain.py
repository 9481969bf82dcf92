"""A terrain with a house on it, images of it from above, and what single rays find."""

import numpy as np
import trimesh

import rastercov as rc
from rastercov.core.camera.projection import to_image
from rastercov.core.mesh import Mesh, shapes

CAMERAS = (
    rc.Camera.from_fov(640, 480, hfov_deg=70),
    rc.Camera(
        width=600, height=500, fx=260, fy=260, model="opencv_fisheye", max_angle_deg=70,
        distortion=(0.02, -0.005, 0, 0),
    ),
)  # fmt: skip


def ground(n=13, half=50.0, height=1.0):
    """Terrain of (n - 1)^2 squares, each of two triangles; a plane for height 0."""
    side = np.linspace(-half, half, n)
    x, y = np.meshgrid(side, side, indexing="ij")
    z = height * (4 * np.sin(x / 9) * np.cos(y / 7) + 6 * np.exp(-((x - 10) ** 2 + y**2) / 60))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (
        each.ravel() for each in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    )
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))
    return Mesh(np.stack((x, y, z), axis=-1).reshape(-1, 3), faces)


def site(height=1.0):
    """Ground, a house, and its wider roof."""
    house = shapes.box((8, 8, 12)).moved(translation=(-10, 5, 8))
    roof = shapes.box((14, 14, 1)).moved(translation=(-10, 5, 14.5))
    return Mesh.joined([ground(height=height), house, roof], ["ground", "house", "roof"])


def images():
    """Poses of the cameras: oblique, from above, and under the roof."""
    eyes = np.array([(-30, -20, 40.0), (-15, 0, 35), (0, 10, 30), (-24, 3, 12)])
    targets = eyes + np.array([(5, 10, -30), (0, 0, -30), (10, 3, -30), (20, 2, -12)])
    return rc.Poses.of(rc.look_at(eyes, targets), camera=[0, 1, 0, 1])


def first_hits(mesh, starts, directions):
    """(N,) distance of the first surface along rays, inf for none."""
    scene = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    places, rays, _ = scene.ray.intersects_location(starts, directions, multiple_hits=True)
    result = np.full(len(starts), np.inf)
    np.minimum.at(result, rays, np.linalg.norm(places - starts[rays], axis=1))
    return result


def heights(mesh, xy, above=100.0):
    """(N,) z of what is seen from above."""
    starts = np.column_stack((xy, np.full(len(xy), above)))
    return above - first_hits(mesh, starts, np.tile([0.0, 0.0, -1.0], (len(xy), 1)))


def is_seen(mesh, camera, pose, points, slack=1e-6):
    """(N,) True for points in an image that the ray from the camera reaches first."""
    eye = pose[:3, 3]
    local = (points - eye) @ pose[:3, :3]
    with np.errstate(all="ignore"):
        at = to_image(local, camera)
        angle = np.degrees(np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2]))
    inside = ((at >= 0) & (at < (camera.width, camera.height))).all(axis=1)
    inside &= angle < (90 if camera.is_pinhole else camera.max_angle_deg)
    distance = np.linalg.norm(points - eye, axis=1)
    hit = np.full(len(points), -1.0)
    rows = np.flatnonzero(inside)
    starts = np.tile(eye, (len(rows), 1))
    hit[rows] = first_hits(mesh, starts, (points[rows] - eye) / distance[rows, None])
    return inside & (np.abs(hit - distance) <= slack * distance)
