"""Mesh readers under attack: mutated files, cut files, long files.

Small valid files of every format are cut at every byte, flipped, and have their lines and numbers
changed. Nothing but the library's own errors may come out, and no cut file may load with fewer
or other faces than the whole one without a note. Then files of twice the size are timed. trimesh
reads the valid files, too.
"""

import json
import struct
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from rows import Report

from rastercov.base.errors import RastercovError
from rastercov.core.mesh import Mesh

N_MUTATED = 100_000
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.25, 1], [12, 10, 3]])
POLYGONS = [[0, 3, 2, 1], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4, 5], [0, 4, 1, 2, 3]]
TRIANGLES = np.array([p[:3] for p in POLYGONS])


# ---- valid files


def ascii_stl() -> bytes:
    facets = (
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in POINTS[TRIANGLES].tolist()
    )
    return f"solid part\n{''.join(facets)}endsolid part\n".encode()


def binary_stl() -> bytes:
    records = np.zeros(len(TRIANGLES), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = POINTS[TRIANGLES]
    return bytes(80) + struct.pack("<I", len(records)) + records.tobytes()


def obj(polygons: list[list[int]], more: tuple[str, ...] = ()) -> bytes:
    lines = ["# a part", "mtllib a.mtl", "o first"]
    lines += [f"v {x} {y} {z}" for x, y, z in POINTS.tolist()]
    lines += ["vn 0 0 1", "g side_a"]
    lines += [f"f {' '.join(f'{i + 1}//1' for i in p)}" for p in polygons[:3]]
    lines += ["g side_b", *more]
    lines += [f"f {' '.join(str(i + 1) for i in p)}" for p in polygons[3:]]
    return "\n".join([*lines, ""]).encode()


def off(polygons: list[list[int]]) -> bytes:
    lines = ["OFF", f"{len(POINTS)} {len(polygons)} 0"]
    lines += [f"{x} {y} {z}" for x, y, z in POINTS.tolist()]
    lines += [f"{len(p)} {' '.join(map(str, p))}" for p in polygons]
    return "\n".join([*lines, ""]).encode()


def ply(order: str, lists: list[list[int]], element: str = "face") -> bytes:
    name = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {name} 1.0\ncomment a part\nelement vertex {len(POINTS)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        f"element {element} {len(lists)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if not order:
        rows = [f"{x} {y} {z} 7" for x, y, z in POINTS.tolist()]
        rows += [f"{len(p)} {' '.join(map(str, p))}" for p in lists]
        return head + "\n".join([*rows, ""]).encode()
    body = b"".join(struct.pack(order + "fffB", *p, 7) for p in POINTS)
    return head + body + b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in lists)


def glb(n_nodes: int = 2, is_rich: bool = True) -> bytes:
    """Nodes of one mesh; if rich, with a morph target, sparse values and instances."""
    binary, views, accessors = b"", [], []

    def add(values: np.ndarray, kind: str, component: int, **more: object) -> int:
        nonlocal binary
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        binary += values.tobytes() + b"\0" * (-values.nbytes % 4)
        accessor = {"bufferView": len(views) - 1, "componentType": component, "type": kind}
        accessors.append({**accessor, "count": len(values), **more})
        return len(accessors) - 1

    position = add(POINTS.astype("<f4"), "VEC3", 5126)
    indices = add(TRIANGLES.ravel().astype("<u2"), "SCALAR", 5123)
    primitive: dict[str, object] = {"attributes": {"POSITION": position}, "indices": indices}
    nodes: list[dict[str, object]] = [
        {"mesh": 0, "name": f"n{i}", "rotation": [0, 0, 0.6, 0.8]} for i in range(n_nodes)
    ]
    if is_rich:
        where = add(np.array([1, 4], "<u2"), "SCALAR", 5123)
        delta = add(np.ones((2, 3), "<f4"), "VEC3", 5126)
        sparse = {
            "count": 2,
            "indices": {"bufferView": where, "componentType": 5123},
            "values": {"bufferView": delta},
        }
        accessors.append({"componentType": 5126, "type": "VEC3", "count": 6, "sparse": sparse})
        primitive["targets"] = [{"POSITION": len(accessors) - 1}]
        move = add(np.eye(3, dtype="<f4"), "VEC3", 5126)
        nodes[0]["weights"] = [0.5]
        nodes[1]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": move}}}
    header = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(n_nodes))}],
        "nodes": nodes, "meshes": [{"primitives": [primitive]}], "accessors": accessors,
        "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


