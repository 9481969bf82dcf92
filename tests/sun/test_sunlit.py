"""Sunlit area and hours against whole numbers, closed forms and single points."""

from contextlib import closing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import amount

import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.swept import swept
from rastercov.core.camera.sun import views_from
from rastercov.core.camera.viewpoints import cone_of_directions
from rastercov.reference.rational import visible_area
from rastercov.sun import sunlight
from rastercov.sun.sunlight import divide_targets

pytestmark = pytest.mark.native

WALL = np.array([(0, 0, 0), (10, 0, 0), (10, 0, 3), (0, 0, 3)], float)
EAVES = np.array([(0, 0, 3), (10, 0, 3), (10, -1, 3), (0, -1, 3)], float)
OVERHANG = [(45, 0, 20), (45, 30, 18.786327949541), (60, -20, 11.903337080193)]
OVERHANG += [(20, 70, 20.820124475322)]
"""Elevation and azimuth from the normal of a wall, and its lit area, m^2."""


def quad(corners, n):
    """A quadrilateral as 2 n^2 triangles."""
    u, v = np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2, indexing="ij")
    origin, right, _, up = corners
    points = origin + u[..., None] * (right - origin) + v[..., None] * (up - origin)
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (each.ravel() for each in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)])
    return rc.Mesh(points.reshape(-1, 3), faces)


def to_sun(elevation, azimuth):
    a, z = np.radians((elevation, azimuth))
    return np.array((np.sin(z) * np.cos(a), -np.cos(z) * np.cos(a), np.sin(a)))


def soup(seed, n):
    """Triangles in space, of small whole coordinates; three roles."""
    rng = np.random.default_rng(seed)
    faces = np.arange(3 * n).reshape(-1, 3)
    groups = [rc.Group("a"), rc.Group("b", is_two_sided=True), rc.Group("c", is_occluder=True)]
    return rc.Mesh(rng.integers(-6, 7, (3 * n, 3)) / 4, faces, groups, np.arange(n) % 3)


@pytest.mark.parametrize("n", [1, 7])
@pytest.mark.parametrize(("elevation", "azimuth", "area"), OVERHANG)
def test_a_wall_below_an_overhang_is_lit_as_in_closed_form(n, elevation, azimuth, area):
    scene = rc.Mesh.joined([quad(WALL, n), quad(EAVES, 1)], ["wall", "eaves"])
    sunlit = rc.sunlit(scene, [to_sun(elevation, azimuth)])
    own = scene.face_group == 0
    assert (sunlit.hours * scene.areas)[own].sum() == pytest.approx(area, abs=1e-10)
    cosine = to_sun(elevation, azimuth) @ (0, -1, 0)
    assert sunlit.lit[0, 0] == pytest.approx(area * cosine, abs=1e-10)
    assert sunlit.share[0, 0] == pytest.approx(area / 30, abs=1e-10)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_a_cube_is_lit_as_the_sum_of_its_cosines(vector):
    sunlit = rc.sunlit(rc.shapes.box((1, 1, 1), centre=(5, 0, 0)), [vector])
    area = np.abs(vector).sum() / np.linalg.norm(vector)
    assert abs(sunlit.part_energy[0] - area) <= sunlit.part_energy_bound[0] < 1e-8
    assert abs(sunlit.share[0, 0] - 1) <= sunlit.share_bound[0, 0] < 1e-8
    if (np.abs(vector) > 1e-6).all():
        assert sunlit.part_energy[0] == pytest.approx(area, abs=1e-12)


@settings(max_examples=amount(6, 60))
@given(st.integers(0, 10**6), st.integers(4, 14))
def test_energy_of_faces_is_that_of_whole_numbers_within_its_bound(seed, n):
    mesh = soup(seed, n)
    rng = np.random.default_rng(seed + 1)
    towards = rng.integers(-5, 6, (3, 3)) + 0.25
    sunlit = rc.sunlit(mesh, towards, weights=[1, 2, 4], irradiance=3.0)
    camera, poses = views_from(sunlit.directions, mesh.bounds)
    total = np.zeros(mesh.n_faces)
    for pose, weight in zip(poses, (1, 2, 4), strict=True):
        seen = visible_area(mesh, camera, pose, np.arange(mesh.n_faces)) / camera.fx**2
        facing = -(mesh.normals @ pose[:3, 2])
        is_lit = mesh.task_mask & ((facing > 0) | mesh.two_sided_mask) & ~mesh.degenerate_mask
        total += weight * 3.0 * np.where(is_lit, seen, 0)
    rounding = 1e-12 * total.clip(1e-3)  # a face that is edge-on gets nothing
    assert (np.abs(sunlit.energy - total) <= sunlit.energy_bound + rounding).all()
    assert sunlit.energy_bound.max() < 1e-6
    assert sunlit.hours.max() <= 7 + 1e-9


