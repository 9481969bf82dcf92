"""Names that a format does not have: noted once each, and refused one slip away from what matters.

Each case is a good file with one bit of a name flipped, or a name misspelt, that used to load with
fewer faces, poses or terms of a lens, and without a word.
"""

import json
import re
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from mesh_files import FACES, POINTS, Glb, obj, places, ply
from repeated_parts import CAMERA, CAMERAS, HERE, KALIBR, dae, metashape, opensfm, scene, threemf

import rastercov as rc
from rastercov.base.errors import CameraError, MeshError
from rastercov.base.files import UnknownNames, is_slip
from rastercov.core.camera.conventions import Conventions
from rastercov.core.mesh import Mesh

ANSWERS = Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")


def noted_or_refused(path, data):
    """Notes of a file, or the line that refuses it."""
    path.write_bytes(data)
    try:
        if path.suffix in (".glb", ".3mf", ".dae", ".obj", ".ply"):
            return " ".join(Mesh.load(path).notes)
        return " ".join(rc.read_views(path, conventions=ANSWERS).notes)
    except (MeshError, CameraError, rc.PoseError) as error:
        return "two lines" * ("\n" in str(error)) or str(error)


def flips(name):
    """A name with each of its bits flipped that gives a character of JSON."""
    for at in range(len(name)):
        for bit in range(7):
            changed = chr(ord(name[at]) ^ (1 << bit))
            if changed.isprintable() and changed not in '"\\':
                yield name[:at] + changed + name[at + 1 :]


