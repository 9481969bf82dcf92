"""Mesh and camera files in which one part is repeated n times, with n instances of its owner.

Each maker gives a file whose size grows with n and whose faces, poses and cameras do not grow
faster, so that neither time nor memory of reading it may.
"""

import io
import json
import struct
import zipfile

import numpy as np
from mesh_files import FACES, POINTS, Glb, obj, off, ply

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


def threemf_levels(k, below, inside=MESH):
    """2^k instances of object 1, which holds `below` beside its mesh."""
    levels = [object_of(i + 2, components(i + 1, i + 1)) for i in range(k)]
    return threemf("".join(levels), f'<item objectid="{k + 1}"/>', below + inside)


ITEM = '<item objectid="1"/>'
THREEMF = {
    "unknown elements": lambda n: threemf(inside="<a/>" * n + MESH, build=ITEM * n),
    "attributes": lambda n: threemf(
        build=ITEM * n, inside=MESH.replace("<mesh", f"<mesh {attributes(n)}")
    ),
    "build items": lambda n: threemf(build=ITEM * n),
    "items of nothing": lambda n: threemf(
        object_of(2, components(*[3] * n)) + object_of(3, ""), ITEM + '<item objectid="2"/>' * n
    ),
    "components": lambda n: threemf(object_of(2, components(*[1] * n)), '<item objectid="2"/>'),
    "2^n components of nothing": lambda n: threemf(
        "".join(object_of(i, components(i + 1, i + 1)) for i in range(2, n)) + object_of(n, ""),
        ITEM + '<item objectid="2"/>',
    ),
    "a chain, and items of it": lambda n: threemf(
        "".join(object_of(i, components(i - 1)) for i in range(2, n // 2)),
        f'<item objectid="{n // 2 - 1}"/>' * n,
    ),
    "a long name": lambda n: threemf(
        f'<object id="2" name="{"n" * 100 * n}">{MESH}</object>', '<item objectid="2"/>' * n
    ),
    "unused objects": lambda n: threemf("".join(object_of(i + 2, MESH) for i in range(n))),
}  # fmt: skip


def attributes(n):
    return " ".join(f'a{i}="0"' for i in range(n))


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


def shared(n, inside, nodes=""):
    """A node of a library with these contents, and n instances of it."""
    there = '<node><instance_node url="#n"/></node>' * n
    return dae(there + nodes, library=f'<node id="n">{inside}</node>')


MOVE = "<translate>0 0 0</translate>"
EMPTY = f"<node>{HERE}</node>"
DAE = {
    "nodes": lambda n: dae(f"<node>{HERE}</node>" * n),
    "transforms": lambda n: shared(n, MOVE * n + HERE),
    "unknown elements": lambda n: shared(n, "<a/>" * n + HERE),
    "unknown names": lambda n: shared(n, "".join(f"<a{i}/>" for i in range(n)) + HERE),
    "empty nodes": lambda n: shared(n, "<node/>" * n, EMPTY),
    "nodes of nothing": lambda n: shared(n, '<instance_node url="#m"/>' * n, EMPTY).replace(
        b"<library_nodes>", b'<library_nodes><node id="m"/>'
    ),
    "2^n nodes of nothing": lambda n: dae(
        EMPTY + '<node><instance_node url="#m0"/></node>',
        library="".join(
            f'<node id="m{i}">' + f'<instance_node url="#m{i + 1}"/>' * 2 + "</node>"
            for i in range(n // 2)
        )
        + f'<node id="m{n // 2}"/>',
    ),
    "geometries of nothing": lambda n: shared(n, HERE.replace("g\"", "h\"") * n, EMPTY).replace(
        b"</library_g", b'<geometry id="h"><mesh/></geometry></library_g'
    ),
    "nested nodes": lambda n: shared(n, "<node>" * (n // 2) + HERE + "</node>" * (n // 2)),
    "primitives": lambda n: dae(mesh=f'<triangles count="1">{INPUT}<p>0 1 2</p></triangles>' * n),
    "empty primitives": lambda n: dae(
        f"<node>{HERE}</node>" * n,
        TRIANGLES + f'<triangles count="0">{INPUT}<p/></triangles>' * n,
    ),
    "lines": lambda n: dae(f"<node>{HERE}</node>" * n, TRIANGLES + "<lines/>" * n),
    "inputs": lambda n: dae(
        mesh=f'<triangles count="4">{INPUT}{INPUT.replace("VERTEX", "N") * n}<p>{INDICES}</p>'
        "</triangles>"
    ),
    "vertices of one source": lambda n: dae(
        mesh="".join(
            f'<triangles count="1">{INPUT.replace("#v", f"#v{i}")}<p>0 1 2</p></triangles>'
            for i in range(n)
        ),
        before=SOURCE.replace("</float_array>", " 0 0 0" * n + "</float_array>").replace(
            'count="12"', f'count="{12 + 3 * n}"'
        )
        + "".join(
            f'<vertices id="v{i}"><input semantic="POSITION" source="#s"/></vertices>'
            for i in range(n)
        ),
    ),
    "controllers": lambda n: dae(
        '<node><instance_controller url="#c0"/></node>' * n,
        more="<library_controllers>"
        + "".join(
            f'<controller id="c{i}"><skin source="#{f"c{i + 1}" if i + 1 < n // 2 else "g"}"/>'
            "</controller>"
            for i in range(n // 2)
        )
        + "</library_controllers>",
    ),
    "strips": lambda n: dae(
        mesh=f'<tristrips count="{n}">{INPUT}{"<p>0 1 2 3</p>" * n}</tristrips>'
    ),
    "polygons": lambda n: dae(mesh=f'<polygons count="{n}">{INPUT}{"<p>0 1 2</p>" * n}</polygons>'),
    "a long name": lambda n: shared(n, HERE).replace(
        b'id="n"', b'id="n" name="%s"' % (b"n" * 100 * n)
    ),
}  # fmt: skip


# ---- glTF


def glb(n_nodes=1, change=lambda glb: None):
    file = Glb()
    file.nodes(*[{"mesh": 0} for _ in range(n_nodes)])
    change(file)
    return file.data()


def with_primitives(n, **more):
    def change(file):
        extra = [{"attributes": {"POSITION": 0}, **more}] * n
        file.header["meshes"][0]["primitives"] += extra

    return change


def with_weights(n, weight=0.0):
    def change(file):
        file.primitive["targets"] = [{"POSITION": 0}] * n
        file.header["meshes"][0]["weights"] = [weight] * n

    return change


def own_weights(n):
    """n nodes with weights of their own, and n primitives without triangles."""

    def change(file):
        file.primitive["targets"] = [{"POSITION": 0}]
        with_primitives(n, mode=0)(file)
        for i, node in enumerate(file.header["nodes"]):
            node["weights"] = [i / n]

    return change


def with_header(key, items):
    return lambda file: file.header.__setitem__(key, items)


def put(**more):
    return lambda file: file.header["meshes"][0].update(more)


def chain_of_nodes(n):
    def change(file):
        file.header["nodes"] = [{"children": [i + 1]} for i in range(n)] + [{"mesh": 0}]
        file.header["scenes"] = [{"nodes": [0]}]

    return change


def instances_of_nothing(n):
    def change(file):
        move = file.accessor(np.zeros((n, 3)))
        file.header["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]})
        own = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": move}}}
        file.header["nodes"] += [{"mesh": 1, "extensions": own} for _ in range(n)]
        file.header["scenes"] = [{"nodes": list(range(n + 1))}]

    return change


def one_large_position(n):
    """n primitives of one triangle each that share n points."""

    def change(file):
        large = file.accessor(np.zeros((n, 3)))
        few = file.accessor(np.array([0, 1, 2]), "<u2")
        file.header["meshes"][0]["primitives"] += [
            {"attributes": {"POSITION": large}, "indices": few}
        ] * n

    return change


GLB = {
    "nodes": lambda n: glb(n),
    "primitives": lambda n: glb(1, with_primitives(n, indices=1)),
    "weights of the mesh": lambda n: glb(n, with_weights(n)),
    "own weights": lambda n: glb(n, own_weights(n)),
    "points": lambda n: glb(n, with_primitives(n, mode=0)),
    "extensions of a mesh": lambda n: glb(n, put(extensions={f"A{i}": {} for i in range(n)})),
    "unknown names of a mesh": lambda n: glb(n, put(**{f"name{i}": 0 for i in range(n)})),
    "a long name": lambda n: glb(n, put(name="n" * 100 * n)),
    "animations": lambda n: glb(n, with_header("animations", [{}] * n)),
    "unused accessors": lambda n: glb(
        n, lambda f: f.header["accessors"].extend([f.header["accessors"][0]] * n)
    ),
    "views": lambda n: glb(
        n, lambda f: f.header["bufferViews"].extend([f.header["bufferViews"][0]] * n)
    ),
    "a chain of nodes": lambda n: glb(1, chain_of_nodes(n)),
    "instances of nothing": lambda n: glb(1, instances_of_nothing(n)),
    "one large position": lambda n: glb(1, one_large_position(n)),
    "unused meshes": lambda n: glb(
        1, lambda f: f.header["meshes"].extend([f.header["meshes"][0]] * n)
    ),
    "attributes": lambda n: glb(
        n, lambda f: f.primitive["attributes"].update({f"_{i}": 0 for i in range(n)})
    ),
}

# ---- text


def ply_with(head, n, order=""):
    data = ply(POINTS, FACES, order)
    start, _, rest = data.partition(b"element vertex")
    return start + "".join(head(i) for i in range(n)).encode() + b"element vertex" + rest


def ply_properties(n, order=""):
    rows = "".join(f"property list uchar int p{i}\n" for i in range(n))
    head = (
        f"ply\nformat {'binary_little_endian' if order else 'ascii'} 1.0\nelement vertex 3\n"
        f"property float x\nproperty float y\nproperty float z\nelement face {n}\n"
        f"property list uchar int vertex_indices\nend_header\n"
    ).replace("element face", f"element other 2\n{rows}element face")
    if order:
        body = struct.pack("<9f", *range(9)) + bytes(2 * n)
        return head.encode() + body + struct.pack("<B3i", 3, 0, 1, 2) * n
    return (
        head + "0 0 0\n1 0 0\n0 1 0\n" + "0 " * n + "\n" + "0 " * n + "\n" + "3 0 1 2\n" * n
    ).encode()


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
        "solids": lambda n: b"".join(
            b"solid a%d\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n"
            b"vertex 0 1 %d\nendloop\nendfacet\nendsolid\n" % (i, i)
            for i in range(n)
        ),
        "solids of nothing": lambda n: (
            b"solid a\nendsolid a\n"
            * n
            + b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
            b"endloop\nendfacet\nendsolid\n"
        ),
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
    library = "".join(
        f'<node id="m{i}">' + f'<instance_node url="#m{i + 1}"/>' * 2 + "</node>" for i in range(k)
    )
    return {
        "a.3mf": threemf_levels(k, "<metadata/>" * 100),
        "a.dae": dae(
            '<node><instance_node url="#m0"/></node>',
            library=f'{library}<node id="m{k}">{MOVE * 100}{HERE}</node>',
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
