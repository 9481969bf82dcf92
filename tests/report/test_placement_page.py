"""The page of a placement: nothing from outside, every figure told, pictures that show it."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from pages import read_alone
from scenes import joined

import rastercov as rc
from rastercov.base.errors import ConfigError
from rastercov.base.format import percent
from rastercov.coverage.coverage import evaluate_batches
from rastercov.coverage.network import Network
from rastercov.coverage.reasons import REASONS
from rastercov.coverage.task import Task
from rastercov.mesh import Group, Mesh, shapes
from rastercov.placement.candidates.cavities import openings
from rastercov.placement.candidates.clearance import KeepOutBox, filter_candidates
from rastercov.placement.candidates.mounting import on_sphere
from rastercov.placement.candidates.pool import Candidates, Framing, per_segment
from rastercov.placement.candidates.segments import segment
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.tolerance import InstallationError, tolerance
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.problem import BestCoverage, FewestCameras, problem_of
from rastercov.placement.uncovered import what_is_left
from rastercov.report import overview, plots, theme
from rastercov.report import placement as page_module
from rastercov.report import placement_pictures as pictures
from rastercov.report.overview import camera_colours, network_picture
from rastercov.report.panorama import DIRECTIONS, best_directions, look, paint, place_in_image
from rastercov.report.placement import page, write_page
from rastercov.report.placement_pictures import PlanReport
from rastercov.report.theme import DARK, LIGHT

CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300, cx=160, cy=120)
TASK = Task(min_pixels=20)
FRAMING = Framing(stand_off=(3.0, 9.0))


def part():
    """A table that only hides, with a ball over it; the ball's name needs escaping."""
    ball, table = shapes.sphere(2, 0.5), shapes.box((2, 2, 0.2), 1, (0, 0, -0.8))
    whole = joined(ball, table)
    groups = (Group("ball <b> & co"), Group("table", is_occluder=True))
    return Mesh(whole.vertices, whole.faces, groups, np.repeat([0, 1], [ball.n_faces, 12]))


def network_of(mesh, poses, task=TASK):
    network = Network(mesh, task)
    with rc.open_observer(mesh, CAMERA) as observer:
        for batch in evaluate_batches(observer, poses, task):
            network.add(batch)
    return network


@pytest.fixture(scope="module")
def report():
    """Everything that a page may tell."""
    mesh = part()
    segments = segment(mesh, 25, 40)
    made = per_segment(mesh, CAMERA, FRAMING, segmentation=segments)
    made += on_sphere(mesh, CAMERA, FRAMING, count=12)
    candidates, dropped = filter_candidates(
        made, mesh, 0.1, [KeepOutBox((-9, -9, -9), (9, 9, -1), "floor")]
    )
    matrix = build_matrix((mesh, CAMERA), candidates.poses, TASK)
    goal = BestCoverage(cameras=2)
    selection = select_greedy(problem_of(matrix, mesh, goal))
    poses = candidates.poses[selection.chosen]
    left = what_is_left((mesh, CAMERA), poses, TASK, candidates=candidates.poses)
    with rc.open_observer(mesh, CAMERA) as observer:
        shaken = tolerance(
            Objective.of(observer, TASK), poses, InstallationError(position_mm=50), draws=4
        )
    return PlanReport(
        mesh=mesh, camera=CAMERA, network=network_of(mesh, poses), poses=poses,
        selection=selection, goal=goal, candidates=candidates, dropped=dropped,
        segmentation=segments, leftover=left, tolerance=shaken,
        openings=openings(mesh, CAMERA, FRAMING, faces=np.flatnonzero(left.left)[:4],
                          keep_out=[KeepOutBox((-9, -9, -9), (9, 9, 9), "everything")]),
        made_with={"versions": {"numpy": "1.2.3"}, "mesh": [{"name": "ball.ply"}]},
        notes=["a <note> for the top"],
    )  # fmt: skip


@pytest.fixture
def without_pictures(monkeypatch):
    """Pages take no time to draw."""
    monkeypatch.setattr(page_module, "drawn_for", lambda report, progress: {})


@pytest.fixture
def whole(report, without_pictures):
    return page(report)


