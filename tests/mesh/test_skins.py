"""Skins of glTF and COLLADA beside their definition, one vertex at a time."""

import re

import numpy as np
import pytest
from mesh_files import FACES, POINTS, Glb, triangles
from repeated_parts import dae, source, words

from rastercov.base.errors import MeshError, ResourceError
from rastercov.core.mesh.arrays import rotations_of_quaternions
from rastercov.formats.meshes import dae as dae_reader

SCALES = {"<u1": 255, "<u2": 65535}


def local(node):
    """parent_from_node of a node with translation, rotation and scale."""
    matrix = np.eye(4)
    turn = rotations_of_quaternions(np.array([node.get("rotation", (0, 0, 0, 1.0))]))[0]
    matrix[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)))
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def world(nodes, index):
    above = [row for row, node in enumerate(nodes) if index in node.get("children", [])]
    return (world(nodes, above[0]) if above else np.eye(4)) @ local(nodes[index])


def any_node(rng, **more):
    turn = rng.normal(size=4)
    return {
        "translation": rng.normal(size=3).tolist(),
        "rotation": (turn / np.linalg.norm(turn)).tolist(),
        "scale": rng.uniform(0.4, 2, 3).tolist(),
        **more,
    }


def weights_of(rng, n, n_sets, dtype):
    """(n, 4 n_sets) weights of sum 1, some 0, as whole shares where the type is of integers."""
    weights = rng.uniform(size=(n, 4 * n_sets)) * (rng.uniform(size=(n, 4 * n_sets)) < 0.6)
    weights[weights.sum(axis=1) == 0, 0] = 1
    weights /= weights.sum(axis=1, keepdims=True)
    if dtype == "<f4":
        return weights.astype("f4"), weights.astype("f4")
    whole = np.floor(weights * SCALES[dtype])
    whole[np.arange(n), whole.argmax(axis=1)] += SCALES[dtype] - whole.sum(axis=1)
    return whole, whole / SCALES[dtype]


def scene(seed):
    """A skinned scene, and where its vertices are by the definition."""
    rng = np.random.default_rng(seed)
    n_sets, n_joints = int(rng.integers(1, 3)), int(rng.integers(1, 6))
    weight_type, joint_type = ("<f4", "<u1", "<u2")[seed % 3], ("<u1", "<u2")[seed % 2]
    glb = Glb()
    nodes = [any_node(rng, mesh=0, skin=0), *(any_node(rng) for _ in range(n_joints))]
    for row in range(2, n_joints + 1):  # below an earlier joint, or beside the mesh
        if (above := int(rng.integers(0, row))) > 0:
            nodes[above].setdefault("children", []).append(row)
    if seed % 4 == 0:  # the mesh below a joint
        nodes[1].setdefault("children", []).append(0)
    below = {child for node in nodes for child in node.get("children", [])}
    roots = [row for row in range(len(nodes)) if row not in below]
    glb.header["nodes"], glb.header["scenes"] = nodes, [{"nodes": roots}]
    order = rng.permutation(np.arange(1, n_joints + 1)).tolist()
    skin = {"joints": order}
    bind = np.repeat(np.eye(4)[None], n_joints, axis=0)
    if seed % 5:
        bind = np.array([np.linalg.inv(local(any_node(rng))) for _ in order]).astype("f4")
        columns = bind.transpose(0, 2, 1).reshape(-1, 16)
        skin["inverseBindMatrices"] = glb.accessor(columns, type="MAT4")
    glb.header["skins"] = [skin]
    weights, shares = weights_of(rng, len(POINTS), n_sets, weight_type)
    joints = rng.integers(0, n_joints, weights.shape)
    is_normalised = {} if weight_type == "<f4" else {"normalized": True}
    for row in range(n_sets):
        own = np.s_[:, 4 * row : 4 * row + 4]
        glb.primitive["attributes"] |= {
            f"JOINTS_{row}": glb.accessor(joints[own], joint_type),
            f"WEIGHTS_{row}": glb.accessor(weights[own], weight_type, **is_normalised),
        }
    matrices = [world(nodes, node) @ own for node, own in zip(order, bind, strict=True)]
    moved = [
        sum(w * (matrices[j] @ [*point, 1])[:3] for w, j in zip(*of, strict=True))
        for point, *of in zip(POINTS, shares, joints, strict=True)
    ]
    return glb, np.array(moved)


@pytest.mark.parametrize("seed", range(40))
def test_joints_place_a_skinned_mesh_and_its_node_does_not(seed, load):
    glb, expected = scene(seed)
    for name, data in (("a.glb", glb.data()), ("a.gltf", glb.json())):
        mesh = load(name, data)
        np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)
        assert mesh.notes == ()
    glb.header["nodes"][0].update(translation=[7, 0, 0], scale=[5, 5, 5])
    glb.header["nodes"][0].pop("children", None)
    np.testing.assert_array_equal(triangles(load("b.glb", glb.data())), triangles(mesh))


