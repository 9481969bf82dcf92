"""The end of a run says what was not tested, and why; and nothing that can be had is skipped."""

import os
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import python
from skips import reasons_of

ROOT = Path(__file__).parents[1]


def skipped(reason, line=1):
    return SimpleNamespace(longrepr=("tests/test_one.py", line, reason))


def test_skips_are_counted_by_reason():
    reports = [skipped("Skipped: no GPU", line) for line in range(3)]
    reports += [skipped("Skipped: no\n mesh"), skipped("no mesh")]
    assert reasons_of(reports) == [("no GPU", 3), ("no mesh", 2)]
    assert reasons_of([]) == []


@pytest.mark.slow
def test_a_run_ends_with_its_skips(tmp_path):
    for name in ("conftest.py", "support/notices.py", "support/skips.py"):
        (tmp_path / Path(name).name).write_text((ROOT / "tests" / name).read_text())
    (tmp_path / "test_some.py").write_text(
        "import pytest\n"
        "@pytest.mark.parametrize('n', range(4))\n"
        "def test_it(n):\n"
        "    if n:\n"
        "        pytest.skip('no such thing here')\n"
    )
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "2", "--rootdir", tmp_path)
    run = python(*words, tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert run.returncode == 0, run.stdout
    assert "not tested here: 3" in run.stdout
    assert "    3 no such thing here\n" in run.stdout


def test_what_the_tests_import_is_installed_with_them():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def names(lines):
        return {line.partition(">")[0] for line in lines}

    for extra in ("place", "models", "markers"):
        assert names(extras[extra]) <= names(extras["dev"]), extra


@pytest.mark.parametrize("module", ["pymoo", "highspy", "cv2", "embreex", "trimesh"])
def test_optional_packages_are_here_where_the_tests_run(module):
    __import__(module)
