"""A page that computes: from a file, without a network, its figures are those of `rastercov`."""

import json
import tomllib

import numpy as np
import pytest
from browser import Tab
from edited import Session
from nightly import IS_NIGHTLY
from rigs_to_view import EYES, ROOM, WIDE, acted, moved, session_of, session_of_room

import rastercov as rc
from rastercov.cli import command
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.mesh import shapes
from rastercov.page.live import open_live as opened_by
from rastercov.page.live import record_cause
from rastercov.page.rig_state import RigState
from rastercov.page.saving import export_page
from rastercov.page.scene import Scene
from rastercov.placement import NearestSurface, in_solid
from rastercov.report import live

WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
pytestmark = [pytest.mark.slow, WITHOUT]
SOME = {"max_incidence_deg": 75, "min_pixel_density": 60.0, "views": 2}


def opened(context, session, tmp_path):
    return Tab(context, export_page(session, tmp_path / "page.html", is_still=False).as_uri())


@pytest.fixture
def page(context, tmp_path):
    """The room, which computes; nothing was asked for, and nothing failed."""
    session = session_of_room()
    made = opened(context, session, tmp_path)
    yield made
    session.close()
    assert made.faults == []
    assert {each.split(":")[0] for each in made.requests} <= {"file", "blob", "data"}


def act(page, **action):
    """The answer of the page to an action."""
    value = page.js("action => rastercov.session.act(action)", action)
    page.idle()
    return value


def evaluated(page, mesh=ROOM):
    """Summary by `rastercov` of the rig that the page saves."""
    return evaluated_of(page.state(), json.loads(downloaded(page)["rig.json"]), mesh)


def evaluated_of(state, rig=None, mesh=ROOM):
    """Summary by `rastercov` of the state of a page, with its own cameras or those of a rig."""
    on = [each["is_on"] for each in state["stations"]]
    if rig is None:
        names, cameras = zip(*((k, v["plain"]) for k, v in state["cameras"].items()), strict=True)
        poses = [np.reshape(each["pose"], (4, 4)) for each in state["stations"]]
        owner = [names.index(each["camera"]) for each in state["stations"]]
    else:
        names = [each.pop("name") for each in rig["cameras"]]
        cameras, poses, owner = rig["cameras"], rig["world_from_camera"], rig["camera"]
    placed = Poses.of(np.array(poses)[on], camera=np.array(owner)[on])
    task = rc.Task(**{k: v for k, v in state["task"].items() if v is not None})
    own = Rig(list(map(rc.Camera.from_dict, cameras)), names)
    return rc.evaluate(mesh, own, placed, task, fields=()).summary()


def assert_equal(result, expected):
    """Areas of a view to the last digit, others nearly; bounds alike.

    `check` and the page add one camera after another, `evaluate` all of a batch, which has smaller
    bounds.
    """
    assert result.keys() == expected.keys()
    for name, value in expected.items():
        if name == "by_views":
            wanted = [{k: pytest.approx(v, rel=1e-12) for k, v in each.items()} for each in value]
            assert result[name] == wanted
        elif name.startswith(("bound", "doubtful")):
            assert value / 3 <= result[name] <= 3 * value, name
        else:
            is_exact = expected["views"] == 1
            assert result[name] == (value if is_exact else pytest.approx(value, rel=1e-12)), name


SAVE = """
async () => {
    const [texts, kept, waiting] = [{}, new Map(), []];
    const { click } = HTMLAnchorElement.prototype;
    const create = URL.createObjectURL;
    URL.createObjectURL = (blob) => {
        const address = create(blob);
        kept.set(address, blob);
        return address;
    };
    HTMLAnchorElement.prototype.click = function () {
        const name = this.download;
        waiting.push(kept.get(this.href).text().then((text) => (texts[name] = text)));
    };
    try {
        await rastercov.session.server.save("rig");
    } finally {
        HTMLAnchorElement.prototype.click = click;
        URL.createObjectURL = create;
    }
    await Promise.all(waiting);
    return texts;
}
"""


def downloaded(page):
    """Texts of the files that the page saves, by name."""
    return page.js(SAVE)


