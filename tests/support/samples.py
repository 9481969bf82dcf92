"""Applies samples of additions to a copy of the package, and runs their checks: samples.py ROOT.

One with `is_alone` has a copy and a process of its own, samples.py ROOT NAME.

The folder of a sample has `sample.toml`: `row`, the start of the row of CONTRIBUTING.md that it
follows; `[files]`, new files by their path; `[[edits]]`, texts that replace others. Its `check.py`
has `check(command, folder)`: `command` runs a line of the program and returns what it printed.
"""

import importlib.util
import io
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from contextlib import redirect_stdout
from pathlib import Path

SAMPLES = Path(__file__).parents[1] / "samples"


def names():
    """Names of all samples."""
    return sorted(each.parent.name for each in SAMPLES.glob("*/sample.toml"))


def entries_of(name):
    """Content of `sample.toml`."""
    return tomllib.loads((SAMPLES / name / "sample.toml").read_text(encoding="utf-8"))


def size_of(name):
    """Files that an addition touches beside its twin, and the lines that it adds."""
    entries = entries_of(name)
    paths = {*entries["files"], *(each["path"] for each in entries["edits"])}
    paths = {each for each in paths if not each.startswith("rastercov/reference/")}
    lines = [
        (SAMPLES / name / each).read_text(encoding="utf-8") for each in entries["files"].values()
    ]
    added = [
        each["new"].rstrip("\n").count("\n") - each["old"].rstrip("\n").count("\n") + 1
        for each in entries["edits"]
    ]
    return len(paths), sum(map(len, map(str.splitlines, lines))) + sum(added)


def copy(root, folder):
    """The package as links, which `add` replaces by files."""
    left_out = shutil.ignore_patterns("*.pyc")
    shutil.copytree(
        root / "rastercov", folder / "rastercov", copy_function=os.symlink, ignore=left_out
    )


def contents(folder):
    """Text or target of every file below a folder, by its path."""
    return {
        str(each.relative_to(folder)): str(each.readlink())
        if each.is_symlink()
        else each.read_bytes()
        for each in folder.rglob("*")
        if (each.is_symlink() or each.is_file()) and "__pycache__" not in each.parts
    }


def add(folder, name):
    """Apply a sample; a function that removes it again."""
    entries, before = entries_of(name), {}
    for path, source in entries["files"].items():
        assert not (folder / path).exists(), path
        before[folder / path] = None
        shutil.copy(SAMPLES / name / source, folder / path)
    for each in entries["edits"]:
        path = folder / each["path"]
        text = path.read_text(encoding="utf-8")
        assert text.count(each["old"]) == 1, (name, each["old"])
        if path not in before:
            before[path] = (path.is_symlink() and path.readlink(), text)
        path.unlink()
        path.write_text(text.replace(each["old"], each["new"]), encoding="utf-8")

    def remove():
        for path, own in before.items():
            path.unlink()
            if own is not None and own[0]:
                path.symlink_to(own[0])
            elif own is not None:
                path.write_text(own[1], encoding="utf-8")

    return remove


def command(line):
    """Output of a line of the program."""
    from rastercov import cli

    text = io.StringIO()
    with redirect_stdout(text):
        assert cli.command(shlex.split(line)) == 0, line
    return text.getvalue()


def main(root, own_name=""):
    """Apply samples in a copy, import it here, run the checks, remove the samples."""
    alone = [each for each in names() if entries_of(each).get("is_alone")]
    chosen = [own_name] if own_name else [each for each in names() if each not in alone]
    for each in alone if not own_name else ():
        subprocess.run([sys.executable, __file__, str(root), each], check=True)
    folder = Path(tempfile.mkdtemp(dir=Path.cwd()))
    copy(root, folder)
    before = contents(folder)
    removals = [add(folder, name) for name in chosen]
    sys.meta_path[:] = [each for each in sys.meta_path if "Editable" not in type(each).__name__]
    sys.meta_path[:] = [each for each in sys.meta_path if "Redirecting" not in type(each).__name__]
    sys.path.insert(0, str(folder))
    import rastercov

    assert Path(rastercov.__file__).is_relative_to(folder), rastercov.__file__
    for name in chosen:
        spec = importlib.util.spec_from_file_location(f"check_{name}", SAMPLES / name / "check.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        own = Path.cwd() / name
        own.mkdir()
        os.chdir(own)
        try:
            module.check(command, own)
        except BaseException as error:
            raise AssertionError(f"sample {name}") from error
        finally:
            os.chdir(own.parent)
        print(f"checked {name}", flush=True)
    for remove in reversed(removals):
        remove()
    assert contents(folder) == before


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
