"""Delete what uses a feature from tests, benchmarks and examples: whole statements, or parts.

An entry of a table, of parameters or of a loop goes alone, and so does an assertion of a test that
has others. A program of benchmarks or examples goes with its `main` or `attack`.
"""

import ast
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

STATEMENTS = (ast.FunctionDef, ast.ClassDef, ast.Assign, ast.AnnAssign, ast.AugAssign)
ENTRIES = ("main", "attack")
"""Functions that run a program."""
MOST_ARGUMENTS = 8
"""A table of tables with more entries is none of arguments, and loses them one by one."""
PROOF = re.compile(r"assert|raises|refus|fails")
Table = ast.Dict | ast.List | ast.Tuple | ast.Set
Span = tuple[int, int]


@dataclass
class Lost:
    """What a feature takes with it."""

    names: re.Pattern[str]
    """Its names in code."""
    subject: re.Pattern[str]
    """Its name in words."""
    modules: dict[str, set[str] | None] = field(default_factory=dict)
    """Names that modules lost; None for all."""
    files: set[str] = field(default_factory=set)
    """Deleted files, as tests name them: with or without folder `tests` and suffix."""
    sentences: list[str] = field(default_factory=list)
    """Sentences that pages lost."""

    def has(self, module: str, name: str) -> bool:
        """True for a name that a module lost, and for a module that is gone."""
        without = self.modules.get(module, set())
        return without is None or name in without or self.modules.get(f"{module}.{name}", 0) is None

    def is_named(self, text: str) -> bool:
        """True for a text that names a deleted file, or a module that has a name like no word."""
        first = text.split(" ")[0].split("::")[0]
        stem = first.split(".")[0]
        is_module = "_" in stem or first.endswith(".py")
        return first in self.files or (is_module and self.modules.get(stem, 0) is None)

    def begins(self, text: str) -> bool:
        """True for the beginning of a sentence that is gone."""
        bare = text.removeprefix("- ")
        return len(bare) > 8 and any(each.startswith(bare) for each in self.sentences)


def without(folder: Path, lost: Lost) -> dict[str, list[str]]:
    """Delete from files what uses what is lost; names of tests that go, and that lose a part."""
    paths = [
        *(path for path in (folder / "tests").rglob("*.py") if "features" not in path.parts),
        *(folder / "benchmarks").glob("*.py"),
        *(folder / "examples").glob("*.py"),
    ]
    files = [File(path, folder) for path in paths]
    number = -1
    while number != (number := sum(len(file.deleted) for file in files) + len(lost.files)):
        for file in files:
            file.delete(lost)
            stem = file.path.stem
            if file.is_gone():
                lost.modules[stem] = None
                lost.files |= names_of(file.name)
            elif lost.modules.get(stem, 0) is not None:
                lost.modules[stem] = file.lost
    texts_by_key: dict[str, list[str]] = {"gone": [], "parts": [], "programs": []}
    for file in files:
        file.write()
        texts_by_key["gone"] += [
            f"{file.name}::{each}: {file.why.get(each, '')[:60]}"
            for each in sorted(file.lost)
            if is_test(each)
        ]
        texts_by_key["parts"] += [f"{file.name}::{each}" for each in sorted(file.cut - file.lost)]
        if file.is_gone() and not file.name.startswith("tests/"):
            texts_by_key["programs"].append(file.name)
    return texts_by_key


def names_of(file: str) -> set[str]:
    """Names by which tests name a file."""
    inner = file.removeprefix("tests/").removeprefix("benchmarks/")
    bare = inner.removesuffix(".py")
    return {file, inner} | ({bare} if {"/", "_"} & {*bare} else set())


def is_test(name: str) -> bool:
    """True for the name of a test."""
    return name.startswith("test_")