@pytest.mark.every_day
def test_edits_give_the_figures_of_rastercov_to_the_last_digit(page, tmp_path, monkeypatch):
    rng = np.random.default_rng(3)
    for _ in range(200 if IS_NIGHTLY else 8):
        act(page, **random_edit(page, rng, ["wide"]))
    expected = evaluated(page)["covered_area"]["percent"]
    assert page.area_percent() == pytest.approx(expected, rel=1e-12)
    assert page.page.locator(".summary .covered").inner_text() == f"{expected:.1f} %"
    own = page.js("rastercov.summary().by_camera.map(each => each.area_percent)")
    assert len(own) == len(page.state()["stations"])
    assert_checked(page, tmp_path, monkeypatch)


def random_edit(page, rng, pinholes):
    """An edit of a page: a pose, a camera more or less, a lens, a threshold, or back."""
    state = page.state()
    stations, cameras = state["stations"], list(state["cameras"])
    one = stations[rng.integers(len(stations))]
    eye = np.reshape(one["pose"], (4, 4))[:3, 3] + rng.uniform(-0.5, 0.5, 3)
    looked = rc.look_at(eye, rng.uniform(-1, 1, 3))[0].ravel().tolist()
    way = rng.choice(["add", "delete", "use", "camera", "task", "undo", "pose"])
    if way == "add" and len(stations) < 12:
        return {"do": "add", "camera": str(rng.choice(cameras)), "pose": looked}
    if way == "delete" and len(stations) > 2:
        return {"do": "delete", "station": one["id"]}
    if way == "use":
        sold = page.js("rastercov.session.scene.catalogue.map(each => each[0])")
        name = str(rng.choice(cameras if len(cameras) > 5 else [*cameras, rng.choice(sold)]))
        return {"do": "use", "station": one["id"], "camera": name}
    if way == "camera":
        changes = {"hfov_deg": float(rng.uniform(60, 110))}
        return {"do": "camera", "camera": str(rng.choice(pinholes)), "changes": changes}
    if way == "task":
        limits = {"max_incidence_deg": float(rng.uniform(60, 90))}
        return {"do": "task", "changes": limits | {"min_pixel_density": float(rng.uniform(0, 60))}}
    if way == "undo" and state["can_undo"]:
        return {"do": "undo"}
    return {"do": "pose", "station": one["id"], "pose": looked}


def assert_checked(page, tmp_path, monkeypatch):
    """The figures of a page are those of `check` of the files that it saves, to the last digit."""
    monkeypatch.chdir(tmp_path)
    for name, text in downloaded(page).items():
        (tmp_path / name).write_text(text)
    told = rc.check("plan.toml", "rig.json", min_coverage=0.1).summary()["covered_area"]
    value = page.js("rastercov.summary().covered_area")
    assert (value["m2"], value["percent"]) == (told["m2"], told["percent"])
    assert value["bound_m2"] == pytest.approx(told["bound_m2"], rel=1e-9)


BENT = rc.Camera(
    width=640, height=480, fx=420, fy=420, model="opencv", distortion=(-0.11, 0.02, 1e-3, -2e-3)
)


def test_edits_of_several_cameras_with_lenses_give_the_figures_of_check(
    context, tmp_path, monkeypatch
):
    poses = rc.look_at(np.array([*EYES, (2.4, -2.0, 2.2)]), np.tile((0.0, 0.0, 0.6), (3, 1)))
    placed = Poses.of(poses, camera=[0, 1, 2])
    rig = Rig([WIDE, BENT, rc.Camera.from_fov(800, 600, hfov_deg=70)], ["wide", "bent", "narrow"])
    session = Session(Scene("room", ROOM, RigState.of(rig, placed)))
    page = opened(context, session, tmp_path)
    rng = np.random.default_rng(6)
    for number in range(200 if IS_NIGHTLY else 10):
        act(page, **random_edit(page, rng, ["wide", "narrow"]))
        if number % 20 == 9:
            assert_checked(page, tmp_path, monkeypatch)
    assert page.faults == []
    session.close()


