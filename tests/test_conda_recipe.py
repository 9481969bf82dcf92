"""The recipe for conda and the addresses of the project agree with `pyproject.toml`."""

import importlib.machinery
import importlib.util
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.markers import Marker
from packaging.requirements import Requirement

import rastercov

ROOT = Path(__file__).parents[1]
RECIPE = ROOT / "packaging" / "conda" / "recipe.yaml"
CHECK = ROOT / ".ci" / "addresses"
pytestmark = pytest.mark.skipif(not RECIPE.is_file(), reason="a wheel has no recipe")
RENAMED: dict[str, str] = {}
"""Packages whose name in conda-forge differs from that in PyPI: none of ours does."""


CONDITIONS = {
    "sys_platform == 'win32'": "win",
    "sys_platform == 'linux' and platform_machine == 'x86_64' or platform_machine == 'AMD64'"
    " or sys_platform == 'darwin' and platform_machine == 'arm64'": (
        "linux and x86_64 or win and x86_64 or osx and arm64"
    ),
}
"""Conditions of the recipe, by the markers that say the same."""


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def recipe():
    return yaml.safe_load(RECIPE.read_text(encoding="utf-8"))


def of_conda(text):
    """A requirement of Python as an entry of the recipe, with the condition of its marker."""
    requirement = Requirement(text)
    ranges = sorted(str(requirement.specifier).split(","), reverse=True)
    entry = f"{RENAMED.get(requirement.name, requirement.name)} {','.join(ranges)}"
    if requirement.marker is None:
        return entry
    (when,) = (own for each, own in CONDITIONS.items() if Marker(each) == requirement.marker)
    return {"if": when, "then": entry}


def test_the_recipe_needs_what_the_package_needs(project, recipe):
    needs = recipe["requirements"]
    assert needs["run"] == ["python", *map(of_conda, project["project"]["dependencies"])]
    assert needs["host"] == ["python", "pip", *map(of_conda, project["build-system"]["requires"])]
    (cmake,) = (entry for entry in needs["build"] if entry.startswith("cmake"))
    assert cmake == f"cmake {project['tool']['scikit-build']['cmake']['version']}"


def test_the_recipe_says_what_the_project_says(project, recipe):
    own, about = project["project"], recipe["about"]
    assert recipe["context"] == {"name": own["name"], "version": rastercov.__version__}
    assert (about["summary"], about["license"]) == (own["description"], own["license"])
    assert about["license_file"] == own["license-files"]
    assert all((ROOT / name).is_file() for name in about["license_file"])
    urls = own["urls"]
    assert about["homepage"] == urls["Homepage"]
    assert about["repository"] == urls["Source"]
    assert about["documentation"] == urls["Documentation"]
    for program in re.findall(
        r"^ +- (rastercov) ", RECIPE.read_text(encoding="utf-8"), re.MULTILINE
    ):
        assert program in own["scripts"]


def faults(folder, urls, recipe):
    """Lines of the check of addresses, for a folder with these texts."""
    (folder / "packaging" / "conda").mkdir(parents=True, exist_ok=True)
    (folder / "pyproject.toml").write_text(urls, encoding="utf-8")
    (folder / "packaging" / "conda" / "recipe.yaml").write_text(recipe, encoding="utf-8")
    loader = importlib.machinery.SourceFileLoader("addresses", str(CHECK))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("addresses", loader))
    loader.exec_module(module)
    return module.faults_of(folder)


PLACEHOLDERS = ("https://example.org/a", "https://www.Example.com/", "https://files.example.net/x")
REAL = ("https://example.org.uk/a", "https://notexample.org/", "https://host.dev/example.org")


@pytest.mark.parametrize("first", PLACEHOLDERS + REAL)
@pytest.mark.parametrize("second", PLACEHOLDERS + REAL)
def test_addresses_are_all_placeholders_or_all_real(tmp_path, first, second):
    urls = f'[project.urls]\nHomepage = "{first}"\n'
    recipe = f'source:\n  url: {second}\n  sha256: "{"1" * 64}"\nabout:\n  homepage: "{first}"\n'
    is_mixed = (first in PLACEHOLDERS) != (second in PLACEHOLDERS)
    assert len(faults(tmp_path, urls, recipe)) == is_mixed


@pytest.mark.parametrize("address", ["http://host.dev/a", "https://", "ftp://host.dev/a"])
def test_an_address_that_is_none_is_named(tmp_path, address):
    lines = faults(tmp_path, f'[project.urls]\nHome = "{address}"\n', "")
    assert any("Home" in line for line in lines)


def test_a_release_has_a_digest(tmp_path):
    urls = f'[project.urls]\nHomepage = "{REAL[0]}"\n'
    for digest, count in (("0" * 64, 1), ("a" * 64, 0)):
        recipe = f'source:\n  url: {REAL[1]}\n  sha256: "{digest}"\n'
        assert len(faults(tmp_path, urls, recipe)) == count
