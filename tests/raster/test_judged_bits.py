"""Faces judged on the device: the bits, areas and views of the host, in every way."""

import re
from dataclasses import replace

import moderngl
import numpy as np
import pytest
from gl_device import DEVICE, IN_SOFTWARE
from judged_scenes import compare, compare_all, criteria_of
from nightly import amount
from processes import TESTS, run_python
from scenes import large_and_small
from test_parallel_samples import views_of

import rastercov as rc
from rastercov import shaders
from rastercov.base.errors import DeviceError, ResourceError
from rastercov.core.coverage.coverage import SampledObserver
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.task import Rules
from rastercov.core.raster.contract import area_units
from rastercov.gl import GLRasterizer, compute, judging
from rastercov.gl.resources import Resources

pytestmark = pytest.mark.matter("opengl")
MESH = rc.shapes.torus(12, 8)
CAMERA = rc.Camera.from_fov(80, 60, hfov_deg=50)
HUGE = rc.Camera(width=1024, height=512, fx=900, fy=900)
RULES = rc.Task(min_visibility=0.3).rules(CAMERA)
PARALLEL = rc.Camera(width=80, height=60, fx=30, fy=30, model="telecentric", near=0.01)
POSES = rc.sphere_of_poses((0, 0, 0), 2 * MESH.diagonal, 9)


@pytest.fixture
def open_compute(device):
    def open_one(mesh=MESH, camera=CAMERA, **options):
        return GLRasterizer(mesh, camera, device=device, plan="compute", **options)

    return open_one


@pytest.mark.every_day
def test_a_device_judges_hostile_scenes_as_the_host_does(device):
    assert compare_all(device, np.random.default_rng(1), 12) > 50


@pytest.mark.slow
def test_a_device_judges_many_scenes_as_the_host_does(device):
    assert compare_all(device, np.random.default_rng(2), amount(40, 1500)) > 1000


@pytest.mark.slow
@pytest.mark.skipif(not IN_SOFTWARE, reason="Mesa is told what to offer")
def test_atomics_of_64_bits_give_the_same_bits():
    code = f"""
import numpy as np
from judged_scenes import compare_all
from rastercov.gl.context import open_context

with open_context({DEVICE!r}) as context:
    assert context.info.has_int64_atomics
    assert compare_all(context, np.random.default_rng(3), 9) > 50
"""
    override = {"MESA_EXTENSION_OVERRIDE": "+GL_NV_shader_atomic_int64"}
    run_python("-c", code, paths=[TESTS / "raster", TESTS / "support"], **override)


def test_parallel_rays_are_judged_as_on_the_host(open_compute):
    rng, mesh, total = np.random.default_rng(3), large_and_small()[0], 0
    for window in (0.3, 1.0):
        camera, poses = views_of(mesh, rng, window)
        with open_compute(mesh, camera, roll=0.4) as rasterizer:
            total += sum(compare(rasterizer, poses, rng=rng) for _ in range(6))
    assert total > 50


def test_an_observer_has_its_rasterisers_judge_by_the_criteria_of_each_camera(device):
    rig = (CAMERA, rc.Camera.from_fov(70, 50, hfov_deg=20))
    poses = replace(rc.Poses.of(POSES), camera=np.arange(len(POSES)) % 2)
    task = rc.Task(max_incidence_deg=60)
    for backend in ({"backend": "cpu"}, {"backend": "gl", "device": device, "plan": "compute"}):
        with SampledObserver(MESH, rig, 1, **backend) as observer:
            faces = FacePass(MESH, rig, 1, task)
            criteria = faces.criteria()
            if why := observer.why_not_judged(poses, criteria):
                assert why.endswith("counts, and judges nothing")
            else:
                judged, _ = observer.judge(poses, criteria)
            arrays = {"reason": np.empty((len(poses), MESH.n_faces), np.uint8)}
            faces.fill(observer.measure(poses), poses, arrays)
    covered = arrays["reason"] == rc.Reason.COVERED
    np.testing.assert_array_equal(judged.dense(), covered)
    assert covered.any(axis=1).all()
    assert (judged.area_units == covered @ area_units(MESH)).all()
    assert (judged.views == covered.sum(axis=0)).all()


