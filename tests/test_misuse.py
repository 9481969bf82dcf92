"""Whatever is passed where: a result, or one line of ours that names what is wrong."""

import inspect
from pathlib import Path

import numpy as np
import pytest
from misuse_calls import (
    OWN,
    UNTRIED,
    calls,
    is_wish_for_much_work,
    names_of_calls,
    parameters_of,
    public_callables,
)
from misuse_values import CAMERA, MESH, PLAN, POSES, TOO_MANY, VALUES
from nightly import IS_NIGHTLY, amount
from of_features import of_features
from visible_fractions import visibility

import rastercov as rc
from rastercov.base.files import StrPath
from rastercov.base.format import LONGEST_SHOWN, shown
from rastercov.base.typed import VARIADIC, check_type
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.placement import build_matrix

NAMES = names_of_calls()
PUBLIC = public_callables()
EACH = amount(2, at_night=1)
"""Of the values of an argument, one in so many is tried; its neighbours take the others."""
COMPARED = {
    "Poses.check_cameras": "n_cameras",
    "show": "height",
} | of_features("EARLY")
"""Arguments that are compared before their type is known: elements of `TOO_MANY`, for 10 s each."""


@pytest.fixture(scope="module")
def right():
    """Every call by its name; made here, because making them compiles loops."""
    return calls()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder of its own: what is spoiled may be the name of a file that is written."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_call_that_is_spoiled_is_right_before(right, name):
    right[name].function(**right[name].arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_any_value_of_an_argument_is_used_or_refused_in_one_line(right, name):
    faults = {
        (argument, kind): fault
        for row, argument in enumerate(right[name].arguments)
        for kind, value in list(VALUES.items())[row % EACH :: EACH]
        if not is_wish_for_much_work(name, argument, value)
        and (IS_NIGHTLY or value is not TOO_MANY[0] or argument != COMPARED.get(name))
        and (fault := right[name].spoiled(**{argument: value}).fault())
    }
    assert not faults


def test_what_is_not_tried_is_public_and_named_with_its_reason():
    """All others are tried, with every argument of the signature."""
    known = {f"{name} {each.name}" for name in PUBLIC for each in parameters_of(PUBLIC[name])}
    assert known | set(PUBLIC) >= set(UNTRIED)
    assert {name.partition(",")[0] for name in OWN} <= {*PUBLIC, "select_thesis"}


@pytest.mark.parametrize("name", PUBLIC)
def test_arguments_that_do_not_fit_the_signature_are_refused_in_one_line(name):
    function, parameters = PUBLIC[name], parameters_of(PUBLIC[name])
    kinds = {each.kind for each in parameters}
    wrong = []
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        wrong.append(((), {"no_such_argument": 1}))
    if inspect.Parameter.VAR_POSITIONAL not in kinds:
        wrong.append(((None,) * (len(parameters) + 2), {}))
    if any(each.default is each.empty and each.kind not in VARIADIC for each in parameters):
        wrong.append(((), {}))
    for given, named in wrong:
        with pytest.raises(rc.RastercovError) as caught:
            function(*given, **named)
        assert f"{name.split('.')[-1]}: " in str(caught.value)  # or of the class that has it
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rc.evaluate("part.stl", CAMERA, POSES), r"mesh to be a Mesh \(Mesh\.load"),
        (lambda: rc.evaluate(MESH, {"width": 3}, POSES), r"camera to be a Camera \(Camera\."),
        (lambda: rc.evaluate(MESH, CAMERA, "poses.npy"), "poses to be numbers"),
        (lambda: evaluate_batches(MESH, POSES), "expected an observer of open_observer"),
        (lambda: rc.Mesh(MESH.vertices, MESH.faces, ["a"]), "groups to be Group values .* 'a'"),
        (
            lambda: rc.look_at((0, 0, 1e160), (0, 0, 0)),
            r"expected eye and target within ±1e\+30 m, got larger",
        ),
        (
            lambda: rc.open_observer(MESH, CAMERA, threads=1.5),
            r"expected threads to be a whole number from 1 to 1024, got 1\.5",
        ),
    ],
    ids=range(7),
)
def test_the_line_says_what_was_wanted_and_what_came(call, words):
    with pytest.raises(rc.RastercovError, match=words):
        call()


