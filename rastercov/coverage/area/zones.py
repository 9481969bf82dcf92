"""Dead zones: connected parts of the task surface that too few cameras cover.

The pieces of a partition with fewer cameras than wanted are connected where they share a part of
their boundary: within a face, and across an edge of the mesh. Faces that meet along a part of an
edge only, as where a vertex lies on the edge of another face, are connected, too.

The reason of a zone is that of most of some points of it, spread evenly over its area: for a point,
the criterion that fails last, in the order of `rastercov.Reason`, in any camera.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base.arguments import checked_array
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import distance as in_metres
from rastercov.base.format import signed
from rastercov.base.memory import BoolArray, FloatArray, Int32Array, IntArray
from rastercov.base.typed import typed
from rastercov.camera.pose import Poses
from rastercov.camera.projection import to_camera
from rastercov.camera.rig import Cameras, cameras_of, gates_of, names_of, rows_of_result
from rastercov.camera.viewpoints import fibonacci_sphere, look_at
from rastercov.coverage.advice import advice, figures_of_point, general_advice, short_of
from rastercov.coverage.area import polygons
from rastercov.coverage.area.failures import failures_of_rows, first_failures
from rastercov.coverage.area.features import device_of
from rastercov.coverage.area.frames import FacePolygons, frames_of, rows_at, to_world
from rastercov.coverage.area.rows import limit_advice, tasks_of
from rastercov.coverage.area.union import Covered, with_rest
from rastercov.coverage.reasons import BASELINE, NAMES, REASONS, UNCERTAIN, Reason
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh
from rastercov.mesh.contacts import TriangleTree
from rastercov.mesh.groups import body_of
from rastercov.mesh.topology import components_of

TOLERANCE_REL = 1e-10
"""Distance of two sides in one plane that are one, relative to the diagonal of the mesh and its
distance from the origin: a hundred times the distance of corners that the union merges."""
LEAST_REL = 1e-8
"""Length of contact from which pieces are connected, relative to the same: a hundred times the
tolerance, so that lines that cross at more than 0.01 rad are not one."""
OPEN_TOLERANCE_REL = 1e-6
"""Distance of open edges that are one: files in float32 have vertices that far from the edge on
which they lie."""
SWEEP = np.array([0.4794, 0.6367, 0.6040])
"""Direction of the sweep in space; the first two, in a plane."""
MOST_ZONES = 100
"""Zones that a summary lists."""
SLIVER_REL = 1e-9
"""Part of the area of the task below which a zone is rounding, and is not listed."""


@dataclass(frozen=True, eq=False, repr=False)
class DeadZones(FacePolygons):
    """Connected parts that too few cameras cover: Z zones, the largest first, of N pieces.

    Attributes
    ----------
    xy, starts, face, views
        The pieces, as in `Covered`.
    zone : (N,) int64
        Zone of each piece.
    area : (Z,) float64
        m^2, descending.
    piece_area : (N,) float64
        m^2.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> covered = rc.unite(rc.regions(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0))))
    >>> zones = rc.dead_zones(covered)
    >>> len(zones), round(zones.places(1)[0]["area_m2"], 6)  # five sides, in one piece
    (1, 0.2)
    """

    views: NDArray[np.int32]
    zone: IntArray
    area: FloatArray
    piece_area: FloatArray

    def __len__(self) -> int:
        return len(self.area)

    @typed
    def places(self, n: int) -> list[dict[str, Any]]:
        """Area, centroid, extent and groups of the first n zones, ready for JSON.

        Groups are named by falling area; `m2_by_views` is the area that exactly 0, 1, ... cameras
        cover.

        Examples
        --------
        >>> import rastercov as rc
        >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
        >>> covered = rc.unite(rc.regions(mesh, camera, rc.look_at((0, 0, 0.6), (0, 0, 0))))
        >>> place = rc.dead_zones(covered).places(1)[0]
        >>> place["groups"], round(place["area_m2"], 6), round(place["percent"], 3)
        (['mesh'], 0.2, 83.333)
        """
        mesh, n = self.mesh, min(max(int(n), 0), len(self.area))
        names = [group.name for group in mesh.groups]
        most_views = int(self.views[self.zone < n].max(initial=0))
        centroids = polygons.centroids(self.xy, self.starts, self.piece_area)
        order = np.argsort(self.zone, kind="stable")
        limits = np.searchsorted(self.zone[order], np.arange(n + 1))
        found = []
        for row, area in enumerate(self.area[:n].tolist()):  # some 0.1 ms each
            own = order[limits[row] : limits[row + 1]]
            face, weight = self.face[own], self.piece_area[own]
            xy, starts = polygons.chosen(self.xy, self.starts, own)
            corners = to_world(mesh, np.repeat(face, np.diff(starts)), xy)
            of_group = np.bincount(mesh.face_group[face], weight, len(names))
            by_views = np.bincount(self.views[own], weight, most_views + 1)
            entry = {
                "area_m2": area,
                "percent": 100 * area / self.total(),
                "centroid": (weight @ to_world(mesh, face, centroids[own]) / area).tolist(),
                "extent": [corners.min(axis=0).tolist(), corners.max(axis=0).tolist()],
                "groups": [names[each] for each in np.argsort(-of_group) if of_group[each] > 0],
                "m2_by_views": by_views.tolist(),
            }
            found.append(entry)
        return found

    def count(self) -> int:
        """Number of zones without those that are rounding."""
        return int((self.area > SLIVER_REL * self.total()).sum())

    def listed(self) -> int:
        """Number of zones that a summary lists: at most `MOST_ZONES`, and none that is rounding."""
        return min(self.count(), MOST_ZONES)

    def others(self) -> dict[str, Any]:
        """Number and area of the zones that a summary does not list."""
        rest, total = self.area[self.listed() :], self.total()
        percent = 100 * float(rest.sum()) / total if total > 0 else 0.0
        return {"zones": len(rest), "area_m2": float(rest.sum()), "percent": percent}

    def total(self) -> float:
        """Area of all task faces, m^2."""
        return float(frames_of(self.mesh).areas[self.mesh.task_mask].sum())


def dead_zones(covered: Covered, views: ArrayLike | None = None) -> DeadZones:
    """Connected parts of the task surface that fewer than `views` cameras cover.

    Faces that no camera can ever see, see `rastercov.mesh.unseeable`, are in none of them.

    Parameters
    ----------
    covered : Covered
        What `rastercov.unite` gives.
    views : int, or (F,) int array_like, optional
        Cameras wanted, of all faces or of each, 1 ... k; k of `covered` unless given.

    Raises
    ------
    ConfigError
        For `views` beyond those that `covered` counts.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.2))
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> eyes = [(0, 0, 0.6), (0.6, 0, 0), (-0.6, 0, 0)]
    >>> covered = rc.unite(rc.regions(mesh, camera, rc.look_at(eyes, (0, 0, 0))))
    >>> rc.dead_zones(covered).area.round(4).tolist()  # m^2 of what no camera covers
    [0.12]
    """
    from rastercov.mesh.unseeable import unseeable_where_seen
    from rastercov.native import area_zone as kernels

    mesh, k = covered.mesh, len(covered.area)
    words = f"whole numbers of 1 to {k}, as covered counts them: one, or one a face"
    wanted = checked_array("views", k if views is None else views, "iu", words, ConfigError)
    is_shape = wanted.shape in ((), (mesh.n_faces,))
    if not is_shape or not ((wanted >= 1) & (wanted <= k)).all():
        raise ConfigError(f"views must be {words}, got {shown(views)}")
    wanted = np.broadcast_to(wanted, mesh.n_faces)
    whole = with_rest(covered)
    areas = polygons.polygon_areas(whole.xy, whole.starts)
    frames = frames_of(mesh)
    seen = covered.area[0] / np.maximum(frames.areas, np.finfo(float).tiny)
    is_left = unseeable_where_seen(mesh, seen) == 0
    kept = (whole.views < wanted[whole.face]) & (areas > 0) & is_left[whole.face]
    xy, starts = polygons.chosen(whole.xy, whole.starts, np.flatnonzero(kept))
    face, number, areas = whole.face[kept], whole.views[kept], areas[kept]
    parent = np.arange(len(face))
    if len(face):
        _link(mesh, xy, starts, face, parent)
    root = np.empty_like(parent)
    kernels.find_roots(parent, root)
    _, zone = np.unique(root, return_inverse=True)
    return DeadZones(mesh, xy, starts, face, number, *_largest_first(zone, areas), areas)


def face_zones(mesh: Mesh, why: IntArray, views: IntArray) -> DeadZones:
    """Zones of whole faces that share edges and a reason, where a result is by face.

    Parameters
    ----------
    mesh : Mesh
    why : (F,) int
        Number of the reason of each face, -1 for those of no zone.
    views : (F,) int
        Cameras that cover each face.
    """
    face = np.flatnonzero((why >= 0) & (frames_of(mesh).areas > 0)).astype(np.int32)
    row = np.full(mesh.n_faces, -1)
    row[face] = np.arange(len(face))
    near = row[mesh.topology.neighbours]
    near = near[(near >= 0).all(axis=1)]
    near = near[np.equal(*why[face[near]].T)]
    areas = frames_of(mesh).areas[face]
    ranked = _largest_first(components_of(len(face), near), areas)
    xy, starts = frames_of(mesh).corners[face].reshape(-1, 2), 3 * np.arange(len(face) + 1)
    return DeadZones(mesh, xy, starts, face, views[face].astype(np.int32), *ranked, areas)


def _largest_first(zone: IntArray, areas: FloatArray) -> tuple[IntArray, FloatArray]:
    """Zone of each piece, (N,), numbered by falling area, and the areas of zones."""
    sums: FloatArray = np.asarray(np.bincount(zone, weights=areas), np.float64)
    order = np.argsort(-sums, kind="stable")
    rank: IntArray = np.argsort(order)
    return rank[zone], sums[order]


def zones_at(zones: DeadZones, face: ArrayLike, points: ArrayLike, n: int) -> NDArray[np.int64]:
    """(N,) dead zone of each point of faces (N,): its row, n for the n-th or later, -1 for none.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    face, points
        As for `rastercov.coverage.area.regions.covering_poses`.
    n : int
        Zones that are distinguished.
    """
    row = np.minimum(zones.zone, n).astype(np.int32)
    found = rows_at(zones, row, n + 1, face, points)
    return np.where(found.any(axis=1), found.argmax(axis=1), -1)


def _link(mesh: Mesh, xy: FloatArray, starts: IntArray, face: Int32Array, parent: IntArray) -> None:
    """Link the pieces that are connected, by their parents."""
    from rastercov.native import area_zone as kernels

    frames = frames_of(mesh)
    scale = mesh.diagonal
    scale = max(scale, 2.0**-20 * float(np.abs(mesh.bounds).max()))
    tolerance, least = TOLERANCE_REL * scale, LEAST_REL * scale
    boxes = polygons.boxes(xy, starts)
    interval = np.stack(polygons.extents(xy @ SWEEP[:2], starts), axis=1)
    order = np.lexsort((interval[:, 0], face))
    kernels.link_in_faces(xy, starts, face, boxes, interval, order, tolerance, least, parent)

    side = np.empty(len(xy), np.int64)
    kernels.find_sides(xy, starts, face, np.array(frames.corners), tolerance, side)
    at = np.flatnonzero(side >= 0)
    piece = np.repeat(np.arange(len(face)), np.diff(starts))
    piece_of = piece[at]
    faces, after = face[piece_of].astype(np.int64), polygons.following(starts)[at]
    points = np.stack([to_world(mesh, faces, xy[rows]) for rows in (at, after)], axis=1)
    one, other, is_open = _edges(mesh, faces, side[at])
    edge = one * mesh.n_vertices + other
    start = mesh.vertices[one]
    away = mesh.vertices[other] - start
    away /= np.linalg.norm(away, axis=1)[:, None]
    along_edge = np.einsum("nki,ni->nk", points - start[:, None], away)
    interval = np.sort(along_edge, axis=1)
    order = np.lexsort((interval[:, 0], edge))
    kernels.link_along_edges(edge[order], interval[order], piece_of[order], face, least, parent)

    rows = np.flatnonzero(is_open)
    ends_in_space = points[rows]
    interval = np.sort(ends_in_space @ SWEEP, axis=1)
    order = np.argsort(interval[:, 0], kind="stable")
    kernels.link_in_space(
        ends_in_space[order],
        interval[order],
        piece_of[rows][order],
        face,
        OPEN_TOLERANCE_REL * scale,
        10 * OPEN_TOLERANCE_REL * scale,
        parent,
    )


def _edges(mesh: Mesh, faces: IntArray, side: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Lower and higher vertex of the edges on which sides of pieces lie, and the open ones.

    An edge is open if it is of one face only. Faces without area do not count.
    """
    frames, corners = frames_of(mesh), mesh.welded_faces
    off = mesh.vertices[mesh.faces] - frames.origin[:, None]
    first = np.einsum("fki,fki->fk", off, off).argmin(axis=1)

    def ends(rows: IntArray, sides: IntArray) -> tuple[IntArray, IntArray]:
        from_, to = ((first[rows] + sides + k) % 3 for k in (0, 1))
        a, b = corners[rows, from_], corners[rows, to]
        return np.minimum(a, b), np.maximum(a, b)

    solid = np.flatnonzero(frames.areas > 0)
    low, high = ends(np.repeat(solid, 3), np.tile(np.arange(3), len(solid)))
    keys, uses = np.unique(low * mesh.n_vertices + high, return_counts=True)
    one, other = ends(faces, side)
    is_open = uses[np.searchsorted(keys, one * mesh.n_vertices + other)] == 1
    return one, other, is_open


