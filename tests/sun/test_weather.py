"""Years of weather: three formats of one year, the energy they give, shade factors, sky factors."""

import csv
import json
import re
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from commands import call, refusal

import rastercov as rc
from rastercov.base import ConfigError
from rastercov.core.mesh.files import Site
from rastercov.sun.weather import HOURS, read_weather, sky_factors

PLACE = (49.1, 8.44)
ZONE = timezone(timedelta(hours=1))
START = datetime(2021, 1, 1, tzinfo=ZONE)
RNG = np.random.default_rng(0)
BEAM, DIFFUSE = RNG.integers(0, 900, HOURS), RNG.integers(0, 300, HOURS)


def epw():
    lines = [f"LOCATION,Karlsruhe,-,DEU,TEST,1,{PLACE[0]},{PLACE[1]},1.0,112.0", *["X"] * 7]
    for hour, (beam, diffuse) in enumerate(zip(BEAM, DIFFUSE, strict=True)):
        day = START + timedelta(hours=hour)
        values = [day.year, day.month, day.day, day.hour + 1, 60, "?", *[0] * 8, beam, diffuse, 0]
        lines.append(",".join(map(str, values)))
    return "\n".join(lines)


def tmy3():
    lines = [f'1,"KARLSRUHE",XX,1.0,{PLACE[0]},{PLACE[1]},112']
    lines.append("Date (MM/DD/YYYY),Time (HH:MM),GHI (W/m^2),DNI (W/m^2),DHI (W/m^2)")
    for hour, (beam, diffuse) in enumerate(zip(BEAM, DIFFUSE, strict=True)):
        day = START + timedelta(hours=hour)
        lines.append(f"{day:%m/%d/%Y},{day.hour + 1:02d}:00,0,{beam},{diffuse}")
    return "\n".join(lines)


def pvgis():
    lines = [f"Latitude (decimal degrees): {PLACE[0]}", f"Longitude (decimal degrees): {PLACE[1]}"]
    lines += ["Elevation (m): 112", "", "time(UTC),T2m,RH,G(h),Gb(n),Gd(h),IR(h)"]
    for hour, (beam, diffuse) in enumerate(zip(BEAM, DIFFUSE, strict=True)):
        middle = (START + timedelta(hours=hour, minutes=30)).astimezone(UTC)
        lines.append(f"{middle:%Y%m%d:%H%M},5,80,0,{beam},{diffuse},300")
    return "\n".join([*lines, "", "T2m: 2-m air temperature"])


FILES = {"a.epw": epw, "tmy3.csv": tmy3, "pvgis.csv": pvgis}


def test_a_leap_year_is_read_without_its_29_february(tmp_path):
    lines = epw().splitlines()
    first = 8 + 24 * 59
    more = [line.replace("2021,3,1,", "2020,2,29,") for line in lines[first : first + 24]]
    (tmp_path / "a.epw").write_text("\n".join(lines[:first] + more + lines[first:]))
    weather = read_weather(tmp_path / "a.epw")
    assert np.array_equal(weather.beam, BEAM)
    assert len(weather.times) == HOURS


@pytest.mark.parametrize("name", FILES)
def test_each_format_is_the_same_year(tmp_path, name):
    (tmp_path / name).write_text(FILES[name]())
    weather = read_weather(tmp_path / name)
    assert (weather.latitude, weather.longitude) == PLACE
    assert weather.times == [START + timedelta(hours=hour + 0.5) for hour in range(HOURS)]
    assert np.array_equal(weather.beam, BEAM)
    assert np.array_equal(weather.diffuse, DIFFUSE)


