"""Uncovered faces of a network: reason, blocking group, and whether a candidate could cover them.

After selection. For each face that the network does not cover: the camera that comes nearest to
covering it, the criterion that fails there, and a proved statement on the candidates: one covers
the face, one sees a part of it, or none sees any of it. `cavities` makes candidates for faces of
the last kind. The statement is by bounds of the greatest visible fraction of each face over all
candidates, in memory proportional to the number of faces.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 7.3.

Blocking groups are found by the share of a face's area that each group of faces hides from a
camera, by rays to points of the face. The exact method measures the hidden area but not the
occluder, which would take one run for every pair of groups. A face takes 0.3 ms among 10,000.
"""

from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    ConfigError,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    dots,
    frozen_record,
    matmul,
    norm,
    percent,
    plural,
)
from rastercov.base.format import area, verb
from rastercov.base.typed import typed
from rastercov.core.area import polygons
from rastercov.core.camera import Cameras, Poses, axes_of, led_by, renumber
from rastercov.core.camera.rig import are_central
from rastercov.core.coverage.coverage import (
    Coverage,
    Observer,
    evaluate_batches,
    measurements,
    open_observer,
)
from rastercov.core.coverage.face_pass import FacePass, Measured, Scope, Worker
from rastercov.core.coverage.network import Network, share_of_faces, shares_by_reason
from rastercov.core.coverage.task import (
    BITS,
    REASONS,
    UNSEEABLE,
    Reason,
    Task,
    nearness,
    reason_rows,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.groups import at_level, rows_at
from rastercov.engine import coverage_pairs as kernels
from rastercov.placement.parts import MOST_ROWS
from rastercov.shards import Progress, silent

SEEN_NOTHING = 1e-6
"""Visible fraction up to which a face counts as not seen: the bound of computed fractions is 1e-9
for images of 1 px^2 or more, and 1e-9 / area for smaller ones."""


class Sight(IntEnum):
    """Visibility of a face to the candidates, proved; see `Leftover.sight`.

    NONE: no candidate sees it. SOME: a candidate sees a part of it. UNKNOWN: neither is proved, or
    there are no candidates.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Sight, what_is_left
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=2)
    >>> others = rc.sphere_of_poses((0, 0, 0), 3, count=6)
    >>> left = what_is_left((mesh, camera), poses, candidates=others)
    >>> [Sight(each).name for each in left.sight[left.left]]
    ['SOME', 'SOME']
    """

    NONE = 0
    """No candidate sees it: in each, at most 1e-6 of its image is visible, or the image is at most
    1e-6 px^2."""
    UNKNOWN = 1
    """Neither is proved, or there are no candidates."""
    SOME = 2
    """A candidate sees a part of it."""


class Greatest(NamedTuple):
    """Bounds of the visible fraction of each face in some poses, and how many cover it, (F,)."""

    low: FloatArray
    high: FloatArray
    covering: IntArray


class ListedPairs(NamedTuple):
    """Number of pairs of each pose; face and coverage of each pair with coverage above 0.

    Coverage is rounded such that no threshold lies between it and the true one.
    """

    counts: IntArray
    face: Int32Array
    coverage: Float32Array


class CandidateBounds:
    """Bounds of the visible fraction of some faces, updated batch by batch; arrays are (F,).

    Attributes
    ----------
    low, high : float64
        Bounds of the greatest visible fraction.
    covering : int64
        Candidates that cover the face.
    n_poses : int
        Candidates so far.
    """

    def __init__(self, n_faces: int, chosen: BoolArray) -> None:
        self.chosen, self.n_poses = chosen, 0
        self.low, self.high = np.zeros(n_faces), np.zeros(n_faces)
        self.covering: IntArray = np.zeros(n_faces, np.int64)

    def add(self, n_poses: int, parts: Sequence[Greatest]) -> None:
        """Add candidates by the bounds of parts of them."""
        for part in parts:
            np.maximum(self.low, np.minimum(part.low, self.chosen), out=self.low)
            np.maximum(self.high, np.minimum(part.high, self.chosen), out=self.high)
            self.covering += np.where(self.chosen, part.covering, 0)
        self.n_poses += n_poses

    def claims(self, n_candidates: int) -> ByteArray:
        """(F,) `Sight` of the faces, for a number of candidates."""
        claim = np.full(len(self.low), Sight.UNKNOWN, np.uint8)
        if n_candidates:
            claim[self.chosen & (self.high <= SEEN_NOTHING)] = Sight.NONE
            claim[self.chosen & (self.low > SEEN_NOTHING)] = Sight.SOME
        return claim


def list_pairs(
    judge: FacePass, poses: Poses, seen: Measured, bounds: CandidateBounds | None
) -> ListedPairs:
    """Pairs of a batch of poses and evaluated faces, which are judged once, also for `bounds`."""
    n_poses, n_faces = len(poses), judge.mesh.n_faces
    n = n_faces if bounds is not None else 0
    rows = np.empty(n_poses * n_faces, np.int32), np.empty(n_poses * n_faces, np.float32)
    memory, parts = ListedPairs(np.zeros(n_poses, np.int64), *rows), list[Greatest]()

    def worker() -> Worker:
        own = Greatest(np.zeros(n), np.zeros(n), np.zeros(n, np.int64))
        parts.append(own)

        def work(turn: slice, index: int, scope: Scope) -> None:
            ends = turn.start, turn.stop
            kernels.list_pairs(*ends, scope, judge.rules[index], judge.mesh.task_mask, memory, own)

        return work

    if n_poses:
        judge.share(seen, poses, worker)
    if bounds is not None:
        bounds.add(n_poses, parts)
    ends = [(n_faces * at, n_faces * at + end) for at, end in enumerate(memory.counts.tolist())]
    face, coverage = (np.concatenate([of[:0], *(of[a:b] for a, b in ends)]) for of in rows)
    return ListedPairs(memory.counts, face, coverage)


RAYS = 256
"""Points of a face to which its blocking groups are found."""
FACES_AT_ONCE = 512
"""Faces whose rays are in memory: 30 MB."""
COINCIDENT_REL = 1e-8
"""Distance between coincident surfaces, in diagonals of the mesh."""


def in_front(
    mesh: Mesh,
    eyes: FloatArray,
    faces: IntArray,
    progress: Progress = silent,
    axes: FloatArray | None = None,
) -> FloatArray:
    """(N, G) share of the area of each face that each group hides from a point.

    Or, where `axes`, (N, 3), are not 0, along parallel rays that start in the plane of an eye.

    `eyes`, (N, 3), lie on either side of the planes of `faces`, (N,); all faces of the mesh but
    those of targets may hide, at any distance. Of coincident faces the first hides the others. A
    share is of `RAYS` points, 0.01 to 0.02 from that of the area.
    """
    shares = np.zeros((len(faces), len(mesh.groups)))
    solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
    if not len(faces) or not len(solid):
        return shares
    middle, size = mesh.centre, mesh.diagonal
    vertices, eyes = (mesh.vertices - middle) / size, (eyes - middle) / size
    tree = TriangleTree.over(vertices, mesh.faces[solid])
    row = np.full(mesh.n_faces, -1)
    row[solid] = np.arange(len(solid))
    x, y = polygons.even_points(RAYS)
    weights = np.stack((1 - x - y, x, y), axis=1)
    for start in range(0, len(faces), FACES_AT_ONCE):
        own = np.repeat(faces[start : start + FACES_AT_ONCE], RAYS)
        points = matmul(weights, vertices[mesh.faces[own[::RAYS]]]).reshape(-1, 3)
        origins = np.repeat(eyes[start : start + FACES_AT_ONCE], RAYS, axis=0)
        along = points - origins
        if axes is not None:
            rays = np.repeat(axes[start : start + FACES_AT_ONCE], RAYS, axis=0)
            straight = dots(along, rays)[:, None] * rays
            along = np.where((rays != 0).any(axis=1, keepdims=True), straight, along)
            origins = points - along
        length = norm(along)
        hit = tree.first_hits(
            origins, along / length[:, None], length + COINCIDENT_REL / 10, row[own]
        )
        ray = np.flatnonzero(hit >= 0)
        hider, hidden = solid[hit[ray]], own[ray]
        apart = dots(mesh.normals[hider], points[ray] - vertices[mesh.faces[hider, 0]])
        counts = (np.abs(apart) > COINCIDENT_REL) | (hider < hidden)
        np.add.at(shares, (start + ray // RAYS, mesh.face_group[hider]), counts / RAYS)
        progress(min(start + FACES_AT_ONCE, len(faces)), len(faces))
    return shares


COULD = {
    "could_be_covered": "could be covered by a candidate",
    "seen_never_covered": "are visible to a candidate, at least in part, but coverable by none",
    "seen_by_no_candidate": "are visible to no candidate (proved)",
    "unknown": "are undecided",
}
"""Words on uncovered faces by what the candidates prove of them."""

NETWORK_FIGURES = (
    *("visibility", "visibility_bound", "visibility_kind", "drawn_pixels", "reason"),
    *("coverage", "in_view_fraction", "resolution", "incidence"),
)
"""Figures that a `Network` and `NearestCameras` take."""


@frozen_record
class Leftover:
    """Faces that a network does not cover; arrays are (F,), and valid where `left` is true.

    Attributes
    ----------
    mesh, task
        Mesh and thresholds.
    n_cameras, n_candidates : int
        Number of cameras of the network, and of candidates that were examined; a rig with a rule
        counts once.
    left : bool
        True for evaluated faces that are not covered.
    reason : uint8
        `Reason` of the camera that comes nearest to covering the face; `COVERED` if too few cameras
        cover it, or from directions that differ too little.
    alone : uint8
        Bits of the criteria that a camera fails alone, see `rastercov.core.coverage.task.BITS`.
    nearest_camera : int64
        Index of that camera; -1 for none. It fails the fewest criteria, of equally many the latest
        in the order of `Reason`; ties go to the largest share of the face if that is the failing
        quantity (field of view, resolution, visibility), and otherwise to the smallest angle of
        incidence.
    views : int64
        Number of cameras of the network that cover the face.
    n_covering : int64
        Number of candidates that cover the face.
    sight : uint8
        `Sight` of the face.
    seen_at_least, seen_at_most : float64
        Bounds of the greatest visible fraction in any candidate.
    occluder : int32
        If the face is occluded: index of the group that hides most of the face from the nearest
        camera; -1 if it is unknown.
    occluder_share : float64
        Share of the area of the face that this group hides, sampled at 256 points: 0.01 to 0.02
        from the true one.
    hidden_area : (G, G) float64
        Area of uncovered faces of the row's group that the column's group hides from the nearest
        camera, m^2.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import what_is_left
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=2)
    >>> others = rc.sphere_of_poses((0, 0, 0), 3, count=6)
    >>> left = what_is_left((mesh, camera), poses, candidates=others)
    >>> int(left.left.sum()), left.n_candidates
    (2, 6)
    """

    mesh: Mesh
    task: Task
    n_cameras: int
    n_candidates: int
    left: BoolArray
    reason: ByteArray
    alone: ByteArray
    nearest_camera: IntArray
    views: IntArray
    n_covering: IntArray
    sight: ByteArray
    seen_at_least: FloatArray
    seen_at_most: FloatArray
    occluder: Int32Array
    occluder_share: FloatArray
    hidden_area: FloatArray

    def summary(self) -> ByName:
        """Figures in total and by group, by count and by area; ready for JSON."""
        return dict(self._figures)

    @cached_property
    def _figures(self) -> ByName:
        mesh, task_faces = self.mesh, self.mesh.task_mask
        is_covered = self.n_covering > 0
        shown = (~is_covered & (self.sight == s) for s in (Sight.SOME, Sight.NONE, Sight.UNKNOWN))
        parts = dict(zip(COULD, (is_covered, *shown), strict=True))
        return {
            "cameras": self.n_cameras,
            "candidates": self.n_candidates,
            "left": share_of_faces(mesh, self.left, task_faces),
            "reasons": self._reasons(task_faces),
            **{
                name: share_of_faces(mesh, self.left & faces, task_faces)
                for name, faces in parts.items()
            },
            "groups": [
                self.of_groups(group.name, [row])
                for row, group in enumerate(mesh.groups)
                if not group.is_occluder
            ],
        }

    def of_groups(self, name: str, rows: Sequence[int], level: int | None = None) -> ByName:
        """Figures of the groups in some rows together.

        The groups that hide them are united by the first `level` levels of their names; by whole
        names unless given.
        """
        members, hidden_by = self.mesh._faces_of(rows), Counter[str]()
        hidden: Any = self.hidden_area[rows].sum(axis=0)
        for row in np.flatnonzero(hidden).tolist():
            hidden_by[at_level(self.mesh.groups[row].name, level)] += hidden[row].item()
        return {
            "name": name,
            "left": share_of_faces(self.mesh, self.left, members),
            "reasons": self._reasons(members),
            "hidden_by": dict(hidden_by.most_common()),
        }

    @cached_property
    def _why(self) -> ByteArray:
        return reason_rows(self.reason, ~self.left, self.n_cameras)

    def _reasons(self, members: AnyArray) -> ByName:
        alone = None if self.task.views > 1 or self.task.min_angle_deg else self.alone
        return shares_by_reason(self.mesh, self._why, self.left, members, alone)

    def lines(self) -> list[str]:
        """The result as lines of text, the largest share first."""
        summary = self.summary()
        if not summary["left"]["faces"]:
            return ["Every face is covered."]
        lines = [f"{_amount(summary['left'], 'are not covered')}."]
        reasons = sorted(summary["reasons"].items(), key=lambda item: -item[1]["faces"])
        lines += [f"  {_amount(share, REASONS[name].sentence)}" for name, share in reasons]
        if self.n_candidates:
            lines.append(f"Of these, judged by {plural(self.n_candidates, 'candidate pose')}:")
            for name, words in COULD.items():
                if summary[name]["faces"]:
                    lines.append(f"  {_amount(summary[name], words)}")
        parts = rows_at(self.mesh.groups, 1)
        table = {name: self.of_groups(name, rows, 1)["hidden_by"] for name, rows in parts.items()}
        for part in sorted(table, key=lambda name: -sum(table[name].values()))[:MOST_ROWS]:
            if table[part]:
                first = [
                    f"{area(size)} occluded by {'itself' if name == part else name}"
                    for name, size in table[part].items()
                ]
                lines.append(f"{part}: {', '.join(first[:3])}")
        return lines


@typed
def what_is_left(
    view: Observer | tuple[Mesh, Cameras],
    poses: ArrayLike | Poses,
    task: Task | None = None,
    *,
    candidates: ArrayLike | Poses | None = None,
    covered: ArrayLike | None = None,
    progress: Progress = silent,
) -> Leftover:
    """Uncovered faces of a network, with reasons.

    Candidates are measured again, because a visibility matrix holds neither bounds nor faces that
    are visible but not covered. Memory is proportional to the number of faces, not of candidates.

    Parameters
    ----------
    view : Observer or (Mesh, Camera)
        An open observer, or the mesh and the camera, for one with method "certified". Method
        "sampled" proves nothing: with it, no face is `Sight.NONE`.
    poses : (K, 4, 4) array_like, or Poses
        world_from_camera of the network; it may be empty. `Poses.camera` is the index of the camera
        of each.
    task : Task, optional
        Thresholds; `Task()` unless given.
    candidates : (C, 4, 4) array_like or Poses, optional
        Further poses to examine.
    covered : (F,) bool array_like, optional
        Mask of the faces that count as covered, such as `Selection.covered` if views must differ by
        an angle; those that `task.views` cameras cover unless given.
    progress : callable, optional
        Called with the number of poses and occluded faces done and the total; faces are included
        once the network is measured.

    Raises
    ------
    ConfigError
        For a mask of another mesh.
    PoseError
        For a pose that is not a rigid transform.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import what_is_left
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> poses = rc.sphere_of_poses((0, 0, 0), 3, count=2)
    >>> others = rc.sphere_of_poses((0, 0, 0), 3, count=6)
    >>> left = what_is_left((mesh, camera), poses, candidates=others)
    >>> print(left.lines()[0])
    2 faces (16.7 % of the area) are not covered.
    """
    network_poses, task = renumber(poses), task or Task()
    others = renumber(np.zeros((0, 4, 4)) if candidates is None else candidates)
    n_poses = len(network_poses)
    opened = open_observer(*view) if isinstance(view, tuple) else nullcontext(view)
    with opened as observer:
        mesh = observer.mesh
        network, nearest = Network(mesh, task), NearestCameras(mesh.n_faces)
        for batch in evaluate_batches(observer, network_poses, task, fields=NETWORK_FIGURES):
            network.add(batch)
            nearest.add(batch)
            progress(len(network.pose_ids), n_poses + len(others))
        mask = network.covered if covered is None else np.asarray(covered)

        def further(done: int, total: int) -> None:
            progress(n_poses + done, n_poses + total)

        return find_rest(observer, network_poses, network, nearest.camera, mask, others, further)


def find_rest(
    observer: Observer,
    poses: Poses,
    network: Network,
    nearest: IntArray,
    covered: AnyArray,
    candidates: Poses,
    progress: Progress,
    bounds: CandidateBounds | None = None,
) -> Leftover:
    """`what_is_left` of a network that was measured before.

    `nearest`, (F,), is `NearestCameras.camera` of it. Candidates are measured again unless `bounds`
    has all of them. Progress is in candidates, and then hidden faces whose blocking groups are
    found.
    """
    mesh, task = observer.mesh, network.task
    if covered.shape != (mesh.n_faces,) or covered.dtype != np.bool_:
        raise ConfigError(
            f"expected covered as a mask of {mesh.n_faces} faces, got {covered.dtype} "
            f"{covered.shape}; give a bool per face"
        )
    left = mesh.task_mask & ~covered
    hidden = np.flatnonzero(left & (BITS[network.reason] & BITS[Reason.OCCLUDED] > 0))
    total = len(candidates) + len(hidden)
    if bounds is not None and bounds.n_poses == len(candidates):
        sight = bounds
    else:
        sight = CandidateBounds(mesh.n_faces, left)
        judge = FacePass(mesh, observer.camera, observer.threads, task)
        for part, seen in measurements(observer, candidates):
            list_pairs(judge, part, seen, sight)
            progress(sight.n_poses, total)
    progress(len(candidates), total)
    seen_by = poses[nearest[hidden]]
    shares = in_front(
        mesh,
        seen_by.eyes,
        hidden,
        lambda done, _: progress(len(candidates) + done, total),
        None if are_central(observer.camera) else axes_of(observer.camera, seen_by),
    )
    occluder, share = np.full(mesh.n_faces, -1, np.int32), np.zeros(mesh.n_faces)
    share[hidden] = shares.max(axis=1)
    occluder[hidden] = np.where(share[hidden] > 0, shares.argmax(axis=1), -1)
    area = np.zeros((len(mesh.groups), len(mesh.groups)))
    np.add.at(area, mesh.face_group[hidden], mesh.areas[hidden, None] * shares)
    return Leftover(
        mesh=mesh,
        task=task,
        n_cameras=len(led_by(observer.camera, poses)),
        n_candidates=len(led_by(observer.camera, candidates)),
        left=frozen(left),
        reason=frozen(np.where(network.unseeable_areas > 0, np.uint8(UNSEEABLE), network.reason)),
        nearest_camera=frozen(nearest.copy()),
        alone=frozen(network.alone.copy()),
        views=frozen(network.views.copy()),
        n_covering=frozen(sight.covering.copy()),
        sight=frozen(sight.claims(len(candidates))),
        seen_at_least=frozen(sight.low.copy()),
        seen_at_most=frozen(sight.high.copy() if len(candidates) else np.ones(mesh.n_faces)),
        occluder=frozen(occluder),
        occluder_share=frozen(share),
        hidden_area=frozen(area),
    )


class NearestCameras:
    """Camera that comes nearest to covering each face, updated batch by batch."""

    def __init__(self, n_faces: int) -> None:
        self.rank = np.full(n_faces, -1.0)
        self.camera: IntArray = np.full(n_faces, -1, np.int64)

    def add(self, batch: Coverage) -> None:
        """Add a batch of cameras."""
        if not len(batch.pose_ids):
            return
        second = 1 - batch.incidence / np.pi
        shown = {
            Reason.OUTSIDE: batch.in_view_fraction,
            Reason.TOO_COARSE: np.minimum(batch.resolution, 1.0),
            Reason.OCCLUDED: batch.visibility,
            Reason.COVERED: np.minimum(batch.coverage, 1.0),
        }
        for reason, figure in shown.items():
            second = np.where(batch.reason == reason, figure, second)
        # The failing criterion decides; the second figure only breaks ties.
        rank = nearness(batch.reason) + 0.9 * second
        leader = rank.argmax(axis=0)
        best = np.take_along_axis(rank, leader[None], axis=0)[0]
        self.take(best, batch.pose_ids[leader])

    def take(self, rank: FloatArray, camera: IntArray) -> None:
        """Add the nearest of further cameras, (F,), by their rank."""
        better = rank > self.rank
        self.rank[better], self.camera[better] = rank[better], camera[better]


def _amount(share: ByName, action: str) -> str:
    """Sentence on a share of faces; `action` is what several do."""
    count, part = share["faces"], percent(share["area_percent"] / 100)
    return f"{plural(count, 'face')} ({part} of the area) {verb(count, action)}"
