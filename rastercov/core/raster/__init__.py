"""Rasterisers: samples of each face in each pose, counted on the CPU or by OpenGL."""

import logging
import math
from typing import Any

from rastercov.base import (
    ByName,
    CameraError,
    ConfigError,
    DeviceError,
    MeshError,
    ReadByName,
    check_choice,
    check_kind,
    finite_number,
    service_of,
    shown,
)
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import self_test
from rastercov.core.raster.contract import (
    BACKENDS,
    MAX_SUPERSAMPLE,
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
)

__all__ = ["FaceCounts", "Rasterizer", "RasterizerInfo", "VisibilityBuffer", "open_rasterizer"]

LOG = logging.getLogger("rastercov")


class Drawer:
    """Hooks of a rasteriser beside that of the CPU."""

    def open_rasterizer(self, mesh: Mesh, camera: Camera, options: ReadByName) -> Rasterizer:
        """The rasteriser; DeviceError where there is none."""
        raise DeviceError("expected a rasteriser of OpenGL, got none; use backend 'cpu'")

    def find_gpu(self) -> str:
        """Name of the first GPU that passes its self-test; "" without one."""
        return ""

    def examine(self) -> ByName:
        """Devices, libraries and settings of this machine, and the self-test of the CPU."""
        raise DeviceError("expected OpenGL to examine, got none; use backend 'cpu'")


_OPTIONS = {
    "cpu": ("threads",),
    "gl": ("device", "plan"),
}
"""Options of `open_rasterizer` that each backend takes."""


def open_rasterizer(
    mesh: Mesh,
    camera: Camera,
    backend: str = "auto",
    *,
    supersample: int = 1,
    roll: float = 0.0,
    **options: Any,
) -> Rasterizer:
    """Rasteriser for a mesh and a camera; use it in a `with` block.

    Parameters
    ----------
    mesh : Mesh
        The faces, occluders included; it is sent to the device once.
    camera : Camera
        The camera.
    backend : {"auto", "cpu", "gl"}
        "auto", the default, selects "gl" if an option of OpenGL is given, and otherwise "cpu",
        which needs no graphics library and was faster even than a GPU
        (docs/appendix/rasterisers.md). A lens with distortion, and targets, are always drawn on
        the CPU, as a warning and `info` of the result state; a device named here must exist
        nevertheless.
    supersample : int
        S, from 1 to 64: the samples are a regular S x S grid in each pixel.
    roll : float
        Angle, radians, by which the rows of samples of `count` are rotated about the image centre
        relative to those of pixels, from u towards v; there are still S^2 of them in a px^2, in the
        same image. Counts on a rotated grid estimate areas better where edges run
        along pixel rows and columns, as those of manufactured parts do.
    **options
        For the CPU `threads`; for OpenGL `device` and `plan`, see
        `rastercov.gl.GLRasterizer`. `device="hardware"` takes a GPU; `device` may also be
        the name of a backend.

    Raises
    ------
    ConfigError
        For an unknown backend, an option that it does not take, a supersample that is not 1 to 64,
        an invalid roll, or an OpenGL plan for pinholes with another camera.
    DeviceError
        When the device cannot be opened or fails its self-test.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera(width=64, height=48, fx=60, fy=60)
    >>> with rc.open_rasterizer(mesh, camera, "cpu") as rasterizer:
    ...     counts = rasterizer.count(rc.look_at((0.7, 0, 0), (0, 0, 0)))
    >>> # visible samples; samples without occlusion
    >>> int(counts.visible.sum()), int(counts.drawn.sum())
    (400, 800)
    """
    check_kind("mesh", mesh, Mesh, "a Mesh (Mesh.load reads a file)", MeshError)
    check_kind("camera", camera, Camera, "a Camera (Camera.load reads a file)", CameraError)
    if finite_number(supersample) not in range(1, MAX_SUPERSAMPLE + 1):
        raise ConfigError(
            f"expected supersample to be a whole number from 1 to {MAX_SUPERSAMPLE}, got "
            f"{shown(supersample)}"
        )
    if math.isnan(finite_number(roll)):
        raise ConfigError(f"expected roll to be an angle in radians, got {shown(roll)}")
    common: ByName = {"supersample": int(supersample), "roll": float(roll)}
    backend, options = backend_of(backend, options)
    if backend == "gl" and (camera.is_curved or mesh.has_targets):
        # What would be refused for a pinhole and surfaces is refused.
        drawer().open_rasterizer(self_test.MESH, self_test.CAMERA, options).close()
        what = f"the lens {camera.model}" if camera.is_curved else "targets"
        LOG.warning("the CPU draws %s in place of OpenGL", what)
        backend, options = "cpu", {}
    if camera.is_curved:
        from rastercov.core.raster.lens import LensRasterizer

        return LensRasterizer(mesh, camera, **common, threads=options.get("threads"))
    if backend in ("auto", "cpu"):
        # It compiles, or loads what was compiled.
        from rastercov.core.raster.cpu import CPURasterizer

        return CPURasterizer(mesh, camera, **common, **options)
    return drawer().open_rasterizer(mesh, camera, common | options)


def drawer() -> Drawer:
    """Hooks of the feature that draws; it imports OpenGL when it is asked to."""
    return service_of("gl", Drawer())


def backend_of(backend: str, options: ReadByName) -> tuple[str, ByName]:
    """Backend that options of `open_rasterizer` leave, and those to pass to it.

    It is "auto" only where there are none. A device "auto", "cpu" or "gl" is the backend of this
    name.

    Raises
    ------
    ConfigError
        For a backend that does not exist, another one than the device, and for an option that the
        backend does not take.
    """
    check_choice("backend", backend, BACKENDS)
    left = dict(options)
    device = left.get("device")
    if isinstance(device, str) and device in BACKENDS:
        del left["device"]
        if "auto" not in (backend, device) and device != backend:
            raise ConfigError(
                f"expected device to be one of backend {backend}, got {device!r}; remove one of "
                "the two"
            )
        backend = device if backend == "auto" else backend
    if backend == "auto" and left:
        backend = "cpu" if left.keys() <= {*_OPTIONS["cpu"]} else "gl"
    if unknown := left.keys() - _OPTIONS.get(backend, ()):
        takes = "; ".join(f"{each} takes {', '.join(names)}" for each, names in _OPTIONS.items())
        raise ConfigError(
            f"expected options that the backend takes, got {', '.join(sorted(unknown))}; {takes}"
        )
    return backend, left
