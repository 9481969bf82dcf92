"""Lamps as candidates: chosen sets against all sets, from place to check, and what is refused."""

import json
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from commands import done, enter, refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import told
from timed import evaluate_over_time

import rastercov as rc
from rastercov.light import lamp_choice as choice
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.prepare import cells_of
from rastercov.placement.plan.scene import name_scene

CAMERA = {"width": 96, "height": 72, "fx": 90.0, "fy": 90.0}
EYES = rc.look_at([(0, -4, 1.5), (3.5, 0, 2)], (0, 0, 0))
PLAN = {
    "ambient": "5 lx",
    "meshes": [{"built_in": "icosahedron"}],
    "camera": CAMERA,
    "lamps": {
        "key": {"kind": "spot", "intensity_cd": 900.0, "half_angle_deg": 40.0, "cost": 2.0},
        "fill": {"kind": "area", "size": 0.3, "points": 4, "intensity_cd": 200.0},
    },
    "task": {"max_incidence_deg": 75.0, "min_illuminance": "25 lx", "gloss": "satin"},
    "existing": "eyes.json",
    "candidates": [
        {"generator": "on_sphere", "count": 8, "distances": [5.0], "lamp": "key"},
        {"generator": "on_sphere", "count": 5, "distances": [3.0], "lamp": "fill"},
    ],
    "selection": {"goal": "best_coverage", "lamps": 2},
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    write_eyes(EYES)


def write_eyes(poses):
    Path("eyes.json").write_text(json.dumps({"world_from_camera": np.asarray(poses).tolist()}))


def some_lamps(placed, rows):
    """Lamps of candidates, made anew from the plan's kinds and the places of the pool."""
    own, pool = (
        [rc.Lamp.spot(40, 900), rc.Lamp.area(0.3, intensity=200, points=4)],
        placed.choices["lamps"],
    )
    kinds = [own[row] for row in pool.pool.candidates.camera[list(rows)]]
    return rc.Lamps(kinds, pool.pool.candidates.poses[list(rows)], ambient=5)


SCENES = st.fixed_dictionaries({
    "counts": st.tuples(st.integers(1, 3), st.integers(1, 2)),
    "least": st.sampled_from([8.0, 25.0, 60.0, 120.0]),
    "limits": st.sampled_from([{}, {"gloss": "satin"}, {"max_illuminance": 150.0}]),
    "eyes": st.lists(st.integers(0, 11), min_size=1, max_size=3, unique=True),
    "views": st.integers(1, 2),
})  # fmt: skip
ROUND = rc.sphere_of_poses((0, 0, 0), 4.0, 12)


def hostile(scene, **selection):
    """A plan of a drawn scene."""
    write_eyes(ROUND[scene["eyes"]])
    counts = dict(zip(("key", "fill"), scene["counts"], strict=True))
    entries = [{**each, "count": counts[each["lamp"]]} for each in PLAN["candidates"]]
    task = {"max_incidence_deg": 75.0, "min_illuminance": scene["least"], **scene["limits"]}
    task["views"] = scene["views"]
    return PLAN | {"candidates": entries, "task": task, "selection": selection}


def placed_or_none(plan):
    try:
        return rc.place(plan)
    except rc.ConfigError as error:
        assert "light what cameras see" in str(error)  # noqa: PT017 - or it is placed


def share_of(placed, rows):
    """Share of the area that the cameras of a placement cover in the light of some candidates."""
    areas = rc.regions(
        placed.prepared.mesh, rc.Rig(placed.prepared.plan.rig.cameras), placed.cameras.placed,
        placed.prepared.task, lamps=some_lamps(placed, rows),
    )  # fmt: skip
    views = placed.prepared.task.views
    return rc.unite(areas, views).share(views)


@given(scene=SCENES, exchanged=st.booleans())
@settings(max_examples=4, deadline=None)
def test_no_set_of_lamps_is_better_than_the_chosen(scene, exchanged):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice, "MOST_SETS", 0 if exchanged else choice.MOST_SETS)
        placed = placed_or_none(hostile(scene, goal="best_coverage", lamps=2))
    if placed is None:
        return
    choices, n = placed.choices["lamps"], len(placed.choices["lamps"].pool.candidates)
    shares = {
        rows: share_of(placed, rows)
        for k in (1, 2) if k <= n
        for rows in combinations(range(n), k)
    }  # fmt: skip
    chosen = tuple(sorted(choices.chosen))
    assert placed.cameras.share == pytest.approx(shares[chosen], abs=1e-9)
    assert choices.together["percent"] == pytest.approx(100 * shares[chosen], abs=1e-7)
    assert choices.is_best is not exchanged
    near = [share for rows, share in shares.items() if len({*rows} ^ {*chosen}) <= 2]
    assert shares[chosen] == pytest.approx(max(near), abs=1e-8)
    if choices.is_best:
        assert shares[chosen] == pytest.approx(max(shares.values()), abs=1e-8)
        assert choices.n_tried == len(shares)
    singly = [share for rows, share in shares.items() if len(rows) == 1 and rows[0] in chosen]
    if not scene["limits"]:  # light that only adds up
        assert 100 * max(singly) - 1e-7 <= choices.alone["percent"]
        assert choices.alone["percent"] <= choices.together["percent"] + 1e-7