VALID = {
    "ascii.stl": ascii_stl(),
    "binary.stl": binary_stl(),
    "a.obj": obj(POLYGONS, ("f -6 -5 \\", " -4 -3")),
    "a.off": off(POLYGONS),
    "ascii.ply": ply("", POLYGONS),
    "little.ply": ply("<", POLYGONS),
    "big.ply": ply(">", POLYGONS),
    "strips.ply": ply("<", [[0, 1, 2, 3, 4, -1, 1, 2, 4], [3, 4, 0]], "tristrips"),
    "strips_ascii.ply": ply("", [[0, 1, 2, 3, 4, -1, 1, 2, 4], [3, 4, 0]], "tristrips"),
    "a.glb": glb(),
    "plain.glb": glb(is_rich=False),
}
# trimesh 5 does not read larger polygons, strips or morph targets right.
TRIANGULAR = {
    "ascii.stl": VALID["ascii.stl"],
    "binary.stl": VALID["binary.stl"],
    "a.obj": obj(TRIANGLES.tolist()),
    "a.off": off(TRIANGLES.tolist()),
    "ascii.ply": ply("", TRIANGLES.tolist()),
    "little.ply": ply("<", TRIANGLES.tolist()),
    "big.ply": ply(">", TRIANGLES.tolist()),
    "plain.glb": VALID["plain.glb"],
}


