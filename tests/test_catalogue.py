"""Cameras that are sold: the derived camera against published angles, pairs, prices, own files."""

import json
import math
import re

import numpy as np
import pytest

import rastercov as rc
from rastercov.cli import command
from rastercov.core.camera.catalogue import KINDS, catalogue, misfit
from rastercov.core.camera.projection import rays_of
from rastercov.core.camera.rig import preset_rig
from rastercov.core.camera.viewpoints import fibonacci_sphere
from rastercov.light.lamps import illuminances, points_of
from rastercov.placement.plan.file import PlanError, plan_of

PUBLISHED = {  # degrees across the image by the makers, which the catalogue does not have
    "rpi-hq+rpi-16mm": 22.2,
    "rpi-hq+rpi-6mm": 55,
    "rpi-gs+rpi-16mm": 17.8,
    "rpi-hq-m12+rpi-25mm-m12": 14.4,
    "rpi-cm1": 53.5,
    "rpi-cm2": 62.2,
    "oak-ffc-imx378": 66,
    "mynteye-s1030": 122,
}
ACROSS_CORNERS = {"dji-phantom4rtk": 84, "hikvision-2143g2-28mm": 122, "hikvision-2143g2-4mm": 100}
OWN = """
[cameras]
ours = { width = 4000, height = 3000, pixel_size = 2e-6, mount = "C", price = 300 }
flir-bfs-u3-51s5 = { price = 900 }
[lenses]
fujinon-hf12xa-5m = { price = 150 }
"""


def test_derived_cameras_have_the_published_angles_of_view():
    for name, degrees in {**PUBLISHED, **ACROSS_CORNERS}.items():
        camera = rc.Camera.load(name)
        top = 0 if name in ACROSS_CORNERS else camera.cy
        a, b = rays_of(np.array([(0, top), (camera.width, camera.height - top)]), camera)
        angle = math.acos(a @ b / math.sqrt((a @ a) * (b @ b)))
        assert math.degrees(angle) == pytest.approx(degrees, rel=0.01), name
    camera = rc.Camera.from_dict({"preset": "rpi-hq+rpi-16mm", "focus_distance": 1.0})
    blur = 1.55e-6 / (16e-3 / 1.4) * (1 - 16e-3) / 16e-3  # (3.10), one pixel, at f/1.4
    assert camera.depth_of_field() == pytest.approx((1 / (1 + blur), 1 / (1 - blur)))


def test_every_model_has_its_source_and_every_pair_that_fits_is_a_camera():
    shop = catalogue()
    assert all(each["source"] for table in shop for each in table.values())
    names = set(shop.names())
    assert all(rc.Camera.preset(name).width >= 628 for name in names)
    for camera, one in shop.cameras.items():
        fitting = {f"{camera}+{lens}" for lens, its in shop.lenses.items() if not misfit(one, its)}
        assert fitting == {name for name in names if name.startswith(f"{camera}+")}


def test_scanners_have_a_pixel_a_beam_and_reach_as_far_as_their_sheets_say():
    for name, low, high, step, reach in (
        ("vlp16", -15, 15, 0.199, (1, 100)),
        ("tls-360", -60, 90, 0.036, (0.6, 70)),
    ):
        camera = rc.Camera.load(name)
        assert camera.depth_of_field() == reach
        at = camera.width / 2
        rays = rays_of(
            np.array([(at, camera.height - 1e-6), (at, 1e-6), (at + 1, camera.cy)]), camera
        )
        ends = np.degrees(np.arcsin(-rays[:2, 1] / np.linalg.norm(rays[:2], axis=1)))
        assert ends == pytest.approx((low, high), abs=0.02)
        assert math.degrees(math.atan2(rays[2, 0], rays[2, 2])) == pytest.approx(step, abs=2e-4)


