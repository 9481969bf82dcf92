import json
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import trimesh
from PIL import Image
from rich.console import Console

from rastercov.base import output
from rastercov.base.errors import ConfigError
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import look_at
from rastercov.coverage.coverage import FIGURES, Coverage
from rastercov.coverage.network import Network
from rastercov.coverage.task import Reason, Task
from rastercov.mesh import Group, Mesh, shapes
from rastercov.raster.contract import RasterizerInfo, VisibilityBuffer
from rastercov.raster.observation import BoundKind
from rastercov.reference.coverage import rows_of
from rastercov.report import coverage_files as coverage_table
from rastercov.report import images as pictures
from rastercov.report import tables, theme
from rastercov.report.coverage_files import write_coloured_mesh

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


@pytest.mark.parametrize("choice", ["covered", "seen", "all"])
def test_table_holds_every_figure_of_the_chosen_pairs_and_no_others(tmp_path, choice):
    coverage = made_up(pose_ids=[4, 7, 9])
    coverage.in_view_fraction[coverage.in_view_fraction < 0.5] = 0.0
    is_seen = (coverage.in_view_fraction > 0) & (coverage.reason > Reason.BACK_FACING)
    chosen = {"covered": coverage.reason == Reason.COVERED, "seen": is_seen}
    pose, face = np.nonzero(chosen.get(choice, np.ones_like(is_seen)))
    read = stored(tmp_path, coverage, choice=choice)
    assert 0 < len(read) == len(pose)
    assert (len(pose) == coverage.coverage.size) == (choice == "all")
    assert read["pose"].to_pylist() == coverage.pose_ids[pose].tolist()
    assert read["face"].to_pylist() == face.tolist()
    names = [STRIP.groups[index].name for index in STRIP.face_group[face]]
    assert read["group"].to_pylist() == names
    reasons = [Reason(r).name.lower() for r in coverage.reason[pose, face]]
    assert read["reason"].to_pylist() == reasons
    kinds = [BoundKind(k).name.lower() for k in coverage.visibility_kind[pose, face]]
    assert read["visibility_kind"].to_pylist() == kinds
    for name in set(FIGURES) - {"reason", "visibility_kind", "visibility_bound"}:
        expected = getattr(coverage, name)[pose, face]
        if expected.dtype != bool:
            expected = expected.astype(np.float32)
        np.testing.assert_array_equal(read[name].to_numpy(), expected)


def test_table_types(tmp_path):
    schema = stored(tmp_path).schema
    assert schema.names == ["pose", "face", "group", *FIGURES]
    category = pa.dictionary(pa.int32(), pa.string())
    expected = {"pose": pa.int32(), "face": pa.int32(), "group": category, "reason": category}
    expected["visibility_kind"] = category
    for name, kind in FIGURES.items():
        expected.setdefault(name, pa.bool_() if kind is np.bool_ else pa.float32())
    assert {name: schema.field(name).type for name in schema.names} == expected
    assert schema.field("incidence").metadata == {b"unit": b"rad"}


def test_table_carries_the_header(tmp_path):
    header = {"mesh": [{"name": "Flügel", "sha256": "ab"}], "far": np.inf, "n": np.int64(3)}
    with coverage_table.CoverageTable(tmp_path / "pairs.parquet", STRIP, header) as table:
        table.add(rows_of(made_up(poses=0), "all"))  # a run without poses is a valid file
    stored = json.loads(pq.read_schema(tmp_path / "pairs.parquet").metadata[b"rastercov"])
    assert stored == {"mesh": [{"name": "Flügel", "sha256": "ab"}], "far": None, "n": 3}


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
    batch = made_up(poses=100)
    rows, held = rows_of(batch, "all"), []
    with coverage_table.CoverageTable(tmp_path / "pairs.parquet", STRIP) as table:
        for _ in range(50):
            table.add(rows)
            held.append((len(table._pending), pa.total_allocated_bytes(), len(table._waiting)))
        n_rows, sizes, waiting = zip(*held, strict=True)
        assert max(n_rows) < 1000
        assert max(sizes[5:]) < sizes[4] + 100_000
        assert max(waiting) <= coverage_table.BATCHES_WAITING + 1
        (part,) = tmp_path.iterdir()
        assert part.stat().st_size > 0
    file = pq.ParquetFile(tmp_path / "pairs.parquet")
    groups = [file.metadata.row_group(g).num_rows for g in range(file.num_row_groups)]
    assert groups == [1000] * 30
    assert file.metadata.row_group(0).column(0).compression == "SNAPPY"
    np.testing.assert_array_equal(
        file.read()["coverage"].to_numpy(),
        np.tile(batch.coverage.astype(np.float32).ravel(), 50),
    )


