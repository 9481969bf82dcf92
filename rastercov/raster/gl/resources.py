"""Ownership of every OpenGL object of a rasteriser, and the calls that moderngl does not offer.

moderngl reports neither a failed allocation, which leaves an object that does not work, nor a
missing memory barrier, which gives wrong counts. Allocation, error polling, clearing, reading and
the barrier are therefore implemented once, here, and the strategies use nothing else.
"""

import ctypes
from contextlib import ExitStack
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov import shaders
from rastercov.base.errors import DeviceError, ResourceError
from rastercov.raster.gl.context import HeadlessContext

_R32UI, _RED_INTEGER, _UNSIGNED_INT = 0x8236, 0x8D94, 0x1405
_UINT, _POINTER, _SIZE = ctypes.c_uint, ctypes.c_void_p, ctypes.c_ssize_t


class Resources:
    """OpenGL objects of one rasteriser on one context; `release` releases all of them."""

    def __init__(self, context: HeadlessContext) -> None:
        self.context = context
        self.gl = context.gl
        self._stack = ExitStack()
        # moderngl lists objects that Python has dropped, to release them later. Objects that were
        # released explicitly stay in that list, so they are removed from it.
        left = [thing for thing in self.gl.objects if not isinstance(thing, moderngl.InvalidObject)]
        self.gl.objects.clear()
        self.gl.objects.extend(left)

    def use(self) -> None:
        """Make the context current."""
        self.context.check_owner()
        self.context.make_current()
        self.gl.memory_barrier()  # shaders of an interrupted call may still write counters

    def own(self, thing: Any) -> Any:
        """Return an OpenGL object and release it in `release`."""
        self._stack.callback(thing.release)
        return thing

    def buffer(self, what: str, data: NDArray[Any] | None = None, size: int = 0) -> Any:
        """Buffer with the given contents, or of `size` bytes; ResourceError if it is refused."""
        contents = None if data is None else np.ascontiguousarray(data)
        n_bytes = size if contents is None else contents.nbytes
        asked = f"{what} ({n_bytes / 2**20:,.1f} MiB)"
        try:
            made = self.gl.buffer(contents, size, dynamic=contents is None)
        except (moderngl.Error, MemoryError) as error:
            raise ResourceError(f"the device refused {asked}: {error}") from None
        reported = self.gl.error
        if reported != "GL_NO_ERROR":
            made.release()
            raise ResourceError(f"the device refused {asked}: {reported}")
        return self.own(made)

    def compute(self, name: str, **defines: int) -> Any:
        """Compute program of the named shader."""
        try:
            return self.own(self.gl.compute_shader(shaders.source(f"{name}.comp", **defines)))
        except moderngl.Error as error:
            log = " ".join(str(error).split())
            raise DeviceError(
                f"{self.context.info.renderer} cannot compile {name}.comp "
                f"(shaders {shaders.digest()[:12]}): {log}"
            ) from None

    def zero(self, buffer: Any, size: int) -> None:
        """Set the first `size` bytes of a buffer, a multiple of 4, to 0 on the device."""
        types = _UINT, _UINT, _SIZE, _SIZE, _UINT, _UINT, _POINTER
        clear = self.context.function("glClearNamedBufferSubData", None, *types)
        clear(buffer.glo, _R32UI, 0, size, _RED_INTEGER, _UNSIGNED_INT, None)

    def read_words(self, buffer: Any, *shape: int) -> NDArray[np.uint32]:
        """First words of a buffer, after a barrier: the only reader of what shaders wrote."""
        self.gl.memory_barrier()
        words = np.empty(shape, np.uint32)
        buffer.read_into(words, size=words.nbytes)
        return words

    def untrusted(self, what: str) -> DeviceError:
        """Error to raise when the device has given a wrong result."""
        renderer = self.context.info.renderer
        return DeviceError(
            f"{renderer} {what}; its answers cannot be trusted, see `rastercov doctor`"
        )

    def poll(self, doing: str) -> None:
        """Raise when the device has reported an error or lost the context while `doing`."""
        error = self.gl.error
        if error == "GL_OUT_OF_MEMORY":
            raise ResourceError(f"the device ran out of memory while {doing}")
        if error != "GL_NO_ERROR":
            raise DeviceError(f"the device reported {error} while {doing}")
        if self.context.reset_status():
            raise DeviceError(f"the driver lost the context while {doing}; open a new rasteriser")

    def release(self) -> None:
        """Release every object."""
        self.context.parking_frame.use()  # moderngl rebinds the framebuffer that was bound last
        self._stack.close()


def set_uniforms(program: Any, **uniforms: Any) -> None:
    """Set the uniforms that the program has; the compiler removes unused ones."""
    for name, value in uniforms.items():
        if name in program:
            program[name].value = value
