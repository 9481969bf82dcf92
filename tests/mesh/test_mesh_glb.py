"""GLB: all that lets glTF move, repeat, replace or hide a face is read right, refused or noted."""

import re
import struct

import numpy as np
import pytest
from mesh_files import FACES, POINTS, Glb, glb_bytes, refusal, triangles

from rastercov.base.errors import MeshError, ResourceError

INSTANCING = "EXT_mesh_gpu_instancing"


@pytest.fixture
def glb():
    return Glb()


@pytest.fixture
def load(load):
    def load_glb(glb, **options):
        return load("a.glb", glb if isinstance(glb, bytes) else glb.data(), **options)

    return load_glb


def rotation(quaternion) -> np.ndarray:
    """The matrix of a quaternion x y z w, by turning the axes: q v q*."""
    x, y, z, w = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    u = np.array([x, y, z])
    return np.stack(
        [v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v)) for v in np.eye(3)], axis=1
    )


# ---- morph targets


DELTAS = np.random.default_rng(5).normal(size=(3, 4, 3)).astype(np.float32).astype(float)


def add_targets(glb):
    glb.primitive["targets"] = [{"POSITION": glb.accessor(d)} for d in DELTAS]


@pytest.mark.parametrize("owner", ["mesh", "node", "both"])
def test_morph_weights_move_the_points_of_each_node(owner, glb, load):
    add_targets(glb)
    rows = np.array([[0.5, 0, -2], [0, 1, 0]])
    if owner != "node":
        rows[1:] = rows[0] if owner == "mesh" else rows[1]
        glb.header["meshes"][0]["weights"] = rows[1].tolist()
    own = [{} if owner == "mesh" else {"weights": row} for row in rows.tolist()]
    glb.nodes(*({"mesh": 0, **weights} for weights in own))
    moved = POINTS + np.einsum("ni,ijk->njk", rows, DELTAS)
    expected = moved[:, FACES].reshape(-1, 3, 3)
    np.testing.assert_allclose(triangles(load(glb)), expected, rtol=0, atol=1e-12)


def test_targets_without_weights_or_positions_leave_the_base_shape(glb, load):
    add_targets(glb)
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])
    glb.primitive["targets"] = [{"NORMAL": 0}]
    glb.node["weights"] = [1.0]
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])


def test_sparse_targets_and_positions_are_read(glb, load):
    sparse = {
        "count": 2,
        "indices": {"bufferView": glb.view(np.array([1, 3], "<u2")), "componentType": 5123},
        "values": {"bufferView": glb.view(DELTAS[0][[1, 3]].astype("<f4"))},
    }
    accessor = {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse}
    glb.header["accessors"].append(accessor)
    glb.primitive["targets"] = [{"POSITION": len(glb.header["accessors"]) - 1}]
    glb.node["weights"] = [2.0]
    moved = POINTS.copy()
    moved[[1, 3]] += 2 * DELTAS[0][[1, 3]]
    np.testing.assert_allclose(triangles(load(glb)), moved[FACES], atol=1e-12)
    del glb.primitive["targets"], glb.node["weights"]
    glb.header["accessors"][0]["sparse"] = sparse
    replaced = POINTS.copy()
    replaced[[1, 3]] = DELTAS[0][[1, 3]]
    np.testing.assert_allclose(triangles(load(glb)), replaced[FACES], atol=1e-12)


def sparse(glb, indices, count, kind):
    """Give the first accessor a sparse part."""
    glb.header["accessors"][0]["sparse"] = {
        "count": count,
        "indices": {"bufferView": glb.view(np.array(indices, "<u2")), "componentType": kind},
        "values": {"bufferView": glb.view(np.zeros((2, 3), "<f4"))},
    }


# ---- transforms


