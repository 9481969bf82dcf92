"""Dead zones: connected parts of the evaluated surface that too few cameras cover.

The pieces of a partition with fewer cameras than wanted are connected where they share a part of
their boundary, see `rastercov/engine/area/zone.hpp`. A zone ends at creases, where groups end, and
where the reason changes: for a point, the criteria that must be met to cover it, see
`rastercov.core.area.stages`.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    TINY,
    BoolArray,
    ByteArray,
    ConfigError,
    FloatArray,
    Int32Array,
    IntArray,
    check_array,
    check_kind,
    first_of,
    matmul,
    shown,
    sort_order,
)
from rastercov.base.format import area as in_square_metres
from rastercov.base.format import percent_of, text_with_sign
from rastercov.base.typed import typed
from rastercov.core.area import polygons
from rastercov.core.area.advice import general_advice
from rastercov.core.area.features import deviations_of, device_of, limit_advice, measure_at
from rastercov.core.area.polygons import FacePolygons, frames_of, rows_at, to_world
from rastercov.core.area.remedies import ANY, Allowed, Remedies, ZoneSpot
from rastercov.core.area.stages import (
    CodeArray,
    Divided,
    ReasonPieces,
    any_in_front,
    divide_by_reason,
    failures_of_rows,
    gains_of_views,
    passes,
    stages_of,
)
from rastercov.core.area.union import Covered, with_rest
from rastercov.core.camera import (
    Cameras,
    Poses,
    cameras_of,
    gates_of,
    led_by,
    movers,
    names_of,
    rows_of_result,
)
from rastercov.core.coverage.task import (
    BASELINE,
    BITS,
    NO_CAMERAS,
    OWN_CRITERIA,
    REASONS,
    TOO_FEW_VIEWS,
    UNCERTAIN,
    UNSEEABLE,
    Reason,
    Task,
    bits_of,
    leads,
    name_of,
    own_reasons,
    rows_in,
    tasks_of,
)
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import blocker, body_of
from rastercov.core.mesh.solids import rooms_at
from rastercov.core.mesh.topology import components_of
from rastercov.shards import Progress, silent

MOST_ZONES = 100
"""Zones that a summary lists."""
SLIVER_REL = 1e-9
"""Part of the evaluated area below which a zone is rounding, and is not listed."""


@dataclass(frozen=True, eq=False, repr=False)
class DeadZones(FacePolygons):
    """Connected parts that too few cameras cover: Z zones, the largest first, of N pieces.

    Attributes
    ----------
    xy, starts, face, views
        The pieces, as in `Covered`; `views` is 0 where no camera covers a piece.
    zone : (N,) int64
        Zone of each piece.
    area : (Z,) float64
        Area of each zone, m^2, in descending order.
    piece_area : (N,) float64
        Area of each piece, m^2.
    reason : (N,) uint32
        Code of the reasons of each piece, see `rastercov.core.coverage.task.name_of`; all
        pieces of a zone have the same.
    doubt : (F,) float64
        Error bound of the area of a face that is assigned to a reason, m^2.
    wanted : (F,) int
        Cameras that each face needs.
    gains : dict of int to (2, F) float64
        Area of each face that the cameras would cover besides without the criterion of a row alone,
        and its bound, m^2.

    Examples
    --------
    >>> import rastercov as rc
    >>> plate = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=90)
    >>> pose = rc.look_at((0.5, 0.5, 0.25), (0.5, 0.5, 0))  # sees 0.5 m x 0.375 m
    >>> covered = rc.unite(rc.regions(plate, camera, pose))
    >>> zones = rc.dead_zones(covered)
    >>> len(zones), zones.area.round(4).tolist()  # m^2
    (1, [0.8125])
    """

    views: Int32Array
    zone: IntArray
    area: FloatArray
    piece_area: FloatArray
    reason: CodeArray
    doubt: FloatArray
    wanted: IntArray
    gains: Mapping[int, FloatArray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.area)

    @typed
    def places(self, n: int) -> list[dict[str, Any]]:
        """Area, centroid, extent and groups of the first n zones, ready for JSON.

        `percent` is of the area of all evaluated faces, `extent` the lowest and highest corner,
        metres, and `groups` are in descending order of area; `m2_by_views` is the area that exactly
        0, 1, ... cameras cover. In a building with spaces, `rooms` are those in front of the zone.

        Examples
        --------
        >>> import rastercov as rc
        >>> plate = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
        >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=90)
        >>> pose = rc.look_at((0.5, 0.5, 0.25), (0.5, 0.5, 0))  # sees 0.5 m x 0.375 m
        >>> covered = rc.unite(rc.regions(plate, camera, pose))
        >>> place = rc.dead_zones(covered).places(1)[0]
        >>> place["groups"], round(place["percent"], 2)
        (['mesh'], 81.25)
        """
        mesh, n = self.mesh, min(max(int(n), 0), len(self.area))
        names = [group.name for group in mesh.groups]
        most_views = int(self.views[self.zone < n].max(initial=0))
        centroids = polygons.centroids(self.xy, self.starts, self.piece_area)
        order = sort_order(self.zone)
        limits = np.searchsorted(self.zone[order], np.arange(n + 1))
        items = []
        for row, area in enumerate(self.area[:n].tolist()):  # some 0.1 ms each
            own = order[limits[row] : limits[row + 1]]
            face, weight = self.face[own], self.piece_area[own]
            xy, starts = polygons.choose_polygons(self.xy, self.starts, own)
            corners = to_world(mesh, np.repeat(face, np.diff(starts)), xy)
            of_group = np.bincount(mesh.face_group[face], weight, len(names))
            by_views = np.bincount(self.views[own], weight, most_views + 1)
            entry = {
                "area_m2": area,
                "percent": percent_of(area, self.total()),
                "centroid": (matmul(weight, to_world(mesh, face, centroids[own])) / area).tolist(),
                "extent": [corners.min(axis=0).tolist(), corners.max(axis=0).tolist()],
                "groups": [names[each] for each in sort_order(-of_group) if of_group[each] > 0],
                "m2_by_views": by_views.tolist(),
            }
            items.append(entry)
        if mesh.spaces and n:
            points, piece = points_of(self, n, LEAST_POINTS**2)
            points += BEFORE_FACE * frames_of(mesh).normal[self.face[piece]]
            every = np.reshape(rooms_at(mesh, points), (n, -1)).tolist()
            for entry, rooms in zip(items, every, strict=True):
                entry["rooms"] = [room for room, _ in Counter(rooms).most_common() if room]
        return items

    @cached_property
    def _reasons_of_pieces(self) -> tuple[CodeArray, IntArray]:
        """Reasons that occur, (K,), and the row of that of each piece, (N,)."""
        codes, rows = np.unique(self.reason, return_inverse=True)
        return codes, rows

    @cached_property
    def leads(self) -> ByteArray:
        """(N,) row of `REASONS` by which each piece has its colour."""
        return leads(self.reason)

    def reasons(self, n: int) -> CodeArray:
        """(n,) reasons of the first n zones, as in `reason`."""
        n = min(max(int(n), 0), len(self.area))
        result = np.full(n, NO_CAMERAS, np.uint32)
        own = self.zone < n
        result[self.zone[own]] = self.reason[own]
        return result

    def count(self) -> int:
        """Number of zones, except those that are below the rounding error of areas."""
        return int((self.area > SLIVER_REL * self.total()).sum())

    def listed(self) -> int:
        """Number of zones that a summary lists: `count`, at most 100."""
        return min(self.count(), MOST_ZONES)

    def others(self) -> dict[str, Any]:
        """Number and area of the zones that a summary does not list, ready for JSON."""
        n, total = self.listed(), self.total()
        rest = float(self.area[n:].sum())
        return {"zones": self.count() - n, "area_m2": rest, "percent": percent_of(rest, total)}

    def total(self) -> float:
        """Area of all evaluated faces, m^2."""
        return float(frames_of(self.mesh).areas[self.mesh.task_mask].sum())


def dead_zones(
    covered: Covered,
    views: ArrayLike | None = None,
    network: tuple[Cameras, Task, Poses] | None = None,
) -> DeadZones:
    """Connected parts of the evaluated surface that fewer than `views` cameras cover.

    Zones end at creases of more than 30 degrees, where groups end, and where the reason changes.

    Parameters
    ----------
    covered : Covered
        Result of `rastercov.unite` with k views.
    views : int, or (F,) int array_like, optional
        Number of cameras required, for all faces or for each, from 1 to k; k unless given. For
        three cameras, unite the regions with `views=3` first.
    network : (Camera or Rig, Task, Poses), optional
        Cameras, task and poses of `covered`, for the reasons. Without them the reason is
        "too_few_views", or "unseeable" for faces that no camera can ever see.

    Raises
    ------
    ConfigError
        For `views` outside 1 to k, and another `network`.

    Examples
    --------
    >>> import rastercov as rc
    >>> plate = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    >>> camera = rc.Camera.from_fov(640, 480, hfov_deg=90)
    >>> pose = rc.look_at((0.5, 0.5, 0.25), (0.5, 0.5, 0))  # sees 0.5 m x 0.375 m
    >>> covered = rc.unite(rc.regions(plate, camera, pose))
    >>> rc.dead_zones(covered).area.round(4).tolist()  # m^2 of what no camera covers
    [0.8125]
    """
    from rastercov.core.mesh.unseeable import unseeable_in_view

    if network is not None:
        if not isinstance(network, tuple) or len(network) != 3:
            raise ConfigError(
                f"expected network (camera, task, poses), got {shown(network)}; give all three"
            )
        cameras_of(network[0])
        check_kind("task", network[1], Task, "a Task", ConfigError)
        network = *network[:2], Poses.of(network[2])
    mesh, k = covered.mesh, len(covered.area)
    words = f"1{f' to {k}' if k > 1 else ''}, for all faces or for each"
    wanted = check_array("views", k if views is None else views, "iu", words, ConfigError)
    is_shape = wanted.shape in ((), (mesh.n_faces,))
    if not is_shape or not ((wanted >= 1) & (wanted <= k)).all():
        raise ConfigError(
            f"expected views of {words}, got {shown(views)}; unite the regions for more views first"
        )
    seen = covered.area[0] / np.maximum(frames_of(mesh).areas, TINY)
    is_unseeable = unseeable_in_view(mesh, seen) > 0
    divide = None if network is None else division(mesh, *network)
    left = TOO_FEW_VIEWS if network is None else NO_CAMERAS
    of_face = np.broadcast_to(wanted, mesh.n_faces)
    zones = zones_of(covered, of_face, is_unseeable, divide, left)
    if divide is None or network is None or (of_face == 1).all():
        return zones
    return replace(zones, gains=gains_of_views(covered, of_face, network))


Divide = Callable[[ReasonPieces], Divided]
"""Divides pieces that no camera covers, ordered by face, as `divide_by_reason` does."""


def division(mesh: Mesh, camera: Cameras, task: Task, poses: Poses) -> Divide | None:
    """The division by the stages of a task; None without cameras."""
    if not len(poses):
        return None
    make, asked = partial(passes, mesh, poses), np.ones(mesh.n_faces, bool)
    own = own_reasons(mesh, tasks_of(camera, task)[0])

    def divide(rest: ReasonPieces) -> Divided:
        ends = any_in_front(mesh, camera, poses, asked), own
        return divide_by_reason(mesh, rest, stages_of(mesh, camera, task), make, ends)

    return divide


def zones_of(
    covered: Covered,
    wanted: IntArray,
    is_unseeable: BoolArray,
    divide: Divide | None,
    left: int,
) -> DeadZones:
    """Zones of what fewer views than wanted, (F,), cover.

    `left` is the reason of what no camera covers and no proof explains, unless it is divided.
    """
    mesh = covered.mesh
    whole = with_rest(covered)
    areas = polygons.polygon_areas(whole.xy, whole.starts)
    is_dead = (whole.views < wanted[whole.face]) & (areas > 0)
    is_open = is_dead & (whole.views == 0) & ~is_unseeable[whole.face]

    known = np.where(whole.views == 0, left, TOO_FEW_VIEWS)
    known[is_unseeable[whole.face]] = UNSEEABLE

    def take(chosen: BoolArray) -> ReasonPieces:
        rows = np.flatnonzero(chosen)
        cut = polygons.choose_polygons(whole.xy, whole.starts, rows)
        return ReasonPieces(
            *cut, whole.face[rows], whole.views[rows], known[rows].astype(np.uint32)
        )

    kept, divided = take(is_dead & ~is_open), Divided(take(is_open), np.zeros(mesh.n_faces), {})
    if divide is not None:
        divided = divide(divided.parts)
    parts = ReasonPieces.join(kept, divided.parts)
    areas = polygons.polygon_areas(parts.xy, parts.starts)
    zone, sizes = linked(mesh, parts, areas, covered.excess)
    rows = np.flatnonzero(zone >= 0)
    own = (
        *polygons.choose_polygons(parts.xy, parts.starts, rows),
        parts.face[rows],
        parts.views[rows],
    )
    ranked = zone[rows], sizes, areas[rows], parts.reason[rows]
    return DeadZones(mesh, *own, *ranked, divided.doubt, wanted, divided.gains)


def linked(
    mesh: Mesh, parts: ReasonPieces, areas: FloatArray, excess: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Zone of each piece, (N,), the largest first, and the areas of zones, m^2.

    The zone is -1 where all of it is within `excess`, (F,), of its faces together; `areas`, (N,),
    are those of pieces.
    """
    from rastercov.engine import area_zone

    frames, least = frames_of(mesh), 2.0**-20 * float(np.abs(mesh.bounds).max())
    scale = max(mesh.opaque.diagonal, least)
    axes = frames.origin, frames.x_axis, frames.y_axis, frames.normal, frames.corners, frames.areas
    surface = mesh.vertices, mesh.welded_faces, mesh.face_group, *axes, scale
    zone, sizes = np.empty(len(areas), np.int64), np.empty(len(areas))
    pieces = parts.xy, parts.starts, parts.face
    n = area_zone.find_zones(surface, pieces, parts.reason, areas, excess, zone, sizes)
    return zone, sizes[:n]


