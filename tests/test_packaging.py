"""The wheel holds the package, all of it and nothing else, and works from where it was put."""

import hashlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import warnings
import zipfile
from importlib import metadata
from pathlib import Path, PurePosixPath

import nanobind
import pytest
import yaml
from cyclonedx.schema import SchemaVersion
from nightly import IS_NIGHTLY
from packaging.requirements import Requirement
from processes import python

import rastercov
from rastercov import engine

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LINKED = {"rastercov/reference": "reference", "rastercov/shaders": "shaders"}
"""Folders that stand at the top level of the tree, and inside the package of the wheel."""


ENTRY = """import sys
sys.path.insert(0, {!r})
sys.meta_path[:] = [each for each in sys.meta_path if "ditable" not in repr(each)]
from rastercov.cli import main
main()"""
"""Program that runs a command of a wheel that was unzipped, and not that of this tree."""
RIG = """{"cameras": [{"name": "a", "width": 64, "height": 48, "fx": 60.0}],
"world_from_camera": [[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 3], [0, 0, 0, 1]]]}"""
LEFT = {
    *("rastercov/engine/_old.abi3.so", "rastercov/engine/_v1.cp311-win_amd64.pyd"),
    *("rastercov/engine/mesh_tree.pyi", "rastercov/base/__pycache__/files.cpython-311.pyc"),
    *("reference/__pycache__/lenses.cpython-311.pyc", "rastercov/old.pyc"),
}
"""What builds and runs leave in a checkout."""
OF_PAGES = {f"rastercov/page/web/{name}.wasm": b"\0asm" for name in ("engine", "lens", "readers")}
"""Compiled modules of pages, and what stands for those that are not there."""


