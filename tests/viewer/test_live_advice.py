"""Advice of a page that computes is that of Python."""

import json
import math

import numpy as np
import pytest
from browser import Tab
from page_in_node import NEEDS_NODE
from page_in_node import node as node
from rigs_to_view import ROOM, acted, session_of_room

import rastercov as rc
from rastercov.core.area.advice import advice
from rastercov.core.coverage.task import REASONS
from rastercov.page.saving import export_page
from rastercov.report import live

REASONS_OF_POINTS = (
    "back_facing",
    "outside",
    "out_of_focus",
    "too_coarse",
    "occluded",
    "too_oblique",
)
LIMITS = {"max_incidence_deg": 47.5, "min_pixel_density": 90.0, "min_facing_density": 150.0}


def case_of(rng):
    """Arguments of `advice`, and the same for the page."""
    size = float(10.0 ** rng.uniform(-6, 5))
    figures = {
        "distance": size,
        "incidence": float(rng.uniform(0, math.pi / 2)),
        "pixel_density": float(rng.choice((0.0, 10.0 ** rng.uniform(-3, 7)))),
        "facing_density": float(10.0 ** rng.uniform(-3, 7)),
    }
    task = rc.Task(
        max_incidence_deg=round(float(rng.uniform(1, 90)), 3),
        min_pixel_density=float(rng.choice((0.0, 10.0 ** rng.uniform(0, 6)))),
        min_facing_density=float(rng.choice((0.0, 10.0 ** rng.uniform(0, 6)))),
    )
    near = float(rng.uniform(0, size))
    far = math.inf if rng.random() < 0.3 else near + float(rng.uniform(0, size))
    camera = rc.Camera(width=640, height=480, fx=600, fy=600, focus_range=(near, far))
    depth = size * rng.uniform(-0.2 if rng.random() < 0.5 else 0.1, 1, 3)
    reason = str(rng.choice(REASONS_OF_POINTS))
    hider, unit = str(rng.choice(("", "beam"))), str(rng.choice(("m", "unit")))
    said = advice(reason, figures, depth, task, camera, hider, unit)
    limits = {name: getattr(task, name) for name in LIMITS}
    focus = [near, "inf" if math.isinf(far) else far]
    template = REASONS[reason].advice
    return said, ["advice_of", template, figures, depth.tolist(), limits, focus, hider, unit]


@NEEDS_NODE
def test_texts_are_those_of_python(node, tmp_path):
    rng = np.random.default_rng(5)
    texts, cases = zip(*(case_of(rng) for _ in range(3000)), strict=True)
    path = tmp_path / "cases.json"
    path.write_text(json.dumps(cases))
    assert node("texts.mjs", path) == list(texts)


@pytest.mark.slow
@pytest.mark.skipif(live.engine() is None, reason="no engine.wasm; run: make wasm")
def test_a_click_gives_the_advice_of_a_served_page(context, tmp_path):
    session = session_of_room()
    page = Tab(context, export_page(session, tmp_path / "page.html", is_still=False).as_uri())
    corners = ROOM.vertices[ROOM.faces]
    heights = [(corners - each.pose[:3, 3]) @ each.pose[:3, 2] for each in session.state.on]
    faces = np.flatnonzero(np.min(np.abs(heights), axis=(0, 2)) > 1e-9)[::9].tolist()
    reasons = []
    for changes in ({"max_incidence_deg": 47.5}, LIMITS):
        page.js(f"rastercov.session.act({{do: 'task', changes: {json.dumps(changes)}}})")
        page.idle()
        acted(session, do="task", changes=changes)
        for face in faces:
            said = page.js("face => rastercov.session.server.why(face)", face)["cameras"]
            for pair, wanted in zip(said, session.why(face)["cameras"], strict=True):
                reasons.append(pair["reason"])
                for name in ("reason", "words", "help", "occluder"):
                    assert pair[name] == wanted[name], (face, name)
    session.close()
    assert {"back_facing", "outside", "too_coarse", "occluded", "too_oblique"} <= set(reasons)
