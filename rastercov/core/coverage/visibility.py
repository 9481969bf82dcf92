"""Visible fraction of each face in each pose, without other figures.

Silhouettes of groups in each image: occluded and truncated shares.

    visible share = visible / silhouette,   truncated share = 1 - inside / silhouette,

areas in px^2, where the silhouette is that of the group alone in an image of three times the width
and height, and `inside` the part of it in the image: `visib_fract` of the BOP benchmark, computed
where that one counts pixels.

T. Hodan et al. BOP: Benchmark for 6D Object Pose Estimation. 2018.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    ByName,
    ByteArray,
    ConfigError,
    FloatArray,
    InOneLine,
    IntArray,
    WholeArray,
    frozen_record,
    sort_order,
)
from rastercov.core.camera import Camera, Cameras, Poses, cameras_of
from rastercov.core.coverage.coverage import evaluate_batches, in_batches, open_observer
from rastercov.core.coverage.task import Engine
from rastercov.core.mesh import Mesh
from rastercov.core.raster.contract import Observation, RasterizerInfo

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


PANORAMA = "equirectangular"
"""Model whose image has all directions, and nothing around it."""


@frozen_record(repr=False)
class GroupViews(InOneLine):
    """Areas of each group in each image, px^2; see `Evaluation.group_views`.

    Attributes
    ----------
    names : (G,) tuple of str
        Groups with faces, except targets.
    pose_ids : (P,) int64
        Row of each pose in the input.
    visible, inside, silhouette : (P, G) float64
        Visible area of the group in the image; area of its silhouette, without other groups, in the
        image; and the same in an image of three times the width and height with the same centre, as
        far as the lens maps rays to pixels.
    bound : (P, G) float64
        Largest error of any of the three.
    """

    names: tuple[str, ...]
    pose_ids: IntArray
    visible: FloatArray
    inside: FloatArray
    silhouette: FloatArray
    bound: FloatArray

    @property
    def visible_share(self) -> FloatArray:
        """(P, G) visible part of the silhouette, [0, 1]; NaN where there is no silhouette."""
        return np.minimum(self._of_silhouette(self.visible), 1.0)

    @property
    def truncated_share(self) -> FloatArray:
        """(P, G) part of the silhouette outside the image, [0, 1]; NaN for no silhouette."""
        return np.maximum(1 - self._of_silhouette(self.inside), 0.0)

    @property
    def share_bound(self) -> FloatArray:
        """(P, G) largest error of either share."""
        return np.minimum(self._of_silhouette(2 * self.bound), 1.0)

    def _of_silhouette(self, area: FloatArray) -> FloatArray:
        none = np.full(area.shape, np.nan)
        return np.divide(area, self.silhouette, none, where=self.silhouette > 0)

    def columns(self) -> ByName:
        """A row for each image and group whose silhouette is not empty, by column."""
        pose, group = np.nonzero(self.silhouette)
        areas = {"visible": self.visible, "inside": self.inside, "silhouette": self.silhouette}
        shares = {
            "visible_share": self.visible_share,
            "truncated_share": self.truncated_share,
            "share_bound": self.share_bound,
        }
        own = {f"{name}_px": area[pose, group] for name, area in areas.items()}
        own |= {"bound_px": self.bound[pose, group]}
        own |= {name: share[pose, group] for name, share in shares.items()}
        names = [self.names[each] for each in group.tolist()]
        return {"pose": self.pose_ids[pose], "group": names} | own


def group_views(mesh: Mesh, camera: Cameras, poses: Poses, engine: Engine) -> GroupViews:
    """Areas of each group in each image.

    Raises
    ------
    ConfigError
        For method "sampled", whose counts of silhouettes have no bound.
    """
    check_groups(engine)
    cameras = cameras_of(camera)
    around = tuple(map(camera_around, cameras))
    rows = [row for row, group in enumerate(mesh.groups) if not group.is_target]
    pairs = zip(rows, places_of(mesh.face_group, np.array(rows)), strict=True)
    members = {row: faces for row, faces in pairs if len(faces)}
    visible, inside, silhouette, bound = np.zeros((4, len(poses), len(members)))
    for at, seen in _observe(mesh, cameras, poses, engine):
        for column, faces in enumerate(members.values()):
            visible[at, column] = seen.visible_pixels[:, faces].sum(axis=1)
            bound[at, column] = seen.area_error[:, faces].sum(axis=1)
    twice, index = np.tile(poses.world_from_camera, (2, 1, 1)), poses.camera
    both = Poses.of(twice, camera=np.append(index, index + len(cameras)))
    for column, faces in enumerate(members.values()):
        used, corners = np.unique(mesh.faces[faces], return_inverse=True)
        alone = Mesh(mesh.vertices[used], corners.reshape(-1, 3))
        areas = np.empty((2, len(both)))
        for at, seen in _observe(alone, (*cameras, *around), both, engine):
            areas[:, at] = seen.visible_pixels.sum(axis=1), seen.area_error.sum(axis=1)
        (inside[:, column], silhouette[:, column]), errors = areas.reshape(2, 2, -1)
        bound[:, column] = np.maximum(bound[:, column], errors.max(axis=0))
    names = tuple(mesh.groups[row].name for row in members)
    return GroupViews(names, poses.ids, visible, inside, silhouette, bound)


def places_of(values: WholeArray, rows: IntArray) -> list[IntArray]:
    """Places (N,) of each of some numbers in an array, in order: all by one sort."""
    flat = values.ravel()
    order = sort_order(flat)
    starts = np.searchsorted(flat, rows, sorter=order)
    stops = np.searchsorted(flat, rows, "right", order)
    return [order[start:stop] for start, stop in zip(starts, stops, strict=True)]


def check_groups(engine: Engine) -> None:
    """Raise ConfigError for a method whose silhouettes have no bound."""
    if engine.method == "sampled":
        raise ConfigError(
            "expected method certified or exact for silhouettes of groups, as in table groups, got "
            "sampled; change the method"
        )


def _observe(
    mesh: Mesh, cameras: Sequence[Camera], poses: Poses, engine: Engine
) -> Iterator[tuple[slice, Observation]]:
    """Observations of some poses after the other, with their rows."""
    done = 0
    with open_observer(mesh, cameras, engine) as observer:
        for some in in_batches(poses, mesh.n_faces, observer.threads):
            yield slice(done, done + len(some)), observer.observe(some)
            done += len(some)


def camera_around(camera: Camera) -> Camera:
    """The camera with its image and as much again on each side of it."""
    if camera.model == PANORAMA:
        return camera
    width, height = camera.width, camera.height
    return replace(
        camera, width=3 * width, height=3 * height, cx=camera.cx + width, cy=camera.cy + height
    )
