"""No path of ours follows a symbolic link that a person has not named."""

import ast
import os
import re
from pathlib import Path

import numpy as np
import planted_links
import pytest
from commands import refusal
from nightly import amount
from rigs_to_view import part, session_of

from rastercov.base.errors import ConfigError
from rastercov.base.output import own_folder, remove_file, write_bytes
from rastercov.core.coverage.shards import FILES
from rastercov.placement.plan.prepare import OF_A_MATRIX
from rastercov.report.folder import NEW, STAGING, ReportFolder, ReportKind
from rastercov.shards.store import ShardStore, remove, remove_halves, store

ROOT = Path(__file__).parents[1]
KIND = ReportKind("evaluate", re.compile(r"summary\.json|pose_\d+\.png"), last="summary.json")
SAMPLE = amount(2, at_night=12)
"""Links of each command in a run of the tests; `benchmarks/attack.py links` tries all."""


@pytest.fixture
def outside(tmp_path):
    """A folder of somebody else, with names of ours."""
    folder = tmp_path / "outside"
    for name in ("summary.json", "pose_1.png", ".0123456789ab.part", ".rastercov-evaluate.json",
                 "shard-00000.npz", "header.json", "header.json.sha256", "new/summary.json",
                 "shards/shard-00000.npz", "sha256/header.json.sha256"):  # fmt: skip
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"of somebody else")
    before = content(folder)
    yield folder
    assert content(folder) == before


