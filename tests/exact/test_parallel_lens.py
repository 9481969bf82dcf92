"""Distortion and skew of parallel rays: pixels, areas, regions and samples, against formulas."""

import numpy as np
import pytest
import shapely
from exact_views import PATHS, SEEDS, look, soup
from hypothesis import given
from hypothesis import strategies as st
from nightly import amount, examples
from surface_cases import assert_pointwise, building, room
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.core.camera.projection import starts_of, to_image, view_frame
from rastercov.core.coverage.coverage import FIGURES
from rastercov.core.coverage.doubts import dead_pixels
from rastercov.reference import polygons, regions, telecentric

pytestmark = pytest.mark.native

SENSOR = {"magnification": 0.25, "pixel_size": 3.45e-6}
LENSES = {
    "k1": {"distortion": (60.0,)},
    "pincushion": {"distortion": (-40.0, 2e4)},
    "brown": {"distortion": (30.0, -1e4, 0.02, -0.03, 1e8)},
    "division": {"model": "telecentric_division", "distortion": (-50.0,)},
    "skew": {"skew": 0.3},
    "both": {"skew": -0.05, "distortion": (-60.0,)},
}
"""Lenses of a sensor whose corners are 8 to 9 mm from its middle."""


def lens_of(name, size, px_per_m, **others):
    """Camera of an image size whose sensor is as large as the coefficients want it."""
    own = dict(LENSES[name])
    pitch = 8e-3 / float(np.hypot(*size)) * 2
    own["skew"] = own.get("skew", 0.0) * px_per_m
    lens = {"magnification": px_per_m * pitch, "pixel_size": pitch}
    return rc.Camera.telecentric(*size, **lens, **(own | others))


coefficient = st.floats(-1, 1)


@given(
    k1=coefficient, k2=coefficient, p1=coefficient, p2=coefficient, k3=coefficient, skew=coefficient
)
@examples(20)
def test_pixels_are_those_of_the_formula_on_the_sensor(k1, k2, p1, p2, k3, skew):
    """Each coefficient alone moves a corner, 8.8 mm from the middle, by 0.4 % at most."""
    radius = 8.8e-3
    own = np.array((k1, k2, p1, p2, k3)) * 4e-3 / radius ** np.array((2, 4, 1, 1, 6))
    scale = SENSOR["magnification"] / SENSOR["pixel_size"]
    camera = rc.Camera.telecentric(
        4096, 3000, **SENSOR, distortion=tuple(own), skew=0.2 * skew * scale, cx=2000.0
    )
    x, y, z = np.random.default_rng(1).uniform(-0.02, 0.02, (3, 200))
    expected = telecentric.image_of(camera, x, y).T
    image = to_image(np.stack((x, y, z), axis=1), camera)
    assert np.abs(image - expected).max() <= 1e-9
    back = starts_of(expected, camera)
    assert np.abs(back[:, :2] - np.stack((x, y), axis=1)).max() <= 1e-15
    assert not back[:, 2].any()


@given(kappa=st.floats(-100, 100))
@examples(10)
def test_the_division_model_is_undone_by_a_division(kappa):
    """HALCON's p = p' / (1 + kappa p'^2), from the place on the sensor to the ideal one."""
    camera = rc.Camera.telecentric(
        4096, 3000, **SENSOR, model="telecentric_division", distortion=(kappa,)
    )
    places = np.random.default_rng(2).uniform(-0.005, 0.005, (100, 2))
    pixels = places / SENSOR["pixel_size"] + (camera.cx, camera.cy)
    ideal = places / (1 + kappa * (places**2).sum(axis=1, keepdims=True))
    starts = starts_of(pixels, camera)[:, :2]
    assert np.abs(starts - ideal / SENSOR["magnification"]).max() <= 1e-15


@pytest.mark.parametrize("name", LENSES)
def test_a_resized_image_is_the_same_image(name):
    camera = lens_of(name, (500, 400), 9000)
    x, y = np.random.default_rng(3).uniform(-0.02, 0.02, (2, 50))
    for size in (0.5, 3.0):
        expected = size * telecentric.image_of(camera, x, y)
        image = telecentric.image_of(camera.resized(size), x, y)
        assert np.abs(image - expected).max() <= 1e-9
        own = to_image(np.stack((x, y, x), axis=1), camera.resized(size)).T
        assert np.abs(own - expected).max() <= 1e-9


def test_coefficients_of_0_are_no_distortion():
    plain = rc.Camera.telecentric(64, 48, **SENSOR)
    for own in ({}, {"model": "telecentric_division", "distortion": (0.0,)}):
        camera = rc.Camera.telecentric(64, 48, **SENSOR, **({"distortion": (0.0, 0.0)} | own))
        assert camera == plain
        assert not camera.is_curved
    assert rc.Camera.telecentric(64, 48, **SENSOR, skew=1.0).is_curved


