"""Targets: surfaces that are evaluated but do not occlude, made for a scene and added to it.

A sheet above a floor represents points at the height of heads, upright squares on it the faces of
people, a grid of boxes a capture volume. All are plain meshes; `with_target` adds one to a scene as
a group of its own.
"""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rastercov.base import (
    TINY,
    BoolArray,
    FloatArray,
    IntArray,
    MeshError,
    cos,
    dots,
    finite_points,
    norm,
    shorten,
    shown,
    sin,
    sort_order,
)
from rastercov.base.format import area
from rastercov.base.typed import typed
from rastercov.core.mesh.groups import Group, list_names, names_of_groups
from rastercov.core.mesh.mesh import Mesh, faces_of_groups, names_of
from rastercov.core.mesh.shapes import box

STEEPEST_DEG = 45.0
"""Slope up to which a face counts as facing up."""
COINCIDENT_REL = 1e-7
"""Distance up to which faces of a sheet coincide, relative to its diagonal."""
LAYERS = 0.3
"""Height between the layers of a floor at most, metres."""
DIGITS = 6
"""Decimals of the heights of places, metres; those of faces that meet there are the same."""
MOST_BOXES = 100_000
"""Boxes of one grid; squares of one sheet."""
MOST_DIRECTIONS = 360
"""In which squares of a sheet face."""


@typed
def sheet_above(mesh: Mesh, group: str | Sequence[str], height: float) -> Mesh:
    """Faces of a group that face up, lifted by a height: a sheet that faces up.

    Parameters
    ----------
    mesh : Mesh
        The scene; z is up.
    group : str or sequence of str
        Names of groups or files, a floor for example. Faces steeper than `STEEPEST_DEG` are left
        out; slopes stay slopes. Of faces up to `LAYERS` above one another, such as a floor and
        the slab that carries it, the highest counts, and a note of the sheet says so. In a
        two-sided group faces that face down count, too, and are turned over.
    height : float
        Metres.

    Raises
    ------
    MeshError
        For an unknown group, one without a face that faces up, or a height that is not finite.
    ConfigError
        For an argument of another type.
    """
    members = names_of_groups("group", group, names_of(mesh)) or set()
    if not math.isfinite(height):
        raise MeshError(f"expected a finite height, got {height} m")
    upward = np.where(mesh.two_sided_mask, abs(mesh.normals[:, 2]), mesh.normals[:, 2])
    chosen = faces_of_groups(mesh, members) & (upward >= cos(math.radians(STEEPEST_DEG)))
    if not chosen.any():
        own = repr(list_names(sorted(members)))
        raise MeshError(
            f"expected a face of group {own} that faces up within {STEEPEST_DEG:g} degrees, got "
            "none"
        )
    faces = mesh.faces[chosen]
    is_turned = mesh.normals[chosen, 2] < 0
    faces[is_turned] = faces[is_turned, ::-1]
    used, corners = np.unique(faces, return_inverse=True)
    sheet = Mesh(mesh.vertices[used] + (0.0, 0.0, height), corners.reshape(-1, 3))
    highest = _highest(sheet)
    if highest is sheet:
        return sheet
    name = shorten(", ".join(sorted(members)), 60)
    lost = area(sheet.areas.sum() - highest.areas.sum(), whole=float(sheet.areas.sum()))
    note = f"sheet above {name}: of faces up to {LAYERS:g} m apart the highest counts, {lost} less"
    return Mesh(highest.vertices, highest.faces, notes=(note,))


