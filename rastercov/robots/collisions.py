"""Collisions and clearances of a robot: its links, a scene, and each other.

A tree of triangles is made once for each body; two trees are walked under a relative pose. Pairs of
bodies that no joint moves against each other are left out, and so are a link and the one that
carries it, which run into each other at their joint. Meshes beside a turntable are fixed to its
floor, the scene to its platter.
"""

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rastercov.base import (
    BoolArray,
    ConfigError,
    FloatArray,
    InOneLine,
    MeshError,
    check_choice,
    check_kind,
    frozen_record,
    members,
    shown,
)
from rastercov.core.mesh.arrays import apply_pose, inverse
from rastercov.core.mesh.contacts import TriangleTree
from rastercov.core.mesh.mesh import Mesh
from rastercov.core.mesh.solids import Matter
from rastercov.engine import mesh_clearance
from rastercov.robots.robot import FLOOR, Robot

CONTACT_REL = 1e-9
"""Distance, in diagonals of the robot, at which two bodies are in contact."""
MOST_PAIRS = 1 << 18
"""Points of a scene times poses of a link that are compared together: a few tens of MB."""
SCENE = ""
"""Body of what does not move."""
Of = Literal["all", "scene", "links"]
"""Pairs of bodies: all, links and what is around the robot, links alone."""
SORTS: tuple[Of, Of] = ("scene", "links")


class Contact(NamedTuple):
    """Deepest collision of a configuration, or its nearest pair of bodies.

    Attributes
    ----------
    link, body : str
        A link, and another link or a group of the scene.
    distance : float
        Metres between them; 0 where they meet.
    depth : float
        Least distance, metres, by which one must move until they are apart; 0 if it is not known.
    """

    link: str
    body: str
    distance: float
    depth: float


