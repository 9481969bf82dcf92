"""Shards made by workers that are killed, and from folders that are lost."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from types import SimpleNamespace

import cluster_job
import dask
import pytest

from rastercov.base.errors import ConfigError, PoolLostError, RastercovError
from rastercov.cluster.scheduler import OfScheduler
from rastercov.shards import Workers, make_shards
from rastercov.shards import run as run_module
from rastercov.shards.store import store
from rastercov.shards.work import work

pytestmark = pytest.mark.slow


class Watch:
    """Shards made and lines said; `act` is called after some of the shards."""

    def __init__(self, after=None, act=None):
        self.made, self.lines, self.after, self.act = [], [], after, act

    def done(self, made):
        self.made.append(made)
        if len(self.made) == self.after:
            self.act(made)

    @property
    def numbers(self):
        return sorted(made.number for made in self.made)


def run(job, watch, workers=None):
    make_shards(workers or Workers(2), job, watch.done, watch.lines.append)
    assert not job.missing()


def kill(made):
    os.kill(int(made.worker.rpartition(":")[2]), signal.SIGKILL)


def shards(folder):
    return {path.name: json.loads(path.read_text()) for path in (folder / "shards").iterdir()}


def test_all_shards_are_made_once_by_both_workers(tmp_path):
    job = cluster_job.prepared(tmp_path / "job", 12, seconds=0.1)
    watch = Watch()
    run(job, watch)
    assert watch.numbers == list(range(12))
    assert len({made.worker for made in watch.made}) == 2
    assert not watch.lines


def test_a_killed_worker_costs_a_shard_at_most(tmp_path):
    job = cluster_job.prepared(tmp_path / "job", 12, seconds=0.2)
    watch = Watch(after=4, act=kill)
    run(job, watch)
    assert watch.numbers == list(range(12))
    assert all(len(poses) == 8 for poses in shards(tmp_path / "job").values())
    assert not job.quarantined()


def test_poses_that_kill_are_found_and_left_out(tmp_path):
    folder = tmp_path / "job"
    job = cluster_job.prepared(folder, 6, poses=4, kill=[5, 6, 19])
    watch = Watch()
    run(job, watch)
    assert watch.numbers == list(range(6))
    table = {number: left for number in range(6) if (left := job.missing_rows(number))}
    assert {n: set(poses) for n, poses in table.items()} == {1: {1, 2}, 4: {3}}
    assert set(table[1].values()) == {"was killed by SIGKILL"}
    assert {made.number: made.quarantined for made in watch.made if made.quarantined} == table
    left = {name: set(range(4)) - set(poses) for name, poses in shards(folder).items()}
    assert {int(name): poses for name, poses in left.items() if poses} == {1: {1, 2}, 4: {3}}
    assert any("worker process ended" in line for line in watch.lines)


def test_a_lost_folder_is_waited_for(tmp_path):
    folder, aside = tmp_path / "job", tmp_path / "aside"
    job = cluster_job.prepared(folder, 12, seconds=0.2)

    def lose(made):
        folder.rename(aside)
        threading.Timer(2.0, aside.rename, [folder]).start()

    watch = Watch(after=4, act=lose)
    run(job, watch)
    assert watch.numbers == list(range(12))
    assert any("expected the folder on worker" in line for line in watch.lines)


def test_a_folder_that_stays_lost_ends_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(run_module, "FOLDER_PATIENCE", 1.0)
    folder = tmp_path / "job"
    job = cluster_job.prepared(folder, 12, seconds=0.2)
    watch = Watch(after=2, act=lambda made: folder.rename(tmp_path / "aside"))
    with pytest.raises(ConfigError, match="under the same path on every worker"):
        run(job, watch)


@pytest.mark.parametrize(
    ("what", "error", "words"),
    [("config", ConfigError, "shard 5 is not to be had"),
     ("disk", ConfigError, "job/shards/5: expected free disk space, got a full disk; free some"),
     ("other", RastercovError, "expected a result of a worker, got ZeroDivisionError: a defect")],
)  # fmt: skip
def test_an_error_ends_the_run_in_one_line_and_shards_stay(tmp_path, what, error, words):
    job = cluster_job.prepared(tmp_path / "job", 8, **{"raise": {"5": what}})
    with pytest.raises(error, match=words):
        run(job, watch := Watch())
    assert 5 in job.missing()
    assert not set(job.missing()) & set(watch.numbers)


def test_another_version_of_rastercov_is_refused(tmp_path):
    job = cluster_job.prepared(tmp_path / "job", 1)
    with pytest.raises(
        ConfigError, match=r"expected rastercov 0\.0\.1 of this run, got .*; update it"
    ):
        run(replace(job, version="0.0.1"), Watch())


def test_an_address_without_a_scheduler_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("rastercov.cluster.scheduler.CONNECT_SECONDS", 1)
    job = cluster_job.prepared(tmp_path / "job", 1)
    with pytest.raises(ConfigError, match=r"expected a scheduler, got .* start one with"):
        run(job, Watch(), Workers(scheduler="tcp://127.0.0.1:9"))


def test_tls_without_certificates_is_refused(tmp_path):
    job = cluster_job.prepared(tmp_path / "job", 1)
    with pytest.raises(ConfigError, match="expected TLS certificates"):
        run(job, Watch(), Workers(scheduler="tls://127.0.0.1:9"))


SETTINGS = {
    "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
}


AGAIN = ["sh", "-c", 'while :; do "$@"; done', "again"]
"""Starts a program again whenever it ends, as a service does."""


@contextmanager
def process(*words, by=()):
    """A program of Dask that lasts as long as the block, and so do its own processes."""
    own = ["--host", "127.0.0.1", "--no-dashboard"]
    started = subprocess.Popen(
        [*by, sys.executable, "-m", "dask", *map(str, words), *own],
        env=os.environ | cluster_job.ENVIRONMENT | SETTINGS,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield started
    finally:
        with suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)
        started.wait()


def scheduler(port, protocol="tcp"):
    return process("scheduler", "--port", port, "--no-show", "--protocol", protocol)


def worker(port, folder, protocol="tcp", by=()):
    own = "--nthreads", 1, "--memory-limit", 0, "--local-directory", folder
    return process("worker", f"{protocol}://127.0.0.1:{port}", *own, by=by)


@pytest.fixture
def port():
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def test_a_lost_scheduler_is_waited_for(tmp_path, port):
    job = cluster_job.prepared(tmp_path / "job", 16, seconds=0.3)
    with ExitStack() as programs:
        first = programs.enter_context(scheduler(port))
        programs.enter_context(worker(port, tmp_path / "w"))

        def exchange(made):
            first.kill()
            first.wait()
            programs.enter_context(scheduler(port))
            programs.enter_context(worker(port, tmp_path / "v"))

        watch = Watch(after=4, act=exchange)
        run(job, watch, Workers(scheduler=f"tcp://127.0.0.1:{port}"))
        assert any("lost the connection" in line for line in watch.lines)
    assert len(shards(tmp_path / "job")) == 16
    # A shard that the workers finished while nobody listened is not made again, but counted.
    assert watch.numbers == list(range(16))


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_names_the_file_that_was_written(tmp_path, monkeypatch, call):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, call, full)
    with pytest.raises(
        OSError, match=r"No space left on device: .*/sha256/shard-5\.sha256"
    ) as error:
        store(tmp_path, "shard-5", b"content")
    assert error.value.errno == errno.ENOSPC
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_an_open_scheduler_is_used_with_one_line_on_its_risk(tmp_path, port):
    job = cluster_job.prepared(tmp_path / "job", 4)
    watch = Watch()
    with scheduler(port), worker(port, tmp_path / "w"):
        run(job, watch, Workers(scheduler=f"tcp://127.0.0.1:{port}"))
    (line,) = watch.lines
    assert "every user of this machine can run programs as you" in line


class NoWorkers:
    """Workers whose client is never used."""

    scheduler = "nowhere"
    _address = _risk = ""

    def pool(self, device):
        return nullcontext()


def test_a_shard_whose_report_was_lost_is_counted_once(tmp_path, monkeypatch):
    job = cluster_job.prepared(tmp_path / "job", 6, poses=4)

    def make(self, numbers):
        for number in numbers:
            made = work(job, number)
            if number == 2:
                job.note(number, {3: "was killed by SIGKILL"})
                raise PoolLostError
            self.done(made)
            self.done(made)

    monkeypatch.setattr(run_module._Run, "make", make)
    watch = Watch()
    run(job, watch, NoWorkers())
    assert watch.numbers == list(range(6))
    lost = [made for made in watch.made if made.worker == run_module.LOST]
    assert [(made.number, made.n_poses, made.quarantined) for made in lost] == [
        (2, 4, {3: "was killed by SIGKILL"})
    ]


class Client:
    """Scheduler that makes each shard at once, and loses the first result."""

    status, is_lost = "running", False

    def nthreads(self):
        return {"own": 1}

    def submit(self, function, *arguments, pure):
        self.made = function(*arguments)
        future = SimpleNamespace(status="finished", result=self.result)
        future.add_done_callback = lambda call: call(future)
        return future

    def result(self):
        if not self.is_lost:
            self.is_lost = True
            raise CancelledError
        return self.made


def test_a_result_that_a_lost_scheduler_did_not_send_is_asked_for_again(tmp_path, monkeypatch):
    client = Client()
    monkeypatch.setattr(NoWorkers, "pool", lambda self, device: nullcontext(OfScheduler(client)))
    watch = Watch()
    run(cluster_job.prepared(tmp_path / "job", 1), watch, NoWorkers())
    assert watch.numbers == [0]
    assert [line for line in watch.lines if "lost the connection" in line]


def test_a_scheduler_without_workers_ends_the_run(tmp_path, port, monkeypatch):
    monkeypatch.setattr(run_module, "PATIENCE", 1.0)
    job = cluster_job.prepared(tmp_path / "job", 2)
    with scheduler(port), pytest.raises(ConfigError, match="expected workers, got none"):
        run(job, Watch(), Workers(scheduler=f"tcp://127.0.0.1:{port}"))


def test_a_killed_head_leaves_whole_shards_and_no_workers(tmp_path):
    folder = tmp_path / "job"
    job = cluster_job.prepared(folder, 12, seconds=0.4)
    environment = os.environ | cluster_job.ENVIRONMENT
    head = subprocess.Popen(cluster_job.head(folder, 12), env=environment)
    while len(job.missing()) > 8:
        time.sleep(0.05)
    head.kill()
    head.wait()
    time.sleep(1.5)
    done = set(range(12)) - set(job.missing())
    time.sleep(1.0)
    assert done == set(range(12)) - set(job.missing())  # its workers ended with it
    times = {n: (folder / job.name(n)).stat().st_mtime_ns for n in done}
    watch = Watch()
    run(job, watch)
    assert watch.numbers == sorted(set(range(12)) - done)
    assert times == {n: (folder / job.name(n)).stat().st_mtime_ns for n in done}


def test_an_error_of_one_process_is_that_of_the_run(tmp_path):
    job = cluster_job.prepared(tmp_path / "job", 1, kill=[3], **{"raise": {"0": "config"}})
    with pytest.raises(ConfigError, match="shard 5 is not to be had"):
        run(job, Watch())
    assert job.missing()


AUTHORITY = "req -x509 -newkey rsa:2048 -nodes -keyout ca.key -out ca.pem -days 2 -subj /CN=own"
REQUEST = "req -newkey rsa:2048 -nodes -keyout key.pem -out request.pem -subj /CN=cluster"
SIGN = "x509 -req -in request.pem -CA ca.pem -CAkey ca.key -CAcreateserial -out cert.pem -days 2"


@pytest.fixture
def certificates(tmp_path, monkeypatch):
    """Dask's configuration of TLS, as docs/scale.md has it, of this process and those it starts."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl")
    for line in (AUTHORITY, REQUEST, SIGN):
        subprocess.run(["openssl", *line.split()], cwd=tmp_path, check=True, capture_output=True)
    pair = {"cert": str(tmp_path / "cert.pem"), "key": str(tmp_path / "key.pem")}
    tls = {"ca-file": str(tmp_path / "ca.pem"), "scheduler": pair, "worker": pair, "client": pair}
    comm = {"require-encryption": True, "tls": tls}
    (tmp_path / "dask").mkdir()
    (tmp_path / "dask/tls.yaml").write_text(json.dumps({"distributed": {"comm": comm}}))
    monkeypatch.setenv("DASK_CONFIG", str(tmp_path / "dask"))
    own = {"ca-file": tls["ca-file"], "client.cert": pair["cert"], "client.key": pair["key"]}
    with dask.config.set({f"distributed.comm.tls.{name}": path for name, path in own.items()}):
        yield


def test_a_scheduler_with_certificates_is_used_without_a_line_on_its_risk(
    tmp_path, port, certificates
):
    job = cluster_job.prepared(tmp_path / "job", 4)
    watch = Watch()
    # With OpenSSL 3.4 or later, connections of Dask break now and then, which ends a worker.
    with scheduler(port, "tls"), worker(port, tmp_path / "w", "tls", by=AGAIN):
        run(job, watch, Workers(scheduler=f"tls://127.0.0.1:{port}"))
    assert watch.numbers == list(range(4))
    assert not [line for line in watch.lines if "run programs as you" in line]
