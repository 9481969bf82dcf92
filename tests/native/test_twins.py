"""Each file of loops names its twin in Python: a module of ours, or a test of the same result."""

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "rastercov/engine").glob("*/*.?pp"))
TWIN = re.compile(r"tests/[\w/]+\.py|rastercov(?:\.\w+)+")


def twins(text):
    """Names after `Twin` in the comment at the top of a file."""
    comment = re.match(r"(?://.*\n)+", text).group().replace("\n//", "")
    return TWIN.findall(re.split(r"\bTwins?: ", comment, maxsplit=1)[1])


def is_there(name):
    """True for a file of the tree, a module, or an attribute of a module."""
    if name.startswith("tests/"):
        return (ROOT / name).is_file()
    try:
        import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return hasattr(import_module(module), attribute)
    return True


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_file_of_loops_names_a_twin_that_is_there(source):
    named = twins(source.read_text())
    assert named
    assert [name for name in named if not is_there(name)] == []


def test_there_are_loops():
    assert len(SOURCES) > 60
