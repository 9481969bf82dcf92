"""The sun as a lamp: what it lights by area and at points, its files, and what is refused."""

import json

import numpy as np
import pytest
from nightly import amount
from surface_cases import in_regions, room

import rastercov as rc
from rastercov.base.errors import CameraError
from rastercov.core.area.stages import failures_of_rows
from rastercov.core.camera.rig import with_equipment
from rastercov.formats.meshes.gltf_file import header_of
from rastercov.light.lamps import lamps_of_json
from rastercov.light.regions import HIGHLIGHT, TOO_BRIGHT, TOO_DARK, UNLIT
from rastercov.reference.regions import points_on, rig_covers_points
from rastercov.report.coverage_files import write_covered_mesh

CAMERA = rc.Camera.from_fov(640, 480, hfov_deg=90)
GROUND = rc.Mesh([(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)], [(0, 1, 2), (0, 2, 3)])
ROOF = rc.shapes.box((1, 1, 0.1), centre=(0, 0, 2.05))
SCENE = rc.Mesh.joined([GROUND, ROOF], ["ground", "roof"])
BESIDE = rc.look_at((0, -6, 4), (0, 0, 0))


def reasons(mesh, lamps, task, pose, *points):
    """Reasons of points on the first faces of a mesh, from one pose."""
    rig = with_equipment(rc.Rig([CAMERA]), {"lamps": lamps}, mesh)
    face = np.zeros(len(points), np.int64)
    rows = failures_of_rows(mesh, rig, task, rc.Poses.of(pose), np.array(points, float), face)
    return next(iter(rows))[1].tolist()


def suns(*directions, **more):
    more = {"illuminance": 80e3} | more
    places = rc.look_at(np.array(directions, float), (0, 0, 0))
    return rc.Lamps([rc.Lamp.sun(**more)] * len(directions), places)


def test_what_the_sun_lights_of_a_room_is_as_by_points():
    mesh, camera, poses = room()
    mesh = mesh.with_groups([], [each.name for each in mesh.groups])
    points, face = points_on(mesh, amount(600, at_night=3000))
    lamps, task = suns((0.3, 0.4, 0.6), (-0.7, 0.2, 0.5)), rc.Task()
    regions = rc.regions(mesh, camera, poses, task, lamps=lamps)
    rig = with_equipment(camera, {"lamps": lamps}, mesh)
    truth = rig_covers_points(mesh, rig, poses, task, points, face)
    for row in range(len(poses)):
        wrong = int((in_regions(regions, row, points, face) != truth[row]).sum())
        assert wrong <= 2 + regions.bounds()[row].sum() / mesh.areas.sum() * len(points)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0.4, 0.1, 1), (-1, 0.5, 0.7)])
def test_the_lamp_lights_what_is_sunlit(direction):
    above = rc.Camera.orthographic(600, 600, px_per_m=40)
    view = rc.look_at(20 * np.array(direction) / np.linalg.norm(direction), (0, 0, 0))
    result = rc.evaluate(SCENE, above, view, lamps=suns(direction), fields=())
    sun = rc.sunlit(SCENE, [direction])
    lit = (sun.hours * SCENE.areas).sum() / SCENE.areas.sum()
    assert result.covered.share() == pytest.approx(lit, abs=1e-9)


def test_illuminance_is_that_across_the_rays_by_the_cosine():
    lamps = suns((0, 3, 4))
    own = GROUND.areas.sum()
    for least, share in ((63_999, 1), (64_001, 0)):
        task = rc.Task(min_illuminance=least)
        regions = rc.regions(GROUND, CAMERA, BESIDE, task, lamps=lamps)
        seen = rc.regions(GROUND, CAMERA, BESIDE)
        assert regions.areas().sum() == pytest.approx(share * seen.areas().sum(), rel=1e-9)
        assert seen.areas().sum() < own
    for task, reason in (
        (rc.Task(min_illuminance=64_001), TOO_DARK),
        (rc.Task(max_illuminance=63_999), TOO_BRIGHT),
        (rc.Task(), int(rc.Reason.COVERED)),
    ):
        assert reasons(GROUND, lamps, task, BESIDE, (0.5, 0.25, 0)) == [reason]


def test_a_lamp_adds_to_the_sun():
    places = np.concatenate([rc.look_at((0, 0, 1), (0, 0, 0)), rc.look_at((0, 0, 2), (0, 0, 0))])
    both = rc.Lamps([rc.Lamp.sun(illuminance=100), rc.Lamp.point(intensity=40)], places)
    view = rc.Camera.orthographic(800, 800, px_per_m=100)
    task = rc.Task(min_illuminance=105)  # 40 h / d^3 = 5 within d^3 = 16
    regions = rc.regions(
        GROUND, view, rc.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0)), task, lamps=both
    )
    radius_2 = 16 ** (2 / 3) - 4
    assert regions.areas().sum() == pytest.approx(np.pi * radius_2, rel=1e-4)


def test_points_of_the_disc_light_between_all_and_some():
    above = rc.Camera.orthographic(400, 400, px_per_m=40)
    view = rc.look_at((0, 0, 20), (0, 0, 0), (0, 1, 0))
    ground = SCENE.with_groups(occluders=["roof"])
    lit = [
        rc.regions(ground, above, view, lamps=suns((0, 0, 1), points=16, share=share))
        for share in (0.01, 0.5, 1)
    ]
    some, half, every = (each.areas().sum() for each in lit)
    assert every < half < some
    assert some - every < 4 * 1.1 * 2 * 2.1 * np.tan(np.radians(0.2666))


