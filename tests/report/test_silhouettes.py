"""Visible and truncated shares of groups: rectangles that face the camera, in closed form."""

import json
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import call, enter
from hypothesis import given, settings
from hypothesis import strategies as st

import rastercov as rc
from rastercov.core.camera.pose import Poses
from rastercov.core.coverage import visibility as silhouettes
from rastercov.core.coverage.visibility import group_views
from rastercov.report import annotations as annotations_module
from rastercov.report.annotations import annotations

CAMERA = rc.Camera(width=64, height=48, fx=50, fy=40, cx=30, cy=25)
NEAR = st.floats(0.5, 0.9)
FAR = st.floats(1.0, 3.0)
PLACE = st.floats(-1.5, 1.5)
SIDE = st.floats(0.05, 1.5)


def rectangle(x, y, z, width, height):
    corners = np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)])
    return np.column_stack((corners, np.full(4, z)))


def scene(*rectangles):
    """Rectangles across the axis of a camera at the origin, each a group."""
    vertices = np.concatenate([rectangle(*each) for each in rectangles])
    one = np.array([(0, 2, 1), (0, 3, 2)])
    faces = np.concatenate([one + 4 * row for row in range(len(rectangles))])
    groups = [rc.Group(name) for name in ("near", "far")]
    return rc.Mesh(vertices, faces, groups, np.repeat(np.arange(len(rectangles)), 2))


def image_of(rectangle, factor=1):
    """Edges of the image of a rectangle within the image, or one `factor` times as wide around."""
    x, y, z, width, height = rectangle
    u = CAMERA.fx * np.array([x, x + width]) / z + CAMERA.cx
    v = CAMERA.fy * np.array([y, y + height]) / z + CAMERA.cy
    more = (factor - 1) // 2 * np.array([CAMERA.width, CAMERA.height])
    ends = [
        np.clip(each, -own, size + own)
        for each, own, size in zip((u, v), more, (CAMERA.width, CAMERA.height), strict=True)
    ]
    return np.array(ends)


def area(ends):
    return float(np.prod(np.diff(ends, axis=1)))


def overlap(one, other):
    low, high = np.maximum(one[:, 0], other[:, 0]), np.minimum(one[:, 1], other[:, 1])
    return float(np.prod(np.maximum(high - low, 0.0)))


@settings(max_examples=60, deadline=None)
@given(near=st.tuples(PLACE, PLACE, NEAR, SIDE, SIDE), far=st.tuples(PLACE, PLACE, FAR, SIDE, SIDE))
@pytest.mark.parametrize("method", ["certified", "exact"])
def test_shares_of_rectangles_have_closed_forms(method, near, far):
    result = group_views(scene(near, far), CAMERA, Poses.of(np.eye(4)), rc.Engine(method))
    seen = [area(image_of(near)), area(image_of(far)) - overlap(image_of(near), image_of(far))]
    for column, own in enumerate((near, far)):
        values = (seen[column], area(image_of(own)), area(image_of(own, 3)))
        given = (result.visible, result.inside, result.silhouette)
        for value, figure in zip(values, given, strict=True):
            assert abs(figure[0, column] - value) <= result.bound[0, column] + 1e-9 * (1 + value)
        whole = values[2]
        if whole > 1e-3:
            assert result.visible_share[0, column] == pytest.approx(values[0] / whole, abs=1e-6)
            assert result.truncated_share[0, column] == pytest.approx(
                1 - values[1] / whole, abs=1e-6
            )


