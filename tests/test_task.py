"""Words on a task."""

from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.area.advice import advice, general_advice, task_in_words
from rastercov.core.coverage.task import REASONS

OTHER = {
    "min_visibility": 0.25, "max_blur": 2.0, "max_incidence_deg": 70.0, "views": 3,
    "focus_rule": "centroid", "cap_resolution": False,
}  # fmt: skip


@pytest.mark.parametrize("name", [each.name for each in fields(rc.Task)])
def test_every_threshold_has_words_with_its_figure(name):
    usual = task_in_words(asdict(rc.Task()))
    assert usual == "A point is covered if a camera sees it."
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
    assert task_in_words(asdict(task), {"at the doors": 3}) == (
        'A point is covered if 2 cameras see it (3 for "at the doors"), at least 15° apart, '
        "with 250 px/m or more on a target facing the camera (identify)."
    )


def test_a_face_is_covered_by_its_score():
    assert task_in_words(asdict(rc.Task(min_pixels=4)), by_face=True) == (
        "A face is covered if a camera sees it, with a coverage score (image area / 4 px, at most "
        "1, times visible share) of 0.5 or more."
    )


@pytest.mark.parametrize("hider", ["", "jig"])
@pytest.mark.parametrize("name", REASONS)
def test_no_advice_has_the_name_of_a_figure_in_place_of_it(name, hider):
    assert not set("{}") & set(general_advice(name))
    if name.upper() in rc.Reason.__members__:
        figures = {"distance": 1.0, "incidence": 1.0, "pixel_density": 1.0}
        task, camera = rc.Task(min_pixel_density=5), rc.Camera(width=8, height=8, fx=8, fy=8)
        said = advice(name, figures, np.ones(1), task, camera, hider)
        assert not set("{}") & set(said)
        assert (hider in said) or name != "occluded"


def test_advice_is_read_where_its_figures_are_filled_in_alone():
    package = Path(rc.__file__).parent
    raw = {
        path.name
        for path in package.rglob("*.py")
        if "].advice" in path.read_text(encoding="utf-8")
    }
    assert raw == {"advice.py"}