@pytest.mark.parametrize("length", [1, 0.9991, 1.0009])
def test_quaternions_near_length_one_rotate_without_scaling(length, glb, load):
    quaternion = np.array([0.1, -0.7, 0.3, 0.5])
    quaternion /= np.linalg.norm(quaternion)
    glb.node["rotation"] = (length * quaternion).tolist()
    expected = (POINTS @ rotation(quaternion).T)[FACES]
    np.testing.assert_allclose(triangles(load(glb)), expected, atol=1e-12)


def test_a_matrix_may_have_the_same_transform_beside_it(glb, load):
    glb.node.update(matrix=np.diag([2, 2, 2, 1.0]).ravel().tolist(), scale=[2, 2, 2])
    for scale in ([2, 2, 2], [1, 1, 1]):
        glb.node["scale"] = scale
        np.testing.assert_array_equal(triangles(load(glb)), 2 * POINTS[FACES])


def test_nodes_are_groups_with_the_transforms_of_their_parents(glb, load):
    turn = rotation([0.5, 0.5, 0.5, 0.5])
    parent = {"translation": [10, 0, 0], "rotation": [0.5, 0.5, 0.5, 0.5], "scale": [2, 2, 2]}
    glb.nodes(
        {"children": [2, 1], **parent},
        {"mesh": 0, "name": "part", "matrix": np.diag([1, 2, 3, 1.0]).ravel().tolist()},
        {"mesh": 0, "name": "part", "translation": [1, 0, 0]},
        {"mesh": 0, "name": "not in the scene"},
    )
    mesh = load(glb.put(["scenes"], [{"nodes": [0]}]))
    assert [group.name for group in mesh.groups] == ["part", "part #2"]
    moved, stretched = POINTS + np.array([1, 0, 0]), POINTS * [1, 2, 3]
    for faces, points in ((slice(4), moved), (slice(4, 8), stretched)):
        expected = 2 * points @ turn.T + [10, 0, 0]
        np.testing.assert_allclose(triangles(mesh)[faces], expected[FACES], atol=1e-12)


def test_scene_is_the_default_one_and_roots_are_found_without(glb, load):
    glb.header["nodes"] = [{"mesh": 0, "name": "zero"}, {"children": [0], "name": "root"}]
    glb.header.update(scenes=[{"nodes": []}, {"nodes": [1]}], scene=1)
    assert load(glb).n_faces == 4
    del glb.header["scenes"]
    assert load(glb).n_faces == 4


# ---- instances


def instanced(glb, n=3, **more):
    rng = np.random.default_rng(2)
    move = rng.normal(size=(n, 3)).astype(np.float32)
    turn = rng.normal(size=(n, 4))
    turn = (turn / np.linalg.norm(turn, axis=1)[:, None]).astype(np.float32)
    size = np.array([[1, 2, 3], [-1, 1, 1], [0.5, 0.5, 0.5]])[np.arange(n) % 3]
    glb.node["extensions"] = {
        INSTANCING: {
            "attributes": {
                "TRANSLATION": glb.accessor(move),
                "ROTATION": glb.accessor(turn),
                "SCALE": glb.accessor(size),
                **more,
            }
        }
    }
    return move.astype(float), turn.astype(float), size


@pytest.mark.parametrize("is_required", [False, True])
def test_instances_are_all_read_each_with_its_transform(is_required, glb, load):
    move, turn, size = instanced(glb)
    glb.node["translation"] = [5, 0, 0]
    glb.header["extensionsUsed"] = [INSTANCING]
    if is_required:
        glb.header["extensionsRequired"] = [INSTANCING]
    mesh = load(glb)
    assert [group.name for group in mesh.groups] == ["part"]
    assert mesh.can_cull_back_faces, "mirrored instances face outwards, too"
    for i in range(3):
        expected = (POINTS * size[i]) @ rotation(turn[i]).T + move[i] + [5, 0, 0]
        faces = FACES[:, [0, 2, 1]] if i == 1 else FACES
        np.testing.assert_allclose(triangles(mesh)[4 * i : 4 * i + 4], expected[faces], atol=1e-6)
    assert mesh.notes == ()


