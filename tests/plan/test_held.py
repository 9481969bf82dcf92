"""Plans whose matrix is of bits on disk: the cameras of lists, by face and on cells."""

from pathlib import Path

import numpy as np
import plans
import pytest
from plans import told
from union_greedy import room_candidates

import rastercov as rc
from rastercov.core.camera.conventions import write_poses
from rastercov.placement.plan import prepare as held_module
from rastercov.placement.select import methods as integer

BY_FACE = {"max_incidence_deg": 75, "by": "face", "min_pixels": 20}
FOUR = {"goal": "best_coverage", "cameras": 4}
POSES = {"generator": "poses", "file": "candidates.json"}
CAVITIES = {"candidates": [POSES, {"generator": "per_cavity", "views": 2}]}
PLAN = {
    "meshes": [{"path": "room.obj"}],
    "camera": {"width": 640, "height": 480, "fx": 350, "fy": 350},
    "task": BY_FACE,
    "candidates": [POSES],
    "selection": FOUR,
    "outputs": {"page": False},
}
KINDS = {
    "faces": {},
    "cells": {"task": {"max_incidence_deg": 75, "resolution_of_result": 0.5}},
    "cavities": CAVITIES,
}


@pytest.fixture(autouse=True)
def candidates(folder):
    write_poses("candidates.json", room_candidates(30))


@pytest.fixture
def listed(monkeypatch):
    """Set the number of pairs up to which a matrix is lists."""
    return lambda most: monkeypatch.setattr(held_module, "MOST_LISTED_PAIRS", most)


def placed(**sections):
    return plans.placed(PLAN, **sections)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_bits_choose_the_cameras_of_lists(listed, kind):
    items, held_as = [], []
    for most in (held_module.MOST_LISTED_PAIRS, 0):
        listed(most)
        items.append(placed(**KINDS[kind]))
        held_as.append(told()["matrix"]["held_as"])
    assert held_as == ["lists", "bits"]
    lists, bits = items
    np.testing.assert_array_equal(bits.selection.chosen, lists.selection.chosen)
    assert bits.selection.bound == lists.selection.bound
    assert bits.cameras.share == lists.cameras.share
    assert bits.prepared.pairs == lists.prepared.pairs
    assert len(bits.selection.chosen) > 1
    (said,) = [note for note in bits.prepared.notes if "of bits on disk" in note]
    assert [note for note in bits.prepared.notes if note != said] == [*lists.prepared.notes]
    if kind == "cavities":
        assert "visibility matrix of cavities" in bits.steps
        listed(lists.prepared.pairs - 1)  # the further matrix makes bits of the first
        both = placed(**CAVITIES)
        assert both.prepared.is_of_bits
        np.testing.assert_array_equal(both.selection.chosen, lists.selection.chosen)


@pytest.mark.slow
def test_an_angle_and_the_integer_program_take_lists_of_any_size(listed, monkeypatch):
    listed(0)
    monkeypatch.setattr(integer, "EFFORT", 10_000)
    angle = {"task": BY_FACE | {"views": 2, "min_angle_deg": 10}}
    program = {"selection": FOUR | {"method": "integer", "time_limit": 5}}
    for sections, words in ((angle, "task.min_angle_deg"), (program, "selection.method integer")):
        assert not placed(**sections).prepared.is_of_bits
        with monkeypatch.context() as patch:
            patch.setattr(held_module, "BYTES_A_PAIR", 1 << 50)
            with pytest.raises(rc.ResourceError, match=f"pairs, which {words} need") as error:
                placed(**sections)
        assert "\n" not in str(error.value)


def test_matrices_of_earlier_plans_go_and_bits_leave_no_file(listed):
    listed(0)
    made = []
    for pixels in (20, 30):
        placed(task=BY_FACE | {"min_pixels": pixels})
        (folder,) = Path("out/matrix").iterdir()
        made.append(folder)
    assert made[0] != made[1]
    kept = {path.name for path in folder.iterdir()}
    assert kept == {"header.json", "poses.npz", "scene.npz", "pairs", "sha256"}