@pytest.mark.parametrize("kappa", [1e9, 1e12, -1e12])
def test_a_lens_that_folds_in_the_image_is_refused_in_one_line(kappa):
    camera = rc.Camera.telecentric(
        64, 48, **SENSOR, model="telecentric_division", distortion=(kappa,)
    )
    with pytest.raises(
        rc.CameraError, match="expected distortion and skew that do not fold"
    ) as raises:
        rc.visibility(rc.shapes.box(), camera, rc.look_at((0, 0, 3), (0, 0, 0)))
    assert "max_angle" not in str(raises.value)


def test_pixels_beyond_the_fold_of_a_polynomial_see_nothing_and_have_a_line():
    """The corners are 9 mm from the middle; p (1 - 900 p^2) is at most 13 mm, of 3,000 7 mm."""
    mesh = rc.shapes.box((0.02, 0.02, 0.02))
    pose = rc.look_at((0.3, 0.1, 0.4), (0, 0, 0))
    for k1, is_whole in ((-900.0, True), (-3000.0, False)):
        camera = rc.Camera.telecentric(4096, 3000, **SENSOR, distortion=(k1,))
        result = rc.evaluate(mesh, camera, pose)
        assert bool(dead_pixels(camera)) != is_whole
        lines = " ".join(result.summary()["doubts"])
        assert (" m off axis): check its model" in lines) != is_whole
        starts, _ = view_frame(camera, 8, 1.0)
        assert np.isfinite(starts).all()


@pytest.mark.parametrize("k1", [0.0, 4.0, -4.0, 40.0])
@pytest.mark.parametrize("path", PATHS)
def test_areas_are_those_of_dense_outlines(path, k1):
    """Of a grid of 40 mm, seen obliquely, by outlines of 20,000 points a side."""
    n, side = 8, 0.04
    steps = np.linspace(-side / 2, side / 2, n + 1)
    x, y = np.meshgrid(steps, steps)
    i, j = (each.ravel() for each in np.meshgrid(np.arange(n), np.arange(n)))
    a = i * (n + 1) + j
    corners = np.concatenate(
        (np.stack((a, a + 1, a + n + 2), 1), np.stack((a, a + n + 2, a + n + 1), 1))
    )
    mesh = rc.Mesh(np.stack((x.ravel(), y.ravel(), np.zeros(x.size)), 1), corners)
    camera = rc.Camera.telecentric(4096, 3000, **SENSOR, distortion=(k1,))
    pose = rc.look_at((0.1, 0.05, 1), (0, 0, 0))[0]
    view = look(mesh, camera, pose, path)
    local = ((mesh.vertices - pose[:3, 3]) @ pose[:3, :3])[mesh.faces][..., :2]
    t = np.linspace(0, 1, 20_000, endpoint=False)[:, None]
    checked = 0
    for f, face in enumerate(local):
        ends = np.roll(face, -1, axis=0)
        outline = np.concatenate([(1 - t) * p + t * q for p, q in zip(face, ends, strict=True)])
        u, v = telecentric.image_of(camera, *outline.T)
        if not ((u > 0) & (v > 0) & (u < camera.width) & (v < camera.height)).all():
            continue
        u, v, checked = u - u.mean(), v - v.mean(), checked + 1
        area = abs(np.sum(u * np.roll(v, -1) - np.roll(u, -1) * v)) / 2
        # What the chords of the outline cut off at each side: bend L^2 / 12 of a length L.
        chords = 6 * abs(k1) * 9e-3 * (700 / 20_000) ** 2 * 700 * 3 / 12 * 3.45e-6
        for item in (view.area[f], view.visible[f]):
            assert abs(item - area) <= 1e-7 + chords
    assert checked >= 90


def distorted_area(camera, shape, step=0.05):
    """Area in the image of what a polygon of an image without distortion shows, px^2."""
    frame = shapely.box(0, 0, camera.width, camera.height)
    ideal = replace_plain(camera)
    total = 0.0
    for part in shapely.get_parts(shape):
        if part.geom_type != "Polygon" or part.area == 0:
            continue
        points = shapely.get_coordinates(shapely.segmentize(part, step))
        places = (points - (ideal.cx, ideal.cy)) / (ideal.fx, ideal.fy)
        polygon = shapely.Polygon(telecentric.image_of(camera, *places.T).T)
        total += shapely.intersection(polygon, frame).area
    return total


MARGIN = 60
"""Pixels around an image that the ideal one has, so that it holds the distorted one."""


