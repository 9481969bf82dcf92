"""Examples for Blender, ROS and FreeCAD: what they give hosts, without the hosts."""

import json
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

import rastercov as rc
from rastercov.base import json_bytes


@pytest.fixture(scope="module", autouse=True)
def hosts():
    """The modules of the examples."""
    from pathlib import Path

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parents[1] / "examples")
        import blender_coverage
        import ros_coverage

        yield blender_coverage, ros_coverage


def plane_of_view(render, data):
    """(left, bottom, right, top) at unit depth, as Blender computes it, BKE_camera_params."""
    width, height = (render.resolution_percentage * side / 100 for side in
                     (render.resolution_x, render.resolution_y))  # fmt: skip
    ratio = render.pixel_aspect_y / render.pixel_aspect_x
    fit = data.sensor_fit
    if fit == "AUTO":
        is_wide = render.pixel_aspect_x * width >= render.pixel_aspect_y * height
        fit, sensor = ("HORIZONTAL" if is_wide else "VERTICAL"), data.sensor_width
    else:
        sensor = data.sensor_width if fit == "HORIZONTAL" else data.sensor_height
    factor = width if fit == "HORIZONTAL" else ratio * height
    pixel = sensor / data.lens / factor
    middle = np.array((data.shift_x, data.shift_y)) * factor
    half = np.array((width, ratio * height)) / 2
    return (*(pixel * (middle - half)), *(pixel * (middle + half)))


SETTINGS = {
    "resolution_x": st.integers(16, 4000),
    "resolution_y": st.integers(16, 4000),
    "pixel_aspect_x": st.floats(1, 3),
    "pixel_aspect_y": st.floats(1, 3),
    "lens": st.floats(5, 300),
    "sensor_fit": st.sampled_from(["AUTO", "HORIZONTAL", "VERTICAL"]),
    "sensor_width": st.floats(5, 60),
    "sensor_height": st.floats(5, 60),
    "shift_x": st.floats(-0.4, 0.4),
    "shift_y": st.floats(-0.4, 0.4),
}


@examples(60)
@given(st.fixed_dictionaries(SETTINGS))
def test_pixels_of_blender_are_those_of_its_view_plane(values):
    from blender_coverage import Settings, camera_of

    assert set(values) <= {field.name for field in fields(Settings)}
    own = Settings(**values)
    camera = camera_of(own, own)
    left, bottom, right, top = plane_of_view(own, own)
    middle = 0.3 * left + 0.7 * right, 0.6 * bottom + 0.4 * top
    for x, y in ((left, bottom), (right, top), middle):
        u, v = (x - left) / (right - left), (top - y) / (top - bottom)
        told = camera.fx * x + camera.cx, -camera.fy * y + camera.cy
        np.testing.assert_allclose(
            told, (u * camera.width, v * camera.height), atol=1e-9 * max(camera.fx, camera.fy, 1e3)
        )


@examples(30)
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.floats(0.01, 3.1))
def test_quaternions_of_ros_turn_about_their_axis(numbers, angle):
    from ros_coverage import pose_of

    axis, vector = np.add(numbers[:3], (0, 0, 2)), np.array([0.3, -0.7, 0.5])
    axis /= np.linalg.norm(axis)
    x, y, z = np.sin(angle / 2) * axis
    place = SimpleNamespace(x=1.0, y=2.0, z=numbers[3])
    pose = pose_of(place, SimpleNamespace(x=x, y=y, z=z, w=np.cos(angle / 2)))
    wanted = vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)
    wanted += axis * (axis @ vector) * (1 - np.cos(angle))
    np.testing.assert_allclose(pose[:3, :3] @ vector, wanted, atol=1e-12)
    assert pose[:, 3].tolist() == [1.0, 2.0, numbers[3], 1.0]


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", [-0.1, 0.02, 0.001, -0.001, 0.003]),
        ("plumb_bob", []),
        ("", []),
        ("equidistant", [0.01, -0.002, 0.0, 0.0]),
        ("rational_polynomial", [-0.1, 0.02, 0.001, -0.001, 0.0, 0.01, 0.0, 0.0]),
    ],
)
def test_messages_of_ros_are_cameras_with_the_first_pixel_at_its_centre(hosts, model, d):
    _, ros = hosts
    info = SimpleNamespace(**vars(ros.INFO) | {"distortion_model": model, "d": d})
    camera = ros.camera_of(info)
    assert (camera.width, camera.height, camera.fx, camera.fy) == (640, 480, 500.0, 500.0)
    assert (camera.cx, camera.cy) == (320.0, 240.0)
    assert any(d) == (camera.model != "pinhole")
    told = list(camera.distortion)[: len(d)]
    assert told == (d if any(d) else told)


