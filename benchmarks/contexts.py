"""Memory that stays after an OpenGL context is opened and closed, by library.

Four programs, each in a process of its own: EGL or OSMesa alone, by ctypes; moderngl on top of
that; our contexts; our rasterisers, which draw. After a warm-up, resident memory and what malloc
has in use may not grow. What the first keeps is Mesa's, what the second keeps beyond it is
moderngl's, the rest is ours.
"""

import argparse
import ctypes
import gc
import json
import subprocess
import sys
from collections.abc import Callable

from rows import Report, arguments, resident_mib

WARM_UP = 60
MOST_KIB = 8.0
"""Resident memory that may stay of each of our contexts: a fifth of the 39 KiB that stay where the
entry points of OpenGL are loaded anew. 250 to 750 KiB of noise are shared by all rounds."""
VERSION, MINOR, PROFILE, CORE = 0x3098, 0x30FB, 0x30FD, 1
SURFACELESS, OPENGL_API, NONE = 0x31DD, 0x30A2, 0x3038
_POINTER, _UINT, _INT = ctypes.c_void_p, ctypes.c_uint, ctypes.c_int


class _Egl:
    """A context of surfaceless EGL, without any of our code; with glcontext's interface."""

    def __init__(self) -> None:
        egl = self.egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetProcAddress.restype = egl.eglCreateContext.restype = _POINTER
        egl.eglInitialize.argtypes = (_POINTER,) * 3
        egl.eglCreateContext.argtypes = egl.eglMakeCurrent.argtypes = (_POINTER,) * 4
        egl.eglDestroyContext.argtypes = (_POINTER,) * 2
        find = ctypes.CFUNCTYPE(_POINTER, _UINT, _POINTER, _POINTER)
        self.display = find(egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT"))(
            SURFACELESS, None, None
        )
        assert egl.eglInitialize(self.display, None, None)
        assert egl.eglBindAPI(OPENGL_API)
        wanted = (_INT * 7)(VERSION, 4, MINOR, 5, PROFILE, CORE, NONE)
        self.handle = egl.eglCreateContext(self.display, None, None, wanted)
        assert self.handle
        assert egl.eglMakeCurrent(self.display, None, None, self.handle)

    def load(self, name: str) -> int:
        return self.egl.eglGetProcAddress(name.encode()) or 0

    def release(self) -> None:
        if self.handle:
            self.egl.eglMakeCurrent(self.display, None, None, None)
            self.egl.eglDestroyContext(self.display, self.handle)
            self.handle = None

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


def egl_alone() -> None:
    _Egl().release()


def osmesa_alone() -> None:
    mesa = ctypes.CDLL("libOSMesa.so.8")
    mesa.OSMesaCreateContextAttribs.restype = _POINTER
    mesa.OSMesaCreateContextAttribs.argtypes = (_POINTER, _POINTER)
    mesa.OSMesaMakeCurrent.argtypes = (_POINTER, _POINTER, _UINT, _INT, _INT)
    mesa.OSMesaDestroyContext.argtypes = (_POINTER,)
    wanted = (_INT * 9)(0x22, 0x1908, 0x33, 0x34, 0x36, 4, 0x37, 5, 0)
    context = mesa.OSMesaCreateContextAttribs(wanted, None)
    image = ctypes.create_string_buffer(16 * 16 * 4)
    assert mesa.OSMesaMakeCurrent(context, image, 0x1401, 16, 16)
    mesa.OSMesaMakeCurrent(None, None, 0, 0, 0)
    mesa.OSMesaDestroyContext(context)


def moderngl_on_egl() -> None:
    import moderngl

    loader = _Egl()
    moderngl.create_context(context=loader, standalone=True).release()
    loader.release()


def our_context(device: str = "surfaceless") -> None:
    from rastercov.gl.context import open_context

    open_context(device).release()


def our_osmesa() -> None:
    our_context("osmesa")


def our_rasteriser() -> None:
    import rastercov as rc
    from rastercov.core.mesh import shapes

    mesh, camera = shapes.box(), rc.Camera(width=64, height=48, fx=50, fy=50)
    with rc.open_rasterizer(mesh, camera, "gl", device="surfaceless") as rasterizer:
        rasterizer.count(rc.look_at((3, 2, 1), (0, 0, 0)))


KINDS: dict[str, tuple[str, Callable[[], None]]] = {
    "egl": ("EGL alone", egl_alone),
    "osmesa": ("OSMesa alone", osmesa_alone),
    "moderngl": ("EGL and moderngl", moderngl_on_egl),
    "context": ("our context on EGL", our_context),
    "our-osmesa": ("our context on OSMesa", our_osmesa),
    "rasteriser": ("our rasteriser on EGL", our_rasteriser),
}
OURS = ("context", "our-osmesa", "rasteriser")


def growth(kind: str, rounds: int) -> dict[str, float]:
    """KiB that stay for each context opened and closed in this process."""
    once = KINDS[kind][1]
    for _ in range(WARM_UP):
        once()
    gc.collect()
    before = 1024 * resident_mib(), _in_use()
    for _ in range(rounds):
        once()
    gc.collect()
    after = 1024 * resident_mib(), _in_use()
    return {"resident": (after[0] - before[0]) / rounds, "malloc": (after[1] - before[1]) / rounds}


def growth_in_a_process(kind: str, rounds: int) -> dict[str, float] | str:
    """Result of `growth` in a process of its own, or the reason why it does not run."""
    command = [sys.executable, __file__, "--kind", kind, "--rounds", str(rounds)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        return (run.stderr.strip().splitlines() or ["no answer"])[-1]
    growth: dict[str, float] = json.loads(run.stdout.splitlines()[-1])
    return growth


class _Mallinfo(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks",
                     "uordblks", "fordblks", "keepcost")
    )  # fmt: skip


def _in_use() -> float:
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "mallinfo2"):  # glibc before 2.33, or none
        return 0.0
    libc.mallinfo2.restype = _Mallinfo
    info = libc.mallinfo2()
    return (info.uordblks + info.hblkhd) / 1024


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=300, help="contexts after the warm-up")
    parser.add_argument("--kind", choices=KINDS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.kind:
        print(json.dumps(growth(args.kind, args.rounds)))
        return
    report = Report()
    for kind, (what, _) in KINDS.items():
        result = growth_in_a_process(kind, args.rounds)
        if isinstance(result, str):
            print(f"{what} is left out: {result}", file=sys.stderr)
            continue
        must = MOST_KIB if kind in OURS else None
        report.add(f"{what}: resident memory a context", result["resident"], "KiB", at_most=must)
        report.add(f"{what}: memory of malloc a context", result["malloc"], "KiB")
        if must is not None:
            report.check(f"{what}: what stays is below {must:g} KiB", result["resident"] <= must)
    report.finish(args.json)


if __name__ == "__main__":
    main()
