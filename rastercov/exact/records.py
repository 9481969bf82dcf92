"""Arrays and constants that the kernels of the exact methods share.

Image coordinates are u to the right and v down, in pixels; w is 1/z, z being the depth in metres.

The arguments `camera`, `projected`, `clipped`, `grid`, `edges`, `segment`, `pieces`, `work` and
`view` of a kernel are the records defined here: Pinhole, Projected, Clipped, CellGrid and so on. A
polygon and its corner count n are (N, 2) float64 and int, clockwise; lines are (N, 5).
"""

from collections import namedtuple

U, V, W = range(3)
"""Columns of a projected vertex, of a polygon's corner (u and v only) and of a plane."""
U_MIN, U_MAX, V_MIN, V_MAX, W_MIN, W_MAX = range(6)
"""Columns of a face's box, and of the extent of all faces (u and v only)."""
SUM_OF_WIDTHS, SUM_OF_HEIGHTS, SUM_OF_AREAS = range(4, 7)
"""Further columns of the extent: sums over the boxes of all faces, within the image."""
DU, DV, OFFSET, LINE_ERROR = range(2, 6)
"""Further columns of a line (u0, v0, du, dv, offset): its inner side is where
du (v - v0) - dv (u - u0) + offset >= 0. The error of the offset is kept for clipped faces only."""
FIRST, LAST, EDGE_ERROR = range(4, 7)
"""Further columns of a crossing (u, v, du, dv): the range of its edge, 0 at the start, 1 at the
end; and the largest error of the edge, pixels."""
SLOPE_U, SLOPE_V, W_ERROR, OUTLINE_ERROR = range(3, 7)
"""Further columns of a plane: slope of w along u and v, the largest error of w within the image,
and the largest error in pixels of the lines that bound the face."""

POSITION_ERROR = 3
"""Further column of an end of a segment (u, v, w)."""

LIVE, CLIPPED, PARTLY, CROSSED, DOUBTFUL, THIN, UNFIT, IN_CONTACT, TRANSPARENT, ABSENT, UNEVEN = (
    1 << bit for bit in range(11)
)
"""Bits of a face's state, and of the states of the faces of a block together.

LIVE: the face reaches into the image. CLIPPED: its image is a polygon made by clipping in space.
PARTLY: it reaches out of the image. CROSSED: its visibility may change within it, so that it cannot
be certified. DOUBTFUL: rounding may decide which side is seen. THIN: its image rounds to nothing,
so that it hides nothing, and the bounds of the faces behind it include what it may hide. UNFIT: its
visibility may change elsewhere than at event edges. IN_CONTACT: another face touches or cuts it.
TRANSPARENT: it is of a target, which hides nothing and which nothing at its depth hides. ABSENT, of
a block only: not all of its faces are live. UNEVEN, of a block only: its faces were
measured one by one, so that any may be clipped, doubtful or thin."""

CONSISTENT, REVERSED, NON_MANIFOLD = 1, -1, 2
"""Kinds of edges: one face, or two that run along it in opposite directions; two that run in the
same direction; more than two faces, or no length."""

BEHIND, IN_FRONT, IN_FRONT_IN_PART, TIED = range(4)
"""Depth order of an occluder relative to a face, over the overlap of their images."""

DEPTH_TIE_REL = 1e-10
"""Relative difference of 1/z up to which two surfaces coincide: the lower index is in front."""
SPARE_ENTRIES = 8
"""Values behind the last of an array, which may be read, or written, with it: eight at a time."""
BLOCK = 64
"""Faces, or edges, that are looked at together."""
MIXED = 2
"""Side of a block whose faces are not all seen from one side, or one of which is doubtful."""
CORNERS = 12
"""Capacity for the corners of a face: clipped to the near plane and the image it has at most 8."""
SIDES = 4
"""Lines that bound the image of a face: its edges and, where it is clipped, the near plane."""
STACK_ROOM = 64
"""Capacity for the parts of a face that are still to be done."""
PIECE_ROOM = 64
"""Capacity for the corners of a piece: intermediate cuts can exceed `MOST_CORNERS`."""

Pinhole = namedtuple(
    "Pinhole",
    "rotation centre near fx fy cx cy width height u_min u_max v_min v_max longest_ray pixel_error "
    "w_error_rel border",
)
"""Camera and pose.

Attributes
----------
rotation : (3, 3) float64
    world_from_camera.
centre : (3,) float64
    Camera centre, in the coordinates of the vertices.
near : float
    Depth of the near plane, metres.
fx, fy, cx, cy, width, height : float
    Pixels.
u_min, u_max, v_min, v_max : float
    Pixels; beyond them, which is well outside the image, faces are clipped in space before they are
    projected.
longest_ray : float
    Greatest length of a ray to the plane z = 1, through the image and half as far around it.
pixel_error : float
    Largest error of a projected position, pixels.
w_error_rel : float
    Largest error of 1/z, relative.
border : (4, 5) float64
    Lines along the four sides of the image.
"""

