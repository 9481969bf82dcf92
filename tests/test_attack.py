"""The campaigns of benchmarks/attack.py, a small part of each: nothing may be wrong."""

import sys
from pathlib import Path

import pytest
from coarse_pictures import coarse_pictures  # noqa: F401 # a fixture for every test

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
# tests/test_threads.py runs all parts of the attack on threads.
CAMPAIGNS = sorted({path.stem for path in BENCHMARKS.glob("attack_*.py")} - {"attack_threads"})
EFFORT = 0.002


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMPAIGNS)
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