def test_thresholds_and_views_are_those_of_a_task(page):
    act(page, do="duplicate", station=0)
    act(page, do="task", changes=SOME)
    summary = evaluated(page)
    assert_equal(page.js("rastercov.summary().covered_area"), summary["covered_area"])
    zones = page.js("rastercov.session.server.zones()")
    pieces = page.js("rastercov.session.server.found.pieces")
    by_reason = {}
    for reason, area in zip(pieces["reasons"], pieces["areas"], strict=True):
        by_reason[reason] = by_reason.get(reason, 0.0) + area
    assert sum(each["area"] for each in zones) <= sum(by_reason.values()) * (1 + 1e-12)
    expected = {name: each["m2"] for name, each in summary["not_covered_because"].items()}
    most = summary["covered_area"]["bound_m2"]  # what zones below their bound are left out of
    for name in by_reason | expected:
        wanted = pytest.approx(expected.get(name, 0.0), rel=1e-9, abs=most)
        assert by_reason.get(name, 0.0) == wanted, name


def test_whole_faces_have_the_colours_of_a_served_page(page):
    session = session_of_room()
    modes = page.js("rastercov.session.scene.modes.map(each => each.id)")
    assert {"reason", "views", "area", "density", "incidence", "coverage", "camera"} <= set(modes)
    for mode in modes:
        page.js("mode => rastercov.session.setMode(mode)", mode)
        page.idle()
        head, levels = acted(session, mode)
        assert (np.frombuffer(page.levels(), np.uint8) != levels).mean() < 0.005, mode
        legend = page.js("rastercov.session.figures.legend")
        assert [each["label"] for each in legend] == [each["label"] for each in head["legend"]]
    session.close()


def test_dead_zones_are_those_of_rastercov(page):
    session = session_of_room()
    expected = session.zones()
    zones = page.js("rastercov.session.server.zones()")
    assert len(zones) == len(expected)
    for pair, wanted in zip(zones, expected, strict=True):
        assert pair["area"] == pytest.approx(wanted["area"], rel=1e-9)
        assert pair["reason"] == wanted["reason"]
        assert pair["faces"] == wanted["faces"]
        assert pair["words"] == wanted["words"]
        assert pair["centre"] == pytest.approx(wanted["centre"], abs=1e-9)
    session.close()


def test_a_click_says_why_a_face_is_not_covered(page):
    session = session_of_room()
    for face in (5, 100, 300, 500):
        said = page.js("face => rastercov.session.server.why(face)", face)
        served = session.why(face)
        assert [each["name"] for each in said["cameras"]] == [
            each["name"] for each in served["cameras"]
        ]
        assert said["group"] == served["group"]
        assert said["words"] == served["words"]
    page.click_middle()
    page.idle()
    page.page.wait_for_function("document.querySelector('.why .verdict')")
    assert ": covered by " in page.page.locator(".why .verdict").inner_text()
    session.close()


def test_undo_takes_edits_back_and_a_drag_is_one_step(page):
    before, levels = page.pose(), page.levels()
    pose = before.copy()
    for step in range(1, 4):
        pose[0, 3] = before[0, 3] - 0.2 * step
        page.js(
            "pose => rastercov.session.act({do: 'pose', station: 0, pose}, {isDrag: true})",
            pose.ravel().tolist(),
        )
    page.idle()
    act(page, do="undo")
    assert not page.state()["can_undo"]
    np.testing.assert_array_equal(page.pose(), before)
    assert page.levels() == levels
    act(page, do="redo")
    np.testing.assert_array_equal(page.pose(), pose)


def test_a_drag_of_a_large_mesh_unites_when_it_rests(context, tmp_path):
    session = session_of_room()
    path = export_page(session, tmp_path / "page.html", is_still=False)
    text = path.read_text()
    assert text.count('"unionAtRest": 100000') == 1
    path.write_text(text.replace('"unionAtRest": 100000', '"unionAtRest": 0'))
    page = Tab(context, path.as_uri())
    before = page.js("rastercov.summary()")
    pose = moved(page.pose(), (-0.5, 0.2, 0.0))
    during = page.js(
        "pose => rastercov.session.act({do: 'pose', station: 0, pose}, {isDrag: true})"
        ".then(({summary}) => summary)",
        pose,
    )
    assert during["covered_area"] == before["covered_area"]
    areas = [each["by_camera"][0]["area_percent"] for each in (before, during)]
    assert areas[0] != areas[1]
    page.page.wait_for_function("!rastercov.session.figures.is_partial")
    after = page.js("rastercov.summary()")
    assert_equal(after["covered_area"], evaluated(page)["covered_area"])
    assert after["by_camera"][0]["area_percent"] == areas[1]
    assert after["covered_area"]["m2"] != before["covered_area"]["m2"]
    act(page, do="undo")
    assert page.js("rastercov.summary().covered_area") == before["covered_area"]
    session.close()