# ---- attacks


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The file after one to three changes of bytes, lines or numbers."""
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        at = int(rng.integers(len(data)))
        kind = int(rng.integers(8))
        if kind == 0:  # a bit
            data = data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
        elif kind == 1:  # a byte
            data = data[:at] + rng.bytes(1) + data[at + 1 :]
        elif kind == 2:  # a piece lost
            data = data[:at] + data[at + int(rng.integers(1, 20)) :]
        elif kind == 3:  # a piece repeated
            data = data[:at] + data[max(0, at - int(rng.integers(1, 20))) :]
        elif kind == 4:  # the end lost
            data = data[:at]
        else:
            lines = data.split(b"\n")
            i = int(rng.integers(len(lines)))
            if kind == 5:
                lines[i:i] = lines[int(rng.integers(len(lines))) :][:1]
            elif kind == 6:
                del lines[i]
            else:
                words = lines[i].split(b" ")
                words[int(rng.integers(len(words)))] = NUMBERS[int(rng.integers(len(NUMBERS)))]
                lines[i] = b" ".join(words)
            data = b"\n".join(lines)
    return data


NUMBERS = [
    *(b"-1", b"0", b"3", b"7", b"255", b"65536", b"4294967295", b"2147483648", b"1e400", b"-1e308"),
    *(b"nan", b"inf", b"1_0", b"0x10", b"1d5", b"", b"99999999999999999999", b"1.5", b"1/2/x"),
]


def outcome(path: Path, data: bytes) -> tuple[str, bytes, bool]:
    """Outcome of loading: "loaded", "refused" or a foreign error; corners; whether noted."""
    path.write_bytes(data)
    try:
        mesh = Mesh.load(path)
    except RastercovError as error:
        return ("refused" if str(error).isprintable() else "no line"), b"", False
    except BaseException as error:
        return repr(error), b"", False
    return "loaded", mesh.vertices[mesh.faces].tobytes(), bool(mesh.notes)


def cuts(name: str, data: bytes, step: int) -> Iterator[bytes]:
    """The file cut at every `step` bytes; an OBJ that ends with a whole line is a whole OBJ."""
    for size in range(0, len(data), step):
        if not (name.endswith(".obj") and data[:size].endswith(b"\n")):
            yield data[:size]


def agrees_with_trimesh(path: Path, data: bytes) -> bool:
    """True if trimesh finds as many triangles, of the same total area."""
    path.write_bytes(data)
    ours, theirs = Mesh.load(path), trimesh.load(path, process=False, force="mesh")
    assert isinstance(theirs, trimesh.Trimesh)
    is_equal: bool = np.allclose(ours.areas.sum(), theirs.area, rtol=1e-5)
    return is_equal and ours.n_faces == len(theirs.faces)


# ---- long files


def long_files(n: int) -> dict[str, bytes]:
    """A file of about n items for each reader."""
    rng = np.random.default_rng(n)
    corners = rng.normal(size=(n, 3, 3)).astype("<f4")
    records = np.zeros(n, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = corners
    rows = [f"{x} {y} {z}" for x, y, z in corners.reshape(-1, 3).tolist()]
    lists = np.arange(3 * n).reshape(-1, 3).tolist()
    head = (
        f"ply\nformat {{}} 1.0\nelement vertex {3 * n}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {n}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(n, [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, lists
    angle = np.arange(n) * 2 * np.pi / n
    dented = (
        np.stack([np.cos(angle), np.sin(angle)], axis=1) * (1 - 0.4 * (np.arange(n) % 2))[:, None]
    )
    return {
        "STL": bytes(80) + struct.pack("<I", n) + records.tobytes(),
        "STL in text": "\n".join(
            ["solid a"]
            + [
                f"facet normal 0 0 0\nouter loop\nvertex {rows[a]}\nvertex {rows[b]}\n"
                f"vertex {rows[c]}\nendloop\nendfacet"
                for a, b, c in lists
            ]
            + ["endsolid a", ""]
        ).encode(),
        "OBJ": "\n".join(
            [f"v {row}" for row in rows]
            + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in lists]
            + [""]
        ).encode(),
        "OBJ of continued lines": (
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt" + b" 1 \\\n" * 30 * n + b"\nf 1 2 3\n"
        ),
        "OBJ of one concave polygon": "\n".join(
            [f"v {x} {y} 0" for x, y in dented] + [f"f {' '.join(map(str, range(1, n + 1)))}", ""]
        ).encode(),
        "OFF": "\n".join(
            ["OFF", f"{3 * n} {n} 0", *rows, *(f"3 {a} {b} {c}" for a, b, c in lists), ""]
        ).encode(),
        "PLY": head.format("binary_little_endian").encode() + corners.tobytes() + faces.tobytes(),
        "PLY in text": (
            head.format("ascii") + "\n".join([*rows, *(f"3 {a} {b} {c}" for a, b, c in lists), ""])
        ).encode(),
        "GLB": glb(max(2, n // 10), is_rich=False),
    }  # fmt: skip


EXTENSIONS = {"STL": "stl", "OBJ": "obj", "OFF": "off", "PLY": "ply", "GLB": "glb"}


def seconds(path: Path, data: bytes, repeats: int) -> float:
    """Shortest process time of loading."""
    path.write_bytes(data)
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        Mesh.load(path)
        best = min(best, time.process_time() - start)
    return best


def attack(report: Report, effort: float) -> None:
    """Mutated, cut and long files of every format."""
    rng = np.random.default_rng(20)
    step = 1 if effort >= 0.01 else 7
    foreign: list[str] = []
    n_cut = n_cut_loaded = n_lost = n_mutated = n_loaded = 0
    with tempfile.TemporaryDirectory() as folder:
        for name, data in VALID.items():
            path = Path(folder) / name
            what, whole, _ = outcome(path, data)
            report.check(f"{name}: the whole file loads", what == "loaded" and whole != b"")
            if name in TRIANGULAR:
                same = agrees_with_trimesh(path, TRIANGULAR[name])
                report.check(f"{name}: triangles as trimesh reads them", same)
            for piece in cuts(name, data, step):
                what, corners, is_noted = outcome(path, piece)
                n_cut += 1
                n_cut_loaded += what == "loaded"
                n_lost += what == "loaded" and corners != whole and not is_noted
                if what not in ("loaded", "refused"):
                    foreign.append(f"{name}: {what}")
            for _ in range(round(effort * N_MUTATED / len(VALID))):
                what, _, _ = outcome(path, mutated(data, rng))
                n_mutated += 1
                n_loaded += what == "loaded"
                if what not in ("loaded", "refused"):
                    foreign.append(f"{name}: {what}")
        report.add("files cut at a byte", n_cut, "files")
        report.add("... of which load", n_cut_loaded, "files")
        report.add("files changed at random", n_mutated, "files")
        report.add("... of which load", n_loaded, "files")
        report.check("no error but the library's own, of one line", not foreign)
        report.check("no cut file loads with fewer or other faces and no note", n_lost == 0)
        for line in foreign[:5]:
            print(line)
        n = max(2000, round(20_000 * effort))
        once, twice = long_files(n), long_files(2 * n)
        for name in once:
            path = Path(folder) / f"long.{EXTENSIONS[name[:3]]}"
            first, second = (seconds(path, files[name], 4) for files in (once, twice))
            growth = len(twice[name]) / len(once[name])
            report.add(f"{name}: {len(twice[name]) / 1e6:.1f} MB", second, "s")
            report.add(
                f"{name}: time by size, file doubled", second / first / growth, "", at_most=1.5
            )
