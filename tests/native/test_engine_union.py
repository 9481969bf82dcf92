"""The class `Union` of the engine: hostile content, errors on the way, one user at a time."""

import subprocess
import sys
from contextlib import suppress
from itertools import pairwise
from threading import Event, Thread

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import joined, square

import rastercov as rc
from rastercov.engine import base_interrupt, solver_union

pytestmark = pytest.mark.native

VALUES = {
    "f": (0.0, -0.0, 1.0, -2.5, 1e-300, 1e300, np.inf, -np.inf, np.nan),
    "i": (0, 1, 3, -1, 7, 40, 2**31 - 1, -(2**31), 2**62, -(2**63)),
    "b": (0, 1),
}
CORNERS = np.array([[(0, 0), (7, 0), (2, 4)], [(0, 0), (5, 0), (1, 3)]], float)
FACES = CORNERS, CORNERS[:, 1, 0] * CORNERS[:, 2, 1] / 2
N_POSES = 3
ALL = solver_union.ALL_TOGETHER


def pieces_of(rng, n, n_poses=N_POSES):
    """Small triangles of some poses on two faces, in order, and their pairs."""
    pose, face = np.divmod(np.sort(rng.integers(0, 2 * n_poses, n)), 2)
    corner = rng.uniform((0.5, 0.1), (4.0, 1.5), (n, 2))
    xy = corner[:, None] + np.array([(0, 0), (0.3, 0), (0.1, 0.2)]) * rng.uniform(0.1, 1, (n, 1, 1))
    pairs = np.unique(2 * pose + face)
    area = np.bincount(2 * pose + face, minlength=2 * n_poses)[pairs] * 1e-5
    of_pairs = pairs // 2, pairs % 2
    return (
        (xy.reshape(-1, 2), np.arange(n + 1) * 3, face.astype(np.int32), pose.astype(np.int32)),
        (*(each.astype(np.int32) for each in of_pairs), area, area * 1e-9, area * 1e-10),
    )


def add(union, arguments, number=(), progress=None):
    union.add(*arguments, np.array(number, np.int64), progress)


def state_of(union):
    """All that a union says."""
    n, corners = union.size()
    items = (
        np.empty((corners, 2)), np.empty(n + 1, np.int64), np.empty(n, np.int32),
        np.empty(n, np.int64), np.empty(n), np.empty((3, 2)), np.empty((2, 2)),
        np.empty(2, np.bool_),
    )  # fmt: skip
    union.write(*items[:5])
    union.write_areas(items[5])
    union.write_bounds(items[6])
    union.write_closed(items[7])
    return b"".join(each.tobytes() for each in items)


def spoilt(arguments, rng, share):
    """Arguments of which some arrays have hostile values; half of them their own, elsewhere."""
    arrays = [[each.copy() for each in part] for part in arguments]
    for _ in range(rng.integers(1, 4)):
        part = arrays[rng.integers(len(arrays))]
        flat = part[rng.integers(len(part))].reshape(-1)
        rows = rng.random(len(flat)) < share
        with np.errstate(over="ignore"):
            few = np.array(VALUES[flat.dtype.kind]).astype(flat.dtype)
        values = few[rng.integers(0, len(few), len(flat))]
        flat[rows] = np.where(rng.random(len(flat)) < 0.5, values, rng.permutation(flat))[rows]
    return tuple(map(tuple, arrays))


@given(
    seed=st.integers(0, 2**32 - 1), share=st.sampled_from((0.02, 0.2, 1.0)),
    views=st.integers(0, 3), most=st.sampled_from((1, 2, 30)),
    together=st.sampled_from((1, 2, ALL)),
)  # fmt: skip
@settings(max_examples=300, deadline=None)
def test_no_content_of_an_array_crashes_and_errors_change_nothing(
    seed, share, views, most, together
):
    rng = np.random.default_rng(seed)
    number = (0, 5, 63) if views == 0 else ()
    union = solver_union.Union(FACES, 1e-15, views, most, together)
    for _ in range(4):
        arguments = pieces_of(rng, int(rng.integers(0, 60)))
        before = state_of(union)
        try:
            add(union, spoilt(arguments, rng, share) if rng.random() < 0.7 else arguments, number)
        except ValueError:
            assert state_of(union) == before
        if views and rng.random() < 0.3:
            union.fill(rng.random(2) < 0.5)
    state_of(union)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_no_partition_to_begin_with_crashes(seed):
    rng = np.random.default_rng(seed)
    pieces, _ = pieces_of(rng, 20, 1)
    tags, bounds = rng.integers(1, 4, 20), rng.random((2, 2)) * 1e-6
    union = solver_union.Union(FACES, 1e-15, 2, 3, ALL)
    with suppress(ValueError):
        union.begin(*(spoilt((pieces, (tags, *bounds)), rng, 0.1)[k] for k in (0,)), tags, *bounds)
    add(union, pieces_of(rng, 20))
    state_of(union)


