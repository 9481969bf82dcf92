"""Uncertainty of points: the information matrix, against Monte Carlo, and cuts by it."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from edited import Session
from exact_views import SEEDS
from hypothesis import given
from lens_cameras import CAMERAS
from nightly import amount, examples
from surface_cases import hostile_scene, in_regions, room, whole

import rastercov as rc
from rastercov.advice.headline import other_lines
from rastercov.base.errors import CameraError, ConfigError
from rastercov.core.area.cut import values_of
from rastercov.core.area.features import deviations_of
from rastercov.core.area.polygons import frames_of, to_plane, to_world
from rastercov.core.area.stages import CentrePass
from rastercov.core.camera import to_image
from rastercov.core.camera.rule import pixels_a_radian, rule_of
from rastercov.core.coverage.task import Reason
from rastercov.page.scene import open_mesh
from rastercov.reference.regions import points_on
from rastercov.report.coverage import Options, network_of, run
from rastercov.report.modes import FIRST, MODES
from rastercov.report.parquet import write_areas
from rastercov.sensors.ray_limits import measure_limits

pytestmark = pytest.mark.native


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def information(criterion, points, normals, sees=None):
    """(N, 3, 3) matrices by the definition."""
    total = np.zeros((len(points), 3, 3))
    eyes = np.asarray(criterion.eyes)
    for j, eye in enumerate(eyes):
        away = points - eye
        d = np.linalg.norm(away, axis=1)
        u = away / d[:, None]
        sigma, stripe = criterion.noise[j], criterion.stripes[j]
        if stripe.any():
            m = unit(np.cross(u, stripe))
            own = m[:, :, None] * m[:, None]
        else:
            own = np.eye(3) - u[:, :, None] * u[:, None]
        own = own / (sigma * d[:, None, None]) ** 2
        if criterion.ranges[j] > 0:
            cosine = (u * normals).sum(axis=1)
            ranged = u[:, :, None] * u[:, None] * cosine[:, None, None] ** 2
            own = own + ranged / criterion.ranges[j] ** 2
        total += own if sees is None else own * sees[:, j, None, None]
    return total


def holds(criterion, points, normals, sees=None):
    values = information(criterion, points, normals, sees) * criterion.limit**2
    off = np.eye(3) if criterion.along == "worst" else normals[:, :, None] * normals[:, None]
    return np.linalg.eigvalsh(values - off)[:, 0]


def deviation(criterion, point, normal=(0.0, 0.0, -1.0), direction=None):
    """Standard deviation at a point, by the loop, in the worst direction or along the normal."""
    mesh = triangle_at(point, normal)
    low, high = 1e-9, 10.0
    for _ in range(60):
        middle = np.sqrt(low * high)
        own = replace(criterion, limit=middle)
        xy = to_plane(mesh, np.zeros(1, int), np.array([point]))
        value = values_of(mesh, own._cuts(1)[0], np.zeros(1, np.int64), xy)[0, 0]
        low, high = (low, middle) if value >= 0 else (middle, high)
    return middle


def triangle_at(point, normal):
    x = unit(np.cross(normal, (0.3, 0.9, 0.2)))
    y = np.cross(normal, x)
    corners = np.asarray(point) + 0.05 * np.array([-x - y, 2 * x - y, 2 * y - x])
    return rc.Mesh(corners, [(0, 1, 2)])


def scattered(rng, rays, planes, n=20_000):
    """(n, 3) least-squares points of noisy measurements.

    `rays` are (eye, sigma), `planes` (eye, axis, sigma), of a point at the origin.
    """
    total, right = np.zeros((n, 3, 3)), np.zeros((n, 3))
    for eye, sigma in rays:
        d, u = np.linalg.norm(eye), unit(-eye)
        e = np.linalg.svd(u[None])[2][1:]
        w = unit(u + rng.normal(0, sigma, (n, 2)) @ e)
        own = (np.eye(3) - w[:, :, None] * w[:, None]) / (sigma * d) ** 2
        total, right = total + own, right + own @ eye
    for eye, axis, sigma in planes:
        d, u = np.linalg.norm(eye), unit(-eye)
        m = unit(np.cross(u, axis))
        across = np.cross(axis, m)
        angle = rng.normal(0, sigma, n)[:, None] * d / abs(across @ -eye)
        w = np.cos(angle) * m + np.sin(angle) * across
        own = w[:, :, None] * w[:, None] / (sigma * d) ** 2
        total, right = total + own, right + own @ eye
    return np.linalg.solve(total, right[..., None])[..., 0]


F, NOISE = 2200.0, 0.2


@pytest.mark.parametrize(("baseline", "z"), [(0.12, 0.5), (0.12, 1.0), (0.3, 0.6)])
def test_stereo_is_as_by_monte_carlo_and_as_in_textbooks(baseline, z):
    sigma, point = NOISE / F, np.zeros(3)
    eyes = np.array([(-baseline / 2, 0, -z), (baseline / 2, 0, -z)])
    result = deviation(rc.Uncertainty(eyes, 1, sigma), point)
    cloud = scattered(np.random.default_rng(0), [(eye, sigma) for eye in eyes], [])
    worst = np.linalg.eigvalsh(np.cov(cloud.T))[-1] ** 0.5
    assert result == pytest.approx(worst, rel=0.02)
    normal = deviation(rc.Uncertainty(eyes, 1, sigma, along="normal"), point)
    assert normal == pytest.approx(cloud[:, 2].std(), rel=0.02)
    if z / baseline >= 4:
        assert result == pytest.approx(z * z * np.sqrt(2) * NOISE / (F * baseline), rel=0.02)
    if (baseline, z) == (0.12, 0.5):
        assert result == pytest.approx(271.7e-6, rel=1e-3)


@pytest.mark.parametrize(("degrees", "um"), [(15, 140.5), (30, 72.7), (45, 51.4)])
def test_a_laser_sheet_is_as_its_footprint_over_the_sine(degrees, um):
    a, sigma = np.radians(degrees), NOISE / F
    camera, laser = 0.4 * np.array([np.sin(a), 0, -np.cos(a)]), np.array([0, 0, -0.4])
    eyes, stripes = np.array([camera, laser]), [(0, 0, 0), (0, 1, 0)]
    result = deviation(rc.Uncertainty(eyes, 1, [sigma, 1e-9], stripes), np.zeros(3))
    assert result == pytest.approx(um * 1e-6, rel=0.002)
    assert result == pytest.approx(0.4 * sigma / np.sin(a), rel=0.02)


def test_stripes_of_a_projector_are_as_by_monte_carlo():
    camera, projector, sigma = np.array([0.0, 0.02, -0.6]), np.array([0.2, 0, -0.5]), 1e-4
    criterion = rc.Uncertainty([camera, projector], 1, [sigma, 3e-4], [(0, 0, 0), (0, 1, 0)])
    result = deviation(criterion, np.zeros(3))
    planes = [(projector, np.array([0.0, 1, 0]), 3e-4)]
    cloud = scattered(np.random.default_rng(1), [(camera, sigma)], planes)
    worst = np.linalg.eigvalsh(np.cov(cloud.T))[-1] ** 0.5
    assert result == pytest.approx(worst, rel=0.02)


def test_a_range_is_as_by_monte_carlo():
    eye, s, sigma = np.array([0.0, 0, -10]), 2e-3, 1e-4
    rng = np.random.default_rng(2)
    for degrees in (0, 60):
        normal = np.array([np.sin(np.radians(degrees)), 0, -np.cos(np.radians(degrees))])
        along = rng.normal(0, s / np.cos(np.radians(degrees)), 20_000)
        across = rng.normal(0, sigma * 10, (20_000, 2))
        cloud = np.column_stack([across, along])
        criterion = rc.Uncertainty([eye], 1, sigma, ranges=s)
        result = deviation(criterion, np.zeros(3), normal)
        assert result == pytest.approx(cloud.std(axis=0).max(), rel=0.02)
        on_normal = deviation(replace(criterion, along="normal"), np.zeros(3), normal)
        assert on_normal == pytest.approx((cloud @ normal).std(), rel=0.02)


def test_rays_that_are_nearly_parallel_are_uncertain():
    items = []
    for degrees in (10, 20, 40, 90):
        a = np.radians(degrees) / 2
        eyes = 0.5 * np.array([(np.sin(a), 0, -np.cos(a)), (-np.sin(a), 0, -np.cos(a))])
        items.append(deviation(rc.Uncertainty(eyes, 1, 1e-4), np.zeros(3)))
    assert np.array(items[:3]) / items[3] == pytest.approx([8.1, 4.1, 2.1], abs=0.05)


def random_uncertainty(rng, n, size=1.0, centre=(0, 0, 0)):
    stripes = rng.normal(size=(n, 3)) * (rng.uniform(size=(n, 1)) < 0.4)
    ranges = np.where(rng.uniform(size=n) < 0.3, size * 10 ** rng.uniform(-4, -3, n), 0.0)
    ranges[stripes.any(axis=1)] = 0.0
    spread = 10 ** rng.uniform(-3, 0.5) * rng.normal(size=(n, 3))
    return rc.Uncertainty(
        centre + size * (rng.normal(size=3) + spread), size * 10 ** rng.uniform(-4, -2.5),
        10 ** rng.uniform(-4, -3.7, n), stripes, ranges * (n > 2),
        "normal" if rng.integers(3) == 0 else "worst",
    )  # fmt: skip


def test_slopes_and_doubts_hold_on_random_pieces():
    rng, tight = np.random.default_rng(3), []
    for turn in range(amount(70, at_night=200)):
        mesh = rc.Mesh(rng.normal(size=(150, 3)), np.arange(150).reshape(50, 3))
        criterion = random_uncertainty(rng, 2 if turn % 2 else int(rng.integers(2, 6)))
        face = np.arange(50)
        weights = rng.dirichlet((1, 1, 1), 50)
        xy = np.einsum("fc,fci->fi", weights, frames_of(mesh).corners)
        r = 10 ** rng.uniform(-5, 0, 50)
        angle = rng.uniform(0, 2 * np.pi, (40, 50))
        off = r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
        off[1::2] *= np.sqrt(rng.uniform(size=(20, 50, 1)))
        truth = holds(criterion, to_world(mesh, face, xy), mesh.normals)
        cut = criterion._cuts(1)[0]
        plain = values_of(mesh, cut, face, xy)
        matrices = information(criterion, to_world(mesh, face, xy), mesh.normals)
        scale = 1 + criterion.limit**2 * np.linalg.norm(matrices, axis=(1, 2))
        assert (np.abs(plain[:, 0] - truth) <= 1e-12 * scale).all()
        here = values_of(mesh, cut, face, xy, radius=r)
        there = np.array([values_of(mesh, cut, face, xy + each)[:, 0] for each in off])
        known = np.isfinite(here[:, 3])
        linear = here[:, 0] + np.einsum("nki,ki->nk", off, here[:, 1:3])
        error = np.abs(there - linear)[:, known]
        rounding = 1e-12 * (scale[known] + np.abs(linear[:, known]))
        assert (error <= here[known, 3] + rounding).all()
        share = error / np.maximum(here[known, 3], 100 * rounding)
        tight.append(share.max(initial=0.0))
    assert max(tight) > 0.4


@pytest.mark.parametrize("stripes", [False, True])
@pytest.mark.parametrize(("n", "along"), [(2, "worst"), (3, "worst"), (2, "normal")])
def test_regions_are_as_by_points(n, along, stripes):
    mesh = rc.shapes.box((0.3, 0.3, 0.2))
    eyes = np.array([(0.3, 0, 0.6), (-0.3, 0, 0.6), (0, 0.4, 0.5)])
    noise, axes = [1e-4, 1.5e-4, 1e-4], np.array([(0, 0, 0), (0, 1, 0.2), (0, 0, 0)])
    limit = {"worst": 1.35e-4 if n == 2 else 0.9e-4, "normal": 0.9e-4}[along] * (1 + 0.2 * stripes)
    criterion = rc.Uncertainty(eyes[:n], limit, noise[:n], axes[:n] * stripes, along=along)
    part = whole(mesh).where(criterion)
    points, face = points_on(mesh, 6000)
    truth = holds(criterion, points, mesh.normals[face]) >= 0
    e = part.bound.sum() / mesh.areas.sum() * len(points)
    assert (in_regions(part, 0, points, face) != truth).sum() <= 2 + e + 6 * np.sqrt(e)
    assert part.bound.sum() <= 0.002 * mesh.areas.sum()
    assert 0.02 < part.area.sum() / mesh.areas.sum() < 0.98


@pytest.mark.parametrize(("n", "along", "has_stripes"), [
    (3, "worst", False), (4, "worst", True), (6, "normal", True),
])  # fmt: skip
def test_bounds_are_narrow_where_a_device_is_much_nearer_than_others(n, along, has_stripes):
    mesh, _, poses = room()
    points, face = points_on(mesh, 500)
    stripes = np.zeros((n, 3))
    stripes[-1] = np.array((0.1, 0.2, 1.0)) * has_stripes
    every = rc.Uncertainty(poses[:n, :3, 3], 1.0, 1e-4, stripes, along=along)
    normals = mesh.normals[face]
    covariance = np.linalg.inv(information(every, points, normals))
    variance = (
        np.linalg.eigvalsh(covariance)[:, -1] if along == "worst"
        else np.einsum("ni,nij,nj->n", normals, covariance, normals)
    )  # fmt: skip
    limit = float(np.median(variance) ** 0.5)
    part = whole(mesh).where(replace(every, limit=limit))
    assert part.bound.sum() <= 1e-3 * mesh.areas.sum()
    truth = variance <= limit**2
    e = part.bound.sum() / mesh.areas.sum() * len(points)
    assert (in_regions(part, 0, points, face) != truth).sum() <= 2 + e + 6 * np.sqrt(e)


@pytest.mark.slow
@examples(10)
@given(seed=SEEDS)
def test_devices_in_hostile_scenes_are_as_by_points(seed):
    mesh = hostile_scene(seed)[0]
    rng, size = np.random.default_rng(seed), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    points, face = points_on(mesh, 1000)
    if not len(points):
        return
    criterion = random_uncertainty(rng, 2 + seed % 4, size, mesh.bounds.mean(axis=0))
    with np.errstate(all="ignore"):
        truth = holds(criterion, points, mesh.normals[face])
    part = whole(mesh).where(criterion)
    e = part.bound.sum() / mesh.areas.sum() * len(points)
    is_off = in_regions(part, 0, points, face) != (truth >= 0)
    assert is_off.sum() <= 2 + e + 6 * np.sqrt(e)


def test_only_devices_that_see_a_piece_count():
    mesh, eyes = room()[0], np.array([(1.0, 1, 2), (4, 4, 2), (7, 2, 2.5)])
    regions = whole(mesh)
    sets = np.random.default_rng(5).integers(0, 8, len(regions))
    criterion = rc.Uncertainty(eyes, 2e-3, 2e-4)
    part = replace(regions, devices=sets).where(criterion)
    points, face = points_on(mesh, 6000)
    sees = (sets[np.searchsorted(regions.face, face)][:, None] >> np.arange(3) & 1).astype(bool)
    truth = holds(criterion, points, mesh.normals[face], sees) >= 0
    e = part.bound.sum() / mesh.areas.sum() * len(points)
    assert (in_regions(part, 0, points, face) != truth).sum() <= 2 + e + 6 * np.sqrt(e)
    assert 0 < part.area.sum() < mesh.areas.sum()


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"eyes": (0, 0, 0)}, "coordinates"),
        ({"limit": 0}, "expected limit above 0"),
        ({"noise": 0}, "expected noise above 0"),
        ({"ranges": -1}, "0 or more"),
        ({"along": "depth"}, "worst"),
        ({"stripes": [(0, 0, 1)] * 2, "ranges": 1e-3}, "got both"),
        ({"stripes": [(0, 0, 1)] * 3}, "fit shape"),
        ({"eyes": np.zeros((65, 3))}, "1 to 64"),
    ],
)
def test_devices_that_cannot_be_are_refused(changed, text):
    usual = {"eyes": [(0, 0, 1), (1, 0, 1)], "limit": 1e-4, "noise": 1e-4}
    with pytest.raises(ConfigError, match=text):
        rc.Uncertainty(**usual | changed)


def head(limit, stripes=(), n=2, task=None):
    """A stereo or fringe head, its second device 0.2 m beside the first and turned to its axis."""
    camera = rc.Camera(width=1280, height=1024, fx=2200, fy=2300)
    places = np.repeat(np.eye(4)[None], n, axis=0)
    for at in range(n):  # along x, turned about y
        turn = np.arctan2(0.2 * at, 0.6)
        places[at, :3, :3] = [
            (np.cos(turn), 0, -np.sin(turn)), (0, 1, 0), (np.sin(turn), 0, np.cos(turn))
        ]  # fmt: skip
        places[at, 0, 3] = 0.2 * at
    rule = rc.All(max_uncertainty=limit, noise_px=0.2, stripes=stripes)
    return rc.Rig([camera] * n, list("abc")[:n], places, rule=rule, tasks=task)


def ball():
    mesh = rc.shapes.torus(24, 12)
    size = np.ptp(mesh.bounds, axis=0).max()
    return rc.Mesh(mesh.vertices * 0.15 / size, mesh.faces)


@pytest.mark.parametrize(
    ("limit", "stripes", "n"), [(255e-6, (), 2), (255e-6, ("b",), 2), (146e-6, ("c",), 3)]
)
def test_rigs_measure_what_is_certain_enough(limit, stripes, n):
    mesh, rig = ball(), head(limit, stripes, n)
    places = rc.look_at(eyes=[(0, 0.05, -0.6), (0.1, 0.4, 0.5)], targets=(0, 0, 0))
    free = rc.Rig(rig.cameras, rig.names, rig.rig_from_camera, rule=rc.All())
    task, both = rc.Task(max_incidence_deg=80), rig.poses(places)
    regions = rc.regions(mesh, rig, both, task)
    every = rc.regions(mesh, free, free.poses(places), task)
    points, face = points_on(mesh, 4000)
    shares = []
    for row in range(2):
        placed = both.world_from_camera[row * n : (row + 1) * n]
        axes = placed[:, :3, 1] * np.isin(list("abc")[:n], stripes)[:, None]
        noise = np.full(n, 0.2 / 2200)
        criterion = rc.Uncertainty(placed[:, :3, 3], limit, noise, axes)
        truth = in_regions(every, row, points, face)
        truth &= holds(criterion, points, mesh.normals[face]) >= 0
        e = (regions.bounds()[row].sum() + every.bounds()[row].sum()) / mesh.areas.sum() * 4000
        assert (in_regions(regions, row, points, face) != truth).sum() <= 2 + e + 6 * np.sqrt(e)
        assert np.array_equal(
            measure_limits(rig.gates[0], placed, points)[1] <= limit,
            holds(criterion, points, mesh.normals[face]) >= 0,
        )
        shares.append(regions.areas()[row].sum() / every.areas()[row].sum())
    assert 0 < shares[1] < 0.9 < shares[0] + 0.4
    assert regions.bound.sum() <= 1e-3 * mesh.areas.sum()


def test_centres_of_cells_are_certain_enough_too():
    mesh, rig = ball(), head(237e-6)
    places = rc.look_at(eyes=[(0, 0.05, -0.6)], targets=(0, 0, 0))
    own = rc.cells(mesh, 0.05)
    result = CentrePass(own, rig, rc.Task()).find(rig.poses(places))
    loose = CentrePass(own, head(1.0), rc.Task()).find(rig.poses(places))
    centres = own.vertices.reshape(-1, 3, 3).mean(axis=1)
    certain = (
        measure_limits(rig.gates[0], rig.poses(places).world_from_camera, centres)[1] <= 237e-6
    )
    assert set(result.row(0)) == set(np.flatnonzero(certain)) & set(loose.row(0))
    assert 0 < len(result.row(0)) < len(loose.row(0))


def test_zones_that_are_seen_and_too_uncertain_are_named_for_it():
    square = rc.Mesh(
        np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * 0.1, [(0, 2, 1), (0, 3, 2)]
    )
    places = rc.look_at(eyes=[(0, 0, -0.6)], targets=(0, 0, 0))
    for limit, reason in ((1e-6, "uncertain"), (1e-3, "outside")):
        rig = head(limit)
        summary = rc.evaluate(square, rig, rig.poses(places), by="area", fields=()).summary()
        reasons = [zone["reason"] for zone in summary["dead_zones"]]
        assert reasons[:1] in ([], [reason])
        assert (summary["covered_area"]["m2"] == 0) == (reason == "uncertain")


def test_rules_are_written_and_read(tmp_path):
    rig = head(50e-6, ("b",))
    path = tmp_path / "rig.json"
    rc.write_views(path, rc.Views(rig, rc.Poses.of(np.zeros((0, 4, 4))), ()))
    assert rc.read_views(path).rig.gates == rig.gates
    text = path.read_text().replace("5e-05", '"50 um"')
    assert '"50 um"' in text
    path.write_text(text)
    again = rc.read_views(path).rig
    assert again.gates[0].most_deviation == pytest.approx(50e-6)
    assert again.gates[0].noise == (0.2 / 2200,) * 2
    assert again.gates[0].stripes == (1,)


def test_a_limit_that_rounding_would_decide_is_refused_in_time():
    camera, mesh = rc.Camera(width=32, height=24, fx=30, fy=30), rc.shapes.sphere()
    rule = rc.All(max_uncertainty=1e12, noise_px=1.0)
    rig = rc.Rig([camera] * 2, ["a", "b"], rc.look_at([(3, 0, 0), (3, 1, 0)], (0, 0, 0)), rule=rule)
    with pytest.raises(ConfigError, match="rounding dominates"):
        rc.evaluate(mesh, rig, rig.poses(np.eye(4)), by="area")


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        (
            {"max_uncertainty": 0, "noise_px": 1},
            "expected max_uncertainty, with noise_px or stripes, to be from 1e-30 to 1e30 m, got",
        ),
        (
            {"max_uncertainty": 1e-4},
            r"expected noise_px to be from 1e-06 to 1e\+06 px with max_uncertainty, got",
        ),
        ({"max_uncertainty": 1e29, "noise_px": 1e-300}, "1e-06 to 1e.06 px"),
        ({"max_uncertainty": 1e-300, "noise_px": 1}, "1e-30 to 1e30 m"),
        ({"max_uncertainty": 1e-4, "noise_px": {"a": 1}}, "each of"),
        ({"max_uncertainty": 1e-4, "noise_px": 1, "stripes": ["c"]}, "stripes to be some"),
        (
            {"max_uncertainty": 1e-4, "noise_px": 1, "stripes": ["a", "b"]},
            "expected a sensor without stripes, got none",
        ),
        (
            {"noise_px": 1},
            "expected max_uncertainty, with noise_px or stripes, to be from 1e-30 to 1e30 m, got",
        ),
    ],
)
def test_rules_that_cannot_be_are_refused(rule, text):
    camera = rc.Camera(width=100, height=100, fx=100, fy=100)
    with pytest.raises(CameraError, match=text):
        rc.Rig([camera] * 2, ["a", "b"], rule=rc.All(**rule))


def test_lengths_have_a_unit():
    assert rule_of({"rule": "all", "max_uncertainty": "50 um"}).max_uncertainty == 50e-6
    with pytest.raises(CameraError, match="m, mm or um"):
        rule_of({"rule": "all", "max_uncertainty": "50 parsec"})


def test_what_the_uncertainty_alone_loses_is_said_apart():
    mesh, places = ball(), rc.look_at(eyes=[(0, 0.05, -0.6)], targets=(0, 0, 0))

    def result(limit):
        rig = head(limit)
        return rc.evaluate(mesh, rig, rig.poses(places), by="area", fields=()).summary()

    strict, loose = result(237e-6), result(1.0)
    lost = {entry["condition"]: entry["missed"]["m2"] for entry in strict["by_device"]}
    by_name = {entry["device"]: entry["missed"]["m2"] for entry in strict["by_device"]}
    both = [each["covered_area"]["m2"] for each in (strict, loose)]
    assert lost["the uncertainty"] == pytest.approx(both[1] - both[0], abs=1e-9)
    usual = {entry["device"]: entry["missed"]["m2"] for entry in loose["by_device"]}
    assert all(by_name[name] <= usual[name] + 1e-9 for name in "ab")
    worst = {entry["condition"]: entry.get("worst_um") for entry in strict["by_device"]}
    assert worst["the uncertainty"] == pytest.approx(237, rel=1e-3)
    entry = loose["by_device"][-1]
    assert 255 < entry["worst_um"] < 265
    rig = head(1.0)
    at = np.array([entry["worst_at"]])
    assert deviations_of(rig, rig.poses(places), at) == pytest.approx(1e-6 * entry["worst_um"])
    assert "largest uncertainty of what is covered: 26" in "\n".join(other_lines(loose))
    zones = [zone for zone in strict["dead_zones"] if zone["reason"] == "uncertain"]
    assert zones
    for zone in zones:
        if zone["area_m2"] < 1e-8:  # a sliver has no point of its own to name
            continue
        assert 237 < zone["uncertainty_um"]["least"] <= zone["uncertainty_um"]["most"]
        assert "required" in zone["advice"]


def test_the_largest_deviation_of_a_face_is_that_of_its_points(tmp_path):
    mesh, rig = ball(), head(270e-6)
    places = rc.look_at(eyes=[(0, 0.05, -0.6), (0.1, 0.4, 0.5)], targets=(0, 0, 0))
    both = rig.poses(places)
    result = rc.evaluate(mesh, rig, both, by="area", fields=())
    um, bound = result.per_camera.of_faces["uncertainty_um"]
    seen = rc.regions(mesh, rig, both)
    points, face = points_on(mesh, 20_000)
    worst = np.zeros(mesh.n_faces)
    for row in range(2):
        placed = both.world_from_camera[2 * row : 2 * row + 2]
        own = rc.Uncertainty(placed[:, :3, 3], 1.0, 0.2 / 2200)
        at = in_regions(seen, row, points, face)
        least = np.linalg.eigvalsh(information(own, points[at], mesh.normals[face[at]]))[:, 0]
        np.maximum.at(worst, face[at], 1e6 / np.sqrt(least))
    assert (bound >= 0).all()
    assert (bound <= 1.001e-3 * um).all()
    assert (worst <= (um + bound) * (1 + 1e-9)).all()
    assert (um[worst > 0] <= 270).all()
    assert (worst[worst > 0] >= 0.93 * um[worst > 0]).mean() > 0.95
    write_areas(tmp_path / "areas.parquet", mesh, result.covered, result.per_camera.of_faces)
    table = pq.read_table(tmp_path / "areas.parquet").to_pydict()
    assert np.array_equal(table["uncertainty_um"], np.where(um > 0, um, np.nan), equal_nan=True)
    assert np.array_equal(np.isnan(table["uncertainty_bound_um"]), um == 0)


def test_pages_map_the_uncertainty(tmp_path):
    mesh, rig = ball(), head(270e-6)
    both = rig.poses(rc.look_at(eyes=[(0, 0.05, -0.6)], targets=(0, 0, 0)))
    run(mesh, rig, both, rc.Task(), tmp_path / "r", Options(pictures=1))
    assert (tmp_path / "r" / "uncertainty.png").exists()
    mode = MODES["uncertainty"]
    assert mode.words in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    result = rc.evaluate(mesh, rig, both, by="area", fields=())
    own = network_of(result, result.summary()).values["uncertainty"]
    painted = mode.paint(mesh, own)
    assert painted.scale["is_log"]
    unit, high = painted.scale["unit"], painted.scale["high"]
    assert (unit, high) == (
        "µm",
        own.values.max(),
    )  # as the text on it; it ended at 98 % of the area
    assert high > 0.9 * 270
    is_measured = painted.levels >= FIRST
    assert np.array_equal(is_measured, result.covered.area[0] > 0)


def test_the_viewer_colours_by_the_uncertainty_of_rigs_that_limit_it():
    mesh, rig = ball(), head(270e-6)
    both = rig.poses(rc.look_at(eyes=[(0, 0.05, -0.6)], targets=(0, 0, 0)))
    session = Session(open_mesh(mesh, rc.Views(rig, both, images=list("ab")), rc.Task(), "heads"))
    assert "uncertainty" in session.scene.modes
    figures, placed = session.figures(), both.world_from_camera
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    _, result = measure_limits(rig.gates[0], placed, corners)
    truth = np.where(figures.failing[0] == Reason.COVERED, result.reshape(-1, 3).max(axis=1), 0.0)
    assert figures.values["uncertainty"]().values == pytest.approx(1e6 * truth)
    assert 0 < np.count_nonzero(truth) < mesh.n_faces
    session.close()
    free = rc.Rig(rig.cameras, rig.names, rig.rig_from_camera, rule=rc.All())
    session = Session(open_mesh(mesh, rc.Views(free, both, images=list("ab")), rc.Task(), "a"))
    assert "uncertainty" not in session.scene.modes
    session.close()


@pytest.mark.parametrize("name", CAMERAS)
def test_noise_is_in_pixels_on_the_axis_of_any_lens(name):
    camera = replace(CAMERAS[name], cx=320.0, cy=240.0, skew=0.0, max_angle_deg=None)
    rays = np.array([(1e-5, 0, 1), (-1e-5, 0, 1), (0, 1e-5, 1), (0, -1e-5, 1)])
    pixels = to_image(rays, camera)
    slopes = (pixels[0] - pixels[1])[0] / 2e-5, (pixels[2] - pixels[3])[1] / 2e-5
    assert pixels_a_radian(camera, is_striped=False) == pytest.approx(min(slopes), rel=2e-3)
    assert pixels_a_radian(camera, is_striped=True) == pytest.approx(slopes[0], rel=2e-3)
