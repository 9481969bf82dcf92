"""Candidate poses at mounting positions: around a part, on walls, under a ceiling.

The generators of `pool` follow the surface of the part; these follow the space where cameras can be
mounted. Positions are on a sphere, on a grid on the sides of a box, or on the mesh inside a room,
with a rule for the aim.

T. F. Gonzalez. Clustering to Minimize the Maximum Intercluster Distance. 1985, for the choice of
positions on the mesh.
"""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    BoolArray,
    ConfigError,
    FloatArray,
    cos,
    finite_points,
    matmul,
    norm,
    shown,
)
from rastercov.base.typed import typed
from rastercov.core.area.cells import cells
from rastercov.core.camera import Camera, fibonacci_sphere, look_at
from rastercov.core.camera.viewpoints import enclosing_distance
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.arrays import unit
from rastercov.core.mesh.groups import list_names
from rastercov.core.mesh.solids import in_solid
from rastercov.placement.candidates.pool import DEFAULT, Candidates, Framing, roll_candidates
from rastercov.placement.candidates.rooms import NearestSurface, Room, nearest_obstacle

Aim = Callable[[Mesh, FloatArray], FloatArray]
"""Rule of aim: from a mesh and (N, 3) camera centres, (N, 3) targets, metres."""
SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
WALLS, CEILING = SIDES[:4], SIDES[5:]
MOST_POSITIONS = 10_000_000
IN_ROOM = "in "
"""Start of the sources of `in_room`, before the name of the room."""
LEVEL = cos(math.radians(45))
"""Least |z| of the normal of a ceiling or a roof."""
FINEST = 0.5
"""Largest side of the cells on the mesh whose middles are tried, metres."""
INSET_TOLERANCE_REL, PUSHES = 1e-6, 8
"""Of the distance from the mesh; and steps that move a position out of a corner."""


@typed
def at_point(point: ArrayLike) -> Aim:
    """Rule of aim: look at one point, (3,) metres.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import at_point, on_box
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> box = ((-2, -2, 0), (2, 2, 2))
    >>> points = on_box(mesh, camera, spacing=2, bounds=box, sides=["+z"], aim=at_point((0, 0, 0)))
    >>> len(points)
    9
    """
    target = _triple("point", point)
    return lambda mesh, eyes: np.broadcast_to(target, eyes.shape)


@typed
def along(direction: ArrayLike) -> Aim:
    """Rule of aim: look in one direction, (3,), from every position.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import along, on_box
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> box = ((-2, -2, 0), (2, 2, 2))
    >>> points = on_box(mesh, camera, spacing=2, bounds=box, sides=["+z"], aim=along((0, 0, -1)))
    >>> points.poses[0, :3, 2].round(6).tolist()  # the optical axis
    [0.0, 0.0, -1.0]
    """
    step = _triple("direction", direction)
    length = norm(step)
    if not length > 0:
        raise ConfigError("expected a direction, got one of length 0; give another vector")
    return lambda mesh, eyes: eyes + step / length


def at_middle() -> Aim:
    """Rule of aim: look at the middle of the bounding box of the mesh.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import at_middle, on_walls
    >>> mesh, camera = rc.shapes.room(), rc.Camera.from_fov(640, 480, hfov_deg=80)
    >>> result = on_walls(mesh, camera, spacing=2, aim=at_middle())
    >>> len(result)
    36
    """
    return lambda mesh, eyes: np.broadcast_to(mesh.centre, eyes.shape)


@typed
def at_nearest_surface(groups: str | Sequence[str] | None = None) -> Aim:
    """Rule of aim: look at the nearest point of the evaluated faces, or of the named groups.

    For a camera on the wall of a room that wall is the nearest surface: name the groups to look at.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import at_nearest_surface, on_ceiling
    >>> mesh, camera = rc.shapes.room(), rc.Camera.from_fov(640, 480, hfov_deg=80)
    >>> result = on_ceiling(mesh, camera, spacing=2, aim=at_nearest_surface("crates"))
    >>> len(result)
    16
    """
    names = [groups] if isinstance(groups, str) else groups

    def aim(mesh: Mesh, eyes: FloatArray) -> FloatArray:
        chosen = mesh.task_mask
        if names is not None:
            chosen = _of_groups(mesh, names)
        return NearestSurface(mesh, chosen).query(eyes).point

    return aim


