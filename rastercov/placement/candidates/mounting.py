"""Candidate poses at mounting positions: around a part, on walls, under a ceiling.

The generators of `pool` follow the surface of the part; these follow the space where cameras can be
mounted. Positions are on a sphere, or on a grid on the sides of a box with a rule for the aim.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base.arguments import LARGEST_COORDINATE, finite_points
from rastercov.base.checks import shown
from rastercov.base.errors import ConfigError
from rastercov.base.memory import FloatArray
from rastercov.base.typed import typed
from rastercov.camera.camera import Camera
from rastercov.camera.viewpoints import enclosing_distance, fibonacci_sphere, look_at
from rastercov.mesh import Mesh
from rastercov.placement.candidates.clearance import NearestSurface
from rastercov.placement.candidates.pool import DEFAULT, Candidates, Framing, rolled_candidates

Aim = Callable[[Mesh, FloatArray], FloatArray]
"""Rule of aim: from a mesh and (N, 3) camera centres, (N, 3) targets, metres."""
SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
WALLS, CEILING = SIDES[:4], SIDES[5:]
MOST_POSITIONS = 10_000_000


@typed
def at_point(point: ArrayLike) -> Aim:
    """Look at one point, (3,) metres."""
    target = _triple("point", point)
    return lambda mesh, eyes: np.broadcast_to(target, eyes.shape)


@typed
def along(direction: ArrayLike) -> Aim:
    """Look in one direction, (3,), at every position."""
    step = _triple("direction", direction)
    length = np.linalg.norm(step)
    if not length > 0:
        raise ConfigError("direction must not be zero; give three numbers")
    return lambda mesh, eyes: eyes + step / length


def at_middle() -> Aim:
    """Look at the middle of the mesh's bounding box: of the part, or of the room."""
    return lambda mesh, eyes: np.broadcast_to(mesh.bounds.mean(axis=0), eyes.shape)