class File:
    """A file whose statements are deleted by what they use."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.path, self.name = path, str(path.relative_to(folder))
        self.text = path.read_bytes()
        self.starts = [0]
        for line in self.text.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.body = ast.parse(self.text).body
        self.modules = dict(modules_in(self.body))
        """Modules by the names that they have here."""
        self.deleted = set[Span]()
        """Bytes of statements, of their parts, and of entries of tables."""
        self.lost = set[str]()
        """Names that were defined here."""
        self.why = dict[str, str]()
        """What of the feature they use."""
        self.cut = set[str]()
        """Tests that lost a part."""
        self.codes = dict[int, tuple[ast.AST, str]]()
        """Code by nodes."""

    def span(self, first: ast.AST, last: ast.AST) -> Span:
        """Bytes from one node to the end of another."""
        end = self.starts[last.end_lineno - 1] + last.end_col_offset
        return self.starts[first.lineno - 1] + first.col_offset, end

    def with_comma(self, first: ast.AST, last: ast.AST) -> Span:
        """Bytes of an entry, with the comma behind it, and the spaces around."""
        start, end = self.span(first, last)
        comma = re.match(rb"\s*,[ ]*", self.text[end:])
        end += comma.end() if comma else 0
        is_last = self.text[end : end + 1] == b"\n"
        return len(self.text[:start].rstrip(b" ")) if is_last else start, end

    def lines(self, node: ast.AST) -> Span:
        """Bytes of the lines of a statement, with its decorators."""
        first = min([node, *getattr(node, "decorator_list", ())], key=lambda each: each.lineno)
        return self.starts[first.lineno - 1], self.starts[node.end_lineno]

    def is_gone(self) -> bool:
        """True for a program without its entry, and a file of tests that has none any more."""
        if not self.name.startswith("tests/"):
            return any(each in self.lost for each in ENTRIES)
        every = {node.name for node in self.body if isinstance(node, ast.FunctionDef)}
        tests = {each for each in every if is_test(each)}
        return is_test(self.path.stem) and bool(tests) and tests <= self.lost

    def is_lost(self, node: ast.AST, lost: Lost, without: Iterable[str] = ()) -> str:
        """What of the feature code names, or of what is deleted; empty for nothing."""
        read = reads(node) & (self.lost | {*without})
        if read or (named := lost.names.search(self.code_of(node))):
            return min(read) if read else named[0]
        used = next((each for each in ast.walk(node) if self.uses(each, lost)), None)
        return "" if used is None else ast.unparse(used)

    def code_of(self, node: ast.AST) -> str:
        """Code of a node, made once."""
        if id(node) not in self.codes:
            self.codes[id(node)] = node, code_of(node)
        return self.codes[id(node)][1]

    def uses(self, node: ast.AST, lost: Lost) -> bool:
        """True for a node that reads, imports or names what is deleted."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            module = self.modules.get(node.value.id)
            return module is not None and lost.has(module, node.attr)
        if isinstance(node, ast.ImportFrom):
            return bool(lost_imports(node, lost))
        if isinstance(node, ast.Import):
            return any(lost.modules.get(each.name, 0) is None for each in node.names)
        return (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and lost.is_named(node.value)
        )

    def delete(self, lost: Lost) -> None:
        """Delete what is lost, once; what uses it may follow."""
        for before, node in zip([None, *self.body], self.body, strict=False):
            if isinstance(node, ast.ImportFrom):
                self.lost |= lost_imports(node, lost)
                continue
            is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            if is_text and before is not None and self.lines(before) in self.deleted:
                self.deleted.add(self.lines(node))
            if isinstance(node, ast.Import):
                if self.is_lost(node, lost):
                    self.deleted.add(self.lines(node))
                    self.lost |= {each.asname or each.name for each in node.names}
                continue
            self.delete_statement(node, lost)

    def delete_statement(self, node: ast.stmt, lost: Lost) -> None:
        """Delete a statement, entries of its tables, or parts of a test."""
        left = node
        for table, of_each in tables_of(node):
            left = self.without_entries(left, table, lost, of_each)
        why = self.is_lost(left, lost) if isinstance(node, STATEMENTS) else ""
        is_kept = not why and (isinstance(node, STATEMENTS) or not reads(left) & self.lost)
        if not is_kept and isinstance(left, ast.FunctionDef):
            parts = self.parts_of(left, lost)
            is_kept = bool(parts)
            self.deleted |= {self.lines(part) for part in parts}
            self.cut |= {left.name} if parts else set()
        if not is_kept:
            self.deleted.add(self.lines(node))
            self.lost |= stored(node)
            self.why |= dict.fromkeys(stored(node), why)

    def parts_of(self, function: ast.FunctionDef, lost: Lost) -> list[ast.stmt]:
        """Statements that go alone, where a test keeps an assertion, a program most; or none."""
        body = function.body[ast.get_docstring(function) is not None :]
        parts = self.lost_parts(body, lost, set(), is_whole=is_test(function.name))
        rest = [each for each in body if each not in parts]
        for node in reversed(rest):  # what only these read
            others = set[str]().union(*(reads(each) for each in rest if each is not node))
            own = stored(node) if isinstance(node, ast.Assign) and is_alone(node) else set()
            if own and not own & others and own & set().union(*map(reads, parts)):
                parts.append(node)
                rest = [each for each in rest if each is not node]
        frame = ast.FunctionDef(
            function.name, function.args, [ast.Pass()], function.decorator_list, function.returns
        )
        is_lost = bool(self.is_lost(ast.fix_missing_locations(frame), lost))
        is_lost |= lost.subject.search(function.name.replace("_", " ")) is not None
        is_lost |= any(isinstance(each, ast.Return) for part in parts for each in ast.walk(part))
        if is_test(function.name):
            is_lost |= PROOF.search("\n".join(map(ast.unparse, rest))) is None
            is_lost |= not all(map(is_alone, parts))
        else:
            is_lost |= self.name.startswith("tests/")
        return [] if is_lost or len(rest) <= len(parts) else parts

    def lost_parts(
        self, body: list[ast.stmt], lost: Lost, gone: set[str], *, is_whole: bool
    ) -> list[ast.stmt]:
        """Statements that are lost, whole or those within them; `gone` has names that went."""
        parts = list[ast.stmt]()
        for node in body:
            if not self.is_lost(node, lost, gone):
                continue
            if isinstance(node, ast.For | ast.With | ast.If) and not (is_whole or orelse(node)):
                fields = {name: getattr(node, name) for name in node._fields}
                head = type(node)(**{**fields, "body": [ast.Pass()]})
                if not self.is_lost(ast.copy_location(head, node), lost, gone):
                    inner = self.lost_parts(node.body, lost, gone, is_whole=False)
                    parts += inner if inner != node.body else [node]
                    continue
            parts.append(node)
            gone |= stored(node) | roots(node)
        return parts

    def without_entries(
        self, node: ast.stmt, table: Table, lost: Lost, of_each: list[ast.expr]
    ) -> ast.stmt:
        """Delete entries of a table that has others; the statement without them."""
        kept = self.kept_entries(table, lost, of_each)
        return node if kept is table else Replaced(table, kept).visit(node)

    def kept_entries(self, table: Table, lost: Lost, of_each: Sequence[ast.expr] = ()) -> Table:
        """A table without the entries that are deleted here; itself where none or all are.

        `of_each` has an expression for each that goes with it.
        """
        entries: list[tuple[ast.expr | None, ast.expr]]
        if isinstance(table, ast.Dict):
            entries = list(zip(table.keys, table.values, strict=True))
        else:
            entries = [(None, each) for each in table.elts]
        kept, spans = [], set[Span]()
        for row, (key, value) in enumerate(entries):
            given = value
            is_table = isinstance(value, ast.Dict) and len(value.keys) > MOST_ARGUMENTS
            if is_table and not (key and self.is_lost(key, lost)):
                value = self.kept_entries(value, lost)
            if self.is_entry_lost(key, value, lost):
                start, end = self.with_comma(key or given, given)
                if isinstance(table, ast.Dict) and key is None:
                    start = self.text.rindex(b"**", 0, start)
                spans |= {
                    (start, end),
                    *(self.with_comma(each, each) for each in of_each[row:][:1]),
                }
            else:
                kept.append((key, value))
        if not kept or [each for _, each in kept] == [each for _, each in entries]:
            return table
        self.deleted |= spans
        if isinstance(table, ast.Dict):
            new: Table = ast.Dict([key for key, _ in kept], [value for _, value in kept])
        else:
            new = type(table)([value for _, value in kept], ctx=ast.Load())
            new = ast.Set(new.elts) if isinstance(table, ast.Set) else new
        return ast.fix_missing_locations(ast.copy_location(new, table))

    def is_entry_lost(self, key: ast.expr | None, value: ast.expr, lost: Lost) -> bool:
        """True for an entry that uses what is deleted, or begins a sentence that is."""
        is_begin = isinstance(key, ast.Constant) and isinstance(key.value, str)
        return (
            any(self.is_lost(each, lost) for each in (key, value) if each is not None)
            or (is_begin and lost.begins(key.value))
        )  # fmt: skip

    def write(self) -> None:
        """Write the file, or delete it where nothing of it is left."""
        changes = [
            (start, end, b"")
            for start, end in self.deleted
            if not any(a <= start and end <= b for a, b in self.deleted - {(start, end)})
        ]
        for node in self.body:
            if isinstance(node, ast.ImportFrom):
                kept = [each for each in node.names if (each.asname or each.name) not in self.lost]
                if len(kept) < len(node.names):
                    line = ast.unparse(ast.ImportFrom(node.module, kept, 0)) if kept else ""
                    changes.append((*self.lines(node), f"{line}\n".encode()))
        text = self.text
        for start, end, new in sorted(changes, reverse=True):
            text = text[:start] + new + text[end:]
        if self.is_gone():
            self.path.unlink()
        elif changes:
            self.path.write_bytes(text)


