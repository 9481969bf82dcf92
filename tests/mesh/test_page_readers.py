"""Readers of the page: STL, OBJ, PLY and OFF give the faces, groups, notes and errors of Python.

What they accept of GLB Python reads alike, and the rest is refused in a line.
"""

import base64
import json
import re
from itertools import product

import numpy as np
import pytest
from mesh_files import POINTS, TEXT, VALID, WRITERS, Glb, places, strips
from nightly import amount
from page_in_node import NEEDS_NODE, PAGE

from rastercov.base.errors import RastercovError

MODULE = PAGE / "readers.wasm"
pytestmark = [
    NEEDS_NODE,
    pytest.mark.slow,
    pytest.mark.skipif(not MODULE.exists(), reason="no readers.wasm; run: make wasm"),
]
ODD = {
    "empty.obj": b"", "blank.off": b"\n", "none.ply": b"ply\n", "points.obj": b"v 0 0 0\n",
    "utf16.obj": VALID["a.obj"].decode().encode("utf-16"),
    "mark.off": b"\xef\xbb\xbf" + VALID["a.off"],
    "dos.stl": VALID["ascii.stl"].replace(b"\n", b"\r\n"),
    "name.stl": VALID["ascii.stl"].replace(b"endfacet", b"ENDFACET a name"),
    "solids.stl": 2 * VALID["ascii.stl"], "pads.stl": VALID["ascii.stl"] + b"\0\x1a",
    "groups.obj": VALID["a.obj"] + b"g \x1b[31m\xff\xd7\x90\nf 1 2 3\no " + b"n" * 300
    + b"\nf 1 2 3\ng \nf 1 2 4",
    "twice.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\ng a\nf 1 2 3\ng a \\\n\nf -3 -2 -1\n"
    b"g a\xe2\x80\x8b\nf 1 3 2\nl 1 2\np 3",
    "weights.obj": b"v 0 0 0 2\nv 1 0 0 1\nv 0 1 0 .5\nf 1 2 3\nv 1 1 1\nb 1 2 3",
    "long.off": b"OFF 3 1\n" + b"0." + b"1" * 900 + b" 1e-320 2.5e-324\n1 0 0\n0 1e22 0\n3 0 1 2",
    "strips.ply": strips([[0, 1, 2, 3, 0, -1, 3, 2, 1, -1], [1, 2, 3]], ">"),
    "bent.off": b"OFF 4 1\n0 0 0\n1 0 0\n1 1 .3\n0 1 0\n4 0 1 2 3",
}  # fmt: skip
WORDS = ("", "x", "1_0", "0x1", "1,5", "--1", "1e", "½", "1e999", "99", "-99", "nan", "0", "-1")
WRONG = (..., None, -1, 1.5, True, "x", [], {}, [7], 10**30, 99, 0, 1)
QUADS = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 0.25, 0)], float)


def by_words(name):
    """The text with each of its words replaced by others."""
    text = VALID[name].decode()
    for match in re.finditer(r"\S+", text):
        for word in WORDS[match.start() % 3 :: amount(3, at_night=1)]:
            if word != match[0]:
                yield (text[: match.start()] + word + text[match.end() :]).encode()


def by_bytes(name, rng):
    """The file with bits turned, bytes doubled, and cut short."""
    data = VALID[name]
    for _ in range(amount(60, at_night=5000)):
        copy, at = bytearray(data), int(rng.integers(len(data)))
        match rng.integers(3):
            case 0:
                copy[at] ^= 1 << int(rng.integers(8))
            case 1:
                copy[at:at] = copy[at : at + 4]
            case _:
                del copy[at:]
        yield bytes(copy)


def scenes():
    """Scenes whose header has one entry less or of another value."""

    def whole():
        glb = Glb()
        glb.node.update(translation=[1.0, 2, 3], rotation=[0.0, 0, 0.6, 0.8], scale=[1.0, 2, 3])
        glb.primitive["mode"] = 4
        return glb

    skinned = whole()
    skinned.header["skins"] = [{"joints": [1]}]
    skinned.header["nodes"].append({"translation": [0, 0, 1]})
    skinned.primitive["attributes"] |= {
        "JOINTS_0": skinned.accessor(np.zeros((4, 4)), "<u1"),
        "WEIGHTS_0": skinned.accessor(np.tile([1.0, 0, 0, 0], (4, 1))),
    }
    yield skinned.put(("nodes", 0, "skin"), 0)
    paths = list(places(whole().header))
    for path, value in product(paths, WRONG):
        yield whole().put(path, value)
    for *path, name in [*paths, ("asset", "version")]:
        if isinstance(name, str):
            glb = whole()
            glb.header.setdefault("asset", {"version": "2.0"})
            glb.put((*path, name), ...)
            yield glb.put((*path, name[:2] + name[2:3].swapcase() + name[3:]), 1)


