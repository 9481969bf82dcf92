"""Areas of CAD kernels: Open CASCADE (by cadquery-ocp) and IfcOpenShell.

Open CASCADE: areas of the faces of solids against the groups of the mesh that we read from their
STEP file, which passes through the float32 of glTF; and the part of a plane that parallel rays
reach past boxes, by its Booleans, against `rc.regions`. IfcOpenShell: areas and footprints of the
elements of houses by its own functions, against groups of the mesh, and against what vertical rays
reach. Our reader of IFC calls IfcOpenShell for the triangles, so that there units, placements and
groups are compared.
"""

import tempfile
from pathlib import Path

import numpy as np
from bungalow import bungalow
from compared import Compared, Comparison, amount

import rastercov as rc

SOLIDS, FLOORS, DIRECTIONS, HOUSES = 100, 60, 5, 10
PRECISION = 1e-9
"""Relative accuracy of areas from both CAD kernels."""
LARGEST_MM = 100.0
ROUNDING_MM = np.sqrt(3) * LARGEST_MM * 2.0**-24
"""Distance by which a corner moves at most that is rounded to float32."""


def of_occ(effort: float) -> list[Compared]:
    return [step_faces(amount(SOLIDS, effort, 3)), lit_floors(amount(FLOORS, effort, 2))]


def step_faces(n_solids: int) -> Compared:
    """Areas of the faces of boxes from which other boxes were cut, through a STEP file."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.Message import Message, Message_Gravity
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    for printer in Message.DefaultMessenger_s().Printers():
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    rng = np.random.default_rng(0)
    writer, shapes = STEPControl_Writer(), []
    for _ in range(n_solids):
        shape = occ_box(np.zeros(3), rng.uniform(20, 80, 3))
        for _ in range(int(rng.integers(1, 5))):
            low = rng.uniform(-10, 60, 3)
            shape = BRepAlgoAPI_Cut(shape, occ_box(low, low + rng.uniform(5, 40, 3))).Shape()
        writer.Transfer(shape, STEPControl_AsIs)
        shapes.append(shape)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "solids.step")
        writer.Write(str(path))
        mesh = rc.Mesh.load(path)
    ours: dict[str, list[float]] = {}
    for area, group in zip(areas_of_groups(mesh), mesh.groups, strict=True):
        ours.setdefault(group.name.partition("/face")[0], []).append(1e6 * area)
    compared = Compared("faces of STEP files (float32)", "mm²")
    for (name, areas), shape in zip(ours.items(), shapes, strict=True):
        sides = occ_faces(shape)
        theirs = np.array(sorted((occ_area(side), occ_perimeter(side)) for side in sides))
        if len(areas) != len(theirs):
            compared.faults.append(f"{name}: {len(areas)} faces for {len(theirs)}")
        elif compared.add(sorted(areas), theirs[:, 0], ROUNDING_MM * theirs[:, 1]).any():
            compared.faults.append(f"{name}: {sorted(areas)}, {theirs[:, 0]}")
    return compared


def areas_of_groups(mesh: rc.Mesh) -> np.ndarray:
    return np.bincount(mesh.face_group, mesh.areas, len(mesh.groups))


def lit_floors(n_floors: int) -> Compared:
    """Part of a floor that oblique parallel rays reach past boxes and prisms."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec

    compared = Compared("lit floor behind boxes", "m²")
    for seed in range(n_floors):
        rng = np.random.default_rng(seed)
        boxes = [
            (low, low + rng.uniform(0.3, 2, 3))
            for low in rng.uniform((-4, -4, 0.1), (3, 3, 1.5), (int(rng.integers(2, 6)), 3))
        ]
        corners = np.array([(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)], float)
        floor = rc.Mesh(corners, [(0, 1, 2), (0, 2, 3)])
        mesh = rc.Mesh.joined([floor, *(box_mesh(*ends) for ends in boxes)])
        camera = rc.Camera.orthographic(2000, 2000, px_per_m=100)
        for _ in range(DIRECTIONS):
            towards = np.append(rng.uniform(-1.5, 1.5, 2), 1.0)
            pose = rc.look_at(20 * towards, (0, 0, 0))
            seen = rc.regions(mesh, camera, pose)
            rest = occ_polygon(corners)
            for ends in boxes:
                for side in occ_faces(occ_box(*ends)):
                    sweep = gp_Vec(*(-10 * towards))
                    rest = BRepAlgoAPI_Cut(rest, BRepPrimAPI_MakePrism(side, sweep).Shape()).Shape()
            ours, bound, theirs = (
                seen.areas()[0, :2].sum(),
                seen.bounds()[0, :2].sum(),
                occ_area(rest),
            )
            if compared.add(ours, theirs, bound + 100 * PRECISION):
                compared.faults.append(f"floor {seed}, towards {towards}: {ours}, {theirs}")
    return compared


