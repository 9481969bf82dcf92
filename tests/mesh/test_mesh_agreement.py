"""One scene in every format: the same faces, places and groups, whatever file it comes from."""

import json

import numpy as np
import pytest
from mesh_files import Glb, triangles
from test_mesh_dae import METRE, dae, primitive, source, words
from test_mesh_threemf import archive, model

from rastercov.mesh import shapes

ROOM = shapes.room(2)
"""Its groups share no vertices, so each is a mesh of its own."""
SHIFT = np.array([3.0, -1.0, 0.5])
"""Translation of each node; its mesh is stored without it."""


def parts():
    """Name, points and faces of each group."""
    for label, group in enumerate(ROOM.groups):
        used, faces = np.unique(ROOM.faces[ROOM.face_group == label], return_inverse=True)
        yield group.name, ROOM.vertices[used], faces.reshape(-1, 3)


def obj() -> bytes:
    lines, first = [], 1
    for name, points, faces in parts():
        lines += [f"o {name}", *(f"v {words(point)}" for point in points + SHIFT)]
        lines += [f"f {words(face + first)}" for face in faces]
        first += len(points)
    return "\n".join([*lines, ""]).encode()


def solids() -> bytes:
    lines = []
    for name, points, faces in parts():
        lines.append(f"solid {name}")
        for corners in (points + SHIFT)[faces]:
            lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {words(c)}" for c in corners)]
            lines += ["endloop", "endfacet"]
        lines.append(f"endsolid {name}")
    return "\n".join([*lines, ""]).encode()


def glb() -> Glb:
    scene = Glb()
    scene.header["meshes"].clear()
    for _, points, faces in parts():
        scene.mesh(points, faces)
    scene.nodes(
        *(
            {"mesh": i, "name": name, "translation": SHIFT.tolist()}
            for i, (name, _, _) in enumerate(parts())
        )
    )
    return scene


def gltf(folder) -> bytes:
    scene = glb()
    (folder / "scene.bin").write_bytes(scene.binary)
    scene.header["buffers"][0]["uri"] = "scene.bin"
    return json.dumps({"asset": {"version": "2.0"}, **scene.header}).encode()


def threemf() -> bytes:
    objects, items = "", ""
    for number, (name, points, faces) in enumerate(parts(), 1):
        vertices = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in points.tolist())
        rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
        mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{rows}</triangles></mesh>"
        objects += f'<object id="{number}" name="{name}">{mesh}</object>'
        items += f'<item objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {words(SHIFT)}"/>'
    return archive(model(objects, items))


def collada() -> bytes:
    geometries, nodes = "", ""
    for number, (name, points, faces) in enumerate(parts()):
        content = f"<p>{words(faces)}</p>"
        text = source(points) + primitive(content=content, count=len(faces))
        for key in "sav":
            text = text.replace(f'"{key}"', f'"{key}{number}"').replace(
                f"#{key}", f"#{key}{number}"
            )
        geometries += f'<geometry id="g{number}"><mesh>{text}</mesh></geometry>'
        place = f"<translate>{words(SHIFT)}</translate>"
        nodes += f'<node name="{name}">{place}<instance_geometry url="#g{number}"/></node>'
    return dae(geometries, nodes, METRE)


@pytest.mark.parametrize("name", ["a.obj", "a.stl", "a.glb", "a.gltf", "a.3mf", "a.dae"])
def test_every_format_gives_the_same_scene(name, load, tmp_path):
    write = {
        "a.obj": obj, "a.stl": solids, "a.glb": lambda: glb().data(),
        "a.gltf": lambda: gltf(tmp_path), "a.3mf": threemf, "a.dae": collada,
    }  # fmt: skip
    mesh = load(name, write[name]())
    order = np.argsort(ROOM.face_group, kind="stable")
    assert [group.name for group in mesh.groups] == [group.name for group in ROOM.groups]
    np.testing.assert_array_equal(mesh.face_group, ROOM.face_group[order])
    wanted = triangles(ROOM)[order] + SHIFT
    np.testing.assert_allclose(triangles(mesh), wanted, atol=2e-6)  # GLB has float32
    if name != "a.stl":
        assert mesh.n_vertices == sum(len(points) for _, points, _ in parts())


def test_the_readable_formats_are_listed(load):
    with pytest.raises(ValueError, match=r"supported formats are \.3mf, \.dae, .*got '\.fbx'"):
        load("a.fbx", b"")
