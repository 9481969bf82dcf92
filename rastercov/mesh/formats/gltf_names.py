"""Parts of a glTF 2 file that its reader does not use: unknown names, accessors, bytes of views.

A name, a count or an index that is wrong makes a valid file with fewer triangles; the parts
that nothing uses show it.

Source: Khronos Group. glTF 2.0 Specification. 2021, sections 3.6 and 5.
"""

import re
from collections.abc import Iterator
from typing import Any

from rastercov.base.errors import MeshError, RastercovError
from rastercov.base.names import UnknownNames

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
WIDTHS = {"5120": 1, "5121": 1, "5122": 2, "5123": 2, "5125": 4, "5126": 4}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
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
