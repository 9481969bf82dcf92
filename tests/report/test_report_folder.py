"""A report folder: one command at a time, nobody else's files, one whole report or none."""

import errno
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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


def refused(folder, words, files=OLD):
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
    (tmp_path / "notes.md").write_bytes(b"mine")
    (tmp_path / "matrix").mkdir()
    (tmp_path / "matrix" / "a.txt").write_bytes(b"mine, too")
    write(tmp_path, NEW)
    mine = {"notes.md": b"mine", "matrix/a.txt": b"mine, too"}
    assert reports(tmp_path) == NEW | mine
    assert content(tmp_path).keys() - reports(tmp_path).keys() == {KIND.manifest}


def test_the_manifest_has_size_and_hash_of_each_file(tmp_path):
    write(tmp_path, OLD)
    told = json.loads((tmp_path / KIND.manifest).read_bytes())
    assert (told["report"], told["last"]) == ("kind", "last.txt")
    assert told["files"].keys() == OLD.keys()
    assert told["files"]["b.txt"] == {
        "bytes": 2,
        "sha256": "4fc82b26aecb47d2868c4efbe3581732a3e7cbcc6c2efb32062c08170a05eeb8",
    }


def test_reports_of_two_kinds_share_a_folder(tmp_path):
    write(tmp_path, OLD)
    write(tmp_path, {"last.png": b"picture"}, OTHER)
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW | {"last.png": b"picture"}


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
    write(tmp_path, OLD)
    before = content(tmp_path)
    with pytest.raises(type(error)):
        fail_in(tmp_path, error)
    assert content(tmp_path) == before