def _highest(sheet: Mesh) -> Mesh:
    """The sheet without what lies on another face of it, or up to `LAYERS` below one.

    Of faces that coincide, up to `COINCIDENT_REL` of the diagonal, the first of the file stays
    whole. Of faces that are cut triangles are left. A sheet without layers is returned as it is.
    """
    import shapely

    origin, tolerance = sheet.bounds[0], COINCIDENT_REL * sheet.diagonal
    corners = sheet.vertices[sheet.faces] - origin
    slopes = -sheet.normals[:, :2] / sheet.normals[:, 2:]

    def heights(faces: IntArray, xy: FloatArray) -> FloatArray:
        """Heights of the planes of faces (N,) at points (N, 2)."""
        first = corners[faces, 0]
        values: FloatArray = first[:, 2] + dots(slopes[faces], xy - first[:, :2])
        return values

    seen = shapely.polygons(corners[..., :2])
    one, other = shapely.STRtree(seen).query(seen)
    one, other = one[other < one], other[other < one]
    common = shapely.intersection(seen[one], seen[other])
    is_wide = _are_wide(common, tolerance)
    one, other, common = one[is_wide], other[is_wide], common[is_wide]
    xy, pair = shapely.get_coordinates(common, return_index=True)
    rise = heights(other[pair], xy) - heights(one[pair], xy)
    is_apart = np.bincount(pair, np.abs(rise) > tolerance, len(one)) > 0
    lower, hidden = one[~is_apart], common[~is_apart]
    if is_apart.all():  # between layers, once nothing coincides
        slope, ends = slopes[other] - slopes[one], (0.0, LAYERS + tolerance)
        hidden = [_between(common, pair, xy, sign * rise, sign * slope, ends) for sign in (1, -1)]
        lower, hidden = np.append(one, other), np.concatenate(hidden)
        lower, hidden = lower[is_wide := _are_wide(hidden, tolerance)], hidden[is_wide]
    if not len(lower):
        return sheet
    order = sort_order(lower)
    cut, starts = np.unique(lower[order], return_index=True)
    above = [shapely.union_all(each) for each in np.split(hidden[order], starts[1:])]
    rests, row = shapely.get_parts(shapely.difference(seen[cut], above), return_index=True)
    is_wide = _are_wide(rests, tolerance)
    triangles, part = shapely.get_parts(
        shapely.constrained_delaunay_triangles(rests[is_wide]), return_index=True
    )
    xy = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)[:, :3]
    z = heights(cut[row[is_wide][part]].repeat(3), xy.reshape(-1, 2)).reshape(-1, 3, 1)
    kept = np.concatenate((np.delete(corners, cut, axis=0), np.concatenate((xy, z), axis=2)))
    vertices = kept.reshape(-1, 3) + origin
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return _highest(Mesh(vertices, faces[~Mesh(vertices, faces).degenerate_mask]))


def _between(
    polygons: NDArray[np.object_],
    row: IntArray,
    xy: FloatArray,
    values: FloatArray,
    slopes: FloatArray,
    limits: tuple[float, float],
) -> NDArray[np.object_]:
    """Part of each polygon where a linear function is within limits.

    Its values (M,) are at the corners (M, 2) of polygons `row` (M,), its slopes (N, 2).
    """
    import shapely

    first = np.searchsorted(row, np.arange(len(polygons)))
    low, high = limits
    least, greatest = (each.reduceat(values, first) for each in (np.minimum, np.maximum))
    is_whole = (least >= low) & (greatest <= high)
    cut = np.flatnonzero(~is_whole & (greatest > low) & (least < high))
    size = np.maximum(norm(slopes[cut]), TINY)[:, None]
    along = slopes[cut] / size
    across = np.stack((-along[:, 1], along[:, 0]), axis=1)
    far = 4 * float(np.abs(xy).max(initial=0.0))
    ends = np.clip((np.array(limits) - values[first[cut], None]) / size, -far, far)
    corners = [
        xy[first[cut]] + ends[:, [end]] * along + side * across
        for end, side in ((0, -far), (0, far), (1, far), (1, -far))
    ]
    between = np.where(is_whole, polygons, shapely.Polygon())
    between[cut] = shapely.intersection(polygons[cut], shapely.polygons(np.stack(corners, axis=1)))
    return between


def _are_wide(polygons: ArrayLike, tolerance: float) -> BoolArray:
    """True for polygons that are wider than rounding makes those of faces side by side."""
    import shapely

    wide: BoolArray = shapely.area(polygons) > tolerance * shapely.length(polygons) / 2
    return wide


