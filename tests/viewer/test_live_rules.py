"""Rules of rigs in a page that computes: its figures and words are those of `rastercov`."""

import json

import numpy as np
import pytest
from browser import Tab, context_of
from edited import Session
from failing_twin import ORDER, failing
from nightly import IS_NIGHTLY
from page_in_node import NEEDS_NODE, PAGE
from page_in_node import node as node
from rigs_to_view import EYES, ROOM, WIDE, acted
from test_live import act, downloaded

import rastercov as rc
from rastercov.core.area.rows import rule_reasons
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.coverage.task import (
    BASELINE,
    NAMES,
    UNCERTAIN,
    Reason,
    nearness,
)
from rastercov.page.live import record_cause
from rastercov.page.rig_state import RigState
from rastercov.page.saving import export_page
from rastercov.page.scene import Scene
from rastercov.report import live

WITHOUT = pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
SLOW = pytest.mark.slow
EVERY_DAY = pytest.mark.every_day
PLACES = [np.eye(4) for _ in range(3)]
for _place, _x in zip(PLACES, (0.0, 0.4, -0.4), strict=True):
    _place[0, 3] = _x
NAMES_OF_DEVICES = ["left", "projector", "right"]
TASKS = {"projector": rc.Task(max_incidence_deg=60)}
RULES = {
    "pair": rc.All(),
    "angles": rc.All(min_baseline_deg=7, max_baseline_deg=14),
    "certain": rc.All(max_uncertainty=0.03, noise_px=0.3),
    "stripes": rc.All(
        min_baseline_deg=5,
        max_uncertainty=0.02,
        noise_px={"left": 0.2, "projector": 0.4, "right": 0.3},
        stripes=["projector"],
    ),
    "two of three": rc.AtLeast(2, needs=["projector"]),
    "any two": rc.AtLeast(2),
}


def rig_of(name):
    """A rig of the rule of that name."""
    n = 2 if name in ("pair", "angles", "certain") else 3
    tasks = TASKS if name == "stripes" else {}
    return Rig([WIDE] * n, NAMES_OF_DEVICES[:n], PLACES[:n], rule=RULES[name], tasks=tasks)


def session_of_rig(rig, task=None, mesh=ROOM):
    """A session on a room with a rig at two places."""
    poses = rig.poses(rc.look_at(np.array(EYES), np.array([(0.0, 0.0, 0.6)] * len(EYES))))
    return Session(Scene("room", mesh, RigState.of(rig, poses, task=task or rc.Task())))


def random_rule(rng, n):
    """A rule of n devices by their names "0", "1", ..."""
    some = [str(row) for row in rng.permutation(n)]
    if rng.random() < 0.5:
        k = int(rng.integers(1, n + 1))
        return rc.AtLeast(k, needs=some[: int(rng.integers(k + 1))])
    least, most = np.sort(rng.uniform(0, 60, 2)).tolist()
    limits = {"min_baseline_deg": least * (rng.random() < 0.5)}
    limits["max_baseline_deg"] = 180.0 if rng.random() < 0.5 else most
    if rng.random() < 0.6:
        limits |= {"max_uncertainty": float(10 ** rng.uniform(-3, 0)), "noise_px": 1.0}
        limits["stripes"] = some[: int(rng.integers(n))]
    return rc.All(**limits)


def random_case(rng):
    """What fails of a rule at a point by Python, and the same for its twin and for the page."""
    n = int(rng.integers(2, 6))
    rig = Rig([WIDE] * n, [str(row) for row in range(n)], rule=random_rule(rng, n))
    world = rc.look_at(rng.normal((0, 0, 1), 1, (n, 3)), rng.normal(0, 0.2, 3))
    point, normal = rng.normal(0, 0.2, (2, 3))
    normal /= np.linalg.norm(normal)
    every = [row for row in ORDER if row not in (BASELINE, UNCERTAIN)]
    every = (every, [Reason.COVERED], range(Reason.COVERED, 35))[rng.integers(3)]
    reasons = rng.choice([*every, Reason.COVERED], n).astype(np.uint8)
    on = point[None], normal[None]
    poses = Poses.of(world, camera=list(range(n)))
    result, device = rule_reasons(reasons[:, None], rig, poses, *on)
    (gate,) = live.describe_union(rig)["gates"]
    gate["noise"] = [each / WIDE.fx for each in gate["image_noise"]] or None
    given = {"gate": gate, "poses": world.reshape(n, 16).tolist(), "reasons": reasons.tolist()}
    twin = failing(rig.gates[0]._for_kernels(), world, *on, reasons[:, None])
    own = (int(result[0, 0]), int(device[0, 0]))
    return (
        own,
        tuple(int(each[0]) for each in twin),
        given | {"point": point.tolist(), "normal": normal.tolist()},
    )


