"""What version 1 keeps: nothing of the lists beside this file goes; additions are free.

python tests/frozen/test_frozen.py     # writes the lists, for a release that adds to them
"""

import dataclasses
import enum
import inspect
import json
import re
import sys
from pathlib import Path

import pytest

import rastercov
import rastercov.placement
from rastercov.cli.console import COMMANDS, LazyCommand, exit_codes

LISTS = Path(__file__).parent
ROOT = LISTS.parents[1]
HEADER = ROOT / "rastercov" / "engine" / "include" / "rastercov.h"
MODULES = (rastercov, rastercov.placement)
MADE = """
    Candidates CellObjective CellShares Cells CoverageBits Covered CoveredBits DeadZones Evaluation
    FaceCounts Lamp LaserLine Leftover Located Objective Observation Openings Optimised OverTime
    Poses Problem RasterizerInfo Refined Regions Robot Room Segmentation Selection Sunlight
    Tolerance Viewshed Visibility VisibilityBuffer VisibilityMatrix"""
"""Results and others that functions and methods make: their fields are kept, not their order."""


def python():
    """Names, their members, arguments by their place, and numbers of codes."""
    for module in MODULES:
        for name in module.__all__:
            value = getattr(module, name)
            path = f"{module.__name__}.{name}"
            yield path
            if inspect.isclass(value):
                yield from members(path, value)
            elif callable(value):
                yield from arguments(path, value)


def members(path, kind):
    own = [each for each in kind.__mro__ if each.__module__.startswith("rastercov")]
    names = {name for each in own for name in vars(each)}
    names |= (
        {each.name for each in dataclasses.fields(kind)}
        if dataclasses.is_dataclass(kind)
        else set()
    )
    if issubclass(kind, enum.IntEnum):
        yield from (f"{path}.{each.name} = {each.value}" for each in kind)
        names -= {each.name for each in kind}
    elif kind.__name__ not in MADE.split():
        yield from arguments(path, kind)
    for name in sorted(name for name in names if not name.startswith("_")):
        yield f"{path}.{name}"
        value = inspect.getattr_static(kind, name, None)
        if isinstance(value, staticmethod | classmethod) or inspect.isfunction(value):
            yield from arguments(f"{path}.{name}", getattr(kind, name))


def arguments(path, function):
    """By their place where they have one, and which must be given."""
    try:
        every = inspect.signature(function).parameters.values()
    except ValueError:
        return
    place = 0
    for each in every:
        if each.name == "self" or each.name.startswith("_"):
            continue
        must = " required" if each.default is each.empty and each.kind < each.VAR_POSITIONAL else ""
        if each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD):
            yield f"{path}({place}: {each.name}{must})"
            place += 1
        else:
            yield f"{path}({each.name}=)"


def commands():
    """Commands, their arguments and options, and their exit codes."""
    for name in COMMANDS:
        command = LazyCommand(name).loaded
        for own in [command, *getattr(command, "commands", {}).values()]:
            path = name if own is command else f"{name} {own.name}"
            for entry in own.params:
                yield from (f"{path} {option}" for option in [*entry.opts, *entry.secondary_opts])
            yield from (f"{path} exits {code}" for code in re.findall(r"\b\d+\b", exit_codes(name)))


