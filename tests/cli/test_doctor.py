"""The doctor: CPU and devices are tested, none takes it down, and it says what will be used."""

import copy
import dataclasses
import io
import json
import os
import re
import runpy
import sys
import time
from unittest.mock import Mock

import pytest
from commands import call
from rich.console import Console

from rastercov import engine, open_rasterizer, shaders
from rastercov.base.errors import DeviceError
from rastercov.cli import doctor
from rastercov.core.raster import self_test
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.gl import PLANS, GLRasterizer, devices, diagnose, libraries
from rastercov.gl.devices import SURFACELESS, DeviceInfo
from rastercov.report import live

ON_CPU = re.compile(r"The default device is the CPU, rastercov [\w.]+, \d+ threads?: .*\.$")
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
    card = copy.deepcopy(row)
    card["device"] = dataclasses.asdict(GPU) | {"label": "egl:0"}
    card["context"] |= {
        "renderer": "NVIDIA H200/PCIe/SSE2 [x]", "version": "4.6.0 NVIDIA 580.105.08",
        "gl_version": 460, "is_software": False,
    }  # fmt: skip
    return report | {"reports": [card, row], "hardware_hints": []}


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
        assert (row["problem"], row["self_test"]) == ("", "passed")
        label = row["device"]["label"]
        with GLRasterizer(self_test.MESH, self_test.CAMERA, device=label) as rasterizer:
            assert rasterizer.info.device.startswith(label)
            assert rasterizer.info.renderer == row["context"]["renderer"]
    assert doctor.exit_code(report) == 0


def test_the_default_is_what_auto_opens(report):
    with open_rasterizer(self_test.MESH, self_test.CAMERA) as rasterizer:
        assert rasterizer.info.device.split(" ")[0] == report["default"]["device"] == "cpu"
        assert rasterizer.info.renderer == report["cpu"]["renderer"]


def test_every_kind_of_context_and_what_made_the_report_is_in_it(report, gl_context):
    renderer, cores = f"rastercov {report['versions']['rastercov']}", len(os.sched_getaffinity(0))
    assert report["cpu"] == {"renderer": renderer, "threads": cores, "self_test": "passed"}
    assert set(report["kinds"]) == {"egl-device", "egl-surfaceless", "osmesa"}
    assert report["kinds"]["egl-surfaceless"] == "available"
    assert report["environment"]["LP_NUM_THREADS"] == "2"
    row = next(r for r in report["reports"] if r["device"]["kind"] == "egl-surfaceless")
    assert row["context"]["renderer"] == gl_context.info.renderer
    assert row["context"]["limits"] == json.loads(json.dumps(gl_context.info.limits))
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["shaders"] == shaders.digest()
    names = ["rastercov", "Python", "moderngl", "numpy", "trimesh", "OS"]
    assert list(report["versions"]) == names


@pytest.mark.parametrize("width", [80, 120])
def test_printed_report_has_every_device_and_ends_with_the_default(report, width):
    report["environment"] = {"LIBGL_ALWAYS_SOFTWARE": "1", "CUDA_VISIBLE_DEVICES": "[2]"}
    text = printed(report, width)
    rows = [r"cpu +rastercov [\w.]+ +- +software +passed *$"]
    rows += [rf"{row['device']['label']} .*passed" for row in report["reports"]]
    places = [re.search(f"^ ?{row}", text, re.MULTILINE).start() for row in rows]
    assert places[0] == min(places)
    for words in (report["versions"]["moderngl"], "CUDA_VISIBLE_DEVICES=[2]"):
        assert words in flat(text)
    assert ON_CPU.search(flat(text))


