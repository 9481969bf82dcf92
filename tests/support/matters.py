"""Tests of what runs by day where its files changed: browsers, OpenGL, photographs, long pages.

`pytest` without names, as `make test` runs it, asks git what changed since CI_BASE, or since the
last commit where there is none. Where that is neither a file of a matter nor one that its files
import, tests of it that are marked `every_day` run; all others do at night, or when they are named
on the command line.
"""

import os
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest
from nightly import IS_NIGHTLY

ROOT = Path(__file__).parents[2]
MATTERS = {
    "page": (
        "rastercov/page/",
        "rastercov/report/",
        "tests/viewer/",
        "tests/report/test_notebook.py",
        "tests/cli/test_printing.py",
        "tests/support/browser.py",
        "tests/support/firefox.py",
    ),
    "opengl": (
        "rastercov/core/raster/",
        "rastercov/gl/",
        "shaders/",
        "tests/raster/",
        "tests/conftest.py",
    ),
    "asbuilt": ("rastercov/asbuilt/", "tests/asbuilt/"),
    "docs": ("docs/", "examples/", "README.md", "tests/test_docs.py"),
    "laboratory": (
        "reference/markers/",
        "reference/methods/",
        "reference/models/",
        "tests/reference/",
        "tests/test_comparison.py",
        "benchmarks/comparison.py",
    ),
}
"""Files of each matter, or folders of them."""
OF_ALL = ("rastercov/engine/", "rastercov/data/", "pyproject.toml", "tests/support/matters.py")
NAMED = "RASTERCOV_TESTS_NAMED"
"""Set where tests are named on the command line, for the processes of a run."""


def note_names(config):
    """Note whether the command line names tests: not the process of a run that another started."""
    if not hasattr(config, "workerinput"):
        is_named = config.args_source is config.ArgsSource.ARGS
        os.environ[NAMED] = str(int(is_named))


def _git(*words):
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return None if done.returncode else done.stdout.splitlines()


@cache
def changed():
    """Paths that changed since CI_BASE or the last commit; None where CI_BASE is not to be had."""
    base = os.environ.get("CI_BASE")
    known, new = (
        _git("diff", "--name-only", base or "HEAD"),
        _git("ls-files", "-o", "--exclude-standard"),
    )
    if known is None or new is None:
        return None if base else ()
    return (*known, *new)


@cache
def _texts(matter):
    """Python of the files of a matter."""
    paths = [ROOT / each for each in MATTERS[matter]]
    files = (file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path]))
    return tuple(file.read_text(encoding="utf-8") for file in files)


def is_imported(path, text):
    """True if a module imports the module of this path, as far as its words tell."""
    bare = path.removeprefix("tests/support/").removesuffix(".py").removesuffix("/__init__")
    module = re.sub("^reference/", "rastercov/reference/", bare).replace("/", ".")
    package, _, name = module.rpartition(".")
    if package and f"from {package} import" in text:
        return bool(re.search(rf"\b{re.escape(name)}\b", text))
    return bool(re.search(rf"\b(from|import) {re.escape(module)}\b", text))


def concerns(matter, paths):
    """True if one of the paths is of the matter, or its files import it."""
    if any(path.startswith((*MATTERS[matter], *OF_ALL)) for path in paths):
        return True
    modules = [path for path in paths if path.endswith(".py")]
    return any(is_imported(path, text) for text in _texts(matter) for path in modules)


@cache
def is_due(matter):
    """True if all tests of a matter are to run."""
    if IS_NIGHTLY or os.environ.get(NAMED) == "1":
        return True
    paths = changed()
    return paths is None or (bool(paths) and concerns(matter, paths))


def matter_of(item):
    """The matter that a test belongs to, or None."""
    marker = item.get_closest_marker("matter")
    if marker is not None:
        return marker.args[0]
    if "browser" in item.fixturenames:
        return "page"
    given = getattr(item, "callspec", None)
    ways = {"layers", "compute"}
    if given is not None and ways & {given.params.get("open_raster"), given.params.get("plan")}:
        return "opengl"
    return None


def is_of_night(item):
    """True for a test of a matter that does not run every day."""
    return matter_of(item) is not None and item.get_closest_marker("every_day") is None


def skip_what_did_not_change(items):
    """Skip tests of matters that are not due, and are not of every day."""
    for item in items:
        matter = matter_of(item)
        if is_of_night(item) and not is_due(matter):
            reason = (
                f"{matter}: its files did not change; RASTERCOV_NIGHTLY=1, or its name, runs it"
            )
            item.add_marker(pytest.mark.skip(reason=reason))
