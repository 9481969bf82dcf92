"""One object used from six threads at once, in twelve runs: every answer right, no crash.

Each part runs in a process of its own, so that a crash of Python is a figure and not the end of the
campaign. A part prints one line of JSON for each run: how many answers it had, how many of them
differ from those of a single thread in any bit, and what was raised. Runs that are missing because
the process died count as crashes.
"""

import faulthandler
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.gl import PLANS
from rastercov.placement.matrix import build_matrix
from rastercov.reference.models import scott, zhang
from rastercov.reference.models.line_of_sight import LineOfSight

RUNS, CALLERS, CALLS = 12, 6, 5
FRACTION = "visibility", "visibility_bound", "visibility_kind"
SHARED = ("certified", "exact", "sampled", "supersample", "rasteriser")
THREADS = ("1", "2", "None")
LONGEST = 300
"""Seconds that a part may take: more is a deadlock."""
CAMERA = rc.Camera(width=96, height=80, fx=85, fy=90)
Answer = list[np.ndarray[Any, Any]]


@dataclass
class Run:
    """Answers of one run: how many, how many are wrong, and the errors that were raised."""

    answers: int
    wrong: int
    errors: list[str]


def attack(report: Report, effort: float) -> None:
    """Report the figures of all parts; `effort` 1.0 is the full campaign, 0.05 a smoke run."""
    runs = max(1, round(RUNS * effort))
    parts = [("shared", kind, threads) for kind in SHARED for threads in THREADS]
    parts += [("first_use",), ("opened",), ("models",)]
    parts += [("closed", "certified"), ("closed", "rasteriser"), ("forked",)]
    for part in parts:
        _report(report, part, runs)


def _report(report: Report, part: tuple[str, ...], runs: int) -> None:
    done, crashes, _ = in_a_process(part, runs)
    name = " ".join(part)
    answers, wrong = sum(run.answers for run in done), sum(run.wrong for run in done)
    for error in sorted({error for run in done for error in run.errors}):
        print(f"{name}: {error}", file=sys.stderr)
    n_errors = sum(len(run.errors) for run in done)
    report.add(f"threads, {name}: crashes of {runs} runs", crashes, "runs", at_most=0)
    report.add(f"threads, {name}: wrong of {answers} answers", wrong, "answers", at_most=0)
    report.add(f"threads, {name}: calls that raised", n_errors, "calls", at_most=0)
    report.check(f"threads, {name}", not crashes and not wrong and not n_errors and answers > 0)


def in_a_process(
    part: tuple[str, ...], runs: int, **environment: str
) -> tuple[list[Run], int, str]:
    """Runs of a part in a process of its own, the runs that are missing, and what it said."""
    command = [sys.executable, __file__, "--part", *part, "--runs", str(runs)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST,
            env={**os.environ, **environment},
        )
        told, code, said = done.stdout, done.returncode, done.stderr
    except subprocess.TimeoutExpired as error:
        told, code, said = (error.stdout or b"").decode(), None, "it hangs"
    items = [Run(**json.loads(line)) for line in told.splitlines()]
    missing = runs - len(items) if code == 0 else max(1, runs - len(items))
    if code != 0:
        how = f"signal {signal.Signals(-code).name}" if code and code < 0 else f"exit code {code}"
        said = f"{how}: {said}"
        print(f"{' '.join(part)}: {said}", file=sys.stderr)
    return items, missing, said


# --- parts: each of them a process ----------------------------------------------------------------


def shared(runs: int, kind: str, *threads: str) -> Iterator[Run]:
    """Six threads use one observer or rasteriser, each for poses of its own; runs for each count.

    `threads` are those that a call may use itself: numbers, or "None" for one for each core.
    """
    mesh = shapes.teapot(4)
    poses = _poses(mesh, CALLERS * CALLS, seed=1)
    with _opened(kind, mesh, 1) as alone:
        expected = [_asked(alone, poses, call) for call in range(len(poses))]
    for n_threads in threads:
        for _ in range(runs):
            with _opened(kind, mesh, None if n_threads == "None" else int(n_threads)) as thing:

                def call(caller: int, thing: Any = thing) -> Iterator[bool]:
                    for at in range(CALLS * caller, CALLS * (caller + 1)):
                        yield _same(_asked(thing, poses, at), expected[at])

                yield _in_threads(call, CALLERS)