@pytest.mark.slow
def test_every_figure_that_counts_is_told(whole, report):
    words = " ".join(read_alone(whole).words)
    told, left = report.network.summary(), report.leftover.summary()
    for figure in (
        f"2 cameras cover {told['covered']['area_percent']:.1f} % of the area",
        f"{told['covered']['faces']:,} of {told['task_faces']:,} faces",
        f"{100 * report.selection.bound:.1f} %",
        f"{100 * report.tolerance.together.worst:.1f} %",
        f"{left['left']['faces']:,}",
        "in keep-out floor",
        f"{report.dropped.summary()['kept_out']['floor']}",
        "ball <b> & co",
        "a <note> for the top",
        "1.2.3",
        "ball.ply",
        report.openings.words(0),
        f"{told['largest_visibility_bound']:.2g}",
    ):
        assert figure in words, figure
    assert "table" not in [line.strip() for line in words.split("  ")][:5]


def test_what_is_written_by_others_is_escaped(whole):
    assert "<note>" not in whole
    assert "ball <b>" not in whole


@pytest.mark.parametrize(
    ("missing", "heading"),  # that of segments comes and goes with its picture
    [
        ({"selection": None, "goal": None}, "Selection"),
        ({"candidates": None, "dropped": None}, "Candidates"),
        ({"leftover": None}, "What is left"),
        ({"openings": None}, "Cavities"),
        ({"tolerance": None}, "Tolerance"),
        ({"made_with": {}}, "How it was made"),
    ],
)
def test_what_is_not_known_has_no_section(report, whole, missing, heading):
    heading = f">{heading}</h"
    assert heading in whole
    assert heading not in page(replace(report, **missing))


@pytest.mark.parametrize("status", page_module.STATUS)
def test_a_selection_that_covers_nothing_is_not_called_the_best(report, without_pictures, status):
    found = replace(report.selection, share=0.0, status=status)
    words = " ".join(read_alone(page(replace(report, selection=found))).words)
    assert page_module.NOTHING in words
    assert page_module.STATUS[status] not in words


def test_a_page_by_area_does_not_say_that_faces_are_at_zero(report, without_pictures):
    assert "have coverage 0 in every camera" in page(report)
    by_area = rc.regions(report.mesh, CAMERA, report.poses)
    assert "coverage 0 in every camera" not in page(replace(report, regions=by_area))


@pytest.mark.slow
def test_a_network_alone_has_a_page(report):
    bare = PlanReport(mesh=report.mesh, camera=CAMERA, network=report.network, poses=report.poses)
    text = page(bare)
    assert len(read_alone(text).loads) == 3 + 2 + 2 * 2  # pictures, cameras; plots for two themes
    assert ">Segments</h" not in text


@pytest.mark.slow
def test_a_network_without_cameras_has_a_page():
    mesh, poses = shapes.box(), np.zeros((0, 4, 4))
    left = what_is_left((mesh, CAMERA), poses)
    bare = PlanReport(
        mesh=mesh, camera=CAMERA, network=network_of(mesh, poses), poses=poses, leftover=left
    )
    words = " ".join(read_alone(page(bare)).words)
    assert "0 cameras cover 0.0 % of the area" in words
    assert "have no camera" in words


def test_poses_names_and_network_must_agree(report):
    with pytest.raises(ConfigError, match="the network has 2 cameras, got 1 poses"):
        replace(report, poses=report.poses[:1])
    with pytest.raises(ConfigError, match="camera_names must be 2 words"):
        replace(report, camera_names=["one"])


def test_each_camera_tells_where_it_comes_from(report):
    chosen = report.candidates.take(report.selection.chosen)
    for origin, source, index in zip(report.origins, chosen.source, chosen.index, strict=True):
        assert origin == (f"{source} {index}" if index >= 0 else source)
    assert replace(report, sources=["wall", "roof"]).origins == ["wall", "roof"]
    assert replace(report, candidates=None).origins == ["", ""]


@pytest.mark.slow
def test_the_file_stands_alone_and_is_whole_or_what_was_there_before(report, tmp_path, monkeypatch):
    path = tmp_path / "plan.html"
    calls = []
    assert write_page(path, report, lambda done, total: calls.append((done, total))) == path
    before = path.read_text(encoding="utf-8")
    assert len(read_alone(before).loads) == 5 + 2 + 2 * 3  # pictures, cameras; plots for two themes
    assert ">Segments</h" in before
    assert before.endswith("</html>\n")
    assert calls[-1] == (10, 10)

    def fail(*arguments):
        raise OSError("no more ink")

    monkeypatch.setattr(pictures, "network_picture", fail)
    with pytest.raises(OSError, match="ink"):
        write_page(path, report)
    assert path.read_text(encoding="utf-8") == before
    assert list(tmp_path.iterdir()) == [path]


def pixels_of(image):
    return np.asarray(image.convert("RGB")).astype(int)