@pytest.mark.parametrize("before", [None, b"earlier"])
def test_an_error_inside_the_block_changes_nothing_on_disk(tmp_path, before):
    path = tmp_path / "pairs.parquet"
    if before:
        path.write_bytes(before)

    def run():
        with coverage_table.CoverageTable(path, STRIP) as table:
            table.add(rows_of(made_up(), "all"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([before] if before else [])


def test_a_disk_that_is_full_while_rows_are_added_ends_the_run_and_names_the_file(
    tmp_path, monkeypatch
):
    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(coverage_table, "ROWS_A_GROUP", 10)
    monkeypatch.setattr(pq.ParquetWriter, "write_table", fail)
    path, rows = tmp_path / "pairs.parquet", rows_of(made_up(), "all")
    added = 0

    def add_for_ever():
        nonlocal added
        with coverage_table.CoverageTable(path, STRIP) as table:
            while True:  # neither waits for the thread nor goes on
                table.add(rows)
                added += 1

    with pytest.raises(OSError, match=str(path)):
        add_for_ever()
    assert added > 0
    assert list(tmp_path.iterdir()) == []


def test_a_system_without_threads_writes_the_same_table(tmp_path, monkeypatch):
    def refuse(_):
        raise RuntimeError("can't start new thread")

    batches = [made_up(seed=seed) for seed in range(5)]
    expected = stored(tmp_path, *batches)
    monkeypatch.setattr("threading.Thread.start", refuse)
    assert stored(tmp_path, *batches).equals(expected)


# --- other files ----------------------------------------------------------------------------


def test_json_has_plain_types_and_null_for_what_is_not_finite(tmp_path):
    @dataclass
    class Thing:
        size: float

    data = {
        "float": np.float64(0.1), "inf": -np.inf, "nan": np.float32("nan"), "int": np.int64(3),
        "flag": np.bool_(True), "array": np.array([[1.0, np.nan]]), 3: (1, None),
        "path": Path("a"), "thing": Thing(np.inf), "reason": Reason.COVERED, "word": "größer",
        "name": "part\udcff.stl",
    }  # fmt: skip
    output.write_json(tmp_path / "a.json", data)
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert "größer" in text
    assert json.loads(text, parse_constant=pytest.fail) == {
        "float": 0.1, "inf": None, "nan": None, "int": 3,
        "flag": True, "array": [[1.0, None]], "3": [1, None],
        "path": "a", "thing": {"size": None}, "reason": 8, "word": "größer",
        "name": "part\udcff.stl",
    }  # fmt: skip


def test_what_cannot_be_written_changes_nothing(tmp_path):
    path = tmp_path / "a.json"
    output.write_json(path, 1)
    with pytest.raises(TypeError):
        output.write_json(path, object())
    with pytest.raises(ConfigError, match="folder does not exist"):
        output.write_json(tmp_path / "no" / "a.json", 1)
    with pytest.raises(ConfigError, match="is a folder"):
        output.write_json(tmp_path, 1)
    with pytest.raises(ConfigError, match="values must have shape"):
        write_coloured_mesh(tmp_path / "a.glb", STRIP, np.zeros(5))
    assert (path.read_text(), [p.name for p in tmp_path.iterdir()]) == ("1\n", ["a.json"])


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


# --- pictures -------------------------------------------------------------------------------


def inside(pixels, square, upper):
    """A pixel well inside a face of `strip_buffer`."""
    return pixels[115 if upper else 145, 100 + 60 * square + (15 if upper else 45)].astype(int)


def test_brighter_is_better_covered():
    values = [0.0, 0.15, 0.5, 1.0, 1.0, 1.0]
    pixels = pictures.coverage_pixels(strip_buffer(), values, STRIP, FROM_ABOVE)
    greys = [inside(pixels, face // 2, face % 2) for face in range(4)]
    assert all(np.ptp(grey) == 0 for grey in greys)
    assert (np.diff([grey[0] for grey in greys]) > 0).all()
    assert greys[0][0] < 60
    assert greys[3][0] > 230


@pytest.mark.parametrize("values", [np.linspace(0, 1, 20), np.array([0.3, 0.45])])
def test_shading_never_outweighs_a_difference_of_coverage(values):
    better, worse = pictures._grey(values[1:], 0.0), pictures._grey(values[:-1], 1.0)
    apart = np.diff(values) > theme.HEADLIGHT / theme.GREY_SPAN
    assert (better[apart] >= worse[apart]).all()
    assert theme.HEADLIGHT <= 0.15 * theme.GREY_SPAN


def test_background_occluders_and_backs_are_coloured_and_nothing_else_is():
    buffer = strip_buffer()
    seen = pictures.coverage_pixels(buffer, np.ones(6), STRIP, FROM_ABOVE)
    background = buffer.face < 0
    assert (seen[background] == theme.BACKGROUND).all()
    is_grey = np.ptp(seen.astype(int), axis=2) == 0
    is_task = np.isin(buffer.face, [0, 1, 2, 3])
    np.testing.assert_array_equal(is_grey, is_task)

    behind = pictures.coverage_pixels(buffer, np.ones(6), STRIP, FROM_BELOW)
    assert (np.ptp(behind.astype(int), axis=2) > 0).all()
    occluder, back = inside(behind, 2, upper=True), inside(behind, 0, upper=True)
    assert np.abs(occluder - back).max() > 40
    both_sides = STRIP.with_groups(two_sided="all")
    turned = pictures.coverage_pixels(buffer, np.ones(6), both_sides, FROM_BELOW)
    np.testing.assert_array_equal(turned, seen)


def test_lines_part_large_faces_and_not_small_ones():
    pixels = pictures.coverage_pixels(strip_buffer(), np.ones(6), STRIP, FROM_ABOVE)
    assert len(np.unique(pixels[105, 100:159, 0])) > 1
    face = np.full((360, 480), -1, np.int32)
    face[:200, :200] = np.random.default_rng(0).integers(0, 2000, (200, 200))
    many = Mesh(STRIP.vertices, np.tile(STRIP.faces[:2], (1000, 1)))
    buffer = VisibilityBuffer(face, np.ones(face.shape, np.float32))
    small = pictures.coverage_pixels(buffer, np.ones(2000), many, FROM_ABOVE)
    plain = np.unique(small[:200, :200])
    assert plain.min() > 200


def test_picture_is_as_wide_as_the_image_and_shows_it_one_to_one():
    buffer, values = strip_buffer(), np.linspace(0, 1, 6)
    picture = pictures.coverage_picture(buffer, values, STRIP, CAMERA, FROM_ABOVE, "pose 3")
    bare = pictures.coverage_picture(buffer, values, STRIP, CAMERA, FROM_ABOVE)
    assert picture.width == bare.width == 480
    assert picture.height > bare.height > 360
    pixels = pictures.coverage_pixels(buffer, values, STRIP, FROM_ABOVE)
    np.testing.assert_array_equal(np.asarray(bare)[:360], pixels)
    top = picture.height - bare.height
    np.testing.assert_array_equal(np.asarray(picture)[top : top + 360], pixels)
    title = np.asarray(picture)[:top]
    assert title.min() < 100 < title.max() == 255


def test_index_picture_has_one_colour_a_face_on_black():
    buffer = strip_buffer()
    pixels = np.asarray(pictures.face_index_picture(buffer))
    assert (pixels[buffer.face < 0] == 0).all()
    is_face = buffer.face >= 0
    np.testing.assert_array_equal(pixels[is_face], theme.index_colours(buffer.face[is_face]))


def test_index_colours_of_neighbours_differ_and_none_is_dark():
    colours = theme.index_colours(np.arange(30_000)).astype(int)
    assert colours.min() >= 40
    for apart in range(1, 100):
        difference = np.abs(colours[apart:] - colours[:-apart]).max(axis=1)
        assert difference.min() >= 28, apart


def test_near_is_bright_in_the_depth_picture():
    depth = np.tile(np.linspace(2, 9, 480, dtype=np.float32), (360, 1))
    depth[:, :40] = np.inf
    buffer = VisibilityBuffer(np.where(np.isinf(depth), -1, 0).astype(np.int32), depth)
    pixels = np.asarray(pictures.depth_picture(buffer))[:360]
    assert (pixels[:, :40] == theme.BACKGROUND).all()
    grey = pixels[:, 40:, 0].astype(int)
    assert (np.ptp(pixels[:, 40:].astype(int), axis=2) == 0).all()
    assert (np.diff(grey, axis=1) <= 0).all()
    assert grey[0, 0] > 230
    assert grey[0, -1] < 60


@pytest.mark.slow
def test_contact_sheet_shows_each_picture_at_its_place():
    colours = [(200, 0, 0), (0, 200, 0), (0, 0, 200), (90, 90, 0), (0, 90, 90)]
    images = [Image.new("RGB", (640, 480), colour) for colour in colours]
    sheet = pictures.contact_sheet(images, ["x" * 500] * 5, thumbnail_width=160)
    assert sheet.width == 3 * (160 + 4) + 4
    assert 2 * 120 < sheet.height < 2 * 160
    pixels = np.asarray(sheet)
    for index, colour in enumerate(colours):
        row, column = divmod(index, 3)
        y = 4 + row * (sheet.height - 4) // 2 + 60
        assert tuple(pixels[y, 4 + column * 164 + 80]) == colour


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
    long = summary["groups"][-2] | {"name": "a group with a very long name indeed, number 1"}
    many = printed(tables.summary_table(summary | {"groups": summary["groups"] + [long] * 48}))
    assert "30 more" in many
    assert max(map(len, many.splitlines())) <= 80
    text = printed(tables.summary_table(summary))
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    (left,) = [line for line in lines if "left" in line]
    assert [cell.strip() for cell in left.strip("│").split("│")] == [
        "left", "2", "50.0", "50.0", "1", "0",
    ]  # fmt: skip
    assert "2 cameras, 2 a face" in text
    assert "middle [bold]" in text  # a name is not markup
    assert "occluder" in text
    assert "75.0" in text
    assert "occluded" in text


def test_run_table_names_what_ran_and_what_came_out():
    empty = Network(STRIP, Task()).summary()
    assert "0 cameras" in printed(tables.summary_table(empty))
    summary = empty | {
        "poses": 1234,
        "poses_per_second": 70.04,
        "size_m": [85.0, 62.0, 20.0],
        "run": {"measured_by": {"renderer": "[bold]Mesa[/]"}},
    }
    text = printed(tables.run_table(summary))
    for wanted in ("1,234", "70.0", "85 x 62 x 20 m", "[bold]Mesa[/]", "0.0 % of the faces"):
        assert wanted in text
