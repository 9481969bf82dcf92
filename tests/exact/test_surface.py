"""Meshes as the exact paths want them: edges by position, contacts by distance, kept per mesh."""

import gc
import weakref

import numpy as np
from exact_cases import box
from exact_views import SEEDS
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined, square

from rastercov.exact.surface import surface_of
from rastercov.mesh import Mesh


def test_minus_zero_and_zero_are_one_place():
    points = [(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (-0.0, -0.0, 0), (1, 0, -0.0), (0, -1, 0)]
    found = surface_of(Mesh(vertices=points, faces=[(0, 1, 2), (4, 3, 5)]))
    assert len(found.vertices) == 4
    assert (found.edges.faces >= 0).all(axis=1).sum() == 1


# --- contacts -------------------------------------------------------------------------------------


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