def share_of_hue(pixels, colour):
    """Part of the pixels that are some shade of a colour."""
    colour = np.asarray(colour, float)
    norm = np.linalg.norm(pixels, axis=2) * np.linalg.norm(colour)
    cosine = (pixels @ colour) / np.maximum(norm, 1)
    bright = pixels.sum(axis=2) / colour.sum()
    return float(((cosine > 0.997) & (bright > 0.5) & (bright < 1.1)).mean())


@pytest.mark.slow
def test_faces_that_are_left_have_the_colour_of_their_reason(report):
    mesh = report.mesh
    nothing = what_is_left((mesh, CAMERA), report.poses[:0])
    image = pixels_of(pictures.leftover_picture(nothing))
    assert share_of_hue(image, theme.REASONS["no_cameras"]) > 0.1
    behind = what_is_left((mesh, CAMERA), rc.look_at([0, 0, 4.0], [0, 0, 9.0]))
    image = pixels_of(pictures.leftover_picture(behind))
    assert share_of_hue(image, theme.REASONS["outside"]) > 0.03
    assert share_of_hue(image, theme.REASONS["back_facing"]) > 0.03


def test_every_reason_has_a_colour_and_words_and_colours_differ():
    colours = np.array(list(theme.REASONS.values()))
    assert theme.REASONS.keys() == REASONS.keys() - {"covered"}
    apart = np.abs(colours[:, None] - colours[None]).max(axis=2) + 999 * np.eye(len(colours))
    assert apart.min() > 30


@pytest.mark.slow
def test_a_face_hidden_from_both_sides_shows_through(report):
    inside = shapes.box((0.6, 0.6, 0.6))
    shell = shapes.box((1, 1, 1))
    whole = joined(inside, shell)
    mesh = Mesh(whole.vertices, whole.faces, (Group("core"), Group("shell")),
                np.repeat([0, 1], [12, 12]))  # fmt: skip
    eyes = 5 * np.array([(1, -1.5, 1), (-1, 1.5, -1), (-2, -1, 1), (1, 2, 1)])
    left = what_is_left((mesh, CAMERA), rc.look_at(eyes, [0, 0, 0]))
    assert left.left[:12].all()
    assert not left.left[12:].any()
    image = pixels_of(pictures.leftover_picture(left))
    red = (image[..., 0] > image[..., 1] + 40) & (image[..., 0] > image[..., 2] + 40)
    assert red[60:600].mean() > 0.02


@pytest.mark.slow
def test_segments_have_colours_of_their_own():
    mesh = shapes.box(n=2)
    one = pixels_of(pictures.segments_picture(mesh, segment(mesh, 10, None)))
    middle = one[60:-10]
    shades = {tuple(pixel) for pixel in middle.reshape(-1, 3)[::7].tolist()}
    # Three sides in each picture; flat sides have one shade within some rounding.
    tones = np.array(sorted(shades))
    counted = [share_of_hue(middle, tone) for tone in theme.index_colours(np.arange(6))]
    assert len(tones) > 6
    assert all(share > 0.01 for share in counted)
    with pytest.raises(ConfigError, match="segment this mesh"):
        pictures.segments_picture(shapes.box(), segment(mesh, 10, None))


@pytest.mark.slow
def test_each_camera_is_drawn_in_its_colour_inside_the_picture(report):
    image = pixels_of(network_picture(report.colours, CAMERA))
    bare = pixels_of(network_picture(camera_colours(report.mesh, report.poses[:0]), CAMERA))
    for colour in theme.camera_colours(2):
        assert share_of_hue(image[60:], colour) > share_of_hue(bare[60:], colour) + 0.001
    for direction in DIRECTIONS[:2]:
        eyes = report.poses[:, :3, 3]
        scene = look(report.mesh, direction, eyes)
        u, v = place_in_image(scene, eyes).T
        assert ((u > 0) & (u < scene.camera.width) & (v > 0) & (v < scene.camera.height)).all()


def test_colours_of_cameras_are_told_apart():
    colours = theme.camera_colours(40).astype(int)
    assert len({tuple(colour) for colour in colours.tolist()}) == 40
    first = colours[:12]
    apart = np.abs(first[:, None] - first[None]).sum(axis=2) + 999 * np.eye(12)
    assert apart.min() > 50


