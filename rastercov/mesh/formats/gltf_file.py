"""glTF 2 as a file: chunks of GLB, checked look-ups in the JSON header, accessors, and a writer.

What the reader of scenes does not use is looked at, too: unknown names, accessors, bytes of views.
A name, a count or an index that is wrong makes a valid file with fewer triangles; the parts that
nothing uses show it.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.6, 4 and 5.
"""

import json
import math
import re
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError, RastercovError
from rastercov.base.files import UnknownNames, unique_names
from rastercov.mesh.formats.polygons import check_budget

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
LONGEST_NAME = 1000
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def chunks(data: bytes) -> tuple[dict[str, Any], memoryview, list[str]]:
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
    found: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += 8
        if at + size > length:
            raise MeshError(
                f"a chunk at byte offset {at} promises {size} bytes, {length - at} are there; "
                "it is truncated, export it again"
            )
        found.setdefault(kind, memoryview(data)[at : at + size])
        at += size
    extra = len(data) - at
    notes = [f"{extra} trailing bytes after the last chunk were not read"] if extra > 0 else []
    if JSON_CHUNK not in found:
        raise MeshError("no readable JSON chunk (there is none); export it again")
    header = json_header(bytes(found[JSON_CHUNK]), "JSON chunk")
    return header, found.get(BINARY_CHUNK, memoryview(b"")), notes


def json_header(text: bytes, what: str) -> dict[str, Any]:
    """JSON object of a glTF 2.0 scene; `what` names the text in errors."""
    try:
        header = json.loads(
            text.decode("utf-8-sig"), parse_constant=_no_number, object_pairs_hook=unique_names
        )
    except (ValueError, RecursionError) as error:
        raise MeshError(f"no readable {what} ({error}); export it again") from error
    if not isinstance(header, dict):
        raise MeshError(f"the {what} must be an object, got {type(header).__name__}")
    asset = header.get("asset", {})
    for key in ("version", "minVersion"):
        wanted = str(asset.get(key, "2.0"))
        if wanted.partition(".")[0] != "2" or (key == "minVersion" and wanted != "2.0"):
            raise MeshError(f"glTF 2.0 wanted, got {key} {wanted[:20]!r}; export it again")
    return header


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is not JSON")


def json_list(owner: dict[str, Any], key: str) -> list[Any]:
    """List at a key, empty where there is none."""
    found = owner.get(key, [])
    if not isinstance(found, list):
        raise MeshError(f"{key!r} must be a list, got {type(found).__name__}; export it again")
    return found


def json_object(header: dict[str, Any], key: str, index: Any) -> dict[str, Any]:
    """Object of that index in the list at a key."""
    items = json_list(header, key)
    if type(index) is not int or not 0 <= index < len(items) or type(items[index]) is not dict:
        raise MeshError(f"{key!r} has {len(items)} objects, number {index!r} was asked; correct it")
    found: dict[str, Any] = items[index]
    return found


def json_name(owner: dict[str, Any]) -> str:
    """Name of an object, shortened, as many nodes may show that of one mesh; "" without one."""
    name = owner.get("name") or ""
    if not isinstance(name, str):
        raise MeshError(f"a name must be a text, got {type(name).__name__}; correct it")
    return name[:LONGEST_NAME]


def json_count(owner: dict[str, Any], key: str, default: int | None = None) -> int:
    """Integer of 0 or more at a key."""
    value = owner.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"{key!r} must be a whole number from 0, got {value!r}; export it again")
    return value


def json_numbers(
    owner: dict[str, Any], key: str, default: tuple[float, ...]
) -> NDArray[np.float64]:
    """Finite numbers at a key, as many as `default` has."""
    values = owner.get(key, default)
    is_list = isinstance(values, (list, tuple)) and len(values) == len(default)
    if not is_list or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
        raise ValueError(f"{key!r} must be {len(default)} finite numbers, got {str(values)[:60]}")
    return np.array(values, dtype=np.float64)


