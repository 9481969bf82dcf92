"""A report folder: one command at a time, nobody else's files, one whole report or none."""

import errno
import fcntl
import json
import os
import re
import shutil
import signal
from itertools import count
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from processes import run_python

from rastercov.base.errors import ConfigError
from rastercov.report import folder as report_folder
from rastercov.report.folder import STAGING, ReportFolder, ReportKind

KIND = ReportKind("kind", re.compile(r"(\w+)\.txt"), last="last.txt")
OTHER = ReportKind("other", re.compile(r"(\w+)\.png"), last="last.png")
OLD = {"a.txt": b"1", "b.txt": b"11", "last.txt": b"1 says it"}
NEW = {"b.txt": b"2", "c.txt": b"222", "last.txt": b"2 says it"}


def write(folder, files, kind=KIND):
    with ReportFolder(folder, kind) as out:
        for name, data in files.items():
            out.file(name).write_bytes(data)
        out.publish()


def fail_in(folder, error):
    with ReportFolder(folder, KIND) as out:
        out.file("b.txt").write_bytes(b"half")
        raise error


def refused(folder, words, files=NEW):
    """A report is refused, and no file of the folder is changed."""
    before = content(folder)
    with pytest.raises(ConfigError, match=words):
        write(folder, files)
    assert content(folder) == before


