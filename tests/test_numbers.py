"""Numbers of input files: of 400 digits, beyond 1e100, or not finite: one line, nothing else."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.base.files import LARGEST_NUMBER, UnreadableError, parsed_json


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
