"""Pages of reports: nothing from outside, every figure told; pages to look around in."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from pages import read_alone

import rastercov as rc
from rastercov.base.format import percent, with_bound
from rastercov.core.area.zones import face_zones
from rastercov.core.mesh import shapes
from rastercov.report import placement as page_module
from rastercov.report.coverage import Options, run
from rastercov.report.modes import MODES
from rastercov.report.network_page import FaceRemedies
from rastercov.report.overview import Volume
from rastercov.report.pages import view_page
from rastercov.report.plan import lines, summary

CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300, cx=160, cy=120)
MESH = shapes.torus(24, 12)
POSES = rc.sphere_of_poses((0, 0, 0), 5.0, 4)
BALL = "ball <b> & co"


SOLD = "ACME 9 <wide> + 4 mm"
SHEET = {"customer": "Smith & Sons", "project": "Balls", "author": "Ann", "revision": "C"}
PLAN = {
    "sheet": SHEET,
    "camera": {"width": 320, "height": 240, "fx": 300, "fy": 300, "product": SOLD},
    "task": {"min_pixels": 20, "by": "face"},
    "candidates": [
        {"generator": "per_segment", "alpha_deg": 25, "beta_deg": 40},
        {"generator": "on_sphere", "count": 12},
    ],
    "constraints": {
        "stand_off": [3.0, 9.0], "clearance": 0.1,
        "spaces": [{"low": [-9, -9, -9], "high": [9, 9, 9]}],
        "keep_out": [{"name": "floor", "low": [-9, -9, -9], "high": [9, 9, -1]}],
    },
    "selection": {
        "goal": "best_coverage", "cameras": 2,
        "tolerance": {"position_mm": 50, "angle_deg": 0.1, "draws": 4},
    },
}  # fmt: skip


def plan(folder, **entries):
    """A ball with a name that needs escaping, over a table that only hides."""
    shapes.sphere(2, 0.5).to_trimesh().export(folder / f"{BALL}.stl")
    shapes.box((2, 2, 0.2), 1, (0, 0, -0.8)).to_trimesh().export(folder / "table.stl")
    ball, table = ({"path": str(folder / f"{name}.stl")} for name in (BALL, "table"))
    return PLAN | {"meshes": [ball, table | {"role": "occluder"}]} | entries


@pytest.fixture(scope="module")
def placement(tmp_path_factory):
    return rc.place(plan(tmp_path_factory.mktemp("plan")))


@pytest.fixture(scope="module")
def pages(placement):
    calls = []
    texts = page_module.pages_of(
        placement, summary(placement), ["a <note> for the top"], lambda *done: calls.append(done)
    )
    assert calls == [(done, 5) for done in range(6)]
    return texts


@pytest.fixture(autouse=True, scope="module")
def recorded():
    """Pages with recorded figures; those that compute are in tests/viewer/test_live_reports.py."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rastercov.report.live.engine", lambda: None)
        yield


def words_of(path):
    return " ".join(read_alone(path.read_text()).words)


def page_of(placement, **changes):
    """Words of the page of a placement whose figures are changed."""
    told = summary(placement)
    for name, entries in changes.items():
        told[name] = None if entries is None else told[name] | entries
    texts = page_module.pages_of(placement, told, lines(placement), lambda *done: None)
    return " ".join(read_alone(texts["page.html"]).words)


def test_every_figure_that_counts_is_told(placement, pages):
    page = read_alone(pages["page.html"])
    assert len(page.loads) == 2 * 5  # the cameras, what is left, the worst of it; in the dark, too
    words, told = " ".join(page.words), summary(placement)
    network, kept_out = told["network"], told["candidates"]["dropped"]["kept_out"]
    for figure in (
        f"2 cameras cover {percent(network['covered']['area_percent'] / 100)} of the area",
        f"{network['covered']['faces']:,} of {network['task_faces']:,} faces",
        percent(told["selection"]["bound"]), percent(told["tolerance"]["together"]["worst"]),
        f"{told['left']['left']['faces']:,}", "rejected: inside keep-out volume ", str(kept_out),
        BALL, SOLD, *SHEET.values(), "a <note> for the top",
        f"{network['largest_visibility_bound']:.2g}",
        *(f"{each['heading_deg']:.1f}°" for each in told["cameras"]),
    ):  # fmt: skip
        assert figure in words, figure
    assert not re.search("<note>|ball <b>", "".join(pages.values()))


def test_what_is_not_known_has_no_section(placement):
    page, without = page_of(placement), page_of(replace(placement, made={}), left=None)
    for heading in ("Tolerance", "candidates and tolerance", "Faces not covered"):
        assert heading in page
        assert heading not in without


def test_a_selection_that_covers_nothing_is_not_called_the_best(placement):
    nothing = "no candidate covers a"
    assert nothing not in page_of(placement)
    assert nothing in page_of(placement, selection={"share": 0.0, "status": "optimal"})
    assert "proved optimal" in page_of(placement, selection={"status": "optimal"})


