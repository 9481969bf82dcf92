"""The command `groups`: groups, parts and rooms of mesh files, by the names that options take."""

import numpy as np
from rich.table import Table

from rastercov.base import ByName, FloatArray, json_text, plural
from rastercov.base.format import area, size_in_words
from rastercov.cli import options
from rastercov.cli.console import print_lines, size_line, warn
from rastercov.cli.inputs import SceneOptions
from rastercov.cli.terminal import print_rows
from rastercov.core.mesh.groups import at_level
from rastercov.core.mesh.mesh import Mesh


@options.expand_options
def groups(
    meshes: options.Meshes,
    scene: SceneOptions,
    level: options.Level = None,
    as_json: options.AsJson = False,
) -> None:
    """List groups, parts (such as storeys) and rooms of mesh files.

    Their names are those of --occluder, --of, --group and plan files.

    Example: rastercov groups house.ifc --level 1
    """
    mesh = scene.read(meshes)
    warn(*mesh.warnings)
    rows = _rows(mesh, level)
    rooms = [
        {"name": product.label, "global_id": product.global_id} | _box(inside.vertices)
        for product, inside in mesh.spaces
    ]
    if as_json:
        print(json_text({"groups": rows, "rooms": rooms}))
        return
    _print("group" if level is None else "part", rows)
    _print("room", rooms)
    print_lines(size_line(mesh))


def _rows(mesh: Mesh, level: int | None) -> list[ByName]:
    """Entries of groups, or of the parts of the first levels of their names."""
    numbers: dict[str, list[int]] = {}
    for row, group in enumerate(mesh.groups):
        numbers.setdefault(at_level(group.name, level), []).append(row)
    entries = []
    for name, own in numbers.items():
        faces = np.isin(mesh.face_group, own)
        roles = sorted({mesh.groups[row].role for row in own})
        entry: ByName = {
            "name": name,
            "role": " and ".join(roles),
            "groups": len(own),
            "faces": int(faces.sum()),
            "area_m2": float(mesh.areas[faces].sum()),
        }
        entries.append(entry | _box(mesh.vertices[mesh.faces[faces]].reshape(-1, 3)))
    return entries


def _box(points: FloatArray) -> ByName:
    """Ends of a box around points (N, 3), metres; of 0 around none."""
    ends = (points.min(axis=0), points.max(axis=0)) if len(points) else np.zeros((2, 3))
    return {"low": ends[0].tolist(), "high": ends[1].tolist()}


def _print(kind: str, rows: list[ByName]) -> None:
    """Print entries of a kind as a table, and their number."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    has_faces = kind != "room"
    for heading in (kind, *("role", "faces", "area") * has_faces, "size", "bottom, m"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        size = size_in_words(np.subtract(row["high"], row["low"]))
        of_faces = (row["role"], f"{row['faces']:,}", area(row["area_m2"])) if has_faces else ()
        table.add_row(row["name"], *of_faces, size, f"{row['low'][2]:.2f}")
    if rows:
        print_rows(table)
    print_lines(plural(len(rows), kind))
