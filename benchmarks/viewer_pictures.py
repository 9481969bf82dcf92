"""Pictures of the viewer for docs/viewer.md, taken in Chromium.

    python benchmarks/viewer_pictures.py [--out docs]

A part with three cameras and its largest dead zone, a room with the cameras of its plan and a face
that they do not cover, and 120 images around a part through a distorting lens.
Needs Debian's package `chromium` and Playwright, which drives it.
"""

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parent.parent
LENS = (
    'width = 1280, height = 960, fx = 1100, fy = 1100, model = "opencv", '
    "distortion = [-0.25, 0.05, 0.0, 0.0]"
)
TURN_TO_ZONE = """async () => {
  const { camera } = rastercov.view;
  const [zone] = await rastercov.session.server.zones();
  camera.heading = camera.placeBefore(zone.centre, zone.normal, 1).heading;
}"""
PICK_IN_ZONE = """async () => {
  const [zone] = await rastercov.session.server.zones();
  const places = zone.faces.map((face) => rastercov.view.corners(face)[0]).map(rastercov.screenOf);
  const picks = places.map(([x, y]) => rastercov.view.pick(x + 2, y));
  rastercov.tools.pickFace(picks.find((found) => found && zone.faces.includes(found.face)));
  rastercov.tools.zone = { faces: zone.faces, revision: rastercov.state().revision };
}"""
PICK_ON_CRATES = """async () => {
  const zones = await rastercov.session.server.zones();
  const crates = zones.filter((zone) => zone.group === "crates");
  const faces = new Set(crates.flatMap((zone) => zone.faces));
  const middle = (face) => {
    const [a, b, c] = rastercov.view.corners(face);
    return a.map((value, axis) => (value + b[axis] + c[axis]) / 3);
  };
  for (const face of faces) {
    const found = rastercov.view.pick(...rastercov.screenOf(middle(face)));
    if (!found || found.face !== face) continue;
    const { words } = await rastercov.session.server.why(face);
    if (words.includes("not covered")) return rastercov.tools.pickFace(found);
  }
}"""
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs")
    out = parser.parse_args().out
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        sys.exit("error: there is no Chromium; install Debian's package chromium")
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=browser, args=FLAGS)
        # The page's policy forbids the scripts by which Playwright waits.
        context = opened.new_context(bypass_csp=True, viewport={"width": 1440, "height": 860})
        page = context.new_page()
        part = ["teapot-12", "--camera", "khepra", "--poses", "sphere:3"]
        picture(page, out / "viewer_part.png", part, of_a_part)
        room = [str(ROOT / "examples" / "plans" / "watch_room.toml")]
        picture(page, out / "viewer_room.png", room, of_a_room)
        images = ["aeroplane", "--camera", LENS, "--poses", "sphere:120"]
        picture(page, out / "viewer_images.png", images, of_images)
        opened.close()


def picture(page, path, arguments, prepare):
    """Open a scene in the page, prepare it, and take its picture."""
    words = [sys.executable, "-m", "rastercov", "view", *arguments, "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as program:
        try:
            url = next(re.search(r"https?://\S+", line) for line in program.stdout if "//" in line)
            page.goto(url[0])
            ready = "window.rastercov?.session.figures !== undefined"
            page.wait_for_function(ready, timeout=300_000)  # the first run compiles
            prepare(page)
            page.evaluate("rastercov.whenIdle()")
            page.wait_for_timeout(6_000)  # messages leave by themselves
            page.screenshot(path=path)
            print(path)
        finally:
            program.terminate()


def of_a_part(page):
    page.get_by_text("Dead zones").click()
    page.locator(".zone").first.wait_for()
    page.evaluate(TURN_TO_ZONE)
    page.get_by_role("button", name="Fit").click()
    page.evaluate("rastercov.whenIdle()")
    page.evaluate(PICK_IN_ZONE)
    page.get_by_text("Centre the view on the face").wait_for()


def of_a_room(page):
    page.get_by_role("button", name="Place", exact=True).click()
    page.wait_for_function("rastercov.state().stations.length", timeout=300_000)
    page.evaluate("rastercov.whenIdle()")
    page.evaluate(PICK_ON_CRATES)
    page.get_by_text("Centre the view on the face").wait_for()


def of_images(page):
    choose(page, "density")


def choose(page, mode):
    """Colour the faces by a mode."""
    page.locator("select").filter(has=page.locator(f'option[value="{mode}"]')).first.select_option(
        mode
    )


if __name__ == "__main__":
    main()
