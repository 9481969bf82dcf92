"""Pages of the documentation that are made from the code: commands, plan files, API.

`conf.py` calls `write_all` at the start of a build, so the pages cannot differ from the program.
They are Markdown for commands and plans, and reStructuredText for the API, in `docs/reference/`,
which git ignores.
"""

import importlib
import inspect
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import rastercov
from rastercov.cli.console import COMMANDS, LazyCommand, _names, exit_codes
from rastercov.placement.plan.file import schema
from rastercov.report.live import engine, playground

FOLDER = Path(__file__).parent / "reference"
PARTS = {
    "mesh": "Meshes",
    "camera": "Cameras and poses",
    "coverage": "Coverage",
    "coverage.area": "Coverage by area",
    "raster": "Rasterisers",
    "report": "Jobs with a report",
    "cluster": "Processes",
    "base": "Errors",
}
"""Packages of public names, and titles; others have their own name as title."""
MODULES = {
    "rastercov.shapes": "Built-in meshes",
    "rastercov.placement": "Placement of cameras",
    "rastercov.reference.models": "Coverage models of the literature",
}
"""Further modules that programs import from."""

NO_PLAYGROUND = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>Playground</title></head>
<body><p>This copy of the documentation has no playground: run make wasm docs.</p></body>
</html>
"""


def write_all() -> None:
    """Write every page that is made from the code; leave those alone that are as before."""
    pages = dict(_api()) | dict(_commands()) | {"plan.md": _plan()}
    pages["playground.html"] = playground() if engine() else NO_PLAYGROUND
    FOLDER.mkdir(exist_ok=True)
    for old in set(FOLDER.rglob("*.*")) - {FOLDER / name for name in pages}:
        old.unlink()
    for name, text in pages.items():
        path = FOLDER / name
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


# --- API ------------------------------------------------------------------------------------------


def _api() -> Iterator[tuple[str, str]]:
    """One page for each public name, and the list of them by package."""
    lines = ["API", "===", "", "Everything that a program imports. ``import rastercov as rc``.", ""]
    parts: dict[str, list[str]] = {}
    for module, names in rastercov._NAMES.items():
        package = "coverage.area" if module.startswith("coverage.area") else module.split(".")[0]
        parts.setdefault(PARTS.get(package, package.capitalize()), []).extend(names.split())
    order = [*PARTS.values(), *sorted(set(parts) - set(PARTS.values()))]
    for title in [title for title in order if title in parts]:
        names = sorted(parts[title], key=lambda name: (name[0].islower(), name.lower()))
        lines += _section(title, "rastercov", names)
        for name in names:
            yield _page("rastercov", name, getattr(rastercov, name))
    for module, title in MODULES.items():
        found = importlib.import_module(
            module.replace("rastercov.shapes", "rastercov.core.mesh.shapes")
        )
        names = getattr(found, "__all__", None) or [
            name
            for name, value in vars(found).items()
            if inspect.isfunction(value) and not name.startswith("_") and name != "typed"
            if inspect.unwrap(value).__module__ == found.__name__
        ]
        module = found.__name__
        names = sorted(names, key=lambda name: (name[0].islower(), name.lower()))
        lines += _section(title, module, names, f"``{module}``")
        for name in names:
            yield _page(module, name, getattr(found, name))
    yield "api.rst", "\n".join(lines)


def _section(title: str, module: str, names: list[str], words: str = "") -> list[str]:
    rows = [f"   ~{module}.{name}" for name in names]
    pages = [f"   {name} <api/{module}.{name}>" for name in names]
    head = [title, "-" * len(title), "", *([words, ""] if words else [])]
    hidden = [".. toctree::", "   :hidden:", f"   :caption: {title}", "", *pages, ""]
    return [*head, ".. autosummary::", "   :nosignatures:", "", *rows, "", *hidden]


def _page(module: str, name: str, value: Any) -> tuple[str, str]:
    full = f"{module}.{name}"
    kind = "autofunction"
    options = []
    if inspect.isclass(value):
        kind = "autoexception" if issubclass(value, Exception) else "autoclass"
        options = (
            [] if issubclass(value, Exception) else ["   :members:", "   :inherited-members: int"]
        )
    elif not callable(value):
        kind = "autodata"
    title = full.removeprefix("rastercov.")
    lines = [title, "=" * len(title), "", f".. {kind}:: {full}", *options, ""]
    return f"api/{full}.rst", "\n".join(lines)


# --- commands -------------------------------------------------------------------------------------


def _commands() -> Iterator[tuple[str, str]]:
    """One page for each command, and the list of them."""
    rows, pages = [], []
    for name, words in COMMANDS.items():
        command = LazyCommand(name).loaded
        rows.append(f"| [`rastercov {name}`](commands/{name}.md) | {_cell(words)} |")
        pages.append(f"commands/{name}")
        yield f"commands/{name}.md", "\n".join(_command(command, ["rastercov", name], 1))
    table = ["| command | |", "|---|---|", *rows]
    tree = ["```{toctree}", ":hidden:", "", *pages, "```", ""]
    codes = exit_codes("rastercov")
    yield "commands.md", "\n".join(["# Commands", "", *table, "", codes, "", *tree])


def _command(command: Any, words: list[str], depth: int) -> list[str]:
    context = command.context_class(command, info_name=" ".join(words))
    inner = getattr(command, "commands", {})
    first, *blocks = re.split(r"\n\s*\n", inspect.cleandoc(command.help or "").replace("\b", ""))
    lines = [f"{'#' * depth} {' '.join(words)}", "", _prose(first), ""]
    for block in filter(None, map(str.strip, blocks)):
        said, colon, code = block.partition(":")
        if colon and code.strip().startswith("rastercov"):
            lines += [f"{_prose(said)}:", "", "```sh", re.sub(r"\s+", " ", code.strip()), "```", ""]
        else:
            lines += [_prose(block), ""]
    usage = command.collect_usage_pieces(context)
    if not inner:
        lines += ["```", " ".join([*words, *usage]), "```", ""]
    tables: dict[str, list[str]] = {}
    for entry in command.params:
        record = entry.get_help_record(context)
        if record is None or entry.name == "help":
            continue
        panel = getattr(entry, "rich_help_panel", None) or ("Options" if not inner else "")
        tables.setdefault(panel, []).append(_row(*record))
    for panel, rows in tables.items():
        lines += [f"{'#' * (depth + 1)} {panel}", "", "| | | default |", "|---|---|---|", *rows, ""]
    lines += [] if inner else [exit_codes(command.name), ""]
    for name, each in inner.items():
        lines += _command(each, [*words, name], depth + 1)
    return lines


def _row(name: str, text: str) -> str:
    """Row of a table from what `--help` prints: name, meaning, default."""
    words, bracket, rest = text.rpartition("  [")
    if not bracket:
        words, rest = (text, "") if not text.startswith("[") else ("", text[1:])
    notes = rest.removesuffix("]").split("; ") if rest else []
    given = next((note[9:] for note in notes if note.startswith("default: ")), "")
    limits = [note for note in notes if not note.startswith("default: ") and note != "required"]
    given = "required" if "required" in notes else given
    if given and given != "required":
        given = given[1:-1] if given.startswith("(") else f"`{given}`"
    words += f" [{', '.join(limits)}]" if limits else ""
    return f"| `{_names(name)}` | {_cell(words)} | {_cell(given)} |"


# --- plan files -----------------------------------------------------------------------------------


def _plan() -> str:
    """Every table of a plan file with its keys, types, defaults and meaning."""
    found = schema()
    kinds = found["$defs"]
    lines = [
        "# Plan reference",
        "",
        "Every table and key of a [plan file](../plan.md), made from the model that reads it. "
        "Lengths are metres, angles degrees, and files are relative to the plan.",
        "",
        "| table | |",
        "|---|---|",
    ]
    sections: list[str] = []
    seen: set[str] = set()
    for key, entry in found["properties"].items():
        heads = list(_heads(key, entry, kinds))
        words = entry.get("description") or next(
            (kinds[name].get("description", "") for _, name in heads), ""
        )
        if not heads:
            lines.append(f"| `{key}` | {_cell(words)} |")
        for head, name in heads:
            anchor = _anchor(head)
            own = kinds[name].get("description", "") if len(heads) > 1 else words
            lines.append(f"| [`{head}`](#{anchor}) | {_cell(own or words)} |")
            sections += _plan_table(f"`{head}`", kinds[name])
            seen.add(name)
    inner = [name for name in kinds if name not in seen]
    lines += ["", *sections]
    for name in inner:
        lines += _plan_table(_words_of(name), kinds[name], seen)
    heads = {_anchor(line.lstrip("#").strip()) for line in lines if line.startswith("#")}

    def link(found: re.Match[str]) -> str:  # entries of a list have the heading of the list
        return found[0] if found[2] in heads else found[1]

    return re.sub(r"\[([^]]+)\]\(#([^)]+)\)", link, "\n".join(lines))


def _heads(key: str, entry: Mapping[str, Any], kinds: Mapping[str, Any]) -> Iterator[Any]:
    """Headings of a table in the file, each with the name of its definition."""
    is_list, is_named = "items" in entry, isinstance(entry.get("additionalProperties"), dict)
    source = entry.get("items", entry)
    source = entry["additionalProperties"] if is_named else source
    source = next((each for each in source.get("anyOf", ()) if each.get("type") != "null"), source)
    bracket = f"[[{key}]]" if is_list else f"[{key}.NAME]" if is_named else f"[{key}]"
    if "$ref" in source:
        yield bracket, source["$ref"].rpartition("/")[2]
    by_name: dict[str, list[str]] = {}
    for choice, reference in source.get("discriminator", {}).get("mapping", {}).items():
        by_name.setdefault(reference.rpartition("/")[2], []).append(choice)
    for name, choices in by_name.items():
        which = source["discriminator"]["propertyName"]
        yield f"{bracket} {which} = {' or '.join(map(json.dumps, choices))}", name


def _plan_table(title: str, kind: Mapping[str, Any], _seen: Any = None) -> list[str]:
    rows = []
    required = kind.get("required", ())
    for key, entry in kind.get("properties", {}).items():
        default = "required" if key in required else _default(entry)
        words = entry.get("description", "")
        rows.append(f"| `{key}` | {_type(entry)} | {default} | {_cell(words)} |")
    words = [_prose(kind["description"]), ""] if kind.get("description") else []
    head = ["| key | type | default | |", "|---|---|---|---|"]
    return [f"## {title}", "", *words, *head, *rows, ""]


def _default(entry: Mapping[str, Any]) -> str:
    value = json.loads(json.dumps(entry.get("default")), object_hook=_given)
    if value is None or isinstance(value, dict):
        return ""
    return f"`{_cell(json.dumps(value))}`"


def _given(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}


def _type(entry: Mapping[str, Any]) -> str:
    """Type of a value in words, with its limits."""
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        return f"[{_words_of(name)}](#{_anchor(_words_of(name))})"
    if "anyOf" in entry or "oneOf" in entry:
        options = [
            each for each in entry.get("anyOf", entry.get("oneOf")) if each != {"type": "null"}
        ]
        return " or ".join(dict.fromkeys(map(_type, options)))
    if "enum" in entry:
        return ", ".join(f"`{json.dumps(value)}`" for value in entry["enum"])
    if "const" in entry:
        return f"`{json.dumps(entry['const'])}`"
    kind = entry.get("type", "any")
    if kind == "array":
        inner = _type(entry.get("items", {}))
        least, most = entry.get("minItems"), entry.get("maxItems")
        return f"{least} x {inner}" if least == most and least else f"list of {inner}"
    if kind == "object":
        inner = entry.get("additionalProperties")
        return f"table of {_type(inner)}" if isinstance(inner, dict) else "table"
    words = {
        "number": "number",
        "integer": "whole number",
        "string": "text",
        "boolean": "true, false",
    }
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    limits = [f"{sign} {entry[key]:g}" for key, sign in signs.items() if key in entry]
    return _cell(" ".join([words.get(kind, kind), ", ".join(limits)]).strip())


def _words_of(name: str) -> str:
    """Name of a definition as words: `TransformEntry` is "transform"."""
    name = re.sub(r"(Entry|Section)$", "", name)
    return re.sub(r"(?<=[a-z])([A-Z])", lambda letter: f" {letter[0].lower()}", name).lower()


def _anchor(head: str) -> str:
    """Anchor that GitHub and MyST give a heading."""
    return re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")


# --- text -----------------------------------------------------------------------------------------


def _cell(text: str) -> str:
    return _prose(text).replace("|", "\\|").replace("\n", " ")


def _prose(text: str) -> str:
    """Text of help as Markdown: words in angle brackets are no HTML."""
    return re.sub(r"\s*\n\s*", " ", text).replace("<", "&lt;").replace("*", "\\*").strip()
