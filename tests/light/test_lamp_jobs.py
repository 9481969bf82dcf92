"""Lamps as arguments of `evaluate`."""

from pathlib import Path

from test_jobs import POSES, RIG, folder  # noqa: F401 # for every test

import rastercov as rc


def test_lamps_are_taken_from_a_file_and_motion_from_poses_of_bodies():
    Path("lamps.toml").write_text("[lamps.a]\nintensity_cd = 9\nposition = [0, 0, 3]\n")
    mesh, body = rc.Mesh.load("part.obj"), rc.turntable(3)
    name = mesh.groups[0].name
    by_file, by_value = (
        rc.evaluate(mesh, RIG.cameras[0], POSES, lamps=lamps, motion=motion, fields=()).over_time
        for lamps, motion in (
            ("lamps.toml", {name: body}),
            (rc.load_lamps("lamps.toml"), rc.Motion(mesh, {name: body})),
        )
    )
    assert 0 < by_file.share() == by_value.share()
