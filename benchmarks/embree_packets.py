"""Embree as its manual has it for primary rays: packets of 16 coherent rays from compiled loops.

A packet is a block of 4 x 4 pixels, with a ray through each pixel centre. The wheel of embreex
carries Embree's library; numba's loops call it by ctypes' function pointers, so no compiler is
needed. Each thread takes whole poses: it makes the rays of a packet, casts them and counts its
hits before the next packet. No array of rays or of results is kept.

Intel. Embree: High Performance Ray Tracing Kernels. 4.4, 2025: `rtcIntersect16`.
"""

import ctypes
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import files, version
from pathlib import Path

import numba
import numpy as np

SIDE, LANES = 4, 16
# Rows of RTCRayHit16, each with 16 numbers of 32 bits.
ORIGIN, NEAR, DIRECTION, TIME, FAR, MASK, PRIMITIVE, GEOMETRY = 0, 3, 4, 7, 8, 9, 17, 18
N_ROWS = 36  # 19, and two of instances per level; builds of Embree have 1 to 8 levels
NO_GEOMETRY = ALL = np.uint32(0xFFFFFFFF)
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
    found = [path for path in files("embreex") or () if path.name.startswith("libembree4")]
    return Path(str(found[0].locate())) if found else None


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
        ("rtcIntersect16", None, address, address, address, address),
    ):
        getattr(embree, name).restype = result
        getattr(embree, name).argtypes = types
    return embree


class EmbreePackets:
    """One scene of Embree, and packets of 16 rays that several threads cast into it."""

    def __init__(self, mesh, camera, poses, threads) -> None:
        self.poses, self.camera, self.n_faces = poses, camera, mesh.n_faces
        self.embree = _open_library()
        self.device = self.embree.rtcNewDevice(f"threads={threads}".encode())
        # In float32, as Embree has them, but from the middle of the part, which loses nothing.
        self.centre = mesh.bounds.mean(axis=0)
        self.scene = self._build((mesh.vertices - self.centre).astype(np.float32), mesh.faces)
        self.arguments = _IntersectArguments(COHERENT, ALL)
        self.cast = _compiled(self.embree.rtcIntersect16)
        self.pool = ThreadPoolExecutor(threads)
        self.of_thread = [np.zeros(self.n_faces, np.int32) for _ in range(threads)]
        number = self.embree.rtcGetDeviceProperty(self.device, 0)  # 10000 major + 100 minor + patch
        dotted = f"{number // 10000}.{number // 100 % 100}.{number % 100}"
        self.about = f"Embree {dotted} of embreex {version('embreex')}"
        self.counts(0)  # compiles

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

    def _pose(self, row: int, counts: np.ndarray, image: np.ndarray) -> None:
        """Add the hits of a pose to `counts`, and write its faces to `image` if it has pixels."""
        camera = self.camera
        lens = camera.fx, camera.fy, camera.cx, camera.cy
        pose = self.poses[row, :3].copy()
        pose[:, 3] -= self.centre
        at = ctypes.addressof(self.arguments)
        self.cast(self.scene, at, camera.width, camera.height, lens, pose, counts, image)

    def count(self, rows: np.ndarray) -> float:
        """As `Runner.count`."""
        left = iter(rows.tolist())

        def take(counts: np.ndarray, rows: Iterable[int]) -> None:
            for row in rows:  # shared by the threads: each takes the next
                counts.fill(0)
                self._pose(row, counts, NO_IMAGE)

        for done in [self.pool.submit(take, counts, left) for counts in self.of_thread]:
            done.result()
        return 0.0

    def counts(self, row: int) -> np.ndarray:
        """(F,) hits of each face."""
        counts = np.zeros(self.n_faces, np.int32)
        self._pose(row, counts, NO_IMAGE)
        return counts

    def faces(self, row: int) -> np.ndarray:
        """As `Runner.faces`."""
        image = np.empty((self.camera.height, self.camera.width), np.int32)
        self._pose(row, np.zeros(self.n_faces, np.int32), image)
        return image


NO_IMAGE = np.empty((0, 0), np.int32)


def _compiled(intersect):
    """The loop over the packets of a pose, about this function pointer."""

    @numba.njit(nogil=True)
    def cast(scene, arguments, width, height, lens, pose, counts, image):
        fx, fy, cx, cy = lens
        memory = np.zeros((N_ROWS + 2) * LANES, np.uint32)  # Embree wants 64-byte alignment
        skip = -(memory.ctypes.data // 4) % LANES
        numbers = memory[skip : skip + N_ROWS * LANES].reshape(N_ROWS, LANES)
        valid = memory[skip + N_ROWS * LANES :][:LANES]
        rays = numbers.view(np.float32)
        for k in range(3):
            rays[ORIGIN + k] = pose[k, 3]
        numbers[MASK] = ALL
        steps = np.empty((3, LANES), np.float32)
        for k, lane in np.ndindex(3, LANES):
            steps[k, lane] = pose[k, 0] * (lane % SIDE) / fx + pose[k, 1] * (lane // SIDE) / fy
        packet, mask = numbers.ctypes.data, valid.ctypes.data
        across, down = -(-width // SIDE), -(-height // SIDE)
        for block in range(across * down):
            left, top = block % across * SIDE, block // across * SIDE
            x, y = (left + 0.5 - cx) / fx, (top + 0.5 - cy) / fy
            for k in range(3):
                corner = np.float32(pose[k, 0] * x + pose[k, 1] * y + pose[k, 2])
                for lane in range(LANES):
                    rays[DIRECTION + k, lane] = corner + steps[k, lane]
            rays[FAR] = np.inf
            numbers[GEOMETRY] = NO_GEOMETRY
            columns, rows = np.int32(width - left), np.int32(height - top)
            for lane in range(LANES):
                inside = np.int32(lane % SIDE) < columns and np.int32(lane // SIDE) < rows
                valid[lane] = ALL if inside else 0
            intersect(mask, scene, packet, arguments)
            for lane in range(LANES):
                face = -1
                if numbers[GEOMETRY, lane] != NO_GEOMETRY:
                    face = np.int64(numbers[PRIMITIVE, lane])
                    counts[face] += 1
                if image.size and valid[lane]:
                    image[top + lane // SIDE, left + lane % SIDE] = face

    return cast
