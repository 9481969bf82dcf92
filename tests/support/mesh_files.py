"""Mesh files of every format, written by hand: a tetrahedron, or any other polygons."""

import base64
import json
import struct
from functools import partial

import numpy as np

from rastercov.base.errors import MeshError

#    3---2      a tetrahedron over the triangle 0 1 2; its faces are wound outwards
#    |\ /|
#    0---1
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def triangles(mesh):
    """(F, 3, 3) corners of the faces."""
    return mesh.vertices[mesh.faces]


def refusal(load, name, data, **options):
    """Text of the error that a file is refused with; empty if it loads."""
    try:
        load(name, data, **options)
    except MeshError as error:
        return str(error)
    return ""


def rows_of(points, start=""):
    return [f"{start}{x!r} {y!r} {z!r}" for x, y, z in np.asarray(points).tolist()]


def binary_stl(points, faces, header=b"", count=None):
    records = np.zeros(len(faces), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    with np.errstate(over="ignore"):
        records["c"] = np.asarray(points)[np.asarray(faces, int).reshape(-1, 3)]
    count = len(faces) if count is None else count
    return header.ljust(80, b"\0") + struct.pack("<I", count) + records.tobytes()


def ascii_stl(points, faces):
    lines = ["solid a name"]
    for corners in np.asarray(points)[faces]:
        lines += ["facet normal 0 0 0", " outer loop", *rows_of(corners, "  vertex ")]
        lines += [" endloop", "endfacet"]
    return "\n".join([*lines, "endsolid a name", ""]).encode()


def obj(points, faces):
    lines = ["# comment", "mtllib secret.mtl", "o thing", *rows_of(points, "v "), "vn 0 0 1"]
    lines += [f"f {' '.join(f'{i + 1}//1' for i in face)}" for face in faces]
    return "\n".join([*lines, ""]).encode()


def off(points, faces):
    lines = ["OFF # comment", f"{len(points)} {len(faces)} 0", *rows_of(points)]
    lines += [f"{len(face)} {' '.join(map(str, face))} 255 0 0" for face in faces]
    return "\n".join(lines).encode()


PLY_FORMATS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


def ply(points, faces, order="", index="int"):
    """PLY with more properties and elements than are read."""
    head = (
        f"ply\nformat {PLY_FORMATS[order]} 1.0\ncomment made by hand\n"
        f"element vertex {len(points)}\nproperty float64 x\nproperty double y\nproperty double z\n"
        f"property uchar red\nelement face {len(faces)}\nproperty short flags\n"
        f"property list uchar {index} vertex_indices\nelement extra 1\nproperty int a\nend_header\n"
    ).encode()
    faces = [list(map(int, face)) for face in faces]
    if not order:
        lines = [f"{row} 7" for row in rows_of(points)]
        lines += [f"5 {len(face)} {' '.join(map(str, face))}" for face in faces]
        return head + "\n".join([*lines, "9", ""]).encode()
    rows = [struct.pack(order + "dddB", *p, 7) for p in points]
    code = {"int": "i", "uchar": "B", "uint": "I"}[index]
    rows += [struct.pack(f"{order}hB{len(face)}{code}", 5, len(face), *face) for face in faces]
    return head + b"".join(rows) + struct.pack(order + "i", 9)


def strips(lists, order="", index="int"):
    """PLY of triangle strips between `POINTS`."""
    return ply(POINTS, lists, order, index).replace(b"element face", b"element tristrips")


def places(value, path=()):
    """Paths of all values of JSON."""
    items = enumerate(value) if isinstance(value, list) else value.items()
    for key, inner in items:
        yield (*path, key)
        if isinstance(inner, dict | list):
            yield from places(inner, (*path, key))


GLB_TYPES = {"<f4": 5126, "<u2": 5123, "<u1": 5121, "<i1": 5120, "<i2": 5122, "<u4": 5125}


def glb_bytes(header, binary=b""):
    text = json.dumps({"asset": {"version": "2.0"}, **header}).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


class Glb:
    """A GLB file in the making: accessors of arrays, then the JSON around them."""

    def __init__(self, points=POINTS, faces=FACES, **primitive):
        self.binary = b""
        self.header = {
            "buffers": [{}], "bufferViews": [], "accessors": [], "meshes": [],
            "nodes": [{"mesh": 0, "name": "part"}], "scenes": [{"nodes": [0]}],
        }  # fmt: skip
        self.mesh(points, faces, **primitive)

    def view(self, values):
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.header["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": values.nbytes}
        )
        self.binary += values.tobytes()
        self.header["buffers"][0]["byteLength"] = len(self.binary)
        return len(self.header["bufferViews"]) - 1

    def accessor(self, values, dtype="<f4", **more):
        with np.errstate(over="ignore"):
            values = np.asarray(values).astype(dtype)
        self.header["accessors"].append(
            {
                "bufferView": self.view(values),
                "componentType": GLB_TYPES[dtype],
                "count": len(values),
                "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}",
                **more,
            }
        )
        return len(self.header["accessors"]) - 1

    def mesh(self, points, faces, **primitive):
        positions = {"POSITION": self.accessor(points)}
        indices = self.accessor(np.ravel(faces), "<u2")
        primitives = [{"attributes": positions, "indices": indices, **primitive}]
        self.header["meshes"].append({"primitives": primitives})
        return self.header["meshes"][-1]

    def put(self, keys, value):
        """Set one value of the header, or delete it if it is `...`; returns the file."""
        *path, last = keys
        owner = self.header
        for key in path:
            owner = owner[key]
        if value is ...:
            del owner[last]
        else:
            owner[last] = value
        return self.data()

    def nodes(self, *nodes):
        """Replace the nodes; all of them are in the scene."""
        self.header["nodes"] = list(nodes)
        self.header["scenes"] = [{"nodes": list(range(len(nodes)))}]

    @property
    def node(self):
        return self.header["nodes"][0]

    @property
    def primitive(self):
        return self.header["meshes"][0]["primitives"][0]

    def data(self):
        return glb_bytes(self.header, self.binary)

    def json(self, uri=None):
        """The same in JSON; the buffer is in a data URI, or where `uri` says."""
        inside = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        buffer = {**self.header["buffers"][0], "uri": uri if uri is not None else inside}
        header = {"asset": {"version": "2.0"}, **self.header, "buffers": [buffer]}
        return json.dumps(header).encode()


WRITERS = {
    "binary.stl": binary_stl,
    "ascii.stl": ascii_stl,
    "a.obj": obj,
    "a.off": off,
    "ascii.ply": ply,
    "little.ply": partial(ply, order="<"),
    "big.ply": partial(ply, order=">"),
    "a.glb": lambda points, faces: Glb(points, faces).data(),
}
"""Functions of points and faces that write each format, by the name of a file."""
TEXT = ("ascii.stl", "a.obj", "a.off", "ascii.ply")
VALID = {name: write(POINTS, FACES) for name, write in WRITERS.items()}
