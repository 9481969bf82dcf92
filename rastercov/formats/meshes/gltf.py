"""Scenes of glTF 2: binary files (.glb), and JSON (.gltf) with buffers beside it or in data URIs.

Only the shape is read: the nodes of the default scene, their transforms and instances, and the
triangles of their meshes with their morph weights and skins, without animation. No other file is
ever opened for a GLB; for JSON a buffer is, if its name leads to a file in the folder of the .gltf
or below it. Images are never opened. Compressed data is an error rather than zeros, and any other
content that is not read is a note.

Source: Khronos Group. glTF 2.0 Specification. 2021.
"""

import base64
import binascii
import re
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from rastercov.base import BoolArray, ByName, FloatArray, IntArray, matmul, norm, plural, shown
from rastercov.core.mesh.arrays import matrices_of, rotations_of_quaternions
from rastercov.formats.meshes.gltf_file import (
    INSTANCING,
    Accessors,
    chunks,
    json_count,
    json_header,
    json_list,
    json_name,
    json_numbers,
    json_object,
    objects,
    unknown_names,
    unread_data,
)
from rastercov.formats.meshes.polygons import (
    Polygons,
    broken,
    check,
    check_affine,
    check_indices,
    names_in_tree,
    strip_triangles,
)
from rastercov.formats.meshes.skins import (
    BYTES_PER_INFLUENCE,
    BYTES_PER_POINT,
    Influences,
    place_skin,
)

TRIANGLES, STRIP, FAN = 4, 5, 6
CAD_FACES = "TM_brep_faces"
"""Extension that numbers the CAD face of each triangle."""
HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
)
"""Beginnings of extensions without influence on the shape."""
READ = ("KHR_mesh_quantization", CAD_FACES, INSTANCING)
"""Extensions that are read here."""
OPTIONAL = (
    "EXT_lights_",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "EXT_meshopt_compression",
    "KHR_audio",
    "KHR_draco_mesh_compression",
    "KHR_meshopt_compression",
    "KHR_xmp",
)
"""Harmless unless required: their data is also there uncompressed, or its absence is an error."""
MOST_CAD_FACES = 1 << 20
QUATERNION_TOLERANCE = 1e-3
"""Difference of the length of a quaternion from 1 that is rounding."""
DATA_URI = re.compile(r"data:[\w.+-]+/[\w.+-]+(?:;[^,;]*)*;base64,")
PADDING = 3
"""Bytes that a buffer may hold beyond its length without a note: padding to 4 bytes."""
BYTES_PER_DELTA = 100  # a point, while a morph target is added
BYTES_PER_INSTANCE = 500  # an instance, while its matrix is computed


def read_glb(data: bytes, budget: int) -> Polygons:
    """Triangles of a GLB file in metres, one group per node, in the order of the scene's tree."""
    header, buffers, notes = content_of_glb(data)
    return scene_polygons(header, buffers, budget, notes)


def content_of_glb(data: bytes) -> tuple[ByName, list[memoryview], list[str]]:
    """JSON and buffers of a GLB file, and notes on them."""
    header, binary, notes = chunks(data)
    buffers = []
    for buffer in json_list(header, "buffers")[:1]:
        if "uri" not in buffer:
            promised = json_count(buffer, "byteLength")
            notes += _length_notes(0, promised, len(binary), "the binary chunk")
            buffers.append(binary)
    return header, buffers, notes


def read_gltf(data: bytes, budget: int, bytes_beside: Callable[[str], bytes]) -> Polygons:
    """Triangles of a .gltf file in metres, one group per node, in the order of the scene's tree.

    Parameters
    ----------
    data : bytes
        The JSON.
    budget : int
        Bytes that reading may need.
    bytes_beside : callable
        Bytes of the file of that relative name; MeshError where it is outside the folder.
    """
    header, buffers, notes = content_of_gltf(data, bytes_beside)
    return scene_polygons(header, buffers, budget, notes)


def content_of_gltf(
    data: bytes, bytes_beside: Callable[[str], bytes]
) -> tuple[ByName, list[memoryview], list[str]]:
    """JSON and buffers of a .gltf file, and notes on them."""
    header = json_header(data, "JSON")
    buffers: list[memoryview] = []
    notes: list[str] = []
    for index, buffer in enumerate(json_list(header, "buffers")):
        if "uri" not in buffer and buffer.get("extensions"):  # of compressed data, which is there
            buffers.append(memoryview(b""))
            continue
        content, name = _content(index, buffer, bytes_beside)
        promised = json_count(buffer, "byteLength")
        check(
            promised <= len(content),
            f"buffer {index}: expected {promised} bytes, as declared, got {len(content)} in "
            f"{name}; truncated",
        )
        notes += _length_notes(index, promised, len(content), name)
        buffers.append(memoryview(content)[:promised])
    return header, buffers, notes


