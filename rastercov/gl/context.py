"""Headless OpenGL core contexts on an EGL device, on EGL without a surface, or on OSMesa.

`open_context` opens a context without a window system and gives it to moderngl. ctypes loaders
replace glcontext, which asks for no reset notification, leaves results of EGL unchecked, and
supports neither OSMesa nor surfaceless EGL.

A context belongs to the thread and process that opened it. EGL displays belong to the whole process
and are never terminated, because another library may use the same one. A device that announces
hardware and gives a software renderer, or the reverse, is refused.

Khronos Group. EGL 1.5 Specification. 2014. EGL_EXT_platform_device, EGL_MESA_platform_surfaceless,
EGL_EXT_create_context_robustness. Mesa project. OSMesa interface (GL/osmesa.h).
"""

import ctypes
import os
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, cast

import moderngl

from rastercov.base import DeviceError
from rastercov.base.threads import Unique
from rastercov.gl import devices
from rastercov.gl.devices import DeviceInfo
from rastercov.gl.libraries import INSTALL_EGL, egl_library, int_array, osmesa_library

TOO_OLD = (
    "expected an OpenGL 4.5 core context, got none; install a newer driver or use backend 'cpu', "
    "which counts the same"
)
EGL_NONE, EGL_OPENGL_API = 0x3038, 0x30A2
EGL_PLATFORM_DEVICE_EXT, EGL_PLATFORM_SURFACELESS_MESA = 0x313F, 0x31DD
EGL_CONTEXT_MAJOR_VERSION, EGL_CONTEXT_MINOR_VERSION = 0x3098, 0x30FB
EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT = 0x30FD, 1
ROBUSTNESS = (
    *(0x30BF, 1),  # EGL_CONTEXT_OPENGL_ROBUST_ACCESS_EXT
    *(0x31BD, 0x31BF),  # EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY: lose the context
)
OSMESA_FORMAT, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x33, 0x34
OSMESA_CONTEXT_MAJOR_VERSION, OSMESA_CONTEXT_MINOR_VERSION = 0x36, 0x37
GL_RGBA, GL_UNSIGNED_BYTE = 0x1908, 0x1401
OSMESA_SIDE = 16  # pixels per side of the framebuffer that OSMesa requires


# --- native contexts ------------------------------------------------------------------------------


class _Thread(threading.local):
    """Doors and handles of a thread's contexts, the current last; EGL and OSMesa ignore each other.

    Not the contexts themselves, which would never be forgotten.
    """

    def __init__(self) -> None:
        self.contexts: list[tuple[Any, int]] = []


_thread = _Thread()


_EMPTY = ctypes.create_string_buffer(1)
_EMPTY_NAME = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_uint)(
    lambda _token, _index: ctypes.addressof(_EMPTY)
)
"""Replacement of glGetStringi while moderngl lists the names of extensions."""


@cache
def _same_object(number: int) -> int:
    """The number itself, as one object for all equal numbers."""
    return number


class _Loader:
    """Interface of glcontext, by which moderngl finds the functions of a context that is current.

    moderngl 5.13 never releases the address of each of 670 functions and the name of each of 220
    extensions, 38 KiB a context. For it equal addresses are therefore one object, and names are
    empty, a single object in Python; `HeadlessContext` sets the names afterwards.
    """

    def __init__(self, address: Callable[[str], int]) -> None:
        self._address = address

    def load(self, name: str) -> int:
        """Address of an OpenGL function."""
        if name == "glGetStringi":
            return _same_object(ctypes.cast(_EMPTY_NAME, ctypes.c_void_p).value or 0)
        return _same_object(self._address(name))

    def __enter__(self) -> None:
        """Leave the context current: the thread owns it."""

    def __exit__(self, *_: object) -> None:
        """Leave the context current."""

    def release(self) -> None:
        """Leave the context to `HeadlessContext`."""


