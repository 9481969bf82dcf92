r"""Algorithm 1 of the thesis, for the record. It is WRONG: use it for comparison and nothing else.

The visible part of a face does follow from polygon Booleans in the image, as (3.13) has it, but not
from these: the algorithm takes the centroid's depth for an order of occlusion, writes over its own
results, tests back faces against the optical axis, and projects what lies behind the camera.
`docs/appendix/equations.md` lists eight defects, each with an example, the exact answer, and what
comes out here. `rastercov.reference.polygons` has the right answer.

As printed, with T_1 ... T_M for the sorted faces that overlap T_j, itself among them:

     4  for j = 1 ... N
     5    if angle(N_Tj, O_c) <= 90 deg                              Definition 3
     6      O_Tj = 1
     9    else find all that overlap T_j
    10      sort them by depth: T_1 ... T_M
    11      O_T1 = 0
    12      for i = 2 ... M
    13        if O_Ti = NaN
    14          O_Ti = 1 - |T_j \ U| / |T_j|,  VA_Ti = T_j \ U      U = T_1 u ... u T_(j-1)
    17        else if |U u T_j| = |U|
    18          O_Tj = 1
    20        else O_Ti = 1 - |VA_Tj \ U| / |T_j|,  VA_Ti = T_j \ U

What the page leaves open is decided so: depth is the camera z of the centroid, as in (3.12); equal
depths keep the order of the mesh; two faces overlap when their insides meet, for with touching
included every neighbour would get its 0 from line 11; VA is the whole face until it is stored; the
two areas of line 17 are equal when they agree to 1e-12.

E. S. Eissa. Image Space Coverage Model for Deployment of Multi-Camera Networks. 2020, (3.13),
(3.14), Definition 3, Algorithm 1 in section 4.2.
"""

from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike

from rastercov.base import AnyArray, BoolArray, FloatArray, IntArray
from rastercov.core.camera import Camera, near_limit, to_camera, to_image
from rastercov.core.mesh import Mesh
from rastercov.reference.coverage import clip_near

Polygons = AnyArray

Reading = Literal["literal", "semi", "charitable"]
SelfOcclusion = Literal["definition3", "perspective"]

EQUAL_AREAS = 1e-12
"""Relative difference up to which line 17 takes two areas for equal; bare rounding would decide."""


def occlusion(
    mesh: Mesh,
    camera: Camera,
    pose: ArrayLike,
    reading: Reading = "charitable",
    *,
    self_occlusion: SelfOcclusion | None = "definition3",
    clip: bool = True,
) -> FloatArray:
    """Hidden fraction of each face as Algorithm 1 has it: a WRONG answer, (3.13).

    Parameters
    ----------
    reading : {"literal", "semi", "charitable"}
        "literal" takes the indices as printed: within the inner loop the outer j names both the
        face and the length of the union, so every T_i gets a number of T_j. "semi" puts i for j
        there. "charitable" gives each face one result, from all that overlap it and come before it
        in the sort: no result is overwritten, and (3.13b) and (3.13d) are not needed.
    self_occlusion : {"definition3", "perspective"} or None
        As for `self_occluding`. Such faces get 1 at their turn, and hide others like any face.
    clip : bool
        Cut faces at the near plane and at the image border, which the thesis does not do.

    Returns
    -------
    (F,) float64
        0 is wholly visible, 1 wholly hidden, (3.14) is 1 minus it; NaN for faces without area in
        the image, unless they count as self-occluding. Depends on the order of the faces, and much
        so for "literal" and "semi"; "literal" can fall below 0.

    Raises
    ------
    ValueError
        For a reading or a test that does not exist, or a mesh with targets.
    """
    if mesh.has_targets:
        raise ValueError("expected a mesh without targets, got some; pass mesh.opaque")
    matrix = np.asarray(pose, np.float64)
    triangles = image_triangles(mesh, camera, matrix, clip=clip)
    is_back = self_occluding(mesh, matrix, self_occlusion)
    depths = to_camera(mesh.vertices, matrix)[mesh.faces][..., 2].mean(axis=1)
    lists = _sort_overlaps(triangles, depths)
    if reading == "charitable":
        return _each_once(triangles, lists, is_back)
    if reading in ("literal", "semi"):
        return _as_printed(triangles, lists, is_back, reading)
    raise ValueError(f"expected reading literal, semi or charitable, got {reading!r}; use one")