def test_equal_directions_and_triangles_change_nothing():
    one = rc.Mesh.joined([quad(WALL, 1), quad(EAVES, 1)], ["wall", "eaves"])
    sun = [to_sun(40, 10), to_sun(40, 10), to_sun(50, -30)]
    whole = rc.sunlit(one, sun, [1, 2, 3], [5, 6, 7])
    parts = rc.sunlit(one, [*sun[1:]], [3, 3], [17 / 3, 7])
    assert parts.energy == pytest.approx(whole.energy, rel=1e-12)
    fine = rc.sunlit(divide_targets(one, 0.7), sun, [1, 2, 3], [5, 6, 7])
    assert fine.part_energy == pytest.approx(whole.part_energy, rel=1e-9)
    assert fine.part_hours == pytest.approx(whole.part_hours, rel=1e-9)
    assert len(fine.hours) > 20 * len(whole.hours)


SUN = np.tan(np.radians(0.2666))


def strips(edges, height, length=60.0):
    """Strips along y between pairs of x, and a square of 2 m below their middle."""
    ground = quad(np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float), 1)
    parts = [
        quad(np.array([(x, y, height) for x, y in zip((a, b, b, a), ends, strict=True)]), 1)
        for a, b in edges
        for ends in [np.repeat((-length, length), 2)]
    ]
    return rc.Mesh.joined([ground, *parts], ["ground"] + ["strip"] * len(parts))


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    ("edges", "height", "all_lit", "some_lit"),
    [
        ([(x, x + 0.02) for x in np.arange(10) / 5 - 0.91], 10, 2 - 10 * (0.02 + 20 * SUN), 2),
        ([(-30, -0.02), (0.02, 30)], 20, 0, 0.04 + 40 * SUN),
        ([(-30, -0.3), (0.3, 30)], 5, 0.6 - 10 * SUN, 0.6 + 10 * SUN),
        ([(-0.001, 0.001)], 15, 2 - 0.002 - 30 * SUN, 2),
        ([(-30, 0.0)], 8, 1 - 8 * SUN, 1 + 8 * SUN),
    ],
    ids=["bars", "slit", "gap", "cable", "edge"],
)
def test_parts_narrower_than_the_disc_shade_in_closed_form(seed, edges, height, all_lit, some_lit):
    """Lengths across the square that all, and some of the disc light, from above and turned."""
    scene, sun = strips(edges, height).with_groups(occluders=["strip"]), np.array((0.0, 0, 1))
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    scene = rc.Mesh(scene.vertices @ turn.T, scene.faces, scene.groups, scene.face_group)
    for by, length, room in (("all", all_lit, 1e-7), ("some", some_lit, 0.1 * height * SUN)):
        sunlit = rc.sunlit(scene, [turn @ sun], lit_by=by)
        assert abs(sunlit.part_hours[0] - length / 2) <= sunlit.part_hours_bound[0]
        assert sunlit.part_hours_bound[0] <= room


def test_the_penumbra_of_a_roof_is_in_closed_form():
    radius = 2.0 * SUN
    ground = quad(np.array([(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)], float), 1)
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    roof = quad(np.array([(x, y, 2.0) for x, y in corners]), 1)
    scene = rc.Mesh.joined([ground, roof], ["ground", "roof"])
    # The roof is lit in all cases; around the corners of its shadow are quarters of discs.
    shaded = {"middle": 1, "all": 1 + 4 * radius + np.pi * radius**2, "some": (1 - 2 * radius) ** 2}
    for by, area in shaded.items():
        sunlit = rc.sunlit(scene, [(0, 0, 1)], lit_by=by)
        assert abs(sunlit.lit[0, :2].sum() - (17 - area)) <= sunlit.lit_bound[0].sum()
        assert sunlit.lit_bound[0].sum() < 1e-3