MOST_POINTS, LEAST_POINTS = 32, 4
"""Points of a zone that are judged; fewer for many cameras."""
PAIRS = 4_000_000
"""Pairs of point and camera up to which there are more than `LEAST_POINTS`: a few seconds."""
ZONES = ("dead_zones", "other_dead_zones")
"""Keys of `summary_of`."""
MOST_NEAREST = 12
"""Poses that are compared for the one that comes nearest to covering a zone."""
PLACES, NEARER = 64, (1.0, 0.7, 0.4)
"""Directions in which a camera is moved around what is hidden from it, and shares of its distance.
"""
MOST_LINES = 5
"""Zones that have a line for people."""
LEAST_PERCENT = 1e-3
"""Part of the task, in percent, from which a zone has one."""


def summary_of(
    zones: DeadZones, camera: Cameras, task: Task, poses: ArrayLike | Poses
) -> dict[str, Any]:
    """`dead_zones`, the largest first, and the sum of all that are not listed.

    A zone has its area, centroid (which may lie off a bent surface), extent, groups by falling
    area, reason, and for "occluded" the group that hides it most often, or None; `nearest`, the
    pose that comes nearest to covering a point of it with its figures, and `advice` for it. Of a
    rig with a rule, `device` is the camera that is missed most, and the pose one of it; of a reason
    of light, the nearest lamp, or the one that is mirrored.

    Parameters
    ----------
    zones : DeadZones
        What the cameras leave.
    camera, task
        Camera or cameras, and thresholds of their regions.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of all cameras.
    """
    n = zones.listed()
    why = _reasons(zones, camera, task, Poses.of(poses), n)
    return {
        "dead_zones": [place | said for place, said in zip(zones.places(n), why, strict=True)],
        "other_dead_zones": zones.others(),
    }


