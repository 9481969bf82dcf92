"""Lines that commands print for people: bounded, and one for an interrupt whatever it met."""

import signal
import threading
import time
from pathlib import Path

import pytest
from commands import INTERRUPTIBLE, refusal, without_progress
from processes import python

from rastercov.base.limits import limit_time
from rastercov.cli.console import (
    LONGEST_LINE,
    LONGEST_WORD,
    exit_code,
    group,
    say,
    show_lines,
    show_waits,
)
from rastercov.cli.terminal import progress_bar

COMMAND = "evaluate box -c camera.toml -p sphere:2 -o out"
OPTIONS = (
    "-c -p --method --unit --transform --occluder --target --by --table --two-sided --views"
    " --pose-unit --camera-name --scheduler --no-such-option"
)
LINES = [
    *(f"{COMMAND} {option} LONG" for option in OPTIONS.split()),
    *(f"{name} LONG LONG" for name in ("", "check", "place", "convert", "view", "audit")),
]


@pytest.mark.parametrize("value", ["x" * 3000, "word " * 700, "漢" * 900, "a/" * 100 + "b" * 2500])
@pytest.mark.parametrize("line", LINES)
def test_a_long_value_or_name_is_shortened(capsys, line, value):
    Path("camera.toml").write_text("width = 96\nheight = 72\nfx = 90\nfy = 90\n")
    words = [value if word == "LONG" else word for word in line.split()]
    assert len(refusal(capsys, words)) <= LONGEST_LINE + 1


def test_a_long_value_keeps_its_begin_and_end_and_the_words_around_it(capsys):
    path = f"/begin/{'x' * 500}/part.stl"
    say(f"error: {path}: expected a file, got {path}; look again")
    line = capsys.readouterr().err.rstrip("\n")
    first, rest = line.removeprefix("error: ").split(": expected a file, got ")
    assert first == rest.removesuffix("; look again")
    assert len(first) == LONGEST_WORD - 1  # with its comma or colon
    assert (first[:8], first[-10:]) == ("/begin/x", "x/part.stl")
    say("error: " + path[:150])
    assert capsys.readouterr().err == f"error: {path[:150]}\n"


@pytest.mark.parametrize(
    ("line", "start"),
    [
        ("demo --shape=cube", "--shape: expected a built-in mesh"),
        ("evaluate box -c khepra -p sphere:2 --pose-unit 0", "--pose-unit: expected unit"),
        ("evaluate box -c khepra -p sphere:2 --pose-unit=nan", "--pose-unit: expected unit"),
        ("evaluate box -c khepra -p sphere:2 --camera-name up", "--camera-name: expected one of"),
        ("compare box -c khepra -p sphere:1 --against up", "--against: expected a reference"),
        ("compare box -c khepra -p sphere:1 --against up --camera-name up", "--camera-name: "),
        ("evaluate box -c khepra -p sphere:2 --views=-1", "--views: expected "),
    ],
)
def test_an_error_names_the_option_whose_value_it_quotes(capsys, line, start):
    assert refusal(capsys, line).startswith(f"error: {start}")


INTERRUPTED = """
import ctypes, os, time
from rastercov import cli
from rastercov.cli import console
def stop():
    os.kill(os.getpid(), signal.{name})
    time.sleep(1)
def becomes(error):
    try:
        stop()
    except BaseException:
        raise error from None
def is_swallowed(times):
    for _ in range(times):
        ctypes.CFUNCTYPE(None)(stop)()
    time.sleep(60)
console.group = lambda: lambda arguments, **options: {fate}
cli.main()
"""
"""An interrupt that a compiler makes an error of, or that a callback of LLVM swallows."""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(
    "fate",
    ["becomes(SystemError('an exception set'))", "becomes(KeyError('loop'))", "is_swallowed(1)",
     "is_swallowed(2)"],
)  # fmt: skip
def test_an_interrupt_ends_in_one_line_whatever_becomes_of_it(name, fate):
    done = python("-c", INTERRUPTIBLE + INTERRUPTED.format(name=name, fate=fate), timeout=30)
    code = 128 + getattr(signal, name)
    assert (done.returncode, without_progress(done.stderr)) == (code, "interrupted\n")


