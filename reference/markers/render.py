"""Pictures of plates by headless OpenGL, with the depth of field of a lens and sensor noise.

Depth of field is no blur filter: the images from many points of the lens are added up. Each has its
own perspective, in which the plane in focus is fixed, and its own shift by a part of a pixel, which
also smooths edges. Many such images are drawn at once, side by side in one atlas.

P. Haeberli, K. Akeley. The Accumulation Buffer: Hardware Support for High-Quality Rendering. 1990.
"""

from contextlib import ExitStack
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov import shaders
from rastercov.base.errors import ConfigError
from rastercov.base.threads import Closing
from rastercov.camera.camera import Camera
from rastercov.camera.projection import to_camera
from rastercov.raster.gl.context import HeadlessContext, open_context
from rastercov.raster.gl.resources import Resources
from rastercov.reference.markers.scene import CELLS, PLAIN, PlateScene

FloatArray = NDArray[np.float64]
Box = tuple[int, int, int, int]

ATLAS = 4096
"""Side of the atlas, px: 16 MiB of grey and 64 MiB of depth."""
BLACK, WHITE, GREY = 0.05, 0.9, 0.35
"""Reflectance of ink, of paper and the wall behind everything, and of plain boards."""
SHARP, BLURRED = 64, 256
"""Images added up for a pinhole, and for a lens."""
FULL_SCALE = 255 / 1.05
"""Grey levels of reflectance 1."""


