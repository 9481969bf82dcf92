"""Every fault of device, driver, process or caller is told apart from an answer."""

import copy
import dataclasses
import itertools
import pickle
import re
import threading
from contextlib import suppress
from functools import partial

import moderngl
import numpy as np
import pytest
from gl_device import DEVICE
from image_laws import assert_same_counts
from judged_scenes import criteria_of

from rastercov import shaders
from rastercov.base.errors import ConfigError, DeviceError, ResourceError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import SampledObserver, open_observer
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import shapes
from rastercov.core.raster import open_rasterizer
from rastercov.gl import PLANS, GLRasterizer, pipeline
from rastercov.gl import rasterizer as rasterizer_module
from rastercov.gl.compute import Compute
from rastercov.gl.pipeline import DeviceScene
from rastercov.gl.resources import FUNCTIONS, Resources, Staging

CAMERA = Camera(width=80, height=60, fx=75, fy=75)
MESH = shapes.torus(12, 8)
POSES = sphere_of_poses((0, 0, 0), 4, 4)
CLOSE = sphere_of_poses((0, 0, 0), 1.9, 4)  # the mesh reaches beyond the image


@pytest.fixture
def rasterizer(open_gl):
    return open_gl(MESH, CAMERA)


# --- what a device lacks --------------------------------------------------------------------------


def counted(context, plan, mesh=MESH, **options):
    with GLRasterizer(mesh, CAMERA, device=context, plan=plan, **options) as rasterizer:
        return rasterizer.count(np.concatenate((POSES, CLOSE))), rasterizer.info


def test_a_mesh_with_more_counters_than_a_storage_block_holds_is_refused(device, monkeypatch):
    limits = device.info.limits | {"max_ssbo_bytes": 4 * MESH.n_faces}
    monkeypatch.setattr(device, "info", dataclasses.replace(device.info, limits=limits))
    line = rf"a storage block .* got {4 * MESH.n_faces + 4} for .* use backend 'cpu'"
    with pytest.raises(ResourceError, match=line):
        counted(device, "pipeline")


@pytest.mark.parametrize("is_software", [True, False])
@pytest.mark.parametrize("has_int64", [True, False])
def test_the_plan_by_default_is_that_of_the_device(device, monkeypatch, is_software, has_int64):
    extensions = device.info.extensions if has_int64 else frozenset()
    info = dataclasses.replace(device.info, is_software=is_software, extensions=extensions)
    monkeypatch.setattr(device, "info", info)
    expected = "compute" if has_int64 and not is_software else "pipeline"
    assert counted(device, "auto")[1].plan == expected
    long = dataclasses.replace(CAMERA, fx=1e6)
    if has_int64:
        with GLRasterizer(MESH, long, device=device) as rasterizer:
            assert rasterizer.info.plan == "compute"
    else:
        for plan in ("auto", "compute"):
            with pytest.raises(DeviceError, match="expected GL_ARB_gpu_shader_int64 for plan"):
                GLRasterizer(MESH, long, device=device, plan=plan)


# --- what a caller gets wrong ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("backend", "options", "words"),
    [
        ("auto", {"speed": 1}, "expected options that the backend takes, got"),
        ("cpu", {"plan": "compute"}, "expected options that the backend takes, got"),
        ("gl", {"threads": 1}, "expected options that the backend takes, got"),
        (
            "auto",
            {"threads": 1, "plan": "compute"},
            "expected options that the backend takes, got",
        ),
        ("gl", {"device": "cpu"}, "device to be one of backend gl, got 'cpu'"),
        ("gl", {"plan": "fast"}, "plan to be .* got 'fast'"),
        ("vulkan", {}, "backend to be .* got 'vulkan'"),
        *(
            ("cpu", {"supersample": value}, "supersample to be a whole number from 1 to 64")
            for value in (0, -1, 65, 1.5, True, "2")
        ),
        *(("cpu", {"roll": value}, "roll to be an angle") for value in (np.nan, "0.4", None)),
    ],
)
@pytest.mark.parametrize("lens", [{}, {"skew": 1.0}], ids=["pinhole", "lens"])
def test_an_option_that_a_backend_does_not_know_is_refused(backend, options, words, lens):
    camera = dataclasses.replace(CAMERA, **lens)
    with pytest.raises(ConfigError, match=words):
        open_rasterizer(MESH, camera, backend, **options)


