"""Everything a rasteriser owns on an OpenGL device, and the few calls moderngl has no name for.

moderngl reports neither a failed allocation nor a missing memory barrier: the one gives an object
that does not work, the other wrong counts, both without an error. So allocation, error polling,
clearing, reading and the barrier each stand here once, and nothing else touches the device.
"""

import ctypes
from contextlib import ExitStack
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov import shaders
from rastercov.errors import DeviceError, ResourceError
from rastercov.raster.gl.context import HeadlessContext

_COLOR, _DEPTH = 0x1800, 0x1801
_DEPTH_ATTACHMENT, _DEPTH_COMPONENT, _DEPTH_COMPONENT32F = 0x8D00, 0x1902, 0x8CAC
_FRAMEBUFFER, _TEXTURE_2D_ARRAY = 0x8D40, 0x8C1A
_LOWER_LEFT, _ZERO_TO_ONE, _FLOAT = 0x8CA1, 0x935F, 0x1406
_STORAGE_BUFFER, _R32UI, _RED_INTEGER, _UNSIGNED_INT = 0x90D2, 0x8236, 0x8D94, 0x1405
_UINT, _INT, _POINTER = ctypes.c_uint, ctypes.c_int, ctypes.c_void_p
_SIZE = ctypes.c_ssize_t


class Target:
    """A stack of triangle-ID images (uint32) with float32 depth, one layer a pose."""

    def __init__(self, arena: "Arena", width: int, height: int, layers: int) -> None:
        self.width, self.height, self.layers = width, height, layers
        what = f"{layers} images of {width} x {height}"
        size = width * height * layers * 8
        gl = arena.gl
        self.faces = arena.own(
            arena.make(what, size, lambda: gl.texture_array((width, height, layers), 1, dtype="u4"))
        )
        self.faces.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self.frame = arena.own(arena.make(what, size, lambda: gl.framebuffer([self.faces])))
        arena.attach_depth(self.frame, width, height, layers, what)
        self.frame.depth_mask = True  # moderngl takes it that a frame without its depth has none


