"""IFC files of buildings: products as a mesh, and spaces as solids.

Shapes are made by IfcOpenShell in another process, which a damaged file may end. Openings are cut
out of walls. Groups are places in the building: storey, type and name of a product. Spaces,
openings and annotations are no surfaces, and are left out of the mesh.

ISO 16739-1. Industry Foundation Classes (IFC) for data sharing in the construction and facility
management industries - Part 1: Data schema. 2024.
"""

import io
import json
import sys
from collections import Counter
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rastercov.base import (
    ByName,
    FloatArray,
    IntArray,
    MeshError,
    arctan2,
    dots,
    offsets_of,
    owners_of,
    plural,
    thread_count,
)
from rastercov.core.mesh.arrays import MOST_FACES
from rastercov.core.mesh.files import Site
from rastercov.formats.meshes.polygons import (
    PEAK_BYTES_PER_FACE,
    SLASH,
    Polygons,
    check,
    check_budget,
    convert_file,
)

NO_SURFACES = (
    "IfcFeatureElementSubtraction",
    "IfcAnnotation",
    "IfcGrid",
    "IfcVirtualElement",
    "IfcSpatialZone",
    "IfcPort",
)
SPACE = "IfcSpace"
FAR = 1e4
"""Distance from the origin from which a note says so, metres: 1 mm of what is drawn in float32."""
DEFLECTION = 0.001
"""Largest distance between a curved surface and its triangles, metres."""
MOST_LEVELS = 64
"""Levels between a product and its storey that are looked at, if a file has a circle of them."""
DEGREES = 1.0, 1 / 60, 1 / 3600, 1 / 3.6e9
"""Parts of an angle: degrees, minutes, seconds, and their millionths."""
CONVERT = "from rastercov.formats.meshes.ifc import convert; convert()"


class Product(NamedTuple):
    """A product of a building (IFC), such as a space; attributes are "" where the file has none.

    Without a name in the file, `name` is the number on drawings or the type. The long name of a
    space is the one in use; its name is often a number.
    """

    storey: str
    type: str
    name: str
    long_name: str
    global_id: str

    @property
    def label(self) -> str:
        """Storey, name and long name, if the name does not end with it."""
        rest = "" if self.name.endswith(self.long_name) else self.long_name
        own = f"{self.name} {rest}".strip() or self.global_id
        return f"{self.storey}/{own}"

    def is_called(self, name: str) -> bool:
        """True for its name, its long name, both, each of them after "STOREY/", or its GlobalId."""
        names = [self.name, self.long_name, f"{self.name} {self.long_name}", self.global_id]
        return name in names or name in [f"{self.storey}/{each}" for each in names]


Solid = tuple[Product, FloatArray, IntArray]
"""A product, its vertices, metres, and its triangles."""


def read(data: bytes, budget: int) -> Polygons:
    """Triangles of an IFC file in metres, one group a product, in the order of the file."""
    made, notes, site = _make_solids(data, budget)
    spaces, solids = ([s for s in made if (s[0].type == SPACE) == is_space] for is_space in (1, 0))
    check(solids, "expected a product with a surface, got none")
    starts = offsets_of([len(points) for _, points, _ in solids])
    vertices = np.concatenate([points for _, points, _ in solids])
    faces = [own + start for (_, _, own), start in zip(solids, starts, strict=False)]
    notes = [
        f"triangulated by IfcOpenShell to within {DEFLECTION * 1000:g} mm",
        *notes,
    ]
    if (far := np.abs(vertices).max()) > FAR:
        moved = [int(-x) for x in vertices.min(axis=0).round(-1)]
        notes.append(
            f"{far / 1000:.0f} km from the origin: translation = {moved} moves it to the origin"
        )
    levels = [(each.storey, each.type, each.name or each.global_id) for each, _, _ in solids]
    return Polygons(
        vertices=vertices,
        faces=np.concatenate(faces),
        source_face=np.arange(sum(map(len, faces))),
        face_group=owners_of(list(map(len, faces))),
        group_names=["/".join(n.replace("/", SLASH) for n in each if n) for each in levels],
        notes=notes,
        is_in_metres=True,
        spaces=spaces,
        site=site,
    )


