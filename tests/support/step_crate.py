"""A solid as a STEP file, written by hand."""

import re
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


def rod(radius=5.0, length=20.0, prefix=".MILLI.", name="rod") -> bytes:
    """A cylinder along z as a STEP file, with three CAD faces."""
    box = crate((1, 1, 1), prefix, name).decode()
    lines = [
        "#1001=DIRECTION('',(0.,0.,1.));",
        "#1002=DIRECTION('',(1.,0.,0.));",
        "#1003=DIRECTION('',(0.,0.,-1.));",
    ]
    for row, z in ((1010, 0.0), (1020, length)):
        lines += [
            f"#{row}=CARTESIAN_POINT('',(0.,0.,{z}));",
            f"#{row + 1}=AXIS2_PLACEMENT_3D('',#{row},#1001,#1002);",
            f"#{row + 2}=CIRCLE('',#{row + 1},{radius});",
            f"#{row + 3}=CARTESIAN_POINT('',({radius},0.,{z}));",
            f"#{row + 4}=VERTEX_POINT('',#{row + 3});",
            f"#{row + 5}=EDGE_CURVE('',#{row + 4},#{row + 4},#{row + 2},.T.);",
            f"#{row + 6}=ORIENTED_EDGE('',*,*,#{row + 5},.T.);",
            f"#{row + 7}=ORIENTED_EDGE('',*,*,#{row + 5},.F.);",
        ]
    lines += [
        "#1030=VECTOR('',#1001,1.);\n#1031=LINE('',#1013,#1030);",
        "#1032=EDGE_CURVE('',#1014,#1024,#1031,.T.);",
        "#1033=ORIENTED_EDGE('',*,*,#1032,.T.);\n#1034=ORIENTED_EDGE('',*,*,#1032,.F.);",
        "#1035=EDGE_LOOP('',(#1016,#1033,#1027,#1034));\n#1036=EDGE_LOOP('',(#1017));",
        "#1037=EDGE_LOOP('',(#1026));",
        *(f"#{row + 3}=FACE_OUTER_BOUND('',#{row},.T.);" for row in (1035, 1036, 1037)),
        f"#1041=CYLINDRICAL_SURFACE('',#1011,{radius});",
        "#1042=PLANE('',#1011);\n#1043=PLANE('',#1021);",
        "#1044=ADVANCED_FACE('',(#1038),#1041,.T.);",
        "#1045=ADVANCED_FACE('',(#1039),#1042,.F.);",
        "#1046=ADVANCED_FACE('',(#1040),#1043,.T.);",
        "#1047=CLOSED_SHELL('',(#1044,#1045,#1046));",
        f"#1048=MANIFOLD_SOLID_BREP('{name}',#1047);",
    ]
    solid = re.search(r"#(\d+)=FACETED_BREP\(", box)[1]
    box = box.replace("FACETED_BREP_SHAPE", "ADVANCED_BREP_SHAPE")
    box = re.sub(rf"(SHAPE_REPRESENTATION\('',\(#\d+,)#{solid}\)", r"\g<1>#1048)", box)
    return box.replace("ENDSEC;\nEND-ISO", "\n".join([*lines, "ENDSEC;\nEND-ISO"])).encode()