def test_a_wait_without_a_terminal_has_a_line_after_two_seconds_and_then_every_ten(
    capsys, monkeypatch
):
    clock = [100.0]
    monkeypatch.setattr("rastercov.cli.console.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 2.0)
    with progress_bar("poses") as progress:
        for done in range(10, 501, 10):  # a pose in 50 ms
            progress(done, 500)
            clock[0] += 0.5
    assert capsys.readouterr().err.splitlines() == [
        "poses: 50 of 500, about 22 s left",
        "poses: 250 of 500, about 12 s left",
        "poses: 450 of 500, about 2 s left",
    ]


def test_a_short_wait_has_no_line(capsys):
    with progress_bar("poses") as progress:
        for done in range(100):
            progress(done, 100)
    assert capsys.readouterr().err == ""


def test_a_command_that_is_busy_says_so_whatever_it_does(capsys, monkeypatch):
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 0.04)
    monkeypatch.setattr("rastercov.cli.console.NEXT_LINE", 0.04)

    def lines(app):
        with show_waits("audit"):
            app()
        return capsys.readouterr().err.splitlines()

    def wait():
        time.sleep(0.5)

    result = lines(wait)
    assert result
    assert set(result) <= {"audit: 0 s elapsed", "audit: 1 s elapsed"}

    def with_steps():
        with progress_bar("poses") as progress:
            progress(4, 4)
            wait()
        with progress_bar("area"):
            wait()

    result = lines(with_steps)
    starts = {line.partition(" s ")[0][:-1] for line in result}
    assert starts >= {"poses: 4 of 4, finishing: ", "area: "}
    assert lines(lambda: None) == []

    def within_a_limit():
        with progress_bar("poses", then="report") as progress:
            progress(4, 4)
            with limit_time("smallest subset", 30):
                wait()
            wait()

    result = lines(within_a_limit)
    assert {"smallest subset: at most 30 s left", "poses done; report: 1 s elapsed"} <= {*result}

    def serve():
        with show_lines(None):
            wait()

    assert lines(serve) == []
    assert not [each for each in threading.enumerate() if "watch" in each.name]


def test_a_time_left_has_a_unit_of_its_size(capsys, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr("rastercov.cli.console.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 2.0)
    with progress_bar("poses") as progress:
        progress(0, 10_000)
        for done, seconds in ((10, 10), (20, 10), (9000, 5000)):
            clock[0] += seconds
            progress(done, 10_000)
    assert capsys.readouterr().err.splitlines() == [
        "poses: 10 of 10,000, about 3 h left",
        "poses: 20 of 10,000, about 3 h left",
        "poses: 9,000 of 10,000, about 9 min left",
    ]


def test_what_comes_then_has_a_time_left_which_a_long_step_does_not_stretch(capsys, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr("rastercov.cli.console.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 2.0)
    with progress_bar(then="report") as progress:
        for done in range(3):
            progress(done, 2)
        for done in range(3):
            progress(done, 5)
            clock[0] += 10
        for _ in range(3):  # the third picture takes long
            progress.tell()
            clock[0] += 20
    assert capsys.readouterr().err.splitlines() == [
        "report: 1 of 5, about 40 s left",
        "report: 2 of 5, about 30 s left",
        *["report: 2 of 5, about 20 s left"] * 3,
    ]


@pytest.mark.parametrize("line", ["--help", "evaluate --help", "view --help", "place --schema"])
def test_help_has_no_line_about_a_wait(line, capsys, monkeypatch):
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 1e-4)
    monkeypatch.setattr("rastercov.cli.console.NEXT_LINE", 1e-4)
    assert exit_code(group(), line.split()) == 0
    readouterr = capsys.readouterr()
    assert readouterr.out
    assert readouterr.err == ""


def test_a_module_that_loads_is_no_wait(capsys, monkeypatch):
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 0.05)
    Path("slow_to_load.py").write_text("import time\ntime.sleep(0.5)\n")
    monkeypatch.syspath_prepend(Path.cwd())
    with show_waits("audit"):
        __import__("slow_to_load")
    assert capsys.readouterr().err == ""
