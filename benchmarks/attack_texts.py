"""Texts of numbers by the modules of the page, in Node, against those of Python: none may differ.

Ties, powers of ten and their neighbours, whole numbers, decimals and numbers of any size, through
every function that reports and the page print with, and through Python's formats themselves.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from page_in_node import NODE, runner_in
from rows import Report
from text_cases import case_of, of_kinds

CASES = 400_000
"""Texts of a campaign of effort 1, half of them of Python's formats and of panels."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign."""
    if NODE is None:
        return
    rng = np.random.default_rng(76)
    n = max(10, round(CASES * effort / 2))
    given, wanted = zip(*(make(rng) for make in (case_of, of_kinds) for _ in range(n)), strict=True)
    with TemporaryDirectory() as folder:
        node, cases = runner_in(Path(folder)), Path(folder) / "cases.json"
        cases.write_text(json.dumps(given))
        result = node("texts.mjs", cases)
    wrong = sum(one != other for one, other in zip(result, wanted, strict=True))
    report.add("texts of the page", len(result), "texts")
    report.add("texts that differ from Python", wrong, "texts", at_most=0)
