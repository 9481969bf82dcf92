"""Prose of docstrings, comments and pages: plain technical English.

A docstring opens with a noun phrase or a verb, and no text has a banned word. What users read
(texts of the program, templates, README) has none of the phrases that terms have replaced.
"""

import ast
import re
import tokenize
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
CLEAN = ["README.md", "CHANGELOG.md", "docs", "examples", "rastercov", "reference", "benchmarks"]
CLEAN += ["tests/support"]
"""Files and folders that are checked."""
OPENINGS = re.compile(r"(How|What|Where|Which|Who|Whose|Whether|When|Why|That)\b")
PHRASES = """
    as it were, so (many|much), by so, in the way, what is left, but for, told, asked of,
    speaks? of, seen? whole, sees whole, seen in part, takes it that, has it that, in its turn,
    whose turn, knows? nothing, no telling, go(es)? on, went on, see to it, make do, let alone,
    nobody, lest, stands?(?!-), stood, astray, sift(s|ed|ing)?, canary, stock, strangers,
    foretells?, foretold, reckon(s|ed)?, outlook, hair, rivals?, forgives?,
    wipes?, mends?, nick, shake[ns]?, ought, shall, heed, wherein, thereof, forthwith"""
WORDS = "|".join(re.split(r",\s+", PHRASES.strip())).replace(" ", r"\s+")
BANNED = re.compile(rf"\b({WORDS})\b", re.IGNORECASE)
CODE = re.compile(r"```.*?```|`[^`]*`|\]\([^)]*\)", re.DOTALL)

RETIRED = re.compile(
    r"too flatly|seen from behind|not all in the image|too small for a sample|in the way of"
    r"| wanted, got|: wanted | wants (a|an|one|NAME)\b|Hold (a|the) (rig|model)|is said\."
    r"|that (is|are) sold|whatever the triangles|seen, and|to the letter|dazzles|for people\b"
    r"|no rigid motion|kill a worker|Covered is what|no selection (covers|that)|no other costs"
    r"|cover the same:|falls? short|to hand on|place that has:|keep clear by"
    r"|is of a face|is of light|has no lx"
    r"|only by it|covered by none|hidden from both sides| s so far"
    r"|mirror direction|hatever the errors|Measured is|rigid motions| by --[a-z]"
)
"""Phrases that no user reads any more; the terms are in docs/conventions.md."""

FORM = re.compile(
    r"(.*: |0)?expected .*, got\b.*|expected \w+ to be 0|(.*: )?0|0(?!.*\bmust\b).*, got.*"
    r"|00|0: sheet|(--camera( 0)?: )?0[;,] .*"
)
"""Form of an error: where, expected X, got Y; do Z. Each value that is put in is a 0; texts that a
function or another error gives may come first or last."""
OTHERS = ("ValueError", "LookupError", "AttributeError", "OSError", "UnparsedError", "_FaultError")
OTHERS += ("DamagedError",)
"""Errors that others catch, and those whose text is what came."""


class Texts(NamedTuple):
    """Texts of a Python file: prose and errors with their lines, and literals that are no prose."""

    prose: tuple
    errors: tuple
    literals: tuple


