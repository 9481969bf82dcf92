"""Files with one bit of a name flipped: no face, pose or camera is lost without a word.

Meshes are written in every format, and bits of their JSON, tags, headers and keywords are flipped.
A file that still loads with less must carry a note that the whole one has not. The folder in the
environment variable ATTACK_MESHES adds meshes to those of this package.
"""

import json
import os
import re
import struct
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh
from mesh_files import GLB_TYPES, ascii_stl, obj, off, ply
from repeated_parts import (
    CAMERAS,
    HERE,
    INPUT,
    MOVE,
    SOURCE,
    components,
    dae,
    object_of,
    threemf,
)
from rows import Report

import rastercov as rc
from rastercov.base.errors import RastercovError
from rastercov.core.camera.conventions import Conventions
from rastercov.core.mesh import Mesh, shapes

N_FLIPS = 60_000
"""Flipped bits of a whole campaign."""
MOST_FACES = 60
"""Of a mesh: names are what is tried."""
ANSWERS = Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")
Outcome = tuple[str, int, frozenset[str]]
"""Outcome: the number of faces, or of poses and cameras; the notes."""


def meshes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces of parts of several meshes."""
    items = [shapes.teapot(), shapes.torus(), shapes.icosahedron()]
    if folder := os.environ.get("ATTACK_MESHES"):
        suffixes = (".stl", ".ply", ".obj")
        paths = sorted(p for p in Path(folder).iterdir() if p.suffix.lower() in suffixes)
        items += [Mesh.load(path) for path in paths]
    parts = []
    for mesh in items:
        used, faces = np.unique(mesh.faces[:MOST_FACES], return_inverse=True)
        parts.append((mesh.vertices[used], faces.reshape(-1, 3)))
    return parts


def own_glb(points: np.ndarray, faces: np.ndarray) -> bytes:
    """Nodes with children, an instance, morph weights and shared views."""
    binary = points.astype("<f4").tobytes() + faces.ravel().astype("<u4").tobytes()
    binary += np.ones(points.shape, "<f4").tobytes() + np.eye(3, dtype="<f4").tobytes()
    sizes = np.cumsum([0, 12 * len(points), 12 * len(faces), 12 * len(points), 36]).tolist()
    kinds = (("VEC3", "<f4", len(points)), ("SCALAR", "<u4", faces.size))
    kinds += (("VEC3", "<f4", len(points)), ("VEC3", "<f4", 3))
    views = [{"buffer": 0, "byteOffset": a, "byteLength": b - a} for a, b in pairwise(sizes)]
    accessors = [
        {"bufferView": i, "componentType": GLB_TYPES[code], "count": count, "type": kind}
        for i, (kind, code, count) in enumerate(kinds)
    ]
    primitive = {
        "attributes": {"POSITION": 0},
        "indices": 1,
        "mode": 4,
        "targets": [{"POSITION": 2}],
    }
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 3}}}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"mesh": 0, "children": [1], "scale": [1, 2, 3]},
            {"mesh": 1, "translation": [1, 2, 3], "rotation": [0, 0, 0.6, 0.8]},
            {"mesh": 0, "extensions": instances, "weights": [0.5]},
        ],
        "meshes": [
            {"primitives": [primitive], "weights": [0.25]},
            {"primitives": [primitive, {"attributes": {"POSITION": 0}, "indices": 1}]},
        ],
        "extensionsUsed": [*instances],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }

    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def of_trimesh(points: np.ndarray, faces: np.ndarray) -> bytes:
    """A scene of two parts, one of them twice, as trimesh writes it."""
    scene = trimesh.Scene()
    part = trimesh.Trimesh(points, faces, process=False)
    for number in range(3):
        matrix = trimesh.transformations.translation_matrix([number, 0, 0])
        scene.add_geometry(part, f"n{number}", geom_name=f"g{number % 2}", transform=matrix)
    data: bytes = scene.export(file_type="glb")
    return data


def own_dae(points: np.ndarray, faces: np.ndarray) -> bytes:
    """Nodes in nodes and in a library, a skin, a unit, several primitives."""
    source = SOURCE.replace('count="12"', f'count="{points.size}"')
    source = source.replace('count="4"', f'count="{len(points)}"')
    source = re.sub("(?<=>)[^<>]+(?=</float)", " ".join(map(str, points.ravel())), source)
    half = len(faces) // 2
    kinds = (("triangles", faces[:half], ""), ("polylist", faces[half:], "<vcount>{}</vcount>"))
    primitives = "".join(
        f'<{kind} count="{len(rows)}">{INPUT}{counts.format("3 " * len(rows))}'
        f"<p>{' '.join(map(str, rows.ravel()))}</p></{kind}>"
        for kind, rows, counts in kinds
    )
    matrix = "<matrix>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</matrix>"
    inner = f'<node id="b">{matrix}{HERE}</node>'
    skinned = '<node id="c"><instance_controller url="#k"/></node>'
    nodes = f'<node id="a">{MOVE}{HERE}{inner}<instance_node url="#n"/></node>{skinned}'
    bind = "<bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix>"
    skin = f'<controller id="k"><skin source="#g">{bind}</skin></controller>'
    more = f'<asset><unit meter="0.01"/></asset><library_controllers>{skin}</library_controllers>'
    scene = '<scene><instance_visual_scene url="#a"/></scene>'
    library = f'<node id="n">{HERE}</node>'
    data = dae(nodes.replace('id="a"', 'id="r"'), primitives, source, library, more)
    return data.replace(b"</COLLADA>", f"{scene}</COLLADA>".encode())


def own_threemf(points: np.ndarray, faces: np.ndarray) -> bytes:
    vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points)
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    inside = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    moved = '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 1 2 3"/>'
    more = object_of(2, components(1, 1))
    return threemf(more, f'<item objectid="1"/>{moved}', inside, compression=0)


def whole_files() -> dict[str, bytes]:
    """Files by a name with their suffix."""
    files: dict[str, bytes] = {}
    for number, (points, faces) in enumerate(meshes()):
        files |= {
            f"own{number}.glb": own_glb(points, faces),
            f"trimesh{number}.glb": of_trimesh(points, faces),
            f"own{number}.dae": own_dae(points, faces),
            f"pycollada{number}.dae": trimesh.Trimesh(points, faces).export(file_type="dae"),
            f"{number}.3mf": own_threemf(points, faces),
            f"{number}.ply": ply(points, faces, "<"),
            f"text{number}.ply": ply(points, faces),
            f"{number}.obj": obj(np.round(points, 3), faces),
            f"{number}.off": off(points, faces),
            f"{number}.stl": ascii_stl(points, faces),
        }
    for (name, part), make in CAMERAS.items():
        files[f"{part} {name}"] = make(3)
    colmap = "# Number of cameras: 4\n" + "".join(
        f"{i} PINHOLE 640 480 500 500 320 240\n" for i in range(1, 5)
    )
    return files | {"cameras.txt": colmap.encode()}


NAMED = {
    ".dae": rb"<[^>]+>",
    ".3mf": rb"<(?!vertex |triangle )[^>]+>",
    ".xml": rb"<[^>]+>",
    ".obj": rb"(?m)^\w+",
    ".stl": rb"(?m)^\s*[a-z]+",
    ".off": rb"\A[^\n]*\n[^\n]*",
    ".yaml": rb"(?m)^\s*\w+:",
    ".json": rb'"\w+"',
    ".gltf": rb'"\w+"',
    ".txt": rb"(?m)^\S+",
    ".out": rb"\A[^\n]*\n[^\n]*",
    ".ply": rb"(?s)\A.*?end_header",
}
"""Bytes of each format that hold its names; in a GLB it is the JSON, values as well."""


def places(name: str, data: bytes) -> np.ndarray:
    """Bytes of a file whose bits are flipped."""
    if name.endswith(".glb"):
        return np.arange(20, 20 + struct.unpack_from("<I", data, 12)[0])
    spans = [m.span() for m in re.finditer(NAMED[Path(name).suffix], data)]
    return np.concatenate([np.arange(a, b) for a, b in spans])


def outcome(path: Path, data: bytes) -> Outcome:
    """Outcome of reading a file."""
    path.write_bytes(data)
    is_mesh = path.suffix in (".glb", ".dae", ".3mf", ".ply", ".obj", ".off", ".stl")
    try:
        if is_mesh:
            mesh = Mesh.load(path)
            return "loaded", mesh.n_faces, frozenset(mesh.notes)
        views = rc.read_views(path, conventions=ANSWERS)
        n = len(views.poses) + (0 if views.rig is None else len(views.rig))
        return "loaded", n, frozenset(views.notes)
    except RastercovError as error:
        return ("refused" if str(error).isprintable() else "no line"), 0, frozenset()
    except Exception as error:
        return repr(error), 0, frozenset()


def attack(report: Report, effort: float) -> None:
    """Flip bits of names, one at a time."""
    rng = np.random.default_rng(6)
    files = whole_files()
    per_file = max(4, round(N_FLIPS * effort / len(files)))
    n_flips = n_loaded = 0
    lost: list[str] = []
    foreign: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            path = Path(folder) / name.rpartition(" ")[2]
            what, n_whole, notes = outcome(path, data)
            if what != "loaded" or not n_whole:
                foreign.append(f"{name}: the whole file is {what}")
            bits = np.ravel(places(name, data)[:, None] * 8 + np.arange(8))
            for bit in rng.permutation(bits)[:per_file].tolist():
                flipped = bytearray(data)
                flipped[bit // 8] ^= 1 << (bit % 8)
                what, n, its = outcome(path, bytes(flipped))
                n_flips += 1
                n_loaded += what == "loaded"
                where = f"{name}, bit {bit}: {bytes(flipped[bit // 8 - 20 : bit // 8 + 20])!r}"
                if what == "loaded" and n < n_whole and its <= notes:
                    lost.append(where)
                if what not in ("loaded", "refused"):
                    foreign.append(f"{where}: {what}")
    for line in (lost + foreign)[:20]:
        print(line)
    report.add("bits of names flipped", n_flips, "files")
    report.add("... of which load", n_loaded, "files")
    report.add("... with less, and no word", len(lost), "files", at_most=0)
    report.check("no bit of a name loses faces, poses or cameras without a word", not lost)
    report.check("no error but the library's own, of one line", not foreign)