def test_replaced_weights_and_morphed_points_are_skinned(load):
    glb, _ = scene(3)  # weights of floats
    plain = glb.data()
    attributes = glb.primitive["attributes"]
    rows = np.arange(2)
    weights = glb.header["accessors"][attributes["WEIGHTS_0"]]
    whole = np.frombuffer(glb.binary, "<f4", 16, glb.header["bufferViews"][weights["bufferView"]]
                          ["byteOffset"]).reshape(4, 4)  # fmt: skip
    sparse = {
        "count": 2,
        "indices": {"bufferView": glb.view(rows.astype("<u2")), "componentType": 5123},
        "values": {"bufferView": glb.view(whole[rows])},
    }
    empty = np.array([[0, 0, 0, 0], [0, 0, 0, 0], *whole[2:]])
    glb.header["accessors"][attributes["WEIGHTS_0"]] |= {
        "bufferView": glb.view(empty.astype("<f4")), "sparse": sparse
    }  # fmt: skip
    np.testing.assert_array_equal(load("a.glb", glb.data()).vertices, load("b.glb", plain).vertices)
    shift = np.tile([1.0, 2, 3], (4, 1))
    glb.primitive["targets"] = [{"POSITION": glb.accessor(shift)}]
    glb.header["meshes"][0]["weights"] = [0.5]
    morphed = load("c.glb", glb.data())
    glb.primitive["attributes"]["POSITION"] = glb.accessor(POINTS + 0.5 * shift)
    glb.header["meshes"][0]["weights"] = [0.0]
    np.testing.assert_allclose(morphed.vertices, load("d.glb", glb.data()).vertices, atol=1e-6)


def one_joint(**joint):
    glb = Glb()
    glb.header["nodes"] = [{"mesh": 0, "skin": 0, "name": "part"}, joint]
    glb.header["scenes"] = [{"nodes": [0, 1]}]
    glb.header["skins"] = [{"joints": [1]}]
    glb.primitive["attributes"] |= {
        "JOINTS_0": glb.accessor(np.zeros((4, 4)), "<u1"),
        "WEIGHTS_0": glb.accessor(np.tile([1.0, 0, 0, 0], (4, 1))),
    }
    return glb


def test_a_joint_that_mirrors_leaves_faces_outwards(load):
    assert load("a.glb", one_joint(scale=[-1, 1, 1]).data()).is_closed_outward
    glb = one_joint()
    glb.node["scale"] = [-1, 1, 1]  # has no effect
    assert load("a.glb", glb.data()).is_closed_outward


def test_weights_are_divided_by_their_sums_and_a_note_says_so(load):
    glb = one_joint(translation=[0, 0, 4])
    glb.primitive["attributes"]["WEIGHTS_0"] = glb.accessor(np.tile([0.25, 0.25, 0, 0], (4, 1)))
    mesh = load("a.glb", glb.data())
    np.testing.assert_allclose(triangles(mesh), POINTS[FACES] + [0, 0, 4])
    assert "divided the weights of skin 0 by their sums, 0.5 to 0.5" in mesh.notes[-1]


def test_a_primitive_without_joints_is_placed_by_the_node_and_joints_may_be_out_of_sight(load):
    glb = one_joint(translation=[0, 0, 4])
    glb.node["translation"] = [9, 0, 0]
    glb.header["scenes"] = [{"nodes": [0]}]
    own = {"attributes": {"POSITION": 0}, "indices": 1}
    glb.header["meshes"][0]["primitives"].append(own)
    mesh = load("a.glb", glb.data())
    np.testing.assert_array_equal(triangles(mesh)[:4], POINTS[FACES] + [0, 0, 4])
    np.testing.assert_array_equal(triangles(mesh)[4:], POINTS[FACES] + [9, 0, 0])
    assert "placed 1 primitive without joints by skinned nodes" in mesh.notes[0]


