"""Delete what pages say of a feature: sections, rows, items, sentences, links, parts of examples.

Links to pages that are gone count as names of the feature. A list of links loses the one alone.
"""

import ast
import re
from collections.abc import Callable
from pathlib import Path

END = re.compile(r"(?:(?<=[a-z0-9)`*]\.)|(?<=[?:]\*\*)) (?=[A-Z`\[])")
"""Between two sentences."""
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```\n", re.DOTALL | re.MULTILINE)
Test = Callable[[str], object]


class Page:
    """A page, what it lost, and whether a text is lost."""

    def __init__(self, text: str, names: re.Pattern[str], pages: set[str]) -> None:
        self.text, self.names, self.pages = text, names, pages
        stems = "|".join(map(re.escape, sorted(pages))) or "(?!)"
        self.link = re.compile(rf"\[[^\]\[]*\]\((?:[\w./]*/)?(?:{stems})\.md(?:#[^)\s]*)?\)")
        self.sentences = list[str]()
        self.variables = set[str]()
        """Of examples in Python, that are not set any more."""

    def is_lost(self, text: str) -> bool:
        """True for a text that names the feature or leads to a page of it."""
        return bool(self.names.search(text) or self.link.search(text))

    def without(self) -> str:
        """The page without what is lost."""
        text = re.sub(rf"{self.link.pattern}, (?=\[)|(?<=\)), {self.link.pattern}", "", self.text)
        out, at = [], 0
        for fence in FENCE.finditer(text):
            out.append(self.prose(text[at : fence.start()]))
            code = self.code(fence[1], fence[2])
            if code.strip():
                out.append(f"```{fence[1]}\n{code}```\n")
            elif out[-1].rstrip().endswith(":"):
                out[-1] = re.sub(r"[^\n]+:\s*\Z", "", out[-1])
            at = fence.end()
        out.append(self.prose(text[at:]))
        return re.sub(r"\n{3,}", "\n\n", self.without_sections("".join(out)))

    def code(self, language: str, text: str) -> str:
        """An example without what is lost; nothing where all of it is."""
        if language.startswith("{toctree}"):
            lines = text.splitlines(keepends=True)
            return "".join(line for line in lines if line.strip() not in self.pages)
        if language == "toml":
            parts = re.split(r"(?<=\n)(?=\n*\[)|(?<=\n)\n", text)
            kept = [each for each in parts if not self.is_lost(each)]
            return text if len(kept) == len(parts) else "\n".join(filter(str.strip, kept))
        if language == "python":
            return self.python(text)
        lines = re.findall(r"(?:[^\n]*\\\n)*[^\n]*\n", text)
        return "".join(line for line in lines if not self.is_lost(line))

    def python(self, text: str) -> str:
        """Statements of an example that use nothing that is lost."""
        lines = text.splitlines(keepends=True)
        for node in ast.parse(text).body:
            names = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
            read = {each.id for each in names if isinstance(each.ctx, ast.Load)}
            if read & self.variables or self.is_lost(ast.unparse(node).replace("'", '"')):
                self.variables |= {each.id for each in names if isinstance(each.ctx, ast.Store)}
                for row in range(node.lineno - 1, node.end_lineno or 0):
                    lines[row] = ""
        return "".join(lines)

    def prose(self, text: str) -> str:
        """Paragraphs, items and rows without sentences that are lost."""
        blocks = re.split(r"(\n\s*\n|\n(?=\s*- |\||#))", text)
        out = list[str]()
        for block, end in zip(blocks[::2], [*blocks[1::2], ""], strict=True):
            left = self.block(block) if self.is_lost(block) else block
            out += [left, end] if left or not block else []
        return "".join(out)

    def block(self, text: str) -> str:
        """A block that names the feature, without its sentences that do."""
        if text.startswith("#"):  # its section goes by itself
            title, end, rest = text.partition("\n")
            return title + end + (self.block(rest) if self.is_lost(rest) else rest)
        if text.startswith("|"):
            return ""
        head = re.match(r"\s*- ", text)
        start = head[0] if head else ""
        every = END.split(" ".join(text[len(start) :].split()))
        kept = [each for each in every if not self.is_lost(each)]
        self.sentences += [each for each in every if each not in kept]
        end = "\n" if text.endswith("\n") else ""
        return start + " ".join(kept) + end if kept else ""

    def without_sections(self, text: str) -> str:
        """The page without sections whose headings name the feature."""
        parts = re.split(r"^(?=#+ )", text, flags=re.MULTILINE)
        out, below = [], 0
        for part in parts:
            level = len(part) - len(part.lstrip("#"))
            if below and (level == 0 or level > below):
                continue
            below = level if level and self.is_lost(part.partition("\n")[0]) else 0
            out += [] if below else [part]
        return "".join(out)


def without(paths: list[Path], names: re.Pattern[str], pages: set[str]) -> list[str]:
    """Delete from pages what is lost with a feature; the sentences that go."""
    items = []
    for path in paths:
        page = Page(path.read_text(encoding="utf-8"), names, pages)
        text = page.without()
        if text != page.text:
            path.write_text(text, encoding="utf-8")
        items += page.sentences
    return items
