"""Terminal output of a command: warnings, errors in one line, progress, its exit code, its help.

Results go to standard output; warnings, errors and progress to standard error. Help is for
terminals of any width: options in panels, no name or metavar broken.
"""

import logging
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_args

import typer

import rastercov
from rastercov.base import ByName, RastercovError, plural, shorten
from rastercov.base.errors import PartMadeError, is_out_of_memory
from rastercov.base.interrupts import (
    ABANDONED,
    announce_end,
    code_of_interrupt,
    forget_interrupts,
    ignore_signals,
    was_interrupted,
    watch_signals,
)
from rastercov.base.limits import time_limit_in_words

if TYPE_CHECKING:
    from typer._click.core import Context
    from typer._click.formatting import HelpFormatter

    from rastercov.core.mesh import Mesh

import inspect
import itertools
import re

from typer.core import TyperCommand, TyperGroup

LONGEST_WORD, LONGEST_LINE = 200, 600
"""Characters that are printed of a name or value without spaces, and of a line."""


NO_READER = 141
"""Exit code where the reader of standard output went away: as a shell has it for SIGPIPE."""


class NoReaderError(Exception):
    """Standard output has no reader any more, as in `rastercov doctor | head -1`."""


def _is_unread() -> bool:
    """True where standard output is a pipe or a socket without a reader."""
    try:
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)
        return bool(poll.poll(0))  # nothing was asked for but errors, which always come
    except (AttributeError, OSError, ValueError):  # Windows, or a stream of a test
        return True


@contextmanager
def separate_broken_pipes() -> Iterator[None]:
    """Standard output without a reader is `NoReaderError`, any other broken pipe an `OSError`.

    Typer would take each for the first, and end without a word.
    """
    try:
        yield
    except BrokenPipeError as error:
        if _is_unread():
            raise NoReaderError from None
        raise OSError(
            f"expected a reader, got a process or stream that ended ({error.strerror})"
        ) from error


def exit_code(app: Callable[..., Any], arguments: Sequence[str]) -> int:
    """Exit code of a command; whatever goes wrong is one line on standard error.

    RASTERCOV_TRACEBACK=1 in the environment raises unexpected errors instead.
    """
    forget_interrupts()
    for option, value in _options(arguments):
        # A variable of a shell that is not set; the title block of a sheet may have empty fields.
        if not value.strip() and arguments[0] != "sheet":
            return say(f"error: {option}: expected a value, got an empty text; give one")
    code = _outcome(app, arguments)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk shows up here, not when Python ends
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            return NO_READER
        if code != 2:  # one line is enough
            code = say(f"error: {error}")
    return code


def _report_interrupt() -> int:
    announce_end()
    return say("interrupted", code_of_interrupt())


def _outcome(app: Callable[..., Any], arguments: Sequence[str]) -> int:
    try:
        code = app(list(arguments), prog_name="rastercov", standalone_mode=False)
        if code != 130:
            return int(code or 0)
        raise KeyboardInterrupt  # which newer versions of Typer turn into this code
    except (KeyboardInterrupt, typer.Abort):
        return _report_interrupt()
    except NoReaderError:
        return NO_READER
    except PartMadeError as made:
        return say(str(made), 0)
    except RastercovError as error:
        for line in getattr(error, "lines", [str(error)]):  # of a plan, a line for each fault
            say(f"error: {_with_options(line, arguments)}")
        return 2
    except OSError as error:
        from rastercov.base.files import reason_of

        where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        return say(f"error: {where}{reason_of(error) if where else error}")
    except Exception as error:
        if hasattr(error, "format_message"):  # of Typer, whose own class has moved between versions
            # An option without its value is noticed before there is a context.
            is_known = bool(arguments) and arguments[0] in getattr(app, "commands", ())
            own = f"rastercov {arguments[0]}" if is_known else "rastercov"
            path = getattr(getattr(error, "ctx", None), "command_path", own)
            text = _in_our_words(error.format_message())
            if option := re.fullmatch(r"(--[\w-]+): expected [^,;]+", text):
                text += f", got {dict(_options(arguments)).get(option[1])!r}"
            return say(f"error: {text}; see {path} --help")
        if os.environ.get("RASTERCOV_TRACEBACK"):
            raise
        if is_out_of_memory(error):
            short = f"{error if isinstance(error, MemoryError) else ''}" or "too little"
            return say(f"error: expected enough memory, got {short}; close programs")
        if was_interrupted():  # a compiler, for one, makes another error of it
            return _report_interrupt()
        return say(
            f"error: {type(error).__name__}: {error} (a defect of rastercov; report it with the "
            "output of RASTERCOV_TRACEBACK=1)"
        )