REFUSED = [
    (lambda g: g.primitive["attributes"].pop("WEIGHTS_0"), "WEIGHTS_0"),
    (lambda g: g.header["skins"][0].update(joints=[]), "skin 0: expected joints, got none"),
    (lambda g: g.header["skins"][0].update(joints=[7]), "index below 2"),
    (lambda g: g.header["skins"][0].update(inverseBindMatrces=3), "inverseBindMatrices"),
    (lambda g: g.put(("accessors", 3, "componentType"), 5125), "accessor 3 to be VEC4"),
    (lambda g: g.primitive["attributes"].update(JOINTS_0=g.accessor(np.ones((4, 4)), "<u1")),
     r"skin 0: expected joints in 0 \.\.\. 0, got 0 \.\.\. 1"),
    (lambda g: g.primitive["attributes"].update(JOINTS_0=g.accessor(np.zeros((4, 4)))), "whole"),
    (lambda g: g.primitive["attributes"].update(WEIGHTS_0=g.accessor(np.zeros((4, 4)))),
     "skin 0: expected a weight above 0 of each vertex, got none of vertex 0"),
    *((lambda g, w=w: g.primitive["attributes"].update(WEIGHTS_0=g.accessor(np.full((4, 4), w))),
       "expected finite weights of 0 or more") for w in (-1.0, np.nan, np.inf)),
    (lambda g: g.primitive["attributes"].update(WEIGHTS_0=g.accessor(np.ones((3, 4)))), "whole jo"),
    (lambda g: g.header["skins"][0].update(
        inverseBindMatrices=g.accessor(np.ones((1, 16)), type="MAT4")), "last row is 0 0 0 1"),
    (lambda g: g.header["skins"][0].update(joints=[1, 0],
        inverseBindMatrices=g.accessor(np.eye(4).reshape(1, 16), type="MAT4")), "each of 2 joints"),
    (lambda g: g.node.update(extensions={"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": g.accessor(np.eye(3))}}}), "expected a skin or instances, got both"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "text"), REFUSED)
def test_a_broken_skin_is_refused(change, text, load):
    glb = one_joint()
    change(glb)
    with pytest.raises(MeshError, match=text):
        load("a.glb", glb.data())


# ---- COLLADA

CONTROLLER = """<library_controllers>{morph}<controller id="c" name="arm"><skin source="#{of}">
<bind_shape_matrix>{shape}</bind_shape_matrix>
<source id="names"><{array} id="na" count="{n}">{names}</{array}><technique_common>
<accessor source="#na" count="{n}" stride="1"><param name="JOINT" type="name"/></accessor>
</technique_common></source>
<source id="binds"><float_array id="ba" count="{n16}">{binds}</float_array><technique_common>
<accessor source="#ba" count="{n}" stride="16"><param name="TRANSFORM" type="float4x4"/></accessor>
</technique_common></source>
<source id="shares"><float_array id="sa" count="{n_shares}">{shares}</float_array><technique_common>
<accessor source="#sa" count="{n_shares}" stride="1"><param name="WEIGHT" type="float"/></accessor>
</technique_common></source>
<joints><input semantic="JOINT" source="#names"/>
<input semantic="INV_BIND_MATRIX" source="#binds"/></joints>
<vertex_weights count="4"><input semantic="WEIGHT" source="#shares" offset="{at_weight}"/>
<input semantic="JOINT" source="#names" offset="{at_joint}"/>
<vcount>{vcount}</vcount><v>{v}</v></vertex_weights></skin></controller></library_controllers>"""
MORPH = """<controller id="m"><morph source="#g" {method}>
<source id="ts"><IDREF_array id="ta" count="1">h</IDREF_array></source>
<source id="ws"><float_array id="wa" count="1">0.25</float_array><technique_common>
<accessor source="#wa" count="1"><param name="MORPH_WEIGHT" type="float"/></accessor>
</technique_common></source><targets><input semantic="MORPH_TARGET" source="#ts"/>
<input semantic="MORPH_WEIGHT" source="#ws"/></targets></morph></controller>"""
TARGET = """</library_geometries><library_geometries><geometry id="h"><mesh>{points}
<triangles count="1">
<input semantic="VERTEX" source="#hv" offset="0"/><p>0 1 2</p></triangles></mesh></geometry>"""


def matrix_text(matrix):
    return f"<matrix>{words(np.ravel(matrix))}</matrix>"