@pytest.mark.parametrize("lens", [{}, {"skew": 1.0}], ids=["pinhole", "lens"])
def test_device_or_backend_is_what_counts_and_threads_judge(lens):
    camera = dataclasses.replace(CAMERA, **lens)
    by_cpu = {"device": "cpu"}, {"backend": "cpu", "device": "auto"}
    by_gl = {"backend": "gl"}, {"device": "gl"}, {"device": DEVICE}
    for options in (*by_cpu, *by_gl):
        backend = "cpu" if options in by_cpu or lens else "gl"
        with open_rasterizer(MESH, camera, **options) as rasterizer:
            assert rasterizer.info.backend == backend
    for device, backend in (("cpu", "cpu"), ("gl", "gl"), (DEVICE, "gl")):
        with open_observer(MESH, camera, f"sampled:{device}", threads=2) as observer:
            assert (observer.info.backend, observer.threads) == ("cpu" if lens else backend, 2)


def test_drawn_pixels_that_were_not_counted_are_refused(rasterizer):
    counts = rasterizer.count(POSES, drawn=False)
    with pytest.raises(ConfigError, match=re.escape("use count(poses, drawn=True)")):
        counts.drawn_pixels  # noqa: B018 - it raises


# --- threads, processes, lifetimes ----------------------------------------------------------------


def test_use_from_a_second_thread_names_both(rasterizer, device):
    caught = []

    def run():
        for call in calls:
            with pytest.raises(DeviceError) as error:
                call()
            caught.append(str(error.value))

    with SampledObserver(MESH, CAMERA, backend="gl", device=device) as observer:
        expected = observer.observe(POSES).visible_pixels
        calls = [partial(rasterizer.count, POSES), partial(rasterizer.render, POSES[0])]
        calls += [rasterizer.close, partial(observer.observe, POSES), observer.close]
        calls += [device.make_current, device.release, lambda: device.gl]
        thread = threading.Thread(target=run, name="guest")
        thread.start()
        thread.join(60)
        # A close that was refused has closed nothing.
        np.testing.assert_array_equal(observer.observe(POSES).visible_pixels, expected)
    assert len(caught) == len(calls)
    assert all("'guest'" in line and threading.current_thread().name in line for line in caught)
    assert rasterizer.count(POSES).visible.any()


def test_every_method_of_a_closed_rasteriser_says_so(open_raster):
    rasterizer = open_raster(MESH, CAMERA)
    rasterizer.close()
    told = []
    for name in (name for name in dir(rasterizer) if not name.startswith("_")):
        member = getattr(rasterizer, name)
        if callable(member) and name != "close":
            more = (None,) if name == "judge" else ()
            with pytest.raises(DeviceError, match="expected an open rasteriser, got a closed one"):
                member(POSES[0], *more)
            told.append(name)
    assert {"count", "render"} <= set(told)  # and those of one rasteriser alone
    with rasterizer as again, pytest.raises(DeviceError, match="closed"):
        again.count(POSES)


@pytest.mark.parametrize("take", [copy.copy, copy.deepcopy, pickle.dumps])
def test_what_holds_a_device_or_scratch_memory_cannot_be_copied_or_pickled(device, take):
    gl = {"backend": "gl", "device": device}
    with (
        open_rasterizer(MESH, CAMERA, "cpu") as cpu,
        open_rasterizer(MESH, CAMERA, **gl) as drawn,
        open_observer(MESH, CAMERA, "certified") as exact,
        SampledObserver(MESH, CAMERA, **gl) as sampled,
    ):
        for thing in (device, cpu, drawn, exact, sampled):
            name = type(thing).__name__
            with pytest.raises(
                ConfigError, match=rf"{name} to stay in its process, got a copy [^\n]*$"
            ):
                take(thing)
        assert cpu.count(POSES).visible.any()


