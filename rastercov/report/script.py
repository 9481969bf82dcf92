"""JavaScript of Python's functions of plain values, so that what both print and accept is one.

`texts_script` is the module `texts.js` of the page. A function may have numbers, texts, lists and
mappings, the statements and expressions of `TEMPLATES`, `CALLS` and `METHODS`, comprehensions over
one list, constants of its module, and calls of other such functions; anything else is refused.
Python's formats of numbers are in `page/plain.js`. JavaScript takes an empty list as true: compare
its length. It has one null: None is no default of `get` where a value may be None.
"""

import ast
import inspect
import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from types import FunctionType

from rastercov.base import ByName
from rastercov.base import format as texts
from rastercov.core.area.advice import advice_of, hidden_by, verdict_of, verdict_of_rigs
from rastercov.core.camera.camera import (
    central_arguments,
    check_fields,
    check_focus,
    depths_in_focus,
    shown_of,
    with_pixels,
)
from rastercov.core.camera.viewpoints import distances_to_try
from rastercov.formats.cameras import colmap
from rastercov.formats.meshes import gltf_file
from rastercov.placement import required

Shared = Callable[..., object]
SHARED: tuple[Shared, ...] = (
    depths_in_focus,
    distances_to_try,
    texts.number,
    texts.percent,
    texts.with_bound,
    texts.area,
    texts.distance,
    texts.text_with_sign,
    advice_of,
    hidden_by,
    verdict_of,
    verdict_of_rigs,
    required.status_of,
    required.short_by,
    required.share_of,
    required.ends_in_words,
    required.outcome_line,
    central_arguments,
    check_fields,
    check_focus,
    with_pixels,
    shown_of,
    colmap.read_cameras,
    colmap.read_images,
    colmap.parameters_of,
    gltf_file.json_list,
    gltf_file.json_object,
    gltf_file.json_count,
    gltf_file.check_version,
    gltf_file.component_of,
    gltf_file.window_of,
)
"""Functions of both."""
HEAD = (
    "import { Refused, fillText, formatNumber, isIn, isTable, kindOf, shown, withoutEnd } "
    'from "rastercov/plain.js";\n'
)
TEMPLATES = {
    "Assign": "{targets} = {value};\n",
    "AnnAssign": "{target} = {value};\n",
    "Attribute": "{value}.{attr}",
    "BinOp": "({left} {op} {right})",
    "ExceptHandler": "{body}",
    "For": "for ({target} of {iter}) {{\n{body}}}\n",
    "FormattedValue": "formatNumber({value}, {format_spec})",
    "If": "if ({test}) {{\n{body}}} else {{\n{orelse}}}\n",
    "IfExp": "({test} ? {body} : {orelse})",
    "JoinedStr": "[{values}].join('')",
    "List": "[{elts}]",
    "Raise": "throw {exc};\n",
    "Return": "return {value};\n",
    "Subscript": "{value}[{slice}]",
    "Try": "try {{\n{body}}} catch {{\n{handlers}}}\n",
    "Tuple": "[{elts}]",
    "UnaryOp": "({op}{operand})",
    "With": "try {{\n{body}}} catch (error) {{\nthrow new Refused({items} + error.message);\n}}\n",
    "withitem": "{context_expr}",
    **dict.fromkeys(("Load", "Store"), ""),
    **{"Add": "+", "Sub": "-", "Mult": "*", "Div": "/", "Pow": "**", "USub": "-"},
    **{"And": "&&", "Or": "||", "Not": "!"},
    **{"Eq": "===", "NotEq": "!==", "Is": "===", "IsNot": "!=="},
    **{"Lt": "<", "LtE": "<=", "Gt": ">", "GtE": ">="},
}
"""JavaScript of nodes of `ast`, by their fields; a docstring is the only expression alone."""
UNTYPED = ("type", "annotation")
"""Fields of nodes that JavaScript does not have."""
CALLS = {
    **dict.fromkeys(("CameraError", "MeshError"), "new Refused({0})"),
    "abs": "Math.abs({0})",
    "float": "Number({0})",
    "getattr": "{0}[{1}]",
    "int": "Math.trunc(Number({0}))",
    "is_inf": "({0} === Infinity)",
    "is_list": "Array.isArray({0})",
    "is_number": "(typeof {0} === 'number')",
    "is_printable": r"(typeof {0} === 'string' && !/(?! )[\p{{C}}\p{{Z}}]/u.test({0}))",
    "is_table": "isTable({0})",
    "is_whole": "Number.isInteger({0})",
    "kind_of": "kindOf({0})",
    "len": "{0}.length",
    "math.inf": "Infinity",
    "math.ceil": "Math.ceil({0})",
    "math.pi": "Math.PI",
    "math.radians": "({0} * (Math.PI / 180))",
    "math.sqrt": "Math.sqrt({0})",
    "cos": "Math.cos({0})",
    "enumerate": "{0}.entries()",
    "errors_as": "{0} + ': '",
    "of_array": "{0}",
    "shown": "shown({0})",
    "shown_entry": "shown({0})",
    "sin": "Math.sin({0})",
    "str": "String({0})",
    "math.degrees": "({0} * (180 / Math.PI))",
    "math.isfinite": "Number.isFinite({0})",
    "math.isinf": "(Math.abs({0}) === Infinity)",
    "max": "Math.max(...[{every}].flat())",
    "min": "Math.min(...[{every}].flat())",
    "round": "Number(formatNumber({0}, '.' + {1} + 'f'))",
}
"""The same of functions, by the numbers of arguments; of one that is a list `max` has all of it."""
METHODS = {
    "append": "{on}.push({0})",
    "format": "fillText({on}, {{ {named} }})",
    "get": "({on}[{0}] ?? {1})",
    "items": "Object.entries({on})",
    "join": "{0}.join({on})",
    "removesuffix": "withoutEnd({on}, {0})",
    "replace": "{on}.replaceAll({0}, {1})",
    "split": "{on}.split({0})",
    "startswith": "{on}.startsWith({0})",
}