def skinned_dae(seed):
    """A COLLADA file with a skin, its vertices by the definition, and its unit."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    places = [local(any_node(rng)) for _ in range(n)]
    above = [int(rng.integers(-1, row)) for row in range(n)]  # -1: below the node of the skeleton
    root, own = local(any_node(rng)), local(any_node(rng))
    by_id, is_morphed, has_roots = seed % 2 > 0, seed % 3 > 0, seed % 5 > 0

    def nodes(parent):
        inner = ""
        for row in range(n):
            if above[row] == parent:
                key = f'id="j{row}"' if by_id else f'id="x{row}" sid="j{row}"'
                inner += f"<node {key} type='JOINT'>{matrix_text(places[row])}{nodes(row)}</node>"
        return inner

    # another joint of the same sid, elsewhere
    other = (
        ""
        if by_id or not has_roots
        else '<node id="other" sid="j0"><translate>9 9 9</translate></node>'
    )
    skeleton = "<skeleton>#root</skeleton>" if has_roots else ""
    scene = (
        f"{other}<node id='root'>{matrix_text(root)}{nodes(-1)}</node>"
        f'<node name="arm">{matrix_text(own)}<instance_controller url="#c">{skeleton}'
        "</instance_controller></node>"
    )
    world_of = []
    for row in range(n):
        world_of.append((root if above[row] < 0 else world_of[above[row]]) @ places[row])
    shape, binds = local(any_node(rng)), [np.linalg.inv(local(any_node(rng))) for _ in range(n)]
    vcount = rng.integers(1, 4, 4)
    joints = [rng.integers(0, n, count) for count in vcount]
    shares = [rng.dirichlet(np.ones(count)) for count in vcount]
    flat = np.concatenate(shares)
    pairs = [(k, j) for k, j in enumerate(np.concatenate(joints).tolist())]
    at_weight, at_joint = (0, 1) if seed % 2 else (1, 0)
    v = [(k, j) if at_weight == 0 else (j, k) for k, j in pairs]
    target = rng.normal(size=(4, 3))
    is_relative = seed % 2 > 0
    points = POINTS
    if is_morphed:
        points = (1 if is_relative else 0.75) * POINTS + 0.25 * target
    controller = CONTROLLER.format(
        morph=MORPH.format(method='method="RELATIVE"' if is_relative else "") if is_morphed else "",
        of="m" if is_morphed else "g", shape=words(np.ravel(shape)),
        array="IDREF_array" if by_id else "Name_array", n=n, n16=16 * n,
        names=words([f"j{row}" for row in range(n)]), binds=words(np.ravel(binds)),
        n_shares=len(flat), shares=words(flat), at_weight=at_weight, at_joint=at_joint,
        vcount=words(vcount), v=words(np.ravel(v)),
    )  # fmt: skip
    data = dae(scene, more=controller, unit='<unit meter="0.01"/>').decode()
    if is_morphed:
        own = re.sub(r'([#"])([sfv])"', r'\1h\2"', source(target))
        more = TARGET.format(points=own)
        data = data.replace("</library_geometries>", more + "</library_geometries>", 1)
    moved = [
        sum(
            w * (world_of[j] @ binds[j] @ shape @ [*point, 1])[:3] for w, j in zip(*of, strict=True)
        )
        for point, *of in zip(points, shares, joints, strict=True)
    ]
    return data.encode(), 0.01 * np.array(moved)


@pytest.mark.parametrize("seed", range(30))
def test_joints_place_a_skin_of_collada_and_its_node_does_not(seed, load):
    data, expected = skinned_dae(seed)
    mesh = load("a.dae", data)
    np.testing.assert_allclose(mesh.vertices[:4], expected, atol=1e-9)
    assert [group.name for group in mesh.groups] == ["arm"]
    assert mesh.notes == ()


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (">j0<", ">other<", "expected joint 'other' to be a node of the scene, got none"),
        ("<vcount>", "<vcount>1 ", "expected joints and weights of 4 points, got 5"),
        (
            'count="1" stride="16"',
            'count="0" stride="16"',
            "bind matrix for each of 1 joints, got 0",
        ),
        ('source="#binds"', 'source="#shares"', "points of 1 numbers"),
        ("<v>", "<v>-1 ", "indices"),
    ],
)
def test_a_broken_skin_of_collada_is_refused(old, new, text, load):
    seed = next(s for s in range(99) if 'count="1" stride="16"' in skinned_dae(s)[0].decode())
    data = skinned_dae(seed)[0].decode()
    assert old in data
    with pytest.raises(MeshError, match=text):
        load("a.dae", data.replace(old, new, 1).encode())


def test_a_joint_of_collada_that_mirrors_leaves_faces_outwards(load):
    mirrored = matrix_text(np.diag([-1, 1, 1, 1]))
    data = skinned_dae(3)[0].decode()
    assert load("a.dae", data.encode()).is_closed_outward
    data = re.sub("(id='root'>)<matrix>.*?</matrix>", rf"\1{mirrored}", data)
    assert load("b.dae", data.encode()).is_closed_outward


def test_skins_that_share_their_joints_count_against_the_budget(load, monkeypatch):
    data = skinned_dae(3)[0].decode()
    (own,) = re.findall("<controller id=.c.*?</controller>", data, re.DOTALL)
    sources = re.search("<source.*</source>", own, re.DOTALL)[0]
    more = [own.replace(sources, "").replace('id="c"', f'id="c{row}"') for row in range(200)]
    uses = "".join(f'<node><instance_controller url="#c{row}"/></node>' for row in range(200))
    data = data.replace(own, own + "".join(more)).replace(
        "</visual_scene>", uses + "</visual_scene>"
    )
    assert load("a.dae", data.encode()).n_faces == 4 * 201
    monkeypatch.setattr(dae_reader, "BYTES_PER_JOINT", 1 << 20)
    load("a.dae", skinned_dae(3)[0], memory_budget=100 << 20)
    with pytest.raises(ResourceError, match=r"expected at most \d+ bytes"):
        load("a.dae", data.encode(), memory_budget=100 << 20)