def content(folder):
    """Files of a folder and of those in it, by their paths."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def reports(folder):
    """The same without what is hidden."""
    return {name: data for name, data in content(folder).items() if not name.startswith(".")}


# --- one whole report -----------------------------------------------------------------------------


def test_a_report_replaces_the_one_before_and_nothing_else(tmp_path):
    write(tmp_path, OLD)
    write(tmp_path, {"last.png": b"picture"}, OTHER)
    (tmp_path / "matrix").mkdir()
    mine = {"notes.md": b"mine", "matrix/a.txt": b"mine, too", "last.png": b"picture"}
    for name, data in mine.items():
        (tmp_path / name).write_bytes(data)
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW | mine
    hidden = content(tmp_path).keys() - reports(tmp_path).keys()
    assert hidden == {KIND.manifest, OTHER.manifest}


def test_the_manifest_has_size_and_hash_of_each_file(tmp_path):
    write(tmp_path, OLD)
    told = json.loads((tmp_path / KIND.manifest).read_bytes())
    digest = "4fc82b26aecb47d2868c4efbe3581732a3e7cbcc6c2efb32062c08170a05eeb8"
    assert (told["report"], told["last"]) == ("kind", "last.txt")
    assert told["files"].keys() == OLD.keys()
    assert told["files"]["b.txt"] == {"bytes": 2, "sha256": digest}


def test_nothing_is_in_its_place_before_all_of_it_is(tmp_path):
    with ReportFolder(tmp_path / "a" / "b", KIND) as out:
        for name, data in NEW.items():
            out.file(name).write_bytes(data)
            assert reports(tmp_path / "a" / "b") == {}
        out.publish()
        assert reports(tmp_path / "a" / "b") == NEW
        out.file("last.txt").write_bytes(b"and again")
        out.publish()
        assert reports(tmp_path / "a" / "b") == {"last.txt": b"and again"}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ConfigError("no"), OSError("odd")])
def test_a_block_that_fails_changes_nothing(tmp_path, error):
    write(tmp_path / "old", OLD)
    before = content(tmp_path)
    for folder in (tmp_path / "old", tmp_path / "made" / "for nothing"):
        with pytest.raises(type(error)):
            fail_in(folder, error)
    assert content(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


# --- files of others ------------------------------------------------------------------------------


def change(path):
    """Other content of the same size and age."""
    stamp, data = path.stat().st_mtime_ns, path.read_bytes()
    path.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    os.utime(path, ns=(stamp, stamp))


def link(path):
    (path.parent / "mine").write_bytes(path.read_bytes())
    path.unlink()
    path.symlink_to(path.parent / "mine")


def become_a_folder(path):
    path.unlink()
    path.mkdir()


def unlist(path):
    (path.parent / KIND.manifest).unlink()


def come(path):
    (path.parent / "zzz.txt").write_bytes(b"mine")


@pytest.mark.parametrize("name", OLD)
@pytest.mark.parametrize(
    ("happen", "words"),
    [*((happen, "{}: .* since it was written") for happen in (change, link, become_a_folder)),
     (unlist, r"a.txt and 2 more: expected a file of an earlier report.*; name another folder"),
     (come, r"zzz.txt: expected a file of an earlier report.*; name another folder")],
)  # fmt: skip
def test_what_is_no_unchanged_file_of_a_report_is_refused_and_kept(tmp_path, name, happen, words):
    write(tmp_path, OLD)
    happen(tmp_path / name)
    refused(tmp_path, words.format(name))


@pytest.mark.parametrize("name", OLD)
def test_a_file_of_ours_that_was_deleted_is_not_missed(tmp_path, name):
    write(tmp_path, OLD)
    (tmp_path / name).unlink()
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW


@pytest.mark.parametrize("name", ["b.txt", "c.txt", "a.txt"])
def test_a_file_that_comes_or_changes_during_the_run_is_kept_and_so_is_the_report(tmp_path, name):
    write(tmp_path, OLD)
    (tmp_path / "new-kind").mkdir()
    with ReportFolder(tmp_path, KIND) as out:
        for of_report, data in NEW.items():
            out.file(of_report).write_bytes(data)
        (tmp_path / name).write_bytes(b"mine")
        with pytest.raises(ConfigError, match=r"during the run.*new-kind-2$"):
            out.publish()
    aside = {f"new-kind-2/{of_report}": data for of_report, data in NEW.items()}
    assert reports(tmp_path) == OLD | {name: b"mine"} | aside


LIES = ("../mine.txt", "/mine.txt", "notes.md")


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", '{"files": []}', '{"last": "", "files": {"a.txt": 1}}',
     *(json.dumps({"last": "", "files": {name: {"bytes": 4, "sha256": ""}}}) for name in LIES),
     '{"last": "", "files": {"a.txt": {"bytes": Infinity, "sha256": ""}}}', "[" * 100_000],
)  # fmt: skip
def test_a_manifest_that_is_damaged_or_lies_deletes_nothing(tmp_path, text):
    write(tmp_path / "out", OLD)
    for path in ("mine.txt", "out/notes.md"):
        (tmp_path / path).write_bytes(b"mine")
    (tmp_path / "out" / KIND.manifest).write_text(text)
    refused(tmp_path / "out", "damaged")
    assert (tmp_path / "mine.txt").read_bytes() == b"mine"


@settings(max_examples=25)
@given(st.binary(max_size=60), st.integers(0, 400), st.sampled_from([0, 1, 30]))
def test_no_damage_to_a_manifest_loses_a_file(tmp_path_factory, damage, start, cut):
    folder = tmp_path_factory.mktemp("out")
    write(folder, OLD)
    (folder / "notes.md").write_bytes(b"mine")
    path = folder / KIND.manifest
    text = path.read_bytes()
    path.write_bytes(text[:start] + damage + text[start + cut :])
    before = content(folder)
    try:
        write(folder, NEW)
    except ConfigError:
        assert content(folder) == before
    else:  # such as a manifest of another version
        assert reports(folder) == NEW | {"notes.md": b"mine"}


def test_only_names_of_the_kind_are_written(tmp_path):
    with ReportFolder(tmp_path, KIND) as out:
        for name in ("a.png", "../a.txt", "a/b.txt", KIND.manifest):
            with pytest.raises(ValueError, match="expected a file of a kind report"):
                out.file(name)


def test_what_is_not_ours_in_the_hidden_folder_stays(tmp_path):
    (tmp_path / STAGING / "mine").mkdir(parents=True)
    (tmp_path / STAGING / "mine" / "notes.md").write_bytes(b"mine")
    write(tmp_path, NEW)
    assert (tmp_path / STAGING / "mine" / "notes.md").read_bytes() == b"mine"


# --- one command at a time ------------------------------------------------------------------------


def test_a_second_command_is_refused_and_changes_nothing(tmp_path):
    write(tmp_path, OLD)
    with ReportFolder(tmp_path, KIND) as out:
        out.file("b.txt").write_bytes(b"half")
        stamps = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        for kind in (KIND, OTHER):
            with pytest.raises(ConfigError, match="another process is writing to"):
                write(tmp_path, NEW, kind)
        assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == stamps
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW


def test_a_folder_that_is_removed_while_it_is_locked_is_refused(tmp_path, monkeypatch):
    flock = fcntl.flock

    def remove(descriptor, how):
        flock(descriptor, how)
        (tmp_path / "out").rmdir()

    monkeypatch.setattr(fcntl, "flock", remove)
    with pytest.raises(ConfigError, match="another process is writing to"):
        write(tmp_path / "out", NEW)


def test_a_file_system_without_locks_is_written_to(tmp_path, monkeypatch):
    none = OSError(errno.ENOLCK, "No locks available")
    monkeypatch.setattr(fcntl, "flock", Mock(side_effect=none))
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW


def test_a_report_of_another_user_in_a_folder_for_all_is_refused_at_once(tmp_path, monkeypatch):
    """Only the owner may remove it there: a swap that began would leave a part of both."""
    write(tmp_path, OLD)
    tmp_path.chmod(0o1777)
    write(tmp_path, NEW)
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    refused(tmp_path, "expected a report of your own in a shared folder")
    write(tmp_path, {"last.png": b"beside it"}, OTHER)
    tmp_path.chmod(0o777)
    write(tmp_path, OLD)


# --- when it is ended, or the disk fails ----------------------------------------------------------


@pytest.mark.slow
def test_a_kill_before_any_operation_leaves_one_whole_report_or_no_last_file(tmp_path):
    """At each of about fifty operations, and at each of those that make up for it."""
    program = Path(__file__).parents[1] / "support" / "kill_report.py"
    content = json.loads(run_python(program, tmp_path, OPENBLAS_NUM_THREADS="1").stdout)
    assert content["killed"].keys() == {"old", "new", "incomplete"}
    assert content["after"].keys() == {"old", "new"}
    assert content["kills"] > 30
    assert min(*content["killed"].values(), *content["after"].values()) > 5


@pytest.mark.slow
def test_a_kill_of_any_command_at_any_moment_leaves_an_old_a_new_or_a_marked_folder(tmp_path):
    """Of evaluate, place and check; a manifest in its place lists the files that are there."""
    program = Path(__file__).parents[1] / "support" / "stop_commands.py"
    table = json.loads(run_python(program, tmp_path, OPENBLAS_NUM_THREADS="1").stdout)
    for name, (found, opened, again) in table.items():
        marked = {"unfinished"} if name == "place False" else set()
        assert found.keys() == {"old", "new", "incomplete"} | marked
        assert opened.keys() - {"left"} == {"old", "new"} | marked
        assert again.keys() == {"new", "left"}
        assert not opened["left"] + again["left"]
        assert opened["old"] > 5
        assert opened["new"] > 5


def failing(real, number, first, last):
    """An operation that fails from its `first` call to its `last`, from 1."""
    calls = count(1)

    def fail(*arguments, **options):
        if first <= next(calls) <= last:
            raise OSError(number, os.strerror(number))
        return real(*arguments, **options)

    return fail


@pytest.mark.parametrize(
    ("operation", "number", "least"),
    [("fsync", errno.EIO, 6), ("replace", errno.ENOSPC, 5),
     ("unlink", errno.EIO, 3), ("mkdir", errno.EDQUOT, 3)],
)  # fmt: skip
@pytest.mark.parametrize("last", [0, 1000])
def test_a_disk_that_fails_leaves_a_report_whole_in_the_end_and_names_a_file(
    tmp_path, monkeypatch, operation, number, least, last
):
    """At its first operation of a kind, at its second, and so on; once, or from there on."""
    module, errors = os if operation == "fsync" else Path, []
    whole = [report | {"notes.md": b"mine"} for report in (OLD, NEW)]
    for at in range(1, 10):
        folder = tmp_path / str(at)
        write(folder, OLD)
        (folder / "notes.md").write_bytes(b"mine")
        with monkeypatch.context() as patch:
            fail = failing(getattr(module, operation), number, at, max(at, last))
            patch.setattr(module, operation, fail)
            try:
                write(folder, NEW)
            except (OSError, ConfigError) as error:
                errors.append(error)
        result = reports(folder)
        assert result in whole or "last.txt" not in result
        with ReportFolder(folder, KIND):
            assert reports(folder) in whole
        assert not (folder / STAGING).exists()
    assert len(errors) >= least
    assert all(os.strerror(number).lower() in str(error).lower() for error in errors)
    for error in errors:
        if not isinstance(error, ConfigError):  # of the folder itself
            assert Path(error.filename).parent.parent == tmp_path
            assert not error.filename.endswith(".part")


def test_an_error_of_a_file_names_it_as_it_will_be(tmp_path):
    with pytest.raises(OSError, match="No space") as caught, ReportFolder(tmp_path, KIND) as out:
        raise OSError(errno.ENOSPC, "No space left on device", str(out.file("b.txt")))
    assert caught.value.filename == str(tmp_path / "b.txt")


@pytest.fixture
def half_swapped(tmp_path, monkeypatch):
    """A folder as an end in the midst of a swap leaves it: the new report is on record."""
    write(tmp_path, OLD)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", failing(Path.replace, errno.ENOSPC, 4, 1000))
        with pytest.raises(OSError, match="No space"):
            write(tmp_path, NEW)
    assert reports(tmp_path) == {"b.txt": NEW["b.txt"]}
    return tmp_path


@pytest.mark.parametrize("kind", [KIND, OTHER])
def test_the_next_command_of_any_kind_ends_a_swap(half_swapped, kind):
    with ReportFolder(half_swapped, kind):
        assert reports(half_swapped) == NEW
    assert content(half_swapped).keys() == NEW.keys() | {KIND.manifest}


@pytest.mark.parametrize("name", ["last.txt", "c.txt"])
def test_a_swap_does_not_end_over_a_file_of_somebody_else(half_swapped, name):
    (half_swapped / name).write_bytes(b"mine")
    refused(half_swapped, r"expected a file of an interrupted report.*; move it away", OLD)
    (half_swapped / name).unlink()
    with ReportFolder(half_swapped, KIND):
        assert reports(half_swapped) == NEW


def test_a_swap_keeps_a_file_in_place_that_somebody_has_changed_since(half_swapped):
    (half_swapped / "b.txt").write_bytes(b"mine")
    with pytest.raises(ConfigError, match=r"b\.txt: .* changed since it was written"):
        write(half_swapped, OLD)
    assert (half_swapped / "b.txt").read_bytes() == b"mine"


def test_a_swap_whose_record_is_damaged_says_what_to_delete(half_swapped):
    journal = half_swapped / STAGING / KIND.manifest
    journal.write_bytes(journal.read_bytes()[:40])
    refused(half_swapped, r"damaged.*delete", OLD)
    shutil.rmtree(half_swapped / STAGING)
    refused(half_swapped, r"b\.txt: .* changed since it was written", OLD)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_in_a_swap_comes_after_it(tmp_path, monkeypatch, number):
    write(tmp_path, OLD)
    sync = report_folder.sync
    steps = Mock(side_effect=lambda path: (signal.raise_signal(number), sync(path)))
    monkeypatch.setattr(report_folder, "sync", steps)
    before = signal.signal(number, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path, NEW)
    assert signal.signal(number, before) is signal.default_int_handler
    assert reports(tmp_path) == NEW
