"""Attack on light: lamps at walls and in corners, grazing light, edges of cones, highlights.

Points of hostile scenes are judged one by one by rays and formulas of this file: seen by the
camera, lit on its side of the face, illuminance within the limits, no lamp mirrored. Regions must
agree with them at every point farther than `EDGE_REL` from a border; nearer ones may differ as
often as the bounds explain. Areas of the regions are held against sums of the points.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rows import Report
from scenes import joined
from surface_cases import hostile_scene, in_regions

import rastercov as rc
from rastercov.core.camera.pose import near_limit
from rastercov.reference.regions import points_on

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

SCENES, POINTS = 200, 600
EDGE_REL = 1e-4
"""Distance from a border of what is covered up to which a point is near it, relative to the
diagonal of the mesh. What the cuts leave undecided is 2e-5 of it wide."""
TIE_REL = 1e-10
"""Relative difference of 1/depth up to which surfaces coincide: the lower index is in front."""
ROUNDING = 1e-9
"""Relative distance from an edge or a tie within which rays of float64 decide nothing."""
MOST_DEVIATIONS = 6.0
"""Standard deviations of the number of points in an area up to which a sum agrees with it."""


@dataclass
class Score:
    """Points and areas compared, and those that were wrong."""

    points: int = 0
    covered: int = 0
    doubtful: int = 0
    """Points at which rounding may decide: rays through edges, eyes in the planes of faces."""
    wrong: list[int] = field(default_factory=list)
    """Seed of the scene of each point that is wrong and near no border."""
    near: int = 0
    explained: float = 0.0
    """Points that differ near a border, and those that the bounds explain."""
    most_near: float = -np.inf
    most_off: float = 0.0
    """Largest distance of an area from its sum of points, in standard deviations."""
    kinds: dict[str, int] = field(default_factory=dict)
    """Points that only this criterion leaves out."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 200 scenes of 1,200 points."""
    score = Score()
    n = max(len(PLACES) * 2, round(SCENES * effort))
    for seed in range(n):
        compare(seed, score)
    report.add(f"light: points of {n} scenes", score.points, "points")
    report.add("light: of these, covered", score.covered, "points")
    report.add("light: not judged, by rounding", score.doubtful, "points",
               at_most=0.1 * score.points)  # fmt: skip
    for name, lost in score.kinds.items():
        report.add(f"light: lost to {name}", lost, "points", must=1)
    report.add("light: wrong, near no border", len(score.wrong), "points", at_most=0)
    report.add("light: different near a border", score.near, "points")
    report.add("light: bounds explain", score.explained, "points")
    report.add("light: areas off their sums of points", score.most_off, "sigma",
               at_most=MOST_DEVIATIONS)  # fmt: skip
    seeds = ", ".join(map(str, sorted(set(score.wrong))))
    report.check(f"light: no point is wrong{seeds and f', scenes {seeds}'}", not score.wrong)
    report.check("light: points near borders are within the bounds", score.most_near <= 0)
    report.check("light: areas are sums of points", score.most_off <= MOST_DEVIATIONS)


def compare(seed: int, score: Score) -> None:
    """Hold the regions of one scene against its points."""
    rng = np.random.default_rng([seed, 7])
    mesh, camera, pose = scene(seed, rng)
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    lamps, on_rig = lamps_in(mesh, pose, size, seed, rng)
    points, face = points_on(mesh, POINTS, seed)
    some = np.flatnonzero(mesh.areas > 0)[rng.integers(0, (mesh.areas > 0).sum(), POINTS)]
    more = _inside(mesh, some, rng)
    points, face = np.concatenate([points, more]), np.concatenate([face, some])
    plain = Judge(mesh, camera, pose, rc.Task(max_incidence_deg=85), lamps)
    task = task_of(plain, points, face, seed, rng)
    judge = Judge(mesh, camera, pose, task, lamps)
    truth, doubt, lost = judge.covers(points, face)
    regions = rc.regions(mesh, camera, pose, task, lamps=on_rig, threads=1)
    off = in_regions(regions, 0, points, face) != truth
    near = off & (doubt | judge.is_near_border(points, face, truth, EDGE_REL * size, off))
    of_area = np.arange(len(points)) < POINTS
    total = mesh.areas.sum()
    explained = regions.bound.sum() / total * POINTS
    score.points += len(points)
    score.covered += int(truth.sum())
    score.doubtful += int(doubt.sum())
    near |= off & is_undecided(regions, face, off & ~near, size)
    score.wrong += [seed] * int((off & ~near).sum())
    score.near += int((near & of_area).sum())
    score.explained += explained
    count = int((off & of_area).sum()) - int((doubt & off & of_area).sum())
    score.most_near = max(score.most_near, count - 2 - explained - 6 * np.sqrt(explained))
    share = regions.area.sum() / total
    deviation = np.sqrt(max(share * (1 - share), 1 / POINTS) / POINTS)
    undecided = regions.bound.sum() / total + (doubt & of_area).mean()
    away = max(abs(share - truth[of_area].mean()) - undecided, 0.0)
    score.most_off = max(score.most_off, away / deviation)
    for name, mask in lost.items():
        score.kinds[name] = score.kinds.get(name, 0) + int(mask.sum())


