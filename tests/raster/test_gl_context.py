"""Headless contexts: each kind draws, each missing piece is named, no misuse hangs."""

import ctypes
import dataclasses
import json
import re
import threading
from functools import partial
from pathlib import Path

import pytest
from nightly import nightly
from processes import run_python

from rastercov.base.errors import DeviceError
from rastercov.gl import devices, libraries
from rastercov.gl.context import HeadlessContext, open_context
from rastercov.gl.devices import DeviceInfo, list_devices

GPU = DeviceInfo("egl-device", 0, "/dev/dri/card0", is_software=False)
CPU = DeviceInfo("egl-device", 1, "Mesa software device", is_software=True)


def open_or_skip(device):
    try:
        return open_context(device)
    except DeviceError as error:
        pytest.skip(f"no {device} here: {error}")


@pytest.fixture
def context():
    context = open_or_skip("surfaceless")
    with context:
        yield context
        if not context._is_released:
            assert context.gl.error == "GL_NO_ERROR"


@pytest.fixture
def egl():
    """The EGL library, for tests that make it answer otherwise."""
    open_or_skip("surfaceless").release()
    return libraries.egl_library()


def draw_red(context):
    """Clear a framebuffer to red and read one pixel."""
    texture = context.gl.texture((4, 4), 4)
    framebuffer = context.gl.framebuffer([texture])
    framebuffer.clear(1.0, 0.0, 0.0, 1.0)
    pixel = framebuffer.read(components=4)[:4]
    framebuffer.release()
    texture.release()
    return pixel


# --- each kind works ------------------------------------------------------------------------------


@pytest.mark.parametrize("device", ["auto", "egl", "egl:0", 0, "surfaceless", "osmesa"])
def test_each_kind_of_context_draws(device):
    with open_or_skip(device) as context:
        assert draw_red(context) == b"\xff\x00\x00\xff"
        assert context.gl.error == "GL_NO_ERROR"
        assert context.gl.gc_mode == "context_gc"
        assert context.gl.version_code == context.info.gl_version >= 450
        assert context.info.renderer == context.gl.info["GL_RENDERER"]
        assert context.info.extensions == context.gl.extensions
        limits = context.info.limits
        assert limits["max_texture_size"] >= 1024 <= min(limits["max_viewport_dims"])


def test_missing_extensions_are_false_flags_not_errors(context):
    bare = dataclasses.replace(context.info, extensions=frozenset())
    flags = [name for name, value in vars(type(bare)).items() if isinstance(value, property)]
    assert set(flags) == {"has_int64", "has_int64_atomics"}
    assert not any(getattr(bare, name) for name in flags)
    some = dataclasses.replace(bare, extensions=frozenset({"GL_ARB_gpu_shader_int64"}))
    assert some.has_int64
    assert not some.has_int64_atomics


def test_functions_are_reached_by_name_once(context):
    get_error = context.function("glGetError", ctypes.c_uint)
    assert get_error() == 0
    assert context.function("glGetError", ctypes.c_uint) is get_error
    with pytest.raises(
        DeviceError, match="expected an OpenGL driver with no such function, got one without;"
    ):
        context.function("no such function", None)


def test_a_lost_context_is_reported_and_a_live_one_is_not(context, monkeypatch):
    assert context.reset_status() == 0
    monkeypatch.setattr(context, "function", lambda *_: lambda: 0x8254)
    assert context.reset_status() == 0x8254


# --- what the driver refuses ----------------------------------------------------------------------


def test_a_context_opens_without_the_robustness_that_is_refused(egl, monkeypatch):
    with open_context("surfaceless") as context:
        whole = context.info
    create, asked = egl.eglCreateContext, []

    def refuse(display, config, share, attributes):
        asked.append(0x30BF in list(attributes)[::2])  # robust access
        return None if asked[-1] else create(display, config, share, attributes)

    monkeypatch.setattr(egl, "eglCreateContext", refuse)
    with open_context("surfaceless") as context:
        assert context.info.gl_version == whole.gl_version
    assert asked == [True, False]


@pytest.mark.parametrize("device", ["surfaceless", "osmesa"])
def test_a_driver_of_an_older_opengl_is_refused_in_one_line(device):
    open_or_skip(device).release()
    code = f"""
from rastercov.base.errors import DeviceError
from rastercov.gl.context import open_context
try:
    open_context({device!r})
except DeviceError as error:
    print(error)
"""
    done = run_python("-c", code, MESA_GL_VERSION_OVERRIDE="4.3")
    (line,) = done.stdout.splitlines()
    assert "expected an OpenGL 4.5 core context, got none; install a newer driver" in line


