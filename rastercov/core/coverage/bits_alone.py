"""Poses that an observer judges where it counts: bits of pairs alone, and what follows of them."""

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rastercov.base import DeviceError, ReadByName, ResourceError
from rastercov.core.camera import Cameras, Poses, cameras_of, eyes_of, is_joint
from rastercov.core.coverage.coverage import Coverage, batch_size
from rastercov.core.coverage.face_pass import ROW_TYPES, FacePass
from rastercov.core.coverage.judging import JudgedPoses
from rastercov.core.coverage.network import Network
from rastercov.core.coverage.observer import Observer, SampledObserver
from rastercov.core.coverage.task import Engine, Task
from rastercov.core.mesh import Mesh
from rastercov.core.raster import drawer

LOG = logging.getLogger("rastercov")
MOST_JUDGED, BYTES_JUDGED, SECONDS_JUDGED = 1 << 14, 64 << 20, 0.2
"""Most poses that are judged at a time, and the memory and time of these."""
BITS_OF_TARGET = 128
"""Memory of a target in a pose while it is judged, bits: two counts."""
LEAST_PAIRS = 1 << 26
"""Pairs of pose and face from which on a GPU is tested: an estimate, for none was at hand.

A self-test takes a second or two; the CPU judges these pairs meanwhile, at 12 ns a pair and core on
images of 256 x 256. `benchmarks/gpu.py` measures the border where there is a GPU."""
NO_ROWS = {name: np.empty(0, kind) for name, kind in ROW_TYPES.items()}
LATER = (
    *("best", "best_pose", "reason", "alone", "covered_faces", "mean_coverage", "kinds"),
    *("largest_bound", "largest_covered_bound"),
)
"""Figures of a `Network` that bits of pairs do not have."""


def engine_for(engine: Engine, mesh: Mesh, camera: Cameras, task: Task, n_poses: int) -> Engine:
    """Engine for poses of which bits alone are wanted: on a GPU, where "auto" is of use for many.

    The GPU has passed its self-test, in a process of its own.
    """
    is_open = engine.method == "sampled" and engine.device == "auto"
    is_large = n_poses * mesh.n_faces >= LEAST_PAIRS
    has_lens = any(each.is_curved for each in cameras_of(camera))
    is_judged = not (mesh.has_targets or has_lens or _needs_rows(camera, task))
    label = drawer().find_gpu() if is_open and is_large and is_judged else ""
    if not label:
        return engine
    LOG.warning("device auto is %s, for %s poses", label, f"{n_poses:,}")
    return replace(engine, device=label)


def _needs_rows(camera: Cameras, task: Task) -> bool:
    """True where pairs need more than bits tell."""
    return is_joint(camera) or task.min_angle_deg > 0


def can_judge(observer: Observer, poses: Poses, task: Task) -> bool:
    """True where the observer judges what it counts; a device that does not is named."""
    if not isinstance(observer, SampledObserver) or _needs_rows(observer.camera, task):
        return False
    criteria = FacePass(observer.mesh, observer.camera, 1, task).criteria()
    why = observer.why_not_judged(poses, criteria)
    if why and observer.info.backend == "gl":
        LOG.warning("the CPU judges what the device counts: %s", why)
    return not why


class NetworkOfBits(Network):
    """Network of poses that are judged where they are counted: views, from their bits.

    Its other figures are those that `measure` gives, called when one of them is first read.
    """

    def __init__(self, mesh: Mesh, task: Task, measure: Callable[[], Network] | None) -> None:
        super().__init__(mesh, task)
        self._measure = measure
        for name in LATER:
            delattr(self, name)

    def _judge(self, observer: Observer, poses: Poses, kept: ReadByName) -> Iterator[JudgedPoses]:
        """Bits of poses: more at a time, while it is quick, and fewer where memory is short.

        In place of a device that fails, the CPU counts the rest.
        """
        assert isinstance(observer, SampledObserver)
        n_faces = self.mesh.n_faces
        criteria = FacePass(self.mesh, observer.camera, observer.threads, self.task).criteria()
        n_bits = n_faces + BITS_OF_TARGET * int(self.mesh.target_mask.sum())
        most = max(1, min(MOST_JUDGED, 8 * BYTES_JUDGED // n_bits))
        step, at = min(most, batch_size(n_faces, observer.threads)), 0
        while at < max(1, len(poses)):
            batch, began = poses[at : at + step], time.perf_counter()
            try:
                bits, clipped = observer.judge(batch, criteria)
            except ResourceError:
                if step == 1:
                    raise
                step //= 2
                continue
            except DeviceError as error:
                if observer.info.backend != "gl":
                    raise
                observer.fall_back()
                LOG.warning("the CPU continues in place of a device: %s", error)
                yield from super()._judge(observer, poses[at:], {**kept, "bits": True})
                return
            is_quick = time.perf_counter() - began < SECONDS_JUDGED
            eyes = eyes_of(observer.camera, batch)
            yield JudgedPoses(batch, clipped, NO_ROWS, None, {}, None, eyes, bits=bits)
            at += step
            step = min(most, 2 * step) if is_quick else max(1, step // 2)

    def add(self, coverage: Coverage | JudgedPoses, camera: int | None = None) -> None:
        """Add the bits of a batch."""
        assert isinstance(coverage, JudgedPoses)
        assert coverage.bits is not None
        self.views += coverage.bits.views
        self.pose_ids += coverage.poses.ids.tolist()
        self.clipped_poses += coverage.poses.ids[coverage.clipped].tolist()

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in LATER:
                raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
            measured = vars(self._measure())
            vars(self).update({each: measured[each] for each in LATER})
            return measured[name]
