"""Reasons of parts that no camera covers, held against points judged one by one."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from exact_views import SEEDS
from hypothesis import given
from nightly import examples

import rastercov as rc
from rastercov.core.area.features import deviations_of
from rastercov.core.area.polygons import (
    DIVIDES,
    DIVIDES_FIRST,
    FIRST_AT,
    PLACE,
    Overlay,
    polygon_areas,
    rows_at,
)
from rastercov.core.area.zones import areas_by_reason, dead_zones
from rastercov.core.coverage.task import (
    BETWEEN,
    CRITERIA,
    NAMES,
    REASONS,
    Reason,
    code_of,
    name_of,
)
from rastercov.engine import area_reason
from rastercov.reference.regions import points_on, reasons_of_points

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))


@pytest.mark.parametrize("seed", [1, 4, 6, 21, 5051])
def test_the_reason_of_a_zone_is_that_of_its_points(seed):
    from attack_reasons import Score, compare

    score = Score()
    compare(seed, score)
    assert score.points > 100
    assert (score.wrong, score.unequal) == ([], 0)
    assert score.sums <= 1


def triangles_that_turn(seed, camera, task):
    """Three large triangles, of which two turn, a camera or a rig around, and what is asked."""
    rng = np.random.default_rng([seed, 76])
    corners = rng.uniform(-0.5, 0.5, (3, 1, 3)) + rng.uniform(-2, 2, (3, 3, 3))
    parts = [rc.Group(f"part {row}", is_two_sided=True) for row in range(3)]
    mesh = rc.Mesh(corners.reshape(-1, 3), np.arange(9).reshape(-1, 3), parts, np.arange(3))
    away = rng.normal(size=(1 + seed % 2, 3))
    eyes = away / np.linalg.norm(away, axis=1)[:, None] * 4
    poses = rc.look_at(eyes, rng.uniform(-1, 1, eyes.shape))
    aside = np.repeat(np.eye(4)[None], 2, axis=0)
    aside[1, 0, 3] = 2.5
    rig = rc.Rig([camera] * 2, ["a", "b"], aside, rule=rc.All())
    task = replace(task, min_pixels_per_m2=(70 * rng.uniform(0.6, 1.1)) ** 2)
    turns = {
        f"part {row}": rc.turntable(2, axis=rng.normal(size=3), degrees=80) for row in range(2)
    }
    over, at = [("all", "one time"), ("some", "one time"), ("all", "any time")][seed % 4 - 1]
    asked = rc.MotionQuery(rc.Motion(mesh, turns), over, at) if seed % 4 else None
    return (mesh, rig if seed % 3 else camera, poses, task), asked, rng


@pytest.mark.parametrize("seed", [4, 8, 22, 23, 27, 29, 33, 35, 39])
def test_each_view_of_a_rig_and_of_each_frame_is_judged_by_its_own_angle(seed):
    """A steep one has the density of the allowed angle, another one that which it has."""
    from attack_reasons import Score, hold

    camera, score = rc.Camera(width=640, height=480, fx=280, fy=280), Score()
    scene, asked, rng = triangles_that_turn(seed, camera, rc.Task(max_incidence_deg=45))
    hold(seed, score, scene, asked, rng)
    assert score.dead > 100
    assert (score.wrong, score.unequal) == ([], 0)
    assert score.sums <= 1


@pytest.mark.parametrize("seed", range(20))
def test_a_part_wider_than_what_is_not_certain_keeps_its_reason(seed):
    """Strips and squares of a face whose borders are uncertain by a width to either side."""
    rng, n = np.random.default_rng([seed, 77]), 12
    width = 10 ** rng.uniform(-5, -2)
    wide = rng.random(n) < 0.5
    wide[0] = True
    sides = np.stack(
        [
            np.where(wide, rng.uniform(5, 50, n), rng.uniform(0, 1, n)) * width,
            rng.uniform(50, 90, n) * width,
        ],
        axis=1,
    )
    boxes = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * sides[:, None]
    areas, outlines = sides.prod(axis=1), 2 * sides.sum(axis=1)
    facts = np.ones(1, bool), np.zeros(1, np.uint32), np.array([width * outlines.sum()])
    pieces = boxes.reshape(-1, 2), 4 * np.arange(n + 1), np.zeros(n, np.int32)
    criteria, codes = np.array(CRITERIA, np.uint8), np.empty(n, np.uint32)
    sets = np.arange(1, n + 1, dtype=np.uint32)  # part k is covered without the set k
    tags = np.int64(1) | np.arange(1, n + 1) << FIRST_AT
    area_reason.name_parts((pieces, tags, areas), sets, criteria, facts, codes)
    own = [
        code_of([CRITERIA[bit] for bit in range(5) if bits >> bit & 1]) for bits in sets.tolist()
    ]
    assert codes.tolist() == np.where(wide, own, own[areas.argmax()]).tolist()


@pytest.mark.parametrize("seed", [0, 2, 3, 5, 8, 13, 16, 30])
def test_gains_are_what_a_task_without_the_criterion_covers(seed):
    from attack_reasons import gains

    distance, excess, n = gains(seed)
    assert distance <= 1
    assert excess <= 0
    assert n > 0


@pytest.mark.parametrize(("pixels", "reason"), [(400, "too_oblique"), (4000, "too_coarse")])
def test_density_of_a_steep_view_is_judged_at_the_allowed_angle(pixels, reason):
    """A strip at 80 degrees, of which no resolution helps unless it is far too low."""
    mesh = rc.Mesh(
        [(0, -0.1, 0), (0.1, -0.1, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [(0, 1, 2), (0, 2, 3)]
    )
    camera, angle = rc.Camera(width=900, height=900, fx=800, fy=800), np.radians(80)
    pose = rc.look_at((0.05 + np.sin(angle), 0, np.cos(angle)), (0.05, 0, 0))
    task = rc.Task(max_incidence_deg=60, min_pixel_density=pixels / 2)
    for by in ("area", "face"):
        summary = rc.evaluate(mesh, camera, pose, task, by=by).summary()["not_covered_because"]
        assert set(summary) - {"too_oblique", "too_coarse"} == (
            set() if reason == "too_oblique" else {"too_oblique+too_coarse"}
        )
        if by == "area":
            alone = {name for name, each in summary.items() if each["m2"] > 0}
            assert alone == ({reason} if reason == "too_oblique" else {"too_oblique+too_coarse"})


@pytest.mark.parametrize("views", [1, 2])
def test_two_criteria_that_different_cameras_fail_have_their_gain_each(views):
    """One camera is too steep, another too far away: without either criterion all is covered."""
    mesh = rc.Mesh([(-0.2, -0.2, 0), (0.2, -0.2, 0), (0, 0.2, 0)], [(0, 1, 2)])
    camera, angle = rc.Camera(width=900, height=900, fx=800, fy=800), np.radians(75)
    steep, far = (2 * np.sin(angle), 0, 2 * np.cos(angle)), (0, 0.1, 20)
    poses = rc.look_at([steep, far] * views, (0, 0, 0), up=(0, 1, 0))
    task = rc.Task(max_incidence_deg=60, min_facing_density=100, views=views)
    for order in (poses, poses[::-1]):
        summary = rc.evaluate(mesh, camera, order, task, by="area", fields=()).summary()
        why = summary["not_covered_because"]
        gains = {name: why[name]["gain_m2"] for name in ("too_oblique", "too_coarse")}
        assert gains == pytest.approx(dict.fromkeys(gains, 0.08))
        assert why["too_oblique"]["m2"] == pytest.approx(0.08)


def test_a_reason_of_several_criteria_has_words_of_each():
    for name in NAMES:
        labels = [REASONS[each].label for each in name.split(BETWEEN)]
        assert all(label in REASONS[name].label for label in labels)
    rows = [NAMES.index(name) for name in NAMES if BETWEEN in name]
    assert [Reason(row).name.lower() for row in rows] == [NAMES[row] for row in rows]


@pytest.mark.parametrize("sections", [3, 4, 8, 24])
def test_walls_along_parallel_rays_are_back_facing(sections):
    wall = trimesh.creation.cylinder(0.0025, 0.002, sections=sections)
    turned = wall.vertices @ trimesh.transformations.rotation_matrix(0.3, (0, 0, 1))[:3, :3]
    camera = rc.Camera.telecentric(2448, 2048, pixel_size=3.45e-6, magnification=0.35)
    above = rc.look_at((0, 0, 0.14), (0, 0, 0), up=(0, 1, 0))
    result = rc.evaluate(rc.Mesh(turned.astype(np.float32), wall.faces), camera, above)
    assert set(result.summary()["not_covered_because"]) == {"back_facing"}


@pytest.mark.parametrize("eye", [(0.5, 0, 3), (0.5, 0.5, 3), (0.1, 0.2, 3)])
def test_faces_whose_plane_holds_the_camera_are_back_facing(eye):
    camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    view = rc.look_at(eye, (0, 0, 0), up=(0, 1, 0))
    result = rc.evaluate(rc.shapes.box((1, 1, 1)), camera, view)
    (entry,) = result.summary()["not_covered_because"].items()
    assert entry[0] == "back_facing"
    assert entry[1]["area_percent"] == pytest.approx(500 / 6)


@pytest.mark.parametrize("seed", [2, 4, 5, 7])
def test_the_reason_of_a_zone_over_time_is_that_of_its_points(seed):
    from attack_reasons import Score, compare

    score = Score()
    compare(seed, score, moves=True)
    assert score.dead > 50
    assert (score.wrong, score.unequal) == ([], 0)
    assert score.sums <= 1


@pytest.mark.parametrize("seed", [27, 43])
def test_each_camera_of_a_rig_without_a_rule_counts_alone_at_any_time(seed, monkeypatch):
    import attack_reasons

    made = attack_reasons.a_rig

    def free(*given):
        rig = made(*given)
        return rc.Rig(rig.cameras, rig.names, rig.rig_from_camera)

    monkeypatch.setattr(attack_reasons, "a_rig", free)
    score = attack_reasons.Score()
    attack_reasons.compare(seed, score, moves=True)
    assert score.dead > 50
    assert score.wrong == []


@pytest.mark.parametrize("views", [2, 3])
@pytest.mark.parametrize("degrees", [0.0, 25.0])
def test_too_few_cameras_have_the_gain_of_a_task_that_wants_one(views, degrees):
    mesh, camera = rc.shapes.torus(12, 8), rc.Camera.from_fov(640, 480, hfov_deg=50)
    eyes = [(3.2, 0, 1), (3, 0.9, 1.2), (2, 2.4, 1), (0, 3, 2)]
    poses = rc.look_at(np.array(eyes) * mesh.diagonal / 3, (0, 0, 0))
    task = rc.Task(views=views, min_angle_deg=degrees, max_incidence_deg=70)
    both = [
        rc.evaluate(mesh, camera, poses, each, by="area", fields=()).summary()
        for each in (task, replace(task, views=1, min_angle_deg=0))
    ]
    before, after = (each["covered_area"] for each in both)
    own = both[0]["not_covered_because"]["too_few_views"]
    bound = own["gain_bound_m2"] + before["bound_m2"] + after["bound_m2"] + 1e-12
    assert own["gain_m2"] == pytest.approx(after["m2"] - before["m2"], abs=bound)
    assert own["gain_m2"] > bound
    assert "gain_m2" in both[0]["not_covered_because"]["too_oblique"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("digits", [2, 4, 6, 9])
def test_no_zone_is_below_the_bound_of_its_faces(seed, digits):
    """A limit that nearly all points meet leaves a strip that may be covered: it is no zone."""
    plate = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    camera = rc.Camera(width=640, height=480, fx=300, fy=300)
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.2
    eye = np.random.default_rng(seed).normal((0.4, 0.5, 1.3), 0.05)

    def rig(limit):
        rule = rc.All(max_uncertainty=limit, noise_px=1.0)
        return rc.Rig([camera] * 2, ["a", "b"], places, rule=rule)

    poses = rig(1.0).poses(rc.look_at([eye], (0.45, 0.5, 0)))
    worst = deviations_of(rig(1.0), poses, np.asarray(plate.vertices)).max()
    own = rig(float(worst * (1 - 10.0**-digits)))
    covered = rc.unite(rc.regions(plate, own, poses))
    zones = dead_zones(covered, 1, (own, rc.Task(), poses))
    assert (len(zones) > 0) == (digits < 6)
    for row, area in enumerate(zones.area):
        assert area > covered.excess[np.unique(zones.face[zones.zone == row])].sum()
    missing = 1 - covered.area[0].sum()
    assert abs(zones.area.sum() - missing) <= covered.excess.sum() + 1e-9


def test_a_criterion_that_one_camera_meets_counts_for_all():
    """Two cameras: the nearer is beside its image, the farther sees too few pixels."""
    mesh = rc.Mesh([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], [(0, 1, 2)])
    camera = rc.Camera(width=100, height=100, fx=100, fy=100)
    eyes = rc.look_at([(0, 0, 3), (0, 0, 30)], [(9, 0, 0), (0, 0, 0)])
    task = rc.Task(min_facing_density=10)
    for poses in (eyes, eyes[::-1]):
        network = camera, task, rc.Poses.of(poses)
        zones = dead_zones(rc.unite(rc.regions(mesh, camera, poses, task)), 1, network)
        assert [name_of(code) for code in zones.reasons(len(zones))] == ["too_coarse"]
        truth = reasons_of_points(mesh, camera, poses, task, *points_on(mesh, 20))
        assert (truth == Reason.TOO_COARSE).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_piece_of_many_corners_loses_nothing_as_others_are_laid_over_it(seed):
    """A polygon of 20 corners without some of these: what is left has more than 20."""
    rng = np.random.default_rng(seed)
    turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    round_ = np.stack([2 + np.cos(turn), 1.5 + np.sin(turn)], axis=1)
    corners = np.array([[(0.0, 0.0), (9.0, 0.0), (4.0, 9.0)]])
    area = polygon_areas(corners[0], np.array([0, 3]))
    overlay, pair = Overlay(corners, area, 10.0), np.zeros(1, np.int32)

    def add(number, xy):
        own = polygon_areas(xy, np.array([0, len(xy)]))
        pieces = xy, np.array([0, len(xy)]), pair, pair
        overlay.add(pieces, (pair, pair, own, np.zeros(1), np.zeros(1)), np.array([number]))
        return float(own[0])

    whole = add(0, round_)
    for k in rng.permutation(20)[:8].tolist():
        before, corner, after = (round_[(k + step) % 20] for step in (-1, 0, 1))
        share = rng.uniform(0.1, 0.4)
        add(
            1,
            np.stack(
                [corner + share * (before - corner), corner, corner + share * (after - corner)]
            ),
        )
        partition = overlay.partition()
        assert partition.area[partition.tag & 1 > 0].sum() == pytest.approx(whole, rel=1e-12)


def test_points_find_the_reason_of_their_zone():
    mesh = rc.shapes.sphere(2)
    camera, poses = rc.Camera(width=200, height=200, fx=60, fy=60), rc.look_at((0, 0, 4), (0, 0, 0))
    zones = dead_zones(
        rc.unite(rc.regions(mesh, camera, poses)), 1, (camera, rc.Task(), rc.Poses.of(poses))
    )
    points, face = points_on(mesh, 500)
    truth = reasons_of_points(mesh, camera, poses, rc.Task(), points, face)
    rows = rows_at(zones, zones.leads.astype(np.int32), len(NAMES), face, points)
    values = np.where(rows.any(axis=1), rows.argmax(axis=1), Reason.COVERED)
    assert (values == truth).mean() > 0.99
    assert sum(
        each["m2"] for each in areas_by_reason(zones, mesh.task_mask).values()
    ) == pytest.approx(float(zones.area.sum()))


def sets_after(sets, kinds):
    """Sets of pieces after all things were added by their kinds, from the sets that cover them."""
    kept = np.zeros_like(sets)
    for thing, kind in enumerate(kinds):
        is_covered = sets >> thing & 1 > 0
        is_covered &= {0: True, DIVIDES: kept > 0, DIVIDES_FIRST: kept == 1}[kind]
        is_first = is_covered & (kept == 1) & (kind > 0)
        kept |= is_covered.astype(np.int64) << thing if kind < DIVIDES_FIRST else 0
        kept |= is_first * np.int64(place_of(thing)) << FIRST_AT
    return kept


def place_of(thing):
    """Among those that divide, far from one another."""
    return 5000 * thing


@given(seed=SEEDS)
@examples(40, at_night=400)
def test_what_divides_alone_gives_the_parts_of_what_was_there(seed):
    """Of each set the same area as if all had been added, and no piece of other things."""
    rng = np.random.default_rng(seed)
    corners = np.array([[(0.0, 0.0), (9.0, 0.0), (4.0, 9.0)], [(0.0, 0.0), (5.0, 0.0), (1.0, 4.0)]])
    areas = np.array([polygon_areas(each, np.array([0, 3]))[0] for each in corners])
    kinds = [0, *rng.choice([DIVIDES, DIVIDES_FIRST], 6).tolist()]
    every, divided = Overlay(corners, areas, 10.0), Overlay(corners, areas, 10.0)
    for thing, kind in enumerate(kinds):
        pieces, faces, sums = [], [], np.zeros(2)
        for face in np.flatnonzero(rng.random(2) < 0.8).tolist():
            weights = rng.dirichlet(np.ones(3), 3) if rng.random() < 0.7 else np.eye(3)
            piece = weights @ corners[face]
            size = polygon_areas(piece, np.array([0, 3]))[0]
            pieces.append(piece if size > 0 else piece[::-1])
            faces.append(face)
            sums[face] += abs(size)
        if not faces:
            continue
        face = np.array(faces, np.int32)
        none, row = np.zeros(len(face)), np.zeros(len(face), np.int32)
        table = np.concatenate(pieces), 3 * np.arange(len(face) + 1), face, row
        place = PLACE * place_of(thing) * (kind > 0)
        for overlay, number in ((every, thing), (divided, place + kind + thing)):
            overlay.add(table, (row, face, sums[face], none, none), np.array([number]))
    found, truth = divided.partition(), every.partition()
    expected = sets_after(truth.tag, kinds)
    assert (found.tag & 1 > 0).all()
    for own in np.unique([*found.tag, *expected[truth.tag & 1 > 0]]).tolist():
        area = found.area[found.tag == own].sum()
        assert area == pytest.approx(truth.area[expected == own].sum(), abs=1e-9), own
    assert len(found.area) <= (truth.tag & 1 > 0).sum()


def test_numbers_of_other_kinds_are_refused():
    corners = np.array([[(0.0, 0.0), (9.0, 0.0), (4.0, 9.0)]])
    overlay, row = Overlay(corners, np.array([40.5]), 10.0), np.array([0, 1], np.int32)
    pairs = row, np.zeros(2, np.int32), np.full(2, 40.5), np.zeros(2), np.zeros(2)
    pieces = np.empty((0, 2)), np.zeros(1, int), np.empty(0, np.int32), np.empty(0, np.int32)
    for number, words in (((0, 1 << 23), "0 to 63, of a kind"), ((0, DIVIDES), "of one kind")):
        with pytest.raises(ValueError, match=words):
            overlay.add(pieces, pairs, np.array(number))
