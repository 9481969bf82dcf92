"""The mesh value: what it refuses, what it finds wrong, and that it never changes."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined

from rastercov.base.errors import MeshError
from rastercov.base.format import size_in_words
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.mesh.topology import first_equal_row

#      7-----6
#     /|    /|      z
#    4-----5 |      | y
#    | 3---|-2      |/
#    |/    |/       +--x
#    0-----1
CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)
CUBE_FACES = np.array(
    [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
     [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]
)  # fmt: skip


def cube(scale: float = 1, offset: float = 0, flip: bool = False) -> Mesh:
    return Mesh(CUBE * scale + offset, CUBE_FACES[:, ::-1] if flip else CUBE_FACES)


# ---- the value


def test_mesh_does_not_alias_its_input():
    vertices, faces, labels = CUBE.copy(), CUBE_FACES.copy(), np.zeros(12, np.int32)
    mesh = Mesh(vertices, faces, [Group("a")], labels)
    vertices[:], faces[:], labels[:] = 9, 0, 5
    np.testing.assert_array_equal(mesh.vertices, CUBE)
    np.testing.assert_array_equal(mesh.faces, CUBE_FACES)
    assert not mesh.face_group.any()


@pytest.mark.parametrize(
    "name",
    [
        "vertices", "faces", "face_group", "source_face", "normals", "areas", "centroids", "bounds",
        "task_mask", "two_sided_mask", "degenerate_mask", "duplicate_mask",
    ],
)  # fmt: skip
def test_every_array_is_read_only(name):
    mesh = Mesh(CUBE, CUBE_FACES)
    with pytest.raises(ValueError, match="read-only"):
        getattr(mesh, name)[0] = 0
    with pytest.raises(AttributeError):
        setattr(mesh, name, 0)


def test_pickle_gives_the_same_frozen_mesh():
    mesh = Mesh(CUBE, CUBE_FACES, [Group("a"), Group("b", is_occluder=True)], [0, 1] * 6)
    again = pickle.loads(pickle.dumps(mesh))
    assert again.groups == mesh.groups
    np.testing.assert_array_equal(again.faces, mesh.faces)
    np.testing.assert_array_equal(again.task_mask, mesh.task_mask)
    assert not again.vertices.flags.writeable


# ---- what is refused


GROUPS = [Group("a"), Group("b")]
ARRAYS = [
    *((CUBE, faces, "at least one row, got none") for faces in (np.zeros((0, 3), int), [])),
    (CUBE, np.zeros((12, 4), int), r"expected faces of shape \(F, 3\), got \(12, 4\)"),
    (CUBE, [0, 1, 2], r"expected faces of shape \(F, 3\), got \(3,\)"),
    (CUBE, [[0, 1, 2], [0, 1]], "rows of unequal length"),
    (CUBE, [[0.0, 1.0, 2.0]], "faces to be integers, got dtype float64"),
    (CUBE, [[0, 1, 2], [0, 1, 8]], r"expected face indices in 0 \.\.\. 7, got \[0, 1, 8\] in f"),
    *((CUBE, faces, "in face 0") for faces in ([[0, 1, -1]], np.array([[0, 2**64 - 1, 1]], "u8"))),
    (np.zeros((0, 3)), [[0, 1, 2]], "in face 0"),
    (CUBE[:, :2], CUBE_FACES, r"vertices of shape \(V, 3\), got \(8, 2\)"),
    *((CUBE.astype(kind), CUBE_FACES, r"vertices to be real numbers, got (dtype|text)")
      for kind in (str, complex)),
    *((np.where(CUBE[7] == CUBE, bad, CUBE), CUBE_FACES, r"faces \[.*\], \d+ in all; repair")
      for bad in (np.nan, -np.inf, 1.1e30)),
]  # fmt: skip
LABELS = [
    {"groups": []},
    {"groups": [GROUPS[0]] * 2, "face_group": [0] * 12},
    {"groups": GROUPS},
    *({"groups": GROUPS[:1], "face_group": labels} for labels in ([1] * 12, [0] * 11, [0.5] * 12)),
    {"source_face": [1, 2]},
]
MOVES = [
    {"groups": ["lid"]},
    *({"scale": scale} for scale in (0, "big", 1e40)),
    *({"axis": axis} for axis in ((0, 0, 0), (1, 2))),
    {"angle_deg": np.inf},
    *({"translation": move} for move in ("far", (np.nan, 0, 0))),
]


def test_arrays_that_are_no_mesh_are_refused():
    for vertices, faces, text in ARRAYS:
        with pytest.raises(MeshError, match=text):
            Mesh(vertices, faces)


def test_labels_and_moves_that_do_not_fit_are_refused_by_their_name():
    calls = [(lambda each=each: Mesh(CUBE, CUBE_FACES, **each), each) for each in LABELS]
    calls += [(lambda each=each: cube().moved(**each), each) for each in MOVES]
    for call, names in calls:
        with pytest.raises(MeshError, match=rf"^[^\n]*({'|'.join(names)}|group|1e)[^\n]*$"):
            call()


@pytest.mark.parametrize("scale", [1e30, 1e-200])
def test_the_largest_and_the_least_coordinates_keep_everything_finite(scale):
    mesh = cube(scale)
    assert np.isfinite(mesh.areas).all()
    assert not mesh.degenerate_mask.any()
    np.testing.assert_array_equal(mesh.normals, cube().normals)
    assert mesh.can_cull_back_faces == (scale > 1)


# ---- groups


@pytest.fixture
def grouped() -> Mesh:
    names = [Group("part"), Group("jig"), Group("sheet")]
    return Mesh(CUBE, CUBE_FACES, names, np.repeat([0, 1, 2], 4))


def test_occluders_are_not_the_task_and_all_can_be_two_sided(grouped):
    assert grouped.task_mask.all()
    assert not grouped.two_sided_mask.any()
    other = grouped.with_groups(occluders=["jig"], two_sided=["sheet"])
    np.testing.assert_array_equal(other.task_mask, np.repeat([True, False, True], 4))
    np.testing.assert_array_equal(other.two_sided_mask, np.repeat([False, False, True], 4))
    assert grouped.task_mask.all(), "the first mesh is unchanged"
    assert other.faces is grouped.faces
    assert grouped.with_groups(two_sided="all").two_sided_mask.all()


def test_one_string_is_one_name_and_an_unknown_one_lists_the_known_ones(grouped):
    assert not grouped.with_groups(occluders="jig").task_mask.all()
    for flag in ("occluders", "two_sided", "targets"):
        with pytest.raises(MeshError, match=r"expected a mesh file or a group, got"):
            grouped.with_groups(**{flag: ["jib", "part"]})


# ---- geometry


@pytest.mark.parametrize("offset", [0, 1e7])
def test_cube_has_unit_normals_outwards_and_area_six(offset):
    mesh = cube(offset=offset)
    np.testing.assert_array_equal(np.linalg.norm(mesh.normals, axis=1), 1)
    outwards = mesh.centroids - (0.5 + offset)
    assert (np.einsum("ij,ij->i", outwards, mesh.normals) > 0.4).all()
    assert mesh.areas.sum() == 6
    np.testing.assert_array_equal(mesh.bounds, [[offset] * 3, [1 + offset] * 3])


def test_blocks_do_not_show(monkeypatch):
    whole, parts = shapes.torus(20, 10), shapes.torus(20, 10)
    expected = whole.normals, whole.areas, whole.centroids, whole.can_cull_back_faces
    monkeypatch.setattr("rastercov.core.mesh.arrays.BLOCK", 7)
    np.testing.assert_array_equal(parts.normals, expected[0])
    np.testing.assert_array_equal(parts.areas, expected[1])
    np.testing.assert_array_equal(parts.centroids, expected[2])
    assert parts.can_cull_back_faces == expected[3]


def test_bounds_ignore_vertices_that_no_face_uses():
    mesh = Mesh([*CUBE, [99, 99, 99]], CUBE_FACES)
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 1]])


#   0--1--2 on a line, 3 above
@pytest.mark.parametrize("scale", [1e-12, 1, 1e12])
def test_faces_without_area_are_kept_and_marked(scale):
    points = np.array([[0, 0, 0], [0.1, 0.2, 0.3], [0.3, 0.6, 0.9], [0, 1, 0], [0, 0, 0]]) * scale
    mesh = Mesh(points, [[0, 1, 2], [0, 0, 3], [0, 1, 3], [0, 4, 3], [2, 2, 2]])
    np.testing.assert_array_equal(mesh.degenerate_mask, [True, True, False, True, True])
    assert not mesh.normals[mesh.degenerate_mask].any()
    assert not mesh.areas[mesh.degenerate_mask].any()
    assert any("4 degenerate faces" in line for line in mesh.warnings)

    thin = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0]], [[0, 1, 2]])
    assert not thin.degenerate_mask.any()
    assert thin.areas[0] == pytest.approx(5e-10, rel=1e-12)


# ---- topology


SOUP = CUBE[CUBE_FACES].reshape(-1, 3)
SOUP[SOUP == 0] = np.where(np.arange((SOUP == 0).sum()) % 2, 0.0, -0.0)
FLIPPED = np.where(np.arange(12)[:, None] == 5, CUBE_FACES[:, ::-1], CUBE_FACES)
SHEETS = [[0, 1, 2], [0, 2, 1]]
FAULTS = {
    "none": (cube(), True, True, []),
    "vertices of their own": (Mesh(SOUP, np.arange(36).reshape(-1, 3)), True, True, []),
    "three": (joined(cube(10), cube(1, 100), cube(0.1, -50)), True, True, []),
    "one of three": (  # which the large ones must not outvote
        joined(cube(10), cube(1, 100), cube(0.1, -50, flip=True)), True, True,
        ["inside out: 1 of 3"],
    ),
    "far": (cube(2**-10, 1e7), True, True, []),
    "open": (
        Mesh(CUBE, CUBE_FACES[2:]),
        False,
        True,
        ["open surface: 4 edges with a face on one side only"],
    ),
    "flipped": (Mesh(CUBE, FLIPPED), True, False, ["winding at 3 of 18 shared edges (16.7%)"]),
    "inside out": (cube(1e-3, 1e7, flip=True), True, True, ["inside out: 1 of 1"]),
    "two sheets": (Mesh(CUBE, SHEETS), True, True, ["inside out: 1 of 1", "1 duplicate"]),
    "cavity": (joined(cube(10), cube(1, 3, flip=True)), True, True, ["inside out: 1 of 2"]),
    "an edge of four faces": (
        joined(cube(), Mesh(CUBE + np.array([1, 1, 0]), CUBE_FACES)), False, True,
        ["1 edge has more than two faces"],
    ),
    "only a flap": (Mesh(CUBE, [[0, 0, 1]]), False, True, ["1 degenerate"]),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_and_ends_culling(name):
    mesh, is_closed, is_consistent, lines = FAULTS[name]
    assert (mesh.is_closed, mesh.is_consistently_wound) == (is_closed, is_consistent)
    assert mesh.can_cull_back_faces == (not lines)
    assert len(mesh.warnings) == len(lines)
    assert all(text in line for text, line in zip(lines, mesh.warnings, strict=True))


def test_flaps_without_area_do_not_spoil_a_closed_mesh():
    flaps = [[0, 0, 1], [2, 2, 2]]
    assert Mesh(CUBE, [*CUBE_FACES, *flaps]).can_cull_back_faces
    assert Mesh(CUBE, [*flaps, *CUBE_FACES]).can_cull_back_faces


#   3-----2      edge 0-1 is split at 4 on one side only; the face 0 1 4 without area
#   |   / |      fills the T-junction, and the mesh stays closed
#   0--4--1
def test_flat_face_in_a_t_junction_keeps_the_mesh_closed():
    points = [*CUBE, [0.5, 0, 0]]
    bottom = [[0, 2, 8], [8, 2, 1], [0, 3, 2]]
    mesh = Mesh(points, [*bottom, *CUBE_FACES[2:], [0, 8, 1]])
    assert mesh.degenerate_mask.sum() == 1
    assert mesh.is_closed
    assert mesh.is_consistently_wound
    assert not mesh.can_cull_back_faces  # its long edge lies on two others: that is a contact


def test_later_copies_of_a_face_are_duplicates_in_any_order_of_corners():
    points = [*CUBE, *CUBE]
    mesh = Mesh(points, [[0, 1, 2], [9, 10, 8], [2, 1, 0], [0, 1, 3], [0, 1, 2]])
    np.testing.assert_array_equal(mesh.duplicate_mask, [False, True, True, False, True])
    assert "3 duplicate faces: the lowest face index is used" in mesh.warnings


@pytest.mark.parametrize(("scale", "warns"), [(1e-9, True), (1e-6, False), (1, False), (2e4, True)])
def test_unlikely_sizes_ask_for_the_unit(scale, warns):
    lines = Mesh(CUBE * scale, CUBE_FACES).warnings
    assert any("check its unit" in line for line in lines) == warns


def test_notes_come_first_in_the_warnings():
    mesh = Mesh(CUBE, CUBE_FACES[:11], notes=["the file was odd"])
    assert mesh.warnings[0] == "the file was odd"
    assert len(mesh.warnings) == 2


@settings(deadline=None, max_examples=40)
@given(st.data())
def test_topology_agrees_with_a_count_by_hand(data):
    n = data.draw(st.integers(3, 7))
    index = st.integers(0, n - 1)
    faces = data.draw(st.lists(st.tuples(index, index, index), min_size=1, max_size=14))
    points = np.random.default_rng(0).random((n, 3))
    topology = Mesh(points, faces).topology
    edges: dict[frozenset[int], list[tuple[int, int]]] = {}
    part = list(range(len(faces)))
    owner: dict[frozenset[int], int] = {}
    for i, face in enumerate(faces):
        if len(set(face)) == 3:
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                edge = frozenset((a, b))
                edges.setdefault(edge, []).append((a, b))
                old, new = part[i], part[owner.setdefault(edge, i)]
                part = [min(old, new) if p in (old, new) else p for p in part]
    uses = [len(u) for u in edges.values()]
    assert topology.n_boundary_edges == uses.count(1)
    assert topology.n_shared_edges == uses.count(2)
    assert topology.n_nonmanifold_edges == len(uses) - uses.count(1) - uses.count(2)
    assert topology.n_inconsistent_edges == sum(
        len(u) == 2 and u[0] == u[1] for u in edges.values()
    )
    order = {p: k for k, p in enumerate(sorted(set(part)))}
    np.testing.assert_array_equal(topology.components(), [order[p] for p in part])


@pytest.mark.parametrize("collide", [False, True])
def test_first_equal_row_survives_colliding_hashes(collide):
    rows = np.random.default_rng(1).integers(0, 3, (200, 3)).astype(np.uint64)
    if collide:  # the second number undoes what the first has done to the digest
        first = rows[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        rows[:, 1] = first ^ first >> np.uint64(29)
        rows[:, 2] = 0
    expected = [next(j for j, r in enumerate(rows) if (r == row).all()) for row in rows]
    np.testing.assert_array_equal(first_equal_row(rows), expected)


def test_a_long_strip_of_faces_is_one_component():
    """Hooking must not need a round for each face of a chain."""
    n = 20_000
    points = np.stack([np.arange(n + 2), np.arange(n + 2) % 2, np.zeros(n + 2)], axis=1)
    faces = np.arange(n)[:, None] + np.arange(3)
    shuffled = np.random.default_rng(2).permutation(faces)
    for strip in (faces, faces[::-1], shuffled):
        assert not Mesh(points, strip).topology.components().any()


# ---- placing and sizing


def test_some_groups_move_and_the_others_stay():
    """Both groups share an edge, whose vertices are doubled."""
    mesh = Mesh(CUBE, CUBE_FACES, [Group("one"), Group("two")], [0] * 6 + [1] * 6)
    moved = mesh.moved(axis=(1, 2, 3), angle_deg=37, translation=(0, 0, 9), groups=["two"])
    turned = mesh.moved(axis=(1, 2, 3), angle_deg=37, translation=(0, 0, 9))
    corners = np.where(
        mesh.face_group[:, None, None] == 1, *(each.vertices[each.faces] for each in (turned, mesh))
    )
    np.testing.assert_array_equal(moved.vertices[moved.faces], corners)
    np.testing.assert_allclose(turned.areas, mesh.areas)
    assert moved.groups == mesh.groups
    np.testing.assert_array_equal(mesh.moved(scale=2, groups=[]).vertices, mesh.vertices)


def test_a_size_is_in_one_unit_with_few_digits():
    for extent, words in (
        ((85_000, 62_000, 20_000), "85,000 x 62,000 x 20,000 m"),
        ((1.5, 0.25, 0), "1.5 x 0.25 x 0 m"),
        ((0.0853, 0.0621, 0.02), "85.3 x 62.1 x 20 mm"),
        ((5e-5, 1e-5, 0), "50 x 10 x 0 µm"),
    ):
        assert size_in_words(extent) == words
