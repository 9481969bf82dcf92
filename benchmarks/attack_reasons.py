"""Attack on reasons: what is said of the zone of a point is true of the point.

Points of random scenes are judged one by one, by `rastercov.reference.regions`: rooms, buildings
and loose triangles, seen by pinholes, lenses, panoramas and rigs with a rule. At every point
farther than `EDGE_REL` from a border the reason of its zone is that of the point, in whatever
order the cameras come; areas by reason add up to what is not covered. So it is of bodies that move,
over time. The gain by each criterion alone is what the task without it covers besides.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from rows import Report
from scenes import joined

import rastercov as rc
from rastercov.core.area.polygons import rows_at
from rastercov.core.area.relaxed import without_borders
from rastercov.core.area.zones import DeadZones, areas_by_reason, dead_zones
from rastercov.core.coverage.task import UNSEEABLE, name_of
from rastercov.reference.regions import points_on, reasons_of_points

FloatArray = NDArray[np.float64]
Reasons = NDArray[np.uint32]

SCENES, MOVING, POINTS, OF_GAINS = 200, 60, 560, 300
EDGE_REL = 1e-4
"""Distance from a border up to which a point is near it, relative to the diagonal: what lenses
leave undecided is 2e-5 of it wide."""
AROUND = 12
"""Points around one that is off, of which one of another reason shows a border."""


@dataclass
class Score:
    """Points compared, and the seeds of the scenes of those that were wrong."""

    points: int = 0
    dead: int = 0
    near: int = 0
    wrong: list[int] = field(default_factory=list)
    unequal: int = 0
    """Scenes in which another order of cameras has other areas."""
    sums: float = 0.0
    """Largest distance of the sum of areas by reason from what is missing, in its bound."""
    kinds: dict[str, int] = field(default_factory=dict)


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 200 scenes of 560 points, and 60 that move."""
    for words, n_scenes, moves in (("reasons", SCENES, False), ("over time", MOVING, True)):
        score = Score()
        for seed in range(max(8, round(n_scenes * effort))):
            compare(seed, score, moves=moves)
        report.add(f"{words}: points judged", score.points, "points")
        report.add(f"{words}: points that no camera covers", score.dead, "points")
        report.add(f"{words}: points near a border that differ", score.near, "points")
        for name, n in sorted(score.kinds.items()):
            report.add(f"{words}: {name}", n, "points")
        report.add(f"{words}: wrong away from borders", len(score.wrong), "points", at_most=0)
        report.add(
            f"{words}: scenes where the order of cameras matters", score.unequal, "", at_most=0
        )
        report.add(f"{words}: sums of areas, in bounds", score.sums, "", at_most=1.0)
    values = np.array([gains(seed) for seed in range(max(8, round(OF_GAINS * effort)))])
    report.add("gains by one criterion alone", int(values[:, 2].sum()), "")
    report.add(
        "gains: distance from a task without it, in bounds", values[:, 0].max(), "", at_most=1
    )
    report.add("gains: areas of one criterion beyond them", values[:, 1].max(), "", at_most=0)


def compare(seed: int, score: Score, *, moves: bool = False) -> None:
    """Hold the zones of one scene against its points."""
    rng = np.random.default_rng([seed, 58])
    own = scene(rng)
    hold(seed, score, own, a_motion(rng, own[0]) if moves else None, rng)