def replace_plain(camera):
    """Camera without distortion whose image holds all that another one sees."""
    return rc.Camera(
        width=camera.width + 2 * MARGIN, height=camera.height + 2 * MARGIN, fx=camera.fx,
        fy=camera.fy, cx=camera.cx + MARGIN, cy=camera.cy + MARGIN, near=camera.near,
        model="telecentric",
    )  # fmt: skip


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("path", PATHS)
def test_visible_areas_are_those_of_visible_polygons_through_the_formula(name, path):
    rng = np.random.default_rng(len(name))
    mesh = soup(rng, n=30)
    mesh = rc.Mesh(mesh.vertices * 4e-3, mesh.faces)
    for near in (0.0, 0.02):
        camera = lens_of(name, (500, 400), 9000, near=near)
        pose = np.eye(4)
        view = look(mesh, camera, pose, path)
        plain = replace_plain(camera)
        faces = rng.permutation(mesh.n_faces)[: amount(12, 30)]
        shapes = polygons.visible_polygons(mesh, plain, pose, faces)
        for f, shape in zip(faces, shapes, strict=True):
            error = 1e-5 + (0.0 if view.is_certified[f] else view.area_error[f])
            assert abs(view.visible[f] - distorted_area(camera, shape)) <= error
        assert view.visible[faces].max() > 0


@pytest.mark.parametrize("method", ["certified", "exact"])
def test_the_path_of_lenses_has_the_figures_of_no_distortion(method):
    mesh = rc.shapes.torus(24, 16)
    size = mesh.diagonal
    own = {"width": 300, "height": 260, "fx": 280 / size, "fy": 280 / size, "pixel_size": 1e-5}
    plain = rc.Camera(model="telecentric", **own)
    curved = rc.Camera(model="telecentric", distortion=(1e-30,), **own)
    assert curved.is_curved
    away = np.random.default_rng(3).normal(size=(4, 3))
    poses = rc.look_at(size * away / np.linalg.norm(away, axis=1, keepdims=True), (0, 0, 0))
    task = rc.Task(max_incidence_deg=70, min_pixel_density=0.5 * plain.fx)
    one, other = (rc.evaluate(mesh, each, poses, task, method=method) for each in (plain, curved))
    assert abs(one.covered.area.sum() - other.covered.area.sum()) <= 1e-6 * mesh.areas.sum()
    one, other = (
        rc.evaluate(mesh, each, poses, task, method=method, by="face") for each in (plain, curved)
    )
    for figure in set(FIGURES) - {"visibility_bound", "visibility_kind"}:
        first, second = getattr(one, figure), getattr(other, figure)
        if first.dtype == np.float64:
            np.testing.assert_allclose(first, second, rtol=1e-11, atol=2e-9, err_msg=figure)
        else:
            np.testing.assert_array_equal(first, second, err_msg=figure)


@pytest.mark.parametrize("name", LENSES)
def test_densities_of_faces_are_those_of_the_formula_at_the_worst_vertex(name):
    mesh = rc.shapes.torus(24, 16)
    camera, poses, _ = around(mesh, np.random.default_rng(6), name)
    task = rc.Task(min_pixel_density=1.0, min_facing_density=1.0)
    result = rc.evaluate(mesh, camera, poses, task, by="face")
    for row, pose in enumerate(poses):
        local = (mesh.vertices[mesh.faces] - pose[:3, 3]) @ pose[:3, :3]
        normal = mesh.normals @ pose[:3, :3]
        seen = np.flatnonzero((normal[:, 2] < 0) & result.in_view[row])
        assert len(seen) > 50
        worst = np.full((2, len(seen)), np.inf)
        for s in range(3):
            x, y, _ = local[seen, s].T
            tangents = regions.jacobian(camera, local[seen, s], normal[seen])
            slopes = telecentric.slopes_of(camera, x, y)
            for own, each in zip(worst, (tangents, slopes), strict=True):
                np.minimum(own, np.linalg.svd(each, compute_uv=False)[:, 1], out=own)
        assert result.pixel_density[row, seen] == pytest.approx(worst[0], rel=1e-9, abs=1e-7)
        assert result.facing_density[row, seen] == pytest.approx(worst[1], rel=1e-9)
        angle = np.arccos(np.clip(-normal[seen, 2], -1, 1))
        assert result.incidence[row, seen] == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("scene", ["torus", "hostile"])