def box_mesh(low: np.ndarray, high: np.ndarray) -> rc.Mesh:
    return rc.shapes.box(tuple(high - low), 1, tuple((low + high) / 2))


def occ_box(low: np.ndarray, high: np.ndarray) -> object:
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    return BRepPrimAPI_MakeBox(gp_Pnt(*low), gp_Pnt(*high)).Shape()


def occ_polygon(corners: np.ndarray) -> object:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakePolygon
    from OCP.gp import gp_Pnt

    outline = BRepBuilderAPI_MakePolygon()
    for corner in corners:
        outline.Add(gp_Pnt(*corner))
    outline.Close()
    return BRepBuilderAPI_MakeFace(outline.Wire()).Shape()


def occ_faces(shape: object) -> list[object]:
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer

    explorer, items = TopExp_Explorer(shape, TopAbs_FACE), []
    while explorer.More():
        items.append(explorer.Current())
        explorer.Next()
    return items


def occ_area(shape: object) -> float:
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties)
    return float(properties.Mass())


def occ_perimeter(shape: object) -> float:
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.LinearProperties_s(shape, properties)
    return float(properties.Mass())


def of_ifcopenshell(effort: float) -> list[Compared]:
    """Areas and footprints of the elements of houses."""
    import ifcopenshell
    import ifcopenshell.geom
    import ifcopenshell.util.shape as measures

    areas = Compared("elements of IFC files", "m²")
    footprints = Compared("their footprints", "m²")
    camera = rc.Camera.orthographic(3000, 3000, px_per_m=200)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(amount(HOUSES, effort)):
            path = Path(folder, f"{seed}.ifc")
            path.write_bytes(bungalow(tuple(np.random.default_rng(seed).uniform(-50, 50, 3))))
            mesh, file = rc.Mesh.load(path), ifcopenshell.open(str(path))
            products = {(each.Name or each.GlobalId): each for each in file.by_type("IfcElement")}
            for number, group in enumerate(mesh.groups):
                name = group.name.rpartition("/")[2].replace("∕", "/")
                settings = ifcopenshell.geom.settings()
                shape = ifcopenshell.geom.create_shape(settings, products[name]).geometry
                part = rc.Mesh(mesh.vertices, mesh.faces[mesh.face_group == number])
                above = part.vertices[part.faces].mean(axis=(0, 1)) + np.array((0, 0, 10))
                seen = rc.regions(part, camera, rc.look_at(above, above - (0, 0, 1), up=(0, 1, 0)))
                theirs = measures.get_area(shape), measures.get_footprint_area(shape)
                wrong = areas.add(part.areas.sum(), theirs[0], PRECISION * theirs[0])
                plane = seen.areas()[0] * np.abs(part.normals[:, 2])
                bound = seen.bounds().sum() + PRECISION * theirs[1]
                if wrong | footprints.add(plane.sum(), theirs[1], bound):
                    areas.faults.append(f"house {seed}, {group.name}: {theirs}")
    return [areas, footprints]


COMPARISONS = [
    Comparison("Open CASCADE", "cadquery-ocp", of_occ),
    Comparison("IfcOpenShell", "ifcopenshell", of_ifcopenshell),
]
