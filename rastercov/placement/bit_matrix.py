"""Visibility matrix whose covered pairs are bits in a memory-mapped file.

Serves selections from more pairs than the memory holds: `measure_matrix` -> `BitMatrix.of` ->
`problem_of` -> `select_greedy`. Coverage itself stays on the disk, in the shards.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.coverage.task import Task
from rastercov.placement._arrays import FloatArray
from rastercov.placement.bit_file import covered_bits
from rastercov.placement.bits import CoveredBits
from rastercov.placement.matrix_folder import MatrixFolder


@dataclass(frozen=True, eq=False)
class BitMatrix:
    """Faces, or cells, that each candidate pose covers, one bit each.

    Attributes
    ----------
    poses : (C, 4, 4) float64
        world_from_camera of the candidates.
    camera : (C,) int32
        Index of the camera of each pose; 0 where there is one.
    folders : tuple of MatrixFolder
        Folders of the matrices of consecutive candidates.
    bits : CoveredBits
        Pairs that count as covered by `task`.
    mean_coverage : (C,) float64
        Mean coverage of each pose over the faces that are scored.
    """

    poses: FloatArray
    camera: NDArray[np.int32]
    folders: tuple[MatrixFolder, ...]
    bits: CoveredBits
    mean_coverage: FloatArray

    @classmethod
    def of(
        cls,
        folder: MatrixFolder,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> Self:
        """Matrix of a complete folder, which gets the file of bits.

        Parameters
        ----------
        folder : MatrixFolder
            See `measure_matrix`.
        progress : callable
            Called with the poses done and the total.

        Raises
        ------
        ConfigError
            When another process is writing to the folder, or a file of it is damaged.
        ResourceError
            When the disk has no room for the bits.
        """
        header = folder.header
        bits, total = covered_bits(folder, Task(**header["task"]).min_coverage, progress)
        mean = total / max(1, header["n_task_faces"])
        poses = folder.poses()
        return cls(poses.world_from_camera, poses.camera, (folder,), bits, mean)

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Matrix that `measure_matrix` or `build_matrix` left in a folder; errors as for `of`."""
        return cls.of(MatrixFolder.open(folder))

    @property
    def header(self) -> dict[str, Any]:
        """Inputs of the first matrix."""
        return self.folders[0].header

    @property
    def task(self) -> Task:
        """Thresholds of coverage."""
        return Task(**self.header["task"])

    @property
    def n_poses(self) -> int:
        """Number of candidates C."""
        return len(self.poses)

    @property
    def n_faces(self) -> int:
        """Faces F of the mesh; of a matrix of cells, their number."""
        return int(self.header["n_faces"])

    @property
    def n_pairs(self) -> int:
        """Pairs with coverage above 0."""
        return sum(folder.n_pairs for folder in self.folders)

    @property
    def is_of_cells(self) -> bool:
        """True where the elements are cells, not faces."""
        return "cells" in self.header

    @property
    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        found: dict[int, str] = {}
        first = 0
        for folder in self.folders:
            found |= {first + pose: end for pose, end in folder.quarantined().items()}
            first += folder.header["n_poses"]
        return found

    def covered_at(self, least: float) -> CoveredBits:
        """Pairs with coverage of at least `least`, from another file that is made where missing."""
        if least == self.task.min_coverage:
            return self.bits
        parts = [covered_bits(folder, float(least))[0].parts for folder in self.folders]
        return CoveredBits(tuple(part for each in parts for part in each), self.n_faces)

    def joined(self, other: "BitMatrix") -> "BitMatrix":
        """Matrix of the poses of both, of one mesh and one task."""
        if self.n_faces != other.n_faces or self.task != other.task:
            raise ConfigError("matrices of other faces or another task cannot be joined")
        return BitMatrix(
            np.concatenate((self.poses, other.poses)),
            np.concatenate((self.camera, other.camera)),
            (*self.folders, *other.folders),
            self.bits.joined(other.bits),
            np.concatenate((self.mean_coverage, other.mean_coverage)),
        )
