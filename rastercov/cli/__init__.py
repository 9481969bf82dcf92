"""The `rastercov` command, with a module for each of its commands.

Exit codes: 0 done, 1 a check failed, 2 bad usage or input, 130 interrupted. Results go to standard
output; warnings, errors and progress to standard error, an error as one line.
"""

import signal
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Annotated

import typer

import rastercov
from rastercov._interrupts import interrupt
from rastercov.cli import (
    audit,
    compare,
    convert,
    demo,
    doctor,
    evaluate,
    place,
    render,
    validate,
    view,
)
from rastercov.cli.console import exit_code, leave, notices_shown

app = typer.Typer(
    help="Which faces of a mesh does each camera see, how well, and why not.\n\n"
    "[bold]Example[/]: rastercov demo --out report/",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


@app.callback(invoke_without_command=True)
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


for _command in (
    *(evaluate.evaluate, demo.demo, render.render, compare.compare, place.place, place.check),
    audit.audit,
    convert.convert,
    view.view,
    doctor.doctor,
):
    app.command()(_command)
app.add_typer(validate.app, name="validate")


def main() -> None:
    """Run the command as a process of its own."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` ends it without a word
    # As Ctrl-C: what is done is kept.
    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored by a shell
        signal.signal(signal.SIGINT, interrupt)
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
        return exit_code(app, arguments)