class Accessors:
    """Typed, strided windows of the buffers, and the memory that reading them needs in all.

    `buffers` are the bytes of each buffer; a buffer beyond them lies outside the file.
    """

    def __init__(self, header: dict[str, Any], buffers: Sequence[memoryview], budget: int) -> None:
        self.header, self._buffers, self._budget = header, buffers, budget
        self._n_faces = self._n_vertices = self._n_bytes = 0

    def check(self, n_faces: int, n_vertices: int) -> None:
        """Raise ResourceError when this many more faces and vertices would exceed the budget."""
        check_budget(
            self._n_faces + n_faces, self._budget, self._n_vertices + n_vertices, self._n_bytes
        )

    def reserve(self, n_faces: int, n_vertices: int, n_bytes: int = 0) -> None:
        """Count memory about to be allocated; an accessor or mesh used again counts again."""
        self._n_faces += n_faces
        self._n_vertices += n_vertices
        self._n_bytes += n_bytes
        self.check(0, 0)

    def count(self, index: Any) -> int:
        """Number of elements."""
        return json_count(json_object(self.header, "accessors", index), "count")

    def read(self, index: Any, wanted: str) -> NDArray[Any]:
        """(N, columns) of type `wanted`; normalised integers become floats, scalars are indices."""
        accessor = json_object(self.header, "accessors", index)
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
        dtype, n, n_columns = np.dtype(f"<{kind}"), self.count(index), COLUMNS[wanted]
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
        """Values of an accessor after the replacements of its sparse part."""
        n = json_count(sparse, "count")
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
        view = json_object(self.header, "bufferViews", owner["bufferView"])
        buffer_index = view.get("buffer", 0)
        json_object(self.header, "buffers", buffer_index)
        if buffer_index >= len(self._buffers):
            raise MeshError(
                "a buffer lies outside the file (uri), which is never opened; "
                "export a self-contained .glb"
            )
        row = n_columns * dtype.itemsize
        stride = json_count(view, "byteStride", row)
        start, within = json_count(view, "byteOffset", 0), json_count(owner, "byteOffset", 0)
        buffer = self._buffers[buffer_index]
        window = min(json_count(view, "byteLength", 0), len(buffer) - start)
        if stride < row or (count and within + (count - 1) * stride + row > window):
            raise MeshError(
                f"accessor {index} promises {count} elements of {row} bytes every {stride}, its "
                f"view holds {max(window, 0)} bytes; the file is broken, export it again"
            )
        if not count:
            return np.empty((0, n_columns), dtype)
        return np.ndarray(
            (count, n_columns), dtype, buffer, start + within, (stride, dtype.itemsize)
        )


