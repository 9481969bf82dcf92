"""`run` leaves one consistent report, whole or up to an interrupt, for runs of any length."""

import hashlib
import json
import math
import signal
import sys
from dataclasses import asdict, replace
from importlib.metadata import version
from itertools import count
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest
from commands import content
from lens_cameras import CAMERAS
from PIL import Image

from rastercov import shaders
from rastercov.base.errors import ConfigError, DeviceError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.job import evaluate
from rastercov.core.coverage.judging import CHOICES
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster import open_rasterizer
from rastercov.core.raster.contract import BoundKind
from rastercov.reference.coverage import rows_of
from rastercov.report import coverage, coverage_files
from rastercov.report.coverage import EVALUATION, OF_GROUPS, Options, run
from rastercov.report.folder import ReportFolder
from rastercov.report.parquet import CoverageTable
from rastercov.shards import Staff

MESH = shapes.box((1, 1, 1))
CAMERA = Camera(width=48, height=36, fx=60, fy=60)
TASK = Task(min_pixels=4, max_incidence_deg=80)
PLAIN = Options(pictures=0, table="seen")
FILES = {"coverage.parquet", "rig.json", "summary.json", "network.glb"}
"""Of a run without pictures."""


def around(count):
    return sphere_of_poses((0, 0, 0), 3, count)


def names(folder):
    """Names in a folder, without that of the manifest of a report, which must be there."""
    items = {path.name for path in folder.iterdir()}
    assert EVALUATION.manifest in items
    return items - {EVALUATION.manifest}


@pytest.fixture
def small_batches(monkeypatch):
    """Four poses a batch."""
    monkeypatch.setattr("rastercov.core.coverage.coverage.PAIRS_A_BATCH", 4 * MESH.n_faces)


def stop_after(done_at):
    def progress(done, total):
        if done >= done_at:
            raise KeyboardInterrupt

    return Staff(progress=progress)


# --- what is written ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("choice", CHOICES)
def test_the_files_hold_what_evaluate_gives_and_the_table_the_pairs_asked_for(
    tmp_path, small_batches, choice
):
    poses = around(10)
    plain = run(MESH, CAMERA, poses, TASK, tmp_path, PLAIN)
    summary = run(MESH, CAMERA, poses, TASK, tmp_path, replace(PLAIN, table=choice))
    assert json.loads((tmp_path / "summary.json").read_text()) == json.loads(json.dumps(summary))
    result = evaluate(MESH, CAMERA, poses, TASK, by="face")
    rows = rows_of(result, choice)
    assert summary["table"] == {"pairs": choice, "rows": len(rows["pose"])}
    assert names(tmp_path) == FILES - ({"coverage.parquet"} if choice == "none" else set())
    assert {"run", *changed(plain, summary)} <= {"run", "table", "seconds", "poses_per_second"}
    means = [row["mean_coverage"] for row in summary["per_pose"]]
    np.testing.assert_allclose(means, result.coverage.mean(axis=1))
    assert summary["poses_per_second"] == pytest.approx(10 / summary["seconds"])
    if choice != "none":
        table = pq.read_table(tmp_path / "coverage.parquet")
        for name in set(rows) - {"reason", "visibility_kind"}:
            np.testing.assert_array_equal(table[name], rows[name], err_msg=name)
        assert set(table["group"].to_pylist()) == {"mesh"}
        for name, kind in (("reason", Reason), ("visibility_kind", BoundKind)):
            words = [kind(row).name.lower() for row in rows[name]]
            assert table[name].to_pylist() == words


def changed(before, after):
    """Keys of two summaries whose values differ."""
    assert before.keys() == after.keys()
    return {key for key in before if before[key] != after[key]}


@pytest.mark.parametrize("by", ["area", "face"])
def test_tables_are_written_only_where_they_are_asked_for(tmp_path, monkeypatch, by):
    """Without them a report neither needs nor loads pyarrow."""
    parquet = "rastercov.report.parquet"
    for name in [each for each in sys.modules if each.startswith(("pyarrow", parquet))]:
        monkeypatch.delitem(sys.modules, name)
    options = replace(PLAIN, by=by)
    for table in ("none", OF_GROUPS, "covered"):
        run(MESH, CAMERA, around(2), Task(), tmp_path, replace(options, table=table))
        items = {name for name in names(tmp_path) if name.endswith(".parquet")}
        own = "groups" if table == OF_GROUPS else "coverage"
        areas = {"areas.parquet"} if by == "area" else set()
        assert items == (set() if table == "none" else {f"{own}.parquet"} | areas)
        if table == "none":
            assert not any(name.startswith(("pyarrow", parquet)) for name in sys.modules)