def keys(schema, defs, path="", above=()):
    """Keys of a schema with their types, which must be there, and the words that one may have."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if not defs:
            yield f"{path} is {name}"
        elif name not in above:
            yield from keys(defs[name], defs, path, (*above, name))
    for name, each in schema.get("properties", {}).items():
        own = f"{path}/{name}"
        kind = each.get("type")
        yield own
        if isinstance(kind, str):
            yield f"{own}: {kind}"
        if name in schema.get("required", ()):
            yield f"{own} required"
        yield from keys(each, defs, own, above)
    for word in [*schema.get("enum", ()), *([schema["const"]] if "const" in schema else [])]:
        yield f"{path} = {word}"
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from keys(schema[key], defs, f"{path}/*", above)
    for key in ("anyOf", "oneOf", "allOf"):
        for each in schema.get(key, ()):
            yield from keys(each, defs, path, above)


def answers():
    root = json.loads((ROOT / "docs" / "answers.schema.json").read_text(encoding="utf-8"))
    for name, each in root["$defs"].items():
        yield from keys(each, {}, name)


def plan():
    root = json.loads((ROOT / "docs" / "plan.schema.json").read_text(encoding="utf-8"))
    yield from keys(root, root["$defs"])


def c():
    """Functions, values of codes, and fields of structs of the header, without its comments."""
    text = re.sub(r"/\*.*?\*/", "", HEADER.read_text(encoding="utf-8"), flags=re.DOTALL)
    yield from re.findall(r"#define (RC_\w+)", text)
    for names in re.findall(r"enum\s*\w*\s*{(.*?)}", text, re.DOTALL):
        yield from (" ".join(each.split()) for each in names.split(",") if each.strip())
    for name, fields in re.findall(r"struct (\w+) {(.*?)}", text, re.DOTALL):
        for each in filter(str.strip, fields.split(";")):
            kind, first = re.fullmatch(r"\s*(.*?[\s*])(\w+)", each.partition(",")[0]).groups()
            own = [first, *(part.strip(" *\n") for part in each.split(",")[1:])]
            yield from (f"{name}.{field}: {' '.join(kind.split()).rstrip(' *')}" for field in own)
    text = re.sub(r"{.*?}", "", re.sub(r"^#.*$", "", text, flags=re.MULTILINE), flags=re.DOTALL)
    for declared in re.findall(r"[^;{}]*\brc_\w+\([^;]*\)", text):
        yield " ".join(re.sub(r'extern "C"', "", declared).split())


NOW = {each.__name__: each for each in (python, commands, answers, plan, c)}


def stored(name):
    return (LISTS / f"{name}.txt").read_text(encoding="utf-8").splitlines()


def lost(name, before, now):
    """What went; of a plan also what must be given and was not, of arguments those without default.

    Types of answers may not change, those that a plan takes may grow.
    """
    before, now = set(before), set(now)
    if name == "plan":
        gone = {each for each in before - now if not re.search(r": \w+$| required$", each)}
        new = {each for each in now - before if each.endswith(" required")}
        return sorted(gone | {each for each in new if each.rpartition("/")[0] in before})
    if name == "python":
        free = {each.replace(" required", "") for each in now}
        gone = {each for each in before - now if each.replace(" required", "") not in free}
        new = {each for each in now - before if each.endswith(" required)")}
        return sorted(gone | {each for each in new if each.partition("(")[0] in before})
    return sorted(before - now)


@pytest.mark.parametrize("name", NOW)
def test_nothing_that_version_1_keeps_goes(name):
    before = stored(name)
    assert len(before) > 100
    assert lost(name, before, NOW[name]()) == []


@pytest.mark.parametrize(
    ("name", "before", "now", "found"),
    [
        ("python", ["a.f", "a.g"], ["a.g", "a.h"], ["a.f"]),
        ("python", ["f", "f(0: x)", "f(1: y)"], ["f", "f(0: y)", "f(1: x)"], 2),
        ("python", ["f", "f(0: x required)"], ["f", "f(0: x)", "f(1: y)"], []),
        ("python", ["f", "f(0: x)"], ["f", "f(0: x)", "f(1: y required)"], 1),
        ("python", ["R.A = 1"], ["R.A = 2"], ["R.A = 1"]),
        ("commands", ["check exits 1"], ["check exits 3"], ["check exits 1"]),
        ("answers", ["x/a: number"], ["x/a: string"], ["x/a: number"]),
        ("answers", ["x/a required"], ["x/a"], ["x/a required"]),
        ("plan", ["/a", "/a/b: number"], ["/a", "/a/b: string"], []),
        ("plan", ["/a", "/a/b"], ["/a", "/a/b", "/a/c required"], ["/a/c required"]),
        ("plan", ["/a = on"], ["/a = off"], ["/a = on"]),
        ("c", ["int f(int a)"], ["int f(int a, int b)"], ["int f(int a)"]),
    ],
)
def test_what_goes_is_found_and_additions_are_not(name, before, now, found):
    result = lost(name, before, now)
    assert (len(result) if isinstance(found, int) else result) == found


def test_results_are_classes_that_no_example_constructs():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.py")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    for name in MADE.split():
        assert any(hasattr(module, name) for module in MODULES), name
        assert not re.search(rf"\b(?:rc\.)?{name}\(", text), name


def test_every_function_and_code_of_c_is_listed():
    text = HEADER.read_text(encoding="utf-8")
    listed = " ".join(stored("c"))
    names = set(re.findall(r"\brc_status (rc_\w+)\(", text)) | set(re.findall(r"\bRC_\w+\b", text))
    assert {name for name in names if not re.search(rf"\b{name}\b", listed)} <= {"RC_MODEL_"}


if __name__ == "__main__":
    for name, make in NOW.items():
        lines = sorted(set(make()))
        (LISTS / f"{name}.txt").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        sys.stdout.write(f"{name}: {len(lines)}\n")
