"""Digests of what is decided by numbers: positions, poses, frames; a line of JSON.

Run for itself it prints them, under any processor and any library of C.
"""

import hashlib
import json

import numpy as np

import rastercov as rc
from rastercov.core.camera.sun import towards
from rastercov.core.camera.viewpoints import cone_of_directions
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.mesh.arrays import nearest_rotations, rotation_about
from rastercov.placement import (
    Circles,
    Framing,
    Objective,
    PoseSpace,
    Room,
    Survey,
    in_room,
    on_box,
    on_hemisphere,
    on_sphere,
    on_walls,
    openings,
    orbit,
    per_face,
    per_segment,
    refine,
    segment,
    strips,
)

SEED = 5


def digest(array):
    return hashlib.sha256(np.ascontiguousarray(array, np.float64).tobytes()).hexdigest()[:16]


def decided():
    """Arrays by what decides them."""
    rng = np.random.default_rng(SEED)
    part = rc.shapes.teapot(3)
    part = part.moved(axis=(1, 2, 3), angle_deg=17, translation=(0.1, 0.2, 1.3))
    camera = rc.Camera.from_fov(640, 480, hfov_deg=53.7)
    lens = {"model": "opencv_fisheye", "fx": 150, "fy": 150, "cx": 200, "cy": 199}
    wide = rc.Camera(width=400, height=400, **lens)
    up = tuple(rng.normal(size=3))
    framing = Framing(rolls_deg=(0, 31.7), up=up, stand_off=(0.2, 3), fit="vertices")
    segments = segment(part, 20, 40)
    yield "mesh", part.vertices
    yield "sphere", rc.sphere_of_poses((0.1, 0.2, 0.3), 1.7, 2000)
    yield "on_sphere", on_sphere(part, camera, framing, count=50).poses
    yield "on_hemisphere", on_hemisphere(part, wide, framing, count=50).poses
    yield "on_box", on_box(part, camera, framing, spacing=0.2).poses
    yield "per_face", per_face(part, camera, framing).poses
    yield "per_segment", per_segment(part, camera, framing, segmentation=segments).poses
    yield "labels", segments.labels
    yield "closest", segment(part, 20, 40, merge="closest").labels
    yield "torus", rc.shapes.torus().vertices
    house = rc.shapes.box((4, 3, 2.5))
    inside = rc.Mesh(house.vertices, house.faces[:, ::-1])
    yield "on_walls", on_walls(inside, camera, spacing=0.7).poses
    room = Room.at(inside, (0.1, 0.2, 0.3))
    yield "in_room", in_room(inside, camera, room=room, spacing=0.7).poses
    area = ((0, 0), (60, 5), (50, 40))
    survey = Survey(height=30, front=0.7, side=0.6, heading_deg=13, tilt_deg=20, polygon=area)
    yield "strips", strips(part, camera, survey=survey).poses
    circles = Circles(radius=5, heights=[1, 3], count=12)
    yield "orbit", orbit(part, camera, circles=circles).poses
    yield (
        "openings",
        openings(part, camera, framing, faces=range(0, 40, 7), views=2).candidates.poses,
    )
    yield "towards", towards(np.arange(360.0), np.linspace(1, 89, 360), 13.0)
    yield "cone", cone_of_directions(np.eye(3), 7, 11.0)
    space = PoseSpace(mesh=part, boxes=[((-1, -1, 0), (1, 1, 3))], stand_off=(0.1, 2))
    start = rc.sphere_of_poses(part.centre, 1, 2)
    with open_observer(part, camera) as observer:
        objective = Objective.of(observer, rc.Task())
        yield "refine", refine(objective, space, start, halvings=1, budget=200).poses
    drifted = rotation_about(up, 0.7) + 1e-7 * rng.random((50, 3, 3))
    yield "rotations", nearest_rotations(drifted)


if __name__ == "__main__":
    print(json.dumps({name: digest(array) for name, array in decided()}))
