r"""Exact visible areas by half planes: the part of each face's image that no other face hides.

In the image 1/z is affine on a face, so the part of face T that face M hides is the convex polygon
T n M n {1/z_M > 1/z_T}, and

    visible(T) = T \ U_M T n M n {1/z_M > 1/z_T}.

No depth sorting is needed: faces that overlap cyclically or pierce one another are correct.
Surfaces at equal depth coincide, and the face with the lower index is visible. Targets hide
nothing, and nothing at their depth hides them. The loops are in `rastercov/native/exact`:
`setup.cpp`, `grid.cpp`, which lists the faces near a place of the image, and `half_plane.cpp`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import BoolArray, FloatArray, Int32Array
from rastercov.camera.camera import Camera
from rastercov.exact.records import (
    CORNERS,
    LIVE,
    PIECE_ROOM,
    SIDES,
    SPARE_ENTRIES,
    STACK_ROOM,
    THIN,
    TRANSPARENT,
    Blocks,
    CellGrid,
    Clipped,
    Pieces,
    Pinhole,
    Projected,
    View,
    VisiblePieces,
    Work,
)
from rastercov.exact.surface import Surface, Targets
from rastercov.native.exact_arrangement import MOST_INTERSECTIONS
from rastercov.native.exact_grid import BUCKETS, NOT_ASKED, ask_for_all, ask_for_faces, fill_grid
from rastercov.native.exact_half_plane import visible_areas
from rastercov.native.exact_setup import (
    CLIP_MARGIN,
    OUTLINE_ERROR_FACTOR,
    UNIT_ROUNDING,
    lay_boxes,
    project,
    set_up,
    set_up_plain,
)

MOST_CELLS = 1 << 14
"""Columns, or rows, of the grid."""
LEAST_EXTENT = 1e-100
"""Pixels; width and height that the grid covers at least."""
CELLS_PER_FACE = 1
"""Cells of the grid for each face, unless that makes more entries than `ENTRIES_PER_FACE`."""
ENTRIES_PER_FACE = 3


OF_CELLS = {
    "asked": np.uint8, "is_near": np.bool_, "fresh": np.int32, "starts": np.int64,
    "stops": np.int64, "is_sorted": np.bool_, "has_bounds": np.bool_, "hider": np.int32,
}  # fmt: skip
"""Arrays of a grid with a value for each cell."""


def _room_for_cells(n: int) -> dict[str, Any]:
    return {name: np.empty(n, dtype) for name, dtype in OF_CELLS.items()}


def _room_for_entries(n: int) -> dict[str, Any]:
    spare = n + SPARE_ENTRIES
    bounds, pairs = np.empty((6, spare)), np.empty((spare, 2), np.int32)
    entries, nearest = np.empty(n, np.int32), np.empty(n)
    return {"entries": entries, "nearest": nearest, "bounds": bounds, "pairs": pairs}


def first_grid(n_faces: int) -> CellGrid:
    """Grid for a mesh, of no cells yet."""
    n_fresh, n_entries, n_listed = np.zeros((3, 1), np.int64)
    faces, found = np.empty((2, n_faces), np.int32)
    return CellGrid(
        left=0.0, top=0.0, per_u=1.0, per_v=1.0, columns=1, rows=1, n_fresh=n_fresh,
        fresh_bits=np.empty((0, 0), np.uint64), n_entries=n_entries, n_faces=n_listed, faces=faces,
        found=found, buckets=np.empty(BUCKETS + 1, np.int64), is_whole=np.zeros(n_faces, np.bool_),
        **_room_for_cells(0), **_room_for_entries(2 * n_faces),
    )  # fmt: skip


def grid_over(grid: CellGrid, n_live: int, extent: NDArray[np.float64]) -> CellGrid:
    """Lay the grid over the live faces, of as many cells as the entries of large ones allow.

    No cell of it is asked for, and no face listed.

    Parameters
    ----------
    grid : CellGrid
        The grid of the last pose; its memory is used again.
    n_live : int
        Faces with an image.
    extent : (7,) float64
        Left, right, top and bottom of their boxes, px, and sums of the widths, heights and areas of
        these; not looked at without faces.
    """
    limits = extent if n_live else np.array((0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    left, right, top, bottom, widths, heights, areas = limits.tolist()
    wide, high = max(right - left, LEAST_EXTENT), max(bottom - top, LEAST_EXTENT)
    cells = CELLS_PER_FACE * n_live + 1.0
    while True:
        columns = int(min(max(1.0, math.sqrt(cells * (wide / high))), MOST_CELLS))
        rows = int(min(max(1.0, cells / columns), MOST_CELLS))
        per_u, per_v = columns / wide, rows / high
        # A box w wide and h high touches (1 + w per_u)(1 + h per_v) cells, on average.
        entries = n_live + widths * per_u + heights * per_v + areas * per_u * per_v
        if entries <= ENTRIES_PER_FACE * n_live or columns * rows == 1:
            break
        cells /= 2
    n_cells, fresh_bits = columns * rows, np.zeros((rows, (columns + 63) // 64), np.uint64)
    grid = grid._replace(
        left=left, top=top, per_u=per_u, per_v=per_v, columns=columns, rows=rows,
        fresh_bits=fresh_bits,
    )  # fmt: skip
    if len(grid.is_sorted) < n_cells:
        grid = grid._replace(**_room_for_cells(n_cells))
    grid.asked[:n_cells], grid.is_near[:n_cells] = NOT_ASKED, False
    grid.n_fresh[0] = grid.n_entries[0] = 0
    return grid


def with_room(grid: CellGrid, room: int) -> CellGrid:
    """Return the grid with the entries it has, and room for a number of them."""
    n, more = int(grid.n_entries[0]), _room_for_entries(room)
    for name in ("entries", "nearest", "bounds"):
        more[name][..., :n] = getattr(grid, name)[..., :n]
    return grid._replace(**more)


class TargetImage(NamedTuple):
    """Image of the targets of a surface.

    Attributes
    ----------
    everything : Projected
        Opaque faces and then targets, without blocks; it shares the memory of both parts.
    own : Projected
        The targets, with their own vertices.
    """

    everything: Projected
    own: Projected

    def beside(self, opaque: Projected, own: Projected) -> "TargetImage":
        """The same after a set-up: `everything` gets the vertices and clipped faces of both."""
        joined, n_clipped = self.everything, len(opaque.clipped.polygons)
        n_vertices = len(opaque.uvw)
        joined.uvw[:n_vertices], joined.uvw[n_vertices:] = opaque.uvw, own.uvw
        joined.state[len(opaque.faces) :] |= TRANSPARENT
        joined.clipped_index[len(opaque.faces) :] += n_clipped
        both = zip(opaque.clipped, own.clipped, strict=True)
        clipped = Clipped(*(np.concatenate(pair) for pair in both))
        return TargetImage(joined._replace(clipped=clipped), own)


def room_for_image(surface: Surface, area: FloatArray) -> Projected:
    """Memory for the image of all faces of a surface, the opaque ones first."""
    n_all, vertices, faces = surface.n_faces, surface.vertices, surface.faces
    if surface.targets is not None:
        faces = np.concatenate((faces, surface.targets.faces + np.int32(len(vertices))))
        vertices = np.concatenate((vertices, surface.targets.vertices))
    uvw = np.empty((len(vertices) + SPARE_ENTRIES, 3))[: len(vertices)]
    state = np.empty(n_all + SPARE_ENTRIES, np.uint16)[:n_all]
    return Projected(
        faces=faces, rank=surface.rank, uvw=uvw, side=np.empty(n_all, np.int8), state=state,
        box=np.empty((n_all, 6)), area=area, clipped_index=np.zeros(n_all, np.int32),
        clipped=room_for_clipped(8), **_room_for_blocks(surface.blocks),
    )  # fmt: skip


def _room_for_blocks(blocks: Blocks) -> dict[str, Any]:
    n = len(blocks.has_flat)
    state, side = np.empty(n, np.uint16), np.empty(n, np.int8)
    its = {"block_box": np.empty((n, 4)), "block_state": state, "block_side": side}
    return {"blocks": blocks, "has_boxes": np.empty(n, np.bool_), **its}


def part_of(everything: Projected, part: slice, faces: Int32Array, blocks: Blocks) -> Projected:
    """Image of a part of all faces, with its own vertices, clipped faces and blocks."""
    own = {
        name: getattr(everything, name)[part]
        for name in ("side", "state", "box", "area", "clipped_index")
    }
    uvw = np.empty((int(faces.max(initial=-1)) + 1, 3))
    return everything._replace(
        faces=faces, uvw=uvw, clipped=room_for_clipped(8), **own, **_room_for_blocks(blocks)
    )


def set_up_image(
    surface: Surface | Targets,
    camera: Pinhole,
    front_only: bool,
    projected: Projected,
    area_error: FloatArray,
    extent: FloatArray,
) -> tuple[Projected, int, int]:
    """Project and set up faces; the image, with room for clipped faces, live and clipped ones."""
    n_out = project(surface.vertices, camera, projected.uvw)
    rest = np.empty(len(surface.blocks.has_flat), np.int32)
    n_plain, n_rest = set_up_plain(camera, front_only, n_out, projected, area_error, extent, rest)
    while True:
        n_live, n_clipped = set_up(
            surface.vertices, surface.flat, rest[:n_rest], camera, front_only, projected,
            area_error, extent,
        )  # fmt: skip
        if n_clipped <= len(projected.clipped.polygons):
            return projected, n_plain + n_live, n_clipped
        projected = projected._replace(clipped=room_for_clipped(n_clipped))


def border_of(width: float, height: float) -> FloatArray:
    """(4, 5) sides of the image as lines, clockwise from the top left corner."""
    corners = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
    return np.column_stack((corners, np.roll(corners, -1, axis=0) - corners, np.zeros(4)))


def room_for_pieces(n: int, corners: int) -> Pieces:
    """Memory for n pieces of a number of corners each."""
    return Pieces(np.empty((n, corners, 2)), np.empty(n, np.int64))


def room_for_kept(n: int, corners: int) -> VisiblePieces:
    """Memory for n pieces of a number of corners together."""
    starts, faces = np.zeros(n + 1, np.int64), np.empty(n, np.int32)
    return VisiblePieces(np.empty((corners, 2)), starts, faces, np.zeros(3, np.int64))


def room_for_clipped(n: int) -> Clipped:
    """Memory for n faces that are clipped in space."""
    polygons, lines = np.empty((n, CORNERS, 2)), np.empty((n, SIDES, 5))
    return Clipped(polygons, np.empty(n, np.int32), lines, np.empty((n, 7)))


MOST_RANGES = 16
"""Visible parts of an event edge in a cell that are kept apart."""


@lru_cache(maxsize=64)
def pinhole_of(camera: Camera) -> tuple[Pinhole, float]:
    """Record of a pinhole, at the origin, and the largest number that positions come from, px."""
    width, height = float(camera.width), float(camera.height)
    fx, fy, cx, cy = map(float, (camera.fx, camera.fy, camera.cx, camera.cy))
    # Off the axis, rounding of z moves a point in proportion to its distance from the axis.
    across, down = max(cx, width - cx), max(cy, height - cy)
    steep = max(width * width / fx, height * height / fy, across * across / fx, down * down / fy)
    scale = max(width, height, fx, fy, abs(cx), abs(cy), steep)
    x, y = 1.5 * across / fx, 1.5 * down / fy
    longest_ray = math.sqrt(1.0 + x * x + y * y)
    (u_min, u_max), (v_min, v_max) = (
        (-CLIP_MARGIN * side - 1, (1 + CLIP_MARGIN) * side + 1) for side in (width, height)
    )
    pinhole = Pinhole(
        np.eye(3), np.zeros(3), 1.0, fx, fy, cx, cy, width, height, u_min, u_max, v_min, v_max,
        longest_ray=longest_ray,
        pixel_error=UNIT_ROUNDING * scale,
        w_error_rel=UNIT_ROUNDING * (longest_ray / 2),
        border=border_of(width, height),
    )  # fmt: skip
    return pinhole, scale


class HalfPlaneSolver:
    """Exact visible areas of a surface, one pose at a time, with the scratch memory of one thread.

    Arrays have the opaque faces first and then the targets: `Surface.rows` puts them in the order
    of the mesh.

    Attributes
    ----------
    area, visible : (F,) float64
        Area of each face inside the image, and the visible part of it, px^2.
    area_error : (F,) float64
        Bound of the errors of both together, px^2, of the faces that were solved.
    state, side : (O,) uint16, int8
        Of the opaque faces, see `records.Projected`.
    is_certified : (F,) bool
        Faces known to be wholly visible or wholly hidden.
    n_clipped : int
        Faces that were clipped in space.
    coordinate_scale : float
        Largest number that image positions are computed from, pixels: rounding is relative to it.
    """

    _left_out: BoolArray | None = None

    def __init__(self, surface: Surface, camera: Camera) -> None:
        self.surface = surface
        n_faces, n_all = len(surface.faces), surface.n_faces
        self.set_camera(camera)
        self.area, self.visible, self.area_error = np.empty((3, n_all))
        self.is_certified: BoolArray = np.zeros(n_all, np.bool_)
        self._marks, self._extent = np.zeros(n_faces + 1, np.int32), np.empty(7)
        self._is_event = np.empty(len(surface.edges.kind), np.bool_)
        self.projected = room_for_image(surface, self.area)
        self._target_image = None
        if surface.targets is not None:
            everything = self.projected
            self.projected = part_of(everything, slice(0, n_faces), surface.faces, surface.blocks)
            targets = surface.targets
            its_image = part_of(everything, slice(n_faces, n_all), targets.faces, targets.blocks)
            self._target_image = TargetImage(everything, its_image)
        self.side, self.state = self.projected.side, self.projected.state
        self.grid = first_grid(n_faces)
        self._is_listed = False
        self._make_room_for_pieces(64)
        spare, other = np.empty((2, PIECE_ROOM, 2))
        self._work = Work(
            target=np.empty((2 * CORNERS, 2)), own=np.empty((SIDES, 5)),
            corners=np.empty((CORNERS, 2)), lines=np.empty((SIDES + 1, 5)), spare=spare,
            other=other, values=np.empty(PIECE_ROOM), ranges=np.empty((MOST_RANGES, 2)),
            cell=np.empty((4, 5)), parts=room_for_pieces(STACK_ROOM, 2 * CORNERS),
            levels=np.empty(STACK_ROOM, np.int64),
            intersections=np.empty((MOST_INTERSECTIONS, 7)), kept=room_for_kept(0, 0),
        )  # fmt: skip

    def set_camera(self, camera: Camera) -> None:
        """Take another camera, for the poses from now on."""
        self.camera, self.coordinate_scale = pinhole_of(camera)

    def set_surface(self, surface: Surface) -> None:
        """Take a surface that differs in positions and contacts alone, with the same memory."""
        self.surface = surface

    def leave_out(self, faces: BoolArray | None) -> None:
        """Measure some opaque faces no more, (F,) bool in the order of the mesh; None for none.

        They hide what they hid. Their visible area is 0 from now on, within their area in the
        image.
        """
        self._left_out = None
        if faces is not None:
            self._left_out = np.zeros(self.surface.n_faces, np.bool_)
            self._left_out[self.surface.rows] = faces

    def keep_pieces(self) -> None:
        """Keep the visible pieces of all faces that are partly visible from now on."""
        self._work = self._work._replace(kept=room_for_kept(1024, 8192))

    @property
    def kept_pieces(self) -> VisiblePieces:
        """Pieces of the faces solved since `set_pose`; wholly visible faces have none."""
        return self._work.kept

    @property
    def image_of_all(self) -> Projected:
        """Image of the opaque faces and then of the targets."""
        return self.projected if self._target_image is None else self._target_image.everything

    def write_to(self, visible: FloatArray, area: FloatArray, area_error: FloatArray) -> bool:
        """Take (F,) arrays for the figures of the poses from now on; False if it keeps its own.

        It keeps its own where the faces of the surface are in another order than in the mesh.
        """
        if self.surface.place is not None:
            return False
        self.visible, self.area, self.area_error = visible, area, area_error
        self.projected = self.projected._replace(area=area)
        return True

    def set_pose(self, pose: FloatArray, near: float, front_only: bool) -> None:
        """Project, set up and list the faces of one pose.

        Parameters
        ----------
        pose : (4, 4) float64
            world_from_camera.
        near : float
            Depth of the near plane, metres.
        front_only : bool
            Faces seen from behind neither hide nor are visible.
        """
        surface = self.surface
        self.camera = self.camera._replace(
            rotation=np.ascontiguousarray(pose[:3, :3]), centre=pose[:3, 3].copy(), near=float(near)
        )
        n_faces = len(surface.faces)
        self.projected, n_live, self.n_clipped = set_up_image(
            surface, self.camera, bool(front_only), self.projected, self.area_error[:n_faces],
            self._extent,
        )  # fmt: skip
        if self._target_image is not None and surface.targets is not None:
            its_image, *_ = set_up_image(
                surface.targets, self.camera, False, self._target_image.own,
                self.area_error[n_faces:], np.empty(7),
            )  # fmt: skip
            lay_boxes(np.arange(len(its_image.blocks.patch), dtype=np.int32), its_image)
            self._target_image = self._target_image.beside(self.projected, its_image)
        self._work.kept.used[:] = 0
        self.grid = grid_over(self.grid, n_live, self._extent)
        self._is_listed = False

    def solve_pose(self, camera: Camera, pose: FloatArray, near: float, front_only: bool) -> None:
        """Compute all figures of every face; see `set_pose`."""
        self.set_camera(camera)
        self.set_pose(pose, near, front_only)
        self.solve_all()

    def solve(self, targets: Int32Array) -> None:
        """Compute `visible` and `area_error` of some opaque faces, given by index."""
        if len(targets):
            if not self._is_listed:
                ask_for_all(self.grid)
                self._list_faces()
            self._run(targets, self.projected)

    def solve_all(self) -> None:
        """Compute `visible`, `area_error` and `is_certified` of every face."""
        self.visible.fill(0.0)
        self.solve(self._measured(np.flatnonzero(self.state & (LIVE | THIN)).astype(np.int32)))
        self.solve_targets()

    def _measured(self, faces: Int32Array) -> Int32Array:
        """Those of some opaque faces that are not left out."""
        if self._left_out is None:
            return faces
        is_left_out = self._left_out[faces] & (self.state[faces] & LIVE > 0)
        rest: Int32Array = faces[~is_left_out]
        others = faces[is_left_out]
        self.visible[others] = 0.0
        self.area_error[others] += self.area[others]
        return rest

    def solve_targets(self) -> None:
        """Compute all targets from the opaque faces in the cells that they touch.

        Last, so that nothing they leave in the grid changes the figures of opaque faces.
        """
        if self._target_image is None:
            return
        targets = np.arange(len(self.surface.faces), self.surface.n_faces, dtype=np.int32)
        projected = self._target_image.everything
        targets = targets[projected.state[targets] & (LIVE | THIN) > 0]
        if len(targets) == 0:
            return
        if ask_for_faces(targets, projected.box, self.grid) or not self._is_listed:
            self._list_faces()
        # Cells asked for so far are listed; others may have to be.
        self._is_listed = bool(self.grid.asked[: self.grid.columns * self.grid.rows].all())
        self._run(targets, projected)

    def _run(self, faces: Int32Array, projected: Projected) -> None:
        """Compute some faces, with more scratch memory as they need it."""
        done = 0
        while True:
            done = visible_areas(faces, done, self._view(projected), self._marks, self._pieces)
            if done == len(faces):
                break
            if not self._grow_kept():
                self._make_room_for_pieces(2 * len(self._pieces.corners))
        self._limit_errors(faces)

    def _view(self, projected: Projected) -> View:
        """The pose for the loops, with an image of all faces or of the opaque ones."""
        return View(
            self.camera, projected, self.grid, self.surface.edges, self._is_event, self._work,
            self.visible, self.area_error,
        )  # fmt: skip

    def _limit_errors(self, faces: Int32Array) -> None:
        """No area exceeds the image; a face that rounds to a point may be some roundings wide."""
        least = OUTLINE_ERROR_FACTOR * 2 * self.camera.pixel_error**2
        largest = 2 * (self.camera.width * self.camera.height)
        # `np.clip` takes four times as long for few faces.
        errors = np.maximum(self.area_error[faces], least)
        self.area_error[faces] = np.minimum(errors, largest)

    def _list_faces(self) -> None:
        """List the faces in the cells asked for."""
        while (needed := fill_grid(self.projected, self.grid)) > len(self.grid.entries):
            self.grid = with_room(self.grid, needed * 5 // 4)
        self._is_listed = True

    def _make_room_for_pieces(self, n: int) -> None:
        """Allocate room for n pieces of a face."""
        self._pieces = room_for_pieces(n, PIECE_ROOM)

    def _grow_kept(self) -> bool:
        """Make twice the room for pieces that are kept, if there was too little; True if so."""
        kept = self._work.kept
        if not kept.used[2]:
            return False
        n = min(len(kept.faces), int(kept.used[0]))
        corners = min(len(kept.corners), int(kept.used[1]))
        more = room_for_kept(2 * len(kept.faces), 2 * len(kept.corners))
        more.corners[:corners], more.faces[:n] = kept.corners[:corners], kept.faces[:n]
        more.starts[: n + 1], more.used[:2] = kept.starts[: n + 1], kept.used[:2]
        self._work = self._work._replace(kept=more)
        return True
