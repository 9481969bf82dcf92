"""The doctor: CPU and devices are tested, none takes it down, and it says what will be used."""

import copy
import dataclasses
import io
import json
import os
import re
import sys
import time

import pytest
from rich.console import Console

from rastercov import open_rasterizer, shaders
from rastercov.base.errors import DeviceError
from rastercov.cli import doctor
from rastercov.raster import self_test
from rastercov.raster.cpu import CPURasterizer
from rastercov.raster.gl import WAYS, GLRasterizer, devices, diagnose, libraries
from rastercov.raster.gl.devices import SURFACELESS, DeviceInfo

ON_CPU = re.compile(
    r"By default rastercov counts on the CPU, numba [\d.]+, \d+ threads?, because .*\.$"
)
GPU = DeviceInfo("egl-device", 0, "/dev/dri/card0", is_software=False, cuda_index=3)


def printed(report, width=80):
    """What a person reads, as one string of plain text."""
    file = io.StringIO()
    doctor.print_report(report, Console(file=file, width=width))
    text = file.getvalue()
    assert all(len(line) <= width for line in text.splitlines())
    return text


def flat(text):
    """Text without line breaks, for sentences that wrap."""
    return " ".join(text.split())


def answer_here(question, label, timeout_s):
    """`diagnose.ask` without a process."""
    return json.loads(json.dumps(question(label)))


