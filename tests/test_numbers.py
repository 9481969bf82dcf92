"""Numbers of input files: of 400 digits, beyond 1e100, or not finite: one line, nothing else."""

import json
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lamp_files import area_lamp
from nightly import examples

import rastercov as rc
from rastercov.base.files import LARGEST_NUMBER, UnreadableError, parsed_json

LAMPS = area_lamp("5")
PLACES = list(re.finditer(r"(?<![\w.])\d[\w.-]*", LAMPS))
HUGE = ("9" * 400, "-" + "9" * 400, "1" + "0" * 400, "1.7e308", "-1.7e308")


@pytest.mark.parametrize("number", HUGE, ids=["nines", "minus", "power", "most", "least"])
def test_a_huge_number_at_any_place_of_a_file_is_refused_with_the_name_of_its_entry(
    number, tmp_path
):
    path = tmp_path / "lamps.toml"
    for place in PLACES:
        path.write_text(LAMPS[: place.start()] + number + LAMPS[place.end() :])
        with pytest.raises(rc.CameraError) as caught:
            rc.load_lamps(path)
        line = str(caught.value)
        assert line.isprintable()
        name = LAMPS[: place.start()].rpartition("\n")[2].partition(" ")[0]
        assert f"{name}: expected a number within ±1e+100, got " in line


@pytest.mark.parametrize("name", ["a.gltf", "a.json"])
def test_an_integer_that_python_does_not_read_is_one_line_without_advice_for_code(name, tmp_path):
    path = tmp_path / name
    path.write_text('{"asset": ' + "9" * 5000 + "}")
    with pytest.raises(rc.RastercovError, match="5000 digits") as caught:
        (rc.Mesh.load if name == "a.gltf" else rc.read_poses)(path)
    assert "sys." not in str(caught.value)


NUMBERS = st.integers(-(10**400), 10**400) | st.floats()
TREES = st.recursive(
    NUMBERS | st.booleans() | st.none() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=20,
)


def numbers_of(tree):
    if isinstance(tree, dict | list):
        inner = tree.values() if isinstance(tree, dict) else tree
        return [each for own in inner for each in numbers_of(own)]
    return [tree] if isinstance(tree, int | float) else []


@given(TREES)
@examples(200)
def test_a_file_is_read_exactly_if_no_finite_number_is_beyond_the_limit(tree):
    data = json.dumps(tree).encode()
    too_large = [
        each for each in numbers_of(tree)
        if (isinstance(each, int) or math.isfinite(each)) and abs(each) > LARGEST_NUMBER
    ]  # fmt: skip
    if too_large:
        with pytest.raises(UnreadableError, match="a number within") as caught:
            parsed_json(data)
        assert str(caught.value).isprintable()
    else:
        assert json.dumps(parsed_json(data)) == data.decode()


def test_a_huge_number_anywhere_in_a_gltf_is_one_line_and_no_warning(tmp_path):
    node = {"translation": [1, 2, 3], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    lights = {"lights": [{"type": "point", "intensity": 5, "range": 10, "color": [1, 1, 1]}]}
    owner = {"light": 0}
    node["extensions"] = {"KHR_lights_punctual": owner}
    scene = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node]}
    scene |= {
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": lights},
    }
    text, path = json.dumps(scene), tmp_path / "lights.gltf"
    path.write_text(text)
    assert len(rc.load_lamps(path)) == 1
    for place in re.finditer(r"(?<![\w.\"])\d+(?![\w.\"])", text):
        for number in (*HUGE, "1e200"):
            path.write_text(text[: place.start()] + number + text[place.end() :])
            with pytest.raises(rc.RastercovError) as caught:
                rc.load_lamps(path)
            line = str(caught.value)
            assert line.isprintable()
            assert re.search(
                r": [\w.]+: expected a number within ±1e\+100, got [^()]*; correct the file$", line
            )
