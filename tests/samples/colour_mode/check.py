"""A mode is in the menu of pages, with its values, and a viewer has them."""

import numpy as np

import rastercov as rc
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.page.session import Session, remove_head
from rastercov.report.modes import mode_picture
from rastercov.report.pages import values_of, view_page


def check(command, folder):
    """A page of recorded figures, a picture, and the frame of a viewer."""
    mesh, camera = rc.shapes.box(), rc.Camera.from_fov(64, 48, hfov_deg=60)
    poses, task = rc.Poses.of(rc.sphere_of_poses((0, 0, 0), 4, 2)), rc.Task(views=2)
    network = rc.evaluate(mesh, camera, poses, task, by="face").network
    need = np.full(mesh.n_faces, 2)
    values = values_of(network, network.covered, ["A", "B"], None, need)
    np.testing.assert_array_equal(values["missing"], need - network.views)
    assert "Missing views" in view_page("box", mesh, camera, poses, ["A", "B"], values, {})
    assert mode_picture("missing", mesh, values["missing"]).size[0] > 0
    session = Session(Scene("box", mesh, RigState.of(rc.Rig([camera]), poses, task=task)))
    head, levels = remove_head(session.ask({"question": "frame", "mode": "missing"}))
    session.close()
    assert len(levels) == mesh.n_faces
    assert {"1 view", "2 views"} & {each["label"] for each in head["legend"]}
