"""A generator is an entry of plans, with its errors, its schema and its candidates."""

import numpy as np
import pytest

import rastercov as rc

PLAN = {
    "meshes": [{"built_in": "box"}],
    "camera": {"width": 64, "height": 48, "hfov_deg": 60},
    "selection": {"goal": "best_coverage", "cameras": 2},
}


def plan(**entries):
    """The plan with a ring."""
    return PLAN | {"candidates": [{"generator": "ring", **entries}]}


def check(command, folder):
    """Placed cameras are on the ring."""
    cameras = rc.place(plan(count=6, radius=3, height=1)).cameras
    eyes = cameras.placed.world_from_camera[:, :3, 3] - rc.shapes.box().bounds.mean(axis=0)
    assert np.allclose(np.hypot(eyes[:, 0], eyes[:, 1]), 3)
    assert np.allclose(eyes[:, 2], 1)
    with pytest.raises(rc.ConfigError, match="radius"):
        rc.place(plan(count=6, radius=-3))
    assert '"ring"' in command("place --schema")
