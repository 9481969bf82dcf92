"""What a plan cannot hold: a line with its path for each, of files, scenes and candidates."""

from pathlib import Path

import numpy as np
import pytest
from test_plan import BASE, CAMERA, ENTRY, errors, plan_of

import rastercov as rc
from rastercov.placement.plan.file import PlanError
from rastercov.placement.plan.prepare import cells_of
from rastercov.placement.plan.run import place
from rastercov.placement.plan.scene import candidate_pool, scene

WIDE = "width = 160\nheight = 120\nhfov_deg = 80\n"
EYE = "[cameras.eye]\n" + WIDE
PAIR = """[rigs.pair]
cameras = [{ camera = "eye", name = "left" }, { camera = "eye", name = "right" }]
"""
BOX = "[[meshes]]\nbuilt_in = 'box'\n"
TASK = BASE + "[task]\n"
SPACE = BASE + "[[constraints.spaces]]\n"
KEEP_OUT = BASE + "[[constraints.keep_out]]\nname = 'table'\n"
SELECTION = BASE + "[selection]\n"
TURN = BASE.replace('"box"\n', '"box"\ntransform = {{ {} }}\n').format
TARGET = BASE.replace('"box"', '"room"') + "[[targets]]\n"
SHEET = TARGET + 'above = "room"\n'
GRID = TARGET + "box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\n"
ONE_CAMERA = BOX + "[camera]\n" + WIDE


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "meshes: expected an entry, got none; add it"),
        (BASE.replace("[[meshes]]", "[meshes]"), "meshes: expected a list"),
        ("x = [", "expected valid TOML"),
        ("x = 1\nx = 2", "expected valid TOML"),
        ("[[meshes]]\n" + CAMERA, "meshes[0]: expected one of path, built_in, got none"),
        ("[[meshes]]\nbuilt_in='box'\nunit='mm'\n" + CAMERA, "meshes[0]: expected metres"),
        (TURN("scale = 0"), "meshes[0].transform.scale: expected a number above 0, got 0"),
        (TURN("axis = [0, 0, 0]"), "meshes[0].transform.axis: expected a direction, got [0, 0, 0]"),
        # targets
        (TARGET, "targets[0]: expected one of above, box, file, got none"),
        (SHEET, "targets[0]: expected above and height, got one"),
        (SHEET + "box = [[0, 0, 0], [1, 1, 1]]", "targets[0]: expected one of above, box, file"),
        (SHEET + "height = 1\nspacing = 0.5", "targets[0]: expected box with spacing"),
        (SHEET + "height = 1\nwithin = 0.1", "targets[0]: expected near with within, got none"),
        (SHEET + "height = -1", "targets[0].height: expected a number of 0 or more"),
        (SHEET + 'height = 1\nunit = "mm"', "targets[0]: expected unit with a file"),
        (GRID + "count = [1, 1]", "targets[0].count: expected 3 or more entries"),
        (
            GRID + "count = [1, 1, 1]\nspacing = 0.1",
            "targets[0]: expected count or spacing, got both",
        ),
        (GRID.replace("1.0]]", "0.0]]"), "targets[0]: expected low < high, got"),
        (TARGET + "box = [[0, 0, 0]]", "targets[0].box: expected 2 or more entries"),
        (TARGET + 'file = "no.stl"', "targets[0].file: expected a file, got 'no.stl'"),
        # cameras and rigs
        (BASE + "aperture = 0.1", "camera: expected aperture and focus_distance together"),
        (BASE + "width = 0", "camera: expected width to be a whole number of pixels"),
        (BASE + "file = 'plan.toml'", "camera: expected only near"),
        (BOX + "[camera]\nfile = 'x.toml'", "camera.file: expected a file"),
        (BOX + "[camera]\nwidth = 3", "camera: expected image size and focal"),
        (ONE_CAMERA + "cost = 1", "camera.cost: expected "),
        (ONE_CAMERA + EYE, "expected camera or cameras, got both"),
        (BOX + EYE + "cost = -1", "cameras.eye.cost: expected a number of 0 or more"),
        (BOX + "[cameras.eye]\nwidth = 3", "cameras.eye: expected image size and focal"),
        (BOX + EYE + "price = 3", "cameras.eye.price: expected "),
        (
            BOX + EYE + PAIR.replace('"eye"', '"ear"'),
            "rigs.pair.cameras: expected a camera (eye), got 'ear'",
        ),
        (BOX + EYE + PAIR.replace("pair", "eye"), "rigs.eye: expected another name"),
        (
            BOX + EYE + "[rigs.none]\ncost = 1",
            "rigs.none: expected one of cameras, file, preset, got none",
        ),
        (BOX + EYE + PAIR + "cost = -1", "rigs.pair.cost: expected a number of 0"),
        (BOX + '[rigs.pair]\nfile = "gone.json"', "rigs.pair.file: expected a file"),
        (BOX + '[rigs.pair]\nfile = "room.obj"', "rigs.pair: room.obj"),
        # task, selection, constraints
        (TASK + "min_coverage = 1.5", "task.min_coverage: expected a number of 1 or less"),
        (TASK + "min_pixels = true", "task.min_pixels: expected a number, got True"),
        (TASK + "min_pixels = nan", "task.min_pixels: expected a finite number, got nan"),
        (TASK + "views = 1.5", "task.views: expected a whole number"),
        (TASK + "views = {box = 0}", "task.views.box: expected a number of 1 or more"),
        (TASK + "supersample = 2", "task: expected method sampled with supersample"),
        (TASK + "method = 'ray'", "task.method: expected 'certified', 'exact' or 'sampled'"),
        (TASK + "resolution_of_result = 0", "task.resolution_of_result: expected a number above 0"),
        (TASK + "resolution_of_result = 1\nby = 'face'", 'task: expected by = "area"'),
        (TASK + "weight_by = 'count'\nby = 'area'", 'task: expected by = "face"'),
        (SELECTION + "coverage = 1", "selection.goal: expected an entry, got none"),
        (SELECTION + "goal = 'best_coverage'", "selection: expected cameras, budget or both"),
        (SELECTION + "goal = 'most'", "selection.goal: expected one of fewest_cameras"),
        (
            BASE + "[constraints]\nclearance = -1",
            "constraints.clearance: expected a number of 0 or",
        ),
        (
            SPACE + "low = [0, 0, 1]\nhigh = [1, 1, 0]",
            "constraints.spaces[0]: expected low <= high",
        ),
        (KEEP_OUT + "low = [0, 0, 0]", "constraints.keep_out[0]: expected low and high, got one"),
        (
            KEEP_OUT + "centre = [0, 0]",
            "constraints.keep_out[0].centre: expected 3 or more entries",
        ),
        # candidates
        (ENTRY + "'on_sphere'\ncount = 0", "candidates[0].count: expected a number of 1 or more"),
        (ENTRY + "'per_face'\nup = [0, 0, 0]", "candidates[0].up: expected a direction"),
        (ENTRY + "'poses'\nfile = '/'", "candidates[0].file: expected a file"),
        (ENTRY + "'per_face'\ncameras = ['fish']", "candidates[0].cameras: expected a camera"),
    ],
)
def test_each_error_says_what_was_wanted(text, line):
    assert [error for error in errors(text) if error.startswith(line)], errors(text)


