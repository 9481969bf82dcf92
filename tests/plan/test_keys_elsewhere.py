"""Keys of a plan in the wrong table, and lists in another form: the error names place and form."""

import re

import pytest

from rastercov.placement.plan.entries import texts_below_fields
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.sections import PlanModel

CAMERA = {"width": 96, "height": 72, "fx": 60.0, "fy": 60.0}


def lines(table):
    """Errors of a plan by the path of their key."""
    whole = {"meshes": [{"path": "a.obj"}], "camera": CAMERA, "selection": SELECTION}
    whole |= {"task": {}, "candidates": [{"generator": "on_sphere", "count": 3}]}
    with pytest.raises(PlanError) as error:
        plan_of(whole | table)
    return dict(line.removeprefix("plan: ").split(": ", 1) for line in error.value.lines)


SELECTION = {"goal": "best_coverage", "cameras": 2}
HOME = {  # a table with the key alone among those that it is looked for in
    "existing": "at the top of the plan",
    "crs": "in [flight]",
    "keep_out": "in [constraints]",
    "max_incidence_deg": "in [task], in [goals] and 1 more",
    "time_limit": "in [selection]",
    "clearance": "in [candidates], in [constraints]",
}
TABLES = {
    "task": lambda key: {"task": {key: 1}},
    "constraints": lambda key: {"constraints": {key: 1}},
    "selection": lambda key: {"selection": SELECTION | {key: 1}},
    "flight": lambda key: {"flight": {key: 1}},
    "candidates[0]": lambda key: {"candidates": [{"generator": "on_sphere", "count": 3, key: 1}]},
    "": lambda key: {key: 1},
}


@pytest.mark.parametrize("key", HOME)
@pytest.mark.parametrize("table", TABLES)
def test_a_key_of_another_table_is_named_with_its_place(table, key):
    own = re.findall(r"\[(\w+)\]", HOME[key])
    if table.removesuffix("[0]") in own or (table == "" and key == "existing"):
        return
    path = f"{table}.{key}".lstrip(".")
    line = lines(TABLES[table](key))[path]
    assert line.startswith("expected one of ") or line.startswith("expected no entry, ")
    assert line.endswith(f"got '{key}'; correct the name, or put it {HOME[key]}")


def test_the_tables_of_a_key_are_looked_up_once_for_all_places_of_it(monkeypatch):
    counts = []
    for n in (3, 30):
        seen = []
        monkeypatch.setattr(
            "rastercov.placement.plan.file._join_path",
            lambda path, part, seen=seen: seen.append(path) or f"{path}.{part}".lstrip("."),
        )
        found = lines({"goals": {f"g{row}": {"deadline": 1, "min_pixels": 1} for row in range(n)}})
        assert len(found) > 2 * n
        counts.append(len(seen))
    assert counts[1] < counts[0] + 2 * 27 * 8  # parts of paths alone
    assert "or put it in [task]" in found["goals.g29.min_pixels"]


def test_a_key_of_no_table_has_names_that_are_similar():
    words = lines({"task": {"max_incidense_deg": 1}})["task.max_incidense_deg"]
    assert words.startswith("expected one of ")
    assert "'max_incidense_deg'; correct the name" in words


FORMS = [
    ({"constraints": {"stand_off": 0.2}}, "constraints.stand_off", "[least, greatest], got 0.2"),
    ({"constraints": {"stand_off": [1, 2, 3]}}, "constraints.stand_off", "[least, greatest], got"),
    ({"candidates": [{"generator": "on_sphere", "count": 3, "stand_off": 1}]},
     "candidates[0].stand_off", "[least, greatest], got 1"),
    ({"flight": {"crs": "EPSG:1", "origin": 3}}, "flight.origin", "[easting, northing, height]"),
    ({"flight": {"home": 3}}, "flight.home", "a list such as [0, -30, 0], got 3"),
    ({"candidates": 3}, "candidates", "a list in [ ], got 3"),
]  # fmt: skip


@pytest.mark.parametrize(("table", "path", "words"), FORMS)
def test_a_list_in_another_form_has_the_form_of_its_key(table, path, words):
    assert lines(table)[path].startswith(f"expected {words}")


def test_the_form_of_every_documented_list_at_the_top_level_tables():
    """Of all keys whose text begins with a form: a number in its place is answered with it."""
    checked = 0
    for section in ("constraints", "flight", "task"):
        (model,) = {
            each
            for hint in [PlanModel.model_fields[section].annotation]
            for each in (getattr(hint, "__args__", None) or (hint,))
            if hasattr(each, "model_fields")
        }
        for key, text in texts_below_fields(model).items():
            if (match := re.match(r"\[[^\d\]]+\]", text)) is not None:
                assert lines({section: {key: 7}})[f"{section}.{key}"].startswith(
                    f"expected {match[0]}, got 7"
                )
                checked += 1
    assert checked
