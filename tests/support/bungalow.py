"""A bungalow as an IFC file: two rooms with a door between them, a loft, and their spaces."""

import ifcopenshell
import numpy as np
from ifcopenshell.api import run

PARTS = {
    ("IfcWall", "South"): ((0, 0, 0), (10, 0.2, 3)),
    ("IfcWall", "North"): ((0, 5.8, 0), (10, 6, 3)),
    ("IfcWall", "West"): ((0, 0.2, 0), (0.2, 5.8, 3)),
    ("IfcWall", "East"): ((9.8, 0.2, 0), (10, 5.8, 3)),
    ("IfcDoor", "Door 1"): ((5.98, 3, 0), (6.02, 3.9, 2.1)),
    ("IfcSlab", "Floor"): ((0, 0, -0.3), (10, 6, 0)),
    ("IfcWall", "Between/1"): ((5.9, 0.2, 0), (6.1, 5.8, 3)),
}
HOLE = (5.9, 3, 0), (6.1, 3.9, 2.1)
SPACES = {
    "Kitchen": ((0.2, 0.2, 0), (5.9, 5.8, 3)),
    "Hall": ((6.1, 0.2, 0), (9.8, 5.8, 3)),
    "Attic": ((0.2, 0.2, 3.2), (9.8, 5.8, 4)),
}


def bungalow(origin=(0, 0, 0)):
    """Bytes of the file, in millimetres; `origin` is that of its ground floor, in metres."""
    file = ifcopenshell.file(schema="IFC4")
    project = run("root.create_entity", file, ifc_class="IfcProject")
    run("unit.assign_unit", file)
    model = run("context.add_context", file, context_type="Model")
    how = {"context_identifier": "Body", "target_view": "MODEL_VIEW", "parent": model}
    body = run("context.add_context", file, context_type="Model", **how)

    def box(kind, name, ends):
        made = run("root.create_entity", file, ifc_class=kind, name=name)
        size = dict(zip(("length", "thickness", "height"), np.subtract(*ends[::-1]), strict=True))
        shape = run("geometry.add_wall_representation", file, context=body, **size)
        run("geometry.assign_representation", file, product=made, representation=shape)
        place = np.eye(4)
        place[:3, 3] = np.add(ends[0], origin)
        run("geometry.edit_object_placement", file, product=made, matrix=place)
        return made

    def put(products, where, verb="spatial.assign_container", to="relating_structure"):
        run(verb, file, products=products, **{to: where})

    ground, loft = (box("IfcBuildingStorey", name, HOLE) for name in ("Ground", "Loft"))
    for storey in (ground, loft):
        storey.Representation = None
    spaces = [box("IfcSpace", str(row), ends) for row, ends in enumerate(SPACES.values())]
    for space, name in zip(spaces, ("Kitchen", "Hall", "Hall"), strict=True):
        space.LongName = name
    put([ground, loft], project, "aggregate.assign_object", "relating_object")
    put(spaces[:2], ground, "aggregate.assign_object", "relating_object")
    put(spaces[2:], loft, "aggregate.assign_object", "relating_object")
    parts = [box(*names, ends) for names, ends in PARTS.items()]
    hole = box("IfcOpeningElement", "hole", HOLE)
    run("feature.add_feature", file, feature=hole, element=parts[-1])
    put(parts, ground)
    put([box("IfcFurniture", None, ((2, 2, 0), (3, 3, 0.8)))], spaces[0])
    put([box("IfcSlab", "Ceiling", ((0, 0, 3), (10, 6, 3.2)))], loft)
    return file.to_string().encode()
