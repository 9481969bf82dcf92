"""Drag of one camera with the mouse, in Chromium: milliseconds of a picture and of new figures.

python benchmarks/mouse_drag.py [--moves 40] [--json]

The page is that of `rastercov view`. The mouse takes the upward arrow of the first camera and moves
down by a pixel, until the page has drawn that. Rows are the times from a move to its picture, and
from one change of the coverage to the next; those at best are of a machine that has nothing else to
do. Chromium draws by SwiftShader, on the CPU.
"""

import statistics
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/support"))

from browser import Program, Tab, chromium
from live_page import scenes
from rows import Report, arguments

import rastercov as rc
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.page.session import Session

SIZE = {"width": 1280, "height": 800}
TIP = 84
"""Pixels from a camera to the tip of its arrow."""
WATCH = """() => {
    window.drawn = [];
    window.figures = [];
    rastercov.session.on("frame", () => figures.push(performance.now()));
    const canvas = document.querySelector("canvas.scene");
    canvas.addEventListener("pointermove", (event) => {
        requestAnimationFrame(() => requestAnimationFrame(() => {
            drawn.push(performance.now() - event.timeStamp);
        }));
    });
}"""


def measured(tab: Tab, moves: int) -> tuple[list[float], list[float]]:
    """Milliseconds from each move to its picture, and between changes of the coverage."""
    for station in tab.state()["stations"]:  # the first whose arrow no panel hides
        tab.js("id => rastercov.session.choose(id)", station["id"])
        eye = np.reshape(station["pose"], (4, 4))[:3, 3]
        pixel = tab.js("point => rastercov.view.look().pixelAt(point)", eye.tolist())
        x, y = tab.place(np.add(eye, (0, 0, TIP * pixel)))
        if tab.js("([x, y]) => document.elementFromPoint(x, y)?.matches('canvas.scene')", [x, y]):
            break
    tab.js(WATCH)
    mouse = tab.page.mouse
    mouse.move(x, y)
    mouse.down()
    for step in range(moves):
        before = tab.js("drawn.length")
        mouse.move(x, y + step + 1)
        tab.page.wait_for_function("before => drawn.length > before", arg=before)
    mouse.up()
    tab.idle()
    moved = np.reshape(tab.js("rastercov.session.station().pose"), (4, 4))[:3, 3] - eye
    if not abs(moved[2]) > 0:
        raise RuntimeError(f"expected a drag to move the camera, got {moved}; see the page")
    return tab.js("drawn"), np.diff(tab.js("figures")).tolist()


def main() -> None:
    """Rows of each scene."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--moves", type=int, default=40, help="moves of the mouse")
    args = parser.parse_args()
    report = Report(prints=not args.json)
    with chromium() as browser:
        for name, mesh, cameras, placed in scenes()[:3]:
            rig = cameras if isinstance(cameras, rc.Rig) else rc.Rig([cameras], ["camera"])
            state = RigState.of(rig, placed, task=rc.Task(max_incidence_deg=80))
            program = Program(Session(Scene(name, mesh, state)))
            program.start()
            context = browser.new_context(viewport=SIZE, bypass_csp=True, reduced_motion="reduce")
            drawn, figures = measured(Tab(context, program.url), args.moves)
            report.add(f"{name}: picture of a move", statistics.median(drawn), "ms")
            report.add(f"{name}: picture of a move, at best", min(drawn), "ms")
            report.add(f"{name}: picture of a move, worst", max(drawn), "ms")
            report.add(f"{name}: between figures", statistics.median(figures), "ms")
            report.add(f"{name}: between figures, at best", min(figures), "ms")
            context.close()
            program.stop()
            program.session.close()
    report.finish(args.json)


if __name__ == "__main__":
    main()
