"""The comparison harness: liars are caught, its figures are right, its page stands alone."""

import dataclasses
import json
import re
import shutil
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from commands import enter
from hypothesis import example, given, settings
from hypothesis import strategies as st
from nightly import examples
from pages import read_alone
from PIL import Image
from scenes import joined, sheet, square
from visible_fractions import visibility

from rastercov import cli
from rastercov.base.errors import ConfigError, PoseError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.coverage.coverage import Observer, open_observer
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.contract import BoundKind, Observation
from rastercov.reference import polygons
from rastercov.reference.coverage import measure_geometry as face_geometry
from rastercov.reference.methods import comparison as compare_entrants
from rastercov.reference.methods import convergence as compare_convergence
from rastercov.reference.methods.comparison import MIN_FACES, SIGNIFICANCE, _often_enough, compare
from rastercov.reference.methods.convergence import KnownFaces, converge
from rastercov.reference.methods.error_statistics import (
    MUST_HOLD,
    SIZES,
    ErrorStatistics,
    FaceError,
    PoseFigures,
)
from rastercov.reference.methods.report import (
    comparison_plots,
    face_picture,
    neighbourhood,
    page,
    write_comparison,
)
from rastercov.reference.pages import LIGHT, image_of
from rastercov.reference.samples import grid_points

CAMERA = Camera(width=160, height=120, fx=190, fy=185)
TEAPOT = shapes.teapot(3)
AHEAD = np.eye(4)
# A sheet with a smaller one before it, of which a part lies outside the image.
OVERLAP = joined(sheet((-0.9, -0.4), (0.3, 0.4), 1.0), sheet((-0.5, -0.15), (0.1, 0.2), 0.8))


def around(n, mesh=TEAPOT, distance=0.5):
    return sphere_of_poses(mesh.bounds.mean(axis=0), distance, n)


class Altered(Observer):
    """An observer whose observations are changed before anyone sees them."""

    def __init__(self, observer, alter):
        self._observer, self._alter = observer, alter
        self.mesh, self.camera, self.info = observer.mesh, observer.camera, observer.info
        self.threads = observer.threads

    def observe(self, poses):
        seen = self._observer.observe(poses)
        arrays = (seen.visible_pixels.copy(), seen.drawn_pixels.copy(), seen.kind.copy())
        return self._alter(
            Observation(*arrays, seen.area_error, seen.clipped, seen.samples_per_pixel)
        )

    def close(self):
        self._observer.close()


def altered(monkeypatch, method, alter):
    """Make every observer of a method one that is altered."""

    def open_one(mesh, camera, engine="certified"):
        observer = open_observer(mesh, camera, engine)
        return Altered(observer, alter) if Engine.of(engine).method == method else observer

    monkeypatch.setattr(compare_entrants, "open_observer", open_one)


def flip_a_certified_face(seen):
    face = np.flatnonzero((seen.kind[0] == BoundKind.CERTIFIED) & (seen.visible_pixels[0] > 1))[0]
    seen.visible_pixels[0, face] = 0
    return seen


def half_of_everything(seen):
    seen.visible_pixels[:] /= 2
    seen.drawn_pixels[:] /= 2
    return seen


def a_millionth_less(seen):
    seen.visible_pixels[seen.kind == BoundKind.EXACT] *= 1 - 1e-6
    return seen


def everything_certified(seen):
    seen.kind[:] = BoundKind.CERTIFIED
    return seen


def no_numbers(seen):
    seen.visible_pixels[:] = np.nan
    return seen


# --- the verdict ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("against", ["exact", "polygons", "rational"])
def test_a_right_candidate_passes(against):
    names = ["certified", "sampled@2"] + ["exact"] * (against != "exact")
    comparison = compare(TEAPOT, CAMERA, around(1), names, against, convergence=False)
    assert comparison.passed
    assert {check.passed for check in comparison.checks} <= {True, None}
    certain = [check for check in comparison.checks if check.kind != "statistical"]
    assert all(check.held == check.figures > 0 for check in certain)
    score = comparison.scores[0]
    assert score.all_sizes.greatest < 1e-9
    assert score.missed == score.phantoms == 0


