"""Lamps before bodies that move, in shards."""

import pytest
from test_frames_in_shards import (
    CAMERA,
    CAMERAS,
    PLACED,
    TASK,
    assert_kept,
    motion_of,
    same,
    small_shards,  # noqa: F401 # for every test
)
from timed import evaluate_over_time

import rastercov as rc

LAMPS = rc.Lamps(
    [rc.Lamp.point(intensity=100), rc.Lamp.spot(40, intensity=60)],
    rc.look_at([(0.9, 0.2, 1.6), (-0.3, -0.9, 1.2)], (0.45, 0, 0.1)),
)
HEADS = rc.Rig([CAMERA] * 2, ["left", "right"], rule=rc.All())


@pytest.mark.parametrize("scene", [(CAMERA, CAMERAS), (HEADS, PLACED)], ids=["cameras", "heads"])
def test_shards_have_the_figures_of_one_run_to_the_bit(tmp_path, scene):
    assert_kept(tmp_path, scene, {"lamps": LAMPS})


@pytest.mark.slow
def test_workers_make_the_shards_of_one_process(tmp_path):
    results = [
        evaluate_over_time(
            motion_of(), CAMERA, CAMERAS, TASK, lamps=LAMPS, shards=(tmp_path / name, workers)
        )
        for name, workers in (("alone", None), ("workers", rc.Workers(2)))
    ]
    same(*results)