@typed
def faces_on(sheet: Mesh, facing: ArrayLike = 8, spacing: float = 0.5, size: float = 0.2) -> Mesh:
    """Upright squares on a sheet, for faces of people: one for each place and direction.

    Parameters
    ----------
    sheet : Mesh
        Surface with the middles of the heads; z is up.
    facing : int or (N, 3) float
        Number of directions, equal angles from +x; or the directions themselves, made level.
    spacing : float
        Most distance of places along x and y, metres.
    size : float
        Edge of a square, metres; it is half as far before the middle of the head.

    Returns
    -------
    Mesh
        Two faces for each square, of all places the first direction first; each faces outward.

    Raises
    ------
    MeshError
        For a sheet with no place, no or too many squares, lengths of 0 or less, or vertical
        directions.
    ConfigError
        For an argument of another type, or directions that are not finite.

    Examples
    --------
    >>> import rastercov as rc
    >>> from rastercov.placement.targets import faces_on, sheet_above
    >>> sheet = sheet_above(rc.shapes.room(), "room", 1.6)
    >>> faces_on(sheet, facing=4, spacing=1.0).n_faces
    240
    """
    import shapely

    ahead = _level_directions(facing)
    low, high = sheet.bounds
    count = count_for(low, high, spacing)[:2]
    n_squares = math.prod(count.tolist()) * len(ahead)
    if n_squares > MOST_BOXES or not size > 0:
        raise MeshError(
            f"expected at most {MOST_BOXES:,} squares of a size above 0 m, got {n_squares:,} of "
            f"{size:g} m; increase spacing or size"
        )
    xy = low[:2] + (np.argwhere(np.ones(count)) + 0.5) * (high - low)[:2] / count
    is_upright = sheet.normals[:, 2] == 0
    corners, normals = sheet.vertices[sheet.faces[~is_upright]], sheet.normals[~is_upright]
    face, place = shapely.STRtree(shapely.points(xy)).query(
        shapely.polygons(corners[..., :2]), predicate="intersects"
    )
    first, normal = corners[face, 0], normals[face]
    rise = dots(normal[:, :2], first[:, :2] - xy[place]) / normal[:, 2]
    z = first[:, 2] + rise
    heads = np.unique(np.column_stack((xy[place], z.round(DIGITS))), axis=0)
    if not len(heads):
        raise MeshError("expected a point on the surface, got none; decrease spacing")
    across = np.cross((0, 0, 1), ahead)
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    shape = ahead[:, None] + across[:, None] * square[:, :1]
    shape[..., 2] = square[:, 1]
    vertices = (shape[:, None] * size / 2 + heads[:, None]).reshape(-1, 3)
    faces = 4 * np.arange(len(vertices) // 4)[:, None, None] + ((0, 1, 2), (0, 2, 3))
    return Mesh(vertices, faces.reshape(-1, 3))


def _level_directions(facing: ArrayLike) -> FloatArray:
    """(N, 3) level unit directions, given as such or as their number."""
    if isinstance(facing, int | np.integer):
        if not 1 <= facing <= MOST_DIRECTIONS:
            raise MeshError(
                f"expected from 1 to {MOST_DIRECTIONS} directions in facing, got {shown(facing)}; "
                "change it"
            )
        angles = np.linspace(0, 2 * np.pi, int(facing), endpoint=False)
        facing = np.stack((cos(angles), sin(angles), 0 * angles), axis=1)
    ahead = finite_points("facing", facing, (-1, 3), "their number, or vectors") * (1.0, 1.0, 0.0)
    length = norm(ahead)[..., None]
    if not len(ahead) or not (length > 0).all():
        raise MeshError("expected level directions in facing, got none, or one along z; change it")
    return np.asarray(ahead / length)


@typed
def box_grid(
    low: ArrayLike, high: ArrayLike, count: ArrayLike = (1, 1, 1), size: float | None = None
) -> Mesh:
    """Boxes in a regular grid: one in the middle of each cell of a volume, hollow, facing outward.

    Parameters
    ----------
    low, high : (3,) float
        Corners of the volume, metres; low < high.
    count : (3,) int
        Cells along x, y and z; `MOST_BOXES` in all at most.
    size : float, optional
        Edge of a cube, metres, at most that of a cell; by default a box is half as long, wide and
        high as its cell.

    Raises
    ------
    MeshError
        For corners, counts or a size that make no boxes.
    ConfigError
        For an argument of another type, or corners that are not finite.
    """
    lowest, highest = _corners(low, high)
    cells = np.asarray(count)
    if not (lowest < highest).all():
        both = f"{lowest.tolist()} and {highest.tolist()}"
        raise MeshError(f"expected corners low < high on every axis of a volume, got {both}")
    if cells.shape != (3,) or cells.dtype.kind not in "iu" or not (cells >= 1).all():
        raise MeshError(
            f"expected count to be three whole numbers of 1 or more, got {cells.tolist()}"
        )
    n_boxes = math.prod(cells.tolist())
    if n_boxes > MOST_BOXES:
        raise MeshError(
            f"expected at most {MOST_BOXES:,} boxes of a grid, got {n_boxes:,}; use fewer"
        )
    cell = (highest - lowest) / cells
    if size is not None and not 0 < size <= cell.min() * (1 + 1e-9):
        most = f"{cell.min():.3g} m"
        raise MeshError(f"expected size above 0 and at most that of a cell, {most}, got {size:g} m")
    half = (cell / 2 if size is None else np.full(3, size)) / 2
    places = np.array(list(product(*(range(n) for n in cells.tolist()))))
    middles = lowest + (places + 0.5) * cell
    cube = box((2.0, 2.0, 2.0))
    vertices = (middles[:, None] + cube.vertices * half).reshape(-1, 3)
    faces = cube.faces + 8 * np.arange(n_boxes)[:, None, None]
    return Mesh(vertices, faces.reshape(-1, 3))


@typed
def count_for(low: ArrayLike, high: ArrayLike, spacing: float) -> IntArray:
    """(3,) fewest cells along each axis of a volume that are no longer than `spacing`, metres.

    MeshError for a spacing of 0 or less; ConfigError as for `box_grid`.
    """
    if not spacing > 0:
        raise MeshError(f"expected spacing above 0 m, got {spacing:g}")
    lowest, highest = _corners(low, high)
    extent = highest - lowest
    # Lengths that are multiples of the spacing up to rounding get no extra cell.
    with np.errstate(over="ignore"):
        wanted = np.clip(np.ceil(extent / spacing - 1e-9), 1, 2.0**31)
    return wanted.astype(np.int64)


def _corners(low: ArrayLike, high: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Corners of a volume, (3,) each, or ConfigError."""
    wanted = "three finite numbers"
    return finite_points("low", low, (3,), wanted), finite_points("high", high, (3,), wanted)


@typed
def with_target(mesh: Mesh, target: Mesh, name: str, *, two_sided: bool = False) -> Mesh:
    """Scene with the faces of another mesh as a target, in a group of its own behind the others.

    Groups of `target` are merged, whatever their roles. MeshError for a name that is taken.
    """
    return Mesh(
        vertices=np.concatenate((mesh.vertices, target.vertices)),
        faces=np.concatenate((mesh.faces, target.faces + mesh.n_vertices)),
        groups=[*mesh.groups, Group(name, is_two_sided=two_sided, is_target=True)],
        face_group=np.concatenate(
            (mesh.face_group, np.full(target.n_faces, len(mesh.groups), np.int32))
        ),
        source_face=np.concatenate((mesh.source_face, target.source_face)),
        sources=(*mesh.sources, *target.sources),
        notes=tuple(dict.fromkeys((*mesh.notes, *target.notes))),
        spaces=mesh.spaces,
    )