@pytest.mark.slow
@pytest.mark.parametrize("direction", DIRECTIONS.tolist())
def test_all_of_the_mesh_is_in_the_picture_from_everywhere(direction):
    mesh = Mesh(vertices=shapes.aeroplane().vertices * 1e-3 + 100, faces=shapes.aeroplane().faces)
    scene = look(mesh, direction, scale=0.2)
    size = scene.camera.width, scene.camera.height
    places = place_in_image(scene, mesh.vertices)
    assert (places >= 0).all()
    assert (places <= size).all()
    assert (np.ptp(places, axis=0) / size).max() > 0.85


@pytest.mark.slow
def test_one_looks_into_a_room_through_its_walls_and_not_into_a_box():
    room, box = shapes.room(4), shapes.box()
    for direction in DIRECTIONS:
        scene = look(room, direction, scale=0.2)
        seen = np.unique(scene.face)
        seen = seen[seen >= 0]
        ray = scene.pose[:3, 3] - room.centroids[seen]
        assert (np.einsum("fi,fi->f", room.normals[seen], ray) > 0).all()
        assert len(look(box, direction, scale=0.2).rows) == box.n_faces
    names = {room.groups[row].name for row in room.face_group[seen]}
    assert names == {"room", "crates"}


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_one_looks_from_where_the_faces_in_question_are_seen(axis, sign):
    mesh = shapes.box()
    faces = mesh.normals[:, axis] * sign > 0.9
    towards = best_directions(mesh, faces)[0]
    assert towards[axis] * sign > 0
    buffer = look(mesh, towards, scale=0.2).buffer
    assert faces[np.unique(buffer.face[buffer.face >= 0])].any()


def test_paint_gives_a_face_its_colour_lit_by_the_eye():
    mesh = shapes.box()
    colours = np.tile(np.array([[200, 100, 50]], np.uint8), (12, 1))
    scene = look(mesh, (1, -1.5, 1), scale=0.2)
    lit = paint(scene, colours)[scene.face >= 0].astype(float)
    share = lit / [200, 100, 50]
    assert share.max() <= 1.01
    assert np.median(share) > 0.6


@pytest.mark.slow
@pytest.mark.parametrize("colours", [LIGHT, DARK])
def test_bars_are_as_long_as_their_shares(colours):
    mesh = shapes.room(4)
    network = network_of(mesh, rc.look_at([[2.5, 2, 2.5]], [0, 0, 0.5]))
    (axes,) = pictures.group_bars(colours, network).axes
    groups = {group["name"]: group["covered"] for group in network.summary()["groups"]}
    tracks, bars = axes.patches[: len(groups)], axes.patches[len(groups) :]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert sorted(names) == sorted(groups)
    assert [bar.get_width() for bar in tracks] == [1.0] * len(groups)
    for name, bar, text in zip(names, bars, axes.texts, strict=True):
        share = groups[name]["area_percent"] / 100
        assert bar.get_width() == pytest.approx(share)
        assert bar.get_facecolor() == to_rgba(colours.series[0])
        assert text.get_text() == f"{percent(share)} of the area"


def test_views_of_faces_make_up_the_whole_area():
    mesh = shapes.sphere(2)
    poses = rc.look_at([[4, 0, 0], [0, 4, 0], [0, 0, 4.0]], [0, 0, 0])
    network = network_of(mesh, poses)
    shares = pictures.overlap_shares(network)
    assert sum(share for _, share, _ in shares) == pytest.approx(1)
    assert shares[0][0] == "0 cameras"
    areas = mesh.areas
    assert shares[1][1] == pytest.approx(areas[network.views == 1].sum() / areas.sum())
    (axes,) = pictures.overlap_histogram(LIGHT, network).axes
    assert [bar.get_width() for bar in axes.patches[len(shares) :]] == pytest.approx(
        [share for _, share, _ in shares]
    )


def test_bars_by_area_are_those_of_the_exact_area():
    mesh, task = shapes.room(4), rc.Task()
    poses = rc.look_at([[2.5, 2, 2.5], [-2.5, 2, 2.5], [2.5, -2, 2.5]], [0, 0, 0.5])
    network, regions = network_of(mesh, poses), rc.regions(mesh, CAMERA, poses, task)
    covered = rc.unite(regions, views=3)
    total = mesh.areas[mesh.task_mask].sum()
    at_least = [1.0, *(covered.area.sum(axis=1) / total), 0.0]
    bars = pictures.overlap_shares(network, regions)
    np.testing.assert_allclose([share for _, share, _ in bars], -np.diff(at_least), atol=1e-12)
    assert bars[0][1] < pictures.overlap_shares(network)[0][1]
    groups = [{"name": group.name, "covered_area": {"percent": 12.5}} for group in mesh.groups]
    assert {share for _, share, _ in pictures.group_shares(network, {"groups": groups})} == {0.125}


