"""Ownership of every OpenGL object of a rasteriser, and the calls that moderngl does not offer.

moderngl reports neither a failed allocation, which leaves an object that does not work, nor a
missing memory barrier, which gives wrong counts. Allocation, error polling, clearing, reading and
the barrier are therefore implemented once, here, and the strategies use nothing else.
"""

import ctypes
import math
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from rastercov import shaders
from rastercov.base import AnyArray, ByteArray, DeviceError, ResourceError
from rastercov.gl.context import HeadlessContext

_COLOR, _DEPTH = 0x1800, 0x1801
_DEPTH_ATTACHMENT, _DEPTH_COMPONENT32F = 0x8D00, 0x8CAC
_FRAMEBUFFER, _FRAMEBUFFER_COMPLETE, _TEXTURE_2D = 0x8D40, 0x8CD5, 0x0DE1
_LOWER_LEFT, _ZERO_TO_ONE = 0x8CA1, 0x935F
_MAP_READ, _MAP_WRITE, _MAP_PERSISTENT, _MAP_COHERENT, _CLIENT_STORAGE = 1, 2, 0x40, 0x80, 0x200
_COMMANDS_COMPLETE, _FLUSH, _ALREADY_SIGNALED, _TIMEOUT_EXPIRED = 0x9117, 1, 0x911A, 0x911B
_UINT, _INT, _SIZE, _POINTER = ctypes.c_uint, ctypes.c_int, ctypes.c_ssize_t, ctypes.c_void_p
FUNCTIONS: dict[str, tuple[Any, ...]] = {  # name: (result, *arguments), of those moderngl lacks
    "glCheckNamedFramebufferStatus": (_UINT, _UINT, _UINT),
    "glClearBufferfv": (None, _UINT, _INT, _POINTER),
    "glClearBufferuiv": (None, _UINT, _INT, _POINTER),
    "glClientWaitSync": (_UINT, _POINTER, _UINT, ctypes.c_uint64),
    "glClipControl": (None, _UINT, _UINT),
    "glCopyNamedBufferSubData": (None, _UINT, _UINT, _SIZE, _SIZE, _SIZE),
    "glCreateBuffers": (None, _INT, _POINTER),
    "glCreateTextures": (None, _UINT, _INT, _POINTER),
    "glDeleteBuffers": (None, _INT, _POINTER),
    "glDeleteSync": (None, _POINTER),
    "glDeleteTextures": (None, _INT, _POINTER),
    "glFenceSync": (_POINTER, _UINT, _UINT),
    "glMapNamedBufferRange": (_POINTER, _UINT, _SIZE, _SIZE, _UINT),
    "glNamedBufferStorage": (None, _UINT, _SIZE, _POINTER, _UINT),
    "glNamedFramebufferTexture": (None, _UINT, _UINT, _UINT, _INT),
    "glTextureStorage2D": (None, _UINT, _INT, _UINT, _INT, _INT),
}

FACE_BYTES, DEPTH_BYTES = 4, 4
SAMPLE_BYTES = FACE_BYTES + DEPTH_BYTES
"""Bytes of a sample of a `Target`: face index and depth."""
WORDS, MAX_ZERO_GROUPS = 7, 4096
"""Binding and most workgroups of zero.comp."""
LEAST_STAGED = 1 << 16
"""Least bytes of the buffers through which words go to and from the device."""
RING = 2
"""Staging buffers of a role."""
WAIT_NS = 1_000_000_000
"""Time after which the device is asked again if it is lost."""


class Target:
    """Triangle-ID image (uint32) with float32 depth."""

    def __init__(self, resources: "Resources", width: int, height: int) -> None:
        what = f"an image of {width} x {height}"
        size = width * height * SAMPLE_BYTES
        gl = resources.gl
        faces = resources.make(what, size, lambda: gl.texture((width, height), 1, dtype="u4"))
        self.frame = resources.make(what, size, lambda: gl.framebuffer([faces]))
        resources.attach_depth(self.frame, width, height, what)
        # moderngl disables the depth mask for a depth attachment that it did not create.
        self.frame.depth_mask = True