def disc_violations(seed, monkeypatch, factor=1.0):
    """Faces on which directions within a disc light more, or less, than is possible by the bounds.

    What all of some directions light holds what all of the disc does; what one of them lights, some
    of it does.
    """
    rng = np.random.default_rng(seed)
    radius = float(rng.choice([0.2666, 1.0, 4.0, 12.0]))
    monkeypatch.setattr(sunlight, "SUN_RADIUS_DEG", radius)
    if factor < 1:
        monkeypatch.setattr(sunlight, "swept", lambda *given: swept(*given[:4], factor * given[4]))
    mesh = soup(seed, int(rng.integers(3, 16))) if seed % 2 else blocks(rng)
    towards = rng.normal(size=(1, 3)) if seed % 3 else rng.integers(1, 4, (1, 3)) + 0.0
    towards /= np.linalg.norm(towards)
    inside = [sunlight.rim_of(towards)[0], cone_of_directions(towards, 9, 0.9 * radius)[0], towards]
    inside = np.concatenate(inside[1:] if seed % 4 else inside)
    facing = mesh.normals @ towards[0]
    facing = np.where(mesh.two_sided_mask, np.abs(facing), facing)
    is_own = mesh.task_mask & ~mesh.degenerate_mask & (facing > sunlight.EDGE_ON)
    camera, poses = views_from(inside, mesh.bounds)
    with closing(RegionPass(mesh, camera, only_task=True)) as finder:
        seen, row = finder.find(rc.Poses.of(poses)), np.zeros(len(poses), np.int64)
    every, one = seen.at_least(len(poses), row), seen.at_least(1, row)
    count = 0
    for by, sign, regions in (("all", 1, every), ("some", -1, one)):
        (lit,) = sunlight._of_disc(mesh, towards, by, 1)
        ends = (lit.lit - sign * lit.bound)[0] / np.maximum(
            np.abs(mesh.normals @ towards[0]), 1e-12
        )
        beyond = sign * (ends - regions.areas()[0]) - regions.bounds()[0]
        count += int((is_own & (beyond > 1e-9)).sum())
    return count


def blocks(rng):
    """Boxes on a slab, some in contact."""
    parts = [rc.shapes.box((4, 4, 0.2), centre=(0, 0, -0.1))]
    for _ in range(int(rng.integers(1, 6))):
        size, at = rng.integers(1, 5, 3) / 4, rng.integers(-6, 7, 2) / 4
        parts.append(rc.shapes.box(size, centre=(*at, size[2] / 2 + rng.integers(0, 3) / 4)))
    return rc.Mesh.joined(parts, [f"part {row}" for row in range(len(parts))])


def test_no_direction_in_the_disc_breaks_the_bounds_of_hostile_scenes(monkeypatch):
    for seed in range(amount(20, 2_000)):
        assert disc_violations(seed, monkeypatch) == 0


def test_a_smaller_disc_is_found_out(monkeypatch):
    assert any(disc_violations(seed, monkeypatch, 0.8) for seed in range(40))


def test_targets_get_sun_and_shade_nothing_and_occluders_get_none():
    roof = rc.shapes.box((1, 1, 0.1), centre=(0, 0, 2))
    scene = rc.Mesh.joined([rc.shapes.box((2, 2, 1)), roof], ["house", "roof"])
    plain = rc.sunlit(scene, [(0, 0, 1)])
    assert dict(zip(plain.names, plain.part_energy, strict=True)) == pytest.approx(
        {"house": 3, "roof": 1}
    )
    hiding = rc.sunlit(scene.with_groups(occluders=["roof"]), [(0, 0, 1)])
    assert (hiding.names, hiding.part_energy[0]) == (("house",), pytest.approx(3))
    target = rc.sunlit(scene.with_groups(targets=["roof"]), [(0, 0, 1)])
    assert target.part_energy == pytest.approx([4, 1])