@NEEDS_NODE
@WITHOUT
def test_what_fails_of_a_rule_is_that_of_python_and_of_its_twin(node, tmp_path):
    rng = np.random.default_rng(9)
    expected, twins, cases = zip(*(random_case(rng) for _ in range(3000)), strict=True)
    path = tmp_path / "cases.json"
    path.write_text(json.dumps(cases))
    items = [
        (each["reason"], each["device"]) for each in node("rules.mjs", PAGE / "engine.wasm", path)
    ]
    named = {NAMES[reason] for reason, _ in expected}
    assert {"covered", "baseline", "uncertain", "occluded", "too_oblique+occluded"} <= named
    assert [*expected] == [*twins]
    assert items == [*expected]


def test_ranks_of_reasons_are_those_of_the_order():
    order = nearness(np.array(ORDER))
    assert (np.diff(order) > 0).all()
    assert {NAMES[row] for row in set(range(len(NAMES))) - set(ORDER)} == {
        "too_few_views", "no_cameras", "unseeable"
    }  # fmt: skip


@pytest.fixture(scope="module", params=RULES)
def opened(browser, tmp_path_factory, request):
    """A session of a rig, and the page that it exports; nothing failed in it.

    All tests of a rule use one page; the last of them edits it.
    """
    task = rc.Task(max_incidence_deg=80, min_pixel_density=40.0)
    session = session_of_rig(rig_of(request.param), task)
    assert record_cause(session, session.scene.start) == ""
    path = export_page(session, tmp_path_factory.mktemp("rule") / "page.html", is_still=False)
    with context_of(browser) as context:
        page = Tab(context, path.resolve().as_uri())
        yield session, page
        session.close()
        assert page.faults == []


