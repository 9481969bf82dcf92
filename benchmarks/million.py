"""A million poses at 128 x 128 in one process: flat memory, and the same answer after two kills.

First all poses are counted in one process on the CPU, in batches, while resident memory is watched.
Then a second process does it again in parts that it leaves in a folder; it is interrupted (SIGINT)
after some of them, one that continues is killed (SIGKILL), and a third ends the work, with another
number of threads. What both found must have the same hash: a fingerprint of each pose's counts,
its sum over faces of visible samples times a random number, and the samples of each face over all.

Last, a visibility matrix (`rastercov.placement.matrix`), with a hundredth of the poses and a
part of 1,970 faces, is built at once, and again in a folder by a process that is killed.
"""

import hashlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rows import Report, arguments, resident_mib

import rastercov as rc
from rastercov.base.interrupts import hold_interrupts
from rastercov.core.mesh import shapes
from rastercov.placement.matrix import VisibilityMatrix, build_matrix

CAMERA = rc.Camera(width=128, height=128, fx=154, fy=154)
BATCH = 500
PARTS = 50
STOPS = ((0.3, signal.SIGINT), (0.6, signal.SIGKILL))
"""Share of the parts after which a process is ended, and the signal that ends it."""
WARM_UP = 0.05


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--count-in", type=Path, help="(what a piece is told)")
    parser.add_argument("--matrix-in", type=Path, help="(the same)")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    if args.count_in:
        _count_in(args.count_in, args.poses, args.threads)
    elif args.matrix_in:
        _matrix(args.poses, args.matrix_in)
    else:
        report = Report()
        whole = _at_once(report, args.poses, args.threads)
        _in_pieces(report, args.poses, whole)
        _matrix_in_pieces(report, max(200, args.poses // 100))
        report.finish(args.json)


# --- counts ---------------------------------------------------------------------------------------


class Job:
    """Poses around a torus of 10,000 faces, and what is kept of their counts."""

    def __init__(self, n_poses: int, threads: int) -> None:
        self.mesh, self.n_poses = shapes.torus(), n_poses
        self.poses = rc.sphere_of_poses((0, 0, 0), 4.2, n_poses)
        self.weights = np.random.default_rng(1).integers(1, 1 << 62, self.mesh.n_faces)
        self.rasterizer = rc.open_rasterizer(self.mesh, CAMERA, "cpu", threads=threads)

    def parts(self) -> list[slice]:
        """Consecutive poses, in at most `PARTS` parts."""
        step = -(-self.n_poses // PARTS)
        return [slice(at, min(at + step, self.n_poses)) for at in range(0, self.n_poses, step)]

    def batches(self, part: slice) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Fingerprint of each pose, modulo 2^64, and samples of each face, batch by batch."""
        for start in range(part.start, part.stop, BATCH):
            poses = self.poses[start : min(start + BATCH, part.stop)]
            visible = self.rasterizer.count(poses, drawn=False).visible
            yield visible @ self.weights, visible.sum(axis=0)


def _hash(fingerprints: np.ndarray, totals: np.ndarray) -> str:
    return hashlib.sha256(fingerprints.tobytes() + totals.tobytes()).hexdigest()


def _at_once(report: Report, n_poses: int, threads: int) -> str:
    job = Job(n_poses, threads)
    fingerprints = np.full(n_poses, -1, np.int64)  # in memory from the start
    totals = np.zeros(job.mesh.n_faces, np.int64)
    resident, done = [], 0
    started = time.perf_counter()
    for part in job.parts():
        for fingerprint, total in job.batches(part):
            fingerprints[done : done + len(fingerprint)] = fingerprint
            totals += total
            done += len(fingerprint)
            resident.append(resident_mib())
    seconds = time.perf_counter() - started
    level = resident[int(WARM_UP * len(resident)) :]
    tenth = max(1, len(level) // 10)
    drift = np.median(level[-tenth:]) - np.median(level[:tenth])
    report.add("poses in one process", n_poses, "poses")
    report.add("poses a second, hash included", n_poses / seconds, "poses/s")
    report.add("resident memory at the end", resident[-1], "MiB")
    report.add("drift: last tenth over first, medians", drift, "MiB", at_most=5, aim=1)
    report.add("highest over lowest after the warm-up", np.ptp(level), "MiB")
    return _hash(fingerprints, totals)


def _in_pieces(report: Report, n_poses: int, expected: str) -> None:
    n_parts = len(Job(n_poses, 1).parts())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command = [sys.executable, __file__, "--poses", str(n_poses), "--count-in", name]
        for share, how in STOPS:
            _run_until(command, folder, "part-*.npz", share * n_parts, how)
            done = len(list(folder.glob("part-*.npz")))
            report.add(f"parts of {n_parts} done when ended by {how.name}", done, "parts")
            report.check(f"{how.name} came before the end", done < n_parts)
        subprocess.run([*command, "--threads", "1"], check=True)
        values = [np.load(path) for path in sorted(folder.glob("part-*.npz"))]
        report.check("all parts are there", len(values) == n_parts)
        totals = np.sum([part["totals"] for part in values], axis=0)
        pieces = _hash(np.concatenate([part["fingerprints"] for part in values]), totals)
    report.check("in pieces: the same hash as at once", pieces == expected)


def _count_in(folder: Path, n_poses: int, threads: int) -> None:
    """Count the parts that are not in the folder; each appears under its name when it is whole."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's "&" has it ignored
    job = Job(n_poses, threads)
    for number, part in enumerate(job.parts()):
        path = folder / f"part-{number:03d}.npz"
        if path.exists():
            continue
        items = list(job.batches(part))  # an interrupt ends it here
        fingerprints, totals = zip(*items, strict=True)
        with hold_interrupts():
            unfinished = folder / f".{path.name}"
            with unfinished.open("wb") as file:
                np.savez(
                    file, fingerprints=np.concatenate(fingerprints), totals=np.sum(totals, axis=0)
                )
            unfinished.rename(path)


# --- a visibility matrix --------------------------------------------------------------------------


def _matrix(n_poses: int, folder: Path | None) -> VisibilityMatrix:
    mesh = shapes.aeroplane()
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), 38.0, n_poses)
    return build_matrix((mesh, CAMERA), poses, folder=folder, poses_a_shard=-(-n_poses // 20))


def _matrix_in_pieces(report: Report, n_poses: int) -> None:
    whole = _matrix(n_poses, None)
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, __file__, "--poses", str(n_poses), "--matrix-in", name]
        _run_until(command, Path(name), "pairs/*.npz", 8, signal.SIGKILL)
        done = len(list(Path(name).glob("pairs/*.npz")))
        pieces = _matrix(n_poses, Path(name))
        names = ("indptr", "face", "coverage")
        same = all(np.array_equal(getattr(whole, a), getattr(pieces, a)) for a in names)
    report.add("matrix: poses", n_poses, "poses")
    report.add("matrix: shards done when ended by SIGKILL", done, "of 20")
    report.check("matrix: SIGKILL came before the end", done < 20)
    report.check("matrix in pieces: bit for bit the same as at once", same)


# --- processes ------------------------------------------------------------------------------------


def _run_until(command, folder: Path, pattern: str, n_files: float, how: signal.Signals) -> None:
    """Run a command and end it at a number of files; it may be done by then."""
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while process.poll() is None and len(list(folder.glob(pattern))) < n_files:
        time.sleep(0.01)
    if process.poll() is None:
        process.send_signal(how)
    process.wait()


if __name__ == "__main__":
    main()
