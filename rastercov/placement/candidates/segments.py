"""Segmentation of a surface by normals, (6.1)-(6.3): one segment for each candidate view.

From a mesh, a label for each face. Segments grow from face to neighbouring face while all normals
of a segment are within alpha of one another; then segments whose average normals are within beta of
one another are merged, neighbours or not.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section
6.3.1; the order of the steps, which it does not define, is that of his program (Khepra, 2020).
"""

import math
from collections.abc import Callable

import numpy as np

from rastercov.base import (
    ConfigError,
    FloatArray,
    IntArray,
    check_choice,
    cos,
    finite_number,
    frozen_record,
    matmul,
    norm,
    shown,
)
from rastercov.base.typed import check_type
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen
from rastercov.engine import placement_segments as kernels

ANGLE_TOLERANCE_DEG = 5e-5
"""Tolerance of angle limits: the thesis' program rounds to 4 decimals, and normals of a file in
single precision are no more accurate."""


@frozen_record
class Segmentation:
    """Faces in segments; its arrays are read-only. Made by `segment`.

    Attributes
    ----------
    labels : (F,) int64
        Segment of each face, numbered from 0 in the order of their first faces; -1 for faces
        without area and for occluders.
    normals : (S, 3) float64
        Unit average normals, (6.5), with equal weights for all faces, as in Eissa (2020).
    centroids : (S, 3) float64
        Average of the corners of all faces, T_S of (6.4), metres.
    areas : (S,) float64
        Area of each segment, m^2.
    sizes : (S,) int64
        Number of faces of each segment.
    alpha_deg : float
        Limit of the angle between any two normals while a segment grew.
    beta_deg : float or None
        Limit of the angle between average normals of segments that were merged; None without
        merging.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import segment
    >>> sides = segment(rc.shapes.box(), alpha_deg=15, beta_deg=25)
    >>> sides.normals.shape, sides.areas.round(6).tolist()[:2]
    ((6, 3), [1.0, 1.0])
    """

    labels: IntArray
    normals: FloatArray
    centroids: FloatArray
    areas: FloatArray
    sizes: IntArray
    alpha_deg: float
    beta_deg: float | None

    @property
    def n_segments(self) -> int:
        """Number of segments S."""
        return len(self.sizes)


def segment(
    mesh: Mesh,
    alpha_deg: float,
    beta_deg: float | None,
    *,
    merge: str = "leader",
) -> Segmentation:
    """Segments of the evaluated faces of a mesh, (6.1)-(6.3).

    Growing, (6.1) and (6.2): the first face without a segment begins one, and faces that share an
    edge with it join, nearest first, as long as their normal is within alpha of *every* normal in
    it. The test is exact to 6e-8 tan(alpha) radians and looks at the convex hull of the normals
    only, see `engine/placement/segments.cpp`. Faces without area are passed through.

    Merging, (6.3): segments whose average normals are within beta are merged, neighbours or not.
    For A near B and B near C, Eissa (2020) defines no order; there are two readings:

    leader
        As in his program. In order, each remaining segment absorbs all others within beta of *its
        own* average, which is not updated. The number of segments depends on the order of the
        faces, and two segments may end up closer than beta.
    closest
        The two closest segments are merged until none are within beta, with the average over the
        faces of both. The result depends much less on the order of the faces, and has about a tenth
        fewer segments.

    Parameters
    ----------
    mesh : Mesh
        Evaluated faces are labelled; occluders stop the growth. Vertices at the same point are one.
        Apart from this, groups and their flags have no effect.
    alpha_deg, beta_deg : float
        Limits alpha and beta, degrees, 0 <= angle < 90. With beta None nothing is merged.
    merge : {"leader", "closest"}
        Order of merging, see above.

    Returns
    -------
    Segmentation
        Deterministic: the same arguments give the same segments.

    Raises
    ------
    ConfigError
        For an angle outside its range, or another `merge`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import segment
    >>> sides = segment(rc.shapes.box(), alpha_deg=15, beta_deg=25)
    >>> sides.n_segments, sides.labels.tolist()[:4]
    (6, [0, 0, 1, 1])
    """
    check_type("mesh", mesh, Mesh)
    alpha = _angle("alpha_deg", alpha_deg)
    beta = None if beta_deg is None else _angle("beta_deg", beta_deg)
    check_choice("merge", merge, tuple(MERGES))
    labels = _grow_segments(mesh, alpha)
    if beta is not None and (n_grown := int(labels.max(initial=-1)) + 1) > 1:
        sums = _sums(labels, mesh.normals, n_grown)
        owner = MERGES[merge](sums, _least_cosine(beta))
        labels = np.where(labels >= 0, np.append(owner, -1)[labels], -1)
    return _describe_segments(mesh, _renumber(labels), alpha, beta)


