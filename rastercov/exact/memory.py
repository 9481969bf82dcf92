"""Memory of the exact methods for one camera and thread, and the images of faces in it."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.exact.surface import Surface, Targets
from rastercov.kernels.direct import DirectCalls
from rastercov.kernels.exact_records import (
    BLOCK,
    CORNERS,
    SIDES,
    SPARE_ENTRIES,
    TRANSPARENT,
    Blocks,
    Clipped,
    Pieces,
    Pinhole,
    Projected,
    VisiblePieces,
)
from rastercov.kernels.exact_setup import project, set_up, set_up_plain

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


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
    return Projected(
        faces=faces,
        rank=surface.rank,
        uvw=np.empty((len(vertices) + SPARE_ENTRIES, 3))[: len(vertices)],
        side=np.empty(n_all, np.int8),
        state=np.empty(n_all + SPARE_ENTRIES, np.uint16)[:n_all],
        box=np.empty((n_all, 6)),
        area=area,
        clipped_index=np.zeros(n_all, np.int32),
        clipped=room_for_clipped(8),
        **_room_for_blocks(surface.blocks),
    )


def _room_for_blocks(blocks: Blocks) -> dict[str, Any]:
    n = len(blocks.has_flat)
    return {
        "blocks": blocks,
        "block_box": np.empty((n, 4)),
        "block_state": np.empty(n, np.uint16),
        "block_side": np.empty(n, np.int8),
        "has_boxes": np.empty(n, np.bool_),
    }


def part_of(everything: Projected, part: slice, faces: IntArray, blocks: Blocks) -> Projected:
    """Image of a part of all faces, with its own vertices, clipped faces and blocks."""
    return everything._replace(
        faces=faces,
        uvw=np.empty((int(faces.max(initial=-1)) + 1, 3)),
        side=everything.side[part],
        state=everything.state[part],
        box=everything.box[part],
        area=everything.area[part],
        clipped_index=everything.clipped_index[part],
        clipped=room_for_clipped(8),
        **_room_for_blocks(blocks),
    )


def set_up_image(
    call: DirectCalls,
    surface: Surface | Targets,
    camera: Pinhole,
    front_only: bool,
    projected: Projected,
    area_error: FloatArray,
    extent: FloatArray,
) -> tuple[Projected, int, int]:
    """Project and set up faces; the image, with room for clipped faces, live and clipped ones."""
    n_out = call(project, surface.vertices, camera, projected.uvw)
    rest = np.empty(len(surface.blocks.has_flat), np.int32)
    n_plain, n_rest = call(
        set_up_plain,
        camera, front_only, n_out, projected, area_error, extent, np.empty(2 * BLOCK), rest,
    )  # fmt: skip
    while True:
        n_live, n_clipped = call(
            set_up,
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
    return VisiblePieces(
        corners=np.empty((corners, 2)),
        starts=np.zeros(n + 1, np.int64),
        faces=np.empty(n, np.int32),
        used=np.zeros(3, np.int64),
    )


def room_for_clipped(n: int) -> Clipped:
    """Memory for n faces that are clipped in space."""
    return Clipped(
        polygons=np.empty((n, CORNERS, 2)),
        n_corners=np.empty(n, np.int32),
        lines=np.empty((n, SIDES, 5)),
        planes=np.empty((n, 7)),
    )
