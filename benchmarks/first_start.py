"""CPU time of the first `rastercov evaluate` after installation, which compiles its loops.

Counted are all processes of the command, those that compile beside it included. The second run of
the same command, which compiles nothing, is measured for comparison. Beside other programs a
hyperthread takes up to twice the CPU time.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rows import Report, arguments

ROOT = Path(__file__).resolve().parents[1]
CAMERA = "width = 1280\nheight = 1024\nfx = 1200\nfy = 1200\n"
MOST_CPU_SECONDS = 20.0
COMMAND = "from rastercov.cli import main; main()"


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=4)
    args = parser.parse_args()
    report = Report()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "camera.toml").write_text(CAMERA)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": f"{folder}/loops"}
        _write_mesh(place / "torus.off")
        words = ("evaluate", "torus.off", "--unit", "m", "--camera", "camera.toml")
        words += ("--poses", f"sphere:{args.poses}")
        for what, at_most in (("first", MOST_CPU_SECONDS), ("second", None)):
            started, before = time.perf_counter(), _cpu_seconds()
            command = [sys.executable, "-c", COMMAND, *words, "--out", what]
            subprocess.run(
                command, cwd=place, env=environment, check=True, stdout=subprocess.DEVNULL
            )
            spent, wall = _cpu_seconds() - before, time.perf_counter() - started
            report.add(f"{what} evaluation: CPU time of all processes", spent, "s", at_most=at_most)
            report.add(f"{what} evaluation: from start to end", wall, "s")
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        report.add("largest memory of one process", peak, "MiB")
    report.finish(args.json)


def _cpu_seconds() -> float:
    """CPU time of all processes that this one has started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _write_mesh(path: Path) -> None:
    from rastercov.mesh import shapes

    mesh = shapes.torus()
    lines = [f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [" ".join(map(repr, vertex)) for vertex in mesh.vertices.tolist()]
    lines += [" ".join(map(str, (3, *face))) for face in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