class Staging:
    """Buffer of the host, mapped for good, through which words go to and from the device.

    A buffer that shaders use and the host reads or writes by itself is moved to the host by some
    drivers, and every access of a shader then crosses the bus. A fence tells when the device is
    done with the last copy: the host touches the bytes after that.
    """

    def __init__(self, resources: "Resources", size: int) -> None:
        self._resources, self.size, self._fence = resources, size, 0
        name = _UINT(0)
        flags = _MAP_READ | _MAP_WRITE | _MAP_PERSISTENT | _MAP_COHERENT

        def create() -> "Staging":
            resources.call("glCreateBuffers", 1, ctypes.addressof(name))
            self._name = name.value
            storage = flags | _CLIENT_STORAGE
            resources.call("glNamedBufferStorage", self._name, size, None, storage)
            address = resources.call("glMapNamedBufferRange", self._name, 0, size, flags)
            if not address:
                raise MemoryError(
                    "expected an address of the mapped buffer, got none; use backend 'cpu'"
                )
            memory = memoryview((ctypes.c_char * size).from_address(address))
            self._bytes = np.frombuffer(memory, np.uint8)
            return self

        resources.make("staging", size, create)

    def read(self, buffer: moderngl.Buffer, n_bytes: int) -> None:
        """Start to copy the first bytes of a buffer, for `take`."""
        self._wait()
        self._copy(buffer.glo, self._name, n_bytes)

    def take(self, n_bytes: int) -> ByteArray:
        """Bytes that were read, once they are there; they hold until the buffer is used again."""
        self._wait()
        return self._bytes[:n_bytes]

    def write(self, buffer: moderngl.Buffer, data: AnyArray) -> None:
        """Copy an array to the start of a buffer; the device does so after what it has to do."""
        self._wait()
        self._bytes[: data.nbytes] = data.reshape(-1).view(np.uint8)
        self._copy(self._name, buffer.glo, data.nbytes)

    def _copy(self, source: int, target: int, n_bytes: int) -> None:
        self._resources.call("glCopyNamedBufferSubData", source, target, 0, 0, n_bytes)
        self._fence = self._resources.call("glFenceSync", _COMMANDS_COMPLETE, 0)

    def _wait(self) -> None:
        """Return when the device is done with the last copy."""
        if not self._fence:
            return
        state = _TIMEOUT_EXPIRED
        while state == _TIMEOUT_EXPIRED:
            state = self._resources.call("glClientWaitSync", self._fence, _FLUSH, WAIT_NS)
            if state != _ALREADY_SIGNALED:
                self._resources.poll("waiting for the device")
        self._resources.call("glDeleteSync", self._fence)
        self._fence = 0

    def release(self) -> None:
        """Give the memory back."""
        name = _UINT(self._name)
        self._resources.call("glDeleteBuffers", 1, ctypes.addressof(name))


