"""Criteria of light: values by their definitions, slopes and doubts, cut regions by points."""

from dataclasses import replace

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import given
from nightly import examples
from surface_cases import in_regions, room, whole
from test_point_criteria import (
    DEFINED,
    MADE,
    assert_hostile,
    assert_slopes,
    assert_tighter,
    assert_where,
    by_definition,
    random_criterion,
)

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.reference.regions import points_on

pytestmark = pytest.mark.native

SPOT = np.array([(-1, 0, 0, 0), (0.5, 0, 0, 0), (0.8, 0.6, 3, 1), (1, 1, 0.5, 0.5)])
"""Table of a spot: dark outside 60 degrees, with a corner at the cosine 0.8."""


def lamp_shares(criterion, points, at):
    """(N, n) I / I0 of lamps at points, by the definition; `at` are their positions."""
    away = points[:, None] - at
    distance = np.linalg.norm(away, axis=2)
    axes = np.broadcast_to(criterion.axes, at.shape)
    cosine = np.clip(np.einsum("nki,ki->nk", away, axes) / distance, -1, 1)
    m = np.broadcast_to(criterion.exponents, len(at))
    shares = np.where(m == 0, 1.0, np.maximum(cosine, 0) ** np.maximum(m, 1e-9))
    for j, t in enumerate(np.broadcast_to(criterion.table, len(at))):
        if t >= 0:
            shares[:, j] = hermite(np.asarray(criterion.tables[t]), cosine[:, j])
    frames = np.broadcast_to(criterion.frames, (len(at), 3, 3))
    for j, web in enumerate(np.broadcast_to(criterion.web, len(at))):
        if web >= 0:
            shares[:, j] = bilinear(criterion.webs[web], away[:, j] @ frames[j].T)
    return shares


def bilinear(web, rays):
    """Shares of a web along rays (N, 3) in its frame, by one interpolation after the other."""
    angles, turns, shares = web
    x, y, z = rays.T
    from_pole = np.degrees(np.arctan2(np.hypot(x, y), z))
    turn = turns[0] + (np.degrees(np.arctan2(y, x)) - turns[0]) % 360
    of_turns = np.array([np.interp(from_pole, angles, each) for each in shares])
    return np.array([np.interp(at, turns, own) for at, own in zip(turn, of_turns.T, strict=True)])


def random_web(rng):
    """A web of few or many cells, often the same at the poles, or with a step of 0.001 degrees."""
    angles = np.r_[0, np.sort(rng.uniform(1, 179, rng.integers(0, 9))), 180]
    turns = rng.uniform(-90, 90) + np.r_[0, np.sort(rng.uniform(1, 359, rng.integers(0, 9))), 360]
    if rng.integers(2):
        angles = np.sort(np.r_[angles, rng.uniform(1, 179) + np.array([0, 1e-3])])
    shares = rng.uniform(0, 1, (len(turns), len(angles)))
    if rng.integers(2):
        shares[:, [0, -1]] = shares[0, [0, -1]]
    shares[-1] = shares[0]
    return angles, turns, shares


def hermite(table, c):
    k = np.clip(np.searchsorted(table[:, 0], c, side="right") - 1, 0, len(table) - 2)
    w = table[k + 1, 0] - table[k, 0]
    t = (c - table[k, 0]) / w
    ends = (1 - t) ** 2 * ((1 + 2 * t) * table[k, 1] + t * w * table[k, 3])
    return ends + t**2 * ((3 - 2 * t) * table[k + 1, 1] + (t - 1) * w * table[k + 1, 2])


