"""Densities by name and unit, and the threshold of a target that faces the camera."""

import json
import math

import numpy as np
import pytest
from scenes import square

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.cli import command
from rastercov.core.coverage.task import EDITIONS, LEVELS
from rastercov.placement.plan.file import read_plan
from rastercov.reference.regions import jacobian

AHEAD = np.eye(4)
CAMERA = rc.Camera(width=200, height=200, fx=100, fy=100)
PLAN = """
[[meshes]]
built_in = "box"
[camera]
width = 96
height = 72
fx = 90
fy = 90
[task]
{line}
"""


def test_the_names_of_the_editions_are_disjoint():
    old, new = (set(levels) for levels in EDITIONS.values())
    assert not old & new
    assert len(LEVELS) == len(old) + len(new) == 13


@pytest.mark.parametrize(
    ("text", "figure"),
    [
        ("monitor", 12.5), ("detect", 25), ("observe", 62.5), ("recognise", 125),
        ("identify", 250), ("inspect", 1000), ("overview", 20), ("outline", 40), ("discern", 80),
        ("perceive", 125), ("characterise", 250), ("validate", 500), ("scrutinise", 1500),
        ("Recognize", 125), ("characterize", 250), ("scrutinize", 1500), (" identify ", 250),
        ("250 px/m", 250), ("0.25 px/mm", 250), ("2.5px/cm", 250), ("76.2 px/ft", 250),
        ("1e3", 1000), (250, 250), (np.float64(2.5), 2.5),
    ],
)  # fmt: skip
@pytest.mark.parametrize("threshold", ["min_pixel_density", "min_facing_density"])
def test_a_density_is_a_number_a_name_or_text_with_a_unit(threshold, text, figure):
    result = getattr(rc.Task(**{threshold: text}), threshold)
    assert type(result) is float
    assert math.isclose(result, figure, rel_tol=1e-15)


@pytest.mark.parametrize("text", ["idntify", "", "250 px", "1.2.3", "250 px/mile", "nan", "px/m"])
def test_a_wrong_name_gives_one_line_with_units_and_similar_levels(text):
    with pytest.raises(
        ConfigError, match=r"^expected min_facing_density to be px/m, px/cm"
    ) as caught:
        rc.Task(min_facing_density=text)
    line = str(caught.value)
    assert "\n" not in line
    assert ("identify" if text == "idntify" else "monitor, detect, observe") in line


@pytest.mark.parametrize("value", [-1, "-1 px/m", math.nan, None, [250]])
def test_a_density_within_no_limits_is_refused(value):
    with pytest.raises(ConfigError, match="min_facing_density to be 0 or more"):
        rc.Task(min_facing_density=value)


def test_a_plan_takes_names_and_keeps_numbers(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN.format(line='min_facing_density = "identify"\nmin_pixel_density = 20'))
    task = read_plan(path).build_task()
    assert (task.min_facing_density, task.min_pixel_density) == (250.0, 20.0)


def test_the_command_line_takes_names(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    line = ["evaluate", "box", "-c", "khepra", "-p", "sphere:2", "--pictures", "0", "--json"]
    assert command([*line, "--min-facing-density", "0.25 px/mm", "-o", "out"]) == 0
    task = json.loads(capsys.readouterr().out)["run"]["task"]
    assert task["min_facing_density"] == 250.0


# --- the figure -----------------------------------------------------------------------------------


def test_facing_density_is_the_focal_length_by_the_greatest_depth():
    mesh = rc.Mesh([(0, 0, 2), (1, 0, 4), (0, 1, 3)], [(0, 2, 1)])
    result = rc.evaluate(mesh, CAMERA, AHEAD[None], by="face")
    assert result.facing_density.tolist() == [[25.0]]
    behind = rc.Mesh([(0, 0, -2), (1, 0, 4), (0, 1, 3)], [(0, 2, 1)])
    assert rc.evaluate(behind, CAMERA, AHEAD[None], by="face").facing_density.tolist() == [[0.0]]


def test_it_is_the_least_singular_value_of_a_plane_across_the_ray():
    points = np.random.default_rng(0).uniform((-2, -2, 1), (2, 2, 5), (500, 3))
    points[250:, 0] = 0

    def ratios(camera):
        """Least singular values by the figure."""
        across = -points / np.linalg.norm(points, axis=1, keepdims=True)
        svd = np.linalg.svd(jacobian(camera, points, across), compute_uv=False)[:, 1]
        return svd * points[:, 2] / 100

    assert np.allclose(ratios(CAMERA), 1, rtol=1e-12)
    flat = ratios(rc.Camera(width=200, height=200, fx=100, fy=130))
    assert (flat >= 1 - 1e-12).all()  # a lower bound ...
    assert np.allclose(flat[250:], 1, rtol=1e-12)  # ... and exact on this axis


@pytest.mark.parametrize("method", ["certified", "exact", "sampled:cpu"])
def test_a_face_below_the_threshold_is_too_coarse(method):
    for limit, reason in ((50.0, rc.Reason.COVERED), (50.01, rc.Reason.TOO_COARSE)):
        task = rc.Task(min_facing_density=limit)
        result = rc.evaluate(square(1, 2), CAMERA, AHEAD[None], task, method=method, by="face")
        assert set(result.reason.ravel()) == {reason}


def test_a_floor_seen_at_a_flat_angle_has_less_density_than_a_person_on_it():
    floor = rc.Mesh([(-1, 1, 9), (1, 1, 9), (1, 1, 11), (-1, 1, 11)], [(0, 1, 2), (0, 2, 3)])
    result = rc.evaluate(floor, CAMERA, AHEAD[None], by="face")
    assert np.allclose(result.facing_density, 100 / 11)
    # Along the line of sight: sin of the angle at which the floor is seen, about 1 / 11
    assert (result.pixel_density < result.facing_density / 10).all()


def test_by_area_the_threshold_is_a_depth():
    floor = rc.Mesh([(-1, 1, 2), (1, 1, 2), (1, 1, 10), (-1, 1, 10)], [(0, 1, 2), (0, 2, 3)])
    for limit, share in ((0, 1), ("20 px/m", 3 / 8), (12.5, 6 / 8), (60, 0)):
        regions = rc.regions(floor, CAMERA, AHEAD[None], rc.Task(min_facing_density=limit))
        assert math.isclose(regions.area.sum(), 16 * share, rel_tol=1e-12)
