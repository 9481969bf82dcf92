"""Visibility certificate: regions of faces that are wholly visible or wholly hidden.

Seen from a camera, the set of surfaces before a point changes only across event edges:
silhouette edges, borders, edges of more than two faces, the rims where the near plane clips. Where
something hides such an edge it hides what is behind on both sides, too. A face that no visible part
of an event edge crosses at or before its depth, and that no other face touches or cuts in space, is
wholly visible or wholly hidden, and so are all faces joined to it edge by edge without crossing an
event edge: a region. The half-plane solver computes the largest face of each region; that face,
which must be wholly visible or wholly hidden, classifies its region. A crossed face is divided by
the edges that cross it, see `native/exact/arrangement.cpp`. The cost is proportional to the
silhouettes, not to the faces or the pixels.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import math

import numpy as np

from rastercov.base.memory import BoolArray, Int32Array
from rastercov.camera.camera import Camera
from rastercov.exact.half_planes import HalfPlaneSolver
from rastercov.exact.records import BLOCK, CROSSED, Crossings, Segment
from rastercov.exact.surface import Surface
from rastercov.native.exact_arrangement import MOST_CELLS, arrangement_areas
from rastercov.native.exact_certificate import classify_regions, find_regions, mark_uncertifiable
from rastercov.native.exact_event import ask_for_events, find_event_edges, mark_crossed
from rastercov.native.exact_grid import ask_for_all, ask_for_faces
from rastercov.native.exact_setup import lay_boxes

CERTAIN_AREA_REL = 1e-6
"""Area tolerance when a region's largest face is classified as wholly visible or wholly hidden,
relative to that face. A partial result means that an event edge was missed; the whole region is
then computed face by face."""
CELLS_PER_EVENT = 1
"""Cells of the grid for each event edge from which on faces are listed only where they run."""
MOST_ASKED = 0.5
"""Share of the cells around event edges above which faces are listed in all."""
CROSSING_TOLERANCE_REL = 1e-9
"""Distance up to which an edge that passes a face counts as crossing it, relative to
`HalfPlaneSolver.coordinate_scale`."""
THIN_TOLERANCE_REL = 1e-8
"""Width below which rounding may decide on which side of a face an edge runs, relative to the
same."""


class CertificateSolver(HalfPlaneSolver):
    """Exact visible areas, of most faces by regions.

    Attributes
    ----------
    n_events, n_crossed, n_regions, n_doubtful : int
        Event edges, faces that they cross, regions, and faces of regions that turned out neither
        wholly visible nor wholly hidden.
    """

    _contacts: BoolArray | None = None
    _has_crossings = False

    def __init__(self, surface: Surface, camera: Camera) -> None:
        super().__init__(surface, camera)
        n_edges, n_faces = len(surface.edges.kind), len(surface.faces)
        self._events, self._is_hidden = np.empty(n_edges, np.int32), np.empty(n_edges, np.bool_)
        self._is_at_event = np.empty(len(surface.vertices), np.bool_)
        self._targets = np.empty(n_faces, np.int32)
        n_nodes = len(surface.blocks.lowest) + n_faces
        self._parent, self._region = np.empty((2, n_nodes), np.int32)
        self._scratch, self._decision = np.empty((2, n_faces), np.int32)
        self._make_room_for_crossings(max(1024, n_edges // 16))
        self._segment = Segment(np.empty((2, 4)), np.empty(3, np.int64))

    def solve_all(self) -> None:
        """As of `HalfPlaneSolver`."""
        surface, camera, projected = self.surface, self.camera, self.projected
        n_faces = len(surface.faces)
        if self._left_out is not None and self._left_out[:n_faces].all():
            self.is_certified[:n_faces] = False
            super().solve_all()
            return
        self.visible[n_faces:] = 0.0
        reach = math.dist(camera.centre, surface.centre) + surface.diagonal / 2
        contacts = surface.contacts.faces_for(reach)
        partners = surface.contacts.partners_for(reach)
        self.n_events = find_event_edges(surface.edges, projected, self._is_event, self._events)
        events = self._events[: self.n_events]
        mark_uncertifiable(
            events, surface.edges, projected, contacts, self._blocks_in(contacts), partners.starts,
            THIN_TOLERANCE_REL * self.coordinate_scale, self._is_at_event,
        )  # fmt: skip
        self._list_around(events)
        if self._has_crossings:  # a pose was left before its end
            self._crossings.last.fill(-1)
        self._has_crossings = True
        while True:
            n_crossings = mark_crossed(
                events, surface.vertices, self._view(projected), self._extent,
                CROSSING_TOLERANCE_REL * self.coordinate_scale, self.n_clipped, self._segment,
                self._crossings, self._is_hidden,
            )  # fmt: skip
            if n_crossings <= len(self._crossings.edge):
                break
            self._make_room_for_crossings(2 * n_crossings)
        self.n_crossed, self.n_regions = find_regions(
            events, self._is_hidden, self._view(projected), self._parent, self._region,
            self._targets,
        )  # fmt: skip
        crossed = self._targets[: self.n_crossed]
        targets = np.concatenate((self._measured(crossed), self.largest_of_regions()))
        lay_boxes(targets, projected)
        if ask_for_faces(targets, projected.box, self.grid):
            self._list_faces()
        if len(self._pieces.corners) < MOST_CELLS:
            self._make_room_for_pieces(MOST_CELLS)
        while True:
            n_left = arrangement_areas(
                targets, self._crossings, partners, self._view(projected), self._pieces,
                self._scratch,
            )  # fmt: skip
            if not self._grow_kept():
                break
            self._work.kept.used[:] = 0
        # The next pose starts without crossings; only faces among the targets have any.
        self._crossings.last[self._targets[: self.n_crossed + self.n_regions]] = -1
        self._has_crossings = False
        self._limit_errors(targets)
        self._left = self._scratch[:n_left].copy()
        self.solve(self._left)
        self.n_doubtful = classify_regions(
            projected, self.visible, self._region, self.largest_of_regions(),
            self._decision[: self.n_regions], self.is_certified[:n_faces], self._scratch,
            CERTAIN_AREA_REL,
        )  # fmt: skip
        self._is_listed = self.n_doubtful == 0
        self.solve(self._measured(self._scratch[: self.n_doubtful]))

        self.solve_targets()

    @property
    def n_left(self) -> int:
        """Crossed faces that are left to half planes."""
        return int(np.count_nonzero(self.state[self._left] & CROSSED))

    def _blocks_in(self, contacts: BoolArray) -> BoolArray:
        """(N,) blocks with a face in contact."""
        if contacts is not self._contacts:
            n_blocks = len(self.surface.blocks.has_flat)
            self._contacts, self._has_contact = contacts, np.zeros(n_blocks, np.bool_)
            self._has_contact[np.flatnonzero(contacts) // BLOCK] = True
        return self._has_contact

    def _list_around(self, events: Int32Array) -> None:
        """List the faces in the cells around event edges, or in all cells if these are not few."""
        n_cells = self.grid.columns * self.grid.rows
        are_few = self.n_clipped == 0 and CELLS_PER_EVENT * len(events) <= n_cells
        if not are_few or not ask_for_events(
            events, self.surface.edges, self.surface.vertices, self.camera, self.projected,
            CROSSING_TOLERANCE_REL * self.coordinate_scale, self.grid, self._segment,
        ) or self.grid.n_fresh[0] > MOST_ASKED * n_cells:  # fmt: skip
            ask_for_all(self.grid)
        self._list_faces()

    def _make_room_for_crossings(self, n: int) -> None:
        last = np.full(len(self.surface.faces), -1, np.int32)
        before, edge = np.empty((2, n), np.int32)
        self._crossings = Crossings(last, before, edge, np.empty((n, 7)))

    def largest_of_regions(self) -> Int32Array:
        """(n_regions,) face of each region that was computed for all of it."""
        return self._targets[self.n_crossed : self.n_crossed + self.n_regions].copy()
