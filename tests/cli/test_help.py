"""Help in narrow terminals: every option in a panel, no name or metavar broken."""

import re

import pytest
import typer
from commands import call

from rastercov.cli.console import COMMANDS, FAILED, LazyCommand, exit_codes

WIDTHS = (60, 80, 100)
LINES = [[], ["validate"], ["validate", "markers"], *([name] for name in sorted(COMMANDS))]
PARAMETERS = [line for line in LINES if line not in ([], ["validate"])]


def loaded(line):
    """Click's command of a command line."""
    command = LazyCommand(line[0]).loaded
    return command.commands[line[1]] if line[1:] else command


def shown(capsys, monkeypatch, line, width):
    monkeypatch.setenv("COLUMNS", str(width))
    code, out, err = call(capsys, [*line, "--help"])
    assert (code, err) == (0, "")
    return out


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("line", LINES, ids=" ".join)
def test_no_line_is_wider_than_the_terminal_and_nothing_is_cut(capsys, monkeypatch, line, width):
    out = shown(capsys, monkeypatch, line, width)
    lines = [each for each in out.splitlines() if not each.startswith("  rastercov ")]
    assert max(map(len, lines)) <= width
    assert "…" not in out
    assert "\x1b" not in out


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("line", PARAMETERS, ids=" ".join)
def test_every_option_is_whole_and_in_its_panel(capsys, monkeypatch, line, width):
    out = shown(capsys, monkeypatch, line, width)
    panels = dict(re.findall(r"^(\w+):\n((?: .*\n)+)", out, re.MULTILINE))
    command = loaded(line)
    context = typer.Context(command)
    for parameter in command.get_params(context):
        panel = panels[parameter.rich_help_panel or "Options"]
        names = [*parameter.opts, *parameter.secondary_opts]
        if parameter.param_type_name == "argument":
            names = [parameter.get_help_record(context)[0].split()[0].removesuffix("...")]
        heads = re.findall(r"^  (\S.*?)(?: {2,}|$)", panel, re.MULTILINE)
        for name in names:
            whole = re.compile(rf"(?<!\S){re.escape(name)}(?!\w|-)")
            heads = [head for head in heads if whole.search(head)]
        (head,) = heads
        assert head.count("<") == head.count(">")


@pytest.mark.parametrize("line", LINES, ids=" ".join)
def test_help_ends_with_the_exit_codes(capsys, monkeypatch, line):
    out = shown(capsys, monkeypatch, line, 60)
    assert " ".join(out.split()).endswith(exit_codes(["rastercov", *line][-1]))


def test_exit_codes_are_of_commands():
    assert FAILED.keys() <= {"rastercov", "markers", *COMMANDS}


@pytest.mark.parametrize("line", LINES, ids=" ".join)
def test_an_example_is_one_line_that_can_be_copied(capsys, monkeypatch, line):
    outs = [shown(capsys, monkeypatch, line, width) for width in WIDTHS]
    first, *others = [re.findall(r"^  (rastercov .*)$", out, re.MULTILINE) for out in outs]
    assert others == [first, first]
    assert first or line == ["validate"]
