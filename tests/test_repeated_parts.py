"""Doubling any repeated part of a file, and its instances with it, doubles the work at most.

Work is calls of functions of Python and of C, not seconds.
"""

import gc
import sys
import tracemalloc

import numpy as np
import pytest
from nightly import amount
from repeated_parts import (
    CAMERAS,
    DAE,
    HERE,
    MESHES,
    THREEMF,
    dae,
    exploding,
    shared,
    unplaced_rigs,
)

import rastercov as rc
from rastercov.base.errors import ResourceError
from rastercov.core.camera.conventions import Conventions
from rastercov.core.mesh import Mesh

SIZE = amount(50, at_night=100)
MOST_GROWTH = 2.5
"""Work that is added by the second doubling, by that of the first; linear is 2, quadratic 4."""
FEW_CALLS = 400
"""Calls that a set or an array, which grows by itself, may add."""
ANSWERS = Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")


def read_cameras(path):
    return rc.read_views(path, conventions=ANSWERS)


def calls_of(read, path):
    """Calls while a file is read."""
    n = 0

    def count(frame, event, argument):
        nonlocal n
        n += event in ("call", "c_call")

    read(path)  # what is only done once in a process
    gc.disable()  # which calls what other tests have registered
    sys.setprofile(count)
    try:
        read(path)
    finally:
        sys.setprofile(None)
        gc.enable()
    return n


def peak_of(read, path):
    tracemalloc.start()
    try:
        read(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def refused(path):
    with pytest.raises(ResourceError):
        Mesh.load(path)


def doublings(read, make, path):
    """Calls that the first and the second doubling add."""
    items = []
    for k in (1, 2, 4):
        path.write_bytes(make(k * SIZE))
        items.append(calls_of(read, path))
    return items[1] - items[0], items[2] - items[1]


CASES = [(Mesh.load, *key, make) for key, make in MESHES.items()]
CASES += [(read_cameras, *key, make) for key, make in CAMERAS.items()]
NAMES = [f"{name} {part}" for _, name, part, _ in CASES]


@pytest.mark.parametrize(("read", "name", "part", "make"), CASES, ids=NAMES)
def test_a_part_twice_as_often_is_twice_the_work_at_most(read, name, part, make, tmp_path):
    path = tmp_path / name
    path.write_bytes(make(10))
    read(path)  # imports, compiles
    first, second = doublings(read, make, path)
    assert second <= MOST_GROWTH * max(first, 0) + FEW_CALLS


@pytest.mark.parametrize("part", ["vertices of one source", "sources of one array"])
def test_primitives_share_the_points_that_they_name(part, load):
    mesh = load("a.dae", DAE[part](SIZE))
    assert mesh.n_faces == SIZE
    assert mesh.n_vertices == SIZE + 4


def test_parts_of_a_scene_twice_as_many_are_twice_the_work_at_most():
    def join(n):
        Mesh.joined([box] * n, [f"part {row}" for row in range(n)])

    box = rc.shapes.box()
    counts = [calls_of(join, k * SIZE) for k in (1, 2, 4)]
    assert counts[2] - counts[1] <= MOST_GROWTH * (counts[1] - counts[0])


def test_rigs_without_places_are_one_note(tmp_path):
    def make(n):
        rows = [f"{i} PINHOLE 640 480 500 500 320 240\n" for i in range(2 * n)]
        (tmp_path / "cameras.txt").write_text("".join(rows))
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 0 a\n\n")
        return unplaced_rigs(n).encode()

    first, second = doublings(read_cameras, make, tmp_path / "rigs.txt")
    assert second <= MOST_GROWTH * first
    notes = [note for note in read_cameras(tmp_path).notes if "has no pose" in note]
    assert len(notes) == 1
    assert f"and {4 * SIZE - 1} others" in notes[0]


@pytest.mark.parametrize("name", ["a.3mf", "a.dae"])
def test_instances_beyond_the_budget_are_refused_before_any_is_made(name, tmp_path):
    path = tmp_path / name
    path.write_bytes(exploding(400)[name])
    assert calls_of(refused, path) < 100_000
    assert peak_of(refused, path) < 10_000_000
    path.write_bytes(exploding(4)[name])
    assert Mesh.load(path).n_faces == 4 * 2**4


def test_instances_are_where_their_nodes_put_them_one_by_one(load):
    """A chain of elements with one part each is one step."""
    rng = np.random.default_rng(0)
    moves = [f"<rotate>0 0.6 0.8 {a}</rotate><translate>{a} 1 2</translate>" for a in rng.random(5)]
    nested = "".join(f"<node>{move}" for move in moves) + HERE + "</node>" * 5
    in_one = f"<node>{''.join(moves)}{HERE}</node>"
    meshes = [load("a.dae", data) for data in (shared(2, nested), dae(in_one * 2))]
    corners = [mesh.vertices[mesh.faces] for mesh in meshes]
    np.testing.assert_allclose(*corners, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.3mf", THREEMF["unknown elements"](50)),
        ("a.dae", DAE["unknown elements"](50)),
        ("a.dae", DAE["unknown names"](50)),
    ],
    ids=["3mf", "dae", "names"],
)
def test_unknown_elements_are_one_note(name, data, tmp_path):
    (tmp_path / name).write_bytes(data)
    mesh = Mesh.load(tmp_path / name)
    (note,) = [note for note in mesh.notes if "not read" in note]
    assert note.count("a of") <= 1
    assert len(note) < 400
