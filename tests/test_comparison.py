"""benchmarks/comparison.py: its errors by hand, its points, its command and its page."""

import json
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from processes import python

import rastercov as rc

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"
PAGE = ROOT / "docs" / "comparison.md"
CAMERA = rc.Camera(width=200, height=200, fx=100, fy=100)
#        0,0 - the face fills a quarter of the image
FACE = rc.Mesh(vertices=[(-1, -1, 2), (0, -1, 2), (-1, 0, 2)], faces=[(0, 2, 1)])


@pytest.fixture(scope="module")
def comparison():
    pytest.importorskip("embreex", reason="embreex is missing: pip install 'rastercov[bench]'")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        yield import_module("comparison")


def marks():
    return import_module("pages_of_tables").marks("benchmarks/comparison.py")


def scene(comparison, **fields):
    ones = np.ones((1, 4))
    known = comparison.Scene(FACE, CAMERA, np.eye(4)[None], ones, ones, 0 * ones, ones > 0)
    return replace(known, **fields)


def test_errors_are_those_of_numbers_by_hand(comparison):
    true = scene(
        comparison,
        visible=np.array([[10.0, 0.0, 3.0, 0.5]]),
        area=np.array([[10.0, 20.0, 4.0, 100.0]]),
        judged=np.array([[True, True, True, True]]),
    )
    # Missed is the third: of the fourth less than a hundredth is visible.
    values = np.array([0.9, 0.2, 0.0, 0.0])
    got = comparison.errors(true, comparison.Contestant("a", "a", lambda row: values, lambda: None))
    assert got["mean"] == pytest.approx((0.1 + 0.2 + 0.75 + 0.005) / 4)
    assert got["mean by area"] == pytest.approx((1 + 4 + 3 + 0.5) / 134)
    assert (got["largest"], got["missed"], got["false"]) == (0.75, 1, 1)
    part = replace(true, judged=np.array([[True, False, False, False]]))
    got = comparison.errors(part, comparison.Contestant("a", "a", lambda row: values, lambda: None))
    assert (got["faces"], got["largest"]) == (1, pytest.approx(0.1))


@pytest.mark.parametrize("side", [1, 2, 4])
def test_points_of_a_face_are_the_centroids_of_its_equal_parts(comparison, side):
    (points,) = comparison.points_of(FACE, side)
    centroid = FACE.vertices.mean(axis=0)
    assert points.shape == (side * side, 3)
    assert np.allclose(points.mean(axis=0), centroid)
    assert len(np.unique(points.round(9), axis=0)) == side * side
    # The distance from the diagonal, where x + y is -1, and from the other sides, in thirds.
    heights = np.stack((-points[:, 0] - points[:, 1] - 1, points[:, 0] + 1, points[:, 1] + 1))
    thirds = np.abs(heights[1:]) * 3 * side
    assert np.allclose(thirds, thirds.round())
    assert (heights > 0).all()


def test_a_fraction_is_the_share_of_points_in_the_image_that_are_met_first(comparison):
    def first(eye, rays):
        return np.where(rays[:, 0] < -0.5, 0, -1)  # a wall before the right half

    here = scene(comparison)
    fractions = comparison.by_points(here, "rays", 4, first).fractions(0)
    (points,) = comparison.points_of(FACE, 4)
    assert fractions == pytest.approx((points[:, 0] < -0.5).mean())
    away = replace(here, poses=np.diag([1.0, -1, -1, 1])[None])
    assert comparison.by_points(away, "rays", 4, first).fractions(0) == [0]


@pytest.mark.matter("laboratory")
@pytest.mark.slow
def test_the_command_compares_first_and_rewrites_its_part_of_a_page(comparison, tmp_path):
    page, text = tmp_path / "page.md", PAGE.read_text(encoding="utf-8")
    page.write_text(text, encoding="utf-8")
    options = ["--scenes", "aeroplane", "--size", "96", "64", "--poses", "1", "--rounds", "1"]
    done = python(BENCHMARKS / "comparison.py", *options, "--out", tmp_path, "--page", page)
    assert done.returncode == 0, done.stderr
    assert "aeroplane: packets meet the faces of our image" in done.stdout
    begin, end = marks()
    before, _, rest = text.partition(begin)
    after = rest.partition(end)[2]
    written = page.read_text(encoding="utf-8")
    assert written.startswith(before)
    assert written.endswith(after)
    block = written.partition(begin)[2].partition(end)[0]
    assert block.strip() in done.stdout
    assert "| **certified** | 0, 0; 0/0 |" in block
    figures = json.loads((tmp_path / "comparison.json").read_text())["scenes"]["aeroplane"]
    assert figures["Embree packets"]["ratio"] == 1
    assert 0 < figures["**sampled**, 16 per pixel"]["mean"] < figures["**sampled**"]["mean"]
    assert figures["Khepra, as printed"]["ms"] == 307_995