class _EglDoor:
    """Contexts on an EGL device or on EGL without a surface."""

    def __init__(self, device: DeviceInfo) -> None:
        self.egl = egl = egl_library()
        self.address, self.current = egl.address, egl.eglGetCurrentContext
        platform: tuple[int, int | None] = (EGL_PLATFORM_SURFACELESS_MESA, None)
        if device.index is not None:
            platform = (EGL_PLATFORM_DEVICE_EXT, egl.devices()[device.index])
        # The same one for every context of the device.
        self.display = egl.eglGetPlatformDisplayEXT(*platform, None)
        if not self.display or not egl.eglInitialize(self.display, None, None):
            raise DeviceError(
                f"expected an EGL display, got error {egl.error()}; install its driver "
                f"({INSTALL_EGL})"
            )

    def create(self) -> int:
        """Handle of a new context, robust where the driver can be."""
        egl = self.egl
        if not egl.eglBindAPI(EGL_OPENGL_API):
            raise DeviceError(
                f"expected desktop OpenGL from EGL, got error {egl.error()} of eglBindAPI; use "
                "backend 'cpu'"
            )
        profile = (EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT)
        version = (EGL_CONTEXT_MAJOR_VERSION, 4, EGL_CONTEXT_MINOR_VERSION, 5)
        for robustness in ROBUSTNESS, ():
            attributes = int_array(*version, *profile, *robustness, EGL_NONE)
            if handle := egl.eglCreateContext(self.display, None, None, attributes):
                return int(handle)
        raise DeviceError(f"{TOO_OLD} (eglCreateContext gave {egl.error()})")

    def bind(self, handle: int) -> None:
        """Make a context current."""
        self.egl.eglBindAPI(EGL_OPENGL_API)  # per thread; another library may bind OpenGL ES
        # Unbind first: Mesa skips a context it believes current, even after OSMesa replaced it.
        self.egl.eglMakeCurrent(self.display, None, None, None)
        if not self.egl.eglMakeCurrent(self.display, None, None, handle):
            raise DeviceError(
                f"expected to make the context current, got error {self.egl.error()}; open another "
                "one"
            )

    def destroy(self, handle: int) -> None:
        """Give a context back."""
        if self.current() == handle:
            self.egl.eglMakeCurrent(self.display, None, None, None)
        self.egl.eglDestroyContext(self.display, handle)