def test_instances_with_one_attribute_or_packed_rotations_are_read(glb, load):
    packed = np.round(np.array([[0, 0, np.sqrt(0.5), np.sqrt(0.5)]] * 2) * 127)
    glb.node["extensions"] = {
        INSTANCING: {"attributes": {"ROTATION": glb.accessor(packed, "<i1", normalized=True)}}
    }
    expected = (POINTS @ rotation([0, 0, 1, 1]).T)[FACES]
    np.testing.assert_allclose(triangles(load(glb)), np.tile(expected, (2, 1, 1)), atol=1e-12)


# ---- what is missing or left out


PLACES = [
    (("accessors", 0, "count"), 5, "expected 5 elements of 12 bytes"),
    (("nodes", 0, "children"), [0], "two parents of node 0"),
    (("nodes", 0, "translation"), [1e300, 0, 0], "a number within"),
    *((("extensionsRequired",), [name], r"supported extensions, got \['.*'\]")
      for name in ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "X")),
    *((("asset",), asset, r"glTF 2\.0")
      for asset in ({"version": "1.0"}, {"version": "3.0"}, {"minVersion": "2.1"})),
    *((("nodes", 0, "rotation"), [0, 0, 0.6 * length, 0.8 * length], "a quaternion of length 1")
      for length in (0, 0.98, 1.02, 1e90)),
]  # fmt: skip


def test_a_header_that_is_wrong_in_one_place_is_refused(load):
    """`test_mesh_damage` has values of wrong types in all places."""
    for keys, value, text in PLACES:
        message = refusal(lambda _, data: load(data), "a.glb", Glb().put(keys, value))
        assert re.search(f"a.glb: .*{text}", message), (keys, value, message)


def instances(**attributes):
    """Change that gives the node instances with these attributes."""

    def change(glb):
        own = {name: glb.accessor(value) for name, value in attributes.items()}
        glb.node["extensions"] = {INSTANCING: {"attributes": own}}

    return change


def weights(values):
    return lambda glb: (add_targets(glb), glb.node.update(weights=values))


def corners(mode, n):
    return lambda g: g.primitive.update(mode=mode, indices=g.accessor(np.arange(n), "<u2"))


MATRIX = np.diag([2, 2, 2, 1.0]).ravel().tolist()
CHANGES = [
    *((weights(w), "") for w in ([1.0], [1, 2, 3, 4], [1, 2, 1e999])),
    (lambda g: (g.primitive.update(targets=[{"POSITION": g.accessor(DELTAS[0][:3])}]),
                g.node.update(weights=[1.0])), "as the mesh has, got 3"),
    *((lambda g, case=case: sparse(g, *case), "") for case in (
        ([3, 1], 2, 5123), ([1, 1], 2, 5123), ([1, 4], 2, 5123), ([1, 3], 0, 5123),
        ([1, 3], 5, 5123), ([1, 3], 2, 5126), ([1, 3], 2.0, 5123), ([1, 3], 9999, 5123))),
    (lambda g: g.node.update(matrix=MATRIX, scale=[3, 3, 3]), "one transform of node 0"),
    (lambda g: g.node.update(matrix=[1, 0, 0, 0.5, *MATRIX[4:]]), "last row is 0 0 0 1"),
    (instances(TRANSLATION=np.zeros((2, 3)), SCALE=np.ones((3, 3))), r"got lengths \[2, 3\]"),
    (instances(), r"of one length, got lengths \[\]"),
    *((corners(mode, n), f"a strip of 3 corners or more, got {n}")
      for mode in (5, 6) for n in (1, 2)),
    (lambda g: g.primitive["attributes"].update(POSITION=g.accessor(POINTS, "<u4")),
     "to be VEC3, got 'VEC3' of 5125"),
    # Of 256 vertices the last is that of the restart index, which the format forbids.
    (lambda g: g.primitive.update(indices=g.accessor([0, 1, 255], "<u1"), attributes={
        "POSITION": g.accessor(np.zeros((256, 3)))}), r"in 0 ... 254, got 0 ... 255"),
]  # fmt: skip