def light_by_definition(criterion, points, normals, sees=None):
    """(N,) values of criteria of light; `sees` (N, n) of lamps."""
    at = np.asarray(criterion.positions)
    away = at - points[:, None]
    distance = np.linalg.norm(away, axis=2)
    sees = np.ones(distance.shape, bool) if sees is None else sees
    if isinstance(criterion, rc.Illuminance):
        height = np.abs(np.einsum("nki,ni->nk", away, normals))
        light = lamp_shares(criterion, points, at) * height / distance**3
        total = np.where(sees, np.broadcast_to(criterion.intensities, len(at)) * light, 0)
        off = total.sum(axis=1) - criterion.limit
        return off if criterion.is_least else -off
    to_eye = criterion.eyes - points
    side = np.where((to_eye * normals).sum(axis=1) < 0, -1, 1)[:, None] * normals
    s = away / distance[..., None] + (to_eye / np.linalg.norm(to_eye, axis=1)[:, None])[:, None]
    off = np.cos(np.radians(criterion.degrees)) * np.linalg.norm(s, axis=2)
    off -= np.einsum("ni,nki->nk", side, s)
    return np.where(sees, off if criterion.is_least else -off, 1.0).min(axis=1)


def highlight(rng, at, axes, size):
    return rc.Highlight(at[0], at[1:], rng.uniform(0, 60), is_least=bool(rng.integers(2)))


def light(rng, at, axes, size):
    exponents = [0, 1, 1.5, 2, 7.3, 20]
    return rc.Illuminance(
        at, 10 ** rng.uniform(-2, 1) / size**2, rng.uniform(0, 2, 3), axes,
        rng.choice(exponents, 3), [SPOT], rng.choice([-1, 0], 3), bool(rng.integers(4)),
        *([random_web(rng), random_web(rng)], rng.choice([-1, 0, 1], 3)),
        np.linalg.qr(rng.normal(size=(3, 3, 3)))[0],
    )  # fmt: skip


MADE |= {"light": light, "highlight": highlight}
DEFINED |= {rc.Illuminance: light_by_definition, rc.Highlight: light_by_definition}
KINDS = ("light", "highlight")


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_and_doubts_hold_on_random_pieces(kind):
    assert_slopes(kind, is_one=kind == "light")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_regions_of_a_room_are_as_by_points(kind, seed):
    rng = np.random.default_rng(seed)
    assert_where(random_criterion(kind, rng, 3.0, (4, 2.5, 1.5)), whole(room()[0]), 8000)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@examples(10)
@given(seed=SEEDS)
def test_regions_of_hostile_scenes_are_as_by_points(kind, seed):
    assert_hostile(kind, seed)


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_fall_with_the_width_of_what_is_undecided(kind, monkeypatch):
    place, lamp = (1.0, 1.2, 2.5), [(5.5, 3.5, 2.2)]
    both = rc.Illuminance([place, *lamp], 4, 30, [(1, 1, -2), (0, -1, -1)], (20, 3))
    own = {"light": both, "highlight": rc.Highlight(place, lamp, 12)}
    assert_tighter(own[kind], monkeypatch)


def test_a_lone_lamp_lights_discs():
    height, power, least = 2.9, 50.0, 2.0
    radius = np.sqrt((height * power / least) ** (2 / 3) - height**2)
    floor = rc.Mesh([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], [(0, 1, 2), (0, 2, 3)])
    lamp = [(0.3, 0.2, height)]
    part = whole(floor).where(rc.Illuminance(lamp, least, power))
    assert abs(part.area.sum() - np.pi * radius**2) <= part.bound.sum() <= 0.02


def test_a_table_of_a_power_is_the_power():
    mesh, lamp, axis = room()[0], [(2.5, 4.2, 2.9)], (0.2, -0.3, -1.0)
    c = np.concatenate([[-1.0], np.linspace(0, 1, 60)])
    f, slope = np.maximum(c, 0) ** 3, 3 * np.maximum(c, 0) ** 2
    table = np.stack([c, f, slope, slope], axis=1)
    exact = whole(mesh).where(rc.Illuminance(lamp, 1.5, 50, axis, 3))
    part = whole(mesh).where(rc.Illuminance(lamp, 1.5, 50, axis, tables=[table], table=0))
    assert abs(part.area.sum() - exact.area.sum()) <= part.bound.sum() + exact.bound.sum() + 1e-4
    assert 1 < exact.area.sum() < 0.9 * mesh.areas.sum()


