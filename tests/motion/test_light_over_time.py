"""Lamps over bodies that move: each frame is that of the moved mesh at rest, by area."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from scenes import joined
from surface_cases import moved, room
from timed import evaluate_over_time, regions_over_time

import rastercov as rc
from rastercov.base.errors import CameraError, ConfigError, MeshError
from rastercov.core.area.features import narrow
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.table import join as joined_regions
from rastercov.core.camera.rig import with_equipment
from rastercov.core.coverage.task import Engine
from rastercov.motion.regions import MovingFrames

CAMERA = rc.Camera(width=200, height=160, fx=150, fy=150)
TASK = rc.Task(max_incidence_deg=75)
WITH_LIMITS = rc.Task(
    max_incidence_deg=75, min_illuminance=8, max_illuminance=30, max_highlight_deg=12
)
TWO_CAMERAS = rc.look_at([(0.3, 0.2, 4), (-1.5, 2, 1.5)], (0, 0, 0), up=(0, 1, 0))
LAMPS = rc.Lamps(
    [rc.Lamp.point(intensity=100), rc.Lamp.area(0.4, points=4, intensity=60)],
    rc.look_at([(2.5, 0, 2.5), (-1.5, 2, 0.2)], (0, 0, 0)),
)


def box_and_plate(part=None):
    """A box at the origin, and a plate between it and the first lamp, beside the images."""
    parts = (
        part or rc.shapes.box((1, 0.8, 0.6)),
        rc.shapes.box((0.6, 0.4, 0.02), centre=(1.4, 0, 1.4)),
    )
    mesh = joined(*parts)
    labels = np.repeat([0, 1], [part.n_faces for part in parts])
    groups = [rc.Group("box"), rc.Group("plate", is_occluder=True)]
    return rc.Mesh(mesh.vertices, mesh.faces, groups, labels)


def turned(degrees, place=(0.0, 0.0, 0.0)):
    """Turned about the z axis, then moved."""
    pose = rc.turntable(2, degrees=2 * degrees)[1].copy()
    pose[:3, 3] += place
    return pose


def assert_frames_are_those_at_rest(motion, camera, poses, task, lamps):
    regions = regions_over_time(motion, camera, poses, task, lamps=lamps)
    areas = regions.areas().reshape(len(motion), -1, motion.mesh.n_faces)
    bounds = regions.bounds().reshape(areas.shape)
    for row in range(len(motion)):
        still = rc.regions(moved(motion, row)[0], camera, poses, task, lamps=lamps)
        limit = bounds[row] + still.bounds() + 1e-9
        assert (np.abs(areas[row] - still.areas()) <= limit).all()
    return areas


@pytest.mark.parametrize("task", [TASK, WITH_LIMITS])
def test_a_motion_that_moves_nothing_gives_the_areas_at_rest_to_the_bit(task):
    mesh, camera, poses = room()
    lamps = rc.Lamps(
        [rc.Lamp.point(intensity=50), rc.Lamp.area(0.6, points=4, intensity=30)],
        rc.look_at([(4, 2.5, 2.9), (6, 4, 2)], (4.2, 2.4, 0.2)),
    )
    motion = rc.Motion(mesh, {"mesh": np.eye(4)[None]})
    result = evaluate_over_time(motion, camera, poses, task, lamps=lamps)
    still = rc.regions(mesh, camera, poses, task, lamps=lamps)
    for name in ("xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound"):
        assert getattr(result.regions, name).tobytes() == getattr(still, name).tobytes()
    assert not result.regions.conditions  # that of one frame would gate all
    evaluated = rc.evaluate(mesh, camera, poses, task, by="area", lamps=lamps, fields=())
    assert result.share() == pytest.approx(evaluated.areas.summary()["percent"] / 100, rel=1e-12)
    assert 0 < result.share() < evaluate_over_time(motion, camera, poses, TASK).share()


@pytest.mark.parametrize("task", [TASK, WITH_LIMITS])
def test_a_box_that_turns_under_lamps_is_lit_as_in_each_place(task):
    motion = rc.Motion(
        box_and_plate(), {"box": rc.turntable(5), "plate": np.tile(turned(0), (5, 1, 1))}
    )
    areas = assert_frames_are_those_at_rest(motion, CAMERA, TWO_CAMERAS, task, LAMPS)
    assert np.ptp(areas.sum(axis=2), axis=0).max() > 0.1


def test_a_body_beside_the_image_shades_what_the_camera_sees_alike():
    """Frames whose regions are shared have a light of their own."""
    mesh, lamps = box_and_plate(), rc.Lamps(LAMPS.lamps[:1], LAMPS.places[:1])
    far = np.stack([np.eye(4), turned(0, (0, 5, 0)), np.eye(4)])
    motion, pose = rc.Motion(mesh, {"plate": far}), TWO_CAMERAS[:1]
    seen = regions_over_time(motion, CAMERA, pose, TASK).areas()
    assert (seen == seen[0]).all()
    areas = assert_frames_are_those_at_rest(motion, CAMERA, pose, TASK, lamps)[:, 0].sum(axis=1)
    assert areas[0] == areas[2] < 0.5 * areas[1]


def test_a_zone_that_is_unlit_in_some_frames_says_so():
    corners = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)]
    sheet = rc.Mesh(corners, [(0, 1, 2), (0, 2, 3)])
    far = np.stack([np.eye(4), turned(0, (0, 5, 0))])
    motion = rc.Motion(box_and_plate(sheet), {"plate": far})
    lamps = rc.Lamps(LAMPS.lamps[:1], LAMPS.places[:1])
    result = evaluate_over_time(motion, CAMERA, TWO_CAMERAS[:1], TASK, "all", lamps=lamps)
    assert result.share() < 0.7
    assert [zone["reason"] for zone in result.dead_zones()["dead_zones"]] == ["unlit"]
    some = evaluate_over_time(motion, CAMERA, TWO_CAMERAS[:1], TASK, lamps=lamps)
    assert some.share() == pytest.approx(1)


def test_a_head_with_a_lamp_that_rides_on_it_measures_in_each_frame():
    places = np.repeat(np.eye(4)[None], 2, axis=0)
    places[1, 0, 3] = 0.4
    rig = rc.Rig([CAMERA] * 2, ["left", "right"], places, rule=rc.All())
    lamps = rc.Lamps(
        [rc.Lamp.point(intensity=100), rc.Lamp.spot(20, intensity=60)],
        np.stack([LAMPS.places[0], turned(0, (0.2, 0, 0))]), rides=[False, True],
    )  # fmt: skip
    motion = rc.Motion(box_and_plate(), {"box": rc.turntable(3), "plate": rc.conveyor(
        3, direction=(0, 1, 0), distance=2)})  # fmt: skip
    poses = rig.poses(TWO_CAMERAS)
    assert_frames_are_those_at_rest(motion, rig, poses, WITH_LIMITS, lamps)
    # All that moves together changes nothing: the lamp moves with the body of the cameras.
    own = of_riding(lamps)
    together = rc.Motion(box_and_plate(), {name: rc.turntable(3) for name in ("box", "plate")})
    areas = regions_over_time(together, rig, poses, TASK, body="box", lamps=own).areas()
    assert areas.sum() > 0
    assert np.abs(areas.reshape(3, -1) - areas.reshape(3, -1)[0]).max() <= 1e-6


def of_riding(lamps):
    """The lamp that rides alone."""
    return rc.Lamps(lamps.lamps[1:], lamps.places[1:], rides=[True])


@settings(max_examples=12, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(0, 360)] * 2, *[st.floats(-0.6, 0.6)] * 2), min_size=1, max_size=3
    ),
    st.sampled_from([TASK, WITH_LIMITS]),
)
def test_any_frames_are_those_of_the_moved_mesh(frames, task):
    boxes = np.stack([turned(angle) for angle, *_ in frames])
    plates = np.stack([turned(angle, (x, y, 0.6)) for _, angle, x, y in frames])
    motion = rc.Motion(box_and_plate(), {"box": boxes, "plate": plates})
    assert_frames_are_those_at_rest(motion, CAMERA, TWO_CAMERAS, task, LAMPS)


NAMES = ("xy", "starts", "face", "pose", "pair_pose", "pair_face", "area", "bound")


def of_each_frame(motion, camera, poses, task, lamps):
    """Frames one by one, by passes that know nothing of one another."""
    camera = with_equipment(camera, {"lamps": lamps}, motion.mesh)
    task = narrow(camera, task)
    job = MovingFrames.of(rc.MotionQuery(motion), camera, rc.Poses.of(poses), task, Engine())
    return [job.regions(np.array([row])) for row in range(len(motion))]


@examples(8, at_night=25)
@given(
    st.lists(
        st.tuples(*[st.sampled_from([0.0, 90.0, 31.7])] * 2, *[st.floats(-4, 4)] * 3),
        min_size=2, max_size=5,
    ),
    st.sampled_from([TASK, WITH_LIMITS]),
    st.booleans(),
    st.booleans(),
)  # fmt: skip
def test_light_of_an_earlier_frame_is_that_of_the_frame_to_the_bit(frames, task, is_there, rides):
    boxes = np.stack([turned(angle) for angle, *_ in frames])
    plates = np.stack([turned(angle, place) for _, angle, *place in frames])
    present = {"plate": [is_there or row % 2 == 0 for row in range(len(frames))]}
    motion = rc.Motion(box_and_plate(), {"box": boxes, "plate": plates}, present)
    # The border of the light of a spot is on the box: strips there are undecided, of a width.
    kinds = [*LAMPS.lamps, rc.Lamp.spot(8, intensity=60)]
    places = [*LAMPS.places, *rc.look_at([(0.55, -0.45, 3)], (0.1, 0, 0), up=(0, 1, 0))]
    if rides:
        places[0] = np.linalg.inv(TWO_CAMERAS[0]) @ places[0]
    lamps = rc.Lamps(kinds, places, rides=[rides, False, False])
    regions = regions_over_time(motion, CAMERA, TWO_CAMERAS, task, lamps=lamps)
    alone = joined_regions(of_each_frame(motion, CAMERA, TWO_CAMERAS, task, lamps))
    for name in NAMES:
        assert getattr(regions, name).tobytes() == getattr(alone, name).tobytes()


@pytest.mark.parametrize("rides", [False, True])
def test_a_lamp_is_found_again_where_a_moved_body_is_before_what_it_lights(monkeypatch, rides):
    solved, find = [], RegionPass.find

    def counted(self, poses, *arguments, **options):
        solved.append((self.camera is not None and len(self.cameras), len(poses)))
        return find(self, poses, *arguments, **options)

    monkeypatch.setattr(RegionPass, "find", counted)
    place = np.linalg.inv(TWO_CAMERAS[0]) @ LAMPS.places[0] if rides else LAMPS.places[0]
    lamps = rc.Lamps(LAMPS.lamps[:1], place[None], rides=[rides])
    away = [np.eye(4), *(turned(0, (0, 3 + at, 0)) for at in range(4)), np.eye(4)]
    motion = rc.Motion(box_and_plate(), {"plate": np.stack(away)})
    regions_over_time(motion, CAMERA, TWO_CAMERAS[:1], TASK, lamps=lamps)
    assert len(solved) == 1 + 2  # the camera, and the lamp with the plate before it and away


def test_light_that_cannot_be_is_refused_in_one_line():
    motion = rc.Motion(box_and_plate(), {"box": rc.turntable(2), "plate": rc.turntable(2)})
    rig = rc.Rig([CAMERA] * 2, ["left", "right"])
    rides = rc.Lamps([rc.Lamp.point(intensity=1)], rides=[True])
    poses = rig.poses(TWO_CAMERAS)
    with pytest.raises(ConfigError, match="on one body, got box, plate; place") as error:
        regions_over_time(motion, rig, poses, body=["box", "plate"], lamps=rides)
    assert "\n" not in str(error.value)
    regions_over_time(motion, rig, poses, body=["box", "box"], lamps=rides)
    with pytest.raises((ConfigError, MeshError), match="body") as error:
        regions_over_time(motion, rig, poses, body=[["box"], ["box"]], lamps=rides)
    assert "\n" not in str(error.value)
    for over_time in (regions_over_time, evaluate_over_time):
        with pytest.raises(CameraError, match="lamps to be"):
            over_time(motion, CAMERA, TWO_CAMERAS, lamps=[rc.Lamp.point(intensity=1)])
        with pytest.raises(ConfigError, match="give lamps"):
            over_time(motion, CAMERA, TWO_CAMERAS, WITH_LIMITS)
