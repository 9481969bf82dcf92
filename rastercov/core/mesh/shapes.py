"""Built-in meshes, for trials, examples, tests and benchmarks.

Every function returns the same `Mesh` for the same arguments; z is up, lengths are metres, faces
are wound counter-clockwise seen from outside. The aeroplane replaces that of Eissa (2020), which is
not public. `rastercov/data/README.md` documents the origin of the stored numbers.

M. Newell. The Utilization of Procedure Models in Digital Image Synthesis. 1975 (the teapot).
E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020.
"""

import json
from importlib.resources import files
from itertools import combinations
from math import comb
from operator import index

import numpy as np
from numpy.typing import NDArray

from rastercov.base import (
    LARGEST_COORDINATE,
    AnyArray,
    FloatArray,
    IntArray,
    MeshError,
    check_seed,
    cos,
    matmul,
    norm,
    shown,
    sin,
)
from rastercov.base.typed import typed
from rastercov.core.mesh.groups import Group, list_names
from rastercov.core.mesh.mesh import BUILT_IN, Mesh

DATA = files("rastercov") / "data"
TEAPOT_UNIT = 0.05  # metres for Newell's unit: 0.32 m from handle to spout, 0.16 m high
POINTS_PER_UNIT = 100_000  # Newell's control points have at most five decimals
MOST_A_SIDE = 10_000  # rows, columns: 1e8 faces and more
AEROPLANE_FACES = (1970, 9856)


@typed
def teapot(n: int = 10, *, keep_degenerate: bool = False) -> Mesh:
    """Newell's teapot: 32 bicubic patches of n x n quads, two faces each.

    Handle at -x, spout at +x, foot at z = 0; 0.32 m from handle to spout. The teapots of E. S.
    Eissa (2020) are `teapot(5)` with 1560 faces, and `keep_degenerate=True` with 6400 and 9216
    faces at n = 10 and 12.

    Parameters
    ----------
    n : int
        Quads along each side of a patch, 2 ... 128.
    keep_degenerate : bool
        Keep the 8 n faces without area at the three poles (lid, bottom): 64 n^2 faces in all.

    Returns
    -------
    Mesh
        64 n^2 - 8 n faces by default, consistently wound; patches share vertices exactly. Open:
        16 n boundary edges at the rim, around the lid and at both ends of handle and spout, which
        pass through the body.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.teapot(5)
    >>> mesh.n_faces, round(mesh.diagonal, 2)  # metres
    (1560, 0.41)
    """
    n = index(n)  # an int8 would overflow below
    if not 2 <= n <= 128:
        raise MeshError(f"expected n in 2 ... 128, got {n}")
    patches = _patches_of_teapot()
    # Bernstein polynomials at k/n, times n^3, are integers, and so is each point times n^6, below
    # 2^63 for n <= 128: points that two patches share are equal without a tolerance.
    k = np.arange(n + 1)
    weights = np.stack([comb(3, i) * k**i * (n - k) ** (3 - i) for i in range(4)], axis=1)
    lattice = np.einsum("ui,vj,pijx->puvx", weights, weights, patches)
    points, corners = _weld(lattice)
    faces = _triangulate(corners)
    if not keep_degenerate:
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    return Mesh(vertices=points / (n**6 * POINTS_PER_UNIT / TEAPOT_UNIT), faces=faces)


def _patches_of_teapot() -> IntArray:
    """(32, 4, 4, 3) control points, from one patch of each ring and half of handle and spout.

    Rows of a ring are r, s and z of the points (r, 0), (r, -s), (s, -r) and (0, -r); of half a
    patch of handle and spout, x and z at y = 0, and y, x and z at the other side.
    """
    data = json.loads((DATA / "teapot.json").read_text(encoding="utf-8"))
    rings, sides = (
        np.moveaxis(np.rint(np.array(data[name]) * POINTS_PER_UNIT).astype(np.int64), 2, 0)
        for name in ("rings", "sides")
    )
    r, s, z = rings
    none = np.zeros_like(r)
    quarter = np.stack([[r, r, s, none], [none, -s, -r, -r], [z, z, z, z]]).transpose(2, 3, 1, 0)
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turns = [np.linalg.matrix_power(turn, k) for k in range(4)]
    whole = np.stack([matmul(quarter, each) for each in turns], axis=1)
    whole[-1, ..., 1] *= -1  # the bottom is wound the other way
    x, z, y, to_x, to_z = sides
    none = np.zeros_like(x)
    half = np.stack([[x, x, to_x, to_x], [none, -y, -y, none], [z, z, to_z, to_z]])
    half = half.transpose(2, 3, 1, 0)
    both = np.stack([half, half[:, :, ::-1] * (1, -1, 1)], axis=1)
    parts = whole[:3], both, whole[3:]
    return np.concatenate([each.reshape(-1, 4, 4, 3) for each in parts])


