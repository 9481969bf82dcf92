"""Triangle meshes: arrays, topology, contacts between faces, file formats."""

from rastercov.core.mesh import shapes
from rastercov.core.mesh.groups import Group
from rastercov.core.mesh.mesh import Mesh, MeshSource

__all__ = ["Group", "Mesh", "MeshSource", "shapes"]
