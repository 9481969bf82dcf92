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


def bungalow(origin=(0, 0, 0), windows=()):
    """Bytes of the file, in millimetres; `origin` is that of its ground floor, in metres.

    `windows` are ends of boxes by name, in front of which nothing is cut out of the walls.
    """
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
    panes = [box("IfcWindow", name, windows[name]) for name in windows]
    hole = box("IfcOpeningElement", "hole", HOLE)
    run("feature.add_feature", file, feature=hole, element=parts[-1])
    put([*parts, *panes], ground)
    put([box("IfcFurniture", None, ((2, 2, 0), (3, 3, 0.8)))], spaces[0])
    put([box("IfcSlab", "Ceiling", ((0, 0, 3), (10, 6, 3.2)))], loft)
    return file.to_string().encode()


def on_earth(data=None, north=None, axis=None, place=None, schema="IFC4"):
    """An IFC file with TrueNorth, the x axis of a map conversion, latitude and longitude."""
    made = ifcopenshell.file(schema=schema)
    file = made if data is None else ifcopenshell.file.from_string(data.decode())
    add = file.create_entity
    if data is None:
        add("IfcProject", GlobalId=ifcopenshell.guid.new())
        for kind in ("Plan", "Model"):
            add("IfcGeometricRepresentationContext", ContextType=kind, CoordinateSpaceDimension=3)
    contexts = file.by_type("IfcGeometricRepresentationContext", include_subtypes=False)
    (model,) = (each for each in contexts if each.ContextType == "Model")
    if north is not None:
        model.TrueNorth = add("IfcDirection", north)
    names = ("XAxisAbscissa", "XAxisOrdinate")
    if axis is not None and schema == "IFC2X3":
        values = [
            add("IfcPropertySingleValue", name, NominalValue=add("IfcReal", value))
            for name, value in zip(names, axis, strict=True)
        ]
        own = {"Name": "ePSet_MapConversion", "HasProperties": values}
        pset = add("IfcPropertySet", GlobalId=ifcopenshell.guid.new(), **own)
        ends = {"RelatedObjects": file.by_type("IfcProject"), "RelatingPropertyDefinition": pset}
        add("IfcRelDefinesByProperties", GlobalId=ifcopenshell.guid.new(), **ends)
    elif axis is not None:
        ends = {"SourceCRS": model, "TargetCRS": add("IfcProjectedCRS", "EPSG:25832")}
        ends |= {"Eastings": 4.5e5, "Northings": 5.4e6, "OrthogonalHeight": 100.0}
        add("IfcMapConversion", **ends, **dict(zip(names, axis, strict=True)))
    if place is not None:
        own = dict(zip(("RefLatitude", "RefLongitude"), place, strict=True))
        add("IfcSite", GlobalId=ifcopenshell.guid.new(), **own)
    return file