def is_undecided(regions: rc.Regions, face: IntArray, off: BoolArray, size: float) -> BoolArray:
    """Mask of points of slivers, narrower than `EDGE_REL`, whose own bounds explain all `off`."""
    mesh, n = regions.mesh, regions.mesh.n_faces
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    explained = np.bincount(face, minlength=n) * regions.bounds()[0]
    explained /= np.maximum(mesh.areas, 1e-300)
    is_sliver = mesh.areas <= EDGE_REL * size * longest
    count = np.bincount(face[off], minlength=n)
    return np.asarray((is_sliver & (count <= explained + 6 * np.sqrt(explained)))[face])


def scene(seed: int, rng: np.random.Generator) -> tuple[rc.Mesh, rc.Camera, FloatArray]:
    """Mesh, camera and pose, (1, 4, 4): a hostile scene, or a room with things in it."""
    if seed % 2:
        mesh, camera, pose = hostile_scene(seed // 2)
        pose = np.asarray(pose, float).reshape(1, 4, 4)
    else:
        mesh, scale = room(rng), 10 ** rng.uniform(-2, 2)
        mesh = rc.Mesh(mesh.vertices * scale, mesh.faces)
        low, high = mesh.bounds
        eye = low + (high - low) * rng.uniform(0.03, 0.97, 3)
        camera = rc.Camera(width=640, height=480, fx=260, fy=260)
        pose = rc.look_at(eye, low + (high - low) * rng.uniform(0.3, 0.7, 3))
    if seed // 2 % 2:
        mesh = mesh.with_groups([], [group.name for group in mesh.groups])
    return mesh, camera, pose


def room(rng: np.random.Generator) -> rc.Mesh:
    """A closed room with boxes, slivers, and sheets in and just above its floor."""
    walls = rc.shapes.box((4, 3, 2))
    parts = [rc.Mesh(walls.vertices, walls.faces[:, ::-1])]
    for _ in range(int(rng.integers(1, 4))):
        box = rc.shapes.box(tuple(rng.uniform(0.1, 1.0, 3)))
        parts.append(rc.Mesh(box.vertices + rng.uniform(-0.5, 0.5, 3) * [3, 2, 1], box.faces))
    for _ in range(4):
        start, along = rng.uniform(-0.9, 0.9, 3) * [1.9, 1.4, 0.9], rng.normal(size=3) * 0.5
        aside = rng.normal(size=3) * 10 ** rng.uniform(-7, -2)
        parts.append(rc.Mesh([start, start + along, start + along / 2 + aside], [(0, 1, 2)]))
    corners = np.array([(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)])
    for height in (0.0, 1e-4):  # the first is in the floor
        at = np.append(rng.uniform(-1, 1, 2), -1.0 + height)
        parts.append(rc.Mesh(corners + at, [(0, 1, 2), (0, 2, 3)]))
    mesh: rc.Mesh = joined(*parts)
    return mesh


def _inside(mesh: rc.Mesh, face: IntArray, rng: np.random.Generator) -> FloatArray:
    weights = rng.dirichlet(np.ones(3), len(face))
    points: FloatArray = np.einsum("nk,nki->ni", weights, mesh.vertices[mesh.faces[face]])
    return points


def at_a_wall(mesh: rc.Mesh, size: float, rng: np.random.Generator) -> FloatArray:
    """A place 1e-4 to 1e-2 of the diagonal in front of a face."""
    face = rng.choice(np.flatnonzero(mesh.areas > 0), 1)
    away = size * 10 ** rng.uniform(-4, -2)
    return np.asarray(_inside(mesh, face, rng)[0] + away * mesh.normals[face[0]])


def in_a_corner(mesh: rc.Mesh, size: float, rng: np.random.Generator) -> FloatArray:
    """A place 1e-3 of the diagonal from a vertex, towards the middle."""
    corner = mesh.vertices[rng.integers(mesh.n_vertices)]
    ray = mesh.bounds.mean(axis=0) - corner + rng.normal(size=3) * 0.1 * size
    return np.asarray(corner + 1e-3 * size * ray / np.linalg.norm(ray))


def grazing(mesh: rc.Mesh, size: float, rng: np.random.Generator) -> FloatArray:
    """A place 1e-6 to 1e-3 of the diagonal over the plane of a face, beside it."""
    face = rng.choice(np.flatnonzero(mesh.areas > 0))
    a, b, c = mesh.vertices[mesh.faces[face]]
    height = size * 10 ** rng.uniform(-6, -3)
    return np.asarray(a + rng.uniform(0.1, 1.5) * (a - (b + c) / 2) + height * mesh.normals[face])


def anywhere(mesh: rc.Mesh, size: float, rng: np.random.Generator) -> FloatArray:
    """A place in the box of the mesh."""
    low, high = mesh.bounds
    return np.asarray(low + (high - low) * rng.uniform(0.02, 0.98, 3))


PLACES = (at_a_wall, in_a_corner, grazing, anywhere)


def lamps_in(
    mesh: rc.Mesh, pose: FloatArray, size: float, seed: int, rng: np.random.Generator
) -> tuple[rc.Lamps, rc.Lamps]:
    """Lamps of a scene as fixed ones, and the same, of which some ride on the camera."""
    own, places = [], []
    for row in range(int(rng.integers(1, 4))):
        place = PLACES[(seed // 2 + row) % len(PLACES)](mesh, size, rng)
        target = _inside(mesh, rng.choice(np.flatnonzero(mesh.areas > 0), 1), rng)[0]
        half, power = float(rng.uniform(2, 88)), float(10 ** rng.uniform(-2, 3))
        exponent = float(rng.choice([0, 1, 2.5, 20]))
        width = size * 10 ** rng.uniform(-3, -0.7)
        ray = target - place
        # The target is at the edge of the cone: the lamp is aimed beside it.
        side = np.cross(ray, rng.normal(size=3))
        side *= np.linalg.norm(ray) / max(float(np.linalg.norm(side)), 1e-300)
        aimed = np.cos(np.radians(half)) * ray + np.sin(np.radians(half)) * side
        lamp, axis = [
            (rc.Lamp.point(power), ray),
            (rc.Lamp.spot(half, power, exponent=exponent), aimed),
            (rc.Lamp.bar(width, power, points=4), ray),
            (rc.Lamp.ring(width, power, points=6, half_angle_deg=half, share=0.8), ray),
        ][int(rng.integers(4))]
        own.append(lamp)
        places.append(rc.look_at(place, place + axis / np.linalg.norm(axis) * size)[0])
    ambient = float(rng.choice([0, 0.01]))
    rides = rng.random(len(own)) < 0.25
    mixed = [
        np.linalg.inv(pose[0]) @ at if on else at for at, on in zip(places, rides, strict=True)
    ]
    return (
        rc.Lamps(own, places, ambient=ambient),
        rc.Lamps(own, mixed, rides=rides.tolist(), ambient=ambient),
    )


def task_of(
    judge: "Judge", points: FloatArray, face: IntArray, seed: int, rng: np.random.Generator
) -> rc.Task:
    """Thresholds of light whose borders are on lit faces."""
    seen, light = judge.light(points, face)
    inside = light[seen & (light > judge.lamps.ambient)]
    least, most = np.quantile(inside, [0.3, 0.8]) if len(inside) > 3 else (0.02, 1.0)
    own = [
        {}, {"min_illuminance": least}, {"min_illuminance": least, "max_illuminance": 2 * most},
        {"max_highlight_deg": rng.uniform(5, 40)},
        {"min_illuminance": least, "max_highlight_deg": rng.uniform(5, 40)},
        {"max_illuminance": most * 1.01 + 0.011},
    ][seed % 6 if seed % 7 else 4]  # fmt: skip
    return rc.Task(max_incidence_deg=85, **{name: float(value) for name, value in own.items()})


class Judge:
    """Points of one scene by definition: a ray for each point, eye and face."""

    def __init__(
        self, mesh: rc.Mesh, camera: rc.Camera, pose: FloatArray, task: rc.Task, lamps: rc.Lamps
    ) -> None:
        self.mesh, self.camera, self.pose, self.task, self.lamps = mesh, camera, pose, task, lamps
        self.corners = mesh.vertices[mesh.faces]
        self.hides = np.flatnonzero(~mesh.degenerate_mask & ~mesh.target_mask)
        self.size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))

    def covers(
        self, points: FloatArray, face: IntArray
    ) -> tuple[BoolArray, BoolArray, dict[str, BoolArray]]:
        """Covered points (N,), those that rounding may decide, and what criteria leave out."""
        seen, doubt = self._seen(points, face)
        at = np.flatnonzero(seen)
        normals, eye = self.mesh.normals[face[at]], self.pose[0, :3, 3]
        lit, reaches, light, unsure = self._lit(points[at], face[at])
        doubt[at] |= unsure
        task, is_free = self.task, np.ones(len(at), bool)
        dark = light < task.min_illuminance
        bright = light > (np.inf if task.max_illuminance is None else task.max_illuminance)
        if task.max_highlight_deg > 0:
            for own, place in zip(reaches, self.lamps.point_places[:, :3, 3], strict=True):
                half = _unit(eye - points[at]) + _unit(place - points[at])
                cosine = np.abs(np.einsum("ni,ni->n", half, normals))
                angle = np.arccos(np.clip(cosine / np.linalg.norm(half, axis=1), 0, 1))
                is_free &= ~own | (np.degrees(angle) >= task.max_highlight_deg)
        truth = np.zeros(len(points), bool)
        truth[at] = lit & ~dark & ~bright & is_free
        lost = {
            "shadow": ~lit, "too little light": lit & dark,
            "too much light": lit & bright, "highlights": lit & ~dark & ~bright & ~is_free,
        }  # fmt: skip
        return truth, doubt, lost

    def light(self, points: FloatArray, face: IntArray) -> tuple[BoolArray, FloatArray]:
        """Points (N,) that are seen and lit, and their illuminance."""
        seen, _ = self._seen(points, face)
        lit, _, light, _ = self._lit(points, face)
        return seen & lit, light

    def is_near_border(
        self, points: FloatArray, face: IntArray, truth: BoolArray, away: float, asked: BoolArray
    ) -> BoolArray:
        """Of the points that are asked for, those with another answer within a distance, (N,)."""
        mask = np.zeros(len(points), bool)
        at = np.flatnonzero(asked)
        sides = self.corners[face[at], 1] - self.corners[face[at], 0]
        first = _unit(sides)
        second = np.cross(self.mesh.normals[face[at]], first)
        for turn in np.linspace(0, 2 * np.pi, 12, endpoint=False):
            for radius in (away / 3, away):
                moved = points[at] + radius * (np.cos(turn) * first + np.sin(turn) * second)
                other, doubt, _ = self.covers(moved, face[at])
                mask[at] |= doubt | (other != truth[at])
        return mask

    def _seen(self, points: FloatArray, face: IntArray) -> tuple[BoolArray, BoolArray]:
        """Points that the camera sees within its image and angle of incidence."""
        camera, local = self.camera, (points - self.pose[0, :3, 3]) @ self.pose[0, :3, :3]
        near = float(near_limit(camera, self.mesh.bounds, self.pose)[0])
        z_near, z_far = camera.depth_of_field(self.task.max_blur)
        x, y, z = local.T
        with np.errstate(all="ignore"):
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        values = (z >= near) & (z >= z_near) & (z <= z_far) & (u >= 0) & (v >= 0)
        values &= (u <= camera.width) & (v <= camera.height)
        eye = self.pose[0, :3, 3]
        height = np.einsum("ni,ni->n", eye - points, self.mesh.normals[face])
        facing = np.where(self.mesh.two_sided_mask[face], np.abs(height), height)
        limit = np.cos(np.radians(self.task.max_incidence_deg))
        values &= self.mesh.task_mask[face] & (facing >= limit * np.linalg.norm(local, axis=1))
        hidden, doubt = self._hidden(eye, points, face, near, z)
        return values & ~hidden, doubt

    def _lit(
        self, points: FloatArray, face: IntArray
    ) -> tuple[BoolArray, BoolArray, FloatArray, BoolArray]:
        """Lit points on the side of the camera, points of lamps that reach them, and their light.

        (N,), (K, N), (N,) and those that rounding may decide.
        """
        lamps, normals, eye = self.lamps, self.mesh.normals[face], self.pose[0, :3, 3]
        side = np.sign(np.einsum("ni,ni->n", eye - points, normals))
        light, reaches = np.full(len(points), lamps.ambient), []
        doubt = np.zeros(len(points), bool)
        counts = np.zeros((len(lamps), len(points)), int)
        eyes = lamps.eyes
        for row, place in zip(lamps.lamp_of_point.tolist(), lamps.point_places, strict=True):
            lamp, at = lamps.lamps[row], place[:3, 3]
            local = (points - at) @ place[:3, :3]
            near = float(near_limit(eyes[row], self.mesh.bounds, place[None])[0])
            d = np.linalg.norm(local, axis=1)
            height = np.einsum("ni,ni->n", at - points, normals)
            angle = np.degrees(np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2]))
            depth = np.abs(local).max(axis=1)
            own = (angle <= lamp.half_angle_deg) & (np.sign(height) == side)
            # Points at which it is not on one side of the face for certain.
            doubt |= (np.abs(height) <= ROUNDING * self.size) | (depth <= 4 * near)
            hidden, unsure = self._hidden(at, points, face, near, depth)
            doubt |= own & unsure
            own &= ~hidden
            reaches.append(own)
            counts[row] += own
            intensity = (lamp.intensity or 0.0) / lamp.points
            cosine = np.maximum(np.cos(np.radians(angle)), 0) ** lamp.exponent
            light += own * intensity * cosine * np.abs(height) / np.maximum(d, 1e-300) ** 3
        needed = [np.ceil(each.share * each.points - 1e-9) for each in lamps.lamps]
        lit = (counts >= np.maximum(needed, 1)[:, None]).any(axis=0)
        return lit, np.array(reaches), light, doubt

    def _hidden(
        self, eye: FloatArray, points: FloatArray, face: IntArray, near: float, depth: FloatArray
    ) -> tuple[BoolArray, BoolArray]:
        """Points (N,) that a face hides from an eye, and those that rounding may decide.

        T. Möller, B. Trumbore. Fast, Minimum Storage Ray/Triangle Intersection. 1997.
        """
        hidden, doubt = np.zeros(len(points), bool), np.zeros(len(points), bool)
        ray = points - eye
        for m in self.hides:  # of the laboratory: 100 us a face
            a, b, c = self.corners[m]
            first, second, away = b - a, c - a, eye - a
            cross = np.cross(ray, second)
            area, other = cross @ first, np.cross(away, first)
            with np.errstate(all="ignore"):
                u, v, t = cross @ away / area, ray @ other / area, second @ other / area
                least = np.minimum(np.minimum(u, v), 1 - u - v)
                back = 1 / t - 1
                scale = np.maximum(1 / t, 1)
            is_tied = np.abs(back) <= TIE_REL * scale
            in_front = np.where(is_tied, m < face, back > 0) & (t * depth >= near)
            is_other = face != m
            hidden |= is_other & (least > 0) & (t > 0) & in_front
            meets = is_other & (t > 0) & (t <= 1 + 1e-6) & (least > -ROUNDING)
            doubt |= meets & (np.abs(least) <= ROUNDING)
            doubt |= meets & ~(np.abs(back) > 1e-7 * scale) & (np.abs(back) > 1e-13 * scale)
            doubt |= meets & (t * depth <= 4 * near)
        return hidden, doubt


def _unit(rays: FloatArray) -> FloatArray:
    return np.asarray(rays / np.maximum(np.linalg.norm(rays, axis=1), 1e-300)[:, None])
