"""GLB (binary glTF 2): from the bytes of a file to its triangles.

Serves `mesh_file`, under the rules of `mesh_formats`. Only shape is read: the nodes of the default
scene, their transforms, and the triangles of their meshes. Nothing outside the file is ever
opened, and what would have to be decompressed is an error rather than zeros.

Source: Khronos Group. glTF 2.0 Specification. 2021.
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError
from rastercov.mesh_formats import Polygons, check_budget

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
TRIANGLES, STRIP, FAN = 4, 5, 6
# Required extensions that leave the shape as it is, or that are understood here.
HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_mesh_quantization",
)


def read_glb(data: bytes, budget: int) -> Polygons:
    """Triangles of a GLB file in metres, one group a node, in the order of the scene's tree."""
    try:
        return _read(data, budget)
    except MeshError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # JSON may hold any type anywhere; to check each would be longer than this and no clearer.
        raise MeshError(f"the file contradicts its format ({error!r}); export it again") from error


def _read(data: bytes, budget: int) -> Polygons:
    header, binary, notes = _chunks(data)
    needed = [str(e) for e in _list(header, "extensionsRequired")]
    foreign = [e for e in needed if not e.startswith(HARMLESS)]
    if foreign:
        raise MeshError(f"extensions {foreign} are required, not supported; export without them")
    reader = _Reader(header, binary)
    vertices, faces, labels = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], []
    names: list[str | None] = []
    n_vertices = n_faces = n_skipped = 0
    for node, world_from_node in _nodes(header):
        mesh = _item(header, "meshes", node["mesh"])
        name = node.get("name") or mesh.get("name") or f"node{len(names)}"
        first_of: dict[int, int] = {}  # primitives may share their vertices
        is_mirrored = np.linalg.det(world_from_node[:3, :3]) < 0
        if "skin" in node:
            notes.append(f"node {str(name)[:80]!r} has a skin; it is read unposed")
        for primitive in _list(mesh, "primitives"):
            mode = primitive.get("mode", TRIANGLES)
            if mode not in (TRIANGLES, STRIP, FAN):
                n_skipped += 1
                continue
            position = primitive["attributes"]["POSITION"]
            n_points = reader.count(position)
            n_corners = reader.count(primitive["indices"]) if "indices" in primitive else n_points
            n_new = 0 if position in first_of else n_points
            check_budget(max(n_faces + n_corners // 3, (n_vertices + n_new) // 3), budget)
            if position not in first_of:
                first_of[position] = n_vertices
                points = reader.read(position, "VEC3").astype(np.float64)
                points = points @ world_from_node[:3, :3].T + world_from_node[:3, 3]
                vertices.append(points)
                n_vertices += len(points)
            corners = np.arange(n_points)
            if "indices" in primitive:
                corners = reader.read(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
            if len(corners) and corners.max() >= n_points:
                raise MeshError(
                    f"mesh {str(name)[:80]!r}: vertex indices must lie in 0 ... {n_points - 1}, "
                    f"got {corners.max()}; export it again"
                )
            triangles = first_of[position] + _triangles(corners, mode)
            faces.append(triangles[:, [0, 2, 1]] if is_mirrored else triangles)
            labels.append(np.full(len(triangles), len(names)))
            n_faces += len(triangles)
            check_budget(n_faces, budget)
        names.append(str(name))
    if n_skipped:
        notes.append(f"{n_skipped} primitives of points or lines were not read")
    label = np.concatenate(labels) if labels else np.empty(0, np.int64)
    return Polygons(
        np.concatenate(vertices), np.concatenate(faces), np.arange(n_faces), label, names, notes
    )


def _chunks(data: bytes) -> tuple[dict[str, Any], memoryview, list[str]]:
    """JSON header, binary chunk and notes."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise MeshError("a GLB file begins with 'glTF', this one does not; export a binary .glb")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise MeshError(f"glTF version 2 wanted, got {version}; export it again")
    if length > len(data):
        raise MeshError(
            f"the header promises {length} bytes, the file ends at byte offset {len(data)}; "
            "it is truncated, export it again"
        )
    extra = len(data) - length
    notes = [f"{extra} trailing bytes after the last chunk were not read"] if extra else []
    chunks: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += 8
        if at + size > length:
            raise MeshError(
                f"a chunk at byte offset {at} promises {size} bytes, {length - at} are there; "
                "it is truncated, export it again"
            )
        chunks.setdefault(kind, memoryview(data)[at : at + size])
        at += size
    try:
        header = json.loads(bytes(chunks[JSON_CHUNK]).decode())
    except (KeyError, ValueError, RecursionError) as error:
        raise MeshError(f"no readable JSON chunk ({error}); export it again") from error
    if not isinstance(header, dict):
        raise MeshError(f"the JSON chunk must be an object, got {type(header).__name__}")
    return header, chunks.get(BINARY_CHUNK, memoryview(b"")), notes


def _list(owner: dict[str, Any], key: str) -> list[Any]:
    found = owner.get(key, [])
    if not isinstance(found, list):
        raise MeshError(f"{key!r} must be a list, got {type(found).__name__}; export it again")
    return found


def _item(header: dict[str, Any], key: str, index: Any) -> dict[str, Any]:
    items = _list(header, key)
    if type(index) is not int or not 0 <= index < len(items) or type(items[index]) is not dict:
        raise MeshError(f"{key!r} has {len(items)} objects, number {index!r} was asked; correct it")
    found: dict[str, Any] = items[index]
    return found


def _whole(owner: dict[str, Any], key: str, default: int) -> int:
    value = owner.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"{key!r} must be a whole number from 0, got {value!r}; export it again")
    return value


def _nodes(header: dict[str, Any]) -> list[tuple[dict[str, Any], NDArray[np.float64]]]:
    """Nodes with a mesh, depth first, each with its `world_from_node`."""
    if _list(header, "scenes"):
        roots = _list(_item(header, "scenes", header.get("scene", 0)), "nodes")
    else:
        below = {c for node in _list(header, "nodes") for c in _list(node, "children")}
        roots = [i for i in range(len(_list(header, "nodes"))) if i not in below]
    found, seen = [], set()
    stack = [(root, np.eye(4)) for root in reversed(roots)]
    while stack:
        index, world_from_parent = stack.pop()
        node = _item(header, "nodes", index)
        if index in seen:  # a loop, or a subtree repeated until it fills the memory
            raise MeshError(f"nodes must form a tree, node {index} has two parents; correct it")
        seen.add(index)
        world_from_node = world_from_parent @ _parent_from_node(node)
        stack.extend((child, world_from_node) for child in reversed(_list(node, "children")))
        if "mesh" in node:
            found.append((node, world_from_node))
    return found


def _parent_from_node(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
    return matrix


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(F, 3) triangles of a primitive; every other one of a strip is turned to face outwards."""
    if mode == TRIANGLES:
        if len(corners) % 3:
            raise MeshError(f"triangles need 3 corners each, got {len(corners)}; export it again")
        return corners.reshape(-1, 3)
    i = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return corners[np.stack([i + 1, i + 2, 0 * i], axis=1)]
    return corners[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)]


class _Reader:
    """Accessors: typed, strided windows of the binary chunk."""

    def __init__(self, header: dict[str, Any], binary: memoryview) -> None:
        self.header, self.binary = header, binary

    def count(self, index: Any) -> int:
        """Number of elements."""
        return _whole(_item(self.header, "accessors", index), "count", 0)

    def read(self, index: Any, wanted: str) -> NDArray[Any]:
        """(N, 3) for wanted "VEC3", (N, 1) for "SCALAR"; normalised integers become floats."""
        accessor = _item(self.header, "accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshError(f"accessor {index} is sparse or compressed; export it uncompressed")
        view = _item(self.header, "bufferViews", accessor["bufferView"])
        buffer_index = view.get("buffer", 0)
        if "uri" in _item(self.header, "buffers", buffer_index) or buffer_index != 0:
            raise MeshError(
                "a buffer lies outside the file (uri), which is never opened; "
                "export a self-contained .glb"
            )
        kind = COMPONENTS.get(accessor["componentType"])
        n_columns = {"SCALAR": 1, "VEC3": 3}[wanted]
        is_index = wanted == "SCALAR"
        if accessor.get("type") != wanted or kind is None or (is_index and kind[0] != "u"):
            raise MeshError(
                f"accessor {index} must be {wanted}, got {accessor.get('type')!r} of "
                f"{accessor.get('componentType')!r}; export it again"
            )
        dtype = np.dtype("<" + kind)
        count, row = self.count(index), n_columns * dtype.itemsize
        stride = _whole(view, "byteStride", row)
        start, within = _whole(view, "byteOffset", 0), _whole(accessor, "byteOffset", 0)
        window = min(_whole(view, "byteLength", 0), len(self.binary) - start)
        if stride < row or (count and within + (count - 1) * stride + row > window):
            raise MeshError(
                f"accessor {index} promises {count} elements of {row} bytes every {stride}, its "
                f"view holds {max(window, 0)} bytes; the file is broken, export it again"
            )
        if not count:
            return np.empty((0, n_columns), dtype)
        values: NDArray[Any] = np.ndarray(
            (count, n_columns), dtype, self.binary, start + within, (stride, dtype.itemsize)
        )
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1)
        return values