@pytest.fixture(scope="module")
def matrix(report):
    return build_matrix((report.mesh, CAMERA), report.candidates.poses, TASK)


@pytest.mark.slow
@pytest.mark.parametrize("goal", [BestCoverage(cameras=3), FewestCameras(0.9, of_reachable=True)])
def test_the_curve_is_drawn_for_either_goal(report, matrix, goal):
    found = select_greedy(problem_of(matrix, report.mesh, goal))
    (axes,) = pictures.coverage_curve(LIGHT, found, goal).axes
    curve = axes.lines[0]
    assert curve.get_xdata().tolist() == list(range(len(found.chosen) + 1))
    assert curve.get_ydata().tolist() == [0.0, *found.curve.tolist()]
    assert axes.get_xlim()[1] >= len(found.chosen)
    assert axes.get_ylim() == (0, 1.04)
    is_best = isinstance(goal, BestCoverage)
    assert ("none covers more than" in axes.texts[0].get_text()) == is_best


def test_an_empty_selection_has_a_curve(report, matrix):
    goal = BestCoverage(cameras=0)
    found = select_greedy(problem_of(matrix, report.mesh, goal))
    assert len(pictures.coverage_curve(LIGHT, found, goal).axes[0].lines[0].get_xdata()) == 1


@pytest.mark.parametrize(
    ("low", "high", "whole"), [(0, 1.04, False), (0, 1, True), (0, 7, True), (0, 250, True)]
)
def test_ticks_of_an_even_axis_are_even_and_within_it(low, high, whole):
    values = plots.Axis("n", low, high, is_whole=whole).ticks()
    steps = np.diff(values)
    assert values[0] == low
    assert 2 <= len(values) <= 12
    assert steps == pytest.approx(steps[0])
    assert values[-1] <= high * (1 + 1e-9)
    if whole:
        assert all(float(value).is_integer() for value in values)


def test_names_of_any_language_and_with_markup_are_drawn_in_one_size():
    bars = [("a $x^2$ 部件 \n two", 0.5, "50.0 %"), ("n" * 99, 1.5, "all"), ("", -1, "none")]
    figure = plots.bar_plot("Bars", bars, LIGHT, "a note", good_from=1)
    image = plots.image_of(figure)
    assert image.size == (1120, round(200 * figure.get_figheight()))
    assert image.mode == "RGB"
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [r"a \$x^2\$ □□ two", "n" * 27 + "…", ""]
    assert [bar.get_width() for bar in axes.patches[3:]] == [0.5, 1.0, 0.0]
    assert axes.patches[3].get_facecolor() == to_rgba(LIGHT.series[1])


@pytest.mark.slow
def test_only_a_page_imports_its_libraries(tmp_path):
    code = """
import sys
import rastercov.cli, rastercov.reference.methods, rastercov.reference.methods.report
import rastercov.report.plan, rastercov.reference.models.report, rastercov.report.placement
from rastercov.cli import command
assert command(["demo", "--shape", "box", "--poses", "2", "--device", "cpu", "--json"]) == 0
print(sorted({"jinja2", "matplotlib", "trimesh"} & sys.modules.keys()), file=sys.stderr)
from rastercov.report import placement_pictures as network_plots
from rastercov.report import plots, theme
plots.image_of(plots.bar_plot("t", [("a", 0.5, "b")], theme.LIGHT))
assert "matplotlib.pyplot" not in sys.modules
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_coverage_is_red_where_it_is_nothing():
    mesh = shapes.box()
    nothing = pixels_of(overview.best_picture(mesh, np.zeros(12)))[60:600]
    full = pixels_of(overview.best_picture(mesh, np.ones(12)))[60:600]
    assert share_of_hue(nothing, (232, 33, 45)) > 0.2
    assert share_of_hue(full, (232, 33, 45)) == 0
    assert share_of_hue(full, (253, 231, 37)) > 0.2
    with pytest.raises(ConfigError, match="shape"):
        overview.best_picture(mesh, np.zeros(3))


@pytest.mark.usefixtures("without_pictures")
def test_candidates_of_one_source_count_as_such(report):
    counts = Candidates.of(np.tile(np.eye(4), (3, 1, 1)), "x").counts()
    assert counts == {"x": 3}
    words = " ".join(read_alone(page(replace(report, dropped=None))).words)
    assert "sphere" in words
