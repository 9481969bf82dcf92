"""Commands load what they need, and no more."""

import inspect
from pathlib import Path

import pytest
import typer
from processes import run_python

import rastercov
from rastercov import cli

HEAVY = ("matplotlib", "trimesh", "scipy.spatial", "rastercov.placement", "dask")


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
    found = loaded_after("--help")
    assert not found & {
        "numpy",
        "numba",
        "pyarrow",
        "PIL",
        "moderngl",
        "trimesh",
        "rastercov.mesh",
        "rastercov.cli.place",
    }


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_the_list_has_the_first_line_of_each_help(name):
    command = cli.LazyCommand(name, help=cli.COMMANDS[name])
    assert command.loaded.name == name
    first = inspect.cleandoc(command.loaded.help).split("\n\n")[0]
    assert " ".join(first.split()) == cli.COMMANDS[name]


def test_every_command_module_is_listed():
    assert set(cli.COMMANDS) == {*cli.IN_MODULE, *modules_with_commands()}


def modules_with_commands():
    others = {"__init__", "console", "inputs", "options"}
    return {path.stem for path in Path(cli.__file__).parent.glob("*.py")} - others


@pytest.mark.parametrize("by", ["area", "face"])
def test_a_report_loads_no_heavy_package_that_it_does_not_need(tmp_path, by):
    line = ("evaluate", "icosahedron", "-c", "khepra", "-p", "sphere:2", "--by", by)
    found = loaded_after(*line, "-o", str(tmp_path / "out"))
    assert (tmp_path / "out" / "contact_sheet.png").exists()
    assert not {name for name in found if name.startswith(HEAVY)}


def test_names_of_the_package_come_at_their_first_use():
    code = "import sys, rastercov as rc; print('numpy' in sys.modules); rc.Mesh; print(rc.camera)"
    first, second = run_python("-c", code).stdout.splitlines()
    assert first == "False"
    assert "rastercov.camera" in second
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        rastercov.nothing  # noqa: B018 - it is looked up


def test_a_command_is_typers_own_once_it_is_loaded():
    assert isinstance(cli.LazyCommand("demo").loaded, typer.core.TyperCommand)
    assert isinstance(cli.LazyCommand("validate").loaded, typer.core.TyperGroup)
