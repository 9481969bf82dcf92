"""Benchmarks print figures in one form; with --json nothing but one list of rows."""

import ast
import json
import sys
from importlib import import_module
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
PICTURES = {"report_pictures", "viewer_pictures"}
"""Programs that draw, without figures."""
PROGRAMS = {
    path.stem: ast.parse(path.read_text(encoding="utf-8"))
    for path in sorted(BENCHMARKS.glob("*.py"))
    if "__main__" in path.read_text(encoding="utf-8") and path.stem not in PICTURES
}
ROW = {"what", "value", "unit", "must", "aim", "holds"}


def calls(tree, name):
    """Calls of a function or method of a name, as text."""
    every = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [ast.unparse(each) for each in every if ast.unparse(each.func).split(".")[-1] == name]


@pytest.mark.parametrize("name", PROGRAMS)
def test_every_program_ends_with_its_rows(name):
    """Only `rows.arguments` makes the option, and what it makes ends in `Report.finish`."""
    tree = PROGRAMS[name]
    assert calls(tree, "arguments") or calls(tree, "_arguments")
    assert not [each for each in calls(tree, "add_argument") if "--json" in each]
    assert not calls(tree, "ArgumentParser")
    (main,) = (node for node in tree.body if getattr(node, "name", "") == "main")
    assert "json" in calls(main, "finish")[-1]


@pytest.fixture
def rows(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr(sys, "stdout", sys.stdout)  # which --json changes
    return import_module("rows")


@pytest.mark.parametrize("passed", [True, False])
def test_json_is_one_list_of_rows_whatever_is_printed(rows, monkeypatch, capsys, passed):
    monkeypatch.setattr(sys, "argv", ["any.py", "--json"])
    args = rows.arguments("words").parse_args()
    report = rows.Report()
    print("a table")
    report.add("time", 2.0, "s", at_most=1.0)
    report.check("answer", passed)
    with pytest.raises(SystemExit) as ended:
        report.finish(args.json)
    assert ended.value.code == (0 if passed else 1)
    out, err = capsys.readouterr()
    content = json.loads(out)
    assert [set(row) for row in content] == [ROW] * 2
    assert [row["holds"] for row in content] == [False, passed]
    assert "a table" in err
    assert ("error: answer: wrong" in err) is not passed


@pytest.mark.parametrize("is_explained", [True, False])
def test_truth_prints_rows_of_its_comparisons(rows, monkeypatch, capsys, is_explained):
    truth = import_module("truth")
    area, index = truth.Compared("area", "m²"), truth.Compared("faces", "")
    area.add([1.0, 2.0], [1.0, 2.0 if is_explained else 3.0], 0.1)
    index.add([1], [1], 0)
    index.largest = float("nan")
    one = truth.Comparison("program", None, lambda effort: [area, index])
    monkeypatch.setattr(truth, "comparisons", lambda: [one])
    monkeypatch.setattr(sys, "argv", ["truth.py", "--json"])
    with pytest.raises(SystemExit) as ended:
        truth.main()
    assert ended.value.code == (0 if is_explained else 1)
    content = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert {set(row) == ROW for row in content} == {True}
    assert [row["value"] for row in content] == [2, 0.0, float(is_explained), 1, 1.0]
    assert all(row["what"].startswith("program: ") for row in content)


@pytest.mark.parametrize("wrong", [0, 2])
def test_a_count_of_what_is_wrong_is_a_check(rows, wrong, capsys):
    report = rows.Report()
    report.add("files that are wrong", wrong, "files", at_most=0)
    with pytest.raises(SystemExit) as ended:
        report.finish(as_json=False)
    assert ended.value.code == bool(wrong)
    assert ("error: files that are wrong: wrong" in capsys.readouterr().err) == bool(wrong)
