"""Visibility matrix of a plan: lists of pairs in the memory or, where there are many, bits."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rastercov.base.memory import check_memory
from rastercov.placement.bit_matrix import BitMatrix
from rastercov.placement.matrix import VisibilityMatrix
from rastercov.placement.matrix_folder import MatrixFolder
from rastercov.placement.plan.file import Plan
from rastercov.placement.plan.network import most_views

Matrix = VisibilityMatrix | BitMatrix

MOST_LISTED_PAIRS = 50_000_000
"""Pairs up to which a matrix is held as lists: 1 GiB with the selection."""
BYTES_A_PAIR = 20
"""Of lists: 8 for the matrix, 4 for the problem, 8 for the selection."""


def held(
    plan: Plan,
    folders: Sequence[MatrixFolder],
    before: Matrix | None,
    progress: Callable[[int, int], None],
) -> Matrix:
    """Matrix of all folders, as lists up to `MOST_LISTED_PAIRS` and as bits beyond.

    An angle between views, several views from rigs and the integer program need lists of any size.

    Parameters
    ----------
    folders : sequence of MatrixFolder
        Of consecutive candidates.
    before : VisibilityMatrix or BitMatrix, optional
        Matrix of all folders but the last.

    Raises
    ------
    ResourceError
        Where lists are needed and the memory has no room, or the disk has none for bits.
    """
    n_pairs = sum(folder.n_pairs for folder in folders)
    reasons = [
        *(["task.min_angle_deg"] if plan.task.min_angle_deg > 0 else []),
        *(["selection.method integer"] if _is_integer(plan) else []),
        *(["several views from rigs"] if plan.mounts.has_rigs and most_views(plan) > 1 else []),
    ]
    if n_pairs <= MOST_LISTED_PAIRS or reasons:
        if n_pairs > MOST_LISTED_PAIRS:
            what = f"{n_pairs:,} pairs, which {' and '.join(reasons)} need in the memory,"
            remedy = "leave them out, or use fewer candidates"
            check_memory(what, BYTES_A_PAIR * n_pairs, remedy)
        last = VisibilityMatrix.of(folders[-1])
        assert not isinstance(before, BitMatrix)  # its pairs were too many already
        return last if before is None else joined(before, last)
    known = before if isinstance(before, BitMatrix) else None
    for folder in folders[0 if known is None else len(known.folders) :]:
        found = BitMatrix.of(folder, progress)
        known = found if known is None else known.joined(found)
    assert known is not None
    return known


def _is_integer(plan: Plan) -> bool:
    return plan.selection is not None and plan.selection.method == "integer"


def words_on(matrix: Matrix) -> list[str]:
    """Line on a matrix of bits; none for lists."""
    if not isinstance(matrix, BitMatrix):
        return []
    size = matrix.bits.n_rows * matrix.bits.n_words * 8
    return [
        f"the matrix has {matrix.n_pairs:,} pairs and is held as {size / 1e6:,.0f} MB of bits on "
        "the disk: exchanges of cameras are tried among the best candidates only"
    ]


def joined(first: VisibilityMatrix, other: VisibilityMatrix) -> VisibilityMatrix:
    """Matrix of the poses of both, of one mesh and one task."""
    return replace(
        first,
        poses=np.concatenate((first.poses, other.poses)),
        indptr=np.concatenate((first.indptr, first.indptr[-1] + other.indptr[1:])),
        face=np.concatenate((first.face, other.face)),
        coverage=np.concatenate((first.coverage, other.coverage)),
        on_rig=np.concatenate((first.on_rig, other.on_rig)),
        camera=np.concatenate((first.camera, other.camera)),
        quarantined=first.quarantined
        | {first.n_poses + pose: end for pose, end in other.quarantined.items()},
    )
