"""Criteria judged on the device: bits, areas and views of poses, from the counters of a batch.

`judge.comp` judges a batch while the host takes the bits of the one before.
"""

import re
from collections.abc import Callable

import numpy as np

from rastercov.base import FloatArray
from rastercov.core.camera import Camera
from rastercov.core.raster.contract import CoverageBits, Criteria, Judged, area_units, no_bits
from rastercov.gl.compute import MAX_GROUPS, Compute, ComputePoses, ComputeScene
from rastercov.gl.resources import Resources, Staging, set_uniforms
from rastercov.shaders import source

OF_PINHOLES = ("min_pixel_density", "min_facing_density", "min_pixels_per_m2")
"""Thresholds that `judge.comp` does not know of parallel rays."""
GROUP_FACES, POSES_AHEAD = 64, 4096
"""Faces of a workgroup of `judge.comp`; poses that are prepared at a time."""
TOTALS = 3
"""Words of a pose behind its bits: area in 64 bits, samples counted."""
COUNTS, FACES, VERTICES, POSES, RESULTS, SEEN = range(6)  # bindings of judge.comp
FACE = np.dtype(
    [("normal", "3f8"), ("corners", "3u4"), ("kind", "u4"), ("area", "u8")]
)  # its struct `Face`


class Judging:
    """Buffers and program that judge the faces of a scene of the plan "compute"."""

    def __init__(self, resources: Resources, strategy: Compute, scene: ComputeScene) -> None:
        self._resources, self._strategy, self._scene = resources, strategy, scene
        mesh, camera, buffer = scene.mesh, scene.camera, resources.buffer
        self._program, layers = resources.compute("judge"), strategy.most_poses
        self._groups = -(-mesh.n_faces // GROUP_FACES)
        self._n_words = GROUP_FACES // 32 * self._groups
        record = np.zeros(mesh.n_faces, FACE)
        record["normal"], record["corners"] = mesh.normals, mesh.faces
        self._record = record
        self._criteria: Criteria | None = None
        self._faces = buffer("faces to judge", record)
        self._vertices = buffer("vertices to judge", mesh.vertices)
        self._results = buffer("bits of faces", size=4 * (self._n_words + TOTALS) * layers)
        self._seen = buffer("views of faces", size=4 * mesh.n_faces)
        set_uniforms(
            self._program,
            focal=(camera.fx, camera.fy),
            centre=(camera.cx, camera.cy),
            size=(camera.width, camera.height),
            is_parallel=camera.is_parallel,
            n_faces=mesh.n_faces,
            n_groups=self._groups,
            scale=float(scene.grid.supersample**2),
        )

    def judge(self, poses: FloatArray, criteria: Criteria, note: Callable[[int], None]) -> Judged:
        """Pairs of all poses; `note` takes the number of some of them, when these are drawn."""
        n_poses, n_faces = len(poses), self._scene.mesh.n_faces
        result = no_bits(self._scene.mesh, n_poses)
        clipped = np.empty(n_poses, bool)
        self._take_criteria(criteria)
        self._resources.zero(self._seen, 4 * n_faces)
        waiting: list[tuple[Staging, slice]] = []
        for first in range(0, n_poses, POSES_AHEAD):
            some = poses[first : first + POSES_AHEAD]
            prepared = self._strategy.prepare(self._scene, some, self._scene.grid)
            clipped[first : first + len(some)] = prepared.clipped
            for rows in self._strategy.batches(len(some)):
                bits = self._start(prepared, rows)
                waiting.append((bits, slice(first + rows.start, first + rows.stop)))
                if len(waiting) > 1:
                    self._finish(*waiting.pop(0), result)
                self._resources.poll("judging")
            note(len(some))
        for each in waiting:
            self._finish(*each, result)
        result.views[:] = self._resources.read_words(self._seen, n_faces)
        return result, clipped

    def _take_criteria(self, criteria: Criteria) -> None:
        if criteria is self._criteria:
            return
        mesh = self._scene.mesh
        self._record["kind"] = criteria.may_be_covered + 2 * mesh.two_sided_mask.astype(np.uint32)
        self._record["area"] = area_units(mesh)
        self._resources.write(self._faces, self._record.view(np.uint8))
        set_uniforms(self._program, **criteria.rules)
        self._criteria = criteria

    def _start(self, prepared: ComputePoses, rows: slice) -> Staging:
        """Count and judge a batch; the buffer that will have its bits."""
        scene, strategy, resources = self._scene, self._strategy, self._resources
        n_poses, n_faces = rows.stop - rows.start, scene.mesh.n_faces
        strategy.begin(prepared, rows)
        tiles = scene.grid.tiles(strategy.tile)
        strategy.fill_counters(scene, n_poses, tiles, drawn=True, backs=False)
        size = 4 * n_poses * (self._n_words + TOTALS)
        resources.zero(self._results, size)
        buffers = {
            COUNTS: strategy.counters,
            FACES: self._faces,
            VERTICES: self._vertices,
            POSES: strategy.records,
            RESULTS: self._results,
            SEEN: self._seen,
        }
        for binding, buffer in buffers.items():
            buffer.bind_to_storage_buffer(binding)
        set_uniforms(self._program, first_drawn=n_poses * (n_faces + 1))
        across = min(self._groups, MAX_GROUPS)
        self._program.run(across, -(-self._groups // across), n_poses)
        return resources.ask(self._results, size, "results")

    def _finish(self, bits: Staging, rows: slice, result: CoverageBits) -> None:
        """Take the results of a batch."""
        n_words = self._n_words
        size = 4 * (rows.stop - rows.start) * (n_words + TOTALS)
        words = bits.take(size).view(np.uint32).reshape(-1, n_words + TOTALS)
        counted, n_samples = words[:, -1], self._scene.grid.n_samples
        if (counted != n_samples).any():
            wrong = counted[counted != n_samples][0]
            raise self._resources.distrust(f"counted {wrong} samples of {n_samples}")
        result.packed[rows] = words.view(np.uint8)[:, : result.packed.shape[1]]
        result.area_units[rows] = np.ascontiguousarray(words[:, n_words:-1]).view(np.int64)[:, 0]


def why_no_shader(camera: Camera, criteria: Criteria) -> str:
    """Reason why a device judges no faces by some criteria, or "".

    `judge.comp` is the registry of thresholds: with one that it does not name, and that is not 0,
    faces are judged on the host.
    """
    known, asked = source("judge.comp"), [name for name, value in criteria.rules.items() if value]
    left = [name for name in asked if not re.search(rf"\b{name}\b", known)]
    left += [name for name in asked if camera.is_parallel and name in OF_PINHOLES]
    return f"no shader judges {', '.join(left)} for this camera" if left else ""