LIES = (
    *(flip_a_certified_face, half_of_everything, a_millionth_less, everything_certified),
    no_numbers,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lie", "against"), [*((lie, "exact") for lie in LIES), (a_millionth_less, "polygons")]
)
def test_certain_figures_that_are_wrong_fail(monkeypatch, lie, against):
    altered(monkeypatch, "certified", lie)
    comparison = compare(TEAPOT, CAMERA, around(1), ["certified"], against, convergence=False)
    assert not comparison.passed
    assert any(check.held < check.figures for check in comparison.checks)
    assert not comparison.scores[0].worst[0].held


def test_a_statistical_bound_that_is_too_small_fails(monkeypatch):
    def boast(seen):
        return dataclasses.replace(seen, samples_per_pixel=seen.samples_per_pixel * 10_000)

    honest = compare(TEAPOT, CAMERA, around(5), ["sampled"], convergence=False)
    altered(monkeypatch, "sampled", boast)
    comparison = compare(TEAPOT, CAMERA, around(5), ["sampled"], convergence=False)
    assert honest.passed
    assert not comparison.passed


@settings(max_examples=25)
@given(st.integers(0, 5000), st.integers(0, 5000))
def test_a_bound_is_judged_by_how_often_it_must_hold(broken, more):
    n = broken + more
    verdict = _often_enough(n - broken, n)
    if n - broken >= MUST_HOLD * n:
        assert verdict is (True if n >= MIN_FACES else None)
    else:
        assert verdict in (False, None)
    if verdict is False:  # one more that does not hold makes nothing better
        assert _often_enough(n - broken, n + 1) is False


def test_chance_seldom_fails_a_bound_that_holds_just_often_enough():
    rng = np.random.default_rng(1)
    for n in (10, 300, 1284, 20_000):
        broken = rng.binomial(n, 1 - MUST_HOLD, 1000)
        failed = np.mean([_often_enough(n - k, n) is False for k in broken.tolist()])
        assert failed < 3 * SIGNIFICANCE
        assert _often_enough(n - round(0.02 * n) - 2, n) is False


# --- the figures ----------------------------------------------------------------------------------


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_figures_are_those_of_an_independent_reckoning(tmp_path):
    mesh, poses = shapes.teapot(2), around(1)
    comparison = compare(mesh, CAMERA, poses, ["sampled"], "polygons", worst=3, convergence=False)
    write_comparison(tmp_path, comparison, mesh, CAMERA, poses)
    score = json.loads((tmp_path / "compare.json").read_text())["scores"][0]

    figures = visibility(mesh, CAMERA, poses, "sampled")
    rows = []
    for i, pose in enumerate(poses):
        view = face_geometry(mesh, CAMERA, pose)
        area = polygons.image_area(mesh, CAMERA, pose)
        seen = polygons.visible_area(mesh, CAMERA, pose)
        for face in range(mesh.n_faces):
            if view.is_front[face] and area[face] > 1e-7:
                value, bound = figures.visibility[i, face], figures.visibility_bound[i, face]
                rows.append((i, face, area[face], seen[face] / area[face], value, bound))
    pose, face, area, truth, value, bound = np.array(rows).T
    error = np.abs(value - truth)
    partly = (truth > 1e-6) & (truth < 1 - 1e-6)

    every = score["all_sizes"]
    assert every["figures"] == len(rows)
    assert every["partly_hidden"] == partly.sum() > 20
    assert every["mean"] == pytest.approx(error.mean())
    assert every["rms_partly_hidden"] == pytest.approx(np.sqrt((error[partly] ** 2).mean()))
    assert every["mean_bound_partly_hidden"] == pytest.approx(bound[partly].mean())
    assert score["missed"] == ((value == 0) & (truth * area > 1e-6)).sum()
    assert score["missed_area"] == pytest.approx((truth * area)[value == 0].sum(), abs=1e-5)
    check = score["bounds"][0]
    assert check["kind"] == "statistical"
    assert check["partly_hidden_held"] == (error <= bound + 1e-6)[partly].sum()
    assert check["greatest_ratio"] == pytest.approx((error / bound)[partly].max(), rel=1e-5)
    known = bound < 1
    weight = np.where(known, error * np.minimum(area, 1), -1)
    worst = np.lexsort((face, pose, -weight))[:3]
    assert [(w["pose"], w["face"]) for w in score["worst"]] == [(pose[i], face[i]) for i in worst]


