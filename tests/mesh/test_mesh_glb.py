"""GLB: all that glTF 2.0 lets move, repeat, replace or hide a face is read right, refused or noted.

The files of the first tests of this format are in test_mesh_file.py; here stands the class.
"""

import json
import struct

import numpy as np
import pytest

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh import Mesh

#    3---2      a tetrahedron over the triangle 0 1 2; its faces are wound outwards
#    |\ /|
#    0---1
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
TYPES = {"<f4": 5126, "<u2": 5123, "<u1": 5121, "<i1": 5120, "<i2": 5122, "<u4": 5125}


class Builder:
    """A GLB file in the making: accessors of arrays, then the JSON around them."""

    def __init__(self) -> None:
        self.binary = b""
        self.header: dict = {
            "asset": {"version": "2.0"}, "bufferViews": [], "accessors": [],
            "meshes": [], "nodes": [{"mesh": 0, "name": "part"}], "scenes": [{"nodes": [0]}],
        }  # fmt: skip
        self.mesh(POINTS, FACES)

    def view(self, values: np.ndarray) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.header["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": values.nbytes}
        )
        self.binary += values.tobytes()
        return len(self.header["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, dtype: str = "<f4", **more: object) -> int:
        values = np.asarray(values).astype(dtype)
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        self.header["accessors"].append(
            {
                "bufferView": self.view(values),
                "componentType": TYPES[dtype],
                "count": len(values),
                "type": kind,
                **more,
            }
        )
        return len(self.header["accessors"]) - 1

    def mesh(self, points: np.ndarray, faces: np.ndarray, **primitive: object) -> dict:
        self.header["meshes"].append(
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": self.accessor(points)},
                        "indices": self.accessor(np.ravel(faces), "<u2"),
                        **primitive,
                    }
                ]
            }
        )
        return self.header["meshes"][-1]

    @property
    def node(self) -> dict:
        return self.header["nodes"][0]

    @property
    def primitive(self) -> dict:
        return self.header["meshes"][0]["primitives"][0]

    def data(self) -> bytes:
        self.header.setdefault("buffers", [{"byteLength": len(self.binary)}])
        text = json.dumps(self.header).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.fixture
def glb():
    return Builder()


@pytest.fixture
def load(tmp_path):
    def write_and_load(glb: Builder | bytes, **options):
        path = tmp_path / "a.glb"
        path.write_bytes(glb if isinstance(glb, bytes) else glb.data())
        return Mesh.load(path, **options)

    return write_and_load


def triangles(mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


def rotation(quaternion) -> np.ndarray:
    """The matrix of a quaternion x y z w, by turning the axes: q v q*."""
    x, y, z, w = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    u = np.array([x, y, z])
    return np.stack(
        [v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v)) for v in np.eye(3)], axis=1
    )


def test_the_builder_makes_files_without_a_note(glb, load):
    mesh = load(glb)
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert mesh.warnings == ()


# ---- morph targets


DELTAS = np.random.default_rng(5).normal(size=(3, 4, 3)).astype(np.float32).astype(float)


def add_targets(glb: Builder) -> None:
    glb.primitive["targets"] = [{"POSITION": glb.accessor(d)} for d in DELTAS]


@pytest.mark.parametrize("owner", ["mesh", "node", "both"])
def test_morph_weights_move_the_points(owner, glb, load):
    add_targets(glb)
    weights = [0.5, 0.0, -2.0]
    if owner != "node":
        glb.header["meshes"][0]["weights"] = weights if owner == "mesh" else [1.0, 1.0, 1.0]
    if owner != "mesh":
        glb.node["weights"] = weights
    expected = POINTS + np.einsum("i,ijk->jk", weights, DELTAS)
    np.testing.assert_allclose(triangles(load(glb)), expected[FACES], rtol=0, atol=1e-12)


def test_nodes_of_one_mesh_have_weights_of_their_own(glb, load):
    add_targets(glb)
    glb.header["nodes"] = [{"mesh": 0, "weights": [0, i, 0]} for i in range(3)]
    glb.header["scenes"] = [{"nodes": [0, 1, 2]}]
    mesh = load(glb)
    for i in range(3):
        expected = (POINTS + i * DELTAS[1])[FACES]
        np.testing.assert_allclose(triangles(mesh)[4 * i : 4 * i + 4], expected, atol=1e-12)


