"""Values that are checked once and then taken as they are: `Poses`, `Engine`, limits of `Task`."""

import dataclasses
import inspect
import shlex
from typing import Annotated

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le, Lt
from hypothesis import given
from hypothesis import strategies as st
from typing_extensions import Doc
from visible_fractions import visibility

import rastercov as rc
from rastercov import cli
from rastercov.base.arguments import check_limits, rules_of
from rastercov.base.errors import ConfigError, PoseError
from rastercov.cli import options
from rastercov.core.camera import pose as pose_module
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.shards import provenance_of
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import shapes
from rastercov.tolerances.installation import InstallationError

CAMERA = rc.Camera(width=64, height=48, fx=60, fy=60)
MESH = shapes.box()


def bad_row():
    poses = sphere_of_poses((0, 0, 0), 3, 4)
    poses[2, 0, 0] += 0.5
    return poses


# --- Poses ----------------------------------------------------------------------------------------


def test_poses_name_the_rows_that_were_accepted_and_rejected():
    accepted = Poses.of(bad_row(), skip_bad=True)
    assert Poses.of(accepted) is accepted
    assert accepted.ids.tolist() == [0, 1, 3]
    assert list(accepted.rejected) == [2]
    assert len(accepted) == len(accepted.world_from_camera) == 3
    assert len(accepted.given) == 4
    with pytest.raises(PoseError, match="expected a rigid transform, got one that is no"):
        Poses.of(bad_row())


def test_some_of_the_poses_keep_their_ids():
    accepted = Poses.of(bad_row(), skip_bad=True)[1:]
    assert accepted.ids.tolist() == [1, 3]
    assert np.array_equal(np.asarray(accepted), bad_row()[[1, 3]])


# --- Engine ---------------------------------------------------------------------------------------

DEVICES = st.sampled_from(("auto", "cpu", "gl", "egl:0", "surfaceless"))
ENGINES = st.one_of(
    st.builds(Engine, st.sampled_from(("certified", "exact")), DEVICES),
    st.builds(Engine, st.just("sampled"), DEVICES, st.integers(1, 64)),
)


@given(ENGINES)
def test_an_engine_is_read_back_from_its_text(engine):
    assert Engine.parse(str(engine)) == engine == Engine.of(str(engine)) == Engine.of(engine)


@pytest.mark.parametrize(
    "text",
    [
        "ray",
        "certified@2",
        "sampled:",
        *(f"sampled@{n}" for n in (0, 65, "x", "²", "9" * 5000)),
    ],
)
def test_what_is_no_engine_is_refused(text):
    words = r"method to be|supersample (1|from 1)|a method such as"
    with pytest.raises(ConfigError, match=words):
        Engine.of(text)


def test_an_engine_is_taken_where_a_method_is():
    poses = sphere_of_poses((0, 0, 0), 3, 2)
    expected = visibility(MESH, CAMERA, poses, "sampled:cpu@3")
    for engine in (Engine("sampled", "cpu", 3), Engine("sampled", "cpu", 3, 1)):
        observation = visibility(MESH, CAMERA, poses, engine)
        assert np.array_equal(observation.visibility, expected.visibility)
    assert Engine.of(engine, 2) == Engine("sampled", "cpu", 3, 2)
    with pytest.raises(ConfigError, match="supersample 1 with method exact"):
        Engine("exact", supersample=2)


# --- limits of fields -----------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Limited:
    share: Annotated[float, Ge(0), Le(1)] = 0.5
    angle: Annotated[float, Gt(0), Le(90)] = 45.0
    tilt: Annotated[float, Gt(0), Lt(90)] = 45.0
    count: Annotated[int, Ge(1)] = 1
    maybe: Annotated[float, Gt(0), Doc("Optional.")] | None = None
    is_on: bool = False

    def __post_init__(self):
        check_limits(self)


@pytest.mark.parametrize("kind", [Limited, rc.Task, InstallationError])
def test_defaults_are_plain_values_within_the_limits(kind):
    """So that they need no check."""
    rules = [rule for rule in rules_of(kind) if rule.default is not dataclasses.MISSING]
    for rule in rules:
        checked = rule.check(rule.default)
        assert checked == rule.default
        assert type(checked) is type(rule.default)
    assert rules


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("share", (1.1, float("nan")), "from 0 to 1"),
        ("angle", (0,), "greater than 0 and at most 90"),
        ("tilt", (0, 90), "greater than 0 and less than 90"),
        ("count", (0, 1.5), "a whole number, 1 or more"),
        ("maybe", (0, "1"), "greater than 0"),
        ("is_on", (1,), "True or False"),
    ],
)
def test_a_value_outside_its_limits_is_refused_in_their_words(name, values, words):
    for value in values:
        with pytest.raises(ConfigError, match=f"{name} to be {words}, got"):
            Limited(**{name: value})
    plain = Limited(share=np.float32(0.25), count=np.int64(3), maybe=2)
    assert [type(each) for each in (plain.share, plain.count, plain.maybe)] == [float, int, float]


def test_a_new_threshold_is_an_option_of_the_command_line(monkeypatch):
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Stricter(rc.Task):
        max_distance: Annotated[float, Gt(0), Doc("Farthest camera, m.")] = 9.0

    monkeypatch.setattr(options, "Task", Stricter)
    items = []

    def command(task: Stricter) -> None:
        items.append(task)

    wrapped = options.expand_options(command)
    assert "max_distance" in inspect.signature(wrapped).parameters
    defaults = {n: p.default for n, p in inspect.signature(wrapped).parameters.items()}
    wrapped(**(defaults | {"max_distance": 3.0}))
    assert items == [Stricter(max_distance=3.0)]
    wrapped(**(defaults | {"thesis": True, "min_pixels": 7.0}))
    assert items[1] == Stricter.thesis(min_pixels=7.0)


def test_provenance_depends_on_every_input():
    poses = sphere_of_poses((0, 0, 0), 3, 2)
    first = provenance_of(MESH, CAMERA, poses, rc.Task())
    assert first == provenance_of(MESH, CAMERA, poses.copy(), rc.Task())
    others = (
        provenance_of(shapes.sphere(), CAMERA, poses, rc.Task()),
        provenance_of(MESH, CAMERA.resized(0.5), poses, rc.Task()),
        provenance_of(MESH, CAMERA, poses[:1], rc.Task()),
        provenance_of(MESH, CAMERA, poses, rc.Task(views=2)),
    )
    assert all(other != first for other in others)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "sampled"])
def test_a_run_checks_its_poses_once(method, tmp_path, monkeypatch):
    calls = []
    check = pose_module.check_poses
    monkeypatch.setattr(pose_module, "check_poses", lambda p: calls.append(len(p)) or check(p))
    line = f"evaluate box -c khepra -p sphere:7 --pictures 2 --method {method} --device cpu"
    assert cli.command([*shlex.split(line), "--json", "-o", str(tmp_path / "out")]) == 0
    assert calls.count(7) == 1  # the others are of views of its pictures
