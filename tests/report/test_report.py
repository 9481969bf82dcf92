import json
import re
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import trimesh
from PIL import Image
from rich.console import Console

from rastercov.base import output
from rastercov.base.errors import ConfigError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at
from rastercov.core.coverage.coverage import FIGURES, Coverage
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.core.raster.contract import BoundKind, RasterizerInfo, VisibilityBuffer
from rastercov.reference.coverage import rows_of
from rastercov.reference.models.report import coverage_picture, coverage_pixels
from rastercov.report import images as pictures
from rastercov.report import parquet as coverage_table
from rastercov.report import tables, theme
from rastercov.report.coverage_files import write_coloured_mesh
from rastercov.report.panorama import draw_scene

INFO = RasterizerInfo("gl", "pipeline", "renderer", "driver", "device", "float32", "hash")
CAMERA = Camera(width=480, height=360, fx=400, fy=400, cx=240, cy=180)

# Three squares side by side in the plane z = 0, two faces each, seen from z = 5:
#
#   1 +---+---+---+     groups: left and middle are to be seen, right only hides
#     |1 /|3 /|5 /|
#     | / | / | / |
#   0 |/ 0|/ 2|/ 4|
#     0   1   2   3
STRIP = Mesh(
    vertices=[(x, y, 0) for x in range(4) for y in range(2)],
    faces=[f for i in (0, 2, 4) for f in ((i, i + 2, i + 3), (i, i + 3, i + 1))],
    groups=[Group("left"), Group("middle [bold]"), Group("right", is_occluder=True)],
    face_group=[0, 0, 1, 1, 2, 2],
)
FROM_ABOVE = look_at((1.5, 0.5, 5), (1.5, 0.5, 0), (0, 1, 0))[0]
FROM_BELOW = look_at((1.5, 0.5, -5), (1.5, 0.5, 0), (0, 1, 0))[0]


def strip_buffer(order=(0, 2, 4)):
    """60 x 60 pixels for each square, background around; row 0 on top."""
    face = np.full((360, 480), -1, np.int32)
    for column, index in enumerate(order):
        square = face[100:160, 100 + 60 * column : 160 + 60 * column]
        rows, columns = np.indices(square.shape)
        square[:] = np.where(rows + columns < 60, index + 1, index)
    return VisibilityBuffer(face, np.where(face < 0, np.inf, 5).astype(np.float32))


def made_up(mesh=STRIP, poses=3, seed=0, pose_ids=None, task=None, **figures):
    """Coverage with random figures, all in view unless said otherwise."""
    rng = np.random.default_rng(seed)
    shape = (poses, mesh.n_faces)
    arrays = {
        name: rng.random(shape) < 0.5 if kind is np.bool_ else rng.random(shape)
        for name, kind in FIGURES.items()
    }
    arrays["visibility_kind"] = rng.integers(0, len(BoundKind), shape).astype(np.uint8)
    arrays["reason"] = rng.integers(0, len(Reason), shape).astype(np.uint8)
    ids = np.arange(poses) if pose_ids is None else np.asarray(pose_ids)
    clipped = np.zeros(poses, bool)
    return Coverage(mesh, CAMERA, task or Task(), INFO, ids, clipped, **{**arrays, **figures})


def stored(folder, *batches, choice="all"):
    """A table of some batches, as it is read back."""
    with coverage_table.CoverageTable(folder / "pairs.parquet", STRIP) as table:
        for batch in batches:
            table.add(rows_of(batch, choice))
    read = pq.read_table(folder / "pairs.parquet")
    assert table.n_rows == len(read)
    return read


# --- the table ------------------------------------------------------------------------------


def test_table_types(tmp_path):
    schema = stored(tmp_path).schema
    kinds = dict.fromkeys(FIGURES, pa.float32())
    kinds |= {name: pa.bool_() for name, kind in FIGURES.items() if kind is np.bool_}
    kinds |= {"pose": pa.int32(), "face": pa.int32()}
    words = pa.dictionary(pa.int32(), pa.string())
    kinds |= dict.fromkeys(["group", "reason", "visibility_kind"], words)
    assert schema.names == ["pose", "face", "group", *FIGURES]
    assert dict(zip(schema.names, schema.types, strict=True)) == kinds
    assert schema.field("incidence").metadata == {b"unit": b"rad"}