def test_faces_seen_in_part_at_the_border_of_the_image_are_compared():
    comparison = compare(OVERLAP, CAMERA, AHEAD[None], ["sampled@4"], "rational", convergence=False)
    truth = compare(OVERLAP, CAMERA, AHEAD[None], ["certified"], "rational", convergence=False)
    view = face_geometry(OVERLAP, CAMERA, AHEAD)
    assert (view.in_view_fraction[:2] < 1).all()
    assert comparison.scores[0].all_sizes.figures == truth.scores[0].all_sizes.figures == 4
    assert comparison.scores[0].all_sizes.partly_hidden == 2
    assert truth.scores[0].all_sizes.greatest < 1e-12
    assert 0 < comparison.scores[0].all_sizes.greatest < 0.01


def test_a_face_between_the_samples_is_missed_and_its_bound_says_so():
    sliver = joined(sheet((0.1, 0.1001), (0.102, 0.1003), 1.0), square(0.02, 1.0))
    scores = compare(sliver, CAMERA, AHEAD[None], ["sampled"], convergence=False).scores[0]
    assert scores.missed >= 1
    assert scores.missed_unsaid == 0
    assert scores.missed_faces[0].value == 0
    assert scores.missed_faces[0].bound == 1
    assert scores.missed_area == pytest.approx(sum(f.visible for f in scores.missed_faces))


def judged(rows):
    """Figures of a pose from (area, share seen, value, bound, kind) of each face."""
    area, share, value, bound, kind = (np.array(column) for column in zip(*rows, strict=True))
    return PoseFigures(
        face=np.arange(len(rows)), area=area, visible=area * share, value=value, bound=bound,
        kind=kind.astype(np.uint8), visible_pixels=area * value, truth_error=np.zeros(len(rows)),
    )  # fmt: skip


FRACTION = st.one_of(st.just(0.0), st.just(1.0), st.floats(0, 1))
ROW = st.tuples(
    st.floats(-8, 6).map(lambda power: 10.0**power), FRACTION, FRACTION, FRACTION, st.integers(0, 2)
)


@pytest.mark.slow
@examples(8, at_night=25)
@given(st.lists(st.lists(ROW, min_size=1, max_size=12), min_size=1, max_size=4))
@example([[(4.0, 0.5, 0.9, 0.5, 0)] * 3 + [(4.0, 0.5, 0.51, 0.001, 0)]])
def test_a_tally_agrees_with_all_figures_side_by_side(poses):
    tally = ErrorStatistics(3)
    for pose, rows in enumerate(poses):
        tally.add(pose, judged(rows), 0)
    all_rows = judged([row for rows in poses for row in rows])
    error, held = np.abs(all_rows.value - all_rows.truth), all_rows.is_held()
    every = tally.all_sizes()
    assert every.figures == len(error) == sum(size.figures for size in tally.classes())
    assert every.held == held.sum() == sum(bound.held for bound in tally.bounds())
    assert every.greatest == pytest.approx(error.max())
    assert every.rms == pytest.approx(np.sqrt((error**2).mean()), abs=1e-12)
    assert every.partly_hidden == sum(bound.partly_hidden for bound in tally.bounds())
    assert every.median >= np.sort(error)[(len(error) - 1) // 2] * (1 - 1e-9) - 1e-17
    assert every.percentile_99 <= max(every.greatest * 10**0.1, 1e-17)
    # Whatever is broken comes first among the worst, as far as there is room.
    assert sum(not w.held for w in tally.worst) == min(3, (~held).sum())
    for size in tally.classes():
        assert size.low in SIZES
        inside = (all_rows.area >= size.low) & (all_rows.area < size.high)
        assert size.figures == inside.sum()
    assert (
        tally.missed
        == ((all_rows.value == 0) & (all_rows.visible > 1e-9 + 1e-9 * all_rows.area)).sum()
    )


@settings(max_examples=25)
@given(st.floats(1e-6, 1e6), FRACTION, FRACTION, st.floats(0, 1))
@example(4.0, 0.5, 0.5 + 2e-9, 0.0)
def test_a_figure_is_held_when_its_error_is_within_its_bound(area, share, value, bound):
    of_face = judged([(area, share, value, bound, BoundKind.STATISTICAL)])
    error = abs(value - share)
    if error < bound * (1 - 1e-9):
        assert of_face.is_held()[0]
    if error > bound + 1e-9:
        assert not of_face.is_held()[0]


# --- long runs ------------------------------------------------------------------------------------


def without_times(result):
    """A comparison as JSON has it, without what a watch measured."""
    text = json.dumps(dataclasses.asdict(result))
    return re.sub(r'"[a-z_]*seconds[a-z_]*": (\[.*?\]|[^,}]*)', '""', text)


def test_batches_change_nothing(monkeypatch):
    options = {"candidates": ["certified", "sampled"], "convergence": False}
    whole = compare(TEAPOT, CAMERA, around(5), **options)
    monkeypatch.setattr("rastercov.reference.methods.comparison.POSES_A_BATCH", 2)
    pieces = compare(TEAPOT, CAMERA, around(5), **options)
    assert without_times(pieces) == without_times(whole)


class Stop:
    """Progress that interrupts once so much is done."""

    def __init__(self, at):
        self.at, self.calls = at, []

    def __call__(self, done, total):
        self.calls.append((done, total))
        if done == self.at:
            raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 4, 6])
