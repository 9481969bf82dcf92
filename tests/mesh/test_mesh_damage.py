"""One value of a file that is wrong: it is refused in one line, noted, or was of no matter."""

import json
import re
from itertools import islice

import numpy as np
import pytest
from mesh_files import POINTS, TEXT, VALID, Glb, places
from nightly import amount
from repeated_parts import (
    HERE,
    TRIANGLES,
    archive,
    components,
    dae,
    model,
    object_of,
)

from rastercov.base.errors import RastercovError

NO_NUMBERS = "x", "1_0", "0x1", "1d5", "1,5", "1.0.0", "--1", "1e", "e5", "½", "١", "+", "1e999"
"""Words that are no coordinate, or none that is finite, and no index; Python reads the second."""
BEYOND = "99", "-99", "1.0", "nan", "0b1", "99999999999999999999999"
"""Words that are no index either."""


WORDS = ("", *NO_NUMBERS, *BEYOND)
EACH = amount(3, at_night=1)
"""Of words in turn at each place, one in so many is tried."""
COORDINATES = "99", "-99", "1.0", "99999999999999999999999"


def fault(load, name, data, whole, *, is_right=False):
    """What is wrong about the answer to a file with another value; empty if it is refused or noted.

    The faces are those of the `whole` file, unless the value `is_right` for another shape.
    """
    try:
        mesh = load(name, data)
    except RastercovError as error:
        text = str(error)
        return "" if name in text and text.isprintable() and len(text) < 500 else f"says {text!r}"
    is_other = not np.array_equal(mesh.vertices[mesh.faces], whole.vertices[whole.faces])
    return "other faces, and no note" if is_other and not (is_right or mesh.notes) else ""


def damaged(text, pattern, words):
    """A text with each match of a pattern replaced by each of some words."""
    for match in re.finditer(pattern, text):
        for word in words:
            if word != match[0]:
                yield text[: match.start()] + word + text[match.end() :], word


@pytest.mark.slow
@pytest.mark.parametrize("name", TEXT)
def test_a_wrong_word_of_a_text_is_refused_noted_or_of_no_matter(name, load):
    text, whole = VALID[name].decode(), load(name, VALID[name])
    faults = {
        (content, result)
        for content, word in islice(damaged(text, r"\S+", WORDS), 0, None, EACH)
        if (result := fault(load, name, content.encode(), whole, is_right=word in COORDINATES))
    }
    assert not faults


WRONG = (..., None, -1, 1.5, True, "x", "1", [], {}, [7], {"x": 1}, [[1]], 10**30, 10**400, 99)


def full_scene():
    """A scene with entries of every kind that is read."""
    glb = Glb()
    glb.primitive.update(mode=4, targets=[{"POSITION": glb.accessor(np.zeros((4, 3)))}])
    glb.header["meshes"][0]["weights"] = [0.5]
    glb.header["accessors"][0]["normalized"] = False
    sparse = {"bufferView": glb.view(np.array([1], "<u2")), "componentType": 5123}
    values = {"bufferView": glb.view(POINTS[[1]].astype("<f4"))}
    glb.header["accessors"][0]["sparse"] = {"count": 1, "indices": sparse, "values": values}
    turned = {"rotation": [0.0, 0, 0, 1], "scale": [1.0, 1, 1], "translation": [0.0, 0, 0]}
    moved = {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": glb.accessor(np.ones((1, 3)))}}}
    glb.nodes({"mesh": 0, **turned, "extensions": moved}, {"matrix": np.eye(4).ravel().tolist()})
    glb.header["scenes"][0]["nodes"] = [1]
    glb.header["nodes"][1]["children"] = [0]
    glb.header.update(scene=0, asset={"version": "2.0"}, extensionsRequired=[])
    return glb


@pytest.mark.slow
def test_a_wrong_value_of_a_scene_is_refused_noted_or_of_no_matter(load):
    glb = full_scene()
    whole, text = load("a.glb", glb.data()), json.dumps(glb.header)
    assert whole.notes == ()
    faults = []
    for turn, path in enumerate(places(glb.header)):
        for value in amount(WRONG[turn % 2 :: 2], at_night=WRONG):  # half of them by day
            glb.header = json.loads(text)
            data = glb.put(path, value)
            is_right = not {*path[-2:]}.isdisjoint(MOVES)
            is_optional = isinstance(path[-1], int) or path in OPTIONAL or path[-1] in OPTIONAL
            is_right |= value is ... and is_optional
            result = fault(load, "a.glb", data, whole, is_right=is_right)
            faults += [(path, value, result)] if result else []
    assert not faults


MOVES = ("weights", "scale", "rotation", "translation", "matrix", "byteOffset")
"""Entries in which another number is another shape."""
OPTIONAL = (
    ("accessors", 0, "bufferView"),
    "nodes",
    "scenes",
    "scene",
    "extensions",
    "targets",
    "sparse",
    "children",
)
"""Entries without which a scene is another one; an accessor with a sparse part needs no view."""
XML = {
    "a.dae": (
        lambda text: text.encode(),
        dae(
            f"<node><scale>1 1 1</scale>{HERE}</node>", TRIANGLES, unit='<unit meter="1"/>'
        ).decode(),
    ),
    "a.3mf": (
        lambda text: archive(**{"3D/a.model": text}),
        model(
            object_of(2, components(1)), '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 0"/>'
        ),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", XML)
def test_a_wrong_value_of_xml_is_refused_noted_or_of_no_matter(name, load):
    make, text = XML[name]
    whole = load(name, make(text))
    pattern = r"(?<=[ >])-?\d[\d.]*(?=[ <])|(?<==\")[^\"]*(?=\")"
    faults = {
        (content, result)
        for content, word in damaged(text, pattern, ("", "x", "1_0", "99", "1e999"))
        if (result := fault(load, name, make(content), whole, is_right=word == "99"))
    }
    assert not faults
