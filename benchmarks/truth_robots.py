"""Kinematics, collisions and distances of robots: yourdfpy, pinocchio and coal.

Random trees of joints and the arm of the examples. A collision may be decided otherwise where the
distance is below `UNDECIDED_REL` of the size.
"""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from arms import ARM, configurations, scene_of_arm
from compared import Compared, Comparison, amount

import rastercov as rc

TREES, CONFIGURATIONS, POSTURES = 20, 200, 1000
SAME = 1e-12
"""Metres and sines by which frames of two programs differ by rounding."""
UNDECIDED_REL = 1e-8
Frames = Callable[[np.ndarray], dict[str, np.ndarray]]


def frames(open_model: Callable[[Path, rc.Robot], Frames], effort: float) -> list[Compared]:
    """Entries of the frames of all links."""
    compared = Compared("frames of links", "")
    with tempfile.TemporaryDirectory() as folder:
        paths = [ARM]
        for seed in range(amount(TREES, effort)):
            paths.append(Path(folder, f"tree_{seed}.urdf"))
            paths[-1].write_text(random_tree(np.random.default_rng(seed)))
        for path in paths:
            robot = rc.Robot.load(path)
            find = open_model(path, robot)
            count = amount(CONFIGURATIONS, effort, 5)
            joints = configurations(robot, count, np.random.default_rng(0))
            own = robot.frames(joints)
            for row, values in enumerate(joints):
                other = find(values)
                pairs = [(own[link][row, :3], other[link][:3]) for link in robot.links]
                ours, theirs = map(np.array, zip(*pairs, strict=True))
                if compared.add(ours, theirs, SAME).any():
                    compared.faults.append(f"{path.stem}, joints {values.tolist()}")
    return [compared]


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


def collisions(effort: float) -> list[Compared]:
    """Collisions and distances of the arm before a part on a table."""
    hits, distances = Compared("collisions", ""), Compared("distances", "m")
    robot = rc.Robot.load(ARM)
    own = rc.Collisions(robot, scene_of_arm())
    joints = configurations(robot, amount(POSTURES, effort), np.random.default_rng(0))
    clearance = own.clearance(joints)
    least = UNDECIDED_REL * float(np.linalg.norm(np.ptp(robot.mesh.bounds, axis=0)))
    for row, (hit, distance) in enumerate(of_coal(own, robot, joints)):
        differs = hits.add(clearance[row] == 0, hit, 0)
        if differs and max(distance, clearance[row]) <= least:
            hits.explain("touching within 1e-8", 1)
        elif differs | distances.add(clearance[row], distance, least):
            hits.faults.append(f"{joints[row].tolist()}: {clearance[row]}, {distance}")
    return [hits, distances]


def of_coal(
    own: rc.Collisions, robot: rc.Robot, joints: np.ndarray
) -> Iterator[tuple[bool, float]]:
    """Collision, true or false, and distance of each configuration."""
    import coal

    def model(mesh: rc.Mesh) -> Any:
        bvhmodel_obbrss = coal.BVHModelOBBRSS()
        bvhmodel_obbrss.beginModel(mesh.n_faces, mesh.n_vertices)
        for face in mesh.faces:
            bvhmodel_obbrss.addTriangle(*mesh.vertices[face])
        bvhmodel_obbrss.endModel()
        return bvhmodel_obbrss

    models = {link: model(mesh) for link, mesh in robot.shapes.items()}
    models[""] = model(rc.Mesh.joined(scene_of_arm()))
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


COMPARISONS = [
    Comparison("yourdfpy", "yourdfpy", partial(frames, of_yourdfpy)),
    Comparison("pinocchio", "pin", partial(frames, of_pinocchio)),
    Comparison("coal", "coal", collisions),
]
