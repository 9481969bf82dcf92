"""What there is to draw on: devices before a context exists, and contexts once they do.

Between `libraries`, which it asks, and `egl`, which opens a context on what `candidates` names and
lets `describe_context` say what came. Nothing here opens a context.

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

from rastercov.errors import DeviceError
from rastercov.raster.gl.libraries import (
    EGL_EXTENSIONS,
    Egl,
    egl_library,
    install_line,
    osmesa_library,
)

EGL_RENDERER_EXT, EGL_CUDA_DEVICE_NV = 0x335F, 0x323A
EGL_DRM_DEVICE_FILE_EXT, EGL_DRM_RENDER_NODE_FILE_EXT = 0x3233, 0x3377

GL_VENDOR, GL_RENDERER, GL_VERSION, GL_EXTENSIONS = 0x1F00, 0x1F01, 0x1F02, 0x1F03
GL_MAJOR_VERSION, GL_MINOR_VERSION, GL_NUM_EXTENSIONS = 0x821B, 0x821C, 0x821D
GL_CONTEXT_FLAGS, GL_CONTEXT_FLAG_ROBUST_ACCESS_BIT = 0x821E, 4
GL_RESET_NOTIFICATION_STRATEGY, GL_LOSE_CONTEXT_ON_RESET = 0x8256, 0x8252
LIMITS = {  # name: (token, how many numbers)
    "max_texture_size": (0x0D33, 1),
    "max_viewport_dims": (0x0D3A, 2),
    "max_array_layers": (0x88FF, 1),
    "max_renderbuffer_size": (0x84E8, 1),
    "max_framebuffer_layers": (0x9317, 1),
    "max_viewports": (0x825B, 1),
    "max_clip_distances": (0x0D32, 1),
    "max_color_attachments": (0x8CDF, 1),
    "max_samples": (0x8D57, 1),
    "max_texture_buffer_texels": (0x8C2B, 1),
    "max_uniform_block_bytes": (0x8A30, 1),
    "max_ssbo_bytes": (0x90DE, 1),
    "max_ssbo_bindings": (0x90DD, 1),
    "max_compute_invocations": (0x90EB, 1),
    "max_compute_shared_bytes": (0x8262, 1),
    "subpixel_bits": (0x0D50, 1),
}
SOFTWARE_RENDERERS = re.compile(
    r"llvmpipe|softpipe|swrast|swiftshader|lavapipe|software rasterizer|basic render", re.IGNORECASE
)

DeviceKind = Literal["egl-device", "egl-surfaceless", "osmesa"]


@dataclass(frozen=True)
class DeviceInfo:
    """One way to draw on this machine, as it announces itself before any context exists.

    Attributes
    ----------
    kind : {"egl-device", "egl-surfaceless", "osmesa"}
        Which loader opens it.
    index : int or None
        Place in EGL's device list, which is not CUDA's order; None for the other kinds.
    name : str
        DRM node, or a description where there is none.
    is_software : bool
        Whether it promises to draw on the CPU.
    cuda_index : int or None
        The same device's number in CUDA, where the driver tells.
    extensions : tuple of str
        EGL device extensions, sorted.
    """

    kind: DeviceKind
    index: int | None
    name: str
    is_software: bool
    cuda_index: int | None = None
    extensions: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """What `open_context` accepts for this device."""
        if self.kind == "egl-device":
            return f"egl:{self.index}"
        return "surfaceless" if self.kind == "egl-surfaceless" else "osmesa"

    def __str__(self) -> str:
        return f"{self.label} ({self.name}{', software' if self.is_software else ''})"


@dataclass(frozen=True)
class ContextInfo:
    """What was got: renderer, version, limits and features.

    Attributes
    ----------
    vendor, renderer, version : str
        GL_VENDOR, GL_RENDERER and GL_VERSION.
    gl_version : int
        100 * major + 10 * minor, as moderngl counts: 450 is OpenGL 4.5.
    is_software : bool
        Whether the renderer string names a CPU renderer.
    device : DeviceInfo
        The device that was opened.
    limits : dict
        The names of `LIMITS`; 0 where the context has no such limit.
    extensions : frozenset of str
        OpenGL extensions.
    has_robust_access, has_reset_notification : bool
        Whether out-of-range accesses are defined, and whether a reset is told.
    """

    vendor: str
    renderer: str
    version: str
    gl_version: int
    is_software: bool
    device: DeviceInfo
    limits: dict[str, Any]
    extensions: frozenset[str]
    has_robust_access: bool = False
    has_reset_notification: bool = False

    def has(self, core_since: int, *extensions: str) -> bool:
        """Whether a feature is there: core from that version on, or by any of the extensions."""
        return self.gl_version >= core_since or not self.extensions.isdisjoint(extensions)

    @property
    def has_clip_control(self) -> bool:
        """Depth from 0 to 1, which reversed-Z needs."""
        return self.has(450, "GL_ARB_clip_control")

    @property
    def has_layer_from_vertex_shader(self) -> bool:
        """Whether a vertex shader may write gl_Layer; no core version has it."""
        names = "GL_ARB_shader_viewport_layer_array", "GL_AMD_vertex_shader_layer"
        return self.has(10_000, *names, "GL_NV_viewport_array2")

    @property
    def has_viewport_array(self) -> bool:
        """Several viewports in one draw call."""
        return self.has(410, "GL_ARB_viewport_array")

    @property
    def has_doubles(self) -> bool:
        """Double precision in all stages, which depths of coplanar faces need."""
        return self.has(400, "GL_ARB_gpu_shader_fp64") and self.has(
            410, "GL_ARB_vertex_attrib_64bit"
        )

    @property
    def has_compute(self) -> bool:
        """Compute shaders."""
        return self.has(430, "GL_ARB_compute_shader")

    @property
    def has_ssbo(self) -> bool:
        """Shader storage buffers and their atomics."""
        return self.has(430, "GL_ARB_shader_storage_buffer_object")

    @property
    def has_batches(self) -> bool:
        """Many poses in one draw, counted on the device: what the plan "hardware" needs."""
        return self.has_layer_from_vertex_shader and self.has_compute and self.has_ssbo

    @property
    def has_compute_raster(self) -> bool:
        """What the plan "compute" needs."""
        return self.has_compute and self.has_ssbo

    @property
    def has_int64_atomics(self) -> bool:
        """64-bit atomicMax on storage buffers: depth and face index in one word."""
        return {"GL_NV_shader_atomic_int64", "GL_ARB_gpu_shader_int64"} <= self.extensions


SURFACELESS = DeviceInfo("egl-surfaceless", None, "EGL without a surface", is_software=True)
OSMESA = DeviceInfo("osmesa", None, "OSMesa off-screen renderer", is_software=True)


# --- what this machine announces ------------------------------------------------------------------


def describe_device(egl: Egl, index: int, handle: int) -> DeviceInfo:
    """Ask EGL what device `index` is, without opening it."""
    ask = egl.eglQueryDeviceStringEXT or (lambda *_: None)
    extensions = egl.words(ask(handle, EGL_EXTENSIONS))
    is_software = "EGL_MESA_device_software" in extensions
    questions = (
        ("EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT),
        ("EGL_EXT_device_drm_render_node", EGL_DRM_RENDER_NODE_FILE_EXT),
        ("EGL_EXT_device_query_name", EGL_RENDERER_EXT),
    )
    names = [ask(handle, token) for extension, token in questions if extension in extensions]
    cuda = ctypes.c_ssize_t(-1)
    if "EGL_NV_device_cuda" not in extensions or not (
        egl.eglQueryDeviceAttribEXT
        and egl.eglQueryDeviceAttribEXT(handle, EGL_CUDA_DEVICE_NV, ctypes.byref(cuda))
    ):
        cuda.value = -1
    unnamed = "Mesa software device" if is_software else "no DRM node"
    return DeviceInfo(
        kind="egl-device",
        index=index,
        name=", ".join(name.decode("utf-8", "replace") for name in names if name) or unnamed,
        is_software=is_software,
        cuda_index=cuda.value if cuda.value >= 0 else None,
        extensions=tuple(sorted(extensions)),
    )


def egl_devices() -> list[DeviceInfo]:
    """List the EGL devices in EGL's order, then surfaceless EGL; DeviceError without EGL."""
    egl = egl_library()
    devices = [describe_device(egl, *numbered) for numbered in enumerate(egl.devices())]
    if "EGL_MESA_platform_surfaceless" in egl.client_extensions:
        devices.append(SURFACELESS)
    return devices


