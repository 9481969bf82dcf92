"""Lenses and their ideal planes as the loops take them, arrays read-only.

Their fields are in the order of the structs of `engine/camera` and `engine/lens`.
"""

from typing import NamedTuple

import numpy as np

from rastercov.base import AnyArray, BoolArray, FloatArray, IntArray
from rastercov.engine import solver_lens

MOST_SIDES = 132
"""Room for the sides of a region: a polygon of 128 sides around a cone, cut by a square."""


class PlaneRecord(NamedTuple):
    """An ideal plane: the part of that of a pinhole, at the place of a lens, that the lens maps.

    Attributes
    ----------
    code, params : int, (32,) float64
        The lens, see `engine/lens/formulas.hpp`, with longitudes that are continuous on this plane.
    frame : (3, 3) float64
        Axes of the pinhole camera, as columns, in axes of the lens: lens_from_plane.
    fx, fy, cx, cy : float
        Of the pinhole, px.
    region, hole : (K, 2) float64
        Convex polygons in units of the plane, (X / Z, Y / Z), counter-clockwise in (x, y). Nothing
        beyond the region has a pixel. The hole is to be taken out of it, as by a face in front of
        everything; it may reach beyond, and is empty where the region is whole.
    window : (K, 2) float64
        The region with few sides: all of it whose pixels are in the image, and perhaps more.
    longest, parts_of : (12,) float64, int
        Rules by the length of an edge, see `engine/lens/edge_bounds.cpp`.
    is_graded : bool
        True where (0, 0) is a pole of an equirectangular image, at the border of the region: rules
        are of lengths relative to the distance from it.
    width, height : float
        Size of the image of the lens, px.
    bend : float
        Bound of the second derivative of pixels along lines of the plane, px.
    stretch : float
        Greatest area in the image of the lens, px^2, for each px^2 of the pinhole's.
    speed : float
        Greatest length in the image of the lens, px, for each px of the pinhole's.
    tolerance : float
        Bound of the error of each edge or part of one, px^2.
    arc_half : float
        Half the longest arc that is integrated in one part along the border of the valid region, in
        radians around its axis; 0 where the image does not show the border.
    arc_bend : float
        Bound of the second derivative of pixels along it, px.
    """

    code: int
    params: FloatArray
    frame: FloatArray
    fx: float
    fy: float
    cx: float
    cy: float
    region: FloatArray
    hole: FloatArray
    window: FloatArray
    longest: FloatArray
    parts_of: int
    is_graded: bool
    width: float
    height: float
    bend: float
    stretch: float
    speed: float
    tolerance: float
    arc_half: float
    arc_bend: float

    def meets(self, x: FloatArray, y: FloatArray, half: tuple[float, float]) -> BoolArray:
        """True for cells that may have a point of the region, by centres and half their sides."""
        mask = np.empty(len(x), bool)
        x, y = (np.ascontiguousarray(each) for each in (x, y))
        solver_lens.find_met(self.region, self.hole, x, y, np.array(half), mask)
        return mask


class CurvedLens(NamedTuple):
    """A lens for the loops over faces, one row for each of its planes; see `PlaneRecord`.

    Attributes
    ----------
    by_distance : bool
        Sharpness depends on the distance, not on the depth.
    frames : (N, 3, 3) float64
    own_params : (N, 32) float64
    regions, holes : (N, MOST_SIDES, 2) float64
    region_sides, hole_sides : (N,) int64
    longest : (N, M) float64
    parts_of : (N,) int64
    is_graded : (N,) bool
    bends, arc_halves, arc_bends : (N,) float64
    unit : float
        Length of a unit of the plane of parallel rays, metres; 0 of rays through a point.
    core : float
        Rays within it times their third coordinate of the axis all have pixels in the image.
    """

    code: int
    params: FloatArray
    width: float
    height: float
    by_distance: bool
    frames: FloatArray
    own_params: FloatArray
    regions: FloatArray
    region_sides: IntArray
    holes: FloatArray
    hole_sides: IntArray
    longest: FloatArray
    parts_of: IntArray
    is_graded: BoolArray
    bends: FloatArray
    arc_halves: FloatArray
    arc_bends: FloatArray
    tolerance: float
    unit: float
    core: float


class Slopes(NamedTuple):
    """Bounds of derivatives along lines of a plane, px per unit^2 and unit^3.

    Attributes
    ----------
    low_x, low_y, per_x, per_y : float
        Corner of the grid, and parts a unit.
    second, third : (CELLS PARTS, CELLS PARTS) float64
        By row (y) and column (x); 0 beyond the region, infinite where nothing is known.
    sizes : (2, CELLS, CELLS) float64
        Least and greatest |det A|, A the first derivative of pixels, px^2, of each cell of PARTS x
        PARTS parts; infinite and 0 beyond the region; 0 and infinite where nothing is known.
    near_axis : (4,) float64
        Bounds of |(A^-1)'| d, |(A^-1)''| d^2, |L'| d and |L''| d^2, L = log |det A|, at a distance
        d from (0, 0), where the plane has a pole or the ray opposite to the axis; else infinite.
    """

    low_x: float
    low_y: float
    per_x: float
    per_y: float
    second: FloatArray
    third: FloatArray
    sizes: FloatArray
    near_axis: FloatArray


class Tree(NamedTuple):
    """Field of view of a plane: rays (x, y, 1) with a x + b y + c >= 0 are inside a line.

    Attributes
    ----------
    lines : (N, 3) float64
        a, b, c of each node, (a, b) of unit length.
    children : (N, 2) int32
        A node or a leaf of `engine/lens/field.hpp`, inside and outside.
    kinds : (N,) uint8
    root : int
        Node 0 or a leaf.
    """

    lines: AnyArray
    children: AnyArray
    kinds: AnyArray
    root: int