def test_stored_bound_covers_the_rounding_of_the_stored_visibility(tmp_path):
    exact = np.array([[0.1, 1 / 3, 0.0, 1.0, 0.7, 1e-9]])
    bound = np.array([[0.0, 1e-9, 0.0, 0.0, 0.1, 1e-9]])
    beyond = np.full((1, 6), 1e39)
    coverage = made_up(poses=1, visibility=exact, visibility_bound=bound, projected_area=beyond)
    read = stored(tmp_path, coverage)
    assert np.isinf(read["projected_area"].to_numpy()).all()
    value, written = (read[n].to_numpy().astype(float) for n in ("visibility", "visibility_bound"))
    assert (np.abs(value - exact[0]) + bound[0] <= written).all()
    assert written[2] == written[3] == 0.0  # what is proved stays proved


def test_table_writes_as_it_goes_and_holds_no_more_than_a_row_group(tmp_path, monkeypatch):
    monkeypatch.setattr(coverage_table, "ROWS_A_GROUP", 1000)
    batch, path, sizes = made_up(poses=100), tmp_path / "pairs.parquet", []
    with coverage_table.CoverageTable(path, STRIP) as table:
        for _ in range(50):
            table.add(rows_of(batch, "all"))
            sizes.append(pa.total_allocated_bytes())
            assert len(table._pending) < 1000 + batch.coverage.size  # while a batch is added
        assert max(sizes[5:]) < sizes[4] + 100_000
        assert next(tmp_path.iterdir()).stat().st_size > 0
    file = pq.ParquetFile(path)
    groups = [file.metadata.row_group(g).num_rows for g in range(file.num_row_groups)]
    assert groups == [1000] * 30
    assert file.metadata.row_group(0).column(0).compression == "SNAPPY"
    expected = np.tile(batch.coverage.astype(np.float32).ravel(), 50)
    np.testing.assert_array_equal(file.read()["coverage"].to_numpy(), expected)


def test_a_disk_that_is_full_while_rows_are_added_ends_the_run_and_names_the_file(
    tmp_path, monkeypatch
):
    full = Mock(side_effect=OSError(28, "No space left on device"))
    monkeypatch.setattr(coverage_table, "ROWS_A_GROUP", 10)
    monkeypatch.setattr(pq.ParquetWriter, "write_table", full)
    path, rows = tmp_path / "pairs.parquet", rows_of(made_up(), "all")

    def add_for_ever():
        with coverage_table.CoverageTable(path, STRIP) as table:
            while True:
                table.add(rows)

    with pytest.raises(OSError, match=str(path)):
        add_for_ever()
    assert list(tmp_path.iterdir()) == []


# --- other files ----------------------------------------------------------------------------


def test_json_has_plain_types_and_null_for_what_is_not_finite(tmp_path):
    @dataclass
    class Thing:
        size: float

    data = {
        "numbers": [np.float64(0.1), np.int64(3), np.bool_(True), np.array([[1.0, np.nan]])],
        "not finite": [-np.inf, np.float32("nan"), Thing(np.inf)], 3: (1, None),
        "words": [Path("a"), Reason.COVERED, "größer", "part\udcff.stl"],
    }  # fmt: skip
    output.write_json(tmp_path / "a.json", data)
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert "größer" in text
    assert json.loads(text, parse_constant=pytest.fail) == {
        "numbers": [0.1, 3, True, [[1.0, None]]], "not finite": [None, None, {"size": None}],
        "3": [1, None], "words": ["a", 8, "größer", "part\udcff.stl"],
    }  # fmt: skip


def test_what_cannot_be_written_changes_nothing(tmp_path):
    output.write_json(tmp_path / "a.json", 1)
    for name, data, error in (
        ("a.json", object(), TypeError), ("no/a.json", 1, ConfigError), ("", 1, ConfigError)
    ):  # fmt: skip
        with pytest.raises(error):
            output.write_json(tmp_path / name, data)
    with pytest.raises(ConfigError, match="expected values of shape"):
        write_coloured_mesh(tmp_path / "a.glb", STRIP, np.zeros(5))
    assert [path.read_text() for path in tmp_path.iterdir()] == ["1\n"]


VALUES = np.array([0.0, 0.25, 0.5, 1.0, 0.9, 0.0])
EXPECTED = np.array(
    [
        *(theme.ZERO_COVERAGE, (57, 82, 140), (32, 144, 140), (253, 231, 37)),
        *(theme.OCCLUDER_3D, theme.OCCLUDER_3D),
    ]
)