def command(*words, cwd):
    result = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def tracked():
    """Files of the tree, those not yet committed too; not what git ignores."""
    words = ["git", "-c", "safe.directory=*"]  # a CI job's clone may belong to another user
    words += ["ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = command(*words, cwd=ROOT).split("\0")
    return sorted(name for name in names if name and (ROOT / name).exists())


def expected():
    """Names that the wheel must hold beside its dist-info."""
    inside = {link: target for target, link in LINKED.items()}
    names = set(OF_PAGES)
    for name in tracked():
        top, *rest = PurePosixPath(name).parts
        packed = "/".join((inside.get(top, top), *rest))
        is_data = packed.startswith("rastercov/data/") or packed == "rastercov/py.typed"
        is_code = packed.startswith("rastercov/") and name.endswith(
            (".py", ".glsl", ".html", ".svg", ".js", ".css")
        )
        if (is_data or is_code) and not (ROOT / name).is_symlink():
            names.add(packed)
    return names


def copied(copy):
    """The tree in another folder: nothing that an earlier build left in it."""
    if not (ROOT / ".git").exists():
        pytest.skip("git says what belongs to the tree, and this is no clone")
    for name in tracked():
        target = copy / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_symlink():
            target.symlink_to((ROOT / name).readlink())
        else:
            target.write_bytes((ROOT / name).read_bytes())
    for name in OF_PAGES:
        (copy / name).write_bytes(of_page(name))
    for name in LEFT:
        (copy / name).parent.mkdir(exist_ok=True)
        (copy / name).write_bytes(b"x")
    return copy


def of_page(name):
    """Bytes of a module of pages in the copy of the tree."""
    path = ROOT / name
    return path.read_bytes() if path.exists() else OF_PAGES[name]


def build(tree, out):
    """Put the wheel and the sdist into a folder, by the tools that are here; loops of one level.

    At night the loops are compiled from the sdist, else the wheel takes those of this tree.
    """
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(tree)]
    build.append("-Ccmake.define.RASTERCOV_LEVELS=own")
    if not IS_NIGHTLY:
        build.append(f"-Ccmake.define.RASTERCOV_BUILT={engine.FOLDER}")
    command(*build, cwd=out)  # the wheel is built from the sdist


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel and the sdist."""
    out = tmp_path_factory.mktemp("dist")
    build(copied(tmp_path_factory.mktemp("tree")), out)
    return out


@pytest.fixture(scope="module")
def unzipped(built, tmp_path_factory):
    """The wheel as pip would put it on sys.path."""
    (wheel,) = built.glob("*.whl")
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_the_links_to_the_top_level_are_relative():
    for link, target in LINKED.items():
        assert (ROOT / link).readlink() == Path("..") / target
        assert (ROOT / target / "__init__.py").is_file()


def test_every_folder_of_code_is_a_package():
    items = {str(PurePosixPath(n).parent) for n in expected() if n.endswith("__init__.py")}
    code = {str(PurePosixPath(n).parent) for n in expected() if n.endswith((".py", ".glsl"))}
    assert code == items


@pytest.mark.slow
def test_the_wheel_holds_the_package_and_nothing_else(unzipped):
    names = {name for name in files(unzipped) if ".dist-info/" not in name}
    modules = {name for name in names if name.endswith(".so")}
    names -= modules
    assert names == expected()
    own = f"_{engine.runnable()[-1]}"
    assert {Path(name).name.split(".")[0] for name in modules} == {"_cpu", own}
    assert {"rastercov/shaders/face.vert.glsl", "rastercov/reference/__init__.py"} <= names
    for name in names:
        wanted = of_page(name) if name in OF_PAGES else (ROOT / name).read_bytes()
        assert (unzipped / name).read_bytes() == wanted


@pytest.mark.slow
def test_pages_of_a_wheel_compute_or_it_says_why(unzipped, tmp_path):
    """With the modules, and without them, as where somebody deleted them."""
    asked = {
        "playground --no-browser --out play.html": 2,
        "evaluate box -c khepra -p sphere:2 --out report": 0,
        "audit rig.json box --out audited": 0,
        "view box -c khepra -p sphere:2 --export page.html": 0,
    }
    for has_modules in (True, False):
        folder = tmp_path / str(has_modules)
        folder.mkdir()
        (folder / "rig.json").write_text(RIG)
        left_out = () if has_modules else ("*.wasm",)
        wheel = shutil.copytree(unzipped, folder / "site", ignore=shutil.ignore_patterns(*left_out))
        words = ["-I", "-c", ENTRY.format(str(wheel))]
        for line, code in asked.items():
            done = python(*words, *line.split(), cwd=folder)
            assert done.returncode == (0 if has_modules else code), done.stderr
            assert ("no engine in this installation" in done.stderr) != has_modules, line
        pages = [folder / "report" / "view.html", folder / "page.html"]
        for page in pages if has_modules else pages[1:]:
            text = page.read_text(encoding="utf-8")
            assert ("no engine in this installation" in text) != has_modules
            assert ('id="live"' in text) == has_modules


@pytest.mark.slow
def test_the_sdist_holds_all_that_the_loops_are_compiled_from(built):
    (sdist,) = built.glob("*.tar.gz")
    sources = {name for name in tracked() if name.startswith("rastercov/engine/")}
    with tarfile.open(sdist) as archive:
        items = {name.partition("/")[2] for name in archive.getnames()}
    assert sources | OF_PAGES.keys() <= items
    assert not {name for name in items if name.endswith((".so", ".pyd", ".pyi", ".pyc"))}
    assert not {name for name in items if name.startswith("tests")}  # all of them, or none


@pytest.mark.slow
def test_two_folders_give_the_same_bytes(built, tmp_path):
    tree = copied(tmp_path / "another" / "tree")
    for path in tree.rglob("*.py"):
        path.chmod(0o600)
        os.utime(path, (1.6e9, 1.6e9))
    again = tmp_path / "dist"
    again.mkdir()
    build(tree, again)
    assert {path.name for path in again.iterdir()} == {path.name for path in built.iterdir()}
    for path in again.iterdir():
        assert path.read_bytes() == (built / path.name).read_bytes(), path.name


@pytest.mark.slow
def test_the_bill_of_materials_names_what_is_compiled_into_the_loops(unzipped):
    from cyclonedx.validation.json import JsonStrictValidator  # it makes forty grammars

    (file,) = unzipped.glob("*.dist-info/sboms/*")
    text = file.read_text(encoding="utf-8")
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    assert bill["metadata"]["component"]["version"] == rastercov.__version__
    libraries = [part for part in bill["components"] if part["type"] == "library"]
    files = {part["name"]: part["hashes"] for part in bill["components"] if part["type"] == "file"}
    assert {name: each["content"] for name, (each,) in files.items()} == {
        name: hashlib.sha256(of_page(name)).hexdigest() for name in OF_PAGES
    }
    versions = {part["name"]: part["version"] for part in libraries}
    assert all(part["purl"].endswith(f"@{part['version']}") for part in libraries)
    assert versions["nanobind"] == metadata.version("nanobind")
    header = "ext/robin_map/include/tsl/robin_growth_policy.h"
    source = (Path(nanobind.__file__).parent / header).read_text(encoding="utf-8")
    numbers = re.findall(r"TSL_RH_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", source)
    assert versions["robin-map"] == ".".join(numbers)


def test_the_version_is_that_of_the_project_wherever_it_is_written():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\d\S+)", changes, re.MULTILINE)[1]
    install, sheet = (
        (ROOT / "docs" / name).read_text(encoding="utf-8")
        for name in ("install.md", "plan_sheet.svg")
    )
    wheel = re.search(r"rastercov-([^-\s]+)-cp", install)[1]
    drawn = re.search(r">rastercov ([^<]+)<", sheet)[1]
    written = {citation["version"], newest, wheel, drawn, metadata.version("rastercov")}
    assert written == {rastercov.__version__}


def test_it_says_its_version_and_answers_without_its_metadata():
    """As in a zip, an add-on of Blender or what PyInstaller packs: a folder on the path."""
    code = """