@given(scene=SCENES, part=st.floats(0.3, 1.0))
@settings(max_examples=4, deadline=None)
def test_the_cheapest_set_that_reaches_a_goal_is_chosen(scene, part):
    plan = hostile(scene, goal="best_coverage", lamps=3)
    most = placed_or_none(plan)
    if most is None:
        return
    goal = part * most.cameras.share
    placed = rc.place(hostile(scene, goal="fewest_cameras", coverage=goal))
    choices, n = placed.choices["lamps"], len(placed.choices["lamps"].pool.candidates)
    costs = choices.pool.costs
    enough = [
        costs[list(rows)].sum()
        for k in range(1, n + 1)
        for rows in combinations(range(n), k)
        if share_of(placed, rows) >= goal + 1e-7
    ]
    assert placed.requirements[0].share >= goal - 1e-6
    assert costs[choices.chosen].sum() <= min(enough, default=np.inf)


def test_three_lamps_reach_together_what_no_two_reach():
    key = {"generator": "on_sphere", "count": 40, "distances": [5.0], "lamp": "key"}
    plan = PLAN | {"ambient": 0.0, "lamps": {"key": PLAN["lamps"]["key"]}, "candidates": [key]}
    goal = {"goal": "best_coverage", "lamps": 3}
    placed = rc.place(plan | {"task": {"min_illuminance": 108.0}, "selection": goal})
    assert len(placed.choices["lamps"].chosen) == 3
    assert placed.choices["lamps"].alone["percent"] == 0
    assert placed.choices["lamps"].together["percent"] > 2


def test_exchanges_lead_from_any_lamp_to_the_best():
    plan = plan_of(PLAN | {"selection": {"goal": "best_coverage", "lamps": 1}}, Path("plan.toml"))
    mesh, plan, _ = name_scene(plan)
    lighting = choice.Lighting(plan, mesh, cells_of(plan, mesh), rc.Poses.of(EYES))
    alone = {(row,): lighting.worth((row,)) for row in range(13)}
    best = max(alone.values())
    assert min(alone.values()) < best
    for start in alone:
        assert lighting.worth(lighting.exchange(start, np.inf)) == best


def toml(table, head=""):
    """A plan as TOML."""
    own = {key: value for key, value in table.items() if not isinstance(value, dict)}
    lines = [f"{key} = {inline(value)}" for key, value in own.items()]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += [f"[{head}{key}]", toml(value, f"{head}{key}.")]
    return "\n".join(lines)


def inline(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {inline(each)}" for key, each in value.items()) + "}"
    return f"[{', '.join(map(inline, value))}]" if isinstance(value, list) else json.dumps(value)


def test_chosen_lamps_go_from_place_to_check_and_to_the_pages(capsys):
    Path("plan.toml").write_text(toml(PLAN))
    out, _ = done(capsys, "place plan.toml -o out")
    assert "2 of 13 candidates for lamps (the best of " in out
    assert "of the area is visible and lit with all lamps on, " in out
    content, file = told(), told("poses.json")
    names = [each["lamp"] for each in content["lamps"]["chosen"]]
    assert file["lamps"]["names"] == names
    done(capsys, "view out --export view.html")  # of a built-in mesh, whose file is the plan
    page = Path("out/page.html").read_text()
    assert all(f"lamp {name} at" in page and f">{name}</td>" in page for name in names)
    assert content["lamps"]["together"]["percent"] == pytest.approx(
        100 * content["share"], abs=1e-7
    )
    assert [each["lamp"] for each in content["network"]["light"]["lamps"]] == names
    assert [each["origin"] for each in content["cameras"]] == ["existing 0", "existing 1"]
    least = content["share"] - 1e-4
    done(
        capsys,
        f"check plan.toml -p out/poses.json --min-coverage {least} --junit junit.xml -o checked",
    )
    assert not ET.parse("junit.xml").getroot().findall(".//failure")
    assert rc.check("plan.toml", "out/poses.json", min_coverage=0.1).whole.share == pytest.approx(
        content["share"], abs=1e-12
    )
    done(
        capsys,
        "evaluate icosahedron -p out/poses.json --by area --max-incidence-deg 75 "
        '--min-illuminance "25 lx" --max-highlight-deg satin -o lit --pictures 0',
    )
    summary = json.loads(Path("lit/summary.json").read_text())
    assert summary["covered_area"]["percent"] == pytest.approx(100 * content["share"], abs=1e-7)


