"""Lines that commands print for people: bounded, and one for an interrupt whatever it met."""

import subprocess
import sys
from pathlib import Path

import pytest
from commands import enter, refusal

from rastercov.cli.console import LONGEST_LINE, LONGEST_WORD, say

COMMAND = "evaluate box -c camera.toml -p sphere:2 -o out"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    Path("camera.toml").write_text("width = 96\nheight = 72\nfx = 90\nfy = 90\n")


LONG = ("x" * 3000, "word " * 700, "漢" * 900, "a/" * 100 + "b" * 2500)


@pytest.mark.parametrize("value", LONG)
@pytest.mark.parametrize(
    "option",
    ["-c", "-p", "--method", "--unit", "--transform", "--occluder", "--target", "--by", "--table",
     "--two-sided", "--views", "--pose-unit", "--camera-name", "--scheduler", "--no-such-option"],
)  # fmt: skip
def test_a_long_value_is_shortened(capsys, option, value):
    line = refusal(capsys, [*COMMAND.split(), option, value])
    assert len(line) <= LONGEST_LINE + 1


@pytest.mark.parametrize("value", LONG)
@pytest.mark.parametrize("words", [[], ["check"], ["place"], ["convert"], ["view"], ["audit"]])
def test_a_long_name_is_shortened(capsys, words, value):
    assert len(refusal(capsys, [*words, value, value])) <= LONGEST_LINE + 1


def test_a_long_value_keeps_its_begin_and_end_and_the_words_around_it(capsys):
    path = f"/begin/{'x' * 500}/part.stl"
    say(f"error: {path}: wanted a file, got {path}; look again")
    line = capsys.readouterr().err.rstrip("\n")
    first, rest = line.removeprefix("error: ").split(": wanted a file, got ")
    assert first == rest.removesuffix("; look again")
    assert len(first) == LONGEST_WORD - 1  # with its comma or colon
    assert first.startswith("/begin/x")
    assert first.endswith("x/part.stl")
    say("error: " + path[:150])
    assert capsys.readouterr().err == f"error: {path[:150]}\n"


INTERRUPTED = """
import os, signal, time
from rastercov import cli
def stopped(arguments, **options):
    try:
        os.kill(os.getpid(), signal.{name})
        time.sleep(60)
    except BaseException:
        raise {error} from None
cli._group = lambda: stopped
cli.main()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("error", ["SystemError('an exception set')", "KeyError('loop')"])
def test_an_interrupt_that_becomes_another_error_is_no_defect(name, error):
    """As in a compiler that makes an error of its own of whatever stops it."""
    code = INTERRUPTED.format(name=name, error=error)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


SWALLOWED = """
import ctypes, os, signal, time
from rastercov import cli
def callback():
    os.kill(os.getpid(), signal.{name})
    time.sleep(1)
def stopped(arguments, **options):
    for _ in range({times}):
        ctypes.CFUNCTYPE(None)(callback)()
    time.sleep(60)
cli._group = lambda: stopped
cli.main()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("times", [1, 2])
def test_an_interrupt_that_a_callback_swallows_comes_again(name, times):
    """As in LLVM, which calls Python with what it has compiled."""
    code = SWALLOWED.format(name=name, times=times)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=30
    )
    assert (done.returncode, done.stderr) == (130, "interrupted\n")
