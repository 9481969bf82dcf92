"""Surface of a mesh for the exact methods: welded vertices, edges with their faces, contacts.

It depends on the mesh alone, is built once, by `rastercov/engine/solver/build.cpp`, and is kept as
long as the mesh exists.

Blocks are groups of 64 faces that the passes over a surface decide together. A pose sees most
blocks from one side, wholly inside or wholly outside the image, and no event edge near them. What
follows from that for all of their faces is then decided once. Blocks are consecutive faces of the
surface, in the order of the mesh where that is local, as generators and CAD programs write it, or
where the mesh is small; otherwise sorted along a curve that fills space.
"""

from collections.abc import Callable
from typing import Any
from weakref import ref

import numpy as np

from rastercov.base import once_each
from rastercov.core.camera.pose import hides_its_back
from rastercov.core.mesh import Mesh
from rastercov.engine import solver_surface
from rastercov.engine.solver_surface import Surface

LEAST_SORTED = solver_surface.LEAST_SORTED
"""Faces from which on they, and vertices, are sorted: figures of fewer fit the cache in any order.
"""


@once_each
def surface_of(mesh: Mesh, least_sorted: int = LEAST_SORTED) -> Surface:
    """Surface of a mesh, built at the first call: about 0.3 s for a million faces."""
    moved = mesh.moved_from
    if moved is None or not len(moved.poses):
        return _build(mesh, least_sorted)
    rest, own = surface_of(moved.rest.mesh), (*_finder(mesh), _hides_its_back(mesh))
    return rest.moved(mesh.opaque.vertices, mesh.vertices, *own)


def _build(mesh: Mesh, least_sorted: int) -> Surface:
    opaque, is_target = mesh.opaque, mesh.target_mask if mesh.has_targets else np.empty(0, bool)
    return Surface(
        (opaque.vertices, opaque.welded_faces),
        (mesh.vertices, mesh.welded_faces),
        is_target,
        *_finder(mesh),
        least_sorted,
        _hides_its_back(mesh),
    )


def _finder(mesh: Mesh) -> tuple[float, Any]:
    """The diagonal that contacts depend on, and what finds them; it does not keep the mesh."""
    contacts = mesh.opaque.contacts
    return contacts.diagonal, lambda far: (contacts.faces_for(far), *contacts.partners_for(far))


def _hides_its_back(mesh: Mesh) -> Callable[[float], bool]:
    """Test that no camera outside, with no surface within a distance, sees the back of a face."""
    held = ref(mesh)

    def hides(distance: float) -> bool:
        return (mesh := held()) is not None and hides_its_back(mesh, distance)

    return hides
