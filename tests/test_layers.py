"""Imports go one way: a module imports only modules of its own layer or of earlier ones."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

import rastercov

ROOT = Path(rastercov.__file__).parent
LAYERS = (
    *("native", "base", "mesh", "camera", "raster", "exact"),
    *("cluster", "coverage", "placement", "report", "viewer", "cli"),
)
LABORATORY = {("cli", "compare")}
"""Commands that run models and oracles of `rastercov.reference`; nothing else imports it."""
LEVEL = {name: level for level, name in enumerate(LAYERS)}


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


def test_no_import_goes_up():
    up = {
        (parts[0], found[0])
        for path, parts in modules()
        for found in imports(path)
        if found and LEVEL.get(found[0], -1) > LEVEL[parts[0]]
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


def test_the_path_from_mesh_to_coverage_is_read_in_one_sitting():
    page = (ROOT.parent / "docs" / "appendix" / "architecture.md").read_text(encoding="utf-8")
    section = page.split("## From mesh to coverage")[1].split("\n## ")[0]
    files = re.findall(r"^\| `([\w/]+\.\w+)` \|", section, re.MULTILINE)
    assert files[-1] == "coverage/job.py"
    assert sum(len((ROOT / name).read_text().splitlines()) for name in files) < 2275


# Code lines of each package, without blank lines, comments, docstrings and imports. A feature that
# needs more says what it retires.
BUDGET = {
    "base": 1_030,
    "camera": 5_860,
    "cli": 1_580,
    "cluster": 650,
    "coverage": 5_260,
    "exact": 750,
    "mesh": 5_210,
    "native": 44,
    "placement": 8_510,
    "raster": 2_330,
    "report": 4_190,
    "viewer": 2_070,
}
MOST_FILES = 250
# Code lines of C++ in native/, without blank lines, comments, includes and texts: the border,
# vectors and loops.
BUDGET_OF_CPP = 14_805
MOST_LINES_OF_CPP_FILE = 600


def code_lines(path):
    source = path.read_text(encoding="utf-8")
    left_out = set()
    for node in ast.walk(ast.parse(source)):
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node, ast.Import | ast.ImportFrom) or is_text:
            left_out |= set(range(node.lineno, node.end_lineno + 1))
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") and row not in left_out
        for row, line in enumerate(source.split("\n"), 1)
    )


@pytest.mark.parametrize("package", BUDGET)
def test_a_package_keeps_to_its_lines(package):
    found = sum(map(code_lines, (ROOT / package).rglob("*.py")))
    assert 0.95 * BUDGET[package] <= found <= BUDGET[package]


def test_cpp_keeps_to_its_lines():
    files = [p for p in (ROOT / "native").rglob("*") if p.suffix in (".cpp", ".hpp")]
    lines = {path: path.read_text(encoding="utf-8").split("\n") for path in files}
    code = [row for rows in lines.values() for row in map(str.strip, rows)]
    found = sum(bool(row) and not row.startswith(("//", "#include", '"')) for row in code)
    assert 0.95 * BUDGET_OF_CPP <= found <= BUDGET_OF_CPP
    assert max(map(len, lines.values())) <= MOST_LINES_OF_CPP_FILE


def test_nothing_lies_flat_beside_the_packages():
    assert {path.name for path in ROOT.glob("*.py")} == {"__init__.py", "__main__.py"}
    folders = {path.name for path in ROOT.iterdir() if list(path.glob("*.py"))}
    assert folders == {*BUDGET, "reference", "shaders"}
    files = [path for name in BUDGET for path in (ROOT / name).rglob("*.py")]
    assert len(files) + 2 <= MOST_FILES
