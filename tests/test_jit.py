"""Compiled loops on disk: what is torn or stale is not believed, and no disk is no error."""

import ast
import hashlib
import logging
import os
import resource
import shutil
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import python

import rastercov
from rastercov.kernels import jit as compiled
from rastercov.kernels.stopwatch import Stopwatch

ROOT = Path(rastercov.__file__).parents[1]
# Says its result, how often it was read from disk, and how often it was compiled.
LOOP = """
from rastercov.kernels.jit import compiled

@compiled
def loop(number):
    return {factor} * number

result = loop(7)
hits, misses = loop.stats.cache_hits, loop.stats.cache_misses
print(result, sum(hits.values()), sum(misses.values()))
"""
KEPT = "rastercov: compiling some loops, once for this version\n"


@pytest.fixture
def module(tmp_path):
    """A module with one loop, in a folder of its own."""
    path = tmp_path / "package" / "kept.py"
    path.parent.mkdir()
    path.write_text(LOOP.format(factor=3))
    return path


def run(module, cache, **options):
    """Result, times read, times compiled; and standard error."""
    (line,), said = run_all(["kept"], module, cache, **options)
    return line, said


def run_all(names, module, cache, **options):
    """As `run`, of several modules beside `module` in one process: a triple of each."""
    path = {"PYTHONPATH": f"{module.parent}{os.pathsep}{ROOT}", "NUMBA_CACHE_DIR": str(cache)}
    # Two versions of a module of one length and one second share Python's own kept bytecode.
    words = ("-B", "-W", "error", "-c", f"import {', '.join(names)}")
    done = python(*words, env=os.environ | path, **options)
    assert done.returncode == 0, done.stderr
    return [tuple(map(int, line.split())) for line in done.stdout.splitlines()], done.stderr


def files(cache, name="kept"):
    """The index and the data of the loop of a module."""
    (index,), (data,) = cache.rglob(f"{name}.*.nbi"), cache.rglob(f"{name}.*.nbc")
    return index, data


# --- damage ---------------------------------------------------------------------------------------


def removed(path):
    path.unlink()


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def outdated(path):
    """As an earlier version of the library left it, with a type that is gone."""
    data = b"crastercov.kernels.jit\nTypeThatIsGone\n."
    path.write_bytes(hashlib.sha256(data).digest() + data)


DAMAGES = (removed, pipe, outdated)
WHICH = {"index": [0], "data": [1], "both": [0, 1]}


@pytest.mark.slow
def test_a_damaged_file_is_compiled_anew_and_replaced(module, tmp_path):
    cache = tmp_path / "cache"
    cases = {f"{damage.__name__}_{which}": (damage, which) for damage in DAMAGES for which in WHICH}
    for name in cases:
        (module.parent / f"{name}.py").write_text(LOOP.format(factor=3))

    def in_one_process():
        lines, said = run_all(cases, module, cache)
        return dict(zip(cases, lines, strict=True)), said

    assert in_one_process() == (dict.fromkeys(cases, (21, 0, 1)), KEPT)
    assert in_one_process() == (dict.fromkeys(cases, (21, 1, 0)), "")
    for name, (damage, which) in cases.items():
        kept = files(cache, name)
        for number in WHICH[which]:
            damage(kept[number])
    found, said = in_one_process()
    assert found == dict.fromkeys(cases, (21, 0, 1))
    assert said in ("", KEPT)
    assert in_one_process() == (dict.fromkeys(cases, (21, 1, 0)), "")


def test_an_index_that_leads_to_older_data_is_not_believed(tmp_path):
    # The disk filled up between the two: numba itself would run what the old source said.
    old = compiled._CheckedFile(str(tmp_path), "loop", "old source")
    old.save("key", "old code")
    assert old.load("key") == "old code"
    new = compiled._CheckedFile(str(tmp_path), "loop", "new source")
    assert new.load("key") is None
    new._save_index({"key": old._load_index()["key"]})
    assert new._load_index()
    assert new.load("key") is None
    new.save("key", "new code")
    assert new.load("key") == "new code"
    # Two processes that start at once take the same name for different signatures.
    new._save_index({"int64": new._load_index()["key"]})
    assert new.load("int64") is None


