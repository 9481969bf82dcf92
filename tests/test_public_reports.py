"""Cases of public reports about other programs, with right values by formulas or own counts.

Further ones: cameras exactly in a plane of the scene, tests/area/test_edge_on_area.py; a lens near
a pole, tests/lenses/test_near_pole.py; files of SLAM programs, tests/camera_formats/test_slam.py;
luminaires, tests/light/test_luminaires.py; names of STEP, tests/mesh/test_mesh_step.py.
"""

import itertools
import json
import re
import struct
import zipfile

import numpy as np
import pytest
from nightly import amount
from processes import run_python
from step_crate import crate
from surface_cases import in_regions
from view_files import has_note, refused, same

import rastercov as rc
from rastercov.core.coverage.doubts import find_warnings
from rastercov.formats.cameras import read_views
from rastercov.placement import FewestCameras, problem_of_matrix, select_greedy, select_integer
from rastercov.reference.regions import points_on

BOX = np.array(list(itertools.product((0, 1), repeat=3)), float) * (30, 20, 10)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = np.array([each for a, b, c, d in SIDES for each in ((a, b, c), (a, c, d))])


def floor(*corners):
    return rc.Mesh(np.array(corners, float), [(0, 1, 2), (0, 2, 3)])


def written(folder, name, content):
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def area_of(mesh):
    return mesh.n_faces, float(mesh.areas.sum())


# --- mesh files -----------------------------------------------------------------------------------


def stl(header=b"exported", count=12, end=b"", attribute=0):
    facets = [struct.pack("<12fH", 0, 0, 0, *BOX[each].ravel(), attribute) for each in TRIANGLES]
    return header.ljust(80, b" ")[:80] + struct.pack("<I", count) + b"".join(facets) + end


def text_stl(start="", name="box", end="\n", tail="", numbers="%g"):
    lines = [f"{start}solid {name}"]
    for each in TRIANGLES:
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += ["   vertex " + " ".join(numbers % x for x in corner) for corner in BOX[each]]
        lines += ["  endloop", " endfacet"]
    return end.join([*lines, f"endsolid {name}"]) + end + tail


@pytest.mark.parametrize(
    "content",
    [
        stl(b"solid base_plate"),
        stl(b"solid part\n facet normal 0 0 1\n outer loop\n vertex 0 0 0"),
        stl(b"solid\0\0\0"),
        stl(b"COLOR=\xff\x80\x00\xff,MATERIAL=", attribute=0x8123),
        stl(end=b"\0" * 36),
        text_stl(" "),
        text_stl(name="2STL_V_1_0" + "/" * 400),
        text_stl(end="\r\n").upper(),
        text_stl(end="\r"),
        text_stl(name="facet normal"),
        text_stl("\ufeff"),
        text_stl(tail="   \n\n\0\0\0"),
        text_stl(numbers="%.6E"),
    ],
    ids=(
        "solid",
        "start",
        "nul",
        "magics",
        "trailing",
        "space",
        "long",
        "crlf",
        "cr",
        "facet",
        "mark",
        "end",
        "exponent",
    ),
)
def test_boxes_of_many_writers_of_stl_are_12_faces_of_2200(content, tmp_path):
    mesh = rc.Mesh.load(written(tmp_path, "a.stl", content), unit="m")
    assert area_of(mesh) == (12, pytest.approx(2200))


def test_two_solids_in_one_stl_are_24_faces(tmp_path):
    both = text_stl() + text_stl(name="lid")
    assert area_of(rc.Mesh.load(written(tmp_path, "a.stl", both), unit="m")) == (24, 4400)


def test_an_stl_that_counts_0_facets_and_has_12_is_refused(tmp_path):
    with pytest.raises(
        rc.MeshError, match="expected 12 triangles from the file size, got 0 in its header"
    ):
        rc.Mesh.load(written(tmp_path, "a.stl", stl(count=0)), unit="m")


CONCAVE = """v 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nf 4 5 6 1 2 3\nf 2 3 4 5 6 1
v 10 0 0\nv 14 3 0\nv 10 1 0\nv 6 3 0\nf 7 8 9 10\nf 10 7 8 9\n"""
NEGATIVE = "".join(
    "".join(f"v {x + 40 * k:g} {y:g} {z:g}\n" for x, y, z in BOX)
    + "".join(f"f {' '.join(str(i - 8) for i in side)}\n" for side in SIDES)
    for k in range(3)
)
WHOLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 3 4 5\nv 1 2 3\nv 4 1 2\nf 4 5 6\n"
LINES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nl 1 2 3\np 1\n"


