"""The command as a person, a script and a terminal meet it."""

import json
import re
import resource
import shlex
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import (
    ENTRY,
    answer,
    call,
    content,
    done,
    process,
    refusal,
    without_progress,
    write_part,
)
from PIL import Image

import rastercov
from rastercov import cli
from rastercov.base.interrupts import interrupt
from rastercov.cli.inputs import poses_around
from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.mesh import shapes
from rastercov.gl import diagnose
from rastercov.report import coverage_files
from rastercov.report.folder import ReportFolder, ReportKind

COMMANDS = ("compare", "demo", "doctor", "evaluate", "render")
REPORT = {"rig.json", "summary.json", "network.glb"}
MANIFEST = ".rastercov-evaluate.json"
CAMERA = "width = 48\nheight = 36\nfx = 60\nfy = 60\n"


@pytest.fixture(autouse=True)
def files():
    """A folder of its own with a part, a camera and twelve poses around it."""
    write_part("part.obj", side=1000.0)  # millimetres
    Path("camera.toml").write_text(CAMERA)
    write_poses("poses.json", sphere_of_poses((0, 0, 0), 4000, 12))


def names(folder):
    return {path.name for path in Path(folder).iterdir()}


QUICK = "evaluate box -c camera.toml -p sphere:2 --pictures 0"
MODELS = "compare box -c camera.toml -p sphere:2 --models"
BUILT_IN = "render box -c camera.toml -p sphere:1 --transform {scale=3}"
LONG = "evaluate sphere -c camera.toml -p sphere:40000 --table seen --pictures 1 -o report"
SMALL = f"shards.PAIRS_A_SHARD = {250 * shapes.by_name('sphere').n_faces}"
"""Shards of it, of which it then has 160."""


# --- help -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_each_help_shows_an_example_that_runs(capsys, monkeypatch, name):
    monkeypatch.setattr(diagnose, "list_devices", list)  # tested with the doctor
    out, _ = done(capsys, [name, "--help"])
    examples = re.findall(
        rf"^(?:Example|Without files):\n  rastercov ({name} .*?)\s*$", out, re.MULTILINE
    )
    assert examples
    shapes.box((1, 1, 1)).to_trimesh().export("part.stl")
    write_poses("poses.json", sphere_of_poses((0, 0, 0), 4, 4))
    less = {"demo": " --poses 1", "compare": " --no-convergence --faces 1"}.get(name, "")
    for example in examples:
        quick = re.sub(r"sphere:\d+", "sphere:1", example.replace("-c khepra", "-c camera.toml"))
        code, out, _ = call(capsys, quick + less)
        assert (code, bool(out)) == (0, True), example


def test_the_result_of_a_demo_has_its_title_and_opens(capsys):
    done(capsys, "demo --shape box --poses 1 --device cpu --out shown")
    assert "<h1>Coverage of box<" in Path("shown/report.html").read_text(encoding="utf-8")
    assert "page.html" in done(capsys, "view shown --export page.html --still")[0]


def test_help_and_version(capsys):
    out, _ = done(capsys, "--help")
    assert "Example:\n  rastercov demo" in out
    assert all(name in out for name in COMMANDS)
    assert call(capsys, "--version") == (0, rastercov.__version__ + "\n", "")
    assert call(capsys, []) == (2, out, "")  # no command is bad usage


