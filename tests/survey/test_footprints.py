"""Footprints against single rays, and their figures against those of plane geometry."""

import numpy as np
import pytest
import shapely
from nightly import amount
from terrain import CAMERAS, ground, heights, images, is_seen, site

import rastercov as rc
from rastercov.base.errors import MeshError
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.placement.footprints import footprints, overlap_words, project_down

NAMES = ("a", "b", "c", "d")
BORDER_REL = {True: 1e-7, False: 2e-5}
"""Distance to a border within which a ray may decide otherwise, of the diagonal: by rounding for a
pinhole, and in the strips that are left undecided along the border of the image of a lens."""


@pytest.mark.parametrize("height", [0.0, 1.0], ids=["plane", "terrain"])
@pytest.mark.parametrize("groups", [(), ("ground",)], ids=["from above", "ground"])
def test_footprints_are_where_rays_meet_the_surface(height, groups):
    mesh, poses = site(height), images()
    result = footprints(mesh, CAMERAS, poses, Task(), names=NAMES, groups=groups)
    xy = np.random.default_rng(0).uniform(-50, 50, (amount(1_500, 100_000), 2))
    points = np.column_stack((xy, heights(ground(height=height) if groups else mesh, xy)))
    for row, polygon in enumerate(result.polygons):
        camera = CAMERAS[poses.camera[row]]
        seen = is_seen(mesh, camera, poses.world_from_camera[row], points)
        inside = shapely.contains_xy(polygon, *xy.T)
        differ = shapely.points(xy[seen != inside])
        assert 0 < seen.sum() < len(xy)
        nearest = shapely.distance(shapely.boundary(polygon), differ).max(initial=0)
        assert nearest < BORDER_REL[camera.is_pinhole] * mesh.diagonal
        assert shapely.is_valid(polygon)
        assert shapely.area(polygon) == pytest.approx(result.area_m2[row], rel=1e-7)


def test_the_house_is_a_hole_in_the_footprint_on_the_ground_below():
    poses = rc.Poses.of(rc.look_at((-10, 5, 45), (-10, 5, 0), (0, 1, 0)))
    mesh = site(0.0)
    on_ground = footprints(mesh, CAMERAS[0], poses, Task(), names=["a"], groups=["ground"])
    above = footprints(mesh, CAMERAS[0], poses, Task(), names=["a"])
    (part,) = on_ground.polygons[0].geoms
    # The shadow of the roof's upper edge, 15 m high, from 45 m.
    assert [shapely.area(shapely.Polygon(each)) for each in part.interiors] == [
        pytest.approx((14 * 45 / 30) ** 2, rel=1e-9)
    ]
    roof = shapely.box(-17, -2, -3, 12)
    assert shapely.contains(above.polygons[0], shapely.buffer(roof, -1e-6))
    assert shapely.area(above.polygons[0]) == pytest.approx(shapely.area(part) + 14**2, rel=1e-9)


def test_what_is_seen_from_above_is_the_plan():
    mesh = site()
    above = project_down(mesh)
    normal = np.abs(mesh.normals[above.pair_face, 2])
    assert above.area @ normal == pytest.approx(100.0**2, rel=1e-9)
    far = mesh.moved(translation=(5e5, 5e6, 300))
    assert project_down(far).area.sum() == pytest.approx(above.area.sum(), rel=1e-6)


def test_a_sheet_counts_on_the_side_that_is_up():
    sheet = Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    sheet = sheet.with_groups(two_sided="all")
    camera, places = CAMERAS[0], [(0.5, 0.5, 3), (0.5, 0.5, -3)]
    poses = rc.Poses.of(rc.look_at(places, (0.5, 0.5, 0)))
    result = footprints(sheet, camera, poses, Task(), names=["above", "below"])
    assert result.area_m2.tolist() == pytest.approx([1.0, 0.0], abs=1e-9)