def test_a_scene_with_one_wrong_part_is_refused(load):
    for change, text in CHANGES:
        glb = Glb()
        change(glb)
        message = refusal(lambda _, data: load(data), "a.glb", glb.data())
        assert re.search(f"a.glb: .*{text}", message), (text, message)


CHUNK = b"glTF" + struct.pack("<I", 2)


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (glb_bytes({})[:4] + b"\1" + glb_bytes({})[5:], "version 2, got 1"),
        (b"glTG" + glb_bytes({})[4:], "expected a GLB file, which begins with glTF, got"),
        *(
            (glb_bytes({"a": bad}), "expected a readable JSON chunk, got")
            for bad in (np.nan, np.inf, -np.inf)
        ),
        (CHUNK + struct.pack("<III", 24, 4, 0x4E4F534A) + b"{[}]", "expected a (readable )?JSON"),
        (
            CHUNK + struct.pack("<III", 24, 4, 0x4E4F534A) + b"null",
            "expected the JSON chunk to be an object, got NoneType",
        ),
        (
            CHUNK + struct.pack("<III", 24, 99, 0x4E4F534A) + b"null",
            "expected 99 bytes of a chunk from byte offset 20 on, got 4",
        ),
        (CHUNK + struct.pack("<III", 24, 4, 0) + b"null", "expected a (readable )?JSON"),
        (CHUNK + struct.pack("<III", 200020, 200000, 0x4E4F534A) + b"[" * 200000, "JSON"),
    ],
)
def test_a_broken_chunk_is_refused(data, text, load):
    with pytest.raises(MeshError, match=text):
        load(data)


def outside(glb):
    glb.header["nodes"] += [{"mesh": 0}, {"children": [3]}, {"mesh": 0}]
    glb.mesh(POINTS, FACES)


def loop(glb):
    """Two nodes that hold each other, and that no root reaches."""
    del glb.header["scenes"]
    glb.header["nodes"] += [{"mesh": 0, "children": [2]}, {"children": [1]}]


def extensions(glb):
    glb.node["extensions"] = {"KHR_node_visibility": {"visible": False}, "KHR_lights_punctual": {}}
    glb.primitive["extensions"] = {"VENDOR_bend": {}, "KHR_materials_variants": {}}


def unused(glb):
    glb.header["animations"] = [{"channels": [], "samplers": []}]


def points_and_nothing(glb):
    empty = glb.accessor(np.empty(0), "<u2")
    more = [{**glb.primitive, "mode": 0}, {**glb.primitive, "indices": empty}]
    glb.header["meshes"][0]["primitives"] += more


NOTED = {
    outside: ["2 nodes with meshes outside the default scene", "1 mesh belongs to no node"],
    loop: ["1 nodes with meshes outside"],
    extensions: ["ignored extensions ['KHR_node_visibility', 'VENDOR_bend'], which may"],
    unused: ["ignored 1 animations"],
    points_and_nothing: ["1 primitive of points or lines", "1 primitive without triangles"],
}


@pytest.mark.parametrize("change", NOTED)
def test_what_is_not_read_is_noted(change, glb, load):
    change(glb)
    mesh = load(glb)
    assert mesh.n_faces == 4
    assert len(mesh.notes) <= len(NOTED[change]) + (change is outside)
    assert all(any(text in note for note in mesh.notes) for text in NOTED[change])


@pytest.mark.parametrize(("change", "is_noted"), [(0, False), (-3, False), (-4, True), (8, True)])
def test_a_buffer_that_disagrees_with_its_chunk_is_noted(change, is_noted, glb, load):
    glb.binary += b"\0" * (-len(glb.binary) % 4)
    glb.header["buffers"] = [{"byteLength": len(glb.binary) + change}]
    mesh = load(glb)
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert any("buffer 0 declares" in note for note in mesh.notes) == is_noted