@pytest.mark.slow
def test_rasterisers_take_turns_on_one_and_on_two_contexts(open_gl):
    first, second = open_gl(MESH, CAMERA), open_gl(shapes.box(), CAMERA, supersample=2)
    plan = first.info.plan
    with open_rasterizer(MESH, CAMERA, "gl", device=DEVICE, plan=plan) as third:
        turns = [first, second, third, first, third, second]
        counts = {rasterizer: rasterizer.count(POSES) for rasterizer in turns[:3]}
        for rasterizer in turns:
            assert_same_counts(rasterizer.count(POSES), counts[rasterizer])
        np.testing.assert_array_equal(counts[third].visible, counts[first].visible)
    first.close()
    assert_same_counts(second.count(POSES), counts[second])


# --- a device that answers wrongly ----------------------------------------------------------------


def test_barrier_comes_before_every_reading_of_counters(rasterizer, monkeypatch):
    calls = []

    def noted(kind, name):
        honest = getattr(kind, name)
        monkeypatch.setattr(
            kind, name, lambda *args, **options: calls.append(name) or honest(*args, **options)
        )

    noted(moderngl.Context, "memory_barrier")
    noted(Staging, "read")
    rasterizer.count(POSES)
    reads = [at for at, name in enumerate(calls) if name == "read"]
    assert reads
    assert {calls[at - 1] for at in reads} == {"memory_barrier"}


@pytest.mark.parametrize("plan", PLANS)
def test_the_host_touches_no_buffer_that_a_shader_uses(device, monkeypatch, plan):
    # NVIDIA's driver moves one that it reads, or writes while shaders use it, to the host's memory.
    own, used, mapped = set(), set(), set()

    def note(kind, name, take):
        honest = getattr(kind, name)

        def noted(*arguments, **options):
            result = honest(*arguments, **options)
            take(result, *arguments)
            return result

        monkeypatch.setattr(kind, name, noted)

    note(moderngl.Context, "buffer", lambda made, *_: own.add(made.glo))
    note(moderngl.Buffer, "bind_to_storage_buffer", lambda _, buffer, *__: used.add(buffer.glo))
    note(Resources, "call", lambda _, __, name, *rest: name in MAPS and mapped.add(rest[0]))
    for name in ("read", "read_into", "read_chunks", "write", "write_chunks", "clear"):
        monkeypatch.delattr(moderngl.Buffer, name)
    for roll in (0.4, 0.0):
        for each in (own, used, mapped):
            each.clear()  # names of what is closed are given again
        with GLRasterizer(MESH, CAMERA, device=device, plan=plan, roll=roll) as rasterizer:
            assert rasterizer.count(POSES).visible.any()
            assert (rasterizer.render(POSES[0]).face >= 0).any()
            criteria = criteria_of(MESH, Task().rules(CAMERA))
            if not rasterizer._why_not_judged(criteria):
                assert rasterizer._judge(POSES, criteria)[0].packed.any()
        assert used <= own
        assert mapped
        assert not mapped & (own | used)
    assert {name for name in FUNCTIONS if "Buffer" in name and "Frame" not in name} == {
        *("glClearBufferfv", "glClearBufferuiv"),  # of images
        *("glCopyNamedBufferSubData", "glCreateBuffers", "glDeleteBuffers"),
        *("glMapNamedBufferRange", "glNamedBufferStorage"),
    }


MAPS = ("glMapNamedBufferRange", "glNamedBufferStorage")


def one_pixel_off(ids):
    ids = ids.copy()
    row, column = np.argwhere(ids > 0)[0]
    ids[row, column] ^= 1
    return ids


