"""The built-in parts are what their docstrings promise."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rastercov.base.errors import MeshError
from rastercov.core.mesh import Mesh, shapes

CLOSED = {
    "aeroplane": (lambda: shapes.aeroplane(), 1970, 2),
    "aeroplane 9856": (lambda: shapes.aeroplane(9856), 9856, 2),
    "torus": (lambda: shapes.torus(12, 7), 168, 0),
    "sphere": (lambda: shapes.sphere(3), 1280, 2),
    "icosahedron": (lambda: shapes.icosahedron(), 20, 2),
    "noisy icosahedron": (lambda: shapes.icosahedron(0.1, 3), 1280, 2),
    "box": (lambda: shapes.box((1, 2, 3), 4, (5, 6, 7)), 192, 2),
    "room": (lambda: shapes.room(3), 108 + 3 * 48, 8),
}


def n_edges(mesh: Mesh) -> int:
    sides = np.stack([mesh.faces, np.roll(mesh.faces, 1, axis=1)], axis=-1)
    return len(np.unique(np.sort(sides.reshape(-1, 2)), axis=0))


def signed_volume(mesh: Mesh) -> float:
    return float(np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6)


@pytest.mark.parametrize(("make", "n_faces", "euler"), CLOSED.values(), ids=CLOSED)
def test_closed_shapes_are_closed_and_wound_alike(make, n_faces, euler):
    mesh = make()
    assert mesh.n_faces == n_faces
    assert mesh.is_closed
    assert mesh.is_consistently_wound
    assert mesh.n_vertices - n_edges(mesh) + mesh.n_faces == euler
    assert not mesh.duplicate_mask.any()
    # A room is a cavity, with crates that stand free.
    assert (signed_volume(mesh) > 0) == mesh.can_cull_back_faces == (mesh.n_faces != 252)


IMPOSSIBLE = (
    *(partial(shapes.teapot, n) for n in (1, 129)),
    partial(shapes.aeroplane, 2000),
    *(partial(shapes.torus, **each) for each in ({"n_major": 2}, {"minor_radius": 1.0})),
    *(partial(shapes.sphere, *each) for each in ((-1,), (1, 0))),
    *(partial(shapes.icosahedron, **each) for each in ({"noise": -0.1}, {"edge_length": -1})),
    *(partial(shapes.box, **each) for each in ({"size": (1, 0, 1)}, {"n": 0})),
    partial(shapes.by_name, "kettle"),
)


def test_impossible_shapes_are_refused_in_one_line():
    for make in IMPOSSIBLE:
        with pytest.raises(MeshError, match=r"^[^\n]*, got[^\n]*$|; got 'kettle'$"):
            make()


@pytest.mark.parametrize("name", shapes.NAMES)
def test_every_name_gives_the_same_sound_mesh_twice(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh, again = shapes.by_name(name), Mesh.load(name)
    assert mesh.groups == again.groups
    assert np.isfinite(mesh.vertices).all()
    assert len(np.unique(mesh.faces)) == mesh.n_vertices  # no stray vertices
    assert len(np.unique(mesh.vertices, axis=0)) == mesh.n_vertices  # welded
    assert not mesh.degenerate_mask.any()
    assert np.array_equal(mesh.vertices, again.vertices)
    assert np.array_equal(mesh.faces, again.faces)


# Teapot


@pytest.mark.parametrize("n", [2, 3, 5, 7, 16])
def test_teapot_only_drops_the_faces_at_its_poles(n):
    whole, mesh = shapes.teapot(n, keep_degenerate=True), shapes.teapot(n)
    assert whole.n_faces == 64 * n**2
    assert whole.degenerate_mask.sum() == 8 * n
    assert np.array_equal(whole.faces[~whole.degenerate_mask], mesh.faces)
    assert not mesh.degenerate_mask.any()
    assert not mesh.duplicate_mask.any()


@pytest.mark.parametrize("n", [2, 5, 7, 12])
def test_teapot_is_open_only_at_rim_lid_handle_and_spout(n):
    mesh = shapes.teapot(n)
    assert mesh.is_consistently_wound
    assert mesh.n_nonmanifold_edges == 0
    # Circles of 4 n edges at rim and lid, of 2 n at both ends of handle and spout.
    assert mesh.n_boundary_edges == 2 * 4 * n + 4 * 2 * n
    # Four pieces: body with bottom, lid, handle, spout.
    assert len(np.unique(mesh.topology.components())) == 4


def test_teapot_is_as_large_as_a_teapot_and_right_side_out():
    mesh = shapes.teapot(10)
    low, high = mesh.bounds
    assert low == pytest.approx([-0.15, -0.1, 0.0], abs=1e-12)
    assert high == pytest.approx([0.1717, 0.1, 0.1575], abs=1e-4)
    # Seen from the middle of the pot, the wall (neither handle nor spout nor lid) faces away.
    centre = np.array([0.0, 0.0, 0.06])
    z, y = mesh.centroids[:, 2], np.abs(mesh.centroids[:, 1])
    wall = (z > 0.02) & (z < 0.115) & (y > 0.04)
    assert wall.sum() > 500
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.centroids - centre)[wall] > 0).all()
    knob, foot = z > 0.156, z < 1e-3
    assert (mesh.normals[knob, 2] > 0).all()
    assert (mesh.normals[foot, 2] < 0).all()


# Aeroplane


@pytest.mark.parametrize("n_faces", shapes.AEROPLANE_FACES)
def test_aeroplane_has_the_thesis_counts_and_an_airliners_size(n_faces):
    mesh = shapes.aeroplane(n_faces)
    assert mesh.n_vertices == n_faces // 2 + 2
    length, span, height = np.ptp(mesh.bounds, axis=0)
    assert length == pytest.approx(30, abs=0.3)
    assert span == pytest.approx(29, abs=0.3)
    assert 8 < height < 12
    assert len(np.unique(mesh.topology.components())) == 1


# Round and flat


def test_sphere_vertices_lie_on_the_sphere():
    mesh = shapes.sphere(3, radius=2.5)
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(2.5, rel=1e-14)
    assert signed_volume(mesh) == pytest.approx(4 / 3 * np.pi * 2.5**3, rel=0.02)


def test_torus_vertices_lie_on_the_torus():
    mesh = shapes.torus(40, 20, 2.0, 0.5)
    x, y, z = mesh.vertices.T
    assert np.hypot(np.hypot(x, y) - 2.0, z) == pytest.approx(0.5, rel=1e-12)
    assert signed_volume(mesh) == pytest.approx(2 * np.pi**2 * 2.0 * 0.5**2, rel=0.03)


def test_box_has_the_sides_volume_and_place_asked_for():
    mesh = shapes.box((1, 2, 3), n=3, centre=(5, 6, 7))
    assert mesh.bounds.tolist() == [[4.5, 5, 5.5], [5.5, 7, 8.5]]
    assert signed_volume(mesh) == pytest.approx(6)
    sides = np.repeat([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], 18, 0)
    assert np.allclose(mesh.normals, sides, atol=1e-12)


def test_room_faces_a_camera_inside_and_its_crates_stand_free():
    mesh = shapes.room()
    assert [group.name for group in mesh.groups] == ["room", "crates"]
    eye = np.array([0.0, 0.0, 2.0])
    is_shell = mesh.face_group == 0
    assert (np.einsum("ij,ij->i", mesh.normals, eye - mesh.centroids)[is_shell] > 0).all()
    crates = mesh.vertices[np.unique(mesh.faces[~is_shell])]
    low, high = mesh.bounds
    assert (crates > low + 0.05).all()
    assert (crates < high - 0.05).all()
    assert signed_volume(mesh) == pytest.approx(-(6 * 5 * 2.8) + 0.96 + 0.512 + 1.536)


# Icosahedron


def test_icosahedron_sides_keep_their_faces_together():
    plain, fine = shapes.icosahedron(), shapes.icosahedron(subdivisions=3)
    assert np.allclose(fine.normals, np.repeat(plain.normals, 64, axis=0), atol=1e-12)
    assert plain.areas == pytest.approx(3**0.5 / 4)
    assert fine.areas == pytest.approx(3**0.5 / 4 / 64)
    assert shapes.icosahedron(edge_length=2.0).areas == pytest.approx(3**0.5)


def test_icosahedron_noise_has_the_spread_asked_for():
    plain = shapes.icosahedron(subdivisions=5, edge_length=3.0)
    noisy = shapes.icosahedron(0.1, 5, seed=1, edge_length=3.0)
    moved = (noisy.vertices - plain.vertices) / (3.0 / 32)  # in edges of the small faces
    standard_error = 0.1 / np.sqrt(2 * moved.size)
    assert abs(moved.std() - 0.1) < 4 * standard_error
    assert abs(moved.mean()) < 4 * 0.1 / np.sqrt(moved.size)
    assert np.array_equal(plain.faces, noisy.faces)
    same, other = (shapes.icosahedron(0.1, 5, seed, 3.0).vertices for seed in (1, 2))
    assert np.array_equal(noisy.vertices, same) > np.array_equal(noisy.vertices, other)


def test_a_built_in_mesh_takes_flags_and_a_place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    group = shapes.box().groups[0].name
    load = Mesh.load("box", two_sided=[group], transforms=[{"scale": 2.0}])
    assert load.groups[0].is_two_sided
    np.testing.assert_allclose(load.bounds, 2 * shapes.box().bounds)
    Mesh.load(["box"], ["m"])
    for path, unit, got in (
        ("box", "mm", "a unit; remove it"),
        (["box", Path("torus")], "m", "torus, too; give one mesh"),
        (["gone.stl", Path("box")], "m", "gone.stl, too; give one mesh"),
    ):
        with pytest.raises(MeshError, match=f"the built-in mesh box alone, got {got}$"):
            Mesh.load(path, unit)
    with pytest.raises(MeshError, match="bax: expected a mesh file or a built-in mesh"):
        Mesh.load("bax")
    (tmp_path / "box").write_text("a file comes first")
    with pytest.raises(MeshError, match="box: expected a mesh file of"):
        Mesh.load("box")
