"""The viewer draws a camera that a plan has kept with dashed edges."""

import json

import numpy as np
import pytest
from page_in_node import NEEDS_NODE
from page_in_node import node as node

from rastercov.core.camera import KEPT, names_by_origin
from rastercov.core.camera.rig import short_names


@NEEDS_NODE
@pytest.mark.every_day
def test_edges_of_a_kept_camera_are_dashes_of_half_their_length(node):
    """Edges from the camera to its image: four dashes each in place of a line."""
    kept, other = names_by_origin(["existing 0", "walls 2"])
    seen = {each["name"]: each for each in node("pyramids.mjs", json.dumps([kept, other]))}
    assert kept.endswith(KEPT)
    np.testing.assert_allclose(2 * seen[kept]["length"], seen[other]["length"], rtol=1e-9)
    # Each edge is drawn twice, in a colour and in one around it.
    assert seen[kept]["lines"] - seen[other]["lines"] == 2 * 4 * 3


@pytest.mark.parametrize("n", [0, 1, 3])
def test_names_say_which_cameras_were_kept(n):
    origins = ["existing 0 (moved)", "per_face 3", "existing 12"][:n]
    names = names_by_origin(origins)
    assert [name.endswith(KEPT) for name in names] == [o.startswith("existing") for o in origins]
    assert short_names(names) == [name.removeprefix("camera ") for name in names]
    assert names_by_origin(["walls 1"] * n) == ()
