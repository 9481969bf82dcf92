"""Parts of a run by commands that share a folder: an array of jobs, of which one is killed."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import rastercov as rc
from rastercov.cli import command
from rastercov.core.coverage import shards
from rastercov.core.mesh import shapes
from rastercov.motion import over_time
from rastercov.placement.plan import goals, rig_parts
from rastercov.shards import Workers

pytestmark = pytest.mark.slow
N = 4
SMALL = (
    "import sys; from rastercov.core.coverage import shards; "
    "shards.PAIRS_A_SHARD = {size}; from rastercov.cli import command; "
    "sys.exit(command(sys.argv[1:]))"
)
PLAN = """\
meshes = [{ built_in = "box" }]
camera = { width = 64, height = 48, hfov_deg = 60 }
candidates = [{ generator = "on_sphere", count = 40 }]
selection = { goal = "best_coverage", cameras = 2 }
task = { max_incidence_deg = 70 }
"""
EVALUATE = ("evaluate", "torus", "-c", "khepra", "-p", "sphere:60", "--pictures", "0")


def start(words, size):
    """A command in a process of its own, with shards of so many pairs."""
    program = [sys.executable, "-c", SMALL.format(size=size), *words]
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def content(folder):
    """Bytes of the files of a report, without times and options."""
    files = {}
    for path in folder.iterdir():
        if path.is_file() and path.suffix not in (".html", ".pdf") and path.name[0] != ".":
            files[path.name] = path.read_bytes()
    result = json.loads(files.pop("summary.json"))
    for name in ("seconds", "poses_per_second", "run"):
        result.pop(name)
    return files, result


def test_four_commands_share_a_folder_and_one_that_is_killed_is_made_up_for(tmp_path, monkeypatch):
    size = 2 * shapes.by_name("torus").n_faces
    out = tmp_path / "shared"
    words = (*EVALUATE, "--out", str(out))
    parts = [start((*words, "--only", f"{part}/{N}"), size) for part in range(N)]
    while not [*out.glob("unfinished/*/shards/*.npz")]:  # it is at work
        assert parts[-1].poll() in (None, 0)
        time.sleep(0.02)
    parts[-1].send_signal(signal.SIGKILL)
    said = [each.communicate() for each in parts]
    assert [each.returncode for each in parts[:-1]] == [0] * (N - 1), said
    wanted = "expected a part of a report, got 8 of 30 shards; when all parts are made, "
    assert said[0][1].splitlines()[-1] == f"{wanted}run the command without --only"
    assert not (out / "summary.json").exists()
    (run,) = out.glob("unfinished/*")
    for of_killed in (run, run / "shards", run / "sha256"):
        (of_killed / ".0123456789ab.part").write_bytes(b"half")
    made = {path.name for path in run.glob("shards/*.npz")}
    for part in range(N - 1):
        assert {f"shard-{number:05}.npz" for number in range(part, 30, N)} <= made
    monkeypatch.setattr(shards, "PAIRS_A_SHARD", size)
    assert command([*words, "--only", f"{N - 1}/{N}"]) == 0
    assert len([*run.glob("shards/*.npz")]) == 30
    assert command([*words, "--workers", "1"]) == 0
    whole = tmp_path / "whole"
    assert command([*EVALUATE, "--out", str(whole), "--workers", "1"]) == 0
    assert content(out) == content(whole)
    assert not (out / "unfinished").exists()


def test_parts_of_a_plan_give_its_matrix(tmp_path, capsys):
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    for part in (1, 0):
        words = ["place", str(plan), "--out", str(tmp_path / "parts"), "--only", f"{part}/2"]
        assert command(words) == 0
        assert not (tmp_path / "parts/plan.json").exists()
    for name in ("parts", "whole"):
        assert command(["place", str(plan), "--out", str(tmp_path / name)]) == 0
    ours, theirs = (
        {path.name: path.read_bytes() for path in (tmp_path / name).glob("matrix/*/pairs/*")}
        for name in ("parts", "whole")
    )
    assert ours == theirs
    assert ours
    poses = [(tmp_path / name / "poses.json").read_bytes() for name in ("parts", "whole")]
    assert poses[0] == poses[1]


def test_a_part_is_its_own_shards_and_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr(shards, "PAIRS_A_SHARD", 2 * shapes.by_name("torus").n_faces)
    words = [*EVALUATE[:5], "sphere:20", "--pictures", "0", "--out", str(tmp_path)]
    assert command([*words, "--only", "1/3"]) == 0
    made = {int(path.stem[6:]) for path in tmp_path.glob("unfinished/*/shards/*.npz")}
    assert made == {1, 4, 7}


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such locks")
def test_a_part_and_a_whole_run_exclude_each_other(tmp_path):
    from rastercov.base.locks import lock

    refused = pytest.raises(rc.ConfigError, match="another process")
    shared = {"is_shared": True}
    with lock(tmp_path, **shared), lock(tmp_path, **shared), refused, lock(tmp_path):
        pass
    with lock(tmp_path), refused, lock(tmp_path, **shared):
        pass


@pytest.mark.parametrize("text", ["4/4", "5/4", "1", "-1/4", "1/0", "a/b", "1/2/3"])
def test_other_parts_are_refused_in_a_line(text, capsys, tmp_path):
    words = [*EVALUATE, f"--only={text}", "--out", str(tmp_path / "out")]
    assert command(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(("error: --only: expected I/N", "error: expected only to be I/N"))
    assert re.search(rf"got '?{text}'?; ", line)


@pytest.mark.parametrize("more", [{"number": 2}, {"scheduler": "tcp://127.0.0.1:1"}])
def test_a_part_is_made_by_this_process_alone(more):
    with pytest.raises(rc.ConfigError, match="got 2 of them; give one"):
        Workers(**more, only=(0, 2))


CHECK = """\
meshes = [{ built_in = "room" }]
camera = { width = 160, height = 120, hfov_deg = 80 }
task.max_incidence_deg = 70
"""
GOAL = 'goals.crates = { groups = ["crates"], at_most = 0.9, max_incidence_deg = 60 }\n'
FRAMES = "motion.turntable = { body = 'crates', steps = 4, axis = [0, 0, 1] }\ntask.over = 0.5\n"
HEADS = """\
meshes = [{ built_in = "torus" }]
cameras.head = { width = 160, height = 120, hfov_deg = 60 }
[rigs.pair]
rule = "all"
[[rigs.pair.cameras]]
camera = "head"
name = "left"
[[rigs.pair.cameras]]
camera = "head"
translation = [0.1, 0.0, 0.0]
name = "right"
"""
FACES = 'task.method = "sampled"\n'
ANGLE = "task.min_angle_deg = 5\n"


@pytest.mark.parametrize("more", ["", FACES, ANGLE, GOAL, FRAMES, HEADS])
def test_parts_of_a_check_give_the_report_of_one_run(tmp_path, more, monkeypatch):
    monkeypatch.setattr(shards, "PAIRS_A_SHARD", 3000)
    monkeypatch.setattr(shards, "PAIRS_OF_COUNTS", 3000)
    monkeypatch.setattr(over_time, "PAIRS_A_SHARD", 3000)
    plan, rig, junit = (tmp_path / name for name in ("plan.toml", "rig.json", "junit.xml"))
    plan.write_text(more if more == HEADS else CHECK + more)
    poses = rc.sphere_of_poses((0, 0, 1), 1.5, count=24).tolist()
    named = {"camera": ["pair"] * 24} if more == HEADS else {}
    rig.write_text(json.dumps({"world_from_camera": poses, **named}))
    words = ["check", str(plan), "--poses", str(rig), "--min-coverage", "0.2"]
    words += ["--junit", str(junit), "--out"]
    for part in (2, 0, 1):
        assert command([*words, str(tmp_path / "parts"), "--only", f"{part}/3"]) == 0
        assert not junit.exists()
    made = [*(tmp_path / "parts").glob("unfinished/*/shards/*")]
    assert len(made) > 3
    monkeypatch.setattr(goals.RigShards, "_measure", lambda *asked: pytest.fail("measured again"))
    codes = [command([*words, str(tmp_path / name)]) for name in ("parts", "whole")]
    assert codes in ([0, 0], [1, 1])
    assert not (tmp_path / "parts/unfinished").exists()
    for name in ("check.json", "check.html", "view.html"):
        ours, theirs = ((tmp_path / each / name).read_bytes() for each in ("parts", "whole"))
        assert ours == theirs


def poisoned(folder, number, chosen):
    """A shard of which one pose kills its process."""
    if 3 in chosen:
        os.kill(os.getpid(), signal.SIGKILL)
    return rig_parts.make(folder, number, chosen)


def test_a_check_refuses_a_camera_that_kills_its_worker(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(goals.RigShards, "function", "test_parts_of_arrays:poisoned")
    monkeypatch.syspath_prepend(Path(__file__).parent)
    plan, rig = tmp_path / "plan.toml", tmp_path / "rig.json"
    plan.write_text(CHECK)
    poses = rc.sphere_of_poses((0, 0, 1), 1.5, count=6).tolist()
    rig.write_text(json.dumps({"world_from_camera": poses}))
    words = ["check", str(plan), "--poses", str(rig), "--min-coverage", "0.2", "--workers", "1"]
    assert command([*words, "--out", str(tmp_path / "out")]) == 2
    assert "error: expected a result of pose 3, got none: its process" in capsys.readouterr().err


def test_a_check_by_workers_is_that_of_this_process(tmp_path):
    plan, rig = tmp_path / "plan.toml", tmp_path / "rig.json"
    plan.write_text(CHECK + GOAL)
    poses = rc.sphere_of_poses((0, 0, 1), 1.5, count=6).tolist()
    rig.write_text(json.dumps({"world_from_camera": poses}))
    words = ["check", str(plan), "--poses", str(rig), "--min-coverage", "0.2", "--out"]
    for name, more in {"one": (), "two": ("--workers", "2")}.items():
        assert command([*words, str(tmp_path / name), *more]) in (0, 1)
    one, two = ((tmp_path / name / "check.json").read_bytes() for name in ("one", "two"))
    assert one == two
    assert command([*words[:-1], "--workers", "2"]) == 2
    rig.write_text('{"world_from_camera": []}')
    assert command([*words, str(tmp_path / "none"), "--workers", "1"]) == 1
    assert command([*words, str(tmp_path / "part"), "--only", "0/2"]) == 0
    assert not (tmp_path / "part/check.json").exists()