def test_lamps_that_stay_count_with_the_chosen_ones():
    stays = {"kind": "point", "intensity_cd": 300.0, "position": [0.0, -3.0, 3.0]}
    rides = {"kind": "spot", "intensity_cd": 90.0, "half_angle_deg": 40.0, "rig": True}
    own = {**PLAN["lamps"], "stays": stays, "rides": rides}
    placed = rc.place(PLAN | {"lamps": own, "selection": {"goal": "best_coverage", "lamps": 1}})
    lamps = placed.choices["lamps"].lamps
    assert lamps.names[:2] == ("stays", "rides")
    assert len(lamps) == 3
    mesh, task = placed.prepared.mesh, placed.prepared.task
    regions = rc.regions(mesh, rc.Camera(**CAMERA), EYES, task, lamps=lamps)
    assert placed.cameras.share == pytest.approx(rc.unite(regions).share(), abs=1e-9)


def test_cameras_and_lamps_are_chosen_in_turns():
    own = [{"generator": "on_sphere", "count": 10, "distances": [4.0]}, *PLAN["candidates"]]
    plan = {name: value for name, value in PLAN.items() if name != "existing"}
    goal = {"goal": "best_coverage", "cameras": 2, "lamps": 2}
    alone = {"outputs": {"page": False}}
    placed = rc.place(plan | alone | {"candidates": own, "selection": goal}, out="out")
    assert (len(placed.cameras.placed), len(placed.choices["lamps"].chosen)) == (2, 2)
    regions = rc.regions(
        placed.prepared.mesh, rc.Camera(**CAMERA), placed.cameras.placed, placed.prepared.task,
        lamps=placed.choices["lamps"].lamps,
    )  # fmt: skip
    assert placed.cameras.share == pytest.approx(rc.unite(regions).share(), abs=1e-9)
    checked = rc.check(plan, "out/poses.json", min_coverage=0.1)
    assert checked.whole.share == pytest.approx(placed.cameras.share, abs=1e-12)
    # no worse than lamps for cameras that are chosen as if all were lit
    dark = {name: value for name, value in plan.items() if name not in ("lamps", "ambient")}
    dark |= {"candidates": own[:1], "task": {"max_incidence_deg": 75.0}}
    cameras = rc.place(dark | {"selection": {"goal": "best_coverage", "cameras": 2}}).cameras
    write_eyes(cameras.poses)
    once = rc.place(PLAN)
    assert placed.cameras.share >= once.cameras.share - 1e-9


def test_lamps_are_chosen_over_time():
    motion = {"turntable": {"body": "icosahedron", "steps": 3, "degrees": 120.0}}
    bodies = [{"name": "icosahedron", "groups": ["mesh"]}]
    own = [{**PLAN["candidates"][0], "count": 3}]
    task = {"max_incidence_deg": 75.0, "min_illuminance": 25.0, "over": 0.6}
    moving = {"motion": motion, "bodies": bodies, "candidates": own, "task": task}
    moving["lamps"] = {"key": PLAN["lamps"]["key"]}
    placed = rc.place(PLAN | moving | {"selection": {"goal": "best_coverage", "lamps": 1}})
    over = placed.cameras.areas.over_time
    scene = over.motion, rc.Camera(**CAMERA), EYES, over.task, 0.6
    shares = [
        evaluate_over_time(*scene, lamps=some_lamps(placed, [row])).share() for row in range(3)
    ]
    assert max(shares) > 0
    assert placed.cameras.share == pytest.approx(max(shares), abs=1e-9)
    assert placed.cameras.share == pytest.approx(
        shares[placed.choices["lamps"].chosen[0]], abs=1e-9
    )