def test_a_head_is_two_cameras_side_by_side_that_measure_together(tmp_path, capsys):
    head = rc.Rig.preset("stereo:0.3:rpi-gs+rpi-16mm")
    assert head.cameras == (rc.Camera.preset("rpi-gs+rpi-16mm"),) * 2
    assert np.ptp(head.rig_from_camera[:, :3, 3], axis=0).tolist() == [0.3, 0, 0]
    assert head.rule == rc.All()
    usual = rc.Rig.preset("stereo:0.12")
    assert usual.cameras == rc.Rig.preset("stereo").cameras == (rc.Camera.preset("zed"),) * 2
    across = math.degrees(2 * math.atan(usual.cameras[0].width / 2 / usual.cameras[0].fx))
    assert across == pytest.approx(76, abs=0.6)
    (tmp_path / "own.toml").write_text('[heads]\nours = { camera = "khepra", baseline = 0.2 }')
    own = preset_rig("ours", tmp_path / "own.toml")
    assert own.rig_from_camera[1, 0, 3] == 0.2
    assert own.cameras[0].width == 1280
    head = {"preset": "ours:0.25", "min_baseline_deg": 3}
    entries = {"meshes": [{"built_in": "box"}], "rigs": {"eyes": head}, "catalogue": "own.toml"}
    plan = plan_of(entries, tmp_path / "plan.toml")
    assert plan.rig.names == ("eyes/left", "eyes/right")
    assert plan.rig.gates[0].least_deg == 3
    assert command(["cameras", "stereo", "--json"]) == 0
    [listed] = json.loads(capsys.readouterr().out)["heads"]
    assert command(["cameras", "depth"]) == 0
    assert capsys.readouterr().out.startswith("no entry matches; ")
    assert (listed["name"], listed["camera"]) == ("stereo", "zed")
    for name, words in (
        ("stereo:wide", "a baseline in metres, got 'wide'"),
        ("stereo:-1", "got '-1'"),
        ("stereo:120", "up to 10 m, got 120; it is in metres, stereo:0.12 for 120 mm"),
        ("stereo:1:none", "cameras of the catalogue, got 'none'"),
        ("mono:1", "expected a head NAME"),
    ):
        with pytest.raises(rc.CameraError, match=words) as error:
            rc.Rig.preset(name)
        assert "\n" not in str(error.value)


RANGES = {  # metres between the centres, and of the range, of the sheets
    "mynteye-s1030": (0.12, 0.8, 5),
    "mynteye-d1000-50": (0.12, 0.49, 10),
    "realsense-r200": (0.07, 0.7, 3.5),
    "gemini-305": (0.018, 0.04, 1),
    "kinect-v1": (0.075, 0.8, 4),
}


@pytest.mark.parametrize("name", RANGES)
def test_a_head_measures_from_its_least_range_on(name):
    head, (baseline, low, high) = rc.Rig.preset(name), RANGES[name]
    assert head.rig_from_camera[:, 0, 3].tolist() == [0, baseline]
    assert all(eye.depth_of_field() == (low, high) for eye in head.cameras)
    assert head.names == (("camera", "projector") if name == "kinect-v1" else ("left", "right"))
    sheet = rc.shapes.box((0.2 * low, 0.2 * low, 1e-3))
    for distance, is_measured in ((0.9 * low, False), (1.1 * low, True), (1.1 * high, False)):
        poses = head.poses(rc.look_at((0, 0, distance + 5e-4), (0, 0, 0), up=(0, 1, 0)))
        result = rc.evaluate(sheet, head, poses, by="area", fields=())
        assert (result.covered.area.sum() > 0) == is_measured, distance


def sheets():
    """Flux, lm or W, and half angle where there is one, of lamps, by their sources."""
    for name, own in catalogue().lamps.items():
        text, area = own["source"], np.prod(own.get("size", 0))
        flux = re.search(r"([\d.]+) (lm|mW|W|klux at 0 mm)$", text)
        half = re.search(r"half at ([\d.]+) degrees", text)
        beam = re.search(r"([\d.]+) degrees, \d+ lm$", text) if own["kind"] == "spot" else None
        units = {"lm": 1, "mW": 1e-3, "W": 1, "klux at 0 mm": 1e3 * area}
        angle = float(half[1]) if half else float(beam[1]) / 2 if beam else None
        yield name, flux and float(flux[1]) * units[flux[2]], angle