def two_nodes():
    """Two nodes of one mesh with two primitives, one node below the other."""
    glb = Glb()
    glb.header["meshes"][0]["primitives"] *= 2
    glb.header["meshes"][0]["primitives"] = json.loads(
        json.dumps(glb.header["meshes"][0]["primitives"])
    )
    glb.header["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [1, 2, 3]}]
    return glb


PLACES = [
    path for path in places(two_nodes().header) if isinstance(path[-1], str) and path[-1] != "name"
]


@pytest.mark.parametrize("path", PLACES, ids=lambda path: "/".join(map(str, path)))
def test_a_flipped_bit_in_a_name_of_a_scene_is_noted_or_refused(path, load, tmp_path):
    *keys, name = path
    assert load("a.glb", two_nodes().data()).notes == ()
    for changed in flips(name):
        glb = two_nodes()
        owner = reduce(getitem, keys, glb.header)
        owner[changed] = owner.pop(name)
        assert noted_or_refused(tmp_path / "a.glb", glb.data()), changed


def animated_scene():
    """A body that is moved by an animation and its parent, and lights on nodes."""
    glb = Glb()
    turn = [0, 0, np.sqrt(0.5), np.sqrt(0.5)]
    moves = np.array([[0, 0, 0, 5, 1, 0], [0, 0, 0, 6, 2, 0]], "<f4")
    view = glb.view(moves)
    glb.header["bufferViews"][view]["byteStride"] = 24
    glb.header["accessors"].append(
        {"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": 2, "type": "VEC3"}
    )
    output = len(glb.header["accessors"]) - 1
    keys = glb.accessor(np.array([0, 1.0]))
    glb.nodes(
        {"mesh": 0, "name": "part"},
        {"name": "arm", "translation": [5, 1, 0], "rotation": turn, "children": [2]},
        {"mesh": 0, "name": "tool", "translation": [0, 2, 0], "scale": [1, 2, 1],
         "extensions": {"KHR_lights_punctual": {"light": 0}}},
    )  # fmt: skip
    glb.header["scenes"] = [{"nodes": [0, 1]}]
    spot = {"type": "spot", "intensity": 4, "spot": {"outerConeAngle": 0.5}}
    glb.header["extensions"] = {"KHR_lights_punctual": {"lights": [spot]}}
    sampler = {"input": keys, "output": output, "interpolation": "STEP"}
    channel = {"sampler": 0, "target": {"node": 1, "path": "translation"}}
    glb.header["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    return glb


SCENE_PLACES = [
    path for path in places(animated_scene().header) if path[-1] not in ("name", "asset")
]


def motion_of(mesh, path):
    motion = rc.load_motion(mesh, path, steps=3)
    return motion.names, motion.body.tobytes(), motion.world_from_body.tobytes()


@pytest.mark.parametrize("path", SCENE_PLACES, ids=lambda path: "/".join(map(str, path)))
def test_a_flipped_name_moves_no_body_unsaid(path, load, tmp_path):
    assert_said(path, motion_of, load, tmp_path)


def assert_said(path, read, load, tmp_path):
    """A flipped name of a scene changes nothing that is read, or is refused."""
    *keys, name = path
    if not isinstance(name, str):
        return
    mesh = load("a.glb", animated_scene().data())
    (tmp_path / "b.glb").write_bytes(animated_scene().data())
    wanted = read(mesh, tmp_path / "b.glb")
    others = (name.upper(), name.capitalize(), name[:-1], name + name[-1])
    for changed in {*list(flips(name))[::4], *others} - {name}:
        glb = animated_scene()
        owner = reduce(getitem, keys, glb.header)
        if changed in owner:
            continue
        owner[changed] = owner.pop(name)
        (tmp_path / "b.glb").write_bytes(glb.data())
        try:
            assert read(mesh, tmp_path / "b.glb") == wanted, changed
        except (MeshError, CameraError, rc.ConfigError):
            continue


def test_names_of_users_are_noted_once_and_read_around(load):
    glb = two_nodes()
    for node in glb.header["nodes"]:
        node |= {"customer": 7, "extras": {"nodes": 1}}
    mesh = load("a.glb", glb.data())
    assert mesh.n_faces == 4 * len(FACES)
    assert [note.partition(": ")[2] for note in mesh.notes] == [
        "not read: customer of node 0; content may be missing"
    ]


def test_a_name_that_comes_twice_is_refused(load):
    with pytest.raises(MeshError, match="expected a readable JSON, got: 'mesh' twice"):
        load("a.gltf", b'{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0, "mesh": 1}]}')


def test_indices_that_are_fewer_than_their_bytes_are_noted(tmp_path):
    """Of 30 indices a bit makes "3 ", 10 triangles are one."""
    glb = Glb(POINTS, np.tile(FACES[:2], (5, 1)))
    data = glb.data()
    assert data.count(b'"count": 30') == 1
    text = noted_or_refused(tmp_path / "a.glb", data.replace(b'"count": 30', b'"count": 3 '))
    assert "ignored 54 bytes" in text
    assert noted_or_refused(tmp_path / "a.glb", data) == ""


def test_an_accessor_that_nothing_names_is_noted(tmp_path):
    glb = two_nodes()
    few = glb.accessor(np.ravel(FACES[:1]), "<u2")
    glb.header["meshes"][0]["primitives"][1]["indices"] = few
    many = glb.accessor(np.ravel(FACES), "<u2")
    assert "ignored 1 accessors" in noted_or_refused(tmp_path / "a.glb", glb.data())
    glb.header["meshes"][0]["primitives"][1]["indices"] = many
    assert "ignored 1 accessors" in noted_or_refused(tmp_path / "a.glb", glb.data())


MOVED = '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 1 2 3"/>'
TWO = f"<node>{HERE}</node><node><translate>1 2 3</translate>{HERE}</node>"
UNIT = '<asset><unit meter="0.01"/></asset>'
OWN = {"cameras": [{"name": "a", **CAMERA}], "rig_from_camera": [np.eye(4).tolist()]}
ROS = (
    "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, "
    "data: [5, 0, 3, 0, 5, 2, 0, 0, 1]}\ndistortion_model: plumb_bob\n"
    "distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}\n"
)
STEREO = CAMERAS["cv.yaml", "matrices"](2).decode() + (
    "R: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    "T: !!opencv-matrix\n  rows: 3\n  cols: 1\n  dt: d\n  data: [1, 0, 0]\n"
)
TWO_CAMERAS = KALIBR.format(0) + KALIBR.format(1)
SHAPE = obj(POINTS, FACES)


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("a.3mf", threemf(build=MOVED.replace("transform", "tranrform")), "'transform', got"),
        ("a.3mf", threemf(build=MOVED + MOVED.replace("item", "itam")), "not read: itam of"),
        ("a.3mf", threemf(build=MOVED.replace("transform", "moved")), "not read: moved of"),
        ("a.3mf", threemf(), None),
        ("a.dae", dae(TWO.replace("translate", "trans")), "not read: trans of"),
        ("a.dae", dae(TWO.replace("translate", "tranrlate")), "expected 'translate', got"),
        ("a.dae", dae(TWO, more=UNIT.replace("meter", "mater")), "expected 'meter', got"),
        ("a.dae", dae(TWO, more=UNIT.replace("unit", "uoit")), "expected 'unit', got"),
        ("a.dae", dae(TWO, more=UNIT.replace("asset", "bsset")), "not read: bsset of the file"),
        ("a.dae", dae(TWO, more=UNIT), None),
        ("a.obj", SHAPE.replace(b"f 1//1 2//1 4//1", b"g 1//1 2//1 4//1"), "may be a face"),
        ("b.obj", SHAPE.replace(b"//1", b"").replace(b"f 1 2 4", b"v 1 2 4"), "may be a face"),
        ("a.obj", SHAPE, None),
        ("a.ply", ply(POINTS, FACES).replace(
            b"element extra 1\nproperty int a", b"element fabe 1\nproperty list uchar int "
            b"vertex_index").replace(b"\n9\n", b"\n3 0 1 2\n"), "ignored elements 'fabe'"),
        *(("k.yaml", TWO_CAMERAS.replace("cam1", name).encode(), f"got a table '{name}'")
          for name in ("cbm1", "cam01", "Camera1")),
        *(("k.yaml", (KALIBR.format(0) + f"cam1:{value}\n").encode(), ", got none|a table of names")
          for value in (" {}", " [1]", "")),
        ("k.yaml", (KALIBR.format(0) + "imu0: {rate: 200}\n").encode(), "not read: imu0"),
        ("k.yaml", TWO_CAMERAS.replace("distortion_coeffs", "distortion_coefgs", 1).encode(),
         "expected 'distortion_coeffs', got"),
        ("ros.yaml", ROS.replace("distortion_coef", "distortion_boef").encode(),
         "expected 'distortion_coefficients', got"),
        ("cv.yaml", STEREO.replace("R:", "S:").encode(), "not read: S of the file"),
        ("transforms.json", CAMERAS["transforms.json", "frames"](2).replace(
            b'"h"', b'"k1": 0, "j1": 0.5, "h"'), "not read: j1 of the file"),
        ("o.json", json.dumps(opensfm(1, 2)).replace("rig_instances", "rig_instbnces").encode(),
         "expected 'rig_instances', got"),
        ("m.xml", metashape(1, 2, "<k1>0.1</k1>").replace(b"k1>", b"j1>"), "expected no term j1"),
        ("m.xml", metashape(1, 2, "<cx>0.1</cx>").replace(b"cx>", b"bx>"), "not read: bx of"),
        ("m.xml", metashape(1, 2).replace(b'<camera id="1"', b'<cbmera id="1"').replace(
            b"</camera></cameras>", b"</cbmera></cameras>"), "not read: cbmera of"),
        ("own.json", json.dumps(OWN).replace("rig_from", "rig_frol").encode(),
         "expected 'rig_from_camera', got"),
        ("a.gltf", json.dumps(scene(2)).replace('"camera": 0}]', '"cbmera": 0}]').encode(),
         "expected 'camera', got"),
    ],
)  # fmt: skip
def test_a_misspelt_name_is_noted_or_refused(name, data, text, tmp_path):
    said = noted_or_refused(tmp_path / name, data)
    assert re.search(text, said) if text else (said == "")


