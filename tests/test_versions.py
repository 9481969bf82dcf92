"""Versions of packages: tested ones are installed, named and promised, and others are named."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import requires
from importlib.util import module_from_spec, spec_from_file_location
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from rastercov.base import versions

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ASKED = [*PROJECT["dependencies"], *chain(*PROJECT["optional-dependencies"].values())]
NAMES = sorted({re.match(r"[\w.-]+", each)[0] for each in ASKED})


def constraints(kind):
    words = [sys.executable, str(ROOT / ".ci" / "versions"), kind]
    lines = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    return dict(line.split("==") for line in lines if not line.startswith("#"))


@pytest.mark.parametrize("name", NAMES)
def test_there_is_a_tested_version_of_all_that_the_project_asks_for(name):
    tested = versions.tested_versions()[re.sub("[-_.]+", "-", name).lower()]
    for line in ASKED:
        if re.match(r"[\w.-]+", line)[0] == name and (least := re.search(r">=([\w.]+)", line)):
            assert versions._numbers(least[1]) <= versions._numbers(tested)


def test_constraints_are_names_and_versions_and_nothing_else():
    for line in versions.CONSTRAINTS.read_text(encoding="utf-8").splitlines():
        assert line.startswith("#") or re.fullmatch(r"[a-z0-9-]+==[\w.!]+", line)


def test_make_installs_by_the_constraints_alone():
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert len(re.findall(r"\$\(PIP\)", text)) == 1  # in PIP_INSTALL
    assert "PIP_INSTALL := $(PIP) install -c $(CONSTRAINTS)" in text


def test_the_oldest_versions_are_those_that_the_project_promises():
    oldest = constraints("oldest")
    for line in PROJECT["dependencies"]:
        name, least = re.match(r"([\w.-]+)>=([\w.]+)", line).groups()
        if (marker := Requirement(line).marker) is None or marker.evaluate():
            assert oldest[name.lower()] == least
    assert oldest["numpy"] == "1.26.4" if sys.platform != "win32" else "2"
    assert oldest["ruff"] == constraints("tested")["ruff"]  # a tool
    assert constraints("newest") == {}


@pytest.fixture
def other(monkeypatch):
    """Make a package seem to have another version."""
    version_of = versions.version_of

    def install(package, number):
        monkeypatch.setattr(
            versions, "version_of", lambda name: number if name == package else version_of(name)
        )

    return install


@pytest.mark.parametrize(
    ("number", "words"),
    [
        ("99.1", ["numpy 99.1 is newer than {}, the newest that was tested"]),
        ("1.26.3", ["numpy 1.26.3 is older than 1.26.4, the oldest that rastercov supports"]),
        ("1.26.4", []),
        ("2.0.2", []),
    ],
)
def test_a_version_outside_of_what_was_tested_is_named(other, number, words):
    tested = versions.tested_versions()["numpy"]
    other("numpy", number)
    items = [line for line in versions.untested_versions() if line.startswith("numpy ")]
    assert items == [line.format(tested) for line in words]


@pytest.mark.parametrize("system", ["linux", "darwin", "win32"])
def test_numpy_of_windows_counts_by_64_bits_and_older_ones_are_named_there_alone(
    monkeypatch, system
):
    numpy = [line for line in PROJECT["dependencies"] if line.startswith("numpy")]
    asked = [Requirement(line) for line in numpy]
    place = {"sys_platform": system}
    own = [each for each in asked if each.marker is None or each.marker.evaluate(place)]
    assert all("1.26.4" in each.specifier for each in own) == (system != "win32")
    monkeypatch.setattr(sys, "platform", system)
    spec = spec_from_file_location("of_a_system", versions.__file__)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    module.requires = lambda package: numpy
    module.version_of = lambda name: "1.26.4"
    words = "numpy 1.26.4 is older than 2, the oldest that rastercov supports"
    assert module.untested_versions() == [words] * (system == "win32")


def test_tools_of_developers_are_not_named(other):
    assert any(line.startswith("ruff") for line in requires("rastercov"))
    other("ruff", "999")
    assert not [line for line in versions.untested_versions() if line.startswith("ruff")]