def test_the_header_says_what_made_the_report(tmp_path):
    path = tmp_path / "part.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    mesh = Mesh.load(path, unit="mm", two_sided=["part"])
    options = replace(PLAIN, method="sampled", device="surfaceless")
    summary = run(mesh, CAMERA, around(2), TASK, tmp_path / "report", options)
    metadata = pq.read_schema(tmp_path / "report" / "coverage.parquet").metadata
    of_page = ("sheet", "level", "names", "output")
    given = {name: value for name, value in asdict(options).items() if name not in of_page}
    header = json.loads(metadata[b"rastercov"])
    assert header == json.loads(json.dumps(summary["run"]))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert header["mesh"] == [{"name": "part.off", "sha256": digest, "n_faces": 1}]
    group = {"name": "part", "is_occluder": False, "is_two_sided": True}
    assert (header["scene"]["n_faces"], header["scene"]["groups"]) == (1, [group])
    assert header["poses"]["n_poses"] == 2
    assert Camera.from_dict(header["camera"]) == CAMERA
    assert (header["task"], header["options"]) == (TASK._entries(), given)
    assert header["measured_by"]["shaders"] == shaders.digest()
    assert header["measured_by"]["renderer"]
    expected = {"rastercov": version("rastercov"), "numpy": np.__version__}
    assert header["versions"].items() >= expected.items()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wanted", "drawn", "full", "kinds"),
    [(0, [], "all", ()), (1, [0], "none", ()), (3, [0, 4, 9], "poses", ("pose",)),
     (99, range(10), "none", ()), (2, [0, 9], "faces", ("faces",)),
     (2, [0, 9], "all", ("pose", "faces"))],
)  # fmt: skip
def test_pictures_are_spread_evenly_and_full_ones_drawn_on_request(
    tmp_path, wanted, drawn, full, kinds
):
    large = Camera(width=4000, height=1000, fx=4000, fy=4000) if kinds else CAMERA
    run(MESH, large, around(10), TASK, tmp_path, Options(pictures=wanted, full=full, table="seen"))
    sizes = {}
    for path in tmp_path.glob("*.png"):
        with Image.open(path) as picture:
            sizes[path.name] = picture.size
    full_ones = {f"{kind}_{pose}.png" for kind in kinds for pose in drawn}
    pages = {"contact_sheet.png", "overview.png", "view.html", "report.html"} if wanted else set()
    assert names(tmp_path) == FILES | pages | full_ones
    assert all((sizes[name][0], sizes[name][1] >= 320) == (1280, True) for name in full_ones)
    width = math.ceil(math.sqrt(len(drawn))) * (320 + 8) + 8
    assert sizes.get("contact_sheet.png", (width,))[0] == width


def test_a_sheet_is_drawn_at_its_size(tmp_path, monkeypatch):
    """Not at that of the camera: of 12 poses that was most of the time of a run."""
    cameras = []

    def opened(mesh, camera, *arguments, **options):
        cameras.append(camera)
        return open_rasterizer(mesh, camera, *arguments, **options)

    monkeypatch.setattr("rastercov.report.coverage.open_rasterizer", opened)
    large = Camera(width=2560, height=1600, fx=2560, fy=2560)
    for camera in (large, CAMERAS["brown"]):  # as its lens shows it
        run(MESH, camera, around(2), TASK, tmp_path, Options(pictures=2, by="face"))
        assert cameras.pop() == camera.resized(2 * 320 / camera.width)
        with Image.open(tmp_path / "contact_sheet.png") as sheet:
            assert sheet.width == 2 * 320 + 3 * 8


# --- when something is wrong ----------------------------------------------------------------------


lost = Mock(side_effect=DeviceError("gone"))


@pytest.mark.slow
@pytest.mark.parametrize("step", ["camera_pixels", "contact_sheet", "NetworkPage",
                                  "write_coloured_mesh", "progress", "first batch"])  # fmt: skip
def test_a_run_that_fails_leaves_the_old_report(tmp_path, small_batches, monkeypatch, step):
    run(MESH, CAMERA, around(6), TASK, tmp_path, Options(pictures=2))
    before, staff, error = content(tmp_path), Staff(), DeviceError
    if step == "first batch":  # nothing is done yet
        staff, error = stop_after(0), KeyboardInterrupt
    elif step == "progress":
        staff = Staff(progress=lambda done, total: done >= 4 and lost())
    else:
        owner = coverage_files if step == "write_coloured_mesh" else coverage
        monkeypatch.setattr(owner, step, lost)
    with pytest.raises(error):
        run(MESH, CAMERA, around(12), TASK, tmp_path, Options(pictures=2, table="seen"), staff)
    assert content(tmp_path) == before


