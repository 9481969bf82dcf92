"""Answers to what camera files leave open, where nothing asks for them: each command says so."""

from pathlib import Path

import pytest
from commands import call, write_part

from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses

PLAN = '[[meshes]]\npath = "part.obj"\n[selection]\ngoal = "fewest_cameras"\ncoverage = 0.1\n'
SOURCES = {"preset": "-c khepra", "entries": "-c 'width = 64, height = 48, fx = 60'",
           "file": "-c camera.toml"}  # fmt: skip
COMMANDS = {
    "evaluate": "evaluate part.obj -p {poses} --pictures 0",
    "render": "render part.obj -p {poses} --device cpu",
    "sheet": "sheet part.obj -p {poses}",
    "compare": "compare part.obj -p {poses} --faces 0 --no-convergence",
    "view": "view part.obj -p {poses} --export a.html --still",
    "view without poses": "view part.obj --export a.html --still",
    "view of a plan": "view plan.toml --export a.html --still",
    "view of a plan and poses": "view plan.toml -p rig.json --export a.html --still",
    "check": "check plan.toml -p rig.json",
}
CASES = [(what, "sphere:2" if poses else "rig.json") for what in COMMANDS for poses in (0, 1)
         if poses == 0 or "{poses}" in COMMANDS[what]]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("what", "poses"), CASES)
def test_an_image_size_that_no_camera_needs_is_said(what, poses, here, capsys, monkeypatch):
    write_part("part.obj")
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 4, 2))
    Path("plan.toml").write_text(PLAN)
    Path("camera.toml").write_text("width = 64\nheight = 48\nfx = 60\n")
    for camera in SOURCES.values() if what in ("evaluate", "check") else ["-c khepra"]:
        line = f"{COMMANDS[what].format(poses=poses)} {camera}"
        said = "warning: --image-size was not used: the file states or does not need it"
        code, _, error = call(capsys, f"{line} --image-size 800x600")
        assert code in (0, 1), error
        assert error.splitlines().count(said) == 1, line
        assert "was not used" not in call(capsys, line)[2]
