"""Commands load what they need, and no more."""

import inspect
from pathlib import Path

import pytest
import typer
from nightly import amount
from processes import run_python

from rastercov import cli
from rastercov.cli.console import COMMANDS, IN_MODULE, LazyCommand

OF_PLANS = tuple(
    f"rastercov.placement.{name}" for name in ("plan", "select", "candidates", "matrix")
)
HEAVY = ("matplotlib", "jinja2", "trimesh", "scipy.spatial", *OF_PLANS, "dask")


def loaded_after(*arguments):
    """Names of the modules that a process has loaded after a command."""
    code = (
        "import contextlib, io, sys; from rastercov.cli import command\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        f"    command({list(arguments)!r})\n"
        "print(*sys.modules)"
    )
    return set(run_python("-c", code).stdout.split())


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_neither_numpy_nor_a_command(option):
    heavy = {"numpy", "pyarrow", "PIL", "moderngl", "trimesh", "pydantic"}
    assert not loaded_after(option) & (heavy | {"rastercov.core.mesh", "rastercov.cli.place"})


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_has_the_first_line_of_each_help(name):
    command = LazyCommand(name, help=COMMANDS[name])
    assert command.loaded.name == name
    first = inspect.cleandoc(command.loaded.help).split("\n\n")[0]
    assert " ".join(first.split()) == COMMANDS[name]


def test_every_command_module_is_listed():
    modules = {path.stem for path in Path(cli.__file__).parent.glob("*.py")}
    others = {"__init__", "console", "inputs", "options", "terminal"}
    assert set(COMMANDS) == {*IN_MODULE, *modules - others}


@pytest.mark.parametrize("by", amount(["area"], at_night=["area", "face"]))
def test_a_report_loads_no_heavy_package_that_it_does_not_need(tmp_path, by):
    line = ("evaluate", "icosahedron", "-c", "khepra", "-p", "sphere:2", "--by", by)
    modules = loaded_after(*line, "-o", str(tmp_path / "out"))
    assert (tmp_path / "out" / "contact_sheet.png").exists()
    readers = (f"rastercov.formats.meshes.{name}" for name in ("dae", "ifc", "step", "threemf"))
    others = (*{*HEAVY, "shapely", "pydantic", *readers} - {"jinja2"},)  # of the page
    assert not {name for name in modules if name.startswith(others)}


def test_a_check_loads_nothing_of_what_others_draw_and_write():
    plans = Path(__file__).parents[2] / "examples" / "plans"
    modules = loaded_after("check", str(plans / "audit_rig.toml"), "-p", str(plans / "rig.json"))
    others = {*HEAVY, "pyarrow", "moderngl", "shapely", "scipy", "yaml"} - {*OF_PLANS}
    assert not {name for name in modules if name.startswith(tuple(others))}


def test_typer_makes_readers_of_given_numbers_alone(monkeypatch):
    made, build = [], typer.core.build_runtime_param
    monkeypatch.setattr(typer.core, "build_runtime_param", lambda of: made.append(of) or build(of))
    line = ["evaluate", "nothing.obj", "-c", "khepra", "-p", "sphere:2", "--views", "2"]
    assert cli.command([*line, "--min-visibility", "0.5", "--out", "here"]) == 2
    assert sorted(each.annotation.__name__ for each in made) == ["float", "int"]


@pytest.mark.parametrize("name", COMMANDS)
def test_values_that_are_not_read_by_typer_are_as_by_typer(name):
    command = LazyCommand(name, help="").loaded
    context = command.context_class(command)
    options = [each for each in command.get_params(context) if not each.callback]
    for option in options:
        kind = option.type_descriptor.annotation
        given = {str: "a b", Path: "no/x", list[str]: ("a", ""), list[Path]: ["x"]}.get(kind)
        for value in (given, option.get_default(context)):
            if value is not None:
                typed = type(option).process_value(option, context, value)
                ours = option.process_value(context, value)
                assert (ours, type(ours)) == (typed, type(typed)), option.name
                assert ours is not option.default or not isinstance(ours, list)