def test_parts_above_groups_are_storeys():
    parts = [rc.shapes.box((1, 1, 1), centre=(x, 0, 0)) for x in (0, 3, 6)]
    names = ["ground/IfcWindow/a", "ground/IfcWindow/b", "roof/IfcSlab/c"]
    sunlit = rc.sunlit(rc.Mesh.joined(parts, names), [(0, 0, 1), (1, 0, 0)], [1, 2])
    of = dict(zip(sunlit.names, sunlit.part_energy, strict=True))
    assert of == pytest.approx(dict(zip(names, (1, 1, 3), strict=True)) | {"ground": 2, "roof": 3})
    hours = dict(zip(sunlit.names, sunlit.part_hours, strict=True))
    assert hours["ground/IfcWindow/a"] == pytest.approx(1)  # in the shade of the third one
    assert hours["roof/IfcSlab/c"] == hours["roof"] == pytest.approx(3)


def window(x):
    """A frame and a pane within its bounding box, which no edge joins."""
    frame = (
        rc.shapes.box((1, 0.1, 0.2), centre=(x, 0, -0.4)),
        rc.shapes.box((1, 0.1, 0.2), centre=(x, 0, 0.4)),
    )
    return one_group([*frame, rc.shapes.box((0.8, 0.02, 0.6), centre=(x, 0, 0))])


def one_group(meshes):
    starts = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    faces = [each.faces + start for each, start in zip(meshes, starts, strict=False)]
    return rc.Mesh(np.concatenate([each.vertices for each in meshes]), np.concatenate(faces))


@pytest.mark.parametrize("lit_by", ["middle", "all"])
def test_the_window_of_a_group_that_gets_the_least_is_as_by_itself(lit_by):
    windows, fin = [window(x) for x in (0, 2, 4)], rc.shapes.box((0.1, 1, 3), centre=(2.6, -0.5, 0))
    sun = [to_sun(20, azimuth) for azimuth in (-60, -20, 20, 60)]
    apart = rc.Mesh.joined([*windows, fin], ["s/0", "s/1", "s/2", "t/fin"])
    joined = rc.Mesh.joined([one_group(windows), fin], ["s/all", "t/fin"])
    each = rc.sunlit(apart, sun, [1, 2, 3, 4], lit_by=lit_by)
    sunlit = rc.sunlit(joined, sun, [1, 2, 3, 4], lit_by=lit_by)
    assert sunlit.names == ("s/all", "t/fin", "s", "t")
    assert [*map(len, sunlit.part_pieces)] == [3, 1, 3, 1]
    assert [*map(len, each.part_pieces)] == [1, 1, 1, 1, 3, 1]
    least = int(each.part_hours[:3].argmin())
    at = sunlit.pieces.at[sunlit.least[[0, 2]]]
    assert at == pytest.approx(np.array([(2.0 * least, 0, 0)] * 2), abs=1e-9)
    hours = sunlit.pieces.hours[sunlit.least]
    assert hours[[0, 2]] == pytest.approx(each.part_hours[least], abs=1e-9)
    assert hours[0] < sunlit.part_hours[0] - 0.1
    assert hours[1] == sunlit.part_hours[1]
    fine = rc.sunlit(divide_targets(joined, 0.3), sun, [1, 2, 3, 4], lit_by=lit_by)
    assert fine.pieces.hours[fine.least] == pytest.approx(hours, abs=1e-9)
    for name in ("hours", "hours_bound", "energy", "energy_bound", "at"):  # of every window
        own, alone = (getattr(one.pieces, name) for one in (sunlit, each))
        order = np.argsort(sunlit.pieces.at[:, 0]), np.argsort(each.pieces.at[:, 0])
        assert own[order[0]] == pytest.approx(alone[order[1]], abs=1e-9)
    middle = joined.centroids[:, 0]
    pane = joined.face_group == 0
    assert np.abs(sunlit.pieces.at[sunlit.pieces.of_face[pane], 0] - middle[pane]).max() < 0.6


def test_a_group_of_too_many_pieces_is_one_and_is_not_judged(monkeypatch):
    """One dark window of many was no window: "1 of 1 gets enough"."""
    boxes = one_group([rc.shapes.box((1, 1, 1), centre=(3 * x, 0, 0)) for x in range(101)])
    assert len(rc.sunlit(boxes, [(0, 0, 1)]).part_pieces[0]) == 101
    monkeypatch.setattr(sunlight, "MOST_PIECES", 100)
    sunlit = rc.sunlit(boxes, [(0, 0, 1)])
    assert sunlit.part_pieces == ((0,),)
    assert sunlit.pieces.hours.tolist() == sunlit.part_hours.tolist()
    with pytest.raises(rc.ConfigError, match="at most 100 pieces of a group, got 101 of"):
        sunlight.pieces_of(boxes, are_judged=True)