def test_the_header_of_colmap_is_held_against_what_was_read(tmp_path):
    """Our own files have one."""
    poses = rc.look_at(eyes=[(1.0, 2, 3), (3, 2, 1)], targets=(0, 0, 0))
    views = rc.Views(rc.Rig([rc.Camera(**CAMERA)]), rc.Poses.of(poses), ("a", "b"))
    rc.write_views(tmp_path / "a", views, format="colmap-text")
    images = tmp_path / "a" / "images.txt"
    text = images.read_text()
    assert rc.read_views(tmp_path / "a").notes == ()
    images.write_text(text.replace("images: 2", "images: 1"))
    assert "declares 1 images; read all 2" in " ".join(rc.read_views(tmp_path / "a").notes)
    images.write_text(text.replace("images: 2", "images: 3"))
    with pytest.raises(
        CameraError, match=r"images\.txt: expected 3 images, as the header says, got 2"
    ):
        rc.read_views(tmp_path / "a")


def test_a_slip_is_one_character_two_in_turn_or_upper_case():
    for name in ("mesi", "mes", "meshh", "emsh", "MESH", "Mesh", "eesh"):
        assert is_slip(name, "mesh"), name
    for name in ("meshes", "name", "mehhs", "shme", "k1"):
        assert not is_slip(name, "mesh"), name
    assert not is_slip("k1", "k2")  # any two names of two characters are that near


def test_a_slip_beside_the_right_name_is_only_noted():
    unknown_names = UnknownNames(MeshError)
    unknown_names.look("node 0", ["mesh", "mesi"], frozenset({"mesh"}))
    assert unknown_names.notes() == ["not read: mesi of node 0; content may be missing"]
    with pytest.raises(MeshError, match="expected 'mesh', got 'mesi', unknown to the format"):
        unknown_names.look("node 1", ["mesi"], frozenset({"mesh"}))
