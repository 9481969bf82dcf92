#!/usr/bin/env python3
"""Functions of C++ with their code lines and parameters, by the laws that Python's follow.

    functions.py      names those above the limits, and statements with two assignments, and ends
                      with exit code 1 where there is one

A function is whatever has a body of statements: free and member functions, constructors, templates,
lambdas, and bodies that a macro makes a lambda, as `EACH(k) {`. Its lines are those with code, from
its first word to its brace; the lines of what it contains count as its own, too.
"""

import re
import sys
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "rastercov"
LONGEST = 60
MOST_PARAMETERS = 8
JOINED = re.compile(r"^\s*(?:[\w:<>]+ )?[\w.\[\]]+ = [^;(){}]*, [\w.\[\]]+ = ", re.MULTILINE)
TOKEN = re.compile(
    r"(?P<left_out>//(?:\\\n|[^\n])*|/\*.*?\*/)"
    r"|(?P<directive>^[ \t]*\#(?:\\\n|/\*.*?\*/|[^\n])*)"
    r"|(?P<text>(?:u8|[uUL])?R\"(?P<end>[^\s()\\]{0,16})\(.*?\)(?P=end)\"\w*"
    r"|(?:u8|[uUL])?\"(?:\\.|[^\"\\])*\"\w*|(?:u8|[uUL])?'(?:\\.|[^'\\])*')"
    r"|[A-Za-z_]\w*|\.?\d(?:[eEpP][+-]|'?[\w.])*|::|->\*?|&&|\|\||\.{3}|[-+*/%&|^!=<>]=|[^\s\w]",
    re.DOTALL | re.MULTILINE,
)
OPENING = {"(": ")", "[": "]", "{": "}"}
CONTROLS = {"if", "for", "while", "switch", "catch"}
OPERANDS = {
    *("alignas", "__attribute__", "__declspec", "decltype", "noexcept", "explicit", "requires"),
    *("sizeof", "typeof", "static_assert", "return", "co_return", "alignof"),
}
"""Words whose parentheses hold no parameters."""
CLASSES = {"struct", "class", "union"}
ACCESS = {"public", "private", "protected"}
BEFORE_VALUES = {"return", "co_return", "co_yield", "case", "else", "do", "throw", "delete"}


class Function(NamedTuple):
    """A function, the line of its first word, its code lines, and its number of parameters."""

    name: str
    line: int
    lines: int
    parameters: int


def is_word(text: str) -> bool:
    """True for a name, a keyword or a number."""
    return text[0].isalnum() or text[0] == "_"


