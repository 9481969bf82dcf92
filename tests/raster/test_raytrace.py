"""Against Embree, a ray tracer that shares nothing with the rasteriser: no differing pixel.

Both answer "which face" at each pixel centre. Rays are built here from the camera convention. Where
the answers differ, the two faces in question are looked at in float64: a pixel within 4e-3 px of
one of their projected edges is excused (the device rounds corners to 1/256 px), and so is one where
their depths are within 1e-4. Embree works in float32 itself and misses tiny faces, so of what is
left, the nearest of all faces at that pixel in float64 says who is wrong.
"""

import itertools
import os
from pathlib import Path

import numpy as np
import pytest
from image_laws import shown_by_two
from wheels import with_wheel

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import Mesh, shapes
from rastercov.gl import PLANS
from rastercov.reference import samples

TriangleMesh = with_wheel("embreex.mesh_construction").TriangleMesh
EmbreeScene = with_wheel("embreex.rtcore_scene").EmbreeScene
CAMERA = Camera(width=640, height=512, fx=700, fy=690, cx=327.75, cy=250.25)
WIDE = Camera(width=640, height=512, fx=320, fy=325, cx=315.25, cy=260.25)
EDGE, GAP = 4e-3, 1e-4

MESHES = Path(os.environ.get("RASTERCOV_MESHES", "no folder"))
"""Folder of mesh files, some of which are tested, too."""


def traced(mesh, camera, pose):
    """Face index at each pixel centre by Embree, (H, W), -1 for background."""
    eye, rotation = pose[:3, 3], pose[:3, :3]
    scene = EmbreeScene(robust=True)
    vertices = (mesh.vertices - eye).astype(np.float32)
    TriangleMesh(scene, vertices, mesh.faces.astype(np.int32))
    column, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    x = (column + 0.5 - camera.cx) / camera.fx
    y = (row + 0.5 - camera.cy) / camera.fy
    # Columns of world_from_camera are the camera's axes: right, down, forward.
    rays = x[..., None] * rotation[:, 0] + y[..., None] * rotation[:, 1] + rotation[:, 2]
    rays = rays.reshape(-1, 3).astype(np.float32)
    return scene.run(np.zeros_like(rays), rays).reshape(column.shape)


def is_wrong(mesh, camera, pose, ours, theirs, point):
    """Whether Embree's face at a point is right and ours is not, for no edge and no equal depth."""

    def view(faces):
        part = Mesh(vertices=mesh.vertices, faces=mesh.faces[faces])
        return samples.at_points(part, camera, pose, point[None])

    named = view([face for face in (ours, theirs) if face >= 0])
    if named.edge_distance[0] <= EDGE or named.depth_gap[0] <= GAP:
        return False
    return view(slice(None)).face[0] != ours


def assert_no_differing_pixel(open_raster, mesh, camera, poses):
    with open_raster(mesh, camera) as rasterizer:
        images = [rasterizer.render(pose).face for pose in poses]
    for pose, face in zip(poses, images, strict=True):
        expected = traced(mesh, camera, pose)
        assert (expected >= 0).mean() > 0.02  # the camera sees something
        differing = np.argwhere(face != expected)
        assert len(differing) <= 1e-3 * face.size, f"{len(differing)} of {face.size} pixels differ"
        for row, column in differing:  # a few hundred in practice, 1 ms each
            point = np.array((column + 0.5, row + 0.5))
            answers = face[row, column], expected[row, column]
            assert not is_wrong(mesh, camera, pose, *answers, point), (row, column, *answers)


def outside(mesh, n=3):
    middle, size = mesh.bounds.mean(axis=0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    return sphere_of_poses(middle, 1.2 * size, n)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("open_raster", "name"),
    [
        *itertools.product((*PLANS, "cpu"), ("teapot", "aeroplane")),
        ("pipeline", "aeroplane-9856"),
        ("cpu", "torus"),
    ],
    indirect=["open_raster"],
)
def test_built_in_part_is_seen_as_by_rays(open_raster, name):
    mesh = shapes.by_name(name)
    assert_no_differing_pixel(open_raster, mesh, CAMERA, outside(mesh))


@pytest.mark.slow
def test_room_is_seen_as_by_rays_from_inside(open_raster):
    eyes = [(0.2, 0.1, 1.5), (2.4, 2.1, 0.4), (-2.7, 1.3, 2.2)]
    targets = [(1, 1, 1), (-3, 0, 1), (1.6, -1.4, 0.9)]
    assert_no_differing_pixel(open_raster, shapes.room(8), WIDE, look_at(eyes, targets))


def stored_mesh(name):
    if not (MESHES / name).exists():
        pytest.skip(f"{name} is not here: the mesh collection is not part of the project")
    return Mesh.load(MESHES / name)


@pytest.mark.slow
@shown_by_two
@pytest.mark.parametrize(
    "name",
    [
        "spot.obj",
        "stanford-bunny.obj",
        "bunny_1602_closed.ply",
        "bunny_5122_closed.ply",
        "featuretype.STL",
        "ADIS16480.STL",
    ],
)
def test_real_part_is_seen_as_by_rays(open_raster, name):
    mesh = stored_mesh(name)
    assert_no_differing_pixel(open_raster, mesh, CAMERA, outside(mesh, 2))
