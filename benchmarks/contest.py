"""Contestants of `throughput`: each in processes of its own, asked in turn for counts and images.

A process of its own gives each its peak of memory and keeps libraries out of each other's way.
What uses one core a process gets as many processes as the others have threads.
"""

import multiprocessing
import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from embree_packets import EmbreePackets
from peers import VTK, Embreex, Open3D, Ours, Runner

import rastercov as rc
from rastercov.base.threads import thread_count
from rastercov.core.mesh import shapes

WORKERS = 2
SOFTWARE = "surfaceless"
ONE_THREAD = {"LP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@dataclass(frozen=True)
class Contestant:
    """Something that goes from poses to counts of each face."""

    name: str
    open: Callable[..., Runner]
    n_processes: int
    packages: tuple[str, ...] = ()

    @property
    def is_peer(self) -> bool:
        """True for a peer's method."""
        return bool(self.packages)

    @property
    def label(self) -> str:
        """Its name and what it runs on."""
        if self.n_processes > 1:
            return f"{self.name}, {self.n_processes} processes"
        return self.name


def contestants(device: str) -> dict[str, Contestant]:
    """Ours and the others, by the name of an option; OpenGL on that device."""
    # Several processes on one GPU can block each other.
    n = WORKERS if device == SOFTWARE else 1
    draw = {
        f"gl-{plan}": Contestant(
            f"{name}", partial(Ours, backend="gl", device=device, plan=plan), n
        )
        for plan, name in (
            ("pipeline", "OpenGL"),
            ("compute", "compute shaders"),
        )
    }
    cpu = partial(Ours, backend="cpu", threads=WORKERS)
    cores = thread_count(None)
    all_cores = Contestant(f"CPU, {cores} threads", partial(Ours, backend="cpu"), 1)
    return {
        "cpu": Contestant(f"CPU, {WORKERS} threads", cpu, 1),
        **({"cpu-all": all_cores} if cores > WORKERS else {}),
        **draw,
        "open3d": Contestant(
            f"Open3D, {WORKERS} threads", partial(Open3D, threads=WORKERS), 1, ("open3d",)
        ),
        "embree": Contestant(
            f"Embree packets, {WORKERS} threads",
            partial(EmbreePackets, threads=WORKERS),
            1,
            ("embreex",),
        ),
        "trimesh": Contestant("trimesh + embreex", Embreex, WORKERS, ("trimesh", "embreex")),
        "vtk": Contestant("VTK", VTK, WORKERS, ("vtk",)),
    }


@dataclass(frozen=True)
class Cell:
    """A scene of about that number of faces, or a mesh file; and an image size."""

    scene: str
    n_faces: int
    width: int
    height: int
    path: str = ""

    def mesh(self) -> rc.Mesh:
        """The mesh of the file, or the built-in one of this kind with the nearest size."""
        if self.path:
            return rc.Mesh.load(self.path, drop_invalid=True)
        n = self.n_faces
        if self.scene == "closed":
            sectors = round((n / 4) ** 0.5)
            return shapes.torus(2 * sectors, sectors)
        if self.scene == "open":
            return shapes.teapot(min(128, round((n / 64) ** 0.5)))
        if self.scene == "interior":
            return shapes.room(round((n / 21) ** 0.5))
        return shapes.aeroplane(9856 if n > 4000 else 1970)

    @property
    def camera(self) -> rc.Camera:
        """Focal length 1.2 heights: the torus takes about 40 % of the image."""
        focal = 1.2 * self.height
        return rc.Camera(width=self.width, height=self.height, fx=focal, fy=focal)

    def poses(self, mesh: rc.Mesh, count: int) -> np.ndarray:
        """Poses around the part, or about the middle of the room, looking anywhere.

        A mesh of a file is seen from its diagonal away, about as the torus is.
        """
        centre = mesh.bounds.mean(axis=0)
        if self.path:
            distance = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
            return rc.sphere_of_poses(centre, distance, count)
        if self.scene != "interior":
            distance = {"closed": 4.2, "open": 0.55, "part": 38.0}[self.scene]
            return rc.sphere_of_poses(centre, distance, count)
        rng = np.random.default_rng(1)
        eyes = centre + rng.uniform(-0.3, 0.3, (count, 3)) * np.ptp(mesh.bounds, axis=0)
        return rc.look_at(eyes, eyes + rng.normal(size=(count, 3)))


class TeamError(Exception):
    """A contestant cannot open, or has died."""


class Team:
    """The processes of one contestant in one cell."""

    def __init__(self, contestant: Contestant, cell: Cell, n_poses: int) -> None:
        self.contestant, self.n_poses = contestant, n_poses
        spawn = multiprocessing.get_context("spawn")
        self.pipes, self.processes = [], []
        if contestant.n_processes > 1:
            os.environ |= ONE_THREAD  # read when the child loads the libraries
        for _ in range(contestant.n_processes):
            ours, theirs = spawn.Pipe()
            process = spawn.Process(target=_work, args=(theirs, contestant.open, cell, n_poses))
            process.start()
            theirs.close()
            self.pipes.append(ours)
            self.processes.append(process)
        for name in ONE_THREAD:
            os.environ.pop(name, None)

    def wait(self) -> str:
        """Device in use, once all its processes have opened."""
        answers = [self._answer(pipe) for pipe in self.pipes]
        for is_open, words in answers:
            if not is_open:
                raise TeamError(words)
        return answers[0][1]

    def count(self, n: int) -> tuple[float, float]:
        """Seconds to count n of the poses, evenly spread; and those that rays took to make."""
        rows = np.arange(n) * self.n_poses // n
        started = time.perf_counter()
        for k, pipe in enumerate(self.pipes):
            pipe.send(("count", rows[k :: len(self.pipes)]))
        making = max(self._answer(pipe) for pipe in self.pipes)
        return time.perf_counter() - started, making

    def ask(self, what: str, row: int) -> np.ndarray:
        """Image of a pose ("faces"), or its counts ("counts": of ours only)."""
        self.pipes[0].send((what, row))
        return self._answer(self.pipes[0])

    @staticmethod
    def _answer(pipe):
        try:
            return pipe.recv()
        except (EOFError, ConnectionResetError):
            raise TeamError("its process died") from None

    def peak(self) -> float:
        """Most memory its processes have held, MiB, since each had the mesh."""
        return sum(peak_of(process.pid) for process in self.processes)

    def close(self) -> None:
        """End its processes."""
        for pipe in self.pipes:
            with suppress(OSError):
                pipe.send(None)
        for process in self.processes:
            process.join(10)
            if process.is_alive():
                process.kill()


def _work(pipe, open_runner, cell: Cell, n_poses: int) -> None:
    mesh = cell.mesh()
    poses = cell.poses(mesh, n_poses)
    forget_peak()
    try:
        runner = open_runner(mesh, cell.camera, poses)
    except Exception as error:  # whatever a library raises where it cannot run
        pipe.send((False, f"{type(error).__name__}: {error}".splitlines()[0]))
        return
    pipe.send((True, runner.about))
    with suppress(EOFError, BrokenPipeError):  # the parent is gone
        while (message := pipe.recv()) is not None:
            what, value = message
            pipe.send(getattr(runner, what)(value))


def peak_of(pid: int | str) -> float:
    """Most memory that a process has held, MiB."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(re.search(r"VmHWM:\s*(\d+)", status)[1]) / 1024


def forget_peak() -> None:
    """Let the peak of this process begin from now."""
    with suppress(OSError):  # where the kernel does not let us, the peak of the start counts
        Path("/proc/self/clear_refs").write_text("5")