def first_use(runs: int) -> Iterator[Run]:
    """Six threads share a new mesh and camera, each for work of its own."""
    work: tuple[Callable[[rc.Mesh, rc.Camera, Any], Answer], ...] = (
        lambda mesh, camera, poses: _figures(
            rc.evaluate(mesh, camera, poses, fields=FRACTION, by="face")
        ),
        lambda mesh, camera, poses: _figures(
            rc.evaluate(mesh, camera, poses, method="exact", fields=FRACTION, by="face")
        ),
        lambda mesh, camera, poses: _counts(mesh, camera, poses),
        lambda mesh, camera, poses: [rc.evaluate(mesh, camera, poses, by="face").coverage],
        _matrix,
        lambda mesh, camera, poses: _known(mesh),
    )
    known = shapes.room(6)
    poses = _poses(known, 4, seed=2)
    expected: list[Answer] = []
    for _ in range(runs):
        mesh, camera = rc.Mesh(known.vertices, known.faces), rc.Camera(**asdict(CAMERA))
        answers: dict[int, Answer] = {}

        def call(
            caller: int,
            mesh: rc.Mesh = mesh,
            camera: rc.Camera = camera,
            answers: dict[int, Answer] = answers,
        ) -> Iterator[bool]:
            answers[caller] = work[caller](mesh, camera, poses)
            yield True

        run = _in_threads(call, len(work))
        # Only now, so that in a new process the threads are the first to need the loops.
        expected = expected or [of(known, CAMERA, poses) for of in work]
        run.wrong = sum(not _same(answer, expected[caller]) for caller, answer in answers.items())
        yield run


def opened(runs: int) -> Iterator[Run]:
    """All rasterisers are opened at once on a new mesh, each in its thread."""
    known = shapes.room(6)
    poses = _poses(known, 4, seed=5)
    options: list[dict[str, Any]] = [{"backend": "cpu", "threads": n} for n in (1, 2, None)]
    options += [{"backend": "gl", "device": "surfaceless", "plan": plan} for plan in PLANS]

    def answer(mesh: rc.Mesh, caller: int) -> Answer:
        with rc.open_rasterizer(mesh, CAMERA, **options[caller]) as rasterizer:
            return [rasterizer.count(poses).visible, rasterizer.render(poses[0]).face]

    expected = [answer(known, caller) for caller in range(len(options))]
    for _ in range(runs):
        mesh = rc.Mesh(known.vertices, known.faces)

        def call(caller: int, mesh: rc.Mesh = mesh) -> Iterator[bool]:
            yield _same(answer(mesh, caller), expected[caller])

        yield _in_threads(call, len(options))


def models(runs: int) -> Iterator[Run]:
    """Threads share one tracer of segments and one mesh, each for a model and a pose of its own."""
    known = shapes.room(6)
    poses = _poses(known, CALLERS, seed=6)

    def answer(mesh: rc.Mesh, sight: LineOfSight, caller: int) -> Answer:
        pose = poses[caller : caller + 1]
        hidden = sight.find_hidden(mesh.vertices, pose[0], 1e-3, CAMERA)
        return [
            hidden,
            zhang.coverage(mesh, CAMERA, pose),
            scott.coverage(mesh, CAMERA, pose),
        ]

    expected = [answer(known, LineOfSight(known), caller) for caller in range(CALLERS)]
    for _ in range(runs):
        mesh = rc.Mesh(known.vertices, known.faces)
        sight = LineOfSight(mesh)

        def call(caller: int, mesh: rc.Mesh = mesh, sight: LineOfSight = sight) -> Iterator[bool]:
            yield _same(answer(mesh, sight, caller), expected[caller])

        yield _in_threads(call, CALLERS)


def closed(runs: int, kind: str) -> Iterator[Run]:
    """An object closed while five threads use it ends well, or refuses in a line of its own."""
    mesh = shapes.teapot(4)
    poses = _poses(mesh, 8, seed=3)
    with _opened(kind, mesh, 1) as alone:
        expected = _asked(alone, poses, 0)
    for run in range(runs):
        thing = _opened(kind, mesh, 2)

        def call(caller: int, thing: Any = thing, wait: float = 1e-3 * run) -> Iterator[bool]:
            if caller == 0:
                time.sleep(wait)
                thing.close()
                thing.close()
                return
            end = time.monotonic() + 30
            while time.monotonic() < end:  # it is closed long before
                try:
                    yield _same(_asked(thing, poses, 0), expected)
                except rc.DeviceError as error:
                    yield "closed" in str(error)
                    return
            yield False

        yield _in_threads(call, CALLERS)


def forked(runs: int) -> Iterator[Run]:
    """Children that are forked while four threads use what they inherit."""
    mesh = shapes.teapot(4)
    poses = _poses(mesh, 4, seed=4)
    with _opened("certified", mesh, 2) as observer, _opened("rasteriser", mesh, 2) as rasteriser:
        things = observer, rasteriser
        expected = [_asked(thing, poses, 0) for thing in things]
        ended = threading.Event()

        def call(caller: int) -> None:
            while not ended.is_set():
                _asked(things[caller % 2], poses, 0)

        callers = [threading.Thread(target=call, args=(caller,)) for caller in range(4)]
        for caller in callers:
            caller.start()
        try:
            for _ in range(runs):
                child = os.fork()
                if not child:
                    signal.alarm(60)
                    fresh = rc.Mesh(mesh.vertices, mesh.faces)
                    with _opened("certified", fresh, 2) as another:
                        answers = [*(_asked(thing, poses, 0) for thing in things)]
                        answers.append(_asked(another, poses, 0))
                    right = all(map(_same, answers, (*expected, expected[0])))
                    os._exit(0 if right else 1)
                status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                yield Run(3, 0 if status == 0 else 3, [] if status >= 0 else [f"signal {-status}"])
        finally:
            ended.set()
            for caller in callers:
                caller.join()


