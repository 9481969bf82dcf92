"""Every command answers six scenes as it did when tests/golden/ was written."""

import json
import math

import pytest
from golden_runs import GOLDEN, NEEDS_CV2, RUNS, answer
from nightly import nightly

MARKS = dict.fromkeys(NEEDS_CV2, nightly) | {"teapot_compare": pytest.mark.matter("laboratory")}
RELATIVE = 1e-8
"""Figures are stored with ten digits; products of matrices differ in the last from CPU to CPU."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(each, marks=MARKS.get(each, ())) for each in RUNS])
def test_a_command_answers_as_before(name, monkeypatch):
    if name in NEEDS_CV2:
        pytest.importorskip("cv2", reason="OpenCV is missing: pip install 'rastercov[markers]'")
    monkeypatch.delenv("RASTERCOV_TRACEBACK", raising=False)
    content = json.loads(json.dumps(answer(name)))
    before = json.loads((GOLDEN / f"{name}.json").read_text())
    assert list(differences(before, content)) == []


def test_every_stored_answer_is_asked_for():
    assert {path.stem for path in GOLDEN.iterdir()} == set(RUNS)


def differences(before, result, where=""):
    """Places where two answers differ, in words."""
    if isinstance(before, dict) and isinstance(result, dict):
        for key in sorted(before.keys() | result.keys()):
            if key not in before or key not in result:
                yield f"{where}/{key}: {'new' if key in result else 'gone'}"
            else:
                yield from differences(before[key], result[key], f"{where}/{key}")
    elif isinstance(before, list) and isinstance(result, list) and len(before) == len(result):
        for index, pair in enumerate(zip(before, result, strict=True)):
            yield from differences(*pair, f"{where}/{index}")
    elif not (before == result or are_close(before, result)):
        yield f"{where}: {before!r} before, {result!r} now"


def are_close(before, result):
    numbers = all(isinstance(value, int | float) for value in (before, result))
    return numbers and math.isclose(before, result, rel_tol=RELATIVE, abs_tol=1e-9)