@typed
def aeroplane(n_faces: int = 1970) -> Mesh:
    """Twin-engined airliner: 30 m long, 29 m span, nose at +x, left wing at +y.

    One closed surface of genus 0 with the face counts of the aeroplanes of E. S. Eissa (2020), not
    their shape. The engines are below and in front of the wings, where they hide part of the
    fuselage.

    Parameters
    ----------
    n_faces : int
        1970 (987 vertices) or 9856 (4930 vertices).

    Returns
    -------
    Mesh
        Closed, consistently wound, outward.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.aeroplane()
    >>> mesh.n_faces, mesh.is_closed
    (1970, True)
    """
    if n_faces not in AEROPLANE_FACES:
        raise MeshError(f"expected n_faces to be one of {AEROPLANE_FACES}, got {n_faces}")
    with (DATA / "aeroplane.npz").open("rb") as file:
        stored = np.load(file, allow_pickle=False)
        return Mesh(vertices=stored[f"vertices_{n_faces}"], faces=stored[f"faces_{n_faces}"])


@typed
def torus(
    n_major: int = 100, n_minor: int = 50, major_radius: float = 1.0, minor_radius: float = 0.4
) -> Mesh:
    """Torus about the z axis: 2 n_major n_minor faces, 10,000 by default.

    Parameters
    ----------
    n_major, n_minor : int
        Quads around the axis and around the tube, at least 3 each.
    major_radius, minor_radius : float
        Distance from the axis to the middle of the tube, and radius of the tube, metres; minor <
        major.

    Returns
    -------
    Mesh
        Closed, genus 1. Vertices lie on the torus, so that the mesh lies slightly inside it.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.torus(major_radius=0.3, minor_radius=0.1)
    >>> mesh.n_faces, mesh.is_closed, mesh.bounds[1].round(3).tolist()
    (10000, True, [0.4, 0.4, 0.1])
    """
    n_major, n_minor = _at_least(3, n_major=n_major, n_minor=n_minor)
    if not 0 < minor_radius < major_radius <= LARGEST_COORDINATE:
        got = f"{minor_radius} and {major_radius}"
        raise MeshError(f"expected a torus with 0 < minor_radius < major_radius, got {got}")
    around = (2 * np.pi / n_major * np.arange(n_major))[:, None]
    tube = (2 * np.pi / n_minor * np.arange(n_minor))[None]
    r, z = major_radius + minor_radius * cos(tube), minor_radius * sin(tube)
    points = np.stack(np.broadcast_arrays(r * cos(around), r * sin(around), z), axis=-1)
    numbers = np.arange(n_major * n_minor).reshape(n_major, n_minor)
    corners = np.pad(numbers, (0, 1), mode="wrap").T  # along a row: around the axis
    return Mesh(vertices=points.reshape(-1, 3), faces=_triangulate(corners))


@typed
def sphere(subdivisions: int = 4, radius: float = 1.0) -> Mesh:
    """Icosphere: 20 * 4^subdivisions nearly equal faces, 5,120 by default.

    Parameters
    ----------
    subdivisions : int
        Times that each face is split into four, 0 ... 9.
    radius : float
        Metres; every vertex lies at this distance from the origin.

    Returns
    -------
    Mesh
        Closed, convex.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.sphere(2, radius=0.5)
    >>> mesh.n_faces, mesh.bounds.round(3).tolist()
    (320, [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
    """
    _positive(radius=radius)
    points, faces = _subdivide_icosahedron(subdivisions)
    points *= radius / norm(points)[..., None]
    return Mesh(vertices=points, faces=faces)


