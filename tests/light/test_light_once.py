"""Light of lamps that are fixed, computed once for all that asks for it in one scene."""

import gc
import weakref

import numpy as np
import pytest

import rastercov as rc
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import stages_of
from rastercov.core.camera import Poses
from rastercov.core.camera.rig import with_equipment
from rastercov.light.regions import Light

ROOM = rc.shapes.box((4.0, 3.0, 2.5))
CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=80)
POSES = rc.look_at([(3.0, 2.5, 2.0), (-3.0, 2.5, 2.0), (0.5, -3.0, 2.0)], (0, 0, 0))


def lamps_outside(n: int, seed: int = 1) -> rc.Lamps:
    """Lamps on a sphere about the box."""
    eyes = np.random.default_rng(seed).normal(size=(n, 3))
    places = rc.look_at(5 * eyes / np.linalg.norm(eyes, axis=1)[:, None], (0, 0, 0))
    return rc.Lamps([rc.Lamp.spot(40, intensity=400)] * n, places)


def with_lamps(lamps: rc.Lamps) -> rc.Rig:
    return with_equipment(CAMERA, {"lamps": lamps}, ROOM)


@pytest.fixture
def computed(monkeypatch):
    """Thresholds of each time that light is computed."""
    found, compute = [], Light._light
    monkeypatch.setattr(
        Light,
        "_light",
        lambda self, *own: (
            found.append((self.task.min_illuminance, self.task.max_illuminance))
            or compute(self, *own)
        ),
    )
    return found


@pytest.mark.parametrize("limits", [{}, {"min_illuminance": 8.0}, {"max_illuminance": 30.0}])
def test_light_is_computed_once_for_its_thresholds(computed, limits):
    """Not for each set of criteria that dead zones try: those of equal limits share it."""
    task, lamps = rc.Task(max_incidence_deg=70, min_pixel_density=20, **limits), lamps_outside(4)
    result = rc.evaluate(ROOM, CAMERA, POSES, task, lamps=lamps)
    assert result.summary()["dead_zones"]
    assert len(set(computed)) == 1 + len(limits)
    assert len(computed) == 1 + len(set(computed))  # and for what single lamps reach


def test_light_is_that_of_its_scene_and_thresholds():
    """Regions through passes that share light are those of passes with light of their own."""
    rng = np.random.default_rng(2)
    shared = with_lamps(lamps_outside(5))
    for _ in range(6):
        limit = float(rng.choice([5.0, 20.0]))
        mesh = ROOM if rng.random() < 0.5 else ROOM.moved(translation=(0.5, 0, 0))
        task, poses = rc.Task(min_illuminance=limit), Poses.of(POSES)
        own = with_lamps(lamps_outside(5))
        found = [next(iter(RegionPass(mesh, rig, task).batches(poses))) for rig in (shared, own)]
        assert found[0].area.tobytes() == found[1].area.tobytes()
        assert found[0].xy.tobytes() == found[1].xy.tobytes()
        assert found[0].area.size


def test_lamps_keep_one_scene_alone():
    """The light of lamps does not keep meshes that are gone."""
    rig = with_lamps(lamps_outside(3))
    held = []
    for size in (1.0, 2.0, 3.0):
        mesh = rc.shapes.box((size, size, size))
        held.append(weakref.ref(mesh))
        assert len([*stages_of(mesh, rig, rc.Task(min_illuminance=5.0))]) > 1
        next(iter(RegionPass(mesh, rig, rc.Task(min_illuminance=5.0)).batches(Poses.of(POSES))))
        del mesh
    del rig
    gc.collect()
    assert [each() is None for each in held] == [True] * 3