def test_overlaps_and_gsd_of_strips_are_those_of_plane_geometry():
    camera = rc.Camera(width=600, height=400, fx=500, fy=500)  # 24 m x 16 m from 20 m
    x, y = np.meshgrid(np.arange(5) * 4.8, np.arange(6) * 3.2, indexing="ij")
    y[1::2] = y[1::2, ::-1]
    eyes = np.stack((x.ravel(), y.ravel(), np.full(30, 20.0)), axis=1)
    poses = rc.Poses.of(rc.look_at(eyes, eyes - (0, 0, 1), (0, 1, 0)))
    names = [f"image {row}" for row in range(30)]
    plane = shapes.box((200, 200, 2)).moved(translation=(0, 0, -1))
    shuffled = np.random.default_rng(1).permutation(30)
    order = [names[row] for row in shuffled]
    summary = footprints(plane, camera, poses[shuffled], Task(), names=order).summary()
    assert summary["strips"] == 5
    assert summary["front_percent"] == pytest.approx(80, abs=1e-6)
    # A strip is as long as its images need: it covers all of the next one.
    assert summary["side_percent"] == pytest.approx(80, abs=1e-6)
    least = [summary[f"{name}_least_percent"] for name in ("front", "side")]
    assert least == pytest.approx([80, 80], abs=1e-6)
    assert summary["gsd_per_px"] == pytest.approx(0.04, rel=1e-6)  # 20 m / 500 px
    assert summary["union_m2"] == pytest.approx((4 * 4.8 + 24) * (5 * 3.2 + 16))
    entry = summary["images"][order.index("image 2")]
    assert entry["plan_m2"] == pytest.approx(24 * 16)


def sampled(camera, pose, normal):
    """Median GSD and mean height by area on a plane through the origin, of one ray per pixel."""
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
    rays, (axes, eye) = np.stack(rays, -1).reshape(-1, 3), (pose[:3, :3], pose[:3, 3])
    depth = -(eye @ normal) / (rays @ axes.T @ normal)
    seen = (depth > 0) & (np.abs(eye + depth[:, None] * (rays @ axes.T))[:, :2] < 300).all(axis=1)
    rays, depth = rays[seen], depth[seen]
    along = np.cross(np.eye(3)[:2], normal)  # two vectors in the plane, made perpendicular
    along = np.linalg.qr(along.T)[0].T @ axes
    slopes = along[None, :, :2] - along[None, :, 2:] * rays[:, None, :2]
    slopes = slopes * (camera.fx, camera.fy) / depth[:, None, None]
    least, weight = np.linalg.svd(slopes, compute_uv=False)[:, 1], 1 / np.abs(np.linalg.det(slopes))
    order = np.argsort(least)
    below = np.cumsum(weight[order])
    height = (eye + depth[:, None] * (rays @ axes.T))[:, 2]
    return 1 / least[order[np.searchsorted(below, below[-1] / 2)]], height @ weight / weight.sum()