def test_a_rig_of_a_pinhole_and_lenses_has_a_row_for_each_image_and_group():
    mesh = rc.shapes.room()
    fisheye = rc.Camera(
        width=640, height=480, fx=200, fy=200, model="opencv_fisheye", distortion=(0.01, 0, 0, 0)
    )
    panorama = rc.Camera(
        width=640, height=320, model="equirectangular", fx=640 / (2 * np.pi), fy=640 / (2 * np.pi)
    )
    cameras = [CAMERA, fisheye, panorama]
    eyes = rc.look_at((0.3, -0.2, 1.4), (2.0, 1.0, 0.5))
    poses = Poses.of(np.repeat(eyes, 3, axis=0), camera=np.arange(3))
    result = group_views(mesh, cameras, poses, rc.Engine())
    assert result.names == ("room", "crates")
    assert (result.visible <= result.inside + 2 * result.bound).all()
    assert (result.inside <= result.silhouette + 2 * result.bound).all()
    assert result.truncated_share[2] == pytest.approx(0, abs=1e-9)  # all directions
    columns = result.columns()
    assert len(columns["pose"]) == len(columns["group"]) == 6
    assert (columns["share_bound"][:4] < 0.01).all()


def test_targets_and_empty_groups_have_no_silhouette():
    mesh = scene((0, 0, 0.8, 0.1, 0.1), (0, 0, 1.5, 0.2, 0.2))
    groups = [rc.Group("near"), rc.Group("far", is_target=True), rc.Group("nothing")]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, mesh.face_group)
    assert group_views(mesh, CAMERA, Poses.of(np.eye(4)), rc.Engine()).names == ("near",)


def test_a_group_behind_the_camera_has_no_row():
    result = group_views(
        scene((0, 0, 0.8, 0.1, 0.1), (0, 0, -1.5, 0.2, 0.2)),
        CAMERA,
        Poses.of(np.eye(4)),
        rc.Engine(),
    )
    assert result.columns()["group"] == ["near"]
    assert np.isnan(result.visible_share[0, 1])


