"""Folder of a visibility matrix with all its shards, verified, of which nothing is in memory."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rastercov.base.errors import ConfigError
from rastercov.camera.pose import Poses
from rastercov.cluster.files import DamagedError
from rastercov.cluster.quarantine import quarantined
from rastercov.placement._arrays import IntArray
from rastercov.placement.shards import (
    Note,
    open_shard,
    read_header,
    read_poses,
    shards_of,
)


@dataclass(frozen=True, eq=False)
class MatrixFolder:
    """A complete folder of a visibility matrix.

    Attributes
    ----------
    path : Path
    header : dict
        Inputs of the matrix.
    n_pairs : int
        Pairs of pose and face, or cell, with coverage above 0.
    """

    path: Path
    header: dict[str, Any]
    n_pairs: int

    @classmethod
    def open(cls, folder: str | Path) -> Self:
        """Verify all files of a folder.

        Raises
        ------
        ConfigError
            When it holds no matrix, when it is incomplete, or when one of its files is damaged.
        """
        folder = Path(folder)
        with remade_by_build():
            header = read_header(folder)
            if header is None:
                raise ConfigError(f"{folder}: there is no matrix in this folder")
            shards = list(shards_of(header["n_poses"], header["poses_a_shard"]))
            sizes = [rows_in(folder, shard, header) for shard, _ in shards]
            if None in sizes:
                raise ConfigError(
                    f"{folder}: {sizes.count(None)} of {len(shards)} shards are missing; "
                    "call build_matrix with the same inputs to make them"
                )
            return cls(folder, header, sum(size or 0 for size in sizes))

    def shards(self) -> list[tuple[str, slice]]:
        """Name and poses of each shard."""
        return list(shards_of(self.header["n_poses"], self.header["poses_a_shard"]))

    def poses(self) -> Poses:
        """Candidates; ConfigError where they are damaged."""
        with remade_by_build():
            found = read_poses(self.path, self.header)
            if found is None:
                raise DamagedError(self.path / "poses.npy", "it is missing")
            return found

    def quarantined(self) -> dict[int, str]:
        """Poses without pairs because they kill the process that measures them, with its end."""
        shards = self.shards()
        with remade_by_build():
            found = quarantined(self.path, len(shards))
        return {
            shards[number][1].start + pose: why
            for number, poses in found.items()
            for pose, why in poses.items()
        }

    def pairs_of(
        self, shard: str, rows: slice
    ) -> tuple[IntArray, NDArray[np.int32], NDArray[np.float32], NDArray[np.uint16]]:
        """Number of pairs of each pose of a shard, and face, coverage and camera of each pair.

        Cameras are numbers on a rig; empty where poses are of single cameras.

        Raises
        ------
        ConfigError
            When the shard is damaged or missing by now.
        """
        with remade_by_build():
            file = open_shard(self.path, shard, self.header)
            if file is None:
                raise DamagedError(self.path / shard, "it changed while it was read")
        is_of_rigs = "pairs" in self.header
        names = ["pose", "face", "coverage", *(["camera_on_rig"] if is_of_rigs else [])]
        table = file.read(names, use_threads=False)
        of_pose = table["pose"].to_numpy() - rows.start
        counts = np.bincount(of_pose, minlength=rows.stop - rows.start)
        on_rig = table["camera_on_rig"].to_numpy() if is_of_rigs else np.zeros(0, np.uint16)
        return counts, table["face"].to_numpy(), table["coverage"].to_numpy(), on_rig


def greatest(
    counts: IntArray, face: NDArray[np.int32], coverage: NDArray[np.float32]
) -> tuple[IntArray, NDArray[np.int32], NDArray[np.float32]]:
    """Pairs of poses, each face once, with the greatest coverage of those that follow one another.

    Arguments are the number of pairs of each pose, and face and coverage of each.
    """
    starts = np.ones(len(face), np.bool_)
    starts[1:] = face[1:] != face[:-1]
    first = np.cumsum(counts) - counts
    starts[first[first < len(face)]] = True
    rows = np.flatnonzero(starts)
    pose = np.repeat(np.arange(len(counts)), counts)[rows]
    best = np.maximum.reduceat(coverage, rows) if len(rows) else coverage
    return np.bincount(pose, minlength=len(counts)), face[rows], best


def rows_in(
    folder: Path, shard: str, header: dict[str, Any], note: Note | None = None
) -> int | None:
    """Pairs in a shard, None where it is missing, or damaged and `note` is given."""
    try:
        file = open_shard(folder, shard, header)
    except DamagedError as error:
        if note is None:
            raise
        note(f"{error}; its poses are measured again")
        return None
    return None if file is None else int(file.metadata.num_rows)


@contextmanager
def remade_by_build() -> Iterator[None]:
    """Name `build_matrix` in the error of a damaged file: it makes the file again."""
    try:
        yield
    except DamagedError as error:
        raise ConfigError(
            f"{error}; call build_matrix with the same inputs to make it again"
        ) from None