def test_lamps_of_the_catalogue_have_the_flux_and_the_angle_of_their_sheets(tmp_path, capsys):
    """Of light around a lamp, by 4,000 directions to far points: the sum of I."""
    n_flux, n_angles = 0, 0
    for name, flux, angle in sheets():
        text = f'[lamps.a]\npreset = "{name}"\nposition = [0, 0, 0]\n'
        (tmp_path / "lamps.toml").write_text(text)
        lamps = rc.load_lamps(tmp_path / "lamps.toml")
        (lamp,) = lamps.lamps
        assert lamp.kind == catalogue().lamps[name]["kind"]
        if angle is not None:
            n_angles += 1
            share = np.cos(np.radians(angle)) ** lamp.exponent
            assert share == pytest.approx(0.5, rel=0.005), name
        if flux is None:
            continue
        n_flux += 1
        half, far = fibonacci_sphere(2000, 1.0), 1e3
        rays = np.r_[half, -half]
        points = points_of(lamps, np.ones(1, bool))
        sees = points.world_from_camera[:, :3, 2] @ rays.T > 0
        result = illuminances(lamps, points, sees, far * rays, rays)
        near = 0.01 if name.startswith("basler") else 0.2
        assert result.sum() * far**2 * 4 * np.pi / 4000 == pytest.approx(flux, rel=near), name
    assert (n_flux, n_angles) == (39, 9)
    text = '[lamps.a]\npreset = "basler-dome-200-white"\nposition = [0, 0, 0]\n'
    (tmp_path / "lamps.toml").write_text(f'{text}range = "3 m"\npoints = 4\n')
    (lamp,) = rc.load_lamps(tmp_path / "lamps.toml").lamps
    assert (lamp.range_m, lamp.intensity, lamp.points, lamp.size) == (3, None, 4, (0.2, 0))
    (tmp_path / "lamps.toml").write_text('[lamps.a]\npreset = "basler-x"\nposition = [0, 0, 0]\n')
    with pytest.raises(rc.CameraError, match="a lamp of the catalogue, such as basler-"):
        rc.load_lamps(tmp_path / "lamps.toml")
    assert command(["cameras", "back-50x100", "--json"]) == 0
    [listed] = json.loads(capsys.readouterr().out)["lamps"]
    assert listed["size"] == [0.05, 0.1]
    assert "71 klux at 0 mm" in listed["source"]


REFUSED = {
    'preset = "flir-bfs-u3-51s"': "cameras of the catalogue, got .*; try flir-bfs-u3-51s5",
    'preset = "sony-a7rm5+rpi-16mm"': "the camera is E, that of the lens is C; .* sony-sel35f18f",
    'preset = "flir-bfs-u3-244s8+fujinon-hf8xa-5m"': "11 mm is smaller than the sensor, 19.3 mm",
    'preset = "rpi-cm2+rpi-6mm"': "has a lens of its own",
    'preset = "rpi-hq"': "give focal_length or rpi-hq.LENS, such as .*",
    'preset = "rpi-hq+rpi-16mm", f_number = 1.2, focus_distance = 1': "1.4 to 16, got 1.2",
    'preset = "rpi-hq+rpi-16mm", focus_distance = 0.1': "0.2 m or more, got 0.1 m",
}


def test_what_does_not_fit_is_one_line(capsys):
    for entries, words in REFUSED.items():
        assert command(["evaluate", "box", "-c", entries, "-p", "sphere:1"]) == 2
        assert re.fullmatch(f"error: .*{words}.*\n", capsys.readouterr().err)


