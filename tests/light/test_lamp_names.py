"""Misspelt names of scenes of which lamps are read."""

import json

import pytest
from test_unknown_names import SCENE_PLACES, assert_said

import rastercov as rc


def lamps_in(mesh, path):
    result = rc.load_lamps(path).to_json()
    return json.dumps(result, sort_keys=True)


@pytest.mark.parametrize("path", SCENE_PLACES, ids=lambda path: "/".join(map(str, path)))
def test_a_flipped_name_moves_no_lamp_unsaid(path, load, tmp_path):
    assert_said(path, lamps_in, load, tmp_path)
