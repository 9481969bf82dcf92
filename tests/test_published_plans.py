"""Published models are those that their file names; the other rule on a known model."""

import hashlib
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import rastercov as rc

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
ENTRY = {"distance_rel": [0.8, 1.0], "hfov_deg": 80, "max_incidence_deg": 75}


@pytest.fixture
def plans(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("published_plans")


@pytest.fixture
def box(tmp_path):
    mesh, path = rc.shapes.box((2, 1, 1)), tmp_path / "box.obj"
    rows = ["v {} {} {}".format(*corner) for corner in mesh.vertices.tolist()]
    rows += ["f {} {} {}".format(*face) for face in (mesh.faces + 1).tolist()]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_model_that_is_missing_or_another_one_is_named(plans, tmp_path):
    (tmp_path / "repo").mkdir()
    for name in ("right", "other"):
        (tmp_path / "repo" / name).write_text(name)
    files = dict.fromkeys(("right", "other", "none"), hashlib.sha256(b"right").hexdigest())
    missing = []
    assert plans.found_in(tmp_path, "repo", files, missing) == [tmp_path / "repo" / "right"]
    assert missing == ["repo: other differs from the named version", "repo: none"]


def test_the_file_names_a_commit_and_a_checksum_of_everything(plans):
    known = tomllib.loads(plans.FILE.read_text(encoding="utf-8"))
    named = [entry["files"] for entry in known["sets"]]
    for entry in known["covers"]:
        named.append({name: digest for name, (_, digest) in entry["files"].items()})
    assert sum(map(len, named)) > 75
    assert all(len(digest) == 64 for files in named for digest in files.values())
    assert all(len(entry["commit"]) in (40, 64) for entry in (*known["sets"], *known["covers"]))


def test_covers_of_both_formats_are_compared_with_the_best_known_cost(plans, tmp_path):
    texts = {"OR-Library": "2 3 1 1 1\n2 1 2\n2 2 3\n", "GECCO": "2 3\n0\n2\n0 1\n1\n2\n1 2\n"}
    for name, text in texts.items():
        file = tmp_path / "repo" / name / "cover.txt"
        file.parent.mkdir(parents=True)
        file.write_text(text)
        digest = hashlib.sha256(text.encode()).hexdigest()
        entry = {"name": name, "format": name, "repository": "by/repo", "folder": name}
        for best, words in ((1, "in 1 of 1"), (0, "in 0 of 1; otherwise: cover 1 instead of 0")):
            files = {"files": {"cover.txt": (best, digest)}}
            line = plans.covers(plans.Report(), tmp_path, entry | files, [])
            assert line == f"Set covers of {name}: the best-known cost {words}."


@pytest.mark.parametrize("views", [1, 2])
def test_a_box_takes_a_view_of_each_side_by_either_rule(plans, box, views):
    plan = plans.planned("box", box, ENTRY | {"views": views})
    assert (plan.theirs, plan.their_share, plan.ours) == (6 * views, 1, 6 * views)
    assert plan.bound == 6 * views
    assert plan.is_better


def test_a_plan_with_a_number_of_cameras_is_bounded(plans, box):
    plan = plans.planned("box", box, ENTRY | {"cameras": 3})
    assert plan.is_better
    assert np.isclose([plan.share, plan.bound], 0.6).all()  # three of its four large sides
    assert plan.share <= plan.bound