@pytest.mark.parametrize(
    ("text", "area", "notes"),
    [
        (CONCAVE, 14, []),
        (NEGATIVE, 6600, []),
        (WHOLE, 0.5 + np.sqrt(128) / 2, []),
        (LINES, 0.5, ["1 polyline: no surface", "1 point element: no surface"]),
        (WHOLE.replace("v 1 2 3\nv 4 1 2", "f 1 2 3"), None, ["line 5 may be a face"]),
    ],
)
def test_obj_files_have_their_area_and_no_false_note(text, area, notes, tmp_path):
    path = written(tmp_path, "a.obj", text)
    if area is None:  # v is f with one bit changed
        text = text.replace("f 4 5 6", "f 1 2 4")
        area = float(rc.Mesh.load(written(tmp_path, "a.obj", text), unit="m").areas.sum())
    mesh = rc.Mesh.load(path, unit="m")
    assert mesh.areas.sum() == pytest.approx(area)
    items = [note for note in mesh.warnings if re.search(r"a.obj: (ignored|line \d+ may)", note)]
    assert len(items) == len(notes)
    assert all(words in note for words, note in zip(notes, items, strict=True))


def test_spaces_in_the_header_of_a_ply_are_none_of_its_words(tmp_path):
    text = (
        "ply  \nformat   ascii 1.0 \nelement  vertex   3\nproperty float  x\nproperty float y \n"
        "property float z\nelement face 1\nproperty list  uchar int vertex_indices\nend_header \n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    assert area_of(rc.Mesh.load(written(tmp_path, "a.ply", text), unit="m")) == (1, 0.5)


def ply(vertex, face, form="binary_little_endian", has_faces_first=False):
    """The box: vertex and face have (type, name, values of a row) for each property."""
    codes = {"uchar": "B", "ushort": "H", "uint": "I", "int": "i", "float": "f", "double": "d"}
    elements = {"vertex": (8, vertex), "face": (6, face)}
    elements = dict(sorted(elements.items(), reverse=not has_faces_first))
    head, body = ["ply", f"format {form} 1.0"], b""
    for name, (n, properties) in elements.items():
        head.append(f"element {name} {n}")
        head += [f"property {kind} {own}" for kind, own, _ in properties]
        for row in range(n):
            words = []
            for kind, _, of_row in properties:
                values = of_row(row)
                kinds = kind.removeprefix("list ").split()
                listed = [len(values)] * (len(kinds) - 1) + [*values]
                for code, value in zip(
                    [kinds[0], *[kinds[-1]] * len(listed)], listed, strict=False
                ):
                    words.append(f"{value:g}")
                    order = ">" if "big" in form else "<"
                    body += struct.pack(order + codes[code], value) if form != "ascii" else b""
            body += f"{' '.join(words)}\n".encode() if form == "ascii" else b""
    return "\n".join([*head, "end_header\n"]).encode() + body


def xyz(kind):
    return [(kind, "xyz"[k], lambda row, k=k: [BOX[row, k]]) for k in range(3)]


def indices(*kinds, name="vertex_indices"):
    return [(f"list {' '.join(kinds)}", name, SIDES.__getitem__)]


TEXTURE = [("list uchar float", "texcoord", lambda row: [0.1, 0.2] * 4)]
DESCRIPTOR = [("list uint double", "descriptor", lambda row: [1.5] * (row % 5))]
COLOUR = [("uchar", name, lambda row: [255]) for name in ("red", "green", "blue", "alpha")]


@pytest.mark.parametrize(
    "content",
    [
        ply(xyz("float"), indices("ushort", "uint") + TEXTURE),
        ply(xyz("float"), indices("ushort", "uint") + TEXTURE, "ascii"),
        ply(xyz("double"), indices("uint", "uint")),
        ply(xyz("double"), indices("int", "int", name="vertex_index"), "binary_big_endian"),
        ply(xyz("float") + DESCRIPTOR, indices("uchar", "int")),
        ply(DESCRIPTOR + xyz("float"), indices("uchar", "int")),
        ply(xyz("float") + COLOUR, indices("uchar", "int") + TEXTURE + COLOUR),
        ply(xyz("float"), indices("uchar", "int"), has_faces_first=True),
    ],
    ids=["texture", "text", "uint", "big", "lists", "lists first", "colours", "faces first"],
)
def test_boxes_of_many_writers_of_ply_are_12_faces_of_2200(content, tmp_path):
    mesh = rc.Mesh.load(written(tmp_path, "a.ply", content), unit="m")
    assert area_of(mesh) == (12, pytest.approx(2200))


METRE = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({},.METRE.))"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        ("$", 1), (".MILLI.", 1e-3), (("INCH", 0.0254, "$"), 0.0254),
        (("FOOT", 304.8, ".MILLI."), 0.3048), (("zoll", 25.4, ".MILLI."), 0.0254),
        *amount((), at_night=(
            (".CENTI.", 1e-2), (".MICRO.", 1e-6), (("INCH", 25.4, ".MILLI."), 0.0254),
            (("inch", 25.4, ".MILLI."), 0.0254),
        )),
    ],
)  # fmt: skip
def test_a_box_of_step_is_22_cm2_in_any_unit(unit, metres, tmp_path):
    pytest.importorskip("cascadio", reason="cascadio is not installed", exc_type=ImportError)
    text = crate(np.array([30, 20, 10]) * 1e-3 / metres).decode()
    if isinstance(unit, str):
        text = text.replace(METRE.format("$"), METRE.format(unit))
    else:
        name, factor, base = unit
        own = f"(CONVERSION_BASED_UNIT('{name}',#9002)LENGTH_UNIT()NAMED_UNIT(#9003))"
        further = (
            f"#9001={METRE.format(base)};\n"
            f"#9002=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE({factor}),#9001);\n"
            "#9003=DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
        )
        text = text.replace(METRE.format("$"), own)
        text = text.replace("\nENDSEC;\nEND-ISO", f"\n{further}ENDSEC;\nEND-ISO")
    mesh = rc.Mesh.load(written(tmp_path, "a.step", text))
    assert area_of(mesh) == (12, pytest.approx(0.0022, rel=1e-6))