# --- the self-test --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("row", range(6))
def test_one_wrong_count_fails_the_self_test(device, monkeypatch, row):
    """Each plan and count, on one of the scenes."""
    plan, name = list(PLANS)[row // 3], ("visible", "drawn", "background")[(row // 3 + row) % 3]
    scene, n_faces = (("box", 48), ("sphere", 80))[row % 2]
    count = GLRasterizer.count

    def miscount(self, poses):
        counts = count(self, poses)
        if (self.info.plan, self.mesh.n_faces) == (plan, n_faces):
            most = counts.visible.argmax() if name != "background" else 0
            getattr(counts, name).flat[most] += 1
        return counts

    monkeypatch.setattr(GLRasterizer, "count", miscount)
    words = rf"plan {plan}: expected correct counts of {scene}, got 1 of 4 poses wrong"
    with pytest.raises(DeviceError, match=words):
        diagnose.verify_device("surfaceless")


@pytest.mark.slow
@pytest.mark.parametrize("when", ["open_device", "verify_device"])
@pytest.mark.parametrize(
    ("script", "problem"),
    [("kill -SEGV $$", "crashed with SIGSEGV"), ("exec sleep 60", "no answer in 1 s, it hangs"),
     ("echo no libLLVM >&2; exit 7", "ended with code 7: no libLLVM"),
     ("exit 0", "ended with code 0 and no answer"),
     ("echo '{}'; kill -SEGV $$", "crashed with SIGSEGV"),  # after the answer
     ('echo \'{"problem": "plan pipeline: box: bad"}\'; exit 0', "plan pipeline: box: bad")],
)  # fmt: skip
def test_a_driver_that_fails_is_reported(bad_driver, script, problem, when):
    bad_driver(script, when)
    report = diagnose.examine(timeout_s=1 if "sleep" in script else 30)
    (row,) = report["reports"]
    opens = when == "verify_device"
    assert problem in row["self_test" if opens else "problem"]
    assert opens == (row["problem"] == "") == (row["self_test"] is not None)
    assert (problem in report["kinds"]["egl-surfaceless"]) != opens
    assert (report["default"]["device"], doctor.exit_code(report)) == ("cpu", 0)
    text = flat(printed(report))
    assert (f"surfaceless: {row['self_test']}" if opens else row["problem"]) in text
    assert ("does not open" in text) != opens
    assert ON_CPU.search(text)


@pytest.mark.parametrize("what", ["visible", "drawn", "background", "face"])
def test_one_wrong_count_on_the_cpu_fails_its_self_test(monkeypatch, what):
    name = "render" if what == "face" else "count"
    measure = getattr(CPURasterizer, name)

    def wrong(self, poses):
        result = measure(self, poses)
        at = result.visible.argmax() if what in ("visible", "drawn") else 0
        getattr(result, what).flat[at] += 1
        return result

    monkeypatch.setattr(CPURasterizer, name, wrong)
    with pytest.raises(DeviceError, match=r"^expected correct counts of box, got \d of 4 poses"):
        diagnose.verify_cpu()


@pytest.mark.parametrize(
    ("error", "line"),
    [(DeviceError("rastercov 0 counted a scene wrongly"), "rastercov 0 counted a scene"),
     (ImportError("no\nloops"), "ImportError: no loops"), (MemoryError(), "MemoryError:")],
)  # fmt: skip
def test_a_cpu_that_fails_is_reported_in_one_line(no_library, monkeypatch, error, line):
    monkeypatch.setattr(CPURasterizer, "__init__", Mock(side_effect=error))
    report = diagnose.examine()
    assert report["cpu"]["self_test"].startswith(line)
    assert "\n" not in report["cpu"]["self_test"]
    assert doctor.exit_code(report) == 1
    text = flat(printed(report))
    assert f"Problems cpu: {line}" in text
    assert text.endswith("the CPU, fails its self-test; nothing else passes")


# --- other machines -------------------------------------------------------------------------------


def test_without_any_library_the_report_says_what_to_install(no_library):
    report = diagnose.examine()
    assert report["reports"] == []
    egl, osmesa = libraries.INSTALL_EGL, libraries.INSTALL_OSMESA
    for kind, line in (("egl-device", egl), ("egl-surfaceless", egl), ("osmesa", osmesa)):
        assert line in report["kinds"][kind]
    assert (report["cpu"]["self_test"], doctor.exit_code(report)) == ("passed", 0)
    text = flat(printed(report, 120))
    assert "Missing devices, needed only for OpenGL" in text
    for words in ("expected", "libEGL.so.1", "libOSMesa.so.8", "libegl1", "libosmesa6"):
        assert words in text
    assert ON_CPU.search(text)


@pytest.mark.parametrize("system", ["darwin", "win32"])
def test_no_packages_of_debian_are_advised_elsewhere(system, monkeypatch):
    monkeypatch.setattr(sys, "platform", system)
    path = runpy.run_path(libraries.__file__)
    for remedy in (path["INSTALL_EGL"], path["INSTALL_OSMESA"]):
        assert remedy == "use the CPU: OpenGL needs Linux"


def test_libraries_without_a_driver_say_what_to_install(device, monkeypatch):
    for module in (devices, diagnose):
        monkeypatch.setattr(module, "list_devices", list)
    monkeypatch.setattr(devices, "egl_devices", list)
    report = diagnose.examine()
    assert doctor.exit_code(report) == 0
    text = flat(printed(report))
    assert "egl-surfaceless EGL reports none" in text
    assert "apt-get install -y libegl1" in text
    assert ON_CPU.search(text)


@pytest.mark.parametrize("width", [80, 120])
def test_a_graphics_card_is_shown_with_its_driver_and_named_at_the_end(gpu_report, width):
    text, card = printed(gpu_report, width), "NVIDIA H200/PCIe/SSE2 [x]"
    cells = rf"egl:0 +{re.escape(card)} +4\.6\.0 NVIDIA 580\.105\.08 +hardware +passed"
    assert width < 120 or re.search(cells, text)
    assert re.search("^ ?CUDA 3 ", text, re.MULTILINE)
    assert "Why there is no hardware device" not in text
    assert ON_CPU.search(flat(text))
    assert flat(text).endswith(f"; `--device hardware` is {card}.")


@pytest.mark.parametrize(
    ("results", "advice"),
    [
        (("passed", "bad"), "pass `--device egl:0`"),
        (("bad", "passed"), "pass `--device surfaceless`"),
        (("bad", "bad"), "nothing else passes"),
    ],
)
def test_a_cpu_that_fails_is_answered_with_what_passes(gpu_report, results, advice):
    problem = "expected correct counts of box, got 1 of 4 poses wrong"
    gpu_report["cpu"]["self_test"] = problem
    for row, result in zip(gpu_report["reports"], results, strict=True):
        row["self_test"] = result
    assert doctor.exit_code(gpu_report) == 1
    text = flat(printed(gpu_report))
    assert f"cpu: {problem}" in text
    assert text.endswith(f"the CPU, fails its self-test; {advice}")


def test_a_missing_package_is_named(monkeypatch, no_library):
    monkeypatch.setattr(diagnose, "version_of", Mock(return_value=None))
    assert diagnose.examine()["versions"]["moderngl"] == "not installed"


@pytest.mark.parametrize("has_engine", [True, False])
def test_it_says_levels_memory_and_whether_pages_compute(report, monkeypatch, capsys, has_engine):
    monkeypatch.setattr("rastercov.core.raster.drawer", lambda: Mock(examine=lambda: report))
    monkeypatch.setattr(live, "engine", lambda: b"" if has_engine else None)
    monkeypatch.setenv("COLUMNS", "100")
    _, out, _ = call(capsys, "doctor")
    levels = f"{', '.join(engine.built_modules())}; in use {engine.LEVEL}"
    assert re.search(rf"levels +{levels} *\n", out)
    assert re.search(r"memory +[\d.]+ GiB free *\n", out)
    pages = "compute by the engine" if has_engine else live.WITHOUT
    assert re.search(rf"pages +{pages} *\n", out)
    about = json.loads(call(capsys, "doctor --json")[1])["cpu"]["about"]
    assert (about["levels"], about["pages"]) == (levels, pages)
