"""Parts of a rig: cameras measured a few at a time, or kept in shards until a report is whole.

A file of a shard has sums of a network, the nearest camera of each face, masks of pairs, and
regions where area counts. Frames of a motion have shards of their own.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rastercov.base import AnyArray, BoolArray, ConfigError, IntArray
from rastercov.core.area.table import Regions
from rastercov.core.camera import Poses, rows_of_result
from rastercov.core.coverage.coverage import Coverage, Observer, classify, measurements
from rastercov.core.coverage.face_pass import FacePass, Sums, merge, no_sums
from rastercov.core.coverage.judging import SUMMED, sums_of
from rastercov.core.coverage.shards import (
    PoseShards,
    arrays_of_regions,
    below,
    open_inputs,
    pack_rows,
    under,
)
from rastercov.core.coverage.task import Reason, Task
from rastercov.placement.uncovered import NETWORK_FIGURES, NearestCameras
from rastercov.shards import Staff

FUNCTION = f"{__name__}:make"
RIG_FIGURES = (*NETWORK_FIGURES, "projected_area", "pixel_density", "facing_density")


class Kept(NamedTuple):
    """Folder for shards of a check, and the processes that make them."""

    folder: Path
    staff: Staff


class RigPart(NamedTuple):
    """Some cameras, and what they cover.

    Attributes
    ----------
    poses : Poses
    clipped : (P,) bool
        As of `Coverage`.
    sums : Sums
    nearest : NearestCameras
    masks : (3, P, F) bool
        Pairs that are covered as measured, certainly, and possibly.
    regions : Regions or None
    """

    poses: Poses
    clipped: BoolArray
    sums: Sums
    nearest: NearestCameras
    masks: BoolArray
    regions: Regions | None


def parts_of(observer: Observer, poses: Poses, task: Task) -> Iterator[RigPart]:
    """Poses a few at a time, those of a rig with a rule together."""
    mesh, rows = observer.mesh, rows_of_result(observer.camera, poses)
    judge = FacePass(mesh, observer.camera, observer.threads, task)
    for some, seen in measurements(observer, poses, rows) if len(poses) else ():
        batch = classify(observer, judge, task, some, seen, RIG_FIGURES)
        figures = {name: getattr(batch, name) for name in SUMMED}
        nearest = NearestCameras(mesh.n_faces)
        nearest.add(batch)
        masks = np.stack((batch.reason == Reason.COVERED, *certain_and_possible(batch)))
        sums = sums_of(mesh, figures, np.arange(len(some)))
        regions = getattr(seen, "regions", None)
        yield RigPart(some, seen.clipped, sums, nearest, masks, regions)


class RigShards(PoseShards[RigPart]):
    """Shards of what cameras of a rig cover."""

    function = FUNCTION
    _more = {"of": "rig"}

    def _measure(self, poses: Poses, did: Callable[[int], None]) -> dict[str, AnyArray]:
        return _arrays_of(self.observer, poses, self.task, did)

    def _part(self, arrays: dict[str, AnyArray], poses: Poses) -> RigPart:
        if len(left := np.setdiff1d(poses.ids, arrays["ids"])):
            raise ConfigError(
                f"expected a result of pose {left[0]}, got none: its process ended; leave the pose "
                f"out, or remove {self.store.folder} and use fewer workers, each with more memory"
            )
        n = self.observer.mesh.n_faces
        nearest, sums = NearestCameras(n), Sums(**under("sums", arrays))
        nearest.take(arrays["rank"], arrays["camera"])
        masks = np.unpackbits(arrays["masks"], axis=2, count=n).astype(np.bool_)
        return RigPart(poses, arrays["clipped"], sums, nearest, masks, self.regions(arrays, poses))


def make(folder: Path, number: int | None, chosen: IntArray) -> bytes:
    """Content of a shard, as `rastercov.shards.ShardStore` wants it."""
    observer, poses, task, _ = open_inputs(folder)
    return pack_rows(folder, number, _arrays_of(observer, poses[chosen], task))


def _arrays_of(
    observer: Observer,
    poses: Poses,
    task: Task,
    did: Callable[[int], None] = lambda n_poses: None,
) -> dict[str, AnyArray]:
    """Arrays of a shard of some poses; `did` is called with the poses that are done."""
    n, done, packed = observer.mesh.n_faces, 0, list[AnyArray]()
    clipped, regions = list[BoolArray](), list[Regions]()
    nearest, sums = NearestCameras(n), no_sums(n, len(poses))
    for part in parts_of(observer, poses, task):
        merge(sums, part.sums, done)
        nearest.take(part.nearest.rank, part.nearest.camera)
        packed.append(np.packbits(part.masks, axis=2))
        clipped.append(part.clipped)
        regions += [] if part.regions is None else [part.regions]
        done += len(part.poses)
        did(len(part.poses))
    arrays = {"ids": poses.ids, "rank": nearest.rank, "camera": nearest.camera}
    arrays |= {"clipped": np.concatenate(clipped), "masks": np.concatenate(packed, axis=1)}
    arrays |= below("sums", sums._asdict())
    if regions:
        arrays |= below("regions", arrays_of_regions(regions))
    return arrays


def certain_and_possible(batch: Coverage) -> BoolArray:
    """(2, P, F) pairs covered at the lower and at the upper bound of their visibility.

    A pair that fails a criterion before occlusion, or for its angle, fails at both. A pair without
    a sample is judged by the computed area of its image, not by its pixels per m^2.
    """
    task = batch.task
    drawn = np.where(batch.reason == Reason.UNSAMPLED, batch.projected_area, batch.drawn_pixels)
    enough = drawn / task.min_pixels
    if task.cap_resolution:
        enough = np.minimum(enough, 1.0)
    open_ones = (batch.reason == Reason.OCCLUDED) | (batch.reason == Reason.UNSAMPLED)
    open_ones &= batch.incidence <= math.radians(task.max_incidence_deg)
    open_ones &= batch.pixel_density >= task.min_pixel_density
    open_ones &= batch.facing_density >= task.min_facing_density
    covered = batch.reason == Reason.COVERED
    ends = (
        (covered, np.maximum(batch.visibility - batch.visibility_bound, 0.0)),
        (covered | open_ones, np.minimum(batch.visibility + batch.visibility_bound, 1.0)),
    )
    mask = np.empty((2, *batch.reason.shape), bool)
    for row, (asked, visibility) in enumerate(ends):
        product = np.where(visibility >= task.min_visibility, visibility, 0.0) * enough
        mask[row] = asked & (product >= task.min_coverage) & (product > 0)
    # The measured result is between the two, in spite of rounding of the products.
    mask[1] |= covered
    return mask
