"""Loops in C++, compiled for the level of this processor: `mesh_tree` and others.

`RASTERCOV_LEVEL`, v2, v3, v4 or generic, chooses another level, for tests. `RASTERCOV_MODULES`
names a folder with modules of another build, such as those with sanitizers. See docs/engine.md.
"""

import os
import sys
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType

LEVELS = ("v2", "v3", "v4")
"""Levels of x86-64, the lowest first."""
FOLDER = Path(os.environ.get("RASTERCOV_MODULES") or Path(__file__).parent)
"""Folder of the modules."""
REMEDY = "run `make native` in the clone, or install a wheel"


def built_modules() -> list[str]:
    """Levels whose modules are here, the lowest first."""
    return [level for level in (*LEVELS, "generic") if _file(f"_{level}")]


def runnable() -> tuple[str, ...]:
    """Levels that this processor has, the lowest first."""
    number = load("_cpu").level()
    return LEVELS[: number - 1] if number else ("generic",)


def load(name: str) -> ModuleType:
    """Extension module of this folder."""
    whole = f"{__name__}.{name}"
    if whole not in sys.modules:
        file = _file(name)
        if file is None:
            raise ImportError(
                f"expected rastercov's compiled module {FOLDER / name}, got no such file; {REMEDY}"
            )
        loader = ExtensionFileLoader(whole, str(file))
        module = module_from_spec(ModuleSpec(whole, loader, origin=str(file)))
        loader.exec_module(module)
        sys.modules[whole] = module
    return sys.modules[whole]


def _file(name: str) -> Path | None:
    files = (FOLDER / f"{name}{suffix}" for suffix in EXTENSION_SUFFIXES)
    return next((file for file in files if file.exists()), None)


def _choose() -> str:
    wanted, here = os.environ.get("RASTERCOV_LEVEL"), built_modules()
    can_run = [level for level in here if level in runnable()]
    if wanted and wanted not in can_run:
        raise ImportError(
            f"expected RASTERCOV_LEVEL to be one of {', '.join(can_run)}, which are built and "
            f"which this processor runs, got {wanted}"
        )
    if not can_run:
        raise ImportError(
            f"expected rastercov's compiled modules for {runnable()[-1]} in {FOLDER}, got none; "
            f"{REMEDY}"
        )
    return wanted or can_run[-1]


LEVEL = _choose()
"""The level at work."""
TOPICS = {
    name: part
    for name, part in vars(load(f"_{LEVEL}")).items()
    if isinstance(part, ModuleType) and not name.startswith("_")
}
"""Modules by name."""
for _name, _part in TOPICS.items():
    sys.modules[f"{__name__}.{_name}"] = globals()[_name] = _part
