"""Polygons of a file, as every reader returns them, and what readers share.

A reader trusts no number of its file: a count is compared with the bytes that are present before
memory is allocated, and content that cannot be parsed is an error with its line or byte. Readers
keep the file's order of vertices and polygons and neither merge nor drop any, except for STL.

`Assembly` has instances of shapes, for 3MF and COLLADA, in time and memory of the faces that they
have. A part holds shapes and other parts, each with a place, and a file of n lines can ask for 2^n
of them. So each part is looked at once, what its instances come to is counted before any is made,
those without faces are left out, and a chain of parts that hold one other each is one step. What
remains has fewer parts than shapes.
"""

import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os.path import commonprefix
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    FloatArray,
    IntArray,
    MeshError,
    RastercovError,
    ResourceError,
    WholeArray,
    matmul,
    owners_of,
    shorten,
)
from rastercov.base.arguments import free_memory
from rastercov.base.errors import OUT_OF_MEMORY
from rastercov.base.threads import child_environment
from rastercov.core.mesh.arrays import MOST_FACES, apply_pose
from rastercov.core.mesh.files import NOWHERE, Site

AFFINE_ROW_TOLERANCE = 1e-6
PEAK_BYTES_PER_FACE = 300
"""Peak memory of a face and its vertex: 250 measured with a binary STL of 10^7, the worst case."""
PEAK_BYTES_PER_VERTEX = 150
"""Peak memory of each vertex beyond one per face."""
SECONDS = (300.0, 30.0)
"""Time that a converter may take: in all, and more for each MB of its file."""
MEMORY = (4 << 30, 1000)
"""Address space of a converter, bytes: in all, and more for each byte of its file; at most what is
free."""
LIMITED = """
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, ({0}, {0}))
except (ImportError, OSError, ValueError):  # a system without it, or a lower limit of its own
    pass
"""
"""Beginning of the program of a converter."""


@dataclass(frozen=True)
class Polygons:
    """Content of a file.

    Attributes
    ----------
    vertices : (V, 3) float64
        In the file's unit, or in metres: `is_in_metres`.
    faces : (F, 3) int64
        Vertex indices, not checked yet; polygons are triangulated as fans.
    source_face : (F,) int64
        Polygon of each face.
    face_group : (F,) int64
        Index into `group_names`.
    group_names : sequence of str or None
        None for faces outside any group.
    notes : sequence of str
        Oddities that the user should know.
    is_in_metres : bool
        True where the file states its unit; the vertices are then in metres.
    spaces : sequence of tuple
        Spaces of a building: product, vertices, metres, and triangles of each.
    site : Site
    """

    vertices: FloatArray
    faces: IntArray
    source_face: IntArray
    face_group: IntArray
    group_names: Sequence[str | None] = (None,)
    notes: Sequence[str] = ()
    is_in_metres: bool = False
    spaces: Sequence[tuple[Any, FloatArray, IntArray]] = ()
    site: Site = NOWHERE


def broken(fault: str, advice: str = "export it again") -> MeshError:
    """Error about a file; `fault` says what was wanted and what came."""
    return MeshError(f"{fault}; {advice}")


def check(is_right: object, fault: str, advice: str = "export it again") -> None:
    """Raise the error of `broken` unless something is right."""
    if not is_right:
        raise broken(fault, advice)


@contextmanager
def refuse_broken_files() -> Iterator[None]:
    """Turn errors of a look-up or of a computation in the block into a MeshError."""
    try:
        yield
    except RastercovError:
        raise
    except RecursionError:
        raise broken(
            "expected parts that are not nested in themselves, got too many levels"
        ) from None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # Any JSON value may have any type; a check of each would be longer and no clearer.
        is_of_type = isinstance(error, AttributeError | TypeError)
        got = "a value of another type" if is_of_type else f"inconsistent data ({error!r})"
        raise broken(f"expected a file that follows its format, got {got}") from error


