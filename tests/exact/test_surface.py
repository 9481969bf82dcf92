"""Meshes as the exact paths want them: edges by position, contacts by distance, kept per mesh."""

import gc
import weakref

import numpy as np
import pytest
from exact_cases import box
from exact_views import SEEDS
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined, square
from surface_twin import part_of
from surfaces import surface_of

from rastercov.core.exact.surface import LEAST_SORTED
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.engine import solver_parts, solver_surface

pytestmark = pytest.mark.native


def test_minus_zero_and_zero_are_one_place():
    points = [(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (-0.0, -0.0, 0), (1, 0, -0.0), (0, -1, 0)]
    surface = surface_of(Mesh(vertices=points, faces=[(0, 1, 2), (4, 3, 5)]))
    assert len(surface.vertices) == 4
    assert (surface.edges.faces >= 0).all(axis=1).sum() == 1


# --- bit for bit as by numpy ----------------------------------------------------------------------


def named(part):
    """Arrays of a surface or of its targets by name."""
    names = {name: getattr(part, name) for name in ("vertices", "faces", "source")}
    records = ["blocks"] + ["edges"] * hasattr(part, "edges")
    for record in records:
        fields = getattr(part, record)._asdict().items()
        names |= {f"{record}.{name}": array for name, array in fields}
    return names


def assert_same_part(part, expected):
    for name, array in named(part).items():
        assert array.dtype == expected[name].dtype, name
        assert array.shape == expected[name].shape, name
        assert array.tobytes() == expected[name].tobytes(), name


@st.composite
def hostile_meshes(draw):
    """Few points for many faces: duplicates, repeated vertices, edges of many faces; targets."""
    rng = np.random.default_rng(draw(SEEDS))
    n_vertices, n_faces = draw(st.integers(1, 60)), draw(st.sampled_from([1, 2, 20, 64, 65, 200]))
    points = rng.integers(-2, 3, (n_vertices, 3)) * draw(st.sampled_from([1.0, -1.0, 1e-200, 1e29]))
    if draw(st.booleans()):
        points = rng.normal(size=(n_vertices, 3))
    faces = rng.integers(0, n_vertices, (n_faces, 3))
    if draw(st.booleans()):
        faces = faces[rng.integers(0, n_faces, n_faces)]
    share = draw(st.sampled_from([0.0, 0.2, 1.0]))
    groups = [Group("a"), Group("b", is_target=True)]
    return Mesh(points, faces, groups, (rng.random(n_faces) < share).astype(int))


def assert_same(mesh, least_sorted):
    surface, opaque = surface_of(mesh, least_sorted), mesh.opaque
    expected = part_of(opaque.vertices, opaque.welded_faces, opaque.degenerate_mask, least_sorted)
    assert_same_part(surface, expected)
    assert np.array_equal(surface.rank, expected["order"])
    assert np.array_equal(surface.centre, opaque.bounds.mean(axis=0))
    assert surface.diagonal == np.sqrt(np.sum(np.ptp(opaque.bounds, axis=0) ** 2))
    for mine, theirs in zip(*(
        (own.faces_for(1.0)[surface.rank], np.diff(own.partners_for(1.0).starts)[surface.rank])
        if own is opaque.contacts else (own[0], np.diff(own[1].starts))
        for own in (opaque.contacts, surface.contacts(1.0))
    ), strict=True):  # fmt: skip
        assert np.array_equal(mine, theirs)
    is_target = mesh.target_mask
    if is_target.any():
        flat = mesh.degenerate_mask[is_target]
        expected = part_of(mesh.vertices, mesh.welded_faces[is_target], flat, mesh.n_faces + 1)
        assert_same_part(surface.targets, expected)
    else:
        assert surface.targets is None
    order = np.empty(surface.n_faces, np.int64)
    n_opaque = np.count_nonzero(~is_target)
    order[: len(surface.faces)][:n_opaque] = np.flatnonzero(~is_target)[surface.rank[:n_opaque]]
    order[len(surface.faces) :] = np.flatnonzero(is_target)
    rows = np.arange(surface.n_faces)[surface.rows]
    assert np.array_equal(order[rows], np.arange(mesh.n_faces))


@given(mesh=hostile_meshes(), least_sorted=st.sampled_from([1, LEAST_SORTED]))
@settings(max_examples=60)
def test_a_surface_is_built_bit_for_bit_as_by_numpy(mesh, least_sorted):
    assert_same(mesh, least_sorted)


@pytest.mark.parametrize("is_shuffled", [False, True])
def test_a_large_surface_is_sorted_where_its_faces_are_in_any_order(is_shuffled):
    ring = shapes.torus(128, 66)
    rows = np.random.default_rng(0).permutation(ring.n_faces) if is_shuffled else slice(None)
    mesh = Mesh(ring.vertices, ring.faces[rows])
    assert mesh.n_faces >= LEAST_SORTED
    assert_same(mesh, LEAST_SORTED)
    assert (surface_of(mesh).place is None) == (not is_shuffled)


TRIANGLE = np.eye(3), np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"vertices": np.full((3, 3), np.nan)}, "expected finite coordinates within 1e30"),
        ({"vertices": np.full((3, 3), 1e31)}, "expected finite coordinates within 1e30"),
        ({"vertices": np.empty((0, 3))}, "faces must hold vertices"),
        ({"faces": np.array([[0, 1, 3]])}, "faces must hold vertices"),
        ({"faces": np.array([[0, 1, -1]])}, "faces must hold vertices"),
        ({"faces": np.array([[0, 1, 2**31]])}, "faces must hold vertices"),
        ({"faces": np.empty((0, 3), np.int64)}, "expected 1 face or more, got 0"),
        ({"is_target": np.array([False, False])}, "opaque faces must be those of all"),
        ({"is_target": np.array([True]), "all_faces": np.array([[0, 1, 7]])}, "must hold vertices"),
    ],
)
def test_what_is_no_surface_is_refused(changed, error):
    vertices, faces = TRIANGLE
    named = {
        "vertices": vertices, "faces": faces, "all_vertices": vertices, "all_faces": faces,
        "is_target": np.empty(0, bool),
    } | changed  # fmt: skip
    vertices, faces, *of_all, is_target = named.values()
    with pytest.raises(ValueError, match=error):
        solver_surface.Surface((vertices, faces), tuple(of_all), is_target, 1.0, print, 9)


