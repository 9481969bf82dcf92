"""Objective of pose optimisation: the share of the task's weight that a network covers.

Serves `search`, `refine` and `tolerance`. Weights are integers as in `Problem`; poses are measured
on demand, in batches.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ConfigError,
    FloatArray,
    IntArray,
    Lists,
    frozen_record,
    offsets_of,
    owners_of,
)
from rastercov.core.area.cells import Cells
from rastercov.core.area.regions import RegionPass
from rastercov.core.area.stages import CentrePass
from rastercov.core.camera import Poses, eyes_of, led_by, renumber, rows_of_result
from rastercov.core.coverage.coverage import Observer, evaluate_batches
from rastercov.core.coverage.network import least_cosine
from rastercov.core.coverage.task import Reason, Task
from rastercov.core.mesh import Mesh
from rastercov.engine.coverage_spread import cameras_until_covered, worth_added
from rastercov.placement.mounts import Mounts, places_on_rigs
from rastercov.placement.select.problem import in_whole_numbers, views_of, weights_of

PART_OF_TOTAL = 1 << 40
"""Total weight of each part of several objectives."""
POSES_A_BATCH = 64
"""Poses between two calls of `Objective.watch` where they are estimated."""


@frozen_record
class Objective:
    """Share of the weight of the evaluated faces that a network covers; see `Objective.of`.

    A face is covered if at least `need` of the cameras cover it and, where `min_cosine` is below 1,
    the rays to two of these differ by that angle: as in `Problem`. Where the cameras of rigs count
    one by one, each pose has `width` rows of faces and of centres: those of its cameras, and empty
    ones where its rig has fewer.

    Attributes
    ----------
    observer : Observer
        Open observer of the mesh and the camera.
    task : Task
        Thresholds at which a camera covers a face.
    integer_weights : (F,) int64
        Integer weight of each face; 0 for faces that are not evaluated, negative for those that
        should not be covered.
    need : (F,) int64
        Number of cameras that must cover each face.
    min_cosine : float
        Largest cosine of the angle between two rays that differ enough; 2 where any two do.
    watch : callable
        Called with the number of poses after each batch that was measured.
    mounts : Mounts or None
        Rigs of the cameras of the observer; `Poses.camera` is then the index of the mount.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Objective
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=3)
    >>> task = rc.Task(max_incidence_deg=70)
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     objective = Objective.of(observer, task, weight_by="area", views=1)
    ...     share = objective.share_of(poses)
    >>> round(share, 3)
    1.0
    """

    is_estimated: ClassVar[bool] = False
    """True where `estimated` differs from `listed`."""

    observer: Observer
    task: Task
    integer_weights: IntArray
    need: IntArray
    min_cosine: float = 2.0
    watch: Callable[[int], None] = lambda count: None
    mounts: Mounts | None = None

    @classmethod
    def of(
        cls,
        observer: Observer,
        task: Task | None = None,
        *,
        weight_by: str = "area",
        views: int | Mapping[str, int] | None = None,
        min_angle_deg: float | None = None,
        mounts: Mounts | None = None,
        **own: Any,
    ) -> Self:
        """Objective of an open observer.

        `weight_by`, `views` and `min_angle_deg` as for `problem_of`, `mounts` as for
        `build_matrix`; `own` are the further attributes of a subclass. ConfigError for `views`
        below 1 and an angle outside 0 to 180 degrees.
        """
        task = task or Task()
        mesh = own["cells"].elements if "cells" in own else observer.mesh
        weights = in_whole_numbers(weights_of(own.get("cells", mesh), weight_by))
        need = views_of(mesh, task.views if views is None else views)
        if (need < 1).any() or not np.issubdtype(need.dtype, np.integer):
            raise ConfigError(f"expected views of 1 or more, got {views}; give whole numbers")
        angle = task.min_angle_deg if min_angle_deg is None else min_angle_deg
        cosine = least_cosine(math.radians(angle))
        return cls(observer, task, weights, need.astype(np.int64), cosine, mounts=mounts, **own)

    @property
    def elements(self) -> Mesh:
        """Mesh whose faces are counted: that of the observer, or of the patches."""
        return self.observer.mesh

    def cameras(self, poses: ArrayLike | Poses) -> tuple[Poses, IntArray]:
        """Poses of all cameras of (P, 4, 4) poses, and the row of the pose that each is of."""
        placed = renumber(poses)
        if self.mounts is None:
            return placed, np.arange(len(placed))
        return self.mounts.cameras(placed)

    @property
    def width(self) -> int:
        """Rows of faces and of centres of each pose: 1 unless cameras of rigs count one by one."""
        is_counted = self.min_cosine <= 1 or bool((self.need > 1).any())
        if self.mounts is None or not self.mounts.has_rigs or not is_counted:
            return 1
        return self.mounts.width

    def eyes(self, poses: ArrayLike | Poses) -> FloatArray:
        """(P width, 3) camera centres of each row of poses, metres."""
        placed = renumber(poses)
        if self.mounts is None:
            return eyes_of(self.observer.camera, placed)
        centres = self.mounts.eyes(placed)
        if (width := self.width) == 1:
            return centres
        result = np.repeat(centres, width, axis=0)
        cameras, owner = self.cameras(placed)
        leads = led_by(self.mounts.rig, cameras)
        rows = owner[leads] * width + places_on_rigs(owner[leads])
        result[rows] = eyes_of(self.mounts.rig, cameras[leads])
        return result

    def listed(self, poses: FloatArray | Poses) -> Lists:
        """Faces that each row of (P, 4, 4) poses covers, in ascending order."""
        return self._unite(poses, self._list)

    def estimated(self, poses: FloatArray | Poses) -> Lists:
        """Faces that each pose covers, by the quickest estimate there is; here `listed`."""
        return self._unite(poses, self._estimate)

    def _unite(self, poses: FloatArray | Poses, find: Callable[[Poses], Lists]) -> Lists:
        """Lists of the rows of poses, of the mounts that they are of."""
        placed, owner = self.cameras(poses)
        if self.mounts is not None:
            owner = self.mounts.rows(placed, owner)
        result = find(placed)
        if (width := self.width) > 1:
            counts = np.zeros(len(poses) * width, np.int64)
            counts[owner * width + places_on_rigs(owner)] = np.diff(result.starts)
            return Lists(offsets_of(counts), result.items)
        return result if self.mounts is None else self.mounts.unite(result, owner, len(poses))

    def _list(self, poses: Poses) -> Lists:
        """Faces that each camera covers."""
        rows: list[AnyArray] = []
        if len(poses):
            for batch in evaluate_batches(self.observer, poses, self.task, fields=("reason",)):
                rows += [np.flatnonzero(row) for row in batch.reason == Reason.COVERED]
                self.watch(len(batch.pose_ids))
        return Lists.of(rows)

    def _estimate(self, poses: Poses) -> Lists:
        return self._list(poses)

    def covers(self, poses: FloatArray | Poses) -> BoolArray:
        """(P width, F) faces that each row of poses covers."""
        return self.dense(self.listed(poses))

    def dense(self, lists: Lists) -> BoolArray:
        """(N, F) mask of the faces of N lists."""
        covers = np.zeros((lists.n, len(self.integer_weights)), bool)
        covers[owners_of(np.diff(lists.starts)), lists.items] = True
        return covers

    def networks(self, poses: FloatArray, camera: ArrayLike) -> tuple[BoolArray, FloatArray]:
        """(N, k width, F) faces that each row of N networks covers, and (N, k width, 3) centres.

        Parameters
        ----------
        poses : (N, k, 4, 4) float64
        camera : (k,) int array_like
            Camera of each pose of a network.
        """
        shape = len(poses), poses.shape[1] * self.width
        placed = Poses.of(poses.reshape(-1, 4, 4), camera=np.tile(camera, len(poses)))
        covers = self.covers(placed).reshape(*shape, len(self.integer_weights))
        return covers, self.eyes(placed).reshape(*shape, 3)

    def covered(self, covers: BoolArray, eyes: FloatArray) -> BoolArray:
        """(F,) faces that a network covers, from the faces of its cameras, (k, F), and centres.

        Leading axes of both, (..., k, F) and (..., k, 3), are independent networks.
        """
        return self.cameras_until_covered(covers, eyes) <= covers.shape[-2]

    def cameras_until_covered(
        self, covers: BoolArray, eyes: FloatArray, need: IntArray | None = None
    ) -> IntArray:
        """(F,) least n for which the first n cameras of a network cover the face, k + 1 for none.

        Arguments as for `covered`; `need` is that of the objective unless given.
        """
        counts = np.empty((*covers.shape[:-2], covers.shape[-1]), np.int64)
        centroids, need = _read_only(self.elements.centroids, self.need if need is None else need)
        for index in np.ndindex(covers.shape[:-2]):
            own, places = _read_only(covers[index], eyes[index])
            rays = places, centroids, float(self.min_cosine)
            cameras_until_covered(own, rays, need, counts[index])
        return counts

    def worth_added(
        self, rest: BoolArray, rest_eyes: FloatArray, trials: Lists, trial_eyes: FloatArray
    ) -> IntArray:
        """(M,) integer weight that each of M trial cameras adds to what the rest covers.

        `rest` are the faces of each other row, (k, F); `trials` those of the M width rows of the
        trials, and the cost is proportional to these.
        """
        n_rest = np.add.reduce(rest, axis=0, dtype=np.int64)
        one = np.ones(rest.shape[1], np.int64)
        is_spread = one > 0
        if self.min_cosine <= 1:
            is_spread = self.cameras_until_covered(rest, rest_eyes, one) <= len(rest)
        added = np.empty(trials.n // self.width, np.int64)
        rest, starts, items = _read_only(rest, trials.starts, trials.items)
        weights, centroids, need = _read_only(
            self.integer_weights, self.elements.centroids, self.need
        )
        rays = np.concatenate((rest_eyes, trial_eyes)), centroids, float(self.min_cosine)
        of_trials = starts, items, self.width
        worth_added(rest, of_trials, rays, n_rest, is_spread, weights, need, added)
        return added

    def worth(self, covered: BoolArray) -> IntArray:
        """Integer weight of the covered faces, (..., F) -> (...)."""
        return np.asarray(covered @ self.integer_weights)

    @property
    def total(self) -> int:
        """Greatest integer weight of covered faces."""
        return int(self.integer_weights.clip(0).sum())

    def share(self, worth: ArrayLike) -> FloatArray:
        """Integer weight as a share of the total, [0, 1]; 1 where there is no weight."""
        total = self.total
        return np.asarray(worth) / total if total else np.ones(np.shape(worth))

    def share_of(self, poses: ArrayLike | Poses) -> float:
        """Share that one network of (k, 4, 4) poses covers."""
        placed = Poses.of(poses)
        covered = self.covered(self.covers(placed), self.eyes(placed))
        return float(self.share(self.worth(covered)))


def _read_only(*arrays: AnyArray) -> list[AnyArray]:
    """The arrays as the loops take them."""
    from rastercov.base import read_only

    return [read_only(array, array.dtype.type) for array in arrays]


@frozen_record
class CellObjective(Objective):
    """Share of the area of patches that a network covers; see `CellObjective.of_cells`.

    A pose covers a patch if it covers at least `task.min_coverage`, one half, of its area, as in a
    matrix of patches. What `Objective` calls faces are patches here.

    Attributes
    ----------
    cells : Cells
        The patches, made by `rastercov.cells`.
    finder : RegionPass
        Open pass over the regions of the mesh and the camera.
    centres : CentrePass
        Estimates for the same patches, camera and task.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.core.area.regions import RegionPass
    >>> from rastercov.placement import CellObjective
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=3)
    >>> cells = rc.cells(mesh, 0.5)
    >>> finder = RegionPass(mesh, camera, rc.Task(max_incidence_deg=70))
    >>> with rc.open_observer(mesh, camera) as observer:
    ...     share = CellObjective.of_cells(observer, finder, cells).share_of(poses)
    >>> finder.close()
    >>> round(share, 3)
    1.0
    """

    is_estimated: ClassVar[bool] = True
    """The centre of a cell is an estimate of half of it."""

    cells: Cells = field(kw_only=True)
    finder: RegionPass = field(kw_only=True)
    centres: CentrePass = field(kw_only=True)

    @classmethod
    def of_cells(
        cls,
        observer: Observer,
        finder: RegionPass,
        cells: Cells,
        **counted: Any,
    ) -> Self:
        """Objective on patches; `counted` are the other arguments of `Objective.of`."""
        centres = CentrePass(cells, finder.camera, finder.task, finder.threads)
        return cls.of(observer, finder.task, cells=cells, finder=finder, centres=centres, **counted)

    @property
    def elements(self) -> Mesh:
        """Mesh of the cells."""
        return self.cells.elements

    def _list(self, poses: Poses) -> Lists:
        """Cells that each camera covers, in ascending order."""
        rows: list[AnyArray] = []
        if len(poses):
            for regions in self.finder.batches(poses):
                shares = self.cells.share(regions)
                for first, last in pairwise(shares.starts.tolist()):
                    cell, share = shares.cell[first:last], shares.share[first:last]
                    rows.append(cell[share >= self.task.min_coverage])
                self.watch(len(shares.pose_ids))
        return Lists.of(rows)

    def _estimate(self, poses: Poses) -> Lists:
        """Cells whose centre each camera covers, in about a seventh of the time of `_list`."""
        rows: list[AnyArray] = []
        together = rows_of_result(self.finder.camera, poses)
        for at in range(0, int(together[-1]) + 1 if len(poses) else 0, POSES_A_BATCH):
            is_own = (together >= at) & (together < at + POSES_A_BATCH)
            result = self.centres.find(poses[np.flatnonzero(is_own)])
            rows += [result.row(row) for row in range(result.n)]
            self.watch(int(is_own.sum()))
        return Lists.of(rows)


@frozen_record
class TogetherObjective(Objective):
    """Several objectives of the same cameras as one, each of its share; make it with `together`.

    Faces of `Objective` are those of all parts, one after the other.
    """

    parts: tuple[Objective, ...] = field(kw_only=True)

    @classmethod
    def together(cls, parts: Sequence[tuple[Objective, int]]) -> Self:
        """One objective of some and their factors, below 0 for what is better not covered."""
        every = tuple(each for each, _ in parts)
        weights = [in_parts(each.integer_weights) * factor for each, factor in parts]
        first = every[0]
        return cls(
            first.observer,
            first.task,
            np.concatenate(weights),
            np.concatenate([each.need for each in every]),
            first.min_cosine,
            mounts=first.mounts,
            parts=every,
        )

    @property
    def is_estimated(self) -> bool:  # type: ignore[override] # of a class there
        """True where the estimates of a part differ from what is listed."""
        return any(each.is_estimated for each in self.parts)

    @cached_property
    def elements(self) -> Mesh:
        """Meshes of all parts."""
        meshes = [each.elements for each in self.parts]
        names = [f"{row}" for row in range(sum(len(each.groups) for each in meshes))]
        return Mesh.joined(meshes, names)

    def _list(self, poses: Poses) -> Lists:
        """Faces of all parts that each camera covers."""
        return self._join_lists([each._list(poses) for each in self.parts], len(poses))

    def _estimate(self, poses: Poses) -> Lists:
        return self._join_lists([each._estimate(poses) for each in self.parts], len(poses))

    def _join_lists(self, lists: Sequence[Lists], n_poses: int) -> Lists:
        """Lists of the rows of all parts."""
        self.watch(n_poses)
        starts = offsets_of([len(each.need) for each in self.parts]).tolist()
        rows = [
            np.concatenate([
                each.row(row) + np.int32(first)
                for each, first in zip(lists, starts, strict=False)
            ])
            for row in range(lists[0].n)
        ]  # fmt: skip
        return Lists.of(rows)


def in_parts(weights: IntArray) -> IntArray:
    """Integer weights as parts of one total, whatever theirs is."""
    total = max(int(weights.clip(0).sum()), 1)
    return np.asarray(np.rint(weights / total * PART_OF_TOTAL), np.int64)
