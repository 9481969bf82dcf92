"""Every public function and class has an example in its docstring, which prints what it says."""

import doctest
import functools
import inspect

import pytest
from of_features import of_features

import rastercov as rc
from rastercov import placement
from rastercov.core.mesh import shapes

FIRST = """
    Camera.depth_of_field Camera.from_dict Camera.from_fov Camera.from_lens Camera.from_opencv
    Camera.load Camera.preset Camera.resized Camera.save Camera.with_optics Cells.share
    Covered.share DeadZones.places Evaluation.covered Evaluation.group_views
    Evaluation.summary
    Mesh.from_trimesh Mesh.joined Mesh.load Mesh.moved Mesh.with_groups
    Observer.observe Poses.of Rasterizer.count Rasterizer.render Regions.at_least Regions.where
    Rig.poses Task.thesis Views.camera"""
"""Methods that a program calls first."""


def is_own(value):
    """True for a public function of `shapes`, false for what it imports."""
    return hasattr(value, "__wrapped__") and value.__module__ == shapes.__name__


SHAPES = [name for name, each in vars(shapes).items() if is_own(each)]
NAMES = [*rc.__all__, *FIRST.split(), *of_features("FIRST")]
NAMES += [f"shapes.{name}" for name in SHAPES]
NAMES += [f"placement.{name}" for name in placement.__all__]


def example(name):
    """Example of a public name; it imports what it needs."""
    value = functools.reduce(getattr, name.split("."), rc)
    text = inspect.getdoc(value) or ""
    _, _, own = text.partition("\nExamples\n--------\n")
    return doctest.DocTestParser().get_doctest(own, {}, name, name, 0)


def outcome(test):
    """Number of lines that were tried, and a report on those that print something else."""
    report = []
    tried = doctest.DocTestRunner(verbose=False).run(test, out=report.append).attempted
    return tried, "".join(report)


def test_built_in_meshes_are_among_the_names():
    assert {"shapes.box", "shapes.room", "shapes.teapot"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_has_an_example_that_prints_something(name):
    lines = example(name).examples
    assert any(line.want for line in lines)
    assert len(lines) >= 2
    assert "import rastercov as rc\n" in [line.source for line in lines]
    assert not any(line.options for line in lines)  # none is skipped


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_an_example_prints_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tried, report = outcome(example(name))
    assert tried
    assert report == ""


def test_an_example_that_prints_something_else_is_found():
    test = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", "wrong", 0)
    assert "Expected:\n    3\nGot:\n    2\n" in outcome(test)[1]
