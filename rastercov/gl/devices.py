"""Graphics devices of this machine, and the renderers behind opened contexts.

`candidates` lists the devices that answer a request, from what `libraries` announces; `context`
opens them and describes the result by `describe_context`. This module opens no context.

Khronos Group. EGL_EXT_device_enumeration, EGL_EXT_device_query, EGL_EXT_device_drm,
EGL_NV_device_cuda, EGL_MESA_device_software.
"""

import ctypes
import operator
import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rastercov.base import ByName, DeviceError, shown
from rastercov.base.threads import DEVICE
from rastercov.gl.libraries import (
    EGL_EXTENSIONS,
    INSTALL_EGL,
    Egl,
    egl_library,
    osmesa_library,
)

EGL_RENDERER_EXT, EGL_CUDA_DEVICE_NV = 0x335F, 0x323A
EGL_DRM_DEVICE_FILE_EXT, EGL_DRM_RENDER_NODE_FILE_EXT = 0x3233, 0x3377

GL_EXTENSIONS, GL_NUM_EXTENSIONS = 0x1F03, 0x821D
LIMITS = {  # name: that of moderngl
    "max_texture_size": "GL_MAX_TEXTURE_SIZE",
    "max_viewport_dims": "GL_MAX_VIEWPORT_DIMS",
    "max_ssbo_bytes": "GL_MAX_SHADER_STORAGE_BLOCK_SIZE",
    "subpixel_bits": "GL_SUBPIXEL_BITS",
}
SOFTWARE_RENDERERS = re.compile(
    r"llvmpipe|softpipe|swrast|swiftshader|lavapipe|software rasterizer|basic render", re.IGNORECASE
)

NVIDIA_IN_CONTAINER = (
    "set NVIDIA_DRIVER_CAPABILITIES=all (or graphics) and provide "
    "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
)

DeviceKind = Literal["egl-device", "egl-surfaceless", "osmesa"]


@dataclass(frozen=True)
class DeviceInfo:
    """Device as announced before any context exists.

    Attributes
    ----------
    kind : {"egl-device", "egl-surfaceless", "osmesa"}
        Library and platform that open it.
    index : int or None
        Index in EGL's device list, whose order differs from CUDA's; None for the other kinds.
    name : str
        DRM node, or a description of a device without one.
    is_software : bool
        Whether it is announced as a renderer on the CPU.
    cuda_index : int or None
        Index of the device in CUDA, if the driver reports it.
    """

    kind: DeviceKind
    index: int | None
    name: str
    is_software: bool
    cuda_index: int | None = None

    @property
    def label(self) -> str:
        """Name of this device in `open_context`."""
        if self.kind == "egl-device":
            return f"egl:{self.index}"
        return "surfaceless" if self.kind == "egl-surfaceless" else "osmesa"

    def __str__(self) -> str:
        return f"{self.label} ({self.name}{', software' if self.is_software else ''})"


@dataclass(frozen=True)
class ContextInfo:
    """Renderer, version, limits and features of an open context.

    Attributes
    ----------
    vendor, renderer, version : str
        GL_VENDOR, GL_RENDERER and GL_VERSION.
    gl_version : int
        100 * major + 10 * minor, as in moderngl: 450 is OpenGL 4.5.
    is_software : bool
        Whether the renderer string names a CPU renderer.
    device : DeviceInfo
        The device that was opened.
    limits : dict
        Values by the names of `LIMITS`.
    extensions : frozenset of str
        OpenGL extensions.
    """

    vendor: str
    renderer: str
    version: str
    gl_version: int
    is_software: bool
    device: DeviceInfo
    limits: ByName
    extensions: frozenset[str]

    @property
    def has_int64(self) -> bool:
        """Integers of 64 bits, which the plan "compute" needs."""
        return "GL_ARB_gpu_shader_int64" in self.extensions

    @property
    def has_int64_atomics(self) -> bool:
        """64-bit atomicMax on storage buffers: depth and face index in one word."""
        return self.has_int64 and "GL_NV_shader_atomic_int64" in self.extensions


SURFACELESS = DeviceInfo("egl-surfaceless", None, "EGL without a surface", is_software=True)
OSMESA = DeviceInfo("osmesa", None, "OSMesa off-screen renderer", is_software=True)


# --- announced devices ----------------------------------------------------------------------------