def convert_file(
    program: str, data: bytes, options: Sequence[str], fault: str, advice: str
) -> bytes:
    """Bytes of the file that a program writes in a process of its own, which a fault may end.

    Its first argument is the file, the others are `options`; the standard input is `data`. Where it
    fails, or takes longer or more memory than `SECONDS` and `MEMORY` allow, MeshError with the
    fault, its last words, and the advice.
    """
    seconds = SECONDS[0] + SECONDS[1] * len(data) / 1e6
    memory = min(free_memory(), MEMORY[0] + MEMORY[1] * len(data))
    with tempfile.TemporaryDirectory(prefix="rastercov-") as folder:
        path = Path(folder) / "scene"
        try:
            ended = subprocess.run(
                [sys.executable, "-c", LIMITED.format(memory) + program, str(path), *options],
                input=data,
                capture_output=True,
                check=False,
                env=child_environment(),
                timeout=seconds,
            )
        except subprocess.TimeoutExpired:
            raise broken(f"{fault} in {seconds:.0f} s, got no end", advice) from None
        made = path.read_bytes() if path.exists() else b""
    check(made and not ended.returncode, f"{fault}, got: {_reason(ended, memory)}", advice)
    return made


def _reason(ended: "subprocess.CompletedProcess[bytes]", memory: int) -> str:
    """Words of a program about its failure, in one line."""
    text = (ended.stdout + b"\n" + ended.stderr).decode("utf-8", "replace")
    if "MemoryError" in text or OUT_OF_MEMORY.search(text):
        return f"it needs more than {memory / 2**30:.1f} GiB of memory"
    if ended.returncode < 0:
        return f"it was ended by signal {-ended.returncode}"
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    lines = [" ".join(line.replace("*", " ").split()) for line in text.splitlines()]
    errors = [line for line in lines if "ERR" in line] or [line for line in lines if line]
    return shorten(errors[-1], 54) if errors else "no reason"


def check_indices(values: WholeArray, n: int, where: str) -> None:
    """Raise MeshError unless all vertex indices lie in 0 ... n - 1; `where` names their owner."""
    low, high = values.min(initial=0), values.max(initial=0)
    is_right = not len(values) or (low >= 0 and high < n)
    check(is_right, f"{where}: expected vertex indices in 0 ... {n - 1}, got {low} ... {high}")


def check_affine(matrix: FloatArray, where: str) -> None:
    """Raise MeshError unless the last row of a (4, 4) matrix is 0 0 0 1."""
    check(
        np.allclose(matrix[3], (0, 0, 0, 1), rtol=0, atol=AFFINE_ROW_TOLERANCE),
        f"{where}: expected a matrix whose last row is 0 0 0 1, got {matrix[3].tolist()}",
    )


def check_budget(
    n_faces: int,
    budget: int,
    n_vertices: int = 0,
    n_bytes: int = 0,
    advice: str = "simplify the mesh, split it, or raise memory_budget",
) -> None:
    """Raise ResourceError, before memory is allocated, when reading needs more bytes than `budget`.

    `n_vertices` are known so far, and only those beyond one per face count. `n_bytes` are those of
    other arrays that are held at the same time.
    """
    n_more = max(0, n_vertices - n_faces)
    need = n_faces * PEAK_BYTES_PER_FACE + n_more * PEAK_BYTES_PER_VERTEX + n_bytes
    if n_faces > MOST_FACES or need > budget:
        vertices = f" with {n_vertices} vertices" if n_more or n_bytes else ""
        raise ResourceError(
            f"expected at most {budget} bytes and {MOST_FACES} triangles, got {need} bytes for "
            f"{n_faces} triangles{vertices}; {advice}"
        )