def building(path, unit):
    """A wall of 2 x 0.2 x 3 m and a block of 1 m as a set of polygons, in a unit of length."""
    ifcopenshell = pytest.importorskip("ifcopenshell", reason="ifcopenshell is missing")
    from ifcopenshell.api import run

    file, metres = ifcopenshell.file(schema="IFC4"), IFC_UNITS[unit]
    project = run("root.create_entity", file, ifc_class="IfcProject")
    if unit in ("inch", "foot"):
        own = run("unit.add_conversion_based_unit", file, name=unit)
    else:
        prefix = {"mm": "MILLI", "cm": "CENTI", "m": None}[unit]
        own = run("unit.add_si_unit", file, unit_type="LENGTHUNIT", prefix=prefix)
    run("unit.assign_unit", file, units=[own])
    whole = run("context.add_context", file, context_type="Model")
    how = {"context_identifier": "Body", "target_view": "MODEL_VIEW", "parent": whole}
    body = run("context.add_context", file, context_type="Model", **how)
    storey = run("root.create_entity", file, ifc_class="IfcBuildingStorey", name="Ground")
    run("aggregate.assign_object", file, products=[storey], relating_object=project)
    size = {"length": 2.0, "height": 3.0, "thickness": 0.2}
    shapes = {"IfcWall": run("geometry.add_wall_representation", file, context=body, **size)}
    corners = itertools.product((0.0, 1 / metres), repeat=3)
    points = file.createIfcCartesianPointList3D([*corners])
    sides = [file.createIfcIndexedPolygonalFace([i + 1 for i in side]) for side in SIDES]
    block = file.createIfcPolygonalFaceSet(points, True, sides)
    shapes["IfcBuildingElementProxy"] = file.createIfcShapeRepresentation(
        body, "Body", "Tessellation", [block]
    )
    for x, (kind, shape) in enumerate(shapes.items()):
        made = run("root.create_entity", file, ifc_class=kind, name=kind)
        run("geometry.assign_representation", file, product=made, representation=shape)
        place = np.eye(4)
        place[:3, 3] = 5.0 * x, 5.0 * x, 0.0
        run("geometry.edit_object_placement", file, product=made, matrix=place, is_si=True)
        run("spatial.assign_container", file, products=[made], relating_structure=storey)
    file.write(str(path))


IFC_UNITS = {"mm": 1e-3, "m": 1, "inch": 0.0254, "foot": 0.3048, "cm": 1e-2}


@pytest.mark.parametrize("unit", IFC_UNITS)
def test_a_wall_and_a_block_of_ifc_are_20_m2_in_any_unit(unit, tmp_path):
    building(tmp_path / "a.ifc", unit)
    mesh = rc.Mesh.load(tmp_path / "a.ifc")
    assert mesh.areas.sum() == pytest.approx(2 * (2 * 0.2 + 2 * 3 + 0.2 * 3) + 6, rel=1e-6)
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx((6, 6, 3), rel=1e-6)


def test_a_gltf_whose_asset_is_a_list_is_refused_in_plain_words(tmp_path):
    with pytest.raises(rc.MeshError, match="got a value of another type; export it again"):
        rc.Mesh.load(written(tmp_path, "a.gltf", '{"asset": []}'))


RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="r" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


