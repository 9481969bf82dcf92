"""GLB (binary glTF 2): from the bytes of a file to its triangles.

Serves `mesh_file`, under the rules of `mesh_formats`. Only shape is read: the nodes of the default
scene, their transforms and instances, and the triangles of their meshes with their morph weights,
all at rest. Nothing outside the file is ever opened; what would have to be decompressed is an error
rather than zeros, and what else is passed over is a note.

Source: Khronos Group. glTF 2.0 Specification. 2021.
"""

import json
import math
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.errors import MeshError, ResourceError
from rastercov.mesh.formats.polygons import Polygons, check_budget

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
N_COLUMNS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TRIANGLES, STRIP, FAN = 4, 5, 6
INSTANCING = "EXT_mesh_gpu_instancing"
# Extensions that leave the shape as it is, or that are understood here.
HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_mesh_quantization",
    INSTANCING,
)
# Harmless unless they are required: what they pack is there unpacked, too, or is missed below.
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
QUATERNION_TOLERANCE = 0.01  # of the length; components of 8 bits are off by up to 0.004
AFFINE_TOLERANCE = 1e-6
BYTES_PER_DELTA = 100  # of a point, while a morph target is added
BYTES_PER_INSTANCE = 500  # while its matrix is made


def read_glb(data: bytes, budget: int) -> Polygons:
    """Triangles of a GLB file in metres, one group a node, in the order of the scene's tree."""
    try:
        return _read(data, budget)
    except (MeshError, ResourceError):
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
    nodes = _nodes(header)
    reader = _Reader(header, binary, budget)
    shapes = _Shapes(reader)
    vertices, faces, labels = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], []
    names: list[str | None] = []
    n_vertices = n_faces = 0
    for node, world_from_node in nodes:
        mesh = _item(header, "meshes", node["mesh"])
        points, triangles = shapes.of(node, mesh)
        world_from_instance = world_from_node @ shapes.instances(node)
        n = len(world_from_instance) if len(triangles) else 0
        reader.reserve(n * len(triangles), n * len(points))
        if n:
            moved = points @ world_from_instance[:, :3, :3].transpose(0, 2, 1)
            moved += world_from_instance[:, None, :3, 3]
            vertices.append(moved.reshape(-1, 3))
            is_mirrored = np.linalg.det(world_from_instance[:, :3, :3]) < 0
            turned = np.where(is_mirrored[:, None, None], triangles[:, [0, 2, 1]], triangles)
            first = n_vertices + len(points) * np.arange(n)
            faces.append((first[:, None, None] + turned).reshape(-1, 3))
            labels.append(np.full(n * len(triangles), len(names)))
            n_vertices += n * len(points)
            n_faces += n * len(triangles)
        names.append(str(node.get("name") or mesh.get("name") or f"node{len(names)}"))
    notes += _notes(header, binary, [node for node, _ in nodes], names) + shapes.notes()
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
    extra = len(data) - at
    notes = [f"{extra} trailing bytes after the last chunk were not read"] if extra > 0 else []
    try:
        header = json.loads(bytes(chunks[JSON_CHUNK]).decode(), parse_constant=_no_number)
    except (KeyError, ValueError, RecursionError) as error:
        raise MeshError(f"no readable JSON chunk ({error}); export it again") from error
    if not isinstance(header, dict):
        raise MeshError(f"the JSON chunk must be an object, got {type(header).__name__}")
    asset = header.get("asset", {})
    for key in ("version", "minVersion"):
        wanted = str(asset.get(key, "2.0"))
        if wanted.partition(".")[0] != "2" or (key == "minVersion" and wanted != "2.0"):
            raise MeshError(f"glTF 2.0 wanted, got {key} {wanted[:20]!r}; export it again")
    return header, chunks.get(BINARY_CHUNK, memoryview(b"")), notes


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is not JSON")


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


def _whole(owner: dict[str, Any], key: str, default: int | None = None) -> int:
    value = owner.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"{key!r} must be a whole number from 0, got {value!r}; export it again")
    return value


