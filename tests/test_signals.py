"""Signals: loops end at once, a command within a second, and a reader that leaves is no fault."""

import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from commands import ENTRY, without_progress
from nightly import amount

import rastercov as rc
from rastercov.base.interrupts import END_S
from rastercov.base.threads import share_poses
from rastercov.engine import base_interrupt

CAMERA = rc.Camera(width=160, height=128, fx=150, fy=150)
LATEST_S = 20.0
"""Seconds after which a loop does not look; its work takes minutes. No measure of speed."""
MANY = 1 << 40
"""Looks at interrupts that would take half a day."""


@pytest.fixture(autouse=True)
def interruptible():
    """A shell starts what runs in the background with interrupts ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ended_by_interrupt(work, after=0.05):
    """Whether work ends by an interrupt before LATEST_S."""
    main = threading.main_thread().ident
    timer = threading.Timer(after, signal.pthread_kill, [main, signal.SIGINT])
    began = time.monotonic()

    def interrupted():  # on a busy machine while it starts the timer
        timer.start()
        work()

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
    finally:
        timer.cancel()
    return time.monotonic() - began < LATEST_S


# --- loops ----------------------------------------------------------------------------------------


@pytest.mark.native
def test_a_loop_of_the_main_thread_looks_at_signals():
    assert ended_by_interrupt(lambda: base_interrupt.poll(MANY))


@pytest.mark.native
def test_no_call_meets_the_interrupt_of_an_earlier_one():
    assert ended_by_interrupt(lambda: base_interrupt.poll(MANY))
    base_interrupt.poll(10_000_000)  # some looks at signals


@pytest.mark.native
def test_a_stop_ends_the_loops_of_the_threads_that_follow_it_and_no_others():
    stop, ends = base_interrupt.Stop(), []
    is_followed = threading.Barrier(3)

    def follow():
        stop.enter()
        is_followed.wait()
        try:
            base_interrupt.poll(MANY)
        except KeyboardInterrupt:
            ends.append("stopped")
        finally:
            stop.leave()
        base_interrupt.poll(1000)
        ends.append("complete")

    def other():
        is_followed.wait()
        base_interrupt.poll(20_000_000)
        ends.append("other")

    threads = [threading.Thread(target=each) for each in (follow, other)]
    for thread in threads:
        thread.start()
    is_followed.wait()
    stop.set()
    for thread in threads:
        thread.join(LATEST_S)
    assert sorted(ends) == ["complete", "other", "stopped"]


@pytest.mark.native
def test_a_stop_ends_those_made_by_threads_that_follow_it():
    outer = base_interrupt.Stop()
    outer.enter()
    inner = base_interrupt.Stop()
    outer.leave()
    outer.set()
    inner.enter()
    with pytest.raises(KeyboardInterrupt):
        base_interrupt.poll(1)
    inner.leave()
    base_interrupt.poll(1)


@pytest.mark.parametrize("fault", [KeyError("own"), None])
def test_what_one_thread_raises_ends_the_loops_of_the_others(fault):
    """The fault is that of the call; an interrupt is one."""

    def looks(part):
        base_interrupt.poll(MANY)

    def fails(part):
        time.sleep(0.05)
        if fault is not None:
            raise fault
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
        base_interrupt.poll(MANY)

    for workers in ((looks, fails, looks), (fails, looks)):
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt if fault is None else KeyError):
            share_poses(8, workers)
        assert time.monotonic() - began < LATEST_S


def soup(n, size=0.08):
    """Random triangles: every one is in many others' way."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + rng.normal(0, size, (n, 3, 3))
    return rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    "options",
    [{"method": "certified", "by": "face"}, {"method": "exact", "by": "face"},
     {"method": "certified", "by": "area"}, {"method": "sampled", "by": "face"}],
    ids=lambda options: "-".join(options.values()),
)  # fmt: skip
def test_a_signal_at_any_time_ends_an_evaluation(options, threads):
    mesh, method = soup(20_000), rc.Engine(options["method"], threads=threads)
    poses = rc.sphere_of_poses((0, 0, 0), 4.0, 400)
    side = 4000 if options["method"] == "sampled" else 800
    camera = rc.Camera(width=side, height=side, fx=0.9 * side, fy=0.9 * side)
    for after in np.random.default_rng(threads).uniform(
        0.05, amount(1.5, at_night=5), amount(2, at_night=3)
    ):
        delay = delay_of(
            lambda: rc.evaluate(mesh, camera, poses, method=method, by=options["by"]), after
        )
        assert delay < LATEST_S / 4, after


def delay_of(work, after):
    """Seconds from an interrupt, `after` the start, to the end."""
    sent = []

    def send():
        sent.append(time.monotonic())
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        work()
    timer.join()
    return time.monotonic() - sent[0]


def test_an_evaluation_after_an_interrupt_is_that_without_one():
    mesh, poses = soup(2000), rc.sphere_of_poses((0, 0, 0), 4.0, 6)
    with rc.open_observer(mesh, CAMERA, "certified", threads=2) as observer:
        expected = observer.observe(poses)
        for after in (0.01, 0.03, 0.1):
            ended_by_interrupt(lambda: [observer.observe(poses) for _ in range(10_000)], after)
        observation = observer.observe(poses)
    assert observation.visible_pixels.tobytes() == expected.visible_pixels.tobytes()