def hold(seed: int, score: Score, of_scene, asked, rng: np.random.Generator) -> None:
    """As `compare`, of a mesh, cameras, their poses and a task, and what is asked over time."""
    mesh, camera, poses, task = of_scene

    def judged(points, face) -> Reasons:
        if asked is None:
            return reasons_of_points(mesh, camera, poses, task, points, face)
        from reasons_over_time import reasons_over_time

        return reasons_over_time(asked, camera, poses, task, points, face)

    size = mesh.diagonal
    points, face = points_on(mesh, POINTS, seed)
    truth = judged(points, face)
    zones, covered = zones_of(mesh, camera, poses, task, asked)
    result = at_points(zones, points, face)
    is_proved = result == UNSEEABLE  # by the points alone
    is_proved &= truth != rc.Reason.COVERED
    off = np.flatnonzero((result != truth) & ~is_proved & mesh.task_mask[face])
    near = np.zeros(len(points), np.bool_)
    for row in off.tolist():
        around = points[row] + EDGE_REL * size * _in_plane(mesh.normals[face[row]], rng)
        of_face = np.repeat(face[row], AROUND)
        is_in = _inside(mesh, around, of_face)
        other = judged(around, of_face)
        near[row] = not is_in.all() or (other != truth[row]).any()
    is_task = mesh.task_mask[face]
    score.points += int(is_task.sum())
    score.dead += int((is_task & (truth != rc.Reason.COVERED)).sum())
    score.near += int(near.sum())
    score.wrong += [seed] * int((~near[off]).sum())
    for name in map(name_of, truth[is_task].tolist()):
        score.kinds[name] = score.kinds.get(name, 0) + 1
    missing = mesh.areas[mesh.task_mask].sum() - covered.area[0][mesh.task_mask].sum()
    bound = covered.bound.sum() + 1e-9 * mesh.areas.sum()
    total = sum(each["m2"] for each in areas_by_reason(zones, mesh.task_mask).values())
    score.sums = max(score.sums, abs(total - missing) / bound)
    order = rng.permutation(len(poses))
    other, _ = zones_of(mesh, camera, poses[order], task, asked)
    one, same = (_areas(each) for each in (zones, other))
    most = 2 * float(zones.doubt.sum()) + bound
    score.unequal += any(abs(one.get(k, 0) - same.get(k, 0)) > most for k in one.keys() | same)


def zones_of(mesh, camera, poses, task, asked=None) -> tuple[DeadZones, rc.Covered]:
    """Dead zones of a network, and what it covers."""
    placed = placed_by(camera, poses)
    if asked is not None:
        timed = rc.evaluate(mesh, camera, placed, task, motion=asked, fields=()).over_time
        return timed.zones, timed.areas.covered
    covered = rc.unite(rc.regions(mesh, camera, placed, task))
    return dead_zones(covered, 1, (camera, task, placed)), covered


def placed_by(camera, poses) -> rc.Poses:
    """Poses of the cameras of a rig, or of one."""
    return camera.poses(poses) if isinstance(camera, rc.Rig) else rc.Poses.of(poses)


def at_points(zones: DeadZones, points: FloatArray, face) -> Reasons:
    """(N,) code of the reasons of the zones of points, `COVERED` for those of none."""
    codes = np.unique(zones.reason)
    own = np.searchsorted(codes, zones.reason).astype(np.int32)
    rows = rows_at(zones, own, len(codes), face, points)
    if not len(codes):
        return np.full(len(face), rc.Reason.COVERED, np.uint32)
    return np.where(rows.any(axis=1), codes[rows.argmax(axis=1)], np.uint32(rc.Reason.COVERED))


def _areas(zones: DeadZones) -> dict[int, float]:
    codes, own = np.unique(zones.reason, return_inverse=True)
    return dict(zip(codes.tolist(), np.bincount(own, zones.piece_area), strict=True))


