"""Visible share of the cells of a small grid of heights in fractions: twin of engine/survey."""

from collections.abc import Iterator
from fractions import Fraction
from itertools import combinations, pairwise
from typing import NamedTuple

Point = tuple[Fraction, Fraction, Fraction]
Cell = tuple[int, int]
ZERO = Fraction(0)


class Edge(NamedTuple):
    """A line over [u0, u1] with v and w at both ends."""

    u0: Fraction
    u1: Fraction
    v0: Fraction
    v1: Fraction
    w0: Fraction
    w1: Fraction

    def at(self, u: Fraction) -> tuple[Fraction, Fraction]:
        """Its v and w."""
        part = (u - self.u0) / (self.u1 - self.u0)
        return self.v0 + part * (self.v1 - self.v0), self.w0 + part * (self.w1 - self.w0)


class Piece(NamedTuple):
    """A triangle in a quadrant: its edges, and those of targets above it."""

    cell: Cell
    edges: list[Edge]
    raised: list[Edge]
    is_front: bool


def triangles(
    heights: list[list[Fraction | None]], spacing: tuple[Fraction, Fraction]
) -> Iterator[tuple[Cell, list[Point]]]:
    """Triangles of cells, divided from their first to their last corner."""
    for i, j in ((i, j) for i in range(len(heights) - 1) for j in range(len(heights[0]) - 1)):
        corners: dict[tuple[int, int], Point | None] = {}
        for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)):
            z = heights[i + k][j + m]
            place = ((j + m) * spacing[0], (i + k) * spacing[1])
            corners[k, m] = None if z is None else (*place, z)
        for middle in ((0, 1), (1, 0)):
            points = [corners[0, 0], corners[middle], corners[1, 1]]
            if None not in points:
                yield (i, j), [each for each in points if each is not None]


def cross(p: Point, q: Point) -> Fraction:
    """Twice the area beside the observer."""
    return p[0] * q[1] - p[1] * q[0]


def plane_below(points: list[Point]) -> Fraction:
    """Height of the plane at the place of the observer."""
    p, q, r = points
    whole = cross(p, q) + cross(q, r) + cross(r, p)
    return (cross(p, q) * r[2] + cross(q, r) * p[2] + cross(r, p) * q[2]) / whole


def clipped(points: list[Point]) -> list[Point]:
    """The part in the quadrant |b| <= a."""
    for sign in (1, -1):
        kept: list[Point] = []
        for p, q in zip(points, points[1:] + points[:1], strict=True):
            d, e = p[0] - sign * p[1], q[0] - sign * q[1]
            if d >= 0:
                kept.append(p)
            if d * e < 0:
                part = d / (d - e)
                a, b, z = (x + part * (y - x) for x, y in zip(p, q, strict=True))
                kept.append((a, b, z))
        points = kept
    return points


def edges_of(points: list[Point], target: Fraction) -> list[Edge]:
    """Edges in (u, v) that are not radial, of points raised by a height."""
    edges = []
    for p, q in zip(points, points[1:] + points[:1], strict=True):
        if p[0] <= 0 or q[0] <= 0 or cross(p, q) == 0:
            continue
        left, right = sorted((p, q), key=lambda each: each[1] / each[0])
        ends = [(x[1] / x[0], (x[2] + target) / x[0], 1 / x[0]) for x in (left, right)]
        edges.append(Edge(*(ends[k][n] for n in range(3) for k in (0, 1))))
    return edges


def crossings(edges: list[Edge]) -> set[Fraction]:
    """All u between which no two lines cross."""
    cuts = {u for each in edges for u in each[:2]}
    for p, q in combinations(edges, 2):
        low, high = max(p.u0, q.u0), min(p.u1, q.u1)
        if low >= high:
            continue
        d, e = p.at(low)[0] - q.at(low)[0], p.at(high)[0] - q.at(high)[0]
        if d * e < 0:
            cuts.add(low + (high - low) * d / (d - e))
    return cuts


def shares(
    heights: list[list[Fraction | None]],
    spacing: tuple[Fraction, Fraction],
    eye: Point,
    target: Fraction,
    inverse_radius: Fraction = ZERO,
) -> dict[Cell, Fraction]:
    """Visible share of each cell on the map, from a point above the ground."""
    result: dict[Cell, Fraction] = {}
    quadrants: list[list[Piece]] = [[], [], [], []]
    for cell, own in triangles(heights, spacing):
        result.setdefault(cell, ZERO)
        moved = [(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]) for p in own]
        points = [(a, b, z - (a * a + b * b) * inverse_radius / 2) for a, b, z in moved]
        sides = [cross(p, q) for p, q in zip(points, points[1:] + points[:1], strict=True)]
        is_over = not min(sides) < 0 < max(sides)
        below = plane_below(points)
        if is_over and (target > 0 or below < 0):
            result[cell] += Fraction(1, 2)
        for quadrant in quadrants:
            inside = clipped(points)
            raised = [] if is_over else edges_of(inside, target)
            quadrant.append(Piece(cell, edges_of(inside, ZERO), raised, target > 0 or below < 0))
            points = [(b, -a, z) for a, b, z in points]
    area = spacing[0] * spacing[1]
    for quadrant in quadrants:
        for cell, value in visible(quadrant):
            result[cell] += value / area
    return result


def visible(pieces: list[Piece]) -> Iterator[tuple[Cell, Fraction]]:
    """Visible areas of triangles of a quadrant, interval by interval."""
    cuts = sorted(crossings([edge for each in pieces for edge in (*each.edges, *each.raised)]))
    for u0, u1 in pairwise(cuts):
        middle = (u0 + u1) / 2

        def over(edges: list[Edge], u: Fraction = middle) -> list[Edge]:
            return [each for each in edges if each.u0 < u < each.u1]

        here = [(each, over(each.edges)) for each in pieces]
        for piece, own in here:
            raised = sorted(over(piece.raised), key=lambda each: each.at(middle)[0])
            if not raised or not piece.is_front:
                continue
            nearest = max(each.at(middle)[1] for each in own)
            hiding = [
                edge
                for _, edges in here
                for edge in edges
                if edge.at(middle)[1] >= nearest and edge not in piece.raised
            ]
            low, high = raised[0], raised[-1]
            at = max((each.at(middle)[0] for each in hiding), default=low.at(middle)[0] - 1)
            if at >= high.at(middle)[0]:
                continue
            bottom = [low.at(u)[1] for u in (u0, u1)]
            if at > low.at(middle)[0]:
                horizon = next(each for each in hiding if each.at(middle)[0] == at)
                bottom = [on(low, high, horizon, u) for u in (u0, u1)]
            top = [high.at(u)[1] for u in (u0, u1)]
            depth = abs(1 / (top[0] * top[1]) - 1 / (bottom[0] * bottom[1]))
            yield piece.cell, (u1 - u0) / 2 * depth


def on(low: Edge, high: Edge, horizon: Edge, u: Fraction) -> Fraction:
    """W at which the triangle between two edges meets the horizon."""
    (v0, w0), (v1, w1), (at, _) = low.at(u), high.at(u), horizon.at(u)
    if v0 == v1:
        return w0
    return w0 + (at - v0) / (v1 - v0) * (w1 - w0)