def fan_polygons(
    vertices: ArrayLike,
    corners: ArrayLike,
    n_corners: ArrayLike,
    budget: int,
) -> Polygons:
    """Triangulate polygons as fans about their first corner.

    `corners` are the (N,) vertex indices of all polygons, concatenated; `n_corners` those of each
    polygon, at least 3.
    """
    n_corners = np.asarray(n_corners, np.int64)
    n_triangles = n_corners - 2
    check_budget(int(n_triangles.sum()), budget, np.size(vertices) // 3)
    points = np.array(vertices, np.float64).reshape(-1, 3)
    corners = np.asarray(corners, np.int64)
    polygon = owners_of(n_triangles)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(n_triangles) - n_triangles)[polygon]
    faces = np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], axis=1)
    return Polygons(points, faces, polygon, np.zeros_like(polygon))


BYTES_PER_INSTANCE = 1000
"""Memory and work that an instance counts for beside its faces."""


def strip_triangles(n_corners: int, *, is_fan: bool) -> IntArray:
    """(T, 3) corners of the triangles of a strip, every other one reversed, or of a fan."""
    i = np.arange(max(n_corners - 2, 0))
    if is_fan:
        return np.stack([0 * i, i + 1, i + 2], axis=1)
    return np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)


LONGEST_NAME = 200
SLASH = "\u2215"
"""Sign in the place of "/" in the name of an element of a tree, where "/" separates the levels."""


def names_in_tree(
    parents: Sequence[int], names: Sequence[str], used: Sequence[int], *, is_tree: bool = False
) -> list[str]:
    """Names of the elements of a file by their place in its tree, such as "arm/gripper/bolt #2".

    Levels that all used elements share are left out, so that those of a flat file keep their names.

    Parameters
    ----------
    parents : sequence of int
        Row of the element above each, earlier than its own; -1 for none.
    names : sequence of str
        An element without a name is no level.
    used : sequence of int
        Rows of the elements with faces.
    is_tree : bool
        True where there are levels below these elements.
    """
    paths: list[str] = []
    n_alike: Counter[str] = Counter()
    for parent, name in zip(parents, names, strict=True):  # some microseconds each
        path = paths[parent] if parent >= 0 else ""
        if name:
            name = name.replace("/", SLASH)[:LONGEST_NAME]
            above = path if len(path) + len(name) < LONGEST_NAME else path.rpartition("/")[0]
            path = f"{above and above + '/'}{name}"
            base = path
            while path in n_alike:
                n_alike[base] += 1
                path = f"{base} #{n_alike[base]}"
            n_alike[path] = 1
        paths.append(path)
    levels = [path.split("/") for path in paths]
    n_shared = len(commonprefix([levels[row][:-1] for row in used]))  # noqa: RUF071 - of levels
    if is_tree or any(len(levels[row]) > n_shared + 1 for row in used):
        return ["/".join(each[n_shared:]) for each in levels]
    return [each[-1].replace(SLASH, "/") for each in levels]


class PolygonShape(NamedTuple):
    """Points, corners of all polygons, number of corners of each, number of triangles.

    One that `is_placed` is in the world, whatever the element that holds it.
    """

    points: FloatArray
    corners: IntArray
    n_corners: IntArray
    n_faces: int
    is_placed: bool = False


class PolygonElement(NamedTuple):
    """An element: its name, how it is called in errors, what it holds, in order, with its place.

    `pieces` are (element_from_piece, (4, 4), shape or key of an element). A place of None is one
    that is not supported, which `why_none` says.
    """

    name: str
    title: str
    pieces: Sequence[tuple[FloatArray | None, PolygonShape | Hashable]]
    why_none: str = ""


class _Node(NamedTuple):
    """An element with faces, and what all its instances come to."""

    name: str
    pieces: "Sequence[tuple[FloatArray, PolygonShape | _Node]]"
    n_faces: int
    n_vertices: int
    n_shapes: int


