"""IFC files of buildings: products as a mesh, and spaces as solids.

Shapes are made by IfcOpenShell in another process, which a damaged file may end. Openings are cut
out of walls. Groups are places in the building: storey, type and name of a product. Spaces,
openings and annotations are no surfaces, and are left out of the mesh.

ISO 16739-1. Industry Foundation Classes (IFC) for data sharing in the construction and facility
management industries - Part 1: Data schema. 2024.
"""

import io
import json
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from rastercov.base.errors import MeshError
from rastercov.base.format import plural
from rastercov.base.threads import thread_count
from rastercov.mesh.arrays import MOST_FACES
from rastercov.mesh.formats.polygons import (
    PEAK_BYTES_PER_FACE,
    FloatArray,
    IntArray,
    Polygons,
    check,
    check_budget,
    converted,
    names_in_tree,
)

NO_SURFACES = (
    "IfcSpace",
    "IfcFeatureElementSubtraction",
    "IfcAnnotation",
    "IfcGrid",
    "IfcVirtualElement",
    "IfcSpatialZone",
    "IfcPort",
)
FAR = 1e4
"""Distance from the origin from which a note says so, metres: 1 mm of what is drawn in float32."""
DEFLECTION = 0.001
"""Largest distance between a curved surface and its triangles, metres."""
MOST_LEVELS = 64
"""Levels between a product and its storey that are looked at, if a file has a circle of them."""
CONVERT = "from rastercov.mesh.formats.ifc import convert; convert()"


class Product(NamedTuple):
    """A product of the building, its texts empty where the file has none."""

    storey: str
    storey_id: str
    type: str
    name: str
    long_name: str
    global_id: str


class Solid(NamedTuple):
    """A product with its triangles, metres."""

    product: Product
    vertices: FloatArray
    faces: IntArray


def read(data: bytes, budget: int) -> Polygons:
    """Triangles of an IFC file in metres, one group a product, in the order of the file."""
    products, vertices, faces, group, notes = _made(data, budget, "products")
    names: list[str] = []
    parents: list[int] = []
    rows: dict[tuple[str, ...], int] = {}
    used: list[int] = []
    for each in products:
        above = -1
        keys = (each.storey_id,), (each.storey_id, each.type), (each.global_id, str(len(used)))
        for key, name in zip(keys, (each.storey, each.type, each.name), strict=True):
            if key not in rows:
                rows[key] = len(names)
                names.append(name or (each.global_id if key == keys[2] else ""))
                parents.append(above)
            above = rows[key]
        used.append(above)
    found = names_in_tree(parents, names, used)
    far = np.abs(vertices).max(initial=0)
    if far > FAR:
        to = (-np.round(vertices.min(axis=0), -1)).tolist()
        notes.append(
            f"the building is {far / 1000:.0f} km from the origin, as a georeferenced one; "
            f"translation = {[int(x) for x in to]} moves it there"
        )
    return Polygons(
        vertices=vertices,
        faces=faces,
        source_face=np.arange(len(faces)),
        face_group=group,
        group_names=[found[row] for row in used],
        notes=[
            f"triangulated by IfcOpenShell to within {DEFLECTION * 1000:g} mm; spaces are left out",
            *notes,
        ],
        is_in_metres=True,
    )


def solids_of_spaces(data: bytes, budget: int) -> list[Solid]:
    """Solids of the spaces of an IFC file, in its order."""
    products, vertices, faces, group, _ = _made(data, budget, "spaces")
    found = []
    for row, each in enumerate(products):
        used, own = np.unique(faces[group == row], return_inverse=True)
        found.append(Solid(each, vertices[used], own.reshape(-1, 3)))
    return found