FLAT = TASK + "resolution_of_result = {}\n"
FAR = ENTRY + "'per_face'\nstand_off = [90, 99]\n"


def cells(plan):
    cells_of(plan, scene(plan))


def pool(plan):
    candidate_pool(plan, scene(plan))


def placed(plan):
    place(plan, None)


@pytest.mark.parametrize(
    ("step", "text", "line"),
    [
        (scene, BASE.replace("[camera]", 'role = "occluder"\n[camera]'), "meshes: expected"),
        (scene, SHEET.replace("room", "flor") + "height = 1", "meshes[0].built_in: expected one"),
        (scene, TARGET + 'above = "flor"\nheight = 1', "targets[0]: expected a mesh file"),
        (
            scene, SHEET + 'height = 1\nnear = ["flor"]\nwithin = 1',
            "targets[0]: expected a mesh file or a group, got 'flor'",
        ),
        (scene, TARGET + 'file = "bad.obj"', "targets[0]: bad.obj"),
        (scene, GRID + "spacing = 0.001", "targets[0]: "),
        (scene, GRID + "size = 2.0", "targets[0]: "),
        (
            scene, SHEET + 'height = 1\nname = "eyes"\n[[targets]]\nabove = "eyes"\nheight = 1',
            "targets[1]: expected a mesh file or a group, got ",
        ),
        (pool, FAR, "candidates[0]: expected a stand-off"),
        (cells, FLAT.format(1e-5), "task.resolution_of_result: expected at most "),
        (cells, FLAT.format(1e-300), "task.resolution_of_result: expected at most "),
        (cells, FLAT.format("1\nmin_pixels = 3"), "task.resolution_of_result: expected a"),
        (placed, BOX, "candidates: expected one entry or more"),
        (placed, BOX + ENTRY[len(BASE) :] + "'per_face'", "camera: expected an entry, got none"),
        (placed, FAR, "selection: expected a goal"),
        (
            placed, BOX + EYE + PAIR.replace('"right"', '"left"')
            + "[[candidates]]\ngenerator = 'per_face'\n[selection]\ngoal = 'fewest_cameras'",
            "rigs.pair: expected names to be 2 distinct",
        ),
    ],
)  # fmt: skip
def test_what_the_scene_refuses_has_a_line_too(step, text, line):
    Path("bad.obj").write_text("v 1 2\n")
    with pytest.raises(PlanError) as caught:
        step(plan_of(text))
    assert [result for result in caught.value.lines if result.startswith(f"plan.toml: {line}")]


@pytest.mark.parametrize("failing", ['above = "flor"\nheight = 1', 'file = "bad.obj"'])
@pytest.mark.parametrize("name", ["", 'name = "eyes"\n'])
def test_a_target_that_failed_gives_one_line_only(failing, name, tmp_path, monkeypatch):
    """Whatever else names it, and though nothing is left to be seen without it."""
    monkeypatch.chdir(tmp_path)
    Path("bad.obj").write_text("nothing")
    group = "eyes" if name else "bad" if "file" in failing else "flor + 1 m"
    text = TARGET.replace("[camera]", 'role = "occluder"\n[camera]') + name + failing
    text += f'\n[task]\nviews = {{ "{group}" = 2 }}\n[selection]\ngoal = "fewest_cameras"\n'
    text += f'coverage = 0.5\ngroups = {{ "{group}" = 0.6, "{group[:3]}*" = 0.1 }}\n'
    with pytest.raises(PlanError) as caught:
        scene(plan_of(text))
    (line,) = caught.value.lines
    assert "targets[0]: " in line


def test_poses_of_existing_cameras_without_names_are_an_error_of_the_plan(folder):
    np.save("kept.npy", np.eye(4)[None])
    np.save("new.npy", np.eye(4)[None])
    text = f"""{BOX}{EYE}{EYE.replace("eye", "far")}
[[candidates]]
generator = "poses"
file = "new.npy"
[existing]
file = "kept.npy"
[selection]
goal = "best_coverage"
cameras = 1
"""
    Path("plan.toml").write_text(text)
    with pytest.raises(PlanError, match="existing: expected the camera of each pose") as error:
        rc.place("plan.toml")
    assert "--camera-name" not in str(error.value)