class Arena:
    """The objects of one rasteriser on one context; `release` gives all of them back."""

    def __init__(self, context: HeadlessContext) -> None:
        self.context = context
        self.gl = context.gl
        self._stack = ExitStack()
        # moderngl lists what Python has let go of, to release it. What an earlier arena released by
        # itself would stay there.
        left = [thing for thing in self.gl.objects if not isinstance(thing, moderngl.InvalidObject)]
        self.gl.objects.clear()
        self.gl.objects.extend(left)
        self._bind_framebuffer = context.function("glBindFramebuffer", None, _UINT, _UINT)
        self._clear_ids = context.function("glClearBufferuiv", None, _UINT, _INT, _POINTER)
        self._clear_depth = context.function("glClearBufferfv", None, _UINT, _INT, _POINTER)
        self.is_reversed = context.info.has_clip_control

    def use(self) -> None:
        """Make the context current and set the state that all draws share."""
        self.context.check_owner()
        self.context.make_current()
        if self.is_reversed:
            self.context.function("glClipControl", None, _UINT, _UINT)(_LOWER_LEFT, _ZERO_TO_ONE)
        self.gl.memory_barrier()  # an interrupted call may have left shaders at work on counters
        self.gl.front_face = "cw"  # counter-clockwise in the world, seen with rows running down
        self.gl.cull_face = "back"

    def own(self, thing: Any) -> Any:
        """Release `thing` when the arena goes; returns it."""
        self._stack.callback(thing.release)
        return thing

    def make(self, what: str, size: int, create: Any) -> Any:
        """Run one allocation and check what came of it.

        Raises
        ------
        ResourceError
            When the device refuses; says what was asked and how many bytes.
        """
        asked = f"{what} ({size / 2**20:,.1f} MiB)"
        try:
            thing = create()
        except (moderngl.Error, MemoryError) as error:
            raise ResourceError(f"the device refused {asked}: {error}") from None
        reported = self.gl.error
        if reported != "GL_NO_ERROR":
            thing.release()
            raise ResourceError(f"the device refused {asked}: {reported}")
        return thing

    def buffer(self, what: str, data: NDArray[Any] | None = None, size: int = 0) -> Any:
        """Buffer with these contents, or of this many bytes."""
        if data is not None:
            contents = np.ascontiguousarray(data)
            size = contents.nbytes
            return self.own(self.make(what, size, lambda: self.gl.buffer(contents)))
        return self.own(self.make(what, size, lambda: self.gl.buffer(reserve=size, dynamic=True)))

    def program(self, fragment: str, version: int, **defines: int) -> Any:
        """Program that draws faces with the fragment stage of this name."""
        stages = {
            "vertex_shader": shaders.source("face.vert", version, **defines),
            "fragment_shader": shaders.source(f"{fragment}.frag", version, **defines),
        }
        return self._compile(f"face.vert and {fragment}.frag", self.gl.program, **stages)

    def compute(self, name: str, version: int, **defines: int) -> Any:
        """Compute program of this name."""
        text = shaders.source(f"{name}.comp", version, **defines)
        return self._compile(f"{name}.comp", self.gl.compute_shader, source=text)

    def _compile(self, names: str, build: Any, **stages: str) -> Any:
        try:
            return self.own(build(**stages))
        except moderngl.Error as error:
            log = " ".join(str(error).split())
            raise DeviceError(
                f"{self.context.info.renderer} cannot compile {names} "
                f"(shaders {shaders.digest()[:12]}): {log}"
            ) from None

    def attach_depth(self, frame: Any, width: int, height: int, layers: int, what: str) -> None:
        """Give a framebuffer float32 depth; moderngl itself only makes 24-bit depth."""
        call = self.context.function
        name = _UINT(0)
        call("glGenTextures", None, _INT, _POINTER)(1, ctypes.addressof(name))
        delete = call("glDeleteTextures", None, _INT, _POINTER)
        self._stack.callback(lambda: delete(1, ctypes.addressof(name)))
        call("glBindTexture", None, _UINT, _UINT)(_TEXTURE_2D_ARRAY, name.value)
        image = call(
            "glTexImage3D", None, _UINT, _INT, _INT, _INT, _INT, _INT, _INT, _UINT, _UINT, _POINTER
        )
        image(
            _TEXTURE_2D_ARRAY, 0, _DEPTH_COMPONENT32F, width, height, layers, 0,
            _DEPTH_COMPONENT, _FLOAT, None,
        )  # fmt: skip
        self._bind_framebuffer(_FRAMEBUFFER, frame.glo)
        attach = call("glFramebufferTexture", None, _UINT, _UINT, _UINT, _INT)
        attach(_FRAMEBUFFER, _DEPTH_ATTACHMENT, name.value, 0)
        status = call("glCheckFramebufferStatus", _UINT, _UINT)(_FRAMEBUFFER)
        error = self.gl.error
        if status != 0x8CD5 or error != "GL_NO_ERROR":
            size = width * height * layers * 4 / 2**20
            raise ResourceError(
                f"the device refused depth for {what} ({size:,.1f} MiB): "
                f"{error}, framebuffer status {status:#x}"
            )

    def clear(self, target: Target, face: int = 0) -> None:
        """Set every id of every layer to `face`, and depth to the farthest value."""
        target.frame.use()
        ids = (_UINT * 4)(face)
        self._clear_ids(_COLOR, 0, ctypes.addressof(ids))
        farthest = ctypes.c_float(0.0 if self.is_reversed else 1.0)
        self._clear_depth(_DEPTH, 0, ctypes.addressof(farthest))

    def read_faces(self, target: Target, box: tuple[int, int, int, int]) -> NDArray[np.uint32]:
        """Ids of layer 0 inside box = (x, y, width, height), (height, width)."""
        ids = np.empty((box[3], box[2]), np.uint32)
        target.frame.read_into(ids, viewport=box, components=1, dtype="u4", alignment=4)
        return ids

    def read_depth(self, target: Target, box: tuple[int, int, int, int]) -> NDArray[np.float32]:
        """Depth buffer values of layer 0 inside a box, as the device holds them."""
        depth = np.empty((box[3], box[2]), np.float32)
        target.frame.read_into(depth, viewport=box, components=1, attachment=-1, dtype="f4")
        return depth

    def zero(self, buffer: Any, size: int) -> None:
        """Set the first bytes of a buffer, a multiple of 4, to 0 on the device itself."""
        call = self.context.function
        call("glBindBuffer", None, _UINT, _UINT)(_STORAGE_BUFFER, buffer.glo)
        clear = call(
            "glClearBufferSubData", None, _UINT, _UINT, _SIZE, _SIZE, _UINT, _UINT, _POINTER
        )
        clear(_STORAGE_BUFFER, _R32UI, 0, size, _RED_INTEGER, _UNSIGNED_INT, None)

    def read_words(self, buffer: Any, *shape: int) -> NDArray[np.uint32]:
        """Counters and the like that shaders wrote; the only reader, and it waits for them."""
        self.gl.memory_barrier()
        words = np.empty(shape, np.uint32)
        buffer.read_into(words, size=words.nbytes)
        return words

    def distrust(self, what: str) -> DeviceError:
        """Error to raise when the device has answered wrongly."""
        renderer = self.context.info.renderer
        return DeviceError(
            f"{renderer} {what}; its answers cannot be trusted, see `rastercov doctor`"
        )

    def poll(self, doing: str) -> None:
        """Raise when the device has reported an error, or lost the context, while `doing`."""
        error = self.gl.error
        if error == "GL_OUT_OF_MEMORY":
            raise ResourceError(f"the device ran out of memory while {doing}")
        if error != "GL_NO_ERROR":
            raise DeviceError(f"the device reported {error} while {doing}")
        if self.context.reset_status():
            raise DeviceError(f"the driver lost the context while {doing}; open a new rasteriser")

    def release(self) -> None:
        """Give everything back."""
        self.context.parking_frame.use()  # moderngl goes back to the frame bound last
        self._stack.close()
