"""What `.ci/cross` makes for another kind of machine, and what `.ci/trial` says of its figures."""

import math
import subprocess
import sys
import zipfile
from importlib.machinery import SourceFileLoader
from importlib.util import find_spec, module_from_spec, spec_from_loader
from pathlib import Path

import pytest
from nightly import nightly

CROSS = Path(__file__).parents[1] / ".ci/cross"
ZIG = [sys.executable, "-m", "ziglang"]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("ziglang") is None, reason="no Zig; run: make wasm"),
]
SOURCE = "__declspec(dllexport) int {}(void) {{ return 3; }}\n"
EXPORTS = ["PyLong_AsLong", "PyModule_Create2", "_Py_Dealloc"]


def script(name):
    """A program of .ci as a module."""
    loader = SourceFileLoader(name, str(CROSS.parent / name))
    module = module_from_spec(spec_from_loader(name, loader))
    loader.exec_module(module)
    return module


@pytest.fixture
def cross():
    return script("cross")


def said(*words):
    return subprocess.run(
        [sys.executable, str(CROSS), *map(str, words)], capture_output=True, text=True, check=False
    )


@nightly  # Zig compiles what each target links, at first
@pytest.mark.parametrize(
    ("kind", "magic"),
    [
        ("x86_64", b"\x7fELF\x02\x01"),
        ("aarch64", b"\x7fELF\x02\x01"),
        ("macos_arm64", b"\xcf\xfa\xed\xfe"),
    ],
)
def test_zig_compiles_for_the_target_of_each_kind(kind, magic, tmp_path):
    done = said(kind, tmp_path)
    assert done.returncode == 0, done.stderr
    options = dict(each.split("=", 1) for each in done.stdout.split())
    source, made = tmp_path / "a.c", tmp_path / "a.o"
    source.write_text("int a(void) { return 3; }\n")
    target = options["-DCMAKE_CXX_COMPILER_TARGET"]
    subprocess.run([*ZIG, "cc", "-target", target, "-c", source, "-o", made], check=True)
    assert made.read_bytes().startswith(magic)


@nightly
def test_the_library_of_windows_names_what_its_python_exports(cross, tmp_path, monkeypatch):
    python = tmp_path / "python"
    python.mkdir()
    source = tmp_path / "python3.c"
    source.write_text("".join(SOURCE.format(name) for name in EXPORTS))
    words = ["cc", "-target", "x86_64-windows-gnu", "-shared", source, "-o", python / "python3.dll"]
    subprocess.run([*ZIG, *words], check=True)
    wheel = tmp_path / "numpy.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("numpy/core/include/numpy/arrayobject.h", "")
    monkeypatch.setattr(cross, "embedded", lambda folder: python)
    monkeypatch.setattr(cross, "from_pypi", lambda folder, *words: wheel)
    assert set(EXPORTS) <= set(cross.exports(python / "python3.dll"))
    made = [*cross.for_windows(tmp_path / "made"), cross.numpy_of(tmp_path / "made", "win_amd64")]
    options = dict(each.split("=", 1) for each in made)
    assert (Path(options["-DRASTERCOV_NUMPY"]) / "numpy/arrayobject.h").is_file()
    assert "MS_WIN64" in (Path(options["-DPython_INCLUDE_DIR"]) / "pyconfig.h").read_text()
    user, made = tmp_path / "user.c", tmp_path / "user.dll"
    calls = "".join(f"int {name}(void);\n" for name in EXPORTS)
    user.write_text(f"{calls}int main(void) {{ return {'() + '.join(EXPORTS)}(); }}\n")
    library = options["-DPython_SABI_LIBRARY"]
    words = ["cc", "-target", "x86_64-windows-gnu", user, library, "-o", made]
    subprocess.run([*ZIG, *words], check=True)
    table = subprocess.run(["objdump", "-p", made], capture_output=True, text=True, check=True)
    assert "DLL Name: python3.dll" in table.stdout
    assert all(name in table.stdout for name in EXPORTS)


@nightly
def test_a_bundle_of_macos_is_linked_as_a_dynamic_library(cross, tmp_path):
    source = tmp_path / "a b.c"
    source.write_text("int none(void); int a(void) { return none(); }\n")
    compiler = cross.compiler_of(tmp_path).partition("=")[2]
    words = ["-target", "aarch64-macos.11.0", "-bundle", "-Wl,@names.sym", "-Wl,-dead_strip"]
    made = tmp_path / "a b.so"
    subprocess.run([compiler, *words, "-o", made, source], check=True)
    assert made.read_bytes()[:16] == b"\xcf\xfa\xed\xfe\x0c\0\0\x01\0\0\0\0\x06\0\0\0"  # MH_DYLIB


@pytest.mark.parametrize("words", [(), ("x86_64",), ("sparc", "x"), ("aarch64", "a", "b")])
def test_other_words_are_refused_in_a_line(words):
    done = said(*words)
    assert done.returncode == 1
    assert done.stderr.startswith("expected one of x86_64, aarch64, win_amd64, macos_arm64 and a")


EXACT = ("/covered_area/m2", "/zones/0/area_m2", "/goals/wall/share", "/covered_percent")
CLOSE = ("/zones/0/centroid", "/covered_area/bound_m2", "/cameras/0/down_deg")
LEFT_OUT = ("/seconds/steps/area", "/run/versions/numpy", "/poses_per_second")


def document(path, value):
    """A document with one value at a path."""
    for key in reversed(path.split("/")[1:]):
        value = [value] if key == "0" else {key: value}
    return value


@pytest.mark.parametrize("value", [0.3, 12345.678, 1e-7])
@pytest.mark.parametrize("path", [*EXACT, *CLOSE, *LEFT_OUT])
def test_a_trial_names_areas_that_differ_by_a_bit_and_other_figures_by_more(path, value):
    differences = script("trial").differences
    here = document(path, value)
    assert differences(here, document(path, value)) == []
    next_one = document(path, math.nextafter(value, math.inf))
    assert len(differences(here, next_one)) == (path in EXACT)
    for other in (document(path, 1.001 * value + 1e-6), document(path, None), {}):
        found = differences(here, other)
        assert [line.partition(":")[0] for line in found] == [path] * (path not in LEFT_OUT)


@pytest.mark.parametrize("words", [(), ("x86_64", "w", "f"), ("aarch64", "w"), ("win_amd64",)])
def test_a_trial_of_other_words_is_refused_in_a_line(words):
    done = subprocess.run(
        [sys.executable, CROSS.parent / "trial", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("expected aarch64 or win_amd64, a wheel and a folder, got ")


def test_windows_is_refused_at_once_where_python_has_no_headers_for_it(cross, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["cross", "win_amd64", "build"])
    monkeypatch.setattr(sys, "version_info", (3, 11))
    with pytest.raises(SystemExit, match=r"expected Python 3\.12 or later for win_amd64, got"):
        cross.main()


def test_drives_of_wine_are_not_in_the_folder_that_an_sdist_is_made_of(tmp_path, monkeypatch):
    """Z: is a link to /, which what packs an sdist follows: it read all files of the machine."""
    trial = script("trial")
    monkeypatch.setattr(trial, "ROOT", tmp_path)
    (tmp_path / "build/cross/win_amd64/python").mkdir(parents=True)
    _, own = trial.python_of("win_amd64", tmp_path / "build/trial", "elsewhere")
    assert own["WINEPREFIX"] == "elsewhere"
