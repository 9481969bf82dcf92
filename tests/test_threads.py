"""Many threads, one object: every answer is that of one thread, and what is closed stays closed."""

import json
import os
import threading
import time
import tracemalloc
import weakref
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from nightly import amount
from processes import python, run_python

import rastercov as rc
from rastercov.base import arguments
from rastercov.base.errors import DeviceError, ResourceError
from rastercov.base.threads import THREADS, Once, once_each, share_poses, thread_count
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.core.coverage.task import Engine
from rastercov.core.exact import surface
from rastercov.core.mesh import contacts, shapes
from rastercov.engine import solver_parts
from rastercov.reference.models.scott import coverage as scott_coverage

ATTACK = Path(__file__).resolve().parents[1] / "benchmarks" / "attack_threads.py"
CAMERA = rc.Camera(width=96, height=80, fx=85, fy=90)
MESH = shapes.torus(16, 12)
POSES = sphere_of_poses((0, 0, 0), 4, 6)
OPENERS = {
    "certified": partial(rc.open_observer, method="certified"),
    "exact": partial(rc.open_observer, method="exact"),
    "sampled": partial(rc.open_observer, method="sampled:cpu"),
    "cpu": partial(rc.open_rasterizer, backend="cpu"),
}
ANALYTIC = ("certified", "exact")
on_every_kind = pytest.mark.parametrize("kind", OPENERS)


def ask(thing, poses=POSES):
    if hasattr(thing, "observe"):
        seen = thing.observe(poses)
        return seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.clipped
    counts = thing.count(poses)
    return counts.visible, counts.drawn, counts.background


def assert_same(one, other):
    assert all(map(np.array_equal, one, other))


def in_threads(n, work):
    """Results of `work(0)` ... `work(n - 1)`, each in a thread that begins with the others."""
    together, results = threading.Barrier(n), {}

    def run(caller):
        together.wait(20)
        try:
            results[caller] = work(caller)
        except Exception as error:
            results[caller] = error

    threads = [threading.Thread(target=run, args=(caller,)) for caller in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    return [results[caller] for caller in range(n)]


# --- in processes of their own, because what breaks here ends Python ------------------------------


PROCESSES = {
    "first use": [("first_use",)],
    "one after another": [
        *(
            ("shared", kind, "1", "2", "None")
            for kind in ("certified", "exact", "sampled", "supersample", "rasteriser")
        ),
        ("opened",),
        ("models",),
        ("closed", "certified"),
        ("closed", "rasteriser"),
    ],
    "forked": [("forked",)],
}
"""Parts of the attack by the process that runs them."""
RUNS = amount(2, 6)


@pytest.mark.slow
@pytest.mark.parametrize("process", PROCESSES)
def test_six_threads_get_the_answers_of_one_bit_for_bit(process):
    parts = PROCESSES[process]
    words = [word for part in parts for word in ("--part", *part)]
    done = python(ATTACK, *words, "--runs", RUNS)
    assert done.returncode == 0, done.stderr
    contents = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(contents) == RUNS * sum(3 if part[0] == "shared" else 1 for part in parts)
    assert all(run["answers"] > 0 and run["wrong"] == 0 for run in contents), contents
    assert not any(run["errors"] for run in contents), contents


@pytest.mark.slow
@pytest.mark.parametrize("n", [32, 80])
@pytest.mark.parametrize("rule", [None, rc.Any(), rc.AtLeast(2)])
def test_figures_and_bounds_are_the_same_for_any_number_of_threads(n, rule, tmp_path):
    mesh = shapes.torus(n, n)  # of few faces, and of more than a union takes in at once
    poses, camera = sphere_of_poses((0, 0, 1), 1.5, 300 if n == 32 else 100), CAMERA
    if rule is not None:
        camera = rc.Rig([CAMERA] * 2, ["left", "right"], rule=rule)
        poses = camera.poses(poses)
    found = []
    for threads in (1, 3, 16):
        engine = Engine("certified", threads=threads)
        found.append(rc.evaluate(mesh, camera, poses, method=engine).summary())
    for each in (*found, rc.evaluate(mesh, camera, poses, shards=tmp_path).summary()):
        for name in each.keys() - {"seconds", "poses_per_second", "run"}:
            assert each[name] == found[0][name], name


@pytest.mark.parametrize("method", ANALYTIC)
def test_a_pose_has_the_bits_of_one_alone_also_where_memory_grew_for_it(method):
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (12_000, 1, 3)) + rng.normal(0, 0.05, (12_000, 3, 3))
    faces = np.arange(36_000).reshape(-1, 3)
    poses, engine = sphere_of_poses((0, 0, 0), 4.0, 4), Engine(method, threads=1)
    camera = rc.Camera(width=1000, height=1000, fx=1000, fy=1000)

    def regions_of(poses):  # of a mesh for which nothing has memory yet
        mesh = rc.Mesh(corners.reshape(-1, 3), faces)
        return rc.regions(mesh, camera, poses, method=engine)

    together, alone = regions_of(poses), [regions_of(poses[row : row + 1]) for row in range(4)]
    for name in ("xy", "area", "bound", "excess"):
        parts = [getattr(each, name) for each in alone]
        assert np.concatenate(parts).tobytes() == getattr(together, name).tobytes(), name