@pytest.mark.parametrize("name", ["brown", "division", "both"])
def test_pixels_show_the_surface_that_their_ray_meets_first(name, scene):
    mesh = rc.shapes.torus(20, 12) if scene == "torus" else soup(np.random.default_rng(5), n=40)
    rng, size = np.random.default_rng(len(name)), mesh.diagonal
    camera, poses, _ = around(mesh, rng, name, near=0.4 * size)
    camera = camera.resized(0.2)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x, y, _ = np.moveaxis(starts_of(np.stack((u, v), axis=-1), camera), -1, 0)
    assert np.abs(telecentric.image_of(camera, x, y) - (u, v)).max() <= 1e-9
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        for pose in poses:
            seen, depth = rasterizer.render(pose), nearest(mesh, camera, pose, (x, y))
            with np.errstate(invalid="ignore"):
                is_close = np.abs(seen.depth - depth) <= 1e-4 * size
            agree = is_close | (np.isinf(depth) & np.isinf(seen.depth))
            assert (~agree).mean() <= 0.01  # steps of 1/1024 px at edges
            assert (np.isinf(seen.depth) == (seen.face < 0)).all()
            assert (seen.face >= 0).any()


def test_samples_of_targets_lie_where_areas_say():
    mesh = beside(sheet_at((-1, -1), (1, 1), 0), sheet_at((-0.5, -0.5), (0.5, 0.5), -1))
    camera, _, _ = around(mesh, np.random.default_rng(1), "k1")
    poses = rc.look_at([(0.2, 0, 3.0), (0, 0.3, -3.0)], (0, 0, 0))
    shares = [
        rc.visibility(mesh, camera, poses, method=each) for each in ("sampled@4", "certified")
    ]
    assert (np.abs(shares[0].value - shares[1].value) <= shares[0].bound + shares[1].bound).all()
    counted, exact = (
        open_counts(mesh, camera, poses, method) for method in ("sampled", "certified")
    )
    assert np.abs(counted - exact).max() <= 0.02 * exact.max()


def open_counts(mesh, camera, poses, method):
    """Visible areas by a method, px^2."""
    with rc.open_observer(mesh, camera, method) as observer:
        return observer.observe(poses).visible_pixels


def nearest(mesh, camera, pose, places):
    """Least depth beyond the near plane along rays at places across them, by all triangles."""
    local, (x, y) = (mesh.vertices - pose[:3, 3]) @ pose[:3, :3], places
    result = np.full(x.shape, np.inf)
    for a, b, c in local[mesh.faces]:
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        s = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
        t = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
        depth = a[2] + s * (b[2] - a[2]) + t * (c[2] - a[2])
        is_in = (s >= 0) & (t >= 0) & (s + t <= 1) & (depth >= camera.near)
        result = np.where(is_in, np.minimum(result, depth), result)
    return result


TASKS = {
    "visible": {},
    "oblique": {"max_incidence_deg": 55},
    "per m^2": {"min_pixels_per_m2": 0.6},
    "density": {"min_pixel_density": 0.6},
    "facing": {"min_facing_density": 1.0},
}
"""Thresholds of densities for one pixel per metre."""


def around(mesh, rng, name, count=2, **others):
    """Distorted camera and poses around a mesh that fills most of the image."""
    low, high = mesh.bounds
    size = float(np.linalg.norm(high - low))
    camera = lens_of(name, (420, 300), 330 / size, **others)
    away = rng.normal(size=(count, 3))
    away *= size / np.linalg.norm(away, axis=1, keepdims=True)
    middle = (low + high) / 2
    return camera, rc.look_at(middle + away, middle), 330 / size


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", LENSES)
def test_a_point_is_in_a_region_exactly_if_it_meets_every_criterion(name, task):
    scene = {"k1": room, "both": room}.get(name, building)
    mesh = scene()[0]
    rng = np.random.default_rng(len(name) + len(task))
    camera, poses, scale = around(
        mesh, rng, name, focus_range=(0.5 * mesh.diagonal, 1.2 * mesh.diagonal)
    )
    scales = {"min_pixels_per_m2": scale**2, "max_incidence_deg": 1}
    own = {key: value * scales.get(key, scale) for key, value in TASKS[task].items()}
    assert_pointwise(mesh, camera, poses, rc.Task(**own), 2500)


@pytest.mark.slow
@given(seed=SEEDS, name=st.sampled_from(list(LENSES)))
@examples(6, at_night=60)
def test_regions_of_any_triangles_hold_their_covered_points(seed, name):
    rng = np.random.default_rng(seed)
    mesh = soup(rng, n=40)
    camera, poses, scale = around(mesh, rng, name, 1, near=mesh.diagonal * rng.uniform(0, 1.2))
    for own in ({}, {"min_pixel_density": 0.6 * scale}, {"min_pixels_per_m2": 0.6 * scale**2}):
        assert_pointwise(mesh, camera, poses, rc.Task(**own), 1500, seed % 1000)
