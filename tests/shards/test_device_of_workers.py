"""Workers of this machine open the device of their run: its folder does not tell the number."""

import json

import devices_of_worker
import pytest

import rastercov as rc
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.raster.contract import RasterizerInfo
from rastercov.gl import devices
from rastercov.placement.matrix import build_matrix
from rastercov.shards import ShardStore, Workers, make_shards
from rastercov.shards import run as run_module

MESH = rc.shapes.box((0.2, 0.2, 0.2))
CAMERA = rc.Camera.from_fov(64, 48, hfov_deg=60)
POSES = rc.look_at([(0.6, 0, 0), (0, 0, 0.6)], (0, 0, 0))


@pytest.mark.parametrize(("device", "opened"), [("egl:1", "egl:1"), ("", "egl:0")])
def test_a_worker_opens_the_device_of_its_run_unless_another_is_named(tmp_path, device, opened):
    store = ShardStore(tmp_path, "{}", 1, 1, devices_of_worker.FUNCTION, device=device)
    make_shards(Workers(1), store, lambda made: None, print)
    assert json.loads(store.read(0)) == [opened, opened, "egl:0", "egl:0", "egl:1"]


def evaluate(opened, monkeypatch, folder):
    monkeypatch.setattr("rastercov.core.coverage.job.open_for", lambda *given: opened)
    options = {"method": "sampled:cpu", "shards": (folder, Workers(1))}
    rc.evaluate(MESH, CAMERA, POSES, **options)


def matrix(opened, monkeypatch, folder):
    build_matrix(opened, POSES, None, folder, workers=Workers(1))


@pytest.mark.parametrize("start", [evaluate, matrix])
@pytest.mark.parametrize(
    ("device", "backend", "told"),
    [
        ("egl:1 (/dev/dri/card2, NVIDIA H200)", "gl", "egl:1"),
        ("surfaceless (EGL without a surface, software)", "gl", "surfaceless"),
        ("cpu", "cpu", ""),
    ],
)
def test_a_run_tells_its_workers_the_device_it_has_opened(
    tmp_path, monkeypatch, start, device, backend, told
):
    stores = []

    def hear(workers, store, done, note):
        stores.append(store)
        raise ZeroDivisionError

    monkeypatch.setattr(run_module, "make_shards", hear)
    opened = open_observer(MESH, CAMERA, "sampled:cpu")
    opened.info = RasterizerInfo(backend, "compute", "stand-in", "", device, "float32", "")
    with pytest.raises(ZeroDivisionError):
        start(opened, monkeypatch, tmp_path / "shards")
    assert [store.device for store in stores] == [told]


def test_the_number_of_a_device_is_read_from_its_label():
    for device in (*devices_of_worker.LISTED, devices.SURFACELESS, devices.OSMESA):
        assert str(device).split()[0] == device.label
