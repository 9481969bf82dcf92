"""Files of a result follow from their entries: report, option, help, docs, and what is replaced."""

import itertools
import re
from pathlib import Path

import pytest

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.report.coverage import EVALUATION, Options, run
from rastercov.report.result_files import FILES, OUTPUT_HELP, files_of

MESH, CAMERA = rc.shapes.box((1, 1, 1)), rc.Camera(width=48, height=36, fx=60, fy=60)
POSES = rc.look_at([(0, 0, 3), (3, 0, 0)], (0, 0, 0))
WORDS = [each.word for each in FILES]
SETS = [words for n in range(len(WORDS) + 1) for words in itertools.combinations(WORDS, n)]
DOCS = Path(rc.__file__).parents[1] / "docs" / "reports.md"


@pytest.mark.parametrize("table", ["none", "covered"])
@pytest.mark.parametrize("by", ["area", "face"])
@pytest.mark.parametrize("words", SETS)
def test_a_report_has_what_its_words_name_and_nothing_of_an_earlier_one(tmp_path, by, table, words):
    options = Options(pictures=0, by=by, table=table, output=words)
    is_refused = by == "face" and any(each.is_by_area for each in FILES if each.word in words)
    old = Options(pictures=0, table="covered", output=WORDS)
    run(MESH, CAMERA, POSES, rc.Task(), tmp_path, old)
    before = {each.name for each in tmp_path.iterdir()}
    assert {each.name for each in FILES} <= before
    if is_refused:
        with pytest.raises(ConfigError, match=r"^--output \w+: expected a result by area"):
            run(MESH, CAMERA, POSES, rc.Task(), tmp_path, options)
        assert {each.name for each in tmp_path.iterdir()} == before
        return
    run(MESH, CAMERA, POSES, rc.Task(), tmp_path, options)
    usual = [
        each.word
        for each in FILES
        if each.is_usual
        and (by == "area" or not each.is_by_area)
        and (table != "none" or not each.is_table)
    ]
    wanted = {each.name for each in FILES if each.word in (words or usual)}
    more = {"summary.json", EVALUATION.manifest, *(["coverage.parquet"] if table != "none" else [])}
    assert {each.name for each in tmp_path.iterdir()} == wanted | more


@pytest.mark.parametrize("words", [["rog"], ["rig", ""], ["Rig"], ["rig.json"]])
def test_a_word_of_no_file_is_refused(words):
    with pytest.raises(ConfigError, match="expected output to be areas"):
        files_of(words, by_area=True, has_tables=True)


def test_tables_need_pyarrow_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr("rastercov.report.coverage.has_parquet", lambda: False)
    with pytest.raises(ConfigError, match=r"^--output: expected pyarrow"):
        run(MESH, CAMERA, POSES, rc.Task(), tmp_path, Options(pictures=0, output=["areas"]))


def test_help_names_and_docs_follow_from_the_entries():
    assert len(set(WORDS)) == len(WORDS)
    for each in FILES:
        assert f"{each.word} ({each.content})" in OUTPUT_HELP
        assert EVALUATION.files.fullmatch(each.name)
        assert not EVALUATION.files.fullmatch(each.name.replace(".", "x"))
    if DOCS.is_file():
        rows = re.findall(r"^\| `(\S+?)`", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
        assert {each.name for each in FILES} <= set(rows)