def test_a_sun_mirrored_by_a_floor_is_a_highlight():
    lamps, eye = suns((0, 1, 1)), rc.look_at((0, -3, 3), (0, 0, 0))
    task = rc.Task(max_highlight_deg=3)
    result = reasons(GROUND, lamps, task, eye, (0, 0, 0), (2, -1, 0))
    assert result == [HIGHLIGHT, int(rc.Reason.COVERED)]
    seen, cut = (rc.regions(GROUND, CAMERA, eye, each, lamps=lamps) for each in (rc.Task(), task))
    assert 0 < cut.areas().sum() < seen.areas().sum()


def test_bodies_that_move_are_lit_where_they_are_and_not_too_far():
    scene = rc.Mesh.joined([GROUND, ROOF], ["ground", "roof"])
    for distance, is_near in ((3.0, True), (2000.0, False)):
        motion = rc.Motion(scene, {"roof": rc.conveyor(2, direction=(1, 0, 0), distance=distance)})
        asked = {"lamps": suns((0, 0, 1)), "motion": rc.MotionQuery(motion, "some")}
        if is_near:
            result = rc.evaluate(scene, CAMERA, BESIDE, fields=(), **asked)
            assert result.covered.share() > 0
        else:
            with pytest.raises(CameraError, match="expected bodies within"):
                rc.evaluate(scene, CAMERA, BESIDE, fields=(), **asked)


ENTRIES = 'kind = "sun"\nilluminance_lx = 8e4\n'


def test_a_file_places_the_sun_by_angles_or_by_place_and_time(tmp_path):
    path = tmp_path / "lamps.toml"
    path.write_text(f"[lamps.sun]\n{ENTRIES}azimuth_deg = 180\nelevation_deg = 30\n")
    lamps = rc.load_lamps(path)
    assert lamps.places[0, :3, 2] == pytest.approx([0, 3**0.5 / 2, -0.5])  # from the south
    assert (lamps.lamps[0].intensity, lamps.unit) == (8e4, "lx")
    path.write_text(
        '[lamps.sun]\nkind = "sun"\nirradiance_w_m2 = 900\nlatitude = 48\nlongitude = 11.5\n'
        "time = 2026-06-21T12:00:00+02:00\nnorth_deg = 40\npoints = 8\nshare = 1\n"
    )
    lamps = rc.load_lamps(path)
    towards = rc.sun_directions(48, 11.5, ["2026-06-21T10:00Z"], north_deg=40)[0]
    assert lamps.places[0, :3, 2] == pytest.approx(-towards)
    assert (lamps.lamps[0].points, lamps.unit) == (8, "W/m2")
    again = lamps_of_json(json.loads(json.dumps(lamps.to_json())))
    assert again.lamps == lamps.lamps


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("", "expected azimuth_deg and elevation_deg, or latitude, longitude, time of a sun"),
        ("azimuth_deg = 3", "expected azimuth_deg and elevation_deg, or latitude"),
        ("azimuth_deg = 3\nelevation_deg = -1", "expected a sun above the horizon, got -1 degrees"),
        ("azimuth_deg = 3\nelevation_deg = 9\ntime = 1", "got azimuth_deg, elevation_deg, time"),
        ("latitude = 95\nlongitude = 0\ntime = 2026-06-21T12:00:00Z", "latitude of -90 to 90"),
        ("latitude = 45\nlongitude = 0\ntime = 2026-06-21T12:00:00", "expected time with a zone"),
        ("azimuth_deg = 0\nelevation_deg = 9\nposition = [0, 0, 1]", "expected entries of a sun"),
        ("azimuth_deg = 0\nelevation_deg = 9\nirradiance_w_m2 = 5", "expected illuminance"),
        ("azimuth_deg = 0\nelevation_deg = 9\nradius_deg = 20", "radius_deg of a sun up to 10"),
    ],
)
def test_wrong_entries_are_refused_in_one_line(entries, words, tmp_path):
    (tmp_path / "lamps.toml").write_text(f"[lamps.sun]\n{ENTRIES}{entries}\n")
    with pytest.raises(CameraError, match=words) as caught:
        rc.load_lamps(tmp_path / "lamps.toml")
    assert str(caught.value).isprintable()


def test_a_sun_is_neither_on_a_rig_nor_chosen():
    with pytest.raises(CameraError, match="expected a sun that is fixed, got one on a rig"):
        rc.Lamps([rc.Lamp.sun(illuminance=1)], rides=[True])
    with pytest.raises(CameraError, match="expected lamps with positions to choose from"):
        _ = rc.Lamp.sun(illuminance=1).eye


def test_a_directional_light_of_a_scene_is_a_sun_and_is_written_as_one(tmp_path):
    lamps = suns((0.3, 0.4, 0.6))
    result = rc.evaluate(SCENE, CAMERA, BESIDE, lamps=lamps, fields=())
    write_covered_mesh(tmp_path / "scene.glb", result.covered, [lamps._to_gltf])
    written = header_of((tmp_path / "scene.glb").read_bytes())
    light = written["extensions"]["KHR_lights_punctual"]["lights"][0]
    assert (light["type"], light["intensity"]) == ("directional", pytest.approx(8e4))
    again = rc.load_lamps(tmp_path / "scene.glb")
    assert again.lamps == lamps.lamps
    assert again.places[0, :3, 2] == pytest.approx(lamps.places[0, :3, 2], abs=1e-7)


def test_a_place_in_the_shade_of_the_roof_is_unlit():
    result = reasons(SCENE, suns((0, 0, 1)), rc.Task(), BESIDE, (0.2, -0.1, 0), (2, -1, 0))
    assert result == [UNLIT, int(rc.Reason.COVERED)]
