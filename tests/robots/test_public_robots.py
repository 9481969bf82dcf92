"""Robots of public descriptions, which pip fetches at night: kinematics by another library.

Their files have their own terms, and are in no folder of this project.
"""

import subprocess
import sys
import zipfile
from importlib import import_module

import numpy as np
import pytest
from nightly import nightly

import rastercov as rc
from rastercov.base.errors import MeshError

pytestmark = [nightly, pytest.mark.slow]
DATA = ("example-robot-data==6.0.0", "airo-models==0.0.12")
ORACLE = ("yourdfpy==0.0.60", "lxml", "six")
ROBOTS = {
    "a1_description/urdf/a1.urdf": 12,
    "baxter_description/urdf/baxter.urdf": 17,
    "centauro_description/urdf/centauro.urdf": 39,
    "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf": 43,
    "icub_description/robots/icub.urdf": 32,
    "panda_description/urdf/panda.urdf": 8,
    "pr2_description/urdf/pr2.urdf": 20,
    "robotiq_2f_85/urdf/robotiq_2f_85.urdf": 1,
    "talos_data/robots/talos_full_v2.urdf": 32,
    "tiago_description/robots/tiago.urdf": 48,
    "ur5e/ur5e.urdf": 6,
    "ur_description/urdf/ur10_robot.urdf": 6,
}
"""Files and their joints that move by themselves."""
SAME = 1e-12


@pytest.fixture(scope="module")
def descriptions(tmp_path_factory):
    """Folder with the content of the wheels of robots."""
    folder = tmp_path_factory.mktemp("robots")
    pip("download", "--only-binary", ":all:", "--dest", folder, *DATA)
    for wheel in folder.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def yourdfpy(tmp_path_factory):
    """The library, without what it needs for meshes."""
    folder = tmp_path_factory.mktemp("oracle")
    pip("install", "--target", folder, *ORACLE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield import_module("yourdfpy")


def pip(command, *arguments):
    words = (sys.executable, "-m", "pip", command, "--quiet", "--no-deps", *map(str, arguments))
    subprocess.run(words, check=True)


def packages_of(path, top):
    """Folders by names that `package://` may have, the nearest first."""
    packages = {}
    for folder in path.parents[: path.parents.index(top)]:
        for each in (folder, *filter(lambda own: own.is_dir(), folder.iterdir())):
            packages.setdefault(each.name, each)
    return packages


@pytest.mark.parametrize("name", ROBOTS)
def test_frames_of_a_public_robot_are_those_of_another_library(name, descriptions, yourdfpy):
    (path,) = descriptions.rglob(name)
    for geometry in ("collision", "visual"):
        robot = rc.Robot.load(path, packages_of(path, descriptions), geometry=geometry)
        assert robot.mesh.n_faces >= 100
    model = yourdfpy.URDF.load(str(path), load_meshes=False, load_collision_meshes=False)
    assert set(robot.joint_names) == set(model.actuated_joint_names)
    assert len(robot.joint_names) == ROBOTS[name]
    driven = {joint.mimic.joint for joint in model.joint_map.values() if joint.mimic}
    for own, limits in zip(robot.joint_names, robot.limits.tolist(), strict=True):
        limit, kind = model.joint_map[own].limit, model.joint_map[own].type
        ends = [-np.inf, np.inf] if kind == "continuous" else [limit.lower or 0, limit.upper or 0]
        assert ends[0] <= limits[0] <= limits[1] <= ends[1]
        assert own in driven or limits == ends
        assert limits[0] < limits[1] or ends[0] == ends[1]
    low, high = np.clip(robot.limits, -3, 3).T
    joints = np.random.default_rng(0).uniform(low, high, (20, len(low)))
    frames, root = robot.frames(joints), robot.links[0]
    for row, values in enumerate(joints):
        model.update_cfg(dict(zip(robot.joint_names, values, strict=True)))
        for link in robot.links:
            assert np.abs(model.get_transform(link, root) - frames[link][row]).max() <= SAME


def test_every_public_robot_is_read_or_refused_in_one_line(descriptions):
    read, refused = [], []
    for path in sorted(descriptions.rglob("*.urdf")):
        try:
            rc.Robot.load(path, packages_of(path, descriptions))
        except MeshError as error:
            refused.append(str(error).removeprefix(str(path)))
        else:
            read.append(path.name)
    assert len(read) >= 60
    assert len(refused) <= len(read) / 4
    assert all(text.startswith(": ") and text.isprintable() for text in refused)
