"""Imports go one way: a module imports only modules of its own layer or of earlier ones."""

import ast
import json
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import rastercov
from rastercov.base.features import FEATURES

ROOT = Path(rastercov.__file__).parent
FLOORS = ("engine", "base", "shards", "core", "formats", "advice", "placement", "report")
SLICES = (
    *(
        "light",
        "sun",
        "motion",
        "robots",
        "sensors",
        "tolerances",
        "survey",
        "asbuilt",
        "building",
        "cluster",
        "gl",
    ),
)
"""Side by side: none imports another one."""
TOPS = ("page", "cli")
LABORATORY = {("cli", "compare")}
"""Commands that run models and oracles of `rastercov.reference`; nothing else imports it."""
EXAMPLES = r"\n +Examples\n +-{8}\n.*?(?=\"{3})"
"""Of docstrings."""
LEVEL = {name: level for level, name in enumerate((*FLOORS, "slices", *TOPS))}
LEVEL |= dict.fromkeys(SLICES, LEVEL["slices"])


def modules():
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[0] not in ("reference", "shaders", "__init__", "__main__"):
            yield path, parts[: -1 if parts[-1] == "__init__" else None]


@cache
def imports(path):
    """Names of modules of the package that a file imports, at the top or in a function."""
    return set(found_imports(path))


def found_imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rastercov"):
            base = node.module.split(".")[1:]
            for name in node.names:
                whole = ROOT.joinpath(*base, name.name)
                is_module = whole.is_dir() or whole.with_suffix(".py").exists()
                yield tuple([*base, name.name] if is_module else base)


def test_no_package_is_called_like_a_public_name():
    """It would take the place of the function where a module of it is imported."""
    assert {path.name for path in ROOT.iterdir() if path.is_dir()}.isdisjoint(rastercov.__all__)


def test_no_import_goes_up():
    up = {
        (parts[0], result[0])
        for path, parts in modules()
        for result in imports(path)
        if parts != ("placement",)  # public names, which are imported when they are asked for
        if result and result[0] != parts[0] and LEVEL.get(result[0], -1) >= LEVEL[parts[0]]
    }
    assert up == set()


def test_only_commands_import_the_laboratory():
    importing = {
        parts for path, parts in modules() if any("reference" in name for name in imports(path))
    }
    assert importing == LABORATORY


def test_no_two_modules_import_each_other():
    graph = {parts: imports(path) - {parts} for path, parts in modules()}
    open_, done = [], set()

    def visit(node):
        assert node not in open_, " -> ".join(map(".".join, [*open_[open_.index(node) :], node]))
        if node not in done:
            open_.append(node)
            for following in sorted(graph.get(node, ())):
                visit(following)
            open_.pop()
            done.add(node)

    for node in sorted(graph):
        visit(node)


