"""Pages on a phone of 390 px: nothing is wider, and controls have names of their own, in words."""

import io
from pathlib import Path

import numpy as np
import pytest
from browser import Tab
from PIL import Image

import rastercov as rc

ARM_FILE = Path(__file__).resolve().parents[2] / "examples" / "arm.urdf"
A4 = 210 - 2 * 12
"""Width of a printed page without margins, mm."""
WIDE = """() => {
  document.querySelectorAll("details:not(.scene)").forEach((each) => { each.open = true; });
  const root = document.documentElement;
  const wide = [...document.querySelectorAll("body *")].filter(
    (each) => each.getBoundingClientRect().right > root.clientWidth && each.getClientRects().length
  );
  return [root.scrollWidth, root.clientWidth, wide.map((each) => each.outerHTML.slice(0, 90))];
}"""
NAMES = """(query) => [...document.querySelectorAll(query)].map((each) => {
  const by = (each.getAttribute("aria-labelledby") || "").split(" ").filter(Boolean);
  const label = by.map((id) => document.getElementById(id).textContent).join(" ")
    || each.getAttribute("aria-label")
    || [...(each.labels || [])].map((one) => one.textContent).join(" ")
    || each.textContent || each.title;
  return label.trim().replace(/\\s+/g, " ");
})"""
ARROWS = set("←↑→↓↔↕▲▼◀▶▸▾◂▴⟲⟳↺↻⤢×✕✖")
PLAN = """
meshes = [{ path = "part_with_a_long_name_of_a_file_that_somebody_gave_to_it_once.obj" }]
task = { max_incidence_deg = 70 }
selection = { goal = "best_coverage", cameras = 3 }
[camera]
width = 96
height = 72
fx = 60
fy = 60
[[candidates]]
generator = "on_sphere"
count = 9
distances = [4.0]
"""
ARM = """
[[meshes]]
path = "cell.obj"
[camera]
width = 320
height = 256
hfov_deg = 38
[task]
resolution_of_result = 0.1
[[bodies]]
name = "arm"
urdf = "arm.urdf"
[[candidates]]
generator = "on_arm"
body = "arm/head"
mount = { translation = [0, 0, 0.06] }
of = { generator = "on_hemisphere", centre = [0.5, 0.05, 0.08], count = 12, distances = [0.38] }
[selection]
goal = "best_coverage"
cameras = 2
"""
FLIGHT = """
meshes = [{ built_in = "box", transform = { scale = 30 } }]
camera = { preset = "dji-mavic3e" }
task = { resolution_of_result = 10 }
selection = { goal = "all" }
flight = { home = [0, 0, 15], battery = 9 }
candidates = [{ generator = "strips", gsd = 0.02, front = 0.5, side = 0.3 }]
"""
HEADS = """
rule = "all"
cameras = [
  { name = "camera_with_a_long_name", width = 96, height = 72, fx = 60, fy = 60 },
  { name = "projector_with_a_long_name", width = 96, height = 72, fx = 60, fy = 60 },
]
rig_from_camera = [
  [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
  [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
]
"""
LINES = {
    "evaluated/report.html": "evaluate {mesh} -c camera.toml -p rig.json -o evaluated",
    "placed/page.html": "place plan.toml -o placed",
    "checked/check.html": "check plan.toml -p placed/poses.json -o checked --min-coverage 0.99",
    "audited/audit.html": "audit placed/poses.json {mesh} -o audited --pose-unit 1 --suggest 1",
    "sun/sun.html": "sun {mesh} screen.obj --latitude 50 --longitude 14 --day 2026-03-01 --step 60 "
    "--at-least 1.5h -o sun",
    "placed/view.html": None,
    "armed/page.html": "place arm.toml -o armed",
    "flown/page.html": "place flight.toml -o flown",
    "heads/report.html": "evaluate {mesh} -c heads.toml -p rig.json -o heads",
    "heads/view.html": None,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pages of all commands, of a part with long names."""
    folder = tmp_path_factory.mktemp("pages")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        mesh = "part_with_a_long_name_of_a_file_that_somebody_gave_to_it_once.obj"
        parts = [rc.shapes.box((1, 1, 1), centre=(2 * x, 0, 0)) for x in range(3)]
        text, n = [], 0
        for row, part in enumerate(parts):
            text.append(f"g A_window_with_a_name_that_does_not_end_before_the_line_does_{row}")
            text += ["v {} {} {}".format(*point) for point in part.vertices.tolist()]
            text += ["f {} {} {}".format(*(face + n + 1)) for face in part.faces]
            n += part.n_vertices
        Path(mesh).write_text("\n".join(text))
        rc.shapes.box((9, 0.1, 3), centre=(2, -1.5, 0)).to_trimesh().export("screen.obj")
        for name, content in (("plan", PLAN), ("arm", ARM), ("flight", FLIGHT), ("heads", HEADS)):
            Path(f"{name}.toml").write_text(content)
        joints = ARM_FILE.read_text().replace('<joint name="', '<joint name="shoulder_of_arm_')
        Path("arm.urdf").write_text(joints)
        rc.shapes.teapot(5).moved(translation=(0.5, 0.05, 0)).to_trimesh().export("cell.obj")
        Path("camera.toml").write_text("width = 96\nheight = 72\nfx = 60\nfy = 60\n")
        eyes = [(6, 3, 2), (-3, 4, 1), (2, -5, 1), (2, 5, 4)]
        rc.write_poses("rig.json", rc.look_at(eyes, np.array((2.0, 0, 0))))
        for line in filter(None, LINES.values()):
            code, out, err = _call(line.format(mesh=mesh))
            assert code in (0, 1), (line, out, err)
    return folder


def _call(line):
    """Exit code and output of a command."""
    import contextlib
    import io
    import shlex

    from rastercov.cli import command

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = command(shlex.split(line))
    return code, out.getvalue(), err.getvalue()


@pytest.fixture
def phone(browser):
    made = browser.new_context(viewport={"width": 390, "height": 844}, bypass_csp=True)
    yield made
    made.close()


@pytest.mark.slow
@pytest.mark.parametrize("page", LINES)
def test_no_page_is_wider_than_a_phone(page, folder, phone):
    """With all that is folded open."""
    opened = phone.new_page()
    opened.goto((folder / page).as_uri())
    opened.wait_for_timeout(200)
    wide, room, those = opened.evaluate(WIDE)
    assert wide <= room == 390, those


@pytest.mark.slow
def test_a_table_that_goes_on_beyond_its_room_has_a_shadow_there(folder, phone):
    """It looked as if it were cut off."""
    opened = phone.new_page()
    opened.goto((folder / "sun/sun.html").as_uri())
    table = opened.locator(".wide:visible").first

    def edge(left):
        table.evaluate("(own, left) => { own.scrollLeft = left; }", left)
        image = Image.open(io.BytesIO(table.screenshot())).convert("L")
        return image.getpixel((image.width - 1, 4)), image.getpixel((image.width // 2, 4))

    for left, is_dark in ((0, True), (9999, False)):
        last, middle = edge(left)
        assert (last < middle - 9) == is_dark, left


@pytest.mark.slow
@pytest.mark.parametrize("page", [each for each in LINES if "view" not in each])
def test_no_page_is_wider_than_its_paper(page, folder, browser):
    """The last column of a table, such as the clearance of an arm, was cut off."""
    opened = browser.new_page(viewport={"width": round(A4 / 25.4 * 96), "height": 844})
    opened.emulate_media(media="print")
    opened.goto((folder / page).as_uri())
    opened.wait_for_timeout(200)
    wide, room, those = opened.evaluate(WIDE)
    opened.close()
    assert wide <= room, those


@pytest.mark.every_day
def test_the_viewer_is_no_wider_than_a_phone_and_its_controls_have_names(phone, program):
    tab = Tab(phone, program.url)
    wide, room, those = tab.page.evaluate(WIDE)
    assert wide <= room == 390, those
    names = tab.page.evaluate(NAMES, "button, summary, [role=button], [role=tab]")
    assert names
    assert [name for name in names if not any(map(str.isalpha, name))] == []
    assert [name for name in names if ARROWS & set(name)] == []
    sliders = tab.page.evaluate(NAMES, "input[type=range]")
    assert sliders
    assert all(any(map(str.isalpha, name)) for name in sliders)
    assert len({*sliders}) == len(sliders)
    assert tab.faults == []