def moved_at_random(page, rng):
    """Moves a rig of a page, its last camera by itself, and changes a lens now and then."""
    state = page.state()
    stations = state["stations"]
    n = len({each["camera"] for each in stations})
    first = int(rng.integers(len(stations) // n)) * n
    eye = np.array(EYES[first // n]) + rng.uniform(-0.6, 0.3, 3) * np.sign(EYES[first // n])
    rig = rc.look_at(eye, rng.uniform(-1, 1, 3))[0]
    for device, station in enumerate(stations[first : first + n]):
        place = PLACES[device].copy()
        place[:3, 3] += rng.normal(0, 0.02, 3)
        station["pose"] = (rig @ place).ravel().tolist()
    last = stations[first + n - 1]
    moved = {"station": last["id"], "pose": last["pose"]}
    last["pose"] = page.pose(first + n - 1).ravel().tolist()
    act(page, do="restore", rig={name: state[name] for name in ("stations", "cameras", "task")})
    act(page, do="pose", **moved)
    if rng.random() < 0.3:
        changes = {"hfov_deg": float(rng.uniform(70, 110))}
        act(page, do="camera", camera=stations[first]["camera"], changes=changes)


def network_of(page):
    """Rig, poses and task of the files that a page saves."""
    rig = json.loads(downloaded(page)["rig.json"])
    state = page.state()
    task = rc.Task(**{k: v for k, v in state["task"].items() if v is not None})
    return rig, task


@SLOW
@WITHOUT
def test_reasons_figures_of_cameras_and_zones_are_those_of_rastercov(opened):
    session, page = opened
    own, told = page.js("rastercov.summary()"), session.figures().summary()
    assert own["covered_area"]["m2"] == pytest.approx(told["covered_area"]["m2"], rel=1e-12)
    for pair, wanted in zip(own["by_camera"], told["by_camera"], strict=True):
        for name in ("station", "area_percent", "alone_percent"):
            assert pair[name] == pytest.approx(wanted[name], rel=1e-12, abs=1e-9), name
    zones = page.js("rastercov.session.server.zones()")
    pieces = page.js("rastercov.session.server.found.pieces")
    by_reason = {}
    for reason, area in zip(pieces["reasons"], pieces["areas"], strict=True):
        by_reason[reason] = by_reason.get(reason, 0.0) + area
    state = session.state
    poses, _ = state.cameras_that_count()
    why = rc.evaluate(ROOM, state.whole, poses, state.task, fields=()).summary()
    expected = why["not_covered_because"]
    most = why["covered_area"]["bound_m2"] + 1e-9 * why["covered_area"]["of_m2"]
    for name in by_reason.keys() | expected.keys():  # what may be covered is no zone of a command
        wanted = expected.get(name, {"m2": 0.0})["m2"]
        assert by_reason.get(name, 0.0) == pytest.approx(wanted, rel=1e-9, abs=most), name
    served = session.zones()
    devices = 0
    for pair, wanted in zip(zones[:10], served[:10], strict=True):
        assert pair["area"] == pytest.approx(wanted["area"], rel=1e-9)
        assert pair["reason"] == wanted["reason"]
        devices += pair["words"].endswith(")")
        assert pair["words"].endswith(")") == wanted["words"].endswith(")")
    assert devices


@SLOW
@WITHOUT
def test_a_click_names_what_fails_of_the_rule_as_python_does(opened):
    session, page = opened
    heard = set()
    for face in range(0, ROOM.n_faces, 7 if IS_NIGHTLY else 28):
        said = page.js("face => rastercov.session.server.why(face)", face)
        served = session.why(face)
        heard.add(said["words"].partition(": ")[2])
        assert said["words"] == served["words"], face
        for pair, wanted in zip(said["cameras"], served["cameras"], strict=True):
            for name in ("reason", "words", "help", "occluder"):
                assert pair[name] == wanted[name], (face, name)
    assert len(heard) > 3


@SLOW
@WITHOUT
def test_faces_have_the_colours_of_heads_as_on_a_served_page(opened):
    """Modes count, rate and name heads, whose sensors have one row; the page had single sensors."""
    session, page = opened
    figures = session.figures()
    n = len(EYES)
    heads = [f"head {row + 1}" for row in range(n)]
    assert [each["name"] for each in page.state()["heads"]] == heads
    assert figures.values["camera"]().names == heads
    assert len(figures.of_heads) == n == len(figures.rows) / len(session.state.whole)
    assert 0 < figures.views.max() <= n
    reason = figures._judged[0]
    assert np.array_equal(figures.views, (reason == Reason.COVERED).sum(axis=0))
    shown = page.page.locator(".row.of-head .who").all_text_contents()
    assert shown == heads
    assert page.page.locator(".cameras .row:not(.head):not(.of-head) .figure").count() == 0
    modes = page.js("rastercov.session.scene.modes.map(each => each.id)")
    gate = session.state.whole.gates[0]
    assert "device" in modes
    assert ("uncertainty" in modes) == gate.has_deviation
    for mode in (
        "camera",
        "views",
        "reason",
        "density",
        "coverage",
        *{"device", "uncertainty", "incidence"} & set(modes),
    ):
        page.js("mode => rastercov.session.setMode(mode)", mode)
        page.idle()
        head, levels = acted(session, mode)
        assert len(np.unique(levels)) > (mode != "views")
        off = np.abs(np.frombuffer(page.levels(), np.uint8).astype(int) - levels) > 1
        assert off.mean() < 0.005, mode
        legend = page.js("rastercov.session.figures.legend")
        assert [each["label"] for each in legend] == [each["label"] for each in head["legend"]]
        assert [each["colour"] for each in legend] == [each["colour"] for each in head["legend"]]
    page.js("rastercov.session.setMode('reason')")


@SLOW
@WITHOUT
@pytest.mark.parametrize(
    "opened",
    [pytest.param(name, marks=EVERY_DAY if name == "stripes" else ()) for name in RULES],
    indirect=True,
)
def test_edits_give_the_figures_of_check_to_the_last_digit(opened, tmp_path, monkeypatch):
    _, page = opened
    rng = np.random.default_rng(11)
    monkeypatch.chdir(tmp_path)
    n, covering = 200 // len(RULES) if IS_NIGHTLY else 2, 0
    for _ in range(n):
        moved_at_random(page, rng)
        for name, text in downloaded(page).items():
            (tmp_path / name).write_text(text)
        told = rc.check("plan.toml", "rig.json", min_coverage=0.1).summary()["covered_area"]
        value = page.js("rastercov.summary().covered_area")
        covering += 0 < value["m2"] < value["of_m2"]
        assert (value["m2"], value["percent"]) == (told["m2"], told["percent"])
        assert value["bound_m2"] == pytest.approx(told["bound_m2"], rel=1e-9, abs=1e-12)
    assert covering > n / 2  # a camera of a rig may be behind a wall


@SLOW
@WITHOUT
def test_a_rig_without_one_of_its_cameras_measures_nothing_and_is_not_saved(context, tmp_path):
    session = session_of_rig(rig_of("pair"))
    page = Tab(context, export_page(session, tmp_path / "page.html", is_still=False).as_uri())
    before = page.area_percent()
    act(page, do="switch", station=0, is_on=False)
    assert 0 < page.area_percent() < before
    assert len(page.js("rastercov.summary().by_camera")) == 2
    act(page, do="switch", station=2, is_on=False)
    assert page.area_percent() == 0
    ask = "face => rastercov.session.server.why(face).then(({ words }) => words)"
    said = {page.js(ask, face).partition(": ")[2] for face in range(0, ROOM.n_faces, 31)}
    assert said == {"not covered, no cameras."}  # the sensors that are left see, and do not count
    act(page, do="switch", station=0, is_on=True)
    act(page, do="delete", station=3)
    assert page.js("rastercov.session.server.save('rig').catch(error => error.message)").startswith(
        "expected all cameras of each rig with a rule, in its order, got others;"
    )
    session.close()


@SLOW
@WITHOUT
def test_the_best_next_rig_has_all_its_cameras_at_their_places(context, tmp_path):
    session = session_of_rig(rig_of("pair"))
    page = Tab(context, export_page(session, tmp_path / "page.html", is_still=False).as_uri())
    before = page.area_percent()
    page.open("Cameras")
    page.page.get_by_role("button", name="Add the best next camera").click()
    page.page.wait_for_function("rastercov.state().stations.length === 6")
    page.idle()
    assert page.area_percent() > before + 3
    left, right = (np.reshape(each["pose"], (4, 4)) for each in page.state()["stations"][4:])
    np.testing.assert_allclose(np.linalg.inv(left) @ right, PLACES[1], atol=1e-12)
    assert page.faults == []
    session.close()


@SLOW
@WITHOUT
def test_a_report_of_a_rig_opens_a_page_that_computes(context, tmp_path):
    from rastercov.report.coverage import Options, run

    rig = Rig(
        [WIDE] * 2, ["left", "projector"], PLACES[:2], rule=RULES["angles"],
        tasks={"projector": {"max_incidence_deg": 70}},
    )  # fmt: skip
    poses = rig.poses(rc.look_at(np.array(EYES), np.array([(0.0, 0.0, 0.6)] * 2)))
    told = run(ROOM, rig, Poses.of(poses), rc.Task(), tmp_path, Options(pictures=1))
    page = Tab(context, (tmp_path / "view.html").as_uri())
    value = page.js("rastercov.summary().covered_area")
    assert value["m2"] == pytest.approx(told["covered_area"]["m2"], rel=1e-12)
    assert [each["camera"] for each in page.state()["stations"]] == ["left", "projector"] * 2
    assert page.faults == []