@typed
def on_sphere(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    count: int,
    centre: ArrayLike | None = None,
    distances: float | Sequence[float] | None = None,
) -> Candidates:
    """Views of the part from all sides: a Fibonacci lattice on a sphere, looking at its centre.

    Parameters
    ----------
    mesh : Mesh
        The part.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Its rolls and up apply, and for the default distance stand-off and margin.
    count : int
        Number of positions on each sphere, 1 or more.
    centre : (3,) array_like, optional
        Centre of the spheres, metres; the middle of the bounding box by default.
    distances : float or sequence of float, optional
        Radii of the spheres, metres. By default one, at which all of the part is in view and beyond
        the near limit of the depth of field, clipped to the limits of the stand-off; for a
        telecentric lens the working distance.

    Returns
    -------
    Candidates
        Sphere by sphere, from the top down.

    Raises
    ------
    ConfigError
        For a count or a distance outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, on_sphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> points = on_sphere(mesh, camera, Framing(stand_off=(2, 4)), count=8)
    >>> points.poses.shape, points.sources
    ((8, 4, 4), ('sphere',))
    """
    return _around(mesh, camera, framing, count, centre, distances, 2.0, "sphere")


@typed
def on_hemisphere(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    count: int,
    centre: ArrayLike | None = None,
    distances: float | Sequence[float] | None = None,
) -> Candidates:
    """Views of the part from the half of a sphere on the side of `Framing.up`; see `on_sphere`.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Framing, on_hemisphere
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> result = on_hemisphere(mesh, camera, Framing(stand_off=(2, 4)), count=8)
    >>> bool((result.poses[:, 2, 3] > 0).all())
    True
    """
    return _around(mesh, camera, framing, count, centre, distances, 1.0, "hemisphere")


@typed
def on_box(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    spacing: float,
    aim: Aim | None = None,
    bounds: ArrayLike | None = None,
    outward: float = 0.0,
    sides: Sequence[str] = SIDES,
    source: str = "box",
) -> Candidates:
    """Views from a grid on the sides of a box, edges and corners included, each position once.

    Parameters
    ----------
    mesh : Mesh
        The scene.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls and up apply, because the positions are fixed.
    spacing : float
        Largest distance between neighbours along an edge, metres; > 0.
    aim : Aim, optional
        Rule of aim; `at_middle()` by default. A position that is its own target is left out.
    bounds : (2, 3) array_like, optional
        Lowest and highest corner, metres; the mesh's bounding box by default.
    outward : float
        Distance by which the box is enlarged on all sides, metres; negative for positions inside.
    sides : sequence of {"-x", "+x", "-y", "+y", "-z", "+z"}
        Sides to use, by their outward direction.
    source : str
        Name in `Candidates.sources`.

    Returns
    -------
    Candidates
        One side after the other, in the order given.

    Raises
    ------
    ConfigError
        For an empty box, an unknown side, or a spacing outside its range.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import at_middle, on_box
    >>> mesh, camera = rc.shapes.box(), rc.Camera.from_fov(640, 480, hfov_deg=60)
    >>> box = ((-2, -2, -2), (2, 2, 2))
    >>> points = on_box(mesh, camera, spacing=2, aim=at_middle(), bounds=box)
    >>> len(points), points.sources
    (26, ('box',))
    """
    if not 0 < spacing < np.inf:
        raise ConfigError(f"expected spacing above 0 m, got {spacing}; give metres")
    low, high = _box(mesh, bounds, outward)
    if unknown := [side for side in sides if side not in SIDES]:
        raise ConfigError(f"expected sides, got {shown(unknown[0])}; they are {', '.join(SIDES)}")
    # Larger counts along one axis are refused below; a tiny spacing divides to inf.
    with np.errstate(over="ignore"):
        wanted = np.ceil((high - low) / spacing * (1 - 1e-12))
    steps = np.minimum(wanted, MOST_POSITIONS).astype(np.int64)
    if not float(np.prod(np.sort(steps + 1)[1:].astype(np.float64))) * 6 <= MOST_POSITIONS:
        raise ConfigError(
            f"expected at most {MOST_POSITIONS} positions, got more at {spacing:g} m; increase "
            "spacing"
        )
    ticks = [np.linspace(low[k], high[k], steps[k] + 1) for k in range(3)]
    grids = []
    for side in sides:
        axis, end = SIDES.index(side) // 2, SIDES.index(side) % 2
        across = list(ticks)
        across[axis] = np.array([(low, high)[end][axis]])
        grids.append(np.stack(np.meshgrid(*across, indexing="ij"), axis=-1).reshape(-1, 3))
    eyes = np.concatenate(grids) if grids else np.zeros((0, 3))
    eyes = eyes[np.sort(np.unique(eyes, axis=0, return_index=True)[1])]
    return _take_aim(mesh, framing, eyes, aim or at_middle(), source)