def test_check_takes_the_saved_files_back_with_the_same_figures(page, tmp_path, monkeypatch):
    act(page, do="add", camera="wide", pose=rc.look_at((0.5, 2, 2), (0, 0, 0))[0].ravel().tolist())
    act(page, do="task", changes={"max_incidence_deg": 70})
    assert_checked(page, tmp_path, monkeypatch)
    assert page.js("rastercov.session.server.state()")["is_saved"]
    assert tomllib.loads((tmp_path / "plan.toml").read_text())["task"] == {"max_incidence_deg": 70}


def test_a_link_has_the_rig_to_the_last_bit(page, context):
    for number in range(8):
        pose = rc.look_at((0.3 * number - 1, 1.5, 2), (0, 0, 0))[0].ravel().tolist()
        act(page, do="add", camera="wide", pose=pose)
    act(page, do="task", changes={"max_incidence_deg": 70})
    address = page.js("rastercov.session.server.link()")
    assert len(address.partition("#")[2]) < 2000
    other = Tab(context, address)
    assert other.state()["stations"] == page.state()["stations"]
    assert other.js("rastercov.summary()") == page.js("rastercov.summary()")
    cut = Tab(context, address[:-40])
    assert len(cut.state()["stations"]) == 2


def assert_free(page, mesh=ROOM):
    """Cameras are outside of bodies, and 5 cm from every surface."""
    eyes = np.array([each["pose"] for each in page.state()["stations"]])[:, [3, 7, 11]]
    assert not in_solid(mesh, eyes).any()
    assert (NearestSurface(mesh).query(eyes).distance >= 0.05).all()


@pytest.mark.slow
def test_cameras_placed_by_a_page_are_outside_of_an_open_body(context, tmp_path):
    mesh = shapes.by_name("teapot-5")
    page = opened(context, session_of(mesh, 1), tmp_path)
    for _ in range(2):
        before = len(page.state()["stations"])
        page.open("Cameras")
        page.page.get_by_role("button", name="Add the best next camera").click()
        page.page.wait_for_function(f"rastercov.state().stations.length === {before + 1}")
        page.idle()
        assert_free(page, mesh)


def test_the_best_next_camera_covers_more_and_can_be_undone(page):
    before = page.area_percent()
    page.open("Cameras")
    page.page.get_by_role("button", name="Add the best next camera").click()
    page.page.wait_for_function("rastercov.state().stations.length === 3")
    page.idle()
    assert_free(page)
    assert page.area_percent() > before + 5
    assert page.area_percent() == evaluated(page)["covered_area"]["percent"]
    act(page, do="undo")
    assert page.area_percent() == before


def test_refining_a_camera_covers_more_and_can_be_undone(page):
    before = page.area_percent()
    page.open("Cameras")
    page.page.get_by_role("button", name="Refine this camera").click()
    page.page.wait_for_function("rastercov.state().can_undo")
    page.idle()
    assert_free(page)
    assert page.area_percent() > before + 1
    assert page.area_percent() == evaluated(page)["covered_area"]["percent"]
    assert len(page.state()["stations"]) == 2
    act(page, do="undo")
    assert page.area_percent() == before


def test_a_camera_of_the_catalogue_is_that_of_python(page):
    name = page.js("rastercov.session.scene.catalogue[7][0]")
    page.open("Cameras")
    page.page.get_by_role("combobox", name="Search the camera catalogue").fill(name)
    page.page.locator("ul.found li").first.click()
    page.page.wait_for_function("rastercov.state().can_undo")
    page.idle()
    state = page.state()
    assert state["stations"][0]["camera"] == name
    sold = rc.Camera.from_dict({"preset": name})
    assert rc.Camera.from_dict(state["cameras"][name]["plain"]) == sold
    assert page.area_percent() == evaluated(page)["covered_area"]["percent"]
    assert act(page, do="use", station=0, camera="none of these") is None