@pytest.mark.parametrize(
    ("function", "answer", "words"),
    [
        ("eglCreateContext", None, r"an OpenGL 4\.5 core context"),
        ("eglMakeCurrent", 0, "expected to make the context current, got error EGL erro"),
        ("eglInitialize", 0, "expected an EGL display, got error EGL erro"),
        ("eglGetPlatformDisplayEXT", None, "expected an EGL display, got error EGL erro"),
        ("address", 0, r"expected libGL\.so\.1, got no OpenGL library"),
    ],
)
def test_what_the_driver_refuses_is_an_error(egl, monkeypatch, function, answer, words):
    monkeypatch.setattr(egl, function, lambda *_: answer)
    with pytest.raises(DeviceError, match=words):
        open_context("surfaceless")


def test_a_library_without_an_entry_point_is_refused_by_its_name():
    with pytest.raises(
        DeviceError,
        match="expected an OpenGL library with OSMesaCreateContextAttribs, got one without;",
    ):
        libraries.Library("OSMesa", lambda name: 0)


# --- choosing -------------------------------------------------------------------------------------


KNOWN = r"auto, cpu, egl:0, egl:1, got "
NO_DEVICE = r"EGL reports no hardware device: install the GPU's EGL driver"


@pytest.mark.parametrize(
    ("listed", "device", "words"),
    [
        *(
            ([GPU, CPU, devices.SURFACELESS], device, KNOWN)
            for device in (99, -1, "a", "egl:x", "egl:99", "egl:-1", "", True, 0.0, None)
        ),
        *(([devices.SURFACELESS], device, NO_DEVICE) for device in ("egl", "egl:0", 0)),
        ([], "surfaceless", NO_DEVICE),
    ],
)
def test_a_device_that_is_not_there_is_answered_with_what_is(monkeypatch, listed, device, words):
    monkeypatch.setattr(devices, "egl_devices", lambda: listed)
    monkeypatch.setattr(devices, "list_devices", lambda: [GPU, CPU])
    with pytest.raises(DeviceError, match=words):
        open_context(device)


def test_a_gpu_tells_its_node_its_name_and_its_cuda_index(egl, monkeypatch):
    words = "EGL_EXT_device_drm EGL_EXT_device_query_name EGL_NV_device_cuda"
    answers = {0x3055: words.encode(), 0x3233: b"/dev/dri/card2", 0x335F: b"NVIDIA H200"}

    def tell_cuda_index(handle, attribute, value):
        ctypes.cast(value, ctypes.POINTER(ctypes.c_ssize_t))[0] = 3
        return int(attribute == 0x323A)

    monkeypatch.setattr(egl, "eglQueryDeviceStringEXT", lambda handle, token: answers.get(token))
    monkeypatch.setattr(egl, "eglQueryDeviceAttribEXT", tell_cuda_index)
    device = devices.describe_device(egl, 1, 0)
    assert (device.name, device.cuda_index) == ("/dev/dri/card2, NVIDIA H200", 3)
    assert not device.is_software
    assert device.label == "egl:1"
    monkeypatch.setattr(egl, "eglQueryDeviceAttribEXT", lambda *_: 0)
    assert devices.describe_device(egl, 1, 0).cuda_index is None


def test_hardware_that_cannot_be_had_is_refused_by_name():
    if any(not device.is_software for device in list_devices()):
        pytest.skip("this machine has hardware")
    open_or_skip("surfaceless").release()
    with pytest.raises(
        DeviceError,
        match=r"expected a device: auto, cpu, egl:0, .*got 'hardware'; ",
    ):
        open_context("hardware")


def test_software_renderers_are_known_by_name():
    for renderer in ("llvmpipe (LLVM 15)", "softpipe", "Google SwiftShader"):
        assert devices.SOFTWARE_RENDERERS.search(renderer), renderer
    assert not devices.SOFTWARE_RENDERERS.search("NVIDIA H200/PCIe/SSE2")


def test_software_in_place_of_hardware_is_not_silent(context, monkeypatch):
    real = next((device for device in list_devices() if device.index == 0), None)
    if real is None or not real.is_software:
        pytest.skip("needs a software EGL device at index 0")
    liar = dataclasses.replace(real, is_software=False)
    monkeypatch.setattr(devices, "egl_devices", lambda: [liar, devices.SURFACELESS])
    monkeypatch.delenv("LIBGL_ALWAYS_SOFTWARE", raising=False)
    renderer = context.info.renderer.split()[0]
    for device in (0, "hardware"):
        with pytest.raises(DeviceError, match=f"promised hardware.*{renderer}"):
            open_context(device)
    with open_context("auto") as fallback:
        assert fallback.info.device.kind == "egl-surfaceless"


def test_hardware_in_place_of_software_is_not_silent(context, monkeypatch):
    monkeypatch.setattr(devices, "SOFTWARE_RENDERERS", re.compile("no renderer at all"))
    monkeypatch.setattr(devices, "egl_devices", lambda: [devices.SURFACELESS])
    with pytest.raises(DeviceError, match="promised software"):
        open_context("surfaceless")


