"""Graphics libraries of this machine, and their entry points.

Bottom of the OpenGL rasteriser: `devices` queries these libraries, `context` opens contexts with
them.

Khronos Group. EGL 1.5 Specification. 2014. EGL_EXT_platform_base, EGL_EXT_device_enumeration,
EGL_EXT_device_query. Mesa project. OSMesa interface (GL/osmesa.h).
"""

import ctypes
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import Any

from rastercov.base import DeviceError
from rastercov.base.format import to_install

EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")
GL_LIBRARIES = ("libOpenGL.so.0", "libGL.so.1", "libGL.so")
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so")

EGL_EXTENSIONS = 0x3055
MOST_DEVICES = 64
"""EGL devices that are listed."""

NO_OPENGL = "use the CPU: OpenGL needs Linux"
INSTALL_EGL = to_install("Mesa", "libegl1 libgl1 libgl1-mesa-dri", NO_OPENGL)
INSTALL_OSMESA = to_install("OSMesa", "libosmesa6", NO_OPENGL)


def find_library(names: tuple[str, ...]) -> ctypes.CDLL | None:
    """First of these shared libraries that loads; None when all fail."""
    for name in names:
        with suppress(OSError):
            return ctypes.CDLL(name)
    return None


def _require_library(names: tuple[str, ...], remedy: str) -> ctypes.CDLL:
    if library := find_library(names):
        return library
    raise DeviceError(f"expected the library {names[0]}, got none; {remedy}")


def int_array(*values: int) -> Any:
    """C array of ints: attribute names and values of EGL and OSMesa, with 0 or EGL_NONE last."""
    return (_INT * len(values))(*values)


def _address(library: ctypes.CDLL | None, name: str) -> int:
    """Address of an exported function, 0 when it is absent."""
    symbol = getattr(library, name, None) if library is not None else None
    return 0 if symbol is None else ctypes.cast(symbol, ctypes.c_void_p).value or 0


_INT, _UINT, _VOID, _TEXT = ctypes.c_int, ctypes.c_uint, ctypes.c_void_p, ctypes.c_char_p
_INT_OUT, _POINTER_OUT = ctypes.POINTER(_INT), ctypes.POINTER(_VOID)
ENTRY_POINTS: dict[str, tuple[Any, ...]] = {  # name: (result, *arguments)
    "eglGetError": (_INT,),
    "eglGetProcAddress": (_VOID, _TEXT),
    "eglQueryString": (_TEXT, _VOID, _INT),
    "eglInitialize": (_UINT, _VOID, _INT_OUT, _INT_OUT),
    "eglBindAPI": (_UINT, _UINT),
    "eglCreateContext": (_VOID, _VOID, _VOID, _VOID, _INT_OUT),
    "eglDestroyContext": (_UINT, _VOID, _VOID),
    "eglMakeCurrent": (_UINT, _VOID, _VOID, _VOID, _VOID),
    "eglGetCurrentContext": (_VOID,),
    "eglGetPlatformDisplayEXT": (_VOID, _UINT, _VOID, _INT_OUT),
    "eglQueryDevicesEXT": (_UINT, _INT, _POINTER_OUT, _INT_OUT),
    "eglQueryDeviceStringEXT": (_TEXT, _VOID, _INT),
    "eglQueryDeviceAttribEXT": (_UINT, _VOID, _INT, ctypes.POINTER(ctypes.c_ssize_t)),
    "OSMesaCreateContextAttribs": (_VOID, _INT_OUT, _VOID),
    "OSMesaMakeCurrent": (ctypes.c_ubyte, _VOID, _VOID, _UINT, _INT, _INT),
    "OSMesaGetCurrentContext": (_VOID,),
    "OSMesaDestroyContext": (None, _VOID),
    "OSMesaGetProcAddress": (_VOID, _TEXT),
}


class Library:
    """Entry points named `prefix`... as attributes; DeviceError where `address(name)` is 0."""

    def __init__(self, prefix: str, address: Callable[[str], int]) -> None:
        for name, signature in ENTRY_POINTS.items():
            if name.startswith(prefix):
                if not (pointer := address(name)):
                    raise DeviceError(
                        f"expected an OpenGL library with {name}, got one without; install one of "
                        "the last ten years"
                    )
                setattr(self, name, ctypes.CFUNCTYPE(*signature)(pointer))

    def __getattr__(self, name: str) -> Any:  # the entry points, for type checkers
        raise AttributeError(name)


class Egl(Library):
    """EGL with the OpenGL functions behind it."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.gl_library = find_library(GL_LIBRARIES)
        # EGL exports its core functions; eglGetProcAddress finds those of extensions.
        super().__init__("egl", lambda name: _address(library, name) or self.address(name))
        self.client_extensions = self.words(self.eglQueryString(None, EGL_EXTENSIONS))

    @staticmethod
    def words(text: bytes | None) -> frozenset[str]:
        """Extension names in an EGL string, empty for a null pointer."""
        return frozenset((text or b"").decode("ascii", "replace").split())

    def error(self) -> str:
        """Last error in this thread, by its number in EGL/egl.h."""
        return f"EGL error {self.eglGetError():#x}"

    def address(self, name: str) -> int:
        """Address of an EGL or OpenGL function, 0 when it is absent."""
        return self.eglGetProcAddress(name.encode()) or _address(self.gl_library, name)

    def devices(self) -> list[int]:
        """Handles of the EGL devices, in EGL's order."""
        count, handles = _INT(0), (_VOID * MOST_DEVICES)()
        self.eglQueryDevicesEXT(MOST_DEVICES, handles, ctypes.byref(count))
        return [handle for handle in handles[: max(count.value, 0)] if handle]


@cache
def egl_library() -> Egl:
    """EGL, loaded once; DeviceError with the command that installs it."""
    return Egl(_require_library(EGL_LIBRARIES, INSTALL_EGL))


@cache
def osmesa_library() -> Library:
    """OSMesa, loaded once; DeviceError with the command that installs it."""
    library = _require_library(OSMESA_LIBRARIES, INSTALL_OSMESA)
    return Library("OSMesa", partial(_address, library))
