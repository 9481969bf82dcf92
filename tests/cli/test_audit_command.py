"""`rastercov audit`: the figures of the function, in tables, arrays and a coloured mesh."""

import json
import re

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import answer, done, refusal
from mesh_files import obj
from scipy.spatial.transform import Rotation

from rastercov.base.files import PROJECTS
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig, Views
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import shapes
from rastercov.formats.cameras import read_views, write_views
from rastercov.placement.audit import audit

MESH = shapes.torus(40, 20)
CAMERAS = (
    Camera(width=640, height=480, fx=500, fy=500, model="opencv", distortion=(-0.2, 0.02, 0, 0)),
    Camera(width=400, height=400, fx=400, fy=400),
)
POSES = Poses.of(sphere_of_poses(MESH.bounds.mean(axis=0), 4.0, 8), camera=[0, 1] * 4)
IMAGES = tuple(f"image {row}.jpg" for row in range(8))


@pytest.fixture(autouse=True)
def files(here):
    (here / "torus.obj").write_bytes(obj(MESH.vertices, MESH.faces))
    write_views("sparse", Views(Rig(CAMERAS, ["wide", "long"]), POSES, IMAGES))


@pytest.mark.slow
def test_files_of_an_audit_of_a_reconstruction_are_those_of_the_function(here, capsys):
    line = "audit sparse torus.obj --pose-unit 1 --min-pixels 4 -o out"
    summary, out = answer(capsys, line), here / "out"
    result = audit(MESH, CAMERAS, POSES, Task(min_pixels=4), names=IMAGES)
    assert summary["by"] == "face"
    assert json.loads((out / "audit.json").read_text())["per_camera"] == summary["per_camera"]
    elements = pq.read_table(out / "elements.parquet")
    np.testing.assert_array_equal(elements["views"].to_numpy(), result.views)
    np.testing.assert_allclose(elements["best_density_px_per_m"].to_numpy(), result.best_density)
    with np.load(out / "elements.npz") as arrays:
        np.testing.assert_array_equal(arrays["covered"], result.covered)
    cameras = pq.read_table(out / "cameras.parquet").to_pydict()
    assert (cameras["name"], len(set(cameras["camera"]))) == (list(IMAGES), 2)
    assert sum(cameras["in_subset"]) == len(result.subset.chosen)
    assert (out / "audit.glb").stat().st_size > 1000
    page = (out / "audit.html").read_text(encoding="utf-8")
    assert all(f">{name}</td>" in page for name in IMAGES)
    pictures = {path.name for path in out.glob("audit_*.png")}
    modes = {f"audit_{name}.png" for name in ("views", "density", "angle", "weak")}
    assert modes <= pictures


@pytest.mark.slow
def test_pinholes_are_audited_by_area(here, capsys):
    write_views("transforms.json", Views(Rig(CAMERAS[1:]), Poses.of(np.array(POSES)), IMAGES))
    content = json.loads((here / "transforms.json").read_text())
    content["frames"][3]["transform_matrix"][0][0] = 9  # no rotation
    (here / "transforms.json").write_text(json.dumps(content))
    line = "audit transforms.json torus.obj --pose-unit 1 -o out --skip-bad-poses"
    printed, error = done(capsys, line)
    summary, left_out = json.loads((here / "out/audit.json").read_text()), "pose 3 (from 0) skipped"
    assert summary["covered_area"]["m2"] > 0
    assert [entry["name"] for entry in summary["per_camera"]] == [*IMAGES[:3], *IMAGES[4:]]
    for text, words in ((printed, "7 images cover"), (printed, "patches"), (error, left_out),
                        ("".join(summary["notes"]), left_out)):  # fmt: skip
        assert words in text


@pytest.mark.slow
def test_without_scale_all_is_in_units_and_suggested_images_keep_their_promise(here, capsys):
    printed, error = done(capsys, "audit sparse torus.obj --views 6 --suggest 2 -o out")
    page = (here / "out/audit.html").read_text(encoding="utf-8")
    assert "no scale" in error
    for text in (printed, page):
        assert "units/px" in text
        assert not re.search(r"\d (m|mm|m²|cm²|mm/px)\b", text)
    assert '"unit": "unit"' in (here / "out/view.html").read_text(encoding="utf-8")
    told = json.loads((here / "out/audit.json").read_text())
    said, zones = told["suggested"], told["weak"]["zones"]
    eyes = read_views("out/suggested.json").poses.world_from_camera[:, :3, 3]
    np.testing.assert_allclose(eyes, [image["position"] for image in said["images"]], atol=1e-9)
    assert len(eyes) > 0
    for zone in zones[:3]:
        assert zone["advice"].partition("; take ")[0][1:] in page  # its images are those of all
    left = sum(zone["percent"] * zone["left_percent"] / 100 for zone in zones)
    assert left <= said["after"]["weak_percent"] + 1e-9
    joined = answer(capsys, "audit out/suggested_joined.json torus.obj --views 6 -o joined")
    assert joined["unit"] == "unit"
    items = joined["covered_percent"], joined["weak"]["percent"]
    np.testing.assert_allclose(items, [said["after"][f"{k}_percent"] for k in ("covered", "weak")])
    for image in re.findall(r"<img [^>]*>", page):
        assert re.search('alt="[^"]+"', image)