def test_covered_triangles_are_those_of_an_evaluation(hosts):
    _, ros = hosts
    mesh, pose = rc.shapes.box(), rc.look_at((0, 0, -4.0), (0, 0, 0))[0]
    corners = ros.covered_triangles(mesh, ros.camera_of(ros.INFO), pose)
    low = mesh.bounds[0][2]
    assert (corners[:, 2] == low).all()
    assert len(corners) == 6


class Moved:
    """Stand-in of FreeCAD.Placement: a shift, mm."""

    def __init__(self, *by):
        self.by = np.array(by, float)

    def multiply(self, other):
        return Moved(*(self.by + other.by))

    def inverse(self):
        return Moved(*-self.by)

    def multVec(self, point):  # noqa: N802 - its name
        return tuple((self.by + point).tolist())


def test_faces_of_freecad_are_groups_where_they_are_in_the_world(tmp_path):
    import freecad_coverage as example

    faces = list(example.box().values())
    shape = SimpleNamespace(Solids=[1], Faces=faces)
    own, whole = Moved(1, 2, 3), Moved(101, 2, 3)  # in a part that is moved by 100 mm
    part = SimpleNamespace(Name="Pad", Shape=shape, Placement=own, ViewObject=SimpleNamespace())
    part.getGlobalPlacement = lambda: whole
    sketch = SimpleNamespace(Name="Sketch", Shape=SimpleNamespace(Solids=[]))
    document = SimpleNamespace(Objects=[sketch, part, SimpleNamespace(Name="Axis")])
    (tmp_path / "part.obj").write_text(example.obj_of(list(example.faces_of(document))))
    mesh = rc.Mesh.load(tmp_path / "part.obj", unit="mm")
    assert [group.name for group in mesh.groups] == [f"Pad.Face{k}" for k in range(1, 7)]
    np.testing.assert_allclose(mesh.bounds, [[0.1, 0, 0], [0.14, 0.06, 0.08]], atol=1e-15)
    assert mesh.areas.sum() == pytest.approx(2 * (0.04 * 0.06 + 0.04 * 0.08 + 0.06 * 0.08))
    example.colour(document, {"Pad.Face1": 1.0, "Pad.Face2": 0.25, "Pad2.Face1": 0.0})
    assert part.ViewObject.DiffuseColor == [(0.0, 1.0, 0.1, 0.0), (0.75, 0.25, 0.1, 0.0)]


def test_shares_of_freecad_are_those_of_an_evaluation():
    import freecad_coverage as example

    from rastercov.cli.serve import Service

    service = Service()

    class Here:
        def ask(self, verb, **entries):
            line = json.dumps({"do": verb, **entries}).encode()
            return json.loads(json_bytes(service.answer(line)))["result"]

    faces = [(name, face, tuple) for name, face in example.box().items()]
    shares = example.shares_of(faces[:5], Here())  # open below: the last face is not there
    assert list(shares) == [name for name, *_ in faces[:5]]
    assert all(0 <= share <= 1 for share in shares.values())
    assert max(shares.values()) == pytest.approx(1)


def test_freecad_without_the_command_is_told_so_and_not_started_again(monkeypatch):
    import freecad_coverage as example

    monkeypatch.setattr(example, "FreeCAD", SimpleNamespace(ActiveDocument=None))
    monkeypatch.setenv("PATH", "")
    with pytest.raises(OSError, match="expected the command rastercov on the PATH of FreeCAD"):
        example.main()