def test_the_command_writes_the_table(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    line = "evaluate room -c khepra -p sphere:3 --pictures 0 --table groups -o out"
    assert call(capsys, line)[0] == 0
    rows = pq.read_table(tmp_path / "out" / "groups.parquet").to_pylist()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["group_views"] == rows
    assert not (tmp_path / "out" / "coverage.parquet").exists()
    coco = json.loads((tmp_path / "out" / "coco.json").read_text())
    info = json.loads((tmp_path / "out" / "scene_gt_info.json").read_text())
    shares = {(row["pose"], row["group"]): row["visible_share"] for row in rows}
    names = {each["id"]: each["name"] for each in coco["categories"]}
    for each in coco["annotations"]:
        assert each["visib_fract"] == shares[each["image_id"], names[each["category_id"]]]
    assert {int(image) for image in info} == {each["id"] for each in coco["images"]} == {0, 1, 2}
    assert all(one["pose"] <= other["pose"] for one, other in pairwise(rows))
    assert {row["group"] for row in rows} <= {"room", "crates"}


def test_annotations_of_rectangles_are_of_their_pixels():
    """Boxes and masks of rectangles across the axis, counted by pixel centres; shares as areas."""
    near, far = (-0.1, -0.2, 0.8, 0.3, 0.25), (-0.4, -0.3, 1.2, 1.5, 0.5)
    mesh, poses = scene(near, far), Poses.of(np.repeat(np.eye(4)[None], 2, axis=0), camera=[1, 0])
    other = rc.Camera(width=640, height=320, model="equirectangular", fx=640 / (2 * np.pi),
                      fy=640 / (2 * np.pi))  # fmt: skip
    result = rc.evaluate(mesh, rc.Rig([CAMERA, other], ["plain", "round"]), poses, fields=())
    views = result.group_views()
    files = annotations(result, views, ["round.png", "plain.png"])
    coco, bop = files["coco.json"], files["scene_gt_info.json"]
    assert [each["file_name"] for each in coco["images"]] == ["round.png", "plain.png"]
    assert [each["name"] for each in coco["categories"]] == ["near", "far"]
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    inside = []
    for each in (near, far):
        (left, right), (top, bottom) = image_of(each)
        inside.append((u > left) & (u < right) & (v > top) & (v < bottom))
    masks = inside[0], inside[1] & ~inside[0]
    own = [each for each in coco["annotations"] if each["image_id"] == 1]
    for column, (mask, annotation) in enumerate(zip(masks, own, strict=True)):
        counts = annotation["segmentation"]["counts"]
        values = np.arange(len(counts)) % 2
        again = np.repeat(values, counts).reshape(CAMERA.width, CAMERA.height).T
        assert (again == mask).all()
        assert annotation["segmentation"]["size"] == [CAMERA.height, CAMERA.width]
        assert annotation["area"] == mask.sum()
        rows, columns = np.nonzero(mask)
        box = [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
        assert annotation["bbox"] == box
        entry = bop["1"][column]
        assert entry["bbox_visib"] == box
        assert entry["visib_fract"] == annotation["visib_fract"] == views.visible_share[1, column]
        assert annotation["truncated_share"] == views.truncated_share[1, column]
        (left, right), (top, bottom) = image_of((near, far)[column], 3)
        x, y = np.floor([left, top])
        assert entry["bbox_obj"] == [x, y, np.ceil(right) - x, np.ceil(bottom) - y]
        assert entry["px_count_all"] == round(views.silhouette[1, column])
        assert entry["px_count_valid"] == round(views.inside[1, column])
        assert entry["px_count_visib"] == round(views.visible[1, column])
    behind = rc.evaluate(mesh, CAMERA, rc.look_at((0, 0, 0), (0, 0, -1)), fields=())
    files = annotations(behind, behind.group_views(), ["back.png"])
    none = {"bbox_obj": [-1] * 4, "bbox_visib": [-1] * 4, "px_count_all": 0, "px_count_valid": 0,
            "px_count_visib": 0, "visib_fract": 0.0}  # fmt: skip
    assert files["scene_gt_info.json"] == {"0": [none, none]}
    assert files["coco.json"]["annotations"] == []


def test_annotations_need_no_image_for_each_group():
    """Memory beside the image grows by the pixels that a group has, of 600 groups in one grid."""
    side = 20
    x, y = np.meshgrid(np.arange(side), np.arange(side + 10))
    corners = np.array([(0.1, 0.1, 0), (0.9, 0.1, 0), (0.9, 0.9, 0), (0.1, 0.9, 0)])
    at = np.column_stack((x.ravel(), y.ravel(), 0 * x.ravel()))
    vertices = (at[:, None] + corners).reshape(-1, 3)
    rows = np.arange(len(at))
    faces = (4 * rows[:, None, None] + [(0, 1, 2), (0, 2, 3)]).reshape(-1, 3)
    groups = [rc.Group(f"tile{row}") for row in rows]
    mesh = rc.Mesh(vertices, faces, groups, np.repeat(rows, 2))
    camera = rc.Camera(width=640, height=480, fx=400, fy=400)
    result = rc.evaluate(mesh, camera, rc.look_at((10, 15, 30), (10, 15, 0)), fields=())
    views = result.group_views()
    tracemalloc.start()
    coco = annotations(result, views, ["a.png"])["coco.json"]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(coco["annotations"]) == len(rows)
    assert peak < 100 * camera.width * camera.height  # a mask for each group needs 600 of these


def test_boxes_of_whole_objects_end_where_their_silhouettes_do():
    """At the border of the wider image, at the near plane, and with parallel rays behind it."""
    floor = rc.Mesh(
        [(-0.5, 1, -5), (0.5, 1, -5), (0.5, 1, 5), (-0.5, 1, 5)], [(0, 1, 2), (0, 2, 3)],
        [rc.Group("floor")],
    )  # fmt: skip
    square = rc.Camera(width=100, height=100, fx=100, fy=100)
    level = rc.Camera.orthographic(100, 100, px_per_m=20)
    skewed = rc.Camera.orthographic(100, 100, px_per_m=20, skew=1e-9, near=2.0)
    up = np.eye(4)
    up[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # looks along y
    for camera, pose, box in (
        (square, np.eye(4), [-25, 70, 150, 130]),  # from z = 2/3, where v is 200, to 5
        (replace(square, near=2.0), np.eye(4), [25, 70, 50, 30]),
        (replace(square, near=6.0), np.eye(4), [-1] * 4),
        (level, up, [40, -50, 20, 200]),
        (level, rc.look_at((0, 2, 0), (0, 3, 0), (0, 0, 1)), [-1] * 4),
        (skewed, up, [-1] * 4),
    ):
        result = rc.evaluate(floor, camera, pose, fields=())
        views = result.group_views()
        (entry,) = annotations(result, views, ["a.png"])["scene_gt_info.json"]["0"]
        assert entry["bbox_obj"] == box
        assert (entry["px_count_all"] > 0) == (box[2] > 0)


def test_counts_are_refused_before_the_work(tmp_path, monkeypatch, capsys):
    enter(tmp_path, monkeypatch)
    line = "evaluate room -c khepra -p sphere:3 --method sampled --table groups -o out"
    code, _, said = call(capsys, line)
    assert code != 0
    assert (
        "expected method certified or exact for silhouettes of groups, as in table groups, got"
        in said
    )
    assert not (tmp_path / "out" / "groups.parquet").exists()


def clipped(polygon, normal, offset):
    """Corners of a polygon on the inner side of a plane, one edge after the other."""
    kept = []
    for one, other in pairwise([*polygon, *polygon[:1]]):
        a, b = one @ normal + offset, other @ normal + offset
        kept += [one] if a >= 0 else []
        kept += [one + a / (a - b) * (other - one)] if (a < 0) != (b < 0) else []
    return kept


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_boxes_of_many_groups_are_those_of_their_clipped_triangles(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 4, 6)  # ahead, behind, across the near plane and the border
    groups = [rng.normal(scale=rng.choice((0.3, 3.0)), size=(n, 3, 3)) for n in sizes]
    boxes = annotations_module._boxes(groups, CAMERA, np.eye(4))
    sides = [(50, 0, 94), (-50, 0, 98), (0, 40, 73), (0, -40, 71), (0, 0, 1)]
    for own, box in zip(groups, boxes, strict=True):
        far = np.abs(own).reshape(-1, 3).max(axis=0)
        near = max(CAMERA.near, 1e-6 * np.linalg.norm(far))
        uv = []
        for triangle in own:
            polygon = [*triangle]
            for side in sides:
                polygon = clipped(polygon, np.array(side), -near if side == (0, 0, 1) else 0.0)
            uv += [corner[:2] / corner[2] * (50, 40) + (30, 25) for corner in polygon]
        low, high = (np.array(box[:2]), np.array(box[:2]) + box[2:]) if box[2] > 0 else ([0], [0])
        if not uv:
            assert box == [-1, -1, -1, -1]
        elif box[2] > 0:
            assert (np.abs(low - np.min(uv, axis=0) + 0.5) <= 0.5 + 1e-6).all()
            assert (np.abs(high - np.max(uv, axis=0) - 0.5) <= 0.5 + 1e-6).all()


def test_a_group_takes_one_observer_and_images_are_widened_once(monkeypatch):
    mesh = scene((0, 0, 1.0, 0.05, 0.05), (0.1, 0, 1.0, 0.05, 0.05))
    groups = [rc.Group(f"g{row}") for row in range(mesh.n_faces)]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, groups, np.arange(mesh.n_faces))
    opened = Mock(wraps=silhouettes.open_observer)
    widened = Mock(wraps=annotations_module.camera_around)
    monkeypatch.setattr(silhouettes, "open_observer", opened)
    monkeypatch.setattr(annotations_module, "camera_around", widened)
    result = rc.evaluate(mesh, CAMERA, np.stack([np.eye(4)] * 3))
    annotations(result, result.group_views(), ["a.png", "b.png", "c.png"])
    assert (opened.call_count, widened.call_count) == (1 + len(groups), 3)
