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
from typing_extensions import TypeIs

from rastercov.base import (
    AnyArray,
    ByName,
    FloatArray,
    MeshError,
    RastercovError,
    UnknownNames,
    UnparsedError,
    UnreadableError,
    Vocabulary,
    parse_json,
    shown,
)
from rastercov.formats.meshes.polygons import broken, check, check_budget

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
LONGEST_NAME = 1000
MOST_COUNTED = 1 << 63
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def chunks(data: bytes) -> tuple[ByName, memoryview, list[str]]:
    """JSON header, binary chunk and notes."""
    is_glb = len(data) >= 20 and data[:4] == b"glTF"
    check(
        is_glb,
        "expected a GLB file, which begins with glTF, got another file",
        "export a binary .glb",
    )
    version, length = struct.unpack_from("<II", data, 4)
    check(version == 2, f"expected glTF version 2, got {version}")
    _check_room("the header", length, 0, len(data))
    table: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += 8
        _check_room("a chunk", size, at, length)
        table.setdefault(kind, memoryview(data)[at : at + size])
        at += size
    extra = len(data) - at
    notes = [f"ignored {extra} bytes after the last chunk"] if extra > 0 else []
    check(JSON_CHUNK in table, "expected a JSON chunk, got none")
    header = json_header(bytes(table[JSON_CHUNK]), "JSON chunk")
    return header, table.get(BINARY_CHUNK, memoryview(b"")), notes


def _check_room(what: str, size: int, at: int, end: int) -> None:
    check(
        at + size <= end,
        f"expected {size} bytes of {what} from byte offset {at} on, got {end - at}; truncated",
    )


def json_header(text: bytes, what: str) -> ByName:
    """JSON object of a glTF 2.0 scene; `what` names the text in errors."""
    try:
        header = parse_json(text, is_strict=True)
    except UnparsedError as error:
        raise broken(f"expected a readable {what}, got: {error.reason}") from error
    except UnreadableError as error:
        raise MeshError(f"{what}: {error.reason}") from error
    if not isinstance(header, dict):
        raise broken(f"expected the {what} to be an object, got {type(header).__name__}")
    check_version(header)
    return header


def check_version(header: ByName) -> None:
    """Raise MeshError for a file of another version than glTF 2."""
    asset = header.get("asset", {})
    for key, known in (("version", "2."), ("minVersion", "2.0")):
        wanted = str(asset.get(key, "2.0"))
        check(f"{wanted}.".startswith(known), f"expected glTF 2.0, got {key} {shown(wanted)}")


def header_of(data: bytes) -> ByName:
    """JSON object of a .glb or .gltf file."""
    return chunks(data)[0] if data[:4] == b"glTF" else json_header(data, "JSON")


def is_list(value: object) -> TypeIs[list[Any]]:
    """True for a list of JSON."""
    return isinstance(value, list)


def is_table(value: object) -> TypeIs[ByName]:
    """True for an object of JSON."""
    return isinstance(value, dict)


def is_whole(value: object) -> TypeIs[int]:
    """True for a whole number of JSON; True and False are none."""
    return type(value) is int


def kind_of(value: object) -> str:
    """Name of the type of a value."""
    return type(value).__name__


def json_list(owner: ByName, key: str) -> list[Any]:
    """List at a key, empty where there is none."""
    entry: object = []
    if key in owner:  # null is no list: `get` of the page takes it for none
        entry = owner[key]
    if not is_list(entry):
        raise broken(f"expected '{key}' to be a list, got {kind_of(entry)}")
    return entry


def json_object(header: ByName, key: str, index: object) -> ByName:
    """Object of that index in the list at a key."""
    items = json_list(header, key)
    if not is_whole(index) or not 0 <= index < len(items) or not is_table(items[index]):
        raise broken(
            f"expected an index below {len(items)}, the objects of '{key}', got {shown(index)}"
        )
    return items[index]


def json_name(owner: ByName) -> str:
    """Name of an object, shortened, as many nodes may show that of one mesh; "" without one."""
    name = owner.get("name") or ""
    if not isinstance(name, str):
        raise broken(f"expected a name to be a string, got {type(name).__name__}")
    return name[:LONGEST_NAME]


def json_count(owner: ByName, key: str, otherwise: int | None = None) -> int:
    """Integer of 0 or more at a key."""
    value: object = otherwise
    if key in owner:
        value = owner[key]
    if not is_whole(value) or not 0 <= value < MOST_COUNTED:
        raise broken(f"expected '{key}' to be a whole number from 0, got {shown(value)}")
    return value