def face_zones(mesh: Mesh, why: IntArray, views: IntArray, wanted: IntArray) -> DeadZones:
    """Zones of whole faces that share edges and a reason, where a result is by face.

    Parameters
    ----------
    mesh : Mesh
    why : (F,) int
        Number of the reason of each face, -1 for those of no zone.
    views, wanted : (F,) int
        Cameras that cover each face, and that it needs.
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
    own = views[face].astype(np.int32), *ranked, areas, why[face].astype(np.uint32)
    return DeadZones(mesh, xy, starts, face, *own, np.zeros(mesh.n_faces), wanted)


def _largest_first(zone: IntArray, areas: FloatArray) -> tuple[IntArray, FloatArray]:
    """Zone of each piece, (N,), numbered by falling area, and the areas of zones."""
    sums: FloatArray = np.asarray(np.bincount(zone, weights=areas), np.float64)
    order = sort_order(-sums)
    rank = sort_order(order)
    return rank[zone], sums[order]


def areas_by_reason(zones: DeadZones, members: BoolArray) -> dict[str, dict[str, float]]:
    """Area of some faces, (F,), by the name of the reason, and percentage of their area.

    The area of each is certain to `bound_m2`. `gain_m2`, of one criterion, is what the task without
    it would cover besides, to `gain_bound_m2`.
    """
    own = zones.piece_area * members[zones.face]
    codes, row = zones._reasons_of_pieces
    m2 = dict(zip(codes.tolist(), np.bincount(row, own, len(codes)).tolist(), strict=True))
    doubt, total = (
        float(zones.doubt[members].sum()),
        float(frames_of(zones.mesh).areas[members].sum()),
    )
    gains = {code: each[:, members].sum(axis=1).tolist() for code, each in zones.gains.items()}
    m2 |= {code: 0.0 for code, (gain, _) in gains.items() if code not in m2 and gain > doubt}
    areas = {}
    for code in sorted(m2, key=lambda each: -m2[each]):
        gain = gains.get(code)
        if m2[code] > SLIVER_REL * total or code in gains:
            entry = {
                "m2": m2[code],
                "bound_m2": min(doubt, total),
                "area_percent": percent_of(m2[code], total),
            }
            if gain is not None:
                entry |= {"gain_m2": gain[0], "gain_bound_m2": min(gain[1], total)}
            areas[name_of(code)] = entry
    return areas


def zones_at(
    zones: DeadZones, face: ArrayLike, points: ArrayLike, n: int, row: IntArray | None = None
) -> IntArray:
    """(N,) dead zone of each point of faces (N,): its row, n for the n-th or later, -1 for none.

    Parameters
    ----------
    zones : DeadZones
        Zones, the largest first.
    face, points
        As for `rastercov.core.area.regions.covering_poses`.
    n : int
        Zones that are distinguished.
    row : (K,) int, optional
        Numbers of the pieces instead of their zones.
    """
    given = np.minimum(zones.zone if row is None else row, n).astype(np.int32)
    is_inside = rows_at(zones, given, n + 1, face, points)
    return np.where(is_inside.any(axis=1), is_inside.argmax(axis=1), -1)


MOST_POINTS, LEAST_POINTS = 32, 4
"""Points of a zone that are judged; fewer for many cameras."""
PAIRS = 4_000_000
"""Pairs of point and camera up to which there are more than `LEAST_POINTS`: a few seconds."""
ZONES = ("dead_zones", "other_dead_zones")
"""Keys of `summary_of`."""
CHECKED = 128
"""Points of a zone against which advice is held."""
TRIED_PERCENT = 1.0
"""Part of the task, in percent, from which advice for a zone is tried, beyond the first."""
MOST_LINES = 5
"""Zones that have a line for people."""
BEFORE_FACE = 0.1
"""Distance from a face of points that are looked for in rooms, metres."""
LEAST_PERCENT = 1e-3
"""Part of the task, in percent, from which a zone has one."""


def summary_of(
    zones: DeadZones,
    camera: Cameras,
    task: Task,
    poses: ArrayLike | Poses,
    allowed: Allowed = ANY,
    progress: Progress = silent,
    of_candidates: bool = False,
) -> dict[str, Any]:
    """`dead_zones`, the largest first, and the sum of all that are not listed.

    A zone has its area, centroid (which may lie off a bent surface), extent, groups by falling
    area, reason, and for "occluded" the group that hides it most often, or None; `nearest`, the
    pose that comes nearest to covering it with its figures; `advice`, with the change that was
    `tried` where one covers half of it, see `rastercov.core.area.remedies`. Of a
    rig with a rule, `device` is the camera that is missed most, and the pose one of it; of a reason
    of a feature, the device that fails.

    Parameters
    ----------
    zones : DeadZones
        What the cameras leave.
    camera, task
        Camera or cameras, and thresholds of their regions.
    poses : (P, 4, 4) array_like, or Poses
        world_from_camera of all cameras.
    allowed : Allowed, optional
        Cameras that advice may name.
    progress : callable
        Called with the zones done for which advice is tried, and their total.
    of_candidates : bool
        True where no camera is placed and `poses` are candidates: none of them is `nearest`.
    """
    n = zones.listed()
    remedies = Remedies(zones.mesh, camera, task, Poses.of(poses), None, allowed)
    why = _reasons(zones, remedies, n, progress)
    for each in why if of_candidates else ():
        if each["nearest"] is not None:
            each |= {"nearest": None, "advice": f"of the nearest candidate: {each['advice']}"}
    return {
        "dead_zones": [place | said for place, said in zip(zones.places(n), why, strict=True)],
        "other_dead_zones": zones.others(),
    }


def explain_zones(
    zones: DeadZones, camera: Cameras, poses: Poses, task: Task, n: int
) -> list[dict[str, Any]]:
    """Place, reason, and the group that hides it, of the first n zones, ready for JSON."""
    judged = _Judged.of(zones, camera, task, poses, n) if n else None
    items = []
    for row, (place, winner) in enumerate(
        zip(zones.places(n), zones.reasons(n).tolist(), strict=True)
    ):
        assert judged is not None
        hider, device, _ = judged.of_zone(row, winner)
        items.append(place | {"reason": name_of(winner), "hidden_by": hider, "device": device})
    return items


def zone_line(zone: Mapping[str, Any], whole: float = 0.0) -> str:
    """Line about one zone, in the unit of a `whole` area, m^2."""
    size = math.sqrt(zone["area_m2"])
    digits = min(max(0, 1 - math.floor(math.log10(size))), 9)
    at = ", ".join(text_with_sign(value, digits) for value in zone["centroid"])
    amount = in_square_metres(zone["area_m2"], whole=whole)
    return f"dead zone {amount} around ({at}) m in group {zone_place(zone)}: {zone_reason(zone)}"


def n_unlisted(summary: Mapping[str, Any]) -> int:
    """Number of zones that a summary does not list; 0 where they are rounding."""
    rest = summary["other_dead_zones"]
    return int(rest["zones"]) if rest["percent"] > 100 * SLIVER_REL * rest["zones"] else 0


def zone_place(zone: Mapping[str, Any]) -> str:
    """Parts that a zone is on, or the one CAD face of one, and the room before it."""
    groups, rooms = zone["groups"], zone.get("rooms")
    place = first_of(groups if len(groups) == 1 else zone_parts(zone), 1)
    return f"{place}, room {first_of(rooms, 1)}" if rooms else place


def zone_parts(zone: Mapping[str, Any]) -> list[str]:
    """Names of what a zone is on, by falling area: groups, or the parts of which they are faces."""
    return list(dict.fromkeys(map(body_of, zone["groups"])))


def zone_reason(zone: Mapping[str, Any]) -> str:
    """Reason of a zone, what hides it, and the camera of a rule that fails or the nearest lamp."""
    text, hider = REASONS[zone["reason"]].label, zone["hidden_by"]
    if hider is not None:
        by, occluded = body_of(hider), REASONS["occluded"].label
        is_own = by == zone_parts(zone)[0]
        text = text.replace(occluded, f"self-{occluded}" if is_own else f"{occluded} by {by}")
    nearest = REASONS[zone["reason"]].nearest
    return text + (f" ({nearest}{zone['device']})" if zone.get("device") else "")


def _reasons(
    zones: DeadZones, remedies: Remedies, n: int, progress: Progress
) -> list[dict[str, Any]]:
    """Reason, what hides it, and advice, of the first n zones."""
    if not n:
        return []
    mesh, camera, task, poses = zones.mesh, remedies.camera, remedies.task, remedies.poses
    shares = 100 * zones.area[:n] / max(zones.total(), TINY)
    n_tried = max(min(n, MOST_LINES), int((shares >= TRIED_PERCENT).sum()))
    judged = _Judged.of(zones, camera, task, poses, n)
    is_single = not (zones.views > 0).any() and task.views == 1 and task.min_angle_deg == 0
    if is_single:
        left = np.bincount(zones.face, zones.piece_area, mesh.n_faces)
        remedies.covered_m2 = frames_of(mesh).areas - left
    reasons = []
    points, piece = points_of(zones, n_tried, CHECKED)
    rows = zones.face[piece].astype(np.int64).reshape(n_tried, CHECKED)
    spots = [
        ZoneSpot.of(own, face, int(zones.wanted[face].max()))
        for own, face in zip(points.reshape(n_tried, CHECKED, 3), rows, strict=True)
    ]
    progress(0, n_tried)
    moving = movers(camera, poses)
    for row, winner in enumerate(zones.reasons(n).tolist()):
        hider, device, failing = judged.of_zone(row, winner)
        name = name_of(winner)
        entry: dict[str, Any] = {"reason": name, "hidden_by": hider}
        spot = spots[row] if row < n_tried else judged.spot(row)
        surface = spot.at, frames_of(mesh).normal[spot.face[spot.middle]]
        lead = moving[failing[:1]]
        if len(failing) and (own := device_of(camera, lead, *surface, winner)):
            device = own
        if device:
            entry["device"] = device
        own = mesh.groups[mesh.face_group[spot.face[spot.middle]]].name
        before = blocker(hider, own)
        entry |= remedies.say(spot, winner, failing, before, is_tried=row < n_tried)
        if entry["tried"] and spot.views == 1:
            share = entry["tried"]["covers_percent"] / 100
            entry["tried"]["gain_m2"] = share * float(zones.area[row])
        if row < n_tried and len(failing):
            words, figures = measure_at((mesh, camera, task), spot.points, spot.face, lead, winner)
            entry |= {"advice": f"{words}: {entry['advice']}", **figures} if words else {}
        if name in OWN_CRITERIA:
            entry |= {"advice": general_advice(name), "tried": None}
        elif {BASELINE, UNCERTAIN} & {*rows_in(winner)}:
            rows, is_tried = rows_of_result(camera, poses), row < MOST_LINES
            some, scene = poses[np.isin(rows, rows[failing])], (mesh, camera, task)
            on = spot.points, spot.face
            if said := limit_advice(failures_of_rows, scene, some, on, is_tried=is_tried):
                more = "" if is_tried else f": {general_advice(name)}"
                entry |= {"advice": said + more, "tried": None}
            if UNCERTAIN in rows_in(winner) and len(some):
                entry["uncertainty_um"] = _deviation_um(camera, some, spot.points)
        reasons.append(entry)
        progress(min(row + 1, n_tried), n_tried)
    return reasons


def _deviation_um(camera: Cameras, poses: Poses, points: FloatArray) -> dict[str, float]:
    """Least and greatest standard deviation of points, (N, 3), by the best of some rigs, um."""
    ends = [*led_by(camera, poses).tolist(), len(poses)]
    deviations = [deviations_of(camera, poses[at:end], points) for at, end in pairwise(ends)]
    best = np.min([each for each in deviations if each is not None], axis=0)
    return {"least": 1e6 * float(best.min()), "most": 1e6 * float(best.max())}


@dataclass(frozen=True, eq=False)
class _Judged:
    """Some points of zones, held against every camera, of N points by P poses.

    Attributes
    ----------
    points, face, zone : (N, 3) float64, (N,) int64, (N,) int64
    in_pose : (P, N) uint8
        `Reason` in each pose; `COVERED` for points that are in none of them.
    hidden : (N, G) int32
        Cameras from which each group hides a point.
    """

    zones: DeadZones
    camera: Cameras
    poses: Poses
    points: FloatArray
    face: IntArray
    zone: IntArray
    in_pose: ByteArray
    hidden: Int32Array

    @classmethod
    def of(cls, zones: DeadZones, camera: Cameras, task: Task, poses: Poses, n: int) -> "_Judged":
        """Points of the first n zones."""
        each = int(np.clip(PAIRS // (n * max(1, len(poses))), LEAST_POINTS, MOST_POINTS))
        points, piece = points_of(zones, n, each)
        face, mesh = zones.face[piece].astype(np.int64), zones.mesh
        in_pose = np.full((len(poses), len(points)), Reason.COVERED, np.uint8)
        hidden = np.zeros((len(points), len(mesh.groups)), np.int32)
        rows = np.flatnonzero((zones.views[piece] == 0) & (zones.reason[piece] != UNSEEABLE))
        judged = failures_of_rows(mesh, camera, task, poses, points[rows], face[rows])
        for pose, fails, hidden_by in judged if len(poses) else ():
            # No camera covers these points: where none of the criteria fails, it is a coincident
            # surface in front, or rounding.
            why = np.where(fails == Reason.COVERED, np.uint8(Reason.OCCLUDED), fails)
            in_pose[pose, rows] = why
            at = np.flatnonzero(hidden_by >= 0)
            np.add.at(hidden, (rows[at], mesh.face_group[hidden_by[at]]), 1)
        return cls(zones, camera, poses, points, face, zones.zone[piece], in_pose, hidden)

    def spot(self, row: int) -> ZoneSpot:
        """Points of a zone."""
        own = self.zone == row
        return ZoneSpot.of(self.points[own], self.face[own])

    def of_zone(self, row: int, winner: int) -> tuple[str | None, str, IntArray]:
        """Group that hides most of a zone, camera of a rule that fails, and poses that fail so."""
        own = np.flatnonzero(self.zone == row)
        # Cameras of a rig may fail a part of its criteria each; conditions are of what they see.
        some = bits_of(winner)
        bits = BITS[self.in_pose[:, own]]
        fails = (self.in_pose[:, own] == winner) | ((bits > 0) & (bits & ~np.uint32(some) == 0))
        failing = np.flatnonzero(fails.any(axis=1))
        failing = failing[sort_order(-fails[failing].sum(axis=1))]
        counts, device = self.hidden[own].sum(axis=0), ""
        hides = Reason.OCCLUDED in rows_in(winner) and counts.any()
        hider = self.zones.mesh.groups[int(counts.argmax())].name if hides else None
        if gates_of(self.camera) and len(failing) and winner < BASELINE:
            of_camera = np.bincount(self.poses.camera[np.nonzero(fails)[0]])
            device = names_of(self.camera)[int(of_camera.argmax())]
            failing = failing[self.poses.camera[failing] == of_camera.argmax()]
        return hider, device, failing


def points_of(zones: DeadZones, n: int, each: int) -> tuple[FloatArray, IntArray]:
    """Points of the first n zones, the same number of each, and their pieces.

    At equal steps of the area of the triangles that the pieces are fans of.
    """
    pieces = np.flatnonzero(zones.zone < n)
    pieces = pieces[sort_order(zones.zone[pieces])]
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
