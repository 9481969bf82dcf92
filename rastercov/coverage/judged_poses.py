"""Poses that a network has judged: their sums, their rows and their arrays on the disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import read_only
from rastercov.camera.pose import Poses
from rastercov.coverage.coverage import Coverage
from rastercov.coverage.face_pass import Measured, Scope
from rastercov.coverage.task import Rules
from rastercov.kernels.direct import DirectCalls
from rastercov.mesh import Mesh
from rastercov.raster.observation import BoundKind

if TYPE_CHECKING:
    from rastercov.kernels.network import PairRows, Sink

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

CHOICES = ("none", "covered", "seen", "all")
"""Pairs that a table may hold: those covered; those seen, that is with some part of the face in the
image and its front to the camera, though other faces may hide it; or every pair."""
SUMMED: dict[str, Any] = {
    "coverage": np.float64,
    "reason": np.uint8,
    "visibility_bound": np.float64,
    "visibility_kind": np.uint8,
    "in_view_fraction": np.float64,
    "drawn_pixels": np.float64,
}
"""Figures that a network adds up, and their types: the arguments of `add_rows` of the kernels, and
the pixels of each face."""


@dataclass(frozen=True, eq=False)
class JudgedPoses:
    """A few poses that a network has judged and not yet added; see `Network.judge`.

    Attributes
    ----------
    poses : Poses
        The poses.
    clipped : (P,) bool
        Whether the near plane cut away a surface in view.
    rows : PairRows
        Figures of the pairs that were asked for, by pose, then by face.
    kept : dict
        Coverage (F,) float64 of the poses to keep, by their ids.
    measured : Observation or FaceCounts, or None
        Measurement of the poses, of those that this process has measured.
    """

    poses: Poses
    clipped: BoolArray
    rows: "PairRows"
    kept: dict[int, FloatArray]
    measured: Measured | None
    parts: "list[tuple[int, Part]]"

    @property
    def pose_ids(self) -> IntArray:
        """(P,) row of each pose in the input."""
        return self.poses.ids


def joined(mesh: Mesh, poses: Poses, batches: "Sequence[JudgedPoses]") -> JudgedPoses:
    """Batches of some poses as one, whatever their sizes and the number of threads."""
    rows = [batch.rows for batch in batches]
    ends = np.cumsum([0] + [len(batch.poses) for batch in batches])
    whole: dict[int, Part] = {}
    for first, batch in zip(ends, batches, strict=False):
        for camera, part in batch.parts:
            whole.setdefault(camera, Part(mesh, int(ends[-1]))).merge(part, int(first))
    kept = {pose: values for batch in batches for pose, values in batch.kept.items()}
    return JudgedPoses(
        poses=poses,
        clipped=np.concatenate([batch.clipped for batch in batches]),
        rows=type(rows[0])(*map(np.concatenate, zip(*rows, strict=True))),
        kept=kept,
        measured=None,
        parts=sorted(whole.items(), key=lambda entry: entry[0]),
    )


def to_arrays(batch: JudgedPoses) -> dict[str, NDArray[Any]]:
    """Arrays of a batch by name; `from_arrays` has their meaning."""
    arrays = {f"rows.{name}": values for name, values in batch.rows._asdict().items()}
    arrays["clipped"] = batch.clipped
    arrays |= {f"kept.{pose}": values for pose, values in batch.kept.items()}
    for camera, part in batch.parts:
        of_part = part.sums._asdict() | {name: getattr(part, name) for name in OF_POSES}
        arrays |= {f"part.{camera}.{name}": values for name, values in of_part.items()}
    return arrays


def from_arrays(mesh: Mesh, poses: Poses, arrays: Mapping[str, NDArray[Any]]) -> JudgedPoses:
    """Batch of some poses from the arrays of `to_arrays`."""
    from rastercov.kernels.network import PairRows, Sums

    tree: dict[str, dict[str, Any]] = {"rows": {}, "kept": {}}
    parts: dict[int, dict[str, Any]] = {}
    for name, values in arrays.items():
        kind, _, rest = name.partition(".")
        if kind == "part":
            camera, _, figure = rest.partition(".")
            parts.setdefault(int(camera), {})[figure] = values
        elif kind in tree:
            tree[kind][rest] = values
    found = []
    for index, figures in parts.items():
        part = Part(mesh, len(poses))
        for name in OF_POSES:
            setattr(part, name, figures.pop(name))
        part.sums = Sums(**figures)
        found.append((index, part))
    return JudgedPoses(
        poses=poses,
        clipped=arrays["clipped"],
        rows=PairRows(**tree["rows"]),
        kept={int(pose): values for pose, values in tree["kept"].items()},
        measured=None,
        parts=found,
    )


OF_POSES = ("covered_faces", "totals", "images")
"""Arrays of a `Part` with a value for each pose."""


class Part:
    """Sums of some of the poses of a batch, made by one thread.

    `covered_faces`, `totals` of coverage and `images` are (P,), 0 for the poses of other parts.
    """

    def __init__(self, mesh: Mesh, n_poses: int) -> None:
        from rastercov.kernels import network  # loads numba

        self.kernels, n = network, mesh.n_faces
        self.sums = network.Sums(
            views=np.zeros(n, np.int64),
            best=np.zeros(n),
            best_row=np.zeros(n, np.int64),
            reason=np.zeros(n, np.uint8),
            kinds=np.zeros(len(BoundKind), np.int64),
            bounds=np.zeros(2),
        )
        self.covered_faces = np.zeros(n_poses, np.int64)
        self.totals, self.images = np.zeros((2, n_poses))
        self._is_scored = read_only(mesh.task_mask, np.bool_)
        self._scored = None if mesh.task_mask.all() else np.flatnonzero(mesh.task_mask)
        self._coverage, self._drawn = np.empty((2, n))
        self._calls: dict[int, DirectCalls] = {}

    def add_coverage(self, coverage: Coverage) -> None:
        """Add all poses of the batch."""
        arrays = [read_only(getattr(coverage, name), kind) for name, kind in SUMMED.items()]
        *added, drawn = arrays
        self.kernels.add_rows(self._is_scored, *added, self.sums, self.covered_faces)
        for row in range(len(drawn)):  # 10 us each
            self._add_sums(row, added[0][row], drawn[row])

    def add_poses(
        self,
        scope: Scope,
        rules: Sequence[Rules],
        sink: "Sink",
        kept: dict[int, FloatArray],
        rows: slice,
        index: int,
    ) -> None:
        """Judge some poses of one camera of the batch and add them; their rows go to `sink`."""
        arguments, coverage = scope(index), self._coverage
        seen = arguments[2]
        own = self._is_scored, self.sums, self.covered_faces, coverage
        call = self._calls.setdefault(index, DirectCalls())
        for row in range(rows.start, rows.stop):
            call(self.kernels.add_pose, row, rows.start, *arguments, rules[index], *own, sink)
            drawn = seen.drawn[row]
            if seen.scale != 1 or drawn.dtype != np.float64:
                drawn = np.divide(drawn, seen.scale, out=self._drawn)
            self._add_sums(row, coverage, drawn)
            pose_id = int(sink.pose_ids[row])
            if pose_id in kept:
                kept[pose_id][:] = coverage

    def _add_sums(self, row: int, coverage: FloatArray, drawn: FloatArray) -> None:
        """Sums over the scored faces of one pose."""
        if self._scored is not None:
            coverage, drawn = coverage.take(self._scored), drawn.take(self._scored)
        self.totals[row], self.images[row] = coverage.sum(), drawn.sum()

    def merge(self, other: "Part", first: int = 0) -> None:
        """Add the sums of other poses; their row 0 is row `first` of this one."""
        ours, theirs = self.sums, other.sums
        ours.views[:] += theirs.views
        rows = theirs.best_row + first
        better = (theirs.best > ours.best) | ((theirs.best == ours.best) & (rows < ours.best_row))
        ours.best[better], ours.best_row[better] = theirs.best[better], rows[better]
        np.maximum(ours.reason, theirs.reason, out=ours.reason)
        ours.kinds[:] += theirs.kinds
        np.maximum(ours.bounds, theirs.bounds, out=ours.bounds)
        own = slice(first, first + len(other.totals))
        for name in OF_POSES:
            getattr(self, name)[own] += getattr(other, name)


class PairBuffer:
    """Memory for the rows of a batch of poses, used again for each batch.

    Parameters
    ----------
    choice : {"none", "covered", "seen", "all"}
        Pairs to keep.
    n_poses, n_faces : int
        Size of the largest batch.

    Raises
    ------
    ConfigError
        For another choice.
    """

    def __init__(self, choice: str, n_poses: int, n_faces: int) -> None:
        from rastercov.kernels import network as kernels  # loads numba

        check_choice(choice)
        self.choice, self._kernels, self._n_faces = CHOICES.index(choice), kernels, n_faces
        size = n_poses * n_faces if self.choice else 0
        # Memory that no row is written to is never taken from the system.
        self._memory = kernels.PairRows(
            *(np.empty(size, kernels.ROW_TYPES[name]) for name in kernels.PairRows._fields)
        )
        self._counts: NDArray[np.int64] = np.zeros(0, np.int64)

    def sink(self, pose_ids: NDArray[np.int64]) -> "Sink":
        """Empty memory for the rows of these poses, (P,)."""
        self._counts = np.zeros(len(pose_ids), np.int64)
        return self._kernels.Sink(self.choice, pose_ids, self._counts, self._memory)

    def rows(self) -> "PairRows":
        """Copy of the rows of the batch, by pose, then by face."""
        starts = np.flatnonzero(self._counts)
        spans = [(at * self._n_faces, self._counts[at]) for at in starts.tolist()]
        return self._kernels.PairRows(*(_joined(column, spans) for column in self._memory))


def check_choice(choice: object) -> None:
    """Raise `ConfigError` for what is no choice of pairs."""
    if choice not in CHOICES:
        raise ConfigError(f"pairs must be one of {', '.join(CHOICES)}, got {shown(choice)}")


def _joined(column: NDArray[Any], spans: list[tuple[int, int]]) -> NDArray[Any]:
    return np.concatenate([column[:0], *(column[at : at + n] for at, n in spans)])
