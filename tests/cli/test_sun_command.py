"""The command `sun`: what it prints and writes, its exit code, and what it refuses."""

import csv
import json
import re
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from commands import call

import rastercov as rc
from rastercov.base.format import text_with_bound

PLACE = "--latitude 49.1 --longitude 8.4"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A house with a canopy over its south wall."""
    folder = tmp_path_factory.mktemp("sun")
    house = rc.shapes.box((4, 4, 3), centre=(0, 0, 1.5))
    canopy = rc.shapes.box((4, 1, 0.1), centre=(0, -2.5, 2.95))
    for name, mesh in (("house", house), ("canopy", canopy)):
        mesh.to_trimesh().export(folder / f"{name}.stl")
    return folder


@pytest.fixture(autouse=True)
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


LINE = f"sun house.stl canopy.stl {PLACE} --day 2026-03-21 --step 30"


def test_a_day_is_printed_and_written(folder, capsys):
    code, out, _ = call(capsys, f"{LINE} --occluder canopy -o day --penumbra")
    assert code == 0
    lines = out.splitlines()
    words = r" h of sun \(lit share of the silhouette, over time\) for 1 group on 2026-03-21"
    assert re.fullmatch(r"[\d.]+ ± [\d.]+" + words, lines[0])
    assert re.search("kWh: house; shaded [\\d.]+ h by canopy$", lines[1])
    assert lines[-1] == "day/sun.html"
    names = {each.name for each in (folder / "day").iterdir() if not each.name.startswith(".")}
    assert names == {"sun.html", "sun.png", "view.html", "sun.npz", "sun.csv", "sun.json"}
    summary = json.loads((folder / "day" / "sun.json").read_text())
    (part,) = summary["parts"]
    assert 0 < part["hours_lit_by_all"] <= part["hours"] <= part["hours_lit_by_some"]
    assert summary["sun_hours"] == pytest.approx(12, abs=0.5)
    assert part["bound_hours"] < 0.6  # half a step in the morning and in the evening, and more
    (row,) = csv.DictReader((folder / "day" / "sun.csv").read_text().splitlines())
    assert (row["name"], float(row["hours"])) == ("house", part["hours"])
    assert [float(row[f"least_piece_at_{n}"]) for n in (1, 2, 3)] == [0, 0, 1.5]
    page = (folder / "day" / "sun.html").read_text()
    assert summary["answer"] in page
    block = dict(re.findall("<dt>(.*?)</dt><dd>(.*?)</dd>", page))  # as other pages
    assert block["Mesh"] == "house.stl, canopy.stl"
    assert (block["Version"], len(block["Date"])) == (f"rastercov {rc.__version__}", 10)
    assert "hours, whole sun disc visible" in page
    with np.load(folder / "day" / "sun.npz") as arrays:
        assert arrays["hours"].shape == (24,)
        assert arrays["hours"].max() <= summary["sun_hours"] + 1e-9
        total = arrays["energy"][:12].sum() / 1e3
    assert total == pytest.approx(part["energy_kwh"])


@pytest.mark.parametrize(
    "line", ["--of house --occluder *", "--occluder *", "--of house --occluder house"]
)
def test_no_group_that_is_left_is_refused_in_a_line(line, capsys):
    """It was an IndexError."""
    code, out, err = call(capsys, f"{LINE} {line} -o none")
    assert (code, out) == (2, "")
    wanted = "expected a group to evaluate, got occluders only; leave one out of --occluder"
    assert err.splitlines()[-1] == f"error: {wanted}"
    assert not Path("none").exists()


@pytest.mark.parametrize("step", [10, 60])
def test_bounds_hold_the_time_step(step, folder, capsys):
    """Against the hours of each minute; the page has no digits that the bound does not leave."""
    line = f"sun house.stl canopy.stl {PLACE} --day 2026-03-21 --north 50 --json"
    fine, coarse = (
        json.loads(call(capsys, f"{line} --step {each} -o step{each}")[1]) for each in (1, step)
    )
    by_name = (sorted(each["parts"], key=lambda part: part["name"]) for each in (fine, coarse))
    for one, other in zip(*by_name, strict=True):
        for key, bound in (("hours", "bound_hours"), ("energy_kwh", "bound_kwh")):
            assert abs(one[key] - other[key]) <= one[bound] + other[bound]
        key = "least_piece_hours"
        assert abs(one[key] - other[key]) <= other["least_piece_bound_hours"]
    assert other["bound_hours"] < 2.5 * step / 60
    faces = [dict(np.load(folder / f"step{each}" / "sun.npz")) for each in (1, step)]
    for key in ("hours", "energy"):
        bounds = faces[0][f"{key}_bound"] + faces[1][f"{key}_bound"]
        assert (np.abs(faces[0][key] - faces[1][key]) <= bounds).all()
    assert faces[1]["hours_bound"].max() < 2.5 * step / 60
    page = (folder / f"step{step}" / "sun.html").read_text(encoding="utf-8")
    cells = re.findall(r"<td[^>]*>([\d.,e+-]+)</td>", page)
    assert cells
    assert not [each for each in cells if "e" in each or len(each.partition(".")[2]) > 3]


@pytest.mark.parametrize(
    ("value", "bound", "text"),
    [
        (6.768, 0.17, "6.8"),
        (6.112e-05, 0.08, "0.00"),
        (2123.4, 364, "2,100"),
        (0.0, 0.0, "0"),
        (6.7341, 1e-11, "6.734"),
        (0.001234, 4e-5, "0.00123"),
        (-1e-12, 0.1, "0.0"),
    ],
)
def test_a_bound_leaves_digits(value, bound, text):
    assert text_with_bound(value, bound) == text


ALONE = (
    "one group in one piece cannot shade its silhouette: its hours are about those of the sun; "
    "for hours of faces see sun.html and sun.npz"
)


@pytest.mark.parametrize(("others", "warned"), [("", True), ("canopy.stl --of house", False)])
def test_one_group_alone_gets_a_warning(others, warned, capsys):
    line = f"sun house.stl {others} {PLACE} --day 2026-03-21 --step 60 -o alone"
    code, _, err = call(capsys, line)
    assert code == 0
    assert (ALONE in " ".join(err.split())) == warned


@pytest.mark.parametrize(("least", "code"), [("1.5h", 0), ("1.5", 0), ("13", 1)])
def test_the_exit_code_says_whether_all_groups_get_enough(least, code, capsys):
    answer, out, _ = call(capsys, [*LINE.split(), "--at-least", least, "-o", "enough"])
    assert answer == code
    n = 2 if code == 0 else 0
    assert out.startswith(f"{n} of 2 groups get ")


@pytest.mark.parametrize(
    ("errors", "word"), [(-1.5, "yes"), (-0.5, "open"), (0.5, "open"), (1.5, "no")]
)
def test_hours_within_their_error_of_what_is_asked_are_undecided_and_fail(errors, word, capsys):
    line = f"{LINE} --of house --json -o near"
    (one,) = json.loads(call(capsys, line)[1])["pieces"]
    least = one["hours"] + errors * one["error_hours"]
    code, out, _ = call(capsys, f"{line} --at-least {least!r}h")
    summary = json.loads(out)
    (piece,), (part,) = summary["pieces"], summary["parts"]
    assert (piece["verdict"], code) == (word, int(word != "yes"))
    assert summary["passed"] == part["reached"] == (word == "yes")
    assert summary["answer"].startswith(f"{int(word == 'yes')} of 1 group ")
    assert ("(1 undecided: a smaller --step decides)" in summary["answer"]) == (word == "open")


def test_what_is_named_as_an_occluder_is_not_evaluated(capsys):
    summary = json.loads(call(capsys, f"{LINE} --of * --occluder canopy --json -o both")[1])
    assert [each["name"] for each in summary["parts"]] == ["house"]


def test_each_window_of_a_group_must_get_enough(folder, capsys):
    text, n = ["g windows"], 0
    for x in (0, 3):
        box = rc.shapes.box((1, 0.1, 1), centre=(x, 0, 1))
        text += ["v {} {} {}".format(*point) for point in box.vertices.tolist()]
        text += ["f {} {} {}".format(*(face + n + 1)) for face in box.faces]
        n += box.n_vertices
    (folder / "two.obj").write_text("\n".join(text))
    screen = rc.shapes.box((1.2, 0.1, 3), centre=(3, -0.2, 1.5))
    screen.to_trimesh().export(folder / "screen.stl")
    line = f"sun two.obj screen.stl --of windows {PLACE} --day 2026-03-21 --step 10 -o two"
    code, out, _ = call(capsys, f"{line} --at-least 4h")
    assert code == 1
    assert re.search(r"h, [\d.]+ kWh: windows, piece 2; no. 1", out)
    (part,) = json.loads((folder / "two" / "sun.json").read_text())["parts"]
    assert part["least_piece_hours"] < 4 < part["hours"]
    assert not part["reached"]
    page = (folder / "two" / "sun.html").read_text()
    assert "1: windows, piece 2" in page
    assert "Not to be signed: window 1 fails." in page


WINDOWS = "--of *IfcWindow* --latitude 50.1 --longitude 14.4 --step 30 -o rooms"


@pytest.fixture(scope="module")
def dwelling(folder):
    """An IFC file of two rooms; one has a window to the south and one to the north."""
    from bungalow import bungalow
    from wheels import with_wheel

    with_wheel("ifcopenshell")
    windows = {"S": ((2, -0.02, 1), (3, 0.02, 2)), "N": ((2, 5.98, 1), (3, 6.02, 2))}
    windows |= {"Dark": ((7, 5.98, 1), (8, 6.02, 2))}
    (folder / "dwelling.ifc").write_bytes(bungalow(windows=windows))
    (folder / "other.ifc").write_bytes(bungalow((0, 40, 0), windows))


LEVELS = [("minimum", 1.5, 1), ("high", 4.0, 1), ("1h", 1.0, 1)]


@pytest.mark.parametrize(("level", "hours", "code"), LEVELS)
def test_rooms_get_the_hours_of_a_level_by_their_windows_together(
    level, hours, code, dwelling, folder, capsys
):
    line = f"sun dwelling.ifc {WINDOWS} --day 2026-02-10 --min-elevation 10 --at-least {level}"
    answer, out, _ = call(capsys, line)
    assert answer == code
    summary = json.loads((folder / "rooms" / "sun.json").read_text(encoding="utf-8"))
    assert summary["least_hours"] == hours
    by_name = {each["name"].rpartition(", ")[2]: each for each in summary["pieces"]}
    assert {name: by_name[name]["faces"] for name in by_name} == {"S": "S", "N": "N", "Dark": "N"}
    assert [each["number"] for each in summary["pieces"]] == [1, 2, 3]
    hall, kitchen = summary["rooms"]  # the darkest first
    assert kitchen["hours"] + 1e-9 >= by_name["S"]["hours"] > 4 > 0.3 > hall["hours"]
    assert (hall["verdict"], kitchen["verdict"]) == ("no", "yes")
    assert kitchen["pieces"] == sorted(by_name[name]["number"] for name in "SN")
    page = (folder / "rooms" / "sun.html").read_text(encoding="utf-8")
    is_level = level != "1h"
    assert out.startswith("1 of 2 rooms gets " if is_level else "1 of 3 windows gets")
    rule = f"Rule: EN 17037, exposure to sunlight, level {level}: {hours:g} h or more on a day"
    assert (rule in page) == is_level
    for name in ("Kitchen", "Hall"):  # on the plan
        assert f">{name}</text>" in page
    assert "Ground, 0 Kitchen, S" in page


def test_rooms_of_two_houses_are_told_apart_by_their_files(dwelling, folder, capsys):
    """Windows of rooms of the same names counted together, in either house."""
    line = f"sun dwelling.ifc other.ifc {WINDOWS} --day 2026-02-10 --min-elevation 10"
    call(capsys, f"{line} --at-least minimum")
    summary = json.loads((folder / "rooms" / "sun.json").read_text(encoding="utf-8"))
    names = ["Ground, 0 Kitchen", "Ground, 1 Hall"]
    assert sorted(each["name"] for each in summary["rooms"]) == [
        *names, *(f"other, {name}" for name in names)
    ]  # fmt: skip
    sides = {each["number"]: each["at"][1] > 30 for each in summary["pieces"]}
    for room in summary["rooms"]:
        assert {sides[number] for number in room["pieces"]} == {"other" in room["name"]}


def test_rooms_of_a_whole_house_have_the_hours_of_their_windows(dwelling, folder, capsys):
    hours = []
    for of in ("--of *IfcWindow* ", ""):
        line = f"sun dwelling.ifc {WINDOWS} --day 2026-02-10".replace("--of *IfcWindow* ", of)
        assert call(capsys, line)[0] == 0
        rooms = json.loads((folder / "rooms" / "sun.json").read_text(encoding="utf-8"))["rooms"]
        hours.append({each["name"]: each["hours"] for each in rooms})
    assert hours[0] == pytest.approx(hours[1], abs=1e-9)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            "--day 2026-06-21 --min-elevation 11",
            "--day: expected a day from 1 February to 21 March",
        ),
        ("--year 2026 --min-elevation 11", "--day: expected a day from 1 February to 21 March"),
        ("--day 2026-03-21", "--min-elevation: expected the minimum for the country"),
    ],
)
def test_a_level_needs_its_days_and_the_elevation_of_the_place(more, words, capsys):
    code, _, err = call(capsys, f"sun house.stl {PLACE} {more} --at-least minimum -o wrong")
    assert (code, err.count("\n")) == (2, 1)
    assert words in err


def test_windows_of_a_group_have_one_colour_each_that_of_their_hours(dwelling, capsys):
    """Both triangles of a pane, and its frame."""
    from rastercov.sun.sun_report import Study

    boxes = [rc.shapes.box((1, 0.1, 1), centre=(3 * x, 0, 1)) for x in range(2)]
    roof = rc.shapes.box((2, 2, 0.1), centre=(0, -1, 1.7))
    mesh = rc.Mesh.joined([*boxes, roof], ["a", "b", "roof"]).with_groups(occluders=["roof"])
    sunlit = rc.sunlit(mesh, [(0.3, -1, 0.8), (0, -1, 0.2)])
    study = Study({"middle": sunlit}, [], np.zeros(2, bool), "", 60, None, "", 90.0, False)
    colours = study.colours()
    for row in range(2):
        assert set(colours[mesh.face_group == row]) == {sunlit.part_hours[row]}
    assert sunlit.part_hours[0] < sunlit.part_hours[1]
    assert (study._replace(is_fine=True).colours() == sunlit.hours).all()


def test_errors_hold_the_disc_and_the_step(folder, capsys):
    """Of every piece: the hours of each minute by the middle, and by all and some of the disc."""
    line = f"sun house.stl canopy.stl {PLACE} --day 2026-03-21 --north 50 --json -o errors"
    coarse, fine, disc = (
        json.loads(call(capsys, f"{line} {more}")[1])["pieces"]
        for more in ("--step 30", "--step 2", "--step 30 --penumbra")
    )
    for one in coarse:
        (true,) = (each for each in fine if each["name"] == one["name"])
        (wide,) = (each for each in disc if each["name"] == one["name"])
        assert abs(one["hours"] - true["hours"]) <= one["error_hours"] + true["error_hours"]
        assert one["error_hours"] > true["error_hours"] > 0
        assert wide["error_hours"] >= 0.5 * one["error_hours"]


@pytest.mark.parametrize("angle", [0, 90, 200])
@pytest.mark.parametrize("is_two_sided", [False, True])
def test_hours_in_front_of_a_pane_without_a_room_are_by_its_one_side(
    angle, is_two_sided, folder, capsys
):
    """Of both sides, or of a body, those of the sun."""
    pane = rc.Mesh([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)], [(0, 1, 2), (0, 2, 3)])
    pane = pane.moved(angle_deg=angle)
    text = ["v {} {} {}".format(*point) for point in pane.vertices.tolist()]
    text += ["f {} {} {}".format(*(face + 1)) for face in pane.faces]
    (folder / "pane.obj").write_text("\n".join([*text, ""]))
    day = "2026-06-21"
    side = " --two-sided *" * is_two_sided
    line = f"sun pane.obj {PLACE} --day {day} --json -o pane{side}"
    code, out, _ = call(capsys, line)
    assert code == 0
    summary = json.loads(out)
    (piece,) = summary["pieces"]
    if is_two_sided:
        assert piece["hours_in_front"] == pytest.approx(summary["sun_hours"])
        assert piece["faces"] == ""
        return
    assert piece["hours_in_front"] == pytest.approx(piece["hours"])
    assert 4 < piece["hours"] < 12 < summary["sun_hours"]
    assert piece["faces"] == {0: "E", 90: "N", 200: "W"}[angle]


@pytest.mark.parametrize("step", [10, 60])
@pytest.mark.parametrize(
    ("day", "latitude", "east"),
    [("2026-03-21", 48, 0), ("2026-09-22", 48, 0), ("2026-03-21", -20, 0), ("2026-06-21", 60, 1)],
)
def test_errors_hold_what_is_between_sunrise_and_the_first_sample(
    day, latitude, east, step, folder, capsys
):
    """Of panes to all sides, some a tower hides at sunrise: hours and energy of each minute."""
    pane = np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)], float)
    sides = [
        rc.Mesh(pane, [(0, 1, 2), (0, 2, 3)]).moved(angle_deg=angle, translation=(9 * n, 0, 0))
        for n, angle in enumerate((0, 90, 180, 270))
    ]
    tower = rc.shapes.box((1, 4, 9), centre=(3, 0.5, 0))
    names = ["east", "north", "west", "south"]
    for name, each in zip(["tower", *names], [tower, *sides], strict=True):
        text = ["v {} {} {}".format(*point) for point in each.vertices.tolist()]
        text += ["f {} {} {}".format(*(face + 1)) for face in each.faces]
        (folder / f"{name}.obj").write_text("\n".join([f"g {name}", *text]))
    line = f"sun {' '.join(f'{name}.obj' for name in ['tower', *names])} --occluder tower --json"
    line += f" --latitude {latitude} --longitude {8 + east} --day {day} -o sides"
    fine, coarse = (
        json.loads(call(capsys, f"{line} --step {each}")[1])["pieces"] for each in (1, step)
    )
    for one in coarse:
        (true,) = (each for each in fine if each["name"] == one["name"])
        for key, error in (("hours", "error_hours"), ("energy_kwh", "bound_kwh")):
            assert abs(one[key] - true[key]) <= one[error]
        assert one["error_hours"] < 6 * step / 60
    faces = [dict(np.load(folder / "sides" / "sun.npz"))]
    assert (faces[0]["hours_bound"] < 6 * step / 60).all()


def test_a_year_has_months_and_a_finer_map_the_same_hours(capsys):
    code, out, _ = call(
        capsys, f"sun house.stl {PLACE} --year 2026 --json --resolution 2 -o year --north 40"
    )
    assert code == 0
    (part,) = json.loads(out)["parts"]
    months = part["hours_by_month"]
    assert sum(months) == pytest.approx(part["hours"])
    assert months[5] > months[2] > months[11] > 0
    summary = json.loads(out)
    assert summary["sun_hours"] == pytest.approx(4380, rel=0.01)
    assert part["hours"] == pytest.approx(summary["sun_hours"])  # nothing shades it
    assert "Hours by month" in Path("year/sun.html").read_text(encoding="utf-8")


def test_only_a_high_sun_counts_and_groups_are_chosen(capsys):
    high = f"{LINE} --of house --min-elevation 30 --irradiance 500 --json -o high"
    code, out, _ = call(capsys, high)
    assert code == 0
    summary = json.loads(out)
    assert summary["sun_hours"] < 7
    assert [each["name"] for each in summary["parts"]] == ["house"]
    assert summary["parts"][0]["energy_kwh"] < 0.5 * 7 * 4 * 4 * 2


def test_a_polar_night_has_no_sun(capsys):
    """It is below the horizon, which counts for a lower elevation, too."""
    line = "sun house.stl --latitude 80 --longitude 0 --day 20261221 --step 60 -o night"
    code, out, err = call(capsys, f"{line} --min-elevation -60")
    assert code == 0
    assert "the sun stays below 0 degrees of elevation (2026-12-21): 0 h" in err
    assert out.startswith(
        "0 h of sun (lit share of the silhouette, over time) for 1 group on 2026-12-21"
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("", "expected --day, --year or --weather, got none; give one"),
        ("--day 2026-03-21 --year 2026", "expected --day, --year or --weather, got 2 of them"),
        (
            "--day 21.3.2026",
            "--day: expected an existing date YYYY-MM-DD, got '21.3.2026'; correct it",
        ),
        ("--year 1900", "--year: expected a number of at least 1950"),
        ("--year 2060", "--year: expected a number of at most 2050"),
        ("--day 2026-03-21 --step 7", "--step: expected minutes that divide an hour, got 7"),
        ("--day 1949-03-21", "of the years 1950 to 2050, got 1949"),
        (
            "--day 2026-03-21 --at-least noon",
            "--at-least: expected hours such as 1.5h, or one of minimum, medium",
        ),
        ("--day 2026-03-21 --of roof", "--of"),
        ("--day 2026-03-21 --irradiance -5", "--irradiance: expected irradiance of 0 or more"),
        ("--day 2026-03-21 --irradiance=nan", "--irradiance: expected irradiance of 0 or more"),
        ("--day 2026-03-21 --resolution 0", "--resolution: expected size above 0 m, got 0.0"),
        ("--day 2026-03-21 --north nan", "--north: expected north_deg to be finite, got nan"),
        ("--day 2026-03-21 --min-elevation nan", "--min-elevation: expected finite"),
        ("--day 2026-03-21 --min-elevation 91", "--min-elevation of -90 to 90 degrees"),
        ("--year=nan", "--year: expected a whole number, got 'nan'"),
    ],
)
def test_wrong_options_are_refused_in_one_line(options, words, capsys):
    code, out, err = call(capsys, f"sun house.stl {PLACE} {options} -o wrong")
    assert (code, out) == (2, "")
    error = err.strip().splitlines()[-1]
    assert error.startswith("error: ")
    assert words in error
    code, _, err = call(capsys, "sun house.stl --latitude 99 --longitude 0 --day 2026-03-21")
    assert (code, err.count("\n")) == (2, 1)
    assert "expected latitude of -90 to 90 degrees, got 99" in err


@pytest.mark.parametrize("depth", [0.1, 0.3, 0.5])
def test_all_shade_of_a_window_is_named_its_reveal_by_its_hours(depth, tmp_path, capsys):
    """Of windows in openings of a wall, one with a neighbour before it, turned to any side."""
    turn = {"axis": (0, 0, 1), "angle_deg": 90 * depth}
    parts = {"wall": [], "window": []}
    for x in (0.0, 6.0):
        for width, height, dx, z in (
            (2, 3, -2, 1.5),
            (2, 3, 2, 1.5),
            (2, 1, 0, 0.5),
            (2, 1, 0, 2.5),
        ):
            middle = (x + dx, depth / 2, z)
            parts["wall"].append(rc.shapes.box((width, depth, height), centre=middle))
        pane = rc.shapes.box((2, 0.02, 1), centre=(x, depth - 0.01, 1.5))
        parts["window"].append(pane)
    room = (12.4, 0.2, 3, 3, 4.1, 1.5), (12.4, 4.4, 0.2, 3, 2, 3.1), (12.4, 4.4, 0.2, 3, 2, -0.1)
    room += (0.2, 4.2, 3, -3.1, 2, 1.5), (0.2, 4.2, 3, 9.1, 2, 1.5)
    parts["house"] = [rc.shapes.box(each[:3], centre=each[3:]) for each in room]
    parts["tower"] = [rc.shapes.box((1, 1, 8), centre=(6, -5, 4))]
    for name, each in parts.items():
        rc.Mesh.joined(each).moved(**turn).to_trimesh().export(tmp_path / f"{name}.stl")
    for others in (["wall", "house"], ["wall", "house", "tower"]):
        files = " ".join(str(tmp_path / f"{name}.stl") for name in ("window", *others))
        line = f"sun {files} {PLACE} --day 2026-03-21 --step 10 -o {tmp_path / 'out'} --json"
        code, out, _ = call(capsys, " ".join((line, *(f"--occluder {each}" for each in others))))
        assert code == 0
        for each in json.loads(out)["pieces"]:
            named = {own["name"]: own["hours"] for own in each["shaded_by"]}
            shade = each["hours_in_front"] - each["hours"]
            assert sum(named.values()) == pytest.approx(shade, abs=0.2)
            assert named["wall (reveal)"] > 0.2 * shade
            assert named.get("wall", 0.0) + named.get("house", 0.0) < 0.1
            assert "tower" in named or each["at"][0] < 3 or "tower" not in others
    page = (tmp_path / "out" / "sun.html").read_text()
    assert "wall (reveal)" in page
    assert 'class="verdict open"' in page  # nothing is asked: no colour says that it holds


@pytest.mark.parametrize("longitude", [8.44, -77.0, 0.0])
def test_the_first_and_the_last_sun_are_by_the_clock_of_the_page(longitude):
    """Of a day, to within a step, in a zone by longitude; panes face east and west."""
    from rastercov.sun.sun_report import Study

    zone, step = timezone(timedelta(hours=round(longitude / 15))), 20
    start = datetime(2026, 3, 21, tzinfo=zone)
    times = [start + timedelta(minutes=step * (row + 0.5)) for row in range(72)]
    towards = rc.sun_directions(49.1, longitude, times)
    up = np.flatnonzero(towards[:, 2] > 0)
    pane = np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)])
    sides = [
        rc.Mesh(pane, [(0, 1, 2), (0, 2, 3)]),
        rc.Mesh(pane - (9, 0, 0), [(2, 1, 0), (3, 2, 0)]),
    ]
    sunlit = rc.sunlit(rc.Mesh.joined(sides, ["east", "west"]), towards[up])
    chosen = [times[row] for row in up]
    study = Study({"middle": sunlit}, chosen, up < 0, "a day", step, None, "", 90.0, False)
    name, whole, *each = study.clock([0, 1])
    hours = [
        [int(end[:2]) + int(end[3:]) / 60 for end in text.split(" to ")] for text in (whole, *each)
    ]
    assert name == ("UTC" if not longitude else f"UTC{round(longitude / 15):+03d}:00")
    noon = 12 + round(longitude / 15) - longitude / 15 + 7 / 60  # the sun is late in March
    for (rise, end), wanted in zip(
        hours, ((noon - 6, noon + 6), (noon - 6, noon), (noon, noon + 6)), strict=True
    ):
        assert (rise, end) == pytest.approx(wanted, abs=step / 60 + 0.15)
    year = study._replace(times=[*chosen[:-1], chosen[-1] + timedelta(days=1)])
    assert year.clock([0, 1]) == [""] * 4
    assert study.clock([]) == [name, whole]


def test_the_page_of_a_day_has_the_clock_and_that_of_a_year_has_none(folder, capsys):
    head = "first to last sun, UTC+01:00"
    call(capsys, f"{LINE} -o clock")
    page = (folder / "clock" / "sun.html").read_text()
    assert head in page
    assert re.search(
        r"above the horizon, 0\d:\d0 to 1\d:\d0 \(UTC\+01:00, without summer time\)", page
    )
    call(capsys, LINE.replace("--day 2026-03-21 --step 30", "--year 2026") + " -o clock")
    page = (folder / "clock" / "sun.html").read_text()
    assert "first to last sun" not in page
    assert "summer time" not in page


def test_the_group_of_a_built_in_mesh_has_a_name(capsys):
    line = f"sun box {PLACE} --day 2026-03-21 --step 60 --of mesh -o built_in"
    assert call(capsys, line)[0] == 0