def test_an_interrupt_keeps_the_poses_that_are_done(at, monkeypatch):
    poses, names = around(7), ["certified", "sampled"]
    monkeypatch.setattr("rastercov.reference.methods.comparison.POSES_A_BATCH", 3)
    comparison = compare(TEAPOT, CAMERA, poses, names, progress=Stop(at))
    short = compare(TEAPOT, CAMERA, poses[:at], names, convergence=False)
    assert comparison.interrupted
    assert (comparison.poses, comparison.poses_done) == (7, at)
    assert comparison.convergence == ()
    comparison, short = (
        dataclasses.replace(comparison, scores=each.scores) for each in (comparison, short)
    )
    assert without_times(comparison) == without_times(short)


def test_an_interrupt_before_the_first_pose_is_raised_and_one_between_sweeps_keeps_the_first():
    poses = around(2)
    with pytest.raises(KeyboardInterrupt):
        compare(TEAPOT, CAMERA, poses, ["certified"], progress=Stop(0))
    first = 2 + 2 * len(compare_convergence.levels("supersampling", CAMERA))
    comparison = compare(TEAPOT, CAMERA, poses, ["sampled"], progress=Stop(first + 1))
    assert comparison.interrupted
    assert comparison.poses_done == 2
    assert [sweep.sweep for sweep in comparison.convergence] == ["supersampling"]


def test_progress_counts_up_to_its_total():
    watch = Stop(-1)
    compare(TEAPOT, CAMERA, around(3), ["certified", "sampled"], progress=watch)
    done, totals = zip(*watch.calls, strict=True)
    assert list(done) == list(range(totals[0] + 1))
    assert set(totals) == {totals[0]}


# --- convergence ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_counts_converge_with_the_power_of_one_and_a_half():
    mesh = shapes.teapot(6)
    camera = Camera(width=320, height=240, fx=380, fy=380)
    comparison = compare(mesh, camera, around(8, mesh), ["sampled:cpu"])
    for sweep in comparison.convergence:
        assert sweep.faces >= 100
        assert sweep.slope == pytest.approx(-1.5, abs=0.35)
        assert sweep.slope_error < 0.2
        assert sorted(sweep.rms, reverse=True) == list(sweep.rms)
    assert [sweep.method for sweep in comparison.convergence] == ["sampled:cpu"] * 2