class Resources:
    """OpenGL objects of one rasteriser on one context; `release` releases all of them."""

    def __init__(self, context: HeadlessContext) -> None:
        self.context = context
        self.gl = context.gl
        self._stack = ExitStack()
        self._zeroing: Any = None
        self._staged: dict[str, list[Staging]] = {}
        # moderngl lists objects that Python has dropped, to release them later. Objects that were
        # released explicitly stay in that list, so they are removed from it.
        left = [thing for thing in self.gl.objects if not isinstance(thing, moderngl.InvalidObject)]
        self.gl.objects.clear()
        self.gl.objects.extend(left)

    def use(self) -> None:
        """Make the context current and set the state that all draws share."""
        self.context.check_owner()
        self.context.make_current()
        self.call("glClipControl", _LOWER_LEFT, _ZERO_TO_ONE)
        self.gl.memory_barrier()  # shaders of an interrupted call may still write counters
        self.gl.front_face = "cw"  # counter-clockwise in the world, seen with rows running down
        self.gl.cull_face = "back"

    def call(self, name: str, *arguments: object) -> Any:
        """Result of one of `FUNCTIONS`."""
        return self.context.function(name, *FUNCTIONS[name])(*arguments)

    def own(self, thing: Any) -> Any:
        """Return an OpenGL object and release it in `release`."""
        self._stack.callback(thing.release)
        return thing

    def make(self, what: str, size: int, create: Callable[[], Any]) -> Any:
        """Result of `create()`, owned; ResourceError with `what` and its `size` if it fails."""
        asked = f"{what} ({size / 2**20:,.1f} MiB)"
        try:
            thing = create()
        except (moderngl.Error, MemoryError) as error:
            raise ResourceError(f"expected the device to allocate {asked}, got: {error}") from None
        reported = self.gl.error
        if reported != "GL_NO_ERROR":
            thing.release()
            raise ResourceError(f"expected the device to allocate {asked}, got: {reported}")
        return self.own(thing)

    def buffer(self, what: str, data: AnyArray | None = None, size: int = 0) -> Any:
        """Buffer with the given contents, or of `size` bytes."""
        if data is None:
            return self.make(what, size, lambda: self.gl.buffer(None, size, dynamic=True))
        contents = np.ascontiguousarray(data)
        return self.make(what, contents.nbytes, lambda: self.gl.buffer(contents))

    def program(self, fragment: str, **defines: int) -> Any:
        """Program of `face.vert` and the named fragment shader."""
        stages = {
            "vertex_shader": shaders.source("face.vert", **defines),
            "fragment_shader": shaders.source(f"{fragment}.frag", **defines),
        }
        return self._compile(f"face.vert and {fragment}.frag", self.gl.program, **stages)

    def compute(self, name: str, **defines: int) -> Any:
        """Compute program of the named shader."""
        text = shaders.source(f"{name}.comp", **defines)
        return self._compile(f"{name}.comp", self.gl.compute_shader, source=text)

    def _compile(self, names: str, build: Callable[..., Any], **stages: str) -> Any:
        try:
            return self.own(build(**stages))
        except moderngl.Error as error:
            log = " ".join(str(error).split())
            raise DeviceError(
                f"expected {self.context.info.renderer} to compile {names} (shaders "
                f"{shaders.digest()[:12]}), got: {log}"
            ) from None

    def attach_depth(self, frame: moderngl.Framebuffer, width: int, height: int, what: str) -> None:
        """Attach a float32 depth texture to a framebuffer; moderngl only makes 24-bit depth."""
        name = _UINT(0)
        self.call("glCreateTextures", _TEXTURE_2D, 1, ctypes.addressof(name))
        self._stack.callback(lambda: self.call("glDeleteTextures", 1, ctypes.addressof(name)))
        self.call("glTextureStorage2D", name.value, 1, _DEPTH_COMPONENT32F, width, height)
        self.call("glNamedFramebufferTexture", frame.glo, _DEPTH_ATTACHMENT, name.value, 0)
        status = self.call("glCheckNamedFramebufferStatus", frame.glo, _FRAMEBUFFER)
        error = self.gl.error
        if status != _FRAMEBUFFER_COMPLETE or error != "GL_NO_ERROR":
            size = width * height * DEPTH_BYTES / 2**20
            raise ResourceError(
                f"expected the device to allocate depth for {what} ({size:,.1f} MiB), got: "
                f"{error}, framebuffer status {status:#x}"
            )

    def clear(self, target: Target) -> None:
        """Set every sample to no face and the farthest depth."""
        target.frame.use()
        zeros = (_UINT * 4)()  # as a float, too
        self.call("glClearBufferuiv", _COLOR, 0, ctypes.addressof(zeros))
        self.call("glClearBufferfv", _DEPTH, 0, ctypes.addressof(zeros))

    def read_faces(self, target: Target, box: tuple[int, int, int, int]) -> NDArray[np.uint32]:
        """Face indices + 1 inside box = (x, y, width, height), (height, width)."""
        ids = np.empty((box[3], box[2]), np.uint32)
        target.frame.read_into(ids, viewport=box, components=1, dtype="u4", alignment=FACE_BYTES)
        return ids

    def read_depth(self, target: Target, box: tuple[int, int, int, int]) -> NDArray[np.float32]:
        """Depth buffer values inside a box, unconverted."""
        depth = np.empty((box[3], box[2]), np.float32)
        target.frame.read_into(depth, viewport=box, components=1, attachment=-1, dtype="f4")
        return depth

    def zero(self, buffer: moderngl.Buffer, size: int) -> None:
        """Set the first `size` bytes of a buffer, a multiple of 4, to 0 on the device."""
        if self._zeroing is None:
            self._zeroing = self.compute("zero")
        buffer.bind_to_storage_buffer(WORDS)
        set_uniforms(self._zeroing, n=size // 4)
        self._zeroing.run(min(MAX_ZERO_GROUPS, -(-size // 1024)))
        self.gl.memory_barrier()

    def read_words(self, buffer: moderngl.Buffer, *shape: int) -> NDArray[np.uint32]:
        """First words of a buffer, after a barrier; with `ask`, the only reader of those."""
        n_bytes = 4 * math.prod(shape)
        words = self.ask(buffer, n_bytes, "words").take(n_bytes).view(np.uint32)
        return words.reshape(shape).copy()

    def ask(self, buffer: moderngl.Buffer, n_bytes: int, role: str) -> Staging:
        """Staging buffer that will have the first bytes of a buffer that shaders wrote."""
        self.gl.memory_barrier()
        staging = self._next(role, n_bytes)
        staging.read(buffer, n_bytes)
        return staging

    def write(self, buffer: moderngl.Buffer, data: AnyArray) -> None:
        """Copy an array to the start of a buffer: the only writer of what shaders use."""
        contents = np.ascontiguousarray(data)
        self._next("words", contents.nbytes).write(buffer, contents)

    def grow(self, buffer: moderngl.Buffer, size: int, what: str) -> None:
        """Give a buffer other contents, of at least that size in bytes, where it has fewer.

        ResourceError where memory is short; the buffer has its size of before.
        """
        before = buffer.size
        if before >= size:
            return
        buffer.orphan(size)
        try:
            self.poll(f"allocating {what} ({size / 2**20:,.1f} MiB)")
        except ResourceError:
            buffer.orphan(before)
            raise

    def has_grown(self, buffer: moderngl.Buffer, size: int, what: str) -> bool:
        """True if `grow` found the memory."""
        try:
            self.grow(buffer, size, what)
        except ResourceError:
            return False
        return True

    def _next(self, role: str, size: int) -> Staging:
        """Next of the two staging buffers of a role: the host fills or reads one meanwhile."""
        ring = self._staged.setdefault(role, [])
        if not ring or ring[0].size < size:
            room = 1 << (max(size, LEAST_STAGED) - 1).bit_length()
            ring[:] = [Staging(self, room) for _ in range(RING)]
        ring.append(ring.pop(0))
        return ring[-1]

    def distrust(self, what: str) -> DeviceError:
        """Error to raise when the device has given a wrong result."""
        renderer = self.context.info.renderer
        return DeviceError(
            f"expected correct results of {renderer}, got a fault: it {what}; see "
            "`rastercov doctor`, or use backend 'cpu'"
        )

    def poll(self, doing: str) -> None:
        """Raise when the device has reported an error or lost the context while `doing`."""
        error = self.gl.error
        if error == "GL_OUT_OF_MEMORY":
            raise ResourceError(
                f"expected enough memory of the device, got too little while {doing}; use backend "
                "'cpu'"
            )
        if error != "GL_NO_ERROR":
            raise DeviceError(
                f"expected no error of the device, got {error} while {doing}; see `rastercov "
                "doctor`"
            )
        if self.context.reset_status():
            raise DeviceError(
                f"expected a live context, got a lost one while {doing}; open a new rasteriser"
            )

    def release(self) -> None:
        """Release every object."""
        self.context.parking_frame.use()  # moderngl rebinds the framebuffer that was bound last
        self._stack.close()


def set_uniforms(program: Any, **uniforms: object) -> None:
    """Set the uniforms that the program has; the compiler removes unused ones."""
    for name, value in uniforms.items():
        if name in program:
            program[name].value = value
