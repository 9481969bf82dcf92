"""STEP files (.step, .stp), triangulated by Open CASCADE through cascadio.

It writes a GLB scene in metres with the CAD face of each triangle. The STEP file itself is not
checked here: what Open CASCADE cannot read it may leave out. It runs in a process of its own,
because damaged files may end it, and it writes to the terminal. Colours are taken out before, as
faces of several colours lose their numbers.

Sources: ISO 10303-21, 10303-41, 10303-44 and 10303-46.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from rastercov.base import (
    TINY,
    ByName,
    FloatArray,
    MeshError,
    WholeArray,
    arccos,
    arcsin,
    dots,
    first_of,
    matmul,
    norm,
    shown,
    sort_order,
)
from rastercov.formats.meshes.gltf import TRIANGLES, nodes_below, roots_of_scene, scene_polygons
from rastercov.formats.meshes.gltf_file import Accessors, chunks, json_list, json_name, json_object
from rastercov.formats.meshes.polygons import Polygons, convert_file

DEFLECTION_MM = 0.1
"""Largest distance between a curved surface and its triangles, in the unit of cascadio."""
DEFLECTION_REL = 4e-4
"""The same, relative to the size of the largest part, where that is less."""
ANGULAR_DEFLECTION = 0.25
"""Largest angle between neighbouring segments along a curve, radians."""
CONVERT = """
import sys
import cascadio
glb = cascadio.load(
    sys.stdin.buffer.read(), tol_linear=float(sys.argv[2]), tol_angular=float(sys.argv[3]),
    use_parallel=False, include_brep=True,
)
with open(sys.argv[1], "wb") as file:
    file.write(glb)
