"""Rules of rigs: kept where cameras are chosen, exchanged, named anew, written and read."""

import json

import numpy as np
import pytest

from rastercov.base.errors import CameraError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig, Views
from rastercov.core.camera.rule import All, AtLeast
from rastercov.core.camera.rule import Any as AnyOf
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.task import Task
from rastercov.formats.cameras import read_views
from rastercov.report.coverage_files import views_of, write_rig

WIDE = Camera(width=160, height=120, fx=90, fy=90)
LONG = Camera(width=240, height=240, fx=400, fy=400, cx=100, near=0.5, focus_range=(2, 6))
TALL = Camera(width=60, height=200, fx=120, fy=130)
CAMERAS = (WIDE, LONG, TALL)


def test_some_cameras_of_a_rig_keep_all_that_is_theirs():
    own, equipment = {"b": Task(max_incidence_deg=40)}, object()
    places = sphere_of_poses((0, 0, 0), 1.0, 3)
    rig = Rig(CAMERAS, [*"abc"], places, tasks=own, fixed=["c"], rule=All(min_baseline_deg=2))
    some = rig._equip("word", equipment)._only([1, 2])
    assert (some.cameras, some.names, some.tasks) == (CAMERAS[1:], ("b", "c"), own)
    assert np.array_equal(some.rig_from_camera, places[1:])
    assert (some.equipment, some.fixed, some.gates, some.rule) == (
        {"word": equipment},
        ("c",),
        {},
        AnyOf(),
    )
    assert rig._only([0, 1, 2]).gates == rig.gates
    assert rig._only([2]).fixed == ()  # of one that is alone, nothing else moves
    pair = Rig.of_several([Rig([WIDE]), rig], [*"xabc"])._only([1, 2, 3])
    assert (pair.gates, pair.tasks, pair.fixed) == (rig.gates, own, ("c",))
    views = Views(rig, Poses.of(places, camera=[0, 1, 2]), tuple("abc"))
    assert views.of_camera("b").rig.tasks == own
    assert views_of(rig, views.poses[[0, 1]]).rig.tasks == own


def test_another_lens_keeps_its_noise_in_pixels():
    pair = Rig([WIDE, LONG], [*"ab"], rule=All(max_uncertainty=1.0, noise_px={"a": 0.2, "b": 0.5}))
    both = Rig.of_several([Rig([TALL]), pair], [*"xab"])
    made = both._with_camera("b", LONG.resized(3))
    assert made.gates[1].noise == pytest.approx((0.2 / 90, 0.5 / 1200))
    assert both._with_camera("x", WIDE).gates == both.gates
    more = both._with_camera("y", WIDE)
    assert (more.names, more.cameras[-1], more.gates) == ((*"xaby",), WIDE, both.gates)
    assert np.array_equal(more.rig_from_camera[-1], np.eye(4))


@pytest.mark.parametrize(
    "rule",
    [
        All(max_uncertainty=1e-3, noise_px={"a": 0.2, "b": 0.5}, stripes=["b"]),
        All(min_baseline_deg=2),
        AtLeast(1, needs=["b"]),
    ],
)
def test_a_rig_by_other_names_is_written_with_its_rule(tmp_path, rule):
    pair = Rig([WIDE, LONG], [*"ab"], sphere_of_poses((0, 0, 0), 1.0, 2), rule=rule)
    placed = Rig.of_several([pair], ["head/a", "head/b"])
    assert (placed.gates, placed.is_one) == (pair.gates, True)
    poses = placed.poses(sphere_of_poses((0, 0, 0), 4.2, 3))
    write_rig(tmp_path / "poses.json", placed, poses)
    assert read_views(tmp_path / "poses.json").rig.gates == pair.gates


def test_a_rule_among_others_stays_where_its_cameras_are_all_that_is_left(tmp_path):
    pair = Rig([WIDE, LONG], [*"ab"], rule=All(min_baseline_deg=2))
    alone = Rig.of_several([Rig([TALL]), pair], [*"xab"])._only([1, 2])
    write_rig(tmp_path / "poses.json", alone, alone.poses(sphere_of_poses((0, 0, 0), 4.2, 3)))
    assert read_views(tmp_path / "poses.json").rig.gates == alone.gates == pair.gates


PAIR = {"cameras": ["a", "b"], "rule": "all"}


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (7, "to be a list of tables"),
        ([7], "cameras of each rig"),
        ([{"rule": "all"}], "cameras of each rig"),
        ([PAIR | {"cameras": "ab"}], "cameras of each rig"),
        ([PAIR | {"cameras": []}], "cameras of each rig"),
        ([PAIR | {"cameras": [["a"], "b"]}], "cameras of each rig"),
        ([PAIR | {"cameras": ["b", "a"]}], "cameras of each rig"),
        ([PAIR | {"cameras": ["c", "d"]}], "cameras of each rig"),
        ([PAIR, PAIR | {"cameras": ["b", "c"]}], "cameras of each rig"),
        ([PAIR | {"cameras": ["a"]}], "2 to 64 sensors"),
        ([PAIR | {"k": 2}], "rule any, at_least"),
        ([PAIR | {"rule": ["all"]}], "rule any, at_least"),
        ([PAIR | {"rule": "at_least", "k": 3}], "1 to 2"),
    ],
)
def test_rules_of_several_rigs_of_a_file_are_refused_in_one_line(tmp_path, tables, words):
    path = tmp_path / "rig.json"
    cameras = [{"name": name, **WIDE.to_json()} for name in "abc"]
    path.write_text(json.dumps({"cameras": cameras, "rigs": tables}))
    with pytest.raises(CameraError, match=words) as error:
        read_views(path)
    assert "\n" not in str(error.value)


def test_one_rule_and_rules_of_several_rigs_exclude_each_other(tmp_path):
    path = tmp_path / "rig.json"
    cameras = [{"name": name, **WIDE.to_json()} for name in "ab"]
    path.write_text(json.dumps({"cameras": cameras, "rigs": [PAIR], "rule": "all"}))
    with pytest.raises(CameraError, match="no rule beside it"):
        read_views(path)
