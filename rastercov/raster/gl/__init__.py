"""OpenGL rasteriser.

    GLRasterizer (rasterizer)           contract, ownership, self-test
        HeadlessContext (context)       OpenGL context of a device (devices, libraries)
        Resources (resources)           every OpenGL object, error polling
        Strategy (strategy)             one of two:
            Pipeline (pipeline)         plan "pipeline"; scene, coplanar
            Compute (compute)           plan "compute"

`rastercov.raster.contract` asks `devices` for hardware even when the CPU then counts. The
rasteriser and moderngl are therefore imported when one of the names below is first used.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rastercov.raster.gl.rasterizer import PLANS, WAYS, GLRasterizer

__all__ = ["PLANS", "WAYS", "GLRasterizer"]


def __getattr__(name: str) -> Any:
    """Import the rasteriser on first use of `GLRasterizer`, `PLANS` or `WAYS`."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rastercov.raster.gl import rasterizer

    return getattr(rasterizer, name)