def test_a_file_of_the_user_adds_models_and_prices(tmp_path, monkeypatch, capsys):
    (tmp_path / "own.toml").write_text(OWN)
    lens = "fujinon-hf12xa-5m"
    types = {"a": {"preset": f"ours+{lens}"}, "b": {"preset": f"flir-bfs-u3-51s5+{lens}"}}
    entries = {"meshes": [{"built_in": "box"}], "cameras": types, "catalogue": "own.toml"}
    plan = plan_of(entries, tmp_path / "plan.toml")
    assert [plan.cost_of("a", None), plan.cost_of("b", 50)] == [450, 1100]
    assert plan.rig.cameras[0].fx == pytest.approx(6000)
    types["c"] = {"preset": "rpi-hq+fujinon-hf8xa-5m"}
    with pytest.raises(PlanError, match=r"cameras\.c: expected a cost, as of others"):
        plan_of(entries, tmp_path / "plan.toml")
    monkeypatch.setenv("RASTERCOV_CATALOGUE", str(tmp_path / "own.toml"))
    assert command(["cameras", "--hfov=35", "--max-price=500", "--min-pixels=5e6", "--json"]) == 0
    table = {each["name"]: each for each in json.loads(capsys.readouterr().out)["cameras"]}
    assert table[f"ours+{lens}"]["price"] == 450
    assert all(31.5 <= each["hfov_deg"] <= 38.5 for each in table.values())
    assert command(["cameras", "--hfov=35", "--min-pixels=5e6", "--json"]) == 0
    every = {each["name"]: each for each in json.loads(capsys.readouterr().out)["cameras"]}
    known = {name: each["price"] for name, each in every.items() if each["price"] is not None}
    assert table.keys() == {name for name, price in known.items() if price <= 500}
    assert table.keys() <= known.keys() < every.keys()
    shops = "[cameras]\nx = 3", "[shop.x]\na = 1", "[lenses.x]\nprice = 3", "cameras = 1"
    lens = "[lenses.x]\nfocal_length = 1e-2\nf_numbers = [2, 8]\nmount = "
    for text in (*shops, f"{lens}[1]", f'{lens}"\\u202e"', '[cameras."a\\nb"]\nprice = 3'):
        (tmp_path / "own.toml").write_text(text)
        assert command(["cameras"]) == 2
        assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'own.toml'}: ")


def test_a_greatest_price_leaves_out_what_has_no_price(tmp_path, capsys):
    (tmp_path / "own.toml").write_text(OWN)
    listed = {}
    for most in ("", "--max-price=0", "--max-price=200", "--max-price=inf"):
        words = [each for each in ("cameras", most, f"--catalogue={tmp_path}/own.toml") if each]
        assert command([*words, "--json"]) == 0
        content = json.loads(capsys.readouterr().out)
        listed[most] = {
            (what, each["name"]): each["price"] for what in content for each in content[what]
        }
    every, known = listed[""], {k: v for k, v in listed[""].items() if v is not None}
    assert {what for what, _ in every} == {"cameras", "lenses", "heads", "lamps"}
    assert ("lenses", "fujinon-hf12xa-5m") in known.keys() < every.keys()
    assert listed["--max-price=inf"] == known
    assert listed["--max-price=200"] == {k: v for k, v in known.items() if v <= 200} != {}
    assert not listed["--max-price=0"]


def test_kinds_of_lamps_are_found_as_kinds_beside_other_words(tmp_path, monkeypatch, capsys):
    ours = 'ours-{0} = {{ kind = "{0}", size = 0.1, maker = "Ringspot bar engineering" }}\n'
    text = "[lamps]\n" + "".join(ours.format(kind) for kind in KINDS)
    (tmp_path / "own.toml").write_text(text)
    monkeypatch.setenv("RASTERCOV_CATALOGUE", str(tmp_path / "own.toml"))
    lamps = catalogue().lamps
    for kind in KINDS:
        for words in ([kind], [kind.upper()], [kind, "ENGINEER"]):
            assert command(["cameras", *words, "--json"]) == 0
            content = json.loads(capsys.readouterr().out)
            named = {each["name"] for each in content.pop("lamps")}
            own = {name for name, entry in lamps.items() if entry["kind"] == kind}
            assert named == (own if len(words) == 1 else {f"ours-{kind}"})
            assert not any(content.values())


