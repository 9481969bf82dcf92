"""A part in millimetres that is read as metres gets a line that asks for the unit, everywhere."""

from pathlib import Path

import pytest
from commands import call, write_part

from rastercov.camera.camera import Camera
from rastercov.camera.formats.doubts import unit_doubts
from rastercov.camera.pose import Poses
from rastercov.camera.pose_file import write_poses
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.mesh import shapes

CAMERA = "width = 64\nheight = 48\nfx = 80\nfy = 80\n"
EYE = Camera(width=64, height=48, fx=80, fy=80)
PLAN = (
    '[[meshes]]\npath = "part.obj"\n[camera]\nfile = "camera.toml"\n[[candidates]]\n'
    'generator = "poses"\nfile = "rig.json"\n[selection]\ngoal = "fewest_cameras"\n'
    "coverage = 0.2\n"
)
RUNS = [
    "evaluate part.obj -c camera.toml -p rig.json --pictures 0 --table none",
    "render part.obj -c camera.toml -p rig.json",
    "view part.obj -c camera.toml -p rig.json --export page.html",
    "check plan.toml -p rig.json",
]


@pytest.fixture(autouse=True)
def files():
    write_part("part.obj", side=85.0)
    Path("camera.toml").write_text(CAMERA)
    Path("plan.toml").write_text(PLAN)
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 0.6, 4))


@pytest.mark.parametrize("line", RUNS)
def test_millimetres_read_as_metres_are_asked_for_in_every_command(line, capsys):
    _, _, err = call(capsys, line)
    assert err.count("the mesh measures 85 x 85 x 85 m") == 1
    assert "mm?" in err
    Path("plan.toml").write_text(PLAN.replace("[camera]", 'unit = "mm"\n[camera]'))
    unit = "" if "plan" in line else " --unit mm"
    assert "the mesh measures" not in call(capsys, line + unit)[2]


@pytest.mark.parametrize("limits", ["", "[constraints]\nstand_off = [0.2, 0.5]\n"])
def test_a_plan_whose_candidates_are_all_rejected_asks_too(capsys, limits):
    """Without a stand-off they are all in the solid."""
    Path("plan.toml").write_text(PLAN + limits)
    code, _, err = call(capsys, "place plan.toml")
    assert code == 2
    assert "expected candidates, got none" in err
    assert "unit of [[meshes]] mm?" in err


@pytest.mark.parametrize("distance", [0.15, 0.3, 0.6, 1.2])
@pytest.mark.parametrize("corner", [0.0, 0.5])
@pytest.mark.parametrize("n_poses", [1, 12])
def test_cameras_around_a_part_tell_its_unit(distance, corner, n_poses):
    """At any distance, and wherever in the part the origin is."""
    part = shapes.box((85.0, 60.0, 20.0)).moved(translation=(85 * corner, 0, 0))
    centre = part.bounds.mean(axis=0) / 1000
    poses = Poses.of(sphere_of_poses(centre, distance, n_poses))
    assert unit_doubts(part, EYE, poses)
    assert not unit_doubts(part.moved(scale=1e-3), EYE, poses)


@pytest.mark.parametrize("name", ["room", "aeroplane"])
def test_cameras_in_and_around_large_scenes_are_no_doubt(name):
    mesh = shapes.by_name(name)
    size = float(max(mesh.bounds[1] - mesh.bounds[0]))
    for distance in (0.2, 0.6, 2.0):
        poses = Poses.of(sphere_of_poses(mesh.bounds.mean(axis=0), distance * size, 8))
        assert not unit_doubts(mesh, EYE, poses)
