"""Calls of placement, with arguments that are right."""

import numpy as np
from misuse_calls import Call
from misuse_values import CAMERA, MESH, POSES, TASK

import rastercov as rc
from rastercov.placement.candidates.cavities import openings, per_cavity
from rastercov.placement.candidates.clearance import (
    KeepOutBox,
    KeepOutSphere,
    filter_candidates,
    in_solid,
)
from rastercov.placement.candidates.mounting import (
    along,
    at_nearest_surface,
    at_point,
    on_box,
    on_ceiling,
    on_hemisphere,
    on_sphere,
    on_walls,
)
from rastercov.placement.candidates.pool import (
    Framing,
    from_poses,
    per_convex_region,
    per_face,
    per_segment,
)
from rastercov.placement.candidates.segments import segment
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import refine
from rastercov.placement.improve.search import optimise
from rastercov.placement.improve.tolerance import InstallationError, tolerance
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.integer import select_integer
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    problem_of,
    problem_of_matrix,
)
from rastercov.placement.uncovered import what_is_left
from rastercov.reference.thesis import select_thesis


def calls():
    """Every call, one for each choice of arguments that exclude each other."""
    scene = {"mesh": MESH, "camera": CAMERA}
    observer = rc.open_observer(MESH, CAMERA, threads=1)
    segments = segment(MESH, 15, 25)
    candidates = on_sphere(MESH, CAMERA, count=4)
    matrix = build_matrix(scene_of := (MESH, CAMERA), POSES)
    problem = problem_of(matrix, MESH, BestCoverage(cameras=1))
    objective = Objective.of(observer, TASK)
    space = PoseSpace(mesh=MESH, stand_off=(0.5, 9.0))
    placed = scene | {"framing": Framing()}
    return [
        Call(
            "Framing",
            Framing,
            {"stand_off": (0.1, 9.0), "fit": "vertices", "margin": 1.1, "rolls_deg": (0.0,)}
            | {"up": (0, 0, 1), "max_blur": None},
        ),
        Call(
            "segment",
            segment,
            {"mesh": MESH, "alpha_deg": 15, "beta_deg": 25, "adjacent": False, "merge": "leader"},
        ),
        Call("per_segment", per_segment, placed | {"segmentation": segments}),
        Call("per_face", per_face, placed | {"faces": [0, 1]}),
        Call("per_convex_region", per_convex_region, placed | {"least_bend_deg": 10.0}),
        Call("openings", openings, placed | {"faces": [0, 1], "clearance": 0.0, "views": 1}),
        Call("from_poses", from_poses, placed | {"poses": POSES}),
        Call("on_sphere", on_sphere, placed | {"count": 3, "centre": (0, 0, 0), "distances": 3.0}),
        Call(
            "on_hemisphere",
            on_hemisphere,
            placed | {"count": 3, "centre": None, "distances": (2.0, 3.0)},
        ),
        Call(
            "on_box",
            on_box,
            placed
            | {"spacing": 0.7, "bounds": [(-2, -2, -2), (2, 2, 2)], "outward": 0.0, "aim": None},
        ),
        Call(
            "on_walls",
            on_walls,
            placed
            | {"spacing": 0.4, "inset": 0.1, "heights": (0.1, 0.9)}
            | {"aim": None, "bounds": None},
        ),
        Call(
            "on_ceiling",
            on_ceiling,
            placed | {"spacing": 0.4, "inset": 0.1} | {"aim": None, "bounds": None},
        ),
        Call("at_point", at_point, {"point": (0, 0, 0)}),
        Call("along", along, {"direction": (0, 0, 1)}),
        Call("at_nearest_surface", at_nearest_surface, {"groups": None}),
        Call("KeepOutBox", KeepOutBox, {"low": (0, 0, 0), "high": (1, 1, 1), "name": "table"}),
        Call("KeepOutSphere", KeepOutSphere, {"centre": (0, 0, 0), "radius": 1.0, "name": "ball"}),
        Call(
            "per_cavity",
            per_cavity,
            placed | {"faces": [0, 1], "clearance": 0.0, "keep_out": (), "views": 1},
        ),
        Call(
            "filter_candidates",
            filter_candidates,
            {"candidates": candidates, "mesh": MESH, "clearance": 0.05, "keep_out": ()},
        ),
        Call("in_solid", in_solid, {"mesh": MESH, "points": [(0, 0, 0)]}),
        Call("build_matrix", build_matrix, {"view": scene_of, "poses": POSES, "task": TASK}),
        Call(
            "problem_of",
            problem_of,
            {"matrix": matrix, "mesh": MESH, "goal": BestCoverage(cameras=1), "weight_by": "area"}
            | {"views": 1, "min_angle_deg": 0.0, "costs": [1.0, 2.0], "min_coverage": 0.5},
        ),
        Call("problem_of_matrix", problem_of_matrix, {"covers": np.eye(3, dtype=bool), "views": 1}),
        Call("FewestCameras", FewestCameras, {"coverage": 0.9, "groups": {}, "of_reachable": True}),
        Call("BestCoverage", BestCoverage, {"cameras": 1, "budget": 2.0}),
        Call(
            "select_greedy",
            select_greedy,
            {"problem": problem, "effort": 10, "seed": 0, "core_pairs": 1000},
        ),
        Call(
            "select_integer",
            select_integer,
            {"problem": problem, "time_limit": 5.0, "threads": 1, "seed": 0},
        ),
        Call("select_thesis", select_thesis, {"problem": problem}),
        Call(
            "optimise",
            optimise,
            {"objective": objective, "space": space, "cameras": 1, "method": "random", "budget": 8}
            | {"population": 4, "seed": 0, "candidates": None, "start": None, "camera": 0},
        ),
        Call(
            "refine",
            refine,
            {"objective": objective, "space": space, "poses": POSES, "step": 0.1, "turn_deg": 10.0}
            | {"halvings": 0, "candidates": None, "budget": 2, "seed": 0},
        ),
        Call(
            "what_is_left",
            what_is_left,
            {"view": scene_of, "poses": POSES, "task": TASK, "candidates": None}
            | {"covered": None, "progress": lambda done, total: None},
        ),
        Call(
            "PoseSpace",
            PoseSpace,
            {"mesh": MESH, "stand_off": (0.5, 3.0), "clearance": 0.1, "keep_out": ()}
            | {"boxes": None, "aim": None, "up": (0, 0, 1), "is_roll_free": False},
        ),
        Call(
            "InstallationError",
            InstallationError,
            {"position_mm": 1.0, "angle_deg": 1.0, "distribution": "normal"},
        ),
        Call(
            "tolerance",
            tolerance,
            {"objective": objective, "poses": POSES, "error": InstallationError(position_mm=1.0)}
            | {"draws": 3, "seed": 0},
        ),
    ]
