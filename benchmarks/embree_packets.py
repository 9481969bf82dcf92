"""Embree as its manual has it for primary rays: packets of coherent rays from compiled loops.

The wheel of embreex carries Embree's library; `embree_packets.cpp`, compiled here for this
processor by the compiler of our own loops, calls it. Each thread takes whole poses: it makes the
rays of a packet, casts them and counts its hits before the next packet. No array of rays or of
results is kept. `RASTERCOV_LEVEL=v2` or v3 keeps Embree to SSE 4.2 or AVX2, like our loops. A
packet has as many rays as Embree has lanes, 16, 8 or 4: with AVX2, 16 are two to five times slower.

Intel. Embree: High Performance Ray Tracing Kernels. 4.4, 2025: `rtcIntersect16`.
"""

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from importlib.metadata import files, version
from pathlib import Path

import numpy as np

ALL = 0xFFFFFFFF
ISA = {"v2": ",isa=sse4.2", "v3": ",isa=avx2"}
"""Embree's word for a level of processors."""
NATIVE = {16: 34, 8: 33, 4: 32}
"""Properties of a device: 1 where packets of this number of rays are native."""
# Values of enums in rtcore_common.h, rtcore_scene.h, rtcore_geometry.h and rtcore_buffer.h.
HIGH_QUALITY, COHERENT = 2, 1 << 16
TRIANGLES, INDICES, VERTICES, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003


class _IntersectArguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", ctypes.c_uint32),
        ("feature_mask", ctypes.c_uint32),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
        ("min_width_distance_factor", ctypes.c_float),
    )


def library() -> Path | None:
    """Embree's shared library in the wheel of embreex, None where the wheel has none."""
    items = [path for path in files("embreex") or () if path.name.startswith("libembree4")]
    return Path(str(items[0].locate())) if items else None


def _open_library() -> ctypes.CDLL:
    """The library, with the types of the functions that are used here."""
    path = library()
    if path is None:
        raise FileNotFoundError("this wheel of embreex has no library libembree4")
    embree = ctypes.CDLL(str(path))
    address = size = ctypes.c_size_t
    number = ctypes.c_uint32
    for name, result, *types in (
        ("rtcNewDevice", address, ctypes.c_char_p),
        ("rtcGetDeviceError", number, address),
        ("rtcGetDeviceProperty", ctypes.c_ssize_t, address, number),
        ("rtcNewScene", address, address),
        ("rtcSetSceneBuildQuality", None, address, number),
        ("rtcNewGeometry", address, address, number),
        ("rtcSetNewGeometryBuffer", address, address, number, number, number, size, size),
        ("rtcCommitGeometry", None, address),
        ("rtcAttachGeometry", number, address, address),
        ("rtcReleaseGeometry", None, address),
        ("rtcCommitScene", None, address),
    ):
        getattr(embree, name).restype = result
        getattr(embree, name).argtypes = types
    return embree


class EmbreePackets:
    """One scene of Embree, and packets of 16 rays that several threads cast into it."""

    def __init__(self, mesh, camera, poses, threads) -> None:
        self.poses, self.camera, self.n_faces = poses, camera, mesh.n_faces
        self.embree = _open_library()
        level = ISA.get(os.environ.get("RASTERCOV_LEVEL", ""), "")
        self.device = self.embree.rtcNewDevice(f"threads={threads}{level}".encode())
        # In float32, as Embree has them, but from the middle of the part, which loses nothing.
        self.centre = mesh.bounds.mean(axis=0)
        self.scene = self._build((mesh.vertices - self.centre).astype(np.float32), mesh.faces)
        self.arguments = _IntersectArguments(COHERENT, ALL)
        of_device = partial(self.embree.rtcGetDeviceProperty, self.device)
        self.rays = next(rays for rays, native in NATIVE.items() if of_device(native))
        self.intersect = getattr(self.embree, f"rtcIntersect{self.rays}")
        self.cast = _compiled(self.rays).cast
        self.pool = ThreadPoolExecutor(threads)
        self.of_thread = [np.zeros(self.n_faces, np.int32) for _ in range(threads)]
        number = of_device(0)  # 10000 major + 100 minor + patch
        dotted = f"{number // 10000}.{number // 100 % 100}.{number % 100}"
        self.about = f"Embree {dotted} of embreex {version('embreex')}, {self.rays} rays"

    def _build(self, vertices: np.ndarray, faces: np.ndarray) -> int:
        embree = self.embree
        geometry = embree.rtcNewGeometry(self.device, TRIANGLES)
        for kind, form, rows in (
            (VERTICES, FLOAT3, vertices),
            (INDICES, UINT3, np.ascontiguousarray(faces, np.uint32)),
        ):
            at = embree.rtcSetNewGeometryBuffer(geometry, kind, 0, form, 12, len(rows))
            ctypes.memmove(at, rows.ctypes.data, rows.nbytes)
        embree.rtcCommitGeometry(geometry)
        scene = embree.rtcNewScene(self.device)
        embree.rtcSetSceneBuildQuality(scene, HIGH_QUALITY)
        embree.rtcAttachGeometry(scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(scene)
        if error := embree.rtcGetDeviceError(self.device):
            raise RuntimeError(f"Embree cannot build the scene: its error {error}")
        return scene

    def _pose(self, row: int, counts: np.ndarray, image: np.ndarray | None = None) -> None:
        """Add the hits of a pose to `counts`, and write its faces to `image`."""
        camera = self.camera
        lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        pose = self.poses[row, :3].copy()
        pose[:, 3] -= self.centre
        arrays = (lens, pose, counts, image)
        self.cast(
            ctypes.cast(self.intersect, ctypes.c_void_p),
            ctypes.c_void_p(self.scene),
            ctypes.byref(self.arguments),
            *(camera.width, camera.height),
            *(None if rows is None else ctypes.c_void_p(rows.ctypes.data) for rows in arrays),
        )

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        left = iter(rows.tolist())

        def take(counts: np.ndarray, rows: Iterable[int]) -> None:
            for row in rows:  # shared by the threads: each takes the next
                counts.fill(0)
                self._pose(row, counts)

        for done in [self.pool.submit(take, counts, left) for counts in self.of_thread]:
            done.result()
        return 0.0

    def counts(self, row: int) -> np.ndarray:
        """(F,) hits of each face."""
        counts = np.zeros(self.n_faces, np.int32)
        self._pose(row, counts)
        return counts

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        image = np.empty((self.camera.height, self.camera.width), np.int32)
        self._pose(row, np.zeros(self.n_faces, np.int32), image)
        return image


@cache
def _compiled(rays: int) -> ctypes.CDLL:
    """The loop over the packets of a pose, compiled for this processor."""
    named = (os.environ.get("CXX", ""), "c++", "g++", "clang++")
    compiler = next(filter(None, map(shutil.which, named)), None)
    if compiler is None:
        raise FileNotFoundError("no compiler of C++: apt-get install g++, or set CXX")
    source = Path(__file__).with_suffix(".cpp")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "packets.so"
        options = (f"-DRAYS={rays}", "-std=c++20", "-O3", "-march=native", "-shared", "-fPIC")
        subprocess.run([compiler, *options, source, "-o", library], check=True)
        return ctypes.CDLL(str(library))  # stays open without its file