def test_a_folder_that_was_made_for_nothing_is_removed(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fail_in(tmp_path / "a" / "b", ZeroDivisionError())
    assert list(tmp_path.iterdir()) == []


# --- files of others ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["b.txt", "zzz.txt", "last.txt"])
@pytest.mark.parametrize("before", [{}, OLD])
def test_a_file_that_no_manifest_lists_is_refused_and_kept(tmp_path, name, before):
    if before:
        write(tmp_path, before)
    if name in before:
        (tmp_path / KIND.manifest).unlink()
    (tmp_path / name).write_bytes(b"mine")
    refused(tmp_path, r"not of an earlier report.*; name another folder", NEW)


@pytest.mark.parametrize("name", OLD)
def test_a_file_of_ours_that_was_changed_is_refused_and_kept(tmp_path, name):
    write(tmp_path, OLD)
    stamp = (tmp_path / name).stat().st_mtime_ns
    data = bytes([OLD[name][0] ^ 1]) + OLD[name][1:]  # of the same size
    (tmp_path / name).write_bytes(data)
    os.utime(tmp_path / name, ns=(stamp, stamp))
    refused(tmp_path, rf"{re.escape(name)}: changed since it was written", NEW)


def test_a_file_of_ours_that_became_a_link_or_a_folder_is_refused_and_kept(tmp_path):
    write(tmp_path / "out", OLD)
    (tmp_path / "mine").write_bytes(OLD["a.txt"])
    (tmp_path / "out" / "a.txt").unlink()
    (tmp_path / "out" / "a.txt").symlink_to(tmp_path / "mine")
    refused(tmp_path / "out", "changed since", NEW)
    (tmp_path / "out" / "a.txt").unlink()
    (tmp_path / "out" / "a.txt").mkdir()
    refused(tmp_path / "out", "changed since", NEW)
    assert (tmp_path / "mine").read_bytes() == OLD["a.txt"]


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


@pytest.mark.parametrize(
    "text",
    [
        *(b"", b"{", b"[]", b"null", b'{"files": []}'),
        b'{"files": {"a.txt": 1}}',
        b'{"files": {"../mine.txt": {"bytes": 4, "sha256": ""}}}',
        b'{"files": {"/mine.txt": {"bytes": 4, "sha256": ""}}}',
        b'{"files": {"notes.md": {"bytes": 4, "sha256": ""}}}',
    ],
)
def test_a_manifest_that_is_damaged_or_lies_deletes_nothing(tmp_path, text):
    write(tmp_path / "out", OLD)
    (tmp_path / "mine.txt").write_bytes(b"mine")
    (tmp_path / "out" / "notes.md").write_bytes(b"mine")
    (tmp_path / "out" / KIND.manifest).write_bytes(text)
    refused(tmp_path / "out", "damaged", NEW)
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


@pytest.mark.parametrize("path", ["", " ", "\t"])
def test_a_name_without_a_name_is_refused(path):
    with pytest.raises(ConfigError, match="empty name"):
        ReportFolder(path, KIND)


def test_only_names_of_the_kind_are_written(tmp_path):
    with ReportFolder(tmp_path, KIND) as out:
        for name in ("a.png", "../a.txt", "a/b.txt", KIND.manifest):
            with pytest.raises(ValueError, match="no file of a report"):
                out.file(name)


# --- one command at a time ------------------------------------------------------------------------


def test_a_second_command_is_refused_and_changes_nothing(tmp_path):
    write(tmp_path, OLD)
    with ReportFolder(tmp_path, KIND) as out:
        out.file("b.txt").write_bytes(b"half")
        before = content(tmp_path)
        stamps = [path.stat().st_mtime_ns for path in sorted(tmp_path.rglob("*"))]
        for kind in (KIND, OTHER):
            with pytest.raises(ConfigError, match="another process is writing to this folder"):
                write(tmp_path, NEW, kind)
        assert content(tmp_path) == before
        assert [path.stat().st_mtime_ns for path in sorted(tmp_path.rglob("*"))] == stamps
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW


def test_a_folder_removed_while_it_is_locked_is_made_again(tmp_path, monkeypatch):
    flock = fcntl.flock
    left = [2]

    def remove(descriptor, how):
        flock(descriptor, how)
        if left[0]:
            left[0] -= 1
            (tmp_path / "out").rmdir()

    monkeypatch.setattr(fcntl, "flock", remove)
    write(tmp_path / "out", NEW)
    assert reports(tmp_path / "out") == NEW


def test_a_file_system_without_locks_is_written_to(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    write(tmp_path, NEW)
    assert reports(tmp_path) == NEW


# --- when it is ended, or the disk fails ----------------------------------------------------------


@pytest.mark.slow
def test_a_kill_before_any_operation_leaves_one_whole_report_or_no_last_file(tmp_path):
    """At each of about fifty operations, and at each of those that make up for it."""
    words = [sys.executable, Path(__file__).parents[1] / "support" / "kill_report.py", tmp_path]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["killed"].keys() == {"old", "new", "incomplete"}
    assert found["after"].keys() == {"old", "new"}
    assert found["kills"] > 30
    assert min(*found["killed"].values(), *found["after"].values()) > 10


def failing(real, number, first, last):
    """An operation that fails from its `first` call to its `last`, from 1."""
    calls = 0

    def fail(*arguments, **options):
        nonlocal calls
        calls += 1
        if first <= calls <= last:
            raise OSError(number, os.strerror(number))
        return real(*arguments, **options)

    return fail


@pytest.mark.parametrize(
    ("operation", "number"),
    [("fsync", errno.EIO), ("rename", errno.ENOSPC), ("replace", errno.ENOSPC),
     ("mkdir", errno.EDQUOT), ("mkdir", errno.ENOSPC)],
)  # fmt: skip
def test_a_disk_that_fails_leaves_the_old_report_and_names_a_file(
    tmp_path, monkeypatch, operation, number
):
    """At its first operation of a kind, at its second, and so on until it is not reached."""
    write(tmp_path, OLD)
    (tmp_path / "notes.md").write_bytes(b"mine")
    before = content(tmp_path)
    module = os if operation == "fsync" else Path
    errors = []
    for at in range(1, 100):
        with monkeypatch.context() as patch:
            patch.setattr(module, operation, failing(getattr(module, operation), number, at, at))
            try:
                write(tmp_path, NEW)
                break
            except (OSError, ConfigError) as error:
                errors.append(error)
        assert content(tmp_path) == before
        assert not (tmp_path / STAGING).exists()
    assert reports(tmp_path) == NEW | {"notes.md": b"mine"}
    assert len(errors) >= {"fsync": 6, "rename": 6, "replace": 2, "mkdir": 3}[operation]
    for error in errors:
        if isinstance(error, ConfigError):  # of the folder itself
            assert os.strerror(number) in str(error)
            continue
        assert error.errno == number
        assert Path(error.filename).parent == tmp_path
        assert not Path(error.filename).name.endswith(".part")


@pytest.mark.parametrize("at", range(1, 9))
def test_a_disk_that_fails_for_good_in_a_swap_loses_nothing(tmp_path, monkeypatch, at):
    """Renames fail from one on, so that those before cannot be undone."""
    write(tmp_path, OLD)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", failing(Path.rename, errno.EIO, at, 1000))
        try:
            write(tmp_path, NEW)
        except OSError:
            assert at <= 6
        else:
            assert at > 6
    found = reports(tmp_path)
    assert found in (OLD, NEW) or "last.txt" not in found
    with ReportFolder(tmp_path, KIND):
        assert reports(tmp_path) in (OLD, NEW)
    assert not (tmp_path / STAGING).exists()


def test_an_error_of_a_file_names_it_as_it_will_be(tmp_path):
    with pytest.raises(OSError, match="No space") as caught, ReportFolder(tmp_path, KIND) as out:
        raise OSError(errno.ENOSPC, "No space left on device", str(out.file("b.txt")))
    assert caught.value.filename == str(tmp_path / "b.txt")


def half_swapped(folder):
    """A folder as a kill leaves it in the midst of a swap: the new report is on record."""
    write(folder, OLD)
    rename = Path.rename
    moved = []

    def stop(source, target):
        if len(moved) == 4:
            os._exit(9)
        moved.append(source)
        return rename(source, target)

    process = os.fork()
    if not process:
        Path.rename = stop
        write(folder, NEW)
        os._exit(0)
    assert os.waitpid(process, 0)[1] != 0
    assert "last.txt" not in reports(folder)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("kind", [KIND, OTHER])
def test_the_next_command_of_any_kind_ends_a_swap(tmp_path, kind):
    half_swapped(tmp_path)
    with ReportFolder(tmp_path, kind):
        assert reports(tmp_path) == NEW
    assert content(tmp_path).keys() == NEW.keys() | {KIND.manifest}


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.parametrize("name", ["last.txt", "c.txt", "b.txt"])
def test_a_swap_does_not_end_over_a_file_of_somebody_else(tmp_path, name):
    half_swapped(tmp_path)
    (tmp_path / name).write_bytes(b"mine")
    if name == "b.txt":  # in place already, and changed since
        with pytest.raises(ConfigError, match=r"b\.txt: changed since it was written"):
            write(tmp_path, OLD)
        assert (tmp_path / "b.txt").read_bytes() == b"mine"
        return
    refused(tmp_path, r"in the way.*; move it away")
    (tmp_path / name).unlink()
    with ReportFolder(tmp_path, KIND):
        assert reports(tmp_path) == NEW


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_swap_that_cannot_end_says_what_to_delete(tmp_path):
    half_swapped(tmp_path)
    kept = (tmp_path / STAGING / KIND.manifest).read_bytes()
    (tmp_path / STAGING / KIND.manifest).write_bytes(kept[:40])
    refused(tmp_path, r"damaged.*delete")
    (tmp_path / STAGING / KIND.manifest).write_bytes(kept)
    (tmp_path / STAGING / "new" / "last.txt").unlink()
    refused(tmp_path, r"last\.txt: missing.*delete")


def test_a_hidden_folder_with_something_else_in_it_is_refused(tmp_path):
    (tmp_path / STAGING / "mine").mkdir(parents=True)
    (tmp_path / STAGING / "mine" / "notes.md").write_bytes(b"mine")
    refused(tmp_path, "move it away")


def test_an_interrupt_in_a_swap_comes_after_it(tmp_path, monkeypatch):
    write(tmp_path, OLD)
    sync = report_folder._sync
    monkeypatch.setattr(
        report_folder, "_sync", lambda path: (signal.raise_signal(signal.SIGINT), sync(path))
    )
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            write(tmp_path, NEW)
    finally:
        signal.signal(signal.SIGINT, before)
    assert reports(tmp_path) == NEW