def test_telecentric_lenses_are_found_by_that_word(capsys):
    assert command(["cameras", "telecentric", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)["lenses"]
    known = {name for name, lens in catalogue().lenses.items() if "magnification" in lens}
    assert {each["name"] for each in content} == known != set()


def test_a_telecentric_lens_of_the_catalogue_makes_the_camera_of_its_data_sheet(tmp_path):
    name = "basler-aca1440-220uc"
    assert {"falenses-btl025x230", "thorlabs-mvbt2313"} <= {*catalogue().lenses_of(name)}
    preset = rc.Camera.preset(f"{name}+falenses-btl025x230")
    assert (preset.model, preset.working_distance, preset.f_number) == ("telecentric", 0.23, 6)
    assert preset.magnification == pytest.approx(0.25)
    assert preset.width == catalogue().cameras[name]["width"]
    assert "BTL0.25X230R1.1" in preset.product
    wide = rc.Camera.preset(f"{name}+thorlabs-mvbt2313")
    assert wide.depth_of_field() == pytest.approx((0.164, 0.194))
    entries = {"preset": f"{name}+falenses-btl025x230", "focal_length": 0.016}
    other = rc.Camera.from_dict(entries)
    assert (other.model, other.f_number, other.focus_distance) == ("pinhole", None, None)
    own = tmp_path / "own.toml"
    own.write_text("[lenses.mine]\nmagnification = 0.1\nmount = 'C'\n")
    mine = rc.Camera.from_dict({"preset": f"{name}+mine", "catalogue": own})
    assert (mine.is_parallel, mine.working_distance) == (True, None)
    own.write_text("[lenses.mine]\nmount = 'C'\n")
    with pytest.raises(rc.CameraError, match="focal_length"):
        catalogue(own)


def test_a_pair_has_the_prices_of_its_camera_and_lens(capsys):
    assert command(["cameras", "rpi-hq+rpi-6mm", "--hfov", "55", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["cameras"]
    assert (row["price"], row["prices"]) == (None, {"rpi-hq": 50.0, "rpi-6mm": None})


@pytest.mark.parametrize(("wd", "fov"), [(0.35, 0.1), (0.318, 0.043), (2.0, 0.5)])
def test_lenses_for_a_field_are_those_whose_image_has_its_ends(wd, fov, capsys):
    """Each camera listed sees a width within a tenth; others do not, or are blurred."""
    assert command(["cameras", "--wd", str(wd), "--fov", str(fov), "--json"]) == 0
    listed = {each["name"]: each for each in json.loads(capsys.readouterr().out)["cameras"]}
    assert listed
    shop = catalogue(None)
    for name in shop.names():
        camera = rc.Camera.preset(name)
        entries = {k: v for part in shop.parts(name) for k, v in part.items()}
        if camera.is_parallel:
            field = camera.width / camera.fx
            is_sharp = abs(wd - entries["working_distance"]) <= 0.1 * wd
        else:
            field = wd * camera.width / camera.fx
            is_sharp = wd >= entries.get("nearest", 0)
        assert (name in listed) == (is_sharp and abs(field - fov) <= 0.1 * fov), name
        if name in listed:
            assert listed[name]["field"] == pytest.approx(field)
            assert listed[name]["px_per_mm"] == pytest.approx(camera.width / field / 1e3)


@pytest.mark.parametrize(
    ("line", "is_said"),
    [("", True), ("tc4", True), ("--wd 0.49 --fov 0.3", True), ("tc4 --hfov 30", True),
     ("--mount C", False), ("khepra", False), ("--wd 0.35 --fov 0.1", False)],
)  # fmt: skip
def test_a_lens_that_fits_no_camera_is_named(line, is_said, capsys):
    """It was in no pair, and nothing said so."""
    assert command(["cameras", *line.split()]) == 0
    out = capsys.readouterr().out
    words = "no camera of the catalogue fits: opto-tc4mhrp240-f"
    assert (out.splitlines()[-1] == words) == is_said
    assert "nan" not in out.split()


@pytest.mark.parametrize("option", ["--wd", "--fov"])
def test_a_field_needs_its_distance(option, capsys):
    assert command(["cameras", option, "0.3"]) == 2
    assert capsys.readouterr().err == (
        f"error: expected --wd with --fov, got {option} alone; give both\n"
    )
