"""Triangle meshes: arrays, topology, contacts between faces, file formats."""

from rastercov.mesh import shapes
from rastercov.mesh.groups import Group
from rastercov.mesh.mesh import Mesh, MeshSource

__all__ = ["Group", "Mesh", "MeshSource", "shapes"]