def _numbers(owner: dict[str, Any], key: str, default: tuple[float, ...]) -> NDArray[np.float64]:
    """As many finite numbers as `default` has."""
    values = owner.get(key, default)
    is_list = isinstance(values, (list, tuple)) and len(values) == len(default)
    if not is_list or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
        raise ValueError(f"{key!r} must be {len(default)} finite numbers, got {str(values)[:60]}")
    return np.array(values, dtype=np.float64)


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
        world_from_node = world_from_parent @ _parent_from_node(index, node)
        stack.extend((child, world_from_node) for child in reversed(_list(node, "children")))
        if "mesh" in node:
            found.append((node, world_from_node))
    return found


def _parent_from_node(index: int, node: dict[str, Any]) -> NDArray[np.float64]:
    placed: NDArray[np.float64] = np.eye(4)
    if not node.keys().isdisjoint(("translation", "rotation", "scale")):
        (placed,) = _affine(
            _numbers(node, "translation", (0, 0, 0))[None],
            _numbers(node, "rotation", (0, 0, 0, 1))[None],
            _numbers(node, "scale", (1, 1, 1))[None],
        )
    if "matrix" not in node:
        return placed
    matrix: NDArray[np.float64] = _numbers(node, "matrix", (0,) * 16).reshape(4, 4).T
    if not np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=AFFINE_TOLERANCE):
        raise MeshError(
            f"node {index}: a matrix whose last row is 0 0 0 1 wanted, got "
            f"{matrix[3].tolist()}; export it again"
        )
    if not (np.array_equal(placed, np.eye(4)) or np.allclose(placed, matrix)):
        raise MeshError(
            f"node {index} has a matrix and, beside it, another translation, rotation or scale; "
            "keep one of them"
        )
    return matrix


