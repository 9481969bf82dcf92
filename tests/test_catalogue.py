"""Cameras that are sold: the derived camera against published angles, pairs, prices, own files."""

import itertools
import json
import math

import pytest

import rastercov as rc
from rastercov.camera.catalogue import catalogue, has_lens, misfit, price_of
from rastercov.cli import command
from rastercov.placement.plan.file import PlanError, plan_of

PUBLISHED = {  # degrees across the image, by the makers; none of them is in the catalogue
    "rpi-hq+rpi-16mm": 22.2,
    "rpi-hq+rpi-6mm": 55,
    "rpi-gs+rpi-16mm": 17.8,
    "rpi-gs+rpi-6mm": 45,
    "rpi-hq-m12+rpi-25mm-m12": 14.4,
    "rpi-cm1": 53.5,
    "rpi-cm2": 62.2,
}
ACROSS_CORNERS = {
    "dji-phantom4rtk": 84,
    "hikvision-2143g2-28mm": 122,
    "hikvision-2143g2-4mm": 99.7,
    "sony-a7m3+sony-sel24f14gm": 84,
    "sony-a7m3+sony-sel28f20": 75,
}
OWN = """
[cameras]
ours = { width = 4000, height = 3000, pixel_size = 2e-6, mount = "C", price = 300 }
flir-bfs-u3-51s5 = { price = 900 }
[lenses]
fujinon-hf12xa-5m = { price = 150 }
"""


def angle(camera, *ends):
    a, b = rc.camera.projection.rays_of(rc.camera.projection.np.array(ends, float), camera)
    return math.degrees(math.acos(a @ b / math.sqrt((a @ a) * (b @ b))))


def test_derived_cameras_have_the_published_angles_of_view():
    for name, degrees in PUBLISHED.items():
        camera = rc.Camera.load(name)
        ends = (0, camera.cy), (camera.width, camera.cy)
        assert angle(camera, *ends) == pytest.approx(degrees, rel=0.01), name
    for name, degrees in ACROSS_CORNERS.items():
        camera = rc.Camera.preset(name)
        assert angle(camera, (0, 0), (camera.width, camera.height)) == pytest.approx(degrees, 0.01)
    camera = rc.Camera.from_dict({"preset": "rpi-hq+rpi-16mm", "focus_distance": 1.0})
    assert camera.fx == pytest.approx(16e-3 / 1.55e-6)
    blur = 1.55e-6 / (16e-3 / 1.4) * (1 - 16e-3) / 16e-3  # (3.10), one pixel, at f/1.4
    assert camera.depth_of_field() == pytest.approx((1 / (1 + blur), 1 / (1 - blur)))


def test_every_model_has_its_source_and_every_camera_is_one():
    shop = catalogue()
    assert len(shop.cameras) > 30
    entries = [*shop.cameras.values(), *shop.lenses.values()]
    assert sum(each["source"].startswith("https://") for each in entries) == len(entries) - 2
    for name, lens in shop.lenses.items():
        assert 1 < lens["f_numbers"][0] <= lens["f_numbers"][1] < 40, name
    for name in shop.names():
        assert rc.Camera.preset(name).width >= 720
    for camera, lens in itertools.product(shop.cameras, shop.lenses):
        fits = not misfit(shop.cameras[camera], shop.lenses[lens])
        assert fits == (f"{camera}+{lens}" in set(shop.names()))
        assert fits <= (not has_lens(shop.cameras[camera]))


REFUSED = {
    "flir-bfs-u3-51s": "among the cameras of the catalogue; there are flir-bfs-u3-51s5",
    "rpi-hq+rpi-6m": "among the lenses of the catalogue; there are rpi-6mm",
    "sony-a7m4+rpi-16mm": "mount of the camera is E, that of the lens is C; .* sony-sel35f18f",
    "flir-bfs-u3-244s8+fujinon-hf8xa-5m": "11 mm is smaller than the sensor, 19.3 mm",
    "rpi-cm2+rpi-6mm": "has a lens of its own",
    "rpi-hq": "give rpi-hq.LENS or focal_length; lenses: .*",
    "basler-aca1300-200um+rpi-6mm": "the camera is C, that of the lens is CS",
}


@pytest.mark.parametrize("name", REFUSED)
def test_impossible_pairs_and_unknown_names_are_one_line(name, capsys):
    with pytest.raises(rc.CameraError, match=REFUSED[name]) as caught:
        rc.Camera.preset(name)
    assert command(["evaluate", "box", "-c", name, "-p", "sphere:1", "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(caught.value).split(";")[0] in error


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"f_number": 1.2, "focus_distance": 1}, "f_number of .* 1.4 to 16, got 1.2"),
     ({"focus_distance": 0.1}, "focuses from 0.2 m on, got 0.1 m")],
)  # fmt: skip
def test_what_a_lens_does_not_do_is_refused(changes, words):
    with pytest.raises(rc.CameraError, match=words):
        rc.Camera.from_dict({"preset": "rpi-hq+rpi-16mm"} | changes)
    assert rc.Camera.from_dict(
        {"preset": "rpi-hq", "focal_length": 8e-3} | changes | {"f_number": 4}
    )


def test_a_file_of_the_user_adds_models_and_prices(tmp_path, monkeypatch, capsys):
    (tmp_path / "own.toml").write_text(OWN)
    types = {"a": {"preset": "ours+fujinon-hf12xa-5m"},
             "b": {"preset": "flir-bfs-u3-51s5+fujinon-hf12xa-5m", "cost": 5},
             "c": {"preset": "flir-bfs-u3-51s5+fujinon-hf12xa-5m"}}  # fmt: skip
    entries = {"meshes": [{"built_in": "box"}], "cameras": types, "catalogue": "own.toml"}
    plan = plan_of(entries, tmp_path / "plan.toml")
    assert [plan.cost_of(name, None) for name in types] == [450, 5, 1050]
    assert plan.cost_of("a", 50) == 500
    assert plan.rig.cameras[0].fx == pytest.approx(6000)
    types["d"] = {"preset": "rpi-hq+fujinon-hf8xa-5m"}
    with pytest.raises(
        PlanError, match=r"cameras\.d: there is no price, as of others; give its cost"
    ):
        plan_of(entries, tmp_path / "plan.toml")
    monkeypatch.setenv("RASTERCOV_CATALOGUE", str(tmp_path / "own.toml"))
    assert price_of("ours+fujinon-hf12xa-5m") == 450
    assert command(["cameras", "--hfov=35", "--max-price=500", "--min-pixels=5e6", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["cameras"]
    assert {each["name"]: each["price"] for each in found}["ours+fujinon-hf12xa-5m"] == 450
    assert all(31.5 <= each["hfov_deg"] <= 38.5 and each["price"] <= 500 for each in found)
    assert command(["cameras", "hf12xa", "--mount", "C"]) == 0
    assert "fujinon-hf12xa-5m 12 1.6-16    11     0.1     C     150" in capsys.readouterr().out
    for text in (
        "[cameras]\nx = 3",
        "[shop.x]\na = 1",
        "[lenses.x]\nprice = 3",
        "cameras = 1",
        "x",
    ):
        (tmp_path / "own.toml").write_text(text)
        assert command(["cameras"]) == 2
        assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'own.toml'}: ")