"""
"""Program of the other process. One thread: the numbering of several depends on their timing."""
_GAP, _TEXT = rb"(?:\s|/\*(?:[^*]|\*(?!/))*\*/)*", rb"(?:'(?:[^']|'')*'|\$)"
_NEXT = _GAP + rb"," + _GAP
PRODUCT = re.compile(
    rb"#(\d+)\s*=\s*PRODUCT\s*\(" + _GAP + rb"(" + _TEXT + rb")" + _NEXT + rb"(" + _TEXT + rb")"
)
"""Number, id and name of a product of a STEP file."""
OF_PRODUCT = re.compile(
    rb"#(\d+)\s*=\s*PRODUCT_DEFINITION(?:_FORMATION)?(?:_WITH\w+)?\s*\("
    + (_GAP + _TEXT + _NEXT) * 2
    + rb"#(\d+)"
)
"""Number of a definition or formation, and of what it belongs to."""
OCCURRENCE = re.compile(
    rb"(=\s*NEXT_ASSEMBLY_USAGE_OCCURRENCE\s*\(" + _GAP + _TEXT + _NEXT + rb")(" + _TEXT + rb")"
    rb"(" + _NEXT + _TEXT + _NEXT + rb"#\d+" + _NEXT + rb"#(\d+))"
)
"""Of an occurrence in an assembly: up to its name, the name, the rest, number of its definition."""
AUTOMATIC = re.compile(
    rb"(?i)(?:=>\[[\d:]*\]|nauo|occ\w*|next_assembly\w*|instance|component)?[\s_:#.-]*\d*"
)
"""Names of occurrences that programs give, not people."""
STYLED = re.compile(rb"\b((?:\w*(?:STYLED_ITEM|LAYER_ASSIGNMENT)|INVISIBILITY)" + _GAP + rb"\()")
"""Colours, layers, and what else is seen of an element."""
UNNAMED = re.compile(r"(?:=>)?\[[\d:]*\]")
"""Names that Open CASCADE gives to parts of assemblies without a name."""
TYPES = frozenset(("COMPOUND", "COMPSOLID", "SOLID", "SHELL", "FACE"))
"""Names that it gives to shapes without a name."""
ROUNDING_REL = 2.0**-24
"""Rounding of coordinates to float32, relative to them."""
FLAT_REL = 1e-6
"""Distance from a surface, relative to the longest edge, that is rounding of float32."""
LARGEST_TILT = 0.7
"""Sine of the angle between a facet and the normal of its surface above which that is at a pole."""


def read_step(data: bytes, budget: int, deflection_mm: float | None = None) -> Polygons:
    """Triangles of a STEP file in metres, one group a CAD face, named "part/face 1" and so on.

    Parts have the names of their products; those of their occurrences stay where they say more.

    Parameters
    ----------
    data : bytes
    budget : int
        Bytes that reading the triangles may need; that of Open CASCADE is not limited.
    deflection_mm : float, optional
        Largest distance between a curved surface and its triangles, millimetres; by default 0.1, or
        less for small parts.
    """
    notes = []
    try:
        data.decode()
    except UnicodeDecodeError:
        data = data.decode("cp1252", "replace").encode()
        notes = ["read names as Windows-1252: they are not UTF-8"]
    notes += _left_out_names(data)
    data = STYLED.sub(rb"UNREAD_\1", with_product_names(data))
    used = deflection_mm or DEFLECTION_MM
    header, binary, more = chunks(_convert(data, used))
    error_mm, size_mm, rounding_mm, error = _error(header, binary, budget)
    if not rounding_mm <= used:
        raise MeshError(
            f"expected coordinates that cascadio rounds by {used:g} mm at most, got "
            f"{rounding_mm:.3g}, as they are far from the origin; move the part there, or allow "
            f"deflection_mm {1.1 * rounding_mm:.2g}"
        )
    wanted = DEFLECTION_REL * size_mm
    if deflection_mm is None and rounding_mm < wanted < min(used, error_mm):
        used = wanted
        header, binary, more = chunks(_convert(data, used))
        *_, error = _error(header, binary, budget)
    _name_nodes(header)
    polygons = scene_polygons(header, [binary], budget, [*more, *notes], by_cad_face=True)
    note = (
        f"triangulated by Open CASCADE to within {used + rounding_mm:.2g} mm{error}, which does "
        "not report what it leaves out"
    )
    return replace(polygons, notes=[*polygons.notes, note], is_in_metres=True)


def _name_nodes(header: ByName) -> None:
    """Give nodes without a name that of their mesh, or of the node above."""
    names: list[str] = []
    for node, _, _, parent in nodes_below(header, roots_of_scene(header)):
        name, above = json_name(node), names[parent] if parent >= 0 else ""
        if UNNAMED.fullmatch(name) or name in TYPES:
            mesh = json_object(header, "meshes", node["mesh"]) if "mesh" in node else {}
            own = json_name(mesh)
            is_named = own and own not in TYPES and not UNNAMED.fullmatch(own)
            name = own if is_named else above
            node["name"] = name
        names.append(name or above)


def _error(header: ByName, binary: memoryview, budget: int) -> tuple[float, float, float, str]:
    """Distance of facets from their surfaces, extent of the largest part, rounding of points, mm.

    And a text.
    """
    reader = Accessors(header, [binary], budget)
    greatest, sums = np.zeros(5), np.zeros(2)
    for mesh in json_list(header, "meshes"):
        for each in json_list(mesh, "primitives"):
            attributes = each["attributes"]
            if each.get("mode", TRIANGLES) != TRIANGLES or "NORMAL" not in attributes:
                continue
            corners = reader.read(each["indices"], "SCALAR")[:, 0].reshape(-1, 3)
            if len(corners):
                points, normals = (
                    reader.read(attributes[key], "VEC3").astype(np.float64)[corners]
                    for key in ("POSITION", "NORMAL")
                )
                most, more = _of_facets(corners, points, normals)
                greatest, sums = np.maximum(greatest, most), sums + more
    distance, angle, longest, extent, farthest = greatest.tolist()
    rounding_mm = 1000 * ROUNDING_REL * farthest
    if distance <= FLAT_REL * longest:
        return 0.0, 0.0, rounding_mm, ""
    return (
        1000 * distance,
        1000 * extent,
        rounding_mm,
        f" (facets are about {1000 * distance:.2g} mm from their surfaces at most, "
        f"{np.degrees(angle):.2g} degrees apart, and change the area by "
        f"{100 * sums[0] / sums[1]:.2g} %)",
    )


def _of_facets(
    corners: WholeArray, p: FloatArray, normals: FloatArray
) -> tuple[list[float], list[float]]:
    """Distance from the surface, angle, edge, extent, coordinate, the greatest; area lacking, area.

    By the normals of the surface at the vertices, n_i, beside that of the facet, n. An edge of
    length L at angles a, b to the surface at its ends is L min(a, b) / 4 away from an arc, and the
    middle of a facet up to 4/3 of that. With t_i = n_i - (n_i n) n, linear over a facet, its area
    is short by (sum |t_i|^2 + |sum t_i|^2) / 24; the face beyond an edge at the border of a CAD
    face, whose vertices are its own, lacks or has L^2 min(a, b) / 6 more.

    Parameters
    ----------
    corners : (F, 3) int
        Vertices.
    p, normals : (F, 3, 3) float64
        Points and normals of the surface at the corners.
    """
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    size = norm(cross)
    n = cross / np.maximum(size, TINY)[:, None]
    tilt = normals - dots(normals, n[:, None])[..., None] * n[:, None]
    tilt[norm(tilt) > LARGEST_TILT] = 0
    lacks = matmul(size, (tilt**2).sum(axis=(1, 2)) + (tilt.sum(axis=1) ** 2).sum(axis=1)) / 48
    edge = np.roll(p, -1, axis=1) - p
    length = norm(edge)
    along = edge / np.maximum(length, TINY)[:, :, None]
    ends = [np.abs(dots(side, along)) for side in (tilt, np.roll(tilt, -1, axis=1))]
    least = arcsin(np.minimum(np.minimum(*ends), 1.0))
    pairs = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
    _, row, uses = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    uses = uses[row.ravel()]
    lacks += float((length**2 * least).ravel()[uses == 1].sum()) / 6
    order = sort_order(row.ravel())
    one, other = order[uses[order] == 2].reshape(-1, 2).T // 3
    cosine = dots(n[one], n[other])[size[one] * size[other] > 0]
    angle = arccos(np.clip(cosine, -1, 1)).max(initial=0.0)
    extent = np.ptp(p.reshape(-1, 3), axis=0).max()
    greatest = [(length * least).max() / 3, angle, length.max(), extent, abs(p).max()]
    return greatest, [lacks, size.sum() / 2]


SHAPES = (
    *(b"BREP", b"BREP_WITH_VOIDS", b"SURFACE_MODEL", b"SHELL", b"FACE", b"FACE_SURFACE"),
    b"SHAPE_REPRESENTATION",
)
"""Ends of the types of elements that have a surface."""
STYLES = (b"STYLED_ITEM", b"LAYER_ASSIGNMENT", b"PRESENTATION_REPRESENTATION")
"""Ends of the types of elements that say how others are shown."""
_KINDS = rb"INVISIBILITY|NEXT_ASSEMBLY\w*|PRODUCT\w*|DOCUMENT_FILE|AXIS2\w*|\w*REPRESENTATION\w*"
_ENDS = b"|".join([*SHAPES, *STYLES])
_PARAMETERS = rb"\((?:[^';]+|'(?:[^']|'')*')*+"
_ENTITY = re.compile(
    rb"#(\d+)%b=%b(%b|\w*(?:%b))%b(%b)" % (_GAP, _GAP, _KINDS, _ENDS, _GAP, _PARAMETERS)
)
"""Number, type and parameters of the elements that notes depend on."""
_REFERENCE = re.compile(rb"#(\d+)")
_STRING = re.compile(rb"'((?:[^']|'')*)'")


def _left_out_names(data: bytes) -> list[str]:
    """Notes on shapes that are marked as invisible, and on products without geometry."""
    if b"INVISIBILITY" not in data and b"NEXT_ASSEMBLY_USAGE" not in data:
        return []
    matches = _ENTITY.findall(data)
    kinds: dict[bytes, bytes] = {number: kind for number, kind, _ in matches}
    texts: dict[bytes, bytes] = {number: text for number, _, text in matches}
    notes = []
    if hidden := list(dict.fromkeys(_hidden_names(kinds, texts))):
        notes.append(f"read bodies that the file marks as invisible: {first_of(hidden)}")
    if empty := list(dict.fromkeys(_without_geometry(kinds, texts))):
        notes.append(f"products without geometry in this file: {first_of(empty)}")
    return notes


def _plain(text: bytes) -> str:
    return re.sub(rb"[\r\n]", b"", text).decode("utf-8", "replace").strip()


def _name_in(text: bytes) -> str:
    """First text among parameters that is not empty."""
    return next((name for each in _STRING.findall(text) if (name := _plain(each))), "")


def _hidden_names(kinds: dict[bytes, bytes], texts: dict[bytes, bytes]) -> Iterator[str]:
    """Names of shapes with INVISIBILITY, by their styles, layers or representations."""
    above: dict[bytes, list[bytes]] = {}
    for number, text in texts.items():
        for each in _REFERENCE.findall(text):
            above.setdefault(each, []).append(number)
    for number, kind in kinds.items():
        if kind != b"INVISIBILITY":
            continue
        todo, seen = _REFERENCE.findall(texts[number]), set[bytes]()
        while todo:
            each = todo.pop()
            of = kinds.get(each, b"")
            if each in seen or not of:
                continue
            seen.add(each)
            if of.endswith(STYLES):
                todo += _REFERENCE.findall(texts[each])
            elif of.endswith(SHAPES):
                yield _owner(each, kinds, texts, above)


def _owner(
    number: bytes,
    kinds: dict[bytes, bytes],
    texts: dict[bytes, bytes],
    above: dict[bytes, list[bytes]],
) -> str:
    """Name of a shape, or of the product that it belongs to."""
    own, todo, seen = _name_in(texts[number].partition(b",")[0]), [number], set[bytes]()
    if own:
        return shown(own)
    while todo:
        each = todo.pop(0)
        if each in seen:
            continue
        seen.add(each)
        kind = kinds.get(each, b"")
        if kind == b"SHAPE_DEFINITION_REPRESENTATION" or kind.startswith(b"PRODUCT_DEFINITION"):
            todo = _REFERENCE.findall(texts[each])[:1]  # of the definition, not of its context
        elif kind == b"PRODUCT":
            return shown(_product_name(texts[each]))
        elif not kind.endswith((*STYLES, b"INVISIBILITY")):
            todo += above.get(each, [])
    return f"#{number.decode()}"


def _without_geometry(kinds: dict[bytes, bytes], texts: dict[bytes, bytes]) -> Iterator[str]:
    """Names of products of assemblies that have neither a shape nor parts, with their files."""
    refs = {number: _REFERENCE.findall(text) for number, text in texts.items()}
    used, whole = dict[bytes, None](), set[bytes]()
    shapes: dict[bytes, list[bytes]] = {}  # representations by the definition of a product
    linked: dict[bytes, set[bytes]] = {}
    for number, kind in kinds.items():
        own = refs[number]
        if kind == b"NEXT_ASSEMBLY_USAGE_OCCURRENCE" and len(own) > 1:
            whole.add(own[0])
            used[own[1]] = None
        elif kind == b"SHAPE_DEFINITION_REPRESENTATION" and len(own) > 1:
            for definition in refs.get(own[0], [])[:1]:
                shapes.setdefault(definition, []).append(own[1])
        elif kind == b"SHAPE_REPRESENTATION_RELATIONSHIP" and len(own) > 1:
            linked.setdefault(own[0], set()).add(own[1])
            linked.setdefault(own[1], set()).add(own[0])
    for definition in used:
        todo, seen = list(shapes.get(definition, [])), set[bytes]()
        has_shape = definition in whole
        while todo and not has_shape:
            each = todo.pop()
            if each in seen:
                continue
            seen.add(each)
            todo += linked.get(each, ())
            items = [kinds.get(item, b"") for item in refs.get(each, [])[:-1]]
            has_shape = any(not kind.startswith(b"AXIS2_PLACEMENT") for kind in items)
        if has_shape or definition not in kinds:
            continue
        name, file = f"#{definition.decode()}", ""
        for each in refs[definition]:
            kind = kinds.get(each, b"")
            if kind.startswith(b"PRODUCT_DEFINITION_FORMATION"):
                product = next(iter(refs[each]), b"")
                name = _product_name(texts.get(product, b"")) or name
            elif kind == b"DOCUMENT_FILE":
                file = _name_in(texts[each])
        yield shown(name) + (f" ({file[:60]})" if file else "")


def _product_name(text: bytes) -> str:
    """Name of a product by its parameters, or its id."""
    names = [_plain(each) for each in _STRING.findall(text)[:2]]
    return next((name for name in reversed(names) if name), "")


def with_product_names(data: bytes) -> bytes:
    """A STEP file in UTF-8, with names of its products in those of their occurrences, ISO 10303-41.

    Triangulation names parts by occurrences, which many programs leave empty or number.
    """

    def text(given: bytes) -> bytes:
        return re.sub(rb"[\r\n]", b"", given)[1:-1].strip()

    above = dict(OF_PRODUCT.findall(data))
    products = {row: text(name) or text(own) for row, own, name in PRODUCT.findall(data)}

    def name_of(result: "re.Match[bytes]") -> bytes:
        name, product = text(result[2]), products.get(above.get(above.get(result[4])))
        if not product:
            return result[0]
        if AUTOMATIC.fullmatch(name):
            name = product
        elif product.lower() not in name.lower():
            name = product + b" (" + name + b")"
        return result[1] + b"'" + name + b"'" + result[3]

    return OCCURRENCE.sub(name_of, data)


def _convert(data: bytes, deflection_mm: float) -> bytes:
    """GLB file of a STEP file."""
    if find_spec("cascadio") is None:
        raise MeshError(
            "expected the package cascadio for STEP files, got none; pip install "
            "'rastercov[formats]'"
        )
    numbers = [str(deflection_mm), str(ANGULAR_DEFLECTION)]
    fault = "expected a STEP file that Open CASCADE reads"
    return convert_file(CONVERT, data, numbers, fault, "export it again, as AP214 or AP242")