@pytest.mark.parametrize("together", [1, ALL])
@pytest.mark.parametrize("views", [0, 1, 3])
def test_what_is_left_by_an_error_is_as_before_and_can_be_added_again(views, together):
    rng = np.random.default_rng(views)
    number = (0, 1, 2) if views == 0 else ()
    first, second = pieces_of(rng, 300), pieces_of(rng, 6000)
    one, other = (solver_union.Union(FACES, 1e-15, views, 40, together) for _ in range(2))
    add(one, first, number)
    add(other, first, number)
    before, said = state_of(one), []

    def stop(done, total):
        said.append(done)
        if done < total:
            raise KeyError(done)

    with pytest.raises(KeyError):
        add(one, second, number, stop)
    assert 0 < said[0] < 6000
    assert state_of(one) == before
    add(one, second, number)
    add(other, second, number)
    assert state_of(one) == state_of(other) != before


def of_poses(arguments, first, last):
    """Pieces and pairs of some poses, numbered from 0."""
    (xy, starts, face, pose), pairs = arguments
    own, of_pairs = (pose >= first) & (pose < last), (pairs[0] >= first) & (pairs[0] < last)
    corners = np.repeat(own, np.diff(starts))
    left = np.concatenate(([0], np.cumsum(np.diff(starts)[own])))
    there = [each[of_pairs] for each in pairs]
    there[0] = there[0] - np.int32(first)
    return (xy[corners], left, face[own], pose[own] - np.int32(first)), tuple(there)


@given(seed=st.integers(0, 2**32 - 1), views=st.integers(0, 3))
@settings(max_examples=100, deadline=None)
def test_poses_may_be_divided_between_additions(seed, views):
    rng = np.random.default_rng(seed)
    together, n = int(rng.integers(1, 4)), 12
    arguments, number = pieces_of(rng, int(rng.integers(0, 200)), n), np.arange(n)
    cuts = together * rng.integers(0, n // together, int(rng.integers(0, 4)))
    one, other = (solver_union.Union(FACES, 1e-15, views, 7, together) for _ in range(2))
    add(one, arguments, () if views else number)
    ends = [0, *np.unique(cuts).tolist(), n]
    for first, last in pairwise(ends):
        add(other, of_poses(arguments, first, last), () if views else number[first:last])
    assert state_of(one) == state_of(other)


def test_an_interrupt_changes_nothing():
    rng = np.random.default_rng(0)
    union = solver_union.Union(FACES, 1e-15, 2, 40, ALL)
    add(union, pieces_of(rng, 300))
    before, ends = state_of(union), []

    def work():
        stop = base_interrupt.Stop()
        stop.enter()
        stop.set()
        try:
            add(union, pieces_of(rng, 3000))
        except KeyboardInterrupt:
            ends.append(True)
        stop.leave()

    thread = Thread(target=work)
    thread.start()
    thread.join()
    assert ends
    assert state_of(union) == before


def test_one_thread_at_a_time_uses_a_union():
    rng = np.random.default_rng(0)
    union, inside, done = solver_union.Union(FACES, 1e-15, 2, 40, ALL), Event(), Event()

    def wait(_, __):
        with pytest.raises(ValueError, match="expected one thread"):
            union.size()
        inside.set()
        done.wait(10)

    thread = Thread(target=lambda: add(union, pieces_of(rng, 50), (), wait))
    thread.start()
    assert inside.wait(10)
    with pytest.raises(ValueError, match="expected one thread"):
        union.fill(np.ones(2, np.bool_))
    done.set()
    thread.join()
    assert union.size()[0] > 0


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        (lambda pieces, pairs: ((pieces[0], *pieces[1:3], pieces[3][::-1].copy()), pairs), "order"),
        (lambda pieces, pairs: (pieces, (pairs[0], pairs[1][::-1].copy(), *pairs[2:])), "order"),
        (lambda pieces, pairs: (pieces, (pairs[0][:-1], *pairs[1:])), "one row"),
        (lambda pieces, pairs: ((*pieces[:2], pieces[2] + 2, pieces[3]), pairs), "hold faces"),
        (lambda pieces, pairs: ((pieces[0][:-1], *pieces[1:]), pairs), "3 to 64 corners"),
        (lambda pieces, pairs: ((pieces[0] + 20, *pieces[1:]), pairs), "lie in their faces"),
        (lambda pieces, pairs: ((pieces[0] * np.nan, *pieces[1:]), pairs), "lie in their faces"),
    ],
)
def test_what_does_not_belong_together_is_refused(change, wanted):
    union = solver_union.Union(FACES, 1e-15, 2, 40, ALL)
    with pytest.raises(ValueError, match=wanted):
        add(union, change(*pieces_of(np.random.default_rng(1), 50)))
    assert union.size() == (0, 0)