WORDS = {
    r"^Invalid value for '([^']+)'(?: / '[^']+')*: ": r"\1: ",
    "Input should be ": "expected ",
    ", unable to parse string as an? [a-z]+": "",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "less than or equal to": "at most",
    "greater than or equal to": "at least",
    r": expected (?=at )": ": expected a number of ",
    r"^Missing (?:argument|option) '([^']+)'.*": r"expected \1, got none",
    r"^Missing command.*": "expected a command, got none",
    r"^Option '([^']+)' requires an argument.*": r"\1: expected a value, got none",
    r"^Option '([^']+)' does not take a value.*": r"\1: expected no value, got one",
    r"^No such (command|option):? '?([^ ']+)'?": r"expected a known \1, got \2",
    r"^Got unexpected extra argument.* \((.*)\)$": r"expected no further argument, got \1",
    r"(?:\.| \() ?(?:Did you mean|Possible options:) ([^?)]*)[?)]$": r"; did you mean \1?",
}
"""Words of Typer and pydantic, and ours."""


def _in_our_words(text: str) -> str:
    """A message of Typer or pydantic in the form of our errors."""
    for theirs, ours in WORDS.items():
        text = re.sub(theirs, ours, text)
    return text.rstrip(".")


def _options(arguments: Sequence[str]) -> list[tuple[str, str]]:
    """Options as typed, each with its value or the argument after it."""
    pairs = itertools.pairwise([*arguments, "-"])
    items = [each.split("=", 1) if "=" in each else [each, after] for each, after in pairs]
    return [(option, value) for option, value in items if re.match("--?[a-z]", option)]


def _with_options(line: str, arguments: Sequence[str]) -> str:
    """An error of the library with the options that were typed in place of its arguments.

    Where it names none of them, it begins with the one option whose value it quotes.
    """
    typed = _options(arguments)
    for option in sorted({name for name, _ in typed}, key=len, reverse=True):
        words = option.lstrip("-").replace("-", "[ _]")
        form = rf"^(?:{words}: expected |expected '?{words}'? (?:to be |(?=(?:from|above) |\d)))"
        line = re.sub(form, f"{option}: expected ", line)
        line = re.sub("(--.*: expected) (?=from |above |greater|less)", r"\1 a number ", line)
        if "[" in words:
            line = re.sub(rf"(?<![\w.])({words.replace('[ _]', '_')})\b", option, line)
    got = re.fullmatch(r"expected [^:]*, got ('.*'|-?[\d.e+-]+|nan|-?inf)(;.*)?", line)
    if not got or "--" in line or got[1].lstrip("-").isdecimal():  # a count of something else
        return line
    quoting = {option for option, value in typed if got[1] in _forms(value)}
    return f"{quoting.pop()}: {line}" if len(quoting) == 1 else line


def _forms(value: str) -> list[str]:
    """Forms of the value of an option in an error."""
    with suppress(ValueError):
        return [repr(value), repr(float(value))]
    return [repr(value)]


class _Notices(logging.Handler):
    """Handler that prints what the library logs like all other lines of a command."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage())


@contextmanager
def show_notices() -> Iterator[None]:
    """Show notices of the library on standard error in the block."""
    log, handler = logging.getLogger("rastercov"), _Notices(logging.WARNING)
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)


def plain(text: str) -> str:
    """Text of one line, with escapes in place of control characters, as a terminal may show it."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in text)


def print_lines(*lines: object) -> None:
    """Print lines on standard output, whatever the names in them hold."""
    print(*(plain(str(line)) for line in lines), sep="\n", flush=True)