def list_devices() -> list[DeviceInfo]:
    """List what this machine announces: EGL devices in EGL's order, surfaceless EGL, OSMesa.

    Opens none of them and never raises: a library that is missing announces nothing.
    """
    devices = []
    with suppress(DeviceError):
        devices += egl_devices()
    with suppress(DeviceError):
        osmesa_library()
        devices.append(OSMESA)
    return devices


# --- which devices answer a request ---------------------------------------------------------------


def candidates(device: str | int) -> tuple[list[DeviceInfo], list[str]]:
    """List the devices to try for this request, best first, and why others are missing."""
    index = _egl_index(device)
    if device == "osmesa":
        return [OSMESA], []
    missing = []
    try:
        egl = egl_devices()
    except DeviceError as error:
        if device != "auto":
            raise
        egl, missing = [], [str(error)]
    hardware = [known for known in egl if known.index is not None and not known.is_software]
    software = [known for known in egl if known.index is not None and known.is_software]
    surfaceless = [known for known in egl if known.index is None]
    if is_software_wanted() and index is None:
        hardware = []
    if device == "auto":
        found = [*hardware, *surfaceless, *software, OSMESA]
    elif device == "surfaceless":
        found = surfaceless + software  # the same renderer, should EGL prefer hardware here
    else:
        found = [known for known in hardware + software if index in (None, known.index)]
    if found:
        return found, missing
    is_listed = any(known.index is not None for known in egl)
    if not is_listed and (index is None or index >= 0):
        surface = "; or ask for 'surfaceless'" if surfaceless else ""
        raise DeviceError(
            f"no device {device!r}: EGL announces no device; {install_line('egl')}; in a container"
            " with an NVIDIA GPU set NVIDIA_DRIVER_CAPABILITIES=all (or graphics) and provide"
            f" /usr/share/glvnd/egl_vendor.d/10_nvidia.json{surface}"
        )
    known_devices = ", ".join(map(str, list_devices())) or f"none; {install_line('egl')}"
    raise DeviceError(f"no device {device!r}; there are: {known_devices}")