@pytest.mark.slow
@given(st.data())
def test_no_damage_to_a_file_is_believed(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("kept")
    file = compiled._CheckedFile(str(folder), "loop", "source")
    file.save("key", {"code": "x" * 20})
    path = data.draw(st.sampled_from(sorted(folder.iterdir())))
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    kind = data.draw(st.sampled_from(["flip", "cut", "more"]))
    if kind == "flip":
        content[place] ^= data.draw(st.integers(1, 255))
    elif kind == "cut":
        del content[place:]
    else:
        content += b"\0"
    path.write_bytes(content)
    assert file.load("key") is None
    file.save("key", "again")
    assert file.load("key") == "again"


# --- nowhere to write -----------------------------------------------------------------------------


def small_files():  # as many bytes as the index has, and fewer than the loop
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


@pytest.mark.slow
@pytest.mark.parametrize("is_looked_for", [True, False])
def test_a_disk_that_fills_up_is_one_line_or_one_more(module, tmp_path, is_looked_for):
    cache, source = tmp_path / "cache", module.read_text()
    if not is_looked_for:
        module.write_text("from rastercov.kernels import jit\njit.ROOM = 0\n" + source)
    result, said = run(module, cache, preexec_fn=small_files)
    assert result == (21, 0, 1)
    said = said.removeprefix("" if is_looked_for else KEPT)
    assert said.startswith("rastercov: compiling, in every process: the result cannot be kept on ")
    assert said.count("\n") == 1
    assert not list(cache.rglob("*.tmp.*"))
    module.write_text(source)
    assert run(module, cache) == ((21, 0, 1), KEPT)
    assert run(module, cache) == ((21, 1, 0), "")


def test_without_a_home_there_is_no_folder_called_tilde(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(compiled.Path, "expanduser", lambda path: path)
    assert compiled._loops_folder.__wrapped__(None) is None


@pytest.mark.parametrize("mode", [0o770, 0o702])
def test_a_folder_that_others_may_write_keeps_no_loops(monkeypatch, tmp_path, mode):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = compiled._loops_folder.__wrapped__(None)
    assert folder == tmp_path / "rastercov" / "loops"
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(mode)
    assert compiled._loops_folder.__wrapped__(None) is None


def test_a_folder_of_another_user_keeps_no_loops(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compiled.os, "geteuid", lambda: 12345)
    assert compiled._loops_folder.__wrapped__(None) is None


# --- notices --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_program_with_logging_of_its_own_decides_where_notices_go(module, tmp_path):
    code = "import logging\nlogging.basicConfig(filename='log.txt')\n"
    module.write_text(code + module.read_text())
    assert run(module, tmp_path / "cache", cwd=tmp_path) == ((21, 0, 1), "")
    text = (tmp_path / "log.txt").read_text()
    assert text == f"WARNING:rastercov:{KEPT}"


def test_a_command_shows_notices_as_it_shows_warnings(capsys):
    from rastercov.cli.console import notices_shown

    with notices_shown():
        logging.getLogger("rastercov").warning("rastercov: a \x1b notice")
    assert capsys.readouterr().err == "rastercov: a \\x1b notice\n"
    assert not logging.getLogger("rastercov").handlers


def test_only_programs_print():
    printing = [
        path.relative_to(ROOT).as_posix()
        for path in sorted((ROOT / "rastercov").rglob("*.py"))
        if "file=sys.stderr" in path.read_text(encoding="utf-8")
    ]
    assert printing == ["rastercov/cli/console.py"]


@pytest.mark.slow
def test_what_is_kept_runs_as_what_was_compiled(module, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    for factor in (3, 5):
        module.write_text(LOOP.format(factor=factor))
        assert run(module, cache)[0] == (7 * factor, 0, 1)
        assert run(module, cache)[0] == (7 * factor, 1, 0)
    # Each source has a folder of its own: going back to the first compiles nothing, and nor does
    # another checkout.
    module.write_text(LOOP.format(factor=3))
    assert run(module, cache)[0] == (21, 1, 0)
    copy = shutil.copytree(module.parent, tmp_path / "elsewhere" / "package") / module.name
    assert run(copy, cache) == ((21, 1, 0), "")
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")  # settings of numba make other loops
    assert run(module, cache)[0] == (21, 0, 1)


PART = """
from rastercov.kernels.jit import part_of

@part_of
def changed(number):
    return {factor} * number
"""


@pytest.mark.compile
def test_a_loop_is_compiled_anew_when_a_file_that_it_is_made_of_changes(module, tmp_path):
    package = module.parent / "parts"
    package.mkdir()
    (package / "__init__.py").touch()
    loop = "from parts.formula import changed\n" + LOOP.format(factor="changed(1)")
    (package / "kept.py").write_text(loop)
    formula = package / "formula.py"
    # First as long as it was, and newer; then as old as it was, and longer.
    for factor, seconds in ((3, 10**9), (4, 10**9 + 5), (50, 10**9 + 5)):
        formula.write_text(PART.format(factor=factor))
        os.utime(formula, (seconds, seconds))
        for counts in ((0, 1), (1, 0)):
            found, _ = run_all(["parts.kept"], module, tmp_path / "cache")
            assert found == [(7 * factor, *counts)]


@pytest.mark.slow
def test_loops_that_no_process_loads_are_removed(module, tmp_path):
    cache = tmp_path / "cache"
    run(module, cache)
    (old,) = cache.iterdir()
    other = cache / "notes"
    other.mkdir()
    os.utime(old, (0, 0))
    run(module, cache)
    assert old.stat().st_mtime > 0  # it was loaded
    for path in (old, other):
        os.utime(path, (0, 0))
    module.write_text(LOOP.format(factor=5))
    assert run(module, cache)[0] == (35, 0, 1)
    assert other.exists()
    assert not old.exists()


# --- what the compiler changes --------------------------------------------------------------------

Record = namedtuple("Record", "values inner number")
Inner = namedtuple("Inner", "table at")


def element_of(record, row, column):
    table = record.inner.table
    return record.values[row] + record.number * table[row, column] + record.inner.at[0]


@pytest.mark.slow
def test_fields_of_records_and_elements_are_those_that_python_reads():
    part = compiled.part_with_arrays(element_of)

    @compiled.allocation_free
    def loop(record, rows, columns, out):
        for k in range(len(rows)):
            out[k] = part(record, rows[k], columns[k])
            out[-1] += 1

    rng = np.random.default_rng(0)
    tables = (
        rng.random((3, 4)),
        np.asfortranarray(rng.random((3, 4))),
        rng.random((6, 8))[::2, 1::2],
    )
    for table in (*tables, (100 * tables[0]).astype(np.uint8), tables[0] > 0.5):
        record = Record(rng.random(9)[::-3], Inner(table, np.array([7], np.int8)), 2.5)
        rows, columns = np.array([0, 2, -1, -3, 1]), np.array([-4, 3, -1, 0, 2], np.int32)
        out = np.zeros(6)
        loop(record, rows, columns, out)
        expected = [element_of(record, *at) for at in zip(rows, columns, strict=True)]
        assert out.tolist() == [*expected, 5.0]


def test_no_file_outside_kernels_decides_what_is_compiled():
    """A change of any of them compiles nothing: the digest of a loop is of kernels alone."""
    folder = Path(compiled.__file__).parent
    reached, files = set(), set(folder.glob("*.py"))
    while files:
        reached |= files
        files = {found for file in files for found in compiled._read_module(file)[1]} - reached
    assert len(reached) > 40
    assert {path for path in reached if path.parent != folder} == set()


def test_no_loop_is_compiled_outside_kernels():
    package = Path(compiled.__file__).parents[1]
    outside = [path for path in package.rglob("*.py") if path.parent != package / "kernels"]
    assert len(outside) > 150
    for path in outside:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "rastercov.kernels.jit":
                assert {name.name for name in node.names} <= {"compiled_aside", "is_compiled"}


def test_a_record_is_refused_from_a_loop_of_another_compiler():
    # Two conventions for the same function would read one another's arguments wrongly.
    part = compiled.part_with_arrays(element_of)

    @numba.njit
    def loop(record):
        return part(record, 0, 0)

    with pytest.raises(TypeError, match="element_of takes a named tuple"):
        loop(Record(np.ones(1), Inner(np.ones((1, 1)), np.ones(1)), 1.0))


# --- processes and clocks -------------------------------------------------------------------------

SLOW = """
import time
from rastercov.kernels import jit

@jit.compiled
def loop(number):
    return 3 * number

template = loop._compiler.compile
def slowly(*args):
    time.sleep(2)
    return template(*args)

loop._compiler.compile = slowly
"""


@pytest.mark.slow
def test_a_process_waits_for_a_loop_that_another_one_compiles(module, tmp_path):
    end = (
        "print(loop(7), sum(loop.stats.cache_hits.values()), sum(loop.stats.cache_misses.values()))"
    )
    module.write_text(SLOW + end)
    path = f"{module.parent}{os.pathsep}{ROOT}"
    environment = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = [sys.executable, "-c", "import kept"]
    running = [
        subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    found = [process.communicate(timeout=300)[0].split() for process in running]
    assert sorted(found) == [["21", "0", "1"], ["21", "1", "0"], ["21", "1", "0"]]


def test_a_loop_that_does_not_compile_leaves_nothing_locked():
    @compiled.compiled
    def loop(number):
        return number.missing

    for _ in range(2):
        with pytest.raises(numba.core.errors.TypingError):
            loop(1)
    assert loop._cache._held is None


def test_no_stopwatch_counts_the_time_in_which_loops_are_compiled():
    @compiled.compiled
    def inner(number):
        return number + 1

    @compiled.compiled
    def loop(number):
        return inner(number) + inner(2.0 * number)

    clock, began = Stopwatch(), time.perf_counter()
    loop._cache._load = inner._cache._load = lambda *_: None
    assert loop(1) == 5
    whole = time.perf_counter() - began
    assert whole > 0.05
    assert 0 < clock.seconds < 0.3 * whole
