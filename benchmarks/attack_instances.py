"""Readers with instances: files in which a part and the instances of its owner are repeated.

Each file of tests/support/repeated_parts.py is read at a size and at twice that size: the memory
and the seconds of the processor may not grow faster. Short files that ask for 2^n instances must
be refused in one line, in little time and memory.
"""

import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

from repeated_parts import CAMERAS, MESHES, exploding
from rows import Report

import rastercov as rc
from rastercov.base.errors import ResourceError
from rastercov.core.camera.conventions import Conventions
from rastercov.core.mesh import Mesh

SIZE = 4_000
"""Repetitions and instances of a whole campaign."""
MOST_GROWTH = 3.2
"""Of seconds and bytes where a file is doubled; 4 is quadratic."""
FREE_SECONDS, FREE_BYTES = 0.2, 1 << 22
"""Differences below these are noise."""
ANSWERS = Conventions(image_size=(640, 480), pixel_centre=0.5, lens_model="brown", pose_unit="m")


def read_cameras(path: Path) -> Any:
    return rc.read_views(path, conventions=ANSWERS)


def cost(read: Callable[[Path], Any], path: Path) -> tuple[float, int]:
    """Seconds of the processor, the least of two, and the peak of memory."""
    seconds = []
    for _ in range(2):
        start = time.process_time()
        read(path)
        seconds.append(time.process_time() - start)
    tracemalloc.start()
    read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return min(seconds), peak


def refused(path: Path) -> bool:
    """True if the budget refuses a mesh in one line."""
    try:
        Mesh.load(path)
    except ResourceError as error:
        return str(error).isprintable() and len(str(error)) < 600
    return False


def attack(report: Report, effort: float) -> None:
    """Files at a size and at twice the size."""
    size = max(100, round(SIZE * effort))
    cases = [(Mesh.load, *key, make) for key, make in MESHES.items()]
    cases += [(read_cameras, *key, make) for key, make in CAMERAS.items()]
    n_slow = n_large = 0
    with tempfile.TemporaryDirectory() as folder:
        for read, name, part, make in cases:
            path = Path(folder) / name
            # Elements of a chain are two nested calls, of which Python has a thousand or so.
            n = min(size, 200) if any(word in part for word in CHAINS) else size
            items = []
            for k in (1, 2):
                path.write_bytes(make(k * n))
                read(path)
                items.append(cost(read, path))
            (first, least), (second, most) = items
            is_slow = second > MOST_GROWTH * first + FREE_SECONDS
            is_large = most > MOST_GROWTH * least + FREE_BYTES
            n_slow, n_large = n_slow + is_slow, n_large + is_large
            if is_slow or is_large:
                print(f"{name}, {part}: {first:.2f} s, {second:.2f} s; {least}, {most} bytes")
        report.add("parts repeated, in files of all formats", len(cases), "files")
        report.add("... that take more than twice the time for twice the file", n_slow, "files")
        report.add("... that take more than twice the memory", n_large, "files", at_most=0)
        report.check("no part takes more memory than in proportion", not n_large)
        wrong = 0
        for k in (20, 40, 80, 160):
            for name, data in exploding(k).items():
                path = Path(folder) / name
                path.write_bytes(data)
                start = time.process_time()
                wrong += not refused(path)
                report.add(f"{name}: 2^{k} instances", time.process_time() - start, "s", at_most=5)
        report.check("2^n instances are refused in one line", not wrong)


CHAINS = ("2^n", "chain", "nested", "controllers")