# --- bad usage and bad input ----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("poses", ["sphere:5", "turntable:3@30"])
@pytest.mark.parametrize("name", ["realsense-r200", "khepra"])
def test_poses_around_a_mesh_are_where_a_focus_range_begins(name, poses):
    """Of a small part; a large one fills the image."""
    camera = rastercov.Camera.preset(name)
    for size, is_moved in ((0.01, True), (10.0, False)):
        mesh = rastercov.shapes.box((size, size, size))
        eyes = poses_around(poses, mesh, camera)
        depth = np.einsum("pvi,pi->pv", mesh.vertices - eyes[:, None, :3, 3], eyes[:, :3, 2])
        assert depth.min() >= camera.focus_range[0]
        radius = np.sqrt(3) * size / 2
        away = np.linalg.norm(eyes[:, :3, 3] - mesh.bounds.mean(axis=0), axis=1)
        assert np.allclose(away, camera.focus_range[0] + radius) == is_moved


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("nonsense", ["expected a known command, got nonsense"]),
        ("evaluate", ["error: expected MESH, got none; see rastercov evaluate --help"]),
        ("evaluate box --nope[x]", ["expected a known option, got --nope[x]"]),
        (
            "evaluate box --full",
            ["error: --full: expected a value, got none; see rastercov evaluate --help"],
        ),
        (
            "place plan.toml --out",
            ["error: --out: expected a value, got none; see rastercov place --help"],
        ),
        (QUICK + " --pictures -1", ["--pictures"]),
        (QUICK + " --method sampled --supersample 0", ["expected a number from 1", "got 0"]),
        (QUICK + " --min-pixels nan", ["--min-pixels: expected a number greater than 0, got"]),
        (QUICK + " --method ray", ["--method: expected certified, exact or sampled, got 'ray'"]),
        (
            QUICK + " --table some",
            ["--table: expected none, covered, seen, all or groups, got 'some'"],
        ),
        (QUICK + " --full both", ["--full: expected none, poses, faces or all, got 'both'"]),
        (
            QUICK + " --supersample 4",
            ["--supersample: expected 1 with method certified", "use method sampled"],
        ),
        (QUICK + " --method sampled --device nonsense", ["got 'nonsense'", "surfaceless"]),
        (QUICK + " --unit mm", ["expected the built-in mesh box alone"]),
        (QUICK + " --unit m --unit mm", ["expected --unit once for all files"]),
        (
            QUICK + " --transform scale=0",
            ["--transform", "scale: expected a number above 0, got 0"],
        ),
        (QUICK + " --transform 90", ["--transform '90': expected entries such as 'angle_deg = 90"]),
        (QUICK + " --transform lid:scale=2", ["mesh files box, got 'lid'"]),
        (QUICK + " --occluder [lid]", ["--occluder", "'[lid]'", "(groups: mesh)"]),
        (QUICK + " --occluder part.obj", ["expected the built-in mesh box alone"]),
        (QUICK + " --occluder mesh", ["expected a group to evaluate, got occluders only"]),
        (QUICK + " --target mesh --occluder mesh", ["one role of group 'mesh'"]),
        (
            "evaluate box -p sphere:2 -c flir-bfs-u3-51s5+thorlabs-mvbt2353",
            ["telecentric", "file of poses"],
        ),
        (
            "evaluate bocks -c khepra -p sphere:2",
            ["bocks: expected a mesh file or a built-in mesh, such as box"],
        ),
        (
            ["evaluate", "a\nb\x1b[31m", "-psphere:1"],
            ["error: ab[31m: expected a mesh file or a built-in"],
        ),
        ("evaluate no[x].stl -c khepra -p sphere:2", ["no[x].stl", "no such file"]),
        (
            "evaluate part.obj -c khepra -p sphere:2 --unit miles",
            ["--unit: expected one of m, mm", "'miles'"],
        ),
        ("evaluate box -c no.toml -p sphere:2", ["no.toml", "no such file"]),
        ("evaluate box -c part.obj -p sphere:2", ["part.obj", "a camera or pose file", "--from"]),
        ("evaluate box -c khepra -p sphere:99999999999", ["sphere:N", "10,000,000"]),
        ("evaluate box -c khepra -p turntable:12@95", ["DEG from", "-90 to 90", "12@95"]),
        ("evaluate box -c khepra -p turntable:12@30,", ["N@DEG", "12@30,"]),
        (
            "render box -c khepra -p poses.json --pose 12",
            ["expected an index from 0 to 11", "got 12"],
        ),
        ("demo --shape nope", ["'nope'", "--shape: expected a built-in mesh"]),
        (MODELS + " --method exact", ["expected --models alone, got --method or --against; leave"]),
        (QUICK + " -o camera.toml", ["camera.toml", "expected a folder, got a file"]),
        (QUICK + " -o /proc/x", ["/proc/x"]),
        (QUICK + " -o " + 300 * "x", [90 * "x" + "...", "name too long"]),
        (f"evaluate {300 * 'x'} -c khepra -p sphere:2", [90 * "x", "...", "got none"]),
    ],
)
def test_each_bad_command_line_gets_one_line_that_says_why(capsys, line, words):
    text = refusal(capsys, line)
    assert all(word.lower() in text.lower() for word in words)
    assert names(".") == {"part.obj", "camera.toml", "poses.json"}


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [("cut.stl", "solid box\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n", "cut.stl -c khepra"),
     ("cut.json", "[1, 2", "box -c cut.json"), ("cut.json", "[1, 2", "box -c khepra -p cut.json"),
     ("wrong.toml", "width = 0\nheight = 1\nfx = 1\nfy = 1", "box -c wrong.toml")],
)  # fmt: skip
def test_broken_files_are_named(capsys, name, text, line):
    Path(name).write_text(text)
    line = line if "-p" in line else f"{line} -p sphere:2"
    assert name in refusal(capsys, f"evaluate {line}")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            MemoryError("Unable to allocate 9 TiB"),
            "expected enough memory, got Unable to allocate 9 TiB",
        ),
        (MemoryError(), "expected enough memory, got too little"),
        (OSError(28, "No space left on device", "report/x"), "report/x: no space left on device"),
        (OSError("odd"), "odd"),
    ],
)
def test_what_nobody_foresaw_is_one_line_too(capsys, monkeypatch, error, words):
    monkeypatch.setattr("rastercov.report.coverage.run", Mock(side_effect=error))
    assert words in refusal(capsys, QUICK)