@pytest.mark.parametrize("power", [-3.0, -1.234, -0.5])
def test_the_slope_of_a_power_law_is_its_power(power):
    """An observer whose fractions are off by a power of its samples a side."""
    rng = np.random.default_rng(0)
    mesh, pose = joined(*(square(0.01, 1, (x, 0.1)) for x in np.linspace(-0.3, 0.3, 20))), AHEAD
    size = rng.uniform(0.5, 1, mesh.n_faces) * rng.choice((-1, 1), mesh.n_faces)

    def opener(mesh, camera, supersample=None):
        scale = supersample * camera.width / CAMERA.width

        def off(seen):
            value = 0.5 + 0.1 * size * scale**power
            return dataclasses.replace(seen, visible_pixels=seen.drawn_pixels * value)

        return Altered(open_observer(mesh, camera, "exact"), off)

    faces = np.arange(mesh.n_faces)
    known = [KnownFaces(pose, faces, np.full(len(faces), 100.0), np.full(len(faces), 0.5))]
    for sweep in compare_convergence.SWEEPS:
        result = converge("made up", opener, sweep, mesh, CAMERA, known, lambda: None)
        assert result.slope == pytest.approx(power)
        assert result.slope_error == pytest.approx(0, abs=1e-9)


def test_too_few_faces_give_no_slope():
    convergence = compare(OVERLAP, CAMERA, AHEAD[None], ["sampled"]).convergence
    assert [sweep.slope for sweep in convergence] == [None, None]
    assert all(len(sweep.rms) == len(sweep.samples_per_side) for sweep in convergence)


# --- arguments ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"candidates": []}, "expected a method to compare, got none"),
        ({"candidates": ["sampled", "sampled@1"]}, "twice"),
        ({"candidates": ["exact"]}, "other than the reference exact"),
        ({"against": "certified"}, "expected a reference"),
        ({"poses": np.empty((0, 4, 4))}, "expected poses, got none"),
        ({"poses": look_at((0, 0, 9), (0, 0, 99))}, "in view from the front, got none"),
        ({"poses": 2 * np.eye(4)[None]}, "does not end in the row"),
    ],
)
def test_bad_arguments_are_named(changes, words):
    whole = {"poses": around(1), "candidates": ["certified"], "against": "exact"} | changes
    with pytest.raises((ConfigError, PoseError), match=words):
        compare(TEAPOT, CAMERA, **whole)


# --- the page -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with everything, and the comparison it tells of."""
    out, poses = tmp_path_factory.mktemp("compare"), around(2)
    comparison = compare(TEAPOT, CAMERA, poses, ["certified", "sampled"], worst=2)
    write_comparison(out, comparison, TEAPOT, CAMERA, poses)
    return out, comparison


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_the_page_stands_alone_and_has_with_the_json_what_was_found(written):
    out, result = written
    text = (out / "compare.html").read_text(encoding="utf-8")
    assert read_alone(text).loads
    data = json.loads((out / "compare.json").read_bytes())
    assert data["passed"] is result.passed is True
    assert [check.passed for check in result.checks] == [True, True, None]
    assert "<title>rastercov compare: undecided</title>" in text
    assert "Undecided: no check fails" in text
    assert [score["name"] for score in data["scores"]] == [score.name for score in result.scores]
    for score in result.scores:
        assert f"<h2>{score.name}</h2>" in text
        assert f"{score.all_sizes.figures:,}" in text
    assert data["scores"][0]["all_sizes"]["high"] is None


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_each_picture_is_in_the_folder_and_on_the_page(written):
    out, result = written
    names, sampled = {path.name for path in out.glob("*.png")}, result.scores[1]
    expected = {f"worst_sampled_{i + 1}.png" for i in range(len(sampled.worst))}
    expected |= {f"missed_sampled_{i + 1}.png" for i in range(len(sampled.missed_faces))}
    assert names >= expected | {"plot_error_by_size.png", "plot_time.png", "plot_bounds.png"}
    text = (out / "compare.html").read_text(encoding="utf-8")
    assert text.count("<img ") == len(names)
    # Each plot for a dark page, too.
    assert text.count("<source ") == sum(name.startswith("plot_") for name in names)
    for name in names:
        with Image.open(out / name) as picture:
            picture.load()
            assert min(picture.size) > 150


def test_names_from_files_are_escaped():
    comparison = compare(OVERLAP, CAMERA, AHEAD[None], ["certified"], convergence=False)
    run = comparison.run | {"mesh": [{"name": "<script>alert('&')</script>.stl"}]}
    text = page(dataclasses.replace(comparison, run=run), {})
    assert "<script" not in text
    assert "&lt;script&gt;" in text


