"""Coverage of each face of a FreeCAD part: a macro, which needs no numpy in FreeCAD.

    freecadcmd examples/freecad_coverage.py

It asks a process of `rastercov serve --stdio` (examples/serve_client.py), a command on the PATH, so
that rastercov may be installed in another Python. Faces of the open document become groups of one
mesh; in the window of FreeCAD covered faces turn green and others red. Without FreeCAD it computes
a box of its own. The tests have stand-ins for FreeCAD; it was tried with 0.20.2.
"""

import shutil
import sys
import tempfile
from operator import add
from pathlib import Path

try:
    import FreeCAD
except ImportError:
    FreeCAD = None
sys.path.insert(0, str(Path(__file__).parent))
from serve_client import Coverage

TOLERANCE = 0.1  # mm between a curved face and its triangles
CAMERA = {"preset": "khepra"}
POSES = 12


class Plane:
    """Rectangle, in place of a face of FreeCAD: its corner and its sides, mm."""

    def __init__(self, corner, first, second):
        second_one = tuple(map(add, corner, first))
        self.points = [corner, second_one, tuple(map(add, second_one, second))]
        self.points.append(tuple(map(add, corner, second)))

    def tessellate(self, tolerance):
        """Points and triangles, as FreeCAD gives them."""
        return self.points, [(0, 1, 2), (0, 2, 3)]


def box():
    """Faces of a box of 40 x 60 x 80 mm, outward."""
    x, y, z, low, high = (40, 0, 0), (0, 60, 0), (0, 0, 80), (0, 0, 0), (40, 60, 80)
    back = [tuple(-each for each in side) for side in (x, y, z)]
    sides = [(low, y, x), (low, x, z), (low, z, y)]
    sides += [(high, back[0], back[1]), (high, back[2], back[0]), (high, back[1], back[2])]
    return {f"Box.Face{k + 1}": Plane(*side) for k, side in enumerate(sides)}


def faces_of(document):
    """Faces of the solids of a document by name, each with what moves it into the world."""
    for item in document.Objects:
        shape = getattr(item, "Shape", None)
        if shape is not None and shape.Solids:
            place = item.getGlobalPlacement().multiply(item.Placement.inverse())
            for k, face in enumerate(shape.Faces):
                yield f"{item.Name}.Face{k + 1}", face, place.multVec


def obj_of(faces):
    """OBJ of (name, face, move), a group for each face, in millimetres."""
    lines, n = [], 1
    for name, face, move in faces:
        points, triangles = face.tessellate(TOLERANCE)
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in map(tuple, map(move, points))]
        lines += [f"g {name}", *(f"f {a + n} {b + n} {c + n}" for a, b, c in triangles)]
        n += len(points)
    return "\n".join(lines) + "\n"


def shares_of(faces, coverage):
    """Covered share of each face, by name, by cameras that `place` chooses around the part."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.obj"
        path.write_text(obj_of(faces), encoding="utf-8")
        plan = {
            "meshes": [{"path": str(path), "unit": "mm"}],
            "camera": CAMERA,
            "candidates": [{"generator": "on_sphere", "count": POSES}],
            "selection": {"goal": "best_coverage", "cameras": 3},
        }
        scene = coverage.ask("open", plan=plan)["scene"]
        poses = coverage.ask("place", scene=scene)["poses"]
        result = coverage.ask("evaluate", scene=scene, poses=poses, summary=True)
    return {each["name"]: each["covered_area"]["percent"] / 100 for each in result["groups"]}


def colour(document, shares):
    """Colour the faces by their shares, red to green, where FreeCAD has a window."""
    for item in document.Objects:
        own = [share for name, share in shares.items() if name.startswith(f"{item.Name}.Face")]
        if own and getattr(item, "ViewObject", None) is not None:
            item.ViewObject.DiffuseColor = [(1.0 - each, each, 0.1, 0.0) for each in own]


def main():
    """Print the share of each face."""
    if FreeCAD and not shutil.which("rastercov"):  # sys.executable is FreeCAD, no Python
        raise OSError("expected the command rastercov on the PATH of FreeCAD, got none")
    document = FreeCAD and FreeCAD.ActiveDocument
    faces = [(name, face, tuple) for name, face in box().items()]
    if document:
        faces = list(faces_of(document))
    coverage = Coverage()
    shares = shares_of(faces, coverage)
    for name, share in shares.items():
        print(f"{name}: {100 * share:.1f} % covered")
    if document:
        colour(document, shares)
    return coverage.close()


if __name__ == "__main__":
    main()