@pytest.mark.parametrize(
    ("attribute", "build", "words"),
    [
        (' meshresolution="lowres"', '<item objectid="1"/>', "got a placeholder"),
        ("", "", "expected an object in the build, got none"),
    ],
)
def test_stand_ins_and_empty_builds_of_3mf_are_refused(attribute, build, words, tmp_path):
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in BOX)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in TRIANGLES)
    model = (
        '<model unit="millimeter" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
        f'<object id="1" type="model"{attribute}><mesh><vertices>{corners}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object></resources><build>{build}</build></model>"
    )
    with zipfile.ZipFile(tmp_path / "a.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
        archive.writestr("_rels/.rels", RELATIONS)
    with pytest.raises(rc.MeshError, match=words):
        rc.Mesh.load(tmp_path / "a.3mf")


# --- cameras and poses ----------------------------------------------------------------------------

QUATERNION = 0.5253162925571191, 0.08616498381666671, -0.8328810911747581, -0.1514182165443147
SHIFT = np.array([17.80032433013168, -3.678248221067275, 71.6593580492154])
CAMERAS = (
    "# Camera list\n2 OPENCV 1400 1050 1.0123e+003 1.0119e+003 700.5 520.25 -1.25e-002 3.0e-003 "
    "1.0e-004 -2.0e-004\n"
)
IMAGE = (
    f"1 {' '.join(map(repr, QUATERNION))} 17.80032433013168 -3.678248221067275 71.6593580492154 2 "
    "A-SITE map plan wp-2 (402).jpg\n775.26 1029.32 8574\n"
)


def model(folder, cameras=CAMERAS, images=IMAGE, end="\n"):
    written(folder, "m/cameras.txt", cameras.replace("\n", end))
    written(folder, "m/images.txt", images.replace("\n", end))
    written(folder, "m/points3D.txt", "")
    return folder / "m"


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_model_of_colmap_with_spaces_in_names_has_its_centre(end, tmp_path):
    w, x, y, z = QUATERNION / np.linalg.norm(QUATERNION)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    views = read_views(model(tmp_path, end=end))
    same(views.poses.world_from_camera[0, :3, 3], -turn.T @ SHIFT, 1e-9)
    assert views.images == ("A-SITE map plan wp-2 (402).jpg",)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((repr(QUATERNION[0]), "5.1"), "got one that is not a rotation"),
        ((repr(QUATERNION[0]), "inf"), "that is not finite"),
        (("71.6593580492154 2", "71.6593580492154 7"), "expected a camera of cameras.txt"),
        (("775.26 1029.32 8574\n", "2 1 0 0 0 1 2 3 2 b.jpg\n"), "expected the points of image"),
    ],
)
def test_images_of_colmap_with_mixed_up_columns_are_refused(change, words, tmp_path):
    refused(model(tmp_path, images=IMAGE.replace(*change)), words)
    refused(model(tmp_path, cameras=CAMERAS.replace("OPENCV", "RADIAL")), "expected 5 parameters")


def test_an_image_of_colmap_without_points_has_a_blank_line(tmp_path):
    line = IMAGE.split("\n")[0]
    images = f"{line}\n\n{line.replace('1 ', '2 ', 1).replace('(402)', '(403)')}\n\n"
    views = read_views(model(tmp_path, images=images))
    assert [name[-9:] for name in views.images] == ["(402).jpg", "(403).jpg"]
    same(*views.poses.world_from_camera)


METASHAPE = """<document version="2.0.0"><chunk label="a" enabled="true"><sensors>
<sensor id="0" label="P1" type="frame"><resolution width="8192" height="5460"/>
<calibration type="frame" class="initial"><resolution width="8192" height="5460"/><f>8198.1</f>
<cx>13.8</cx><cy>7.4</cy></calibration>
<calibration type="frame" class="adjusted"><resolution width="8192" height="5460"/><f>8196.7</f>
<cx>15.5</cx><cy>16.1</cy><k1>-0.0447</k1><k2>0.0208</k2><k3>-0.0912</k3><p1>-0.0013</p1>
<p2>0.0008</p2></calibration></sensor></sensors><cameras>
<camera id="0" sensor_id="0" label="a"><transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform>
</camera><camera id="1" sensor_id="0" label="b"/></cameras>
<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 20 30</translation>
<scale>2.5</scale></transform></chunk></document>
"""


def test_metashape_has_the_adjusted_lens_and_the_place_of_its_chunk(tmp_path):
    views = read_views(written(tmp_path, "a.xml", METASHAPE))
    camera = views.camera()
    assert (camera.fx, camera.fy) == (8196.7, 8196.7)
    assert (camera.cx, camera.cy) == (pytest.approx(4096 + 15.5), pytest.approx(2730 + 16.1))
    assert views.images == ("a",)
    # s R x + t
    same(views.poses.world_from_camera[0, :3, 3], (5, 22.5, 37.5), 1e-12)


ROS = """image_width: {width}
image_height: {height}
camera_name: a
camera_matrix: {{rows: 3, cols: 3, data: [690, 0, 640, 0, 690, 400, 0, 0, 1]}}
distortion_model: {model}
distortion_coefficients: {{rows: 1, cols: {n}, data: {d}}}
"""


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("plumb_bob", [-0.03, 0.035, -0.0001, -0.0002, -0.012, 0, 0, 0]),
        ("rational_polynomial", [-0.03, 0.035, -0.0001, -0.0002, -0.012]),
    ],
)
def test_ros_counts_coefficients_whatever_the_model_is_called(model, d, tmp_path):
    text = ROS.format(width=1280, height=800, model=model, n=len(d), d=d)
    camera = read_views(written(tmp_path, "a.yaml", text)).camera()
    assert camera.distortion == (-0.03, 0.035, -0.0001, -0.0002, -0.012)