@pytest.fixture
def without_plots(monkeypatch):
    """Pages take less time to draw."""
    monkeypatch.setattr("rastercov.reference.methods.report.comparison_plots", lambda *_: {})


@pytest.mark.slow
@pytest.mark.usefixtures("without_plots")
def test_an_interrupt_while_drawing_leaves_a_whole_page(tmp_path):
    comparison = compare(OVERLAP, CAMERA, AHEAD[None], ["sampled"], convergence=False, worst=2)
    assert len(comparison.scores[0].worst) == 2
    with pytest.raises(KeyboardInterrupt):
        write_comparison(tmp_path, comparison, OVERLAP, CAMERA, AHEAD[None], Stop(1))
    names = {path.name for path in tmp_path.iterdir()}
    assert {"compare.html", "compare.json", "worst_sampled_1.png"} <= names
    assert "worst_sampled_2.png" not in names
    told = json.loads((tmp_path / "compare.json").read_bytes())
    assert told["scores"]
    assert told["interrupted"] is True
    read_alone((tmp_path / "compare.html").read_text(encoding="utf-8"))


# --- pictures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("supersample", "roll"), [(1, 0.4), (3, 0.4), (2, 0.0)])
def test_samples_in_a_part_are_those_of_the_image(supersample, roll):
    camera = Camera(width=15, height=8, fx=30, fy=30)
    box = (4.0, -5.0, 9.5, 6.5)
    every = grid_points(camera, supersample, roll)
    is_in = ((every >= box[:2]) & (every <= box[2:])).all(axis=1)
    assert np.array_equal(grid_points(camera, supersample, roll, box), every[is_in])


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_the_neighbourhood_of_a_face_holds_all_that_hides_it():
    pose = around(4)[1]
    front = np.flatnonzero(face_geometry(TEAPOT, CAMERA, pose).is_front)[::25]
    truth = polygons.visible_area(TEAPOT, CAMERA, pose, front)
    area = polygons.image_area(TEAPOT, CAMERA, pose, front)
    for face, seen, whole in zip(front.tolist(), truth, area, strict=True):
        around_it = neighbourhood(TEAPOT, CAMERA, pose, face)
        if whole == 0:
            assert around_it is None
            continue
        assert around_it.seen.area == pytest.approx(seen, abs=1e-7)
        assert around_it.seen.area + around_it.hidden.area == pytest.approx(whole, abs=1e-6)


@pytest.mark.matter("laboratory")
@pytest.mark.slow
@pytest.mark.parametrize("roll", [None, 0.4])
def test_faces_cut_by_the_near_plane_or_the_border_are_drawn(roll):
    floor = Mesh(vertices=[(-9, 1, -5), (9, 1, -5), (0, 1, 40)], faces=[(0, 1, 2)])
    for mesh, face in ((joined(floor, square(0.3, 2)), 0), (OVERLAP, 0), (OVERLAP, 1)):
        some = FaceError(0, face, 9.0, 4.5, 0.5, 0.4, 0.05, "statistical", False, 3.6)
        figure = face_picture(mesh, CAMERA, AHEAD, some, "any", 1, roll)
        assert image_of(figure).size[0] > 600
        assert len(figure.axes[0].patches) >= 3


def test_a_face_that_is_not_in_the_image_has_no_picture():
    comparison = compare(OVERLAP, CAMERA, AHEAD[None], ["sampled"], convergence=False)
    away = look_at((0, 0, 5), (0, 0, 9))[0]
    assert face_picture(OVERLAP, CAMERA, away, comparison.scores[0].worst[0], "any") is None


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_labels_of_plots_do_not_overlap(written):
    for name, figure in comparison_plots(written[1], LIGHT).items():
        figure.draw_without_rendering()  # sets the places of all texts
        (axes,) = figure.axes
        inside = figure.bbox.padded(1)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            shown = [tick for tick in ticks if low <= tick.get_loc() <= high]
            boxes = [each.label1.get_window_extent() for each in shown if each.label1.get_text()]
            assert all(not a.overlaps(b) for a, b in combinations(boxes, 2)), name
            assert all(inside.contains(*box.min) and inside.contains(*box.max) for box in boxes)
        for legend in figure.legends:
            box = legend.get_window_extent()
            assert inside.contains(*box.min), name
            assert inside.contains(*box.max), name
            assert box.y1 < axes.get_tightbbox().y0, name