def test_targets_without_weights_or_positions_leave_the_base_shape(glb, load):
    add_targets(glb)
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])
    glb.primitive["targets"] = [{"NORMAL": 0}]
    glb.node["weights"] = [1.0]
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])


@pytest.mark.parametrize("weights", [[1.0], [1, 2, 3, 4], [1, 2, "3"], [1, 2, 1e999], "123", [[1]]])
def test_weights_that_do_not_fit_are_refused(weights, glb, load):
    add_targets(glb)
    glb.node["weights"] = weights
    with pytest.raises(MeshError):
        load(glb)


def test_target_of_another_length_is_refused(glb, load):
    glb.primitive["targets"] = [{"POSITION": glb.accessor(DELTAS[0][:3])}]
    glb.node["weights"] = [1.0]
    with pytest.raises(MeshError, match="moves 3 points, the mesh has 4"):
        load(glb)


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


@pytest.mark.parametrize(
    ("indices", "count", "kind"),
    [([3, 1], 2, 5123), ([1, 1], 2, 5123), ([1, 4], 2, 5123), ([1, 3], 0, 5123), ([1, 3], 5, 5123),
     ([1, 3], 2, 5126), ([1, 3], 2.0, 5123), ([1, 3], 9999, 5123)],
)  # fmt: skip
def test_broken_sparse_accessors_are_refused(indices, count, kind, glb, load):
    glb.header["accessors"][0]["sparse"] = {
        "count": count,
        "indices": {"bufferView": glb.view(np.array(indices, "<u2")), "componentType": kind},
        "values": {"bufferView": glb.view(np.zeros((2, 3), "<f4"))},
    }
    with pytest.raises(MeshError):
        load(glb)


# ---- transforms


@pytest.mark.parametrize("length", [1, 0.995, 1.009])
def test_quaternions_near_length_one_rotate_without_scaling(length, glb, load):
    quaternion = np.array([0.1, -0.7, 0.3, 0.5])
    quaternion /= np.linalg.norm(quaternion)
    glb.node["rotation"] = (length * quaternion).tolist()
    expected = (POINTS @ rotation(quaternion).T)[FACES]
    np.testing.assert_allclose(triangles(load(glb)), expected, atol=1e-12)


@pytest.mark.parametrize("length", [0, 0.5, 0.98, 1.02, 2, 1e200])
def test_quaternions_of_another_length_are_refused(length, glb, load):
    glb.node["rotation"] = [0, 0, 0.6 * length, 0.8 * length]
    with pytest.raises(MeshError, match="must be a quaternion of length 1"):
        load(glb)


@pytest.mark.parametrize(
    ("key", "value"),
    [("rotation", [0, 0, 0]), ("rotation", [0, 0, 0, "1"]), ("rotation", [0, 0, 0, None]),
     ("rotation", [[0, 0, 0, 1]]), ("scale", [1, 1]), ("scale", 2), ("scale", ["1", "1", "1"]),
     ("translation", [0, 0, True]), ("translation", {"x": 1}), ("matrix", [1] * 15),
     ("matrix", [[1, 0, 0, 0]] * 4)],
)  # fmt: skip
def test_transforms_that_are_no_numbers_are_refused(key, value, glb, load):
    glb.node[key] = value
    with pytest.raises(MeshError, match=f"'{key}' must be"):
        load(glb)


@pytest.mark.parametrize("text", [b"NaN", b"Infinity", b"-Infinity"])
def test_json_without_numbers_is_refused(text, glb, load):
    glb.node["translation"] = [0, 0, 123456789]
    with pytest.raises(MeshError, match="no readable JSON chunk"):
        load(glb.data().replace(b"123456789", text.rjust(9)))