@pytest.mark.parametrize("seed", range(amount(6, 60)))
def test_gsd_and_height_are_those_of_all_rays_on_any_slope_and_triangles(seed):
    rng = np.random.default_rng(seed)
    slope, n = np.tan(np.radians(rng.uniform(-35, 35, 2))), 1 + seed % 3
    normal = np.array((*-slope, 1)) / np.linalg.norm((*slope, 1))
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-300, 300, n + 1)] * 2))
    at = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (each.ravel() for each in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.concatenate([np.stack((a, b, c), 1), np.stack((a, c, d), 1)])
    mesh = Mesh(np.stack((x, y, np.stack((x, y), -1) @ slope), axis=1), faces)
    camera = rc.Camera(width=300, height=210, fx=rng.uniform(150, 400), fy=rng.uniform(150, 400))
    eye = rng.uniform(-20, 20, 2)
    eye = np.array((*eye, eye @ slope + 60))
    pose = rc.look_at(eye, eye + np.append(rng.uniform(-30, 30, 2), -60))[0]
    result = footprints(mesh, camera, rc.Poses.of(pose[None]), Task(), names=["a"])
    gsd, height = sampled(camera, pose, normal)
    assert result.gsd[0] == pytest.approx(gsd, rel=0.01)
    assert result.height[0] == pytest.approx(height, abs=0.5)


@pytest.mark.parametrize("groups", [(), ("ground",)], ids=["from above", "ground"])
def test_overlaps_leave_out_images_that_reach_the_edge(groups):
    camera = rc.Camera(width=600, height=400, fx=500, fy=500)  # 24 m x 16 m from 20 m
    x, y = np.meshgrid(np.arange(-4, 5) * 9.6, np.arange(-8, 9) * 3.2, indexing="ij")
    lengths = np.where(np.arange(9) % 2, 10, 30)[:, None]
    x, y = (each[np.abs(y) < lengths] for each in (x, y))
    eyes = np.stack((x, y, np.full(x.shape, 20.0)), axis=1)
    poses = rc.Poses.of(rc.look_at(eyes, eyes - (0, 0, 1), (0, 1, 0)))
    names = [f"{row:03}" for row in range(len(eyes))]
    plane = Mesh.joined(
        [
            shapes.box((80, 60, 2)).moved(translation=(0, 0, -1)),
            shapes.box((1, 1, 1)).moved(translation=(3, 2, 0.5)),
        ],
        names=["ground", "house"],
    ).with_groups(occluders=["house"])
    result = footprints(plane, camera, poses, Task(), names=names, groups=groups)
    reaches = (np.abs(x) > 40 - 12) | (np.abs(y) > 30 - 8)
    assert result.at_edge.tolist() == reaches.tolist()
    figures = result.summary()
    assert figures["front_percent"] == pytest.approx(80, abs=1e-6)
    assert figures["side_percent"] == pytest.approx(60, abs=1e-6)
    assert figures["front_least_percent"] == pytest.approx(80, abs=1)  # but for the house
    assert figures["side_least_percent"] == pytest.approx(60, abs=1)
    front, side = result.overlaps
    assert np.nanmin(side) < 0.3  # beyond the ends of short strips
    assert np.nanmax(front) == pytest.approx(1)  # at the edge
    small = plane.moved(scale=0.1)
    alone = footprints(small, camera, poses, Task(), names=names, groups=groups)
    assert overlap_words(alone.summary()).startswith("overlap unknown")


def test_an_occluder_is_no_surface():
    mesh = site().with_groups(occluders=["house"])
    with pytest.raises(MeshError, match="expected an evaluated group as surface, got occluder"):
        footprints(mesh, CAMERAS, images(), Task(), names=NAMES, groups=["house"])


def test_faces_that_touch_on_the_plan_between_corners_are_united():
    """GEOS refuses them as a coverage: an edge of each passes a corner of the other."""
    low, high = [(0, 3, 0), (2, 1, 0), (3, 3, 0)], [(0, 2, 1), (1, 2, 1), (0, 3, 1)]
    mesh = Mesh(np.array([*low, *high], float), [(0, 1, 2), (3, 4, 5)])
    camera, pose = (
        rc.Camera.from_fov(100, 100, hfov_deg=20),
        rc.look_at((1.5, 1.5, 30), (1.5, 1.5, 0)),
    )
    result = footprints(mesh, camera, rc.Poses.of(pose), Task(), names=["a"], groups=["mesh"])
    corners = [np.array(each)[:, :2] for each in (low, high)]
    wanted = shapely.union_all([shapely.Polygon(each) for each in corners])
    assert shapely.area(result.polygons[0]) == pytest.approx(shapely.area(wanted), rel=1e-7)
    if shapely.geos_version >= (3, 14):  # 3.13 leaves them as two
        with pytest.raises(shapely.GEOSException, match="noded"):
            shapely.coverage_union_all([shapely.Polygon(each) for each in corners])