def test_binning_and_region_of_a_ros_message_make_the_image(tmp_path):
    """K is of the full resolution, and the image has width / binning_x pixels: CameraInfo.msg."""
    text = """header: {{seq: 1, stamp: {{secs: 1, nsecs: 2}}, frame_id: left}}
height: 2050
width: 2448
distortion_model: plumb_bob
D: [-0.123, 0.1376, -0.00083, -0.00303, -0.0848]
K: [2348.0, 0.0, 1173.5, 0.0, 2346.7, 994.7, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [2454.0, 0.0, 1218.2, 0.0, 0.0, 2454.0, 991.6, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 4
binning_y: 4
roi: {{x_offset: {x}, y_offset: {y}, height: {h}, width: {w}, do_rectify: False}}
---
"""
    whole = read_views(written(tmp_path, "a.yaml", text.format(x=0, y=0, w=0, h=0)))
    camera = whole.camera()
    assert (camera.width, camera.height) == (612, 512)
    assert camera.fx == 2348 / 4
    assert camera.cx == pytest.approx((1173.5 + 0.5) / 4)
    assert camera.cy == pytest.approx((994.7 + 0.5) / 4)
    assert has_note(whole, "binning and roi applied: 612 x 512 px, of 2448 x 2050")
    part = read_views(written(tmp_path, "b.yaml", text.format(x=400, y=200, w=800, h=600))).camera()
    assert (part.width, part.height) == (200, 150)
    assert part.cx == pytest.approx((1173.5 + 0.5 - 400) / 4)


def test_a_kalibr_fisheye_takes_a_limit_of_its_angle_beside_the_file(tmp_path):
    text = (
        "cam0: {camera_model: pinhole, intrinsics: [300, 300, 320, 240], distortion_model: fov, "
        "distortion_coeffs: [0.92], resolution: [640, 480]}\n"
    )
    written(tmp_path, "k.yaml", text)
    own = written(tmp_path, "own.json", '{"file": "k.yaml", "max_angle_deg": 60}')
    camera = read_views(own).camera()
    assert (camera.model, camera.max_angle_deg) == ("fov", 60)


def test_poses_in_mm_lists_and_columns_are_named(tmp_path):
    mesh, camera = rc.shapes.teapot(5), rc.Camera.load("khepra")
    poses = rc.sphere_of_poses((0, 0, 0.07), 0.6, count=6)
    wanted = rc.evaluate(mesh, camera, poses, fields=()).covered.share()
    far = poses.copy()
    far[:, :3, 3] *= 1000
    np.save(tmp_path / "mm.npy", far)
    views = read_views(tmp_path / "mm.npy", conventions=rc.Conventions(pose_unit="mm"))
    assert rc.evaluate(mesh, camera, views.poses, fields=()).covered.share() == wanted
    result = rc.evaluate(mesh, camera, far, by="face")
    assert any("--pose-unit" in line for line in find_warnings(result.network, camera, far))
    written(tmp_path, "list.json", json.dumps(poses.tolist()))
    same(read_views(tmp_path / "list.json").poses.world_from_camera, poses)
    np.save(tmp_path / "columns.npy", poses.transpose(0, 2, 1))
    refused(tmp_path / "columns.npy", "but its transpose does")
    for name, (has_axes, is_inverse) in {"opengl": (True, False), "camera-from-world":
                                         (False, True)}.items():  # fmt: skip
        given = np.linalg.inv(poses) if is_inverse else poses
        given = given @ np.diag([1.0, -1, -1, 1]) if has_axes else given
        lines = find_warnings(rc.evaluate(mesh, camera, given, by="face").network, camera, given)
        assert any(f"--pose-convention {name}" in line for line in lines)


def test_cameras_of_odm_are_in_parts_of_the_longer_side(tmp_path):
    own = {"projection_type": "brown", "width": 4000, "height": 3000, "focal_x": 0.6,
           "focal_y": 0.61, "c_x": 0.01, "c_y": -0.02, "k1": 0.01, "k2": -0.02, "p1": 0.001,
           "p2": -0.002, "k3": 0.003}  # fmt: skip
    camera = read_views(written(tmp_path, "c.json", json.dumps({"v2 dji": own}))).camera()
    assert (camera.fx, camera.fy) == (2400, 2440)
    assert (camera.cx, camera.cy) == (pytest.approx(2040), pytest.approx(1420))
    frames = [{"file_path": "a", "transform_matrix": np.eye(4).tolist()}]
    content = {"camera_angle_x": 0.6911112070083618, "w": 800, "h": 800, "frames": frames}
    path = written(tmp_path, "transforms.json", json.dumps(content))
    views = read_views(path, conventions=rc.Conventions(pose_unit="m"))
    assert views.camera().fx == pytest.approx(1111.1110311937682)


# --- areas by formulas ----------------------------------------------------------------------------