def test_pages_of_evaluate_and_audit_have_the_title_block_of_a_file(here, capsys):
    (here / "job.toml").write_text(
        'name = "x"\n[sheet]\ncustomer = "A & B"\nrevision = "C"\nnorth = 3\n'
    )
    commands = {
        "audit sparse torus.obj --pose-unit 1 --by face -o out": "audit.html",
        "evaluate torus.obj -c khepra -p sphere:2 --by face -o out2": "report.html",
    }
    block = "<dt>Customer</dt><dd>A &amp; B</dd></div><div><dt>Revision</dt><dd>C</dd>"
    for line, page in commands.items():
        done(capsys, f"{line} --sheet job.toml")
        (glob,) = here.glob(f"out*/{page}")
        assert block in glob.read_text()
        assert "North" not in glob.read_text()
    done(capsys, "sheet out2 --out plan.svg")
    assert "A &amp; B" in (here / "plan.svg").read_text()
    line = "evaluate torus.obj -c khepra -p sphere:2 -o no --sheet"
    for text, words in {
        "a = 1": "job.toml: expected a table [sheet] with the title block, got none",
        "sheet = 1": "job.toml: expected a table [sheet] with the title block, got none",
        "[sheet]\ncustomr = 'x'": "sheet: customr: expected one of author, customer, date, ",
        "[": "job.toml: expected valid TOML",
    }.items():
        (here / "job.toml").write_text(text)
        assert words in refusal(capsys, f"{line} job.toml")
    assert "none.toml: no such file" in refusal(capsys, f"{line} none.toml")


def test_what_cannot_be_audited_is_refused_in_one_line(here, capsys):
    np.save("poses.npy", np.array(POSES))
    assert "give --pose-unit" in refusal(capsys, "audit sparse torus.obj --unit mm -o out")
    for name, program in PROJECTS.items():
        (here / f"scan{name}").write_bytes(b"\x00\xff")
        for words, files in (("mesh", f"sparse scan{name}"), ("cameras", f"scan{name} torus.obj")):
            line = refusal(capsys, f"audit {files} -o out")
            assert words in line
            assert f"{program}; export " in line
    assert "expected poses and cameras, got only poses" in refusal(
        capsys, "audit poses.npy torus.obj --pose-unit 1 -o out"
    )
    assert not (here / "out").exists()


@pytest.mark.slow
def test_footprints_of_images_and_their_map(here, capsys):
    line = "audit sparse torus.obj --pose-unit 1 --resolution-of-result 0.5 -o out"
    files = "--footprints images.geojson --overlap-map map.png --map-cell 0.05"
    summary, content = (
        answer(capsys, f"{line} {files}"),
        json.loads((here / "images.geojson").read_text()),
    )
    figures = summary["footprints"]
    assert (figures["crs"], figures["surface"]) == (None, "the surface seen from above")
    assert [each["properties"] for each in content["features"]] == figures["images"]
    assert (here / "map.png").exists()
    assert len((here / "map.pgw").read_text().split()) == 6
    assert any(text.startswith("Footprints on the surface seen") for text in summary["sentences"])
    page = (here / "out/audit.html").read_text(encoding="utf-8")
    assert "Footprints of images" in page
    for more, words in (
        ("--footprints images.kml", "expected a CRS for KML"),
        ("--crs EPSG:4326", "expected --footprints or --overlap-map with --crs"),
        ("--overlap-map map.gif", "expected the suffix of --overlap-map"),
        ("--overlap-map map.tif --map-cell 0", "--map-cell: expected metres above 0"),
    ):
        assert words in refusal(capsys, f"{line} {more}")


@pytest.mark.slow
def test_footprints_of_an_odm_project_are_on_the_earth(here, capsys):
    pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'rastercov[geo]'")
    shots = {}
    for name, pose in zip(IMAGES, POSES.world_from_camera, strict=True):
        turn = Rotation.from_matrix(pose[:3, :3].T)
        shift = -pose[:3, :3].T @ pose[:3, 3]
        own = {"rotation": turn.as_rotvec().tolist(), "translation": shift.tolist()}
        shots[name] = {"camera": "c"} | own
    camera = {"projection_type": "perspective", "width": 640, "height": 480, "focal": 0.8}
    lla = {"latitude": 47.0, "longitude": 8.5, "altitude": 400.0}
    content = [{"cameras": {"c": camera}, "shots": shots, "reference_lla": lla}]
    (here / "opensfm").mkdir()
    (here / "opensfm/reconstruction.json").write_text(json.dumps(content))
    line = "audit opensfm torus.obj --pose-unit 1 --resolution-of-result 0.5 -o out"
    printed, error = done(capsys, f"{line} --footprints f.geojson --overlap-map m.tif")
    assert "coordinates: WGS 84 / UTM zone 32N (EPSG:32632)" in error
    assert "Footprints on the surface seen from above cover" in printed
    result = json.loads((here / "f.geojson").read_text())
    corners = np.array(result["features"][0]["geometry"]["coordinates"][0][0])
    assert np.abs(corners - (8.5, 47.0)).max() < 1e-4
    summary = json.loads((here / "out/audit.json").read_text())
    assert summary["footprints"]["crs"] == "WGS 84 / UTM zone 32N (EPSG:32632)"


@pytest.mark.slow
@pytest.mark.parametrize("suggest", ["", " --suggest 2"])
def test_a_page_suggests_images_once(here, capsys, suggest):
    """Those of single zones, unless the audit suggests images for all."""
    done(capsys, f"audit sparse torus.obj --pose-unit 1 --views 6{suggest} -o out")
    told = json.loads((here / "out/audit.json").read_text(encoding="utf-8"))
    page = (here / "out/audit.html").read_text(encoding="utf-8")
    cards = page.partition("<h2>Weak zones</h2>")[2].partition("<h2>")[0]
    assert "<h3>Zone 1" in cards
    advice = told["weak"]["zones"][0]["advice"]
    assert "; take " in advice
    assert ("; take " in cards) == (not suggest)
    assert ("<h2>Images to take next</h2>" in page) == bool(suggest)
    for image in told.get("suggested", {"images": ()})["images"]:
        assert ", ".join(f"{value:.3f}" for value in image["position"]) in page
