"""Mounts of candidates: a camera, or a rig of cameras that move together.

A pose of a candidate is that of its mount, and `Poses.camera` the index of the mount. A rig covers
what any of its cameras covers, and is one choice; each of its cameras is a view of a face. A rig
with a rule covers what its cameras cover together, and is one view.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Self

import numpy as np

from rastercov.base import (
    FloatArray,
    IntArray,
    Lists,
    PoseError,
    first_of,
    frozen_record,
    offsets_of,
    owners_of,
)
from rastercov.core.camera import Camera, Poses, Rig, Views, eyes_of, led_by
from rastercov.core.camera.rig import MOST_NAMES, movers, with_places


def places_on_rigs(owner: IntArray) -> IntArray:
    """(K,) number of each camera on its rig, from the ascending rows of their rigs."""
    return np.arange(len(owner)) - np.searchsorted(owner, owner)


@frozen_record
class Mounts:
    """Cameras and rigs that candidates choose among.

    Attributes
    ----------
    names : tuple of str
        Name of each of N mounts.
    rig : Rig
        All cameras, those of a mount in a row, with their names and places on it; a camera of a
        rig is named "rig/camera".
    starts : (N + 1,) int64
        Mount i has the cameras `starts[i]` ... `starts[i + 1] - 1`.
    """

    names: tuple[str, ...]
    rig: Rig
    starts: IntArray

    @classmethod
    def of(cls, mounts: Mapping[str, Camera | Rig]) -> Self:
        """Mounts by their names."""
        rigs: list[Rig] = []
        names: list[str] = []
        for name, mount in mounts.items():
            own = Rig([mount], [name]) if isinstance(mount, Camera) else mount
            names += [name] if own is not mount else [f"{name}/{each}" for each in own.names]
            rigs.append(own)
        starts = offsets_of([len(each) for each in rigs])
        return cls(tuple(mounts), Rig.of_several(rigs, names), starts)

    @classmethod
    def of_cameras(cls, rig: Rig) -> Self:
        """A mount for each camera, by its name, without its place on the rig.

        Cameras that measure together are one, by the name of the first, with their places.
        """
        joint = [at + row for at, gate in rig.gates.items() for row in range(1, gate.n)]
        starts = np.setdiff1d(np.arange(len(rig) + 1), joint)
        is_alone = np.diff(starts) == 1
        places = rig.rig_from_camera.copy()
        places[starts[:-1][is_alone]] = np.eye(4)
        alone = {rig.names[row] for row in starts[:-1][is_alone]}
        own = with_places(rig, places)._with(fixed=tuple(n for n in rig.fixed if n not in alone))
        return cls(tuple(rig.names[row] for row in starts[:-1]), own, starts)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def has_rigs(self) -> bool:
        """True where a mount is more than one camera at its origin."""
        places = self.rig.rig_from_camera
        return len(self) < len(self.rig) or not np.array_equal(
            places, np.broadcast_to(np.eye(4), places.shape)
        )

    def first_camera(self, index: int) -> Camera:
        """First camera of a mount, by which its candidates are framed."""
        return self.rig.cameras[int(self.starts[index])]

    def cameras(self, placed: Poses) -> tuple[Poses, IntArray]:
        """All cameras of mounts in P poses, in their order, and the row of the pose of each."""
        if not self.has_rigs:
            return placed, np.arange(len(placed))
        placed.check_cameras(len(self))
        counts = np.diff(self.starts)[placed.camera]
        owner = owners_of(counts)
        camera = self.starts[placed.camera[owner]] + places_on_rigs(owner)
        matrices = self.rig._place(placed.world_from_camera[owner], camera)
        return Poses.of(matrices, camera=camera), owner

    def mounted(self, cameras: Poses) -> tuple[Poses, IntArray]:
        """Mounts of cameras, with the ids of their first ones, and the row of each camera's mount.

        PoseError unless the cameras of a rig come in its order, to 1e-6 at their places on it.
        """
        mounts = np.searchsorted(self.starts, cameras.camera, "right").astype(np.int32) - 1
        leads = cameras.camera == self.starts[mounts]
        matrices = self.rig._rigs(movers(self.rig, cameras))[leads]
        placed = replace(cameras[leads], world_from_camera=matrices, camera=mounts[leads])
        every, owner = self.cameras(placed)
        if not np.array_equal(every.camera, cameras.camera) or not np.allclose(
            every.world_from_camera, cameras.world_from_camera, 1e-6, 1e-6
        ):
            raise PoseError(
                "expected all cameras of a rig in its order, at their places on it, got others; "
                "write them as rastercov place does"
            )
        return placed, owner

    def place(self, views: Views) -> Poses:
        """Poses of mounts that a file names; PoseError for other names, or none."""
        if not views.camera_names:
            known = first_of(self.names, MOST_NAMES)
            raise PoseError(
                f"expected the camera or rig of each pose, one of {known}, got none; add "
                '"camera" to the pose file, a list of names'
            )
        firsts = [self.first_camera(row) for row in range(len(self))]
        return views.with_cameras(Rig(firsts, self.names)).poses

    def eyes(self, placed: Poses) -> FloatArray:
        """(P, 3) points that mounts in P poses see from, of rigs by the first camera, metres."""
        firsts = Poses.of(placed.world_from_camera, camera=self.starts[placed.camera])
        return eyes_of(self.rig, firsts)

    def rows(self, cameras: Poses, owner: IntArray) -> IntArray:
        """Row in `owner` of each row of the result of the cameras of `cameras`."""
        return owner[led_by(self.rig, cameras)]

    @property
    def width(self) -> int:
        """Most rows of the result of a mount: its cameras, or one by a rule."""
        counts = np.diff(self.starts)
        counts[np.isin(self.starts[:-1], list(self.rig.gates))] = 1
        return int(counts.max())

    def unite(self, lists: Lists, owner: IntArray, n: int) -> Lists:
        """Lists of n mounts from those of their cameras: what any of these has, in order."""
        if not self.has_rigs:
            return lists
        ends = np.searchsorted(owner, np.arange(n + 1)).tolist()
        rows = []
        for first, last in pairwise(ends):
            own = lists.items[lists.starts[first] : lists.starts[last]]
            rows.append(own if last - first == 1 else np.unique(own))
        return Lists.of(rows)