IMPORT_EACH = """
import contextlib, importlib, os, sys, traceback
reading, writing = os.pipe()
if not os.fork():
    for name in sys.argv[1:]:
        with contextlib.suppress(BaseException):
            importlib.import_module(name)
    others = [name for name in sys.modules if name.split(".")[0] != "rastercov"]
    os.write(writing, " ".join(others).encode()[:60_000])
    os._exit(0)
os.wait()
for name in os.read(reading, 65_536).decode().split():  # which take most of the time
    with contextlib.suppress(BaseException):
        importlib.import_module(name)
for name in sys.argv[1:]:
    child = os.fork()
    if not child:
        try:
            importlib.import_module(name)
        except BaseException:
            print(name, traceback.format_exc().splitlines()[-1], flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


def test_any_module_can_be_the_first_that_is_imported():
    """So what adds to others by hooks imports nothing that asks for hooks when it is imported."""
    of_reports = {
        own.get("ReportHooks") for own in FEATURES.values()
    }  # `report.modes` imports them
    every = {".".join(parts) for _, parts in modules()} - of_reports
    assert of_reports.isdisjoint(".".join(name) for path, _ in modules() for name in imports(path))
    names = [f"rastercov.{name}" for name in sorted(every)]
    command = [sys.executable, "-c", IMPORT_EACH, *names]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == ""


def test_the_path_from_mesh_to_coverage_is_read_in_one_sitting():
    page = (ROOT.parent / "docs" / "appendix" / "architecture.md").read_text(encoding="utf-8")
    section = page.split("## From mesh to coverage")[1].split("\n## ")[0]
    files = re.findall(r"^\| `([\w/]+\.\w+)` \|", section, re.MULTILINE)
    assert files[0] == "core/coverage/job.py"
    texts = (re.sub(EXAMPLES, "", (ROOT / name).read_text(), flags=re.DOTALL) for name in files)
    assert sum(len(text.splitlines()) for text in texts) <= 2000


@pytest.mark.parametrize(
    ("title", "steps", "returns"),
    [("From mesh to coverage", 14, 2), ("From a plan to cameras", 60, 10)],
)
def test_the_steps_of_a_walk_are_few_and_are_there(title, steps, returns):
    page = (ROOT.parent / "docs" / "appendix" / "architecture.md").read_text(encoding="utf-8")
    section = page.split(f"## {title}")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `([\w/]+\.\w+)` \| (.*) \|$", section, re.MULTILINE)
    items = [
        (file, *each) for file, text in rows for each in re.findall(r"(\d+) `([\w.:]+)`", text)
    ]
    numbers = [int(number) for _, number, _ in items]
    assert len(set(numbers)) == len(numbers)
    assert max(numbers) <= steps
    assert len(re.findall("[Rr]eturns ", "".join(text for _, text in rows))) <= returns
    for file, _, name in items:
        own = re.split(r"\.|::", name)[-1]
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"(def |class |::){own}\(", text), f"{file}: {name}"


def test_weight_counts_tokens_of_what_ships(tmp_path):
    """Not comments and docstrings; a text is one token, and of several lines each word."""
    weight = ROOT.parent / ".ci" / "weight"
    package = tmp_path / "rastercov"
    for folder in (tmp_path / ".ci" / "features", package / "camera"):
        folder.mkdir(parents=True)
    for name in ("weight", "functions.py"):
        shutil.copy(weight.with_name(name), tmp_path / ".ci")
    (package / "__init__.py").write_text('"""Text."""  # comment\nx: Any = f(1.5e-3, "a b")\n')
    (package / "camera" / "part.py").write_text('TEXT = """\nlet x = 1\n"""\n')
    (tmp_path / ".ci" / "features" / "one.toml").write_text('own = ["rastercov/camera/p*.py"]')
    (package / "code.cpp").write_text(
        "#include <cmath>\n/* a\n b */\n    double x = a->b, y = 1e-3; // c\n"
    )
    (package / "page.js").write_text("// comment\nlet x = 'a b';\n" + "x = 1;\n" * 3)
    (package / "user.py").write_text(
        "from rastercov.camera.part import TEXT\ndef f(a: Any, /): ...\n"
    )
    limit = tmp_path / ".ci" / "weight.limit"

    def run(*options):
        words = [sys.executable, str(tmp_path / ".ci" / "weight"), *options]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    limit.write_text("70")
    content = json.loads(run("--json").stdout)
    assert content["Python"] == 10 + (2 + 10) + (8 + 11)
    assert content["C++"] == 11
    assert content["JavaScript"] == 5 + 3 * 4
    assert content["files that import one"] == content["parameters typed Any"] == 1
    assert content["assignments joined by a comma, C++"] == 1
    limit.write_text("65")
    assert "expected at most 65 tokens" in run().stderr


def test_nothing_lies_flat_beside_the_packages():
    assert {path.name for path in ROOT.glob("*.py")} == {"__init__.py", "__main__.py"}
    folders = {path.name for path in ROOT.iterdir() if list(path.glob("*.py"))}
    assert folders | {*SLICES} == {*FLOORS, *SLICES, *TOPS, "reference", "shaders"}


OPTIONAL = ("rastercov.page.connections", "rastercov.report.parquet")
"""Modules that are an optional package by themselves; what imports them asks for it first."""
WITHOUT = """
import importlib, os, pkgutil, re, sys, tomllib
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions
import rastercov

project = tomllib.loads(open(sys.argv[1], encoding="utf-8").read())["project"]
def names(texts):
    return {re.match(r"[\\w.-]+", text)[0].lower() for text in texts}
extras = {name for own in project["optional-dependencies"].values() for name in names(own)}
extras -= names(project["dependencies"])
items = packages_distributions().items()
packages = {name for name, own in items if extras & {each.lower() for each in own}}
find = PathFinder.find_spec
PathFinder.find_spec = lambda name, *more: (
    None if name.partition(".")[0] in packages else find(name, *more)
)
for module in pkgutil.walk_packages(rastercov.__path__, "rastercov."):
    if not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except ImportError:
            print(module.name)
os.chdir(sys.argv[2])
rastercov.place("plan.toml", out="out")
print(*sorted(os.listdir("out")))
"""
FLOWN = """
[[meshes]]
path = "field.obj"
[camera]
width = 800
height = 600
hfov_deg = 60
[[candidates]]
generator = "strips"
height = 10
front = 0.5
side = 0.5
[selection]
goal = "all"
[flight]
"""


def test_modules_and_flights_without_a_crs_need_no_optional_package(tmp_path):
    (tmp_path / "field.obj").write_text("v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 0\nf 1 2 3 4\n")
    (tmp_path / "plan.toml").write_text(FLOWN)
    project = Path(__file__).parents[1] / "pyproject.toml"
    arguments = [sys.executable, "-c", WITHOUT, str(project), str(tmp_path)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    *missing, written = done.stdout.splitlines()
    assert missing == [*OPTIONAL]
    assert "flight.csv" in written.split()