def _made(
    data: bytes, budget: int, kind: str
) -> tuple[list[Product], FloatArray, IntArray, IntArray, list[str]]:
    """Products or spaces, vertices, faces, product of each face, and notes."""
    if find_spec("ifcopenshell") is None:
        raise MeshError("reading IFC files needs ifcopenshell: pip install 'rastercov[building]'")
    most = min(MOST_FACES, budget // PEAK_BYTES_PER_FACE)
    options = [kind, str(most)]
    fault, advice = "IfcOpenShell cannot read the IFC file", "export it again, as IFC2X3 or IFC4"
    made = converted(CONVERT, data, options, fault, advice)
    with np.load(io.BytesIO(made), allow_pickle=False) as arrays:
        vertices, faces, n_faces = arrays["vertices"], arrays["faces"], arrays["n_faces"]
        texts = json.loads(str(arrays["texts"]))
    check_budget(int(n_faces.sum()), budget, len(vertices))
    check(kind == "spaces" or len(faces), "no triangles: no product of the file has a surface")
    products = [Product(*each) for each in texts["products"]]
    group = np.repeat(np.arange(len(products)), n_faces)
    return products, vertices.reshape(-1, 3), faces.reshape(-1, 3), group, texts["notes"]


def convert() -> None:
    """Triangulate the file of the standard input: the program of the other process.

    Its arguments are the file to write, "products" or "spaces", and the greatest number of faces.
    """
    import sys
    from collections import Counter
    from pathlib import Path

    ifcopenshell = import_module("ifcopenshell")
    geom = import_module("ifcopenshell.geom")
    target, kind, most = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    source = target.with_suffix(".ifc")
    source.write_bytes(sys.stdin.buffer.read())
    try:
        file = ifcopenshell.open(source)
        products = [
            each
            for each in file.by_type("IfcSpace" if kind == "spaces" else "IfcProduct")
            if each.Representation and (kind == "spaces" or not any(map(each.is_a, NO_SURFACES)))
        ]
    except (ifcopenshell.Error, OSError, RuntimeError) as error:
        sys.exit(str(error))
    products.sort(key=lambda each: each.id())
    settings = geom.settings()
    settings.set("use-world-coords", True)
    settings.set("mesher-linear-deflection", DEFLECTION)
    made: dict[int, list[tuple[FloatArray, IntArray]]] = {}
    n_faces = 0
    for shape in _shapes(settings, file, products):
        points = np.array(shape.geometry.verts, np.float64).reshape(-1, 3)
        corners = np.array(shape.geometry.faces, np.int64).reshape(-1, 3)
        if len(corners):
            made.setdefault(shape.id, []).append((points, corners))
        n_faces += len(corners)
        if n_faces > most:  # an error, see `_made`
            break
    chosen = [each for each in products if each.id() in made]
    none = Counter(each.is_a() for each in products if each.id() not in made)
    notes = [
        f"{plural(n, name)} without a surface, or with one that fails" for name, n in none.items()
    ]
    if not file.by_type("IfcUnitAssignment"):
        notes.append("the file has no units, taken as metres")
    pieces = [piece for each in chosen for piece in made[each.id()]]
    starts = np.cumsum([0] + [len(points) for points, _ in pieces])
    moved = [own + start for (_, own), start in zip(pieces, starts, strict=False)]
    arrays: dict[str, Any] = {
        "vertices": np.concatenate([np.empty((0, 3)), *(points for points, _ in pieces)]),
        "faces": np.concatenate([np.empty((0, 3), np.int64), *moved]),
        "n_faces": np.array([sum(len(own) for _, own in made[each.id()]) for each in chosen], int),
        "texts": json.dumps({"products": [_texts(each) for each in chosen], "notes": notes}),
    }
    with target.open("wb") as written:
        np.savez(written, **arrays)


def _shapes(settings: Any, file: Any, products: Sequence[Any]) -> Iterator[Any]:
    """Shapes of products, made by all cores, in any order."""
    if products:
        geom = import_module("ifcopenshell.geom")
        iterator = geom.iterator(settings, file, thread_count(None), include=products)
        is_more = iterator.initialize()
        while is_more:
            yield iterator.get()
            is_more = iterator.next()


def _texts(product: Any) -> Product:
    """Names of a product and of its storey."""
    get_parent = import_module("ifcopenshell.util.element").get_parent
    storey: Any = product
    for _ in range(MOST_LEVELS):
        if storey is None or storey.is_a("IfcBuildingStorey"):
            break
        storey = get_parent(storey)
    return Product(
        storey="" if storey is None else storey.Name or storey.GlobalId,
        storey_id="" if storey is None else storey.GlobalId,
        type=product.is_a(),
        name=product.Name or "",
        long_name=getattr(product, "LongName", None) or "",
        global_id=product.GlobalId,
    )
