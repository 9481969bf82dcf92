"""Mesh and camera files in which one part is repeated n times, with n instances of its owner.

Each maker gives a file whose size grows with n and whose faces, poses and cameras do not grow
faster, so that neither time nor memory of reading it may.
"""

import io
import json
import zipfile
from functools import partial

import numpy as np
from mesh_files import FACES, POINTS, Glb, ascii_stl, obj, off, ply

# ---- 3MF

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
KIND = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
RELATIONSHIPS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/3D/a.model" Id="r" Type="{KIND}"/></Relationships>'
)
VERTICES = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in POINTS)
ROWS = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in FACES)
MESH = f"<mesh><vertices>{VERTICES}</vertices><triangles>{ROWS}</triangles></mesh>"


def model(objects="", build='<item objectid="1"/>', inside=MESH, more="", own='unit="meter"'):
    return (
        f'<model xmlns="{CORE}" {own}>{more}<resources>'
        f'<object id="1" name="part">{inside}</object>{objects}</resources>'
        f"<build>{build}</build></model>"
    )


def archive(compression=zipfile.ZIP_DEFLATED, **parts):
    """A ZIP file of these texts, beside those of a model that is right."""
    content = {"_rels/.rels": RELATIONSHIPS, "3D/a.model": model(), **parts}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as file:
        for name, text in content.items():
            file.writestr(name, text)
    return stream.getvalue()


def threemf(*words, compression=zipfile.ZIP_DEFLATED, **named):
    return archive(compression, **{"3D/a.model": model(*words, **named)})


def components(*ids):
    rows = "".join(f'<component objectid="{each}"/>' for each in ids)
    return f"<components>{rows}</components>"


def object_of(number, inside):
    return f'<object id="{number}">{inside}</object>'


ITEM = '<item objectid="1"/>'
SECOND = '<item objectid="2"/>'


def pairs(n, element):
    """n elements that hold the next one twice each, and so ask for 2^n of the last one."""
    return "".join(element(i, i + 1, i + 1) for i in range(2, n + 2))


def holding(number, *ids):
    return object_of(number, components(*ids))


def attributes(n):
    return " ".join(f'a{i}="0"' for i in range(n))