def _length_notes(index: int, promised: int, n_bytes: int, name: str) -> list[str]:
    """A note where a buffer has another length than promised, beyond padding."""
    if 0 <= n_bytes - promised <= PADDING:
        return []
    return [f"buffer {index} declares {promised} bytes; {name} has {n_bytes}"]


def _content(index: int, buffer: ByName, bytes_beside: Callable[[str], bytes]) -> tuple[bytes, str]:
    """Bytes of a buffer, and the name of their place for errors."""
    uri = buffer.get("uri")
    if not isinstance(uri, str):
        raise broken(f"buffer {index}: expected a file name or a data URI, got {uri!r:.60}")
    if not uri.startswith("data:"):
        return bytes_beside(unquote(uri)), unquote(uri)[:80]
    head = DATA_URI.match(uri)
    try:
        if head is None:
            raise ValueError("no base64 is declared")
        text = uri[head.end() :]
        return base64.b64decode(unquote(text) if "%" in text else text, validate=True), "its URI"
    except (ValueError, binascii.Error) as error:
        text = f"buffer {index}: expected a data URI in base64, got {uri[:40]!r} ({error})"
        raise broken(text) from None


def scene_polygons(
    header: ByName,
    buffers: Sequence[memoryview],
    budget: int,
    notes: Sequence[str],
    *,
    by_cad_face: bool = False,
) -> Polygons:
    """Triangles of a scene by its JSON and its buffers, in metres, one group per node.

    With `by_cad_face` the groups are the CAD faces of each node, where the file numbers them, named
    "node/face 1" and so on.
    """
    needed = [str(e) for e in json_list(header, "extensionsRequired")]
    foreign = [e[:80] for e in needed if not (e in READ or e.startswith(HARMLESS))]
    check(not foreign, f"expected supported extensions, got {foreign[:5]}", "export without them")
    notes = [*notes, *unknown_names(header)]
    rows = nodes_below(header, roots_of_scene(header))
    shapes = _Shapes(Accessors(header, buffers, budget), rows)
    vertices, faces, labels = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], [np.empty(0, int)]
    names: list[str] = []
    used, _, paths = name_meshes(header, rows, is_tree=by_cad_face)
    n_vertices = 0
    for each in used:
        node, _, world_from_node, _ = rows[each]
        points, triangles, cad_faces = shapes.of(node, world_from_node)
        if "skin" in node:
            world_from_node = np.eye(4)
        world_from_instance = matmul(
            world_from_node, shapes.instances(node, len(points), len(triangles))
        )
        n = len(world_from_instance)
        if not n:
            continue
        moved = matmul(points, world_from_instance[:, :3, :3].transpose(0, 2, 1))
        moved += world_from_instance[:, None, :3, 3]
        vertices.append(moved.reshape(-1, 3))
        is_mirrored = np.linalg.det(world_from_instance[:, :3, :3]) < 0
        turned = np.where(is_mirrored[:, None, None], triangles[:, [0, 2, 1]], triangles)
        first = n_vertices + len(points) * np.arange(n)
        faces.append((first[:, None, None] + turned).reshape(-1, 3))
        n_vertices += n * len(points)
        row, own = np.zeros(len(triangles), np.int64), [paths[each]]
        if by_cad_face and cad_faces.min() >= 0:
            known, row = np.unique(cad_faces, return_inverse=True)
            own = [f"{paths[each]}/face {face + 1}" for face in known.tolist()]
        labels.append(np.tile(len(names) + row, n))
        names += own
    notes += _notes(header, len(used))
    notes += unread_data(header) + shapes.notes()
    label = np.concatenate(labels)
    return Polygons(
        np.concatenate(vertices), np.concatenate(faces), np.arange(len(label)), label, names, notes
    )


Node = tuple[ByName, str, FloatArray, int]
"""A node, its name or that above, world_from_node, and the row of the parent, -1 for none."""


