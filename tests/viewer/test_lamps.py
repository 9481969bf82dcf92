"""Lamps in the viewer: devices that are moved, and figures of what they light."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from browser import Program, Tab
from commands import call, done, enter, refusal
from edited import Saving, Session, Work
from moving_scene import CAMERA, EYES, PART, POSES, TASK, by_hand, moving_scene
from PIL import Image
from rigs_to_view import moved
from timed import evaluate_over_time

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.features import values_of
from rastercov.core.area.stages import failures_of_rows
from rastercov.core.coverage.task import NAMES, REASONS
from rastercov.light.points import OfLight
from rastercov.light.regions import TOO_DARK
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene, describe_devices, task_fields
from rastercov.page.session import remove_head
from rastercov.report.modes import MODES
from rastercov.report.overview import by_faces, camera_pixels, camera_scene

CENTRE = PART.bounds.mean(axis=0)
PLACES = rc.look_at(np.add(CENTRE, [(0.4, -0.3, 0.5), (-0.2, 0.3, 0.4)]), CENTRE)
LAMPS = rc.Lamps(
    [rc.Lamp.spot(12, intensity=40), rc.Lamp.area(0.2, intensity=30, points=4)],
    PLACES, ["key", "panel"], ambient=5,
)  # fmt: skip
LAMP_COLOUR = (217, 140, 0)  # of lines, as `frusta.js` has it
LIT = rc.Task(max_incidence_deg=75, min_illuminance=70, max_highlight_deg=10)


def lit_scene(task=LIT, lamps=LAMPS):
    rig = rc.Rig([CAMERA], ["eye"])._equip("lamps", lamps)
    return Scene("lit", PART, RigState.of(rig, rc.Poses.of(POSES), task=task))


@pytest.fixture
def session():
    made = Session(lit_scene())
    yield made
    made.close()


def acted(session, mode="reason", at=(), **action):
    request = {
        "revision": session.history.revision, "mode": mode, "at": list(at),
        "action": action or {"do": "none"},
    }  # fmt: skip
    head, levels = remove_head(session.act(request))
    return head, np.frombuffer(levels, np.uint8)


def assert_lit(session, mesh, poses, lamps, task=LIT):
    """Exact area as of `rc.regions` with lamps, and light at centroids as it judges points."""
    exact = rc.unite(rc.regions(mesh, CAMERA, poses, task, lamps=lamps)).share()
    assert session.areas().summary()["percent"] == pytest.approx(100 * exact, abs=1e-6)
    rig = rc.Rig([CAMERA])._equip("lamps", lamps)
    faces = np.flatnonzero(mesh.task_mask & ~mesh.degenerate_mask)
    plain = rc.Task(max_incidence_deg=75)
    covers = rc.evaluate(mesh, CAMERA, poses, plain, by="face").reason == rc.Reason.COVERED
    placed = rc.Poses.of(poses)
    judged = failures_of_rows(mesh, rig, task, placed, mesh.centroids[faces], faces)
    n_light, every = 0, np.zeros(len(faces), bool)
    for (_, reason, _), row, own in zip(judged, session.figures().rows, covers, strict=True):
        some = own[faces] & ((reason == rc.Reason.COVERED) | (reason > rc.Reason.COVERED))
        assert np.array_equal(row.failed[faces][some], reason[some])
        assert np.array_equal(row.covers, own & (row.fails == rc.Reason.COVERED))
        n_light += int((reason[some] != rc.Reason.COVERED).sum())
        every |= row.covers[faces]
    assert n_light > 20
    assert np.array_equal(session.figures().covered[faces], every)


def test_figures_are_those_of_regions_with_lamps(session):
    head, levels = acted(session)
    assert_lit(session, PART, POSES, LAMPS)
    assert {each["label"] for each in head["legend"]} >= {"too dark", "covered"}
    assert (levels == TOO_DARK).any()


def test_sliders_have_the_thresholds_of_light(session):
    fields = {each["name"]: each for each in task_fields(session.state.whole)}
    assert set(fields) == set(rc.Task.__dataclass_fields__)
    assert fields["min_illuminance"]["unit"] == "lx"


def test_a_lamp_that_is_moved_lights_other_parts_and_may_go_back(session):
    before, _ = acted(session)
    wanted = moved(PLACES[1], (0.2, -0.5, 0.1))
    head, _ = acted(session, do="device", device="lamps 1", pose=wanted)
    assert head["state"]["devices"][1]["pose"] == pytest.approx(wanted)
    assert head["state"]["undo_label"] == "move panel"
    places = np.stack([PLACES[0], np.reshape(wanted, (4, 4))])
    assert_lit(session, PART, POSES, rc.Lamps(LAMPS.lamps, places, LAMPS.names, ambient=5))
    assert head["summary"]["covered"] != before["summary"]["covered"]
    after, _ = acted(session, do="undo")
    assert after["summary"]["covered"] == before["summary"]["covered"]


def test_bodies_that_move_shade_what_lamps_light(tmp_path):
    session = Session(moving_scene(tmp_path, lamps=LAMPS))
    for frame in (4, 1):
        acted(session, at=[frame], do="task", changes={
            "min_illuminance": 70.0, "max_highlight_deg": 10.0
        })  # fmt: skip
        assert_lit(session, *by_hand(frame), LAMPS)
    session.close()


def test_a_lamp_on_a_camera_moves_with_it():
    lamps = rc.Lamps([rc.Lamp.spot(10, intensity=9)], rides=[True])
    task = rc.Task(max_incidence_deg=75, min_illuminance=8)
    session = Session(lit_scene(task, lamps))
    head, _ = acted(session)
    shown = head["state"]["devices"][0]
    assert shown["pose"] is None
    assert np.allclose(np.reshape(shown["rides"]["eye"], (4, 4)), lamps.places[0])
    assert "lux" not in [each["id"] for each in session.describe()["modes"]]
    assert_lit(session, PART, POSES, lamps, task)
    pose = rc.look_at(EYES[0] + (0.1, 0.1, 0.0), CENTRE)[0]
    acted(session, do="pose", station=0, pose=pose.ravel().tolist())
    assert_lit(session, PART, np.stack([pose, POSES[1]]), lamps, task)
    with pytest.raises(ConfigError, match="expected equipment of the scene, got 'lamps 0'"):
        acted(session, do="device", device="lamps 0", pose=pose.ravel().tolist())
    session.close()


def test_the_map_of_light_is_that_of_the_report(session):
    head, levels = acted(session, "lux")
    values, *_ = values_of(PART, rc.Rig([CAMERA])._equip("lamps", LAMPS), rc.Task())["lux"]
    painted = MODES["lux"].paint(PART, OfLight(values, "lx", 70.0, None))
    assert np.array_equal(levels, painted.levels)
    assert head["legend"] == painted.legend


def test_the_image_of_a_camera_has_the_reasons_of_light():
    limits = {"max_illuminance": 120, "max_highlight_deg": 30}
    session, labels = Session(lit_scene(replace(LIT, **limits))), set()
    for station, row in enumerate(session.figures().rows):
        head, png = remove_head(session.image(station, 300))
        assert head["title"] == session.state.station(station).name
        small = CAMERA.resized(300 / CAMERA.width)
        image = by_faces(camera_scene(PART, small, POSES[station]), row.failed)
        assert np.array_equal(Image.open(BytesIO(png)), camera_pixels(image))
        labels |= {each["label"] for each in head["legend"]}
    names = ("covered", "unlit", "too_dark", "too_bright", "highlight")
    assert {REASONS[name].label for name in names} <= labels
    session.close()


def test_a_lamp_on_one_camera_of_a_rig_is_shown_on_it():
    places = np.stack([np.eye(4), POSES[1]])
    rig = rc.Rig([CAMERA, CAMERA], ["left", "right"], places)
    lamps = rc.Lamps([rc.Lamp.point(9)] * 2, PLACES, rides=["right", True])
    one, all_of_rig = describe_devices(rig._equip("lamps", lamps))
    assert (one["pose"], all_of_rig["pose"]) == (None, None)
    assert list(one["rides"]) == ["right"]
    assert np.allclose(POSES[1] @ np.reshape(one["rides"]["right"], (4, 4)), PLACES[0])
    assert np.allclose(np.reshape(all_of_rig["rides"]["left"], (4, 4)), PLACES[1])


def test_why_names_the_lamp(session):
    _, levels = acted(session)
    face = int(np.flatnonzero(levels == TOO_DARK)[0])
    said = session.why(face)
    assert "too dark" in said["words"]
    words = [each["words"] for each in said["cameras"] if each["reason"] == "too_dark"]
    assert words
    assert all(
        each in ("too dark (nearest lamp: key)", "too dark (nearest lamp: panel)") for each in words
    )


def test_work_counts_what_is_lit(session):
    before, _ = acted(session)
    work = Work(session)
    work.start({"kind": "add", "camera": "eye"})
    work.wait()
    assert work.describe()["status"] == "done", work.describe()
    gain = float(work.describe()["words"].split(": ")[1].split()[0].replace(",", ""))
    head, _ = acted(session)
    values = head["summary"]["covered_area"]["m2"] - before["summary"]["covered_area"]["m2"]
    assert values * 1e4 == pytest.approx(gain, rel=0.01)  # cm2
    assert_lit(session, PART, session.state.poses().world_from_camera, LAMPS)


def test_places_of_lamps_that_are_none_are_refused(session):
    with pytest.raises(ConfigError, match="expected equipment of the scene, got 'lamps 2'"):
        acted(session, do="device", device="lamps 2", pose=moved(PLACES[0]))
    with pytest.raises(ConfigError, match="rigid transform"):
        acted(session, do="device", device="lamps 0", pose=[0.0] * 16)
    assert session.history.revision == 0


def test_the_command_takes_lamps(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    (tmp_path / "lamps.toml").write_text(
        "[lamps.key]\nintensity_cd = 100\nposition = [0.5, 0.5, 0.5]\n"
    )
    words = "view teapot-5 -c khepra -p sphere:2 --min-illuminance 50"
    done(capsys, f"{words} --lamps lamps.toml --export page.html")
    page = (tmp_path / "page.html").read_text("utf-8")
    data = json.loads(page.partition('id="export">')[2].partition("</script>")[0])
    assert data["state"]["devices"][0]["name"] == "key"
    assert "too dark" in {each["label"] for each in data["frames"]["reason"]["legend"]}
    code, _, err = call(capsys, f"{words} --export page.html")
    assert (code, err.splitlines()[-1]) == (
        2, "error: expected lamps for --min-illuminance, got none; give lamps, or leave it out"
    )  # fmt: skip
    (tmp_path / "plan.toml").write_text(
        '[[meshes]]\nbuilt_in = "teapot-5"\n[camera]\npreset = "khepra"\n'
    )
    line = refusal(capsys, "view plan.toml --lamps lamps.toml --export page.html")
    assert "expected the lamps of the plan" in line


@pytest.mark.slow
def test_a_lamp_is_chosen_and_dragged_in_the_page(context):
    session = Session(lit_scene())
    running = Program(session)
    running.start()
    tab = Tab(context, running.url)
    names = tab.page.locator("button.name")
    assert sorted(names.all_inner_texts()) == sorted(["key", "panel", *(
        each["name"] for each in tab.state()["stations"]
    )])  # fmt: skip
    tab.page.mouse.click(*tab.place(PLACES[0][:3, 3]))
    tab.idle()
    assert tab.js("rastercov.session.chosen") == "lamps 0"
    tab.page.get_by_role("group", name="Lamps").get_by_role("button", name="panel").click()
    tab.idle()
    assert tab.js("rastercov.session.chosen") == "lamps 1"
    before = tab.area_percent()
    centre = PLACES[1][:3, 3]
    pixel = tab.js("point => rastercov.view.look().pixelAt(point)", centre.tolist())
    start, end = (tab.place(np.add(centre, (0, 0, k * pixel))) for k in (84, 150))
    tab.page.mouse.move(*start)
    tab.page.mouse.down()
    tab.page.mouse.move(*end, steps=4)
    tab.page.mouse.up()
    tab.idle()
    place = np.reshape(tab.state()["devices"][1]["pose"], (4, 4))
    assert place[2, 3] - centre[2] == pytest.approx(66 * pixel, rel=0.1)
    assert tab.area_percent() != before
    lamps = rc.Lamps(LAMPS.lamps, np.stack([PLACES[0], place]), LAMPS.names, ambient=5)
    assert_lit(session, PART, POSES, lamps)
    tab.press("ArrowUp")
    tab.idle()
    nearer = np.reshape(tab.state()["devices"][1]["pose"], (4, 4))
    assert not np.allclose(nearer, place)
    tab.button("Undo")
    tab.button("Undo")
    assert tab.area_percent() == pytest.approx(before)
    assert tab.js("rastercov.session.chosen") == "lamps 1"
    tab.press("Delete")  # of cameras alone
    assert len(tab.state()["stations"]) == 2
    tab.page.wait_for_function("rastercov.session.pieces !== undefined")
    assert tab.faults == []
    running.stop()
    session.close()


@pytest.mark.slow
def test_a_lamp_that_rides_is_drawn_where_its_cameras_are_in_the_frame(context, tmp_path):
    ride = np.eye(4)
    ride[:3, 3] = (0.1, 0, 0)
    lamps = rc.Lamps([rc.Lamp.point(9)], ride[None], rides=[True])
    session = Session(moving_scene(tmp_path, lamps=lamps, steps=3))
    running = Program(session)
    running.start()
    tab = Tab(context, running.url)
    for frame in (0, 1):
        tab.js("frame => rastercov.session.setFrame(frame)", frame)
        tab.idle()
        shown = tab.js("rastercov.session.shownDevices().map(({ pose }) => pose)")
        expected = by_hand(frame, 3)[1] @ ride
        assert np.allclose(np.reshape(shown, (-1, 4, 4)), expected)
        assert all(is_drawn(tab, place[:3, 3]) for place in expected)
    tab.js("() => rastercov.session.act({ do: 'switch', station: 1, is_on: false })")
    tab.idle()
    assert len(tab.js("rastercov.session.shownDevices()")) == 1
    assert is_drawn(tab, expected[0, :3, 3])
    assert not is_drawn(tab, expected[1, :3, 3])
    tab.js("() => rastercov.session.setMode('time')")  # its cameras are on two bodies
    tab.page.wait_for_function("rastercov.session.mode === 'reason'")
    assert "on one body" in tab.page.get_by_role("alert").inner_text()
    assert tab.faults == []
    running.stop()
    session.close()


def is_drawn(tab, point):
    """True where the picture has the colour of lamps at a world point."""
    x, y = tab.place(point)
    clip = {"x": x - 3, "y": y - 3, "width": 7, "height": 7}
    picture = Image.open(BytesIO(tab.page.screenshot(clip=clip))).convert("RGB")
    return (np.abs(np.asarray(picture, int) - LAMP_COLOUR).max(axis=2) < 40).any()


def test_reasons_of_light_follow_those_of_cameras():
    assert min(NAMES.index(name) for name in ("unlit", "too_dark", "too_bright", "highlight")) > (
        rc.Reason.COVERED
    )


def test_saved_lamps_are_read_again(session, tmp_path):
    acted(session, do="device", device="lamps 1", pose=moved(PLACES[1], (0.1, 0.2, 0.3)))
    Saving(session, tmp_path).save({"what": "rig"})
    lamps = rc.load_lamps(tmp_path / "lamps.json")
    assert lamps.to_json() == session.state.whole.equipment["lamps"].to_json()
    for text in ("{}", "[]", '{"lamps": [{"kind": 3}]}', '{"lamps": 1}', "{"):
        (tmp_path / "lamps.json").write_text(text)
        with pytest.raises(rc.RastercovError, match=r"lamps\.json") as caught:
            rc.load_lamps(tmp_path / "lamps.json")
        assert str(caught.value).isprintable()


@pytest.mark.slow
def test_a_report_of_a_lit_scene_that_moves_is_over_time(tmp_path):
    scene = moving_scene(tmp_path, lamps=LAMPS, steps=3)
    session = Session(scene)
    Saving(session, tmp_path / "out").save({"what": "report"})
    said = json.loads((tmp_path / "out" / "report" / "summary.json").read_text())["over_time"]
    moving = scene.phases
    rig = rc.Rig([CAMERA, CAMERA], ["fixed", "carried"])
    result = evaluate_over_time(
        moving.motion, rig, rc.Poses.of(POSES, camera=[0, 1]), TASK, body=["world", "head"],
        lamps=LAMPS,
    )  # fmt: skip
    assert said["covered"]["percent"] == pytest.approx(100 * result.share(), abs=1e-6)
    session.close()


MOVED = '[motion]\nturntable = { body = "part", steps = 3, centre = [0.45, 0, 0] }\n'
"""A file of motion."""


def exported(capsys, sources):
    """Content of the page that `view` writes."""
    done(capsys, f"view {sources} --export page.html")
    page = Path("page.html").read_text("utf-8")
    return json.loads(page.partition('id="export">')[2].partition("</script>")[0])


@pytest.mark.slow
def test_results_and_plans_show_the_lamps_that_were_chosen(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    PART.to_trimesh().export("part.stl")
    rc.write_poses("eyes.json", POSES)
    Path("plan.toml").write_text(
        'existing = "eyes.json"\n[[meshes]]\npath = "part.stl"\n[task]\nmin_illuminance = 12.0\n'
        '[selection]\ngoal = "best_coverage"\nlamps = 1\n[[candidates]]\nlamp = "key"\n'
        'generator = "on_sphere"\ncount = 4\ndistances = [0.6]\n[outputs]\npage = false\n[camera]\n'
        "width = 320\nheight = 240\nhfov_deg = 50.0\n[lamps.key]\nintensity_cd = 9\n" + MOVED
    )
    done(capsys, "place plan.toml")
    chosen = rc.read_views("plan/poses.json").rig.equipment["lamps"]
    for sources in ("plan", "plan.toml -p plan/poses.json"):
        data = exported(capsys, sources)
        shown = {each["name"]: each["pose"] for each in data["state"]["devices"]}
        assert list(shown) == list(chosen.names)
        assert np.allclose(np.reshape(list(shown.values()), (-1, 4, 4)), chosen.places)
        assert data["frames"]["reason@0"]["summary"]["covered"]["faces"] > 0
        assert {each["place"] for each in data["state"]["stations"]} == {"allowed"}
        assert data["scene"]["constraints"]["boxes"] == []
    data = exported(capsys, "plan.toml -p eyes.json")  # none is chosen yet: in any light
    assert not data["state"].get("devices")
    assert {each["place"] for each in data["state"]["stations"]} == {"allowed"}
    assert data["frames"]["reason@0"]["summary"]["covered"]["faces"] > 0


@pytest.mark.slow
def test_results_show_their_lamps_and_motion_again(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    Path("m.toml").write_text(MOVED)
    PART.to_trimesh().export("part.stl")
    lamp = "[lamps.key]\nintensity_cd = 9\nposition = [0.5, 0.4, 0.6]\n"
    (tmp_path / "lamps.toml").write_text(lamp)
    camera = "{width = 320, height = 240, hfov_deg = 50}"
    words = "evaluate part.stl -p sphere:2 --table none --pictures 0 -o report"
    lit = "--motion m.toml --lamps lamps.toml --min-illuminance 12 -c"
    done(capsys, [*words.split(), *lit.split(), camera])
    (tmp_path / "plan.toml").write_text(
        '[[meshes]]\npath = "part.stl"\n[task]\nmin_illuminance = 12.0\n[selection]\n'
        'goal = "best_coverage"\ncameras = 1\n[[candidates]]\ngenerator = "on_sphere"\ncount = 2\n'
        "distances = [1.0]\n[outputs]\npage = false\n[camera]\nwidth = 320\nheight = 240\n"
        "hfov_deg = 50.0\n" + lamp
    )
    done(capsys, "place plan.toml")
    for folder, n_frames in (("report", 3), ("plan", 0)):
        data = exported(capsys, folder)
        assert [each["name"] for each in data["state"]["devices"]] == ["key"]
        assert len(data["scene"].get("motion", {}).get("durations", ())) == n_frames
        frame = data["frames"]["reason@2" if n_frames else "reason"]
        assert "too dark" in {each["label"] for each in frame["legend"]}
