"""The command `locate`: a page and the rig as built, verdicts as exit codes, refusals in a line."""

import json
import re
from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from commands import call
from PIL import Image
from test_edges import CAMERA, MESH, off, photograph, pose_of

import rastercov as rc
from rastercov.asbuilt.resection import pixels_of

PLAN = """meshes = [{ path = "cell.obj" }]
[camera]
width = 480
height = 360
hfov_deg = 50
[selection]
goal = "best_coverage"
cameras = 2
"""


def save(path, photo):
    """A photograph as a file."""
    Image.fromarray((255 * photo).astype(np.uint8)).save(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A plan, its rig, and photographs: of "east" as planned, of "door" 1.5 degrees off."""
    folder = tmp_path_factory.mktemp("built")
    MESH.to_trimesh().export(folder / "cell.obj")
    (folder / "plan.toml").write_text(PLAN)
    poses = np.array([pose_of(1), pose_of(2)])
    views = rc.Views(rc.Rig([CAMERA]), rc.Poses.of(poses), images=("east", "door"))
    rc.write_views(folder / "rig.json", views)
    (folder / "photos").mkdir()
    save(folder / "photos/east.png", photograph(MESH, poses[0], 1))
    save(folder / "photos/door.png", photograph(MESH, off(poses[1], 2, 1.5, 0), 2))
    save(folder / "small.png", photograph(MESH, poses[0], 1)[::2, ::2])
    (folder / "text.png").write_text("no picture")
    (folder / "three.csv").write_text("u,v,x,y,z\n1,1,0,0,0\n2,2,1,0,0\n3,5,1,1,0\n")
    (folder / "four.csv").write_text((folder / "three.csv").read_text() + "9,8,0,1,1\n")
    (folder / "words.csv").write_text("u,v,x,y,z\n1,1,0,0,zero\n")
    (folder / "empty").mkdir()
    (folder / "more").mkdir()
    for name in ("east.png", "roof.png"):
        save(folder / "more" / name, photograph(MESH, poses[0], 1))
    (folder / "twice").mkdir()
    for name in ("east.png", "east.jpg"):
        save(folder / "twice" / name, photograph(MESH, poses[0], 1))
    return folder


def test_a_folder_of_photographs_makes_a_page_and_the_rig_as_built(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    line = "locate photos plan.toml -p rig.json --out built --junit built.xml"
    code, out, _ = call(capsys, line)
    assert code == 1
    assert re.search(r"east: as planned;.*\)$", out, re.MULTILINE)  # and no turn
    assert "door: moved;" in out
    told = json.loads((folder / "built/locate.json").read_text())
    assert [each["verdict"] for each in told["cameras"]] == ["moved", "as planned"]
    assert abs(told["cameras"][0]["turned_deg"] - 1.5) < 0.1
    limits = [each["tolerance"]["place_m"] for each in told["cameras"]]
    assert limits[0] != limits[1]  # each of its own distance
    page = (folder / "built/locate.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == 2
    xml = (folder / "built.xml").read_text(encoding="utf-8")
    assert 'name="pose of door"' in xml
    answer, _, rest = page.partition("<figure>")
    assert answer.count("<li>") == 2
    assert "oor: " in answer
    assert ": turn 1." in answer
    assert "Covered now: " in answer
    assert rest.index("door: edges") < rest.index("east: edges")  # what has moved is shown first
    assert call(capsys, "check plan.toml -p built/poses.json --min-coverage 0.05")[0] == 0


def test_an_error_across_the_limit_is_said_in_the_terminal_and_in_the_page(
    folder, capsys, monkeypatch
):
    monkeypatch.chdir(folder)
    line = "locate photos/door.png plan.toml -p rig.json --of door --out across"
    told = json.loads(call(capsys, f"{line} --json")[1])["cameras"][0]
    limit = f"{told['turned_deg']:.3g}"
    code, out, _ = call(capsys, f"{line} --within '1 m, {limit} deg'")
    assert code == 2
    said = f"its error reaches across the limit of 1 m and {limit} deg"
    assert f"; {said}\n" in out
    assert f"Next: {said}; click more points" in (folder / "across/locate.html").read_text("utf-8")


@pytest.mark.parametrize("turns", [0, 2])
def test_of_an_undecided_camera_nothing_is_claimed(folder, capsys, monkeypatch, turns):
    monkeypatch.chdir(folder)
    wrong = photograph(MESH, pose_of(1), 1) * bool(turns)  # black, or upside down
    save(folder / "wrong.png", np.rot90(wrong, turns))
    code, out, _ = call(capsys, "locate wrong.png plan.toml -p rig.json --of east --out wrong")
    page = (folder / "wrong/locate.html").read_text(encoding="utf-8")
    assert code == 2
    assert out.count("undecided") == page.count("Undecided") == 1
    for text in (out.lower(), page.lower()):
        assert "what is lost is not known" in text
        assert "nothing is lost" not in text
        assert "as built in green" not in text
    answer, _, rest = page.partition("<figure>")
    assert answer.count("<li>") == 3
    assert "Next: if wrong.png is of east, click eight corners" in answer
    assert "rastercov view plan.toml -p rig.json" in answer
    shares = re.findall("<tr><td[^>]*>(?:whole|group).*</tr>", rest)
    assert shares
    assert all(re.search("<td[^>]*>—</td></tr>$", each) for each in shares)
    assert json.loads((folder / "wrong/locate.json").read_text())["requirements_as_built"] == []
    assert not (folder / "wrong/poses.json").exists()  # it would be the plan's


def test_a_folder_without_the_photograph_of_a_camera_is_undecided(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "part").mkdir()
    (folder / "part/east.png").write_bytes((folder / "photos/east.png").read_bytes())
    line = "plan.toml -p rig.json --out part_built --junit part.xml"
    code, out, _ = call(capsys, f"locate part {line}")
    assert code == 2
    assert "door: undecided; no photograph" in out
    assert "nothing is lost" not in out
    assert json.loads((folder / "part_built/locate.json").read_text())["missing"] == ["door"]
    page = (folder / "part_built/locate.html").read_text(encoding="utf-8")
    assert "No photograph of door" in page.partition("<figure>")[0]
    assert "Covered now, with undecided cameras as planned: " in page
    assert 'name="pose of door"' in (folder / "part.xml").read_text(encoding="utf-8")
    assert call(capsys, f"locate part/east.png --of east {line}")[0] == 0  # of one camera alone
    assert call(capsys, "locate part plan.toml -p rig.json --rigid")[0] == 0  # it follows


def test_a_rigid_rig_whose_cameras_moved_apart_is_undecided(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    code, out, _ = call(capsys, "locate photos plan.toml -p rig.json --rigid")
    assert code == 2
    assert out.count("the cameras did not move as one") == 2


def test_points_that_disagree_are_named(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    pixels = pixels_of(MESH.vertices, CAMERA, pose_of(1))
    inside = np.isfinite(pixels).all(axis=1) & (np.abs(pixels - (240, 180)) < (240, 180)).all(
        axis=1
    )
    pairs = np.hstack((pixels, MESH.vertices))[inside][:9]
    pairs[6, 0] += 30
    rows = [",".join(map(str, row)) for row in pairs.tolist()]
    (folder / "nine.csv").write_text("\n".join(("u,v,x,y,z", *rows)))
    line = "locate photos/east.png plan.toml -p rig.json --of east --points nine.csv"
    code, out, _ = call(capsys, f"{line} --pixel-error 0.3 --out nine")
    assert code == 0, out
    page = (folder / "nine/locate.html").read_text(encoding="utf-8")
    assert "east: points that disagree with the others and are left out: 7." in page


def picture_in(page):
    """The first picture of a page."""
    found = re.search('base64,([^"]+)', page.read_text(encoding="utf-8"))[1]
    return np.asarray(Image.open(BytesIO(b64decode(found))).convert("L"), dtype=float)


@pytest.mark.parametrize("kind", ["turned.jpg", "deep.png"])
def test_pictures_are_turned_as_they_say_and_shown_in_all_depths(folder, capsys, monkeypatch, kind):
    monkeypatch.chdir(folder)
    grey = Image.open("photos/east.png")
    if kind == "turned.jpg":  # a browser turns it, too: points are clicked in the upright one
        exif = Image.Exif()
        exif[0x0112] = 6
        grey.rotate(90, expand=True).save(kind, exif=exif, quality=95)
    else:
        Image.fromarray(np.asarray(grey, dtype=np.uint16) * 257).save(kind)
    code, out, _ = call(capsys, f"locate {kind} plan.toml -p rig.json --of east --out {kind[:4]}")
    assert code == 0, out
    shown = picture_in(folder / kind[:4] / "locate.html")
    assert np.corrcoef(shown.ravel(), np.ravel(grey))[0, 1] > 0.8


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("small.png --of east", "error: expected a photograph of 480 x 360 px as its camera, got"),
        ("small.png --of east", "scale the camera by 0.5"),
        ("text.png --of east", "expected a picture in 'text.png'"),
        ("photos/east.png", "expected the camera of east.png among 2 cameras"),
        ("photos/east.png --of roof", "roof"),
        ("photos/east.png --of 3", "expected --of to be east, door, 1 or 2, got '3'"),
        ("photos/east.png --of 1 --points three.csv", "at least 4 points, got 3"),
        ("photos/east.png --of 1 --points words.csv", "expected numbers in every row"),
        ("photos/east.png --of 1 --points none.csv", "none.csv"),
        ("photos/east.png --of 1 --points /dev/zero", "a regular file, got a device"),
        ("photos --points four.csv", "expected one photograph for --points, got 2"),
        ("empty", "expected photographs named as cameras"),
        ("more", "expected photographs named as cameras (east.jpg, ...), got roof.png"),
        ("twice", "got east.jpg and east.png; remove one"),
        ("none.png --of east", "none.png"),
        ("photos/east.png --of east --within near", "--within"),
    ],
)
def test_wrong_input_is_refused_in_one_line(folder, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(folder)
    code, out, err = call(capsys, f"locate {arguments} plan.toml -p rig.json --out refused")
    assert code == 2
    assert out == ""
    (line,) = [each for each in err.splitlines() if each.startswith("error: ")]
    assert words in line
    assert not (folder / "refused").exists()