def json_numbers(owner: ByName, key: str, default: tuple[float, ...]) -> FloatArray:
    """Finite numbers at a key, as many as `default` has."""
    values = owner.get(key, default)
    is_list = isinstance(values, (list, tuple)) and len(values) == len(default)
    if not is_list or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
        raise ValueError(
            f"expected {key!r} to be {len(default)} finite numbers, got {str(values)[:60]}"
        )
    return np.array(values, np.float64)


def component_of(accessor: ByName, where: str, wanted: str) -> str:
    """Kind of the numbers of an accessor of the type that is wanted; scalars are indices."""
    kind = COMPONENTS.get(accessor["componentType"])
    is_index = wanted == "SCALAR"
    if (
        accessor.get("type") != wanted
        or kind is None
        or not (kind[0] == "u" if is_index else kind != "u4")
    ):
        got = f"{shown(accessor.get('type'))} of {shown(accessor.get('componentType'))}"
        raise broken(f"expected {where} to be {wanted}, got {got}")
    is_normalised: object = False
    if "normalized" in accessor:
        is_normalised = accessor["normalized"]
    check(
        kind_of(is_normalised) == "bool" and not (is_normalised and (is_index or kind == "f4")),
        f"{where}: expected 'normalized' of integers, got {shown(is_normalised)}",
    )
    return kind


def window_of(
    view: ByName, owner: ByName, where: str, count: int, size: int, length: int
) -> tuple[int, int]:
    """Start and stride, bytes, of elements of a size that `owner` has in a buffer of a length."""
    stride = json_count(view, "byteStride", size)
    start, within = json_count(view, "byteOffset", 0), json_count(owner, "byteOffset", 0)
    window = min(json_count(view, "byteLength", 0), length - start)
    check(
        stride >= size and (not count or within + (count - 1) * stride + size <= window),
        f"{where}: expected {count} elements of {size} bytes every {stride}, got a view of "
        f"{max(window, 0)} bytes; truncated",
    )
    return start + within, stride


class Accessors:
    """Typed, strided windows of the buffers, and the memory that reading them needs in all.

    `buffers` are the bytes of each buffer; a buffer beyond them lies outside the file.
    """

    def __init__(self, header: ByName, buffers: Sequence[memoryview], budget: int) -> None:
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

    def count(self, index: object) -> int:
        """Number of elements."""
        return json_count(json_object(self.header, "accessors", index), "count")

    def read(self, index: object, wanted: str) -> AnyArray:
        """(N, columns) of type `wanted`; normalised integers become floats, scalars are indices."""
        accessor = json_object(self.header, "accessors", index)
        where = f"accessor {index}"
        sparse = accessor.get("sparse")
        has_data = sparse if "sparse" in accessor else "bufferView" in accessor
        check(has_data, f"{where}: expected plain data, got none", "export it uncompressed")
        kind = component_of(accessor, where, wanted)
        dtype, n, n_columns = np.dtype(f"<{kind}"), self.count(index), COLUMNS[wanted]
        if "bufferView" in accessor:
            values = self._window(where, accessor, n, dtype, n_columns)
        else:
            values = np.zeros((n, n_columns), dtype)
        if sparse:
            values = self._replace(where, sparse, values)
        if accessor.get("normalized"):
            values = np.maximum(values / np.iinfo(dtype).max, -1)
        return values

    def step(self, index: object) -> float:
        """Difference of neighbouring values, 0 for those of floating point."""
        kind = np.dtype(COMPONENTS[json_object(self.header, "accessors", index)["componentType"]])
        return 0.0 if kind.kind == "f" else 1 / float(np.iinfo(kind).max)

    def read_times(self, index: object) -> FloatArray:
        """(N,) float64 of an accessor of float32 scalars, such as times."""
        accessor = json_object(self.header, "accessors", index)
        is_right = (
            accessor.get("type") == "SCALAR" and COMPONENTS.get(accessor["componentType"]) == "f4"
        )
        check(
            is_right and "sparse" not in accessor,
            f"expected scalars of float32, got accessor {index}",
        )
        window = self._window(f"accessor {index}", accessor, self.count(index), np.dtype("<f4"), 1)
        return window[:, 0].astype(np.float64)

    def _replace(self, where: str, sparse: ByName, values: AnyArray) -> AnyArray:
        """Values of an accessor after the replacements of its sparse part."""
        n, n_values = json_count(sparse, "count"), len(values)
        kind = COMPONENTS.get(sparse["indices"]["componentType"], "")
        check(
            0 < n <= n_values and kind[:1] == "u",
            f"{where}: expected 1 to {n_values} replaced elements, got {n} with indices of "
            f"type {kind!r}",
        )
        rows = self._window(where, sparse["indices"], n, np.dtype(f"<{kind}"), 1)[:, 0]
        check(
            (rows[1:] > rows[:-1]).all() and rows[-1] < n_values,
            f"{where}: expected sparse indices that increase within 0 ... {n_values - 1}, got "
            "others",
        )
        replaced = values.copy()
        replaced[rows] = self._window(where, sparse["values"], n, values.dtype, values.shape[1])
        return replaced

    def _window(
        self, where: str, owner: ByName, count: int, dtype: np.dtype[Any], n_columns: int
    ) -> AnyArray:
        """(count, n_columns) elements of the buffer view that `owner` names."""
        view = json_object(self.header, "bufferViews", owner["bufferView"])
        index = view.get("buffer", 0)
        compressed = json_object(self.header, "buffers", index).get("extensions")
        is_here = index < len(self._buffers) and (self._buffers[index] or not compressed)
        check(
            is_here or not compressed,
            f"{where}: expected plain data, got {', '.join(map(shown, compressed or ()))} alone",
            "export it uncompressed",
        )
        check(is_here, "expected buffers in the file, got one outside (uri)", "export a .glb")
        row = n_columns * dtype.itemsize
        buffer = self._buffers[index]
        start, stride = window_of(view, owner, where, count, row, len(buffer))
        if not count:
            return np.empty((0, n_columns), dtype)
        return np.ndarray((count, n_columns), dtype, buffer, start, (stride, dtype.itemsize))


