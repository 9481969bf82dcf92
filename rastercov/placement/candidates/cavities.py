"""Candidates for faces that no other candidate covers, along the directions that are open there.

Serves faces that `uncovered` finds. From the centroid of each face, and from three more points
where that finds nothing, a hemicube measures the free distance in all directions. A direction is
open where nothing blocks it up to the least distance of a camera; cameras are placed along the best
open directions, at the nearest allowed distance at which the face is in view. A face without an
open direction, or without an allowed position, is reported as out of reach: proved where possible
(`Enclosure`), and else with the width of an opening that cannot have been missed.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, section 7.3.

Hemicube over a point of a face: free distance in every direction of the half space. A rasteriser at
the point renders along the normal and to four sides: the upper half of a cube of images, whose
pixel centres are the directions. On a face of the cube samples are 2 / N apart and no point is
farther than sqrt(2) / N from one, so that a cone whose half angle is

    rho = 2 asin(sqrt(2) / (2 N))

or more, about a direction above the horizon, holds a sample: no opening of that width is missed.

M. F. Cohen, D. P. Greenberg. The Hemi-Cube: A Radiosity Solution for Complex Environments. 1985.

Open directions of one side of a face: from the face and a hemicube, a few promising rays, each with
the interval of distances within which nothing blocks it and the whole face is in view.

Proof that no camera within its limits can see a face: it faces solid or an enclosed space. A closed
surface divides space into regions of equal winding number, and a camera that sees a point is in the
region of that point, because no surface is between them. Where the region in front of a face is
solid, or is bounded and within a box that the limits of a camera exclude, the face is out of reach;
no sampling is involved. The argument requires the same winding number all over the face, that is,
that no closed surface crosses it; this is tested.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    AnyArray,
    BoolArray,
    ByName,
    ByteArray,
    Closing,
    ConfigError,
    FloatArray,
    IntArray,
    arcsin,
    cos,
    frozen_record,
    image_side,
    matmul,
    norm,
    percent,
    plural,
    sort_order,
)
from rastercov.base.typed import typed
from rastercov.core.camera import Camera, box_corners, look_at
from rastercov.core.camera.viewpoints import half_angles
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import frozen, matrices_of
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.solids import Winding, closed_parts, matter_of
from rastercov.core.raster.cpu import CPURasterizer
from rastercov.engine import base_rounded, mesh_clearance
from rastercov.placement.candidates.pool import (
    DEFAULT,
    Candidates,
    Framing,
    face_rows,
    fit_vertices,
    roll_candidates,
    roll_frames,
)
from rastercov.placement.candidates.rooms import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    Place,
    check_clearance,
    filter_candidates,
)
from rastercov.shards import Progress, silent

LIFT_REL = 1e-6
"""Height of the camera above its face, relative to the mesh's diagonal."""


