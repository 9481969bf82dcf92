"""Graphics libraries of this machine: their entry points, and the commands that install them.

Bottom of the OpenGL rasteriser: `devices` queries these libraries, `context` opens contexts with
them.

Khronos Group. EGL 1.5 Specification. 2014. EGL_EXT_platform_base, EGL_EXT_device_enumeration,
EGL_EXT_device_query. Mesa project. OSMesa interface (GL/osmesa.h).
"""

import ctypes
import platform
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache, partial
from typing import Any, Literal

from rastercov.base.errors import DeviceError

EGL_LIBRARIES = ("libEGL.so.1", "libEGL.so")
GL_LIBRARIES = ("libOpenGL.so.0", "libGL.so.1", "libGL.so")
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")

EGL_EXTENSIONS = 0x3055
MOST_DEVICES = 64
"""EGL devices that are listed."""

PACKAGES = {  # family: (command, EGL packages, OSMesa packages)
    "debian": ("apt-get install -y", "libegl1 libgl1 libgl1-mesa-dri", "libosmesa6"),
    "fedora": ("dnf install -y", "mesa-libEGL mesa-libGL mesa-dri-drivers", "mesa-libOSMesa"),
    "arch": ("pacman -S", "mesa", "mesa"),
    "alpine": ("apk add", "mesa-egl mesa-gl mesa-dri-gallium", "mesa-osmesa"),
}
FAMILY = {"ubuntu": "debian", "rhel": "fedora", "centos": "fedora"}


def install_line(kind: Literal["egl", "osmesa"], release: Mapping[str, str] | None = None) -> str:
    """Command that installs EGL with OpenGL, or OSMesa, on a distribution.

    `release` has the fields of its os-release file; None reads that of this machine.
    """
    if release is None:
        release = {}
        with suppress(OSError, ValueError):  # no file, or another encoding
            release = platform.freedesktop_os_release()
    for word in f"{release.get('ID', '')} {release.get('ID_LIKE', '')}".lower().split():
        if family := PACKAGES.get(FAMILY.get(word, word)):
            return f"{family[0]} {family[1] if kind == 'egl' else family[2]}"
    library = "libEGL.so.1 and libGL.so.1" if kind == "egl" else "libOSMesa.so.8"
    return f"install your distribution's Mesa packages that hold {library}"


def find_library(names: tuple[str, ...]) -> ctypes.CDLL | None:
    """First of these shared libraries that loads; None when all fail."""
    for name in names:
        with suppress(OSError):
            return ctypes.CDLL(name)
    return None


def _required_library(kind: Literal["egl", "osmesa"]) -> ctypes.CDLL:
    title, names = {"egl": ("EGL", EGL_LIBRARIES), "osmesa": ("OSMesa", OSMESA_LIBRARIES)}[kind]
    if library := find_library(names):
        return library
    raise DeviceError(f"no {title}: wanted {names[0]}, found none; {install_line(kind)}")


def int_array(*values: int) -> Any:
    """C array of ints: attribute names and values of EGL and OSMesa, with 0 or EGL_NONE last."""
    return (_INT * len(values))(*values)


def library_names() -> dict[str, str | None]:
    """File name of the library loaded for "EGL", "OpenGL" and "OSMesa"; None for a missing one."""
    wanted = {"EGL": EGL_LIBRARIES, "OpenGL": GL_LIBRARIES, "OSMesa": OSMESA_LIBRARIES}
    found = {library: find_library(names) for library, names in wanted.items()}
    return {library: None if file is None else file._name for library, file in found.items()}


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
    """Entry points named `prefix`... as attributes, None where `address(name)` is 0."""

    def __init__(self, prefix: str, address: Callable[[str], int]) -> None:
        for name, signature in ENTRY_POINTS.items():
            if name.startswith(prefix):
                pointer = address(name)
                setattr(self, name, ctypes.CFUNCTYPE(*signature)(pointer) if pointer else None)

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
        """Handles of the EGL devices, in EGL's order; empty when EGL cannot list them."""
        count, handles = _INT(0), (_VOID * MOST_DEVICES)()
        if self.eglQueryDevicesEXT is not None:
            self.eglQueryDevicesEXT(MOST_DEVICES, handles, ctypes.byref(count))
        return [handle for handle in handles[: max(count.value, 0)] if handle]


@cache
def egl_library() -> Egl:
    """EGL, loaded once; DeviceError with the command that installs it."""
    return Egl(_required_library("egl"))


@cache
def osmesa_library() -> Library:
    """OSMesa, loaded once; DeviceError with the command that installs it."""
    osmesa = Library("OSMesa", partial(_address, _required_library("osmesa")))
    for name, function in vars(osmesa).items():
        if function is None:
            raise DeviceError(f"OSMesa has no {name}: wanted Mesa 12 or newer")
    return osmesa
