"""Numbers of input files: of 400 digits, beyond 1e100, or not finite: one line, nothing else."""

import ast
import json
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.base.files import LARGEST_NUMBER, UnreadableError, parse_json


@pytest.mark.parametrize("name", ["a.gltf", "a.json"])
def test_an_integer_that_python_does_not_read_is_one_line_without_advice_for_code(name, tmp_path):
    path = tmp_path / name
    path.write_text('{"asset": ' + "9" * 5000 + "}")
    with pytest.raises(rc.RastercovError, match="5000 digits") as caught:
        (rc.Mesh.load if name == "a.gltf" else rc.read_poses)(path)
    assert "sys." not in str(caught.value)


ROOT = Path(__file__).parents[1]
NUMBERS = st.integers(-(10**400), 10**400) | st.floats()
TREES = st.recursive(
    NUMBERS | st.booleans() | st.none() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=20,
)


def numbers_of(tree):
    if isinstance(tree, dict | list):
        inner = tree.values() if isinstance(tree, dict) else tree
        return [each for own in inner for each in numbers_of(own)]
    return [tree] if isinstance(tree, int | float) else []


@given(TREES)
@examples(200)
def test_a_file_is_read_exactly_if_no_finite_number_is_beyond_the_limit(tree):
    data = json.dumps(tree).encode()
    too_large = [
        each for each in numbers_of(tree)
        if (isinstance(each, int) or math.isfinite(each)) and abs(each) > LARGEST_NUMBER
    ]  # fmt: skip
    if too_large:
        with pytest.raises(UnreadableError, match="a number within") as caught:
            parse_json(data)
        assert str(caught.value).isprintable()
    else:
        assert json.dumps(parse_json(data)) == data.decode()


ORDERS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
WHOLE = re.compile(
    r"\b(n_\w+|_n_values|len|count|views|draws|budget|rows?|seed|side|supersample|st_size|"
    r"n_bytes|need|needed|depth|ndim|monotonic|perf_counter|corners|MOST_\w*(CELLS|POSES|UNITS|"
    r"DEVICES)|EVALUATE_BUDGET|MAX_RENDERED|core_pairs|poses_a_shard|promised|first|camera|value|"
    r"most|number|labels|shape|starts|own\.min_\w+|z_[nf]|min_angle_deg|max_highlight_deg|angle|start|n|values)\b"
)
"""Names in comparisons of whole numbers and times, and of thresholds that are checked before."""


def refusals(tree):
    """Comparisons that are true where a test raises an error: those that NaN passes."""

    def positive(node, is_negated):
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return positive(node.operand, not is_negated)
        if isinstance(node, ast.Compare):
            is_order = any(isinstance(each, ORDERS) for each in node.ops)
            return [node] if is_order and not is_negated else []
        inner = {ast.BoolOp: ("values",), ast.Call: ("func", "args"), ast.Attribute: ("value",),
                 ast.BinOp: ("left", "right"), ast.NamedExpr: ("value",)}  # fmt: skip
        parts = [getattr(node, name) for name in inner.get(type(node), ())]
        parts = [each for part in parts for each in (part if isinstance(part, list) else [part])]
        return [item for part in parts for item in positive(part, is_negated)]

    for node in ast.walk(tree):
        if isinstance(node, ast.If) and any(isinstance(each, ast.Raise) for each in node.body):
            yield from positive(node.test, is_negated=False)


def test_every_comparison_that_refuses_is_written_so_that_nan_is_refused():
    """`not value > 0`, never `value <= 0`, for all that is no whole number."""
    wrong = [
        f"{path.relative_to(ROOT)}:{each.lineno}: {ast.unparse(each)}"
        for path in sorted((ROOT / "rastercov").rglob("*.py"))
        for each in refusals(ast.parse(path.read_text(encoding="utf-8")))
        if not WHOLE.search(ast.unparse(each))
    ]
    assert wrong == []


@pytest.mark.parametrize(
    ("text", "n"),
    [("x < 0", 1), ("not x >= 0", 0), ("(x > 1).any()", 1), ("not (x < 1).all()", 0),
     ("a and (b or x > y)", 1), ("not a or not x < y < z", 0), ("x is None or abs(x) > 3", 1)],
)  # fmt: skip
def test_what_counts_as_a_refusal_that_nan_passes(text, n):
    tree = ast.parse(f"if {text}:\n    raise ValueError\n")
    assert len(list(refusals(tree))) == n
    assert not list(refusals(ast.parse(f"if {text}:\n    pass\n")))


CONDITION = re.compile(r"\b(?:require|expect)\(")
NEGATED = re.compile(r"!(?=\()|\bnot\b")


def in_parentheses(text, start):
    """Text from an opening parenthesis to the one that closes it, or to the end of an argument."""
    depth = 0
    for at in range(start, len(text)):
        depth += {"(": 1, "[": 1, "{": 1, ")": -1, "]": -1, "}": -1}.get(text[at], 0)
        if depth == 0 or (depth == 1 and text[at] == ","):
            return text[start:at]
    return text[start:]


def passed_by_nan(source):
    """Conditions of refusals in C++ that negate a comparison: NaN makes these true."""
    for result in CONDITION.finditer(source):
        condition = in_parentheses(source, result.end() - 1)
        for negated in NEGATED.finditer(condition):
            inner = in_parentheses(condition, negated.end())
            if re.search(r" [<>]=? ", inner):
                yield " ".join(condition[1:].split())


def test_every_condition_in_c_is_written_so_that_nan_is_refused():
    """`require(value > 0)`, never `require(!(value <= 0))`."""
    native = ROOT / "rastercov" / "engine"
    sources = [path for path in sorted(native.rglob("*")) if path.suffix in (".cpp", ".hpp")]
    wrong = [
        f"{path.relative_to(ROOT)}: {each}"
        for path in sources
        for each in passed_by_nan(path.read_text(encoding="utf-8"))
    ]
    assert wrong == []
    assert sum(len(CONDITION.findall(path.read_text(encoding="utf-8"))) for path in sources) > 150


@pytest.mark.parametrize(
    ("text", "n"),
    [("require(x > 0, w)", 0), ("require(!(x <= 0), w)", 1), ("expect(a && !(b || x < 1), w)", 1),
     ("require(!is_set(x) && x >= 0, w)", 0), ("require(!f(max<int>(a, b)), w)", 0),
     ("require(!(is_a && (is_b ||\n x > y)),\n w)", 1)],
)  # fmt: skip
def test_what_counts_as_a_condition_that_nan_passes(text, n):
    assert len(list(passed_by_nan(text))) == n
