"""Robots against other libraries: kinematics, inverse kinematics, collisions and distances.

The arm of the examples, random trees of joints, and the URDF files that are given. Where they are
installed (`pip install pin coal yourdfpy`), pinocchio and yourdfpy answer for the frames of links,
coal for collisions and distances; else only laws are checked. A collision may be decided otherwise
where the distance is below 1e-8 of the size. Costs are CPU times of one thread.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.mesh.kinematics import pose_error

ARM = Path(__file__).parents[1] / "examples" / "arm.urdf"
SAME = 1e-12
"""Metres and sines by which frames differ at most."""
UNDECIDED_REL = 1e-8


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("urdf", nargs="*", help="URDF files, with their meshes beside them")
    parser.add_argument("--packages", nargs="*", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--configurations", type=int, default=1000)
    args = parser.parse_args()
    report = Report()
    folders = dict(each.split("=", 1) for each in args.packages)
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(20):
            path = Path(folder, f"tree_{seed}.urdf")
            path.write_text(random_tree(np.random.default_rng(seed)))
            frames(report, f"random tree {seed}", path, rc.Robot.load(path), rng)
    for path in (ARM, *map(Path, args.urdf)):
        robot = rc.Robot.load(path, folders)
        frames(report, path.stem, path, robot, rng)
        inverse(report, path.stem, robot, rng)
        collisions(report, path.stem, robot, rng, args.configurations)
    report.finish(args.json)


def random_tree(rng: np.random.Generator) -> str:
    """URDF of 12 links: any kind of joint, any origin and axis, one mimic."""
    shape = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    parts = [f'<link name="l{k}">{shape}</link>' for k in range(12)]
    kinds = ["revolute", "continuous", "prismatic", "fixed"]
    for k in range(1, 12):
        kind = "revolute" if k < 3 else kinds[rng.integers(4)]
        three = rng.normal(size=(3, 3))
        three[2] /= np.linalg.norm(three[2])  # yourdfpy takes axes as they are
        xyz, rpy, axis = (" ".join(map(repr, row)) for row in three.tolist())
        mimic = '<mimic joint="j1" multiplier="-0.7" offset="0.1"/>' if k == 2 else ""
        parts.append(
            f'<joint name="j{k}" type="{kind}"><parent link="l{rng.integers(k)}"/>'
            f'<child link="l{k}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2" upper="2" effort="1" velocity="1"/>{mimic}</joint>'
        )
    return f'<robot name="tree">{"".join(parts)}</robot>'


def configurations(robot: rc.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    low, high = np.clip(robot.limits, -3, 3).T
    return rng.uniform(low, high, (n, len(low)))


def frames(
    report: Report, name: str, path: Path, robot: rc.Robot, rng: np.random.Generator
) -> None:
    """Hold the frames of all links against those of the libraries."""
    joints = configurations(robot, 50, rng)
    own = robot.frames(joints)
    for library, make in {"yourdfpy": of_yourdfpy, "pinocchio": of_pinocchio}.items():
        if find_spec(library) is None:
            continue
        find = make(path, robot)
        off = 0.0
        for row, values in enumerate(joints):
            other = find(values)
            off = max(off, *(np.abs(other[link] - own[link][row]).max() for link in robot.links))
        report.check(f"{name}: frames are those of {library} to {SAME:g}", off <= SAME)
    start = time.thread_time()
    robot.frames(np.repeat(joints, 20, axis=0))
    if "tree" not in name:
        report.add(f"{name}: frames", (time.thread_time() - start) * 1e3, "us a configuration")


def of_yourdfpy(path: Path, robot: rc.Robot) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
    import yourdfpy

    model = yourdfpy.URDF.load(str(path), load_meshes=False, load_collision_meshes=False)

    def find(values: np.ndarray) -> dict[str, np.ndarray]:
        model.update_cfg(dict(zip(robot.joint_names, values, strict=True)))
        root = robot.links[0]
        return {link: model.get_transform(link, root) for link in robot.links}

    return find


def of_pinocchio(path: Path, robot: rc.Robot) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(path), mimic=True)
    data = model.createData()

    def find(values: np.ndarray) -> dict[str, np.ndarray]:
        q = pinocchio.neutral(model)
        for joint, value in zip(robot.joint_names, values, strict=True):
            each = model.joints[model.getJointId(joint)]
            at = slice(each.idx_q, each.idx_q + each.nq)
            q[at] = (np.cos(value), np.sin(value)) if each.nq == 2 else value
        pinocchio.framesForwardKinematics(model, data, q)
        return {n: data.oMf[model.getFrameId(n)].homogeneous for n in robot.links}

    return find


def inverse(report: Report, name: str, robot: rc.Robot, rng: np.random.Generator) -> None:
    """Solve for the last link in poses that are within reach."""
    link = robot.links[-1]
    goals = robot.frames(configurations(robot, 200, rng))[link]
    start = time.thread_time()
    found = robot.solve(goals, link)
    report.add(f"{name}: inverse", (time.thread_time() - start) * 5, "ms a pose")
    error = pose_error(robot.frames(found.joints)[link], goals[found.pose])
    report.check(f"{name}: solutions meet their poses", np.linalg.norm(error, axis=1).max() <= 1e-6)
    low, high = robot.limits.T
    report.check(
        f"{name}: and their limits", bool(((found.joints >= low) & (found.joints <= high)).all())
    )
    share = len(set(found.pose.tolist())) / len(goals)
    report.add(f"{name}: poses solved", 100 * share, "%", must=99)


def collisions(
    report: Report, name: str, robot: rc.Robot, rng: np.random.Generator, n: int
) -> None:
    """Hold collisions and distances against coal, before a part on a table."""
    part = rc.shapes.teapot(10).moved(translation=(0.5, 0.1, 0))
    scene = [part, rc.shapes.box((1.6, 1.2, 0.04), 1, (0.3, 0, -0.021))]
    own, joints = rc.Collisions(robot, scene), configurations(robot, n, rng)
    size = float(np.linalg.norm(np.ptp(robot.mesh.bounds, axis=0)))
    start = time.thread_time()
    hits = own.clearance(joints, 1e-6) == 0
    report.add(f"{name}: collisions", (time.thread_time() - start) / n * 1e3, "ms", aim=0.3)
    start = time.thread_time()
    clearance = own.clearance(joints)
    report.add(f"{name}: distances", (time.thread_time() - start) / n * 1e3, "ms")
    report.add(f"{name}: in collision", 100 * hits.mean(), "%")
    report.check(f"{name}: both agree", np.array_equal(hits, clearance == 0))
    if find_spec("coal") is None:
        return
    start = time.thread_time()
    found = list(of_coal(own, robot, joints))
    report.add(f"{name}: coal, both", (time.thread_time() - start) / n * 1e3, "ms")
    differs = [
        row
        for row, (hit, distance) in enumerate(found)
        if hit != hits[row] and max(distance, clearance[row]) > UNDECIDED_REL * size
    ]
    report.check(f"{name}: collisions are those of coal", not differs)
    off = max(abs(distance - clearance[row]) for row, (_, distance) in enumerate(found))
    report.check(f"{name}: distances are those of coal", off <= UNDECIDED_REL * size)


def of_coal(
    own: rc.Collisions, robot: rc.Robot, joints: np.ndarray
) -> Iterator[tuple[bool, float]]:
    """Collision, true or false, and distance of each configuration."""
    import coal

    def model(mesh: rc.Mesh) -> Any:
        found = coal.BVHModelOBBRSS()
        found.beginModel(mesh.n_faces, mesh.n_vertices)
        for face in mesh.faces:
            found.addTriangle(*mesh.vertices[face])
        found.endModel()
        return found

    models = {link: model(mesh) for link, mesh in robot.shapes.items()}
    models[""] = model(rc.Mesh.joined(own.scene))
    frames = robot.frames(joints) | {"": np.broadcast_to(np.eye(4), (len(joints), 4, 4))}
    for row in range(len(joints)):
        places = {
            name: coal.Transform3s(
                np.ascontiguousarray(frames[name][row, :3, :3]), frames[name][row, :3, 3].copy()
            )
            for name in models
        }
        hit, least = False, np.inf
        for one, other in own.pairs:
            pair = (models[one], places[one], models[other], places[other])
            hit = hit or bool(coal.collide(*pair, coal.CollisionRequest(), coal.CollisionResult()))
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            least = min(least, max(0.0, coal.distance(*pair, request, result)))
        yield hit, 0.0 if hit else least


if __name__ == "__main__":
    main()