@cache
def texts_of(path):
    """Those of a file of the package, which is parsed once for all laws."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    said = {node.value for node in nodes if isinstance(node, ast.Expr)}
    literals = (x for x in nodes if isinstance(x, ast.Constant) and x not in said)
    return Texts(
        tuple(prose_of(source, tree)), tuple(errors_of(tree)), tuple(str(x.value) for x in literals)
    )


def prose_of(source, tree=None):
    """Line and text of each docstring (also of assigned names) and each comment."""
    for node in ast.walk(tree or ast.parse(source)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text
    lines = iter(source.splitlines(keepends=True))
    for token in tokenize.generate_tokens(lambda: next(lines, "")):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def faults(prose, suffix=".py"):
    """Banned openings and words as (line, words); code in backquotes is not prose."""
    for line, text in prose:
        if opening := suffix == ".py" and OPENINGS.match(text):
            yield line, opening[0]
        prose = CODE.sub(lambda code: "\n" * code[0].count("\n"), text)
        for hit in BANNED.finditer(prose):
            yield line + prose.count("\n", 0, hit.start()), " ".join(hit[0].split())


def errors_of(tree):
    """Line and text of each error, as far as it is a literal or a name for one."""
    known = {}
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                known[name] = value
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                known |= dict(zip(map(ast.unparse, names), values, strict=False))

    def text(node, above=()):
        match node:
            case ast.Constant(value=str(result)):
                return result
            case ast.JoinedStr(values=parts):
                return "".join(text(part, above) or "0" for part in parts)
            case ast.FormattedValue(value=ast.Name(id=name)) | ast.Name(id=name):
                return None if name in above else text(known.get(name), (*above, name))

    for node in ast.walk(tree):
        match node:
            case ast.Raise(exc=ast.Call(func=func, args=args)):
                args = args[:1] if ast.unparse(func) == "broken" else args
            case ast.Call(func=ast.Name(id="check"), args=[_, *args]):
                func, args = ast.Name("check"), args[:1]
            case _:
                continue
        name, item = ast.unparse(func), next(filter(None, map(text, args)), None)
        is_error = name.endswith("Error") or name in ("error", "broken", "check")
        if item and is_error and name not in OTHERS:
            yield node.lineno, item


def files():
    for path in (ROOT / name for name in CLEAN):
        yield from [path] if path.is_file() else path.rglob("*.py")
        yield from path.rglob("*.md")


def prose_in(path):
    """Line and text of the prose of a file."""
    if path.suffix != ".py":
        return [(1, path.read_text(encoding="utf-8"))]
    if path.is_relative_to(ROOT / "rastercov"):
        return texts_of(path).prose
    return prose_of(path.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_prose_is_plain():
    items = [
        f"{path.relative_to(ROOT)}:{line}: {words}"
        for path in sorted(files())
        for line, words in faults(prose_in(path), path.suffix)
    ]
    assert items == []


def test_users_read_none_of_the_retired_phrases():
    """In literals that are no docstrings, templates and the README."""
    texts = [(ROOT / "README.md").read_text(encoding="utf-8")]
    texts += [path.read_text() for path in ROOT.glob("rastercov/report/templates/*.html")]
    for path in ROOT.glob("rastercov/**/*.py"):
        texts += texts_of(path).literals
    assert [hit[0] for hit in map(RETIRED.search, texts) if hit] == []


def every_error():
    """Place and text of every error of the package, values as 0."""
    return [
        (f"{path.relative_to(ROOT)}:{line}", text)
        for path in sorted((ROOT / "rastercov").rglob("*.py"))
        for line, text in texts_of(path).errors
    ]


def test_errors_have_one_form():
    """What was expected, what came, what to do: one line of at most 160 characters."""
    texts = every_error()
    assert len(texts) > 900
    assert [each for each in texts if not FORM.fullmatch(each[1]) or len(each[1]) > 160] == []


@pytest.mark.parametrize(
    "text",
    [
        "x must be 0 or more, got 0",
        "missing fx",
        "Expected x, got 0",
        "expected x",
        "0 must be x, got 0",
    ],
)
def test_an_error_of_another_form_is_found(text):
    [(_, result)] = errors_of(ast.parse(f"raise MeshError({text!r})"))
    assert not FORM.fullmatch(result)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('"""How a face is clipped."""', "How"),
        ('def f():\n    """Whether it is closed."""', "Whether"),
        ('N = 1\n"""What rounding may do."""', "What"),
        ("x = 1  # So many faces", "So many"),
        ('"""Faces that are in\nthe way."""', "in the way"),
    ],
)
def test_a_banned_opening_or_word_is_found(text, words):
    assert [fault for _, fault in faults(prose_of(text))] == [words]


def test_code_and_longer_words_are_not_banned():
    text = '"""Stand-off of `so_many` faces, `what is left`; understand, shifted."""'
    assert list(faults(prose_of(text))) == []
    assert list(faults([(1, "Stocks: ```\nthe canary\n``` and\n\na stand-off")], ".md")) == []


if __name__ == "__main__":  # every message to read
    print("\n".join(f"{place}: {text}" for place, text in every_error()))