def self_occluding(
    mesh: Mesh, pose: ArrayLike, test: SelfOcclusion | None = "definition3"
) -> BoolArray:
    """Faces that (3.13c) calls hidden by themselves in a pose world_from_camera, (F,).

    Parameters
    ----------
    test : {"definition3", "perspective"} or None
        "definition3": the angle between normal and optical axis is at most 90 degrees, which tells
        front from back in a parallel projection only. "perspective": the angle between normal and
        view ray is, which is right. None: no face is. A face without normal is, under both.

    Raises
    ------
    ValueError
        For a test that does not exist.
    """
    matrix = np.asarray(pose, np.float64)
    if test is None:
        return np.zeros(mesh.n_faces, bool)
    if test == "definition3":
        towards = mesh.normals @ matrix[:3, 2]
    elif test == "perspective":
        towards = ((mesh.vertices[mesh.faces[:, 0]] - matrix[:3, 3]) * mesh.normals).sum(axis=1)
    else:
        raise ValueError(f"expected definition3, perspective or None, got {test!r}; use one")
    return towards >= 0


def image_triangles(mesh: Mesh, camera: Camera, pose: ArrayLike, *, clip: bool = True) -> Polygons:
    """Image of each face as a shapely polygon, px; empty for a face without area there, (F,).

    With `clip`, faces are cut at the near plane and at the image border. Without, (3.2) is taken as
    printed: vertices behind the camera come out mirrored, and those at depth 0 void their face.
    """
    camera.check_pinhole("expected a pinhole for a reference")
    matrix = np.asarray(pose, np.float64)
    corners = to_camera(mesh.vertices, matrix)[mesh.faces]
    counts = np.full(mesh.n_faces, 3)
    if clip:
        corners, counts = clip_near(
            corners, near_limit(camera, mesh.opaque.bounds, matrix[None])[0]
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        points = to_image(corners, camera)
    drawn = (counts >= 3) & np.isfinite(points).all(axis=(1, 2))
    triangles: Polygons = shapely.polygons(np.where(drawn[:, None, None], points, 0.0))
    if clip:
        triangles[drawn] = shapely.intersection(
            triangles[drawn], shapely.box(0, 0, camera.width, camera.height)
        )
    empty = ~drawn | ~shapely.is_valid(triangles) | (shapely.area(triangles) == 0)
    triangles[empty] = shapely.Polygon()
    return triangles


def _sort_overlaps(triangles: Polygons, depths: FloatArray) -> list[IntArray]:
    """Lines 9 and 10: for each face all that overlap it, itself too, nearest centroid first."""
    of, other = shapely.STRtree(triangles).query(triangles, predicate="intersects")
    meet = shapely.relate_pattern(triangles[of], triangles[other], "T********")
    of, other = of[meet], other[meet]
    order = np.lexsort((other, depths[other], of))
    ends = np.cumsum(np.bincount(of, minlength=len(triangles)))
    return np.split(other[order], ends[:-1])


def _each_once(triangles: Polygons, lists: list[IntArray], is_back: BoolArray) -> FloatArray:
    """(3.13a) and (3.13c) alone, once a face."""
    hidden = np.where(is_back, 1.0, np.nan)
    # A Boolean of some ten triangles a face: 0.3 ms.
    for j in np.flatnonzero(~is_back):
        if lists[j].size:
            place = int(np.argmax(lists[j] == j))
            seen = shapely.difference(triangles[j], shapely.union_all(triangles[lists[j][:place]]))
            hidden[j] = 1 - seen.area / triangles[j].area
    return hidden


def _as_printed(
    triangles: Polygons, lists: list[IntArray], is_back: BoolArray, reading: Reading
) -> FloatArray:
    """All of Algorithm 1, line by line; the numbers are its own."""
    hidden = np.full(len(triangles), np.nan)  # 3
    visible_area: list[Any] = list(triangles)
    # Faces x overlapping faces x a union of those: some seconds for a thousand faces.
    for j, listed in enumerate(lists):  # 4
        if is_back[j]:  # 5
            hidden[j] = 1  # 6
            continue
        if not listed.size:  # no area in the image
            continue
        hidden[listed[0]] = 0  # 11
        for place in range(1, len(listed)):  # 12
            i = int(listed[place])
            # The printed j counts from 1, so T_1 ... T_(j-1) are j of ours, or all there are.
            subject, n_before = (j, j) if reading == "literal" else (i, place)
            before = shapely.union_all(triangles[listed[:n_before]])
            area, slack = triangles[subject].area, EQUAL_AREAS * before.area
            if np.isnan(hidden[i]):  # 13
                visible_area[i] = shapely.difference(triangles[subject], before)
                hidden[i] = 1 - visible_area[i].area / area  # 14
            # 17, (3.13b): the areas of U and of U with the face are the same.
            elif abs(shapely.union(before, triangles[subject]).area - before.area) <= slack:
                hidden[subject] = 1  # 18
            else:
                hidden[i] = 1 - shapely.difference(visible_area[subject], before).area / area
                visible_area[i] = shapely.difference(triangles[subject], before)  # 20
    return hidden