def _egl_index(device: str | int) -> int | None:
    """Index in a request such as 0 or "egl:0", -1 for one that cannot exist, None without one."""
    if isinstance(device, str):
        if device in ("auto", "egl", "surfaceless", "osmesa"):
            return None
        found = re.fullmatch(r"egl:(\d{1,9})", device)
        return int(found[1]) if found else -1
    try:
        return -1 if isinstance(device, bool) else operator.index(device)
    except TypeError:
        return -1


def is_software_wanted() -> bool:
    """Whether LIBGL_ALWAYS_SOFTWARE forbids hardware, read as Mesa reads it."""
    return os.environ.get("LIBGL_ALWAYS_SOFTWARE", "").lower() in ("1", "y", "yes", "t", "true")


def why_no_hardware(devices: list[DeviceInfo]) -> list[str]:
    """Reasons why no hardware renderer may be had, each with what to do."""
    reasons = []
    if is_software_wanted():
        reasons.append("LIBGL_ALWAYS_SOFTWARE is set: unset it")
    if not any(device.kind == "egl-device" and not device.is_software for device in devices):
        reasons.append("EGL announces no hardware device: install the GPU's EGL driver")
    if Path("/proc/driver/nvidia").exists() or Path("/dev/nvidiactl").exists():
        capabilities = os.environ.get("NVIDIA_DRIVER_CAPABILITIES", "not set")
        reasons.append(
            f"an NVIDIA GPU is here and NVIDIA_DRIVER_CAPABILITIES is {capabilities}: a container"
            " needs NVIDIA_DRIVER_CAPABILITIES=all (or graphics) and 10_nvidia.json in"
            " /usr/share/glvnd/egl_vendor.d"
        )
    for node in sorted(Path("/dev/dri").glob("renderD*")):
        if not os.access(node, os.R_OK | os.W_OK):
            reasons.append(f"no permission for {node}: join the group that owns it")
    return reasons


# --- what a context is ----------------------------------------------------------------------------


def describe_context(function: Callable[..., Any], device: DeviceInfo) -> ContextInfo:
    """Ask the current context what it is.

    Parameters
    ----------
    function : callable
        `function(name, restype, *argtypes)` gives an OpenGL function.
    device : DeviceInfo
        The device it was opened on.
    """
    uint, out = ctypes.c_uint, ctypes.POINTER(ctypes.c_int64)
    get_error = function("glGetError", uint)
    get_string = function("glGetString", ctypes.c_char_p, uint)
    get_string_i = function("glGetStringi", ctypes.c_char_p, uint, uint)
    get_integers = function("glGetInteger64v", None, uint, out)

    def integers(token: int, count: int = 1) -> tuple[int, ...]:
        numbers = (ctypes.c_int64 * 4)()  # stays 0 where the token is unknown
        get_integers(token, numbers)
        return tuple(numbers[:count])

    def text(token: int) -> str:
        return (get_string(token) or b"").decode("utf-8", "replace")

    vendor, renderer, version = text(GL_VENDOR), text(GL_RENDERER), text(GL_VERSION)
    if not renderer or not version:
        raise DeviceError("the OpenGL driver tells neither renderer nor version")
    n_extensions = integers(GL_NUM_EXTENSIONS)[0]
    limits = {name: integers(token, count) for name, (token, count) in LIMITS.items()}
    info = ContextInfo(
        vendor=vendor,
        renderer=renderer,
        version=version,
        gl_version=100 * integers(GL_MAJOR_VERSION)[0] + 10 * integers(GL_MINOR_VERSION)[0],
        is_software=SOFTWARE_RENDERERS.search(renderer) is not None,
        device=device,
        limits={name: got if len(got) > 1 else got[0] for name, got in limits.items()},
        extensions=frozenset(
            (get_string_i(GL_EXTENSIONS, i) or b"").decode() for i in range(n_extensions)
        ),
        has_robust_access=bool(integers(GL_CONTEXT_FLAGS)[0] & GL_CONTEXT_FLAG_ROBUST_ACCESS_BIT),
        has_reset_notification=(
            integers(GL_RESET_NOTIFICATION_STRATEGY)[0] == GL_LOSE_CONTEXT_ON_RESET
        ),
    )
    for _ in range(100):  # unknown tokens left errors; a lost context leaves them without end
        if not get_error():
            break
    return info
