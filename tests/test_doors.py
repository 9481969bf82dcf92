"""Doors to other users and to others' files: ports and pipes of a run, modules in its folder."""

import os
import subprocess
import sys

import cluster_job
import pytest
from hostile_folder import COMMANDS, command, executed, fill
from nightly import nightly
from open_doors import listening

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig, Views
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.formats.cameras import write_views
from rastercov.shards.process import Process


def test_an_open_door_is_found():
    import socket

    with socket.socket() as tcp, socket.socket(socket.AF_UNIX) as unix:
        assert listening([os.getpid()]) == []
        tcp.bind(("127.0.0.1", 0))
        tcp.listen()
        unix.bind("\0rastercov-test-door")
        unix.listen()
        assert len(listening([os.getpid()])) == 2


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    """A folder of modules that must not be executed, and what the commands read."""
    folder = tmp_path_factory.mktemp("hostile")
    fill(folder)
    poses = Poses.of(sphere_of_poses((0, 0, 0), 4.0, 4))
    names = tuple(f"{row}.jpg" for row in range(4))
    views = Views(Rig([Camera(width=96, height=72, fx=90, fy=90)], ["one"]), poses, names)
    write_views(folder / "model", views)
    return folder


def test_a_module_in_the_folder_would_be_executed(hostile):
    """By Python's own `-c`: the modules are found where the path leads to them."""
    subprocess.run([sys.executable, "-c", "import inspect"], cwd=hostile, check=False)
    assert executed(hostile)
    (hostile / "executed.txt").unlink()


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [pytest.param(each, marks=nightly if "markers" in each else ()) for each in COMMANDS],
)
def test_a_file_in_the_folder_is_not_executed(hostile, line):
    done = command(hostile, line.split())
    assert executed(hostile) == []
    is_refused = "part.step" in line
    assert done.returncode in ((2,) if is_refused else (0, 1)), done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_processes_of_the_library_execute_no_file_in_the_folder(hostile, monkeypatch):
    monkeypatch.chdir(hostile)
    monkeypatch.syspath_prepend("")  # as for `python -c`
    with Process() as process:
        assert process.call(os.getcwd) == str(hostile)
        # What the libraries start there, such as those of multiprocessing.
        assert process.call(subprocess.call, [sys.executable, "-c", "import inspect"]) == 0
    assert executed(hostile) == []


@pytest.mark.slow
def test_quarantine_executes_no_file_in_the_folder(hostile, tmp_path):
    cluster_job.prepared(tmp_path / "job", 40, poses=2, kill=[3])
    environment = os.environ | cluster_job.ENVIRONMENT
    words = cluster_job.head(tmp_path / "job", 40)
    subprocess.run(words, cwd=hostile, env=environment, check=True, capture_output=True)
    assert (tmp_path / "job/quarantine/shard-1.json").exists()
    assert executed(hostile) == []