@pytest.mark.parametrize(("done_at", "done"), [(1, 4), (8, 8)])
def test_an_interrupt_keeps_whole_batches(tmp_path, small_batches, done_at, done):
    whole = run(MESH, CAMERA, around(12), TASK, tmp_path / "whole", PLAIN)
    part = run(MESH, CAMERA, around(12), TASK, tmp_path / "part", PLAIN, stop_after(done_at))
    assert (part["interrupted"], part["poses"]) == (True, done)
    assert part["per_pose"] == whole["per_pose"][:done]
    assert json.loads((tmp_path / "part" / "summary.json").read_text())["interrupted"] is True
    kept, rows = (pq.read_table(tmp_path / run / "coverage.parquet") for run in ("part", "whole"))
    assert kept.equals(rows.filter(np.asarray(rows["pose"]) < done))


@pytest.mark.parametrize("step", ["camera_pixels", "_draw_network"])  # the sheet has what was drawn
def test_an_interrupt_while_drawing_leaves_out_the_rest_and_says_so(tmp_path, monkeypatch, step):
    run(MESH, CAMERA, around(5), TASK, tmp_path, Options(pictures=5))
    function, calls = getattr(coverage, step), count(1 if step == "camera_pixels" else 3)

    def stop(*arguments, **options):
        if next(calls) == 3:
            raise KeyboardInterrupt
        return function(*arguments, **options)

    monkeypatch.setattr(coverage, step, stop)
    summary = run(MESH, CAMERA, around(12), TASK, tmp_path, Options(table="seen"))
    assert (summary["interrupted"], summary["poses"]) == (True, 12)
    assert names(tmp_path) == FILES | {"contact_sheet.png"}
    assert json.loads((tmp_path / "summary.json").read_bytes())["interrupted"] is True
    assert pq.read_table(tmp_path / "coverage.parquet")["pose"].to_numpy().max() == 11


def interrupting(monkeypatch, name, is_now=lambda *arguments: True):
    """Let the table of a run be interrupted by Ctrl-C in a method of it."""
    method = getattr(CoverageTable, name)

    def interrupt(table, *arguments):
        if is_now(*arguments):
            signal.raise_signal(signal.SIGINT)
        return method(table, *arguments)

    monkeypatch.setattr(CoverageTable, name, interrupt)


@pytest.mark.usefixtures("raising_interrupts")
def test_an_interrupt_while_the_table_is_closed_comes_after_it(tmp_path, monkeypatch):
    interrupting(monkeypatch, "__exit__")
    summary = run(MESH, CAMERA, around(6), TASK, tmp_path, PLAIN)
    assert (summary["interrupted"], summary["poses"]) == (True, 6)
    assert names(tmp_path) == FILES


@pytest.fixture
def raising_interrupts():
    """Interrupts raise, whatever the test runner does with them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("raising_interrupts", "small_batches")
def test_a_signal_in_a_batch_counts_it_everywhere_or_nowhere(tmp_path, monkeypatch):
    interrupting(monkeypatch, "add", lambda batch, covered_m2: batch["pose"][0] == 4)
    summary = run(MESH, CAMERA, around(12), TASK, tmp_path, PLAIN)
    assert summary["poses"] == 8
    assert np.asarray(pq.read_table(tmp_path / "coverage.parquet")["pose"]).max() == 7


def test_progress_tells_the_poses_done(tmp_path, small_batches):
    calls = []
    run(MESH, CAMERA, around(10), TASK, tmp_path, PLAIN, Staff(progress=lambda *a: calls.append(a)))
    assert calls == [(0, 10), (4, 10), (8, 10), (10, 10)]


def test_a_folder_that_cannot_be_used_is_refused_before_a_device_is_opened(tmp_path, monkeypatch):
    run(MESH, CAMERA, around(2), TASK, tmp_path / "used", PLAIN)
    (tmp_path / "taken").mkdir()
    for name in ("file", "taken/view.html", "taken/coverage.parquet"):
        (tmp_path / name).write_text("mine")
    before = content(tmp_path)
    monkeypatch.setattr("rastercov.core.coverage.job.open_for", lambda *_: pytest.fail("opened"))
    with ReportFolder(tmp_path / "used", EVALUATION):
        for out in ("file", "file/report", "taken", "used"):
            with pytest.raises(ConfigError):
                run(MESH, CAMERA, around(1), TASK, tmp_path / out, Options())
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(ConfigError, match="expected a writable folder"):
        run(MESH, CAMERA, around(1), TASK, tmp_path / "used", PLAIN)
    assert content(tmp_path) == before