@typed
def icosahedron(
    noise: float = 0.0, subdivisions: int = 0, seed: int = 0, edge_length: float = 1.0
) -> Mesh:
    """Icosahedron with flat sides, optionally subdivided and noisy.

    As in figure 6.3 of E. S. Eissa (2020).

    Parameters
    ----------
    noise : float
        Standard deviation of the Gaussian noise added to each vertex coordinate, as a fraction of
        the edge length of the subdivided faces, so that their tilt does not depend on
        `subdivisions`. Above about 0.2 the surface crosses itself.
    subdivisions : int
        Times that each face is split into four, 0 ... 9.
    seed : int
        Seed of the noise.
    edge_length : float
        Edge length of the icosahedron, metres.

    Returns
    -------
    Mesh
        20 * 4^subdivisions faces, closed; face f lies on side f // 4^subdivisions.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.icosahedron(edge_length=2)
    >>> mesh.n_faces, mesh.areas[0].round(3).item()  # m^2
    (20, 1.732)
    """
    if not noise >= 0:
        raise MeshError(f"expected noise, a standard deviation, to be 0 or more, got {noise}")
    _positive(edge_length=edge_length)
    check_seed(seed)
    points, faces = _subdivide_icosahedron(subdivisions)
    points += np.random.default_rng(seed).normal(scale=noise / 2**subdivisions, size=points.shape)
    return Mesh(vertices=points * edge_length, faces=faces)


