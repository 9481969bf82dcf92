"""Meshes to and from trimesh: no face is lost or moved, and the checks of `Mesh` hold."""

import numpy as np
import pytest
import trimesh

from rastercov.base.errors import MeshError
from rastercov.core.mesh import Group, Mesh, shapes


def assert_same(one, other):
    for name in ("vertices", "faces", "face_group", "source_face"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.groups == other.groups


def test_a_mesh_comes_back_from_trimesh_as_it_was():
    flags = {"occluders": ["crates"], "two_sided": ["room"]}
    room = shapes.room(3).with_groups(**flags)
    repeated = np.array([[0, 0, 1], [2, 2, 2]])  # faces that trimesh would drop, if asked to
    mesh = Mesh(
        vertices=room.vertices,
        faces=np.concatenate([room.faces, repeated, room.faces[:2]]),
        groups=room.groups,
        face_group=np.concatenate([room.face_group, [0, 1, 1, 0]]),
        source_face=np.arange(room.n_faces + 4) // 2,
    )
    assert_same(Mesh.from_trimesh(mesh.to_trimesh()), mesh)
    assert_same(Mesh.from_trimesh(mesh.to_trimesh().copy(), name="unused"), mesh)


def test_groups_follow_the_faces_that_trimesh_keeps():
    room = shapes.room(3)
    tri = room.to_trimesh()
    chosen = np.arange(room.n_faces) % 3 == 0
    tri.update_faces(chosen)
    mesh = Mesh.from_trimesh(tri)
    np.testing.assert_array_equal(mesh.faces, room.faces[chosen])
    np.testing.assert_array_equal(mesh.face_group, room.face_group[chosen])
    np.testing.assert_array_equal(mesh.source_face, np.flatnonzero(chosen))


def test_a_mesh_made_by_trimesh_is_one_group_in_metres():
    box = trimesh.creation.box((200.0, 100.0, 50.0))
    mesh = Mesh.from_trimesh(box, name="part", unit="mm")
    assert mesh.groups == (Group("part"),)
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), (0.2, 0.1, 0.05))
    np.testing.assert_array_equal(mesh.faces, box.faces)
    assert mesh.is_closed


def test_changes_of_the_copy_do_not_reach_the_mesh():
    mesh = shapes.box()
    before = mesh.vertices.copy()
    tri = mesh.to_trimesh()
    tri.apply_scale(2.0)
    np.testing.assert_array_equal(mesh.vertices, before)
    tri.face_attributes["source_face"][:] = 0
    np.testing.assert_array_equal(mesh.source_face, np.arange(mesh.n_faces))


@pytest.mark.parametrize("tri", [trimesh.Scene(), np.zeros((3, 3))])
def test_what_is_no_mesh_is_refused(tri):
    with pytest.raises(MeshError, match=r"tri to be a trimesh.Trimesh \(of a Scene, pass scene"):
        Mesh.from_trimesh(tri)
