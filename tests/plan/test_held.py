"""Plans whose matrix is bits on the disk: the cameras of lists, by face and on cells."""

from pathlib import Path

import numpy as np
import pytest
from union_greedy import room_candidates

from rastercov.base.errors import ResourceError
from rastercov.camera.pose_file import write_poses
from rastercov.placement.plan import prepare as held_module
from rastercov.placement.plan.file import read_plan
from rastercov.placement.plan.run import place
from rastercov.placement.select import integer
from rastercov.report import plan as report

PLAN = """
[[meshes]]
path = "room.obj"
[camera]
width = 640
height = 480
fx = 350
fy = 350
[task]
max_incidence_deg = 75
resolution_of_result = 0.5
[[candidates]]
generator = "poses"
file = "candidates.json"
[selection]
goal = "best_coverage"
cameras = 4
[outputs]
page = false
"""
BY_FACE = PLAN.replace("resolution_of_result = 0.5", 'by = "face"\nmin_pixels = 20')
CAVITIES = BY_FACE.replace(
    "[selection]", '[[candidates]]\ngenerator = "per_cavity"\nviews = 2\n[selection]'
)


@pytest.fixture(autouse=True)
def candidates(folder):
    write_poses("candidates.json", room_candidates(30))


def placed(text, out):
    Path("plan.toml").write_text(text)
    return place(read_plan("plan.toml"), Path(out))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["faces", "cells", "cavities"])
def test_bits_choose_the_cameras_of_lists(monkeypatch, kind):
    text = {"faces": BY_FACE, "cells": PLAN, "cavities": CAVITIES}[kind]
    lists = placed(text, "lists")
    monkeypatch.setattr(held_module, "MOST_LISTED_PAIRS", 0)
    bits = placed(text, "bits")
    assert (lists.prepared.is_of_bits, bits.prepared.is_of_bits) == (False, True)
    np.testing.assert_array_equal(bits.selection.chosen, lists.selection.chosen)
    assert bits.selection.bound == lists.selection.bound
    assert bits.cameras.share == lists.cameras.share
    assert bits.prepared.least_share == lists.prepared.least_share
    assert bits.prepared.pairs == lists.prepared.pairs
    assert len(bits.selection.chosen) > 1
    if kind == "cells":
        strict = [found.prepared.stricter(0.95).problem for found in (lists, bits)]
        for row in range(len(bits.prepared.pool.candidates)):
            one, other, half = (p.faces_of(row) for p in (*strict, bits.prepared.problem))
            np.testing.assert_array_equal(one, other)
            assert len(one) < len(half)
    if kind == "cavities":
        assert "visibility matrix of cavities" in bits.steps
    said = [note for note in bits.prepared.notes if "bits on the disk" in note]
    assert len(said) == 1
    assert [note for note in bits.prepared.notes if note not in said] == [*lists.prepared.notes]
    for found, words in ((lists, "lists"), (bits, "bits")):
        assert report.summary(found)["matrix"]["held_as"] == words


@pytest.mark.slow
def test_a_further_matrix_may_make_the_first_one_bits(monkeypatch):
    lists = placed(CAVITIES, "lists")
    monkeypatch.setattr(held_module, "MOST_LISTED_PAIRS", lists.prepared.pairs - 1)
    bits = placed(CAVITIES, "lists")
    assert bits.prepared.is_of_bits
    np.testing.assert_array_equal(bits.selection.chosen, lists.selection.chosen)


@pytest.mark.slow
def test_an_angle_and_the_integer_program_take_lists_of_any_size(monkeypatch):
    monkeypatch.setattr(held_module, "MOST_LISTED_PAIRS", 0)
    angle = BY_FACE.replace("min_pixels = 20", "min_pixels = 20\nviews = 2\nmin_angle_deg = 10")
    program = BY_FACE.replace("cameras = 4", 'cameras = 4\nmethod = "integer"\ntime_limit = 5')
    monkeypatch.setattr(integer, "EFFORT", 10_000)
    for text, words in ((angle, "task.min_angle_deg"), (program, "selection.method integer")):
        assert not placed(text, "out").prepared.is_of_bits
        with monkeypatch.context() as patch:
            patch.setattr(held_module, "BYTES_A_PAIR", 1 << 50)
            with pytest.raises(ResourceError, match=f"pairs, which {words} need") as error:
                placed(text, "out")
        assert "\n" not in str(error.value)


def test_matrices_of_earlier_plans_go_with_their_bits(monkeypatch):
    monkeypatch.setattr(held_module, "MOST_LISTED_PAIRS", 0)
    placed(BY_FACE, "out")
    before = {path.name for path in Path("out/matrix").iterdir()}
    placed(BY_FACE.replace("min_pixels = 20", "min_pixels = 30"), "out")
    after = {path.name for path in Path("out/matrix").iterdir()}
    assert len(before) == len(after) == 1
    assert before != after
    assert list(Path("out").rglob("covered-*.words"))
