"""The library of C as others find it: by CMake and pkg-config, shared and static."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILD, EXAMPLE = ROOT / "build", ROOT / "examples/c/coverage.c"
TOOLS = Path(sys.executable).parent
ENVIRONMENT = {**os.environ, "PKG_CONFIG_PATH": str(BUILD / "lib/pkgconfig")}
ENVIRONMENT["PATH"] = f"{TOOLS}:{os.environ['PATH']}"
SAID = "together they cover 1.500000000 m2"
CMAKE = """\
cmake_minimum_required(VERSION 3.18)
project(host LANGUAGES C CXX)
find_package(rastercov {version} REQUIRED)
add_executable(coverage {example})
target_link_libraries(coverage PRIVATE rastercov::{target})
set_target_properties(coverage PROPERTIES LINKER_LANGUAGE CXX)
"""
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (BUILD / "lib/librastercov.a").exists(), reason="run: make lib"),
]


def ran(*words, cwd=None):
    return subprocess.run(
        list(map(str, words)),
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )


def needed(path):
    """Libraries that a program or library loads."""
    lines = ran("objdump", "-p", path).stdout.splitlines()
    return [line.split()[1] for line in lines if "NEEDED" in line]


def configure(folder, version, target):
    (folder / "CMakeLists.txt").write_text(
        CMAKE.format(version=version, target=target, example=EXAMPLE)
    )
    words = ("cmake", "-G", "Ninja", "-B", folder / "out", "-S", folder)
    return ran(*words, f"-DCMAKE_PREFIX_PATH={BUILD}")


@pytest.mark.parametrize("target", ["rastercov", "static"])
def test_cmake_finds_the_version_that_is_asked_for(tmp_path, target):
    if shutil.which("ninja", path=ENVIRONMENT["PATH"]) is None or shutil.which("cc") is None:
        pytest.skip("no compiler")
    configured = configure(tmp_path, "1.0", target)
    assert configured.returncode == 0, configured.stderr
    made = ran("cmake", "--build", tmp_path / "out")
    assert made.returncode == 0, made.stdout
    assert SAID in ran(tmp_path / "out/coverage").stdout
    libraries = needed(tmp_path / "out/coverage")
    assert ("librastercov.so.1" in libraries) == (target == "rastercov")


def test_cmake_refuses_another_version(tmp_path):
    configured = configure(tmp_path, "2.0", "rastercov")
    assert configured.returncode != 0
    assert "version: 1.0.0" in configured.stderr


@pytest.mark.skipif(shutil.which("pkg-config") is None, reason="no pkg-config")
def test_pkg_config_names_what_a_static_program_needs(tmp_path):
    flags = ran("pkg-config", "--static", "--cflags", "--libs", "rastercov").stdout.split()
    static = [flag.replace("-lrastercov", "-l:librastercov.a") for flag in flags]
    made = ran("cc", EXAMPLE, *static, "-o", tmp_path / "coverage")
    assert made.returncode == 0, made.stderr
    assert SAID in ran(tmp_path / "coverage").stdout
    assert not [name for name in needed(tmp_path / "coverage") if "rastercov" in name]


@pytest.mark.skipif(None in map(shutil.which, ("mcs", "mono")), reason="no C# to compile with")
def test_c_sharp_calls_the_library(tmp_path):
    source = EXAMPLE.with_name("Coverage.cs")
    made = ran("mcs", source, f"-out:{tmp_path / 'coverage.exe'}")
    assert made.returncode == 0, made.stdout
    path = f"LD_LIBRARY_PATH={BUILD / 'lib'}"
    assert ran("env", path, "mono", tmp_path / "coverage.exe").stdout == (
        "the camera covers 1.000000000 m2\n"
    )


def test_the_library_exports_its_functions_and_nothing_else():
    table = ran("nm", "-D", "--defined-only", BUILD / "lib/librastercov.so").stdout
    names = {line.split()[-1] for line in table.splitlines()}
    header = (BUILD / "include/rastercov.h").read_text()
    assert names
    assert {name for name in names if not name.startswith("rc_") or name not in header} == set()
    lines = ran("objdump", "-p", BUILD / "lib/librastercov.so").stdout
    assert "librastercov.so.1\n" in lines