@pytest.mark.parametrize("wrong", [np.zeros_like, one_pixel_off, np.ones_like])
def test_wrong_image_is_caught_at_opening(device, monkeypatch, wrong):
    read = Resources.read_faces
    monkeypatch.setattr(Resources, "read_faces", lambda *arguments: wrong(read(*arguments)))
    with pytest.raises(DeviceError, match="expected correct results of"):
        GLRasterizer(MESH, CAMERA, device=device, plan="pipeline")


def one_count_moved(counters):
    if counters.ndim == 1:  # no counters
        return counters
    moved = counters.copy()
    row = moved.reshape(-1, moved.shape[-1])[0]
    row[np.argmax(row)] -= 1
    row[-1] += 1
    return moved


@pytest.mark.slow
@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("roll", [0.0, 0.4])
@pytest.mark.parametrize("wrong", [np.zeros_like, one_count_moved])
def test_wrong_counters_are_caught_at_opening(device, monkeypatch, wrong, plan, roll):
    read = Resources.read_words
    monkeypatch.setattr(Resources, "read_words", lambda *arguments: wrong(read(*arguments)))
    with pytest.raises(DeviceError, match="expected correct results"):
        GLRasterizer(MESH, CAMERA, device=device, plan=plan, roll=roll)


def stuck(monkeypatch):
    """From now on images and counters keep what they hold: nothing is cleared, nothing is drawn."""
    monkeypatch.setattr(Resources, "clear", lambda *_, **__: None)
    monkeypatch.setattr(Resources, "zero", lambda *_: None)
    blind(monkeypatch)


def blind(monkeypatch):
    """From now on nothing is drawn."""
    monkeypatch.setattr(DeviceScene, "draw", lambda *_, **__: None)
    monkeypatch.setattr(Compute, "_draw", lambda *_: None)


def no_depth_test(monkeypatch):
    """From now on the face drawn last wins, or the lists stay empty."""
    monkeypatch.setattr(pipeline.moderngl, "DEPTH_TEST", 0)
    monkeypatch.setattr(Compute, "_enter", lambda *_, **__: None)


@pytest.mark.slow
@pytest.mark.parametrize("fail", [stuck, blind, no_depth_test])
def test_device_that_goes_wrong_later_is_caught_within_the_interval(open_gl, monkeypatch, fail):
    monkeypatch.setattr(rasterizer_module, "SELF_TEST_INTERVAL", 8)
    rasterizer = open_gl(MESH, CAMERA)
    rasterizer.count(POSES)
    fail(monkeypatch)
    with pytest.raises(DeviceError, match="expected correct results"):
        rasterizer.count(np.concatenate((POSES, POSES)))


def test_counts_that_do_not_add_up_are_refused(open_gl, monkeypatch):
    rasterizer = open_gl(MESH, CAMERA)
    honest = rasterizer._strategy.count

    def lossy(*arguments, **options):
        counts, empty = honest(*arguments, **options)
        return counts, empty - 1

    monkeypatch.setattr(rasterizer._strategy, "count", lossy)
    with pytest.raises(DeviceError, match="got a fault: it counted 4799 samples of 4800; see"):
        rasterizer.count(POSES)


def test_face_that_does_not_exist_is_refused(device, monkeypatch):
    read = Resources.read_faces
    with GLRasterizer(MESH, CAMERA, device=device, plan="pipeline") as rasterizer:
        monkeypatch.setattr(Resources, "read_faces", lambda *arguments: read(*arguments) * 1000)
        with pytest.raises(DeviceError, match=r"drew face \d+ of 192"):
            rasterizer.count(POSES)