def test_a_phone_has_targets_for_fingers_and_says_what_is_covered(browser, tmp_path):
    session = session_of_room()
    path = export_page(session, tmp_path / "page.html", is_still=False)
    phone = {"width": 390, "height": 780}
    context = browser.new_context(
        viewport=phone, has_touch=True, is_mobile=True, bypass_csp=True, reduced_motion="reduce"
    )
    context.set_default_timeout(60_000)
    page = Tab(context, path.as_uri())
    for panel in ("Object", "Cameras", "One camera", "All cameras"):
        page.page.get_by_role("tab", name=panel, exact=True).tap()
        small = page.js(SMALL)
        assert small == [], panel
    said = page.page.get_by_role("status", name="Coverage")
    assert said.locator(".covered").inner_text() == f"{page.area_percent():.1f} %"
    assert page.js("document.documentElement.scrollWidth") <= phone["width"]
    context.close()
    session.close()


SMALL = """
[...document.querySelectorAll("button, select, summary, input")]
    .filter((each) => each.checkVisibility() && !each.matches(".name"))
    .map((each) => (each.type === "radio" ? each.closest("label") : each))
    .filter((each) => each.getBoundingClientRect().height < 44)
    .map((each) => each.outerHTML.slice(0, 80))
"""


def curved():
    """Two cameras with distortion around a teapot."""
    mesh = shapes.torus(24, 12)
    poses = rc.look_at(2.5 * mesh.diagonal * np.array([(1, 0.1, 0.4), (0.2, 1, 0.3)]), (0, 0, 0))
    return Session(Scene("ring", mesh, RigState.of(Rig([BENT], ["bent"]), Poses.of(poses))))


def test_a_lens_with_distortion_moves_with_the_figures_of_rastercov(context, tmp_path):
    session = curved()
    page = opened(context, session, tmp_path)
    pose = rc.look_at((0.4, -1.8, 0.9), (0, 0, 0))[0].ravel().tolist()
    act(page, do="pose", station=0, pose=pose)
    expected = evaluated(page, session.scene.mesh)["covered_area"]
    assert page.js("rastercov.summary().covered_area.percent") == pytest.approx(
        expected["percent"], rel=1e-12
    )
    assert page.faults == []
    session.close()


def test_the_lens_of_a_camera_is_changed_and_chosen(context, tmp_path):
    """Its figures are those of the saved rig, and a page that was saved opens with it."""
    session = curved()
    page = opened(context, session, tmp_path)
    pose = rc.look_at((0.3, -1.2, 0.6), (0, 0, 0))[0].ravel().tolist()
    act(page, do="pose", station=0, pose=pose)  # from where the image ends within the ring
    edits = [
        *({"do": "camera", "camera": "bent", "changes": each}
          for each in ({"k1": -0.2}, {"fx": 700.0}, {"cx": 300.0}, {"width": 800})),
        {"do": "use", "station": 0, "camera": "hikvision-2143g2-4mm"},
    ]  # fmt: skip
    shares = set()
    for edit in edits:
        act(page, **edit)
        expected = evaluated(page, session.scene.mesh)["covered_area"]["percent"]
        shares.add(page.js("rastercov.summary().covered_area.percent"))
        assert page.js("rastercov.summary().covered_area.percent") == pytest.approx(
            expected, rel=1e-9
        )
    assert len(shares) == len(edits)
    act(page, do="undo")
    assert page.js("rastercov.summary().covered_area.percent") in shares
    saved = page.js("rastercov.session.server.download('page').then(each => each.text())")
    (tmp_path / "again.html").write_text(saved)
    again = Tab(context, (tmp_path / "again.html").as_uri())
    assert again.js("rastercov.summary().covered_area") == page.js(
        "rastercov.summary().covered_area"
    )
    assert page.faults == again.faults == []
    session.close()


@pytest.mark.every_day
def test_names_with_markup_are_text_and_nothing_leaves_the_page(context, tmp_path):
    name = "<img src=x onerror=alert(1)></script>"
    mesh = rc.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], [rc.Group(name)], [0])
    poses = Poses.of(rc.look_at((0.3, 0.3, 2), (0.3, 0.3, 0)))
    session = Session(Scene(name, mesh, RigState.of(Rig([WIDE], [name]), poses)))
    page = opened(context, session, tmp_path)
    assert page.js("document.querySelectorAll('[onerror], [src=x]').length") == 0
    assert page.js("fetch('http://127.0.0.1:9/').then(() => 'out', () => 'kept')") == "kept"
    assert page.js("rastercov.summary().covered_area.percent") == 100.0
    session.close()