class Assembly:
    """Elements by their keys, made by `element_of` when they are first asked for."""

    def __init__(self, element_of: Callable[[Any], PolygonElement], budget: int) -> None:
        self._element_of, self._budget = element_of, budget
        self._nodes: dict[Hashable, _Node | None] = {}
        self._names: list[str] = []
        self._parents: list[int] = []

    def polygons(
        self, roots: Sequence[tuple[FloatArray, Hashable]], metres: float | None
    ) -> Polygons:
        """All instances below these elements, one group each, by `metres` if they are known."""
        points, corners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        n_corners, labels = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        n_points = 0
        whole = self._node_of(PolygonElement("", "the scene", roots))
        for label, place, shape in self._shapes(whole, np.eye(4)):
            points.append(apply_pose(shape.points, place))
            is_mirrored = np.linalg.det(place[:3, :3]) < 0  # it would face inwards
            rows = reverse_rows(shape.n_corners) if is_mirrored else slice(None)
            corners.append(shape.corners[rows] + n_points)
            n_corners.append(shape.n_corners)
            labels.append(np.full(len(shape.n_corners), label))
            n_points += len(shape.points)
        result = fan_polygons(
            np.concatenate(points) * (1.0 if metres is None else metres),
            np.concatenate(corners),
            np.concatenate(n_corners),
            self._budget,
        )
        group = np.concatenate(labels)
        names = names_in_tree(self._parents, self._names, np.unique(group).tolist())
        return replace(
            result,
            face_group=group[result.source_face],
            group_names=[name or None for name in names],
            is_in_metres=metres is not None,
        )

    def _node(self, key: Hashable) -> _Node:
        """The element of a key, without what has no faces."""
        if key not in self._nodes:
            self._nodes[key] = None
            self._nodes[key] = self._node_of(self._element_of(key))
        if (known := self._nodes[key]) is None:
            raise broken(
                f"expected {self._element_of(key).title} not to contain itself, got a cycle"
            )
        return known

    def _node_of(self, element: PolygonElement) -> _Node:
        """An element, counted, within the budget."""
        pieces: list[tuple[FloatArray, PolygonShape | _Node]] = []
        n_faces = n_vertices = n_shapes = 0
        for matrix, each in element.pieces:
            piece = each if isinstance(each, PolygonShape) else self._node(each)
            if not piece.n_faces:
                continue
            if matrix is None:
                raise MeshError(f"expected a transform of {element.title}, got {element.why_none}")
            if isinstance(piece, _Node) and len(piece.pieces) == 1:
                [(place, only)] = piece.pieces
                if isinstance(only, _Node):
                    matrix, piece = matmul(matrix, place), only
            pieces.append((matrix, piece))
            n_faces += piece.n_faces
            n_vertices += piece.n_vertices if isinstance(piece, _Node) else len(piece.points)
            n_shapes += piece.n_shapes if isinstance(piece, _Node) else 1
        check_budget(n_faces, self._budget, n_vertices, n_shapes * BYTES_PER_INSTANCE)
        return _Node(element.name, pieces, n_faces, n_vertices, n_shapes)

    def _shapes(
        self, node: _Node, place: FloatArray, above: int = -1
    ) -> Iterator[tuple[int, FloatArray, PolygonShape]]:
        """Shapes of an instance and of those below it: group, world_from_shape, shape."""
        label = len(self._names)
        self._names.append(node.name)
        self._parents.append(above)
        for matrix, piece in node.pieces:
            if isinstance(piece, _Node):
                yield from self._shapes(piece, matmul(place, matrix), label)
            else:
                yield label, np.eye(4) if piece.is_placed else matmul(place, matrix), piece


def reverse_rows(n_corners: IntArray) -> IntArray:
    """Indices that reverse the corners of each polygon but its first one."""
    polygon = owners_of(n_corners)
    first = (np.cumsum(n_corners) - n_corners)[polygon]
    place = np.arange(len(polygon)) - first
    return first + (n_corners[polygon] - place) % n_corners[polygon]