def test_a_surveillance_camera_covers_the_trapezoid_of_its_density():
    """At 4 m, 30 degrees down: between the lower edge of the image and the depth f / density."""
    ground = floor((-150, -150, 0), (150, -150, 0), (150, 150, 0), (-150, 150, 0))
    camera, down = rc.Camera.from_fov(1920, 1080, hfov_deg=106), np.radians(30)
    pose = rc.look_at((0, 0, 4), (0, 4 / np.tan(down), 0))
    half, t = np.arctan(540 / camera.fy), np.tan(np.radians(53))
    for density, wanted in ((25, 1264.4043), (62.5, 186.6357), (125, 32.6688), (250, 0)):
        task = rc.Task(min_facing_density=density)
        is_covered = rc.evaluate(ground, camera, pose, task, fields=()).covered
        near = 4 / np.tan(down + half)
        far = (camera.fx / density - 4 * np.sin(down)) / np.cos(down)
        area = t * ((far**2 - near**2) * np.cos(down) + 8 * np.sin(down) * (far - near))
        assert is_covered.area[0].sum() == pytest.approx(max(area, 0), abs=1e-6)
        assert is_covered.area[0].sum() == pytest.approx(wanted, abs=1e-4)


def test_nadir_images_cover_the_union_of_their_rectangles():
    ground = floor((-100, -100, 0), (100, -100, 0), (100, 100, 0), (-100, 100, 0))
    camera = rc.Camera(width=4000, height=3000, fx=2900, fy=2900)
    width, height = 4000 / 2900 * 50, 3000 / 2900 * 50
    eyes = np.array([(0.3 * width * k - 40, 0, 50) for k in range(5)])
    poses = rc.look_at(eyes, eyes * (1, 1, 0), up=(0, 1, 0))
    is_covered = rc.evaluate(ground, camera, poses, fields=()).covered
    left = max(eyes[0, 0] - width / 2, -100)
    right = min(eyes[-1, 0] + width / 2, 100)
    assert is_covered.area[0].sum() == pytest.approx((right - left) * height, rel=1e-12)
    assert is_covered.area[0].sum() == pytest.approx(7847.800237812128, rel=1e-12)
    for density, share in ((57.9, 1), (58.1, 0)):  # f / h = 58 px/m everywhere
        task = rc.Task(min_pixel_density=density)
        some = rc.evaluate(ground, camera, poses, task, fields=()).covered
        assert some.area[0].sum() == pytest.approx(share * 7847.800237812128, abs=1)


@pytest.mark.native
def test_a_luminaire_is_linear_in_the_angle(tmp_path):
    """200 points a side of the light of 1,000 cd on the axis, 0.1 at 10 degrees, none from 90."""
    text = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 50\n0 10 90\n0\n1000 100 0\n"
    written(tmp_path, "a.ies", text)
    lamps = rc.Lamps([rc.Lamp.from_ies(tmp_path / "a.ies")], rc.look_at((0, 0, 3), (0, 0, 0)))
    ground = floor((-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0))
    camera, eye = rc.Camera.from_fov(500, 500, hfov_deg=90), rc.look_at((0, 0, 4), (0, 0, 0))
    regions = rc.regions(ground, camera, eye, rc.Task(min_illuminance=8), lamps=lamps)
    points, face = points_on(ground, 4000)
    r = np.hypot(points[:, 0], points[:, 1])
    share = np.interp(np.degrees(np.arctan2(r, 3)), [0, 10, 90], [1, 0.1, 0])
    wanted = 1000 * share * 3 / (r**2 + 9) ** 1.5 >= 8
    assert (in_regions(regions, 0, points, face) == wanted).mean() > 0.999


@pytest.mark.native
def test_a_spot_of_10_degrees_has_the_limit_of_linear_intensities(tmp_path):
    """3 m above a floor, 12.758 m2: the angles of a table by steps of 10 degrees."""
    table = [2000, 1704.288, 1054.585, 473.856, 154.609, 36.631, 6.302, 0.787, 0.071, 0.005]
    text = (
        "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 10 1 1 2 0 0 0\n1 1 14\n0 10 20 30 40 50 60 70 80 90"
    )
    written(tmp_path, "a.ies", f"{text}\n0\n{' '.join(map(str, table))}\n")
    lamps = rc.Lamps([rc.Lamp.from_ies(tmp_path / "a.ies")], rc.look_at((0, 0, 3), (0, 0, 0)))
    ground = floor((-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0))
    camera, eye = rc.Camera.from_fov(500, 500, hfov_deg=100), rc.look_at((0, 0, 4), (0, 0, 0))
    task = rc.Task(min_illuminance=22.222)
    result = rc.regions(ground, camera, eye, task, lamps=lamps).at_least(1).areas().sum()
    low, high = 0.0, 4.0  # the radius, by halving: the light falls all the way
    for _ in range(60):
        r = (low + high) / 2
        intensity = np.interp(np.degrees(np.arctan2(r, 3)), np.arange(0, 91, 10), table)
        low, high = (r, high) if intensity * 3 / (r**2 + 9) ** 1.5 >= 22.222 else (low, r)
    assert np.pi * low**2 == pytest.approx(12.758, abs=1e-3)
    assert result == pytest.approx(12.758, abs=0.01)


