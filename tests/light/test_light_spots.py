"""Spots of glTF fall off between two cones, beside the formula of KHR_lights_punctual."""

import json
import math

import numpy as np
import pytest

import rastercov as rc
from rastercov.base.errors import CameraError
from rastercov.light.lamps import illuminances, lamps_of_json, points_of
from rastercov.placement.plan.file import plan_of
from rastercov.report.coverage_files import write_covered_mesh

HALF = 5.0
FLOOR = rc.Mesh(
    [(-HALF, -HALF, 0), (HALF, -HALF, 0), (HALF, HALF, 0), (-HALF, HALF, 0)], [(0, 1, 2), (0, 2, 3)]
)
CAMERA = rc.Camera.from_fov(1000, 1000, hfov_deg=120)
ABOVE = rc.look_at([(0, 0, 8)], (0, 0, 0), up=(0, 1, 0))
PUNCTUAL = "KHR_lights_punctual"


def attenuation(t, inner, outer):
    """Of the specification, at an angle t from the axis, radians."""
    width = max(0.001, math.cos(inner) - math.cos(outer))
    return np.clip((np.cos(t) - math.cos(outer)) / width, 0, 1) ** 2


def scene(path, light, **more):
    """A scene with a light at a height of 3 m, which shines down."""
    node = {"name": "s", "translation": [0, 0, 3], "extensions": {PUNCTUAL: {"light": 0}}}
    content = {
        "asset": {"version": "2.0"},
        "extensions": {PUNCTUAL: {"lights": [light]}},
        "nodes": [node, {"name": "above", "children": [0]}, {"name": "other"}],
        **more,
    }
    path.write_text(json.dumps(content))
    return rc.load_lamps(path)


def border(value, end):
    """Angle up to `end` at which a falling function is 0."""
    low, high = 0.0, end
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if value(middle) > 0 else (low, middle)
    return low


def spots():
    rng = np.random.default_rng(5)
    yield from [{"innerConeAngle": 0.2, "outerConeAngle": 0.5}, {"outerConeAngle": 0.5}, {}]
    yield {"innerConeAngle": 0.6, "outerConeAngle": 0.6}
    yield {"outerConeAngle": 0.04}  # narrower than the least falloff
    for _ in range(6):
        outer = float(rng.uniform(0.05, 1.0))
        yield {"innerConeAngle": float(rng.uniform(0, 1)) * outer, "outerConeAngle": outer}


@pytest.mark.parametrize("spot", list(spots()))
def test_a_spot_lights_the_area_of_the_formula(spot, tmp_path):
    lamps = scene(tmp_path / "a.gltf", {"type": "spot", "intensity": 100, "spot": spot})
    inner, outer = spot.get("innerConeAngle", 0), spot.get("outerConeAngle", math.pi / 4)
    for limit in (5.0, 0.5):

        def over(t, limit=limit):
            return 100 * attenuation(t, inner, outer) * math.cos(t) ** 3 / 9 - limit

        area = math.pi * (3 * math.tan(border(over, outer))) ** 2
        is_covered = rc.evaluate(
            FLOOR, CAMERA, ABOVE, rc.Task(min_illuminance=limit), lamps=lamps, fields=()
        ).covered
        assert abs(is_covered.area.sum() - area) <= is_covered.bound.sum() + 1e-9
        assert is_covered.bound.sum() < 3e-3 * (area + 1)


def test_light_at_points_is_that_of_the_formula():
    rng = np.random.default_rng(8)
    for _ in range(50):
        outer, place = rng.uniform(0.05, math.pi / 2), rng.normal(size=3)
        inner = rng.uniform(0, outer)
        spot = rc.Lamp(
            kind="spot", intensity=70, half_angle_deg=math.degrees(outer),
            inner_angle_deg=math.degrees(inner),
        )  # fmt: skip
        lamps = rc.Lamps([spot], rc.look_at([place], rng.normal(size=3)))
        points, normals = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        to = points - place
        d = np.linalg.norm(to, axis=1)
        t = np.arccos(to @ lamps.places[0, :3, 2] / d)
        expected = 70 * attenuation(t, inner, outer) * np.abs((to * normals).sum(axis=1)) / d**3
        sees = np.ones((1, 40), bool)
        result = illuminances(lamps, points_of(lamps, np.ones(1, bool)), sees, points, normals)
        np.testing.assert_allclose(result, expected, rtol=1e-6, atol=1e-9)
        again = lamps_of_json(json.loads(json.dumps(lamps.to_json())))
        assert again.lamps == lamps.lamps


def test_spots_are_the_same_after_a_scene_of_their_own(tmp_path):
    lamps = rc.Lamps(
        [
            rc.Lamp.spot(30, intensity=5),
            *(
                rc.Lamp(kind="spot", intensity=9, half_angle_deg=30, inner_angle_deg=inner)
                for inner in (0, 12, 30)
            ),
        ],
        rc.look_at(np.eye(4)[:, :3] + 2, (0, 0, 0)),
    )
    result = rc.evaluate(FLOOR, CAMERA, ABOVE, lamps=lamps, fields=())
    write_covered_mesh(tmp_path / "scene.glb", result.covered, [lamps._to_gltf])
    again = rc.load_lamps(tmp_path / "scene.glb").lamps
    assert [lamp.inner_angle_deg for lamp in again] == pytest.approx([None, 0, 12, 30])


