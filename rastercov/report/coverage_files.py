"""Files of an evaluation: the rig, and coloured meshes; `tables` has those of Parquet.

An error of the disk is an `OSError` that names the file.
"""

import dataclasses
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from rastercov.base import (
    AnyArray,
    ByName,
    FloatArray,
    IntArray,
    owners_of,
    write_bytes,
    write_json,
)
from rastercov.core.area.union import Covered, with_rest
from rastercov.core.camera import Cameras, Poses, Rig, Views, cameras_of, names_of_poses
from rastercov.core.mesh import Mesh
from rastercov.formats.cameras.own import content_of
from rastercov.formats.meshes.gltf_file import Y_UP, GlbBuffer
from rastercov.report import theme
from rastercov.report.images import png

INSTALL_PYARROW = "pip install 'rastercov[tables]'"
"""Command that brings pyarrow, which tables need."""
OPACITY = 0.4
"""Of targets in coloured meshes."""
MOST_POSES = 5_000
"""Poses up to which a result has the file: about 3 MB."""


def has_parquet() -> bool:
    """True where pyarrow is installed, which `rastercov.report.parquet` needs."""
    return find_spec("pyarrow") is not None


def write_rig(
    path: Path, camera: Cameras, poses: Poses, names: Sequence[str] = (), unit: str = "m"
) -> None:
    """Write the cameras and poses of a result; nothing for more than `MOST_POSES`.

    `names` are those of the images, as of `names_of_poses` unless given; `unit` is "unit" where
    lengths have no scale.
    """
    if 0 < len(poses) <= MOST_POSES:
        write_json(path, content_of(views_of(camera, poses, names, unit)))


def views_of(camera: Cameras, poses: Poses, names: Sequence[str] = (), unit: str = "m") -> Views:
    """Poses of a result with their cameras; names of images and unit as for `write_rig`."""
    used = np.unique(poses.camera).tolist()
    rig = (camera if isinstance(camera, Rig) else Rig(cameras_of(camera)))._only(used)
    index = np.searchsorted(used, poses.camera)
    placed = dataclasses.replace(poses, camera=index.astype(np.int32), rejected={})
    images = tuple(names) or names_of_poses(poses)
    return Views(rig=rig, poses=placed, images=images, has_unit=unit == "m")


Addition = Callable[[GlbBuffer, list[ByName], list[int]], ByName]
"""Adds to the buffer of a file, its nodes and the roots of its scene; gives further entries."""


def write_coloured_mesh(path: str | Path, mesh: Mesh, values: ArrayLike) -> None:
    """Write the mesh as GLB, each face in the colour of its coverage, for any 3D viewer.

    Colours run from dark violet over teal to yellow for coverage up to 1; evaluated faces without
    coverage are red, occluders grey-blue. Targets are translucent. Greys would be changed by a
    viewer's light. Faces share no vertices, so that each has one colour.

    One node a group, which a viewer can hide; node matrices turn z up to glTF's y up and carry the
    offset, so that a part far from the origin keeps its shape in float32. Colours come from a small
    texture, because vertex colours are linear light in glTF and not every viewer shows them.

    Parameters
    ----------
    path : path
        Of the file.
    mesh : Mesh
        F faces.
    values : (F,) array_like
        Coverage, such as `Network.best`; beyond [0, 1] shown as the nearer end.
    """
    rows = theme.colour_rows(mesh, values)
    write_bytes(path, _glb(mesh, mesh.vertices[mesh.faces], mesh.face_group, rows))


def write_covered_mesh(
    path: str | Path, covered: Covered, additions: Sequence[Addition] = ()
) -> None:
    """Write the exact parts of the faces that cameras cover, and the rest of the mesh.

    What no camera covers is red; what they cover runs from violet to yellow with the number of
    cameras, yellow for all that are required; occluders are grey-blue.

    Parameters
    ----------
    path : path
        Of the file, as for `write_coloured_mesh`.
    covered : Covered
        Of the mesh.
    additions : sequence of Addition
        Of features.
    """
    mesh, parts = covered.mesh, with_rest(covered)
    counts = np.diff(parts.starts)
    # A fan of triangles from the first corner of each piece.
    of_piece = owners_of(counts - 2)
    step = np.arange(len(of_piece)) - np.repeat((counts - 2).cumsum() - (counts - 2), counts - 2)
    first = parts.starts[:-1][of_piece]
    triangles = parts.points()[np.stack((first, first + step + 1, first + step + 2), axis=1)]
    is_other = ~mesh.task_mask
    entry = theme.level_rows(parts.views[of_piece] / len(parts.area))
    content = _glb(
        mesh,
        np.concatenate([triangles, mesh.vertices[mesh.faces[is_other]]]),
        np.concatenate([mesh.face_group[parts.face[of_piece]], mesh.face_group[is_other]]),
        np.concatenate([entry, np.full(is_other.sum(), theme.OCCLUDER_ROW)]),
        additions,
    )
    write_bytes(path, content)


def _glb(
    mesh: Mesh,
    triangles: FloatArray,
    group_of: AnyArray,
    entry: IntArray,
    additions: Sequence[Addition] = (),
) -> bytes:
    """One node a group, turned from z up to y up, with the palette as texture."""
    buffer = GlbBuffer()
    texture = png(Image.fromarray(theme.coverage_colours()[None]))
    shine = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    faint = shine | {"baseColorFactor": [1.0, 1.0, 1.0, OPACITY]}
    opaque = {"name": "coverage", "pbrMetallicRoughness": shine, "doubleSided": True}
    transparent = {"name": "coverage of targets", "pbrMetallicRoughness": faint}
    centre = mesh.centre
    turn = Y_UP.copy()
    turn[:3, 3] = turn[:3, :3] @ centre
    nodes: list[ByName] = []
    meshes: list[ByName] = []
    for index, group in enumerate(mesh.groups):
        members = np.flatnonzero(group_of == index)
        if not members.size:
            continue
        points = (triangles[members] - centre).reshape(-1, 3).astype(np.float32)
        # The middle of a texel, the same for all three corners: independent of the filter.
        uv = np.full((len(points), 2), 0.5, np.float32)
        uv[:, 0] = (np.repeat(entry[members], 3) + 0.5) / theme.PALETTE
        primitive = {
            "attributes": {"POSITION": buffer.add(points), "TEXCOORD_0": buffer.add(uv)},
            "material": int(group.is_target),
        }
        node = {"name": group.name, "mesh": len(meshes)}
        nodes.append(node | {"matrix": turn.T.ravel().tolist()})
        meshes.append({"name": group.name, "primitives": [primitive]})
    roots, more = list(range(len(nodes))), ByName()
    for add in additions:
        more |= add(buffer, nodes, roots)
    return buffer.file(
        more
        | {
            "scene": 0,
            "scenes": [{"nodes": roots}],
            "nodes": nodes,
            "meshes": meshes,
            "materials": [opaque, opaque | transparent | {"alphaMode": "BLEND"}],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{}],
            "images": [{"bufferView": buffer.add_bytes(texture), "mimeType": "image/png"}],
        }
    )