import importlib.metadata as m
def absent(name):
    if name == "rastercov":
        raise m.PackageNotFoundError(name)
    return found(name)
found, m.Distribution.from_name = m.Distribution.from_name, absent
import rastercov as rc
from rastercov.base.versions import untested_versions
print(rc.__version__, *untested_versions())
poses = rc.sphere_of_poses((0, 0, 0), 4, 3)
rc.evaluate(rc.shapes.box(), rc.Camera.load("khepra"), poses, rc.Task())
"""
    assert python("-c", code).stdout.split() == [rastercov.__version__]


WHEELS_OF_MODERNGL = {
    ("linux", "x86_64"): True,
    ("linux", "aarch64"): False,
    ("win32", "AMD64"): True,
    ("win32", "ARM64"): False,
    ("darwin", "arm64"): True,
    ("darwin", "x86_64"): False,
}
"""Systems and processors, by those for which its release 5.13 has wheels of each Python."""


@pytest.mark.parametrize(("place", "has_wheel"), WHEELS_OF_MODERNGL.items())
def test_pip_asks_for_moderngl_only_where_it_need_not_compile_it(place, has_wheel):
    system = dict(zip(("sys_platform", "platform_machine"), place, strict=True))
    asked = [Requirement(line) for line in PROJECT["dependencies"]]
    taken = {each.name for each in asked if each.marker is None or each.marker.evaluate(system)}
    assert ("moderngl" in taken) == has_wheel
    assert taken | {"moderngl"} == {each.name for each in asked}


@pytest.mark.slow
def test_the_wheel_asks_only_for_the_stable_interface_of_python(unzipped):
    """A module tagged with one version of Python would not be found by a later one."""
    (info,) = unzipped.glob("*.dist-info")
    if "-abi3-" in (info / "WHEEL").read_text():
        assert all(name.endswith(".abi3.so") for name in files(unzipped) if name.endswith(".so"))


def test_wheels_have_the_loops_of_all_levels():
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]
    wheels = [each for each in table["overrides"] if each["if"].get("state") == "wheel"]
    assert [each["cmake"]["define"]["RASTERCOV_LEVELS"] for each in wheels] == ["all"]
    build = (ROOT / "rastercov" / "engine" / "flags.cmake").read_text()
    assert f"set(KNOWN {' '.join(engine.LEVELS)})" in build


SCRIPT = """
import sys
from pathlib import Path
folder = Path(sys.argv[1])
sys.path = [str(folder), *(p for p in sys.path if p != sys.argv[2])]
sys.meta_path = [f for f in sys.meta_path if "editable" not in repr(f)]
import rastercov
import rastercov.reference
from rastercov import shaders, shapes
from rastercov import cli
for module in (rastercov, rastercov.reference, shaders):
    assert Path(module.__file__).is_relative_to(folder), module.__file__
