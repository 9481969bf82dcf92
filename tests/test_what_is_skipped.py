"""The end of a run says what was not tested, and why; and nothing that can be had is skipped."""

import os
import tomllib
from pathlib import Path

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


def test_what_the_tests_import_is_installed_with_them():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]

    def names(lines):
        return {line.partition(">")[0] for line in lines}

    for extra in ("place", "tables", "compare", "markers"):
        assert names(extras[extra]) <= names(extras["dev"]), extra