class Hemicube(Closing):
    """Rasteriser of the five images; use it in a `with` block.

    Attributes
    ----------
    directions : (D, 3) float64
        Unit vectors in the axes of a face, z along its normal; D = 3 N^2.
    solid_angles : (D,) float64
        Solid angle of the pixel of each, steradians; their sum is 2 pi.
    missed : float
        Half angle of a cone that certainly holds a direction, radians.
    """

    def __init__(self, mesh: Mesh, side: int) -> None:
        half = image_side("side", side) / 2
        self.side = side
        self.missed = 2 * arcsin(math.sqrt(2) / (2 * side))
        self._lift = LIFT_REL * mesh.diagonal
        self._rasterizer = CPURasterizer(
            mesh, Camera(width=side, height=side, fx=half, fy=half, cx=half, cy=half)
        )
        sides = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)])
        # (5, 3, 3), as columns, in those of a face: along the normal, and to four sides.
        self._axes = np.concatenate((np.eye(3)[None], look_at(np.zeros(3), sides)[:, :3, :3]))
        step = (np.arange(side) + 0.5 - half) / half
        y, x = np.meshgrid(step, step, indexing="ij")
        rays = np.stack((x, y, np.ones_like(x)), axis=-1)
        every = matmul(rays, self._axes.transpose(0, 2, 1)[:, None])
        # The horizon lies between two rows of pixels and halves four of the images exactly.
        self._is_above = every[..., 2] > 0
        length = np.broadcast_to(norm(rays), self._is_above.shape)
        self._stretch = length[self._is_above]
        self.directions = every[self._is_above] / self._stretch[:, None]
        self.solid_angles = 1 / self._stretch**2 / self._stretch
        self.solid_angles *= 2 * math.pi / self.solid_angles.sum()

    def free_distances(self, points: FloatArray, frames: FloatArray) -> FloatArray:
        """(N, D) metres to the first surface in each direction, inf where there is none.

        Parameters
        ----------
        points : (N, 3) float64
            Points on faces.
        frames : (N, 3, 3) float64
            Their axes as columns, the third the normal.
        """
        eyes = points + self._lift * frames[:, :, 2]
        poses = matrices_of(matmul(frames[:, None], self._axes), eyes[:, None]).reshape(-1, 4, 4)
        depth = self._rasterizer.render_all(poses).depth.reshape(-1, *self._is_above.shape)
        return depth[:, self._is_above] * self._stretch

    def blur(self, values: FloatArray, reach: int) -> FloatArray:
        """(D,) mean over the (2 reach + 1)^2 nearest pixels of the same image."""
        sums = np.zeros((2, *self._is_above.shape))
        sums[0, self._is_above], sums[1] = values, self._is_above
        place = np.arange(self.side)
        for axis in (2, 3):
            total = np.insert(np.cumsum(sums, axis), 0, 0.0, axis)
            last, first = np.minimum(place + reach + 1, self.side), np.maximum(place - reach, 0)
            sums = total.take(last, axis) - total.take(first, axis)
        total, count = sums[:, self._is_above]
        return np.asarray(total / count)

    def close(self) -> None:
        """Close the rasteriser."""
        self._rasterizer.close()


def face_frames(normals: FloatArray) -> FloatArray:
    """(N, 3, 3) right-handed axes whose third columns are unit normals (N, 3)."""
    return look_at(-normals, np.zeros(3))[:, :3, :3]


INSET = 0.5
"""Relative position of three more points of a face, from the centroid towards each corner."""
STEPS = 8
"""Number of distances tried along a direction, from the nearest that frames the face."""
APART_DEG = 15.0
"""Least angle between two views of a face."""
FIRST_RAYS, MORE_RAYS = 8, 256
"""Directions tried for a face, and further ones where no position on those is allowed."""
FARTHEST = 2.0
"""Greatest distance relative to the mesh's diagonal, where nothing else limits it."""