@dataclass
class Source:
    """Tokens of a file, and where each bracket closes."""

    text: str
    tokens: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    closing: dict[int, int] = field(default_factory=dict)
    code_lines: list[int] = field(default_factory=list)
    functions: list[Function] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Divide the text into tokens, and find all functions."""
        with_code: set[int] = set()
        for token, line, n_lines in self._tokens():
            with_code.update(range(line, line + n_lines))
            if token:
                self.tokens.append(token)
                self.lines.append(line)
        self.code_lines = sorted(with_code)
        self._pair()
        self._scan(0, len(self.tokens), "declarations")

    def _tokens(self) -> Iterator[tuple[str, int, int]]:
        """Tokens, their lines and numbers of lines; an empty one for a directive.

        Of the branches of an `#if` that leave braces open, only the first one counts.
        """
        depth, line, at = 0, 1, 0
        branches: list[tuple[int, list[int]]] = []
        is_left_out = False
        for match in TOKEN.finditer(self.text):
            line += self.text.count("\n", at, match.start())
            at = match.start()
            token = match[0]
            if match["left_out"] is not None:
                continue
            if match["directive"] is not None:
                word = re.match(r"\s*#\s*(\w*)", token)
                kind = word[1] if word else ""
                if kind.startswith("if"):
                    branches.append((depth, []))
                elif kind in ("else", "elif", "endif") and branches:
                    start, ends = branches[-1]
                    if not is_left_out:
                        ends.append(depth)
                    is_left_out = kind != "endif" and ends[0] != start
                    depth = ends[0]
                    if kind == "endif":
                        branches.pop()
                yield "", line, token.count("\n") + 1
            elif not is_left_out:
                depth += (token == "{") - (token == "}")
                yield ('""' if match["text"] else token), line, token.count("\n") + 1

    def _pair(self) -> None:
        """Pair the brackets; one that is not closed ends with the file."""
        waiting: list[int] = []
        for k, token in enumerate(self.tokens):
            if token in OPENING:
                waiting.append(k)
            elif waiting and token == OPENING[self.tokens[waiting[-1]]]:
                self.closing[waiting.pop()] = k
        self.closing.update(dict.fromkeys(waiting, len(self.tokens)))

    def _opening(self, close: int) -> int:
        """Where a parenthesis opens."""
        return next(k for k in range(close, -1, -1) if self.closing.get(k) == close)

    def _after_angles(self, k: int, end: int) -> int:
        """Place after `<...>`; the same place where that compares two values."""
        depth, at = 0, k
        others = {"&&", "||", ";", "{", ")"} | (
            {"="} if self.tokens[k - 1] != "template" else set()
        )
        while at < end:
            token = self.tokens[at]
            if token in others:
                return k
            depth += (token == "<") - (token == ">")
            at = self.closing[at] + 1 if token in OPENING else at + 1
            if depth == 0:
                return at
        return k

    def _count(self, start: int, end: int) -> int:
        """Number of parameters between two parentheses."""
        inside = self.tokens[start + 1 : end]
        if inside in ([], ["void"]):
            return 0
        number, k = 1, start + 1
        while k < end:
            token = self.tokens[k]
            if token in OPENING:
                k = self.closing[k]
            elif token == "<" and is_word(self.tokens[k - 1]):
                k = max(self._after_angles(k, end) - 1, k)
            number += token == ","
            k += 1
        return number

    def _parameters(self, head: int, end: int) -> int | None:
        """Where the parameters of a declaration open; None for what is no function."""
        k = head
        while k < end:
            token, before = self.tokens[k], self.tokens[k - 1] if k > head else ""
            if token == "operator":
                k += 1
                while k < end and (self.tokens[k] != "(" or self.tokens[k - 1] == "operator"):
                    k = self.closing[k] + 1 if self.tokens[k] == "(" else k + 1
                return k if k < end else None
            if token in ("=", ":"):
                return None
            if token == "<" and (before == "template" or is_word(before or "<")):
                k = max(self._after_angles(k, end) - 1, k)
            elif token == "(":
                if (is_word(before or "(") or before == ">") and before not in OPERANDS:
                    return k
                k = self.closing[k]
            elif token in OPENING:
                k = self.closing[k]
            k += 1
        return None

    def _words(self, head: int, end: int) -> set[str]:
        """Tokens of a declaration outside of brackets, also of `<...>`."""
        words: set[str] = set()
        k = head
        while k < end:
            after = k
            if self.tokens[k] == "<" and k > head and is_word(self.tokens[k - 1]):
                after = self._after_angles(k, end)
            if after == k:
                words.add(self.tokens[k])
                after = self.closing[k] + 1 if self.tokens[k] in OPENING else k + 1
            k = after
        return words

    def _add(self, name: str, head: int, close: int, parameters: tuple[int, int]) -> None:
        last = self.lines[min(close, len(self.lines) - 1)]
        first = self.lines[head]
        lines = bisect_left(self.code_lines, last + 1) - bisect_left(self.code_lines, first)
        self.functions.append(Function(name, first, lines, self._count(*parameters)))

    def _lambda_at(self, k: int, end: int) -> tuple[int, tuple[int, int]] | None:
        """Where the body of a lambda opens, and its parameters; None for other brackets."""
        before = self.tokens[k - 1] if k else ""
        two = self.tokens[max(k - 2, 0) : k]
        if before in (")", "]", '""') or (is_word(before or "[") and before not in BEFORE_VALUES):
            return None
        if before == "delete" or (two and two[0] == "auto" and before in ("&", "&&")):
            return None
        at = self.closing[k] + 1
        if at < end and self.tokens[at] == "<":
            at = self._after_angles(at, end)
        parameters = (at - 1, at)
        if at < end and self.tokens[at] == "(":
            parameters = (at, self.closing[at])
        while at < end and self.tokens[at] not in (";", ",", ")", "]", "}", "="):
            token = self.tokens[at]
            if token == "{":
                return at, parameters
            after = self._after_angles(at, end) if token == "<" else at
            at = self.closing[at] + 1 if token in OPENING else max(after, at + 1)
        return None

    def _scan(self, start: int, end: int, scope: str) -> None:
        """Find the functions between two places, among declarations, statements or values."""
        head, k = start, start
        while k < min(end, len(self.tokens)):
            token = self.tokens[k]
            if token == ";" or (token == ":" and self.tokens[k - 1] in ACCESS):
                head = k + 1
            elif token == "[" and self.tokens[k + 1 : k + 2] == ["["] and self._is_attribute(k):
                k = self.closing[k]
            elif token == "[" and (result := self._lambda_at(k, end)):
                body, parameters = result
                self._scan(k + 1, body, "values")
                self._add("lambda", k, self.closing[body], parameters)
                self._scan(body + 1, self.closing[body], "statements")
                k = self.closing[body]
            elif token in ("(", "["):
                self._scan(k + 1, self.closing[k], "values")
                k = self.closing[k]
            elif token == "{":
                ends_head = self._brace(head, k, scope)
                k = self.closing[k]
                head = k + 1 if ends_head else head
            k += 1

    def _is_attribute(self, k: int) -> bool:
        return self.closing.get(k + 1) == self.closing[k] - 1

    def _brace(self, head: int, k: int, scope: str) -> bool:
        """Scan what a brace opens; true where its end is that of a declaration or statement."""
        close, before = self.closing[k], self.tokens[k - 1] if k > head else ""
        if scope == "declarations":
            return self._declaration(head, k)
        opener = self._opening(k - 1) if before == ")" else 0
        word = self.tokens[opener - 1] if opener else ""
        if word == "constexpr":
            word = "if"
        if before == ")" and is_word(word or ")") and word not in CONTROLS | OPERANDS:
            self._add(word, opener - 1, close, (opener, k - 1))
            self._scan(k + 1, close, "statements")
            return False
        if scope == "values" and before != "":
            self._scan(k + 1, close, "values")
            return False
        words = self._words(head, k)
        is_class = not words & {"=", "(", "return"} and words & CLASSES
        is_block = before in ("", ")", "else", "do", "try", ":", "{", "}", ";")
        inside = "declarations" if is_class else "statements" if is_block else "values"
        self._scan(k + 1, close, inside)
        return bool(is_class) or is_block

    def _declaration(self, head: int, k: int) -> bool:
        close, before = self.closing[k], self.tokens[k - 1] if k > head else ""
        opens = self._parameters(head, k)
        if opens is None:
            words = self._words(head, k)
            is_scope = "=" not in words and bool(words & {*CLASSES, "namespace"})
            is_scope = is_scope or self.tokens[head:k] in ([], ["extern", '""'])
            self._scan(k + 1, close, "declarations" if is_scope else "values")
            return is_scope or "enum" in words
        after = self.closing[opens] + 1
        if ":" in self.tokens[after:k] and (is_word(before) or before == ">") and before != "try":
            self._scan(k + 1, close, "values")  # a member in a list of constructors
            return False
        name = "operator" if "operator" in self.tokens[head:opens] else self.tokens[opens - 1]
        if name not in CONTROLS:  # the `catch` of a constructor
            self._add(name, head, close, (opens, after - 1))
        self._scan(k + 1, close, "statements")
        return True


def functions_of(text: str) -> list[Function]:
    """Functions of a source in C++."""
    return Source(text).functions


def sources() -> list[Path]:
    """Files of C++ that ship."""
    return [path for end in ("cpp", "hpp") for path in sorted(SOURCES.rglob(f"*.{end}"))]


def faults() -> Iterator[str]:
    """One line for each function above a limit, and for each statement of two assignments."""
    for path in sources():
        text = path.read_text(encoding="utf-8")
        name = path.relative_to(ROOT)
        for each in functions_of(text):
            if each.lines > LONGEST:
                yield f"{name}:{each.line}: {each.name} has {each.lines} lines of {LONGEST}"
            if each.parameters > MOST_PARAMETERS:
                number = f"{each.parameters} parameters of {MOST_PARAMETERS}"
                yield f"{name}:{each.line}: {each.name} has {number}"
        for joined in JOINED.finditer(text):
            line = text.count("\n", 0, joined.start()) + 1
            yield f"{name}:{line}: expected one assignment a statement, got two; divide it"


if __name__ == "__main__":
    lines = list(faults())
    print("\n".join(lines or ["functions in C++: within the limits"]))
    sys.exit(bool(lines))
