"""The end of a run says what was not tested, and why; and nothing that can be had is skipped."""

import os
import tomllib
from pathlib import Path

import matters
import pytest
from processes import python

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_a_run_ends_with_its_skips(tmp_path):
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "test_some.py").write_text(
        "import pytest\n"
        "@pytest.mark.parametrize('n', range(4))\n"
        "def test_it(n):\n"
        "    if n:\n"
        "        pytest.skip('no such thing here')\n"
    )
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", "--rootdir", tmp_path)
    path = f"{ROOT}:{ROOT / 'tests' / 'support'}"
    run = python(*words, tmp_path, env={**os.environ, "PYTHONPATH": path})
    assert run.returncode == 0, run.stdout
    assert "not tested here: 3" in run.stdout
    assert "    3 no such thing here\n" in run.stdout


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("CHANGELOG.md", set()),
        ("docs/guide.md", {"docs"}),
        ("rastercov/page/session.py", {"page"}),
        ("tests/support/browser.py", {"page", "docs", "asbuilt"}),
        ("rastercov/core/area/zones.py", {"page"}),
        ("rastercov/asbuilt/edges.py", {"asbuilt"}),
        ("rastercov/gl/compute.py", {"opengl"}),
        ("reference/markers/detect.py", {"laboratory"}),
        ("rastercov/engine/area/region.cpp", set(matters.MATTERS)),
        ("rastercov/core/mesh/__init__.py", set(matters.MATTERS)),
    ],
)
def test_a_matter_is_due_where_its_files_or_what_they_import_changed(path, expected):
    assert {each for each in matters.MATTERS if matters.concerns(each, (path,))} == expected
    for folder in (each for folders in matters.MATTERS.values() for each in folders):
        assert (ROOT / folder).exists(), folder


@pytest.mark.parametrize(
    ("environment", "changed", "is_due"),
    [
        ({}, (), False),
        ({}, ("rastercov/page/session.py",), True),
        ({"CI_BASE": "no such commit"}, None, True),
        ({matters.NAMED: "1"}, (), True),
    ],
)
def test_without_a_change_matters_wait_for_the_night(monkeypatch, environment, changed, is_due):
    for name in ("CI_BASE", matters.NAMED):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(matters, "IS_NIGHTLY", False)
    if changed is None:
        assert matters.changed.__wrapped__() is None
    monkeypatch.setattr(matters, "changed", lambda: changed)
    assert matters.is_due.__wrapped__("page") is is_due


def test_a_module_of_a_matter_has_a_test_of_every_day(request):
    """Among all modules that this run collected."""
    items = request.session.items
    of_night = {item.path for item in items if matters.is_of_night(item)}
    assert of_night <= {item.path for item in items if not matters.is_of_night(item)}


def test_what_the_tests_import_is_installed_with_them():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def names(lines):
        return {line.partition(">")[0] for line in lines}

    for extra in ("place", "tables", "compare", "markers"):
        assert names(extras[extra]) <= names(extras["dev"]), extra
