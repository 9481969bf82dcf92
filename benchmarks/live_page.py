"""Sizes and times of pages that compute, in Chromium and Firefox, with six cameras.

python benchmarks/live_page.py
"""

import statistics
import sys
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/support"))

from browser import CHROMIUM, chromium
from firefox import FIREFOX, XVFB, firefox
from rows import Report, arguments

import rastercov as rc
from rastercov.core.camera.rig import Cameras
from rastercov.core.mesh import Mesh, shapes
from rastercov.report.live import Asked, engine, record_cause, view_of

CAMERA = rc.Camera(width=1280, height=720, fx=640, fy=640)
FINE = 3
DRAGS = 30
OPEN = "Boolean(window.rastercov && rastercov.session.figures)"
DRAG = """(async () => {
    const { session } = rastercov;
    const pose = [...session.state.stations[0].pose];
    const times = [];
    for (let k = 0; k < DRAGS; k++) {
        pose[3] += 0.003;
        const began = performance.now();
        const action = { do: "pose", station: 0, pose: [...pose] };
        const { revision } = session.server.history;
        await session.server.act({ revision, mode: "area", is_drag: true, action });
        times.push(performance.now() - began);
    }
    return times;
})()""".replace("DRAGS", str(DRAGS))
Ask = Callable[[str], Any]


def scenes() -> list[tuple[str, Mesh, Cameras, rc.Poses]]:
    """Names, meshes, cameras and poses: six cameras, and three pairs of cameras with a rule."""
    eyes = [
        (-2.5, -2, 2.4),
        (2.5, -2, 2.4),
        (2.5, 2, 2.4),
        (-2.5, 2, 2.4),
        (0, -2, 2.4),
        (0, 2, 2.4),
    ]
    inside = rc.look_at(np.array(eyes), np.tile((0, 0, 0.6), (6, 1)))
    around = rc.sphere_of_poses((0, 0, 0), 6.0, 6)
    beside = np.eye(4)
    beside[0, 3] = 0.3
    rule = rc.All(min_baseline_deg=4)
    pair = rc.Rig([CAMERA] * 2, ["left", "right"], [np.eye(4), beside], rule=rule)
    pairs = pair.poses(inside[:3])
    one, others = rc.Poses.of(inside), rc.Poses.of(around)
    return [
        ("room, 1,344 faces", shapes.room(), CAMERA, one),
        ("room, 1,344 faces, pairs", shapes.room(), pair, pairs),
        ("ring, 10,000 faces", shapes.torus(), CAMERA, others),
        ("room, 12,096 faces", shapes.room(8 * FINE), CAMERA, one),
        ("room, 12,096 faces, pairs", shapes.room(8 * FINE), pair, pairs),
        ("ring, 100,000 faces", shapes.torus(500, 100), CAMERA, others),
    ]


@contextmanager
def in_chromium():
    with chromium() as browser:
        context = browser.new_context(bypass_csp=True)
        page = context.new_page()
        page.set_default_timeout(300_000)
        yield page.goto, page.evaluate


@contextmanager
def in_firefox():
    with firefox() as page:
        yield page.goto, page.js


def measured(goto: Callable[[str], Any], ask: Ask, path: Path) -> tuple[float, list[float]]:
    """Seconds to the first figures, and ms of the steps of a drag."""
    began = perf_counter()
    goto(path.as_uri())
    while not ask(OPEN):
        pass
    first = perf_counter() - began
    return first, ask(DRAG)[2:]


def main() -> None:
    """Rows of each scene and browser."""
    args = arguments(__doc__.splitlines()[0]).parse_args()
    report = Report(prints=not args.json)
    with TemporaryDirectory() as folder:
        paths = {}
        for name, mesh, cameras, placed in scenes():
            paths[name] = Path(folder, f"{len(paths)}.html")
            names = [f"camera {row + 1}" for row in range(len(placed))]
            text = view_of(name, mesh, cameras, placed, names, Asked(rc.Task(max_incidence_deg=80)))
            paths[name].write_text(text, encoding="utf-8")
            report.add(name, paths[name].stat().st_size / 1e6, "MB")
        report.add("engine", len(engine() or b"") / 1e3, "kB")
        large = shapes.torus(1000, 500)
        why = record_cause(large, CAMERA, 6, rc.Task(), {})
        report.check(f"a page of {large.n_faces:,} faces is recorded", bool(why))
        browsers = {"Chromium": in_chromium} if CHROMIUM else {}
        if FIREFOX and XVFB:
            browsers["Firefox"] = in_firefox
        for browser, opened in browsers.items():
            with opened() as (goto, ask):
                for name, path in paths.items():
                    first, drags = measured(goto, ask, path)
                    report.add(f"{browser}, {name}: first figures", first, "s")
                    report.add(f"{browser}, {name}: drag", statistics.median(drags), "ms")
                    report.add(f"{browser}, {name}: drag at best", min(drags), "ms")
    report.finish(args.json)


if __name__ == "__main__":
    main()
