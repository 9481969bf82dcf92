"""Versions of packages that rastercov was tested with, and those that are installed here.

The newest are those of `data/constraints.txt`, which `make` and CI install; the oldest are what the
package asks for.
"""

import functools
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.resources import files

CONSTRAINTS = files("rastercov") / "data" / "constraints.txt"
OF_OTHERS = re.compile(
    rf"extra == .(dev|docs|bench|shapes).|; sys_platform == .(?!{sys.platform}\b)\w+.$"
)
"""Requirements that no user of this system has."""
REQUIREMENT = re.compile(r"([\w.-]+)[^;>]*(?:>=([\w.]+))?")


@functools.cache
def version_of(package: str) -> str | None:
    """Version of an installed package, read once: its file takes a millisecond; None without it."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def tested_versions() -> dict[str, str]:
    """Newest version that was tested of each package, by its name in lower case with hyphens."""
    lines = CONSTRAINTS.read_text(encoding="utf-8").splitlines()
    return dict(line.split("==") for line in lines if "==" in line)


def untested_versions() -> list[str]:
    """A line for each installed package that is newer or older than what was tested, by name.

    Packages that rastercov itself asks for, those of its extras included.
    """
    return sorted(_untested_names())


def _untested_names() -> Iterator[str]:
    newest = tested_versions()
    try:
        requirements = set(requires("rastercov") or ())
    except PackageNotFoundError:  # a folder that nothing installed, as in a zip or an add-on
        return
    for requirement in requirements:
        result = REQUIREMENT.match(requirement)
        if result is None or OF_OTHERS.search(requirement):
            continue
        name = re.sub("[-_.]+", "-", result[1]).lower()
        here = version_of(name)
        if here is None:  # of an extra
            continue
        if name in newest and _numbers(here) > _numbers(newest[name]):
            yield f"{name} {here} is newer than {newest[name]}, the newest that was tested"
        if result[2] and _numbers(here) < _numbers(result[2]):
            yield f"{name} {here} is older than {result[2]}, the oldest that rastercov supports"


def _numbers(text: str) -> tuple[int, ...]:
    """Numbers of a version, without zeros at the end: 2.1 is 2.1.0."""
    numbers = [int(each) for each in re.findall(r"\d+", text)]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)
