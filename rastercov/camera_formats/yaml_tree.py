"""YAML of calibration files: plain values, the dialect of OpenCV, and limits.

Numbers and truth values are those of YAML 1.2, whatever the file declares: YAML 1.1 takes 1e-5 for
a text and 1:30 for ninety. Aliases are resolved as long as the whole stays small, tags other than
OpenCV's are errors, and a name that comes twice in a table is one.
"""

import re
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from rastercov._checks import shown
from rastercov._files import UnparsedError, one_line

MOST_VALUES = 2_000_000
"""Values of a file, each alias counted as what it repeats."""
DEEPEST = 50
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$")
INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN|Nan)$")
OPENCV_TAGS = ("opencv-matrix", "opencv-nd-matrix", "opencv-sparse-matrix", "opencv-sequence-tree")
PREFIX = "tag:yaml.org,2002:"

_Base: Any = getattr(
    yaml, "CSafeLoader", yaml.SafeLoader
)  # the compiled parser, where there is one


class _Loader(_Base):  # type: ignore[misc] # chosen above
    """Loader of the values of YAML 1.2's core schema."""

    yaml_implicit_resolvers: dict[str | None, list[tuple[str, Any]]] = {}  # noqa: RUF012 - as in the base


for _tag, _pattern, _first in (
    ("bool", r"(true|True|TRUE|false|False|FALSE)$", "tTfF"),
    ("null", r"(~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("int", r"[-+]?[0-9]{1,40}$", "-+0123456789"),
    ("float", FLOAT.pattern, "-+.0123456789"),
    ("float", INFINITE.pattern, "-+."),
):
    _Loader.add_implicit_resolver(PREFIX + _tag, re.compile(_pattern), list(_first))


def parsed_yaml(text: str) -> Any:
    """Content of a YAML text; `UnparsedError` for anything else."""
    # OpenCV writes %YAML:1.0, which is no directive of YAML.
    text = re.sub(r"\A(\s*%[^\n]*\n)+", "", text)
    loader = _Loader(text)
    try:
        root = loader.get_single_node()
        return None if root is None else _Tree().value(root)
    except yaml.YAMLError as error:
        raise UnparsedError("YAML", one_line(error)) from None
    except RecursionError:
        raise UnparsedError("YAML", "nested too deep") from None
    finally:
        loader.dispose()


class _Tree:
    """Plain values of a tree of nodes."""

    def __init__(self) -> None:
        self._values = 0

    def value(self, node: Node, depth: int = 0) -> Any:
        self._values += 1
        if self._values > MOST_VALUES:
            raise yaml.YAMLError(f"more than {MOST_VALUES} values, with those that aliases repeat")
        if depth > DEEPEST:
            raise yaml.YAMLError(f"nested deeper than {DEEPEST}")
        if isinstance(node, ScalarNode):
            return self._scalar(node)
        kind = node.tag.removeprefix(PREFIX)
        if kind not in ("map", "seq", *OPENCV_TAGS):
            raise yaml.YAMLError(f"a plain value wanted, got one with tag {shown(node.tag)}")
        if isinstance(node, SequenceNode):
            return [self.value(each, depth + 1) for each in node.value]
        assert isinstance(node, MappingNode)
        table: dict[str, Any] = {}
        for key, each in node.value:
            name = str(self.value(key, depth + 1)) if isinstance(key, ScalarNode) else None
            if name is None or name in table:
                words = "a name is no text" if name is None else f"{shown(name)} comes twice"
                raise yaml.YAMLError(f"{words}, line {key.start_mark.line + 1}")
            table[name] = self.value(each, depth + 1)
        return table

    def _scalar(self, node: ScalarNode) -> Any:
        kind, text = node.tag.removeprefix(PREFIX), node.value
        if kind == "null":
            return None
        if kind == "bool":
            return text.lower() == "true"
        if kind == "int" and text:
            return int(text)
        if kind == "float":
            return float(text if "n" not in text.lower() else text.replace(".", ""))
        if kind == "str":
            return text
        raise yaml.YAMLError(f"a plain value wanted, got one with tag {shown(node.tag)}")
