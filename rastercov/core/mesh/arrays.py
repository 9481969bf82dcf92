"""Checks of a mesh's arrays, and computations over its faces.

Every function takes whole arrays; `blocks` bounds the size of temporaries.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    LARGEST_COORDINATE,
    AnyArray,
    BoolArray,
    ConfigError,
    FloatArray,
    IntArray,
    MeshError,
    ResourceError,
    WholeArray,
    check_array,
    cos,
    dots,
    finite_points,
    matmul,
    norm,
    sin,
)
from rastercov.base.arguments import own_array

MOST_FACES = 2**31 - 1  # a pixel stores face index + 1
BLOCK = 1 << 17  # faces processed at once, so that temporaries fit in the cache
LEAST_SINE = 8 * float(np.finfo(np.float64).eps)
"""Sine of the angle between two edges below which the normal is only rounding."""
RIGID = 1e-9
"""Difference from a rotation below which a matrix is one; it is made orthogonal."""


def some(mask: BoolArray) -> str:
    """Text with the first few indices where `mask` is True, and their number."""
    rows = np.flatnonzero(mask)
    more = ", ..." if len(rows) > 5 else ""
    return f"[{', '.join(map(str, rows[:5]))}{more}], {len(rows)} in all"


def unusable_points(vertices: FloatArray) -> BoolArray:
    """(V,) points with a coordinate that is not finite or exceeds `LARGEST_COORDINATE`."""
    return ~np.all(np.abs(vertices) <= LARGEST_COORDINATE, axis=1)


def check_coordinates(vertices: FloatArray, faces: IntArray) -> None:
    """Raise MeshError if a vertex is unusable, with the faces that use it."""
    unusable = unusable_points(vertices)
    if unusable.any():
        raise MeshError(
            f"expected finite coordinates within ±{LARGEST_COORDINATE:g}, got other values in "
            f"{places_of(unusable, faces)}; repair them or drop them on loading (drop_invalid)"
        )


def places_of(unusable: BoolArray, faces: IntArray) -> str:
    """Text with the faces of vertices under a mask, or with the vertices if no face uses them."""
    rows = np.any(unusable[faces], axis=1)
    return f"faces {some(rows)}" if rows.any() else f"vertices {some(unusable)}, without a face"


def check_vertices(vertices: ArrayLike) -> FloatArray:
    """(V, 3) float64 copy, or MeshError, or ResourceError."""
    points = check_array("vertices", vertices, "iuf", "real numbers", MeshError)
    _check_rows("vertices", "V", points, "pass x, y, z rows")
    return own_array("vertices", points, np.float64)


def check_faces(faces: ArrayLike) -> IntArray:
    """(F, 3) int64 copy with F in 1 ... 2^31 - 1, or MeshError, or ResourceError."""
    corners = check_array("faces", faces, "iu", "integers", MeshError)
    if corners.size == 0:
        raise MeshError("expected faces of at least one row, got none; add triangles")
    _check_rows("faces", "F", corners, "triangulate quads first")
    return own_array("faces", corners, np.int64)


def _check_rows(name: str, letter: str, rows: AnyArray, advice: str) -> None:
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise MeshError(f"expected {name} of shape ({letter}, 3), got {rows.shape}; {advice}")
    if len(rows) > MOST_FACES:
        raise ResourceError(
            f"expected at most {MOST_FACES} {name}, got {len(rows)}; split the mesh"
        )


def bounds_of(vertices: FloatArray, faces: AnyArray) -> FloatArray:
    """(2, 3) lowest and highest coordinates of the vertices that faces use."""
    is_used = np.zeros(len(vertices), bool)
    is_used[faces] = True
    used = vertices if is_used.all() else vertices[is_used]
    return np.stack([used.min(axis=0), used.max(axis=0)])


def face_labels(name: str, values: ArrayLike, n_faces: int) -> IntArray:
    """(F,) int64 copy of one label per face, or of one label for all faces, or MeshError."""
    labels = check_array(name, values, "iu", "integers", MeshError)
    if labels.shape not in ((), (n_faces,)):
        raise MeshError(
            f"expected {name} of shape ({n_faces},), got {labels.shape}; pass one value per face"
        )
    return own_array(name, np.broadcast_to(labels, n_faces), np.int64)


def frozen(array: AnyArray) -> AnyArray:
    """Make `array` read-only and return it."""
    array.flags.writeable = False
    return array


def blocks(n: int) -> Iterator[slice]:
    """Slices that cover range(n)."""
    return (slice(start, start + BLOCK) for start in range(0, n, BLOCK))


def normals_and_areas(
    vertices: FloatArray, faces: WholeArray
) -> tuple[FloatArray, FloatArray, float]:
    """(F, 3) unit normals by the right-hand rule, (F,) areas; 0 where they are only rounding.

    And the least sine of the angle between two edges of the others, up to 1.
    """
    normals, areas, least = np.zeros((len(faces), 3)), np.zeros(len(faces)), 1.0
    for block in blocks(len(faces)):
        p, q, r = np.moveaxis(vertices[faces[block]], 1, 0)
        sides = np.stack([q - p, r - p])
        size = np.abs(sides).max(axis=(0, 2))  # scaled, so that no square under- or overflows
        sides /= np.where(size > 0, size, 1)[:, None]
        cross = np.cross(sides[0], sides[1])
        length = norm(cross)
        product = norm(sides).prod(axis=0)
        is_flat = length <= LEAST_SINE * product
        sines = np.divide(length, product, out=np.ones(len(length)), where=~is_flat)
        least = min(least, float(sines.min(initial=1.0)))
        normals[block] = np.where(is_flat, 0, cross.T / np.where(is_flat, 1, length)).T
        areas[block] = np.where(is_flat, 0, length * size**2 / 2)
    return normals, areas, least


def unit(vectors: ArrayLike) -> FloatArray:
    """Vectors (..., n) of length 1 along others, which are finite and not 0, of any length."""
    array = np.asarray(vectors, np.float64)
    # Powers of two, which change no digit: squares of 1e160 would overflow.
    scaled = np.ldexp(array, -np.frexp(np.abs(array).max(axis=-1, keepdims=True))[1])
    return scaled / norm(scaled)[..., None]


def cross_matrix(axis: FloatArray) -> FloatArray:
    """(3, 3) matrix by which a vector becomes the cross product of an axis, (3,), and it."""
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def rotation_about(axis: ArrayLike, angle: float) -> FloatArray:
    """(3, 3) rotation by radians, right-handed about an axis of length above 0."""
    cross = cross_matrix(unit(axis))
    # Rodrigues: R = I + sin a [n] + (1 - cos a) [n]^2
    return np.eye(3) + sin(angle) * cross + matmul((1 - cos(angle)) * cross, cross)


def matrices_of(linear: ArrayLike, translation: ArrayLike = 0.0) -> FloatArray:
    """(..., 4, 4) of linear parts (..., 3, 3), such as rotations, and translations (..., 3)."""
    given = np.asarray(linear, np.float64)
    matrices = np.zeros((*given.shape[:-2], 4, 4))
    matrices[..., :3, :3], matrices[..., :3, 3], matrices[..., 3, 3] = given, translation, 1.0
    return matrices


def inverse(poses: FloatArray) -> FloatArray:
    """camera_from_world of world_from_camera, or the reverse; (..., 4, 4)."""
    rotation = poses[..., :3, :3].swapaxes(-1, -2)
    return matrices_of(rotation, -matmul(rotation, poses[..., :3, 3, None])[..., 0])


def apply_pose(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Points (N, 3) moved by a pose (4, 4)."""
    return matmul(points, pose[:3, :3].T) + pose[:3, 3]


def nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Orthogonal matrices (N, 3, 3) nearest to others that have drifted by less than 0.1.

    By Newton's method, which squares the drift in each step. N. J. Higham. Computing the Polar
    Decomposition. 1986.
    """
    for _ in range(6):
        matrices = matmul(matrices, 1.5 * np.eye(3) - matmul(matrices.swapaxes(1, 2), matrices) / 2)
    return matrices


def rotations_of_quaternions(quaternions: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations of unit quaternions (N, 4), x y z w."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def encloses_volume(vertices: FloatArray, faces: IntArray, part: IntArray) -> BoolArray:
    """(C,) True for parts of a closed mesh with a signed volume greater than rounding.

    The volume of a part is computed about its own centre: an offset would cancel its digits.
    """
    n_parts = int(part.max()) + 1
    low, n_of = vertices[faces[0, 0]], 3 * np.bincount(part, minlength=n_parts)[:, None]
    centre = np.zeros((n_parts, 3))
    volume, scale = np.zeros(n_parts), np.zeros(n_parts)
    for block in blocks(len(faces)):
        corners = (vertices[faces[block]] - low).sum(axis=1).T
        centre += np.stack([np.bincount(part[block], x, n_parts) for x in corners], axis=1)
    centre = low + centre / n_of
    for block in blocks(len(faces)):
        p, q, r = np.moveaxis(vertices[faces[block]] - centre[part[block], None], 1, 0)
        term = dots(p, np.cross(q, r))
        volume += np.bincount(part[block], term, n_parts)
        scale += np.bincount(part[block], np.abs(term), n_parts)
    return volume > 1e-12 * scale


def check_poses(name: str, given: ArrayLike) -> FloatArray:
    """Poses (T, 4, 4), orthogonal, of some or of one; ConfigError unless rigid transforms."""
    rigid = "(T, 4, 4) rigid transforms"
    wanted = f"expected {name} to be {rigid}"
    array = check_array(name, given, "iuf", rigid, ConfigError)
    array = finite_points(name, array[None] if array.ndim == 2 else array, (-1, 4, 4), rigid)
    if not len(array):
        raise ConfigError(f"{wanted}, got none")
    turns = array[:, :3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(matmul(turns, np.swapaxes(turns, 1, 2)) - np.eye(3)).max(axis=(1, 2))
        is_rigid = (off <= RIGID) & (np.linalg.det(turns) > 0)
    is_rigid &= (array[:, 3] == (0, 0, 0, 1)).all(axis=1)
    if not is_rigid.all():
        raise ConfigError(f"{wanted}, got another matrix in row {int(is_rigid.argmin())}")
    result = array.copy()
    moved = off > 1e-15
    result[moved, :3, :3] = nearest_rotations(turns[moved])
    return result


def quaternions_of(rotations: FloatArray) -> FloatArray:
    """(T, 4) unit quaternions w, x, y, z of rotations (T, 3, 3), each on the side of the last.

    K. Shoemake. Animating Rotation with Quaternion Curves. 1985. The largest of four squares is
    divided by, so that no digit is lost.
    """
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.stack((trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]), axis=1)
    quaternions = np.empty((len(r), 4))
    for row, largest in enumerate(squares.argmax(axis=1)):  # 10 us each
        m = r[row]
        if largest == 0:
            q = (1 + trace[row], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1])
        else:
            i, j, k = (largest - 1 + np.arange(3)) % 3
            values = {
                0: m[k, j] - m[j, k],
                1 + i: 1 + m[i, i] - m[j, j] - m[k, k],
                1 + j: m[j, i] + m[i, j],
                1 + k: m[k, i] + m[i, k],
            }
            q = tuple(values[at] for at in range(4))
        quaternions[row] = np.array(q) / norm(q)
        if row and matmul(quaternions[row], quaternions[row - 1]) < 0:
            quaternions[row] *= -1
    return quaternions