INSTANCING = "EXT_mesh_gpu_instancing"
KNOWN = {
    kind: frozenset(f"{names} extensions extras".split())
    for kind, names in {
        "file": "accessors animations asset buffers bufferViews cameras extensionsRequired "
        "extensionsUsed images materials meshes nodes samplers scene scenes skins textures",
        "asset": "copyright generator minVersion version",
        "scene": "nodes name",
        "node": "camera children matrix mesh name rotation scale skin translation weights",
        "mesh": "primitives weights name",
        "primitive": "attributes indices material mode targets",
        "accessor": "bufferView byteOffset componentType count max min name normalized sparse type",
        "sparse": "count indices values",
        "sparse indices": "bufferView byteOffset componentType",
        "sparse values": "bufferView byteOffset",
        "bufferView": "buffer byteLength byteOffset byteStride name target",
        "buffer": "byteLength name uri",
        "camera": "orthographic perspective type name",
        "perspective": "aspectRatio yfov zfar znear",
        INSTANCING: "attributes",
    }.items()
}
"""Names of each kind of object."""
PARTS = {
    "file": {
        "asset": "asset", "scenes": "scene", "nodes": "node", "meshes": "mesh",
        "accessors": "accessor", "bufferViews": "bufferView", "buffers": "buffer",
        "cameras": "camera",
    },
    "node": {"extensions": "extensions"},
    "extensions": {INSTANCING: INSTANCING},
    INSTANCING: {"attributes": "instances"},
    "mesh": {"primitives": "primitive"},
    "primitive": {"attributes": "attributes", "targets": "attributes"},
    "accessor": {"sparse": "sparse"},
    "sparse": {"indices": "sparse indices", "values": "sparse values"},
    "camera": {"perspective": "perspective"},
}  # fmt: skip
"""Kinds of the objects within an object, or in a list there, by their names."""
HARMLESS = frozenset(
    {"copyright", "generator", "name", "extras", "material", "materials", "max", "min", "target"}
    | {"images", "samplers", "textures", "animations", "skin", "skins", "zfar", "znear"}
)
"""Names that no triangle and no camera depends on."""
ATTRIBUTES = {
    "attributes": (
        re.compile(r"POSITION|NORMAL|TANGENT|(TEXCOORD|COLOR|JOINTS|WEIGHTS)_[0-9]+|_.*", re.S),
        frozenset({"POSITION"}),
    ),
    "instances": (
        re.compile(r"TRANSLATION|ROTATION|SCALE|_.*", re.S),
        frozenset({"TRANSLATION", "ROTATION", "SCALE"}),
    ),
}
"""Names of attributes, and those that move triangles."""
WIDTHS = {str(component): int(kind[1]) for component, kind in COMPONENTS.items()}
ALIGNMENT = 4
"""Bytes: a smaller gap between accessors is padding."""


def unknown_names(header: dict[str, Any], error: type[RastercovError] = MeshError) -> list[str]:
    """Notes on names that glTF 2.0 does not have; an error for a slip in one that matters."""
    found = UnknownNames(error)
    for where, kind, owner in _objects("the file", "file", header):
        if kind in KNOWN:
            found.look(where, owner.keys(), KNOWN[kind], HARMLESS)
        elif kind in ATTRIBUTES:
            pattern, needed = ATTRIBUTES[kind]
            known = {name for name in owner if pattern.fullmatch(name)}
            if len(known) < len(owner):
                found.look(where, owner.keys(), frozenset(known | needed), frozenset(known))
    return found.notes()