# --- the command as a process ---------------------------------------------------------------------

HELD = """
import threading, time, re
from rastercov.cli import evaluate
def held(*arguments, **options):
    print("held", flush=True)
    {work}
evaluate.run_and_print = held
"""
"""A command that is at something that looks at no signal, and may hold the lock of Python."""
DEMO = "demo --shape box --poses 2"
COARSE = "from rastercov.report import panorama\npanorama.WIDTH, panorama.HEIGHT = 120, 93\n"
"""Pictures are most of a report, and are beside the point."""


def started(code, line, **options):
    return subprocess.Popen(
        [sys.executable, "-c", code + ENTRY, *line.split()], stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    "work",
    ["re.match('(a*)*b', 'a' * 40)",  # in C, without a look, with the lock
     "__import__('ctypes').CDLL(None).sleep(600) or time.sleep(600)",  # without the lock
     "[base_interrupt.poll(1 << 40) for _ in '1']"],
    ids=["holds the lock", "in a library", "in a loop of ours"],
)  # fmt: skip
def test_a_command_ends_whatever_it_is_at(tmp_path, number, code, work):
    source = HELD.format(work=work) + "from rastercov.engine import base_interrupt\n"
    with started(source, DEMO, cwd=tmp_path) as child:
        assert child.stdout.readline() == "held\n"
        time.sleep(0.2)
        child.send_signal(number)
        _, said = child.communicate(timeout=60)
    assert (child.returncode, said.splitlines()[-1:]) == (code, ["interrupted"])


AT_AN_IMPORT = """
import os, signal
import rastercov.cli

class Named:
    def __set_name__(self, owner, name):
        os.kill(os.getpid(), signal.%s)
        for _ in range(1000):
            pass

def refused():
    type("Owner", (), {"name": Named()})  # Python 3.11 makes a RuntimeError of what is raised

rastercov.cli._refuse_for_memory = refused
"""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_an_interrupt_that_an_import_makes_another_error_of_is_one(number, code):
    with started(AT_AN_IMPORT % number, "cameras") as child:
        said = child.communicate(timeout=120)[1]
    assert (child.returncode, said) == (code, "interrupted\n")


@pytest.mark.slow
def test_a_swap_that_has_begun_is_completed(tmp_path):
    """By a command that is stopped in it for longer than it has."""
    source = f"""
import time
from pathlib import Path
from rastercov.report.folder import ReportFolder
swap = ReportFolder._swap
def slow(self, journal):
    print("swap", flush=True)
    time.sleep({END_S + 1})
    swap(self, journal)
ReportFolder._swap = slow
"""
    with started(COARSE + source, DEMO, cwd=tmp_path) as child:
        assert "swap\n" in iter(child.stdout.readline, "")  # after the answer
        child.send_signal(signal.SIGTERM)
        _, said = child.communicate(timeout=60)
    assert (child.returncode, said.splitlines()[-1:]) == (143, ["interrupted"])
    assert (tmp_path / "report/summary.json").exists()
    assert not (tmp_path / "report/.rastercov-report.part").exists()


# --- pipes ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("line", [DEMO, f"{DEMO} --json", "cameras --json", "demo --help"])
def test_a_reader_that_goes_away_ends_a_command_without_a_word(tmp_path, line):
    with started(COARSE if DEMO in line else "", line, cwd=tmp_path) as child:
        child.stdout.close()
        assert without_progress(child.stderr.read()) == ""
        assert child.wait(60) == -signal.SIGPIPE


LOST = """
import os, socket
from rastercov.cli import evaluate
def lost(*arguments, **options):
    one, other = socket.socketpair()
    other.close()
    one.send(b"to no one")
evaluate.run_and_print = lost
"""


@pytest.mark.slow
def test_a_lost_connection_is_an_error_in_one_line(tmp_path):
    with started(LOST, DEMO, cwd=tmp_path) as child:
        _, said = child.communicate(timeout=60)
    assert child.returncode == 2
    assert said == "error: expected a reader, got a process or stream that ended (Broken pipe)\n"


@pytest.mark.slow
def test_connections_that_close_at_once_do_not_end_the_viewer():
    httpx = pytest.importorskip("httpx")
    viewer_doors = pytest.importorskip("viewer_doors")
    viewer = viewer_doors.Viewer("--no-browser")
    port = int(viewer.url.rsplit(":", 1)[1])
    for _ in range(500):
        with socket.create_connection(("127.0.0.1", port)) as line:
            head = f"POST /api/act HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 9\r\n\r\nx"
            line.sendall(head.encode())
    headers = {"x-rastercov-token": viewer.token}
    assert httpx.get(f"{viewer.url}/api/ping", headers=headers, timeout=30).status_code == 200
    viewer.process.send_signal(signal.SIGTERM)
    assert viewer.ended()[0] == 143
