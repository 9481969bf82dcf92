"""Pages that are signed: whether they may be, under which conditions, and what changes give."""

import re

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.mesh import shapes
from rastercov.placement.plan.network import Requirement
from rastercov.placement.required import HOLDS, SHARE_TOLERANCE, status_of
from rastercov.report.coverage import Options, run
from rastercov.report.notebook import network_of
from rastercov.report.pages import _environment
from rastercov.report.verdict import mark_of
from rastercov.survey.flight import HIGHEST, Flight

CAMERA = {"width": 320, "height": 240, "fx": 160, "fy": 160}


@pytest.mark.parametrize("seed", range(60))
def test_a_goal_is_said_to_be_met_after_a_change_only_where_its_share_is_certain(seed):
    rng = np.random.default_rng(seed)
    share, limit, doubt, gain = rng.uniform((0, 0, 0, -0.3), (1, 1, 0.01, 0.3))
    is_most, is_about = (rng.random(2) < 0.3).tolist()
    ends = share - doubt, share, share + doubt
    status = status_of(ends[0], ends[2], limit, is_most=is_most)
    own = Requirement(None, limit, *ends, status, 4, 1, is_most=is_most)
    after, words = min(max(share + gain, 0), 1), own.after(gain, is_about=is_about)
    lack = after - limit if is_most else limit - after
    if words.endswith("the goal is then met"):
        assert not is_about
        assert lack + 2 * doubt <= SHARE_TOLERANCE * 1.01
    if "still" in words:
        assert lack > 0
    assert ("about" in words) == is_about
    assert ("seen" in words) == is_most


@pytest.mark.parametrize(
    ("passed", "lines", "said"),
    [
        (True, [("door: 9 %", HOLDS)], "May be signed: all goals are met, under the conditions"),
        (False, [("door: 9 %", "fails"), ("hall: 1 %", HOLDS)], "Not to be signed: door fails."),
        (False, [("door: 9 %", "undecided")], "Not to be signed: door is undecided."),
        (False, ["text"], "Not to be signed: not all goals are met."),
        (None, ["text"], "No goal was set"),
    ],
)
def test_a_verdict_says_whether_it_may_be_signed(passed, lines, said):
    macro = _environment("rastercov.report").get_template("macros.html").module.verdict
    html = str(macro("answer", lines, passed, ["all is opaque", "b"]))
    assert said in re.sub("<[^>]*>", "", html)
    assert "<details" not in html  # conditions are not hidden
    assert html.index("All is opaque") > html.index(said)
    assert "sign" not in str(macro("answer", ["text"], passed)).replace('class="verdict', "")


@pytest.mark.parametrize(
    ("line", "sign"),
    [
        *((("a: 1 %", status), "✓") for status in (True, HOLDS, "holds under errors")),
        *((("a: 1 %", status), "✗") for status in (False, "fails")),
        *((("a: 1 %", status), "–") for status in (None, "undecided")),
        ("a: 1 %", ""),
    ],
)
def test_a_line_has_the_sign_of_its_status(line, sign):
    assert mark_of(line)[1:] == (sign, "a: 1 %")
    macro = _environment("rastercov.report").get_template("macros.html").module.verdict
    items = re.findall("<li>(.*?)</li>", str(macro("answer", [line])))
    assert [re.sub("<[^>]*>", "", item) for item in items] == [
        f"{sign} a: 1 %" if sign else "A: 1 %"
    ]


@pytest.mark.parametrize("under", ["", "2 mm"])
def test_conditions_name_each_note_once_and_what_was_skipped(under):
    room = shapes.room()
    middle = room.bounds.mean(axis=0)
    result = rc.evaluate(
        room, rc.Camera(**CAMERA), rc.look_at([middle + np.array((1, 0, 0))], middle)
    )
    page = network_of(result)
    said = page._conditions(["far away", "far away"], {"quarantined": {"7": "was killed"}}, under)
    assert said.count("far away") == 1
    assert said[-1] == "pose 7 was skipped: its process was killed"
    assert any("no mounting errors" in text for text in said) == (not under)
    assert any("light enough everywhere" in text for text in said)
    assert not any("frames" in text or "samples" in text or "straight" in text for text in said)


def test_a_page_names_glass_and_what_its_reader_left_out(tmp_path):
    room = shapes.room()
    groups = [rc.Group(name) for name in ("hall", "IfcWindow/east", "Glass door")]
    groups.append(rc.Group("outdoors", is_occluder=True))
    of_faces = np.where(np.arange(room.n_faces) < 9, np.arange(room.n_faces) % 3, 0)
    mesh = rc.Mesh(room.vertices, room.faces, groups, of_faces)
    middle = room.bounds.mean(axis=0)
    poses = rc.look_at([middle + np.array((1, 0, 0))], middle)
    run(mesh, rc.Camera(**CAMERA), poses, rc.Task(), tmp_path, Options(pictures=1))
    told = " ".join((tmp_path / "report.html").read_text("utf-8").split())
    verdict = told[told.index('class="verdict') :].partition("</div>")[0]
    assert "IfcWindow/east, Glass door" in verdict
    assert "outdoors" not in verdict  # it has no faces
    assert "no mounting errors" in verdict
    assert "none is modelled" in verdict
    assert "No goal was set" in verdict


@pytest.mark.parametrize("height", [50, 110, 121, 130])
def test_a_flight_names_the_limits_of_height_that_it_is_above(height):
    placement = rc.place(
        {
            "meshes": [{"built_in": "box", "transform": {"scale": 200}}],
            "camera": CAMERA,
            "task": {"resolution_of_result": 20.0},
            "candidates": [
                {"generator": "orbit", "radius": 40, "heights": [100 + height], "count": 4}
            ],
            "selection": {"goal": "all"},
            "outputs": {"page": False},
            "flight": {},
        }
    )
    flight = placement.product("flight")
    assert isinstance(flight, Flight)
    over = [text for most, text in HIGHEST.items() if height > most]
    (line,) = [note for note in flight.notes if "above ground" in note] or [""]
    assert all((text in line) == (text in over) for text in HIGHEST.values())
    assert any("no battery" in note for note in flight.notes)
