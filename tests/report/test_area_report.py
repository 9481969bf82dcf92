"""Files of an evaluation by area: figures, the table of faces, the coloured parts."""

from collections import Counter

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh
from PIL import Image
from surface_cases import room

import rastercov as rc
from rastercov.report import panorama
from rastercov.report.coverage import Options, run
from rastercov.report.theme import ZERO_COVERAGE, coverage_colours

TASK = rc.Task(views=2, max_incidence_deg=75)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("area") / "report"
    mesh, camera, poses = room()
    summary = run(mesh, camera, poses, TASK, folder, Options(pictures=0, table="covered"))
    return mesh, folder, summary


def coloured_areas(path):
    """Area of each colour of a coloured mesh."""
    areas = Counter()
    for part in trimesh.load(path).geometry.values():
        palette = np.asarray(part.visual.material.baseColorTexture.convert("RGB"))[0]
        texel = (part.visual.uv[part.faces[:, 0], 0] * len(palette)).astype(int)
        for colour, area in zip(palette[texel].tolist(), part.area_faces, strict=True):
            areas[tuple(colour)] += area
    return areas


def test_the_table_of_faces_adds_up(report):
    mesh, folder, summary = report
    table = pq.read_table(folder / "areas.parquet").to_pydict()
    views, m2 = np.array(table["views"]), np.array(table["m2"])
    assert len(m2) == 2 * mesh.n_faces
    for each in summary["covered_area"]["by_views"]:
        assert m2[views == each["views"]].sum() == pytest.approx(each["m2"])
    assert (m2 <= np.array(table["area_m2"]) * (1 + 1e-12)).all()
    assert set(table["group"]) == {"mesh"}


def test_only_what_is_covered_has_a_colour_of_coverage(report):
    mesh, folder, summary = report
    once, twice = (each["m2"] for each in summary["covered_area"]["by_views"])
    areas = coloured_areas(folder / "network.glb")
    palette = [tuple(colour) for colour in coverage_colours().tolist()]
    assert areas.pop(ZERO_COVERAGE) == pytest.approx(mesh.areas.sum() - once, rel=1e-5)
    assert areas.pop(palette[-1]) == pytest.approx(twice, rel=1e-5)
    (half,) = areas.values()
    assert half == pytest.approx(once - twice, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("n_colours", [60, 2])
def test_the_network_and_its_dead_zones_are_drawn(tmp_path, monkeypatch, n_colours):
    monkeypatch.setattr("rastercov.report.network_page.MOST_COLOURS", n_colours)
    monkeypatch.setattr(panorama, "WIDTH", 240)  # those of a page are no smaller than 320 pixels
    run(*room(), TASK, tmp_path, Options(pictures=1))
    for name in ("overview.png", "zones.png"):
        with Image.open(tmp_path / name) as picture:
            assert picture.width == 2 * panorama.WIDTH + 6
            assert len(np.unique(np.asarray(picture)[60:-60].reshape(-1, 3), axis=0)) > 10


@pytest.mark.slow
@pytest.mark.parametrize("pairs", ["covered", "seen", "all"])
def test_the_table_of_pairs_has_the_exact_area_of_each(tmp_path, pairs):
    mesh, camera, poses = room()
    poses = np.concatenate([poses, poses])  # faces are closed after the first half
    task = rc.Task(max_incidence_deg=75)
    run(mesh, camera, poses, task, tmp_path / "r", Options(pictures=0, table=pairs))
    table = pq.read_table(tmp_path / "r" / "coverage.parquet")
    pose, face, result = (table[name].to_numpy() for name in ("pose", "face", "covered_m2"))
    expected = rc.regions(mesh, camera, poses, task).areas()
    np.testing.assert_allclose(result, expected[pose, face], rtol=1e-6)
    assert result.max() > 1
    assert table.schema.field("covered_m2").metadata == {b"unit": b"m^2"}
    if pairs != "covered":
        assert result.sum() == pytest.approx(expected.sum(), rel=1e-6)


def test_by_face_the_report_has_no_areas(tmp_path):
    summary = run(*room(), TASK, tmp_path, Options(pictures=0, by="face", table="seen"))
    assert (summary["by"], "covered_area" in summary) == ("face", False)
    assert not (tmp_path / "areas.parquet").exists()
    assert "covered_m2" not in pq.read_schema(tmp_path / "coverage.parquet").names