class OpenDirections:
    """Search for open directions in front of one side of a face.

    Attributes
    ----------
    proof : str
        Reason why no camera can see it, "" without a proof.
    n_points, n_directions, open_share, missed_deg, n_places
        As in `Openings`.
    rays : (M, 8) float64 or None
        Origin, direction, nearest and farthest distance; the best first. None where no direction
        is open.
    n_first : int
        Number of rays to try first.
    poses : list of (4, 4) float64
        Poses at allowed positions.
    """

    def __init__(
        self, mesh: Mesh, camera: Camera, framing: Framing, clearance: float, face: int, sign: float
    ) -> None:
        self.camera, self.framing, self.clearance, self.face = camera, framing, clearance, face
        self.limits = framing.limits(camera)
        self.normal: FloatArray = sign * mesh.normals[face]
        self.target: FloatArray = mesh.centroids[face]
        self.corners: FloatArray = mesh.vertices[mesh.faces[face]]
        self.reach = FARTHEST * mesh.diagonal
        self.proof = ""
        self.n_points, self.n_directions, self.n_places = 0, 0, 0
        self.open_share, self.missed_deg = 0.0, 0.0
        self.rays: FloatArray | None = None
        self.n_first = 0
        self.poses: list[FloatArray] = []

    def origins(self, n_points: int) -> FloatArray:
        """(n_points, 3) points of the face: the centroid, and three towards the corners."""
        inset = self.target + INSET * (self.corners - self.target)
        return np.concatenate((self.target[None], inset))[:n_points]

    def search(self, hemicube: Hemicube, frame: FloatArray, free: FloatArray) -> None:
        """Find the open directions, and rank the rays to try.

        `free`, (n_points, D), are the free distances at the first `origins`.
        """
        origins = self.origins(len(free))
        is_open = free > self.limits[0]
        self.n_points, self.n_directions = len(free), len(hemicube.directions)
        self.missed_deg = math.degrees(2 * hemicube.missed)
        if not is_open.any():
            return
        self.open_share = float(matmul(is_open, hemicube.solid_angles).max() / (2 * np.pi))
        # Rank: open from all points of the face, within a wide opening, close to the normal.
        share = is_open.mean(axis=0)
        wide = sum(hemicube.blur(share, max(1, hemicube.side // n)) for n in (32, 8))
        score = share * wide * hemicube.directions[:, 2]
        order = sort_order(-score)
        order = order[share[order] > 0]
        chosen = far_apart(hemicube.directions, order, FIRST_RAYS)
        more = order[:: max(1, len(order) // MORE_RAYS)]
        picks = np.concatenate((chosen, more))
        point = is_open[:, picks].argmax(axis=0)
        self.rays = np.empty((len(picks), 8))
        self.rays[:, :3] = origins[point]
        self.rays[:, 3:6] = matmul(hemicube.directions[picks], frame.T)
        self.rays[:, 6] = self._nearest(self.rays[:, 3:6])
        top = np.minimum(self.limits[1], np.maximum(self.reach, 2 * self.rays[:, 6]))
        self.rays[:, 7] = np.minimum(top, free[point, picks] - self.clearance)
        self.n_first = len(chosen)

    def _nearest(self, directions: FloatArray) -> FloatArray:
        """(M,) distance from which the whole face is in view for every roll."""
        camera, framing = self.camera, self.framing
        upright = look_at(directions, np.zeros(3), framing.up)[:, :3, :3]
        frames = roll_frames(upright, framing.rolls_deg)
        starts = np.arange(len(directions))
        seen = matmul(self.corners - self.target, frames).swapaxes(0, 1)
        distances = [fit_vertices(camera, framing, of_roll, starts) for of_roll in seen]
        return np.maximum(np.max(distances, axis=0), self.limits[0])

    def eyes(self, rays: slice) -> tuple[FloatArray, IntArray]:
        """(N, 3) positions along some of the rays, nearest first, and the ray of each."""
        if self.rays is None:
            return np.zeros((0, 3)), np.zeros(0, np.int64)
        chosen = self.rays[rays]
        fits = np.flatnonzero(chosen[:, 7] >= chosen[:, 6])
        distance = np.empty((len(fits), STEPS))
        base_rounded.fill_steps(chosen[fits, 6], chosen[fits, 7], distance)
        eyes = chosen[fits, None, :3] + distance[..., None] * chosen[fits, None, 3:6]
        eyes = eyes.reshape(-1, 3)
        # Rays may start off the centroid, to which the limits refer.
        away = norm(eyes - self.target)
        tolerance = 1e-9 * away
        within = away >= self.limits[0] - tolerance
        within &= away <= self.limits[1] + tolerance
        return eyes[within], np.repeat(fits, STEPS)[within]


def far_apart(directions: FloatArray, order: IntArray, most: int) -> IntArray:
    """First directions of an order, each at least `APART_DEG` apart from those before it."""
    chosen: list[int] = []
    left = order
    while len(left) and len(chosen) < most:
        chosen.append(int(left[0]))
        left = left[matmul(directions[left], directions[left[0]]) < cos(math.radians(APART_DEG))]
    return np.array(chosen, np.int64)


RIM_WIDTH_REL = 1e-3
"""Relative width of the rim of a face that is left out of the proof, to exclude its neighbours."""


class Enclosure:
    """Closed surfaces of a mesh, for proofs that a face is enclosed.

    Parameters
    ----------
    least : float
        Least distance from a camera centre to the centroid of the face it sees, metres.
    clearance : float
        Least distance from a camera centre to any surface, metres.
    keep_out : sequence of KeepOut
        Boxes and spheres count here, because they are convex; others do not.
    """

    def __init__(
        self, mesh: Mesh, least: float, clearance: float, keep_out: Sequence[KeepOut]
    ) -> None:
        self.mesh, self.least, self.clearance = mesh, least, clearance
        self.keep_out = [v for v in keep_out if isinstance(v, KeepOutBox | KeepOutSphere)]
        self._middle = mesh.centre
        self._lift = LIFT_REL * mesh.diagonal
        # Targets enclose nothing.
        self._parts = closed_parts(mesh.opaque)
        self._boxes = self._parts.boxes - self._middle
        rows = self._parts.faces[~mesh.opaque.degenerate_mask[self._parts.faces]]
        around, faces = mesh.opaque.vertices - self._middle, mesh.opaque.faces[rows]
        self._surface = TriangleTree.over(around, faces) if len(rows) else None

    def proofs(self, faces: IntArray, normals: FloatArray) -> list[str]:
        """Reason for each face why no camera can see it from the side of its normal, or "".

        `faces` is (N,); `normals`, (N, 3), are their own, or the opposite for the back of a
        two-sided face.
        """
        result = [""] * len(faces)
        if self._surface is None:
            return result
        corners = self.mesh.vertices[self.mesh.faces[faces]] - self._middle
        centres = corners.mean(axis=1)
        raised = centres[:, None] + (1 - RIM_WIDTH_REL) * (corners - centres[:, None])
        raised += self._lift * normals[:, None]
        points = raised.mean(axis=1)
        for row in np.flatnonzero(matter_of(self.mesh).encloses(points + self._middle)):
            result[row] = "solid material covers it"
        for part, box in enumerate(self._boxes):
            beyond = np.maximum(box[0] - points, points - box[1]).max(axis=1)
            # Tens of microseconds each.
            rows = [row for row in np.flatnonzero(beyond <= self._lift) if not result[row]]
            why = {row: self._exclude(box, centres[row]) for row in rows}
            rows = [row for row in rows if why[row]]
            if rows:
                of_part = self._parts.faces[self._parts.starts[part] : self._parts.starts[part + 1]]
                about = points[rows] + self._middle
                turns = Winding(self.mesh.opaque, of_part).numbers(about)
                for row in np.array(rows)[turns != 0]:
                    result[row] = why[row]
        return [
            why if why and not self._is_crossed(raised[row]) else ""
            for row, why in enumerate(result)
        ]

    def _exclude(self, box: FloatArray, target: FloatArray) -> str:
        """Reason why no camera can be in a closed space within a box, (2, 3); "" for none."""
        ends = box_corners(box)
        deep = float(norm(ends - target).max())
        if self.least > deep:
            return (
                f"the enclosed space in front of it ends within {deep:.3g} m, and cameras are at "
                f"least {self.least:.3g} m away"
            )
        narrow = float(np.ptp(box, axis=0).min())
        if self.clearance > narrow / 2:
            return (
                f"the enclosed space in front of it is at most {narrow:.3g} m wide, and cameras "
                f"keep a clearance of {self.clearance:.3g} m"
            )
        for volume in self.keep_out:
            if volume.contains(ends + self._middle).all():
                return f"keep-out volume {volume.name} contains the enclosed space in front of it"
        return ""

    def _is_crossed(self, triangle: FloatArray) -> bool:
        """True where a face of the closed surfaces cuts a triangle, (3, 3)."""
        assert self._surface is not None
        own, apart = TriangleTree.over(triangle, np.arange(3)[None]), np.array([self._lift])
        both = self._surface.corners, self._surface.nodes, own.corners, own.nodes
        mesh_clearance.distances(*both, np.eye(4)[None], apart)
        return bool(apart[0] <= 0)


PLACES_AT_ONCE = 20_000
DIRECTIONS_AT_ONCE = 1 << 21
"""Free distances in memory: 32 MB with the pictures that they are from."""

Vector = tuple[float, float, float]
Allowed = Callable[[FloatArray], BoolArray]
"""Mask of the poses at positions where a camera can be mounted."""


class Access(IntEnum):
    """Accessibility of a face for cameras.

    ENCLOSED: proved that no camera within its limits can see the face. CLOSED: no sampled direction
    is open. NO_ROOM: directions are open, but no allowed position was found along them. REACHED:
    candidates were made.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Access, Framing, openings
    >>> mesh, camera = rc.shapes.teapot(5), rc.Camera.preset("icube-ns4133bu-8mm")
    >>> result = openings(mesh, camera, Framing(stand_off=(0.3, 0.8)), faces=[0, 1])
    >>> [Access(each).name for each in result.access]
    ['REACHED', 'REACHED']
    """

    ENCLOSED = 0
    """Proved: a camera that sees it would be inside a solid, or in a closed space outside of the
    limits of positions."""
    CLOSED = 1
    """No sampled direction is open."""
    NO_ROOM = 2
    """Directions are open, but no allowed position was found along them."""
    REACHED = 3
    """Candidates were made."""


@frozen_record
class Openings:
    """Accessibility of N faces; a two-sided face counts with its better side.

    Attributes
    ----------
    face : (N,) int64
        The faces; faces without area are left out.
    access : (N,) uint8
        `Access` of each face.
    points, directions : (N,) int64
        Number of sampled points of the face, 0 if there is a proof, and of directions from each.
    open_share : (N,) float64
        Open share of the half space in front of the face, at the point where it is largest.
    missed_deg : (N,) float64
        Full angle of the smallest cone of open directions that these samples cannot miss, degrees.
    least : float
        Minimum distance from a camera to the face, metres, up to which open directions are free.
        All results are for cameras at this distance or more.
    places : (N,) int64
        Number of positions tried.
    proof : tuple of str
        Reason why the face is out of reach, "" without a proof.
    candidates : Candidates
        Candidates at allowed positions; their source is "cavity", and `index` the face.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, openings
    >>> mesh, camera = rc.shapes.teapot(5), rc.Camera.preset("icube-ns4133bu-8mm")
    >>> result = openings(mesh, camera, Framing(stand_off=(0.3, 0.8)), faces=[0, 1])
    >>> result.access.tolist()
    [3, 3]
    """

    face: IntArray
    access: ByteArray
    points: IntArray
    directions: IntArray
    open_share: FloatArray
    missed_deg: FloatArray
    least: float
    places: IntArray
    proof: tuple[str, ...]
    candidates: Candidates

    def words(self, row: int) -> str:
        """One sentence on the face in a row."""
        face, access = f"Face {self.face[row]}", self.access[row]
        if access == Access.ENCLOSED:
            return f"{face} is visible to no permitted camera (proved): {self.proof[row]}."
        if access == Access.CLOSED:
            far = f" for {self.least:.3g} m" if self.least else ""
            return (
                f"{face} has no unobstructed direction{far} among {self.directions[row]:,} from "
                f"each of {self.points[row]} points: open cones are narrower than "
                f"{self.missed_deg[row]:.2g}°."
            )
        share = f"{percent(self.open_share[row])} of the half space in front of it is open"
        if access == Access.NO_ROOM and not self.places[row]:
            return f"{face}: {share}, but not far enough to have the face in view."
        if access == Access.NO_ROOM:
            return f"{face}: {share}, but no camera fits at any of {self.places[row]:,} places."
        count = int((self.candidates.index == self.face[row]).sum())
        return f"{face}: {share}; {plural(count, 'candidate')}."

    def summary(self) -> ByName:
        """Counts, ready for JSON."""
        shut = self.access == Access.CLOSED
        return {
            "faces": len(self.face),
            **{each.name.lower(): int((self.access == each).sum()) for each in Access},
            "missed_deg": float(self.missed_deg[shut].max(initial=0.0)),
            "candidates": len(self.candidates),
        }


@typed
def openings(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    faces: ArrayLike,
    clearance: float = 0.0,
    keep_out: Sequence[KeepOut] = (),
    views: int = 3,
    side: int = 32,
    finest: int = 256,
    progress: Progress = silent,
) -> Openings:
    """Candidates for each face along its open directions, and its accessibility.

    A direction is open if nothing blocks it up to the minimum distance that `Framing.stand_off` and
    the depth of field allow. Along it, a camera is at the distance of `fit="vertices"`, or at the
    next of 8 larger ones with an allowed position. Distances are from the camera centre to the
    centroid of the face. Views of one face differ by 15 degrees or more.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Stand-off, margin, rolls and up of the candidates.
    faces : (F,) bool or (N,) int array_like
        Mask or indices of the faces to see, such as those that no candidate sees.
    clearance, keep_out
        Constraints on positions, as for `filter_candidates`.
    views : int
        Maximum number of candidates per face, times the rolls of `framing`.
    side, finest : int
        Pixels along each side of the hemicube of directions, even numbers: for all faces, and for
        those that seem closed.
    progress : callable, optional
        Called with the number of faces done and the total.

    Raises
    ------
    ConfigError
        For a value outside its range, or limits that exclude each other.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, openings
    >>> mesh, camera = rc.shapes.teapot(5), rc.Camera.preset("icube-ns4133bu-8mm")
    >>> result = openings(mesh, camera, Framing(stand_off=(0.3, 0.8)), faces=[0, 1])
    >>> len(result.candidates), result.words(0)
    (6, 'Face 0: 29.7 % of the half space in front of it is open; 3 candidates.')
    """
    rows = face_rows(mesh, faces)
    rows = rows[~mesh.degenerate_mask[rows]]
    if views < 1 or side < 2 or side % 2 or finest % 2:
        raise ConfigError(
            f"expected views of 1 or more, even side and finest, got {views}, {side}, {finest}; "
            "correct them"
        )
    least = framing.limits(camera)[0]
    half_angles(camera)  # raises for a camera that cannot be aimed
    two_sided = mesh.two_sided_mask[rows]
    owner = np.concatenate((np.arange(len(rows)), np.flatnonzero(two_sided)))
    sign = np.repeat([1.0, -1.0], [len(rows), int(two_sided.sum())])
    n_sites = len(owner)
    check_clearance(clearance)
    sites = [
        OpenDirections(mesh, camera, framing, clearance, int(rows[o]), s)
        for o, s in zip(owner, sign, strict=True)
    ]
    enclosure = Enclosure(mesh, least, clearance, keep_out)
    normals = np.array([site.normal for site in sites]).reshape(-1, 3)
    for site, proof in zip(sites, enclosure.proofs(rows[owner], normals), strict=True):
        site.proof = proof
    levels = [(side, 1), (side, 4)] + ([(finest, 4)] if finest > side else [])
    waiting = [site for site in sites if not site.proof]
    done = n_sites - len(waiting)
    for level in levels:
        if not waiting:
            break
        with Hemicube(mesh, level[0]) as hemicube:
            closed: list[OpenDirections] = []
            for site in _search_directions(hemicube, waiting, level[1]):
                if site.rays is None and level != levels[-1]:
                    closed.append(site)
                else:
                    done += 1
                    progress(done, n_sites)
            waiting = closed
    progress(n_sites, n_sites)

    def is_allowed(poses: FloatArray) -> BoolArray:
        candidates = Candidates.of(poses, "cavity")
        place = filter_candidates(candidates, mesh, clearance, keep_out)[1]
        return np.asarray(place == Place.ALLOWED)

    _place([site for site in sites if site.rays is not None], is_allowed, framing.up, views)
    return _gather_openings(rows, owner, sites, framing, least)


def _search_directions(
    hemicube: Hemicube, sites: Sequence[OpenDirections], n_points: int
) -> Iterator[OpenDirections]:
    """Search `n_points` of each site, and yield it."""
    at_once = max(1, DIRECTIONS_AT_ONCE // (n_points * len(hemicube.directions)))
    for start in range(0, len(sites), at_once):
        some = sites[start : start + at_once]
        frames = face_frames(np.array([site.normal for site in some]))
        points = np.concatenate([site.origins(n_points) for site in some])
        free = hemicube.free_distances(points, np.repeat(frames, n_points, axis=0))
        for site, frame, of_site in zip(
            some, frames, free.reshape(len(some), n_points, -1), strict=True
        ):
            site.search(hemicube, frame, of_site)
            yield site


def _place(sites: Sequence[OpenDirections], allowed: Allowed, up: Vector, views: int) -> None:
    """Find allowed poses for each site, on the first rays before the others."""
    for is_first, n_rays in ((True, FIRST_RAYS), (False, MORE_RAYS)):
        left, at_once = [s for s in sites if not s.poses], PLACES_AT_ONCE // (n_rays * STEPS)
        for start in range(0, len(left), at_once):
            _classify(left[start : start + at_once], is_first, allowed, up, views)


def _classify(
    sites: Sequence[OpenDirections], is_first: bool, allowed: Allowed, up: Vector, views: int
) -> None:
    """Keep the nearest allowed position on each of the first rays of some sites, or the others."""
    rays = [slice(s.n_first) if is_first else slice(s.n_first, None) for s in sites]
    result = [site.eyes(part) for site, part in zip(sites, rays, strict=True)]
    ends = np.cumsum([len(eyes) for eyes, _ in result])
    if not ends[-1]:
        return
    targets = np.repeat([site.target for site in sites], np.diff(ends, prepend=0), axis=0)
    poses = look_at(np.concatenate([eyes for eyes, _ in result]), targets, up)
    is_allowed = allowed(poses)
    for site, (eyes, ray), end in zip(sites, result, ends.tolist(), strict=True):
        site.n_places += len(eyes)
        rows = np.flatnonzero(is_allowed[end - len(eyes) : end])
        _, nearest = np.unique(ray[rows], return_index=True)
        good = poses[end - len(eyes) + rows[nearest]]
        chosen = far_apart(-good[:, :3, 2], np.arange(len(good)), views)
        site.poses = list(good[chosen])


def _gather_openings(
    rows: IntArray, owner: IntArray, sites: Sequence[OpenDirections], framing: Framing, least: float
) -> Openings:
    """Openings of the faces, each with its better side."""
    of_face: list[list[OpenDirections]] = [[] for _ in rows]
    for row, site in zip(owner.tolist(), sites, strict=True):
        of_face[row].append(site)
    chosen = [max(both, key=_access) for both in of_face]
    poses = [[pose for site in both for pose in site.poses] for both in of_face]
    upright = np.array([pose for own in poses for pose in own]).reshape(-1, 4, 4)
    index = np.repeat(rows, [len(own) for own in poses])

    def column(name: str, kind: type) -> AnyArray:
        return frozen(np.array([getattr(site, name) for site in chosen], kind))

    return Openings(
        face=frozen(rows),
        access=frozen(np.array([_access(site) for site in chosen], np.uint8)),
        points=column("n_points", np.int64),
        directions=column("n_directions", np.int64),
        open_share=column("open_share", np.float64),
        missed_deg=column("missed_deg", np.float64),
        least=least,
        places=column("n_places", np.int64),
        proof=tuple(site.proof for site in chosen),
        candidates=roll_candidates(upright, "cavity", index, framing),
    )


def _access(site: OpenDirections) -> Access:
    if site.proof:
        return Access.ENCLOSED
    if site.rays is None:
        return Access.CLOSED
    return Access.REACHED if site.poses else Access.NO_ROOM