@pytest.mark.slow
def test_interrupted_counting_leaves_the_next_one_right(rasterizer, monkeypatch):
    expected = rasterizer.count(POSES)
    steps = (
        (Resources, "read_words"),
        (DeviceScene, "draw"),
        (Compute, "_enter"),
        (Resources, "poll"),
    )
    for victim, name in steps:
        for call in range(4):
            honest, calls = getattr(victim, name), []

            def interrupt(*arguments, honest=honest, calls=calls, call=call, **options):
                calls.append(1)
                if len(calls) == call + 1:
                    raise KeyboardInterrupt
                return honest(*arguments, **options)

            with monkeypatch.context() as patch:
                patch.setattr(victim, name, interrupt)
                with suppress(KeyboardInterrupt):
                    rasterizer.count(POSES)
            counts = rasterizer.count(POSES)
            assert_same_counts(counts, expected)


@pytest.mark.parametrize(
    ("owner", "name", "fault", "kind", "text"),
    [
        (
            "gl",
            "error",
            "GL_INVALID_OPERATION",
            DeviceError,
            "expected no error of the device, got GL_INVALID_OPE",
        ),
        (
            "gl",
            "error",
            "GL_OUT_OF_MEMORY",
            ResourceError,
            "expected enough memory of the device, got too little whi",
        ),
        (
            *("context", "reset_status", lambda: 0x8253, DeviceError),
            "expected a live context, got a lost one whi",
        ),
    ],
)
def test_fault_that_the_driver_reports_is_raised(
    rasterizer, monkeypatch, owner, name, fault, kind, text
):
    owners = {"gl": moderngl.Context, "context": type(rasterizer._context)}
    monkeypatch.setattr(owners[owner], name, property(lambda self: fault))
    for call in (rasterizer.count, rasterizer.render):
        with pytest.raises(kind, match=text):
            call(POSES[0])
    monkeypatch.undo()


# --- shaders and memory ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plan", "name"),
    [
        *itertools.product(["pipeline"], ("face.vert", "face.frag", "drawn.frag")),
        *itertools.product(["compute"], ("setup.comp", "list.comp", "scan.comp", "fill.comp")),
    ],
)
def test_shader_that_does_not_compile_is_named(device, monkeypatch, plan, name):
    honest = shaders.source

    def broken(asked, **defines):
        return honest(asked, **defines) + ("\nnonsense;" if asked == name else "")

    monkeypatch.setattr(shaders, "source", broken)
    words = rf"{name} .*{shaders.digest()[:12]}.*(nonsense|syntax error)"
    with pytest.raises(DeviceError, match=words) as caught:
        GLRasterizer(MESH, CAMERA, device=device, plan=plan)
    assert "\n" not in str(caught.value)


def test_missing_shader_file_is_named(device, monkeypatch, tmp_path):
    monkeypatch.setattr(shaders, "files", lambda package: tmp_path)
    shaders.source.cache_clear()
    try:
        with pytest.raises(DeviceError, match=r"face.vert.glsl is missing .* reinstall rastercov"):
            GLRasterizer(MESH, CAMERA, device=device, plan="pipeline")
    finally:
        shaders.source.cache_clear()


@pytest.mark.parametrize(
    ("plan", "maker"),
    [
        *itertools.product(["pipeline"], ("buffer", "texture", "framebuffer")),
        ("compute", "buffer"),  # where it keeps everything
    ],
)
@pytest.mark.parametrize("way", ["raises", "error flag"])
def test_refused_allocation_says_how_many_bytes(open_gl, monkeypatch, plan, maker, way):
    make, error = getattr(moderngl.Context, maker), moderngl.Context.error

    def refuse(self, *arguments, **options):
        if way == "raises":
            raise moderngl.Error("cannot create it")
        failed.append(maker)
        return make(self, *arguments, **options)

    failed = []
    monkeypatch.setattr(moderngl.Context, maker, refuse)
    monkeypatch.setattr(
        moderngl.Context,
        "error",
        property(lambda self: "GL_OUT_OF_MEMORY" if failed else error.fget(self)),
    )
    with pytest.raises(ResourceError, match="expected the device to allocate"):
        open_gl(MESH, CAMERA)
    monkeypatch.undo()
