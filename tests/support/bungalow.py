"""A bungalow as an IFC file: two rooms with a door between them, a window, and their spaces."""

import ifcopenshell
from ifcopenshell import api, guid

WALLS = {
    "South": ((0, 0, 0), (10, 0.2, 3)),
    "North": ((0, 5.8, 0), (10, 6, 3)),
    "West": ((0, 0.2, 0), (0.2, 5.8, 3)),
    "East": ((9.8, 0.2, 0), (10, 5.8, 3)),
    "Between/1": ((5.9, 0.2, 0), (6.1, 5.8, 3)),
}
DOOR = (5.9, 3.0, 0), (6.1, 3.9, 2.1)
SPACES = {
    ("1", "Kitchen"): ((0.2, 0.2, 0), (5.9, 5.8, 3)),
    ("2", "Hall"): ((6.1, 0.2, 0), (9.8, 5.8, 3)),
    ("3", "Hall"): ((0.2, 0.2, 3.2), (9.8, 5.8, 4)),
}


def bungalow(metres=1.0, origin=(0.0, 0.0, 0.0)):
    """Bytes of the file, whose unit is some metres; its ground floor is at `origin`, metres."""
    file = ifcopenshell.file(schema="IFC4")
    project = api.run("root.create_entity", file, ifc_class="IfcProject", name="House")
    prefix = {1.0: None, 0.001: "MILLI"}[metres]
    length = api.run("unit.add_si_unit", file, unit_type="LENGTHUNIT", prefix=prefix)
    api.run("unit.assign_unit", file, units=[length])
    model = api.run("context.add_context", file, context_type="Model")
    body = api.run(
        "context.add_context", file, context_type="Model", context_identifier="Body",
        target_view="MODEL_VIEW", parent=model,
    )  # fmt: skip

    def point(values):
        return file.createIfcCartesianPoint([float(x) / metres for x in values])

    def frame(at):
        return file.createIfcLocalPlacement(None, file.createIfcAxis2Placement3D(point(at)))

    def box(kind, name, low, high, **more):
        size = [b - a for a, b in zip(low, high, strict=True)]
        middle = file.createIfcAxis2Placement2D(point((size[0] / 2, size[1] / 2)))
        x, y, z = (each / metres for each in size)
        profile = file.createIfcRectangleProfileDef("AREA", None, middle, x, y)
        up = file.createIfcDirection((0.0, 0.0, 1.0))
        zero = file.createIfcAxis2Placement3D(point((0, 0, 0)))
        solid = file.createIfcExtrudedAreaSolid(profile, zero, up, z)
        shape = file.createIfcShapeRepresentation(body, "Body", "SweptSolid", [solid])
        at = [a + b for a, b in zip(low, origin, strict=True)]
        return file.create_entity(
            kind, GlobalId=guid.new(), Name=name, ObjectPlacement=frame(at),
            Representation=file.createIfcProductDefinitionShape(None, None, [shape]), **more,
        )  # fmt: skip

    storeys = [
        api.run("root.create_entity", file, ifc_class="IfcBuildingStorey", name=name)
        for name in ("Ground", "Loft")
    ]
    api.run("aggregate.assign_object", file, products=storeys, relating_object=project)
    spaces = [box("IfcSpace", name, *ends, LongName=long) for (name, long), ends in SPACES.items()]
    for storey, own in zip(storeys, (spaces[:2], spaces[2:]), strict=True):
        api.run("aggregate.assign_object", file, products=own, relating_object=storey)
    parts = [box("IfcWall", name, *ends) for name, ends in WALLS.items()]
    hole = box("IfcOpeningElement", "hole", *DOOR)
    file.createIfcRelVoidsElement(guid.new(), RelatingBuildingElement=parts[-1],
                                  RelatedOpeningElement=hole)  # fmt: skip
    parts.append(box("IfcDoor", "Door 1", (5.98, 3, 0), (6.02, 3.9, 2.1)))
    parts.append(box("IfcSlab", "Floor", (0, 0, -0.3), (10, 6, 0)))
    table = box("IfcFurniture", None, (2, 2, 0), (3, 3, 0.8))
    ceiling = box("IfcSlab", "Ceiling", (0, 0, 3), (10, 6, 3.2))
    for where, own in ((storeys[0], parts), (spaces[0], [table]), (storeys[1], [ceiling])):
        api.run("spatial.assign_container", file, products=own, relating_structure=where)
    return file.to_string().encode()