@pytest.mark.slow
def test_by_area_dead_zones_are_listed_and_drawn(tmp_path):
    task = {"max_incidence_deg": 60, "min_pixels_per_m2": 500, "views": {BALL: 1}}
    placement = rc.place(plan(tmp_path, task=task))
    texts = page_module.pages_of(placement, told := summary(placement), [], lambda *done: None)
    words = " ".join(read_alone(texts["page.html"]).words)
    exact = told["covered_area"]
    assert f"cover {with_bound(exact['percent'], exact['bound_percent'])} of the area" in words
    assert "Dead zones" in words
    data = data_of(texts["view.html"])
    assert len(data["zones"]) == len(told["dead_zones"]) > 0
    area = np.frombuffer(base64.b64decode(data["frames"]["area"]["levels"]), np.uint8)
    share = placement.cameras.areas.covered.area[0] / placement.prepared.mesh.areas
    assert ((area > 1) == ((share > 0) & placement.prepared.mesh.task_mask)).all()


def data_of(page):
    """What an exported page holds."""
    return json.loads(re.search(r'id="export">(.*?)</script>', page, re.DOTALL)[1])


def held_by(folder):
    """Data of the page of a report, whose frames must be those of its own legend."""
    data = data_of((folder / "view.html").read_text(encoding="utf-8"))
    n_faces = data["scene"]["n_faces"]
    assert len(base64.b64decode(data["soup"])) == 36 * n_faces
    for name, frame in data["frames"].items():
        assert frame["mode"] == name
        assert len(base64.b64decode(frame["levels"])) == n_faces
    assert [each["id"] for each in data["scene"]["modes"]] == list(data["frames"])
    return data


@pytest.mark.parametrize("by", ["area", "face"])
def test_the_page_of_a_report_has_its_rig_and_its_figures(tmp_path, by):
    task = rc.Task(max_incidence_deg=70)
    told = run(
        MESH, replace(CAMERA, product=SOLD), POSES, task, tmp_path, Options(pictures=1, by=by)
    )
    assert f"{SOLD}, 320 x 240 px, field of view 56.1 x 43.6°" in words_of(tmp_path / "report.html")
    data = held_by(tmp_path)
    state, frame = data["state"], data["frames"]["views"]
    assert np.array_equal([each["pose"] for each in state["stations"]], POSES.reshape(-1, 16))
    (camera,) = state["cameras"].values()
    assert rc.Camera.from_dict(camera["plain"]) == CAMERA
    views = (rc.evaluate(MESH, CAMERA, POSES, task, by="face").reason == rc.Reason.COVERED).sum(
        axis=0
    )
    levels = MODES["views"].paint(MESH, views).levels.tobytes()
    assert base64.b64decode(frame["levels"]) == levels
    assert frame["summary"]["covered"] == told["covered"]
    assert frame["summary"].get("covered_area") == told.get("covered_area")
    faces = [each["faces"] for each in frame["summary"]["by_camera"]]
    assert faces == [each["covered_faces"] for each in told["per_pose"]]
    assert ("area" in data["frames"]) == (by == "area")
    assert len(data["zones"]) == len(told.get("dead_zones", ()))


@pytest.mark.parametrize("by", ["area", "face"])
def test_the_page_of_an_audit_shows_its_elements(tmp_path, by):
    task, camera = rc.Task(max_incidence_deg=70), replace(CAMERA, product=SOLD)
    audit = rc.audit(MESH, camera, POSES, task, by=by, out=tmp_path)
    assert SOLD in words_of(tmp_path / "audit.html")
    data = held_by(tmp_path)
    assert data["scene"]["n_faces"] == len(audit.views)
    assert list(data["frames"])[:2] == ["weak", "views"]
    shares = [each["alone_percent"] for each in data["frames"]["views"]["summary"]["by_camera"]]
    total = audit.problem.weights.sum()
    np.testing.assert_allclose(shares, 100 * audit.alone_m2 / total)
    assert "data-scene=" in (tmp_path / "audit.html").read_text()


def test_limits_of_places_are_in_the_picture(placement):
    place, floor = page_module.network_of(placement, summary(placement), has_parts=False).volumes
    assert (place.name, floor.name) == ("mounting box", "keep-out: floor")
    for volume, high in ((place, 9), (floor, -1)):
        assert len({tuple(map(tuple, edge)) for edge in volume.edges.tolist()}) == 12
        assert (np.count_nonzero(np.diff(volume.edges, axis=1), axis=2) == 1).all()
        ends = volume.edges.reshape(-1, 3)
        assert (ends.min(axis=0).tolist(), ends.max(axis=0).tolist()) == ([-9] * 3, [9, 9, high])
    ball = Volume.sphere("ball", (0, 0, 0), np.array((1.0, 2.0, 3.0)), 0.5)
    np.testing.assert_allclose(np.linalg.norm(ball.edges - (1, 2, 3), axis=2), 0.5)