class Replaced(ast.NodeTransformer):
    """A statement with another table; the old one stays as it is."""

    def __init__(self, table: ast.AST, new: ast.AST) -> None:
        self.table, self.new = table, new

    def visit(self, node: ast.AST) -> ast.AST:
        """Copy a node on the way to the table."""
        if node is self.table:
            return self.new
        if not any(each is self.table for each in ast.walk(node)):
            return node
        fields = {
            name: [self.visit(each) if isinstance(each, ast.AST) else each for each in value]
            if isinstance(value, list)
            else self.visit(value)
            if isinstance(value, ast.AST)
            else value
            for name, value in ast.iter_fields(node)
        }
        return ast.copy_location(type(node)(**fields), node)


def is_alone(node: ast.stmt) -> bool:
    """True for an assertion, and for a statement that only gives names to values."""
    if isinstance(node, ast.Assign | ast.Import | ast.ImportFrom):
        return not roots(node)
    return isinstance(node, ast.Assert) or bool(PROOF.search(ast.unparse(node).split("\n")[0]))


def tables_of(node: ast.stmt) -> Iterator[tuple[Table, list[ast.expr]]]:
    """Tables of a statement, with ids: its value; parameters, loops and lists of a test."""
    targets = getattr(node, "targets", ())
    is_record = any(isinstance(each, ast.Tuple | ast.List) for each in targets)
    items = [] if is_record else [(getattr(node, "value", None), None)]
    if isinstance(node, ast.FunctionDef) and is_test(node.name):
        for call in (each for each in node.decorator_list if isinstance(each, ast.Call)):
            if ast.unparse(call.func).endswith("parametrize") and len(call.args) > 1:
                ids = [each.value for each in call.keywords if each.arg == "ids"]
                items.append((call.args[1], (ids or [None])[0]))
        inner = list(ast.walk(node))
        items += [(each.iter, None) for each in inner if isinstance(each, ast.For)]
        values = (each.value for each in inner if isinstance(each, ast.Assign))
        items += [(each, None) for each in values if isinstance(each, ast.List)]
    for table, ids in items:
        many = isinstance(table, ast.Dict) or len(getattr(table, "elts", ())) > 1
        if isinstance(table, Table) and many:
            yield table, getattr(ids, "elts", [])


