"""Rasterisers: samples of each face in each pose, counted on the CPU or by OpenGL."""

import math
from typing import Any

from rastercov._arguments import check_choice, check_scene
from rastercov._checks import finite_number, shown
from rastercov.camera import Camera
from rastercov.errors import ConfigError, DeviceError
from rastercov.mesh import Mesh
from rastercov.raster.contract import (
    MAX_SUPERSAMPLE,
    FaceCounts,
    Rasterizer,
    RasterizerInfo,
    VisibilityBuffer,
)

__all__ = ["FaceCounts", "Rasterizer", "RasterizerInfo", "VisibilityBuffer", "open_rasterizer"]


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
        Image size and intrinsics.
    backend : {"auto", "cpu", "gl"}
        "cpu" needs no graphics library. "auto" takes a hardware OpenGL device when one opens, and
        the CPU otherwise: it is several times as fast as OpenGL in software.
    supersample : int
        S; the samples are a regular S x S grid in each pixel.
    roll : float
        Radians by which the rows of samples that `count` counts are turned about the image centre
        against those of pixels, from u towards v; there are still S^2 of them in a px^2, in the
        same image. Turned by an odd angle, counts are nearer to areas where edges run along the
        rows and columns of pixels, as those of manufactured parts do.
    **options
        Passed on: `threads` to `rastercov.raster.cpu.CPURasterizer`; `device`, `plan` and more to
        `rastercov.raster.gl.GLRasterizer`, which "auto" then means.

    Raises
    ------
    ConfigError
        For an unknown backend, a supersample that is not 1 to 64, a roll that is no angle, or a
        plan of OpenGL that draws pinholes only for another camera.
    DeviceError
        When the device cannot be opened or fails its self-test.
    """
    check_scene(mesh, camera)
    if finite_number(supersample) not in range(1, MAX_SUPERSAMPLE + 1):
        raise ConfigError(
            f"supersample must be a whole number 1 to {MAX_SUPERSAMPLE}, got {shown(supersample)}"
        )
    if math.isnan(finite_number(roll)):
        raise ConfigError(f"roll must be an angle in radians, got {shown(roll)}")
    common: dict[str, Any] = {"supersample": int(supersample), "roll": float(roll)}
    check_choice("backend", backend, ("auto", "cpu", "gl"))
    if backend == "auto":
        if not options and (hardware := _open_hardware(mesh, camera, common)):
            return hardware
        backend = "gl" if options.keys() - {"threads"} else "cpu"
    if backend == "cpu":
        # Each compiles, or loads what was compiled.
        if not camera.is_pinhole:
            from rastercov.raster.cpu.lens_rasterizer import LensRasterizer

            return LensRasterizer(mesh, camera, **common, **options)
        from rastercov.raster.cpu import CPURasterizer

        return CPURasterizer(mesh, camera, **common, **options)
    from rastercov.raster.gl import GLRasterizer  # imports OpenGL only when it is wanted

    return GLRasterizer(mesh, camera, **common, **options)


def _open_hardware(mesh: Mesh, camera: Camera, common: dict[str, Any]) -> Rasterizer | None:
    """Rasteriser on a hardware device, None when none is announced or none works."""
    from rastercov.raster.gl.devices import list_devices

    if all(device.is_software for device in list_devices()):
        return None
    from rastercov.raster.gl import GLRasterizer

    try:
        return GLRasterizer(mesh, camera, require_hardware=True, **common)
    except DeviceError:
        return None
