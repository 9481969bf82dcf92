"""The page in a real Chromium: what it shows is what rastercov computes, and nothing is lost."""

import itertools
import math

import numpy as np
import pytest
from browser import Program, Tab
from nightly import amount
from PIL import Image
from rigs_to_view import EYES, ROOM, percent_covered, session_of
from scipy.ndimage import maximum_filter, minimum_filter

import rastercov as rc
from rastercov.core.area.zones import zones_at
from rastercov.core.coverage.task import REASONS, Reason
from rastercov.core.mesh import shapes
from rastercov.page.saving import export_page
from rastercov.report.pages import describe_camera

pytestmark = pytest.mark.slow
POSE = rc.look_at((2.6, -2.0, 2.2), (-0.5, 0.3, 0.5))[0]
PANELS = ("Object", "Cameras", "One camera", "All cameras")


def pinhole_picture(tab, pose):
    """Set the picture to that of a pinhole; the camera of the same picture."""
    height = tab.js("rastercov.view.canvas.clientHeight")
    width = tab.js("rastercov.view.canvas.clientWidth")
    camera = rc.Camera(width=width, height=height, fx=0.8 * height, fy=0.8 * height)
    field = math.degrees(2 * math.atan(0.5 / 0.8))
    matrix = [float(x) for x in np.ravel(pose)]
    tab.js("([pose, field]) => rastercov.setView(pose, field)", [matrix, field])
    tab.idle()
    return camera


def picture_and_image(tab):
    """Camera of the picture, and the face that the rasteriser draws at each of its pixels."""
    tab.js("rastercov.setOption('isCulled', false)")
    camera = pinhole_picture(tab, POSE)
    with rc.open_rasterizer(ROOM, camera, "cpu") as rasterizer:
        return camera, rasterizer.render(POSE).face


def tip_of_arrow(tab):
    """Tip of the arrow upwards of the first camera."""
    pixel = tab.js("point => rastercov.view.look().pixelAt(point)", list(EYES[0]))
    return np.add(EYES[0], (0, 0, 84 * pixel))


def is_uniform(image, reach):
    """True where all pixels up to `reach` rows and columns away show the same face."""
    low, high = (
        find(image, 2 * reach + 1, mode="constant", cval=-2)
        for find in (minimum_filter, maximum_filter)
    )
    return (low == high) & (image >= 0)