def zone_lines(summary: Mapping[str, Any]) -> list[str]:
    """Lines about the largest zones of a summary, with advice on the first where all is dead."""
    zones = [each for each in summary.get("dead_zones", ()) if each["percent"] >= LEAST_PERCENT]
    lines = [zone_line(zone) for zone in zones[:MOST_LINES]]
    if lines and summary.get("covered_area", {}).get("m2") == 0:
        lines[0] += f"; {zones[0]['advice']}"
    return lines


def zone_line(zone: Mapping[str, Any]) -> str:
    """Line about one zone."""
    size = math.sqrt(zone["area_m2"])
    digits = min(max(0, 1 - math.floor(math.log10(size))), 9)
    at = ", ".join(signed(value, digits) for value in zone["centroid"])
    first, *others = zone_parts(zone)
    more = f" and {len(others)} more" if others else ""
    text = f"dead zone {in_square_metres(zone['area_m2'])} at ({at}) in group {first}{more}: "
    return text + zone_reason(zone)


def zone_parts(zone: Mapping[str, Any]) -> list[str]:
    """Names of what a zone is on, by falling area: groups, or the parts of which they are faces."""
    return list(dict.fromkeys(map(body_of, zone["groups"])))


def zone_reason(zone: Mapping[str, Any]) -> str:
    """Reason of a zone, what hides it, and of a rig with a rule the camera that fails."""
    text, hider = REASONS[zone["reason"]].label, zone["hidden_by"]
    if hider is not None:
        text += f" by {'itself' if body_of(hider) == zone_parts(zone)[0] else body_of(hider)}"
    return text + (f" ({zone['device']})" if zone.get("device") else "")