def _make_solids(data: bytes, budget: int) -> tuple[list[Solid], list[str], Site]:
    """Products with triangles, spaces among them, notes, and the site."""
    if find_spec("ifcopenshell") is None:
        raise MeshError(
            "expected the package ifcopenshell for IFC files, got none; pip install "
            "'rastercov[building]'"
        )
    options = [str(min(MOST_FACES, budget // PEAK_BYTES_PER_FACE))]
    fault = "expected an IFC file that IfcOpenShell reads"
    made = convert_file(CONVERT, data, options, fault, "export it again, as IFC2X3 or IFC4")
    with np.load(io.BytesIO(made), allow_pickle=False) as arrays:
        texts = json.loads(str(arrays["texts"]))
        check_budget(texts["n_faces"], budget)
        items = [
            (Product(*each), arrays[f"vertices {row}"], arrays[f"faces {row}"])
            for row, each in enumerate(texts["products"])
        ]
    return items, texts["notes"], Site(*texts["site"])


def convert() -> None:
    """Triangulate the file of the standard input: the program of the other process.

    Its arguments are the file to write and the greatest number of faces.
    """
    ifc, geom = import_module("ifcopenshell"), import_module("ifcopenshell.geom")
    target, most = Path(sys.argv[1]), int(sys.argv[2])
    source = target.with_suffix(".ifc")
    source.write_bytes(sys.stdin.buffer.read())
    try:
        file = ifc.open(source)
        products = [
            each
            for each in file.by_type("IfcProduct")
            if each.Representation and not any(map(each.is_a, NO_SURFACES))
        ]
    except (ifc.Error, OSError, RuntimeError) as error:
        sys.exit(str(error))
    settings = geom.settings()
    settings.set("use-world-coords", True)
    settings.set("mesher-linear-deflection", DEFLECTION)
    notes = [] if file.by_type("IfcUnitAssignment") else ["assumed metres: the file has no units"]
    shapes, n_faces = {}, 0
    made = products and geom.iterate(settings, file, thread_count(None), include=products)
    for shape in made:
        faces = np.array(shape.geometry.faces, np.int64).reshape(-1, 3)
        if len(faces):
            shapes[shape.id] = np.array(shape.geometry.verts).reshape(-1, 3), faces
        n_faces += len(faces)
        if n_faces > most:  # an error, see `_make_solids`
            break
    none = Counter(each.is_a() for each in products if each.id() not in shapes)
    notes += [
        f"{plural(n, name)} without a surface, or with one that fails" for name, n in none.items()
    ]
    arrays: ByName = {}
    for row, each in enumerate(sorted(shapes)):  # as in the file: cores make them in any order
        arrays[f"vertices {row}"], arrays[f"faces {row}"] = shapes[each]
    site, of_site = _site(file)
    texts = {"n_faces": n_faces, "notes": [*notes, *of_site], "site": site}
    texts["products"] = [_texts(file.by_id(each)) for each in sorted(shapes)]
    with target.open("wb") as written:
        np.savez(written, texts=json.dumps(texts), **arrays)


def _site(file: Any) -> tuple[Site, list[str]]:
    """Site of a file, and notes on it. North of IfcMapConversion precedes TrueNorth (ISO 16739)."""
    contexts = file.by_type("IfcGeometricRepresentationContext", include_subtypes=False)
    contexts = sorted(contexts, key=lambda each: each.ContextType != "Model")
    ways = [each.TrueNorth.DirectionRatios[:2] for each in contexts if each.TrueNorth]
    items = [("TrueNorth", np.degrees(arctan2(y, x))) for x, y in ways[:1] if x or y]
    if file.schema == "IFC2X3":
        get_pset = import_module("ifcopenshell.util.element").get_pset
        maps = [get_pset(each, "ePSet_MapConversion") or {} for each in file.by_type("IfcProject")]
    else:
        maps = [each.get_info() for each in file.by_type("IfcMapConversion")]
    for each in maps[:1]:
        x, y = (each.get(f"XAxis{name}") or 0.0 for name in ("Abscissa", "Ordinate"))
        if x or y:
            items.insert(0, ("IfcMapConversion", 90 - np.degrees(arctan2(y, x))))
    words = [f"north at {north:.6g} degrees from +x by {name}" for name, north in items]
    at = [(each.RefLatitude, each.RefLongitude) for each in file.by_type("IfcSite")]
    places = [[float(dots(own, DEGREES[: len(own)])) for own in each] for each in at if all(each)]
    places = [each for each in places if any(each) and np.abs(each).max() <= 180][:1]
    words += [f"latitude {place[0]:.7g}, longitude {place[1]:.7g} by IfcSite" for place in places]
    used = f"{'; '.join(words)}: the first of each is used for suns and plan sheets"
    site = Site(*(float(each) for _, each in items[:1]))
    for latitude, longitude in places:
        site = Site(site.north_deg, latitude, longitude)
    return site, [used] * bool(words)


def _texts(product: Any) -> Product:
    """Names of a product and of its storey."""
    get_parent = import_module("ifcopenshell.util.element").get_parent
    storey: Any = product
    for _ in range(MOST_LEVELS):
        if storey is not None and not storey.is_a("IfcBuildingStorey"):
            storey = get_parent(storey)
    of = "" if storey is None else storey.Name or storey.LongName or storey.GlobalId
    long_name, tag = (getattr(product, name, None) or "" for name in ("LongName", "Tag"))
    name = product.Name or ("" if long_name else tag or product.ObjectType or "")
    return Product(of, product.is_a(), name, long_name, product.GlobalId)