def test_a_matrix_beside_another_transform_is_refused(glb, load):
    matrix = np.diag([2, 2, 2, 1.0])
    glb.node.update(matrix=matrix.ravel().tolist(), scale=[3, 3, 3])
    with pytest.raises(MeshError, match="node 0 has a matrix and, beside it, another"):
        load(glb)
    glb.node.update(scale=[2, 2, 2], translation=[0, 0, 0], rotation=[0, 0, 0, 1])
    np.testing.assert_array_equal(triangles(load(glb)), 2 * POINTS[FACES])
    glb.node.update(scale=[1, 1, 1])
    np.testing.assert_array_equal(triangles(load(glb)), 2 * POINTS[FACES])


def test_a_projective_matrix_is_refused(glb, load):
    matrix = np.eye(4)
    matrix[3, 0] = 0.5
    glb.node["matrix"] = matrix.T.ravel().tolist()
    with pytest.raises(MeshError, match=r"last row is 0 0 0 1 wanted, got \[0.5, 0.0, 0.0, 1.0\]"):
        load(glb)


def test_transforms_of_parents_apply_in_turn(glb, load):
    turn = rotation([0.5, 0.5, 0.5, 0.5])
    glb.header["nodes"] = [
        {"children": [1], "translation": [1, 2, 3], "rotation": [0.5, 0.5, 0.5, 0.5]},
        {"mesh": 0, "scale": [1, 2, 3]},
    ]
    expected = (POINTS * [1, 2, 3]) @ turn.T + [1, 2, 3]
    np.testing.assert_allclose(triangles(load(glb)), expected[FACES], atol=1e-12)


# ---- instances


