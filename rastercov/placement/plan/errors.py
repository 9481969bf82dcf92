"""Error lines of a plan file: all errors of pydantic at once, a line each with its path.

For example `task.min_pixels: wanted a number above 0, got -3`.
"""

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from rastercov.base.checks import share_meant, shown
from rastercov.base.errors import ConfigError

WORDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "list_type": "a list in [ ]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of {ge:g} or more",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of {le:g} or less",
    "literal_error": "{expected}",
    "too_short": "{min_length} or more of them",
    "too_long": "{max_length} at most",
    "string_too_short": "a text that is not empty",
}
"""Words for the expected value, by the error type of pydantic."""


class PlanError(ConfigError):
    """A plan that cannot be used.

    Attributes
    ----------
    lines : tuple of str
        One for each error, with the name of the file and the path in it.
    """

    def __init__(self, name: str, lines: Sequence[str]) -> None:
        self.lines = tuple(f"{name}: {line}" for line in lines)
        more = f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""
        super().__init__(self.lines[0] + more)


def lines_of(error: ValidationError, table: Mapping[str, Any], model: type[BaseModel]) -> list[str]:
    """Errors of pydantic as lines, one for each path."""
    wanted: dict[str, list[str]] = {}
    lines: dict[str, str] = {}
    for each in error.errors(include_url=False):
        kind, path = each["type"], _path(each["loc"], table, each["type"])
        if kind in WORDS:
            words = wanted.setdefault(path, [])
            text = WORDS[kind].format(**each.get("ctx", {}))
            words += [text] if text not in words else []
            lines[path] = f"{path}: wanted {' or '.join(words)}, got {shown(each['input'])}"
            if each.get("ctx", {}).get("le") == 1:
                lines[path] += share_meant(each["input"])
        elif kind == "missing":
            lines[path] = f"{path}: missing; add it"
        elif kind == "extra_forbidden":
            lines[path] = f"{path}: there is no such entry{_meant(each['loc'], model)}"
        elif kind == "union_tag_not_found":
            tag = each["ctx"]["discriminator"].strip("'")
            lines[f"{path}.{tag}"] = f"{_joined(path, tag)}: missing; add it"
        elif kind == "union_tag_invalid":
            context = each["ctx"]
            tag, known = context["discriminator"].strip("'"), context["expected_tags"]
            near = _near(context["tag"], known.replace("'", "").split(", "))
            path = _joined(path, tag)
            lines[path] = f"{path}: wanted one of {known}, got {context['tag']!r}{near}"
        else:
            text = " ".join(each["msg"].removeprefix("Value error, ").split())
            lines[path] = f"{path}: {text}" if path else text
    return list(lines.values())


def _path(location: tuple[int | str, ...], table: Any, kind: str) -> str:
    """Path of an error in the table, without the names of union members."""
    path, here = "", table
    for place, part in enumerate(location):
        is_last = place == len(location) - 1
        if isinstance(here, Mapping) and part in here:
            path, here = _joined(path, str(part)), here[part]
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            path, here = f"{path}[{part}]", here[part]
        elif is_last and kind == "missing":
            path = _joined(path, str(part))
    return path


def _joined(path: str, part: str) -> str:
    part = part if re.fullmatch("[A-Za-z0-9_-]+", part) else json.dumps(part)
    return f"{path}.{part}" if path else part


def _meant(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """Known entries beside an unknown one, and the most similar name."""
    names = sorted(_entries(location[:-1], model.model_json_schema()))
    if not names:
        return ""
    return f"; there are {', '.join(names)}{_near(str(location[-1]), names)}"


def _near(name: str, names: Sequence[str]) -> str:
    found = difflib.get_close_matches(name, names, 1)
    return f"; did you mean {found[0]}?" if found else ""


def _entries(location: tuple[int | str, ...], schema: dict[str, Any]) -> set[str]:
    """Names of the entries of the table at a location, from the schema of the model."""
    here: dict[str, Any] = schema
    for part in location:
        here = _resolved(here, schema)
        if isinstance(part, int):
            here = here.get("items", {})
        elif part in here.get("properties", {}):
            here = here["properties"][part]
        elif part in (mapping := here.get("discriminator", {}).get("mapping", {})):
            here = {"$ref": mapping[part]}
    return set(_resolved(here, schema).get("properties", {}))


def _resolved(here: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """Definition to which a part of a schema refers."""
    members = [m for m in here.get("anyOf", []) if m.get("type") != "null"]
    if len(members) == 1:
        here = members[0]
    while "$ref" in here:
        here = schema["$defs"][here["$ref"].rsplit("/", 1)[-1]]
    return here