def altered(text, way):
    """Text of a page that someone changed."""
    if way == "rig":
        station = '{"id": 7, "name": "x", "camera": "none", "pose": [1], "is_on": true}, '
        return text.replace('"stations": [', f'"stations": [{station}', 1)
    at = text.index(f'"{way}": "') + len(way) + 300
    return text[:at] + "AAAAAAAA" * 4 + text[at + 32 :]


@pytest.mark.parametrize(
    ("way", "line"),
    [
        ("rig", "there is no camera none"),
        ("engine", "damaged bytes"),
        ("vertices", "damaged bytes"),
    ],
)
def test_an_altered_page_says_a_line(context, tmp_path, way, line):
    session = session_of_room()
    path = export_page(session, tmp_path / "page.html", is_still=False)
    path.write_text(altered(path.read_text(), way))
    page = context.new_page()
    page.goto(path.as_uri())
    page.wait_for_selector(".failed[role=alert]")
    assert line in page.locator(".failed").inner_text()
    session.close()


def test_numbers_that_are_none_are_a_line_and_the_page_goes_on(page):
    pose = page.pose().ravel().tolist()
    broken = [*pose[:3], None, *pose[4:]]
    assert act(page, do="pose", station=0, pose=broken) is None
    page.page.wait_for_function("document.querySelector('.message.fault')")
    page.page.locator(".message.fault button").first.click()
    wrong = {"stations": [{"id": 0, "camera": "x", "pose": [0] * 16}], "task": {"views": 1}}
    wrong |= {"cameras": {"x": {"focus": [0, 1]}}, "need": []}
    wrong |= {"rows": [{"stations": [0], "gate": None}]}
    ask = "rig => rastercov.session.server.asking.ask('frame', rig, 'area', false)"
    said = page.js(f"{ask}.catch(error => error.message)", wrong)
    assert said.startswith("expected ")
    before, covered = page.state(), page.area_percent()
    assert act(page, do="pose", station=0, pose=[*pose[:3], 1e31, *pose[4:]]) is None
    assert "got 1e+31;" in page.page.locator(".message.fault").first.inner_text()
    assert page.state() == page.js("rastercov.session.server.state()") == before
    act(page, do="pose", station=0, pose=pose)
    assert page.area_percent() == covered
    assert page.page.get_by_text("Another tab").count() == 0
    assert page.area_percent() == evaluated(page)["covered_area"]["percent"]


def test_a_tab_in_the_background_computes(page):
    """No frame is drawn there, and figures follow."""
    page.js("window.requestAnimationFrame = () => 0")
    before = page.area_percent()
    pose = page.pose()
    pose[0, 3] -= 0.5
    action = {"do": "pose", "station": 0, "pose": pose.ravel().tolist()}
    page.js("action => rastercov.session.act(action)", action)
    assert page.area_percent() != before
    assert page.area_percent() == evaluated(page)["covered_area"]["percent"]


def test_a_page_without_a_worker_computes_itself(context, tmp_path):
    session = session_of_room()
    context.add_init_script("window.Worker = class { constructor() { throw new Error('none'); } }")
    page = opened(context, session, tmp_path)
    assert page.area_percent() == session.figures().summary()["covered_area"]["percent"]
    assert page.js("rastercov.session.server.asking.worker") is None
    session.close()


def test_what_the_page_cannot_compute_is_recorded_and_said(tmp_path, monkeypatch, capsys):
    session = session_of(task=rc.Task(min_visibility=0.5))
    assert record_cause(session, session.scene.start).endswith("cannot recompute results by face")
    path = export_page(session, tmp_path / "page.html", is_still=False)
    assert 'id="export"' in path.read_text()
    session.close()
    monkeypatch.setattr(live, "engine", lambda: None)
    other = session_of()
    assert record_cause(other, other.scene.start) == live.NO_ENGINE
    assert command(["view", "box", "-c", "khepra", "-p", "sphere:4", "--export", str(path)]) == 0
    assert live.NO_ENGINE in capsys.readouterr().err
    assert live.NO_ENGINE in path.read_text()
    assert live.BY_PYTHON in opened_by(other)["scene"]["notes"]
    assert "engine" not in opened_by(other)
