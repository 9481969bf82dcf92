"""Commands as tests call them, in this process or in one of their own, and a part for them."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

from rastercov import cli
from rastercov.core.mesh import shapes

INTERRUPTIBLE = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
"""The background of a shell ignores SIGINT, and so would a process that tests start from there."""
ENTRY = (
    INTERRUPTIBLE + "import sys; from rastercov.cli import main; sys.argv[0] = 'rastercov'; main()"
)
LID_AND_REST = {0: "lid", 2: "rest"}


def write_part(path, side=1.0, names=LID_AND_REST):
    """A box as OBJ; `names` starts a group at a face: lid (two faces) and rest."""
    mesh = shapes.box((side, side, side))
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    for index, face in enumerate(mesh.faces + 1):
        lines += [f"g {names[index]}"] if index in names else []
        lines.append("f " + " ".join(map(str, face)))
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def enter(folder, monkeypatch):
    """Work in a folder, with a terminal of 100 columns and no settings of the person who tests."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setattr("rastercov.cli.console.FIRST_LINE", 60.0)  # however slow the machine is
    for name in ("FORCE_COLOR", "NO_COLOR", "RASTERCOV_TRACEBACK"):
        monkeypatch.delenv(name, raising=False)


def call(capsys, line):
    """Exit code, standard output and standard error of a command line, in this process."""
    code = cli.command(line if isinstance(line, list) else shlex.split(line))
    return code, *capsys.readouterr()


def done(capsys, line):
    """Standard output and standard error of a command line that ends with 0."""
    code, out, err = call(capsys, line)
    assert code == 0, err
    return out, err


def answer(capsys, line, code=0):
    """Answer of a command line with --json."""
    answer, out, err = call(capsys, f"{line} --json")
    assert answer == code, err
    return json.loads(out)


def refusal(capsys, line):
    """The one line that a bad command line gets."""
    code, out, err = call(capsys, line)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.endswith("\n")
    assert err.count("\n") == 1
    return err


def without_progress(text):
    """Text of a command on standard error, without lines on the time that has passed or is left."""
    kept = text.splitlines(keepends=True)
    ends = (b" elapsed", b" left") if isinstance(text, bytes) else (" elapsed", " left")
    return text[:0].join(line for line in kept if not line.rstrip().endswith(ends))


def process(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **environment):
    """The command as a process of its own, for laws about streams, signals and the environment."""
    words = line if isinstance(line, list) else shlex.split(line)
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", ENTRY, *words],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
        env=os.environ | environment,
        timeout=300,
        check=False,
    )
    result.stderr = without_progress(result.stderr or b"")  # however slow the machine is
    return result


def content(folder):
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}