def inner_pixels(image, count, seed):
    """Pixels (x, y) whose neighbours show the same face, where no rounding decides.

    Every other one is at most three pixels from another face.
    """
    rng, inner, deep = np.random.default_rng(seed), is_uniform(image, 1), is_uniform(image, 3)
    places = [np.argwhere(mask)[:, ::-1] for mask in (inner, inner & ~deep)]
    return np.concatenate([rng.choice(each, count // 2, replace=False) for each in places]).tolist()


@pytest.mark.every_day
def test_a_slider_changes_the_summary_to_what_evaluate_says(tab):
    before = percent_covered(tab.state())
    assert tab.area_percent() == pytest.approx(before, abs=1e-9)
    tab.open("All cameras")
    tab.page.locator('input[type=range][aria-label="Max incidence"]').focus()
    view_before = tab.js("rastercov.view.camera.place()")
    tab.keys("PageDown", "PageDown", "PageDown", "ArrowLeft")
    limit = tab.state()["task"]["max_incidence_deg"]
    expected = percent_covered(tab.state(), max_incidence_deg=limit)
    assert (limit < 90, expected < before) == (True, True)
    assert tab.area_percent() == pytest.approx(expected, abs=1e-9)
    assert tab.page.locator(".summary .covered").inner_text() == f"{expected:.1f} %"
    assert tab.js("rastercov.view.camera.place()") == view_before  # the keys were the slider's


def test_undo_restores_the_bytes_and_redo_makes_them_again(tab):
    before, pose = tab.levels(), tab.pose()
    tab.press("Alt+ArrowLeft")  # turns the chosen camera
    tab.keys(*["ArrowLeft"] * 6)
    after = tab.levels()
    assert after != before
    while tab.state()["can_undo"]:
        tab.keys("Control+z")
    assert tab.levels() == before
    np.testing.assert_array_equal(tab.pose(), pose)
    while tab.state()["can_redo"]:
        tab.keys("Control+Shift+z")
    assert tab.levels() == after


@pytest.mark.every_day
def test_a_drag_of_an_arrow_moves_the_camera_along_it_and_is_one_step(tab):
    tip, eye = tip_of_arrow(tab), np.array(EYES[0])
    tab.drag(tab.place(tip), tab.place(tip - (0, 0, 0.5)))
    np.testing.assert_allclose(tab.pose()[:3, 3], eye - (0, 0, 0.5), atol=0.02)
    assert tab.area_percent() == pytest.approx(percent_covered(tab.state()), abs=1e-9)
    tab.button("Undo")
    np.testing.assert_array_equal(tab.pose()[:3, 3], eye)
    assert not tab.state()["can_undo"]


def test_a_ring_turns_the_camera_with_the_pointer(tab):
    before = tab.pose()
    tab.button("Floor plan")
    middle = np.array(tab.place(EYES[0]))
    ring = 62 * np.array((1, -1)) / math.sqrt(2)  # north-east of the camera
    tab.drag(middle + ring, middle - ring * (1, -1))  # to north-west: a quarter turn to the left
    before[:3, :3] = np.array(((0, -1, 0), (1, 0, 0), (0, 0, 1))) @ before[:3, :3]
    np.testing.assert_allclose(tab.pose()[:3, :3], before[:3, :3], atol=0.02)
    np.testing.assert_allclose(tab.pose()[:3, 3], before[:3, 3])


def test_aim_turns_the_camera_to_the_point_that_is_clicked(tab):
    point = np.array((0.4, 2.0, 0.0))
    pinhole_picture(tab, rc.look_at((0.0, 0.0, 2.6), (0.0, 1.6, 0.0))[0])
    tab.press("i")
    tab.page.mouse.click(*tab.place(point))
    tab.idle()
    away = point - EYES[0]
    np.testing.assert_allclose(tab.pose()[:3, 2], away / np.linalg.norm(away), atol=0.01)
    np.testing.assert_array_equal(tab.pose()[:3, 3], EYES[0])


def test_escape_takes_a_drag_back(tab):
    before, pose, tip = tab.levels(), tab.pose(), tip_of_arrow(tab)
    tab.drag(tab.place(tip), tab.place(tip - (0, 0, 0.9)), release=False)
    tab.idle()
    assert (tab.pose() != pose).any()
    tab.keys("Escape")
    tab.page.mouse.up()
    tab.idle()
    np.testing.assert_array_equal(tab.pose(), pose)
    assert tab.levels() == before


def test_a_pick_gives_the_face_of_the_rasteriser_at_100_pixels(tab):
    _, image = picture_and_image(tab)
    pixels = inner_pixels(image, 100, seed=1)
    pick = "places => places.map(([x, y]) => rastercov.pick(x + 0.5, y + 0.5))"
    picked = tab.js(pick, pixels)
    assert [each["face"] for each in picked] == [int(image[y, x]) for x, y in pixels]
    # The point of a pick is in the plane of its face.
    corners = ROOM.vertices[ROOM.faces[[each["face"] for each in picked]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.array([each["point"] for each in picked]) - corners[:, 0]
    np.testing.assert_allclose((away * normals).sum(axis=1), 0, atol=1e-5)


def test_pixels_have_the_colours_of_the_legend(tab):
    tab.js("['hasEdges', 'hasPieces'].map(each => rastercov.setOption(each, false))")
    camera, image = picture_and_image(tab)
    pixels, levels = inner_pixels(image, amount(50, at_night=200), seed=2), tab.levels()
    legend = "[...document.querySelectorAll('.legend .swatch')].map(each =>"
    legend += " [Number(each.dataset.level), getComputedStyle(each).backgroundColor])"
    legend = dict(tab.js(legend))
    read = "places => places.map(([x, y]) => rastercov.readPixel(x + 0.5, y + 0.5))"
    flat, lit = (
        tab.js(f"places => (rastercov.setOption('isFlat', {is_flat}), ({read})(places))", pixels)
        for is_flat in ("true", "false")
    )
    shown = [legend[levels[image[y, x]]] for x, y in pixels]
    assert shown == ["rgb({}, {}, {})".format(*colour) for colour in flat]
    assert len(set(shown)) >= 2
    # The headlight dims them, and the paler lines of a hatch, by the cosine of incidence alone.
    x, y = np.transpose(pixels)
    rays = np.column_stack(((x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy,
                            np.ones(len(x))))  # fmt: skip
    least = tab.js("rastercov.shadeLeast")
    normals = ROOM.normals[image[y, x]] @ POSE[:3, :3]
    cosine = np.abs((rays * normals).sum(axis=1)) / np.linalg.norm(rays, axis=1)
    light, paler = (least + (1 - least) * cosine)[:, None], 0.55 * np.array(flat) + 0.45 * 255
    plain, hatched = (np.abs(lit - light * each).max(axis=1) <= 1.6 for each in (flat, paler))
    assert (plain | hatched).all()
    assert hatched.any()


def test_at_rest_faces_have_the_colours_of_their_pieces(tab, program):
    tab.page.wait_for_function("rastercov.session.pieces !== undefined")
    tab.js("rastercov.setOption('isFlat', true), rastercov.setOption('hasEdges', false)")
    _, image = picture_and_image(tab)
    pixels = inner_pixels(image, 100, seed=3)
    pick = "places => places.map(([x, y]) => rastercov.pick(x + 0.5, y + 0.5))"
    value = tab.js(pick, pixels)
    read = "places => places.map(([x, y]) => rastercov.readPixel(x + 0.5, y + 0.5))"
    shown = (np.array(tab.js(read, pixels)) == REASONS["covered"].colour).all(axis=1)
    zones = program.session.areas().zones
    faces, points = (np.array([each[name] for each in value]) for name in ("face", "point"))
    is_covered = zones_at(zones, faces, points, 1) < 0
    levels = np.frombuffer(tab.levels(), np.uint8)[faces]
    assert (shown == is_covered).mean() > 0.98  # float32 on the borders of pieces
    of_zone = zones_at(zones, faces, points, zones.count())
    at = of_zone >= 0
    reasons = zones.reasons(zones.count())[of_zone[at]]
    flat = np.array([words.colour for words in REASONS.values()])[reasons]
    drawn = np.array(tab.js(read, pixels))[at]
    is_own = [np.abs(drawn - each).max(axis=1) <= 1.6 for each in (flat, 0.55 * flat + 0.45 * 255)]
    assert np.any(is_own, axis=0).mean() > 0.98  # of its reason, plain or hatched
    assert (shown != (levels == Reason.COVERED)).any()


def test_all_modes_are_reached_and_drawn(tab):
    modes = {each["id"] for each in tab.js("rastercov.session.scene.modes")}
    for mode in modes - {"area"}:  # which takes long, and is a test of the session's
        tab.js("mode => rastercov.session.setMode(mode)", mode)
        tab.idle()
        assert tab.js("rastercov.figures().mode") == mode
        assert tab.page.locator(".message.fault").count() == 0
    for panel in PANELS:
        tab.open(panel)
        assert tab.page.get_by_role("tabpanel", name=panel, exact=True).is_visible()
    nameless = "[...document.querySelectorAll('button, input, select')].filter(each => !("
    nameless += "each.ariaLabel || each.textContent.trim() || each.labels?.[0]?.textContent.trim()"
    assert tab.js(nameless + ")).map(each => each.outerHTML)") == []


def test_a_click_on_a_face_says_why(tab):
    pinhole_picture(tab, POSE)
    tab.click_middle()
    face = tab.js("rastercov.session.face")
    told = tab.js("face => rastercov.session.server.why(face)", face)
    tab.page.get_by_text(told["words"]).wait_for()
    tab.button("Centre the view on the face")
    assert tab.page.locator(".why .card").count() == len(told["cameras"])


def test_a_number_that_cannot_be_is_answered_by_one_line(tab):
    before, line = tab.state(), tab.page.locator(".fault:visible")
    tab.open("All cameras")
    for number in ("120", "0"):
        tab.type_number("Max incidence", number)
        wanted = "Max incidence: expected a number above 0 and at most 90 deg, got "
        assert line.inner_text() == f"{wanted}“{number}”"
    assert tab.state() == before
    tab.type_number("Max incidence", "45")
    assert line.count() == 0
    assert tab.state()["task"]["max_incidence_deg"] == 45


def test_a_level_of_the_standard_is_a_threshold_and_a_colour(tab):
    tab.open("All cameras")
    for is_on in (True, False):
        tab.button("Recognise")
        assert tab.state()["task"]["min_facing_density"] == (125 if is_on else 0)
    tab.js("rastercov.session.setMode('level')")
    tab.idle()
    assert tab.page.locator(".legend li").filter(has_text="observe, 62.5 px/m or more").count() == 1


def test_sections_and_groups_hide_what_they_cut_away(tab):
    pinhole_picture(tab, rc.look_at((2.6, -2.0, 2.2), (1.6, -1.4, 0.9))[0])  # at the tallest crate
    canvas = "rastercov.view.canvas"
    centre = f"rastercov.pick({canvas}.clientWidth / 2, {canvas}.clientHeight / 2)"

    def group_at_centre():
        return ROOM.groups[ROOM.face_group[tab.js(centre)["face"]]].name

    assert group_at_centre() == "crates"
    tab.js("rastercov.setOption('section', [0, 0, 1, -0.05])")  # what is above 5 cm is cut away
    assert group_at_centre() == "room"
    assert tab.js(centre)["point"][2] == pytest.approx(0, abs=1e-5)
    tab.js("rastercov.setOption('section', null)")
    tab.open("Object")
    tab.page.get_by_label("crates").uncheck()
    assert group_at_centre() == "room"


def test_a_measure_is_the_distance_of_two_points_that_are_clicked(tab):
    pinhole_picture(tab, rc.look_at((0.0, 0.0, 2.6), (0.0, 1.6, 0.0))[0])
    tab.button("Measure")
    ends = np.array(((-0.6, 1.0, 0.0), (0.4, 2.0, 0.0)))
    for end in ends:
        tab.page.mouse.click(*tab.place(end))
    tab.idle()
    picked = np.array(tab.js("rastercov.tools.points"))
    np.testing.assert_allclose(picked, ends, atol=0.02)
    length = np.linalg.norm(picked[1] - picked[0])
    assert tab.page.locator(".measure").inner_text().startswith(f"{length:.3f}"[:4])


def test_looking_through_a_camera_shows_what_it_covers(tab):
    tab.open("One camera")
    tab.button("Look through")
    size = np.array([tab.js(f"rastercov.view.canvas.client{side}") for side in ("Width", "Height")])
    points = np.vstack(((0, 0, 2), tab.state()["cameras"]["wide"]["border"]))
    world = points @ tab.pose()[:3, :3].T + tab.pose()[:3, 3]
    middle, *seen = tab.js("all => all.map(each => rastercov.screenOf(each))", world.tolist())
    np.testing.assert_allclose(middle[:2], size / 2)
    seen = np.array(seen)[:, :2]
    assert ((seen >= 0) & (seen <= size)).all()
    assert (np.ptp(seen, axis=0) > 0.9 * size).any()


def test_the_blur_circle_reaches_its_limit_at_the_ends_of_the_depth_of_field(tab):
    camera = rc.Camera.from_lens(
        width=640, height=480, focal_length=8e-3, pixel_size=5e-6, f_number=2.8,
        focus_distance=0.4, max_blur=1.5,
    )  # fmt: skip
    depths = [*camera.depth_of_field(), camera.focus_distance]
    assert np.isfinite(depths).all()
    blur = tab.js(
        "async ([camera, eye, depths]) => { const { blurAt } = await import('rastercov/frusta.js');"
        " return depths.map((depth) => blurAt(camera, eye, [0.1, 0.2, depth])); }",
        [describe_camera(camera), np.eye(4).ravel().tolist(), depths],
    )
    np.testing.assert_allclose(blur, (1.5, 1.5, 0), atol=1e-9)


SLOW = """() => {
  const { server } = rastercov.session;
  const worth = server.worth.bind(server);
  server.worth = async (...asked) => {
    await new Promise((resolve) => setTimeout(resolve, 100));
    return worth(...asked);
  };
}"""
"""Work that tries ten poses a second."""


def test_work_shows_its_progress_and_can_be_cancelled(tab):
    tab.js(SLOW)
    tab.page.get_by_role("button", name="Refine this camera").click()
    tab.page.locator(".job progress[value]").wait_for()
    tab.page.get_by_role("button", name="Cancel").click()
    tab.page.get_by_text("nothing was changed").wait_for()
    assert tab.page.locator(".job").is_hidden()
    assert not tab.state()["can_undo"]


def test_a_new_user_gains_ten_points_and_saves_in_three_clicks(tab, program, tmp_path):
    program.stop()
    program.out = tmp_path
    program.start()
    tab.page.locator(".banner").wait_for(state="hidden")
    before = percent_covered(tab.state())
    tab.button("Add the best next camera")
    tab.page.wait_for_function("rastercov.state().stations.length === 3")
    tab.idle()
    tab.page.get_by_text("Save", exact=True).click()
    tab.button("Save rig")
    tab.page.wait_for_function("rastercov.state().is_saved")
    poses = rc.read_views(tmp_path / "rig.json").poses.world_from_camera
    after = percent_covered({"stations": [{"pose": pose, "is_on": True} for pose in poses]})
    assert after > before + 10
    assert tab.area_percent() == pytest.approx(after, abs=1e-9)


@pytest.fixture
def empty(context):
    """Page of a closed box without a camera."""
    session = session_of(shapes.box(), 0)
    program = Program(session)
    program.start()
    tab = Tab(context, program.url)
    yield tab
    assert tab.faults == []
    program.stop()
    session.close()


def test_an_empty_rig_is_clay_with_a_card_of_ways_to_cameras(empty):
    tab, card = empty, empty.page.get_by_label("First cameras")
    assert card.is_visible()
    assert tab.js("[...new Set(rastercov.levels())].map(rastercov.palette)") == [
        list(REASONS["no_cameras"].colour)
    ]
    creases = tab.js("[...rastercov.view.creases]")
    assert sorted(each.bit_count() for each in creases) == [2] * 12  # no diagonal of a side
    tab.page.get_by_label("Cameras to place").fill("2")
    card.get_by_role("button", name="Place").click()
    tab.page.wait_for_function("rastercov.state().stations.length === 2")
    tab.idle()
    assert card.is_hidden()
    tab.button("Undo")
    assert card.is_visible()


def test_a_camera_that_is_sold_is_found_by_words_and_taken_by_keys(tab):
    name = "flir-bfs-u3-51s5+fujinon-hf12xa-5m"
    box = tab.page.get_by_role("combobox", name="Search the camera catalogue")
    box.fill("FLIR 51s5")
    box.press_sequentially(" hf12xa")
    assert tab.page.locator(".found strong").first.inner_text() == name
    tab.keys("ArrowDown", "ArrowUp", "Enter")
    assert tab.state()["stations"][0]["camera"] == name
    assert tab.state()["cameras"][name]["fx"] == pytest.approx(rc.Camera.preset(name).fx)
    tab.button("Undo")
    assert tab.state()["stations"][0]["camera"] == "wide"


def test_panels_fold_and_stay_so_and_the_image_enlarges(tab):
    tab.open("One camera")
    tab.button("Enlarge")
    tab.page.wait_for_function("document.querySelector('dialog.large img').naturalWidth == 640")
    tab.keys("Escape")
    width = tab.js("rastercov.view.canvas.clientWidth")
    tab.button("hide Why")
    tab.button("hide Panels")
    tab.page.reload()
    tab.page.wait_for_function("window.rastercov?.session.figures !== undefined")
    assert tab.js("rastercov.view.canvas.clientWidth") > width + 400
    assert tab.page.get_by_role("tab", name="One camera", exact=True).is_hidden()
    tab.keys("3")  # unfolds them
    heads = tab.page.get_by_role("tab").all()
    boxes = [each.bounding_box() for each in heads]
    apart = [b["x"] - a["x"] - a["width"] for a, b in itertools.pairwise(boxes)]
    assert min(apart) >= 3


def test_a_page_at_rest_draws_nothing_and_asks_nobody_else(tab, program):
    tab.page.wait_for_function("rastercov.session.pieces !== undefined")
    tab.idle()
    tab.js(
        "() => { window.drawn = 0; const draw = rastercov.view.draw.bind(rastercov.view);"
        " rastercov.view.draw = () => { window.drawn += 1; draw(); }; }"
    )
    tab.page.wait_for_timeout(1500)
    assert tab.js("window.drawn") == 0
    tab.press("+")
    tab.page.wait_for_function("window.drawn > 0")
    home = f"http://127.0.0.1:{program.port}/"
    assert [url for url in tab.requests if not url.startswith((home, "data:", "blob:"))] == []
    assert "#" not in tab.page.url  # the token is not left in the address


@pytest.mark.every_day
def test_a_static_page_shows_and_changes_colours_without_a_program(context, program, tmp_path):
    path = export_page(program.session, tmp_path / "page.html")
    context.set_offline(True)
    tab = Tab(context, path.as_uri())
    assert tab.levels() == program.session.frame("reason", {})[-ROOM.n_faces :]
    tab.js("rastercov.session.setMode('views')")
    tab.idle()
    assert tab.levels() == program.session.frame("views", {})[-ROOM.n_faces :]
    assert tab.page.get_by_role("button", name="Undo").count() == 0
    pinhole_picture(tab, POSE)
    tab.click_middle()
    tab.page.locator(".why .figures").wait_for()
    assert [url for url in tab.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert tab.faults == []


def test_a_page_in_a_frame_fits_the_scene_to_every_size_of_it(context, program, tmp_path):
    export_page(program.session, tmp_path / "view.html")
    outer = tmp_path / "outer.html"
    outer.write_text('<iframe src="view.html" style="display: none; border: 0"></iframe>')
    page = context.new_page()
    page.goto(outer.as_uri())
    frame = page.frames[1]
    frame.wait_for_function("window.rastercov?.session.figures !== undefined", polling=100)
    corners = [[x, y, z] for x, y, z in itertools.product(*np.transpose(ROOM.bounds).tolist())]
    places = "all => [...all.map(each => rastercov.screenOf(each).slice(0, 2)),"
    places += " [rastercov.view.canvas.clientWidth, rastercov.view.canvas.clientHeight]]"
    for width, height in ((900, 500), (1000, 900), (800, 300)):
        page.evaluate(
            "size => Object.assign(document.querySelector('iframe').style, size)",
            {"display": "block", "width": f"{width}px", "height": f"{height}px"},
        )
        page.wait_for_timeout(300)
        *result, size = np.array(frame.evaluate(places, corners))
        assert size[0] > 0.9 * width  # both sides are folded
        assert ((np.min(result, axis=0) >= 0) & (np.max(result, axis=0) <= size)).all()
        assert (np.ptp(result, axis=0) > 0.5 * size).any()


DROPPED = """() => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File(["solid"], "d.stl"));
  document.body.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
}"""


def chosen_drawing(tab, path):
    tab.page.get_by_label("Choose a PNG, JPEG or SVG…").set_input_files(path)


def test_a_drawing_lies_under_the_floor_plan_to_scale_by_two_points(tab, tmp_path):
    Image.new("RGB", (800, 600), "white").save(tmp_path / "plan.png")
    tab.button("Floor plan")
    chosen_drawing(tab, tmp_path / "plan.png")
    drawing = tab.page.locator("img.drawing:visible")

    def on_drawing(across, down):
        box = drawing.bounding_box()
        return box["x"] + across * box["width"], box["y"] + down * box["height"]

    low, high = ROOM.bounds
    ends = np.array(((low[0], high[1], 0.0), (high[0], high[1], 0.0)))  # its wall in the north
    tab.page.get_by_text("Drawing", exact=True).click()
    tab.button("Place by two points")
    near = [np.add(tab.place(end), (2, -2)) for end in ends]  # corners take what is near
    for place in (on_drawing(0.1, 0.2), on_drawing(0.6, 0.2), *near):
        tab.page.mouse.click(*place)
    tab.idle()
    scale = np.ptp(ends[:, 0]) / 400
    box, origin = drawing.bounding_box(), np.array(tab.place(ends[0]))
    pixel = np.subtract(tab.place(ends[1]), origin)[0] / np.ptp(ends[:, 0])  # of a metre
    np.testing.assert_allclose(
        [box["width"], box["height"]], scale * pixel * np.array((800, 600)), 1e-5
    )
    np.testing.assert_allclose(on_drawing(0.1, 0.2), origin, atol=0.01)
    tab.js("localStorage.clear()")  # as in the browser of a colleague
    tab.page.reload()
    tab.page.wait_for_function("window.rastercov?.session.figures !== undefined")
    tab.button("Floor plan")
    np.testing.assert_allclose(drawing.bounding_box()["width"], box["width"], rtol=1e-6)


@pytest.mark.every_day
def test_a_hostile_drawing_is_inert_or_refused(tab, tmp_path):
    svg = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9" onload="parent.ran = 1">'
    svg += '<script>parent.ran = 1</script><image href="http://example.org/a.png"/></svg>'
    head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"  # of 2.5e9 pixels
    files = {"a.svg": svg.encode(), "b.png": head + 2 * b"\0\0\xc3\x50", "c.pdf": b"%PDF-1.7"}
    tab.button("Floor plan")
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        chosen_drawing(tab, tmp_path / name)
    tab.page.get_by_text("b.png has 50000 × 50000 pixels").wait_for()
    tab.page.get_by_text("c.pdf: expected a PNG, JPEG or SVG").wait_for()
    tab.js(DROPPED)
    tab.page.get_by_text("d.stl: expected a PNG, JPEG or SVG").wait_for()
    assert tab.page.locator("img.drawing:visible").get_attribute("src").startswith("data:image/svg")
    assert tab.js("window.ran") is None
    assert [each for each in tab.requests if "example.org" in each] == []


INJECTED = """() => {
  window.ran = [];
  const [text, data, image, button] = ["script", "script", "img", "button"].map(
    (tag) => document.createElement(tag));
  text.textContent = "window.ran.push('inline')";
  data.src = "data:text/javascript,window.ran.push('data')";
  image.src = "http://example.org/image.png";
  button.setAttribute("onclick", "window.ran.push('attribute')");
  document.body.append(text, data, image, button);
  button.click();
}"""
"""What a page does with markup that reached it in spite of everything."""


@pytest.mark.every_day
@pytest.mark.parametrize("is_served", [True, False])
def test_the_policy_of_a_page_stops_what_is_not_its_own(browser, program, tmp_path, is_served):
    """With the policy in force, as in no other test: the page works, and nothing is injected."""
    url = program.url if is_served else export_page(program.session, tmp_path / "a.html").as_uri()
    context = browser.new_context(viewport={"width": 1180, "height": 620})
    try:
        tab = Tab(context, url)
        assert tab.levels() == program.session.frame("reason", {})[-ROOM.n_faces :]
        for panel in PANELS:
            tab.open(panel)
        tab.idle()
        assert tab.faults == []
        own = (url.partition("/#")[0], "data:", "blob:")
        assert [each for each in tab.requests if not each.startswith(own)] == []
        tab.js(INJECTED)
        tab.page.wait_for_timeout(500)
        assert tab.js("window.ran") == []
        said = tab.js("fetch('http://example.org/').then(() => 'sent', (error) => error.name)")
        assert said == "TypeError"
        for name in ("http://example.org/image.png", "http://example.org/'"):
            assert any(name in fault for fault in tab.faults)
    finally:
        context.close()