@pytest.mark.slow
def test_a_comparison_that_fails_leaves_the_page_and_ends_with_1(comparison, tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    earlier = "\nearlier\n".join(marks()) + "\n"
    page.write_text(earlier)
    monkeypatch.setattr(comparison, "wrong_pixels", lambda *args: (1, 1))
    monkeypatch.setattr(comparison, "ALGORITHM_1", 0)
    options = ["--scenes", "aeroplane", "--size", "48", "32", "--poses", "1", "--rounds", "1"]
    words = [*options, "--out", str(tmp_path), "--page", str(page)]
    monkeypatch.setattr("sys.argv", ["comparison.py", *words])
    with pytest.raises(SystemExit) as ended:
        comparison.main()
    assert ended.value.code == 1
    assert page.read_text() == earlier


def test_a_page_without_marks_is_refused_and_kept(comparison, tmp_path):
    (tmp_path / "page.md").write_text("text\n")
    with pytest.raises(SystemExit, match=r"page\.md must have the lines <!-- made by"):
        comparison.write(tmp_path / "page.md", comparison.PROGRAM, "| |")
    assert (tmp_path / "page.md").read_text() == "text\n"


def rows(text, begins):
    """Numbers of the cells of rows of tables that begin so, without their text: lists of lists."""
    lines = (
        line for line in text.splitlines() if re.match(rf"\| (?!scene){re.escape(begins)}", line)
    )
    cells = ([cell.strip() for cell in line.strip("| ").split("|")[1:]] for line in lines)
    return [
        [[float(n.replace(",", "")) for n in re.findall(r"[\d.,]*\d", cell)] for cell in row]
        for row in cells
    ]


def test_ranges_of_the_readme_are_those_of_the_tables():
    """To the digits that it gives: rates relative to Embree packets at 1280 x 1024."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    page = PAGE.read_text(encoding="utf-8")
    measured = (PAGE.parent / "appendix" / "measurements.md").read_text(encoding="utf-8")
    engine = measured.partition("## Certified")[2].partition("## Rasterisers")[0]
    counted = measured.partition("## Rasterisers")[2].partition("\n## ")[0]
    every = [row for row in rows(engine, "") if len(row) == 5]
    certified = [cell[0] for row in every for cell in row[:2]]
    sampled = [cell[0] for row in every for cell in row[2:4]]
    sampled += [row[0][1] for row in rows(counted, "") if len(row[0]) == 2]

    def rates(begins):
        (row,) = [row for row in rows(page, begins) if len(row[0]) == 2]
        return [cell[1] for cell in row]

    for begins, found in {
        "**rastercov, `certified`**": certified,
        "**rastercov, `sampled`**": sampled,
        "one ray to the centre": rates("Open3D, centroids"),
        "rendered face-index": rates("VTK on software OpenGL"),
    }.items():
        (line,) = [line for line in readme.splitlines() if line.startswith(f"| {begins}")]
        said = line.rstrip("| ").rpartition("|")[2].strip().split(" to ")
        ends = [min(found), max(found)] if len(said) == 2 else [np.median(found)]
        for word, number in zip(said, ends, strict=True):
            half = 0.5 * 10.0 ** -len(word.partition(".")[2])
            assert abs(float(word) - number) <= half + 1e-9, (begins, word, number)


def test_rays_to_centroids_are_as_the_page_says():
    """Few errors on faces; less time than `certified` on the open mesh, the teapot."""
    page = PAGE.read_text(encoding="utf-8")
    ((*_, teapot, _),) = rows(page, "Open3D, centroids")
    ((*_, proved, _),) = [row for row in rows(page, "**certified**") if len(row[0]) == 2]
    assert teapot[0] < proved[0]
    (errors,) = rows(page, "one ray to the centroid")
    assert max(cell[0] for cell in errors) < 10  # percent of a face, on average
