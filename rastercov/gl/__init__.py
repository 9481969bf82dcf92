"""OpenGL rasteriser.

    GLRasterizer (rasterizer)           contract, ownership, self-test
        HeadlessContext (context)       OpenGL context of a device (devices, libraries)
        Resources (resources)           every OpenGL object, error polling
        Strategy (strategy)             one of two:
            Pipeline (pipeline)         plan "pipeline"
            Compute (compute)           plan "compute"

`rastercov.core.raster.contract` asks `devices` for hardware even when the CPU then counts. The
rasteriser and moderngl are therefore imported when one of the names below is first used.
"""

from typing import TYPE_CHECKING, Any

from rastercov.base import ByName, DeviceError, ReadByName
from rastercov.core.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.core.raster import Drawer
from rastercov.core.raster.contract import Rasterizer

if TYPE_CHECKING:
    from rastercov.gl.rasterizer import PLANS, GLRasterizer

__all__ = ["PLANS", "GLRasterizer"]


def __getattr__(name: str) -> Any:
    """Import the rasteriser on first use of `GLRasterizer` or `PLANS`.

    Raises
    ------
    DeviceError
        Where moderngl is not installed, as for Linux on aarch64, or is broken.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from rastercov.gl import rasterizer
    except ImportError as error:
        raise DeviceError(
            f"expected OpenGL, got an import error ({error}); run: pip install "
            "moderngl, or use the device cpu"
        ) from error
    return getattr(rasterizer, name)


class _Drawer(Drawer):
    def open_rasterizer(self, mesh: Mesh, camera: Camera, options: ReadByName) -> Rasterizer:
        """The rasteriser of OpenGL."""
        drawn: Rasterizer = __getattr__("GLRasterizer")(mesh, camera, **options)
        return drawn

    def find_gpu(self) -> str:
        """See `rastercov.gl.diagnose`."""
        from rastercov.gl.diagnose import find_gpu

        return find_gpu()

    def examine(self) -> ByName:
        """See `rastercov.gl.diagnose`."""
        from rastercov.gl.diagnose import examine

        return examine()


HOOKS = _Drawer()
"""Hooks of this feature."""
