"""The `rastercov` command, with a module for each of its commands.

Exit codes: 0 done, 1 a check failed, 2 bad usage or input, 130 interrupted. Results go to standard
output; warnings, errors and progress to standard error, an error as one line.
"""

import gc
import signal
import sys
from collections.abc import Sequence
from functools import cached_property
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

import rastercov
from rastercov.base.interrupts import come_again, interrupt
from rastercov.cli.console import Command, Group, exit_code, leave, notices_shown

SETTINGS: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
}
COMMANDS = {
    "evaluate": "Evaluate every pose and leave a report: a table, figures, pictures, a coloured "
    "mesh.",
    "demo": "Run the main job on a built-in mesh.",
    "render": "Draw one pose: a picture, the face index and the depth of every pixel (PNG and "
    "NPZ).",
    "compare": "Compare ways to find visibility with the truth; 1 when a bound does not hold.",
    "place": "Find out where cameras go: carry out a plan file; 1 when its goal is not reached.",
    "check": "Hold a rig against the mesh, camera and task of a plan; 1 when it falls short.",
    "audit": "Audit existing cameras: what each sees, what is lost without it, and the smallest "
    "subset.",
    "cameras": "List cameras, lenses and heads that are sold, by text, pixels, mount, price or "
    "field of view.",
    "convert": "Convert camera and pose files between programs; whatever is lost is said.",
    "view": "See a rig in the browser, move its cameras, and understand what they cover.",
    "sheet": "Draw a plan of a building with its cameras to scale: SVG, PDF or DXF.",
    "doctor": "List graphics devices, test each, and say what to install.",
    "validate": "Hold the model against what a real task makes of pictures.",
}
"""Commands and the first line of their help, which the list shows before any is loaded."""
GARBAGE = 200_000
"""Objects that are made between two looks for garbage."""
IN_MODULE = {"check": "place", "demo": "evaluate", "render": "evaluate", "validate": "compare"}
"""Modules of commands that have another name."""


class LazyCommand(TyperCommand):
    """Command whose module is imported when it runs or shows its own help."""

    @cached_property
    def loaded(self) -> Any:
        """The command itself."""
        assert self.name is not None
        module = import_module(f"rastercov.cli.{IN_MODULE.get(self.name, self.name)}")
        app = getattr(module, self.name)
        if not isinstance(app, typer.Typer):
            command, app = app, typer.Typer(**SETTINGS)
            app.command(cls=Command)(command)
        found = typer.main.get_command(app)
        found.name = self.name
        return found

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Context of the command itself."""
        return self.loaded.make_context(*args, **options)


def _group() -> Any:
    """The commands, as one that has them."""
    group = typer.Typer(
        help="Which faces of a mesh does each camera see, how well, and why not.\n\n"
        "Example: rastercov demo --out report/",
        cls=Group,
        **SETTINGS,
    )
    group.callback(invoke_without_command=True)(_start)
    found: Any = typer.main.get_command(group)
    for name, words in COMMANDS.items():
        found.add_command(LazyCommand(name, help=words))
    return found


def _start(
    context: typer.Context,
    show_version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if show_version:
        print(rastercov.__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(2)


def main() -> None:
    """Run the command as a process of its own."""
    # Modules leave many objects and no garbage: it is looked for hardly ever.
    gc.set_threshold(GARBAGE)
    if hasattr(signal, "SIGPIPE"):  # not on Windows
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` ends it without a word
    # As Ctrl-C: what is done is kept.
    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored by a shell
        signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = come_again
    # Names of files may hold what the terminal cannot show.
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = command(sys.argv[1:])
    except KeyboardInterrupt:  # a second one, while the first was reported
        code = 130
    leave(code)


def command(arguments: Sequence[str]) -> int:
    """Exit code of the command; see `console.exit_code`."""
    with notices_shown():
        return exit_code(_group(), arguments)
