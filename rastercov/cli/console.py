"""Terminal output of a command: warnings, errors in one line, progress, its exit code, its help.

Results go to standard output; warnings, errors and progress to standard error. Help is for
terminals of any width: options in panels, no name or metavar broken.
"""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer
from rich.console import Console

from rastercov.base.errors import RastercovError
from rastercov.base.format import plural, shortened
from rastercov.base.interrupts import ABANDONED, forget_interrupts, was_interrupted

if TYPE_CHECKING:
    from rastercov.mesh import Mesh

import inspect
import re

from typer.core import TyperCommand, TyperGroup

LONGEST_WORD, LONGEST_LINE = 200, 600
"""Characters that are printed of a name or value without spaces, and of a line."""


def exit_code(app: Callable[..., Any], arguments: Sequence[str]) -> int:
    """Exit code of a command; whatever goes wrong is one line on standard error.

    RASTERCOV_TRACEBACK=1 in the environment raises unexpected errors instead.
    """
    forget_interrupts()
    code = _outcome(app, arguments)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk shows up here, not when Python ends
    except OSError as error:
        if code != 2:  # one line is enough
            code = say(f"error: {error}")
    return code


def _outcome(app: Callable[..., Any], arguments: Sequence[str]) -> int:
    try:
        code = app(list(arguments), prog_name="rastercov", standalone_mode=False)
        if code != 130:
            return int(code or 0)
        raise KeyboardInterrupt  # which newer versions of Typer turn into this code
    except (KeyboardInterrupt, typer.Abort):
        return say("interrupted", 130)
    except RastercovError as error:
        for line in getattr(error, "lines", [str(error)]):  # of a plan, a line for each fault
            say(f"error: {line}")
        return 2
    except OSError as error:
        where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        return say(f"error: {where}{(where and error.strerror) or error}")
    except MemoryError as error:
        return say(f"error: not enough memory: {error}".rstrip(": "))
    except Exception as error:
        if hasattr(error, "format_message"):  # of Typer, whose own class has moved between versions
            # An option without its value is noticed before there is a context.
            is_known = bool(arguments) and arguments[0] in getattr(app, "commands", ())
            own = f"rastercov {arguments[0]}" if is_known else "rastercov"
            path = getattr(getattr(error, "ctx", None), "command_path", own)
            return say(f"error: {error.format_message().rstrip('.')}; see {path} --help")
        if os.environ.get("RASTERCOV_TRACEBACK"):
            raise
        if was_interrupted():  # a compiler, for one, makes another error of it
            return say("interrupted", 130)
        return say(
            f"error: {type(error).__name__}: {error} (a defect of rastercov; please report it, "
            "with what RASTERCOV_TRACEBACK=1 shows)"
        )


class _Notices(logging.Handler):
    """Handler that prints what the library logs like all other lines of a command."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


@contextmanager
def notices_shown() -> Iterator[None]:
    """Show notices of the library on standard error in the block."""
    log, handler = logging.getLogger("rastercov"), _Notices(logging.WARNING)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


def say(text: str, code: int = 2) -> int:
    """Print one line on standard error, whatever the names in it hold; gives the exit code.

    A long word is shortened in its middle wherever it comes, and so is the line.
    """
    line = "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in text)
    words = (shortened(word, LONGEST_WORD) for word in line.split(" "))
    line = shortened(" ".join(words), LONGEST_LINE)
    with suppress(OSError):  # there is no stream left to report it
        print(line, file=sys.stderr, flush=True)
    return code


def leave(code: int) -> NoReturn:
    """End the process with this exit code, whatever is left in the buffers of its streams.

    Python writes them once more when it ends, and exits with 120 where that fails; it would wait
    for the threads that an interrupt leaves alone.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left to interrupt
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
    if any(thread.name.startswith(ABANDONED) for thread in threading.enumerate()):
        os._exit(code)
    sys.exit(code)


def warn(lines: Iterable[str]) -> None:
    """Print warnings, a line each."""
    for line in lines:
        say(f"warning: {line}")


def size_line(mesh: "Mesh") -> str:
    """Faces and size of a scene; a wrong unit shows in it."""
    return f"{plural(mesh.n_faces, 'face')}, {mesh.size_in_words}"


def out_option(words: str) -> Any:
    """Option `--out` of a command that leaves files in a folder."""
    return typer.Option("--out", "-o", help=words, parser=_folder, metavar="PATH")


def _folder(text: str | Path) -> Path:
    """Folder by its name; an unset variable of a shell is not the current one."""
    if not str(text).strip():
        raise typer.BadParameter("a folder is wanted, got an empty name; '.' is the current one")
    return Path(text)


@contextmanager
def progress_bar(what: str = "poses") -> Iterator[Callable[[int, int], None]]:
    """Progress with the time left: a bar on a terminal, nothing elsewhere.

    The time counts from the first report on: what an earlier run had done says nothing about it.
    """
    console = Console(stderr=True)
    if not (console.is_terminal and sys.stderr.isatty()):  # whatever FORCE_COLOR says
        yield lambda done, total: None
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None, start=False)

        def update(done: int, total: int) -> None:
            if bar.tasks[0].started:
                bar.update(task, completed=done, total=total)
            else:
                bar.reset(task, completed=done, total=total)

        yield update


class _Help:
    """Command whose help has a panel for each group of options; the terminal may be narrow."""

    def format_help_text(self: Any, ctx: Any, formatter: Any) -> None:
        """Write the description; the line of an example stays whole, so that it can be copied."""
        for paragraph in inspect.cleandoc(self.help).split("\n\n"):
            title, is_example, rest = paragraph.partition(": rastercov ")
            formatter.write_paragraph()
            if is_example:
                formatter.write(f"{title}:\n  rastercov {rest}\n")
            else:
                formatter.write_text(paragraph)

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write commands, arguments and options, a panel for those that `expanded` made."""
        rows: dict[str, list[tuple[str, str]]] = {"Commands": [], "Options": []}
        for name in getattr(self, "commands", ()):
            rows["Commands"].append((name, self.get_command(ctx, name).help.split("\n\n")[0]))
        for parameter in self.get_params(ctx):
            if (record := parameter.get_help_record(ctx)) is not None:
                panel = getattr(parameter, "rich_help_panel", None) or "Options"
                rows.setdefault(panel, []).append((_names(record[0]), record[1]))
        for panel, own in rows.items():
            if own:
                with formatter.section(panel):
                    formatter.write_dl(own)


class Command(_Help, TyperCommand):
    """Command with this help."""


class Group(_Help, TyperGroup):
    """Group of commands with this help."""


def _names(text: str) -> str:
    """Names and metavar of an option; one that may be repeated ends in dots, an argument, too."""
    text = re.sub(r"<list\[(.*)\]>", r"<\1>...", text.replace(" range>", ">"))
    return re.sub(r"\.\.\. <.*>\.\.\.", "...", text)
