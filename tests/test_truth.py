"""benchmarks/truth.py: differences need a reason; programs that are installed here agree."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
HERE = ("IfcOpenShell", "exact fractions", "OpenCV")
"""Programs that the tests need anyway."""


@pytest.fixture
def truth(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("truth")


def test_a_difference_beyond_both_bounds_needs_a_reason(truth):
    compared = truth.Compared("area", "m²")
    beyond = compared.add([1.0, 2.0, np.nan], [1.0, 2.1, 1.0], [0.0, 0.05, 9.0])
    assert beyond.tolist() == [False, True, True]
    assert (compared.figures, compared.beyond, compared.largest) == (3, 2, 0.0)
    assert not compared.is_explained
    compared.explain("rounding", 2)
    assert compared.is_explained
    assert truth.row("tool 1", compared) == "| tool 1 | area | 3 | 0 | 2: rounding |"
    compared.faults.append("face 7")
    assert not compared.is_explained


def test_a_missing_program_is_named(truth, monkeypatch, capsys):
    none = truth.Comparison("Nothing", "no-such-package-at-all", lambda effort: [])
    monkeypatch.setattr(truth, "comparisons", lambda: [none])
    monkeypatch.setattr(sys, "argv", ["truth.py"])
    with pytest.raises(SystemExit) as ended:
        truth.main()
    assert ended.value.code == 0
    assert "not installed: Nothing (pip install no-such-package-at-all)" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", HERE)
def test_programs_that_are_here_agree(truth, name):
    (each,) = (each for each in truth.comparisons() if each.name == name)
    for compared in each.run(0.005):
        assert compared.figures > 8
        assert compared.faults == []
        assert compared.is_explained


@pytest.mark.slow
def test_points_and_pixels_of_embree_agree(truth):
    if find_spec("embreex") is None:
        pytest.skip("embreex is missing: pip install 'rastercov[bench]'")
    (each,) = (each for each in truth.comparisons() if each.name == "Embree")
    shares, images = each.run(0.001)
    assert shares.figures >= 20
    assert images.figures == 640 * 512
    assert shares.is_explained
    assert images.is_explained


def test_a_page_keeps_the_rows_of_programs_that_did_not_run(truth, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "| program | figures |\n| A 1 | areas | 1,000 | 0 | 0 |\n| B 1 | x | 5 | 0 | 0 |\n"
    )
    table = truth.table(page, ["A", "B", "C"], {"B": ["| B 2 | x | 7 | 0 | 0 |"]})
    assert table.splitlines()[0] == "1,007 figures."
    assert table.splitlines()[-2:] == ["| A 1 | areas | 1,000 | 0 | 0 |", "| B 2 | x | 7 | 0 | 0 |"]