Projected = namedtuple(
    "Projected",
    "faces rank uvw side state box area clipped_index clipped blocks block_box block_state "
    "block_side has_boxes",
)
"""Image of a surface.

Attributes
----------
faces : (F, 3) int32
    Vertices of each face.
rank : (O,) int32
    Index of each opaque face in the mesh; where two tie, the lower one is in front.
uvw : (V, 3) float64
    Projected vertices; w is 0 where a vertex lies before the near plane or too far outside the
    image to be projected, so that faces and edges that use it must be clipped in space.
side : (F,) int8
    1 for a face seen from the front, -1 from behind, 0 for one that is left out.
state : (F,) uint16
    Bits `LIVE` to `TRANSPARENT`.
box : (F, 6) float64
    Bounds of u, v and w, of the live and thin faces of blocks that have boxes.
area : (F,) float64
    Image area inside the image, px^2.
clipped_index : (F,) int32
    Row in `clipped`, of clipped faces.
clipped : Clipped
blocks : Blocks
block_box : (N, 4) float64
    Bounds of u and v of the live and thin faces of each block; from inf to -inf for none.
block_state : (N,) uint16
    Bits that the state of any face of a block has, after `set_up`; `ABSENT` and `UNEVEN`.
block_side : (N,) int8
    Side of all faces of a block, or `MIXED`.
has_boxes : (N,) bool
    Blocks of which `box` is filled in for all faces: boxes are made where one is needed.
"""

Blocks = namedtuple(
    "Blocks", "has_flat patch patch_starts of_patch lowest joins is_plain starts of_edges"
)
"""Blocks of `BLOCK` faces of a surface, and of `BLOCK` consecutive edges.

A patch is a part of a block whose faces are joined by edges that two of them use in opposite
directions.

Attributes
----------
has_flat : (N,) bool
    Blocks with a face without area.
patch : (F,) int32
    Patch of each face.
patch_starts : (N + 1,) int32
    The patches of block b are patch_starts[b] ... patch_starts[b + 1] - 1.
of_patch : (C,) int32
    Block of each patch.
lowest : (C,) int32
    Lowest face of each patch.
joins : (J, 2) int32
    Pairs of patches with a common edge of two faces, the lower one first; the complement ~c of the
    other where both faces run along the edge in the same direction.
is_plain : (M,) bool
    Blocks of edges that all have two faces which run along them in opposite directions.
starts : (M + 1,) int32
    The blocks of the faces of edges m are of_edges[starts[m]] ... of_edges[starts[m + 1] - 1], of
    those that are plain.
of_edges : (Q,) int32
"""

Clipped = namedtuple("Clipped", "polygons n_corners lines planes")
"""Images of the faces that are clipped in space.

Attributes
----------
polygons, n_corners : (N, CORNERS, 2) float64, (N,) int32
    Corners, clockwise in the image.
lines : (N, SIDES, 5) float64
    Lines that bound each.
planes : (N, 7) float64
    1/z: a point (u, v, w), slopes and errors.
"""

CellGrid = namedtuple(
    "CellGrid",
    "left top per_u per_v columns rows asked is_near fresh_bits fresh n_fresh starts stops entries "
    "n_entries nearest is_sorted bounds has_bounds hider buckets faces n_faces found "
    "pairs is_whole",
)
"""Live and thin faces listed by the cells of a regular grid over the image that their boxes touch.

Attributes
----------
left, top : float
    Least u and v, pixels.
per_u, per_v : float
    Columns and rows a pixel.
columns, rows : int
asked : (columns * rows or more,) uint8
    `exact_grid.NOT_ASKED`, `ASKED` or `LISTED`: faces are listed in the last only.
is_near : (columns * rows or more,) bool
    Cells of which that one, the next, or one of these two in the next row is asked for and not
    listed.
fresh_bits : (rows, (columns + 63) // 64) uint64
    Bits of the cells that are asked for and not listed, those of the first columns lowest.
fresh, n_fresh : (columns * rows or more,) int32, (1,) int64
    The same cells, and their number.
starts, stops : (columns * rows or more,) int64
    The faces of a listed cell c are entries[starts[c]] ... entries[stops[c] - 1].
entries, n_entries : (N,) int32, (1,) int64
    Faces, in the order of their index until the cell is sorted; the number of all.
nearest : (N,) float64
    Greatest 1/z of the faces of sorted cells.
is_sorted : (columns * rows or more,) bool
    Cells whose faces are sorted by their nearest depth, from front to back.
bounds : (6, N + SPARE_ENTRIES) float64
    Boxes of the faces of cells with bounds, one after another in memory.
has_bounds : (columns * rows or more,) bool
    Cells of which they are filled in.
hider : (columns * rows or more,) int32
    A face that hid something in the cell, to be looked at first; -1 for none.
buckets : (BUCKETS + 1,) int64
    Scratch.
faces, n_faces : (F,) int32, (1,) int64
    The faces that are listed, and their number.
found : (F,) int32
    Scratch: faces that are found in a cell.
pairs : (N + SPARE_ENTRIES, 2) int32
    Scratch: cells, and faces to be listed there.
is_whole : (F,) bool
    Live and thin faces that are listed in all cells that their boxes touch.
"""