@pytest.mark.parametrize(
    "changes",
    [{"half_angle_deg": 95}, {"inner_angle_deg": 31}, {"inner_angle_deg": -1},
     {"inner_angle_deg": math.nan}, {"exponent": 2}, {"kind": "point"},
     {"profile": [(0, 1), (90, 0)]}],
)  # fmt: skip
def test_an_inner_angle_is_of_a_spot_and_within_its_cone(changes):
    own = {"kind": "spot", "intensity": 1, "half_angle_deg": 30, "inner_angle_deg": 10}
    assert rc.Lamp(**own).table is not None
    with pytest.raises(CameraError, match="expected inner_angle_deg of a spot without profile"):
        rc.Lamp(**own | changes)


def moving(**target):
    return {"animations": [{"channels": [{"sampler": 0, "target": target}], "samplers": [{}]}]}


def by_pointer(pointer):
    return moving(path="pointer", extensions={"KHR_animation_pointer": {"pointer": pointer}})


MOVED = [
    moving(node=0, path="translation"),
    moving(node=1, path="rotation"),
    by_pointer("/nodes/1/scale"),
    by_pointer(f"/extensions/{PUNCTUAL}/lights/0/intensity"),
]
STILL = [
    moving(node=2, path="rotation"),
    by_pointer("/nodes/2/scale"),
    by_pointer("/materials/0/emissiveFactor"),
]


@pytest.mark.parametrize("light", [{"type": "point"}, {"type": "spot", "spot": {}}])
def test_what_moves_a_light_is_noted_and_other_animations_are_not(light, tmp_path):
    for row, more in enumerate(MOVED + STILL):
        notes = scene(tmp_path / "a.gltf", light, **more).notes
        expected = ("lights 's' are animated: they are read as at rest",)
        assert notes == (expected if row < len(MOVED) else ())


def test_a_range_is_noted_in_results(tmp_path):
    lamps = scene(tmp_path / "a.gltf", {"type": "point", "intensity": 100, "range": 4})
    line = "lights 's' have a range, which is a hint: it does not end their light"
    assert lamps.notes == (line,)
    result = rc.evaluate(FLOOR, CAMERA, ABOVE, lamps=lamps, fields=())
    assert line in result.summary()["result_warnings"]


@pytest.mark.parametrize("spot", list(spots()))
def test_a_file_of_lamps_and_a_plan_have_spots_as_gltf_has_them(spot, tmp_path):
    (asked,) = scene(tmp_path / "a.gltf", {"type": "spot", "intensity": 100, "spot": spot}).lamps
    inner, outer = spot.get("innerConeAngle", 0), spot.get("outerConeAngle", math.pi / 4)
    own = {"kind": "spot", "intensity_cd": 100, "half_angle_deg": math.degrees(outer)}
    own |= {"inner_angle_deg": math.degrees(inner), "position": [0, 0, 3]}
    lines = [f"{name} = {json.dumps(value)}" for name, value in own.items()]
    (tmp_path / "lamps.toml").write_text("\n".join(["[lamps.key]", *lines]))
    camera = {"width": 64, "height": 48, "fx": 60}
    entries = {"meshes": [{"built_in": "box"}], "camera": camera, "lamps": {"key": own}}
    of_plan = plan_of(entries, tmp_path / "plan.toml").rig.equipment["lamps"]
    points = np.random.default_rng(1).uniform((-3, -3, 0), (3, 3, 0), (60, 3))
    up, sees = np.tile((0.0, 0.0, 1.0), (60, 1)), np.ones((1, 60), bool)
    for lamps in (rc.load_lamps(tmp_path / "lamps.toml"), of_plan):
        (result,) = lamps.lamps
        assert result.inner_angle_deg == pytest.approx(asked.inner_angle_deg, abs=1e-6)
        light = illuminances(lamps, points_of(lamps, np.ones(1, bool)), sees, points, up)
        t = np.arctan(np.hypot(*points[:, :2].T) / 3)
        expected = 100 * attenuation(t, inner, outer) * np.cos(t) ** 3 / 9
        np.testing.assert_allclose(light.ravel(), expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("kind", ["point", "ring", "bar", "dome", "area", "sun"])
def test_only_spots_of_a_file_have_an_inner_angle(kind, tmp_path):
    size = "size = 1\n" * (kind in ("ring", "bar", "dome", "area"))
    text = f'[lamps.a]\nkind = "{kind}"\nintensity_cd = 1\ninner_angle_deg = 5\n{size}'
    (tmp_path / "lamps.toml").write_text(text + "position = [0, 0, 1]\n")
    with pytest.raises(CameraError, match="inner_angle_deg"):
        rc.load_lamps(tmp_path / "lamps.toml")
