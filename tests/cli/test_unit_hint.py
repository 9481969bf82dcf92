"""A part in millimetres that is read as metres gets a line that asks for the unit, everywhere."""

import re
from pathlib import Path

import numpy as np
import pytest
from commands import call, write_part

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.doubts import unit_warnings
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import shapes

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


AROUND = [
    "evaluate part.obj -c camera.toml -p sphere:8 --pictures 0 --table none",
    "render part.obj -c camera.toml -p sphere:8",
    "compare part.obj -c camera.toml -p sphere:8 --method sampled@1",
    "view part.obj -c camera.toml -p sphere:8 --export page.html",
    "sheet part.obj -c camera.toml -p rig.json --out sheet.svg",
    "place around.toml",
    "check around.toml -p rig.json",
    "sun part.obj --latitude 48 --longitude 11 --day 2026-06-21 --step 60",
]
AROUND_PLAN = PLAN.replace('"poses"\nfile = "rig.json"', '"on_sphere"\ncount = 20')


@pytest.mark.parametrize("line", AROUND)
def test_cameras_that_are_placed_by_the_size_of_the_mesh_tell_its_unit(line, capsys):
    """A part of 0.5 m and a house of 9 m, read as of thousands of metres, and of a thousandth."""
    Path("around.toml").write_text(AROUND_PLAN)
    for side in (0.5e-3, 0.5, 9.0, 9e3):
        if side > 1e3 and line.startswith("place"):  # few cameras are chosen, not all around
            Path("camera.toml").write_text(CAMERA + "focus_range = [0.05, 30.0]\n")
        write_part("part.obj", side=side)
        write_poses("rig.json", sphere_of_poses((0, 0, 0), 2.5 * side, 8))
        _, _, err = call(capsys, line)
        assert err.count("the mesh measures") == (not 1e-3 < side < 1e3), (side, err)


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
    assert unit_warnings(part, EYE, poses)
    assert not unit_warnings(part.moved(scale=1e-3), EYE, poses)


@pytest.mark.parametrize("seed", range(12))
def test_cameras_near_a_part_name_the_ratio_of_its_size_to_their_distance(seed):
    """Around a corner of it that is the origin, and before its surface, of any shape and place."""
    random = np.random.default_rng(seed)
    sides = random.permutation([*random.uniform(30, 150, 2), random.uniform(80, 150)])
    part = shapes.box(tuple(sides))
    part = part.moved(translation=sides / 2 * random.choice((-1, 1), 3))
    camera = Camera.from_fov(640, 480, hfov_deg=random.uniform(25, 90))
    away = random.uniform(0.25, 0.4)
    face = random.integers(0, part.n_faces, 5)
    points = (part.vertices[part.faces[face]] * random.dirichlet((2, 2, 2), 5)[..., None]).sum(1)
    near = look_at(points + away * part.normals[face], points)
    around = sphere_of_poses(part.bounds.mean(axis=0) / 1e3, random.uniform(0.4, 0.6), 9)
    for poses in (near, around):
        (line,) = unit_warnings(part, camera, Poses.of(poses))
        ratio, millimetres = re.search(r" m, (\d+) times the ([\d.]+) mm ", line).groups()
        assert line.endswith("--unit mm?")
        assert float(ratio) == pytest.approx(1e3 * max(sides) / float(millimetres), rel=0.02)
        assert 100 < float(ratio) < 1000
    assert not unit_warnings(part.moved(scale=1e-3), camera, Poses.of(around))
    one = Poses.of(near[:1])  # as on the wall of a hall, close to a pillar
    assert not unit_warnings(part, camera, one)


@pytest.mark.parametrize("seed", range(40))
def test_cameras_in_halls_above_terrain_and_around_parts_are_no_doubt(seed):
    random = np.random.default_rng(seed)
    name = ("room", "aeroplane", "torus", "sphere", "teapot")[seed % 5]
    mesh = shapes.by_name(name).moved(scale=10 ** random.uniform(-0.5, 1.5))
    low, high = mesh.bounds
    size, n = float((high - low).max()), random.integers(1, 12)
    eyes = random.uniform(low, high, (n, 3))
    aims = random.uniform(low, high, (n, 3))
    above = np.add(eyes, (0, 0, size * random.uniform(0.3, 50)))
    beside = eyes[:1] + random.normal(0, 0.02 * size, (n, 3))
    camera = Camera.from_fov(640, 480, hfov_deg=random.uniform(20, 110))
    rigs = {
        "inside": look_at(eyes, aims),
        "drone": look_at(above, above - (0, 0, 1), (0, 1, 0)),
        "together": look_at(beside, beside + random.normal(size=(n, 3))),
        "around": sphere_of_poses((low + high) / 2, size * random.uniform(0.7, 9), n),
    }
    for name, poses in rigs.items():
        assert not unit_warnings(mesh, camera, Poses.of(poses)), name


@pytest.mark.parametrize("name", ["room", "aeroplane"])
def test_cameras_in_and_around_large_scenes_are_no_doubt(name):
    mesh = shapes.by_name(name)
    size = float(max(mesh.bounds[1] - mesh.bounds[0]))
    for distance in (0.2, 0.6, 2.0):
        poses = Poses.of(sphere_of_poses(mesh.bounds.mean(axis=0), distance * size, 8))
        assert not unit_warnings(mesh, EYE, poses)