# --- what is left to the host ---------------------------------------------------------------------


def test_a_threshold_without_a_shader_is_left_to_the_host_and_named(open_compute):
    plain = criteria_of(MESH, rc.Task().rules(CAMERA))
    with open_compute() as rasterizer:
        assert rasterizer._why_not_judged(plain) == ""
        for value, reason in ((0.0, ""), (2.0, "no shader judges min_gloss for this camera")):
            criteria = replace(plain, rules={**plain.rules, "min_gloss": value})
            assert rasterizer._why_not_judged(criteria) == reason


def test_every_threshold_of_a_task_is_registered_and_decides(open_compute):
    text = shaders.source("judge.comp")
    code = "\n".join(line.partition("//")[0] for line in text.splitlines())
    names = re.findall(r"\w+", code)
    unused = {"tan_incidence"}  # of areas alone
    assert {name for name in Rules._fields if names.count(name) < 2} == unused
    camera = replace(CAMERA, focus_range=(0.1, 9.0))
    limits = {"max_incidence_deg": 60, "min_pixel_density": 1, "min_visibility": 0.1}
    limits |= {"min_facing_density": 1, "min_pixels_per_m2": 1, "focus_rule": "centroid"}
    rules = rc.Task(**limits).rules(camera)
    assert all(rules)
    with open_compute(camera=camera) as rasterizer:
        assert rasterizer._why_not_judged(criteria_of(MESH, rules)) == ""


@pytest.mark.parametrize(
    ("mesh", "camera", "options", "reason"),
    [
        (MESH, CAMERA, {"plan": "pipeline"}, "plan 'pipeline' judges nothing on the device"),
        (MESH, HUGE, {"supersample": 64}, "images of 2^31 samples are counted on the host"),
        (MESH, PARALLEL, {}, "no shader judges min_pixel_density for this camera"),
    ],
)
def test_what_a_device_cannot_judge_it_says(device, mesh, camera, options, reason):
    rules = rc.Task(min_pixel_density=1).rules(camera)
    with GLRasterizer(mesh, camera, device=device, **{"plan": "compute"} | options) as rasterizer:
        assert reason in rasterizer._why_not_judged(criteria_of(mesh, rules))


# --- how the work is divided ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "sizes",
    [
        {"compute.MAX_POSES": 2},
        {"compute.MOST_LISTED": 100},
        {"judging.POSES_AHEAD": 4, "compute.MAX_POSES": 3},
        {"judging.MAX_GROUPS": 1},
    ],
)
def test_how_poses_are_shared_out_changes_no_bit(open_compute, monkeypatch, sizes):
    modules = {"compute": compute, "judging": judging}
    for name, value in sizes.items():
        module, _, name = name.partition(".")
        assert hasattr(modules[module], name)
        monkeypatch.setattr(modules[module], name, value)
    with open_compute() as rasterizer:
        compare(rasterizer, POSES, RULES)
    with open_compute(camera=CAMERA.resized(4)) as rasterizer:
        compare(rasterizer, POSES, RULES)


@pytest.mark.parametrize(("most", "is_divided"), [(300, False), (30, True)])
def test_a_dispatch_fills_no_more_entries_than_its_share(
    open_compute, monkeypatch, most, is_divided
):
    monkeypatch.setattr(compute, "MOST_LISTED", most)
    with open_compute(camera=CAMERA.resized(4)) as rasterizer:
        turns, honest = [], compute.set_uniforms

        def noted(program, **uniforms):
            turns.extend(value for name, value in uniforms.items() if name == "first_group")
            honest(program, **uniforms)

        monkeypatch.setattr(compute, "set_uniforms", noted)
        compare(rasterizer, POSES)
    assert {view for view, _ in turns} == set(range(len(POSES)))
    assert (len({row for _, row in turns}) > 1) == is_divided