@typed
def on_walls(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    spacing: float,
    aim: Aim | None = None,
    bounds: ArrayLike | None = None,
    inset: float = 0.1,
    heights: tuple[float, float] | None = None,
) -> Candidates:
    """Views from the four walls of a room, `on_box` with the sides -x, +x, -y and +y; z is up.

    Parameters
    ----------
    mesh, camera, framing, spacing, aim, bounds
        As for `on_box`; the box is the room.
    inset : float
        Distance of the positions from each wall, floor and ceiling, metres.
    heights : (float, float), optional
        Lowest and highest z of the positions, metres; from floor to ceiling by default.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import at_middle, on_walls
    >>> mesh, camera = rc.shapes.room(), rc.Camera.from_fov(640, 480, hfov_deg=80)
    >>> result = on_walls(mesh, camera, spacing=2, aim=at_middle(), heights=(2.0, 2.6))
    >>> len(result), result.sources
    (24, ('walls',))
    """
    low, high = _box(mesh, bounds, -inset)
    if heights is not None:
        low[2], high[2] = finite_points("heights", heights, (2,), "two finite numbers")
    room = np.stack((low, high))
    return on_box(
        mesh, camera, framing, spacing=spacing, aim=aim, bounds=room, sides=WALLS, source="walls"
    )


@typed
def on_ceiling(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    spacing: float,
    aim: Aim | None = None,
    bounds: ArrayLike | None = None,
    inset: float = 0.1,
) -> Candidates:
    """Views from under the ceiling of a room, `inset` metres from it and the walls; z is up.

    The other arguments are those of `on_box`; the box is the room.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import along, on_ceiling
    >>> mesh, camera = rc.shapes.room(), rc.Camera.from_fov(640, 480, hfov_deg=80)
    >>> result = on_ceiling(mesh, camera, spacing=2, aim=along((0, 0, -1)))
    >>> len(result), result.sources
    (16, ('ceiling',))
    """
    box = np.stack(_box(mesh, bounds, -inset))
    return on_box(
        mesh, camera, framing, spacing=spacing, aim=aim, bounds=box, sides=CEILING, source="ceiling"
    )