assert "void main" in shaders.source("face.vert")
assert shapes.teapot().n_faces > 1000
assert shapes.aeroplane().n_faces == 1970
import rastercov.report.coverage, rastercov.report.placement, rastercov.page.server
words = "render teapot-5 -c khepra -p sphere:2 --device surfaceless".split()
sys.exit(cli.command([*words, "--out", sys.argv[3]]))
"""


@pytest.mark.slow
def test_the_wheel_works_from_another_folder(unzipped, tmp_path):
    out = tmp_path / "report"
    words = (sys.executable, "-I", "-W", "error", "-c", SCRIPT, str(unzipped), str(ROOT), str(out))
    assert "depth.png" in command(*words, cwd=tmp_path)
    assert (out / "depth.png").is_file()


def test_neither_folder_is_a_package_of_its_own(tmp_path):
    script = "import importlib.util as u, sys; sys.exit(any(map(u.find_spec, sys.argv[1:])))"
    # -I leaves out PYTHONPATH.
    assert python("-I", "-c", script, "reference", "shaders", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    "module", ["rastercov.core.mesh", "test_packaging", "mesh_files", "attack"]
)
def test_a_warning_in_a_file_of_ours_is_an_error(module):
    with pytest.raises(DeprecationWarning):
        warnings.warn_explicit("old", DeprecationWarning, "file.py", 1, module=module)


@pytest.mark.slow
def test_the_wheel_names_its_command_and_licence(unzipped):
    (info,) = unzipped.glob("*.dist-info")
    assert "rastercov = rastercov.cli:main" in (info / "entry_points.txt").read_text()
    for name in PROJECT["license-files"]:
        assert (info / "licenses" / name).read_bytes() == (ROOT / name).read_bytes()
    text = (info / "METADATA").read_text(encoding="utf-8")
    assert "\nLicense-Expression: MIT\n" in text


def test_what_a_wheel_fits_is_said_by_its_tags():
    fits = runpy.run_path(str(ROOT / ".ci" / "fits"))["fits"]
    own = fits("rastercov-1.0-cp311-cp311-manylinux_2_28_x86_64.whl")
    assert "for Python 3.11 alone" in own
    stable = fits("rastercov-1.0-cp312-abi3-manylinux_2_28_aarch64.whl")
    assert stable.endswith("for Python 3.12 and later, manylinux_2_28_aarch64")


def test_a_wheel_that_is_compiled_for_another_glibc_names_its_abi():
    tags = runpy.run_path(str(ROOT / ".ci" / "fits"))["tags"]
    assert tags((3, 11)) == "cp311-cp311"
    assert {tags((3, minor)) for minor in (12, 13, 14)} == {"cp312-abi3"}
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert settings["tool"]["scikit-build"]["wheel"]["py-api"] == "cp312"


@pytest.mark.slow
def test_a_wheel_of_one_python_has_its_tag_alone(built):
    (wheel,) = built.glob("*.whl")
    python, abi = wheel.name.split("-")[2:4]
    own = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    assert (python, abi) == ((own, own) if sys.version_info < (3, 12) else ("cp312", "abi3"))