def test_a_page_by_hand_of_a_placement_has_both_cameras(placement, pages):
    data = data_of(pages["view.html"])
    assert [each["name"] for each in data["state"]["stations"]] == ["camera 1", "camera 2"]
    said = data["frames"]["reason"]["summary"]
    mesh = placement.prepared.mesh
    weights = mesh.areas * mesh.task_mask / mesh.areas[mesh.task_mask].sum()
    share = 100 * weights[placement.cameras.covers[0]].sum()
    assert said["by_camera"][0]["area_percent"] == pytest.approx(share)


def test_a_mesh_too_large_for_a_report_has_no_page(monkeypatch):
    monkeypatch.setattr("rastercov.report.pages.MOST_OF_REPORT", 11)
    poses = rc.Poses.of(POSES)
    assert view_page("box", shapes.box(), CAMERA, poses, list("abcd"), {}, {}) is None


def test_zones_of_faces_are_connected_have_one_reason_and_hold_all_that_is_left():
    mesh, rng = shapes.torus(24, 12), np.random.default_rng(7)
    why = rng.integers(-1, 3, mesh.n_faces)
    zones = face_zones(mesh, why, *np.zeros((2, mesh.n_faces), np.int64))
    assert np.array_equal(zones.face, np.flatnonzero(why >= 0))
    assert zones.area.sum() == pytest.approx(mesh.areas[why >= 0].sum(), rel=1e-12)
    assert (np.diff(zones.area) <= 0).all()
    of_face = np.full(mesh.n_faces, -1)
    of_face[zones.face] = zones.zone
    one, other = mesh.topology.neighbours.T
    assert (of_face[one] == of_face[other])[(why[one] == why[other]) & (why[one] >= 0)].all()
    assert len(np.unique(np.stack((zones.zone, why[zones.face])), axis=1).T) == len(zones)


def test_advice_by_face_is_that_of_a_pose_that_fails_so(tmp_path):
    task = rc.Task(min_pixels=400)
    run(MESH, CAMERA, POSES, task, tmp_path, Options(pictures=1, by="face"))
    words = " ".join(read_alone((tmp_path / "report.html").read_text("utf-8")).words)
    assert re.search(
        r"comes closest to covering the zone's middle: [\d.]+ px at [\d.]+ m, 400 px required",
        words,
    )


def test_advice_by_face_tries_only_places_that_the_plan_allows(placement, monkeypatch):
    allowed, whole = [], FaceRemedies.say

    def said(remedies, *words, **options):
        allowed.append(remedies.allowed)
        return whole(remedies, *words, **options)

    monkeypatch.setattr(FaceRemedies, "say", said)
    page_of(placement)
    inside, outside = (0, 0, -4.0), (0, 0, 4.0)  # of the floor, which is kept free
    places = allowed[0].places(np.zeros(3), np.array([inside, outside]))
    assert places.tolist() == [list(outside)]


def test_a_percentage_is_within_the_bound_beside_it():
    rng = np.random.default_rng(3)
    values, bounds = rng.uniform(0, 100, 500), 10.0 ** rng.uniform(-9, 1, 500)
    for value, bound in zip([*values, 99.99999, 1e-7], [*bounds, 1e-9, 1e-9], strict=True):
        shown, *beside = with_bound(value, bound).removesuffix(" %").split(" ± ")
        last = 10.0 ** -len(shown.partition(".")[2])
        assert abs(float(shown) - value) + bound <= float(beside[0] if beside else last) + 1e-9
        assert 0 < float(shown) < 100
        unit = 0.1 if value >= 10 else 0.01 if value >= 1 else 0.001
        is_near = min(value, 100 - value) < 0.06
        assert is_near or bool(beside) == (bound >= unit / 2), "three digits are certain, or not"
    assert with_bound(100.0, 1e-12) == "100 %"
    assert with_bound(29.1801, 1e-6) == "29.2 %"
    assert with_bound(99.99996, 1e-9) == "99.999960 %"
    assert with_bound(99.9999999, 1.2e-10) == "99.999999 %"  # it had ± 0.001 %
    assert with_bound(99.97, 0.04) == "99.97 ± 0.04 %"  # it had no bound


@pytest.mark.parametrize(
    ("rule", "words"),
    [(rc.All(), "A point is measured if a and b and c see it."),
     (rc.All(min_baseline_deg=5, max_uncertainty=5e-5, noise_px=0.1),
      "a and b and c see it, along rays 5° or more apart, with an uncertainty of at most 50 "
      "µm."),
     (rc.All(max_baseline_deg=60), "a and b and c see it, along rays 0 to 60° apart."),
     (rc.AtLeast(2, needs=["c"]), "A point is measured if 2 of a, b, c see it, c among them.")],
)  # fmt: skip
def test_the_rule_of_a_rig_is_among_the_first_sentences(rule, words, tmp_path):
    places = np.repeat(np.eye(4)[None], 3, axis=0)
    places[:, 0, 3] = (0, 0.3, 0.6)
    rig = rc.Rig([CAMERA] * 3, list("abc"), places, rule=rule)
    run(MESH, rig, rig.poses(POSES[:1]), rc.Task(), tmp_path, Options(pictures=1))
    told = words_of(tmp_path / "report.html")
    assert words in told
    assert told.index(words) < 1000