def say(text: str, code: int = 2) -> int:
    """Print one line on standard error, whatever the names in it hold; gives the exit code.

    A long word is shortened in its middle wherever it comes, and so is the line.
    """
    words = (shorten(word, LONGEST_WORD) for word in plain(text).split(" "))
    line = shorten(" ".join(words), LONGEST_LINE)
    with suppress(OSError):  # there is no stream left to report it
        print(line, file=sys.stderr, flush=True)
    return code


def leave(code: int) -> NoReturn:
    """End the process with this exit code, whatever is left in the buffers of its streams.

    Python writes them once more when it ends, and exits with 120 where that fails; it would wait
    for the threads that an interrupt leaves alone.
    """
    if threading.current_thread() is threading.main_thread():
        ignore_signals()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
    if code == NO_READER and hasattr(signal, "SIGPIPE"):  # the end that a shell expects
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGPIPE)
    is_left = any(thread.name.startswith(ABANDONED) for thread in threading.enumerate())
    if is_left or was_interrupted():  # Python would tidy up its memory for half a second
        os._exit(code)
    sys.exit(code)


def warn(*lines: str) -> None:
    """Print warnings, a line each, equal ones once."""
    for line in dict.fromkeys(lines):
        say(f"warning: {line}")


def report_skips(skipped: Mapping[int, str], *, is_accepted: bool) -> None:
    """Warn of each pose that crashed its worker; without `is_accepted`, end with 1 for any."""
    warn(*(f"pose {pose} (from 0) skipped: its process {end}" for pose, end in skipped.items()))
    if skipped and not is_accepted:
        raise typer.Exit(1)


def size_line(mesh: "Mesh") -> str:
    """Faces and size of a scene; a wrong unit shows in it."""
    return f"{plural(mesh.n_faces, 'face')}, {mesh.size_in_words}"


def out_option(words: str, default: str | bool = True) -> Any:
    """Option `--out` of a command that leaves files in a folder."""
    return typer.Option("--out", "-o", help=words, metavar="<path>", show_default=default)


FIRST_LINE, NEXT_LINE = 2.0, 10.0
"""Seconds until a line of progress, and from one to the next."""
IMPORTER = "<frozen importlib._bootstrap>"
"""File name of the code that loads modules."""


class ProgressLines:
    """Progress in lines on standard error, where that is no terminal."""

    def __init__(self, what: str, then: str = "") -> None:
        self._what, self._then, self._began = what, then, time.monotonic()
        self._first: tuple[float, int] | None = None
        self._last, self._at, self._next = (0, 0), 0.0, 0.0
        self.rest()

    def rest(self) -> None:
        """Say nothing for a while: another line was said, or modules are loading."""
        self._next = max(self._next, time.monotonic() + FIRST_LINE)

    def __call__(self, done: int, total: int) -> None:
        """Take how far it is, and say so where it is time.

        A count that begins anew after the last is of what comes `then`.
        """
        before, of = self._last
        if done == 0 < of <= before:
            self._what, self._first = self._then or self._what, None
        if done != before or self._first is None:
            self._at = time.monotonic()
        self._last = done, total
        if self._first is None:
            self._first = self._at, done
            self.rest()
        if done < total:
            self.tell()

    def tell(self) -> None:
        """Say how far it is and the time left, or the time that has passed, where it is time."""
        now, (done, total) = time.monotonic(), self._last
        if now < self._next:
            return
        self._next = now + NEXT_LINE
        if self._first is None or done >= total:
            rest = f" done; {self._then}" if total else ""
            if total and self._then in ("", self._what):
                rest = f": {total:,} of {total:,}, finishing"
            elapsed = _duration(now - self._began)
            say(time_limit_in_words() or f"{self._what}{rest}: {elapsed} elapsed", 0)
            return
        started, before = self._first
        step = (self._at - started) / max(done - before, 1)
        left = step * (total - done) - min(
            now - self._at, step
        )  # a long step says nothing of others
        is_most = self._what == "refinement"
        time_ = f"{'at most' if is_most else 'about'} {_duration(max(left, 1))} left"
        if done <= before:
            time_ = f"{_duration(now - started)} elapsed"
        of = f"of about {total:,} evaluations" if is_most else f"of {total:,}"
        say(f"{self._what}: {done:,} {of}, {time_}", 0)


