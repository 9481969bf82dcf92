"""With --json, standard output is JSON and nothing else, whatever a library prints of itself."""

import ctypes
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from bungalow import bungalow
from commands import process, write_part
from nightly import nightly
from step_crate import crate

from rastercov import cli
from rastercov.base.streams import no_printing
from rastercov.core.mesh import shapes

C_LIBRARY = ctypes.CDLL(None)
CAMERA = "width = 48\nheight = 36\nhfov_deg = 60\n"
EVALUATE = "evaluate {} -c camera.toml -p sphere:2 --pictures 0 --json -o out"
PLAN = """
meshes = [{{path = "part.obj"}}]
camera = {{file = "camera.toml"}}
task = {{min_pixels = 1, by = "{by}"}}
candidates = [{{generator = "on_sphere", count = 9, distances = [3.5]}}]
outputs = {{page = false}}
[selection]
{selection}
"""
FEWEST, BEST = 'goal = "fewest_cameras"\ncoverage = 0.5', 'goal = "best_coverage"\ncameras = 2'
SELECTIONS = {
    **{
        f"{name}_{method}": f'{goal}\nmethod = "{method}"'
        for name, goal in {"fewest": FEWEST, "best": BEST}.items()
        for method in ("greedy", "integer")
    },
    "refined": f"{BEST}\nrefine = true",
    "searched": f"{BEST}\n[selection.optimise]\nbudget = 40",
}
"""Ends of plans: every goal, method and search."""
LINES = {
    "evaluate": EVALUATE.format("part.obj"),
    "place_integer": "place best_integer_area.toml --json -o out",
    "place_searched": "place searched_area.toml --json -o out",
    "cameras": "cameras khepra --json",
}
SLOW = {
    **{f"place_{n}_{by}": f"place {n}_{by}.toml --json -o out"
       for n in SELECTIONS for by in ("area", "face")},
    **{kind: EVALUATE.format(f"part.{kind}")
       for kind in ("stl", "ply", "off", "glb", "dae", "step", "ifc")},
    "by_exact": EVALUATE.format("part.obj") + " --method exact",
    "by_opengl": EVALUATE.format("part.obj") + " --method sampled --device surfaceless",
    "workers": EVALUATE.format("part.obj") + " --workers 2",
    "by_area": EVALUATE.format("part.obj") + " --by area --table all",
}  # fmt: skip
"""Other commands, methods and formats than those of `test_json_schema`."""
AT_NIGHT = {f"place_{name}_face" for name in SELECTIONS}


@pytest.fixture
def files(here):
    """The files that the lines name."""
    write_part("part.obj")
    mesh = shapes.box((1, 1, 1))
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    for kind in ("stl", "ply", "off", "glb", "dae"):
        solid.export(f"part.{kind}")
    Path("part.step").write_bytes(crate())
    Path("part.ifc").write_bytes(bungalow())
    Path("camera.toml").write_text(CAMERA)
    for name, selection in SELECTIONS.items():
        for by in ("area", "face"):
            Path(f"{name}_{by}.toml").write_text(PLAN.format(by=by, selection=selection))


def check_output(line, capfd):
    capfd.readouterr()
    code = cli.command(shlex.split(line))
    C_LIBRARY.fflush(None)
    readouterr = capfd.readouterr()
    assert code in (0, 1), readouterr.err
    json.loads(readouterr.out)


@pytest.mark.parametrize("name", LINES)
def test_a_library_prints_nothing_beside_the_answer(files, capfd, name):
    check_output(LINES[name], capfd)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=nightly if name in AT_NIGHT else ()) for name in SLOW],
)
def test_no_library_prints_beside_the_answer_of_any_command_method_or_format(files, capfd, name):
    check_output(SLOW[name], capfd)


def test_the_command_as_a_process_prints_json_alone(files):
    result = process("place fewest_integer_area.toml --json -o out")
    assert result.returncode in (0, 1), result.stderr
    json.loads(result.stdout)
    assert b"HiGHS" not in result.stderr


NOISY = """
import ctypes, os, subprocess, sys, threading
from rastercov import cli
def noisy(arguments):
    os.write(1, b"descriptor ")
    ctypes.CDLL(None).puts(b"stream")
    subprocess.run(["echo", "child"])
    print("{}")
    thread = threading.Thread(target=os.write, args=(1, b"thread"))
    thread.start()
    thread.join()
    return 0
cli.command = noisy
cli.main()
"""


@pytest.mark.parametrize("is_closed", [False, True])
def test_descriptor_1_is_standard_error_while_a_command_runs(is_closed):
    words = [sys.executable, "-c", NOISY]
    if is_closed:
        words = ["sh", "-c", 'exec "$@" 2>&-', "sh", *words]
    result = subprocess.run(words, capture_output=True, check=False, timeout=100)
    assert result.returncode == 0
    assert result.stdout == b"{}\n"
    words = [b"descriptor", b"stream", b"child", b"thread"]
    assert [word for word in words if word in result.stderr] == ([] if is_closed else words)


def test_only_code_in_c_is_kept_from_printing(capfd):
    C_LIBRARY.puts(b"before")
    with no_printing():
        C_LIBRARY.puts(b"hidden")
        os.write(1, b"Python\n")
    C_LIBRARY.puts(b"after")
    C_LIBRARY.fflush(None)
    assert sorted(capfd.readouterr().out.split()) == ["Python", "after", "before"]