def describe_device(egl: Egl, index: int, handle: int) -> DeviceInfo:
    """Description of EGL device `index`, without opening it."""
    query = egl.eglQueryDeviceStringEXT
    extensions = egl.words(query(handle, EGL_EXTENSIONS))
    is_software = "EGL_MESA_device_software" in extensions
    strings = (
        ("EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT),
        ("EGL_EXT_device_drm_render_node", EGL_DRM_RENDER_NODE_FILE_EXT),
        ("EGL_EXT_device_query_name", EGL_RENDERER_EXT),
    )
    names = [query(handle, token) for extension, token in strings if extension in extensions]
    cuda = ctypes.c_ssize_t(-1)
    if "EGL_NV_device_cuda" in extensions:
        egl.eglQueryDeviceAttribEXT(handle, EGL_CUDA_DEVICE_NV, ctypes.byref(cuda))
    unnamed = "Mesa software device" if is_software else "no DRM node"
    return DeviceInfo(
        kind="egl-device",
        index=index,
        name=", ".join(name.decode("utf-8", "replace") for name in names if name) or unnamed,
        is_software=is_software,
        cuda_index=cuda.value if cuda.value >= 0 else None,
    )


def egl_devices() -> list[DeviceInfo]:
    """EGL devices in EGL's order, then surfaceless EGL; DeviceError without EGL."""
    egl = egl_library()
    devices = [describe_device(egl, *numbered) for numbered in enumerate(egl.devices())]
    if "EGL_MESA_platform_surfaceless" in egl.client_extensions:
        devices.append(SURFACELESS)
    return devices


def list_devices() -> list[DeviceInfo]:
    """Announced devices: EGL devices in EGL's order, surfaceless EGL, OSMesa.

    Opens no device and raises no error; a missing library announces nothing.
    """
    devices = []
    with suppress(DeviceError):
        devices += egl_devices()
    with suppress(DeviceError):
        osmesa_library()
        devices.append(OSMESA)
    return devices


# --- requests -------------------------------------------------------------------------------------


def candidates(device: str | int) -> tuple[list[DeviceInfo], list[str]]:
    """Devices to try for a request of `open_context`, best first, and reasons for missing ones."""
    wanted = device if isinstance(device, str) else ""
    if wanted in ("auto", "egl"):  # without a number, as in the folder of a run
        wanted = os.environ.get(DEVICE) or wanted
    if not isinstance(device, str | bool):
        with suppress(TypeError):  # a whole number of any type
            wanted = f"egl:{operator.index(device)}"
    if wanted == "osmesa":
        return [OSMESA], []
    missing: list[str] = []
    try:
        egl = egl_devices()
    except DeviceError as error:
        if wanted != "auto":
            raise
        egl, missing = [], [str(error)]
    hardware = [each for each in egl if not each.is_software]
    software = [each for each in egl if each.is_software and each != SURFACELESS]
    surfaceless = [each for each in egl if each == SURFACELESS]
    usable = [] if is_software_wanted() else hardware
    named = {
        "hardware": usable,
        "auto": [*usable, *surfaceless, *software, OSMESA],
        "surfaceless": surfaceless + software,  # same renderer, if surfaceless EGL wants hardware
        "egl": usable + software,
    } | {each.label: [each] for each in hardware + software}
    if entry := named.get(wanted):
        return entry, missing
    known = ", ".join(each.label for each in list_devices()) or f"none; {INSTALL_EGL}"
    reasons = "" if usable else f"; {'; '.join(why_no_hardware(egl))}"
    raise DeviceError(f"expected a device: auto, cpu, {known}, got {shown(device)}{reasons}")


def is_software_wanted() -> bool:
    """True when LIBGL_ALWAYS_SOFTWARE forbids hardware, parsed as by Mesa."""
    return os.environ.get("LIBGL_ALWAYS_SOFTWARE", "").lower() in ("1", "y", "yes", "t", "true")


def why_no_hardware(devices: list[DeviceInfo]) -> list[str]:
    """Possible reasons for the lack of a hardware renderer, each with its remedy."""
    reasons = []
    if is_software_wanted():
        reasons.append("LIBGL_ALWAYS_SOFTWARE is set: unset it")
    if not any(device.kind == "egl-device" and not device.is_software for device in devices):
        reasons.append("EGL reports no hardware device: install the GPU's EGL driver")
    if Path("/proc/driver/nvidia").exists() or Path("/dev/nvidiactl").exists():
        capabilities = os.environ.get("NVIDIA_DRIVER_CAPABILITIES", "not set")
        reasons.append(
            f"an NVIDIA GPU is here and NVIDIA_DRIVER_CAPABILITIES is {capabilities}: in a "
            f"container {NVIDIA_IN_CONTAINER}"
        )
    for node in sorted(Path("/dev/dri").glob("renderD*")):
        if not os.access(node, os.R_OK | os.W_OK):
            reasons.append(f"no permission for {node}: join the group that owns it")
    return reasons


# --- open contexts --------------------------------------------------------------------------------


def describe_context(gl: Any, function: Callable[..., Any], device: DeviceInfo) -> ContextInfo:
    """Description of the current context, which `device` gave; `gl` is that of moderngl.

    `function(name, restype, *argtypes)` returns an OpenGL function.
    """
    known, uint, n_extensions = gl.info, ctypes.c_uint, ctypes.c_int()
    name_of = function("glGetStringi", ctypes.c_char_p, uint, uint)
    out = ctypes.POINTER(ctypes.c_int)
    function("glGetIntegerv", None, uint, out)(GL_NUM_EXTENSIONS, ctypes.byref(n_extensions))
    return ContextInfo(
        vendor=known["GL_VENDOR"],
        renderer=known["GL_RENDERER"],
        version=known["GL_VERSION"],
        gl_version=gl.version_code,
        is_software=SOFTWARE_RENDERERS.search(known["GL_RENDERER"]) is not None,
        device=device,
        limits={name: known[token] for name, token in LIMITS.items()},
        extensions=frozenset(
            (name_of(GL_EXTENSIONS, i) or b"").decode() for i in range(n_extensions.value)
        ),
    )