def test_only_lamps_that_see_a_piece_count():
    mesh = room()[0]
    regions = whole(mesh)
    rng = np.random.default_rng(5)
    sets = rng.integers(0, 8, len(regions))
    seen = replace(regions, devices=sets)
    points, face = points_on(mesh, 8000)
    sees = (sets[np.searchsorted(regions.face, face)][:, None] >> np.arange(3) & 1).astype(bool)
    for criterion in (
        rc.Illuminance([(1, 1, 2), (4, 4, 2), (7, 2, 2.5)], 5, 30),
        rc.Highlight((4, 2, 2.5), [(1, 1, 2), (4, 4, 2), (7, 2, 2.5)], 15),
    ):
        part = seen.where(criterion)
        assert (part.devices == sets[np.searchsorted(regions.face, part.face)]).all()
        holds = by_definition(criterion, points, mesh.normals[face], sees) >= 0
        wrong = int((in_regions(part, 0, points, face) != holds).sum())
        e = part.bound.sum() / mesh.areas.sum() * 8000
        assert wrong <= 2 + e + 6 * np.sqrt(e)
        assert 0 < part.area.sum() < mesh.areas.sum()


def test_rows_have_criteria_of_their_own():
    mesh = room()[0]
    lamps = np.array([[(1, 1, 2.5)], [(7, 4, 2.0)]])
    both = whole(mesh, 2).where(rc.Illuminance(lamps, 5, [[30], [60]]))
    for row in range(2):
        alone = whole(mesh).where(rc.Illuminance(lamps[row], 5, 30 * (row + 1)))
        assert np.array_equal(alone.areas()[0], both.areas()[row])


LAMP = [(0.0, 0.0, 1.0)]


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: rc.Illuminance(LAMP, 0), "above 0"),
        (lambda: rc.Illuminance(np.zeros((0, 3)), 1), "1 to 64 lamps"),
        (lambda: rc.Illuminance(np.zeros((65, 3)), 1), "1 to 64 lamps"),
        (lambda: rc.Illuminance(LAMP, 1, -1), "0 or more"),
        (lambda: rc.Illuminance(LAMP, 1, 1, (0, 0, 0)), "length 0"),
        (lambda: rc.Illuminance(LAMP, 1, exponents=0.5), "0, or 1 to 1000"),
        (lambda: rc.Illuminance(LAMP, 1, [1, 2, 3]), "fit shape"),
        (lambda: rc.Illuminance(LAMP, 1, table=0), "table below 0, got"),
        (lambda: rc.Illuminance(LAMP, 1, web=0), "web below 0, got"),
        (
            lambda: rc.Illuminance(LAMP, 1, webs=[([0, 90], [0, 360], np.ones((2, 2)))]),
            "from 0 to 180",
        ),
        (
            lambda: rc.Illuminance(LAMP, 1, webs=[([0, 180], [0, 350], np.ones((2, 2)))]),
            "first . 360",
        ),
        (
            lambda: rc.Illuminance(LAMP, 1, webs=[([0, 180], [0, 360], np.ones((2, 3)))]),
            "shares of 0",
        ),
        (lambda: rc.Illuminance(LAMP, 1, frames=np.ones((3, 3))), "at right angles"),
        (lambda: rc.Illuminance(LAMP, 1, tables=[[(0, 1, 0, 0), (1, 1, 0, 0)]]), "-1 up to 1"),
        (lambda: rc.Illuminance(LAMP, 1, tables=[[(-1, 1, 0, 0), (1, -1, 0, 0)]]), "0 or more"),
        (lambda: rc.Highlight((0, 0), LAMP, 10), "coordinates"),
        (lambda: rc.Highlight((0, 0, 0), LAMP, 91), "0 to 90"),
    ],
)
def test_criteria_that_cannot_be_are_refused(make, text):
    with pytest.raises(ConfigError, match=text):
        make()