@typed
def in_room(
    mesh: Mesh,
    camera: Camera,
    framing: Framing = DEFAULT,
    *,
    room: Room,
    spacing: float,
    aims: Sequence[Aim] = (),
    inset: float = 0.1,
    heights: tuple[float, float] | None = None,
    on: Sequence[Literal["walls", "ceiling"]] = ("walls", "ceiling"),
    groups: Sequence[str] = (),
) -> Candidates:
    """Views from the walls and the ceiling of the mesh in a room; z is up.

    The middles of small cells of the mesh are moved off it, to both sides, and out of corners. Of
    those in the room, the one furthest from the positions so far is the next one, until none is
    further than the spacing: corners come first, and a smaller spacing, of 1 m or more, adds to the
    positions of a larger one.

    Parameters
    ----------
    mesh : Mesh
        The building.
    camera : Camera
        Camera to place.
    framing : Framing, optional
        Only its rolls and up apply.
    room : Room
        The room.
    spacing : float
        Largest distance from any place on the faces to the nearest position, metres; > 0.
    aims : sequence of Aim
        Rules of aim, each of which gives a candidate; the middle of the room by default.
    inset : float
        Distance of the positions from the mesh, metres; > 0.
    heights : (float, float), optional
        Lowest and highest z of the positions, metres; those of the room by default.
    on : sequence of {"walls", "ceiling"}
        Faces to use: "walls" are steep faces, used from either side, "ceiling" the others, from
        below. Furniture counts, too.
    groups : sequence of str
        Use only faces of these groups; all by default.

    Returns
    -------
    Candidates
        Their source has the name of the room; `index` is the face.

    Raises
    ------
    ConfigError
        For a spacing or an inset outside its range, and for an unknown group.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement import Room, in_room
    >>> mesh, camera = rc.shapes.room(), rc.Camera.from_fov(640, 480, hfov_deg=80)
    >>> hall = Room.at(mesh, (0, 0, 1.5))
    >>> result = in_room(mesh, camera, room=hall, spacing=2, heights=(2.0, 2.6))
    >>> len(result), result.sources
    (8, ('in room',))
    """
    if not 0 < spacing < np.inf or not 0 < inset <= LARGEST_COORDINATE:
        raise ConfigError(
            f"expected spacing and inset above 0 m, got {spacing} and {inset}; give metres"
        )
    low, high = room.bounds.copy()
    if heights is not None:
        limits = finite_points("heights", heights, (2,), "two finite numbers")
        low[2], high[2] = max(low[2], limits[0]), min(high[2], limits[1])
    surface, corners = nearest_obstacle(mesh), mesh.vertices[mesh.faces]
    is_level = np.abs(mesh.normals[:, 2]) >= LEVEL
    usable = np.where(is_level, "ceiling" in on, "walls" in on) & ~mesh.degenerate_mask
    usable &= ~mesh.target_mask & (_of_groups(mesh, groups) if len(groups) else True)
    usable &= (corners.max(axis=1) >= low - inset).all(axis=1)
    usable &= (corners.min(axis=1) <= high + inset).all(axis=1)
    rows = np.flatnonzero(usable)
    if surface is None or not len(rows):
        return Candidates.of(np.zeros((0, 4, 4)), IN_ROOM + room.name)
    result = cells(Mesh(mesh.vertices, mesh.faces[rows]), min(FINEST, spacing / 2))
    rows = np.tile(rows[result.source_face], 2)
    away = mesh.normals[rows] * np.repeat((float(inset), -float(inset)), len(result))[:, None]
    eyes = np.tile(result.vertices[result.faces].mean(axis=1), (2, 1)) + away
    within = np.clip(eyes, low, high)
    kept = (np.abs(eyes - within) <= result.size * np.array([0, 0, 1])).all(axis=1)
    kept &= ~(is_level[rows] & (away[:, 2] > 0))
    eyes, rows = within[kept], rows[kept]
    tight = np.arange(len(eyes))
    for _ in range(PUSHES):
        near = surface.query(eyes[tight])
        is_tight = (near.distance > 0) & (near.distance < inset)
        tight, way = tight[is_tight], (eyes[tight] - near.point)[is_tight]
        eyes[tight] += way * (inset / near.distance[is_tight] - 1)[:, None]
    kept = np.abs(surface.query(eyes).distance / inset - 1) <= INSET_TOLERANCE_REL
    kept &= ((low <= eyes) & (eyes <= high)).all(axis=1) & ~in_solid(mesh, eyes)
    eyes, rows = eyes[kept], rows[kept]
    kept = np.flatnonzero(room.contains(eyes))
    kept = kept[_spread_out(eyes[kept], spacing)]
    every = [
        _take_aim(mesh, framing, eyes[kept], rule, IN_ROOM + room.name, rows[kept])
        for rule in list(aims) or [at_point(room.middle)]
    ]
    return reduce(Candidates.__add__, every)


