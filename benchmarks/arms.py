"""Robots: cost of kinematics, inverse kinematics, collisions and distances, and their laws.

The arm of the examples, and the URDF files that are given. Costs are CPU times of one thread.
`truth.py` compares frames, collisions and distances with other libraries.
"""

import time
from pathlib import Path

import numpy as np
from rows import Report, arguments

import rastercov as rc
from rastercov.robots.kinematics import pose_error

ARM = Path(__file__).parents[1] / "examples" / "arm.urdf"


def main() -> None:
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("urdf", nargs="*", help="URDF files, with their meshes beside them")
    parser.add_argument("--packages", nargs="*", default=[], metavar="NAME=FOLDER")
    parser.add_argument("--configurations", type=int, default=1000)
    args = parser.parse_args()
    report = Report()
    folders = dict(each.split("=", 1) for each in args.packages)
    rng = np.random.default_rng(0)
    for path in (ARM, *map(Path, args.urdf)):
        robot = rc.Robot.load(path, folders)
        frames(report, path.stem, robot, rng)
        inverse(report, path.stem, robot, rng)
        collisions(report, path.stem, robot, rng, args.configurations)
    report.finish(args.json)


def scene_of_arm() -> list[rc.Mesh]:
    """A part on a table."""
    part = rc.shapes.teapot(10).moved(translation=(0.5, 0.1, 0))
    return [part, rc.shapes.box((1.6, 1.2, 0.04), 1, (0.3, 0, -0.021))]


def configurations(robot: rc.Robot, n: int, rng: np.random.Generator) -> np.ndarray:
    low, high = np.clip(robot.limits, -3, 3).T
    return rng.uniform(low, high, (n, len(low)))


def frames(report: Report, name: str, robot: rc.Robot, rng: np.random.Generator) -> None:
    """Time of the frames of all links."""
    joints = configurations(robot, 1000, rng)
    start = time.thread_time()
    robot.frames(joints)
    report.add(f"{name}: frames", (time.thread_time() - start) * 1e3, "us a configuration")


def inverse(report: Report, name: str, robot: rc.Robot, rng: np.random.Generator) -> None:
    """Solve for the last link in poses that are within reach."""
    link = robot.links[-1]
    goals = robot.frames(configurations(robot, 200, rng))[link]
    start = time.thread_time()
    solution = robot.solve(goals, link)
    report.add(f"{name}: inverse", (time.thread_time() - start) * 5, "ms a pose")
    error = pose_error(robot.frames(solution.joints)[link], goals[solution.pose])
    report.check(f"{name}: solutions meet their poses", np.linalg.norm(error, axis=1).max() <= 1e-6)
    low, high = robot.limits.T
    report.check(
        f"{name}: and their limits",
        bool(((solution.joints >= low) & (solution.joints <= high)).all()),
    )
    share = len(set(solution.pose.tolist())) / len(goals)
    report.add(f"{name}: poses solved", 100 * share, "%", must=99)


def collisions(
    report: Report, name: str, robot: rc.Robot, rng: np.random.Generator, n: int
) -> None:
    """Time of collisions and of distances, before a part on a table."""
    own, joints = rc.Collisions(robot, scene_of_arm()), configurations(robot, n, rng)
    start = time.thread_time()
    hits = own.clearance(joints, 1e-6) == 0
    report.add(f"{name}: collisions", (time.thread_time() - start) / n * 1e3, "ms", aim=0.3)
    start = time.thread_time()
    clearance = own.clearance(joints)
    report.add(f"{name}: distances", (time.thread_time() - start) / n * 1e3, "ms")
    report.add(f"{name}: in collision", 100 * hits.mean(), "%")
    report.check(f"{name}: both agree", np.array_equal(hits, clearance == 0))


if __name__ == "__main__":
    main()