def _in_plane(normal: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Unit vectors around, at right angles to a normal."""
    away = rng.normal(size=(AROUND, 3))
    away -= np.outer(away @ normal, normal)
    return np.asarray(away / np.linalg.norm(away, axis=1)[:, None])


def _inside(mesh: rc.Mesh, points: FloatArray, face) -> NDArray[np.bool_]:
    """Points that are within their triangles."""
    corners = mesh.vertices[mesh.faces[face]]
    sides = [
        np.cross(corners[:, (k + 1) % 3] - corners[:, k], points - corners[:, k]) for k in range(3)
    ]
    normals = mesh.normals[face]
    return np.min([np.einsum("ni,ni->n", side, normals) for side in sides], axis=0) > 0


def gains(seed: int) -> tuple[float, float, int]:
    """Largest distance of a gain from what a task without its criterion covers, in its bounds.

    Also the largest excess of the area of a reason of one criterion over its gain where one camera
    suffices, and the number of gains. Some scenes want two cameras, or two at an angle. Densities
    of steep views are judged at the allowed angle, so that an area may be "too oblique" by itself
    where the task without the angle leaves it for its density; and what lies behind a camera is
    "outside" by itself.
    """
    rng = np.random.default_rng([seed, 58])
    mesh, camera, poses, task = scene(rng)
    if not isinstance(camera, rc.Rig) and len(poses) > 1 and rng.random() < 0.6:
        angle = float(rng.uniform(2, 40)) if rng.random() < 0.5 else 0.0
        task = replace(task, views=2, min_angle_deg=angle)
    placed = placed_by(camera, poses)
    whole = rc.evaluate(mesh, camera, placed, task, by="area", fields=())
    assert whole.areas is not None
    areas = areas_by_reason(whole.areas.zones(camera, placed), mesh.task_mask)
    covered, every, worst, excess, n = whole.covered, mesh.task_mask, 0.0, 0.0, 0
    before = covered.area[task.views - 1][every].sum()
    is_dense = task.min_facing_density > 0 or task.min_pixels_per_m2 > 0
    for name, entry in areas.items():
        if "gain_m2" not in entry:
            continue
        changed = without(name, mesh, camera, task)
        after = rc.evaluate(
            *changed[:2], placed_by(changed[1], poses), changed[2], by="area", fields=()
        ).covered
        rounding = 1e-9 * mesh.areas.sum()
        bound = (
            entry["gain_bound_m2"]
            + covered.bound[every].sum()
            + after.bound[changed[0].task_mask].sum()
        )
        gain = after.area[changed[2].views - 1][changed[0].task_mask].sum() - before
        worst = max(worst, abs(entry["gain_m2"] - gain) / (bound + rounding))
        is_of_pairs = task.views > 1 or (name == "too_oblique" and is_dense)
        if name != "outside" and not is_of_pairs:
            most = entry["gain_m2"] + entry["bound_m2"] + rounding
            excess = max(excess, (entry["m2"] - most) / mesh.areas.sum())
        n += 1
    return worst, excess, n


def without(name: str, mesh: rc.Mesh, camera, task: rc.Task):
    """Scene, cameras and task without the criterion of a reason."""
    if name == "too_few_views":
        task = replace(task, views=1, min_angle_deg=0)
    if name == "too_oblique":
        task = replace(task, max_incidence_deg=90)
    if name == "too_coarse":
        task = replace(task, min_facing_density=0, min_pixels_per_m2=0, min_pixel_density=0)
    if name == "occluded":
        roles = [replace(each, is_occluder=False, is_target=True) for each in mesh.groups]
        own = mesh.task_mask
        mesh = rc.Mesh(mesh.vertices, mesh.faces[own], roles, mesh.face_group[own])
    change = {"out_of_focus": {"focus_range": None}}.get(name, {})

    def of(one: rc.Camera) -> rc.Camera:
        if name == "outside":
            return without_borders(one)
        return replace(one, **change) if change else one

    if not isinstance(camera, rc.Rig):
        return mesh, of(camera), task
    rule = rc.All() if name == "baseline" else camera.rule
    rig = rc.Rig([*map(of, camera.cameras)], camera.names, camera.rig_from_camera, rule=rule)
    return mesh, rig, task


# --- scenes ---------------------------------------------------------------------------------------


def scene(rng: np.random.Generator):
    """Mesh, camera or rig, its poses and a task."""
    mesh, eyes, targets = (room, yard, soup)[rng.integers(3)](rng)
    part = mesh.topology.components()
    roles = [
        rc.Group(f"part {row}", is_occluder=row > 0 and a < 0.2, is_two_sided=b < 0.2)
        for row, (a, b) in enumerate(rng.random((int(part.max()) + 1, 2)))
    ]
    mesh = rc.Mesh(mesh.vertices, mesh.faces, roles, part)
    reach = float(np.linalg.norm(eyes - targets, axis=1).mean())
    camera, focal = a_camera(rng, reach)
    density = focal / reach * rng.uniform(0.4, 1.2)
    limits = {
        "max_incidence_deg": float(rng.uniform(40, 85)),
        "min_facing_density": density,
        "min_pixels_per_m2": density**2 * rng.uniform(0.3, 1),
    }
    task = rc.Task(**{name: value for name, value in limits.items() if rng.random() < 0.5})
    poses = rc.look_at(eyes, targets)
    if rng.random() < 0.35:
        return mesh, a_rig(rng, camera, reach), poses[:2], task
    return mesh, camera, poses, task


def a_motion(rng: np.random.Generator, mesh: rc.Mesh) -> rc.MotionQuery:
    """Groups that are moved and turned, of which some leave, and the time that is asked for."""
    n, size = int(rng.integers(2, 5)), 0.1 * mesh.diagonal
    poses, present = {}, {}
    for name in [group.name for group in mesh.groups if rng.random() < 0.4] or ["part 0"]:
        poses[name] = rc.turntable(n, axis=rng.normal(size=3), degrees=float(rng.uniform(5, 200)))
        poses[name][:, :3, 3] += rng.normal(scale=size, size=(n, 3))
        if rng.random() < 0.2:
            present[name] = rng.random(n) < 0.7
    durations = rng.integers(1, 3, n).astype(float)
    motion = rc.Motion(mesh, poses, present, durations)
    if not motion.present[:, motion.body].any(axis=1).all():
        motion = rc.Motion(mesh, poses, durations=durations)
    body = "world" if rng.random() < 0.8 else str(rng.choice(list(poses)))
    over = ["some", "all", 0.6][rng.integers(3)]
    return rc.MotionQuery(motion, over, ["one time", "any time"][rng.integers(2)], body)


def room(rng: np.random.Generator):
    """A room with crates, seen from below its ceiling."""
    size = rng.uniform(3, 9, 3) * (1, 1, 0.5)
    walls = rc.shapes.box(size, int(rng.integers(1, 4)))
    crates = [
        rc.shapes.box(rng.uniform(0.3, 1.5, 3), 1, (rng.uniform(-0.4, 0.4, 3)) * size)
        for _ in range(rng.integers(1, 5))
    ]
    mesh = joined(rc.Mesh(walls.vertices, walls.faces[:, ::-1]), *crates)
    n = int(rng.integers(1, 4))
    eyes = rng.uniform(-0.48, 0.48, (n, 3)) * size
    return mesh, eyes, rng.uniform(-0.4, 0.4, (n, 3)) * size


def yard(rng: np.random.Generator):
    """Solids on the ground, seen from around."""
    ground = rc.shapes.box((20, 20, 0.2), int(rng.integers(1, 4)), (0, 0, -0.2))
    solids = []
    for _ in range(rng.integers(1, 5)):
        low = rng.uniform(1, 5, 3)
        place = np.array([*rng.uniform(-7, 7, 2), low[2] / 2 + rng.uniform(0, 0.5)])
        solids.append(rc.shapes.box(low, 1, place))
    n = int(rng.integers(1, 4))
    turn = rng.uniform(0, 2 * np.pi, n)
    eyes = np.stack([14 * np.cos(turn), 14 * np.sin(turn), rng.uniform(1, 9, n)], axis=1)
    return joined(ground, *solids), eyes, rng.uniform(-3, 3, (n, 3)) * (1, 1, 0.3)


def soup(rng: np.random.Generator):
    """Loose triangles."""
    n = int(rng.integers(12, 40))
    corners = rng.uniform(-2, 2, (n, 1, 3)) + rng.uniform(-1.5, 1.5, (n, 3, 3))
    mesh = rc.Mesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3))
    count = int(rng.integers(1, 4))
    away = rng.normal(size=(count, 3))
    eyes = away / np.linalg.norm(away, axis=1)[:, None] * rng.uniform(3, 8, (count, 1))
    return mesh, eyes, rng.uniform(-1, 1, (count, 3))


def a_camera(rng: np.random.Generator, reach: float) -> tuple[rc.Camera, float]:
    """A camera and its focal length in pixels."""
    focal = 400 * 10 ** rng.uniform(-0.3, 0.3)
    own = {"width": 640, "height": 480, "fx": focal, "fy": focal}
    if rng.random() < 0.5:
        own["focus_range"] = (reach * rng.uniform(0.3, 0.8), reach * rng.uniform(1, 1.6))
    kind = rng.random()
    if kind < 0.2:
        own |= {"model": "opencv", "distortion": (-0.1, 0.02, 0.001, 0.0, 0.0)}
    elif kind < 0.35:
        own |= {"model": "opencv_fisheye", "distortion": (0.01, 0.0, 0.0, 0.0)}
    elif kind < 0.45:
        focal = 640 / (2 * np.pi)
        own |= {"model": "equirectangular", "height": 320, "fx": focal, "fy": focal}
    return rc.Camera(**own), focal


def a_rig(rng: np.random.Generator, camera: rc.Camera, reach: float) -> rc.Rig:
    """Two cameras side by side, or three of which one is needed."""
    n = int(rng.integers(2, 4))
    places = np.repeat(np.eye(4)[None], n, axis=0)
    places[:, 0, 3] = np.arange(n) * reach * rng.uniform(0.05, 0.3)
    names = [f"eye {row}" for row in range(n)]
    rules = [
        rc.All(),
        rc.All(min_baseline_deg=float(rng.uniform(1, 15))),
        rc.AtLeast(2, [names[-1]]),
    ]
    return rc.Rig([camera] * n, names, places, rule=rules[rng.integers(3)])
