"""Surfaces whose faces are sorted: figures come out as of the mesh, which is in another order."""

import numpy as np
import pytest
from exact_cases import AHEAD, WINDOW
from exact_views import SEEDS, soup
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples
from scenes import joined, square
from surfaces import surface_of
from target_scenes import only, some_as_targets

import rastercov as rc
from rastercov.core.mesh import Mesh, shapes


def scene(seed):
    """Faces in any order, of which some coincide, touch or pass through others; two copies."""
    rng = np.random.default_rng(seed)
    ring = shapes.torus(24, 12)
    ring = Mesh(np.add(ring.vertices, (0, 0, 6)), ring.faces)
    twin = Mesh(ring.vertices, ring.faces[rng.random(ring.n_faces) < 0.1])
    mesh = joined(ring, twin, square(0.5, 4.0), square(0.3, 4.0), soup(rng, 20))
    mesh = only(mesh, rng.permutation(mesh.n_faces))
    if rng.random() < 0.5:
        mesh = some_as_targets(mesh, rng.random(mesh.n_faces) < 0.05)
    copy = only(mesh, np.arange(mesh.n_faces))
    surface = surface_of(copy, least_sorted=1)
    assert not np.array_equal(surface.rank, np.arange(len(surface.faces)))
    return mesh, copy


@pytest.mark.slow
@given(seed=SEEDS, method=st.sampled_from(["certified", "exact"]))
@examples(7, at_night=20)
def test_sorted_faces_have_the_figures_of_the_mesh(seed, method):
    assert_same(seed, WINDOW, method)


@pytest.mark.slow
@given(seed=SEEDS)
@settings(max_examples=5)
def test_sorted_faces_have_the_figures_of_the_mesh_through_a_lens(seed):
    assert_same(seed, CAMERAS["brown"], "certified")


def assert_same(seed, camera, method):
    """Observers of both copies agree; where faces tie, the first one of the mesh is seen."""
    items = []
    for mesh in scene(seed):
        with rc.open_observer(mesh, camera, method, threads=1) as observer:
            items.append(observer.observe(AHEAD))
    one, other = items
    np.testing.assert_allclose(one.drawn_pixels, other.drawn_pixels, rtol=1e-12, atol=1e-9)
    assert np.array_equal(one.kind, other.kind)
    off = np.abs(one.visible_pixels - other.visible_pixels)
    assert (off <= one.area_error + other.area_error + 1e-9).all()