# ---- primitives and accessors


@pytest.mark.parametrize(
    ("mode", "corners", "expected"),
    [
        (5, [0, 1, 2, 3, 0], [[0, 1, 2], [1, 3, 2], [2, 3, 0]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_strips_and_fans_are_unrolled(mode, corners, expected, load):
    mesh = load(Glb(POINTS, corners, mode=mode))
    np.testing.assert_array_equal(mesh.faces, expected)


def test_primitives_without_indices_take_vertices_in_turn(load):
    glb = Glb(POINTS[FACES].reshape(-1, 3), [])
    del glb.primitive["indices"]
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])


def test_primitives_of_a_node_share_vertices(glb, load):
    glb.header["meshes"][0]["primitives"] *= 2
    mesh = load(glb)
    assert (mesh.n_vertices, mesh.n_faces) == (4, 8)


@pytest.mark.parametrize("dtype", ["<i1", "<u1", "<i2", "<u2"])
@pytest.mark.parametrize("is_normalised", [False, True])
def test_positions_in_whole_numbers_are_read(dtype, is_normalised, glb, load):
    largest = np.iinfo(np.dtype(dtype)).max
    packed = POINTS * largest
    index = glb.accessor(packed, dtype, normalized=is_normalised)
    glb.primitive["attributes"]["POSITION"] = index
    glb.header["extensionsRequired"] = ["KHR_mesh_quantization"]
    expected = POINTS if is_normalised else packed
    np.testing.assert_array_equal(triangles(load(glb)), expected[FACES])


def test_interleaved_and_offset_attributes_are_read(glb, load):
    rows = np.random.default_rng(1).normal(size=(5, 7)).astype("<f4")
    rows[1:, 2:5] = POINTS
    view = glb.view(rows)
    glb.header["bufferViews"][view]["byteStride"] = 28
    glb.header["accessors"][0].update(bufferView=view, byteOffset=28 + 8)
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])


# ---- a short file does not become a long job


@pytest.mark.slow
def test_instances_do_not_multiply_a_short_file_unasked(load):
    glb = Glb(np.random.default_rng(0).normal(size=(600, 3)), np.arange(600))
    n = (1 << 20) // 200 + 1
    attributes = {"TRANSLATION": glb.accessor(np.zeros((n, 3)))}
    glb.node["extensions"] = {INSTANCING: {"attributes": attributes}}
    with pytest.raises(ResourceError, match=r"expected at most \d+ bytes .*, got \d+ bytes"):
        load(glb)
    assert load(glb, memory_budget=1 << 30).n_faces == 200 * n


N_SHARED = 4000


def shared_points(glb):
    """Accessors of one view, each for a primitive of one triangle."""
    few, accessors = glb.accessor([0, 1, 2], "<u2"), glb.header["accessors"]
    at = range(len(accessors), len(accessors) + N_SHARED)
    accessors.extend([accessors[0]] * N_SHARED)
    primitives = glb.header["meshes"][0]["primitives"]
    primitives.extend({"attributes": {"POSITION": index}, "indices": few} for index in at)


def shared_targets(glb):
    glb.primitive["targets"] = [{"POSITION": 0}] * N_SHARED
    glb.node["weights"] = [1.0] * N_SHARED


SHARED = [
    lambda glb: glb.nodes(*[{"mesh": 0}] * N_SHARED),
    lambda glb: glb.header["meshes"][0].update(primitives=[glb.primitive] * N_SHARED),
    shared_targets,
    shared_points,
]


@pytest.mark.slow
@pytest.mark.parametrize("change", SHARED)
def test_shared_data_is_counted_before_it_is_read(change, load):
    glb = Glb(np.random.default_rng(0).normal(size=(3000, 3)), np.arange(3000))
    change(glb)
    with pytest.raises(ResourceError, match="bytes for"):
        load(glb)