def _spread_out(points: FloatArray, spacing: float) -> list[int]:
    """Rows of (N, 3) points: each furthest from those before, until none is beyond the spacing."""
    chosen: list[int] = []
    distance = np.full(len(points), np.inf)
    following = np.lexsort(points.T[::-1])[:1]
    while len(following) and distance[following[0]] > spacing:
        chosen.append(int(following[0]))
        distance = np.minimum(distance, norm(points - points[following]))
        following = np.argmax(distance, keepdims=True)
    return chosen


def _of_groups(mesh: Mesh, names: Sequence[str]) -> BoolArray:
    """(F,) faces of the groups of these names; ConfigError for an unknown one."""
    known = [group.name for group in mesh.groups]
    if unknown := sorted(set(names) - set(known)):
        raise ConfigError(
            f"expected a group, got {shown(unknown[0])}; groups are {list_names(known)}"
        )
    return np.isin(mesh.face_group, [known.index(name) for name in names])


def _around(
    mesh: Mesh,
    camera: Camera,
    framing: Framing,
    count: int,
    centre: ArrayLike | None,
    distances: float | Sequence[float] | None,
    height: float,
    source: str,
) -> Candidates:
    """Views from the upper part, `height` radii high, of spheres."""
    if not 1 <= count <= MOST_POSITIONS:
        raise ConfigError(f"expected count from 1 to {MOST_POSITIONS}, got {count}; change it")
    middle = mesh.centre if centre is None else _triple("centre", centre)
    if distances is None:
        radii = np.array([_whole_in_view(mesh, camera, framing, middle)])
    else:
        radii = finite_points("distances", np.atleast_1d(distances), (-1,), "finite numbers")
        if not (radii > 0).all():
            raise ConfigError(f"expected distances above 0 m, got {shown(distances)}; correct them")
    outward = matmul(fibonacci_sphere(count, height), _upright(framing).T)
    eyes = (middle + radii[:, None, None] * outward).reshape(-1, 3)
    return _take_aim(mesh, framing, eyes, at_point(middle), source)


def _whole_in_view(mesh: Mesh, camera: Camera, framing: Framing, centre: FloatArray) -> float:
    """Distance at which the ball about `centre` that holds the mesh is in view and in focus."""
    least, greatest = framing.limits(camera)
    radius, distance = enclosing_distance(mesh, camera, centre, framing.margin)
    if not camera.is_parallel:
        distance = max(distance, least + radius)
    return float(np.clip(distance, least, greatest))


def _upright(framing: Framing) -> FloatArray:
    """(3, 3) rotation that turns z to `Framing.up`; none where they are the same."""
    up = unit(framing.up)
    if up[2] == 1.0:
        return np.eye(3)
    first = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    first /= norm(first)
    return np.stack((first, np.cross(up, first), up), axis=1)


def _take_aim(
    mesh: Mesh, framing: Framing, eyes: FloatArray, aim: Aim, source: str, index: ArrayLike = -1
) -> Candidates:
    """Views from `eyes` by a rule, each with every roll; positions at their target are left out."""
    targets = np.asarray(aim(mesh, eyes), np.float64) if len(eyes) else eyes
    seeing = (targets != eyes).any(axis=1)
    index = np.broadcast_to(index, len(eyes))[seeing]
    eyes, targets = eyes[seeing], targets[seeing]
    if not len(eyes):
        return Candidates.of(np.zeros((0, 4, 4)), source)
    return roll_candidates(look_at(eyes, targets, framing.up), source, index, framing)


def _box(mesh: Mesh, bounds: ArrayLike | None, outward: float) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the enlarged box."""
    given = mesh.opaque.bounds if bounds is None else bounds
    box = finite_points("bounds", given, (2, 3), "two finite corners, (2, 3)")
    if not abs(outward) <= LARGEST_COORDINATE:
        raise ConfigError(
            f"expected an offset within ±{LARGEST_COORDINATE:g} m, got {outward}; give metres"
        )
    low, high = box[0] - outward, box[1] + outward
    if not (low <= high).all():
        raise ConfigError(f"expected a box with low <= high, got {low} and {high}; change bounds")
    return low, high


def _triple(name: str, value: ArrayLike) -> FloatArray:
    return finite_points(name, value, (3,), "three finite numbers")