class MarkerRenderer(Closing):
    """Draws scenes of plates; owns its OpenGL objects, so use it in a `with` statement.

    Parameters
    ----------
    patterns : (M, 8, 8) bool or int
        Cells of each marker, 1 is white.
    device : str, int or HeadlessContext
        As for `open_context`; a context that is open already is used and left open.
    """

    def __init__(self, patterns: NDArray[Any], device: str | int | HeadlessContext = "auto"):
        self._stack = ExitStack()
        try:
            if isinstance(device, HeadlessContext):
                self._context = device
            else:
                self._context = self._stack.enter_context(open_context(device))
            self._resources = Resources(self._context)
            self._stack.callback(self._resources.release)
            self._allocate(np.ascontiguousarray(patterns, np.uint8))
        except BaseException:
            self.close()
            raise

    @property
    def renderer(self) -> str:
        """Name of the OpenGL renderer."""
        return self._context.info.renderer

    def _allocate(self, patterns: NDArray[np.uint8]) -> None:
        gl, kept = self._context.gl, self._resources.own
        self._drawing = kept(
            gl.program(
                shaders.source("markers_plate.vert"),
                shaders.source("markers_plate.frag", CELLS=CELLS, PLAIN=PLAIN),
            )
        )
        self._adding = kept(
            gl.program(shaders.source("markers_sum.vert"), shaders.source("markers_sum.frag"))
        )
        table = (CELLS * CELLS, len(patterns))
        self._cells = kept(gl.texture(table, 1, patterns.tobytes(), dtype="u1"))
        self._cells.filter = (moderngl.NEAREST, moderngl.NEAREST)
        for name, value in {"black": BLACK, "white": WHITE, "grey": GREY}.items():
            self._drawing[name].value = value
        self._atlas = kept(gl.texture((ATLAS, ATLAS), 1, dtype="f1"))
        depth = kept(gl.depth_renderbuffer((ATLAS, ATLAS)))
        self._atlas_frame = kept(gl.framebuffer([self._atlas], depth))
        self._sum = kept(gl.texture((ATLAS, ATLAS), 1, dtype="f4"))
        self._sum_frame = kept(gl.framebuffer([self._sum]))
        self._adder = kept(gl.vertex_array(self._adding, []))

    def render(
        self,
        scene: PlateScene,
        camera: Camera,
        pose: FloatArray | None = None,
        *,
        box: Box | None = None,
        images: int | None = None,
        sharp: bool = False,
        wall: float = WHITE,
    ) -> FloatArray:
        """Reflected light in each pixel, 0 to 1, (H, W).

        Parameters
        ----------
        scene, camera
            Plates and camera; its aperture and focus distance blur the image.
        pose : (4, 4) float64, optional
            world_from_camera; the scene's own camera unless given.
        box : (left, top, width, height), optional
            Part of the image to draw, px; all of it unless given. Pixels are those of the whole.
        images : int, optional
            Points of the lens; 64 for a pinhole and 256 for a lens unless given.
        sharp : bool
            Draw as a pinhole, whatever the lens.
        wall : float
            Reflectance of the background.
        """
        camera.check_pinhole("images of plates are drawn through pinholes")
        left, top, width, height = box or (0, 0, camera.width, camera.height)
        if not (0 < width <= ATLAS and 0 < height <= ATLAS):
            raise ConfigError(f"box must be 1 to {ATLAS} px a side, got {width} x {height}")
        has_lens = camera.aperture is not None and not sharp
        bundles = ray_bundles(images or (BLURRED if has_lens else SHARP))
        points = to_camera(scene.mesh.vertices, np.eye(4) if pose is None else pose)
        corners = points[scene.mesh.faces]
        if (corners[..., 2] <= 0).any():
            raise ConfigError("plates must stand before the camera; move them or the camera")
        values = {
            "camera": (camera.fx, camera.fy, camera.cx - left, camera.cy - top),
            "lens": lens_uniform(camera) if has_lens else (0.0, 0.0, 0.0),
            "size": (width, height),
            # Within the clip range for depths from -1 and from 0.
            "near": 0.4 * float(corners[..., 2].min()),
        }
        columns, rows = ATLAS // width, ATLAS // height
        total = np.zeros((height, width))
        with ExitStack() as stack:
            gl = self._context.gl
            vertices = self._vertices(gl, corners, scene)
            stack.callback(vertices.release)
            for first in range(0, len(bundles), columns * rows):
                batch = bundles[first : first + columns * rows]
                across = min(columns, len(batch))
                total += self._draw(gl, vertices, batch, across, values, wall)
        return total / len(bundles)

    def _vertices(self, gl: moderngl.Context, corners: FloatArray, scene: PlateScene) -> Any:
        first, second, third = np.moveaxis(corners, 1, 0)
        # The back of a plate is uniform grey.
        is_front = (np.cross(second - first, third - first) * first).sum(axis=1) < 0
        row = np.dtype([("position", "f4", 3), ("place", "f4", 2), ("marker", "i4")])
        table = np.empty(corners.shape[:2], row)
        table["position"], table["place"] = corners, scene.place
        table["marker"] = np.where(is_front, scene.printed, PLAIN)[:, None]
        return gl.buffer(table.tobytes())

    def _draw(
        self,
        gl: moderngl.Context,
        vertices: object,
        bundles: FloatArray,
        columns: int,
        values: dict[str, Any],
        wall: float,
    ) -> FloatArray:
        """Sum of the images of some ray bundles."""
        width, height = values["size"]
        used = (columns * width, -(-len(bundles) // columns) * height)
        for name, value in (values | {"columns": columns, "atlas": used}).items():
            self._drawing[name].value = value
        for name, value in {
            "size": (width, height),
            "columns": columns,
            "count": len(bundles),
        }.items():
            self._adding[name].value = value
        with ExitStack() as stack:
            instances = gl.buffer(bundles.astype("f4").tobytes())
            stack.callback(instances.release)
            content = [
                (vertices, "3f 2f 1i", "position", "place", "marker"),
                (instances, "4f/i", "bundle"),
            ]
            array = gl.vertex_array(self._drawing, content)
            stack.callback(array.release)
            self._atlas_frame.viewport = (0, 0, *used)
            self._atlas_frame.clear(wall, depth=1.0, viewport=(0, 0, *used))
            self._atlas_frame.use()
            gl.enable_only(moderngl.DEPTH_TEST)
            gl.depth_func = "<"
            self._cells.use(0)
            for distance in range(4):
                gl.enable_direct(0x3000 + distance)  # GL_CLIP_DISTANCE0 and on
            array.render(moderngl.TRIANGLES, instances=len(bundles))
            for distance in range(4):
                gl.disable_direct(0x3000 + distance)
            gl.enable_only(moderngl.NOTHING)
            self._sum_frame.viewport = (0, 0, width, height)
            self._sum_frame.use()
            self._atlas.use(0)
            self._adder.render(moderngl.TRIANGLES, vertices=3)
            data = self._sum_frame.read((0, 0, width, height), 1, dtype="f4")
        return np.frombuffer(data, "f4").reshape(height, width).astype(np.float64)

    def close(self) -> None:
        """Release all OpenGL objects; a second call does nothing."""
        self._stack.close()


def lens_uniform(camera: Camera) -> tuple[float, float, float]:
    """1 / z_s in 1/m, and the reach of a lens in px m along u and v.

    The blur circle A f |z - z_s| / (z (z_s - f)) of depth z is reach |1 / z_s - 1 / z| with a reach
    of A f z_s / (z_s - f), over the pixel's sides.
    """
    assert camera.aperture is not None
    assert camera.focus_distance is not None
    assert camera.focal_length is not None
    assert camera.pixel_size is not None
    f, z_s = camera.focal_length, camera.focus_distance
    reach = camera.aperture * f * z_s / (z_s - f)
    s_u, s_v = camera.pixel_size
    return 1 / z_s, reach / s_u, reach / s_v


def ray_bundles(count: int) -> FloatArray:
    """Points of the lens (a disc of diameter 1) and of the pixel (+-1/2), (count, 4).

    A lattice that fills four dimensions evenly: powers of the real root of x^5 = x + 1, after M.
    Roberts. The Unreasonable Effectiveness of Quasirandom Sequences. 2018. The disc by P. Shirley,
    K. Chiu. A Low Distortion Map Between Disk and Square. 1997.
    """
    root = 1.1673039782614187
    steps = root ** -np.arange(1.0, 5.0)
    points = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    a, b = (2 * points[:, :2] - 1).T
    is_wide = np.abs(a) > np.abs(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(is_wide, np.pi / 4 * b / a, np.pi / 2 - np.pi / 4 * a / b)
    angle = np.nan_to_num(angle)
    radius = np.where(is_wide, a, b) / 2
    lens = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    # Relative to their mean; edges would move by a few hundredths of a pixel otherwise.
    shift = points[:, 2:] - points[:, 2:].mean(axis=0)
    return np.concatenate((lens, shift), axis=1)


def sensor(
    light: FloatArray, rng: np.random.Generator, *, read_noise: float = 1.5, full_well: float = 1e4
) -> NDArray[np.uint8]:
    """Grey levels of a sensor, linear, with noise, (H, W).

    Parameters
    ----------
    light : (H, W) float64
        Reflected light, 0 to 1.
    rng : Generator
        Source of the noise.
    read_noise : float
        Standard deviation of the read-out, grey levels.
    full_well : float
        Electrons at grey level 255; their standard deviation is the root of their number.
    """
    level = FULL_SCALE * light
    spread = np.sqrt(read_noise**2 + level * 255 / full_well)
    noisy = level + spread * rng.standard_normal(light.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
