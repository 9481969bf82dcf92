"""Program that runs rastercov without what another system lacks, darwin or win32.

on_another_system.py SYSTEM FOLDER: imports every module, then measures, writes a report and places
cameras through the command line. Everything is imported once before that, so that libraries, which
choose their ways by the system, are there.
"""

import fcntl
import importlib
import os
import pkgutil
import platform
import signal
import sys
import types
from contextlib import suppress
from pathlib import Path

TEMPORARY = 1 << 30
PLAN = """
[[meshes]]
built_in = "box"
[camera]
width = 64
height = 64
hfov_deg = 60
[[candidates]]
generator = "on_sphere"
count = 8
[selection]
goal = "best_coverage"
cameras = 2
"""
ONLY_ON_LINUX = {os: "posix_fallocate sched_getaffinity sched_setaffinity memfd_create"}
NOT_ON_WINDOWS = {
    os: (
        "fork forkpty geteuid getuid getgid mkfifo pread pwrite uname sysconf statvfs wait waitid "
        "fchmod fchown getpgid setsid killpg O_CLOEXEC O_NONBLOCK O_NOCTTY O_DIRECTORY O_NOFOLLOW"
    ),
    signal: "SIGKILL SIGPIPE SIGHUP SIGALRM SIGUSR1 pthread_kill setitimer alarm sigwait",
}


def take_away(missing):
    for module, names in missing.items():
        for name in names.split():
            delattr(module, name)


def as_on_windows():
    """Locks of its own, folders that are not opened, files that are gone when they are closed."""
    posix_open, posix_close, flock = os.open, os.close, fcntl.flock
    exclusive, of_files = fcntl.LOCK_EX | fcntl.LOCK_NB, {}

    def opened(path, flags, *arguments, **options):
        if Path(path).is_dir():
            raise PermissionError(13, "Permission denied", os.fspath(path))
        descriptor = posix_open(path, flags & ~TEMPORARY, *arguments, **options)
        if flags & TEMPORARY:
            of_files[descriptor] = path
        return descriptor

    def closed(descriptor):
        posix_close(descriptor)
        if path := of_files.pop(descriptor, None):
            Path(path).unlink()

    def locking(descriptor, _mode, _n_bytes):
        flock(descriptor, exclusive)

    os.open, os.close, os.O_TEMPORARY, os.O_BINARY = opened, closed, TEMPORARY, 0
    sys.modules |= dict.fromkeys(("fcntl", "grp", "pwd", "resource", "termios"))
    sys.modules["msvcrt"] = types.SimpleNamespace(LK_NBLCK=2, locking=locking)
    take_away(NOT_ON_WINDOWS)


def import_all():
    import rastercov

    for walk_package in pkgutil.walk_packages(rastercov.__path__, "rastercov."):
        if not walk_package.name.endswith("__main__"):
            try:
                importlib.import_module(walk_package.name)
            except ModuleNotFoundError as error:
                is_optional = error.name not in sys.stdlib_module_names
                if not is_optional or walk_package.name.startswith(str(error.name)):
                    raise


def run(*words):
    from rastercov.cli import main

    sys.argv = ["rastercov", *words]
    with suppress(SystemExit):
        main()


def find_bits(folder):
    """Make a shard as a worker does, and bits of a matrix in a file that is reserved."""
    import rastercov as rc
    from rastercov.placement.matrix_folder import MatrixFolder
    from rastercov.shards.work import work

    mesh, camera = rc.shapes.by_name("box"), rc.Camera.from_fov(64, 64, hfov_deg=60)
    poses = rc.sphere_of_poses(mesh.bounds.mean(axis=0), distance=3.0, count=8)
    rc.placement.build_matrix((mesh, camera), poses, rc.Task(), folder)
    matrix = MatrixFolder.open(folder)
    work(matrix.store, 0)
    print("bits of", matrix.rows_and_areas(0.3, mesh.n_faces)[0].n_faces, "faces")


if __name__ == "__main__":
    system, folder = sys.argv[1], Path(sys.argv[2])
    platform.uname()
    import_all()
    for name in [name for name in sys.modules if name.split(".")[0] == "rastercov"]:
        if not name.startswith("rastercov.engine"):
            del sys.modules[name]
    take_away(ONLY_ON_LINUX)
    if system == "win32":
        as_on_windows()
    sys.platform = system
    import_all()
    drawn = sys.modules["rastercov.report.panorama"]
    drawn.WIDTH, drawn.HEIGHT = 120, 93  # pictures are beside the point
    run("demo", "--out", str(folder / "report"), "--shape", "box", "--device", "cpu")
    plan = folder / "plan.toml"
    plan.write_text(PLAN, encoding="utf-8")
    run("place", str(plan), "--out", str(folder / "placed"))
    find_bits(folder / "matrix")
