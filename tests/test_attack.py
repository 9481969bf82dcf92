"""The campaigns of benchmarks/attack.py, a small part of each: nothing may be wrong.

By day the dearest are imported alone: a test of the suite has the law of each.
"""

import sys
from pathlib import Path

import pytest
from nightly import nightly

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
# tests/test_threads.py runs all parts of the attack on threads.
CAMPAIGNS = sorted({path.stem for path in BENCHMARKS.glob("attack_*.py")} - {"attack_threads"})
EFFORT = 0.002
AT_NIGHT = {
    "attack_advice": "tests/area/test_zones.py",
    "attack_cones": "tests/area/test_cones.py",
    "attack_doors": "tests/test_doors.py",
    "attack_doubling": "tests/mesh/test_mesh_linear.py",
    "attack_edge_on": "tests/area/test_edge_on_area.py",
    "attack_exact": "tests/exact/test_exactness.py",
    "attack_frames": "tests/shards/test_frames_in_shards.py",
    "attack_inputs": "tests/camera_formats/test_hostile.py",
    "attack_instances": "tests/test_repeated_parts.py",
    "attack_lenses": "tests/area/test_lens_regions.py",
    "attack_light": "tests/light/test_light_cuts.py",
    "attack_links": "tests/test_links.py",
    "attack_matrix": "tests/placement/test_matrix.py",
    "attack_misuse": "tests/test_misuse.py",
    "attack_names": "tests/test_unknown_names.py",
    "attack_numbers": "tests/test_numbers.py",
    "attack_opengl": "tests/raster/test_coplanar.py",
    "attack_readers": "tests/mesh/test_mesh_damage.py",
    "attack_reasons": "tests/area/test_stages.py",
    "attack_reports": "tests/report/test_report_folder.py",
    "attack_signals": "tests/test_signals.py",
    "attack_texts": "tests/viewer/test_texts.py",
    "attack_viewer": "tests/viewer/test_connections.py",
}
"""The dearest, and where their law is tried by day."""


@pytest.mark.parametrize("name", AT_NIGHT)
def test_a_campaign_of_the_night_can_be_had_and_has_its_test_by_day(name, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    for module in ("rows", name):
        monkeypatch.delitem(sys.modules, module, raising=False)
    assert callable(__import__(name).attack)
    assert (BENCHMARKS.parent / AT_NIGHT[name]).exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(each, marks=nightly if each in AT_NIGHT else ()) for each in CAMPAIGNS],
)
def test_a_small_part_of_each_campaign_finds_nothing(name, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    for module in ("rows", name):
        monkeypatch.delitem(sys.modules, module, raising=False)
    campaign = __import__(name)
    from rows import Report

    report = Report()
    campaign.attack(report, EFFORT)
    assert report.rows
    assert report.failed == []
    figures = [row for row in report.rows if row["unit"] != "s"]  # tests run side by side
    assert [row["what"] for row in figures if row["holds"] is False] == []


def test_the_campaign_on_advice_reads_the_words_that_are_printed(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from attack_advice import Score, carry_out

    score = Score()
    carry_out(3, score)
    assert score.pieces > 3
    assert score.unread == score.short == score.fell == []