THREEMF = {
    "unknown elements": lambda n: threemf(inside="<a/>" * n + MESH, build=ITEM * n),
    "attributes": lambda n: threemf(
        inside=MESH.replace("<mesh", f"<mesh {attributes(n)}"), build=ITEM * n
    ),
    "build items": lambda n: threemf(build=ITEM * n),
    "items of nothing": lambda n: threemf(
        holding(2, *[3] * n) + object_of(3, ""), ITEM + SECOND * n
    ),
    "components": lambda n: threemf(holding(2, *[1] * n), SECOND),
    "2^n components of nothing": lambda n: threemf(
        pairs(n, holding) + object_of(n + 2, ""), ITEM + SECOND
    ),
    "a chain, and items of it": lambda n: threemf(
        "".join(holding(i, i - 1) for i in range(2, n // 2)), f'<item objectid="{n // 2 - 1}"/>' * n
    ),
    "a long name": lambda n: threemf(
        f'<object id="2" name="{"n" * 100 * n}">{MESH}</object>', SECOND * n
    ),
    "unused objects": lambda n: threemf("".join(object_of(i + 2, MESH) for i in range(n))),
}


# ---- COLLADA


def words(values):
    return " ".join(str(value) for value in np.ravel(values).tolist())


def source(points=POINTS, count=None, accessor=""):
    """Coordinates `s` of a geometry, and its vertices `v`."""
    n = np.size(points)
    accessor = accessor or f'source="#f" count="{n // 3}" stride="3"'
    return (
        f'<source id="s"><float_array id="f" count="{count or n}">{words(points)}</float_array>'
        f'<technique_common><accessor {accessor}><param name="X"/><param name="Y"/>'
        '<param name="Z"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>'
    )


def primitive(kind, content, count, more=""):
    return f'<{kind} count="{count}">{INPUT}{more}{content}</{kind}>'


SOURCE = source()
INPUT = '<input semantic="VERTEX" source="#v" offset="0"/>'
INDICES = words(FACES)
TRIANGLES = primitive("triangles", f"<p>{INDICES}</p>", 4)
HERE = '<instance_geometry url="#g"/>'


def dae(
    nodes=f"<node>{HERE}</node>",
    mesh=TRIANGLES,
    before=SOURCE,
    library="",
    more="",
    unit="",
    head="",
):
    return (
        f'{head}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset>{unit}</asset>'
        f'<library_geometries><geometry id="g"><mesh>{before}{mesh}</mesh></geometry>'
        f"</library_geometries>{more}<library_nodes>{library}</library_nodes>"
        f'<library_visual_scenes><visual_scene id="a">{nodes}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#a"/></scene></COLLADA>'
    ).encode()


def shared(n, inside, nodes="", library=""):
    """A node of a library with these contents, and n instances of it."""
    there = '<node><instance_node url="#n"/></node>' * n
    return dae(there + nodes, library=f'<node id="n">{inside}</node>{library}')


MOVE = "<translate>0 0 0</translate>"
EMPTY = f"<node>{HERE}</node>"
INNER = '<instance_node url="#m2"/>'


def node_of(number, *ids):
    return (
        f'<node id="m{number}">' + "".join(f'<instance_node url="#m{i}"/>' for i in ids) + "</node>"
    )


def vertices(number, source="s"):
    return f'<vertices id="v{number}"><input semantic="POSITION" source="#{source}"/></vertices>'


def source_of_all(number, n):
    """Another source of the n points of `source`."""
    return (
        f'<source id="s{number}"><technique_common><accessor source="#f" count="{n}" stride="3">'
        '<param name="X"/><param name="Y"/><param name="Z"/></accessor></technique_common></source>'
    )


def skin(number, url):
    return f'<controller id="c{number}"><skin source="#{url}"/></controller>'


FACE, NO_FACE = primitive("triangles", "<p>0 1 2</p>", 1), primitive("triangles", "<p/>", 0)
INSIDE = {
    "transforms": lambda n: MOVE * n + HERE,
    "unknown elements": lambda n: "<a/>" * n + HERE,
    "unknown names": lambda n: "".join(f"<a{i}/>" for i in range(n)) + HERE,
    "empty nodes": lambda n: "<node/>" * n + HERE,
    "nested nodes": lambda n: "<node>" * (n // 2) + HERE + "</node>" * (n // 2),
}
"""Content of a node that has n instances."""
IN_MESH = {
    "empty primitives": lambda n: TRIANGLES + NO_FACE * n,
    "lines": lambda n: TRIANGLES + "<lines/>" * n,
}
"""Content of a geometry that n nodes show."""
DAE = {
    **{part: lambda n, inside=inside: shared(n, inside(n)) for part, inside in INSIDE.items()},
    **{part: lambda n, mesh=mesh: dae(EMPTY * n, mesh(n)) for part, mesh in IN_MESH.items()},
    "nodes": lambda n: dae(EMPTY * n),
    "nodes of nothing": lambda n: shared(n, INNER * n, EMPTY, node_of(2)),
    "2^n nodes of nothing": lambda n: dae(
        EMPTY + f"<node>{INNER}</node>", library=pairs(n // 2, node_of) + node_of(n // 2 + 2)
    ),
    "geometries of nothing": lambda n: shared(n, HERE.replace("#g", "#h") * n, EMPTY).replace(
        b"</library_g", b'<geometry id="h"><mesh/></geometry></library_g'
    ),
    "primitives": lambda n: dae(mesh=FACE * n),
    "inputs": lambda n: dae(
        mesh=TRIANGLES.replace(INPUT, INPUT + INPUT.replace("VERTEX", "N") * n)
    ),
    "vertices of one source": lambda n: dae(
        mesh="".join(FACE.replace("#v", f"#v{i}") for i in range(n)),
        before=source(np.zeros((n + 4, 3))) + "".join(vertices(i) for i in range(n)),
    ),
    "sources of one array": lambda n: dae(
        mesh="".join(FACE.replace("#v", f"#v{i}") for i in range(n)),
        before=source(np.zeros((n + 4, 3)))
        + "".join(vertices(i, f"s{i}") + source_of_all(i, n + 4) for i in range(n)),
    ),
    "controllers": lambda n: dae(
        '<node><instance_controller url="#c0"/></node>' * n,
        more="<library_controllers>"
        + "".join(skin(i, f"c{i + 1}") for i in range(n // 2))
        + skin(n // 2, "g")
        + "</library_controllers>",
    ),
    "strips": lambda n: dae(mesh=primitive("tristrips", "<p>0 1 2 3</p>" * n, n)),
    "polygons": lambda n: dae(mesh=primitive("polygons", "<p>0 1 2</p>" * n, n)),
    "a long name": lambda n: shared(n, HERE).replace(
        b'id="n"', b'id="n" name="%s"' % (b"n" * 100 * n)
    ),
}


# ---- JSON


def repeated(content, place, n, item=None):
    """Put n copies of an item into the list or the object at a place, by default of its first."""
    for key in filter(None, place.split("/")):
        new = {} if key == "extensions" else []
        content = content[int(key)] if key.isdecimal() else content.setdefault(key, new)
    if isinstance(content, list):
        content += [content[0] if item is None else item] * n
    else:
        content |= {f"_{i}": 0 if item is None else item for i in range(n)}


PRIMITIVE = {"attributes": {"POSITION": 0}}
PRIMITIVES, TARGETS = "meshes/0/primitives", "meshes/0/primitives/0/targets"
OF_SCENE = {
    "primitives": [(PRIMITIVES, {**PRIMITIVE, "indices": 1})],
    "unused meshes": [("meshes", None)],
}
"""Parts of a scene that are repeated."""
OF_MESH = {
    "nodes": [],
    "weights of the mesh": [(TARGETS, {"POSITION": 0}), ("meshes/0/weights", 0.0)],
    "points": [(PRIMITIVES, {**PRIMITIVE, "mode": 0})],
    "extensions of a mesh": [("meshes/0/extensions", {})],
    "unknown names of a mesh": [("meshes/0", 0)],
    "animations": [("animations", {})],
    "unused accessors": [("accessors", None)],
    "views": [("bufferViews", None)],
    "attributes": [("meshes/0/primitives/0/attributes", 0)],
}
"""The same, with n nodes of the mesh."""


def own_weights(file, n):
    """n nodes with weights of their own, and n primitives without triangles."""
    file.primitive["targets"] = [{"POSITION": 0}]
    repeated(file.header, PRIMITIVES, n, {**PRIMITIVE, "mode": 0})
    file.nodes(*[{"mesh": 0, "weights": [i / n]} for i in range(n)])


def chain_of_nodes(file, n):
    file.header["nodes"] = [{"children": [i + 1]} for i in range(n)] + [{"mesh": 0}]


def instances_of_nothing(file, n):
    move = file.accessor(np.zeros((n, 3)))
    file.header["meshes"].append({"primitives": [{**PRIMITIVE, "mode": 0}]})
    own = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": move}}}
    file.nodes({"mesh": 0}, *[{"mesh": 1, "extensions": own} for _ in range(n)])


def one_large_position(file, n):
    """n primitives of one triangle each that share n points."""
    large = {"POSITION": file.accessor(np.zeros((n, 3)))}
    few = file.accessor(np.array([0, 1, 2]), "<u2")
    repeated(file.header, PRIMITIVES, n, {"attributes": large, "indices": few})


def a_long_name(file, n):
    file.header["meshes"][0]["name"] = "n" * 100 * n
    file.nodes(*[{"mesh": 0}] * n)


SCENES = (own_weights, chain_of_nodes, instances_of_nothing, one_large_position, a_long_name)


def glb(n, part):
    """Scene whose part, a function or one of the tables above, is repeated n times."""
    file = Glb()
    if callable(part):
        part(file, n)
        return file.data()
    for place, item in (OF_SCENE | OF_MESH)[part]:
        repeated(file.header, place, n, item)
    if part in OF_MESH:
        file.nodes(*[{"mesh": 0}] * n)
    return file.data()


GLB = {part: partial(glb, part=part) for part in (*OF_SCENE, *OF_MESH)}
GLB |= {part.__name__: partial(glb, part=part) for part in SCENES}

# ---- text


def ply_with(head, n, order=""):
    data = ply(POINTS, FACES, order)
    start, _, rest = data.partition(b"element vertex")
    return start + "".join(head(i) for i in range(n)).encode() + b"element vertex" + rest


def ply_properties(n, order=""):
    rows = b"".join(b"property list uchar int p%d\n" % i for i in range(n))
    data = ply(POINTS, [*FACES] * n, order).replace(b"end_header", rows + b"end_header")
    return data + bytes(n) if order else data.rstrip() + b" 0" * n + b"\n"


SHAPE = obj(POINTS, FACES)
TEXT = {
    "a.obj": {
        "groups": lambda n: SHAPE + b"".join(b"g a%d\nf 1 2 3\n" % i for i in range(n)),
        "objects of one name": lambda n: SHAPE + b"o a\nf 1 2 3\n" * n,
        "comments": lambda n: SHAPE + b"# comment\n" * n,
        "words of a group": lambda n: SHAPE + b"g" + b" a" * n + b"\n" + b"f 1 2 3\n" * n,
        "corners": lambda n: SHAPE + b"f" + b" 1 2 3" * n + b"\n",
        "continued lines": lambda n: SHAPE + b"f \\\n 1 2 3\n" * n,
        "vertices": lambda n: b"v 0 0 0\n" * n + SHAPE,
    },
    "a.ply": {
        "comments": lambda n: ply_with(lambda i: "comment a\n", n),
        "elements": lambda n: ply_with(lambda i: f"element e{i} 0\nproperty int a\n", n),
        "binary elements": lambda n: ply_with(
            lambda i: f"element e{i} 0\nproperty int a\n", n, "<"
        ),
        "properties": lambda n: ply_properties(n),
        "binary properties": lambda n: ply_properties(n, "<"),
    },
    "a.off": {
        "comments": lambda n: off(POINTS, FACES) + b"\n" + b"# comment\n" * n,
        "faces": lambda n: off(POINTS, [*FACES] * n),
    },
    "a.stl": {
        "solids": lambda n: ascii_stl(POINTS, FACES) * n,
        "solids of nothing": lambda n: b"solid a\nendsolid a\n" * n + ascii_stl(POINTS, FACES),
    },
}

MESHES = {
    **{("a.3mf", part): make for part, make in THREEMF.items()},
    **{("a.dae", part): make for part, make in DAE.items()},
    **{("a.glb", part): make for part, make in GLB.items()},
    **{(name, part): make for name, parts in TEXT.items() for part, make in parts.items()},
}
"""Makers of mesh files by the name of the file and of the part that is repeated."""


def exploding(k):
    """Mesh files of k lines or so that ask for 2^k instances of a shape, by their names."""
    return {
        "a.3mf": threemf(pairs(k, holding) + object_of(k + 2, "<metadata/>" * 100 + MESH), SECOND),
        "a.dae": dae(
            f"<node>{INNER}</node>",
            library=f'{pairs(k, node_of)}<node id="m{k + 2}">{MOVE * 100}{HERE}</node>',
        ),
    }


# ---- cameras


def frames(n, **more):
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    return {"w": 640, "h": 480, "fl_x": 500, "frames": [frame] * n, **more}


def as_json(content):
    return json.dumps(content).encode()


CAMERA = {"width": 640, "height": 480, "fx": 500, "fy": 500}
KALIBR = (
    "cam{}:\n  camera_model: pinhole\n  intrinsics: [4, 4, 3, 2]\n  distortion_model: none\n"
    "  distortion_coeffs: []\n  resolution: [7, 4]\n"
)
PLACE = "  T_cn_cnm1: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
OPENCV = "image_width: 640\nimage_height: 480\n"
MATRIX = "{}: !!opencv-matrix\n  rows: {}\n  cols: {}\n  dt: d\n  data: [{}]\n"


def matrices(n):
    return OPENCV + "".join(
        MATRIX.format(f"K{i}", 3, 3, "5, 0, 3, 0, 5, 2, 0, 0, 1")
        + MATRIX.format(f"D{i}", 5, 1, "0, 0, 0, 0, 0")
        for i in range(n)
    )


def opensfm(n_cameras, n_shots):
    camera = {"projection_type": "brown", "width": 640, "height": 480, "focal_x": 1, "focal_y": 1}
    shots = {
        f"s{i}": {"rotation": [0, 0, 0], "translation": [0, 0, i], "camera": f"c{i % n_cameras}"}
        for i in range(n_shots)
    }
    place = {"rotation": [0, 0, 0], "translation": [0, 0, 0]}
    return {
        "cameras": {f"c{i}": camera for i in range(n_cameras)},
        "shots": shots,
        "rig_instances": {"a": {"rig_camera_ids": {f"s{i}": f"c{i}" for i in range(n_shots)}}},
        "rig_cameras": {f"c{i}": place for i in range(n_cameras)},
    }


def metashape(n_sensors, n_cameras, terms=""):
    sensor = (
        '<sensor id="{0}" label="s{0}" type="frame"><resolution width="640" height="480"/>'
        f'<calibration class="adjusted"><f>500</f>{terms}</calibration></sensor>'
    )
    camera = (
        '<camera id="{0}" sensor_id="0" label="a{0}">'
        "<transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera>"
    )
    return (
        "<document><chunk><sensors>"
        + "".join(sensor.format(i) for i in range(n_sensors))
        + "</sensors><cameras>"
        + "".join(camera.format(i) for i in range(n_cameras))
        + "</cameras></chunk></document>"
    ).encode()


def unplaced_rigs(n):
    """Text of `rigs.txt`, whose cameras have no place."""
    return "".join(f"{i} 2 CAMERA {2 * i} CAMERA {2 * i + 1} 0\n" for i in range(n))


def scene(n, name="a"):
    lens = {"type": "perspective", "perspective": {"yfov": 1.0}}
    nodes = [{"name": name, "children": [*range(1, n + 1)]}, *({"camera": 0} for _ in range(n))]
    return {"asset": {"version": "2.0"}, "cameras": [lens] * n, "nodes": nodes}


CAMERAS = {
    ("transforms.json", "frames"): lambda n: as_json(frames(n)),
    ("transforms.json", "names"): lambda n: as_json(frames(n, **{f"a{i}": 0 for i in range(n)})),
    ("k.yaml", "cameras"): lambda n: "".join(
        KALIBR.format(i) + PLACE * (i > 0) for i in range(n)
    ).encode(),
    ("k.yaml", "anchors and aliases"): lambda n: (
        "".join(f"a{i}: &a{i} [{f'*a{i - 1}' if i % 9 else 1}, 2]\n" for i in range(n))
        + KALIBR.format(0)
    ).encode(),
    ("cv.yaml", "matrices"): lambda n: matrices(n).encode(),
    ("cv.yaml", "names"): lambda n: (
        matrices(n) + "".join(f"a{i}: 0\n" for i in range(n))
    ).encode(),
    ("o.json", "cameras and shots"): lambda n: as_json(opensfm(n, n)),
    ("m.xml", "sensors"): lambda n: metashape(n, n),
    ("m.xml", "terms"): lambda n: metashape(1, n, "<k9>0</k9>" * n),
    ("own.json", "cameras and poses"): lambda n: as_json(
        {
            "cameras": [{"name": f"c{i}", **CAMERA} for i in range(n)],
            "world_from_camera": [np.eye(4).tolist()] * n,
            "camera": [f"c{i}" for i in range(n)],
        }
    ),
    ("cameras.txt", "cameras"): lambda n: "".join(
        f"{i} PINHOLE 640 480 500 500 320 240\n" for i in range(n)
    ).encode(),
    ("scene.gltf", "cameras"): lambda n: as_json(scene(n)),
    ("scene.gltf", "a long name"): lambda n: as_json(scene(n, "n" * 100 * n)),
    ("b.out", "cameras"): lambda n: (
        f"# Bundle file v0.3\n{n} 0\n" + "500 0 0\n1 0 0\n0 1 0\n0 0 1\n1 2 3\n" * n
    ).encode(),
}
"""Makers of camera files by the name of the file and of the part that is repeated."""