def _affine(
    translation: NDArray[np.float64], rotation: NDArray[np.float64], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(N, 4, 4) matrices that scale, then rotate by a quaternion x y z w, then translate."""
    length = np.linalg.norm(rotation, axis=1)
    wrong = np.flatnonzero(~(np.abs(length - 1) <= QUATERNION_TOLERANCE))
    if len(wrong):
        raise MeshError(
            f"a rotation must be a quaternion of length 1, got {rotation[wrong[0]].tolist()} of "
            f"length {length[wrong[0]]:.3g}; export it again"
        )
    x, y, z, w = (rotation / length[:, None]).T
    matrix = np.zeros((len(rotation), 4, 4))
    matrix[:, :3, :3] = np.moveaxis(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        ),
        2,
        0,
    )
    matrix[:, :3, :3] *= scale[:, None, :]
    matrix[:, :3, 3] = translation
    matrix[:, 3, 3] = 1
    return matrix


def _notes(
    header: dict[str, Any],
    binary: memoryview,
    nodes: list[dict[str, Any]],
    names: list[str | None],
) -> list[str]:
    """Notes on what of the file was not read."""
    notes = []
    skinned = [name for node, name in zip(nodes, names, strict=True) if "skin" in node]
    if skinned:
        more = f" (and {len(skinned) - 1} others)" if len(skinned) > 1 else ""
        notes.append(f"node {str(skinned[0])[:80]!r}{more} has a skin; it is read unposed")
    if _list(header, "animations"):
        notes.append(
            f"{len(_list(header, 'animations'))} animations were not played; the nodes are at rest"
        )
    outside = sum("mesh" in node for node in _list(header, "nodes")) - len(nodes)
    if outside:
        notes.append(f"{outside} nodes with meshes are outside the default scene, not read")
    used = {node["mesh"] for node in _list(header, "nodes") if "mesh" in node}
    n_unused = len(_list(header, "meshes")) - len(used)
    if n_unused > 0:
        notes.append(f"{n_unused} meshes belong to no node, not read")
    for buffer in _list(header, "buffers")[:1]:
        promised = _whole(buffer, "byteLength")
        if "uri" not in buffer and not 0 <= len(binary) - promised <= 3:  # padding to 4 bytes
            notes.append(
                f"buffer 0 promises {promised} bytes, the binary chunk holds {len(binary)}"
            )
    return notes


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """(F, 3) triangles of a primitive; every other one of a strip is turned to face outwards."""
    if mode == TRIANGLES:
        if len(corners) % 3:
            raise MeshError(f"triangles need 3 corners each, got {len(corners)}; export it again")
        return corners.reshape(-1, 3)
    if 0 < len(corners) < 3:
        raise MeshError(f"a strip needs 3 corners or more, got {len(corners)}; export it again")
    i = np.arange(max(len(corners) - 2, 0))
    if mode == FAN:
        return corners[np.stack([i + 1, i + 2, 0 * i], axis=1)]
    return corners[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)]


class _Shape(NamedTuple):
    """Points and triangles of a mesh."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]


class _Shapes:
    """Meshes, each taken apart once for all of its nodes that have the same morph weights."""

    def __init__(self, reader: "_Reader") -> None:
        self._reader = reader
        self._known: dict[tuple[int, tuple[float, ...]], _Shape] = {}
        self._foreign: set[str] = set()
        self._n_skipped = self._n_empty = 0

    def of(self, node: dict[str, Any], mesh: dict[str, Any]) -> _Shape:
        """Shape of a node's mesh, before the node's transform."""
        self._look_for_extensions(node)
        owner = node if "weights" in node else mesh
        n_weights = len(_list(owner, "weights"))
        weights = tuple(_numbers(owner, "weights", (0.0,) * n_weights).tolist())
        key = (node["mesh"], weights)
        if key not in self._known:
            self._known[key] = self._read(node["mesh"], mesh, weights)
        return self._known[key]

    def instances(self, node: dict[str, Any]) -> NDArray[np.float64]:
        """(N, 4, 4) `node_from_instance`; the identity where the node has no instances."""
        extension = node.get("extensions", {}).get(INSTANCING)
        if extension is None:
            return np.eye(4)[None]
        found = [extension["attributes"].get(key) for key in ("TRANSLATION", "ROTATION", "SCALE")]
        counts = sorted({self._reader.count(index) for index in found if index is not None})
        if len(counts) != 1:
            raise MeshError(
                f"instances need TRANSLATION, ROTATION or SCALE of one length, got lengths "
                f"{counts}; export it again"
            )
        self._reader.reserve(0, 0, counts[0] * BYTES_PER_INSTANCE)
        rest = (("VEC3", (0, 0, 0)), ("VEC4", (0, 0, 0, 1)), ("VEC3", (1, 1, 1)))
        return _affine(
            *(
                np.tile(np.array(one, float), (counts[0], 1))
                if index is None
                else self._reader.read(index, kind).astype(np.float64)
                for index, (kind, one) in zip(found, rest, strict=True)
            )
        )

    def notes(self) -> list[str]:
        """Notes on what was passed over in the nodes and meshes that were read."""
        notes = []
        if self._n_skipped:
            notes.append(f"{self._n_skipped} primitives of points or lines were not read")
        if self._n_empty:
            notes.append(f"{self._n_empty} primitives have no triangles")
        if self._foreign:
            notes.append(
                f"extensions {sorted(self._foreign)[:5]} were not read; they may change the shape"
            )
        return notes

    def _look_for_extensions(self, owner: dict[str, Any]) -> None:
        names = (name for name in owner.get("extensions", ()))
        self._foreign |= {n[:80] for n in names if not n.startswith((*HARMLESS, *OPTIONAL))}

    def _read(self, index: int, mesh: dict[str, Any], weights: tuple[float, ...]) -> _Shape:
        """Shape of a mesh. Its primitives may share their vertices."""
        self._look_for_extensions(mesh)
        points, triangles = [np.empty((0, 3))], [np.empty((0, 3), np.int64)]
        first_of: dict[tuple[Any, ...], int] = {}
        n_points = n_triangles = 0
        for primitive in _list(mesh, "primitives"):
            self._look_for_extensions(primitive)
            mode = primitive.get("mode", TRIANGLES)
            if type(mode) is not int or not 0 <= mode <= FAN:
                raise MeshError(
                    f"mesh {index}: a mode from 0 to 6 wanted, got {mode!r}; correct it"
                )
            if mode < TRIANGLES:
                self._n_skipped += 1
                continue
            position = primitive.get("attributes", {}).get("POSITION")
            if position is None:
                raise MeshError(f"mesh {index}: a primitive without POSITION; export it again")
            deltas = self._deltas(index, primitive, weights)
            key = (position, *deltas)
            n_new = self._reader.count(position)
            n_corners = self._reader.count(primitive.get("indices", position))
            n_triangles += n_corners // 3 if mode == TRIANGLES else max(n_corners - 2, 0)
            self._n_empty += not n_corners
            self._reader.check(n_triangles, n_points + (key not in first_of) * n_new)
            if key not in first_of:
                first_of[key] = n_points
                n_points += n_new
                points.append(self._points(position, deltas))
            corners = np.arange(n_new)
            if "indices" in primitive:
                corners = self._corners(index, primitive["indices"], n_new)
            triangles.append(first_of[key] + _triangles(corners, mode))
        if len(points) == 1 and not _list(mesh, "primitives"):
            raise MeshError(f"mesh {index} has no primitives; export it again")
        return _Shape(np.concatenate(points), np.concatenate(triangles))

    def _deltas(
        self, index: int, primitive: dict[str, Any], weights: tuple[float, ...]
    ) -> list[tuple[float, Any]]:
        """Weight and accessor of each morph target that moves the points."""
        targets = _list(primitive, "targets")
        if weights and len(weights) != len(targets):
            raise MeshError(
                f"mesh {index}: a weight for each of {len(targets)} morph targets wanted, got "
                f"{len(weights)}; correct the weights"
            )
        return [
            (weight, target["POSITION"])
            for weight, target in zip(weights, targets, strict=False)
            if weight and "POSITION" in target
        ]

    def _points(self, position: Any, deltas: list[tuple[float, Any]]) -> NDArray[np.float64]:
        points = self._reader.read(position, "VEC3").astype(np.float64)
        for weight, target in deltas:
            if self._reader.count(target) != len(points):
                raise MeshError(
                    f"accessor {target} moves {self._reader.count(target)} points, the mesh has "
                    f"{len(points)}; export it again"
                )
            # Targets may share their bytes, so a short file could ask for any amount of work.
            self._reader.reserve(0, 0, len(points) * BYTES_PER_DELTA)
            points += weight * self._reader.read(target, "VEC3")
        return points

    def _corners(self, index: int, indices: Any, n_points: int) -> NDArray[np.int64]:
        values = self._reader.read(indices, "SCALAR")[:, 0]
        # The largest number of a type would restart a strip, where the format allowed it.
        limit = min(n_points, int(np.iinfo(values.dtype).max))
        if len(values) and values.max() >= limit:
            raise MeshError(
                f"mesh {index}: vertex indices must lie in 0 ... {limit - 1}, got {values.max()}; "
                "export it again"
            )
        return values.astype(np.int64)


class _Reader:
    """Accessors: typed, strided windows of the binary chunk; and what they cost together."""

    def __init__(self, header: dict[str, Any], binary: memoryview, budget: int) -> None:
        self.header, self.binary, self._budget = header, binary, budget
        self._n_faces = self._n_vertices = self._n_bytes = 0

    def check(self, n_faces: int, n_vertices: int) -> None:
        """Raise ResourceError when this much more would need more than the budget."""
        check_budget(
            self._n_faces + n_faces, self._budget, self._n_vertices + n_vertices, self._n_bytes
        )

    def reserve(self, n_faces: int, n_vertices: int, n_bytes: int = 0) -> None:
        """Count what is about to be made; accessors and meshes that are used again count again."""
        self._n_faces += n_faces
        self._n_vertices += n_vertices
        self._n_bytes += n_bytes
        self.check(0, 0)

    def count(self, index: Any) -> int:
        """Number of elements."""
        return _whole(_item(self.header, "accessors", index), "count")

    def read(self, index: Any, wanted: str) -> NDArray[Any]:
        """(N, columns) of type `wanted`; normalised integers become floats, scalars are indices."""
        accessor = _item(self.header, "accessors", index)
        sparse = accessor.get("sparse")
        if ("bufferView" not in accessor and not sparse) or sparse == {}:
            raise MeshError(f"accessor {index} is sparse or compressed; export it uncompressed")
        kind = COMPONENTS.get(accessor["componentType"])
        is_index = wanted == "SCALAR"
        is_normalised = accessor.get("normalized", False)
        fits = kind is not None and (kind[0] == "u" if is_index else kind != "u4")
        if accessor.get("type") != wanted or not fits:
            raise MeshError(
                f"accessor {index} must be {wanted}, got {accessor.get('type')!r} of "
                f"{accessor.get('componentType')!r}; export it again"
            )
        if type(is_normalised) is not bool or (is_normalised and (is_index or kind == "f4")):
            raise MeshError(
                f"accessor {index}: 'normalized' is for coordinates in whole numbers, got "
                f"{is_normalised!r}; export it again"
            )
        dtype, n, n_columns = np.dtype(f"<{kind}"), self.count(index), N_COLUMNS[wanted]
        if "bufferView" in accessor:
            values = self._window(index, accessor, n, dtype, n_columns)
        else:
            values = np.zeros((n, n_columns), dtype)
        if sparse:
            values = self._replaced(index, sparse, values)
        if is_normalised:
            values = np.maximum(values / np.iinfo(dtype).max, -1)
        return values

    def _replaced(self, index: Any, sparse: dict[str, Any], values: NDArray[Any]) -> NDArray[Any]:
        """Values of an accessor with those replaced that its sparse part lists."""
        n = _whole(sparse, "count")
        kind = COMPONENTS.get(sparse["indices"]["componentType"], "")
        if not 0 < n <= len(values) or kind[:1] != "u":
            raise MeshError(
                f"accessor {index} is sparse or compressed: 1 to {len(values)} replaced elements "
                f"wanted, got {n} with indices of type {kind!r}; export it uncompressed"
            )
        where = self._window(index, sparse["indices"], n, np.dtype(f"<{kind}"), 1)[:, 0]
        if (where[1:] <= where[:-1]).any() or where[-1] >= len(values):
            raise MeshError(
                f"accessor {index}: sparse indices must rise within 0 ... {len(values) - 1}; "
                "export it again"
            )
        replaced = values.copy()
        replaced[where] = self._window(index, sparse["values"], n, values.dtype, values.shape[1])
        return replaced

    def _window(
        self, index: Any, owner: dict[str, Any], count: int, dtype: np.dtype[Any], n_columns: int
    ) -> NDArray[Any]:
        """(count, n_columns) elements of the buffer view that `owner` names."""
        view = _item(self.header, "bufferViews", owner["bufferView"])
        buffer_index = view.get("buffer", 0)
        if "uri" in _item(self.header, "buffers", buffer_index) or buffer_index != 0:
            raise MeshError(
                "a buffer lies outside the file (uri), which is never opened; "
                "export a self-contained .glb"
            )
        row = n_columns * dtype.itemsize
        stride = _whole(view, "byteStride", row)
        start, within = _whole(view, "byteOffset", 0), _whole(owner, "byteOffset", 0)
        window = min(_whole(view, "byteLength", 0), len(self.binary) - start)
        if stride < row or (count and within + (count - 1) * stride + row > window):
            raise MeshError(
                f"accessor {index} promises {count} elements of {row} bytes every {stride}, its "
                f"view holds {max(window, 0)} bytes; the file is broken, export it again"
            )
        if not count:
            return np.empty((0, n_columns), dtype)
        return np.ndarray(
            (count, n_columns), dtype, self.binary, start + within, (stride, dtype.itemsize)
        )