def instanced(glb: Builder, n: int = 3, **more: object) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(2)
    move = rng.normal(size=(n, 3)).astype(np.float32)
    turn = rng.normal(size=(n, 4))
    turn = (turn / np.linalg.norm(turn, axis=1)[:, None]).astype(np.float32)
    size = np.array([[1, 2, 3], [-1, 1, 1], [0.5, 0.5, 0.5]])[np.arange(n) % 3]
    glb.node["extensions"] = {
        "EXT_mesh_gpu_instancing": {
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
    glb.header["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    if is_required:
        glb.header["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
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
        "EXT_mesh_gpu_instancing": {
            "attributes": {"ROTATION": glb.accessor(packed, "<i1", normalized=True)}
        }
    }
    expected = (POINTS @ rotation([0, 0, 1, 1]).T)[FACES]
    np.testing.assert_allclose(triangles(load(glb)), np.tile(expected, (2, 1, 1)), atol=1e-12)


def test_instances_of_unequal_number_are_refused(glb, load):
    instanced(glb, TRANSLATION=glb.accessor(np.zeros((2, 3))))
    with pytest.raises(MeshError, match=r"of one length, got lengths \[2, 3\]"):
        load(glb)
    glb.node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {}
    with pytest.raises(MeshError, match=r"of one length, got lengths \[\]"):
        load(glb)


# ---- what is missing or left out


@pytest.mark.parametrize(
    ("owner", "key", "text"),
    [
        (("accessors", 0), "count", "'count' must be a whole number from 0, got None"),
        (("accessors", 1), "count", "'count' must be a whole number from 0, got None"),
        (("meshes", 0), "primitives", "mesh 0 has no primitives"),
        (("meshes", 0, "primitives", 0), "attributes", "a primitive without POSITION"),
        (("meshes", 0, "primitives", 0, "attributes"), "POSITION", "a primitive without POSITION"),
        (("accessors", 0), "bufferView", "accessor 0 is sparse or compressed"),
        (("accessors", 0), "componentType", "contradicts its format"),
        (("accessors", 0), "type", "accessor 0 must be VEC3, got None"),
        (("bufferViews", 0), "byteLength", "view holds 0 bytes"),
        (("buffers", 0), "byteLength", "'byteLength' must be a whole number from 0, got None"),
    ],
)
def test_missing_properties_are_refused_and_no_part_vanishes(owner, key, text, glb, load):
    glb.data()
    glb.mesh(POINTS, FACES)
    glb.header["nodes"].append({"mesh": 1})
    glb.header["scenes"] = [{"nodes": [0, 1]}]
    place = glb.header
    for step in owner:
        place = place[step]
    del place[key]
    with pytest.raises(MeshError, match=text):
        load(glb)


def test_nodes_and_meshes_outside_the_scene_are_noted(glb, load):
    glb.header["nodes"] += [{"mesh": 0}, {"children": [3]}, {"mesh": 0}]
    glb.mesh(POINTS, FACES)
    mesh = load(glb)
    assert mesh.n_faces == 4
    assert "a.glb: 2 nodes with meshes are outside the default scene, not read" in mesh.warnings[0]
    assert "a.glb: 1 meshes belong to no node, not read" in mesh.warnings[1]


def test_a_loop_of_nodes_that_no_root_reaches_is_noted(glb, load):
    del glb.header["scenes"]
    glb.header["nodes"] += [{"mesh": 0, "children": [2]}, {"children": [1]}]
    assert "1 nodes with meshes are outside" in load(glb).notes[0]


@pytest.mark.parametrize(("change", "is_noted"), [(0, False), (-3, False), (-4, True), (8, True)])
def test_a_buffer_that_disagrees_with_its_chunk_is_noted(change, is_noted, glb, load):
    glb.binary += b"\0" * (-len(glb.binary) % 4)
    glb.header["buffers"] = [{"byteLength": len(glb.binary) + change}]
    mesh = load(glb)
    np.testing.assert_array_equal(triangles(mesh), POINTS[FACES])
    assert any("buffer 0 promises" in note for note in mesh.notes) == is_noted


def test_extensions_that_may_change_the_shape_are_noted(glb, load):
    glb.node["extensions"] = {"KHR_node_visibility": {"visible": False}, "KHR_lights_punctual": {}}
    glb.primitive["extensions"] = {"VENDOR_bend": {}, "KHR_materials_variants": {}}
    (note,) = load(glb).notes
    assert "extensions ['KHR_node_visibility', 'VENDOR_bend'] were not read; they may" in note


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "X"])
def test_required_extensions_that_are_not_known_are_refused(name, glb, load):
    glb.header["extensionsRequired"] = [name]
    with pytest.raises(MeshError, match="are required, not supported"):
        load(glb)


def test_animations_and_skins_are_noted(glb, load):
    glb.header["animations"] = [{"channels": [], "samplers": []}]
    glb.node["skin"] = 0
    notes = load(glb).notes
    assert "node 'part' has a skin; it is read unposed" in notes[0]
    assert "1 animations were not played" in notes[1]


@pytest.mark.parametrize(
    "asset", [{"version": "1.0"}, {"version": "3.0"}, {"version": "2.0", "minVersion": "2.1"}]
)
def test_other_versions_are_refused(asset, glb, load):
    glb.header["asset"] = asset
    with pytest.raises(MeshError, match=r"glTF 2.0 wanted"):
        load(glb)


# ---- primitives and accessors


@pytest.mark.parametrize("mode", [7, -1, 4.0, "4", True, None, [4]])
def test_modes_that_are_none_are_refused(mode, glb, load):
    glb.primitive["mode"] = mode
    with pytest.raises(MeshError, match="a mode from 0 to 6 wanted"):
        load(glb)


@pytest.mark.parametrize("mode", [5, 6])
@pytest.mark.parametrize("n", [1, 2])
def test_strips_of_less_than_a_triangle_are_refused(mode, n, glb, load):
    glb.primitive.update(mode=mode, indices=glb.accessor(np.arange(n), "<u2"))
    with pytest.raises(MeshError, match=f"a strip needs 3 corners or more, got {n}"):
        load(glb)


def test_primitives_without_corners_are_noted(glb, load):
    empty = glb.accessor(np.empty(0), "<u2")
    glb.header["meshes"][0]["primitives"].append({**glb.primitive, "indices": empty})
    mesh = load(glb)
    assert mesh.n_faces == 4
    assert "1 primitives have no triangles" in mesh.notes[0]


def test_normalised_indices_are_refused(glb, load):
    """They were scaled to 0 or 1, and every face lay at the first vertices."""
    glb.header["accessors"][1]["normalized"] = True
    with pytest.raises(MeshError, match="accessor 1: 'normalized' is for coordinates"):
        load(glb)


@pytest.mark.parametrize("value", ["false", 1, None])
def test_normalized_must_be_true_or_false(value, glb, load):
    glb.header["accessors"][0]["normalized"] = value
    with pytest.raises(MeshError, match="'normalized' is for coordinates"):
        load(glb)


@pytest.mark.parametrize("dtype", ["<i1", "<u1", "<i2", "<u2"])
@pytest.mark.parametrize("is_normalised", [False, True])
def test_positions_in_whole_numbers_are_read(dtype, is_normalised, glb, load):
    largest = np.iinfo(np.dtype(dtype)).max
    packed = POINTS * largest
    glb.header["bufferViews"].append({"buffer": 0, "byteOffset": 0, "byteLength": 0})
    index = glb.accessor(packed, dtype, normalized=is_normalised)
    glb.primitive["attributes"]["POSITION"] = index
    expected = POINTS if is_normalised else packed
    np.testing.assert_array_equal(triangles(load(glb)), expected[FACES])


def test_positions_of_32_bits_are_refused(glb, load):
    glb.primitive["attributes"]["POSITION"] = glb.accessor(POINTS, "<u4")
    with pytest.raises(MeshError, match="must be VEC3, got 'VEC3' of 5125"):
        load(glb)


def test_the_restart_index_is_refused_though_a_vertex_has_it(glb, load):
    glb.header["meshes"] = []
    glb.mesh(np.random.default_rng(0).normal(size=(256, 3)), [[0, 1, 2]])
    glb.primitive["indices"] = glb.accessor([0, 1, 255], "<u1")
    with pytest.raises(MeshError, match=r"must lie in 0 ... 254, got 255"):
        load(glb)


def test_interleaved_and_offset_attributes_are_read(glb, load):
    rows = np.random.default_rng(1).normal(size=(5, 7)).astype("<f4")
    rows[1:, 2:5] = POINTS
    view = glb.view(rows)
    glb.header["bufferViews"][view]["byteStride"] = 28
    glb.header["accessors"][0].update(bufferView=view, byteOffset=28 + 8)
    np.testing.assert_array_equal(triangles(load(glb)), POINTS[FACES])


# ---- a short file does not become a long job


@pytest.mark.slow
def test_instances_do_not_multiply_a_short_file_unasked(load, glb):
    n = 1000
    glb.header["meshes"] = []
    glb.mesh(np.random.default_rng(0).normal(size=(600, 3)), np.arange(600).reshape(-1, 3))
    n = (1 << 20) // 200 + 1
    glb.node["extensions"] = {
        "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": glb.accessor(np.zeros((n, 3)))}}
    }
    with pytest.raises(ResourceError, match=r"triangles.* need about \d+ bytes, the budget is"):
        load(glb)
    assert load(glb, memory_budget=1 << 30).n_faces == 200 * n