def files():
    rng = np.random.default_rng(11)
    yield from ODD.items()
    for name, data in VALID.items():
        yield name, data
        if name in TEXT:
            yield from ((name, data) for data in by_words(name))
        yield from ((name, data) for data in by_bytes(name, rng))
    for name, data in ODD.items():
        yield from ((name, data[: len(data) * part // 8]) for part in range(8))
    yield from (("a.glb", data) for data in scenes())
    for name in ("a.obj", "a.off", "ascii.ply", "big.ply"):
        for faces in ([[0, 1, 2, 3]], [[0, 1, 2, 4, 3]], [[4, 0, 1, 2, 3]], [[0, 4, 1, 2, 3]]):
            yield name, WRITERS[name](QUADS, faces)
        for n in (5, 9, 30, 80):
            angle = np.sort(rng.uniform(0, 2 * np.pi, n))
            star = rng.uniform(0.02, 1, n) * np.array([np.cos(angle), np.sin(angle), 0 * angle])
            yield name, WRITERS[name](star.T @ rng.normal(size=(3, 3)), [range(n)])
            yield name, WRITERS[name](rng.normal(size=(n, 3)) * (1, 1, 0.1), [range(n)])


@pytest.fixture
def in_page(node, tmp_path):
    """What the page says of files, an object for each."""

    def read(every):
        path = tmp_path / "files.json"
        path.write_text(json.dumps([(n, base64.b64encode(data).decode()) for n, data in every]))
        return node("readers.mjs", MODULE, path)

    return read


def of_python(load, name, data):
    """A mesh, or the line of its error, without the folder of the file."""
    try:
        return load(name, data)
    except RastercovError as error:
        return name + str(error).partition(name)[2]


def check_alike(mesh, said, data):
    """The page has the faces, groups and notes of Python."""
    corners = np.array(said["corners"], float).reshape(-1, 3, 3)
    np.testing.assert_array_equal(corners, mesh.vertices[mesh.faces], data[:600])
    assert said["groups"] == [group.name for group in mesh.groups], data[:600]
    assert said["groupOf"] == mesh.face_group.tolist(), data[:600]


def test_the_page_gives_faces_and_lines_of_python(in_page, load):
    every = [each for each in files() if each[0] != "a.glb"]
    assert len(every) > 700
    accepted = refused = 0
    for (name, data), said in zip(every, in_page(every), strict=True):
        mesh = of_python(load, name, data)
        if isinstance(mesh, str):
            assert said == {"fault": mesh, "status": 400}, data[:600]
            refused += 1
        else:
            assert "fault" not in said, (said, data[:600])
            check_alike(mesh, said, data)
            notes = [note.partition(f"{name}: ")[2] for note in mesh.notes]
            assert said["notes"] == notes, data[:600]
            accepted += 1
    assert accepted > 100
    assert refused > 400


def test_what_the_page_accepts_of_glb_python_reads_alike(in_page, load):
    every = [each for each in files() if each[0] == "a.glb"]
    accepted = refused = equal = 0
    for (name, data), said in zip(every, in_page(every), strict=True):
        if "fault" in said:
            equal += said["fault"] == of_python(load, name, data)
            line = said["fault"]
            assert said["status"] == 400, line
            assert re.fullmatch(rf"{re.escape(name)}: .{{,290}}", line), line
            assert line.isprintable(), line
            refused += 1
            continue
        accepted += 1
        mesh = of_python(load, name, data)
        assert not isinstance(mesh, str), f"read by the page, and not by Python: {mesh}"
        corners = np.array(said["corners"], float).reshape(-1, 3, 3)
        np.testing.assert_allclose(corners, mesh.vertices[mesh.faces], rtol=1e-12, atol=1e-300)
        assert said["groups"] == [group.name for group in mesh.groups]
    assert accepted > 30
    assert refused > 100
    assert equal > 0.6 * refused  # others name what Python finds later, or sooner


def test_valid_files_of_all_formats_are_read_with_their_groups(in_page, load):
    every = list(VALID.items())
    for (name, data), said in zip(every, in_page(every), strict=True):
        check_alike(load(name, data), said, data)
        assert np.isin(np.array(said["corners"], float), POINTS).all()