def script_of(functions: Iterable[Shared]) -> str:
    """Text of a module that exports functions, and those that they call, by their names.

    TypeError for what has no translation.
    """
    made = _Script(functions)
    bodies = [made.function(each) for each in made.called]
    constants = [f"export const {name} = {value};\n" for name, value in made.constants.items()]
    return "".join([HEAD, *constants, *bodies])


@cache
def texts_script() -> str:
    """The module `texts.js` of the page."""
    return script_of(SHARED)


class _Script:
    """Translator of functions, to which it adds those that they call, and of their constants."""

    def __init__(self, functions: Iterable[Shared]) -> None:
        self.called = [*functions]
        self.constants: dict[str, str] = {}
        self._globals: ByName = {}
        self._names: dict[str, Shared] = {}
        self._local: tuple[str, ...] = ()

    def function(self, given: Shared) -> str:
        """A function that is exported."""
        assert isinstance(given, FunctionType)
        tree = ast.parse(inspect.getsource(given)).body[0]
        assert isinstance(tree, ast.FunctionDef)
        parameters = inspect.signature(given).parameters.values()
        self._globals, self._local = given.__globals__, given.__code__.co_varnames
        self._bound: set[str] = {*self._local}
        heads = ", ".join(
            each.name + ("" if each.default is each.empty else f" = {json.dumps(each.default)}")
            for each in parameters
        )
        own = ", ".join(self._local[len(parameters) :])
        let = f"let {own};\n" if own else ""
        text = f"export function {self._of(given)}({heads}) {{\n{let}{self.text(tree.body)}}}\n"
        return re.sub(r" else \{\n\}|(, undefined)+(?=\))", "", text)

    def _of(self, function: Shared) -> str:
        """Name of a function, one of each, which joins those that are translated."""
        name = function.__name__
        while self._names.setdefault(name, function) is not function:
            name += "_"
        self.called += [function] * (function not in self.called)
        return name

    def text(self, node: object) -> str:
        """A node of `ast`, or several of one field."""
        if isinstance(node, list):
            between = "" if node and isinstance(node[0], ast.stmt) else ", "
            return between.join(map(self.text, node))
        if not isinstance(node, ast.AST):
            return "undefined" if node is None else str(node)
        kind = type(node).__name__
        if kind == "Attribute" and (said := ast.unparse(node)) in CALLS:
            return CALLS[said]
        if kind in TEMPLATES:
            fields = ast.iter_fields(node)
            own = {name: self.text(value) for name, value in fields if name not in UNTYPED}
            return TEMPLATES[kind].format(**own)
        match node:
            case ast.Constant(value):
                return json.dumps(value, ensure_ascii=False)
            case ast.Name(name):
                return self._name_of(name)
            case ast.Expr(value):
                return f"{self.text(value)};\n" * isinstance(value, ast.Call)
            case ast.BoolOp(operator, values):
                return f"({f' {self.text(operator)} '.join(map(self.text, values))})"
            case ast.Compare(left, operators, others):
                pairs = zip([left, *others], operators, others, strict=False)
                return f"({' && '.join(self._compare(*each) for each in pairs)})"
            case ast.Dict(keys, values):
                heads = [f"[{self.text(key)}]: " if key else "..." for key in keys]
                return f"({{ {', '.join(map(str.__add__, heads, map(self.text, values)))} }})"
            case ast.ListComp(element, [of]):
                return self._each(of, element)
            case ast.DictComp(key, value, [of]):
                return f"Object.fromEntries({self._each(of, ast.List([key, value]))})"
            case ast.Call():
                return self._call(node)
        raise _refusal_of(node)

    def _each(self, of: ast.comprehension, element: ast.expr) -> str:
        """A list of what an expression gives for each of others, where conditions hold."""
        self._bound |= {each.id for each in ast.walk(of.target) if isinstance(each, ast.Name)}
        head = f"({self.text(of.target)}) =>"
        is_in = " && ".join(map(self.text, of.ifs)) or "true"
        return f"[...{self.text(of.iter)}].filter({head} {is_in}).map({head} {self.text(element)})"

    def _name_of(self, name: str) -> str:
        if name in self._bound:
            return name
        value = self._globals[name]
        text = ""
        if isinstance(value, Mapping) and all(map(inspect.isfunction, value.values())):
            text = f"{{ {_entries({key: self._of(each) for key, each in value.items()})} }}"
        text = text or json.dumps(value, ensure_ascii=False)
        if self.constants.setdefault(name, text) != text:
            raise TypeError(f"expected one constant {name} of all functions, got two; rename one")
        return name

    def _compare(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> str:
        one, other = self.text(left), self.text(right)
        if isinstance(operator, ast.In | ast.NotIn):
            return f"{'!' * isinstance(operator, ast.NotIn)}isIn({one}, {other})"
        return f"{one} {self.text(operator)} {other}"

    def _call(self, node: ast.Call) -> str:
        said = ast.unparse(node.func)  # the kind of an error is one in JavaScript
        given = [self.text(each) for each in node.args if ast.unparse(each) != "CameraError"]
        named = {str(each.arg): self.text(each.value) for each in node.keywords}
        if said in CALLS:
            return CALLS[said].format(*given, every=", ".join(given))
        if isinstance(node.func, ast.Attribute) and node.func.attr in METHODS:
            of = {"on": self.text(node.func.value), "named": _entries(named)}
            return METHODS[node.func.attr].format(*given, "null", **of)
        if said.split(".")[0] in self._bound:
            return f"{said}({', '.join([*given, *named.values()])})"
        function = self._globals.get(said)
        if fields := getattr(function, "_fields", ()):
            return f"({{ {_entries(dict(zip(fields, given, strict=True)))} }})"
        if not inspect.isfunction(function):
            raise _refusal_of(node)
        rest = [*inspect.signature(function).parameters][len(given) :]
        given += [named.get(each, "undefined") for each in rest]
        return f"{self._of(function)}({', '.join(given)})"


def _entries(named: Mapping[str, str]) -> str:
    return ", ".join(f"{name}: {value}" for name, value in named.items())


def _refusal_of(node: ast.AST) -> TypeError:
    return TypeError(
        f"expected Python that has a JavaScript here, got {ast.unparse(node)}; see CALLS"
    )
