"""Help of a command for terminals of any width: options in panels, no name or metavar broken."""

import re
import shutil
import textwrap
from collections.abc import Iterable
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

WIDEST, WIDEST_NAMES = 100, 34
"""Columns of the text, and of the names beside it; longer names have a line of their own."""
PANELS = {
    "Inputs": "meshes plan source sources --unit --transform --occluder --target --two-sided "
    "--drop-invalid --shape --schema",
    "Camera": "--camera --poses --camera-name --pixel-centre --lens-model --pose-unit --image-size "
    "--pose-convention --original-world --skip-bad-poses --pose",
    "Task": "--min-pixels --min-visibility --max-blur --max-incidence-deg --min-pixel-density "
    "--min-facing-density --min-pixels-per-m2 --min-coverage --views --min-angle-deg --thesis "
    "--group --scenes --seed --obstacle",
    "Method": "--method --by --supersample --device --workers --scheduler --against "
    "--resolution-of-result --convergence --models --from --to",
    "Output": "target --out --table --pictures --json --json-progress --junit --failures "
    "--faces --overwrite --export",
    "Server": "--port --host --token-file --certificate --key --no-browser",
    "Other": "--version --help",
}
"""Panels in their order, and the arguments and options of all commands by panel."""
PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}


class _Help:
    """Command whose help is text in panels; the terminal may be narrow."""

    def format_help(self: Any, ctx: Any, formatter: Any) -> None:
        """Write usage, description, examples, and a panel for each kind of option."""
        width = max(40, min(shutil.get_terminal_size().columns, WIDEST))
        rows: dict[str, list[tuple[str, str]]] = {panel: [] for panel in ("Commands", *PANELS)}
        for parameter in self.get_params(ctx):
            if (record := parameter.get_help_record(ctx)) is not None:
                name = max(parameter.opts, key=len)
                text = re.sub(r"\[default: \((.*?)\)", r"[default: \1", record[1])
                rows[PANEL_OF.get(name, "Other")].append((_names(record[0]), text))
        commands = [(name, self.get_command(ctx, name)) for name in _commands(self, ctx)]
        rows["Commands"] = [(name, command.help.split("\n\n")[0]) for name, command in commands]
        lines = [*textwrap.wrap(self.get_usage(ctx), width, **_WHOLE), ""]
        for paragraph in (self.help or "").split("\n\n"):
            lines += [*_paragraph(" ".join(paragraph.split()), width), ""]
        for panel in rows:
            lines += [*_panel(panel, rows[panel], width), ""] if rows[panel] else []
        formatter.write("\n".join(lines))


class Command(_Help, TyperCommand):
    """Command with this help."""


class Group(_Help, TyperGroup):
    """Group of commands with this help."""


_WHOLE: Any = {"break_long_words": False, "break_on_hyphens": False}


def _commands(group: Any, ctx: Any) -> Iterable[str]:
    return group.list_commands(ctx) if isinstance(group, TyperGroup) else ()


def _names(text: str) -> str:
    """Names and metavar of an option; one that may be repeated ends in dots, an argument, too."""
    text = re.sub(r"<list\[(.*)\]>", r"<\1>...", text.replace(" range>", ">"))
    return re.sub(r"\.\.\. <.*>\.\.\.", "...", text)


def _paragraph(text: str, width: int) -> list[str]:
    """Lines of a paragraph; an example, which begins in bold, can be copied from several lines."""
    if (example := re.fullmatch(r"\[bold\](.*)\[/\]: (.*)", text)) is None:
        return textwrap.wrap(text, width, **_WHOLE)
    fits = len(example[2]) <= width - 2
    parts = textwrap.wrap(
        example[2], width - (2 if fits else 4), subsequent_indent="    ", **_WHOLE
    )
    command = " \\\n".join("  " + part for part in parts)
    return [typer.style(f"{example[1]}:", bold=True), command]


def _panel(title: str, rows: list[tuple[str, str]], width: int) -> list[str]:
    """Lines of a panel: names in one column, text beside them."""
    column = min(max(len(names) for names, _ in rows), WIDEST_NAMES, width // 2) + 4
    lines = [typer.style(f"-- {title} ".ljust(width, "-"), bold=True)]
    for names, text in rows:
        first, *rest = textwrap.wrap(text, width - column, **_WHOLE) or [""]
        head = typer.style(f"  {names}", bold=True)
        if len(names) > column - 4:
            lines.append(head)
            rest = [first, *rest]
        else:
            lines.append(f"{head}{' ' * (column - 2 - len(names))}{first}".rstrip())
        lines += [" " * column + line for line in rest]
    return lines
