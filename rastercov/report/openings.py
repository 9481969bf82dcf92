"""Openings of a building, such as windows: their storey, room, side, and plans that number them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from rastercov.base import BoolArray, ByName, FloatArray, IntArray, norm, sort_order
from rastercov.core.area.polygons import points_on, spread_faces
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.bodies import boxes_of
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.sections import section
from rastercov.core.mesh.solids import rooms_at
from rastercov.report.drawing import DOT, frame_around, labels_beside, scale_bar
from rastercov.report.plan_geometry import rooms_of

PROBES = 0.25, 0.5, 0.75
"""Distances from the middle of an opening at which its room is looked for, m."""
AROUND = np.radians(np.arange(0, 360, 45))
RINGS = (0.8, 0.6), (0.98, 0.2)
RAYS = np.array([(0, 0, 1)] + [(r * np.cos(x), r * np.sin(x), z) for r, z in RINGS for x in AROUND])
"""Directions to one side of an opening, whose axis is the last one."""
ENCLOSED = len(RAYS) * 2 / 3
"""Directions in which there is something from an opening into a room, at least."""
FLAT = 1 - 1e-6
"""Part of the area of one-sided faces that looks one way where they are in a plane, at least."""
STOREY = 1.5
"""Difference in height from which openings are on different plans, m."""
COMPASS = "N", "NE", "E", "SE", "S", "SW", "W", "NW"
OVER_FLOOR, OVER_SILL = 1.2, 0.3
"""Least heights of the point of EN 17037, m."""
REVEAL, BORDER = 0.6, 0.15
"""Depth of a reveal, and width of a frame, at most, m."""
MOST_PLANS, FAR = 12, 6
"""Plans; distance of a label in its own sizes at most."""


class Openings(NamedTuple):
    """Parts of a mesh, by their numbers of faces (F,), -1 for none, and their middles (M, 3)."""

    mesh: Mesh
    piece: IntArray
    at: FloatArray

    def sides(self) -> tuple[FloatArray, list[str]]:
        """(M, 3) unit vectors outwards, and the label of the room of each part, "" for none.

        Outwards is the front of one-sided faces in a plane, which alone has light, else away from a
        room on one side alone, else from a side that is enclosed; a part where none is known has 0.
        """
        matrices, own = np.zeros((len(self.at), 3, 3)), self.piece >= 0
        normals = self.mesh.normals[own]
        areas, fronts = self.mesh.areas[own, None], np.zeros((len(self.at), 3))
        weighted = areas[..., None] * normals[:, :, None] * normals[:, None]
        np.add.at(matrices, self.piece[own], weighted)
        np.add.at(fronts, self.piece[own], areas * normals * ~self.mesh.two_sided_mask[own, None])
        fronts *= norm(fronts)[:, None] > FLAT * np.trace(matrices, axis1=1, axis2=2)[:, None]
        axes = np.linalg.eigh(matrices)[1]
        before, behind = (self._rooms(side * axes[:, :, 2]) for side in (1, -1))
        n_met, n_behind = (self._n_met(axes * (1, 1, side)) for side in (1, -1))
        normals, rooms = np.array(axes[:, :, 2]), []
        for row, (one, other) in enumerate(zip(before, behind, strict=True)):
            order = bool(one) - bool(other) or n_met[row] - n_behind[row]
            is_known = bool(one) != bool(other) or max(n_met[row], n_behind[row]) >= ENCLOSED
            front = fronts[row] @ normals[row]
            normals[row] *= np.sign(front if front else -order * is_known)
            rooms.append(other or one)
        return normals, rooms

    def prescribed(self, rooms: Sequence[str]) -> list[list[float] | None]:
        """Point of each part by EN 17037, in the plane of the part; None where no room is known."""
        own = self.piece >= 0
        floors = {product.label: space.bounds[0, 2] for product, space in self.mesh.spaces}
        sills, _ = boxes_of(self.piece[own], self.mesh.vertices[self.mesh.faces[own]])
        places = zip(self.at.tolist(), sills[:, 2].tolist(), rooms, strict=True)
        return [
            [x, y, max(float(floors[room]) + OVER_FLOOR, sill + OVER_SILL)] if room else None
            for (x, y, _), sill, room in places
        ]

    def are_of_rooms(self) -> BoolArray:
        """(M,) True for windows, by names of groups; for all where there are but windows and doors.

        And where there are no windows.
        """
        names = [group.name.casefold() for group in self.mesh.groups]
        own = self.piece >= 0
        part, group = self.piece[own], self.mesh.face_group[own]
        is_window, is_door = (
            np.bincount(part, [word in names[each] for each in group], len(self.at)) > 0
            for word in ("window", "door")
        )
        return is_window | (is_window | is_door).all() | ~is_window.any()

    def _n_met(self, axes: FloatArray) -> IntArray:
        """(M,) rays that meet something, of those of `RAYS` along axes (M, 3, 3)."""
        rays = np.einsum("mik,rk->rmi", axes, RAYS)
        starts = np.tile(self.at, (len(RAYS), 1))
        face = self.first_faces(starts, rays.reshape(-1, 3))
        return np.sum(face.reshape(len(RAYS), -1) >= 0, axis=0)

    def _rooms(self, normals: FloatArray) -> list[str]:
        """Label of the nearest room along unit vectors from each part, "" for none."""
        names = [""] * len(self.at)
        for step in PROBES:
            own = rooms_at(self.mesh, self.at + step * normals)
            names = [one or other for one, other in zip(names, own, strict=True)]
        return names

    def first_faces(self, starts: FloatArray, rays: FloatArray) -> IntArray:
        """(N,) first face outside all parts from points along unit rays; -1 for none."""
        others, n = np.flatnonzero(self.piece < 0), len(starts)
        if not len(others) or not n:
            return np.full(n, -1)
        middle, scale = self.mesh.centre, 1 / self.mesh.diagonal
        points = (self.mesh.vertices - middle) * scale
        tree = TriangleTree.over(points, self.mesh.faces[others])
        placed, none = (starts - middle) * scale, np.full(n, -1)
        hits = tree.first_hits(placed, np.ascontiguousarray(rays), np.full(n, 2.0), none)
        return np.append(others, -1)[hits]

    def points(self, normals: FloatArray, n: int) -> FloatArray:
        """(M, n, 3) points evenly over each part; of one that faces a side, over those faces."""
        mesh, items = self.mesh, []
        for row, normal in enumerate(normals):
            own = np.flatnonzero(self.piece == row)
            front = own[mesh.normals[own] @ normal > np.sqrt(0.5)]
            own = front if len(front) else own
            items.append(points_on(mesh, own[spread_faces(mesh.areas[own], n)]))
        return np.array(items)

    def of_reveal(self, rows: IntArray, places: FloatArray, normals: FloatArray) -> BoolArray:
        """(N,) True for places around parts of some rows that face a side, on their reveal."""
        own = self.piece >= 0
        across = np.cross(normals, (0, 0, 1))
        axes = np.stack((across, np.cross(normals, across), normals), axis=1)
        corners = self.mesh.vertices[self.mesh.faces[own]]
        low, high = boxes_of(
            self.piece[own], np.einsum("nij,nkj->nki", axes[self.piece[own]], corners)
        )
        at = np.einsum("nij,nj->ni", axes[rows], places)
        beyond = np.maximum(low[rows] - at, at - high[rows]) - (BORDER, BORDER, REVEAL)
        return np.asarray((beyond <= 0).all(axis=1) & normals[rows].any(axis=1))

    def names(self, rooms: Sequence[str]) -> list[str]:
        """Storey, room and name of each part, for people."""
        own, first = np.unique(self.piece, return_index=True)
        groups = self.mesh.face_group[first[own >= 0]]
        names, n_of = [], np.bincount(groups)
        for row, group in enumerate(groups.tolist()):
            levels = levels_of(self.mesh, group)
            if rooms[row]:
                levels[:-1] = rooms[row].split("/")
            if n_of[group] > 1:
                levels.append(f"piece {1 + (groups[:row] == group).sum()}")
            names.append(", ".join(levels))
        return names

    def plans(self, numbers: Sequence[int], names: Sequence[str], north: float) -> list[ByName]:
        """Parts of a plan of each storey, in mm, for `floor_plan.svg`, from below."""
        order, plans = sort_order(self.at[:, 2]), list[ByName]()
        steps = np.flatnonzero(np.diff(self.at[order, 2]) > STOREY) + 1
        for rows in np.split(order, steps)[:MOST_PLANS]:
            cut, xy = float(np.median(self.at[rows, 2])), self.at[rows, :2]
            walls = section(self.mesh.vertices, self.mesh.faces, cut)
            spaces = rooms_of(self.mesh, cut)
            rooms = shapely.GeometryCollection([each for _, _, each in spaces])
            around = shapely.total_bounds(rooms).reshape(-1, 2)
            points = np.concatenate((xy, around[~np.isnan(around).any(axis=1)]))
            beside = float(np.ptp(points, axis=0).max())
            frame = frame_around(points, np.asarray(self.mesh.bounds)[:, :2], beside)
            at, turn = frame.on_paper(xy), np.radians(north)
            middles = [(each.representative_point(), name) for name, _, each in spaces if each]
            storeys = {names[row].split(", ")[0] for row in rows.tolist() if ", " in names[row]}
            texts = [str(numbers[row]) for row in rows]
            on_paper = shapely.linestrings(frame.on_paper(walls))
            plans.append(
                {
                    "title": storeys.pop() if len(storeys) == 1 else f"z = {cut:.2f} m",
                    "size": frame.size,
                    "walls": frame.path(shapely.MultiLineString(list(walls))),
                    "rooms": [
                        (*frame.on_paper(np.array((point.x, point.y))).tolist(), name)
                        for point, name in middles
                    ],
                    "dot": DOT,
                    "parts": [
                        (*place, numbers[row])
                        for place, row in zip(at.tolist(), rows.tolist(), strict=True)
                    ],
                    "labels": labels_beside(texts, at, at, FAR, on_paper),
                    "up": (float(np.cos(turn)), -float(np.sin(turn))),
                    "bar": scale_bar(frame),
                }
            )
        return plans


def levels_of(mesh: Mesh, group: int) -> list[str]:
    """Levels of the name of a group, without the types of an IFC file."""
    levels = mesh.groups[group].name.split("/")
    return [each for each in levels if not each.startswith("Ifc")] or levels


def compass(normals: FloatArray, north: float) -> list[str]:
    """Point of the compass that vectors (N, 3) face, "" for one up or down, and for 0."""
    turn = north - np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    points = np.rint(turn / 45).astype(int) % 8
    is_level = np.hypot(normals[:, 0], normals[:, 1]) > np.sqrt(0.5)
    return [COMPASS[at] * bool(own) for at, own in zip(points, is_level, strict=True)]
