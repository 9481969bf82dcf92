"""GLB container: chunks, checked look-ups in the JSON header, accessors of the buffers.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.6 and 4.
"""

import json
import math
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import MeshError
from rastercov.base.files import unique_names
from rastercov.mesh.formats.polygons import check_budget

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
LONGEST_NAME = 1000
N_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


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