def _duration(seconds: float) -> str:
    """A time in seconds, from two minutes on in minutes, and from two hours on in hours."""
    factor, unit = (1, "s") if seconds < 120 else (60, "min") if seconds < 7200 else (3600, "h")
    return f"{seconds / factor:,.0f} {unit}"


_STEPS: list[ProgressLines | None] = []
"""Steps that a command is in, the innermost last; None for one that says nothing."""


@contextmanager
def show_lines(lines: ProgressLines | None) -> Iterator[None]:
    """Show lines of a step in place of the one around it; nothing for None."""
    _STEPS.append(lines)
    try:
        yield
    finally:
        _STEPS.pop()
        for each in _STEPS:
            if each is not None:
                each.rest()


def _is_importing(thread: int) -> bool:
    """True while a thread loads a module."""
    frame = sys._current_frames().get(thread)
    while frame is not None and frame.f_code.co_filename != IMPORTER:
        frame = frame.f_back
    return frame is not None


@contextmanager
def show_waits(command: str) -> Iterator[None]:
    """Say from time to time what a command does, where standard error is no terminal.

    The time that modules take to load does not count.
    """
    ended, worker = threading.Event(), threading.get_ident()

    def watch() -> None:
        while not ended.wait(FIRST_LINE / 4):
            if not _STEPS or (lines := _STEPS[-1]) is None:
                continue
            if _is_importing(worker):
                lines.rest()
            else:
                lines.tell()

    thread = threading.Thread(target=watch, daemon=True)
    with show_lines(ProgressLines(command)):
        if sys.stderr is not None and not sys.stderr.isatty():
            with suppress(RuntimeError):  # no memory for a thread
                thread.start()
        try:
            yield
        finally:
            ended.set()
            if thread.is_alive():
                thread.join()


def exit_codes(command: str) -> str:
    """Exit codes of a command by its name, as one sentence."""
    failed = f"1 {FAILED[command]}, " if command in FAILED else ""
    return f"Exit codes: 0 done, {failed}2 wrong usage or input, 130 interrupted, 143 terminated."


def _process_value(
    option: Any, process: Callable[["Context", Any], Any], context: "Context", value: Any
) -> Any:
    """Value of an option; what is no text Typer reads by pydantic, 0.1 s until it is loaded."""
    if value is None and not option.required:
        return None
    kind = option.type_descriptor.annotation
    own = (*get_args(kind), kind)[0]
    is_known = own in (str, Path) or value == option.default
    if option.callback or not is_known or (option.required and not value):
        return process(context, value)
    return [own(each) for each in value] if isinstance(value, list | tuple) else own(value)


