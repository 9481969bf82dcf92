"""Meshes as the exact paths want them: edges by position, contacts by distance, kept per mesh."""

import gc
import weakref
from collections import defaultdict

import numpy as np
import pytest
from exact_cases import box
from exact_views import SEEDS
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined, square

from rastercov.exact.surface import surface_of
from rastercov.kernels.exact_records import CONSISTENT, NON_MANIFOLD, REVERSED
from rastercov.mesh import Mesh, contacts, shapes
from rastercov.mesh.contacts import CONTACT, REACH, touching_faces


def random_mesh(seed):
    """Faces between few points, some of them equal: borders, fins, flaps, twins, any winding."""
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3, (8, 3)).astype(float)
    return Mesh(vertices=points, faces=rng.integers(0, 8, (int(rng.integers(1, 15)), 3)))


@given(seed=SEEDS)
@settings(max_examples=40)
def test_edges_are_those_of_the_faces_by_position(seed):
    mesh = random_mesh(seed)
    found = surface_of(mesh)
    uses = defaultdict(list)
    for face, corners in enumerate(found.faces.tolist()):
        for i in range(3):
            a, b = corners[i], corners[(i + 1) % 3]
            uses[min(a, b), max(a, b)].append((face, a < b))
    assert sorted(uses) == sorted(map(tuple, found.edges.vertices.tolist()))
    for edge, (a, b) in enumerate(found.edges.vertices.tolist()):
        users = uses[a, b]
        first, second = found.edges.faces[edge].tolist()
        faces = sorted(face for face, _ in users)
        kind = found.edges.kind[edge]
        if a == b or len(users) > 2:
            assert kind == NON_MANIFOLD
            assert first in faces
        elif len(users) == 1:
            assert (first, second, kind) == (faces[0], -1, CONSISTENT)
        else:
            assert sorted((first, second)) == faces
            assert kind == (CONSISTENT if users[0][1] != users[1][1] else REVERSED)
    for face, corners in enumerate(found.faces.tolist()):
        for i, edge in enumerate(found.edges.of_face[face].tolist()):
            ends = {corners[i], corners[(i + 1) % 3]}
            assert set(found.edges.vertices[edge].tolist()) == ends


@given(seed=SEEDS)
@settings(max_examples=25)
def test_every_position_in_use_stands_once_and_faces_stay_where_they_are(seed):
    mesh = random_mesh(seed)
    found = surface_of(mesh)
    assert len(np.unique(found.vertices, axis=0)) == len(found.vertices)
    assert set(found.faces.ravel()) == set(range(len(found.vertices)))
    expected = mesh.vertices[mesh.faces]
    assert np.array_equal(found.vertices[found.faces], expected)
    assert np.array_equal(found.flat, mesh.degenerate_mask)
    assert found.diagonal == pytest.approx(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))


def test_minus_zero_and_zero_are_one_place():
    points = [(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (-0.0, -0.0, 0), (1, 0, -0.0), (0, -1, 0)]
    found = surface_of(Mesh(vertices=points, faces=[(0, 1, 2), (4, 3, 5)]))
    assert len(found.vertices) == 4
    assert (found.edges.faces >= 0).all(axis=1).sum() == 1


# --- contacts -------------------------------------------------------------------------------------


def test_contacts_grow_with_the_distance_by_decades():
    mesh = shapes.teapot(3)
    found = surface_of(mesh)
    diagonal = found.diagonal
    for distance, tolerance in ((0.1, 1), (REACH * 0.999, 1), (REACH * 1.001, 10), (3e4, 1000)):
        expected = touching_faces(
            found.vertices, found.faces.astype(np.int64), tolerance * CONTACT * diagonal
        )
        assert np.array_equal(found.contacts.faces_for(distance * diagonal), expected)


@given(seed=SEEDS, distance=st.floats(-3, 8))
@settings(max_examples=20)
def test_whatever_is_at_equal_depth_from_afar_is_in_contact(seed, distance):
    # 1e-10 of the distance is the tie of depths; contacts must reach beyond that.
    rng = np.random.default_rng(seed)
    diagonal = 2 * np.sqrt(2)
    tie = 1e-10 * 10**distance * diagonal
    gap = tie * rng.uniform(0, 1)
    mesh = joined(square(1, 0.0), square(1, gap))
    assert surface_of(mesh).contacts.faces_for(10**distance * diagonal).all()


def test_contacts_of_a_decade_are_worked_out_once(monkeypatch):
    calls = []

    def counted(*arguments, **options):
        calls.append(1)
        return touching_faces(*arguments, **options)

    monkeypatch.setattr(contacts, "touching_faces", counted)
    found = surface_of(box((0, 0, 0), (1, 1, 1)))
    for distance in (1, 2, 9, 40, 51, 40, 2, 400, 0.01):
        found.contacts.faces_for(float(distance))
    assert len(calls) == 2  # up to 30 diagonals, and up to 300


# --- kept as long as the mesh ---------------------------------------------------------------------


def test_the_surface_of_a_mesh_is_worked_out_once_and_dropped_with_it():
    mesh = box((0, 0, 0), (1, 2, 3))
    found = surface_of(mesh)
    assert surface_of(mesh) is found
    assert surface_of(box((0, 0, 0), (1, 2, 3))) is not found
    kept = weakref.ref(found)
    del mesh, found
    gc.collect()
    assert kept() is None