def test_a_child_works_out_what_its_parent_was_working_out_when_it_forked():
    run_python(
        "-c",
        """
import os, signal, threading
from rastercov.base.threads import Once
value, begun, ended = Once(), threading.Event(), threading.Event()
def slow():
    begun.set()
    ended.wait()
    return "parent"
thread = threading.Thread(target=value.get, args=(slow,), daemon=True)
thread.start()
begun.wait()
child = os.fork()
if not child:
    signal.alarm(30)
    os._exit(0 if value.get(lambda: "child") == "child" else 1)
assert os.waitpid(child, 0)[1] == 0
ended.set()
thread.join()
assert value.get(lambda: "late") == "parent"
""",
    )


# --- what is worked out once ----------------------------------------------------------------------


def test_what_could_not_be_made_is_made_by_the_next_that_asks():
    value = Once()
    with pytest.raises(ValueError, match="not yet"):
        value.get(lambda: (_ for _ in ()).throw(ValueError("not yet")))
    assert value.get(lambda: 3) == 3


def test_a_value_of_each_object_is_made_once_and_goes_with_it():
    made = []

    @once_each
    def value(key, *others):
        made.append(others)
        return [others]

    mesh, other = shapes.box(), shapes.box()
    held = in_threads(6, partial(value, mesh))
    assert len(made) == 1
    assert all(each is held[0] for each in held)
    assert value(other) is not held[0]
    kept = weakref.ref(mesh)
    del mesh
    assert kept() is None
    assert len(made) == 2


def test_the_surface_and_the_contacts_of_a_mesh_are_worked_out_once(monkeypatch):
    built, touched = [], []
    build, touching = surface._build, contacts.touching_faces

    def slow_build(*args):
        built.append(args)
        time.sleep(0.05)
        return build(*args)

    def slow_touching(*args, **options):
        touched.append(1)
        time.sleep(0.05)
        return touching(*args, **options)

    monkeypatch.setattr(surface, "_build", slow_build)
    monkeypatch.setattr(contacts, "touching_faces", slow_touching)
    mesh = rc.Mesh(MESH.vertices, MESH.faces)
    result = in_threads(6, lambda _: solver_parts.contacts(surface.surface_of(mesh), 1.0)[0])
    assert len(built) == len(touched) == 1
    assert all(np.shares_memory(each, result[0]) for each in result)


def test_a_surface_lives_as_long_as_its_mesh():
    mesh = rc.Mesh(MESH.vertices, MESH.faces)
    assert surface.surface_of(mesh) is surface.surface_of(mesh)
    kept = weakref.ref(mesh)  # which the surface does not keep
    del mesh
    assert kept() is None


def test_what_a_mesh_computes_at_first_use_cannot_be_changed():
    mesh = rc.Mesh(MESH.vertices, MESH.faces)
    mesh.warnings  # noqa: B018
    for name, value in vars(mesh).items():
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                assert not array.flags.writeable, name
    assert not mesh.topology.neighbours.flags.writeable


# --- scratch memory -------------------------------------------------------------------------------