Pieces = namedtuple("Pieces", "corners n_corners")
"""Convex polygons, clockwise: (N, room, 2) float64 corners, (N,) int64 corner counts."""

VisiblePieces = namedtuple("VisiblePieces", "corners starts faces used")
"""Visible parts of faces that are partly visible, as convex polygons, where a caller asks for them.

Attributes
----------
corners : (C, 2) float64
    Corners, clockwise in the image; (0, 2) where no caller asks.
starts : (N + 1,) int64
    The corners of piece p are corners[starts[p]] ... corners[starts[p + 1] - 1].
faces : (N,) int32
    The face of each; the pieces of a face follow one another.
used : (3,) int64
    Pieces and corners so far, also where there is no room for them; 1 if there was none.
"""

Work = namedtuple(
    "Work",
    "target own corners lines spare other values ranges cell parts levels intersections kept",
)
"""Scratch for one face.

Attributes
----------
target, own : (2 CORNERS, 2), (SIDES, 5) float64
    Image of the face, and the lines that bound it.
corners, lines : (CORNERS, 2), (SIDES + 1, 5) float64
    The same of an occluder, with the line of equal depth.
spare, other, values : (PIECE_ROOM, 2), (PIECE_ROOM, 2), (PIECE_ROOM,) float64
    Two polygons, and values at their corners.
ranges : (N, 2) float64
    Parts of an edge.
cell : (4, 5) float64
    Lines that bound a cell of the grid.
parts, levels : Pieces, (STACK_ROOM,) int64
    Stack of convex parts of the face, and how often each was halved.
intersections : (N, 7) float64
    Lines along which faces in contact pass through the face, as `Crossings.segments`.
kept : VisiblePieces
    Pieces that are handed out.
"""

Segment = namedtuple("Segment", "uvw ends")
"""Edge in the image.

Attributes
----------
uvw : (2, 4) float64
    u, v, w of both ends, and the error of the position, pixels.
ends : (3,) int64
    Vertices at the ends, -1 for an end that is no vertex; 1 if the edge is not wholly hidden.
"""

Edges = namedtuple("Edges", "vertices faces kind of_face")
"""Edges of a surface.

Attributes
----------
vertices : (E, 2) int32
    Lower index first.
faces : (E, 2) int32
    Two of its faces; the second is -1 where there is only one.
kind : (E,) int8
    `CONSISTENT`, `REVERSED` or `NON_MANIFOLD`.
of_face : (F, 3) int32
    Edge from each corner of a face to the next.
"""

Crossings = namedtuple("Crossings", "last before edge segments")
"""Parts of event edges that cross faces in the image, as a linked list for each face.

Attributes
----------
last : (F,) int32
    Last crossing of each face, -1 for none.
before : (N,) int32
    Crossing before this one of the same face, -1 for the first.
edge : (N,) int32
    The event edge, -1 for a rim at the near plane.
segments : (N, 7) float64
    u, v, du, dv of the edge, the first and last of the range of it that crosses the face, and the
    error of its position, pixels.
"""

View = namedtuple("View", "camera projected grid edges is_event work visible area_error")
"""Pose of a surface, with what is found of it.

Attributes
----------
camera, projected, grid, edges : Pinhole, Projected, CellGrid, Edges
is_event : (E,) bool
    Event edges, of `exact_event.find_event_edges`; unused by half planes.
work : Work
    Scratch.
visible, area_error : (F,) float64
    Visible area, and the bound of its error and that of the area together, px^2.
"""