@pytest.mark.parametrize("what", ["nodes", "primitives", "targets", "points"])
def test_shared_data_is_counted_before_it_is_read(what, glb, load):
    n = 4000
    glb.header["meshes"] = []
    mesh = glb.mesh(np.random.default_rng(0).normal(size=(3000, 3)), np.arange(3000))
    if what == "nodes":
        glb.header["nodes"] = [{"mesh": 0}] * n
        glb.header["scenes"] = [{"nodes": list(range(n))}]
    elif what == "primitives":
        mesh["primitives"] *= n
    elif what == "targets":
        mesh["primitives"][0]["targets"] = [{"POSITION": 2}] * n
        glb.node["weights"] = [1.0] * n
    else:
        few = glb.accessor([0, 1, 2], "<u2")
        for _ in range(n):
            glb.header["accessors"].append(dict(glb.header["accessors"][2]))
            mesh["primitives"].append(
                {"attributes": {"POSITION": len(glb.header["accessors"]) - 1}, "indices": few}
            )
    with pytest.raises(ResourceError, match="need about"):
        load(glb)


def test_meshes_without_triangles_cost_nothing_a_node(glb, load):
    """Nodes times primitives would be 10^8 steps: minutes."""
    n = 10_000
    glb.header["meshes"].append({"primitives": [{**glb.primitive, "mode": 0}] * n})
    glb.header["nodes"] += [{"mesh": 1}] * n
    glb.header["scenes"] = [{"nodes": list(range(n + 1))}]
    mesh = load(glb)
    assert mesh.n_faces == 4
    assert "10000 primitives of points or lines were not read" in mesh.notes[0]
