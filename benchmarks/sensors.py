"""Rigs with a rule: their points against a slow reference, the laws of gates, then their cost.

A room of 48 faces seen by six cameras; `--meshes DIR` adds pairs on featuretype.STL and costs on
warehouse.ply. Quasi-random points are judged one by one from the definitions, once for each camera
(`rastercov.reference.regions`), and held against the regions of each of 15 pairs, of 20 rigs of
three with a rule, and of the pairs with limits of the angle between rays; so are rigs of three in
100 hostile scenes. Points on the wrong side must be fewer than the bound explains. Other cuts of
the same surface change the area of pairs by 1e-4 points at most, and laser lines are held against
rays. Light, highlights, beams and uncertainties of the room are held against points, too. Costs are
CPU times of one thread, medians over the rounds: a pair to a pose of regions, `All` and the angle,
and what a fixed lamp adds to a pose beside its own regions, which are found once.
"""

import statistics
import time
from itertools import combinations
from pathlib import Path

import numpy as np
from rows import Report, arguments, seconds
from surface_cases import building, cut_at_random, hostile_scene, in_regions, room
from sweep_rays import TASK, along_x, around_z, head, measured, parts, start

import rastercov as rc
from rastercov.reference.regions import covers_points, points_on, rig_covers_points

MOST_OF_POSES = 3.5
"""Time of a pair to that of the regions of one pose."""
MOST_OF_A_LAMP = 1.0
"""Time that a fixed lamp adds to a pose, to that of the gate of a pair."""
LIMITS = {"min_baseline_deg": 40.0}, {"max_baseline_deg": 70.0}
"""Limits of the angle between rays, for pairs."""


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=400_000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--scenes", type=int, default=100, help="hostile ones")
    parser.add_argument("--meshes", type=Path, metavar="DIR", help="measure these files, too")
    args = parser.parse_args()
    report = Report()
    mesh, camera, poses = room()
    task = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000)
    pairs = list(combinations(range(6), 2))
    compare(report, "room", mesh, camera, poses, task, pairs, args.points)
    laws(report, mesh, camera, poses, task)
    hostile(report, args.scenes)
    cuts(report)
    lines(report, args.points)
    criteria(report, mesh, args.points)
    measure(report, "room", mesh, camera, poses, task, args.rounds)
    if args.meshes:
        part = rc.Mesh.load(args.meshes / "featuretype.STL", unit="in")
        eyes, heads = around(part, 6)
        long = rc.Camera(width=1280, height=1024, fx=2200, fy=2200)
        own = rc.Task(max_incidence_deg=70)
        compare(report, "featuretype", part, long, eyes, own, heads, args.points // 7)
        hall = rc.Mesh.load(args.meshes / "warehouse.ply", unit="m")
        wide = rc.Camera(width=1280, height=960, fx=700, fy=700)
        measure(report, "warehouse", hall, wide, under_the_roof(hall), own, args.rounds)
    report.finish(args.json)


def around(mesh: rc.Mesh, n: int) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Poses of n pairs of cameras around a part, and the pairs."""
    rng, size = np.random.default_rng(0), np.linalg.norm(np.ptp(mesh.bounds, axis=0))
    centre, eyes = mesh.bounds.mean(axis=0), []
    for away in rng.normal(size=(n, 3)):
        away /= np.linalg.norm(away)
        side = np.cross(away, [0.3, 0.5, 0.81])
        side *= 0.35 * size / np.linalg.norm(side)
        eyes += [centre + 2.2 * size * away - side, centre + 2.2 * size * away + side]
    pairs = [(2 * row, 2 * row + 1) for row in range(n)]
    return rc.look_at(eyes=np.array(eyes), targets=centre), pairs


def under_the_roof(mesh: rc.Mesh) -> np.ndarray:
    """Poses of six cameras in a hall, pairs half a metre apart."""
    (low, high), rng = mesh.bounds, np.random.default_rng(1)
    eyes = low + (high - low) * rng.uniform(0.15, 0.85, (6, 3))
    eyes[:, 2] = low[2] + 0.9 * (high - low)[2]
    eyes[1::2] = eyes[::2]
    eyes[1::2, 0] += 0.5
    down = np.repeat(rng.normal(size=(3, 3)) * [1, 1, 0.2] + [0, 0, -1], 2, axis=0)
    return rc.look_at(eyes=eyes, targets=eyes + down)


def compare(
    report: Report, name: str, mesh: rc.Mesh, camera: rc.Camera, poses: np.ndarray, task: rc.Task,
    pairs: list[tuple[int, int]], n: int,
) -> None:  # fmt: skip
    """Hold points against the regions of rigs."""
    points, face = points_on(mesh, n)
    sees, eyes, total = covers_points(mesh, camera, poses, task, points, face), poses[:, :3, 3], {}
    rays = eyes[:, None] - points
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)

    def hold(what: str, rule: rc.All | rc.AtLeast, chosen: tuple[int, ...], truth: np.ndarray):
        rig = rc.Rig([camera] * len(chosen), list("abc")[: len(chosen)], poses[list(chosen)],
                     rule=rule)  # fmt: skip
        regions = rc.regions(mesh, rig, rig.poses(np.eye(4)), task)
        wrong = int((in_regions(regions, 0, points, face) != truth).sum())
        explained = regions.bound.sum() / mesh.areas.sum() * n
        entry = total.setdefault(what, [0, 0.0, 0])
        entry[0], entry[1], entry[2] = entry[0] + wrong, entry[1] + explained, entry[2] + n

    for i, j in pairs:
        both = sees[i] & sees[j]
        hold("pairs", rc.All(), (i, j), both)
        angle = np.degrees(np.arccos(np.clip((rays[i] * rays[j]).sum(axis=1), -1, 1)))
        hold("at least 40 deg", rc.All(**LIMITS[0]), (i, j), both & (angle >= 40))
        hold("at most 70 deg", rc.All(**LIMITS[1]), (i, j), both & (angle <= 70))
    for three in combinations(range(min(len(poses), 6)), 3):
        counts = sees[list(three)].sum(axis=0)
        hold("2 of 3", rc.AtLeast(2), three, counts >= 2)
        needed = rc.AtLeast(2, needs=["c"])
        hold("2 of 3, one needed", needed, three, (counts >= 2) & sees[three[2]])
    for what, (wrong, explained, points_of_all) in total.items():
        report.add(f"{name}, {what}: points", points_of_all, "")
        report.add(f"{name}, {what}: on the wrong side", wrong, "points",
                   at_most=2 + explained + 6 * np.sqrt(explained))  # fmt: skip
        report.check(f"{name}, {what}", wrong <= 2 + explained + 6 * np.sqrt(explained))


def laws(
    report: Report, mesh: rc.Mesh, camera: rc.Camera, poses: np.ndarray, task: rc.Task
) -> None:
    """Check what gates must obey, whatever they are of."""
    total, regions = mesh.areas.sum(), rc.regions(mesh, camera, poses, task)
    same = np.array_equal(regions.at_least(1).areas()[0], rc.unite(regions).area[0])
    report.check("at_least(1) is the union, to the bit", same)
    order = [4, 5, 0, 1, 2, 3]
    other = rc.regions(mesh, camera, poses[order], task)
    areas = [
        each.at_least(2, [0, 0, 1, 1, 2, 2]).at_least(2).area.sum() for each in (regions, other)
    ]
    report.check("gates in any order agree to 1e-12", abs(areas[0] - areas[1]) <= 1e-12 * total)
    by_number = sum(regions.at_least(k).area.sum() for k in range(1, 7))
    off = abs(by_number - regions.area.sum())
    report.check("areas over k add up to 1e-12", off <= 1e-12 * total)


def hostile(report: Report, n_scenes: int) -> None:
    """Hold points against rigs of three, and pairs by the angle between their rays."""
    wrong, explained, worst, n = 0, 0.0, 0.0, 1000
    for seed in range(n_scenes):
        mesh, camera, poses = hostile_scene(seed)
        rng = np.random.default_rng(seed)
        if seed % 2:
            mesh = mesh.with_groups([], [group.name for group in mesh.groups])
        size, places = np.linalg.norm(np.ptp(mesh.bounds, axis=0)), np.tile(np.eye(4), (3, 1, 1))
        places[1:, :3, 3] = rng.normal(size=(2, 3)) * size * 10 ** rng.uniform(-2, 0, (2, 1))
        rules = [rc.All(min_baseline_deg=8), rc.AtLeast(2), rc.AtLeast(2, needs=["c"]), rc.All()]
        rig = rc.Rig([camera] * 3, ["a", "b", "c"], places, rule=rules[seed // 2 % 4])
        task = rc.Task(max_incidence_deg=80)
        regions = rc.regions(mesh, rig, rig.poses(poses), task)
        points, face = points_on(mesh, n)
        truth = rig_covers_points(
            mesh, rig, np.asarray(poses).reshape(-1, 4, 4), task, points, face
        )
        for row, covered in enumerate(truth):
            off = int((in_regions(regions, row, points, face) != covered).sum())
            allowed = regions.bounds()[row].sum() / mesh.areas.sum() * n
            wrong, explained = wrong + off, explained + allowed
            worst = max(worst, off - 2 - allowed - 6 * np.sqrt(allowed))
    report.add(f"{n_scenes} hostile scenes: on the wrong side", wrong, "points")
    report.add(f"{n_scenes} hostile scenes: bounds explain", explained, "points")
    report.check("hostile scenes, each", worst <= 0)


def cuts(report: Report) -> None:
    """Check that other triangles of the same surface change nothing, and that shadows are sharp."""
    task = rc.Task(max_incidence_deg=75)
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, 0, 3] = -0.15, 0.15
    for scene in (room, building):
        mesh, camera, poses = scene()
        for rule in (rc.All(), rc.All(min_baseline_deg=3)):
            rig = rc.Rig([camera] * 2, ["a", "b"], places, rule=rule)
            regions = [
                rc.regions(each, rig, rig.poses(poses), task)
                for each in (mesh, *(cut_at_random(mesh, seed, 60)[0] for seed in range(3)))
            ]
            to_points = 100 / mesh.areas.sum()
            off = np.ptp([each.areas().sum(axis=1) for each in regions], axis=0).max() * to_points
            most, angle = 1e-4, ""
            if rule.min_baseline_deg:  # what is not decided is left out, and in the bounds
                bounds = [each.bounds().sum(axis=1).max() * to_points for each in regions]
                most, angle = most + 2 * max(bounds), " with an angle"
            report.add(f"{scene.__name__}, other cuts, pairs{angle}", off, "points", at_most=most)
            report.check(f"{scene.__name__}, other cuts{angle}", off <= most)
    sheet = rc.Mesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)],
        [rc.Group("sheet", is_two_sided=True)],
    )  # fmt: skip
    wide = rc.Camera(width=200, height=160, fx=150, fy=150)
    eyes = rc.look_at([(0.5, 0.5, 2), (0.5, 0.5, -2)], (0.5, 0.5, 0), up=(0, 1, 0))
    both = rc.regions(sheet, wide, eyes).at_least(2)
    report.check("a sheet between camera and lamp is not measured", both.area.sum() == 0)
    closed = rc.shapes.box((2, 2, 2))
    eyes = rc.look_at([(0, 0, 0), (3, 0.1, 0.2)], [(1, 0, 0), (0, 0, 0)])
    both = rc.regions(closed, wide, eyes).at_least(2)
    report.check("a lamp in a closed box lights nothing outside", both.area.sum() == 0)


def lines(report: Report, n: int) -> None:
    """Hold laser lines, straight and turning, against rays of each point at its moment."""
    mesh, rig = parts(), head()
    points, face = points_on(mesh, n)
    whole = np.concatenate([rc.turntable(32), np.eye(4)[None]])
    for what, path, moments, first in (
        ("straight", rc.conveyor(33, direction=(1, 0, 0), distance=0.3 + 2e-9),
         along_x, start(-0.15 - 1e-9)),
        ("turning", whole, around_z, start(0.01)),
    ):  # fmt: skip
        seen = measured(mesh, rig, moments(points, first), TASK, points, face)
        for step, n_stations in ((2, 16), (1, 32)):
            result = rc.LaserLine.of(mesh, rig, path[::step] @ first, TASK)
            off = abs(result.percent - 100 * seen.mean())
            name = f"laser line, {what}, {n_stations} stations: off rays"
            report.add(name, off, "points", at_most=0.05)
            report.check(name, off <= 0.05)


def criteria(report: Report, mesh: rc.Mesh, n: int) -> None:
    """Hold points against regions of lamps and heads, cut by light, highlights and uncertainty."""
    places = np.array([(2.5, 4.2, 2.9), (6.9, 1.2, 2.6), (1.0, 1.0, 1.0)])
    eye = rc.Camera(width=2048, height=1024, fx=1024 / np.pi, fy=1024 / np.pi,
                    model="equirectangular")  # fmt: skip
    poses, down = rc.look_at(eyes=places, targets=places + np.array([0.13, 0.4, -1.0])), (0, 0, -1)
    lit = rc.regions(mesh, eye, poses, threads=1)
    points, face = points_on(mesh, n)
    sees = covers_points(mesh, eye, poses, rc.Task(), points, face)
    away, normals = points - places[:, None], mesh.normals[face]
    d = np.linalg.norm(away, axis=2)
    light = 50 * np.abs(np.einsum("lni,ni->ln", away, normals)) / d**3
    cosine = np.maximum(-away[..., 2] / d, 0)
    one, u = lit.of_poses(np.arange(3) == 0), -away / d[..., None]
    both = lit.of_poses(np.arange(3) < 2).at_least(2)
    half = u[0] + u[1]
    off = np.einsum("ni,ni->n", half, normals) / np.linalg.norm(half, axis=1)
    w, c = 1 / (1e-4 * d[:2]) ** 2, np.einsum("ni,ni->n", u[0], u[1])
    least = (w[0] + w[1] - np.sqrt((w[0] + w[1]) ** 2 - 4 * w[0] * w[1] * (1 - c**2))) / 2
    across = np.eye(3) - u[..., None] * u[..., None, :]
    three = (across / (1e-4 * d[..., None, None]) ** 2).sum(axis=0)
    cases = {
        "6 lx of a lamp": (one, rc.Illuminance(places[:1], 6, 50), sees[0] & (light[0] >= 6)),
        "6 lx, cos": (one, rc.Illuminance(places[:1], 6, 50, down, 1),
                      sees[0] & (light[0] * cosine[0] >= 6)),
        "2 lx, cos^20": (one, rc.Illuminance(places[:1], 2, 50, down, 20),
                         sees[0] & (light[0] * cosine[0] ** 20 >= 2)),
        "6 lx of three": (lit.by_devices(), rc.Illuminance(places, 6, 50),
                          (light * sees).sum(axis=0) >= 6),
        "no highlight within 12 deg": (both, rc.Highlight(places[1], places[:1], 12),
                                       sees[0] & sees[1] & (off <= np.cos(np.radians(12)))),
        "uncertainty of 0.6 mm": (both, rc.Uncertainty(places[:2], 6e-4, 1e-4),
                                  sees[0] & sees[1] & (least >= 6e-4**-2)),
        "uncertainty of 0.4 mm by three": (
            lit.at_least(3), rc.Uncertainty(places, 4e-4, 1e-4),
            sees.all(axis=0) & (np.linalg.eigvalsh(three)[:, 0] >= 4e-4**-2)),
    }  # fmt: skip
    for name, (regions, criterion, truth) in cases.items():
        regions.where(criterion)
        before = time.thread_time()
        part = regions.where(criterion)
        spent = time.thread_time() - before
        wrong = int((in_regions(part, 0, points, face) != truth).sum())
        explained = part.bound.sum() / mesh.areas.sum() * n
        most = 2 + explained + 6 * np.sqrt(explained)
        report.add(f"{name}: area", 100 * part.area.sum() / mesh.areas.sum(), "%")
        report.add(f"{name}: cut", 1e3 * spent, "ms")
        report.add(f"{name}: on the wrong side", wrong, "points", at_most=most)
        report.check(name, wrong <= most)


def measure(
    report: Report, name: str, mesh: rc.Mesh, camera: rc.Camera, poses: np.ndarray, task: rc.Task,
    rounds: int,
) -> None:  # fmt: skip
    """Print what a pair costs, in poses of regions; alternating, medians of ratios."""
    groups, regions = [0, 0, 1, 1, 2, 2], rc.regions(mesh, camera, poses, task, threads=1)
    both = regions.at_least(2, groups)
    angle = rc.RayAngle(poses[:, :3, 3].reshape(3, 2, 3), 20.0)
    cost_of_a_lamp(mesh, camera, poses, task)  # what is made once, at first use
    taken, added = [], []
    for _ in range(rounds):
        added.append(cost_of_a_lamp(mesh, camera, poses, task))
        of_poses = seconds(lambda: rc.regions(mesh, camera, poses, task, threads=1)) / 6
        gate = seconds(lambda: regions.at_least(2, groups)) / 3
        taken.append((of_poses, gate, seconds(lambda: both.where(angle)) / 3))
    ratio = statistics.median(2 + gate / of_poses for of_poses, gate, _ in taken)
    report.add(f"{name}: regions", 1e3 * statistics.median(each[0] for each in taken), "ms/pose")
    report.add(f"{name}: gate", 1e3 * statistics.median(each[1] for each in taken), "ms/pair")
    report.add(f"{name}: angle", 1e3 * statistics.median(each[2] for each in taken), "ms/pair")
    report.add(f"{name}: a pair, in poses of regions", ratio, "", at_most=MOST_OF_POSES)
    lamp = statistics.median(added)
    gates = lamp / statistics.median(each[1] for each in taken)
    report.add(f"{name}: a fixed lamp adds", 1e3 * lamp, "ms/pose")
    report.add(f"{name}: a fixed lamp, in gates of a pair", gates, "", at_most=MOST_OF_A_LAMP)
    report.add(f"{name}: pieces", len(both) / max(1, len(regions)), "of those of the poses")


def cost_of_a_lamp(mesh: rc.Mesh, camera: rc.Camera, poses: np.ndarray, task: rc.Task) -> float:
    """CPU seconds that a fixed lamp adds to a pose; what it lights is found once, and left out."""
    low, high = mesh.bounds
    place = np.eye(4)[None]
    place[0, :3, 3] = low + (high - low) * [0.52, 0.47, 0.83]
    lamps, many = rc.Lamps([rc.Lamp.point(50)], place), np.concatenate([poses] * 4)

    def adds(some: np.ndarray) -> float:
        lit = seconds(lambda: rc.regions(mesh, camera, some, task, lamps=lamps, threads=1))
        return lit - seconds(lambda: rc.regions(mesh, camera, some, task, threads=1))

    return (adds(many) - adds(poses[:1])) / (len(many) - 1)


if __name__ == "__main__":
    main()
