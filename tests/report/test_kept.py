"""What is made of files of the package alone is kept, and made anew where they changed."""

import os
import sys
from pathlib import Path

import pytest

from rastercov.report import live, pages

NAMES = {
    pages.bundle_scripts: ("main",),
    live._catalogue: (),
    live._deflate_module: (live.ENGINE,),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Folder of what is kept; nothing is at first."""
    monkeypatch.setattr(sys, "pycache_prefix", str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    place = tmp_path / Path(pages.__file__).parent.relative_to("/")
    place.mkdir(parents=True)
    pages._environment.cache_clear()
    yield place
    pages._environment.cache_clear()


@pytest.mark.parametrize(("make", "words"), NAMES.items())
def test_what_is_kept_is_what_is_made(folder, make, words):
    made = make(*words)
    (path,) = folder.iterdir()
    kept = path.stat().st_mtime_ns
    assert make(*words) == made
    assert path.stat().st_mtime_ns == kept
    path.write_bytes(path.read_bytes()[:-100])  # damaged
    assert make(*words) == made
    path.write_bytes(b"")
    assert make(*words) == made
    assert path.stat().st_size > len(made) / 2


def test_what_is_kept_is_as_old_as_the_package(folder, monkeypatch):
    answers = iter(["old", "new"])
    text = pages.kept(lambda: next(answers))
    assert [text(), text()] == ["old", "old"]
    monkeypatch.setattr(pages, "_state", lambda: "of another package")
    assert [text(), text()] == ["new", "new"]


def test_each_file_of_the_package_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(pages.rastercov, "__file__", str(tmp_path / "__init__.py"))
    for name in (
        "__init__.py",
        "web/main.js",
        "web/engine.wasm",
        "data/cameras.toml",
        "a/b/c.html",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
        states = set()
        for second in (1, 2):
            os.utime(path, (second, second))
            states.add(pages._state.__wrapped__())
        path.write_text(name + ", larger")
        os.utime(path, (2, 2))  # as a wheel that gives all files one time
        states.add(pages._state.__wrapped__())
        assert len(states) == 3
    before = pages._state.__wrapped__()
    monkeypatch.setattr(pages.rastercov, "__version__", "another")
    assert pages._state.__wrapped__() != before
    monkeypatch.undo()
    monkeypatch.setattr(pages.rastercov, "__file__", str(tmp_path / "__init__.py"))
    cached = tmp_path / "__pycache__" / "a.cpython-311.pyc"
    cached.parent.mkdir()
    cached.write_text("code of a module that was loaded since")
    assert pages._state.__wrapped__() == before


def test_nothing_is_kept_where_python_keeps_nothing(folder, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert live._catalogue()
    assert pages._environment("rastercov.report").get_template("report.html")
    assert not list(folder.iterdir())


def test_pages_are_made_where_nothing_can_be_kept(folder):
    folder.rmdir()
    assert live._catalogue()
    assert pages._environment("rastercov.report").get_template("report.html")


def test_templates_are_kept_and_the_same(folder):
    def code():
        pages._environment.cache_clear()
        template = pages._environment("rastercov.report").get_template("report.html")
        return template.root_render_func.__code__, {path.name for path in folder.iterdir()}

    made, names = code()
    assert any(name.endswith(".pyc") for name in names)
    assert code() == (made, names)