def test_a_lamp_is_chosen_for_a_sensor_and_a_part_of_what_it_sees():
    camera = {"camera": "cam", "name": "proj", "translation": [0.5, 0.0, 0.0]}
    sensor = {"fringe": {"rule": "all", "cameras": [{"camera": "cam"}, camera]}}
    both = {"cameras": {"cam": CAMERA}, "rigs": sensor}
    dark = {"meshes": PLAN["meshes"], "task": {"max_incidence_deg": 75.0}, **both}
    places = [{"generator": "on_sphere", "count": 6, "distances": [4.0], "cameras": ["fringe"]}]
    goal = {"goal": "best_coverage", "cameras": 2}
    dark["outputs"] = {"page": False}
    seen = rc.place(dark | {"candidates": places, "selection": goal}, out="sensor")
    plan = changed(camera=None, existing="sensor/poses.json", **both)
    part = {"goal": "fewest_cameras", "coverage": 0.5, "of_reachable": True}
    placed = rc.place(plan | {"task": {**dark["task"], "min_illuminance": 25.0}, "selection": part})
    rig, task = placed.prepared.plan.rig, placed.prepared.task
    lit = rc.regions(placed.prepared.mesh, rig, placed.cameras.placed, task)
    share = rc.unite(lit).share()
    assert placed.cameras.share == pytest.approx(share, abs=1e-9)
    assert placed.is_met
    assert placed.requirements[0].share == pytest.approx(share / seen.cameras.share, abs=1e-9)


def changed(**sections):
    return {k: v for k, v in (PLAN | sections).items() if v is not None}


LAMPS, ENTRY = PLAN["lamps"], PLAN["candidates"][0]
KEY, SPOT = {**LAMPS["key"]}, {"generator": "on_sphere", "count": 8, "distances": [5.0]}


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        (
            {"candidates": [{**ENTRY, "lamp": "kye"}]},
            "expected a lamp, got 'kye'; lamps are key, fill",
        ),
        (
            {"lamps": {**LAMPS, "key": {**KEY, "rig": True}}},
            "lamps.key.rig: expected a place or candidates, got both",
        ),
        (
            {"lamps": {**LAMPS, "key": {**KEY, "position": [0.0, 0.0, 3.0]}}},
            "lamps.key.position: expected a place or candidates",
        ),
        ({"task": {}}, "threshold of light for lamps, got none; give task.min_illuminance"),
        (
            {"candidates": [{**ENTRY, "cameras": ["camera"]}]},
            "expected places of lamp key, got cameras",
        ),
        (
            {"candidates": [{"generator": "per_cavity", "lamp": "key"}]},
            "places of lamp key, got generator per_cavity",
        ),
        ({"candidates": [ENTRY, SPOT]}, "existing: expected candidates for lamps, got"),
        ({"candidates": [SPOT]}, "selection.lamps: expected candidates"),
        (
            {"existing": None, "candidates": [SPOT], "lamps": {"key": {**KEY, "rig": True}}},
            "selection.lamps: expected candidates",
        ),
        ({"existing": None}, "existing: expected cameras for lamps, got none"),
        ({"existing": "gone.json"}, "existing: expected a file, got 'gone.json'"),
        (
            {"selection": {"goal": "best_coverage", "cameras": 2}},
            "selection.cameras: expected none for lamps of existing cameras",
        ),
        (
            {"existing": None, "candidates": [ENTRY, SPOT]},
            "selection: expected only numbers of cameras and lamps",
        ),
        (
            {"selection": {**PLAN["selection"], "refine": True}},
            "selection.refine: expected none for lamps of existing cameras",
        ),
        (
            {"task": {**PLAN["task"], "min_illuminance": "3 W/m2"}},
            "expected min_illuminance in lx",
        ),
        ({"task": {**PLAN["task"], "by": "face"}}, "by"),
        (
            {"lamps": {**LAMPS, "other": {"kind": "point", "intensity_cd": 3.0}}},
            "lamp 'other': expected position",
        ),
        (
            {"task": {**PLAN["task"], "min_illuminance": 1e5}},
            "got none of 13 candidates; relax thresholds",
        ),
        (
            {"constraints": {"stand_off": [7.0, 8.0]}},
            "expected candidates for lamps, got none (13 candidates: ",
        ),
    ],
)
def test_wrong_plans_of_lamps_are_one_line(sections, words, capsys):
    Path("plan.toml").write_text(toml(changed(**sections)))
    assert words in refusal(capsys, "place plan.toml -o out")
    assert not Path("out/plan.json").exists()


def test_a_check_needs_the_chosen_lamps(capsys):
    Path("plan.toml").write_text(toml(PLAN))
    line = "check plan.toml -p eyes.json --min-coverage 0.1"
    assert "eyes.json: expected chosen lamps for plan.toml" in refusal(capsys, line)
    Path("eyes.json").write_text(json.dumps({
        "cameras": [{"name": "a", **CAMERA}], "world_from_camera": EYES.tolist(), "lamps": {"x": 1},
    }))  # fmt: skip
    assert "expected entries lamps, places, names, rides and ambient" in refusal(capsys, line)


def test_candidates_of_lamps_need_lamps():
    with pytest.raises(PlanError, match="expected a lamp, got 'key'; lamps are none"):
        plan_of(changed(lamps=None, ambient=None, existing=None, task={}))