@pytest.fixture(scope="module")
def examined(gl_context):
    """One examination of this machine, with the questions answered in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LP_NUM_THREADS", "2")
        patch.setattr(diagnose, "ask", answer_here)
        report = diagnose.examine()
    gl_context.make_current()
    return report


@pytest.fixture
def report(examined):
    """A copy that a test may change."""
    return copy.deepcopy(examined)


@pytest.fixture
def bad_driver(tmp_path, monkeypatch, examined):
    """A device that opens, whose driver then does what a shell script says; or at opening."""
    opened = json.dumps({"context": examined["reports"][0]["context"]})
    (tmp_path / "opened.json").write_text(opened)

    def install(script, when):
        python = tmp_path / "python"
        python.write_text(
            f'#!/bin/sh\ncase "$*" in *{when}*) {script};; esac\ncat {tmp_path}/opened.json\n'
        )
        python.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(python))
        monkeypatch.setattr(diagnose, "list_devices", lambda: [SURFACELESS])

    return install


@pytest.fixture
def gpu_report(report):
    """A machine with a graphics card, made up from the software renderer of this one."""
    row = next(r for r in report["reports"] if r["device"]["label"] == "surfaceless")
    card = copy.deepcopy(row) | {"plan": "pipeline"}
    card["device"] = dataclasses.asdict(GPU) | {"label": "egl:0"}
    card["context"] |= {
        "renderer": "NVIDIA H200/PCIe/SSE2 [x]",
        "version": "4.6.0 NVIDIA 580.105.08",
        "gl_version": 460,
        "is_software": False,
    }
    report["reports"] = [card, row]
    report["default"] = {"device": "egl:0", "why": "it is the first that draws in hardware"}
    report["hardware_hints"] = []
    return report


# --- this machine ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_process_for_each_device_answers_as_this_one(examined):
    start = time.monotonic()
    assert diagnose.examine()["reports"] == examined["reports"]
    assert time.monotonic() - start < 60  # about 2.5 s on two quiet cores


@pytest.mark.slow
def test_every_device_passes_its_self_test_and_its_row_tells_what_it_runs(report):
    assert report["reports"]
    for row in report["reports"]:
        assert (row["problem"], row["self_test"], row["plan"]) == ("", "passed", "pipeline")
        label = row["device"]["label"]
        with GLRasterizer(self_test.MESH, self_test.CAMERA, device=label) as rasterizer:
            assert rasterizer.info.device.startswith(label)
            assert rasterizer.info.renderer == row["context"]["renderer"]
            assert (rasterizer.info.plan, rasterizer.info.depth) == (row["plan"], row["depth"])
    assert doctor.exit_code(report) == 0


def test_the_default_is_what_auto_opens(report):
    with open_rasterizer(self_test.MESH, self_test.CAMERA) as rasterizer:
        assert rasterizer.info.device.split(" ")[0] == report["default"]["device"]
        rows = {row["device"]["label"]: row["context"] for row in report["reports"]}
        row = {"cpu": report["cpu"], **rows}[report["default"]["device"]]
        assert rasterizer.info.renderer == row["renderer"]


def test_every_kind_of_context_and_what_made_the_report_is_in_it(report, gl_context):
    renderer, cores = f"numba {report['versions']['numba']}", len(os.sched_getaffinity(0))
    assert report["cpu"] == {"renderer": renderer, "threads": cores, "self_test": "passed"}
    assert set(report["kinds"]) == {"egl-device", "egl-surfaceless", "osmesa"}
    assert report["kinds"]["egl-surfaceless"] == "available"
    assert report["libraries"]["EGL"] == "libEGL.so.1"
    assert report["environment"]["LP_NUM_THREADS"] == "2"
    row = next(r for r in report["reports"] if r["device"]["kind"] == "egl-surfaceless")
    found, info = row["context"], gl_context.info
    assert found["renderer"] == info.renderer
    assert found["limits"]["max_texture_size"] == info.limits["max_texture_size"]
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["shaders"] == shaders.digest()
    names = ["rastercov", "Python", "moderngl", "numba", "numpy", "trimesh", "OS"]
    assert list(report["versions"]) == names
    assert all(report["versions"].values())


@pytest.mark.parametrize("width", [80, 120])
def test_printed_report_has_every_device_and_ends_with_the_default(report, width):
    text = printed(report, width)
    for row in report["reports"]:
        assert re.search(rf"^ ?{row['device']['label']} .*passed", text, re.MULTILINE)
    cpu = r"^ ?cpu +numba [\d.]+ +- +- +software +threads +passed *$"
    assert re.search(cpu, text, re.MULTILINE)
    assert text.index("cpu ") < min(
        text.index(f"{row['device']['label']} ") for row in report["reports"]
    )
    assert report["versions"]["moderngl"] in text
    device, why = report["default"]["device"], report["default"]["why"].split(";")[0]
    assert flat(text).endswith(f", because {why}.")
    if device == "cpu":
        assert ON_CPU.search(flat(text))
        assert "Limits of" not in text


def test_environment_is_printed_with_its_effect(report):
    report["environment"] = {"LIBGL_ALWAYS_SOFTWARE": "1", "CUDA_VISIBLE_DEVICES": "[2]"}
    text = flat(printed(report))
    assert "LIBGL_ALWAYS_SOFTWARE=1 1 forbids hardware" in text
    assert "CUDA_VISIBLE_DEVICES=[2] EGL ignores it" in text


# --- the self-test --------------------------------------------------------------------------------


@pytest.mark.slow
def test_self_test_runs_every_plan_the_device_has(device, monkeypatch):
    plans, start = [], GLRasterizer.__init__

    def remember(self, *arguments, **options):
        plans.append((options.get("plan", "auto"), options.get("max_layers")))
        start(self, *arguments, **options)

    monkeypatch.setattr(GLRasterizer, "__init__", remember)
    assert diagnose.verify_device("surfaceless")["plan"] == "pipeline"
    layers = [("pipeline", 128)] * 2 if device.info.has_batches else []
    compute = [("compute", None)] * 2 if device.info.has_compute_raster else []
    assert plans == [("pipeline", 1)] * 2 + layers + compute + [("auto", None)]


COUNTS, SCENES = ("visible", "drawn", "background"), ("box", "sphere")


@pytest.mark.slow
@pytest.mark.parametrize("row", range(9))
def test_one_wrong_count_fails_the_self_test(device, monkeypatch, row):
    """Each plan and count, on one of the scenes."""
    plan, scene, name = list(WAYS)[row // 3], SCENES[row % 2], COUNTS[(row // 3 + row) % 3]
    has = {"layers": device.info.has_batches, "compute": device.info.has_compute_raster}
    if not has.get(plan, True):
        pytest.skip(f"this device does not run plan {plan}")
    count, faces = GLRasterizer.count, {"box": 48, "sphere": 80}

    def miscount(self, poses):
        counts = count(self, poses)
        way = self.info.plan
        if way == "pipeline" and self._strategy._layers > 1:
            way = "layers"
        if way == plan and self.mesh.n_faces == faces[scene]:
            most = counts.visible.argmax() if name != "background" else 0
            getattr(counts, name).flat[most] += 1
        return counts

    monkeypatch.setattr(GLRasterizer, "count", miscount)
    with pytest.raises(
        DeviceError, match=rf"plan {plan}: {scene}: 1 of 4 poses are counted wrongly"
    ):
        diagnose.verify_device("surfaceless")


@pytest.mark.slow
@pytest.mark.parametrize("when", ["open_device", "verify_device"])
@pytest.mark.parametrize(
    ("script", "problem"),
    [
        ("kill -SEGV $$", "crashed with SIGSEGV"),
        ("exec sleep 60", "no answer in 1 s, it hangs"),
        ("echo no libLLVM >&2; exit 7", "ended with code 7: no libLLVM"),
        ("exit 0", "ended with code 0 and no answer"),
        ("echo '{}'; kill -SEGV $$", "crashed with SIGSEGV"),  # after the answer
        ('echo \'{"problem": "plan pipeline: box: bad"}\'; exit 0', "plan pipeline: box: bad"),
    ],
)
def test_a_driver_that_fails_is_reported(bad_driver, script, problem, when):
    bad_driver(script, when)
    report = diagnose.examine(timeout_s=1 if "sleep" in script else 30)
    (row,) = report["reports"]
    opens = when == "verify_device"
    assert problem in row["self_test" if opens else "problem"]
    assert opens == (row["problem"] == "") == (row["self_test"] is not None)
    assert (problem in report["kinds"]["egl-surfaceless"]) != opens
    assert report["default"]["device"] == "cpu"
    assert doctor.exit_code(report) == 0
    text = flat(printed(report))
    assert (f"surfaceless: {row['self_test']}" if opens else row["problem"]) in text
    assert ("does not open" in text) != opens
    assert ON_CPU.search(text)


@pytest.mark.parametrize("what", ["visible", "drawn", "background", "face"])
def test_one_wrong_count_on_the_cpu_fails_its_self_test(monkeypatch, what):
    count, render = CPURasterizer.count, CPURasterizer.render

    def miscount(self, poses):
        counts = count(self, poses)
        if what != "face":
            values = getattr(counts, what)
            values.flat[counts.visible.argmax() if what != "background" else 0] += 1
        return counts

    def miss(self, pose):
        image = render(self, pose)
        if what == "face":
            image.face[0, 0] = 0
        return image

    monkeypatch.setattr(CPURasterizer, "count", miscount)
    monkeypatch.setattr(CPURasterizer, "render", miss)
    with pytest.raises(DeviceError, match=r"^box: \d of 4 poses are counted wrongly$"):
        diagnose.verify_cpu()


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (DeviceError("numba 0 counted a known scene wrongly"), "numba 0 counted a known scene"),
        (ImportError("no\nllvmlite"), "ImportError: no llvmlite"),
        (MemoryError(), "MemoryError:"),
    ],
)
def test_a_cpu_that_fails_is_reported_in_one_line(no_library, monkeypatch, error, line):
    def refuse(self, *arguments, **options):
        raise error

    monkeypatch.setattr(CPURasterizer, "__init__", refuse)
    report = diagnose.examine()
    assert report["cpu"]["self_test"].startswith(line)
    assert "\n" not in report["cpu"]["self_test"]
    assert doctor.exit_code(report) == 1
    text = flat(printed(report))
    assert f"Problems cpu: {line}" in text
    assert text.endswith("tries cpu, which fails its self-test; nothing else passes")


def test_a_cpu_that_fails_is_answered_with_a_device_that_passes(report):
    report["cpu"]["self_test"] = "box: 1 of 4 poses are counted wrongly"
    report["default"] = {"device": "cpu", "why": "no hardware device opens; it is fast"}
    assert doctor.exit_code(report) == 1
    label = report["reports"][0]["device"]["label"]
    assert flat(printed(report)).endswith(f"fails its self-test; pass `--device {label}`")


# --- other machines -------------------------------------------------------------------------------


def test_without_any_library_the_report_says_what_to_install(no_library):
    report = diagnose.examine()
    assert report["reports"] == []
    assert set(report["libraries"].values()) == {None}
    assert libraries.install_line("egl") in report["kinds"]["egl-device"]
    assert libraries.install_line("egl") in report["kinds"]["egl-surfaceless"]
    assert libraries.install_line("osmesa") in report["kinds"]["osmesa"]
    assert set(report["install"]) == {"EGL", "OpenGL", "OSMesa"}
    assert report["cpu"]["self_test"] == "passed"
    assert doctor.exit_code(report) == 0
    text = printed(report)
    assert "Missing libraries, needed only for OpenGL" in text
    for line in report["install"].values():
        assert line in text
    assert ON_CPU.search(flat(text))
    assert "Missing devices" not in text
    assert json.loads(json.dumps(report)) == report


def test_libraries_without_a_driver_say_what_to_install(device, monkeypatch):
    for module in (devices, diagnose):
        monkeypatch.setattr(module, "list_devices", list)
    monkeypatch.setattr(devices, "egl_devices", list)
    report = diagnose.examine()
    assert doctor.exit_code(report) == 0
    text = flat(printed(report))
    assert "egl-surfaceless EGL announces none" in text
    assert libraries.install_line("egl") in text
    assert ON_CPU.search(text)


@pytest.mark.parametrize("width", [80, 120])
def test_a_graphics_card_is_shown_with_its_driver_and_limits_and_named_at_the_end(
    gpu_report, width
):
    text = printed(gpu_report, width)
    cells = r"egl:0 +NVIDIA H200/PCIe/SSE2 \[x\] +NVIDIA 580\.105\.08 +4\.6 +hardware"
    assert width < 120 or re.search(cells + " +pipeline +passed", text)
    assert re.search("^ ?CUDA 3 ", text, re.MULTILINE)
    assert "Why no hardware" not in text
    for words in ("Limits of egl:0", "image side", "image layers", "storage block",
                  "sub-pixel bits", "float32", "64-bit atomics  no"):  # fmt: skip
        assert words in text
    card = "NVIDIA H200/PCIe/SSE2 [x], plan pipeline"
    why = "because it is the first that draws in hardware."
    assert flat(text).endswith(f"By default rastercov draws on egl:0, {card}, {why}")


@pytest.mark.parametrize(
    ("cpu", "surfaceless", "advice"),
    [
        ("passed", "passed", "pass `--device cpu`"),
        ("bad", "passed", "pass `--device surfaceless`"),
        ("bad", "bad", "nothing else passes"),
    ],
)
def test_a_default_that_fails_is_answered_with_what_passes(gpu_report, cpu, surfaceless, advice):
    gpu_report["reports"][0]["self_test"] = "plan layers: box: 1 of 4 poses are counted wrongly"
    gpu_report["reports"][1]["self_test"] = surfaceless
    gpu_report["cpu"]["self_test"] = cpu
    assert doctor.exit_code(gpu_report) == 1
    text = flat(printed(gpu_report))
    assert "egl:0: plan layers: box: 1 of 4 poses are counted wrongly" in text
    assert text.endswith(f"tries egl:0, which fails its self-test; {advice}")


@pytest.mark.parametrize(
    ("setting", "opens", "default", "why"),
    [
        ("", ["egl:0", "surfaceless"], "egl:0", "first that draws in hardware"),
        ("", ["surfaceless"], "cpu", "no hardware device opens; it is"),
        ("1", ["egl:0", "surfaceless"], "cpu", "forbids hardware"),
    ],
)
def test_default_follows_the_order_of_auto(monkeypatch, setting, opens, default, why):
    monkeypatch.setattr(devices, "egl_devices", lambda: [GPU, SURFACELESS])
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", setting)
    rows = [
        {"device": {"label": label}, "problem": "" if label in opens else "no"}
        for label in ("egl:0", "surfaceless")
    ]
    found = diagnose._default(rows)
    assert found["device"] == default
    assert why in found["why"]


def test_a_missing_package_is_named(monkeypatch, no_library):
    def absent(name):
        raise diagnose.PackageNotFoundError(name)

    monkeypatch.setattr(diagnose, "version", absent)
    assert diagnose.examine()["versions"]["moderngl"] == "not installed"