@pytest.mark.parametrize(
    "result",
    [
        (np.zeros(2, bool), np.zeros(2, np.int64), np.empty(0, np.int32)),
        (np.zeros(1, bool), np.array([0, 5]), np.empty(0, np.int32)),
        (np.zeros(1, bool), np.array([0, 1]), np.array([7], np.int32)),
    ],
)
def test_contacts_that_are_not_of_the_surface_are_refused(result):
    surface = solver_surface.Surface(
        TRIANGLE, TRIANGLE, np.empty(0, bool), 1.0, lambda far: result, 9
    )
    with pytest.raises(ValueError, match=r"(contacts|partners) must"):
        solver_parts.contacts(surface, 1.0)


def test_an_error_of_the_contacts_is_passed_on_and_the_next_query_asks_again():
    answers = iter([ZeroDivisionError("nothing"), 1.0])

    def find(far):
        if isinstance(answer := next(answers), Exception):
            raise answer
        return np.ones(1, bool), np.zeros(2, np.int64), np.empty(0, np.int32)

    surface = solver_surface.Surface(TRIANGLE, TRIANGLE, np.empty(0, bool), 1.0, find, 9)
    with pytest.raises(ZeroDivisionError, match="nothing"):
        solver_parts.contacts(surface, 1.0)
    assert solver_parts.contacts(surface, 1.0)[0].all()


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
    assert surface_of(mesh).contacts(10**distance * diagonal)[0].all()


# --- kept as long as the mesh ---------------------------------------------------------------------


def test_the_surface_of_a_mesh_is_worked_out_once_and_dropped_with_it():
    mesh = box((0, 0, 0), (1, 2, 3))
    surface = surface_of(mesh)
    assert surface_of(mesh) is surface
    assert surface_of(box((0, 0, 0), (1, 2, 3))) is not surface
    kept = weakref.ref(surface)
    del mesh, surface
    gc.collect()
    assert kept() is None