INSTANCING = "EXT_mesh_gpu_instancing"
NAMES = Vocabulary(
    "accessors asset buffers bufferViews cameras extensions extensionsRequired extensionsUsed "
    "meshes nodes scene scenes minVersion version camera children matrix mesh rotation scale "
    "translation weights primitives attributes indices targets bufferView byteOffset "
    "componentType count normalized sparse type values buffer byteLength byteStride uri "
    "orthographic perspective aspectRatio yfov xmag ymag POSITION TRANSLATION ROTATION SCALE "
    f"{INSTANCING} animations channels samplers target skin skins joints inverseBindMatrices",
    "sampler input output interpolation node path",
    "copyright generator name extras material materials max min images textures skeleton zfar "
    "znear mode magFilter minFilter wrapS wrapT",
)
"""A slip in `mode` is a note only: `model` is a word of many programs."""
OF_ATTRIBUTES = frozenset(filter(str.isupper, NAMES.known))
"""Names that only tables of attributes have; a node has its own in small letters."""
ATTRIBUTE = re.compile(r"NORMAL|TANGENT|(TEXCOORD|COLOR|JOINTS|WEIGHTS)_[0-9]+|_.*", re.DOTALL)
"""Attributes of vertices that move no triangle."""
NAMES_ACCESSORS = {
    *("attributes", "indices", "targets", "extensions", "inverseBindMatrices", "input", "output")
}
"""Names of entries that have indices of accessors, directly or below."""
ALIGNMENT = 4
"""Bytes: a smaller gap between accessors is padding."""


def unknown_names(header: ByName, error: type[RastercovError] = MeshError) -> list[str]:
    """Notes on names that glTF 2.0 does not have; an error for a slip in one that matters."""
    unknown_names = UnknownNames(error)
    for where, kind, owner in objects(header):
        if kind != "extensions":  # those are noted where they are
            still = filter(ATTRIBUTE.fullmatch, owner.keys() - NAMES.known)
            known = (
                NAMES.known if kind in ("attributes", "targets") else NAMES.known - OF_ATTRIBUTES
            )
            unknown_names.look(where, owner.keys(), known.union(still), NAMES.harmless)
    return unknown_names.notes()


def objects(
    owner: ByName, where: str = "the file", kind: str = ""
) -> Iterator[tuple[str, str, ByName]]:
    """An object and those within it, each with its place and the name of its entry."""
    yield where, kind, owner
    of = f" of {where}" if kind else ""
    for name in filter(NAMES.inner.__contains__, owner):
        value = owner[name]
        for row, each in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(each, dict):
                title = {"meshes": "mesh"}.get(name, name.removesuffix("s"))
                yield from objects(each, f"{title} {row}{of}", name)