def test_a_defect_is_shown_after_an_interrupt_before_too_and_with_its_traceback(
    capsys, monkeypatch
):
    with pytest.raises(KeyboardInterrupt):
        interrupt(signal.SIGINT, None)
    monkeypatch.setattr("rastercov.report.coverage.run", lambda *_, **__: 1 / 0)
    assert "ZeroDivisionError: division by zero" in refusal(capsys, QUICK)
    monkeypatch.setenv("RASTERCOV_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        call(capsys, QUICK)


# --- what a run leaves and prints -----------------------------------------------------------------


@pytest.mark.slow
def test_files_units_and_groups(capsys):
    line = "evaluate part.obj --unit mm -c camera.toml -p sphere:4 --occluder lid --two-sided rest"
    code, out, err = call(capsys, line)
    assert (code, err) == (0, "")
    assert out.startswith("covered: 100 % of the area\nreport/report.html\n")
    drawn = {"contact_sheet.png", "overview.png", "view.html", "report.html"}
    assert names("report") == REPORT | drawn | {MANIFEST}
    summary = json.loads(Path("report/summary.json").read_text())
    assert (summary["faces"], summary["task_faces"], summary["covered"]["faces"]) == (12, 10, 10)
    roles = {group["name"]: group["role"] for group in summary["groups"]}
    assert roles == {"lid": "occluder", "rest": "task"}


@pytest.mark.slow
def test_without_pyarrow_only_a_table_that_is_asked_for_is_refused(capsys, monkeypatch):
    monkeypatch.setattr(coverage_files, "find_spec", lambda name: None)
    assert done(capsys, f"{QUICK} -o report")[1] == ""
    assert names("report") & REPORT == REPORT
    code, _, err = call(capsys, f"{QUICK} --table all -o other")
    assert (code, err.count("\n")) == (2, 1)
    assert (
        "--table all: expected pyarrow, got no package; run: pip install 'rastercov[tables]'" in err
    )
    assert not Path("other").exists()


@pytest.mark.slow
def test_an_occluder_or_a_target_may_be_a_file_or_a_group(capsys):
    write_part("fixture.obj", side=3000.0)  # closed around the part, and hides nothing
    write_part("case.obj", side=2000.0, names={0: "case"})
    roles = "--target fixture.obj --target part/lid --occluder case.obj"
    line = f"evaluate part.obj --unit mm -c camera.toml -p sphere:4 --pictures 1 {roles}"
    by_name = {group["name"]: group for group in answer(capsys, line)["groups"]}
    targets = dict.fromkeys(["lid", "fixture/lid", "fixture/rest"], "target")
    assert {name: group["role"] for name, group in by_name.items()} == targets | {
        "rest": "task", "case": "occluder"
    }  # fmt: skip
    assert by_name["rest"]["covered"]["faces"] == 0  # behind the case
    assert by_name["fixture/rest"]["covered"]["faces"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("line", [QUICK, "render box -c camera.toml -p sphere:2", "demo --poses 1"])
def test_json_is_all_there_is_on_standard_output(capsys, line):
    out, _ = done(capsys, line + " --json")
    assert json.loads(out)
    assert out.isascii()


@pytest.mark.slow
def test_names_are_shown_as_they_are(capsys):
    name, out_folder, group = "<script>[bold]x[] é.obj", "a [red]b[] é", "<b>[bold]lid"
    write_part(name, names={0: group, 2: "rest"})
    out, _ = done(capsys, ["evaluate", name, "-ccamera.toml", "-psphere:2", "-o", out_folder])
    assert f"{out_folder}/report.html\n" in out
    assert group in out
    summary = json.loads(Path(out_folder, "summary.json").read_text(encoding="utf-8"))
    assert summary["run"]["mesh"][0]["name"] == name


def test_no_poses_is_a_run_that_covers_nothing(capsys):
    np.save("none.npy", np.zeros((0, 4, 4)))
    assert (
        "no poses, so nothing is covered"
        in done(capsys, "evaluate box -c camera.toml -p none.npy --table seen")[1]
    )
    assert names("report") == (REPORT - {"rig.json"}) | {
        MANIFEST,
        "coverage.parquet",
        "areas.parquet",
    }
    assert pq.read_table("report/coverage.parquet").num_rows == 0


@pytest.mark.slow
def test_one_pose_one_pixel_and_a_mesh_behind(capsys):
    camera = "-c 'width = 1, height = 1, fx = 1, fy = 1' -p away.npy"
    away = sphere_of_poses((0, 0, 0), 4, 1)
    away[0, :3, 1:3] *= -1
    np.save("away.npy", away)
    assert call(capsys, f"evaluate box --table seen {camera}")[0] == 0
    assert pq.read_table("report/coverage.parquet").num_rows == 0
    assert call(capsys, f"render box {camera}")[0] == 0
    with Image.open("render/faces.png") as picture:
        assert picture.size == (1, 1)


def test_a_built_in_mesh_is_placed(capsys):
    assert ", 3 x 3 x 3 m\n" in call(capsys, BUILT_IN)[1]


def test_render_leaves_what_it_names(capsys):
    result = answer(capsys, "render box -c camera.toml -p sphere:3 --pose 2")
    files = {Path(name).name for name in result["files"]}
    assert names("render") == files | {".rastercov-render.json"}
    with np.load("render/buffers.npz") as arrays:
        assert arrays["face"].shape == arrays["depth"].shape == (36, 48)
        assert (arrays["face"] >= 0).sum() == result["pixels_covered"] > 0


# --- as a process ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_no_terminal_no_escape_codes(capsys, monkeypatch):
    result = process(QUICK, FORCE_COLOR="")
    assert (result.returncode, result.stderr) == (0, b"")
    assert b"\x1b" not in result.stdout
    monkeypatch.setenv("FORCE_COLOR", "1")
    code, _, err = call(capsys, QUICK)
    assert (code, "\x1b" in err) == (0, False)  # colour perhaps, but no bar


@pytest.mark.slow
def test_a_reader_that_goes_away_is_no_error():
    line = [sys.executable, "-c", ENTRY, *QUICK.split()]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        child.stdout.close()
        assert child.wait(300) == -signal.SIGPIPE
        assert without_progress(child.stderr.read()) == b""
    assert names("report") >= REPORT


@pytest.mark.slow
@pytest.mark.parametrize(("line", "unbuffered"), [("demo --help", ""), ("--version", "1")])
def test_a_full_disk_behind_standard_output_is_one_line(line, unbuffered):
    with Path("/dev/full").open("wb") as full:
        result = process(line, stdout=full, PYTHONUNBUFFERED=unbuffered)
        both = process(line, stdout=full, stderr=full, PYTHONUNBUFFERED=unbuffered)
    assert result.returncode == both.returncode == 2
    assert result.stderr == b"error: [Errno 28] No space left on device\n"


@pytest.mark.slow
@pytest.mark.parametrize("line", [BUILT_IN, "groups box"])
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_streams_are_no_error(line, closed):
    words = f"exec {shlex.quote(sys.executable)} -c {shlex.quote(ENTRY)} {line} {closed}"
    assert subprocess.run(["bash", "-c", words], check=False).returncode == 0


@pytest.mark.slow
def test_a_full_disk_is_one_line_that_names_the_file_and_the_old_report_stays(capsys):
    """A limit on the size of a file is what a test can set anywhere."""
    line = QUICK.replace("box", "sphere").replace("--pictures 0", "--pictures 2")
    call(capsys, line + " -o other")  # compiles, and writes what it compiled, without a limit
    call(capsys, QUICK)
    Path("report/notes.txt").write_text("mine")
    before, (limit, most) = content("report"), resource.getrlimit(resource.RLIMIT_FSIZE)
    for kib in (0, 1, 8, 12):
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * kib, most))
        try:
            code = cli.command(shlex.split(line))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, most))
        error = r"error: report/[\w.]+: file too large\n"
        assert (code, bool(re.fullmatch(error, capsys.readouterr().err))) == (2, True), kib
        assert content("report") == before, kib


