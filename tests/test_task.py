"""Words on a task."""

from dataclasses import asdict, fields, replace

import pytest

import rastercov as rc
from rastercov.coverage.advice import task_in_words

OTHER = {
    "min_visibility": 0.25, "max_blur": 2.0, "max_incidence_deg": 70.0, "views": 3,
    "focus_rule": "centroid", "cap_resolution": False,
}  # fmt: skip


@pytest.mark.parametrize("name", [each.name for each in fields(rc.Task)])
def test_every_threshold_has_words_with_its_figure(name):
    usual = task_in_words(asdict(rc.Task()))
    assert usual == "Covered is what a camera sees."
    task = replace(
        rc.Task(),
        **{name: OTHER.get(name, 12.5)}
        | ({"min_coverage": 0.75} if name == "min_coverage" else {}),
    )
    said = task_in_words(asdict(task))
    assert said != usual
    value = getattr(task, name)
    figure = {"min_visibility": "25.0 %", "min_coverage": "0.75"}.get(
        name, f"{value:g}" if isinstance(value, int | float) and not isinstance(value, bool) else ""
    )
    assert figure in said


def test_views_of_groups_and_names_of_the_standard_are_in_words():
    task = rc.Task(min_facing_density=250, views=2, min_angle_deg=15)
    assert task_in_words(asdict(task), {"doors": 3}) == (
        "Covered is what 2 cameras see, 3 of doors, 15° apart, with 250 px/m or more on what "
        "faces the camera (identify)."
    )