def modules_in(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """Modules that are imported, by their names here; a name of a package may be one."""
    for node in (each for top in body for each in ast.walk(top)):
        if isinstance(node, ast.Import):
            yield from ((each.asname or each.name, each.name) for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            for each in node.names:
                yield each.asname or each.name, f"{node.module}.{each.name}"


def lost_imports(node: ast.ImportFrom, lost: Lost) -> set[str]:
    """Names that a statement cannot import any more."""
    module = node.module or ""
    return {
        each.asname or each.name
        for each in node.names
        if lost.has(module, each.name)
        or (
            module.startswith("rastercov")
            and lost.names.search(f"from {module} import {each.name}")
        )
    }


def code_of(node: ast.AST) -> str:
    """Code of a statement or expression without its docstring and comments."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node):
        fields: Mapping[str, object] = {name: getattr(node, name) for name in node._fields}
        node = type(node)(**{**fields, "body": node.body[1:] or [ast.Pass()]})
    return ast.unparse(ast.fix_missing_locations(node)).replace("'", '"').replace(r"\n", "\n")


def reads(node: ast.AST) -> set[str]:
    """Names of the module that a node reads, and fixtures."""
    every = list(ast.walk(node))
    items = {each.id for each in every if isinstance(each, ast.Name) and is_read(each)}
    arguments = {each.arg for each in every if isinstance(each, ast.arg)}
    own = arguments | of_loops(every)
    if not isinstance(node, ast.FunctionDef):
        return items - own
    own |= stored(ast.Module(node.body, []))
    decorators = "\n".join(map(ast.unparse, node.decorator_list))
    is_of_pytest = is_test(node.name) or "fixture" in decorators
    given = {each for each in arguments if not re.search(rf"['\", ]{each}['\",]", decorators)}
    return (items - own) | (given if is_of_pytest else set())


def of_loops(nodes: list[ast.AST]) -> set[str]:
    """Names that only comprehensions have."""
    loops = [each.target for each in nodes if isinstance(each, ast.comprehension)]
    return {each.id for loop in loops for each in ast.walk(loop) if isinstance(each, ast.Name)}


def is_read(name: ast.Name) -> bool:
    """True for a name that is not assigned."""
    return isinstance(name.ctx, ast.Load)


def stored(node: ast.AST) -> set[str]:
    """Names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return {node.name}
    every = list(ast.walk(node))
    items = {each.id for each in every if isinstance(each, ast.Name) and not is_read(each)}
    imports = [each for each in every if isinstance(each, ast.ImportFrom | ast.Import)]
    items |= {name.asname or name.name for each in imports for name in each.names}
    return (items | {each.name for each in every if isinstance(each, ast.FunctionDef)}) - of_loops(
        every
    )


def orelse(node: ast.stmt) -> list[ast.stmt]:
    """What a statement does otherwise."""
    items: list[ast.stmt] = getattr(node, "orelse", [])
    return items


def roots(node: ast.AST) -> set[str]:
    """Names whose entries or attributes a statement sets, and of lists that it adds to."""
    members = set()
    for each in ast.walk(node):
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Attribute):
            of_list = each.func.attr in ("append", "extend", "update", "insert")
            members |= reads(each.func.value) if of_list else set()
        if isinstance(each, ast.Subscript | ast.Attribute) and not isinstance(each.ctx, ast.Load):
            inner: ast.AST = each
            while isinstance(inner, ast.Subscript | ast.Attribute):
                inner = inner.value
            members |= {inner.id} if isinstance(inner, ast.Name) else set()
    return members
