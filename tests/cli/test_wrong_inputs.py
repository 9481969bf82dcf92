"""Wrong inputs of every command: one line of at most 160 characters that names the option or file,
says what was expected, what came and what to do; exit code 2, and no file is written or changed.
"""

from pathlib import Path

import pytest
from commands import call, content, refusal, write_part

from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.models import MODELS
from rastercov.core.camera.viewpoints import sphere_of_poses

EVALUATE = "evaluate part.obj -c camera.toml -p rig.json"
CHECK = "check plan.toml -p rig.json"
FILES = {
    "camera.toml": "width = 64\nheight = 48\nfx = 60\n",
    "list.toml": "width = 64\nheight = [48]\nfx = 60\n",
    "plan.toml": '[[meshes]]\npath = "part.obj"\n[camera]\nwidth = 64\nheight = 48\nfx = 60\n'
    '[selection]\ngoal = "fewest_cameras"\ncoverage = 0.5\n',
    "nan.obj": "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n",
    "lamps.toml": '[key]\nkind = "point"\n',
    "broken.step": "ISO-10303-21;\nbroken",
}
LINES = {
    # files: missing, of another kind, unreadable
    "evaluate prat.obj -p rig.json": "prat.obj: no such file or directory; did you mean "
    "'part.obj'?",
    "evaluate part -p rig.json": "part: expected a mesh file or a built-in mesh, such as "
    "aeroplane, aeroplane-9856, box, icosahedron, room and 5 more, got none; did you "
    "mean 'part.obj'?",
    "evaluate folder -p rig.json": "folder: expected a mesh file or a built-in mesh, such as "
    "aeroplane, aeroplane-9856, box, icosahedron, room and 5 more, got a folder",
    "evaluate TEAPOT -p rig.json": "TEAPOT: expected a mesh file or a built-in mesh, such as "
    "teapot, teapot-5, teapot-12 and 7 more, got none",
    "evaluate nan.obj -p rig.json": "nan.obj: expected finite coordinates within ±1e+30, got other "
    "values in faces [0], 1 in all; repair them or drop them on loading (drop_invalid)",
    "render part.obj -c camera.json -p rig.json": "camera.json: no such file or directory; did you "
    "mean 'camera.toml'?",
    "render part.obj -c list.toml -p rig.json": "list.toml: expected height to be a number, got "
    "[48]",
    "render part.obj -c picture.png -p rig.json": "picture.png: expected valid text, got: byte "
    "0x89 at 0; save it as UTF-8",
    "convert part.obj out.npy": "part.obj: expected a camera or pose file in one of 29 "
    "formats, got another file; to name its format, use rastercov convert --from FORMAT",
    "place plan": "plan: no such file or directory; did you mean 'plan.toml'?",
    f"{EVALUATE} --lamps lamps.toml": "lamps.toml: expected a table [lamps.NAME] per lamp, and "
    "only ambient and [exposure] beside them, got 'key'; rename it",
    f"{EVALUATE} --out part.obj": "part.obj: expected a folder, got a file; name another",
    f"{EVALUATE} --thesis --min-coverage 0.3": "expected --thesis or --min-coverage, got both "
    "(0.3); give one",
    # cameras and poses
    "evaluate part.obj -c 'width = 64, height = 48, fx = 60, k1 = 0.1' -p rig.json": "--camera "
    "width = 64, height..., fx = 60, k1 = 0.1: expected known entries of a camera (such as "
    "distortion), got 'k1'; give distortion = [k1, k2, p1, p2, k3]",
    "evaluate part.obj -c 'width = 64, height = 48, model = \"fish\"' -p rig.json": "--camera "
    'width = 64, height = 48, model = "fish": expected model to be one of fisheye62 and '
    f"{len(MODELS) - 1} more, got 'fish'",
    "evaluate part.obj -c rpi-hq -p rig.json": "--camera: expected a lens for rpi-hq (mount CS), "
    "got none; give focal_length or rpi-hq+LENS, such as rpi-hq+fujinon-hf6xa-5m, or give a file",
    "evaluate part.obj -c thorlabs-mvbt2353 -p rig.json": "--camera: expected a camera of the "
    "catalogue, got lens 'thorlabs-mvbt2353'; give CAMERA+thorlabs-mvbt2353, see rastercov "
    "cameras, or give a file",
    "evaluate part.obj -c camera.toml -p spere:12": "--poses: expected a file, sphere:N or "
    "turntable:N@DEG, got 'spere:12'; correct it",
    "check plan.toml -p sphere:12": "--poses: expected a pose file, such as rig.json of evaluate "
    "--out, got 'sphere:12'; correct it",
    "check plan.toml -p camera.toml": "camera.toml: expected poses, got cameras only; give a file "
    "with poses",
    f"{EVALUATE} --camera-name left": "--camera-name: expected one of 'camera 1', got 'left'",
    # values of options
    f"{EVALUATE} --sheet ''": "--sheet: expected a value, got an empty text; give one",
    f"{EVALUATE} --unit=furlong": "--unit: expected one of m, mm, cm, um, in, inch, ft or a "
    "positive number of metres, got 'furlong'",
    f"{EVALUATE} --pose-unit furlong": "--pose-unit: expected unit to be one of m, mm, cm, um, "
    "in, inch, ft or a positive number of metres, got 'furlong'",
    f"{EVALUATE} --pixel-centre 1": "--pixel-centre: expected 0 or 0.5, got 1.0",
    f"{EVALUATE} --by part": "--by: expected area or face, got 'part'",
    f"{EVALUATE} --views 100000": "--views: expected a whole number, from 1 to 10000, got 100000",
    f"{EVALUATE} --max-incidence-deg 120": "--max-incidence-deg: expected a number greater than 0 "
    "and at most 90, got 120.0",
    f"{EVALUATE} --min-illuminance 100": "expected lamps for --min-illuminance, got none; give "
    "lamps, or leave it out",
    f"{EVALUATE} --workers 0": "--workers: expected a number from 1 to 1024, got 0; correct it",
    "cameras --mount X": "--mount: expected C, CS, E, F or S, got 'X'",
    "demo --shape=cube": "--shape: expected a built-in mesh, such as aeroplane, aeroplane-9856, "
    "box, icosahedron, room and 5 more, got 'cube'",
    "convert rig.json out.npy --from colmapp": "--from: expected format to be one of 29 names, "
    "such as colmap, got 'colmapp'",
    "sheet part.obj -c camera.toml -p rig.json --paper A9": "--paper: expected A4, A3, A2, A1 or "
    "A0, got 'A9'",
    "sheet part.obj -c camera.toml -p rig.json --scale 50": "--scale: expected auto or 1:N, got "
    "'50'; write 1:50",
    "compare part.obj -c camera.toml -p rig.json --against up": "--against: expected a reference, "
    "got 'up'; use exact, polygons, rational",
    f"{CHECK} --tolerance 2": '--tolerance: expected errors of cameras, "2 mm, 0.2 deg, 1 %" '
    "(focal length), and \"part 3 mm\", got '2'; give each kind once, in mm, cm, m, deg, degrees, "
    "%",
    f"{CHECK} --group lidd=0.5": "--group: expected a mesh file or a group, "
    "got 'lidd'; correct the name (groups: lid, rest)",
    f"{CHECK} --allow-worse 0.5": "--allow-worse: expected a baseline, got none; name its "
    "check.json",
    # usage
    "evaluate part.obj": "expected --poses, got none; see rastercov evaluate --help",
    "audit rig.json": "expected MESH, got none; see rastercov audit --help",
    "evaluate part.obj -p": "-p: expected a value, got none; see rastercov evaluate --help",
    f"{EVALUATE} --pdf=1": "--pdf: expected no value, got one; see rastercov evaluate --help",
    f"{EVALUATE} --outt x": "expected a known option, got --outt; did you mean --out, --output, "
    "--unit?; see rastercov evaluate --help",
    "evalute part.obj": "expected a known command, got evalute; did you mean 'evaluate', "
    "'validate'?; see rastercov --help",
    "doctor extra": "expected no further argument, got extra; see rastercov doctor --help",
    "validate": "expected a command, got none; see rastercov validate --help",
    "sun part.obj --latitude 49N": "--latitude: expected a number, got '49N'; see rastercov sun "
    "--help",
    "view part.obj --port 99999": "--port: expected a number of at most 65535, got '99999'; see "
    "rastercov view --help",
}


@pytest.fixture(autouse=True)
def files():
    write_part("part.obj")
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 4, 3))
    Path("folder").mkdir()
    Path("picture.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    for name, text in FILES.items():
        Path(name).write_text(text)


@pytest.mark.slow
@pytest.mark.parametrize("line", LINES)
def test_a_wrong_input_gets_one_line_and_leaves_no_file(line, capsys):
    before = content(".")
    error = refusal(capsys, line)
    assert error == f"error: {LINES[line]}\n"
    assert len(LINES[line]) <= 160
    assert content(".") == before


@pytest.mark.slow
def test_the_words_of_open_cascade_are_shortened(capsys):
    error = refusal(capsys, "evaluate broken.step -c camera.toml -p sphere:2")
    assert error.startswith("error: broken.step: expected a STEP file that Open CASCADE reads, got")
    assert error.endswith("; export it again, as AP214 or AP242\n")
    assert len(error) <= 168


def test_a_field_of_the_title_block_may_be_empty(capsys):
    code, *_ = call(capsys, "sheet part.obj -c camera.toml -p rig.json --customer ''")
    assert code == 0
