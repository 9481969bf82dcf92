"""A solid as a STEP file, written by hand."""

from itertools import product

import numpy as np

HEADER = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
)
SIDES = [
    ((0, 2, 3, 1), (0, 0, -1), (1, 0, 0)),
    ((4, 5, 7, 6), (0, 0, 1), (1, 0, 0)),
    ((0, 1, 5, 4), (0, -1, 0), (1, 0, 0)),
    ((2, 6, 7, 3), (0, 1, 0), (1, 0, 0)),
    ((0, 4, 6, 2), (-1, 0, 0), (0, 1, 0)),
    ((1, 3, 7, 5), (1, 0, 0), (0, 1, 0)),
]
"""Corners, normal and an axis of each side of a box; bits 0, 1, 2 of a corner are x, y, z."""


def crate(size=(1.0, 2.0, 3.0), prefix="$", name="crate", occurrences=()) -> bytes:
    """A box as a STEP file, in metres or another SI unit of length by its prefix.

    With names of occurrences, as in the file, an assembly of as many, 10 units apart along x.
    """
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def triple(kind: str, values) -> str:
        return add(f"{kind}('',({','.join(str(float(value)) for value in values)}))")

    def joined(items) -> str:
        return f"({','.join(items)})"

    corners = [np.array(bits[::-1]) * size for bits in product((0, 1), repeat=3)]
    points = [triple("CARTESIAN_POINT", corner) for corner in corners]
    faces = []
    for loop, normal, axis in SIDES:
        polygon = add(f"POLY_LOOP('',{joined(points[i] for i in loop)})")
        bound = add(f"FACE_OUTER_BOUND('',{polygon},.T.)")
        directions = [triple("DIRECTION", normal), triple("DIRECTION", axis)]
        frame = add(f"AXIS2_PLACEMENT_3D('',{points[loop[0]]},{','.join(directions)})")
        plane = add(f"PLANE('',{frame})")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',{joined(faces)})")
    solid = add(f"FACETED_BREP('',{shell})")
    length = add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({prefix},.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid_angle = add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    context = add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT({joined([length, angle, solid_angle])})"
        "REPRESENTATION_CONTEXT('',''))"
    )
    frames = []
    for x in range(1 + len(occurrences)):
        origin = triple("CARTESIAN_POINT", (10 * x, 0, 0))
        frames.append(add(f"AXIS2_PLACEMENT_3D('',{origin},$,$)"))
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({frames[0]},{solid}),{context})")
    application = add("APPLICATION_CONTEXT('')")
    product_context = add(f"PRODUCT_CONTEXT('',{application},'')")

    def defined(name: str, shape: str) -> str:
        """Definition of a product of a name and a shape."""
        part = add(f"PRODUCT('{name}','{name}','',({product_context}))")
        formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{part})")
        definition_context = add(f"PRODUCT_DEFINITION_CONTEXT('',{application},'')")
        definition = add(f"PRODUCT_DEFINITION('','',{formation},{definition_context})")
        own = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
        add(f"SHAPE_DEFINITION_REPRESENTATION({own},{shape})")
        return definition

    part = defined(name, shape)
    if occurrences:
        cell = add(f"SHAPE_REPRESENTATION('',{joined(frames)},{context})")
        whole = defined("cell", cell)
    for frame, given in zip(frames[1:], occurrences, strict=True):
        used = add(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('1',{given},'',{whole},{part},$)")
        placed = add(f"PRODUCT_DEFINITION_SHAPE('','',{used})")
        motion = add(f"ITEM_DEFINED_TRANSFORMATION('','',{frames[0]},{frame})")
        relation = add(
            f"(REPRESENTATION_RELATIONSHIP('','',{shape},{cell})REPRESENTATION_RELATIONSHIP_WITH_"
            f"TRANSFORMATION({motion})SHAPE_REPRESENTATION_RELATIONSHIP())"
        )
        add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION({relation},{placed})")
    return (HEADER + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n").encode()
