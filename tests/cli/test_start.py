"""Commands load what they need, and no more."""

import inspect
import re
from pathlib import Path

import pytest
from processes import run_python

import rastercov as rc
from rastercov import cli

HEAVY = ("matplotlib", "jinja2", "trimesh", "scipy.spatial", "rastercov.placement", "dask")


def loaded_after(*arguments):
    """Names of the modules that a process has loaded after a command."""
    code = (
        "import contextlib, io, sys; from rastercov.cli import command\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        f"    command({list(arguments)!r})\n"
        "print(*sys.modules)"
    )
    return set(run_python("-c", code).stdout.split())


def test_help_loads_neither_numpy_nor_a_command():
    heavy = {"numpy", "numba", "pyarrow", "PIL", "moderngl", "trimesh"}
    assert not loaded_after("--help") & (heavy | {"rastercov.mesh", "rastercov.cli.place"})


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_the_list_has_the_first_line_of_each_help(name):
    command = cli.LazyCommand(name, help=cli.COMMANDS[name])
    assert command.loaded.name == name
    first = inspect.cleandoc(command.loaded.help).split("\n\n")[0]
    assert " ".join(first.split()) == cli.COMMANDS[name]


def test_every_command_module_is_listed():
    modules = {path.stem for path in Path(cli.__file__).parent.glob("*.py")}
    others = {"__init__", "console", "inputs", "options"}
    assert set(cli.COMMANDS) == {*cli.IN_MODULE, *modules - others}


@pytest.mark.parametrize("by", ["area", "face"])
def test_a_report_loads_no_heavy_package_that_it_does_not_need(tmp_path, by):
    line = ("evaluate", "icosahedron", "-c", "khepra", "-p", "sphere:2", "--by", by)
    found = loaded_after(*line, "-o", str(tmp_path / "out"))
    assert (tmp_path / "out" / "contact_sheet.png").exists()
    others = tuple(set(HEAVY) - {"jinja2"})  # of the page
    assert not {name for name in found if name.startswith(others)}


STOP_AT_THE_FIRST_NOTICE = """
import os, sys
from rastercov.kernels import jit
def say(kind, text):
    print(text, flush=True)
    os._exit(0)
jit._say_once = say
from rastercov.cli import command
os.chdir(sys.argv[1])
command(sys.argv[2:])
"""
PLANS = Path(__file__).parents[2] / "examples" / "plans"


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    ["demo", "evaluate box -c khepra -p sphere:2", "compare box -c khepra -p sphere:2",
     "view box -c khepra -p sphere:2 --export page.html",
     f"place {PLANS / 'eye_height.toml'} -o plan",
     f"check {PLANS / 'audit_rig.toml'} -p {PLANS / 'rig.json'}", "audit rig.json box"],
)  # fmt: skip
def test_the_first_notice_says_how_long_compiling_takes(tmp_path, line):
    """Whatever a command compiles first: where it is a loop of meshes, two processes begin late."""
    poses = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 4.0, 2))
    rig = rc.Rig([rc.Camera.preset("khepra")], ["one"])
    rc.write_views(tmp_path / "rig.json", rc.Views(rig=rig, poses=poses, images=("a", "b")))
    words = ("-c", STOP_AT_THE_FIRST_NOTICE, tmp_path, *line.split())
    said = run_python(*words, NUMBA_CACHE_DIR=str(tmp_path / "loops")).stdout.splitlines()[-1]
    assert re.fullmatch(r"rastercov: compiling, about \d+ s, once for this version", said)