AROUND = rc.shapes.box((5, 4.5, 2.7), centre=(2.5, 2.25, 1.35))
ROOM = rc.Mesh(AROUND.vertices, AROUND.faces[:, ::-1])
"""A closed room, of two triangles a wall."""


def rays_hits(mesh, camera, pose, several):
    """First face of rays through several by several points of each pixel, by all triangles."""
    u = (np.arange(camera.width * several) + 0.5) / several
    v = (np.arange(camera.height * several) + 0.5) / several
    across, down = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.stack((across, down, np.ones_like(across)), axis=-1).reshape(-1, 3) @ pose[:3, :3].T
    best, face = np.full(len(rays), np.inf), np.full(len(rays), -1)
    for row, (a, b, c) in enumerate(mesh.vertices[mesh.faces]):
        volume = rays @ np.cross(c - a, b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = rays @ np.cross(c - a, pose[:3, 3] - a) / volume
            over = np.cross(pose[:3, 3] - a, b - a)
            t, away = rays @ over / volume, (c - a) @ over / volume
        is_hit = (s >= 0) & (t >= 0) & (s + t <= 1) & (away > 1e-12) & (away < best)
        best[is_hit], face[is_hit] = away[is_hit], row
    return face


@pytest.mark.parametrize(
    ("mesh", "camera", "eye", "target"),
    [
        (rc.shapes.box((2, 2, 2)), (256, 256, 1000), (6, 5, 10), (0, 0, 0)),
        (ROOM, (320, 240, 160), (0.8, 0.2, 1.2), (3, 1, 0.5)),
        (ROOM, (320, 240, 160), (0.1, 0.1, 2.6), (4, 4, 0)),
    ],
    ids=["a cube", "in a room", "in a corner"],
)
def test_areas_of_faces_are_those_of_16_rays_a_pixel(mesh, camera, eye, target):
    """Walls of two triangles, of which corners are behind the camera, included."""
    width, height, f = camera
    camera = rc.Camera(width=width, height=height, fx=f, fy=f)
    pose = rc.look_at(eye, target)
    rays = np.bincount(rays_hits(mesh, camera, pose[0], 4) + 1, minlength=mesh.n_faces + 1)[1:] / 16
    for method in ("certified", "exact"):
        with rc.open_observer(mesh, camera, method=method) as observer:
            seen = observer.observe(pose).visible_pixels[0]
        assert np.abs(seen - rays).max() < 0.03 * np.sqrt(
            rays.max()
        )  # a share of a border's pixels
        assert seen.sum() == pytest.approx(rays.sum(), rel=1e-3)
    with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
        image = rasterizer.render(pose[0]).face
    assert (image.ravel() != rays_hits(mesh, camera, pose[0], 1)).mean() < 1e-4


RATIONAL = {
    "Basler": (1296, 972, 1874.63131, 1879.55762, 648, 486,
        (-13.238113, -98.012135, 0.001444, 0.002849, 1357.782415, -13.050801, -102.363353,
         1383.055291)),
    "OAK-D": (250, 250, 202.61964416503906, 202.61964416503906, 124.846, 127.786,
        (-3.4751670360565186, -38.5734748840332, 0.000343096, -9.377e-05, 286.4400939941406,
         -3.6408045291900635, -36.68898010253906, 279.0523681640625)),
    "under water": (1280, 720, 800, 800, 640, 360,
        (9.491045951843262, -102.06877136230469, 0.000822873, 0.00199929, 401.19476318359375,
         9.264853477478027, -100.42776489257813, 394.56182861328125)),
    "radtan8": (1280, 800, 903.94, 905.33, 646.09, 387.38,
        (-7.64, 19.10, 0.00068, 0.00112, -12.51, -7.64, 19.06, -12.45)),
    "Azure Kinect, colour": (4096, 3072, 1961.6769, 1961.3916, 2075.5337, 1580.7529,
        (0.40386343, -2.60288429, 0.00089407846, -4.1651688e-5, 1.51187789, 0.28427526,
         -2.42072129, 1.43542445)),
    "Azure Kinect, depth": (1024, 1024, 503.847, 503.738, 513.5111, 508.9779,
        (4.72473669, 3.20922279, 5.87981e-6, 0.00012382, 0.170596451, 5.05585957, 4.7757802,
         0.886494160)),
    "Azure Kinect, depth, another": (1024, 1024, 504.5254, 504.6263, 502.5727, 515.5487,
        (0.92184949, 0.5004009, -3.07822e-6, 2.77186e-6, 0.0283604674, 1.25842416, 0.7518121,
         0.144187750)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", RATIONAL)
def test_rational_lenses_see_the_closed_room_with_the_whole_image(name):
    width, height, fx, fy, cx, cy, distortion = RATIONAL[name]
    camera = rc.Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, model="opencv",
                       distortion=distortion)  # fmt: skip
    pose = rc.look_at((2, 2.5, 1.5), (5, 3.2, 1.9))
    with rc.open_observer(ROOM, camera) as observer:
        seen = observer.observe(pose).visible_pixels[0]
    assert seen.sum() == pytest.approx(width * height, rel=1e-9)


def test_plates_a_hair_apart_hide_what_is_behind_them():
    camera = rc.Camera(width=640, height=480, fx=900, fy=900, cx=320, cy=240)
    for gap in (1e-3, 1e-4, 1e-6, 1e-8):
        corners = [
            [(a, -0.3, z), (b, -0.3, z), (b, 0.3, z), (a, 0.3, z)]
            for a, b, z in ((-0.5, 0.5, 3), (-0.2, 0.2, 3 - gap))
        ]
        faces = [(0, 2, 1), (0, 3, 2), (4, 6, 5), (4, 7, 6)]
        with rc.open_observer(rc.Mesh(np.concatenate(corners), faces), camera) as observer:
            seen = observer.observe(np.eye(4)[None]).visible_pixels[0]
        front = 0.24 * (900 / (3 - gap)) ** 2
        assert seen[2:].sum() == pytest.approx(front, rel=1e-9)
        hidden = 0.4 * 900 / (3 - gap) * 0.6 * 300  # as high as the one behind
        assert seen[:2].sum() == pytest.approx(0.6 * 300**2 - hidden, rel=1e-9)


def test_two_triangles_of_6_px_cover_36_px_without_a_hole():
    corners = [(0.5, 0.49993896484375, 1), (0.5, 6.5, 1), (6.50006103515625, 0.49993896484375, 1),
               (6.50006103515625, 6.5, 1)]  # fmt: skip
    camera = rc.Camera(width=8, height=8, fx=1, fy=1, cx=0.5, cy=0.5)
    for faces in ([(0, 1, 2), (3, 2, 1)], [(0, 1, 2), (3, 1, 2)], [(1, 0, 2), (3, 2, 1)]):
        with rc.open_rasterizer(rc.Mesh(corners, faces), camera, "cpu") as rasterizer:
            face = rasterizer.render(np.eye(4)).face
        assert (face >= 0).sum() == (face[1:7, 1:7] >= 0).sum() == 36


TRAP = [[j < 14 for j in range(28)], [j >= 14 for j in range(28)]]
TRAP += [[a <= j % 14 < b for j in range(28)] for a, b in ((0, 8), (8, 12), (12, 14))]
"""Two halves cover all; the largest set is of both, and leads a greedy choice away."""


@pytest.mark.parametrize(
    ("covers", "costs", "chosen"),
    [
        ([[1, 0], [0, 1], [1, 1]], [16, 24, 32], 32),
        ([[1, 0], [0, 1], [0, 1]], None, 2),
        ([[1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 0, 0], [0, 0, 1, 1, 0, 0], [0, 0, 0, 0, 1, 0],
          [0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 1, 1]], None, 3),
        ([[1, 1, 0], [0, 1, 1]], [0, 1], 1),
        ([[1, 0], [0, 1], [1, 1]], [16, 16, 32], 32),
        ([[1, 1, 0], [0, 1, 1]], [1e-9, 1e9], 1e9 + 1e-9),
        (TRAP, None, 2),
    ],
)  # fmt: skip
def test_covers_cost_the_least_of_all_subsets(covers, costs, chosen):
    matrix, own = np.array(covers, bool), costs or [1] * len(covers)
    sets = (
        some
        for n in range(1, len(matrix) + 1)
        for some in itertools.combinations(range(len(matrix)), n)
    )
    least = min(sum(own[i] for i in some) for some in sets if matrix[[*some]].any(axis=0).all())
    assert least == chosen
    for select in (select_greedy, select_integer):
        selection = select(problem_of_matrix(matrix, FewestCameras(1.0), costs=costs))
        assert sum(own[i] for i in selection.chosen) == least
        assert selection.bound == pytest.approx(least)


@pytest.mark.parametrize("select", [select_greedy, select_integer])
def test_what_no_set_covers_is_refused_or_left_out(select):
    matrix = np.array([[1, 1, 0], [0, 1, 0]], bool)
    with pytest.raises(rc.ConfigError, match=r"All 2 candidates together reach 66\.7 %"):
        problem_of_matrix(matrix, FewestCameras(1.0))
    selection = select(problem_of_matrix(matrix, FewestCameras(1.0, of_reachable=True)))
    assert list(selection.chosen) == [0]
    assert selection.share == pytest.approx(2 / 3)


# --- devices --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent", "egl-device"),
        ("GALLIUM_DRIVER", "softpipe", "expected an OpenGL 4.5 core context, got none"),
        ("MESA_GL_VERSION_OVERRIDE", "2.1", "expected an OpenGL 4.5 core context, got none"),
    ],
)
def test_doctor_takes_the_cpu_without_a_driver_and_says_why(name, value, reason):
    """Of the machine, at least: no device of these settings opens."""
    done = run_python("-m", "rastercov", "doctor", **{name: value, "COLUMNS": "200"})
    assert f"{name}={value}" in done.stdout
    assert reason in " ".join(done.stdout.split())
    assert "The default device is the CPU" in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