def _objects(
    where: str, kind: str, owner: dict[str, Any]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """An object and those within it, each with its place and kind."""
    yield where, kind, owner
    for name, inner in PARTS.get(kind, {}).items():
        value = owner.get(name)
        of = "" if kind == "file" else f" of {where}"
        for row, each in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(each, dict):
                yield from _objects(f"{inner} {row}{of}", inner, each)


def unread_data(header: dict[str, Any]) -> list[str]:
    """Notes on accessors that nothing names, and on bytes of views that no accessor reads."""
    accessors, views = (_tables(header.get(key)) for key in ("accessors", "bufferViews"))
    used = _used_accessors(header)
    n_unused = sum(index not in used for index in range(len(accessors)))
    notes = [f"{n_unused} accessors belong to nothing, not read"] if n_unused else []
    spans: dict[int, list[tuple[int, int, int]]] = {}
    for accessor in accessors:
        for owner, row in _windows(accessor):
            index, count = owner.get("bufferView"), owner.get("count")
            if type(index) is int and 0 <= index < len(views):
                stride, start = views[index].get("byteStride", row), owner.get("byteOffset", 0)
                if type(start) is type(stride) is type(count) is int:
                    spans.setdefault(index, []).append((start, start + stride * count, stride))
    n_unread = 0
    for index, its in spans.items():
        length = views[index].get("byteLength")
        at = 0
        for start, end, stride in (*sorted(its), (length, length, its[0][2])):
            if type(start) is int and start - at >= max(stride, ALIGNMENT):
                n_unread += start - at
            at = max(at, end) if type(end) is int else at
    return notes + (
        [f"{n_unread} bytes beside the elements of accessors belong to none, not read"]
        if n_unread
        else []
    )


def _windows(accessor: dict[str, Any]) -> Iterator[tuple[dict[str, Any], int]]:
    """Parts of an accessor that name a view, with their count, and the bytes of an element."""
    columns = COLUMNS.get(str(accessor.get("type")), 0)
    row = columns * WIDTHS.get(str(accessor.get("componentType")), 0)
    yield accessor, row
    for sparse in _tables([accessor.get("sparse")]):
        for indices in _tables([sparse.get("indices")]):
            width = WIDTHS.get(str(indices.get("componentType")), 0)
            yield {**indices, "count": sparse.get("count")}, width
        for values in _tables([sparse.get("values")]):
            yield {**values, "count": sparse.get("count")}, row


def _used_accessors(header: dict[str, Any]) -> set[int]:
    """Whole numbers in all places that may have the index of an accessor."""
    places: list[Any] = []
    for mesh in _tables(header.get("meshes")):
        for each in _tables(mesh.get("primitives")):
            places += [each.get(key) for key in ("attributes", "indices", "targets", "extensions")]
    places += [node.get("extensions") for node in _tables(header.get("nodes"))]
    places += [skin.get("inverseBindMatrices") for skin in _tables(header.get("skins"))]
    for animation in _tables(header.get("animations")):
        samplers = _tables(animation.get("samplers"))
        places += [sampler.get(key) for key in ("input", "output") for sampler in samplers]
    places.append(header.get("extensions"))
    found: set[int] = set()
    while places:
        each = places.pop()
        if isinstance(each, dict):
            places += each.values()
        elif isinstance(each, list):
            places += each
        elif type(each) is int:
            found.add(each)
    return found


def _tables(items: Any) -> list[dict[str, Any]]:
    """Objects of a list, empty ones in place of what is none: the reader refuses it."""
    listed = items if isinstance(items, list) else []
    return [each if isinstance(each, dict) else {} for each in listed]


Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turn from z up to glTF's y up."""
COMPONENT_OF = {kind: number for number, kind in COMPONENTS.items()}
KIND_OF_COLUMNS = {COLUMNS[kind]: kind for kind in ("SCALAR", "VEC2", "VEC3", "VEC4")}


class GlbBuffer:
    """Binary chunk of a file, with its views and accessors."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._n_bytes = 0
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add_bytes(self, data: bytes) -> int:
        """Index of a new view, which begins at a multiple of 4 bytes."""
        view = {"buffer": 0, "byteOffset": self._n_bytes, "byteLength": len(data)}
        self._views.append(view)
        piece = _padded(data, b"\0")
        self._pieces.append(piece)
        self._n_bytes += len(piece)
        return len(self._views) - 1

    def add(self, array: NDArray[Any]) -> int:
        """Index of a new accessor of float32 or uint32 values, (N,) or (N, columns), N > 0."""
        kind = KIND_OF_COLUMNS[1 if array.ndim == 1 else array.shape[1]]
        accessor: dict[str, Any] = {
            "bufferView": self.add_bytes(array.astype(array.dtype.newbyteorder("<")).tobytes()),
            "componentType": COMPONENT_OF[f"{array.dtype.kind}{array.dtype.itemsize}"],
            "count": len(array),
            "type": kind,
        }
        if kind == "VEC3":  # required of positions
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def file(self, scene: dict[str, Any]) -> bytes:
        """The file of a glTF scene, which refers to the views and accessors of this buffer."""
        header = {
            "asset": {"version": "2.0", "generator": "rastercov"},
            **scene,
            "buffers": [{"byteLength": self._n_bytes}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }
        text = _padded(json.dumps(header, allow_nan=False).encode(), b" ")
        total = 12 + 8 + len(text) + 8 + self._n_bytes
        return b"".join(
            (
                struct.pack("<4sII", b"glTF", 2, total),
                struct.pack("<II", len(text), JSON_CHUNK),
                text,
                struct.pack("<II", self._n_bytes, BINARY_CHUNK),
                *self._pieces,
            )
        )


def _padded(data: bytes, filler: bytes) -> bytes:
    """Data whose length is a multiple of 4."""
    return data + filler * (-len(data) % 4)
