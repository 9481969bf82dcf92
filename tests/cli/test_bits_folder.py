"""`evaluate --bits`: covered pairs of many poses in a folder, whole or not at all."""

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from commands import call
from gl_device import DEVICE
from plans import write_obj

import rastercov as rc
from rastercov.core.coverage import network
from rastercov.core.coverage.evaluation import Query
from rastercov.core.coverage.shards import EvaluationShards
from rastercov.core.raster.contract import CoverageBits
from rastercov.gl import GLRasterizer
from rastercov.report.bits import write_bits
from rastercov.shards import ALONE

CAMERA = rc.Camera.from_fov(64, 48, hfov_deg=50)
LINE = "evaluate part.obj --unit m -c camera.toml --max-incidence-deg 65 --method sampled --bits b"
FILES = {"packed.npy", "area_units.npy", "views.npy", "bits.json", ".rastercov-bits.json"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_obj("part.obj", rc.shapes.torus(14, 9))
    Path("camera.toml").write_text("width = 64\nheight = 48\nhfov_deg = 50\n")
    mesh = rc.Mesh.load("part.obj", unit="m")
    np.save("poses.npy", rc.sphere_of_poses((0, 0, 0), 2 * mesh.diagonal, 50))


def expected(fields=("covered",)):
    mesh, task = rc.Mesh.load("part.obj", unit="m"), rc.Task(max_incidence_deg=65)
    poses = np.load("poses.npy")
    return rc.evaluate(mesh, CAMERA, poses, task, method="sampled:cpu", fields=fields)


def check(result):
    found, bits = CoverageBits.open("b"), result.bits
    assert {each.name for each in Path("b").iterdir()} == FILES
    for name in ("packed", "area_units", "views", "areas"):
        np.testing.assert_array_equal(getattr(found, name), getattr(bits, name))
    np.testing.assert_array_equal(found.dense(slice(3, 9)), bits.dense(slice(3, 9)))
    assert isinstance(found.packed, np.memmap)
    told = json.loads(Path("b/bits.json").read_text())
    assert told["covered"] == result.network.summary()["covered_faces"]
    assert told["best"] == {"pose": bits.areas.argmax(), "area_m2": bits.areas.max()}


@pytest.mark.parametrize("views", ["", " --views 2 --min-angle-deg 20"])
def test_a_folder_has_the_bits_of_evaluate(capsys, views):
    code, out, err = call(capsys, f"{LINE} -p poses.npy{views}")
    assert code == 0, err
    if not views:
        check(expected())
    assert out.startswith("covered: ")
    assert "measured by rastercov" in out


@pytest.mark.matter("opengl")
def test_a_device_writes_the_bits_of_the_cpu(capsys, monkeypatch):
    monkeypatch.setattr(GLRasterizer, "_choose_plan", lambda self, plan: "compute")
    code, out, err = call(capsys, f"{LINE} -p poses.npy --device {DEVICE} --json")
    assert code == 0, err
    check(expected())
    assert json.loads(out)["run"]["measured_by"]["backend"] == "gl"


def test_an_interrupt_keeps_the_earlier_result_and_the_next_run_continues(capsys, monkeypatch):
    mesh = rc.Mesh.load("part.obj", unit="m")
    monkeypatch.setattr("rastercov.core.coverage.shards.PAIRS_OF_COUNTS", 8 * mesh.n_faces)
    call(capsys, f"{LINE} -p sphere:3")
    before = {name: Path("b", name).read_bytes() for name in FILES}
    honest, made = EvaluationShards.parts, []

    def interrupted(self, staff):
        for batch in honest(self, staff):
            yield batch
            made.append(len(batch.poses))
            if sum(made) == 24:
                raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(EvaluationShards, "parts", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_bits(query(mesh, np.load("poses.npy")), Path("b"), {}, ALONE)
    assert {name: Path("b", name).read_bytes() for name in FILES} == before
    (shards,) = Path("b/unfinished").glob("*/shards")
    kept = {each.name: each.stat().st_mtime_ns for each in shards.iterdir()}
    assert len(kept) >= 3
    measured = []
    judge = network.Network.judge
    monkeypatch.setattr(
        network.Network,
        "judge",
        lambda self, observer, poses, **kept: (
            measured.append(len(poses)) or judge(self, observer, poses, **kept)
        ),
    )
    write_bits(query(mesh, np.load("poses.npy")), Path("b"), {}, ALONE)
    assert sum(measured) <= 50 - 24
    check(expected())


def query(mesh, poses):
    engine = rc.Engine("sampled", "cpu")
    task = rc.Task(max_incidence_deg=65)
    return Query(mesh, CAMERA, rc.Poses.of(poses), task, engine, by="face")


def test_the_memory_is_that_of_a_batch_and_not_of_the_pairs():
    mesh = rc.Mesh.load("part.obj", unit="m")

    def peak(n):
        asked = query(mesh, rc.sphere_of_poses((0, 0, 0), 2 * mesh.diagonal, n))
        tracemalloc.start()
        write_bits(asked, Path(str(n)), {}, ALONE)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(10)  # what is made once
    few, many = peak(1000), peak(4000)
    assert (many - few) / 3000 < 4 * mesh.n_faces  # bytes a pose; of counts it is 8 a pair


@pytest.mark.parametrize(
    "more",
    ["--table covered", "--pictures 3", "--by area", "--before poses.npy", "--output x.json"],
)
def test_options_of_a_report_are_refused_with_bits(capsys, more):
    code, _, err = call(capsys, f"{LINE} -p poses.npy {more}")
    assert code == 2
    assert "expected --bits with --method, --supersample and --device alone" in err
    assert not Path("b").exists()


@pytest.mark.parametrize("content", [None, "{}", "no json", '{"unit_m2": 1.0}'])
def test_a_folder_without_bits_is_refused(content):
    if content is not None:
        Path("b").mkdir()
        Path("b/bits.json").write_text(content)
    with pytest.raises(rc.ConfigError, match="expected bits of evaluate --bits, got none"):
        CoverageBits.open("b")
