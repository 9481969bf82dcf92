r"""Exact visible areas by half planes: what no other face hides of each face's image.

In the image 1/z is affine on a face, so the part of face T that face M hides is the convex polygon
T n M n {1/z_M > 1/z_T}, and

    visible(T) = T \ U_M T n M n {1/z_M > 1/z_T}.

No order of depth is needed, and faces that overlap in a circle or pierce one another come out
right. Surfaces at equal depth count as one, of which the face with the lower index is seen. The
loops are in `analytic_kernels`.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov._jit import announce_compilation
from rastercov._memory import check_memory
from rastercov._threads import share_poses, thread_count
from rastercov.camera import Camera
from rastercov.errors import ConfigError
from rastercov.exact import half_plane_kernels as kernels
from rastercov.exact.surface import Surface, surface_of
from rastercov.mesh import Mesh
from rastercov.near_plane import limits
from rastercov.pose import valid_poses

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int32]

MOST_CELLS = 1 << 14
"""Columns, or rows, of the grid."""
LEAST_SIDE = 1e-100
"""Pixels; of what the grid covers."""
CELLS_A_FACE = 2
"""Cells of the grid for each face, unless that makes more entries than this:"""
ENTRIES_A_FACE = 4


def visible_areas(
    mesh: Mesh,
    camera: Camera,
    poses: ArrayLike,
    faces: ArrayLike | None = None,
    *,
    front_only: bool | None = None,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Exact visible area and image area of all or chosen faces in many poses, px^2.

    Parameters
    ----------
    mesh, camera
        What is looked at, and by what.
    poses : (P, 4, 4) array_like
        world_from_camera.
    faces : (N,) int array_like, optional
        The faces to measure, all F unless given. All others hide as ever.
    front_only : bool, optional
        True leaves out faces seen from behind: they neither hide nor are seen. Unless given, they
        are left out where that changes nothing, which is proved pose by pose: the mesh is closed
        and consistently wound, the camera outside it, and nothing is cut by the near plane.
    threads : int, optional
        Poses measured side by side; one for each core unless given.

    Returns
    -------
    visible, area, bound : (P, N) float64
        Of the part inside the image: what is seen of the face, from either side, and what would be
        were it alone; and the most that rounding may have done to the two together, px^2.

    Raises
    ------
    PoseError
        For a pose that is no rigid motion.
    ConfigError
        For a face that is not there.
    ResourceError
        Where the arrays take more memory than is free, before any is taken.
    """
    matrices = valid_poses(poses)
    chosen: NDArray[Any] = np.arange(mesh.n_faces) if faces is None else np.asarray(faces)
    if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "iu"):
        raise ConfigError(f"faces must be a list of indices, got {chosen.dtype} {chosen.shape}")
    if chosen.size and (chosen.min() < 0 or chosen.max() >= mesh.n_faces):
        raise ConfigError(
            f"faces must lie in 0 ... {mesh.n_faces - 1}, got {chosen.min()} ... {chosen.max()}"
        )
    check_memory(
        f"areas of {len(matrices):,} poses x {len(chosen):,} faces",
        3 * 8 * len(matrices) * len(chosen),
        "measure fewer poses at a time",
    )
    announce_compilation(kernels.visible_areas)
    near, can_cull, _ = limits(mesh, camera, matrices)
    cull = can_cull if front_only is None else np.full(len(matrices), front_only)
    visible, area, bound = np.empty((3, len(matrices), len(chosen)))
    chosen = chosen.astype(np.int32)

    def worker(view: View) -> Callable[[slice], None]:
        def work(turn: slice) -> None:
            for row in range(len(matrices))[turn]:
                view.look(matrices[row], near[row], cull[row])
                view.measure(chosen)
                visible[row], area[row] = view.visible[chosen], view.area[chosen]
                bound[row] = view.blur[chosen]

        return work

    n_threads = max(1, min(thread_count(threads), len(matrices)))
    surface = surface_of(mesh)
    share_poses(len(matrices), [worker(View(surface, camera)) for _ in range(n_threads)])
    return visible, area, bound


