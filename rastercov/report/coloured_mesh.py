"""Mesh files with each face in the colour of its coverage."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from rastercov._output import write_bytes
from rastercov.errors import ConfigError
from rastercov.mesh import Mesh
from rastercov.report import theme
from rastercov.report.target_pictures import OPACITY


def write_coloured_mesh(path: str | Path, mesh: Mesh, values: ArrayLike) -> None:
    """Write the mesh, each face in the colour of its coverage, for any 3D viewer.

    Colours run from dark violet over teal to yellow for coverage up to 1; task faces without
    coverage are red, occluders grey-blue. Targets are translucent. Greys would be changed by a
    viewer's light. Faces share no vertices, so that each has one colour.

    Parameters
    ----------
    path : path ending in .glb or .ply
        GLB: one node a group, which a viewer can hide; node matrices turn z up to glTF's y up and
        carry the offset, so that a part far from the origin keeps its shape in float32. Colours
        come from a small texture, because vertex colours are linear light in glTF and not every
        viewer shows them. PLY: unchanged axes, vertex colours, one mesh in the order of
        `mesh.faces`, coordinates in float32.
    mesh : Mesh
        F faces.
    values : (F,) array_like
        Coverage, such as `Network.best`; beyond [0, 1] shown as the nearer end.
    """
    path = Path(path)
    formats = {".glb": _coloured_scene, ".ply": _coloured_soup}
    if path.suffix.lower() not in formats:
        raise ConfigError(f"{path}: a coloured mesh is saved as .glb or .ply")
    content = formats[path.suffix.lower()](mesh, theme.colour_rows(mesh, values))
    write_bytes(path, content.export(file_type=path.suffix.lower()[1:]))


def _coloured_soup(mesh: Mesh, entry: NDArray[np.int64]) -> Any:
    """Separate triangles with vertex colours, in the order of the faces."""
    colours = np.full((mesh.n_faces, 4), 255, np.uint8)
    colours[:, :3] = theme.coverage_colours()[entry]
    colours[mesh.target_mask, 3] = round(255 * OPACITY)
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    corners = np.arange(len(points)).reshape(-1, 3)
    return trimesh.Trimesh(
        points, corners, vertex_colors=np.repeat(colours, 3, axis=0), process=False
    )


def _coloured_scene(mesh: Mesh, entry: NDArray[np.int64]) -> Any:
    """One node a group, turned from z up to y up, with the palette as texture."""
    visual: Any = trimesh.visual  # its classes are not annotated

    def material(name: str, **fields: Any) -> Any:
        return visual.material.PBRMaterial(
            name=name,
            baseColorTexture=Image.fromarray(theme.coverage_colours()[None]),
            metallicFactor=0.0,
            roughnessFactor=1.0,
            doubleSided=True,
            **fields,
        )

    opaque = material("coverage")
    white = [255, 255, 255, round(255 * OPACITY)]
    translucent = material("coverage of targets", alphaMode="BLEND", baseColorFactor=white)
    centre = mesh.bounds.mean(axis=0)
    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)
    turn[:3, 3] = turn[:3, :3] @ centre
    root = "root" + "_" * max(len(group.name) for group in mesh.groups)  # no group has this name
    scene = trimesh.Scene(base_frame=root)
    for index, group in enumerate(mesh.groups):
        members = np.flatnonzero(mesh.face_group == index)
        if members.size:
            points = (mesh.vertices[mesh.faces[members]] - centre).reshape(-1, 3)
            corners = np.arange(len(points)).reshape(-1, 3)
            # The middle of a texel, the same for all three corners: independent of the filter.
            u = (np.repeat(entry[members], 3) + 0.5) / theme.PALETTE
            skin_of = translucent if group.is_target else opaque
            skin = visual.TextureVisuals(np.stack((u, np.full_like(u, 0.5)), axis=1), skin_of)
            part = trimesh.Trimesh(points, corners, visual=skin, process=False)
            scene.add_geometry(part, group.name, group.name, transform=turn)
    return scene