def _reasons(
    zones: DeadZones, camera: Cameras, task: Task, poses: Poses, n: int
) -> list[dict[str, Any]]:
    """Reason and hiding group of the first n zones."""
    if not len(poses):
        nothing = {"reason": "no_cameras", "hidden_by": None, "nearest": None}
        return [nothing | {"advice": general_advice("no_cameras")}] * n
    if not n:
        return []
    each = int(np.clip(PAIRS // (n * len(poses)), LEAST_POINTS, MOST_POINTS))
    points, piece = points_of(zones, n, each)
    face = zones.face[piece].astype(np.int64)
    is_seen = zones.views[piece] > 0
    reason = np.where(is_seen, Reason.COVERED, Reason.DEGENERATE).astype(np.uint8)
    in_pose = np.full((len(poses), len(points)), Reason.COVERED, np.uint8)
    mesh = zones.mesh
    hidden = np.zeros((len(points), len(mesh.groups)), np.int32)
    rows = np.flatnonzero(~is_seen)
    judged = failures_of_rows(mesh, camera, task, poses, points[rows], face[rows])
    for pose, fails, hidden_by in judged:
        # No camera covers these points: where none of the criteria fails, it is a coincident
        # surface in front, or rounding.
        why = np.where(fails == Reason.COVERED, np.uint8(Reason.OCCLUDED), fails)
        reason[rows] = np.maximum(reason[rows], why)
        in_pose[pose, rows] = why
        at = np.flatnonzero(hidden_by >= 0)
        np.add.at(hidden, (rows[at], mesh.face_group[hidden_by[at]]), 1)
    zone, found, gates, spaces = zones.zone[piece], [], gates_of(camera), _Spaces(mesh)
    for row in range(n):
        of_zone = zone == row
        winner = int(np.bincount(reason[of_zone]).argmax())
        counts = hidden[of_zone & (reason == Reason.OCCLUDED)].sum(axis=0)
        hides = winner == Reason.OCCLUDED and counts.any()
        name = "too_few_views" if winner == Reason.COVERED else NAMES[winner]
        hider = mesh.groups[int(counts.argmax())].name if hides else None
        entry = {"reason": name, "hidden_by": hider}
        of_reason = np.flatnonzero(of_zone & (reason == winner))
        away = points[of_reason] - points[of_reason].mean(axis=0)
        at = of_reason[(away**2).sum(axis=1).argmin()]  # the one in the middle
        failing = np.flatnonzero(in_pose[:, at] == winner)
        if gates and len(failing) and winner < BASELINE:
            of_camera = np.bincount(poses.camera[np.nonzero(in_pose[:, of_reason] == winner)[0]])
            device = int(of_camera.argmax())
            entry["device"] = names_of(camera)[device]
            own_poses = failing[poses.camera[failing] == device]
            failing = own_poses if len(own_poses) else failing
        if name == "occluded" and row < MOST_LINES and len(failing) > 1:
            eyes = poses.world_from_camera[failing, :3, 3]
            failing = failing[spaces.nearest_in_one_space(eyes, points[at], int(face[at]))]
        surface = points[at], frames_of(mesh).normal[face[at]]
        if len(failing) and (name_of := device_of(camera, poses[failing[:1]], *surface, winner)):
            entry["device"] = name_of
        own = mesh.groups[mesh.face_group[face[at]]].name
        before = "" if hider is None else body_of(hider)
        before = "another part of it" if before == body_of(own) else before
        said = _nearest(camera, task, poses[failing], *surface, name, before)
        if winner in (BASELINE, UNCERTAIN) and row < MOST_LINES:
            rows = rows_of_result(camera, poses)
            own_poses = poses[np.isin(rows, rows[failing])]
            on = own_poses, points[of_reason], face[of_reason]
            said["advice"] = (
                limit_advice(failures_of_rows, mesh, camera, task, *on) or said["advice"]
            )
        if name == "occluded" and row < MOST_LINES and said["nearest"]:
            best = poses[np.flatnonzero(poses.ids == said["nearest"]["pose"])]
            sight = where_seen(mesh, camera, task, best, points[at], int(face[at]))
            said["advice"] = sight.format(said["advice"], before or "a surface")
        found.append(entry | said)
    return found


def _nearest(
    camera: Cameras,
    task: Task,
    poses: Poses,
    point: FloatArray,
    normal: FloatArray,
    name: str,
    hider: str,
) -> dict[str, Any]:
    """`advised` for a point, by the nearest `MOST_NEAREST` of poses that fail for one reason."""
    if name.upper() not in Reason.__members__ or not len(poses):
        return {"nearest": None, "advice": general_advice(name)}
    some, cameras = nearest_to(poses, point), cameras_of(camera)
    figures = [
        figures_of_point(cameras[of], pose, point, normal)
        for pose, of in zip(some.world_from_camera, some.camera, strict=True)
    ]
    own = tasks_of(camera, task)
    # Thresholds are compared among poses of one camera, or of the same task.
    row = nearest_row(name, figures, own[some.camera[0]])
    task = own[some.camera[row]]
    return advised(camera, task, some[row : row + 1], figures[row], point[None], name, hider)


def nearest_to(poses: Poses, point: FloatArray) -> Poses:
    """The nearest `MOST_NEAREST` of some poses to a point, in their own order."""
    away = np.linalg.norm(poses.world_from_camera[:, :3, 3] - point, axis=1)
    return poses[np.sort(np.argsort(away, kind="stable")[:MOST_NEAREST])]


def nearest_row(name: str, figures: Sequence[Mapping[str, float]], task: Task) -> int:
    """Row of the figures of the pose that comes nearest to covering, of those of one reason.

    That with the least missing factor, or seen least flatly; the first of equals.
    """

    def missing(row: int) -> float:
        short = short_of(figures[row], task) if name == "too_coarse" else None
        flat = figures[row]["incidence"] if name == "too_oblique" else 0.0
        return short.factor if short else flat

    return min(range(len(figures)), key=missing)


def advised(
    camera: Cameras,
    task: Task,
    pose: Poses,
    figures: Mapping[str, float],
    points: FloatArray,
    name: str,
    hider: str,
) -> dict[str, Any]:
    """`nearest`, a pose with its figures, and `advice` for it to cover points (N, 3)."""
    depth, eye = to_camera(points, pose.world_from_camera[0])[:, 2], cameras_of(camera)
    more = {key: each for key, each in figures.items() if key not in ("distance", "incidence")}
    return {
        "nearest": {
            "pose": int(pose.ids[0]),
            "distance_m": figures["distance"],
            "incidence_deg": math.degrees(figures["incidence"]),
            **more,
        },
        "advice": advice(name, figures, depth, task, eye[pose.camera[0]], hider),
    }


@dataclass(frozen=True, eq=False)
class _Spaces:
    """Spaces of a scene: a wall between two rooms divides them, a crate in a room does not."""

    mesh: Mesh

    @cached_property
    def _tree(self) -> tuple[TriangleTree, IntArray, FloatArray, float]:
        """Tree of what hides, row of each face in it, and middle and size of the scene."""
        mesh = self.mesh
        solid = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
        middle, size = mesh.bounds.mean(axis=0), mesh.diagonal
        row = np.full(mesh.n_faces, -1)
        row[solid] = np.arange(len(solid))
        tree = TriangleTree.over((mesh.vertices - middle) / size, mesh.faces[solid])
        return tree, row, middle, size

    def nearest_in_one_space(self, eyes: FloatArray, point: FloatArray, face: int) -> IntArray:
        """Rows of centres (P, 3) that see a place which sees a point of a face, or of all.

        Of the `MOST_NEAREST` that are nearest to the point, at the places of `where_seen`.
        """
        tree, own, middle, size = self._tree
        away = np.linalg.norm(eyes - point, axis=1)
        near = np.argsort(away, kind="stable")[:MOST_NEAREST]
        n = len(NEARER) * PLACES
        reach = np.multiply.outer(away[near], np.array(NEARER))
        places = point + np.multiply.outer(reach, fibonacci_sphere(PLACES)).reshape(-1, 3)
        ends = np.concatenate([np.broadcast_to(point, places.shape), np.repeat(eyes[near], n, 0)])
        starts = (np.concatenate([places, places]) - middle) / size
        along = (ends - middle) / size - starts
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        but = np.concatenate([np.full(len(places), own[face]), np.full(len(places), -1)])
        hits = tree.first_hits(starts, along / length[:, None], length, but)
        is_one = (hits.reshape(2, len(near), n).max(axis=0) < 0).any(axis=1)
        return near[is_one] if is_one.any() else np.arange(len(eyes))


def where_seen(
    mesh: Mesh, camera: Cameras, task: Task, pose: Poses, point: FloatArray, face: int
) -> str:
    """Advice with the nearest place to which one camera is moved to cover a point that is hidden.

    Of `PLACES` around the point, at each of `NEARER` of its distance, where it looks at the point.
    The text wants what is known without it, and the name of what hides the point.
    """
    eye = pose.world_from_camera[0, :3, 3]
    away = float(np.linalg.norm(eye - point))
    around = np.multiply.outer(away * np.array(NEARER), fibonacci_sphere(PLACES))
    places = point + around.reshape(-1, 3)
    moves = np.linalg.norm(places - eye, axis=1)
    order = np.argsort(moves, kind="stable")
    poses = Poses.of(look_at(places[order], point), camera=pose.camera.repeat(len(order)))
    judged = first_failures(mesh, camera, task, poses, point[None], np.array([face]))
    for row, (reason, _) in zip(order.tolist(), judged, strict=True):
        if reason[0] == Reason.COVERED:
            digits = int(np.clip(2 - math.floor(math.log10(away)), 0, 9))
            place = ", ".join(signed(value, digits) for value in places[row].tolist())
            return f"{{0}}: by {in_metres(float(moves[row]))}, to ({place}) m"
    return f"{{1}} is between, and none of {len(order)} places within {in_metres(away)} covers it"


def points_of(zones: DeadZones, n: int, each: int) -> tuple[FloatArray, IntArray]:
    """Points of the first n zones, the same number of each, and their pieces.

    At equal steps of the area of the triangles that the pieces are fans of.
    """
    pieces = np.flatnonzero(zones.zone < n)
    pieces = pieces[np.argsort(zones.zone[pieces], kind="stable")]
    fans = np.diff(zones.starts)[pieces] - 2
    piece = np.repeat(pieces, fans)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = zones.starts[piece]
    a, b, c = zones.xy[first], zones.xy[first + number + 1], zones.xy[first + number + 2]
    u, v = b - a, c - a
    areas = np.maximum(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], 0.0) / 2
    total = np.cumsum(areas)
    ends = total[np.searchsorted(zones.zone[piece], np.arange(n), side="right") - 1]
    starts = np.concatenate([[0.0], ends[:-1]])
    steps = (np.arange(each) + 0.5) / each
    at = (starts[:, None] + steps * (ends - starts)[:, None]).ravel()
    chosen = np.minimum(np.searchsorted(total, at), len(total) - 1)
    x, y = polygons.even_points(len(at))
    xy = a[chosen] + x[:, None] * u[chosen] + y[:, None] * v[chosen]
    return to_world(zones.mesh, zones.face[piece[chosen]], xy), piece[chosen]