@pytest.mark.parametrize(
    ("corners", "least"),
    [(CORNERS, np.nan), (CORNERS, np.inf), (CORNERS, -1.0), (CORNERS + np.inf, 0.0)],
)
def test_faces_and_tolerances_that_are_no_lengths_are_refused(corners, least):
    with pytest.raises(ValueError, match="corners must be finite, and least not negative"):
        solver_union.Union((corners, FACES[1]), least, 2, 40, ALL)


def test_sets_have_up_to_64_poses():
    union = solver_union.Union(FACES, 1e-15, 0, 40, ALL)
    arguments = pieces_of(np.random.default_rng(1), 50)
    for number in ((0, 1, 64), (0, 1), (-1, 0, 1)):
        with pytest.raises(ValueError, match=r"numbers? must"):
            add(union, arguments, number)
    with pytest.raises(ValueError, match=r"numbers? must"):
        add(solver_union.Union(FACES, 1e-15, 1, 40, ALL), arguments, (0, 1, 2))


def test_what_is_known_of_an_area_stays_known():
    """`fill` and `of` keep the bounds of what was added before."""
    mesh = joined(square(0.5, 2), square(0.2, 1.2))
    poses = np.repeat(np.eye(4)[None], 3, axis=0)
    poses[:, 0, 3] = -0.2, 0.0, 0.3
    camera = rc.Camera(width=200, height=150, fx=150, fy=150)
    union = rc.RegionUnion(mesh, 2)
    union.add(rc.regions(mesh, camera, poses, rc.Task(min_pixel_density=60)))
    before = union.covered()
    assert before.bound.max() > 0
    again = rc.RegionUnion.of(before, 2).covered()
    assert np.array_equal(again.bound, before.bound)
    assert np.array_equal(again.excess, before.excess)
    union.fill(np.zeros(mesh.n_faces, np.bool_))
    assert (union.covered().bound >= before.bound).all()
    union.fill(np.ones(mesh.n_faces, np.bool_))
    assert (union.covered().bound >= before.bound).all()


OUT_OF_MEMORY = """
import resource, sys
sys.path.insert(0, "tests/native")
from test_engine_union import *
union = solver_union.Union(FACES, 1e-15, 3, 256, ALL)
rng = np.random.default_rng(0)
add(union, pieces_of(rng, 100))
more, before = pieces_of(rng, 50_000), state_of(union)
with open("/proc/self/statm") as file:
    taken = int(file.read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + 2**20, resource.RLIM_INFINITY))
try:
    add(union, more)
except MemoryError:
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert state_of(union) == before
    add(union, pieces_of(rng, 100))
    print("as before")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS")
def test_a_lack_of_memory_changes_nothing():
    ended = subprocess.run(
        [sys.executable, "-c", OUT_OF_MEMORY], capture_output=True, text=True, check=False,
        env={"PYTHONPATH": "tests/support"},
    )  # fmt: skip
    assert ended.stdout == "as before\n", ended.stderr