PARTS: dict[str, Callable[..., Iterator[Run]]] = {
    "shared": shared,
    "first_use": first_use,
    "opened": opened,
    "models": models,
    "closed": closed,
    "forked": forked,
}


# --- what the parts are made of -------------------------------------------------------------------


def _in_threads(call: Callable[[int], Iterator[bool]], n: int) -> Run:
    """Number of right answers of `call(0)` ... `call(n - 1)`, in threads that begin together."""
    together = threading.Barrier(n)
    right: list[bool] = []
    errors: list[str] = []

    def run(caller: int) -> None:
        try:
            together.wait()
            right.extend(call(caller))
        except Exception as error:  # any is a figure of the campaign
            errors.append(f"{type(error).__name__}: {error}")

    threads = [threading.Thread(target=run, args=(caller,)) for caller in range(n)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return Run(len(right), right.count(False), errors)


def _poses(mesh: rc.Mesh, n: int, seed: int) -> np.ndarray[Any, Any]:
    """From outside and from inside in turn, so that neighbours differ much."""
    rng = np.random.default_rng(seed)
    centre, extent = mesh.bounds.mean(axis=0), np.ptp(mesh.bounds, axis=0)
    eyes = centre + rng.normal(size=(n, 3)) * extent
    eyes[::3] = centre + rng.uniform(-0.4, 0.4, (len(eyes[::3]), 3)) * extent
    return rc.look_at(eyes, centre + rng.uniform(-0.3, 0.3, (n, 3)) * extent)


def _opened(kind: str, mesh: rc.Mesh, threads: int | None) -> Any:
    if kind == "rasteriser":
        return rc.open_rasterizer(mesh, CAMERA, "cpu", supersample=2, threads=threads)
    if kind in ("certified", "exact"):
        return rc.open_observer(mesh, CAMERA, kind, threads=threads)
    method = "sampled:cpu@3" if kind == "supersample" else "sampled:cpu"
    return rc.open_observer(mesh, CAMERA, method, threads=threads)


def _asked(thing: Any, poses: Any, at: int) -> Answer:
    """Answer to one call: of one to four poses from `at` on, by turns; every third a picture."""
    if not hasattr(thing, "observe"):
        if at % 3 == 2:
            picture = thing.render(poses[at])
            return [picture.face, picture.depth]
        counts = thing.count(poses[at : at + 1 + at % 4])
        return [counts.visible, counts.drawn, counts.background]
    seen = thing.observe(poses[at : at + 1 + at % 4])
    return [seen.visible_pixels, seen.drawn_pixels, seen.kind, seen.area_error, seen.clipped]


def _figures(evaluation: rc.Evaluation) -> Answer:
    return [getattr(evaluation, name) for name in FRACTION]


def _counts(mesh: rc.Mesh, camera: rc.Camera, poses: Any) -> Answer:
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        return [rasterizer.count(poses).visible, rasterizer.render(poses[0]).face]


def _matrix(mesh: rc.Mesh, camera: rc.Camera, poses: Any) -> Answer:
    with tempfile.TemporaryDirectory() as folder:
        matrix = build_matrix((mesh, camera), poses, rc.Task(), Path(folder) / "matrix")
        return [matrix.face, matrix.coverage]


def _known(mesh: rc.Mesh) -> Answer:
    """Lazy properties of a mesh at first use, and of its copies with other groups."""
    other = mesh.with_groups(two_sided="all")
    facts = (mesh.is_closed, mesh.is_consistently_wound, mesh.can_cull_back_faces)
    return [other.bounds, mesh.normals, mesh.welded_faces, other.duplicate_mask, np.array(facts)]


def _same(one: Answer, other: Answer) -> bool:
    return all(map(np.array_equal, one, other))


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--effort", type=float, default=1.0, help="1 is the whole campaign")
    parser.add_argument(
        "--part", nargs="+", action="append", help="this part alone, a line of JSON for each run"
    )
    parser.add_argument("--runs", type=int, default=RUNS)
    args = parser.parse_args()
    if args.part:
        faulthandler.enable(all_threads=False)
        sys.setswitchinterval(1e-5)  # threads take turns as often as they can
        for name, *options in args.part:
            for run in PARTS[name](args.runs, *options):
                print(json.dumps(asdict(run)), flush=True)
        return
    report = Report()
    attack(report, args.effort)
    report.finish(args.json)


if __name__ == "__main__":
    main()
