"""Visible fraction of each face in each pose, without other figures."""

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import ByteArray, FloatArray, InOneLine, frozen_record
from rastercov.core.camera import Cameras, Poses
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.core.coverage.engine import Engine
from rastercov.core.coverage.observer import open_observer
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import RasterizerInfo

FRACTION = "visibility", "visibility_bound", "visibility_kind"
"""Its fields of `Coverage`."""


@frozen_record(repr=False)
class Visibility(InOneLine):
    """Visible fraction of each face in each pose.

    Attributes
    ----------
    value : (P, F) float64
        Visible fraction of the part inside the image, [0, 1]: 1 - occlusion. 0 for back-facing
        faces, and for faces whose image is empty to within rounding error or has no sample, where
        `bound` is 1: their visibility is unknown.
    bound : (P, F) float64
        Largest error of `value`.
    kind : (P, F) uint8
        `rastercov.BoundKind` of each bound.
    info : RasterizerInfo
        Method and device that computed it.

    Examples
    --------
    >>> import rastercov as rc
    >>> vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    >>> low = rc.Mesh(vertices, [(0, 1, 2), (0, 2, 3)])
    >>> high = low.moved(scale=0.5, translation=(0.25, 0.25, 0.5))
    >>> mesh = rc.Mesh.joined([low, high], ["low", "high"])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> observation = rc.visibility(mesh, camera, rc.look_at((0.5, 0.5, 5), (0.5, 0.5, 0)))
    >>> observation.value.round(3).tolist(), bool(observation.bound.max() < 1e-6)
    ([[0.691, 0.691, 1.0, 1.0]], True)
    """

    value: FloatArray
    bound: FloatArray
    kind: ByteArray
    info: RasterizerInfo


def visibility(
    mesh: Mesh,
    camera: Cameras,
    poses: ArrayLike | Poses,
    method: str | Engine = "certified",
    *,
    threads: int | None = None,
) -> Visibility:
    """Visible fraction of each face in each pose, with its error bound, as by `rastercov.evaluate`.

    `poses` are (P, 4, 4) world_from_camera, or `Poses`; the other arguments are those of
    `open_observer`, and errors those of `Observer.observe`.

    Examples
    --------
    >>> import rastercov as rc
    >>> vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    >>> low = rc.Mesh(vertices, [(0, 1, 2), (0, 2, 3)])
    >>> high = low.moved(scale=0.5, translation=(0.25, 0.25, 0.5))
    >>> mesh = rc.Mesh.joined([low, high], ["low", "high"])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> observation = rc.visibility(mesh, camera, rc.look_at((0.5, 0.5, 5), (0.5, 0.5, 0)))
    >>> observation.value.round(3).tolist()  # two faces partly hidden, two fully visible
    [[0.691, 0.691, 1.0, 1.0]]
    """
    with open_observer(mesh, camera, method, threads=threads) as observer:
        batches = list(evaluate_batches(observer, poses, fields=FRACTION))
        value, bound, kind = (
            np.concatenate([getattr(each, name) for each in batches]) for name in FRACTION
        )
        return Visibility(value, bound, kind, observer.info)
