"""The certificate: where visibility cannot change, and one question for all of it.

Seen from a camera, the number of surfaces before a point changes only across edges that do not
have one face on either side: contours, borders, edges of more than two faces, the rims where the
near plane cuts. A face that no such edge crosses at or before its depth, and that no other face
touches or cuts in space, is seen whole or not at all. So are all faces that are joined to it, edge
by edge, without crossing such an edge: a patch. The largest face of each patch is measured by
`analytic`, and so are all faces that are crossed; its answer, which must be all or nothing, is
that of its patch. The cost goes with the contours, not with the faces or the pixels. The loops are
in `contour_kernels`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import numpy as np
from numpy.typing import NDArray

from rastercov._jit import announce_compilation, compiled_aside
from rastercov._once import Once
from rastercov.camera import Camera
from rastercov.exact import certificate_kernels as kernels
from rastercov.exact import half_plane_kernels as analytic_kernels
from rastercov.exact.half_planes import View
from rastercov.exact.surface import Surface, surface_of
from rastercov.raster import self_test as canary

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]

SURE = 1e-6
"""Part of the largest face of a patch up to which rounding may make all or nothing of it; one that
is seen in part shows an edge that was missed, and all faces of its patch are measured."""
NEAR_MISS = 1e-9
"""Of `View.grain`: a face that an edge passes closer than this counts as crossed."""
THINNEST = 1e-8
"""Of the same: width below which rounding may decide on which side of a face an edge runs."""


ELSEWHERE = """
import numpy as np
from rastercov.mesh.contacts import touching_faces
from rastercov.raster.self_test import CAMERA, MESH
from rastercov.raster.cpu import CPURasterizer
touching_faces(np.eye(3), np.array([(0, 1, 2), (0, 2, 1)]), 1e-9)
CPURasterizer(MESH, CAMERA)
"""
"""Compiles about half of all loops: those of the contacts, and of the rasteriser for pictures."""


_COMPILED: Once[None] = Once()


def compile_once() -> None:
    """Compile all loops, in two processes side by side, where no earlier run left them on disk.

    Threads that call it while one of them compiles wait until that is done.
    """
    _COMPILED.get(_compile)


def _compile() -> None:
    if announce_compilation(analytic_kernels.visible_areas):
        surface, pose = surface_of(canary.MESH), canary.POSES[0]
        with compiled_aside(ELSEWHERE):
            view = View(surface, canary.CAMERA)
            view.look(pose, 1e-3, False)
            view.measure_all()
        certified = CertifiedView(surface, canary.CAMERA)
        certified.look(pose, 1e-3, False)
        certified.measure_all()


class CertifiedView(View):
    """A view that finds what is seen of every face by patches.

    Attributes
    ----------
    patch : (F,) int32
        Number of the patch that decides over each face, -1 for none.
    n_jumps, n_crossed, n_patches, n_doubtful : int
        Edges where visibility may change, faces that they cross, patches, and faces of patches
        that came out neither seen nor hidden.
    """

    def __init__(self, surface: Surface, camera: Camera) -> None:
        super().__init__(surface, camera)
        n_edges, n_faces = len(surface.edge_turn), len(surface.faces)
        self._is_jump, self._jumps = np.empty(n_edges, np.bool_), np.empty(n_edges, np.int32)
        self._is_at_jump = np.empty(len(surface.vertices), np.bool_)
        self.patch, self._targets = np.empty(n_faces, np.int32), np.empty(n_faces, np.int32)
        self._scratch = np.empty(n_faces, np.int32)

    def measure_all(self) -> None:
        """Put what is seen of every face into `visible`."""
        surface = self.surface
        away = float(np.linalg.norm(self.eye - surface.centre))
        contacts = surface.contacts.faces_for(away + surface.diagonal / 2)
        self.n_jumps = kernels.find_jumps(
            surface.edge_faces, surface.edge_turn, self.side, self.state, self._is_jump, self._jumps
        )
        kernels.mark_unfit(
            self._jumps, self.n_jumps, surface.edge_vertices, surface.faces, self.state, self.box,
            self.area, contacts, THINNEST * self.grain, self._is_at_jump,
        )  # fmt: skip
        kernels.mark_crossed(
            self._jumps, self.n_jumps, surface.edge_vertices, surface.vertices, surface.faces,
            self.rotation, self.eye, self.lens, self.near, self.pyramid, self.uvw, self.side,
            self.state, self.box, self.slot, self.polygons, self.n_corners, self.planes, self.grid,
            self.columns, self.rows, self.starts, self.listed, self.region,
            NEAR_MISS * self.grain, self.n_cut > 0,
        )  # fmt: skip
        self.n_crossed, self.n_patches = kernels.find_patches(
            surface.face_edges, surface.edge_faces, surface.edge_turn, surface.edge_vertices,
            self._is_jump, self.uvw, self.size, self.state, self.area, self.patch, self._scratch,
            self._targets,
        )  # fmt: skip
        self.measure(self._targets[: self.n_crossed + self.n_patches])
        self.n_doubtful = kernels.decide(
            self.patch, self._targets, self.n_crossed, self.n_patches, self.area, self.visible,
            self._scratch, SURE,
        )  # fmt: skip
        self.measure(self._scratch[: self.n_doubtful])

        self.is_certified = self.patch >= 0

    def largest_of_patches(self) -> IntArray:
        """(n_patches,) the face of each patch that was measured for all."""
        return self._targets[self.n_crossed : self.n_crossed + self.n_patches].copy()