# --- the folder of a report -----------------------------------------------------------------------

INTO = {
    QUICK: "summary.json",
    "demo --poses 1": "coverage.parquet",
    "render box -c camera.toml -p sphere:1": "depth.png",
    "compare box -c camera.toml -p sphere:1 --no-convergence": "worst_sampled_1.png",
    MODELS: "models.json",
    "validate markers": "markers.html",
}
"""Commands that leave a report, and a file that it may have."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["", "' '"])
@pytest.mark.parametrize("line", [*INTO, "place plan.toml"])
def test_an_empty_name_of_a_folder_is_not_the_current_one(capsys, line, name):
    Path("summary.json").write_text("mine")
    before = content(".")
    text = refusal(capsys, f"{line} --out {name or repr('')}")
    assert "--out" in text
    assert "an empty text" in text
    assert content(".") == before


@pytest.mark.slow
@pytest.mark.parametrize("is_used", [False, True])
@pytest.mark.parametrize(("line", "name"), INTO.items())
def test_a_folder_in_use_or_with_a_file_of_nobody_is_refused_and_kept(capsys, line, name, is_used):
    Path("out").mkdir()
    Path("out", "notes.txt" if is_used else name).write_text("mine")
    before, stamp = content("out"), Path("out").stat().st_mtime_ns
    other = ReportFolder("out", ReportKind("other", re.compile("x"), "x"))
    with other if is_used else nullcontext():
        code, out, err = call(capsys, f"{line} -o out")
    assert (code, out) == (2, "")
    (text,) = [line for line in err.splitlines() if not line.startswith("warning: ")]
    where = (
        "out: expected an unused folder, got one that another process is writing to"
        if is_used
        else f"out/{name}: expected a file of an earlier report"
    )
    assert text.startswith(f"error: {where}")
    assert "another" in text
    assert content("out") == before
    assert Path("out").stat().st_mtime_ns == stamp


@pytest.mark.slow
def test_a_terminal_and_a_locale_without_the_letters_of_a_name_show_something():
    bare = {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C", "LANG": "C"}
    Path("part.obj").rename("漢.obj")
    line = "evaluate 漢.obj -c camera.toml -p poses.json --pictures 0 -o 漢"
    result = process(line, **bare)
    assert (result.returncode, result.stderr) == (0, b"")
    assert result.stdout.decode("ascii")
    assert json.loads(Path("漢/summary.json").read_text())["run"]["mesh"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_keeps_what_is_done(number):
    # A busy machine must not end it before it has written what is done; see tests/test_signals.py.
    patient = "from rastercov.base import interrupts\ninterrupts.END_S = 60.0"
    out, code = (
        Path("report"),
        f"from rastercov.core.coverage import shards\n{SMALL}\n{patient}\n{ENTRY}",
    )
    line = [sys.executable, "-c", code, *LONG.split()]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        # Ended in a shard, the run keeps those before it.
        while len(list(out.glob("unfinished/*/shards/shard-*.npz"))) < 2:
            assert child.poll() is None
            time.sleep(0.01)
        child.send_signal(number)
        _, err = child.communicate(timeout=60)
    assert child.returncode == 128 + number
    assert err.endswith(b"interrupted\n")
    assert not list(out.rglob(".*.part"))
    summary = json.loads((out / "summary.json").read_text())
    table = pq.read_table(out / "coverage.parquet", columns=["pose"])
    assert summary["interrupted"]
    assert 0 < summary["poses"] < 40_000
    assert table["pose"].to_numpy().max() == summary["poses"] - 1
    assert {path.name for path in out.iterdir()} >= REPORT