def _angle(name: str, value: float) -> float:
    if not 0 <= finite_number(value) < 90:
        raise ConfigError(
            f"expected {name} from 0 to below 90 degrees, got {shown(value)}; change it"
        )
    return float(value)


def _least_cosine(angle_deg: float) -> float:
    """Cosine of an angle with its tolerance; above 0, the cosine of a right angle."""
    return max(cos(math.radians(angle_deg + ANGLE_TOLERANCE_DEG)), 1e-9)


def _grow_segments(mesh: Mesh, alpha_deg: float) -> IntArray:
    """Segment of each face; growth passes through faces without area, which have none."""
    role = np.full(mesh.n_faces, kernels.TASK, np.uint8)
    role[mesh.degenerate_mask] = kernels.PASSED
    role[~mesh.task_mask] = kernels.BARRIER
    pairs = mesh.topology.neighbours
    rows = np.concatenate((pairs, pairs[:, ::-1]))
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    starts = np.searchsorted(rows[:, 0], np.arange(mesh.n_faces + 1))
    least = _least_cosine(alpha_deg)
    passed = np.empty(mesh.n_faces, np.int64)
    kernels.grow_segments(
        np.ascontiguousarray(mesh.normals), role, starts.astype(np.int64),
        np.ascontiguousarray(rows[:, 1]), least, np.sqrt(1 - least**2) / least, passed,
    )  # fmt: skip
    return np.where(role == kernels.TASK, passed, -1)


def _by_leader(sums: FloatArray, least_cosine: float) -> IntArray:
    """Leader of each segment, itself for a leader; about 20 us a leader."""
    units = _units(sums)
    owner = np.full(len(units), -1, np.int64)
    free = np.arange(len(units))
    while len(free):
        leader = int(free[0])
        near = matmul(units[free], units[leader]) >= least_cosine
        near[0] = True
        owner[free[near]] = leader
        free = free[~near]
    return owner


def _by_closest(sums: FloatArray, least_cosine: float) -> IntArray:
    """Lowest segment of the set of each segment; three steps of 10 to 100 us a segment.

    Each segment has the partner that was the closest when it was looked up last. Of the two closest
    segments, the one looked up later has the other as its partner, so they come first.
    """
    sums, units = sums.copy(), _units(sums)
    owner, partner = np.arange(len(units)), np.arange(len(units))
    closest = np.full(len(units), -1.0)

    def look_up(one: int) -> None:
        cosines = matmul(units, units[one])
        cosines[one] = -1.0
        partner[one] = cosines.argmax()
        closest[one] = cosines[partner[one]]

    for one in range(len(units)):
        look_up(one)
    while len(units) and closest[one := int(closest.argmax())] >= least_cosine:
        kept, gone = sorted((one, int(partner[one])))
        owner[owner == gone] = kept
        sums[kept] += sums[gone]
        units[kept] = sums[kept] / norm(sums[kept])
        units[gone], closest[gone] = 0.0, -1.0  # a right angle to all: never merged again
        is_changed = ((partner == kept) | (partner == gone)) & (closest >= least_cosine)
        is_changed[kept] = True
        for other in np.flatnonzero(is_changed):
            look_up(int(other))
    return owner


MERGES: dict[str, Callable[[FloatArray, float], IntArray]] = {
    "leader": _by_leader,
    "closest": _by_closest,
}


def _units(sums: FloatArray) -> FloatArray:
    return sums / norm(sums)[..., None]


def _sums(labels: IntArray, values: FloatArray, count: int) -> FloatArray:
    """(S, 3) sums of the rows of each segment, added in the order of the faces."""
    chosen = labels >= 0
    columns = values[chosen].T
    return np.stack([np.bincount(labels[chosen], column, count) for column in columns], axis=1)


def _renumber(labels: IntArray) -> IntArray:
    """Labels without gaps, in the same order; both steps keep the lowest label of a segment."""
    chosen = labels >= 0
    out = np.full(len(labels), -1, np.int64)
    out[chosen] = np.unique(labels[chosen], return_inverse=True)[1]
    return out


def _describe_segments(
    mesh: Mesh, labels: IntArray, alpha: float, beta: float | None
) -> Segmentation:
    count = int(labels.max(initial=-1)) + 1
    chosen = labels >= 0
    sizes = np.bincount(labels[chosen], minlength=count).astype(np.int64)
    # Relative to the centre of the mesh, because a far offset costs precision.
    middle = mesh.centre
    centroids = middle + _sums(labels, mesh.centroids - middle, count) / sizes[:, None]
    return Segmentation(
        labels=frozen(labels),
        normals=frozen(_units(_sums(labels, mesh.normals, count))),
        centroids=frozen(centroids),
        areas=frozen(np.bincount(labels[chosen], mesh.areas[chosen], count)),
        sizes=frozen(sizes),
        alpha_deg=alpha,
        beta_deg=beta,
    )