@pytest.mark.slow
@on_every_kind
def test_idle_scratch_memory_does_not_grow_with_the_threads_that_ever_called(kind):
    thing = OPENERS[kind](MESH, CAMERA, threads=2)
    in_threads(8, lambda _: ask(thing))
    owner = thing._rasterizers._open[0] if kind == "sampled" else getattr(thing, "_pass", thing)

    def n_idle():
        return (owner._solvers if kind in ANALYTIC else owner._drawing).n_idle

    assert 1 <= n_idle() <= 2
    thing.close()
    assert n_idle() == 0


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_scratch_memory_that_an_error_left_half_changed_is_not_used_again(monkeypatch, error):
    # Contacts are looked for in the middle of the first pose.
    expected = ask(OPENERS["certified"](MESH, CAMERA, threads=1), np.eye(4))

    def interrupted(*args, **options):
        raise error

    mesh = rc.Mesh(MESH.vertices, MESH.faces)
    with OPENERS["certified"](mesh, CAMERA, threads=1) as observer:
        monkeypatch.setattr(contacts, "touching_faces", interrupted)
        with pytest.raises(error):
            observer.observe(np.eye(4))
        monkeypatch.undo()
        assert observer._pass._solvers.n_idle == 0
        assert_same(ask(observer, np.eye(4)), expected)


def test_an_observer_that_nobody_holds_gives_its_memory_back_at_once():
    observer = OPENERS["certified"](MESH, CAMERA)
    observer.observe(POSES)
    view = weakref.ref(observer._pass)
    del observer
    assert view() is None


def test_where_the_system_gives_no_more_threads_those_that_run_do_the_work(monkeypatch):
    taken, started = [], []
    start = threading.Thread.start

    def refused(thread):
        if started:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", refused)
    share_poses(200, [lambda turn: taken.extend(range(200)[turn])] * 5)
    assert sorted(taken) == list(range(200))


# --- closing --------------------------------------------------------------------------------------


@on_every_kind
def test_what_is_closed_refuses_in_one_line_and_closes_again(kind):
    with OPENERS[kind](MESH, CAMERA) as thing:
        ask(thing)
    thing.close()
    for poses in (POSES, np.empty((0, 4, 4))):
        with pytest.raises(DeviceError, match=r"closed( one)?; open a") as caught:
            ask(thing, poses)
        assert "\n" not in str(caught.value)


def test_a_call_that_another_thread_is_in_ends_well_when_the_observer_is_closed(monkeypatch):
    expected = ask(OPENERS["certified"](MESH, CAMERA, threads=1))
    inside, closed = threading.Event(), threading.Event()
    touching = contacts.touching_faces

    def waiting(*args, **options):
        inside.set()
        closed.wait(20)
        return touching(*args, **options)

    monkeypatch.setattr(contacts, "touching_faces", waiting)
    observer = OPENERS["certified"](rc.Mesh(MESH.vertices, MESH.faces), CAMERA, threads=2)

    def work(caller):
        if caller == 0:
            return ask(observer)
        inside.wait(20)
        observer.close()
        closed.set()
        return None

    result, _ = in_threads(2, work)
    assert_same(result, expected)
    assert observer._pass._solvers.n_idle == 0
    with pytest.raises(DeviceError, match="closed"):
        observer.observe(POSES)


def test_a_batch_of_a_closed_observer_is_refused():
    with OPENERS["certified"](MESH, CAMERA) as observer:
        batches = evaluate_batches(observer, POSES)
    with pytest.raises(DeviceError, match="expected an open observer"):
        next(batches)


# --- more than memory holds -----------------------------------------------------------------------


def peak_of(call, error, match):
    """Most bytes that a call takes before it raises."""
    tracemalloc.start()
    try:
        with pytest.raises(error, match=match) as caught:
            call()
        assert "\n" not in str(caught.value)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_picture_of_ten_thousand_million_pixels_is_refused_before_it_is_made():
    camera = rc.Camera(width=100_000, height=100_000, fx=90_000, fy=90_000)
    with rc.open_rasterizer(MESH, camera, "cpu") as rasteriser:
        peak = peak_of(
            lambda: rasteriser.render(POSES[0]),
            ResourceError,
            r"got 100,000 x 100,000 \(74.5 GiB\); use a smaller camera",
        )
    assert peak < 1 << 20


@pytest.mark.slow
def test_samples_of_a_large_picture_are_counted_in_little_memory():
    camera = rc.Camera(width=30_000, height=30_000, fx=27_000, fy=27_000)
    with rc.open_rasterizer(MESH, camera, "cpu") as rasteriser:
        tracemalloc.start()
        counts = rasteriser.count(POSES[0], drawn=False)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert counts.visible.sum() + counts.background[0] == 30_000**2
    assert peak < 64 << 20


