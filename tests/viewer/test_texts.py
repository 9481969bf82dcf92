"""Texts of numbers are one: the page writes each as Python does."""

import json
import math
import re

import numpy as np
import pytest
from nightly import IS_NIGHTLY
from page_in_node import HERE, NEEDS_NODE, PAGE
from page_in_node import node as node
from text_cases import SPECS, case_of, of_kinds

from rastercov.report.pages import static_file
from rastercov.report.script import SHARED, script_of, texts_script

ELSEWHERE = {
    *("advice_of", "central_arguments", "check_fields", "check_focus", "shown_of", "with_pixels"),
    *("read_cameras", "read_images", "parameters_of"),
    *("json_list", "json_object", "json_count", "check_version", "component_of", "window_of"),
}
"""Functions of test_live_advice, test_lens_edits, test_page_files and test_page_readers."""


@NEEDS_NODE
def test_the_page_writes_numbers_as_python_does(node, tmp_path):
    rng = np.random.default_rng(62)
    cases = [
        make(rng) for make in (case_of, of_kinds) for _ in range(100_000 if IS_NIGHTLY else 12_000)
    ]
    given, wanted = zip(*cases, strict=True)
    (tmp_path / "cases.json").write_text(json.dumps(given))
    result = node("texts.mjs", tmp_path / "cases.json")
    assert [row for row in zip(given, result, wanted, strict=True) if row[1] != row[2]] == []
    assert {name for name, *_ in given} >= {each.__name__ for each in SHARED} - ELSEWHERE


@NEEDS_NODE
@pytest.mark.parametrize("value", [62.25, 0.5, 2.5, 1e22, 5e-324, -0.0, 1.7e308, math.inf])
def test_ends_and_ties(node, tmp_path, value):
    given = [["formatNumber", "inf" if math.isinf(value) else value, spec] for spec in SPECS[2:]]
    (tmp_path / "cases.json").write_text(json.dumps(given))
    assert node("texts.mjs", tmp_path / "cases.json") == [format(value, each) for each in SPECS[2:]]


def of_a_loop(values):
    """A function that has no translation."""
    while values:
        values = values[1:]


def of_a_call(values):
    """Another one."""
    return sorted(values)


LIMIT = 3


def of_a_constant(value):
    """A constant of this module, and a mapping."""
    return [value < LIMIT, value in (2, LIMIT)]


@pytest.mark.parametrize("function", [of_a_loop, of_a_call])
def test_what_has_no_translation_is_refused(function):
    with pytest.raises(TypeError, match="expected Python that has a JavaScript here, got"):
        script_of([function])


def test_constants_and_called_functions_are_in_the_module():
    said = script_of([of_a_constant])
    assert "export const LIMIT = 3;" in said
    assert "export function of_a_constant(value)" in said
    assert "export function exponent(" in texts_script()


def test_modules_import_names_that_others_export():
    own = {path.stem: path.read_text("utf-8") for path in [*PAGE.glob("*.js"), *HERE.glob("*.mjs")]}
    own |= {name: static_file(f"{name}.js").decode() for name in ("features", "texts")}
    has = {
        name: set(re.findall(r"^export (?:async )?(?:class|function|const) (\w+)", text, re.M))
        for name, text in own.items()
    }
    asked = [
        (name, module, each.split()[0])
        for name, text in own.items()
        for names, module in re.findall(
            r'^import \{([^}]*)\} from "rastercov/(\w+)\.js"', text, re.M | re.S
        )
        for each in names.split(",")
        if each.strip()
    ]
    assert len(asked) > 100
    assert [row for row in asked if row[2] not in has[row[1]]] == []