def test_glb_has_each_face_in_the_colour_of_its_coverage_and_a_node_a_group(tmp_path):
    write_coloured_mesh(tmp_path / "a.glb", STRIP, VALUES)
    scene = trimesh.load_scene(tmp_path / "a.glb", process=False)
    assert set(scene.graph.nodes_geometry) == {"left", "middle [bold]", "right"}
    for name, faces in (("left", [0, 1]), ("middle [bold]", [2, 3]), ("right", [4, 5])):
        part = scene.geometry[name]
        texture = np.asarray(part.visual.material.baseColorTexture.convert("RGB")).astype(int)
        texel = part.visual.uv[part.faces][..., 0] * texture.shape[1]
        assert np.abs(texel % 1 - 0.5).max() < 1e-3  # the middle of a texel, whatever the filter
        assert (np.ptp(texel, axis=1) == 0).all()
        assert np.abs(texture[0, texel[:, 0].astype(int)] - EXPECTED[faces]).max() <= 2


def test_glb_stands_upright_and_keeps_the_shape_of_a_part_far_away(tmp_path):
    offset = (1e7, -2e7, 3e7)
    part = shapes.teapot(3)
    far = Mesh(part.vertices + offset, part.faces, groups=[Group("world")])
    write_coloured_mesh(tmp_path / "a.glb", far, np.ones(far.n_faces))
    read = Mesh.load(tmp_path / "a.glb")
    x, y, z = far.vertices[far.faces].reshape(-1, 3).T
    corners = read.vertices[read.faces].reshape(-1, 3)
    np.testing.assert_allclose(corners, np.stack((x, z, -y), axis=1), rtol=0, atol=2e-8)
    assert read.groups[0].name == "world"


def test_scale_of_the_coloured_mesh_grows_lighter_evenly():
    linear = (theme.coverage_colours()[2:] / 255.0) ** 2.2
    luminance = linear @ (0.2126, 0.7152, 0.0722)
    lightness = np.cbrt(luminance)
    steps = np.diff(lightness[::23])
    assert (steps > 0).all()
    assert steps.max() < 2 * steps.min()


def strip_scene():
    return draw_scene(STRIP, CAMERA, FROM_ABOVE, strip_buffer())


# --- pictures -------------------------------------------------------------------------------


def inside(pixels, square, upper):
    """A pixel well inside a face of `strip_buffer`."""
    return pixels[115 if upper else 145, 100 + 60 * square + (15 if upper else 45)].astype(int)