def test_a_pose_too_far_away_is_named_among_others():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[1, 2, 3] = -1e160
    with pytest.raises(
        rc.PoseError, match=r"expected a rigid transform, got one that is beyond ±1e\+30 m"
    ) as caught:
        rc.evaluate(MESH, CAMERA, poses)
    assert caught.value.pose_ids == (1,)
    assert rc.evaluate(MESH, CAMERA, rc.Poses.of(poses, skip_bad=True)).pose_ids.tolist() == [0, 2]


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", [">f8", "<f4", ">f4"])
def test_any_layout_of_numbers_gives_the_same_answer(kind, order):
    expected = visibility(MESH, CAMERA, POSES.astype(kind).astype(np.float64)).visibility
    vertices = np.array(MESH.vertices, kind, order=order)
    mesh = rc.Mesh(vertices, np.array(MESH.faces, ">i2", order=order))
    observation = visibility(mesh, CAMERA, np.array(POSES, kind, order=order)).visibility
    assert np.array_equal(observation, expected)


class ComparedError(BaseException):
    """An array was computed with; no function takes this for an error of an argument."""


class Uncompared(np.ndarray):
    """Array with which nothing may be computed."""

    def __array_ufunc__(self, *_, **__):
        raise ComparedError


@pytest.mark.parametrize(
    ("name", "argument"),
    [("evaluate", "by"), ("audit", "by"), ("audit", "suggest"), ("check", "min_coverage"),
     *of_features("COMPARED")],
)  # fmt: skip
def test_an_array_is_compared_with_no_name(right, name, argument):
    """It would be a comparison of each element, and that many bytes."""
    many = np.broadcast_to(np.int8(0), (2**40, 3)).view(Uncompared)
    assert not right[name].spoiled(**{argument: many}).fault()


def test_a_value_is_shown_in_a_few_characters():
    poses = np.eye(4).tolist()
    assert shown(3.5) == "3.5"
    assert len(shown({"places": [[poses] * 9] * 9, "a\nb": "x" * 900})) <= LONGEST_SHOWN


def test_a_path_object_fits_the_annotation_of_a_path():
    """An error inside a function must not blame a path that was right."""
    check_type("path", Path("a"), StrPath)
    with pytest.raises(rc.ConfigError, match="path to be a string or a path, got 3"):
        check_type("path", 3, StrPath)


@pytest.mark.parametrize("path", ["a\0b", Path("a\0b.html"), "\0"])
@pytest.mark.parametrize(
    "call",
    [
        lambda path: rc.evaluate(MESH, CAMERA, POSES, shards=path),
        lambda path: rc.evaluate(MESH, CAMERA, POSES, shards=(path, rc.Workers(1))),
        lambda path: rc.show(rc.evaluate(MESH, CAMERA, POSES), path),
        lambda path: rc.place(PLAN, out=path),
        lambda path: build_matrix((MESH, CAMERA), POSES, rc.Task(), path),
    ],
    ids=["shards", "shards of workers", "show", "place", "build_matrix"],
)
def test_a_path_with_a_zero_byte_is_refused_by_name(call, path):
    with pytest.raises(rc.RastercovError, match=r"(?i)a path .*got .*\\x00"):
        call(path)


@pytest.mark.parametrize("only", [[], (1,), (0, 1, 2), (0.5, 1), (2, 2)])
def test_the_part_of_a_run_is_two_whole_numbers(only):
    with pytest.raises(rc.ConfigError, match="expected only to be"):
        rc.Workers(only=only)


@pytest.mark.parametrize("n", [2**31, 2**40])
def test_more_than_the_memory_holds_is_refused_before_any_is_taken(n):
    one = np.int8(0)
    with pytest.raises(rc.ResourceError, match="at most 2147483647 faces"):
        rc.Mesh(MESH.vertices, np.broadcast_to(one, (n, 3)))
    with pytest.raises(rc.ResourceError, match="at most 2147483647 vertices"):
        rc.Mesh(np.broadcast_to(one, (n, 3)), MESH.faces)
    with pytest.raises(rc.MeshError, match="expected spacing to be two numbers"):
        rc.Mesh.terrain([[1, 2], [3, 4]], spacing=np.broadcast_to(one, (n, 3)))
    with pytest.raises(
        rc.ResourceError,
        match=r"expected poses to fit in .* GiB of free memory, got .* GiB; pass fewer",
    ):
        rc.evaluate(MESH, CAMERA, np.broadcast_to(np.eye(4, dtype=np.int8), (n, 4, 4)))