def test_forced_software_skips_hardware_devices(monkeypatch):
    monkeypatch.setattr(devices, "egl_devices", lambda: [GPU, CPU, devices.SURFACELESS])
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "1")
    with pytest.raises(DeviceError, match="LIBGL_ALWAYS_SOFTWARE is set: unset it"):
        devices.candidates("hardware")
    for device in ("auto", "egl", "surfaceless"):
        assert GPU not in devices.candidates(device)[0]
    assert devices.candidates("egl:0")[0] == [GPU]  # asked for by number: the driver answers
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "0")
    assert devices.candidates("auto")[0][0] == GPU


# --- missing libraries ----------------------------------------------------------------------------


@pytest.mark.parametrize("device", ["auto", "egl", "egl:0", 0, "surfaceless", "osmesa"])
def test_without_its_library_the_error_says_what_to_install(no_library, device):
    package = "libosmesa6" if device == "osmesa" else "libegl1 libgl1 libgl1-mesa-dri"
    with pytest.raises(DeviceError, match=f"apt-get install -y {package}"):
        open_context(device)


def test_without_libraries_there_are_no_devices(no_library):
    assert list_devices() == []


# --- one owner ------------------------------------------------------------------------------------


def test_a_context_of_its_own_works_in_another_thread(context):
    pixels = []

    def draw():
        with open_context("surfaceless") as own:
            pixels.append(draw_red(own))

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    assert pixels == [b"\xff\x00\x00\xff"]


def test_use_after_release_is_an_error(context):
    context.release()
    context.release()
    clear = partial(context.function, "glClear", None)
    for attempt in (lambda: context.gl, context.check_owner, clear):
        with pytest.raises(DeviceError, match="expected a live OpenGL context, got a released one"):
            attempt()


@pytest.mark.slow
def test_a_forked_child_is_told_instead_of_hanging(context):
    code = """
import os, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of every such fork
from rastercov.base.errors import ConfigError, DeviceError
from rastercov.gl.context import open_context
context = open_context("surfaceless")
child = os.fork()
if child == 0:
    try:
        for attempt in (lambda: context.gl, open_context):
            try:
                attempt()
                os._exit(3)
            except DeviceError as error:
                assert str(os.getpid()) in str(error) and str(os.getppid()) in str(error)
                assert "spawn" in str(error)
        with context:
            pass
    except DeviceError:
        context.release()
        os._exit(0)
    os._exit(4)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
assert context.gl.error == "GL_NO_ERROR"
context.release()
"""
    run_python("-W", "error", "-c", code, timeout=60)


@pytest.mark.parametrize("other", ["surfaceless", "osmesa"])
def test_two_contexts_take_turns(context, other):
    with open_or_skip(other) as other:
        for turn in (other, context, other):
            turn.make_current()
            assert turn._door.current() == turn._handle
            assert draw_red(turn) == b"\xff\x00\x00\xff"
        gl = context.gl
        other.make_current()
    assert gl.buffer(b"1234").read() == b"1234"
    assert draw_red(context) == b"\xff\x00\x00\xff"  # the release hands the thread back


@pytest.mark.slow
def test_a_context_opens_without_a_home_and_may_be_open_when_python_ends(context):
    code = (
        "from rastercov.gl.context import open_context\n"
        "c = open_context()\nc.gl.buffer(b'1')\nprint(c.info.renderer)"
    )
    home = {"HOME": "/proc", "XDG_CACHE_HOME": "/proc/none", "LIBGL_ALWAYS_SOFTWARE": "1"}
    done = run_python("-W", "error", "-c", code, timeout=60, LANG="C", LC_ALL="C", **home)
    assert devices.SOFTWARE_RENDERERS.search(done.stdout)
    assert not re.search("exception|warning|error", done.stderr, re.IGNORECASE)


def test_a_forgotten_context_warns_and_is_released(context, monkeypatch):
    forgotten = open_context("surfaceless")
    assert isinstance(forgotten, HeadlessContext)
    destroy, handle, destroyed = forgotten._door.destroy, forgotten._handle, []
    monkeypatch.setattr(
        forgotten._door, "destroy", lambda own: destroyed.append(own) or destroy(own)
    )
    with pytest.warns(ResourceWarning, match="not released"):
        del forgotten
    assert destroyed == [handle]
    context.make_current()


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    [
        "context",
        pytest.param("our-osmesa", marks=pytest.mark.matter("opengl")),
        pytest.param("rasteriser", marks=nightly),
    ],
)
def test_a_context_that_was_closed_leaves_less_than_two_pages_behind(context, kind):
    if kind == "our-osmesa":
        open_or_skip("osmesa").release()
    script = Path(__file__).parents[2] / "benchmarks" / "contexts.py"
    done = run_python(script, "--kind", kind, "--rounds", "300")
    grown = json.loads(done.stdout)
    # KiB. 39 to 46 with what moderngl keeps; up to 1.3 MiB of noise are shared by all rounds.
    assert grown["resident"] < 8, grown
    assert grown["malloc"] < 1, grown