def test_brighter_is_better_covered():
    values = [0.0, 0.15, 0.5, 1.0, 1.0, 1.0]
    pixels = coverage_pixels(strip_scene(), values)
    greys = [inside(pixels, face // 2, face % 2) for face in range(4)]
    assert all(np.ptp(grey) == 0 for grey in greys)
    assert (np.diff([grey[0] for grey in greys]) > 0).all()
    assert greys[0][0] < 60
    assert greys[3][0] > 230


@pytest.mark.parametrize("values", [np.linspace(0, 0.85, 20), np.array([0.3, 0.45])])
def test_shading_never_outweighs_a_difference_of_coverage(values):
    edge_on = theme.OF_CAMERA.least_light * pictures.greys(values + 0.15)
    assert (edge_on >= pictures.greys(values)).all()


def test_background_occluders_and_backs_are_coloured_and_nothing_else_is():
    buffer, both_sides = strip_buffer(), STRIP.with_groups(two_sided="all")
    above, behind, turned = (
        coverage_pixels(draw_scene(mesh, CAMERA, pose, buffer), np.ones(6)).astype(int)
        for mesh, pose in ((STRIP, FROM_ABOVE), (STRIP, FROM_BELOW), (both_sides, FROM_BELOW))
    )
    assert (above[buffer.face < 0] == theme.OF_CAMERA.background).all()
    is_grey = np.ptp(above, axis=2) == 0
    np.testing.assert_array_equal(is_grey, np.isin(buffer.face, [0, 1, 2, 3]))
    assert (np.ptp(behind, axis=2) > 0).all()
    occluder, back = inside(behind, 2, upper=True), inside(behind, 0, upper=True)
    assert np.abs(occluder - back).max() > 40
    np.testing.assert_array_equal(turned, above)


def test_picture_is_as_wide_as_the_image_and_shows_it_one_to_one():
    scene, values = strip_scene(), np.linspace(0, 1, 6)
    bare, pixels = np.asarray(coverage_picture(scene, values)), coverage_pixels(scene, values)
    titled = np.asarray(pictures.add_frame(pixels, "pose 3", []))
    top = len(titled) - len(pixels)
    np.testing.assert_array_equal(bare[:360], pixels)
    np.testing.assert_array_equal(titled[top : top + 360], pixels)
    assert titled[:top].min() < 100 < titled[:top].max() == 255


def test_index_colours_of_neighbours_differ_and_none_is_dark_but_the_background():
    face = np.append(np.arange(30_000), -1).astype(np.int32)[None]
    buffer = VisibilityBuffer(face, np.ones(face.shape, np.float32))
    colours = np.asarray(pictures.face_index_picture(buffer)).astype(int)[0]
    assert (colours[-1] == 0).all()
    assert colours[:-1].min() >= 40
    for apart in range(1, 100):
        assert np.abs(colours[apart:] - colours[:-apart]).max(axis=1).min() >= 28, apart


def test_near_is_bright_in_the_depth_picture():
    depth = np.tile(np.linspace(2, 9, 480, dtype=np.float32), (360, 1))
    depth[:, :40] = np.inf
    buffer = VisibilityBuffer(np.where(np.isinf(depth), -1, 0).astype(np.int32), depth)
    pixels = np.asarray(pictures.depth_picture(buffer))[:360].astype(int)
    assert (pixels[:, :40] == theme.OF_CAMERA.background).all()
    grey = pixels[:, 40:, :1]
    assert (pixels[:, 40:] == grey).all()
    assert (np.diff(grey, axis=1) <= 0).all()
    assert grey[0, 0] > 230 > 60 > grey[0, -1]


@pytest.mark.slow
def test_contact_sheet_shows_each_picture_at_its_place():
    colours = [(200, 0, 0), (0, 200, 0), (0, 0, 200), (90, 90, 0), (0, 90, 90)]
    images = [Image.new("RGB", (640, 480), colour) for colour in colours]
    pixels = np.asarray(pictures.contact_sheet(images, ["x" * 500] * 5, thumbnail_width=160))
    height, width, _ = pixels.shape
    assert width == 3 * (160 + 4) + 4
    assert 2 * 120 < height < 2 * 160
    rows, columns = np.divmod(np.arange(5), 3)
    result = pixels[64 + rows * (height - 4) // 2, 84 + 164 * columns]
    np.testing.assert_array_equal(result, colours)


# --- tables to print ------------------------------------------------------------------------


def printed(table):
    console = Console(file=StringIO(), width=80, color_system=None)
    console.print(table)
    return console.file.getvalue()


def test_summary_names_groups_percentages_and_reasons_in_80_columns():
    network = Network(STRIP, Task(views=2))
    reason = np.full((2, 6), Reason.COVERED, np.uint8)
    reason[:, 0] = Reason.OCCLUDED
    network.add(made_up(poses=2, reason=reason, task=network.task))
    summary = network.summary()
    long = [
        summary["groups"][-2] | {"name": f"a group with a very long name {i}"} for i in range(48)
    ]
    many = printed(tables.summary_table(summary | {"groups": summary["groups"] + long}))
    assert "and 38 more, see --json" in many
    text = printed(tables.summary_table(summary))
    assert max(map(len, (many + text).splitlines())) <= 80
    assert re.search(r"left\W+\d+ m²\W+50\.0\W+50\.0\W+occluded", text)
    for words in ("2 cameras together, 2 per face", "middle [bold]", "occluder", "occluded"):
        assert words in text  # a name is not markup


def test_run_table_names_what_ran_and_what_came_out():
    empty = Network(STRIP, Task()).summary()
    assert "0 cameras" in printed(tables.summary_table(empty))
    summary = empty | {
        "poses": 1234, "poses_per_second": 70.04, "size_m": [85.0, 62.0, 20.0],
        "run": {"measured_by": {"backend": "gl", "renderer": "[bold]Mesa[/]"}},
    }  # fmt: skip
    text = printed(tables.run_table(summary))
    for wanted in ("1,234", "70.0", "85 x 62 x 20 m", "[bold]Mesa[/]"):
        assert wanted in text