def test_no_direction_is_no_sun():
    sunlit = rc.sunlit(rc.shapes.box(), np.empty((0, 3)))
    assert sunlit.hours.tolist() == sunlit.energy.tolist() == [0.0] * 12
    assert sunlit.part_hours.tolist() == [0.0]


@pytest.mark.parametrize("degrees", [-0.3, -0.2, -0.036, 0, 0.036, 0.2, 0.3])
@pytest.mark.parametrize("two_sided", [False, True])
def test_some_of_the_sun_lights_a_face_whose_plane_it_crosses(degrees, two_sided):
    """The disc has a radius of 0.2666 degrees; what occludes is not evaluated."""
    roof = rc.shapes.box((1, 1, 1), centre=(0, 0, -5))
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    ground = rc.Mesh(corners, [(0, 1, 2), (0, 2, 3)])
    scene = rc.Mesh.joined([ground, roof], ["ground", "roof"])
    groups = [rc.Group("ground", is_two_sided=two_sided), rc.Group("roof", is_occluder=True)]
    scene = rc.Mesh(scene.vertices, scene.faces, groups, scene.face_group)
    for turn in (0, 1.234):
        e = np.radians(degrees)
        sun = [np.cos(e) * np.cos(turn), np.cos(e) * np.sin(turn), np.sin(e)]
        sunlit = rc.sunlit(scene, [sun], lit_by="some")
        right = float(two_sided or degrees > -0.2666)
        assert (abs(sunlit.hours[:2] - right) <= sunlit.hours_bound[:2] + 1e-9).all()
        assert not sunlit.hours[2:].any()
        if degrees:
            assert abs(sunlit.part_hours[0] - right) <= sunlit.part_hours_bound[0] + 1e-9


@pytest.mark.parametrize("lit_by", ["middle", "all", "some"])
def test_no_directions_give_no_hours(lit_by):
    assert not rc.sunlit(rc.shapes.box((1, 1, 1)), np.zeros((0, 3)), lit_by=lit_by).hours.any()


@pytest.mark.parametrize("rows", [1, 3, 100])
def test_bounds_of_times_hold_half_a_step_of_all_changes(rows, monkeypatch):
    """Of faces as of groups, by arcs, whatever the number of directions summed together.

    The share of a face that turned to or from the sun was anything meanwhile.
    """
    rng = np.random.default_rng(6)
    boxes = [rc.shapes.box((1, 1, 1)), rc.shapes.box((2, 0.1, 2), centre=(0.2, 1, 0.5))]
    scene = rc.Mesh.joined(boxes, ["part", "wall"])
    towards = rng.normal((0, 0, 1), size=(20, 3))
    starts, step = np.arange(20) % 7 == 0, 0.5
    monkeypatch.setattr(sunlight, "PAIRS_TOGETHER", rows * scene.n_faces)
    how = {"weights": np.full(20, step), "irradiance": np.arange(20.0)}
    plain = rc.sunlit(scene, towards, **how)
    sunlit = rc.sunlit(scene, towards, **how, step=step, starts=starts)
    each = [rc.sunlit(scene, towards[[row]], irradiance=float(row)) for row in range(20)]
    is_before = np.pad(towards @ scene.normals.T > 0, ((1, 1), (0, 0)))
    for name in ("hours", "energy", "part_hours", "part_energy"):
        values = np.array([getattr(one, name) for one in each])
        whole = 0.0
        for rows in np.split(np.arange(20), np.flatnonzero(starts)[1:]):
            arc = np.pad(values[rows], ((1, 1), (0, 0)))
            change = np.abs(np.diff(arc, axis=0))
            if name == "hours":
                turned = np.diff(is_before[rows[0] : rows[-1] + 3], axis=0)
                turned[[0, -1]] = False
                change = np.where(turned, 2 - (arc[1:] + arc[:-1]), change)
            whole += change.sum(axis=0)
        more = getattr(sunlit, f"{name}_bound") - getattr(plain, f"{name}_bound")
        np.testing.assert_allclose(more, step / 2 * whole, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(getattr(sunlit, name), getattr(plain, name))
    assert rc.sunlit(scene, np.zeros((0, 3)), step=1.0).part_hours_bound.tolist() == [0.0, 0.0]