class _OSMesaDoor:
    """Contexts of OSMesa, which draws into memory without EGL."""

    def __init__(self) -> None:
        self.osmesa = osmesa_library()
        self.current = self.osmesa.OSMesaGetCurrentContext
        self.buffer = ctypes.create_string_buffer(4 * OSMESA_SIDE**2)

    def create(self) -> int:
        """Handle of a new context."""
        version = (OSMESA_CONTEXT_MAJOR_VERSION, 4, OSMESA_CONTEXT_MINOR_VERSION, 5)
        layout = (OSMESA_FORMAT, GL_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        attributes = int_array(*layout, *version, 0)
        if handle := self.osmesa.OSMesaCreateContextAttribs(attributes, None):
            return int(handle)
        raise DeviceError(TOO_OLD)

    def address(self, name: str) -> int:
        """Address of an OpenGL function, 0 when it is absent."""
        return self.osmesa.OSMesaGetProcAddress(name.encode()) or 0

    def bind(self, handle: int) -> None:
        """Make a context current."""
        image = (self.buffer, GL_UNSIGNED_BYTE, OSMESA_SIDE, OSMESA_SIDE)
        if not self.osmesa.OSMesaMakeCurrent(handle, *image):
            raise DeviceError(
                "expected to make the OSMesa context current, got an error; open another one"
            )

    def destroy(self, handle: int) -> None:
        """Give a context back."""
        if self.current() == handle:
            self.osmesa.OSMesaMakeCurrent(None, None, 0, 0, 0)
        self.osmesa.OSMesaDestroyContext(handle)


class HeadlessContext(Unique):
    """OpenGL core context without a window, and the moderngl context on it.

    Opened by `open_context`, owned by one thread of one process; close it by `release` or `with`.

    Attributes
    ----------
    info : ContextInfo
        Renderer, version, limits and features.
    parking_frame : moderngl.Framebuffer
        Framebuffer of one pixel, to bind before the framebuffer in use is released.
    """

    _is_released = True

    def __init__(self, device: DeviceInfo) -> None:
        self._pid, self._thread = os.getpid(), threading.current_thread()
        self._functions: dict[tuple[Any, ...], Any] = {}
        self._door = _OSMesaDoor() if device.kind == "osmesa" else _EglDoor(device)
        self._handle = self._door.create()
        self._own, self._is_released = (self._door, self._handle), False
        try:
            self.make_current()
            if not self._door.address("glGetString"):
                raise DeviceError(f"expected libGL.so.1, got no OpenGL library; {INSTALL_EGL}")
            # `standalone`: there is no default framebuffer to inspect.
            loader = cast("Any", _Loader(self._door.address))
            self._gl = moderngl.create_context(context=loader, standalone=True)
            self.info = devices.describe_context(self._gl, self.function, device)
            self._gl.extensions.clear()  # see `_Loader`
            self._gl.extensions.update(self.info.extensions)
            self._gl.gc_mode = "context_gc"
            self._pixel = self._gl.renderbuffer((1, 1))
            self.parking_frame = self._gl.framebuffer([self._pixel])
        except BaseException:
            self._destroy()
            raise

    @property
    def gl(self) -> moderngl.Context:
        """Current moderngl context (gc_mode "context_gc"); DeviceError in other threads."""
        self.make_current()
        return self._gl

    def check_owner(self) -> None:
        """Raise DeviceError in another thread or a forked child, and after `release`."""
        if self._is_released:
            raise DeviceError("expected a live OpenGL context, got a released one; open a new one")
        if os.getpid() != self._pid:
            raise DeviceError(
                f"expected an OpenGL context of this process, {os.getpid()}, got one of "
                f"{self._pid}, which forked it; start processes with multiprocessing's 'spawn'"
            )
        owner, thread = self._thread, threading.current_thread()
        if thread.ident != owner.ident:
            raise DeviceError(
                f"expected an OpenGL context of thread {thread.name!r} ({thread.ident}), got one "
                f"of {owner.name!r} ({owner.ident}); open one context in each thread"
            )

    def make_current(self) -> None:
        """Bind the context to its thread; needed when one thread has several contexts."""
        self.check_owner()
        if _thread.contexts[-1:] != [self._own] or self._door.current() != self._handle:
            self._door.bind(self._handle)
            _thread.contexts = [
                *(each for each in _thread.contexts if each != self._own),
                self._own,
            ]

    def function(self, name: str, restype: type | None, *argtypes: type) -> Callable[..., Any]:
        """OpenGL function as a ctypes callable, cached; DeviceError when it is absent.

        Drivers may return an address for any name that begins with gl, so check `info` first.
        """
        self.check_owner()
        key = (name, restype, *argtypes)
        if key not in self._functions:
            if not (address := self._door.address(name)):
                raise DeviceError(
                    f"expected an OpenGL driver with {name}, got one without; install a newer "
                    "driver"
                )
            self._functions[key] = ctypes.CFUNCTYPE(restype, *argtypes)(address)
        return cast("Callable[..., Any]", self._functions[key])

    def reset_status(self) -> int:
        """glGetGraphicsResetStatus: 0 for a live context and for one that does not report it."""
        return self.function("glGetGraphicsResetStatus", ctypes.c_uint)()

    def release(self) -> None:
        """Destroy both contexts; no effect when released before.

        A forked child, which shares them, only forgets them.
        """
        if self._is_released:
            return
        if os.getpid() == self._pid:
            self.check_owner()
            with suppress(DeviceError):  # a lost context may refuse to become current
                self.make_current()
                # First, because moderngl never frees a context with live objects.
                self.parking_frame.release()
                self._pixel.release()
                self._gl.release()
            self._destroy()
        self._functions.clear()
        self._is_released = True

    def _destroy(self) -> None:
        """Give the native context back, and the thread to the one before it."""
        self._is_released = True
        self._door.destroy(self._handle)
        _thread.contexts = [each for each in _thread.contexts if each != self._own]
        for door, handle in _thread.contexts[-1:]:
            with suppress(DeviceError):  # its next use raises the error again
                door.bind(handle)

    def __enter__(self) -> "HeadlessContext":
        self.make_current()
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __del__(self) -> None:
        if not (self._is_released or self._pid != os.getpid() or sys.is_finalizing()):
            message = "OpenGL context was not released"
            warnings.warn(message, ResourceWarning, source=self, stacklevel=2)
            if threading.get_ident() == self._thread.ident:
                self.release()


# --- choosing a device ----------------------------------------------------------------------------

_opened_in: int | None = None  # id of the process that first opened a context


def open_context(device: str | int = "auto") -> HeadlessContext:
    """Open a headless OpenGL core context, current in the calling thread.

    Parameters
    ----------
    device : str or int
        "hardware": the first EGL device with a hardware renderer. "auto": the same, else
        surfaceless EGL, else OSMesa.
        "egl": the first EGL device, hardware first. "egl:0" or 0: that EGL device.
        "surfaceless": EGL on the CPU. "osmesa": OSMesa.

    Raises
    ------
    DeviceError
        Unknown device, missing library, refusal by the driver, hardware instead of software or
        the reverse, or a process forked from one that had opened a context.
    """
    global _opened_in
    if _opened_in not in (None, os.getpid()):
        raise DeviceError(
            f"expected a process without an OpenGL context, got {os.getpid()}, a fork of "
            f"{_opened_in}, which has one; start processes with multiprocessing's 'spawn'"
        )
    candidates, failures = devices.candidates(device)
    for candidate in candidates:
        _opened_in = os.getpid()
        try:
            context = HeadlessContext(candidate)
        except DeviceError as error:
            failures.append(f"{candidate}: {error}")
            continue
        if context.info.is_software == candidate.is_software:
            return context
        context.release()
        promise = "software" if candidate.is_software else "hardware"
        failures.append(f"{candidate}: promised {promise} and gave {context.info.renderer}")
    if device == "hardware":
        failures += devices.why_no_hardware(candidates)
    raise DeviceError(
        f"expected an OpenGL context for device {device!r}, got: {'; '.join(failures)}"
    )