@typed
def box(
    size: tuple[float, float, float] = (1.0, 1.0, 1.0),
    n: int = 1,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Mesh:
    """Box along the axes: 12 n^2 faces.

    Parameters
    ----------
    size, centre : three floats
        Full extent along x, y, z, positive, and the middle; metres.
    n : int
        Quads along each edge.

    Returns
    -------
    Mesh
        Closed, outward; sides in the order -x, +x, -y, +y, -z, +z.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.box((0.2, 0.2, 0.4), centre=(0, 0, 1))
    >>> mesh.n_faces, mesh.bounds.round(6).tolist()
    (12, [[-0.1, -0.1, 0.8], [0.1, 0.1, 1.2]])
    """
    (n,) = _at_least(1, n=n)
    if len(size) != 3 or len(centre) != 3:
        raise MeshError(
            f"expected size and centre to be three numbers each, got {size} and {centre}"
        )
    _positive(size=min(size))
    _positive(size=max(size))
    row, column = np.indices((n + 1, n + 1))
    sides = []
    for axis in range(3):
        low = np.roll(np.stack([np.zeros_like(row), row, column], axis=-1), axis, axis=-1)
        high = np.roll(np.stack([np.full_like(row, n), column, row], axis=-1), axis, axis=-1)
        sides += [low, high]
    points, corners = _weld(np.stack(sides))
    return Mesh(vertices=(points / n - 0.5) * size + centre, faces=_triangulate(corners))


@typed
def room(n: int = 8) -> Mesh:
    """Room of 6 x 5 x 2.8 m, whose walls face inward, with three crates.

    The crates are 0.1 m above the floor, so that no two faces coincide. The origin is the centre of
    the floor.

    Parameters
    ----------
    n : int
        Quads along each edge of the room, and half as many, rounded up, along those of a crate.

    Returns
    -------
    Mesh
        Groups "room" (12 n^2 faces, facing inward) and "crates" (outward). Closed; the room is a
        cavity, so back faces are never culled and `warnings` reports a component as inside out.

    Examples
    --------
    >>> import rastercov as rc
    >>> mesh = rc.shapes.room()
    >>> [group.name for group in mesh.groups], mesh.bounds.round(3).tolist()
    (['room', 'crates'], [[-3.0, -2.5, 0.0], [3.0, 2.5, 2.8]])
    """
    (n,) = _at_least(1, n=n)
    shell = box((6.0, 5.0, 2.8), n, (0.0, 0.0, 1.4))
    m = (n + 1) // 2
    parts = [
        Mesh(shell.vertices, shell.faces[:, ::-1]),
        box((1.2, 0.8, 1.0), m, (-1.5, -1.0, 0.6)),
        box((0.8, 0.8, 0.8), m, (1.2, 0.9, 0.5)),
        box((0.8, 1.2, 1.6), m, (1.6, -1.4, 0.9)),
    ]
    starts = np.cumsum([0, *(part.n_vertices for part in parts)])
    faces = np.concatenate([p.faces + start for p, start in zip(parts, starts, strict=False)])
    return Mesh(
        vertices=np.concatenate([part.vertices for part in parts]),
        faces=faces,
        groups=(Group("room"), Group("crates")),
        face_group=(np.arange(len(faces)) >= shell.n_faces).astype(np.int32),
    )


BUILT_IN |= {
    "aeroplane": aeroplane,
    "aeroplane-9856": lambda: aeroplane(9856),
    "box": box,
    "icosahedron": icosahedron,
    "room": room,
    "sphere": sphere,
    "teapot": teapot,
    "teapot-5": lambda: teapot(5),
    "teapot-12": lambda: teapot(12),
    "torus": torus,
}
NAMES = tuple(BUILT_IN)


@typed
def by_name(name: str) -> Mesh:
    """Built-in mesh of a name in `NAMES`; MeshError for another name.

    Examples
    --------
    >>> import rastercov as rc
    >>> rc.shapes.NAMES[:3]
    ('aeroplane', 'aeroplane-9856', 'box')
    >>> rc.shapes.by_name("box").n_faces
    12
    """
    if name not in BUILT_IN:
        near = list_names(NAMES, name.lower())
        raise MeshError(f"expected a built-in mesh, such as {near}, got {shown(name)}")
    return BUILT_IN[name]()


def _at_least(least: int, **counts: int) -> list[int]:
    """Counts as integers of Python, of which no product overflows."""
    for name, count in counts.items():
        if not least <= count <= MOST_A_SIDE:
            raise MeshError(
                f"expected {name} to be from {least} to {MOST_A_SIDE}, got {shown(count)}"
            )
    return list(map(index, counts.values()))


def _positive(**lengths: float) -> None:
    for name, length in lengths.items():
        if not 0 < length <= LARGEST_COORDINATE:
            wanted = f"above 0 and at most {LARGEST_COORDINATE:g} m"
            raise MeshError(f"expected {name} to be {wanted}, got {length}")


def _weld(lattice: IntArray) -> tuple[IntArray, NDArray[np.intp]]:
    """(V, 3) distinct points of a (..., 3) integer array, and the index (...) of each."""
    points, index = np.unique(lattice.reshape(-1, 3), axis=0, return_inverse=True)
    return points, index.reshape(lattice.shape[:-1])


def _triangulate(corners: AnyArray) -> AnyArray:
    """(F, 3) faces, two for each cell of (..., rows, columns) vertex indices.

    A face's normal is (direction along a row) x (direction along a column).
    """
    a, b = corners[..., :-1, :-1], corners[..., :-1, 1:]
    d, c = corners[..., 1:, :-1], corners[..., 1:, 1:]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def _subdivide_icosahedron(times: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Vertices and faces of an icosahedron with edges of length 1, each face split 4^times."""
    if not 0 <= times <= 9:
        raise MeshError(f"expected subdivisions in 0 ... 9, got {times}; 9 give 5,242,880 faces")
    golden = (1 + 5**0.5) / 2
    ends = [(0.0, y / 2, z * golden / 2) for y in (-1, 1) for z in (-1, 1)]
    points = np.array([np.roll(p, axis) for axis in range(3) for p in ends])
    # The sides are the triples of vertices whose distances are all 1, turned outward.
    triples = np.array(list(combinations(range(12), 3)))
    spans = norm(points[triples] - points[np.roll(triples, 1, axis=1)])
    faces = triples[np.isclose(spans, 1).all(axis=1)]
    is_inward = np.linalg.det(points[faces]) < 0
    faces[is_inward] = faces[is_inward][:, ::-1]
    for _ in range(times):
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
        shared, middle = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        ab, bc, ca = (middle.reshape(-1, 3) + len(points)).T
        a, b, c = faces.T
        points = np.concatenate([points, points[shared].mean(axis=1)])
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=-1).reshape(-1, 3)
    return points, faces