@pytest.mark.parametrize("offset", [0.1761, -0.5, 0.75, 0.0])
def test_the_sun_of_pvgis_is_by_its_offset_from_the_stamp(tmp_path, offset):
    """Also past midnight of 28 February of a leap year."""
    text = pvgis().replace("Elevation", f"Irradiance Time Offset (h): {offset}\nElevation")
    (tmp_path / "a.csv").write_text(re.sub("202102", "202002", text))
    times = read_weather(tmp_path / "a.csv").times
    for hour in (0, 31 * 24 + 5, HOURS // 2, HOURS - 1):
        time = (START + timedelta(hours=hour + 0.5 + offset)).astimezone(UTC)
        assert times[hour].replace(year=time.year) == time
    assert len(times) == HOURS


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("pvgis.csv", lambda text: f"Irradiance Time Offset (h): inf\n{text}", "TMY3 or PVGIS"),
        ("a.epw", lambda text: text[: len(text) // 2], "EPW, TMY3 or PVGIS|8760 hours"),
        ("a.epw", lambda text: text.replace("LOCATION", "PLACE"), "an EPW, TMY3 or PVGIS"),
        ("a.epw", lambda text: "", "an EPW, TMY3 or PVGIS"),
        ("a.epw", lambda text: text.replace(",24,60,", ",0,60,"), "an hour 0, which are 1 to 24"),
        ("a.epw", lambda text: text.replace(",1.0,112.0", ",25,112.0"), "a time zone of 25 h"),
        ("tmy3.csv", lambda text: text.replace("DNI (W/m^2)", "DNI"), "an EPW, TMY3 or PVGIS"),
        ("tmy3.csv", lambda text: text.replace(",02:00,0,", ",02:00,0,x"), "EPW, TMY3 or PVGIS"),
        ("pvgis.csv", lambda text: text.replace("Latitude", "Breite"), "EPW, TMY3 or PVGIS"),
        ("pvgis.csv", lambda text: text.replace(",5,80,0,", ",5,80,0,-1"), "hours with 0 to 2000"),
        ("a.epw", lambda text: "\n".join(text.split("\n")[:8]), "2000 W/m2, got 0;|EPW, TMY3"),
        (
            "a.epw",
            lambda text: text.replace(",5,60,?,0,0,0,0,0,0,0,0,", ",5,60,?,0,0,0,0,0,0,0,0,9"),
            "got 2021-01-01 04:30:00\\+01:00: 9[0-9]+ and [0-9]+; download",
        ),
    ],
)
def test_another_file_is_refused_in_one_line(tmp_path, name, change, words):
    (tmp_path / name).write_text(change(FILES[name]()))
    with pytest.raises(ConfigError, match=words) as caught:
        read_weather(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_device_is_not_read():
    with pytest.raises(ConfigError, match="a regular file, got a device"):
        read_weather(Path("/dev/zero"))


def test_sky_factors_of_planes_and_a_pit():
    up = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    wall = rc.Mesh([(9, 0, 0), (9, 1, 0), (9, 1, 1), (9, 0, 1)], [(0, 1, 2), (0, 2, 3)])
    factors, errors = sky_factors(rc.Mesh.joined([up, wall], ["up", "wall"]))
    np.testing.assert_allclose(factors, [1.0, 0.5], atol=0.01)
    assert (errors < 0.01).all()
    # The floor of a cylinder of radius 1 and height 2 sees (from its middle) 1 / (1 + 4).
    angle = np.linspace(0, 2 * np.pi, 25)[:-1]
    ring = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    points = np.concatenate([np.column_stack((ring, np.full(24, z))) for z in (0.0, 2.0)])
    sides = [(k, (k + 1) % 24, k + 24) for k in range(24)]
    sides += [((k + 1) % 24, (k + 1) % 24 + 24, k + 24) for k in range(24)]
    pit = rc.Mesh(points, sides).with_groups(two_sided=["mesh"], occluders=["mesh"])
    floor = rc.Mesh([(-0.02, -0.02, 0), (0.02, -0.02, 0), (0, 0.02, 0)], [(0, 1, 2)])
    scene = rc.Mesh.joined([floor, pit], ["floor", "pit"])
    (factor,), (error,) = sky_factors(scene)
    assert factor == pytest.approx(0.2, abs=0.01 + error)


def test_energy_and_shade_factors_of_a_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.epw").write_text(epw())
    (tmp_path / "roof.obj").write_text("v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nf 1 2 3 4\n")
    screen = rc.shapes.box((6, 0.1, 3), centre=(1, -1, 1.5))
    (tmp_path / "screen.off").write_text(
        f"OFF\n{screen.n_vertices} {screen.n_faces} 0\n"
        + "".join("{} {} {}\n".format(*point) for point in screen.vertices.tolist())
        + "".join("3 {} {} {}\n".format(*face) for face in screen.faces.tolist())
    )
    line = "sun roof.obj --weather a.epw --shade-factors loss.csv --json"
    code, text, err = call(capsys, f"{line} -o alone")
    assert code == 0
    told = json.loads(text)
    height = rc.sun_directions(*PLACE, read_weather(tmp_path / "a.epw").times)[:, 2]
    beam = 2 * (BEAM * np.clip(height, 0, None)).sum() / 1e3
    assert told["parts"][0]["energy_kwh"] == pytest.approx(beam, rel=1e-6)
    (entry,) = told["diffuse"]
    assert entry["energy_kwh"] == pytest.approx(2 * DIFFUSE.sum() / 1e3, rel=0.01)
    assert json.loads((tmp_path / "alone" / "sun.json").read_text())["diffuse"] == [entry]
    rows = list(csv.reader((tmp_path / "loss.csv").read_text().splitlines()))
    assert (len(rows), set(map(tuple, rows[1:]))) == (HOURS + 1, {("0.0",)})
    assert "the place is" not in err
    page = (tmp_path / "alone" / "sun.html").read_text()
    assert "nergy is for the direct normal irradiance of a.epw" in page
    assert "sky view factor" in page
    monkeypatch.setattr(rc.Mesh, "site", Site(90.0, PLACE[0], PLACE[1] + 90))
    err = call(capsys, f"{line} -o far")[2]
    assert "warning: the place is that of a.epw, far from that of the mesh file" in err
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    more = "--occluder screen.off"
    code, text, _ = call(capsys, line.replace("roof.obj", f"roof.obj {more}") + " -o shaded")
    assert code == 0
    shaded = json.loads(text)
    losses = np.loadtxt(tmp_path / "loss.csv", skiprows=1)
    left = 2 * (BEAM * np.clip(height, 0, None) * (1 - losses / 100)).sum() / 1e3
    assert shaded["parts"][0]["energy_kwh"] == pytest.approx(left, rel=1e-4)
    assert 0 < left < beam
    assert (losses[height <= 0] == 0).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--day 2026-03-21 --weather a.epw", "got 2 of them"),
        ("--day 2026-03-21 --shade-factors b.csv", "expected --weather with it"),
        ("--weather nothing.epw", "an EPW, TMY3 or PVGIS file"),
        ("--weather a.epw --latitude 50", "expected --weather or --latitude, got both; leave one"),
        ("--weather a.epw --longitude 0", "expected --weather or --longitude, got both"),
        ("--weather a.epw --step 60", "expected --weather or --step, got both"),
        ("--weather a.epw --irradiance 900", "expected --weather or --irradiance, got both"),
        ("--weather a.epw --shade-factors no/b.csv", "a file in an existing folder"),
    ],
)
def test_wrong_options_are_one_line(tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.epw").write_text(epw())
    place = "" if "a.epw" in options else "--latitude 49 --longitude 8"
    assert words in refusal(capsys, f"sun teapot {place} {options}")