def test_the_host_takes_bits_of_a_batch_while_the_next_is_drawn(open_compute, monkeypatch):
    monkeypatch.setattr(compute, "MAX_POSES", 2)
    order = []

    def noted(kind, name):
        honest = getattr(kind, name)
        monkeypatch.setattr(
            kind, name, lambda *args, **options: order.append(name) or honest(*args, **options)
        )

    with open_compute() as rasterizer:
        criteria = criteria_of(MESH, RULES)
        noted(judging.Judging, "_start")
        noted(judging.Judging, "_finish")
        rasterizer._judge(POSES, criteria)
    assert order == ["_start", *["_start", "_finish"] * 4, "_finish"]


def test_staging_is_used_again_only_after_its_fence(open_compute, monkeypatch):
    calls = []
    honest = Resources.call

    def noted(self, name, *arguments):
        calls.append((name, arguments))
        return honest(self, name, *arguments)

    with open_compute() as rasterizer:
        monkeypatch.setattr(Resources, "call", noted)
        rasterizer._judge(POSES, criteria_of(MESH, RULES))
        made = [name for name, _ in calls if name == "glFenceSync"]
        copies = [name for name, _ in calls if name == "glCopyNamedBufferSubData"]
        staged = [each for ring in rasterizer._resources._staged.values() for each in ring]
    assert len(made) == len(copies) > 0
    assert {len(ring) for ring in rasterizer._resources._staged.values()} <= {1, 2}
    assert len({each._name for each in staged}) == len(staged) > 2
    used: set[int] = set()
    for name, arguments in calls:  # no copy while an earlier one of the same buffer is not awaited
        if name == "glCopyNamedBufferSubData":
            own = {each._name for each in staged} & set(arguments[:2])
            assert not own & used
            used |= own
        if name == "glDeleteSync":
            used.clear()


# --- a device that fails --------------------------------------------------------------------------


def test_samples_that_do_not_add_up_are_refused(open_compute, monkeypatch):
    with open_compute() as rasterizer:
        criteria, strategy = criteria_of(MESH, RULES), rasterizer._strategy
        honest = strategy.fill_counters

        def lossy(scene, n_poses, tiles, **options):
            honest(scene, n_poses, list(tiles)[:-1], **options)

        monkeypatch.setattr(strategy, "fill_counters", lossy)
        monkeypatch.setattr(rasterizer, "_note", lambda n_poses: None)
        with pytest.raises(DeviceError, match=r"got a fault: it counted \d+ samples of 4800; see"):
            rasterizer._judge(POSES, criteria)


def test_a_device_that_is_lost_is_noticed(open_compute, monkeypatch):
    with open_compute() as rasterizer:
        with monkeypatch.context() as patch:
            patch.setattr(rasterizer._context, "reset_status", lambda: 0x8253)
            with pytest.raises(DeviceError, match=r"a lost one while .*; open a new rasteriser"):
                rasterizer._judge(POSES, criteria_of(MESH, RULES))
        compare(rasterizer, POSES)


def too_large(monkeypatch, most):
    """From now on the device has no memory for buffers of more bytes than this."""
    make, orphan = Resources.make, moderngl.Buffer.orphan

    def lacking(self, what, size, create):
        if size > most:
            raise ResourceError(f"no {what}")
        return make(self, what, size, create)

    monkeypatch.setattr(Resources, "make", lacking)
    poll, refused = Resources.poll, []

    def orphaned(self, size):
        refused.append(1) if size > most else orphan(self, size)

    def polled(self, doing):
        if refused:
            refused.clear()
            raise ResourceError(f"no memory {doing}")
        poll(self, doing)

    monkeypatch.setattr(moderngl.Buffer, "orphan", orphaned)
    monkeypatch.setattr(Resources, "poll", polled)


def test_batches_shrink_where_memory_is_short(open_compute, monkeypatch):
    with open_compute() as rasterizer:
        most = rasterizer._strategy.most_poses
    too_large(monkeypatch, 100_000)
    with open_compute() as rasterizer:
        assert 1 < rasterizer._strategy.most_poses < most
        compare(rasterizer, POSES)
    with open_compute(camera=CAMERA.resized(8)) as rasterizer:  # whose lists have no room
        compare(rasterizer, POSES)


def test_memory_too_short_for_one_pose_is_refused(open_compute, monkeypatch):
    too_large(monkeypatch, 70_000)
    with pytest.raises(ResourceError, match="no triangles"):
        open_compute(rc.shapes.torus(60, 40))