@typed
def at_nearest_surface(groups: str | Sequence[str] | None = None) -> Aim:
    """Look at the nearest point of the task faces, or of the groups of these names.

    For a camera on the wall of a room that wall is the nearest surface: name the groups to look at.
    """
    names = [groups] if isinstance(groups, str) else groups

    def aim(mesh: Mesh, eyes: FloatArray) -> FloatArray:
        chosen = mesh.task_mask
        if names is not None:
            known = [group.name for group in mesh.groups]
            if unknown := sorted(set(names) - set(known)):
                raise ConfigError(f"groups must be among {known}, got {unknown}; correct them")
            chosen = np.isin(mesh.face_group, [known.index(name) for name in names])
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
    """Views of the part from all sides: a Fibonacci lattice, looking at its centre.

    Parameters
    ----------
    count : int
        Positions on each sphere, 1 or more.
    centre : (3,) array_like, optional
        Metres; the middle of the bounding box by default.
    distances : float or sequence of float, optional
        Radii of the spheres, metres. By default one, at which all of the part is in view and beyond
        the near limit of the depth of field, clipped to the limits of the stand-off.

    Returns
    -------
    Candidates
        Sphere by sphere, from the top down.

    Raises
    ------
    ConfigError
        For a count or a distance outside its range.
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
    """Views of the part from above with respect to `Framing.up`; otherwise as `on_sphere`."""
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
        Side by side in the order given. Only rolls and up of `framing` apply, because the positions
        are fixed.

    Raises
    ------
    ConfigError
        For an empty box, an unknown side, or a spacing outside its range.
    """
    if not 0 < spacing < np.inf:
        raise ConfigError(f"spacing must be positive and finite, got {spacing}; give metres")
    low, high = _box(mesh, bounds, outward)
    if unknown := [side for side in sides if side not in SIDES]:
        raise ConfigError(f"sides must be among {', '.join(SIDES)}, got {', '.join(unknown)}")
    # Larger counts along one axis are refused below; a tiny spacing divides to inf.
    with np.errstate(over="ignore"):
        wanted = np.ceil((high - low) / spacing * (1 - 1e-12))
    steps = np.minimum(wanted, MOST_POSITIONS).astype(np.int64)
    if float(np.prod(np.sort(steps + 1)[1:].astype(np.float64))) * 6 > MOST_POSITIONS:
        raise ConfigError(f"a spacing of {spacing:g} m gives more than {MOST_POSITIONS} positions")
    ticks = [np.linspace(low[k], high[k], steps[k] + 1) for k in range(3)]
    grids = []
    for side in sides:
        axis, end = SIDES.index(side) // 2, SIDES.index(side) % 2
        across = list(ticks)
        across[axis] = np.array([(low, high)[end][axis]])
        grids.append(np.stack(np.meshgrid(*across, indexing="ij"), axis=-1).reshape(-1, 3))
    eyes = np.concatenate(grids) if grids else np.zeros((0, 3))
    eyes = eyes[np.sort(np.unique(eyes, axis=0, return_index=True)[1])]
    return _aimed(mesh, framing, eyes, aim or at_middle(), source)


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
    """Views from the four walls of a room, `on_box` with its sides along x and y; z is up.

    Parameters
    ----------
    inset : float
        Distance from each wall, floor and ceiling, metres.
    heights : (float, float), optional
        Lowest and highest z of the positions; from floor to ceiling by default.
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
    """Views from under the ceiling of a room, `inset` from it and the walls; z is up."""
    box = np.stack(_box(mesh, bounds, -inset))
    return on_box(
        mesh, camera, framing, spacing=spacing, aim=aim, bounds=box, sides=CEILING, source="ceiling"
    )


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
        raise ConfigError(f"count must be a whole number, 1 to {MOST_POSITIONS}, got {count}")
    middle = mesh.bounds.mean(axis=0) if centre is None else _triple("centre", centre)
    if distances is None:
        radii = np.array([_whole_in_view(mesh, camera, framing, middle)])
    else:
        radii = finite_points("distances", np.atleast_1d(distances), (-1,), "finite numbers")
        if not (radii > 0).all():
            raise ConfigError(f"distances must be positive and finite, got {shown(distances)}")
    outward = fibonacci_sphere(count, height) @ _upright(framing).T
    eyes = (middle + radii[:, None, None] * outward).reshape(-1, 3)
    return _aimed(mesh, framing, eyes, at_point(middle), source)


def _whole_in_view(mesh: Mesh, camera: Camera, framing: Framing, centre: FloatArray) -> float:
    """Distance at which the ball about `centre` that holds the mesh is in view and in focus."""
    least, greatest = framing.limits(camera)
    radius, distance = enclosing_distance(mesh, camera, centre, framing.margin)
    return float(np.clip(max(distance, least + radius), least, greatest))


def _upright(framing: Framing) -> FloatArray:
    """(3, 3) rotation that turns z to `Framing.up`; none where they are the same."""
    up = np.asarray(framing.up, np.float64)
    up = up / np.linalg.norm(up)
    if up[2] == 1.0:
        return np.eye(3)
    first = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    first /= np.linalg.norm(first)
    return np.stack((first, np.cross(up, first), up), axis=1)


def _aimed(mesh: Mesh, framing: Framing, eyes: FloatArray, aim: Aim, source: str) -> Candidates:
    """Views from `eyes` by a rule, each with every roll; positions at their target are left out."""
    targets = np.asarray(aim(mesh, eyes), np.float64) if len(eyes) else eyes
    seeing = (targets != eyes).any(axis=1)
    eyes, targets = eyes[seeing], targets[seeing]
    if not len(eyes):
        return Candidates.of(np.zeros((0, 4, 4)), source)
    return rolled_candidates(look_at(eyes, targets, framing.up), source, -1, framing)


def _box(mesh: Mesh, bounds: ArrayLike | None, outward: float) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of the enlarged box."""
    given = mesh.opaque.bounds if bounds is None else bounds
    box = finite_points("bounds", given, (2, 3), "two finite corners, (2, 3)")
    if not abs(outward) <= LARGEST_COORDINATE:
        raise ConfigError(
            f"outward and inset must be within ±{LARGEST_COORDINATE:g} m, got {outward}"
        )
    low, high = box[0] - outward, box[1] + outward
    if not (low <= high).all():
        raise ConfigError(f"the box must have low <= high on every axis, got {low} and {high}")
    return low, high


def _triple(name: str, value: ArrayLike) -> FloatArray:
    return finite_points(name, value, (3,), "three finite numbers")
