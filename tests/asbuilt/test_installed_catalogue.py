"""A plan that names a camera of the catalogue: its lens and size are those of the photograph."""

import json

import numpy as np
from commands import call
from PIL import Image
from test_edges import MESH, off, photograph, pose_of

import rastercov as rc

PLAN = """meshes = [{ path = "cell.obj" }]
[camera]
preset = "kinect-v1"
[selection]
goal = "best_coverage"
cameras = 1
"""


def test_a_camera_of_the_catalogue_is_located(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    MESH.to_trimesh().export("cell.obj")
    (tmp_path / "plan.toml").write_text(PLAN)
    camera = rc.Camera.preset("kinect-v1")
    planned = pose_of(1)
    turned = off(planned, 2, 1.5, 0)
    rc.write_views(
        "rig.json", rc.Views(rc.Rig([camera]), rc.Poses.of(planned[None]), images=("east",))
    )
    photo = photograph(MESH, turned, 2, camera)
    Image.fromarray((255 * photo).astype(np.uint8)).save("photo.png")
    code, out, _ = call(capsys, "locate photo.png plan.toml -p rig.json --json")
    assert code == 1
    (told,) = json.loads(out)["cameras"]
    assert told["verdict"] == "moved"
    assert abs(told["turned_deg"] - 1.5) < 0.1
    Image.fromarray((255 * photo).astype(np.uint8)[::2, ::2]).save("small.png")
    code, _, err = call(capsys, "locate small.png plan.toml -p rig.json")
    assert code == 2
    assert "scale the camera by 0.5" in err