def name_meshes(
    header: ByName, rows: Sequence[Node], *, is_tree: bool = False
) -> tuple[list[int], list[str], list[str]]:
    """Rows of the nodes with a mesh, their own names, and by row those by their place in the tree.

    A node without a name has that of its mesh, or a number.
    """
    names = [json_name(node) for node, *_ in rows]
    used = [row for row, (node, *_) in enumerate(rows) if "mesh" in node]
    for number, row in enumerate(used):
        of_mesh = json_name(json_object(header, "meshes", rows[row][0]["mesh"]))
        names[row] = names[row] or of_mesh or f"node{number}"
    paths = names_in_tree([each[-1] for each in rows], names, used, is_tree=is_tree)
    return used, [names[row] for row in used], paths


def roots_of_scene(header: ByName) -> list[Any]:
    """Indices of the nodes that a file shows, with those below them."""
    if json_list(header, "scenes"):
        return json_list(json_object(header, "scenes", header.get("scene", 0)), "nodes")
    return root_nodes(header)


def root_nodes(header: ByName) -> list[int]:
    """Indices of the nodes that are no children of others."""
    below = {c for node in json_list(header, "nodes") for c in json_list(node, "children")}
    return [i for i in range(len(json_list(header, "nodes"))) if i not in below]


def nodes_below(header: ByName, roots: Sequence[Any], world: str = "") -> list[Node]:
    """Nodes of some trees, depth first.

    The frame of a node with `world` among its `extras` is the world.
    """
    nodes: list[Node] = []
    seen = set()
    stack = [(root, "", np.eye(4), -1) for root in reversed(roots)]
    while stack:
        index, name, world_from_parent, parent = stack.pop()
        node = json_object(header, "nodes", index)
        # A cycle, or a subtree repeated until memory is exhausted.
        check(
            index not in seen, f"expected nodes that form a tree, got two parents of node {index}"
        )
        seen.add(index)
        name = json_name(node) or name
        extras = node.get("extras")
        is_world = isinstance(extras, dict) and extras.get(world) is True
        matrix = (
            np.eye(4) if is_world else matmul(world_from_parent, _parent_from_node(index, node))
        )
        children = reversed(json_list(node, "children"))
        stack.extend((child, name, matrix, len(nodes)) for child in children)
        nodes.append((node, name or f"node {index}", matrix, parent))
    return nodes


def _parent_from_node(index: int, node: ByName) -> FloatArray:
    placed: FloatArray = np.eye(4)
    if not node.keys().isdisjoint(("translation", "rotation", "scale")):
        rotation = json_numbers(node, "rotation", (0, 0, 0, 1))[None]
        check_rotations(rotation, f"node {index}")
        (placed,) = affine(
            json_numbers(node, "translation", (0, 0, 0))[None],
            rotation,
            json_numbers(node, "scale", (1, 1, 1))[None],
        )
    if "matrix" not in node:
        return placed
    matrix: FloatArray = json_numbers(node, "matrix", (0,) * 16).reshape(4, 4).T
    check_affine(matrix, f"node {index}")
    check(
        np.array_equal(placed, np.eye(4)) or np.allclose(placed, matrix),
        f"expected one transform of node {index}, got a matrix and another translation, "
        "rotation or scale",
    )
    return matrix


