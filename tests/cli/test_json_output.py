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

import rastercov as rc
from rastercov import cli
from rastercov.base.streams import no_printing
from rastercov.mesh import shapes

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
    **{f"by_{method}": f"{EVALUATE.format('part.obj')} --method {method}"
       for method in ("certified", "exact", "sampled")},
    "by_opengl": EVALUATE.format("part.obj") + " --method sampled --device surfaceless",
    "workers": EVALUATE.format("part.obj") + " --workers 2",
    "by_area": EVALUATE.format("part.obj") + " --by area --table all",
    "pictures": EVALUATE.format("part.obj").replace("--pictures 0", "--pictures 1"),
    "demo": "demo --shape box --poses 1 --device cpu --json -o out",
    "render": "render part.obj -c camera.toml -p sphere:1 --device surfaceless --json -o out",
    "compare": "compare part.obj -c camera.toml -p sphere:1 --faces 2 --method certified "
    "--no-convergence --json -o out",
    "models": "compare part.obj -c lens.toml -p sphere:2 --models --json -o out",
    "check": "check fewest_greedy_area.toml -p rig.json --json",
    "audit": "audit six.json part.obj --json -o out",
    "convert": "convert rig.json out.npy --json",
    "doctor": "doctor --json",
}  # fmt: skip
AT_NIGHT = {"markers": "validate markers --json -o out"}
"""It takes as long as all others."""


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
    Path("lens.toml").write_text(
        "width = 48\nheight = 36\npixel_size = [1e-5, 1e-5]\nfocal_length = 4e-4\n"
        "aperture = 1e-4\nfocus_distance = 3.0\n"
    )
    for name, selection in SELECTIONS.items():
        for by in ("area", "face"):
            Path(f"{name}_{by}.toml").write_text(PLAN.format(by=by, selection=selection))
    ends = [(3, 0, 0), (0, 3, 0), (0, 0, 3), (-3, 0, 0), (0, -3, 0), (0, 0, -3)]
    poses = rc.look_at(ends, (0, 0, 0))
    rc.write_poses("rig.json", poses)
    rig = rc.Rig([rc.Camera.load("camera.toml")], ["wide"])
    rc.write_views("six.json", rc.Views(rig, rc.Poses.of(poses), tuple("abcdef")))


def check_output(line, capfd):
    capfd.readouterr()
    code = cli.command(shlex.split(line))
    C_LIBRARY.fflush(None)
    found = capfd.readouterr()
    assert code in (0, 1), found.err
    json.loads(found.out)


@pytest.mark.parametrize("name", LINES)
def test_a_library_prints_nothing_beside_the_answer(files, capfd, name):
    check_output(LINES[name], capfd)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SLOW, *(pytest.param(n, marks=nightly) for n in AT_NIGHT)])
def test_no_library_prints_beside_the_answer_of_any_command_method_or_format(files, capfd, name):
    check_output((SLOW | AT_NIGHT)[name], capfd)


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