POOR = 300 << 20
RESULTS = {  # with the bytes that they take for each pose and face
    "counts": (lambda poses: ask(rc.open_rasterizer(MESH, CAMERA, "cpu"), poses), 4 + 4),
    "certified": (lambda poses: ask(rc.open_observer(MESH, CAMERA), poses), 3 * 8 + 1),
    "sampled": (lambda poses: ask(OPENERS["sampled"](MESH, CAMERA), poses), 3 * 8 + 1),
    "model": (lambda poses: scott_coverage(MESH, CAMERA, poses), 8),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", RESULTS)
def test_results_larger_than_memory_are_refused_with_their_bytes_and_a_remedy(monkeypatch, kind):
    monkeypatch.setattr(arguments, "free_memory", lambda: POOR)
    call, bytes_a_pair = RESULTS[kind]
    n_poses = POOR // (bytes_a_pair * MESH.n_faces) + 1
    poses = np.tile(np.eye(4), (n_poses, 1, 1))
    match = rf"{n_poses:,} poses x {MESH.n_faces:,} faces to fit in .* GiB.*; \w+ fewer poses"
    peak = peak_of(lambda: call(poses), ResourceError, match)
    assert peak < POOR / 2


def test_small_results_are_not_held_against_the_machine(monkeypatch):
    monkeypatch.setattr(arguments, "free_memory", lambda: 0)
    ask(OPENERS["cpu"](MESH, CAMERA))


MEMINFO = "MemTotal: 100 kB\nMemAvailable: 60 kB\nHugePages_Total: 0\nSwapFree: 10 kB\n"
WHOLE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize(
    ("meminfo", "limits", "free"),
    [
        *((MEMINFO, limits, 70 * 1024) for limits in ((), ("max\n", None), ("999999999\n",))),
        *((MEMINFO, limits, 5000) for limits in (("5000\n",), (None, "5000\n"))),
        # All memory where the system does not say.
        *((text, (), WHOLE) for text in (None, "", "MemTotal: 100 kB\n", "MemAvailable: much\n")),
    ],
)
def test_free_memory_is_what_is_left_within_the_container(
    monkeypatch, tmp_path, meminfo, limits, free
):
    files = [tmp_path / f"{number}" for number in range(len(limits) + 1)]
    for file, text in zip(files, (meminfo, *limits), strict=True):
        if text is not None:
            file.write_text(text)
    monkeypatch.setattr(arguments, "_MEMINFO", files[0])
    monkeypatch.setattr(arguments, "_CONTAINER_LIMITS", files[1:])
    assert arguments.free_memory() == free


HELD_AT_EXIT = """
import threading, time
import rastercov as rc
mesh, camera = rc.shapes.by_name("box"), rc.Camera(width=32, height=24, fx=30, fy=30)
measured = threading.Event()
def hold():
    observer = rc.open_observer(mesh, camera, method="sampled:cpu", threads=1)
    observer.observe(rc.look_at((0, 0, 3), (0, 0, 0)))
    measured.set()
    time.sleep(1000)
threading.Thread(target=hold, daemon=True).start()
assert measured.wait(100)
"""


def test_an_observer_of_a_daemon_thread_is_no_leak_when_python_ends():
    result = python("-X", "dev", "-c", HELD_AT_EXIT)
    assert (result.returncode, result.stderr) == (0, "")


def test_the_number_of_threads_is_that_of_the_option_and_results_stay(
    tmp_path, capsys, monkeypatch
):
    """Of a process and those that it starts; refused in one line."""
    from commands import call, write_part

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(THREADS, "3")
    assert thread_count(None) == 3
    assert thread_count(2) == 2
    write_part("part.obj")
    line = "evaluate part.obj -c 'width = 64, height = 48, hfov_deg = 60' -p sphere:4 --json"
    answers = []
    for n in (1, 5):
        code, out, _ = call(capsys, f"{line} --threads {n} -o out{n}")
        assert (code, thread_count(None)) == (0, n)
        answer = json.loads(out)
        answers.append([answer[name] for name in ("covered", "covered_area", "dead_zones")])
    assert answers[0] == answers[1]
    code, _, err = call(capsys, f"{line} --threads 0 -o none")
    assert (code, err.count("\n")) == (2, 1)
    assert "--threads" in err
