"""Covered area of a network: its unit, sums over batches and groups, and what no camera covers."""

import numpy as np
import pytest
from exact_views import SEEDS
from hypothesis import example, given
from hypothesis import strategies as st
from lens_cameras import CAMERAS
from nightly import examples
from scenes import joined, square
from surface_cases import hostile_scene, room

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.core.area.feature import in_words
from rastercov.core.area.network import AreaNetwork, unit_of_result
from rastercov.core.area.polygons import polygon_areas
from rastercov.core.area.regions import RegionObserver
from rastercov.core.area.union import with_rest
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Group


def network_of(mesh, camera, poses, task, step=2, *, closing=True):
    """Covered area, added up a few poses at a time."""
    areas = AreaNetwork(mesh, task)
    with RegionObserver(mesh, camera, task, Engine()) as observer:
        for at in range(0, len(poses), step):
            areas.add(observer.observe(poses[at : at + step]).regions)
            if closing:
                observer.closed = areas.closed
    return areas


# --- unit of a result -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("by", "task", "method", "words"),
    [
        ("faces", rc.Task(), "certified", "expected 'by' to be area or face, got 'faces'"),
        ("area", rc.Task(min_pixels=5), "certified", "min_pixels applies to faces"),
        ("area", rc.Task(), "sampled", "method sampled counts whole faces"),
    ],
)
def test_what_cannot_be_by_area_is_refused(by, task, method, words):
    with pytest.raises(ConfigError, match=words):
        unit_of_result(by, task, Engine(method))
    # Where nothing was chosen, that is the reason of a result by face.
    unit, reason = unit_of_result(None, task, Engine(method))
    assert (unit, words in reason) == (("area", False) if by == "faces" else ("face", True))


# --- sums -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 2, 3])
def test_closed_faces_change_nothing(views):
    mesh, camera, poses = room()
    task = rc.Task(views=views, max_incidence_deg=75)
    closing = network_of(mesh, camera, poses, task)
    whole = network_of(mesh, camera, poses, task, step=len(poses), closing=False)
    bound = closing.covered.bound + whole.covered.bound
    assert (abs(closing.covered.area - whole.covered.area) <= bound + 1e-12).all()
    assert closing.summary()["percent"] == pytest.approx(whole.summary()["percent"], abs=1e-7)


@pytest.mark.slow
def test_groups_add_up_to_the_whole():
    mesh, camera, poses = room()
    task = rc.Task(views=2)
    areas = network_of(mesh, camera, poses, task)
    network = Network(mesh, task)
    summary = network.summary()
    areas.add_to(summary, camera, poses)
    parts = [group["covered_area"] for group in summary["groups"] if "covered_area" in group]
    assert sum(part["m2"] for part in parts) == pytest.approx(summary["covered_area"]["m2"])
    assert [row["views"] for row in summary["covered_area"]["by_views"]] == [1, 2]
    most, least = (row["m2"] for row in summary["covered_area"]["by_views"])
    assert most > least == summary["covered_area"]["m2"] > 0


def two_groups(**flags):
    mesh = joined(square(2, 4), square(1, 3))
    groups = [Group("back"), Group("front", **flags)]
    return rc.Mesh(mesh.vertices, mesh.faces, groups=groups, face_group=[0, 0, 1, 1])


def test_groups_may_need_views_of_their_own():
    mesh, camera = two_groups(), rc.Camera(width=100, height=100, fx=50, fy=50)
    areas = network_of(mesh, camera, np.eye(4)[None], rc.Task(views=2))
    by_one = areas.summary()["by_views"][0]
    assert areas.summary({})["m2"] == pytest.approx(by_one["m2"]) == areas.covered.area[0].sum()
    front = areas.summary({"back": 2})
    assert front["m2"] == pytest.approx(areas.covered.area[0, 2:].sum())
    assert areas.summary({"back": 2, "front": 2})["m2"] == 0
    summary = Network(mesh, areas.task).summary()
    areas.add_to(summary, camera, np.eye(4)[None], {"back": 2})
    assert [group["covered_area"]["views"] for group in summary["groups"]] == [2, 1]
    assert summary["groups"][1]["covered_area"]["percent"] == pytest.approx(100)


@pytest.mark.slow
@given(seed=SEEDS, lens=st.sampled_from([None, "fisheye"]))
@example(272, "fisheye")  # a plane of the lens that sees nothing of the mesh
@examples(7, at_night=20)
def test_an_observer_of_regions_measures_what_an_exact_observer_does(seed, lens):
    mesh, camera, poses = hostile_scene(seed)
    camera = CAMERAS[lens] if lens else camera
    with rc.open_observer(mesh, camera) as plain:
        expected = plain.observe(poses)
    with RegionObserver(mesh, camera, rc.Task(), Engine()) as observer:
        observation = observer.observe(poses)
    for name in ("visible_pixels", "drawn_pixels", "kind", "area_error", "clipped"):
        assert np.array_equal(getattr(observation, name), getattr(expected, name)), name
    again = rc.regions(mesh, camera, poses)
    assert np.array_equal(observation.regions.areas(), again.areas())


# --- the rest -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("views", [1, 3])
def test_covered_parts_and_the_rest_make_up_the_faces(views):
    mesh, camera, poses = room()
    areas = network_of(mesh, camera, poses, rc.Task(views=views, max_incidence_deg=75))
    parts = with_rest(areas.covered)
    sizes = polygon_areas(parts.xy, parts.starts)
    sums = np.bincount(parts.face, sizes, minlength=mesh.n_faces)
    assert sums == pytest.approx(mesh.areas, rel=1e-9)
    assert set(parts.views.tolist()) <= set(range(views + 1))
    for level in range(views):
        rows = parts.views > level
        values = np.bincount(parts.face[rows], sizes[rows], minlength=mesh.n_faces)
        assert values == pytest.approx(areas.covered.area[level], abs=1e-9 * mesh.areas.max())


def test_occluders_have_no_rest():
    covered = AreaNetwork(two_groups(is_occluder=True), rc.Task()).covered
    assert set(with_rest(covered).face.tolist()) == {0, 1}


def test_words_have_the_digits_that_are_known():
    figures = {"percent": 12.3456789, "bound_percent": 3e-4, "views": 1, "by_views": []}
    assert in_words(figures) == "12.3 % of the area"
    figures |= {"bound_percent": 0.0, "views": 2, "by_views": [{"percent": 50.0, "views": 1}, {}]}
    assert "by at least 2 cameras; 50.0 % by at least 1" in in_words(figures)


def test_what_is_covered_as_a_whole_is_100_percent():
    for seed in range(60):
        w, h = np.random.default_rng(seed).uniform(0.1, 3, 2)
        corners = [(0, 0, 0), (w, 0, 0), (w, h, 0), (0, h, 0)]
        plate = rc.Mesh(corners, [(0, 1, 2), (0, 2, 3)])
        camera = rc.Camera.from_fov(400, 400, hfov_deg=150)
        pose = rc.look_at((w / 2, h / 2, 5), (w / 2, h / 2, 0))
        result = rc.evaluate(plate, camera, pose, rc.Task(), fields=())
        assert result.summary()["covered_area"]["percent"] == 100