class View:
    """One pose at a time of a surface, and the scratch memory of one thread for it.

    Attributes
    ----------
    area, visible : (F,) float64
        Image of each face inside the image border, and what is seen of it, px^2.
    blur : (F,) float64
        Bound of the error of both together, px^2, where they were measured.
    state, side : (F,) uint8, int8
        See `analytic_kernels.set_up`.
    is_certified : (F,) bool
        Faces known to be seen whole or not at all.
    n_cut : int
        Faces that were cut in space.
    grain : float
        The largest number that positions in the image are made from, pixels: rounding goes with it.
    rounding : (2,) float64
        Largest error of a position in the image, in pixels, and of 1/z, relative.
    """

    def __init__(self, surface: Surface, camera: Camera) -> None:
        self.surface = surface
        n_faces = len(surface.faces)
        self.size = np.array((camera.width, camera.height), np.float64)
        self.lens = np.array((camera.fx, camera.fy, camera.cx, camera.cy))
        # Off the axis, rounding of z moves a point as far as it is out.
        steep = (self.size**2 / self.lens[:2]).max()
        self.grain = float(max(*self.size, *np.abs(self.lens), steep))
        relative = kernels.longest_ray(self.lens, self.size)
        self.rounding = kernels.RESIDUE * np.array((self.grain, relative / 2))
        low, high = -kernels.MARGIN * self.size - 1, (1 + kernels.MARGIN) * self.size + 1
        self.pyramid = np.array((low[0], high[0], low[1], high[1]))
        self.uvw = np.empty((len(surface.vertices), 3))
        self.side, self.state = np.empty(n_faces, np.int8), np.empty(n_faces, np.uint8)
        self.box = np.empty((n_faces, 6))
        self.area, self.visible, self.blur = np.empty((3, n_faces))
        self.is_certified: BoolArray = np.zeros(n_faces, np.bool_)
        self.slot, self._marks = np.empty(n_faces, np.int32), np.empty(n_faces, np.int64)
        self.region = np.empty(7)
        self.starts = np.empty(0, np.int64)
        self.listed = np.empty(4 * n_faces, np.int32)
        self._make_room_for_cuts(8)
        self._make_room_for_pieces(64)

    def look(self, pose: FloatArray, near: float, front_only: bool) -> None:
        """Project, keep and list the faces of one pose.

        Parameters
        ----------
        pose : (4, 4) float64
            world_from_camera.
        near : float
            Depth of the near plane, metres.
        front_only : bool
            Faces seen from behind neither hide nor are seen.
        """
        surface = self.surface
        self.rotation, self.eye = np.ascontiguousarray(pose[:3, :3]), pose[:3, 3].copy()
        self.near = near
        kernels.project(
            surface.vertices, self.rotation, self.eye, self.lens, near, self.pyramid, self.uvw
        )
        while True:
            n_live, self.n_cut = kernels.set_up(
                surface.vertices, surface.faces, surface.flat, self.rotation, self.eye, self.lens,
                near, self.size, front_only, self.rounding[0], self.uvw, self.side, self.state,
                self.box, self.area, self.blur, self.slot, self.polygons, self.n_corners,
                self.sides, self.planes, self.region,
            )  # fmt: skip
            if self.n_cut <= len(self.polygons):
                break
            self._make_room_for_cuts(self.n_cut)
        self.visible[:] = 0.0
        self._fill_grid(n_live)

    def measure(self, targets: IntArray) -> None:
        """Put what is seen of some faces, by their indices, into `visible`, its bound in `blur`."""
        done = 0
        self._marks.fill(-1)
        while True:
            done = kernels.visible_areas(
                targets, done, self.surface.faces, self.uvw, self.side, self.state, self.box,
                self.area, self.slot, self.polygons, self.n_corners, self.sides, self.planes,
                self.size, self.rounding, self.grid, self.columns, self.rows, self.starts,
                self.listed, self._marks, self._found, self._found_lines, self._pool, self._pieces,
                self._n_of, self.visible, self.blur,
            )  # fmt: skip
            if done == len(targets):
                break
            self._make_room_for_pieces(2 * len(self._pieces))
        np.minimum(self.blur, 2 * self.size.prod(), out=self.blur)  # no area exceeds the image

    def measure_all(self) -> None:
        """Put what is seen of every face into `visible`."""
        self.measure(np.flatnonzero(self.state & (kernels.LIVE | kernels.THIN)).astype(np.int32))

    def _fill_grid(self, n_live: int) -> None:
        """List the live faces by cells: as many as the entries that large faces make allow."""
        left, right, top, bottom, *sums = self.region.tolist() if n_live else (0, 1, 0, 1, 0, 0, 0)
        wide, high = max(right - left, LEAST_SIDE), max(bottom - top, LEAST_SIDE)
        widths, heights, areas = sums
        cells = CELLS_A_FACE * n_live + 1.0
        while True:
            self.columns = int(min(max(1.0, math.sqrt(cells * (wide / high))), MOST_CELLS))
            self.rows = int(min(max(1.0, cells / self.columns), MOST_CELLS))
            across, down = self.columns / wide, self.rows / high
            # A box w wide and h high touches (1 + w across)(1 + h down) cells, on average.
            entries = n_live + widths * across + heights * down + areas * across * down
            if entries <= ENTRIES_A_FACE * n_live or self.columns * self.rows == 1:
                break
            cells /= 2
        self.grid = np.array((left, top, across, down))
        if len(self.starts) < self.columns * self.rows + 2:
            self.starts = np.empty(self.columns * self.rows + 2, np.int64)
        while True:
            needed = kernels.fill_grid(
                self.state, self.box, self.grid, self.columns, self.rows, self.starts, self.listed
            )
            if needed <= len(self.listed):
                return
            self.listed = np.empty(needed * 5 // 4, np.int32)

    def _make_room_for_cuts(self, n: int) -> None:
        self.polygons = np.empty((n, kernels.CORNERS, 2))
        self.n_corners = np.empty(n, np.int32)
        self.sides, self.planes = np.empty((n, kernels.SIDES, 5)), np.empty((n, 7))

    def _make_room_for_pieces(self, n: int) -> None:
        """For n pieces of a face, and as many occluders."""
        self._pieces, self._n_of = np.empty((n, kernels.WIDTH, 2)), np.empty(n, np.int64)
        self._found, self._found_lines = np.empty(n, np.int32), np.empty((n, 6))
        self._pool = np.empty(8 * n, np.int32)