def unread_data(header: ByName) -> list[str]:
    """Notes on accessors that nothing names, and on bytes of views that no accessor reads."""
    accessors, views = json_list(header, "accessors"), json_list(header, "bufferViews")
    used = set(_used_accessors(header | {"accessors": []}))
    n_unused = sum(index not in used for index in range(len(accessors)))
    notes = [f"ignored {n_unused} accessors that nothing uses"] if n_unused else []
    spans: dict[int, list[tuple[int, int, int]]] = {}
    for accessor in accessors:
        for owner, count, row in _windows(accessor):
            view = json_object(header, "bufferViews", owner["bufferView"])
            stride, start = json_count(view, "byteStride", row), json_count(owner, "byteOffset", 0)
            span = (start, start + stride * count, stride)
            spans.setdefault(owner["bufferView"], []).append(span)
    n_unread = 0
    for index, its in spans.items():
        length = json_count(views[index], "byteLength", 0)
        at = 0
        for start, end, stride in (*sorted(its), (length, length, its[0][2])):
            if start - at >= max(stride, ALIGNMENT):
                n_unread += start - at
            at = max(at, end)
    if n_unread:
        notes.append(f"ignored {n_unread} bytes that belong to no accessor")
    return notes


def _windows(accessor: ByName) -> Iterator[tuple[ByName, int, int]]:
    """Parts of an accessor that name a view, each with its count and the bytes of an element."""
    row = COLUMNS.get(str(accessor.get("type")), 0) * _width(accessor)
    sparse = accessor.get("sparse", {})
    indices, values = sparse.get("indices", {}), sparse.get("values", {})
    for owner, counted, size in (
        (accessor, accessor, row),
        (indices, sparse, _width(indices)),
        (values, sparse, row),
    ):
        if "bufferView" in owner:
            yield owner, json_count(counted, "count"), size


def _width(owner: ByName) -> int:
    """Bytes of a number."""
    return int(COMPONENTS.get(owner.get("componentType", 0), "00")[1])


def _used_accessors(each: object, has_accessors: bool = False) -> Iterator[int]:
    """Whole numbers in all places that may have the index of an accessor."""
    if isinstance(each, dict):
        for key, value in each.items():
            if key != "extras":
                yield from _used_accessors(value, has_accessors or key in NAMES_ACCESSORS)
    elif isinstance(each, list):
        for value in each:
            yield from _used_accessors(value, has_accessors)
    elif has_accessors and type(each) is int:
        yield each


Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turn from z up to glTF's y up."""
WORLD = "rastercov_world"
"""Entry in `extras` of the node whose frame is the world: viewers have y up, and we have not."""
COMPONENT_OF = {kind: number for number, kind in COMPONENTS.items()}
KIND_OF_COLUMNS = {COLUMNS[kind]: kind for kind in ("SCALAR", "VEC2", "VEC3", "VEC4")}


def world_node(name: str, children: range) -> ByName:
    """Node whose frame is the world, turned to y up."""
    matrix = Y_UP.T.ravel().tolist()
    return {"name": name, "matrix": matrix, "children": list(children), "extras": {WORLD: True}}


class GlbBuffer:
    """Binary chunk of a file, with its views and accessors."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._n_bytes = 0
        self._views: list[ByName] = []
        self._accessors: list[ByName] = []

    def add_bytes(self, data: bytes) -> int:
        """Index of a new view, which begins at a multiple of 4 bytes."""
        view = {"buffer": 0, "byteOffset": self._n_bytes, "byteLength": len(data)}
        self._views.append(view)
        piece = _pad(data, b"\0")
        self._pieces.append(piece)
        self._n_bytes += len(piece)
        return len(self._views) - 1

    def add(self, array: AnyArray, *, with_range: bool = False) -> int:
        """Index of a new accessor of float32 or uint32 values, (N,) or (N, columns), N > 0.

        `with_range` for times, (N,), whose least and greatest a file must state.
        """
        kind = KIND_OF_COLUMNS[1 if array.ndim == 1 else array.shape[1]]
        accessor: ByName = {
            "bufferView": self.add_bytes(array.astype(array.dtype.newbyteorder("<")).tobytes()),
            "componentType": COMPONENT_OF[f"{array.dtype.kind}{array.dtype.itemsize}"],
            "count": len(array),
            "type": kind,
        }
        if with_range:
            accessor |= {"min": [float(array.min())], "max": [float(array.max())]}
        if kind == "VEC3":  # required of positions
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def file(self, scene: ByName) -> bytes:
        """The file of a glTF scene, which refers to the views and accessors of this buffer."""
        header = {
            "asset": {"version": "2.0", "generator": "rastercov"},
            **scene,
            "buffers": [{"byteLength": self._n_bytes}],
            "bufferViews": self._views,
            "accessors": self._accessors,
        }
        text = _pad(json.dumps(header, allow_nan=False).encode(), b" ")
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


def _pad(data: bytes, filler: bytes) -> bytes:
    """Data whose length is a multiple of 4."""
    return data + filler * (-len(data) % 4)