def content(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


# --- one place ------------------------------------------------------------------------------------

WRITES = {
    "mkdir", "makedirs", "rmdir", "removedirs", "rmtree", "unlink", "remove_dir", "rename",
    "symlink_to", "hardlink_to", "symlink", "link", "touch", "truncate_file", "mkstemp", "copyfile",
    "copytree", "copy2", "move_file", "write_text", "write_bytes", "savetxt", "tofile",
}  # fmt: skip
"""Methods and functions that change what a folder has."""
OURS = {"write_text", "write_bytes"}
"""Of these, functions of `base/output.py`."""
OF_FILES = {"part", "archive", "formatter"}
"""Names of what `base/output.py` gives, of an archive in memory, and of no file."""
ELSEWHERE = {
    "base/streams.py": {"open"},  # descriptors of the process, and the null device
    "formats/meshes/ifc.py": {"write_bytes", "open"},  # a program in a new folder of its own
}


def writes_of(source):
    """Calls in a source that write or delete other than by `base/output.py`, by name and line."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        function, is_method = node.func, isinstance(node.func, ast.Attribute)
        name = function.attr if is_method else getattr(function, "id", "")
        if is_method and getattr(function.value, "id", "") in OF_FILES:
            continue
        words = [each.value for each in ast.walk(node) if isinstance(each, ast.Constant)]
        modes = [set(word) for word in words if re.fullmatch("[rwaxbt+]{1,3}", str(word))]
        is_ours = name in OURS and not is_method
        if (name in WRITES and not is_ours) or (
            name == "open" and any(mode & set("wax+") for mode in modes)
        ):
            yield name, node.lineno


def test_a_writer_is_found():
    items = [name for name, _ in writes_of("""
path.write_text("x"); part.write_bytes(b""); write_text(path, ""); open(path, "wb"); path.unlink()
path.open("w"); part.open("wb"); os.rename(a, b); file.open(path); shutil.rmtree(path)
""")]  # fmt: skip
    assert sorted(items) == ["open", "open", "rename", "rmtree", "unlink", "write_text"]


@pytest.mark.parametrize("folder", ["rastercov", "reference"])
def test_files_are_written_and_deleted_by_one_module_alone(folder):
    items = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        name = path.relative_to(ROOT / folder).as_posix()
        if name == "base/output.py" or name.startswith(("reference/", "shaders/")):
            continue
        allowed = ELSEWHERE.get(name, set())
        calls = writes_of(path.read_text(encoding="utf-8"))
        items += [f"{name}:{line}: {call}" for call, line in calls if call not in allowed]
    assert items == []


# --- links in the places of ours ------------------------------------------------------------------


@pytest.mark.parametrize(
    "place", [STAGING, f"{STAGING}/{NEW}", f"{STAGING}/{KIND.manifest}"]
)  # fmt: skip
def test_a_hidden_folder_that_is_a_link_is_refused(tmp_path, outside, place):
    link = tmp_path / "out" / place
    link.parent.mkdir(parents=True)
    to = outside / KIND.manifest if place.endswith(".json") else outside
    link.symlink_to(os.path.relpath(to, link.parent))
    with (
        pytest.raises(ConfigError, match=re.escape(link.name)) as caught,
        ReportFolder(tmp_path / "out", KIND),
    ):
        pass
    assert "\n" not in str(caught.value)
    assert link.is_symlink()


@pytest.mark.parametrize("name", ["summary.json", "pose_1.png", "pose_7.png"])
def test_links_in_the_hidden_folder_are_removed_themselves(tmp_path, outside, name):
    new = tmp_path / "out" / STAGING / NEW
    new.mkdir(parents=True)
    (new / name).symlink_to(outside / name)
    (new / "mine.md").write_bytes(b"mine")
    with ReportFolder(tmp_path / "out", KIND) as folder:
        folder.file("summary.json").write_bytes(b"ours")
        folder.publish()
    assert (tmp_path / "out/summary.json").read_bytes() == b"ours"
    assert (new / "mine.md").read_bytes() == b"mine"
    assert not (new / name).is_symlink()


def test_a_link_to_the_folder_itself_is_that_of_the_person(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "out").symlink_to("real")
    with ReportFolder(tmp_path / "out", KIND) as folder:
        folder.file("summary.json").write_bytes(b"ours")
        folder.publish()
    assert (tmp_path / "real/summary.json").read_bytes() == b"ours"
    assert (tmp_path / "out").is_symlink()


@pytest.mark.parametrize("place", ["shards", "sha256", "quarantine"])
def test_a_folder_of_shards_that_is_a_link_is_not_followed(tmp_path, outside, place):
    folder = tmp_path / "job"
    folder.mkdir()
    (folder / place).symlink_to(outside)
    shards = ShardStore(folder, "shards/shard-{}.npz", 8, 4, "none:none")
    remove_halves(folder)
    for act in (
        lambda: remove(folder, FILES), lambda: remove(folder, OF_A_MATRIX),
        lambda: store(folder, f"{place}/shard-00000.npz", b"ours"),
        lambda: shards.note(0, {1: "why"}), lambda: shards.note(0, {}),
        lambda: shards.mend(lambda line: None, shards.read, range(len(shards))),
    ):  # fmt: skip
        try:
            act()
        except ConfigError as error:
            assert "symbolic link" in str(error)  # noqa: PT017 - others do not go there
    assert (folder / place).is_symlink()


def test_a_link_to_a_file_in_its_folder_stays_and_any_other_is_refused(tmp_path, outside):
    (tmp_path / "here.json").symlink_to("target.json")
    write_bytes(tmp_path / "here.json", b"ours")
    assert (tmp_path / "here.json").is_symlink()
    assert (tmp_path / "target.json").read_bytes() == b"ours"
    ring = tmp_path / "ring"
    ring.symlink_to("ring")
    for to in (outside / "summary.json", "outside/new.json", "/dev/full", "ring", ".."):
        link = tmp_path / "link.json"
        link.symlink_to(to)
        with pytest.raises(ConfigError, match=r"link\.json: "):
            write_bytes(link, b"ours")
        remove_file(link)
    with pytest.raises(ConfigError, match="expected a folder, got a symbolic link"):
        own_folder(ring)


@pytest.mark.parametrize(
    "line",
    [
        "evaluate part.obj -c camera.json -p poses.json --pictures 0 -o ring",
        "convert poses.json ring",
        "convert poses.json ring/new.json",
        "place plan.toml -o ring",
    ],
)
def test_a_ring_of_links_is_refused_in_one_line(tmp_path, monkeypatch, capsys, line):
    folder = tmp_path / "work"
    planted_links.fill(folder)
    (folder / "ring").symlink_to("ring")
    monkeypatch.chdir(folder)
    assert refusal(capsys, line).startswith("error: ring")


def test_what_the_process_has_open_is_written_to(tmp_path):
    with (tmp_path / "file").open("wb") as file:
        write_bytes(f"/dev/fd/{file.fileno()}", b"ours")
    assert (tmp_path / "file").read_bytes() == b"ours"
    write_bytes("/dev/null", b"ours")


# --- commands -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("line", planted_links.COMMANDS)
def test_no_command_follows_a_link_in_a_place_of_its_own(tmp_path, line):
    names = planted_links.names_of(line, tmp_path / "seen")
    assert names
    every = [(name, kind) for name in names for kind in planted_links.KINDS]
    for row in np.random.default_rng(len(line)).permutation(len(every))[:SAMPLE]:
        assert not planted_links.fault_of(line, names, *every[row], tmp_path / "links"), every[row]


@pytest.mark.parametrize("name", ["report", "rig.json", "task.toml"])
def test_the_viewer_saves_through_no_link(tmp_path, outside, name):
    pytest.importorskip("starlette")
    from rastercov.page.saving import Saving

    saving = Saving(session_of(part(), 2), tmp_path / "out")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).symlink_to(outside if name == "report" else outside / "summary.json")
    is_report = name == "report"
    asked = {"what": name} if is_report else {"what": "rig", "texts": {name[:-5]: "{}"}}
    with pytest.raises(ConfigError, match="symbolic link"):
        saving.save(asked)
