"""Visible share of the triangles of a small grid in fractions: twin of engine/survey."""

from collections.abc import Iterator
from fractions import Fraction
from itertools import combinations, pairwise
from typing import NamedTuple

Point = tuple[Fraction, Fraction, Fraction]
Grid = list[list[Point | None]]
Cell = tuple[int, int, int]
"""Row and column of a cell, and its triangle: 0 with the corner below, 1 with that beside."""
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


def triangles(points: Grid) -> Iterator[tuple[Cell, list[Point]]]:
    """Triangles of cells, divided from their first to their last corner, by their halves."""
    for i, j in ((i, j) for i in range(len(points) - 1) for j in range(len(points[0]) - 1)):
        for half, (k, m) in enumerate(((1, 0), (0, 1))):
            corners = [points[i][j], points[i + k][j + m], points[i + 1][j + 1]]
            if None not in corners:
                yield (i, j, half), [each for each in corners if each is not None]


def cross(p: Point, q: Point) -> Fraction:
    """Twice the area beside the observer."""
    return p[0] * q[1] - p[1] * q[0]


def is_over(points: list[Point]) -> bool:
    """The observer is above or below the triangle, or its border."""
    sides = [cross(p, q) for p, q in zip(points, points[1:] + points[:1], strict=True)]
    return not min(sides) < 0 < max(sides)


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


def shares(points: Grid, target: Fraction) -> dict[Cell, Fraction]:
    """Visible share of each triangle on the map, from the origin above the ground."""
    result: dict[Cell, Fraction] = {}
    areas: dict[Cell, Fraction] = {}
    quadrants: list[list[Piece]] = [[], [], [], []]
    for cell, own in triangles(points):
        corners = own
        sides = [cross(p, q) for p, q in zip(own, own[1:] + own[:1], strict=True)]
        areas[cell] = abs(sum(sides)) / 2
        is_near, below = is_over(own), plane_below(own)
        result[cell] = Fraction(is_near and (target > 0 or below < 0))
        for quadrant in quadrants:
            inside = clipped(corners)
            raised = [] if is_near else edges_of(inside, target)
            quadrant.append(Piece(cell, edges_of(inside, ZERO), raised, target > 0 or below < 0))
            corners = [(b, -a, z) for a, b, z in corners]
    for quadrant in quadrants:
        for cell, value in visible(quadrant):
            result[cell] += value / areas[cell]
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