def affine(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """(N, 4, 4) matrices: scale, then rotation by a quaternion x y z w, then translation.

    Quaternions were checked, see `check_rotations`; the rest is rounding.
    """
    length = norm(rotation)
    turns = rotations_of_quaternions(rotation / length[:, None])
    return matrices_of(turns * scale[:, None, :], translation)


def check_rotations(rotation: FloatArray, where: str, step: float = 0.0) -> None:
    """Error for quaternions (N, 4) that have not the length 1, of components `step` apart."""
    length = norm(rotation)
    is_unit = np.abs(length - 1) <= max(QUATERNION_TOLERANCE, step)
    worst = is_unit.argmin() if len(is_unit) else 0
    check(
        is_unit.all(),
        f"expected a rotation of {where} to be a quaternion of length 1, got "
        f"{rotation[worst : worst + 1].tolist()}",
    )


def _notes(header: ByName, n_nodes: int) -> list[str]:
    """Notes on content of the file that was not read, beside that many nodes with meshes."""
    known = (*READ, *HARMLESS, *OPTIONAL)
    owners = (each for _, kind, each in objects(header) if kind == "extensions")
    foreign = {n[:80] for names in owners for n in names if not n.startswith(known)}
    notes = []
    if foreign:
        notes.append(f"ignored extensions {sorted(foreign)[:5]}, which may change the shape")
    if animations := json_list(header, "animations"):
        notes.append(f"ignored {len(animations)} animations: the nodes are at rest")
    used = [node["mesh"] for node in json_list(header, "nodes") if "mesh" in node]
    if outside := len(used) - n_nodes:
        notes.append(f"ignored {outside} nodes with meshes outside the default scene")
    n_unused = len(json_list(header, "meshes")) - len(set(used))
    if n_unused > 0:
        notes.append(f"ignored {plural(n_unused, 'mesh', 'belong')} to no node")
    return notes


def _triangles(corners: IntArray, mode: int) -> IntArray:
    """(F, 3) triangles of a primitive; odd ones of a strip are reversed, which unifies winding."""
    n = len(corners)
    if mode == TRIANGLES:
        check(n % 3 == 0, f"expected triangles of 3 corners each, got {n} corners")
        return corners.reshape(-1, 3)
    check(n not in (1, 2), f"expected a strip of 3 corners or more, got {n}")
    rows = strip_triangles(n, is_fan=mode == FAN)
    # The first corner of a fan is the last of each triangle.
    return corners[np.roll(rows, -1, axis=1) if mode == FAN else rows]


_Shape = tuple[FloatArray, IntArray, IntArray]
"""Points and triangles of a mesh, and the CAD face of each triangle, -1 where none is given."""
_Surfaces = tuple[list[ByName], tuple[float, ...], set[int]]
"""Primitives of a mesh with triangles, its weights, and the numbers of their morph targets."""


class _Skin(NamedTuple):
    """A skin: its number, the matrix of each joint, (J, 4, 4), and that of the node, (4, 4)."""

    number: object
    world_from_mesh: FloatArray
    world_from_node: FloatArray


def _weights(owner: ByName) -> tuple[float, ...]:
    """Weights of the morph targets of a mesh or node."""
    n_weights = len(json_list(owner, "weights"))
    return tuple(json_numbers(owner, "weights", (0.0,) * n_weights).tolist())


class _Shapes:
    """Shapes of meshes, each read once for all nodes with the same morph weights but no skin.

    `rows` are the nodes of the scene.
    """

    def __init__(self, accessors: Accessors, rows: Sequence[Node]) -> None:
        self._accessors, self._rows = accessors, rows
        self._meshes: dict[int, _Surfaces] = {}
        self._known: dict[tuple[int, tuple[float, ...] | None], _Shape] = {}
        self._n_skipped = self._n_empty = self._n_unbound = 0
        self._of_skins: dict[str, None] = {}
        self._skins: dict[int, FloatArray] = {}

    def of(self, node: ByName, world_from_node: FloatArray) -> _Shape:
        """Shape of a node's mesh, in the coordinates of the node; of a skin in the world."""
        index = node["mesh"]
        if index not in self._meshes:
            self._meshes[index] = self._surfaces(index)
        surfaces, weights, n_targets = self._meshes[index]
        own = _weights(node) if "weights" in node else None
        weights = weights if own is None else own
        check(
            not (weights and n_targets) or n_targets == {len(weights)},
            f"mesh {index}: expected a weight for each of {max(n_targets, default=0)} morph "
            f"targets, got {len(weights)}",
        )
        if "skin" in node:
            return self._read(
                index,
                surfaces,
                weights,
                _Skin(node["skin"], self._skin(node["skin"]), world_from_node),
            )
        if (index, own) not in self._known:
            self._known[index, own] = self._read(index, surfaces, weights)
        return self._known[index, own]

    @cached_property
    def _world_from_nodes(self) -> dict[int, FloatArray]:
        """By the id of a node; joints may lie outside the scene that is shown."""
        header = self._accessors.header
        every = (*nodes_below(header, root_nodes(header)), *self._rows)
        return {id(node): matrix for node, _, matrix, _ in every}

    def _skin(self, index: int) -> FloatArray:
        """(J, 4, 4) world_from_mesh of the joints of a skin, found once."""
        skin = json_object(self._accessors.header, "skins", index)
        if index in self._skins:
            return self._skins[index]
        joints = [
            json_object(self._accessors.header, "nodes", each) for each in json_list(skin, "joints")
        ]
        check(joints, f"skin {index}: expected joints, got none")
        n = len(joints)
        self._accessors.reserve(0, 0, n * BYTES_PER_INSTANCE)
        matrices = np.array([self._world_from_nodes[id(each)] for each in joints])
        if "inverseBindMatrices" in skin:
            columns = self._accessors.read(skin["inverseBindMatrices"], "MAT4").astype(np.float64)
            check(
                len(columns) >= n,
                f"skin {index}: expected a bind matrix for each of {n} joints, got {len(columns)}",
            )
            joint_from_mesh = columns[:n].reshape(n, 4, 4).transpose(0, 2, 1)
            for each in joint_from_mesh:
                check_affine(each, f"skin {index}")
            matrices = matmul(matrices, joint_from_mesh)
        self._skins[index] = matrices
        return matrices

    def _pose_shape(
        self, skin: "_Skin", attributes: ByName, points: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Points of a primitive where its joints place them, and those that are mirrored."""
        n, where = len(points), f"skin {skin.number}"
        sets = sum(name.startswith("JOINTS_") for name in attributes)
        matrices, by = skin.world_from_mesh, Influences(*(np.empty(0, int),) * 2, np.empty(0))
        self._accessors.reserve(0, 0, n * (BYTES_PER_POINT + 4 * sets * BYTES_PER_INFLUENCE))
        if not sets:  # it is no part of the skin
            self._n_unbound += 1
            matrices = skin.world_from_node[None]
            by = Influences(np.arange(n), np.zeros(n, int), np.ones(n))
        for number in range(sets):
            joints, weights = (
                self._accessors.read(attributes[f"{name}_{number}"], "VEC4")
                for name in ("JOINTS", "WEIGHTS")
            )
            check(
                joints.dtype.kind == "u" and len(joints) == len(weights) == n,
                f"{where}: expected whole joints, and weights, of {n} vertices each, got others",
            )
            own = np.repeat(np.arange(n), 4), joints.ravel(), weights.ravel()
            by = Influences(*map(np.append, by, own))
        moved, is_mirrored, note = place_skin(where, points, matrices, by)
        if note:
            self._of_skins[note] = None
        return moved, is_mirrored

    def instances(self, node: ByName, n_points: int, n_triangles: int) -> FloatArray:
        """(N, 4, 4) node_from_instance, counted; the identity for a node without instances.

        Nothing is computed of instances without triangles: N is 0.
        """
        extension = node.get("extensions", {}).get(INSTANCING)
        if not n_triangles:
            return np.empty((0, 4, 4))
        check("skin" not in node or extension is None, "expected a skin or instances, got both")
        if extension is None:
            self._accessors.reserve(n_triangles, n_points)
            return np.eye(4)[None]
        entries = [extension["attributes"].get(key) for key in ("TRANSLATION", "ROTATION", "SCALE")]
        counts = sorted({self._accessors.count(index) for index in entries if index is not None})
        check(
            len(counts) == 1,
            "expected TRANSLATION, ROTATION or SCALE of instances of one length, got lengths "
            f"{counts}",
        )
        n = counts[0]
        self._accessors.reserve(n * n_triangles, n * n_points, n * BYTES_PER_INSTANCE)
        rest = (("VEC3", (0, 0, 0)), ("VEC4", (0, 0, 0, 1)), ("VEC3", (1, 1, 1)))
        translation, rotation, scale = (
            np.tile(np.array(one, float), (n, 1))
            if index is None
            else self._accessors.read(index, kind).astype(np.float64)
            for index, (kind, one) in zip(entries, rest, strict=True)
        )
        if entries[1] is not None:
            check_rotations(rotation, "an instance", self._accessors.step(entries[1]))
        return affine(translation, rotation, scale)

    def notes(self) -> list[str]:
        """Notes on skipped content of the nodes and meshes that were read."""
        notes = []
        if self._n_skipped:
            notes.append(f"ignored {plural(self._n_skipped, 'primitive')} of points or lines")
        if self._n_empty:
            notes.append(f"ignored {plural(self._n_empty, 'primitive')} without triangles")
        if self._n_unbound:
            notes.append(
                f"placed {plural(self._n_unbound, 'primitive')} without joints by skinned nodes"
            )
        return notes + list(self._of_skins)

    def _surfaces(self, index: int) -> _Surfaces:
        """Primitives of a mesh with triangles, checked once; the others are counted for a note."""
        mesh = json_object(self._accessors.header, "meshes", index)
        surfaces: list[ByName] = []
        n_targets: set[int] = set()
        check(json_list(mesh, "primitives"), f"mesh {index}: expected primitives, got none")
        for primitive in json_list(mesh, "primitives"):
            mode = primitive.get("mode", TRIANGLES)
            is_mode = type(mode) is int and 0 <= mode <= FAN
            check(is_mode, f"mesh {index}: expected a mode from 0 to 6, got {shown(mode)}")
            if mode < TRIANGLES:
                self._n_skipped += 1
                continue
            position = primitive.get("attributes", {}).get("POSITION")
            check(
                position is not None,
                f"mesh {index}: expected a primitive with POSITION, got one without",
            )
            n_targets.add(len(json_list(primitive, "targets")))
            if self._accessors.count(primitive.get("indices", position)):
                surfaces.append(primitive)
            else:
                self._n_empty += 1
        return surfaces, _weights(mesh), n_targets

    def _read(
        self,
        index: int,
        surfaces: list[ByName],
        weights: tuple[float, ...],
        skin: "_Skin | None" = None,
    ) -> _Shape:
        """Shape of a mesh with these weights. Its primitives may share their vertices."""
        points, triangles = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        cad_faces, mirrored = [np.empty(0, np.int64)], [np.empty(0, bool)]
        first_of: dict[tuple[Any, ...], int] = {}
        n_points = n_triangles = 0
        active = [(target, weight) for target, weight in enumerate(weights) if weight]
        for primitive in surfaces:
            attributes = {
                name: each
                for name, each in primitive["attributes"].items()
                if name == "POSITION" or (skin and name.startswith(("JOINTS_", "WEIGHTS_")))
            }
            mode, position = primitive.get("mode", TRIANGLES), attributes["POSITION"]
            targets = json_list(primitive, "targets")
            deltas = [
                (weight, targets[target]["POSITION"])
                for target, weight in active
                if "POSITION" in targets[target]
            ]
            key = (*sorted(attributes.items()), *deltas)
            n_new = self._accessors.count(position)
            n_corners = self._accessors.count(primitive.get("indices", position))
            n_triangles += n_corners // 3 if mode == TRIANGLES else max(n_corners - 2, 0)
            self._accessors.check(n_triangles, n_points + (key not in first_of) * n_new)
            if key not in first_of:
                first_of[key] = n_points
                n_points += n_new
                own = self._points(position, deltas)
                is_mirrored = np.zeros(n_new, bool)
                if skin is not None:
                    own, is_mirrored = self._pose_shape(skin, attributes, own)
                points.append(own)
                mirrored.append(is_mirrored)
            corners = np.arange(n_new)
            if "indices" in primitive:
                corners = self._corners(index, primitive["indices"], n_new)
            triangles.append(first_of[key] + _triangles(corners, mode))
            cad_faces.append(self._cad_faces(index, primitive, len(triangles[-1])))
        corners = np.concatenate(triangles)
        if skin is not None:
            faces_inwards = np.concatenate(mirrored)[corners].sum(axis=1) > 1
            corners[faces_inwards] = corners[faces_inwards][:, [0, 2, 1]]
        return np.concatenate(points), corners, np.concatenate(cad_faces)

    def _cad_faces(self, index: int, primitive: ByName, n_triangles: int) -> IntArray:
        """(n_triangles,) CAD face of each triangle of a primitive, -1 where none is given."""
        extension = primitive.get("extensions", {}).get(CAD_FACES)
        if extension is None:
            return np.full(n_triangles, -1)
        values = self._accessors.read(extension["faceIndices"], "SCALAR")[:, 0]
        # A number beyond the triangles would ask for as many names of groups.
        check(
            len(values) == n_triangles and values.max(initial=0) < MOST_CAD_FACES,
            f"mesh {index}: expected CAD faces below {MOST_CAD_FACES} for {n_triangles} triangles, "
            f"got {len(values)} up to {values.max(initial=0)}",
        )
        return values.astype(np.int64)

    def _points(self, position: object, deltas: list[tuple[float, Any]]) -> FloatArray:
        points = self._accessors.read(position, "VEC3").astype(np.float64)
        n = len(points)
        for weight, target in deltas:
            n_moved = self._accessors.count(target)
            check(
                n_moved == n,
                f"accessor {target}: expected {n} points, as the mesh has, got {n_moved}",
            )
            # Targets may share their bytes, so a short file could demand unlimited work.
            self._accessors.reserve(0, 0, BYTES_PER_INSTANCE + n * BYTES_PER_DELTA)
            points += weight * self._accessors.read(target, "VEC3")
        return points

    def _corners(self, index: int, indices: object, n_points: int) -> IntArray:
        values = self._accessors.read(indices, "SCALAR")[:, 0]
        # The largest value of a type is the primitive restart index, which glTF forbids.
        limit = min(n_points, int(np.iinfo(values.dtype).max))
        check_indices(values, limit, f"mesh {index}")
        return values.astype(np.int64)