# --- the command ----------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    enter(tmp_path, monkeypatch)
    Path("camera.toml").write_text("width = 64\nheight = 48\nfx = 70\nfy = 70\n")
    return tmp_path


def call(capsys, line):
    code = cli.command(line.split())
    out, err = capsys.readouterr()
    return code, out, err


QUICK = "compare box -c camera.toml -p sphere:2 --no-convergence --faces 1"


@pytest.mark.usefixtures("folder", "without_plots")
def test_the_command_prints_a_table_and_a_verdict(capsys):
    code, out, _ = call(capsys, QUICK + " -o here --method sampled:cpu@2")
    assert code == 0
    assert "sampled:cpu@2" in out
    assert "reference" in out
    assert out.splitlines()[-1] == "here/compare.html"
    assert Path("here/compare.html").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_json_is_what_the_file_holds(capsys):
    code, out, _ = call(capsys, QUICK + " --json --method certified --against polygons")
    assert code == 0
    assert json.loads(out) == json.loads(Path("compare/compare.json").read_bytes())
    assert json.loads(out)["against"] == "polygons"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("more", "compared", "names"),
    [
        ("", "methods.compare", ["compare.json", "compare.html", "plot_time.png", "worst_x_1.png"]),
        (
            " --models", "models.report.compare_models",
            ["models.json", "models.html", "models_9.png", "occlusion_0.png"],
        ),
    ],
)  # fmt: skip
def test_files_of_nobody_are_refused_before_the_work(capsys, monkeypatch, more, compared, names):
    monkeypatch.setattr(f"rastercov.reference.{compared}", lambda *_, **__: 1 / 0)
    for name in names:
        Path("here").mkdir()
        Path("here", name).write_text("mine")
        code, out, err = call(capsys, f"{QUICK}{more} -o here")
        assert (code, out) == (2, "")
        assert err.splitlines()[-1].startswith(f"error: here/{name}: expected a file of an earl")
        assert [path.read_text() for path in Path("here").iterdir()] == ["mine"]
        shutil.rmtree("here")


@pytest.mark.matter("laboratory")
@pytest.mark.slow
@pytest.mark.usefixtures("folder", "without_plots")
def test_a_liar_ends_the_command_with_1(capsys, monkeypatch):
    altered(monkeypatch, "certified", flip_a_certified_face)
    code, out, _ = call(capsys, QUICK + " --method certified")
    assert code == 1
    assert "fails, certified" in out
    assert json.loads(Path("compare/compare.json").read_bytes())["passed"] is False
    assert "Failed: " in Path("compare/compare.html").read_text(encoding="utf-8")
    assert Path("compare/worst_certified_1.png").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "more",
    [
        *("--method nonsense", "--method sampled:nowhere", "--method exact", "--against nonsense"),
        *("--faces -1", "--out camera.toml", "--unit mm", "-c nowhere.toml"),
    ],
)
def test_bad_usage_is_one_line_and_2(capsys, more):
    code, out, err = call(capsys, f"{QUICK} {more}")
    assert (code, out) == (2, "")
    errors = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert len(errors) == 1
    assert errors[0].startswith("error: ")
    assert "defect of rastercov" not in errors[0]
    assert not Path("compare").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_an_interrupted_command_leaves_what_is_done(capsys, monkeypatch):
    @contextmanager
    def stop(*words):
        yield Stop(1)

    monkeypatch.setattr("rastercov.cli.compare.progress_bar", stop)
    code, _, err = call(capsys, QUICK + " --method certified --faces 0")
    assert code == 130
    assert "1 of 2 poses" in err
    data = json.loads(Path("compare/compare.json").read_bytes())
    assert (data["interrupted"], data["poses_done"]) == (True, 1)
    assert "interrupted)" in Path("compare/compare.html").read_text(encoding="utf-8")
