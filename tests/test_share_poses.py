"""Poses in threads: each is looked at once, in any number of threads, and nothing else changes."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rastercov.base.errors import ConfigError
from rastercov.base.threads import POSES_A_TURN, share_poses, thread_count
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.mesh import shapes

CAMERA = Camera(width=160, height=120, fx=140, fy=150)


@given(n_poses=st.integers(0, 400), n_workers=st.integers(1, 9))
@settings(max_examples=60)
def test_every_pose_is_taken_once_in_turns_that_can_be_shared(n_poses, n_workers):
    turns = []
    share_poses(n_poses, [lambda turn: turns.append(range(n_poses)[turn])] * n_workers)
    assert sorted(row for turn in turns for row in turn) == list(range(n_poses))
    assert max(map(len, turns), default=0) <= POSES_A_TURN
    assert len(turns) >= min(n_poses, n_workers)


def test_workers_run_side_by_side_each_in_a_thread_of_its_own():
    both = threading.Barrier(2, timeout=20)
    threads = []

    def worker(turn):
        threads.append(threading.get_ident())
        both.wait()

    share_poses(2, [worker, worker])
    assert len(set(threads)) == 2
    assert threading.get_ident() in threads


def test_one_worker_stays_in_the_thread_of_the_caller():
    threads = []
    share_poses(40, [lambda turn: threads.append(threading.get_ident())])
    assert set(threads) == {threading.get_ident()}


@pytest.mark.parametrize("n_workers", [1, 3])
@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_what_a_worker_raises_is_raised_and_ends_the_others(n_workers, kind):
    done = []

    def worker(turn):
        if len(done) >= 3:
            raise kind("enough")
        done.append(turn)
        time.sleep(0.001)

    with pytest.raises(kind, match="enough"):
        share_poses(POSES_A_TURN * 1000, [worker] * n_workers)
    assert len(done) < 50  # of 1000


@pytest.mark.parametrize("method", ["certified", "sampled:cpu"])
def test_answers_are_equal_in_any_number_of_threads(method):
    mesh, poses = shapes.torus(20, 10), sphere_of_poses((0, 0, 0), 4, 60)
    answers = set()
    for threads in (1, 2, 5):
        with open_observer(mesh, CAMERA, method, threads=threads) as observer:
            for _ in range(2):
                seen = observer.observe(poses)
                answers.add(seen.visible_pixels.tobytes() + seen.drawn_pixels.tobytes())
    assert len(answers) == 1


def test_threads_are_counted_from_one():
    assert thread_count(None) >= 1
    assert thread_count(7) == 7
    for wrong in (0, -1, True):
        with pytest.raises(
            ConfigError, match="expected threads to be a whole number from 1 to 1024"
        ):
            thread_count(wrong)


# --- observers ------------------------------------------------------------------------------------


def mixed_poses(mesh, n, rng):
    """From outside, inside and far away in turn, so that neighbours in a batch differ much."""
    centre, extent = mesh.bounds.mean(axis=0), np.ptp(mesh.bounds, axis=0)
    eyes = centre + rng.uniform(-0.4, 0.4, (n, 3)) * extent
    eyes[::3] = centre + rng.normal(size=(len(eyes[::3]), 3)) * extent * 3
    eyes[1::6] = centre + rng.normal(size=(len(eyes[1::6]), 3)) * extent * 300
    return look_at(eyes, centre + rng.uniform(-0.3, 0.3, (n, 3)) * extent)


def observe(mesh, poses, method, **options):
    with open_observer(mesh, CAMERA, method, **options) as observer:
        return observer.observe(poses)


def assert_same(one, other, rows=slice(None)):
    for name in ("visible_pixels", "drawn_pixels", "kind", "clipped"):
        assert np.array_equal(getattr(one, name)[rows], getattr(other, name))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["certified", "exact"])
@pytest.mark.parametrize("name", ["room", "teapot-5"])
def test_neither_threads_nor_batches_nor_their_order_change_a_bit(method, name):
    mesh, rng = shapes.by_name(name), np.random.default_rng(3)
    poses, order = mixed_poses(mesh, 40, rng), rng.permutation(40)
    one = observe(mesh, poses, method, threads=1)
    for threads in (64, None):
        assert_same(one, observe(mesh, poses, method, threads=threads))
    with open_observer(mesh, CAMERA, method, threads=2) as observer:
        for rows in (slice(0, 1), slice(1, 8), slice(8, 40), order):
            assert_same(one, observer.observe(poses[rows]), rows)
        assert_same(one, observer.observe(poses[7]), slice(7, 8))


@pytest.mark.slow
def test_observers_of_one_mesh_work_side_by_side():
    # They share its surface, and the contacts that each finds are those of the other.
    mesh = shapes.torus(40, 30)
    poses = mixed_poses(mesh, 30, np.random.default_rng(5))
    expected = observe(mesh, poses, "certified", threads=1)
    with ThreadPoolExecutor(4) as pool:
        for item in pool.map(lambda _: observe(mesh, poses, "certified", threads=2), range(4)):
            assert_same(expected, item)
