"""Scenes and sessions for tests of the viewer."""

import numpy as np
from edited import Session

import rastercov as rc
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.rig import Rig
from rastercov.core.camera.viewpoints import look_at, sphere_of_poses
from rastercov.core.mesh import shapes
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.page.session import remove_head

CAMERA = rc.Camera(width=320, height=240, fx=300, fy=300)
ROOM = shapes.room(6)
WIDE = rc.Camera(width=640, height=360, fx=320, fy=320)
EYES = ((2.5, 2.1, 2.5), (-2.6, -2.1, 2.5))
"""Cameras in the room, which look at its middle."""


def part():
    """A small part that hides some of itself."""
    return shapes.by_name("teapot-5")


def around(mesh, count=4):
    """Poses around a mesh that have it in view."""
    low, high = np.asarray(mesh.bounds)
    radius = 1.6 * float(np.linalg.norm(high - low))
    return sphere_of_poses((low + high) / 2, radius, count)


def state_of(mesh, count=4, camera=CAMERA, task=None, more=None):
    """Some cameras around a mesh, and perhaps one more at a pose."""
    poses = around(mesh, count) if count else np.empty((0, 4, 4))
    poses = poses if more is None else np.concatenate([poses, more[None]])
    return RigState.of(Rig([camera], ["eye"]), Poses.of(poses), task=task)


def session_of(mesh=None, count=4, **options):
    """A session on a part."""
    mesh = part() if mesh is None else mesh
    return Session(Scene("part", mesh, state_of(mesh, count, **options)))


def session_of_room():
    """A session on a room with two cameras inside."""
    poses = Poses.of(look_at(np.array(EYES), np.array([(0.0, 0.0, 0.6)] * len(EYES))))
    return Session(Scene("room", ROOM, RigState.of(Rig([WIDE], ["wide"]), poses)))


def percent_covered(state, **thresholds):
    """Percent of the room's area that `rc.evaluate` finds covered by the rig of a page's state."""
    poses = [np.reshape(each["pose"], (4, 4)) for each in state["stations"] if each["is_on"]]
    result = rc.evaluate(ROOM, WIDE, poses, rc.Task(**thresholds), fields=())
    return result.areas.summary()["percent"]


def acted(session, mode="reason", *, drag=False, shown=None, options=None, **action):
    """Head and levels after an action at the present revision."""
    frame = session.act(
        {
            "revision": session.history.revision, "mode": mode, "is_drag": drag,
            "station": shown, "options": options or {}, "action": action or {"do": "none"},
        }
    )  # fmt: skip
    head, levels = remove_head(frame)
    return head, np.frombuffer(levels, np.uint8)


def moved(pose, by=(0.0, 0.0, 0.0)):
    """A pose moved in the world, as a page sends it."""
    values = np.array(pose, np.float64).reshape(4, 4).copy()
    values[:3, 3] += by
    return values.ravel().tolist()


def looking(eye, target):
    """One pose."""
    return look_at(np.array(eye, float), np.array(target, float))[0]
