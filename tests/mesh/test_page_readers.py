"""Readers of the page: what they accept Python reads alike; the rest is refused in a line."""

import base64
import json
import re
from itertools import product

import numpy as np
import pytest
from mesh_files import POINTS, TEXT, VALID, WRITERS, Glb, places
from nightly import amount
from page_in_node import NEEDS_NODE

from rastercov.base.errors import RastercovError

pytestmark = [NEEDS_NODE, pytest.mark.slow]
NAMES = [name for name in VALID if not name.endswith(".off")]
WORDS = ("", "x", "1_0", "0x1", "1,5", "--1", "1e", "½", "1e999", "99", "-99", "nan", "0", "-1")
WRONG = (..., None, -1, 1.5, True, "x", [], {}, [7], 10**30, 99, 0, 1)
QUADS = np.array([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 0.25, 0)], float)


def by_words(name):
    """The text with each of its words replaced by others."""
    text = VALID[name].decode()
    for match in re.finditer(r"\S+", text):
        for word in WORDS:
            if word != match[0]:
                yield (text[: match.start()] + word + text[match.end() :]).encode()


def by_bytes(name, rng):
    """The file with bits turned, bytes doubled, and cut short."""
    data = VALID[name]
    for _ in range(amount(250, at_night=5000)):
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


def files():
    rng = np.random.default_rng(11)
    for name in NAMES:
        yield name, VALID[name]
        if name in TEXT:
            yield from ((name, data) for data in by_words(name))
        yield from ((name, data) for data in by_bytes(name, rng))
    yield from (("a.glb", data) for data in scenes())
    for name in ("a.obj", "ascii.ply", "big.ply"):
        for faces in ([[0, 1, 2, 3]], [[0, 1, 2, 4, 3]], [[4, 0, 1, 2, 3]], [[0, 4, 1, 2, 3]]):
            yield name, WRITERS[name](QUADS, faces)


def test_what_the_page_accepts_python_reads_alike(node, load, tmp_path):
    every = list(files())
    path = tmp_path / "files.json"
    path.write_text(json.dumps([(name, base64.b64encode(data).decode()) for name, data in every]))
    found = node("readers.mjs", path)
    assert len(found) == len(every) > 2000
    accepted = refused = 0
    for (name, data), said in zip(every, found, strict=True):
        if "fault" in said:
            line = said["fault"]
            assert said["status"] == 400, line
            assert re.fullmatch(rf"{re.escape(name)}: .{{,290}}", line), line
            assert line.isprintable(), line
            refused += 1
            continue
        accepted += 1
        try:
            mesh = load(name, data)
        except RastercovError as error:
            pytest.fail(f"{name} is read by the page, and not by Python: {error}\n{data[:600]}")
        corners = np.array(said["corners"], float).reshape(-1, 3, 3)
        expected = mesh.vertices[mesh.faces]
        assert corners.shape == expected.shape, data[:600]
        if name == "a.glb":
            np.testing.assert_allclose(corners, expected, rtol=1e-12, atol=1e-300)
        else:
            np.testing.assert_array_equal(corners, expected, data[:600])
    assert accepted > 200
    assert refused > 200


def test_valid_files_of_all_formats_are_read_with_their_groups(node, load, tmp_path):
    every = [(name, VALID[name]) for name in NAMES]
    path = tmp_path / "files.json"
    path.write_text(json.dumps([(name, base64.b64encode(data).decode()) for name, data in every]))
    for (name, data), said in zip(every, node("readers.mjs", path), strict=True):
        mesh = load(name, data)
        corners = np.array(said["corners"], float).reshape(-1, 3, 3)
        np.testing.assert_array_equal(corners, mesh.vertices[mesh.faces])
        assert np.isin(corners, POINTS).all()
        assert said["groups"] == [group.name for group in mesh.groups]