class _Around:
    """Meshes around a robot that do not move against each other."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self.whole = Mesh.joined(meshes)
        self.matter = [Matter(mesh) for mesh in meshes]
        self.points = np.concatenate([*map(_corners_of, meshes)])
        """(N, 3) a corner of each component."""
        self.face_group = self.whole.face_group[~self.whole.degenerate_mask]

    @cached_property
    def groups(self) -> dict[str, TriangleTree]:
        """Tree of each group."""
        mesh, table = self.whole, {}
        for row, group in enumerate(mesh.groups):
            faces = mesh.faces[(mesh.face_group == row) & ~mesh.degenerate_mask]
            if len(faces):
                table[group.name] = TriangleTree.over(mesh.vertices, faces)
        return table


@frozen_record(init=False, repr=False)
class Collisions(InOneLine):
    """Distances of the links of a robot from a scene and from each other.

    Parameters
    ----------
    robot : Robot
        The robot.
    scene : sequence of Mesh, optional
        Meshes that the robot must not touch, such as the part, occluders and keep-out volumes;
        their targets do not count. Nor may the robot be inside a watertight mesh or outside a room.
    allowed : iterable of (str, str), optional
        Pairs of links that may touch, in addition to adjacent ones.
    stationary : sequence of Mesh, optional
        Meshes beside a turntable, which it does not turn, as they are at its angle 0; see
        `Robot.on_turntable`.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Pairs of links that are compared; "" is the scene, "turntable/floor" the stationary meshes.

    Raises
    ------
    ConfigError
        For an unknown link.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rastercov as rc
    >>> box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    >>> _ = Path("gate.urdf").write_text(
    ...     f'<robot name="gate"><link name="rail"/><link name="head">{box}</link>'
    ...     '<joint name="x" type="prismatic"><parent link="rail"/><child link="head"/>'
    ...     '<axis xyz="1 0 0"/><limit lower="0" upper="0.3"/></joint></robot>'
    ... )
    >>> post = rc.shapes.box((0.2, 0.2, 0.2), centre=(0.5, 0, 0))
    >>> pairs = rc.Collisions(rc.Robot.load("gate.urdf"), [post])
    >>> pairs.clearance([[0.0], [0.25], [0.3]]).round(6).tolist()  # metres
    [0.35, 0.1, 0.05]
    """

    robot: Robot
    pairs: tuple[tuple[str, str], ...]
    _around: dict[str, _Around]

    def __init__(
        self,
        robot: Robot,
        scene: Sequence[Mesh] = (),
        allowed: Iterable[tuple[str, str]] = (),
        stationary: Sequence[Mesh] = (),
    ) -> None:
        check_kind("robot", robot, Robot, "a Robot", ConfigError)
        around = {SCENE: members("scene", scene, Mesh, "Mesh values", MeshError)}
        still = members("stationary", stationary, Mesh, "Mesh values", MeshError)
        if FLOOR in robot.links:
            offset = -robot.frames(robot.rest)[FLOOR][0, :3, 3]
            around[FLOOR] = tuple(mesh.moved(translation=offset) for mesh in still)
        else:
            around[SCENE] += still
        free = set()
        for pair in members("allowed", allowed, tuple, "pairs of links", ConfigError):
            for link in pair:
                if link not in robot.links:
                    raise ConfigError(
                        f"expected allowed pairs of links of the robot, got {shown(link)}"
                    )
            free.add(frozenset(pair))
        self.__dict__.update(robot=robot, _around={})
        for name, meshes in around.items():
            opaque = [mesh.opaque for mesh in meshes if not mesh.target_mask.all()]
            if opaque:
                self._around[name] = _Around(opaque)
        pairs = [
            (one, other)
            for one, other in combinations(self._trees, 2)
            if self._can_meet(one, other) and frozenset((one, other)) not in free
        ]
        self.__dict__["pairs"] = tuple(pairs)

    @cached_property
    def _trees(self) -> dict[str, TriangleTree]:
        """Trees of the faces with areas of each body that has some."""
        bodies = self.robot.shapes | {name: each.whole for name, each in self._around.items()}
        trees = {}
        for name, mesh in bodies.items():
            faces = mesh.faces[~mesh.degenerate_mask]
            if len(faces):
                trees[name] = TriangleTree.over(mesh.vertices, faces)
        return trees

    @cached_property
    def _links(self) -> dict[str, Matter]:
        """Matter of each link with a shape, in its frame."""
        return {link: Matter(mesh) for link, mesh in self.robot.shapes.items()}

    def _can_meet(self, one: str, other: str) -> bool:
        """True for bodies that a joint moves against each other, unless one carries the other."""
        robot, n_around = self.robot, (one in self._around) + (other in self._around)
        ways = [[] if link == SCENE else robot.kinematics.chain(link) for link in (one, other)]
        n_common = sum(a is b for a, b in zip(*ways, strict=False))
        between = [each for way in ways for each in way[n_common:]]
        if n_around == 2 or not any(joint.column >= 0 for joint in between):
            return False
        if n_around:
            return True
        shorter, longer = sorted((way[n_common:] for way in ways), key=len)
        is_above = not shorter and not any(e.parent in robot.shapes for e in longer[1:])
        return not is_above

    def _pairs_of(self, of: Of) -> list[tuple[str, str]]:
        """Pairs of a kind; the link first."""
        check_choice("of", of, ("all", *SORTS))
        wanted = {"scene": True, "links": False}.get(of)
        return [pair for pair in self.pairs if wanted in (None, pair[1] in self._around)]

    def clearance(self, joints: ArrayLike, most: float = np.inf, of: Of = "all") -> FloatArray:
        """Clearance of each configuration, metres: 0 in collision, at most `most`.

        Parameters
        ----------
        joints : (N, J) or (J,) array_like
            As for `Robot.frames`.
        most : float
            Distance above which nothing is computed, to save time; above 0.
        of : {"all", "scene", "links"}
            Pairs that count: all, those of links with their surroundings, or of links alone.

        Returns
        -------
        (N,) float64

        Raises
        ------
        ConfigError
            For invalid joints, see `Robot.frames`, and `most` of 0 or less.
        """
        if not most > 0:
            raise ConfigError(f"expected most to be above 0, got {shown(most)}")
        frames, n = self._frames(joints)
        result = np.full(n, float(most))
        contact = CONTACT_REL * self.robot.mesh.diagonal
        pairs = self._pairs_of(of)
        for one, other in pairs:
            relative = inverse(frames[one]) @ frames[other]
            result = self._apart(one, self._trees[other], relative, result)
            result[result <= contact] = 0.0
        for link, around in pairs:
            rows = np.flatnonzero(result > 0)
            if around in self._around and len(rows):
                poses = inverse(frames[around][rows]) @ frames[link][rows]
                result[rows[self._is_inside(link, self._around[around], poses)]] = 0.0
        return result

    def _frames(self, joints: ArrayLike) -> tuple[dict[str, FloatArray], int]:
        """Poses of the links and of the scene in each of N configurations, and N."""
        frames = self.robot.frames(joints)
        n = len(next(iter(frames.values())))
        return frames | {SCENE: np.broadcast_to(np.eye(4), (n, 4, 4))}, n

    def _is_inside(self, link: str, around: _Around, poses: FloatArray) -> BoolArray:
        """(N,) True where a part of a link is in matter, or a part of that in it, under N poses."""
        corners = self._corners[link]
        points = corners @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
        swallows = self._swallows(link, around.points, poses)
        for matter in around.matter:
            swallows |= matter.holds(points.reshape(-1, 3)).reshape(len(poses), -1).any(axis=1)
        return swallows

    @cached_property
    def _corners(self) -> dict[str, FloatArray]:
        """A corner of each component of the links, in their frames."""
        return {link: _corners_of(mesh) for link, mesh in self.robot.shapes.items()}

    def _swallows(self, link: str, points: FloatArray, poses: FloatArray) -> BoolArray:
        """(N,) True where one of some points, (K, 3), is in a link under N poses."""
        swallows = np.zeros(len(poses), bool)
        low, high = self.robot.shapes[link].bounds
        for some in np.array_split(points, 1 + len(points) * len(poses) // MOST_PAIRS):
            own = (some[:, None] - poses[:, :3, 3])[:, :, None] @ poses[:, :3, :3]
            is_near = ((own[:, :, 0] >= low) & (own[:, :, 0] <= high)).all(axis=2)
            rows = np.nonzero(is_near)[1]
            np.logical_or.at(swallows, rows, self._links[link].holds(own[:, :, 0][is_near]))
        return swallows

    def contacts(self, joints: ArrayLike, of: Of = "all") -> list[Contact]:
        """Pair that penetrates deepest, or else the nearest pair, in each configuration.

        `joints` and `of` as for `clearance`. Each result has `link`, `body`, and `distance` and
        `depth` in metres; there is none for a robot without pairs to compare.
        """
        (frames, n), pairs = self._frames(joints), self._pairs_of(of)
        if not pairs:
            return []
        apart, depth = np.full((2, len(pairs), n), np.inf)
        group = np.full((len(pairs), n), -1)
        for row, (one, other) in enumerate(pairs):
            relative = inverse(frames[one]) @ frames[other]
            apart[row] = self._apart(one, self._trees[other], relative, apart[row])
        is_met = apart <= CONTACT_REL * self.robot.mesh.diagonal
        depth[:] = 0.0
        for row, (one, other) in enumerate(pairs):
            own = self._around.get(other)
            is_asked = is_met[row] | ((own is not None) & ~is_met.any(axis=0))
            for at in np.flatnonzero(is_asked).tolist():
                relative = inverse(frames[one][at]) @ frames[other][at]
                ways = ((one, other, inverse(relative)), (other, one, relative))
                for way in ways:
                    deep, face = self._depth(*way)
                    if deep > depth[row, at]:
                        depth[row, at] = deep
                        group[row, at] = own.face_group[face] if own and way[1] == other else -1
        items = []
        for at in range(n):
            row = np.lexsort((apart[:, at], -depth[:, at])).tolist()[0]
            link, body = pairs[row]
            if body in self._around:
                relative = inverse(frames[link][at]) @ frames[body][at]
                body = self._group_at(link, body, relative[None], int(group[row, at]))
            is_apart = not is_met[row, at] and depth[row, at] == 0
            distance = float(apart[row, at]) if is_apart else 0.0
            items.append(Contact(link, body, distance, float(depth[row, at])))
        return items

    def _group_at(self, link: str, around: str, relative: FloatArray, group: int) -> str:
        """A group around the robot by its row, or the one that is nearest to a link."""
        own = self._around[around]
        if group >= 0:
            return own.whole.groups[group].name
        least, nearest = np.full(1, np.inf), ""
        for name, tree in own.groups.items():
            apart = self._apart(link, tree, relative, least.copy())
            if apart[0] < least[0]:
                least, nearest = apart, name
        return nearest

    def _apart(
        self, link: str, other: TriangleTree, relative: FloatArray, apart: FloatArray
    ) -> FloatArray:
        """(N,) `apart`, with the distances of a link from a tree where these are less."""
        tree = self._trees[link]
        own = tree.corners, tree.nodes, other.corners, other.nodes
        mesh_clearance.distances(*own, np.ascontiguousarray(relative), apart)
        return apart

    def _depth(self, body: str, into: str, pose: FloatArray) -> tuple[float, int]:
        """Depth of the deepest point of a body in another one, and the face nearest to it."""
        around = self._around
        mesh = around[body].whole if body in around else self.robot.shapes[body]
        points = apply_pose(np.concatenate([mesh.vertices, mesh.centroids]), pose)
        if into not in around:
            low, high = self.robot.shapes[into].bounds
            points = points[((points >= low) & (points <= high)).all(axis=1)]
        matter = around[into].matter if into in around else [self._links[into]]
        points = points[np.any([each.holds(points) for each in matter], axis=0)]
        if not len(points):
            return 0.0, -1
        distance, face, _ = self._trees[into].nearest(points)
        return float(distance.max()), int(face[distance.argmax()])


def _corners_of(mesh: Mesh) -> FloatArray:
    """A corner of each edge-connected component."""
    first = np.unique(mesh.topology.components(), return_index=True)[1]
    return mesh.vertices[mesh.faces[first, 0]]
