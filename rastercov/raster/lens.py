"""Rasteriser of any lens: samples are looked up in images of pinholes.

A lens moves samples, not edges: edges are straight in its ideal planes (`camera.lenses.planes`).
So the rasteriser of pinholes draws these planes, and each sample of the lens takes the face at the
place whose ray it sees, rounded to a sample of the plane. Places are found once for a camera.

    camera -> rays of samples -> views: pinholes, and the sample of each that shows a ray (once)
    pose -> image of each view -> faces at the samples of the lens -> counts

A view is at least as fine as the samples of the lens are in nearly all of it, in each direction.
Where a lens shrinks one part of a plane and not another, the samples are divided until their views
are little larger than the image.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ResourceError
from rastercov.base.memory import FloatArray, Int32Array, IntArray, check_memory
from rastercov.base.threads import ScratchPool, share_poses, thread_count
from rastercov.camera.camera import Camera
from rastercov.camera.lenses.of_camera import lens_of, planes_of
from rastercov.camera.near_plane import limits, picture_limits
from rastercov.mesh import Mesh
from rastercov.mesh.arrays import matrices_of
from rastercov.native.raster_targets import count_targets
from rastercov.raster.contract import (
    FaceCounts,
    Rasterizer,
    check_counts,
)
from rastercov.raster.sample_grid import SampleGrid

Look = tuple[FloatArray, FloatArray, NDArray[np.bool_]]
"""Pose (1, 4, 4) of a view, depth of its near plane, and whether back faces are hidden, (1,)."""

RESOLUTION, OF_PICTURES = 1.0, 2.0
"""Samples of a view to one of the lens, a side, where the lens is as dense as `DENSEST`."""
DENSEST = 0.95
"""Share of the samples of a view that are no denser than that."""
TURN = 0.1
"""Radians by which views are turned: edges along rows of the image are not along those of a view,
where whole rows would be on its wrong side."""
MOST_WASTE = 3.0
"""Area of a view to that of the samples it shows beyond which these are divided."""
LEAST_SIDE, MOST_SIDE = 256, 4096
"""Samples a side of a view that is not divided any more, and of the largest view."""
MOST_ROWS = 1 << 22
"""Samples of the lens whose rays are in memory at a time, `RAY_BYTES` each."""
RAY_BYTES = 120
MOST_KEPT = 1 << 23
"""Samples of the lens whose views are kept; those of all others are made for each call."""
MOST_WEIGHT = 255
"""Largest weight of a sample, a byte."""
MOST_DRAWERS = 1024
"""Views whose drawers a thread keeps."""
ROWS_A_TURN = 8
"""Rows of samples a thread unprojects at a time."""


class ViewDrawer(Protocol):
    """Rasteriser of pinholes that draws the opaque faces of a mesh through one view."""

    def picture(self, look: Look) -> tuple[Int32Array, NDArray[np.float32]]:
        """Face, -1 for none, and depth (H, W) at each sample, until the next call."""

    def add_counts(self, look: Look, view: "View", visible: Any, drawn: Any) -> None:
        """Add the samples of the lens that show each face to (F,) counts, and those of it alone.

        `drawn` may be None.
        """


@dataclass(eq=False)
class View:
    """Pinhole at the place of a lens, and the samples of it that show the rays of the lens.

    Attributes
    ----------
    camera : Camera
        The pinhole.
    turn : (4, 4) float64
        lens_from_view.
    index : (N,) int32
        Sample of the pinhole, counted along its rows, of each sample of the lens.
    samples : (N,) int64
        Those samples, counted along the rows of their canvas; empty unless places are kept.
    places : (N, 2) float32
        X / Z and Y / Z of their rays; empty unless places are kept.
    """

    camera: Camera
    turn: FloatArray
    index: Int32Array
    samples: IntArray
    places: NDArray[np.float32]
    of_drawer: Any = None
    """Kept by a drawer with the view."""

    @cached_property
    def grid(self) -> SampleGrid:
        """Its samples."""
        return SampleGrid(self.camera)

    def weights(self) -> Int32Array:
        """Samples of the lens at each sample of the pinhole, (H, W) int32."""
        size = self.camera.width * self.camera.height
        counts = np.bincount(self.index, minlength=size).astype(np.int32)
        if counts.max() > MOST_WEIGHT:
            raise ResourceError(
                f"{counts.max():,} samples of the lens share a ray; lower supersample or resolution"
            )
        return counts.reshape(self.camera.height, self.camera.width)

    @cached_property
    def sums(self) -> Int32Array:
        """Sums of the weights of each row before each column, (H, W + 1) int32."""
        sums = np.zeros((self.camera.height, self.camera.width + 1), np.int32)
        np.cumsum(self.weights(), axis=1, out=sums[:, 1:])
        return sums

    def count_alone(
        self, corners: FloatArray, centre: FloatArray, look: Look, depth: Any, visible: Any,
        drawn: Any,
    ) -> None:  # fmt: skip
        """Add the samples that faces (N, 3, 3) cover alone, and those that a depth leaves.

        The corners are from `centre`. `visible` is not written where there is no depth (H, W).
        """
        ((pose,), (near,), _), grid = look, self.grid
        axes, eye = np.ascontiguousarray(pose[:3, :3]), pose[:3, 3] - centre
        count_targets(
            (corners, axes, eye, grid.lens, float(near)), np.empty((0, 2), np.int64),
            (0, 0, grid.width, grid.height), tuple(grid.runs),
            np.empty((0, 0), np.float32) if depth is None else depth, self.sums, visible, drawn,
        )  # fmt: skip


class Views:
    """Views of the samples of a camera, in bands of rows.

    Parameters
    ----------
    camera : Camera
        Any lens.
    supersample, roll
        As for `open_rasterizer`.
    keeps_places : bool
        Whether the views have `samples` and `places`, and are finer: for pictures.
    most_rows : int
        Samples of a band.
    """

    def __init__(
        self,
        camera: Camera,
        supersample: int = 1,
        roll: float = 0.0,
        *,
        keeps_places: bool = False,
        most_rows: int = MOST_ROWS,
    ) -> None:
        self.grid = grid = SampleGrid(camera, supersample, roll)
        self._keeps_places, self._lens, self._near = keeps_places, lens_of(camera), camera.near
        self._resolution = OF_PICTURES if keeps_places else RESOLUTION
        c, s = math.cos(TURN), math.sin(TURN)
        turned = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))
        frames = {plane.frame.tobytes(): plane.frame @ turned for plane, _ in planes_of(camera)}
        self.frames = tuple(frames.values())
        self._rows = max(1, most_rows // grid.width)
        self._kept: dict[int, tuple[View, ...]] = {}

    def bands(self, threads: int) -> Iterator[tuple[View, ...]]:
        """Yield the views of each band of rows."""
        for top in range(0, self.grid.height, self._rows):
            views = self._kept.get(top)
            if views is None:
                views = tuple(self._made(top, min(top + self._rows, self.grid.height), threads))
                if (top + self._rows) * self.grid.width <= MOST_KEPT or not top:
                    self._kept[top] = views
            yield views

    def _made(self, top: int, bottom: int, threads: int) -> Iterator[View]:
        width, height = self.grid.width, bottom - top
        check_memory(
            f"the places of {width * height:,} samples",
            RAY_BYTES * width * height,
            "lower supersample",
        )
        rays = self._rays(top, bottom, threads)
        along = np.stack([rays @ frame[:, 2] for frame in self.frames])
        plane = along.argmax(axis=0)
        z = np.take_along_axis(along, plane[None], axis=0)[0]
        plane[~(z > 0)] = -1
        parts = [(number, np.flatnonzero(plane == number)) for number in range(len(self.frames))]
        rays = rays.reshape(-1, 3)
        while parts:
            number, at = parts.pop()
            if not len(at):
                continue
            own, frame = rays[at], self.frames[number]
            places = (own @ frame[:, :2]) / (own @ frame[:, 2])[:, None]
            camera = self._pinhole(own, places, frame)
            side = max(camera.width, camera.height)
            if side > MOST_SIDE or (
                side > LEAST_SIDE
                and camera.width * camera.height > MOST_WASTE * self._resolution**2 * len(at)
            ):
                axis = int(camera.height > camera.width)
                is_first = places[:, axis] < places[:, axis].mean()
                parts += [(number, at[is_first]), (number, at[~is_first])]
                continue
            column, row = (
                np.clip(places[:, axis] * focal + centre, 0, side - 1).astype(np.int32)
                for axis, (focal, centre, side) in enumerate(
                    ((camera.fx, camera.cx, camera.width), (camera.fy, camera.cy, camera.height))
                )
            )
            kept = slice(None if self._keeps_places else 0)
            yield View(
                camera, matrices_of(frame), row * np.int32(camera.width) + column,
                at[kept] + top * width, places[kept].astype(np.float32),
            )  # fmt: skip

    def _rays(self, top: int, bottom: int, threads: int) -> FloatArray:
        """Unit rays of some rows of the canvas, NaN without one and outside the image."""
        grid, lens = self.grid, self._lens
        rays = np.empty((bottom - top, grid.width, 3))
        column = np.arange(grid.width)

        def work(turn: slice) -> None:
            for first in range(ROWS_A_TURN * turn.start, ROWS_A_TURN * turn.stop, ROWS_A_TURN):
                rows = slice(first, min(first + ROWS_A_TURN, bottom - top))
                own = slice(top + rows.start, top + rows.stop)
                rays[rows] = lens.unproject(grid.positions(own.start, own.stop))
                begin, end = grid.runs[:, own, None]
                rays[rows][(column < begin) | (column >= end)] = np.nan

        n_turns = -(-(bottom - top) // ROWS_A_TURN)
        workers: list[Callable[[slice], None]] = [work] * max(1, min(threads, n_turns))
        share_poses(n_turns, workers)
        return rays

    def _pinhole(self, rays: FloatArray, places: FloatArray, frame: FloatArray) -> Camera:
        """Pinhole that shows all of some places, as finely as the lens does."""
        some = slice(None, None, max(1, len(rays) // 2000))
        # Derivatives by places are those by rays of length 1 / z.
        slopes = self._lens.jacobian(rays[some]) @ frame[:, :2]
        slopes *= (rays[some] @ frame[:, 2])[:, None, None] * self.grid.supersample
        density = np.linalg.norm(slopes, axis=1)  # samples of the lens to a unit of each axis
        scale = self._resolution * np.nanquantile(density, DENSEST, axis=0)
        low, high = places.min(axis=0), places.max(axis=0)
        # At a pole the lens is infinitely dense: a few samples have no larger view.
        scale = np.minimum(scale, (LEAST_SIDE + len(rays)) / np.maximum(high - low, 1e-9))
        width, height = (np.ceil((high - low) * scale).astype(int) + 2).tolist()
        (fx, fy), (cx, cy) = scale.tolist(), (1.0 - low * scale).tolist()
        return Camera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, near=self._near)


@lru_cache(maxsize=8)
def views_of(camera: Camera, supersample: int, roll: float, keeps_places: bool) -> Views:
    """Views of a camera, which rasterisers of one camera share."""
    return Views(camera, supersample, roll, keeps_places=keeps_places)


def largest_view(camera: Camera, supersample: int) -> Camera:
    """Pinhole as large as the views of a camera, and of about their greatest focal length."""
    side = min(MOST_SIDE, LEAST_SIDE + 2 * supersample * max(camera.width, camera.height))
    focal = RESOLUTION * supersample * max(camera.fx, camera.fy)
    return Camera(width=side, height=side, fx=focal, fy=focal)


class LensRasterizer(Rasterizer):
    """Rasteriser of cameras with any lens, on one of pinholes.

    Parameters
    ----------
    mesh, camera, supersample, roll
        As for `open_rasterizer`.
    pinholes : GLRasterizer or CPURasterizer
        Of this mesh; it is closed with this one.
    threads : int, optional
        Number of threads, by default one for each core; each takes whole poses.
    """

    def __init__(
        self,
        mesh: Mesh,
        camera: Camera,
        pinholes: Any,
        *,
        supersample: int = 1,
        roll: float = 0.0,
        threads: int | None = None,
    ) -> None:
        super().__init__(mesh, camera, supersample, roll)
        self._pinholes, self._threads = pinholes, thread_count(threads)
        self.info = pinholes.info
        self._views = views_of(camera, supersample, roll, keeps_places=False)
        self._drawers: ScratchPool[dict[View, ViewDrawer]] = ScratchPool(dict, self._threads)

    def _counted(self, poses: FloatArray, drawn: bool) -> FaceCounts:
        grid, mesh, targets = self._views.grid, self.mesh.opaque, self._targets
        n_bytes = np.dtype(grid.count_type).itemsize
        check_counts(len(poses), self.mesh.n_faces, n_bytes * (1 + drawn))
        limit, cull, clipped = limits(self.mesh, self.camera, poses)
        visible: Any = np.zeros((len(poses), mesh.n_faces), grid.count_type)
        covered: Any = np.zeros_like(visible) if drawn else None
        of_targets = np.zeros((2, len(poses), len(targets.rows) if targets else 0), np.int64)

        def work(views: tuple[View, ...], drawers: dict[View, ViewDrawer], turn: slice) -> None:
            for view in views:
                drawer = self._drawer(drawers, view)
                for row in range(turn.start, turn.stop):
                    one = slice(row, row + 1)
                    look = poses[one] @ view.turn, limit[one], cull[one]
                    own = None if covered is None else covered[row]
                    drawer.add_counts(look, view, visible[row], own)
                    if targets:
                        depth = drawer.picture(look)[1]
                        found = of_targets[:, row]
                        view.count_alone(targets.corners, targets.centre, look, depth, *found)

        for views in self._views.bands(self._threads):
            self._share(self._drawers, len(poses), partial(work, views))
        background = grid.n_samples - visible.sum(axis=1, dtype=np.int64)
        counts = self._result(visible, covered, background, clipped)
        return self._with_targets(counts, *of_targets) if targets else counts

    def _drawn(self, poses: FloatArray) -> tuple[Int32Array, NDArray[np.float32]]:
        near, cull = picture_limits(self.mesh, self.camera, poses)
        shape = self.camera.height, self.camera.width
        face, depth = np.full(shape, -1, np.int32), np.full(shape, np.inf, np.float32)
        pictures = views_of(self.camera, 1, 0.0, keeps_places=True)
        for views in pictures.bands(self._threads):
            for view in views:
                look = poses @ view.turn, near, cull
                drawer = self._pinholes.drawer(view.camera)
                drawn_face, drawn_depth = drawer.picture(look)
                found = drawn_face.ravel()[view.index]
                is_seen = found >= 0
                at, places = view.samples[is_seen], view.places[is_seen].astype(np.float64)
                face.ravel()[at] = found[is_seen]
                drawn = drawn_depth.ravel()[view.index[is_seen]]
                z = self._depths(look, found[is_seen], places, drawn)
                if len(pictures.frames) > 1:
                    z *= np.sqrt(1 + (places**2).sum(axis=1))
                depth.ravel()[at] = z
        return face, depth

    def close(self) -> None:
        """Release its memory: later calls raise `DeviceError`, calls in other threads complete."""
        self._pinholes.close()
        super().close()
        self._drawers.close()

    def _drawer(self, drawers: dict[View, ViewDrawer], view: View) -> ViewDrawer:
        """Drawer of a view, of a few that a thread keeps."""
        if view not in drawers:
            if len(drawers) >= MOST_DRAWERS:
                drawers.clear()
            drawers[view] = self._pinholes.drawer(view.camera, next(iter(drawers.values()), None))
        return drawers[view]

    def _depths(
        self,
        look: Look,
        face: Int32Array,
        places: FloatArray,
        drawn: NDArray[np.float32],
    ) -> FloatArray:
        """Camera z at places of a view, by the planes of faces; what was drawn if edge-on."""
        (corners, centre), ((pose,), (near,), _) = self._corners, look
        is_used = np.zeros(len(corners), np.bool_)
        is_used[face] = True
        row = np.cumsum(is_used) - 1
        corners = (corners[is_used] - (pose[:3, 3] - centre)) @ pose[:3, :3]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        height = np.einsum("fi,fi->f", normal, corners[:, 0])
        own = normal[row[face]]
        with np.errstate(all="ignore"):
            z = height[row[face]] / (
                own[:, 0] * places[:, 0] + own[:, 1] * places[:, 1] + own[:, 2]
            )
        z = np.where(np.isfinite(z), z, drawn)
        least = np.maximum(corners[..., 2].min(axis=1), near)[row[face]]
        return np.clip(z, least, np.maximum(corners[..., 2].max(axis=1), near)[row[face]])