class _Help:
    """Command whose help has a panel for each group of options; the terminal may be narrow."""

    def get_params(self: Any, ctx: "Context") -> Any:
        """Parameters whose values `_process_value` gives."""
        options = super().get_params(ctx)  # type: ignore[misc] # of the command
        for option in options:
            vars(option).setdefault(
                "process_value", partial(_process_value, option, option.process_value)
            )
        return options

    def format_epilog(self: Any, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write the exit codes."""
        formatter.write_paragraph()
        formatter.write_text(exit_codes(self.name))

    def format_help_text(self: Any, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write the description; the line of an example stays whole, so that it can be copied."""
        for paragraph in inspect.cleandoc(self.help).split("\n\n"):
            title, is_example, rest = paragraph.partition(": rastercov ")
            formatter.write_paragraph()
            if is_example:
                formatter.write(f"{title}:\n  rastercov {rest}\n")
            else:
                formatter.write_text(paragraph)

    def format_options(self: Any, ctx: "Context", formatter: "HelpFormatter") -> None:
        """Write commands, arguments and options, a panel for those that `expand_options` made."""
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
    """Command with this help, which a signal ends within a second."""

    def invoke(self, ctx: "Context") -> Any:
        """Run it."""
        watch_signals()
        with show_waits(str(self.name)):
            return super().invoke(ctx)


class CommandGroup(_Help, TyperGroup):
    """Group of commands with this help."""

    def invoke(self, ctx: "Context") -> Any:
        """Run the command of the group."""
        with separate_broken_pipes():
            return super().invoke(ctx)


def _names(text: str) -> str:
    """Names and metavar of an option; one that may be repeated ends in dots, an argument, too."""
    text = re.sub(r"<list\[(.*)\]>", r"<\1>...", text.replace(" range>", ">"))
    return re.sub(r"^([\w|]+)(\.\.\.)? <.*>\.\.\.", r"\1...", text)


SETTINGS: ByName = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
}
COMMANDS = {
    "evaluate": "Evaluate the coverage of a mesh by camera poses, and write a report.",
    "demo": "Run `evaluate` on a built-in mesh.",
    "render": "Render one pose: a picture, and the face index and depth of every pixel (PNG, NPZ).",
    "compare": "Compare visibility methods with a reference.",
    "place": "Place cameras from a plan file.",
    "check": "Check a rig against a plan.",
    "audit": "Audit existing cameras: what each sees, what is lost without it, and which subset "
    "suffices.",
    "cameras": "Search the catalogue of cameras, lenses, sensor heads and lamps.",
    "groups": "List groups, parts (such as storeys) and rooms of mesh files.",
    "convert": "Convert camera and pose files, and report what the target format cannot represent.",
    "view": "View a rig in the browser, move its cameras, and see what they cover.",
    "playground": "Write a page that computes without rastercov, for a mesh of its reader.",
    "serve": "Answer requests of another program, a line of JSON each.",
    "locate": "Find the pose of an installed camera from a photograph, and what it covers now.",
    "sheet": "Draw a floor plan with cameras to scale: SVG, PDF or DXF.",
    "sun": "Compute sunlight hours and solar irradiation on faces, groups and storeys "
    "for a day or year.",
    "viewshed": "Compute the visible part of each cell of a terrain, with the curvature of the "
    "earth.",
    "doctor": "List and test graphics devices, and name missing packages.",
    "validate": "Validate the coverage model against marker detection in rendered images.",
}
"""Commands and the first line of their help, which the list shows before any is loaded."""
FAILED = {
    "rastercov": "a check or goal failed",
    "evaluate": "a pose crashed its worker",
    "demo": "a pose crashed its worker",
    "compare": "an error bound was exceeded",
    "place": "the goal was not reached, a flight is blocked, or a candidate crashed its worker",
    "check": "a requirement failed, or the result is worse than the baseline",
    "audit": "a pose crashed its worker",
    "sun": "a group gets less sunlight than --at-least, or is undecided",
    "locate": "a camera has moved (2: undecided)",
    "viewshed": "an observer sees too little of the ground",
    "doctor": "the default device failed its test",
    "markers": "fewer than 98 % of the predictions were right",
    "validate": "fewer than 98 % of the predictions were right",
}
"""Meaning of exit code 1 of each command that has it."""
IN_MODULE = {
    "check": "place",
    "demo": "evaluate",
    "playground": "view",
    "render": "evaluate",
    "validate": "compare",
}
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
        value: Any = typer.main.get_command(app)
        value.name = self.name
        return value

    def make_context(self, *args: object, **options: object) -> Any:
        """Context of the command itself."""
        return self.loaded.make_context(*args, **options)


def group() -> Any:
    """The commands, as one that has them."""
    app = typer.Typer(
        help="Find which part of a surface each camera sees, how well, and why the rest is not "
        "covered.\n\nExample: rastercov demo --out report/",
        name="rastercov",
        cls=CommandGroup,
        **SETTINGS,
    )
    app.callback(invoke_without_command=True)(_start)
    value: Any = typer.main.get_command(app)
    for name, words in COMMANDS.items():
        value.add_command(LazyCommand(name, help=words))
    return value


def _print_version(is_asked: bool) -> None:
    if is_asked:
        print(rastercov.__version__)
        raise typer.Exit


# Eager, as --help is: what comes later loads numpy.
VERSION = typer.Option(
    "--version", help="Print the version.", callback=_print_version, is_eager=True
)


def _start(context: typer.Context, show_version: Annotated[bool, VERSION] = False) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit(2)
