"""Coverage of a part in a fixture that occludes faces and is not evaluated."""

import numpy as np

import rastercov as rc
from rastercov.core.mesh import shapes

# From files: rc.Mesh.load(["part.stl", "fixture.stl"], unit="mm", occluders=["fixture"])
part, clamp = shapes.sphere(4, radius=0.05), shapes.box((0.04, 0.04, 0.04), centre=(0, 0, 0.06))
mesh = rc.Mesh(
    vertices=np.concatenate((part.vertices, clamp.vertices)),
    faces=np.concatenate((part.faces, clamp.faces + part.n_vertices)),
    groups=(rc.Group("part"), rc.Group("clamp", is_occluder=True)),
    face_group=np.repeat((0, 1), (part.n_faces, clamp.n_faces)),
)
camera = rc.Camera(width=640, height=480, fx=900, fy=900)
poses = rc.look_at(eyes=[(0.3, 0, 0.3), (-0.3, 0.1, 0.3), (0, 0, -0.4)], targets=(0, 0, 0))

for name, scene in (("alone", part), ("in the clamp", mesh)):
    coverage = rc.evaluate(scene, camera, poses, by="face")
    network = rc.Network(scene, coverage.task)
    network.add(coverage)
    covered = network.summary()["covered"]
    print(f"{name}: {covered['faces']} faces covered, {covered['area_percent']:.1f} % of the area")
