"""Every public function with every argument, and values that none of them is meant for.

Used by `test_misuse`, which tries each value alone, and by `benchmarks/attack_misuse`, which spoils
several arguments at once.
"""

import ast
import inspect
import tempfile
import warnings
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import rastercov as rc
from rastercov import shapes
from rastercov.mesh.targets import box_grid, count_for, sheet_above, with_target
from rastercov.placement.bits import CoveredBits
from rastercov.placement.candidates.cavities import openings
from rastercov.placement.candidates.clearance import (
    KeepOutBox,
    KeepOutSphere,
    filter_candidates,
    in_solid,
)
from rastercov.placement.candidates.framing import Framing
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
from rastercov.placement.candidates.pool import from_poses, per_convex_region, per_face, per_segment
from rastercov.placement.candidates.segments import segment
from rastercov.placement.improve.objective import Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.tolerance import InstallationError, tolerance
from rastercov.placement.matrix import build_matrix
from rastercov.placement.select.bit_problem import BitProblem
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.lazy import select_lazy
from rastercov.placement.select.problem import (
    AnyProblem,
    BestCoverage,
    FewestCameras,
    problem_of,
    problem_of_matrix,
)

MESH = shapes.box((1, 1, 1))
CAMERA = rc.Camera(width=32, height=24, fx=30, fy=30)
POSES = rc.look_at([(0, 0.2, 3), (3, 0.1, 0)], (0, 0, 0))
TASK = rc.Task()
PLAN = {
    "meshes": [{"built_in": "box"}],
    "camera": {"width": 32, "height": 24, "fx": 30, "fy": 30},
    "task": {"resolution_of_result": 1.0},
    "candidates": [{"generator": "on_sphere", "count": 2}],
    "selection": {"goal": "best_coverage", "cameras": 1},
}
FOLDER = Path(tempfile.mkdtemp(prefix="rastercov-misuse-"))


class Hostile:
    """An object whose every operation fails, and whose name has two lines."""

    def __repr__(self):
        return "hostile\nobject"

    def __float__(self):
        raise RuntimeError("no number")

    def __array__(self, *_, **__):
        raise RuntimeError("no array")


def endless():
    """A list that contains itself."""
    values: list[Any] = []
    values.append(values)
    return values


VALUES = {
    "nothing": None,
    "true": True,
    "false": False,
    "numpy true": np.bool_(True),
    "zero": 0,
    "one": 1,
    "minus one": -1,
    "half": 0.5,
    "one and a half": 1.5,
    "2^31": 2**31,
    "2^70": 2**70,
    "10^400": 10**400,
    "nan": float("nan"),
    "inf": float("inf"),
    "-inf": -float("inf"),
    "1e-9": 1e-9,
    "1e160": 1e160,
    "1e308": 1e308,
    "least": 5e-324,
    "float32": np.float32(2),
    "int8": np.int8(3),
    "numpy nan": np.float64("nan"),
    "long": np.longdouble("1e4000"),
    "complex": 1j,
    "date": np.datetime64("2020-01-01"),
    "empty text": "",
    "digit": "2",
    "two lines": "a\nb",
    "device": "/dev/zero",
    "mesh file": "part.stl",
    "bytes": b"x",
    "empty list": [],
    "empty tuple": (),
    "empty table": {},
    "table": {"a": 1},
    "set": {1},
    "object": object(),
    "hostile": Hostile(),
    "list in itself": endless(),
    "ragged": [[1, 2], [3]],
    "texts": ["a"],
    "range": range(3),
    "iterator": iter(()),
    "function": len,
    "type": int,
    "class": rc.Mesh,
    "mesh": MESH,
    "camera": CAMERA,
    "task": TASK,
    "groups": [rc.Group("a")],
    "0-d array": np.array(3),
    "no numbers": np.array([]),
    "three": np.array([1.0, 2.0, 3.0]),
    "eye": np.eye(4),
    "complex eye": np.eye(4) * 1j,
    "text eye": np.eye(4).astype(str),
    "object eye": np.eye(4).astype(object),
    "bool eye": np.eye(4, dtype=bool),
    "swapped eye": np.eye(4, dtype=">f8"),
    "masked eye": np.ma.masked_array(np.eye(4), np.eye(4) > 0),
    "nan eye": np.full((4, 4), np.nan),
    "far eye": np.eye(4) + np.array([[0, 0, 0, 1e160]] + [[0] * 4] * 3),
    "no rows": np.zeros((0, 3)),
    "no poses": np.zeros((0, 4, 4)),
    "no columns": np.zeros((3, 0)),
    "2^31 faces": np.broadcast_to(np.int8(0), (2**31, 3)),
    "2^31 poses": np.broadcast_to(np.eye(4, dtype=np.int8), (2**31, 4, 4)),
    "words": np.array(["a", "b"]),
    "memory": memoryview(b"abc"),
}


@dataclass(frozen=True)
class Call:
    """A function with arguments that it takes gladly, each of which may be exchanged.

    Attributes
    ----------
    name : str
        For people.
    function : callable
        What is called with `arguments` by their names.
    arguments : dict
    """

    name: str
    function: Any
    arguments: dict[str, Any]

    def spoiled(self, **values):
        """The same call with other values for some arguments."""
        return replace(self, arguments=self.arguments | values)

    def fault(self):
        """Fault of a call, empty if there is none.

        It must return, or raise one of our errors with one printable line, and warn of nothing.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                self.function(**self.arguments)
        except rc.RastercovError as error:
            text = str(error)
            if not text or not text.isprintable() or len(text) > 700:
                return f"no line for people: {text[:200]!r}"
            return "calls itself a defect" if "defect of rastercov" in text else ""
        except Exception as error:
            return f"{type(error).__name__}: {error}"[:200]
        return ""


def names_of_calls():
    """Names of all calls, in the order of `calls`, without making one."""
    literals = ast.walk(ast.parse(inspect.getsource(calls)))
    made = (node for node in literals if isinstance(node, ast.Call))
    return [
        node.args[0].value
        for node in made
        if isinstance(node.func, ast.Name) and node.func.id == "Call"
    ]


def closed(opened):
    opened.close()


def calls():
    """Every public call with arguments that are right."""
    lens = {"width": 32, "height": 24, "fx": 30.0, "fy": 30.0}
    whole = {"cx": 1.0, "cy": 1.0, "near": 0.1, "focal_length": 0.01, "pixel_size": (1e-5, 1e-5)}
    whole |= {"aperture": 1e-3, "focus_distance": 1.0, "max_blur": 1.0, "skew": 0.0}
    scene = {"mesh": MESH, "camera": CAMERA}
    seen = scene | {"poses": POSES}
    thresholds = {"min_pixels": 1, "min_visibility": 0, "max_blur": 1, "max_incidence_deg": 80}
    thresholds |= {"min_pixel_density": 1, "min_facing_density": 1, "min_coverage": 0.5, "views": 1}
    thresholds |= {"focus_rule": "vertices", "cap_resolution": True}
    thresholds |= {"min_angle_deg": 20}
    arrays = {"vertices": MESH.vertices, "faces": MESH.faces, "groups": None, "face_group": None}
    arrays |= {"source_face": None, "sources": (), "notes": ()}
    groups = [rc.Group("a"), rc.Group("b")]
    exact = {"method": "exact", "supersample": 1, "threads": 1}
    sampled = {"method": "sampled", "backend": "cpu", "supersample": 1, "threads": 1}
    observer = rc.open_observer(MESH, CAMERA, threads=1)
    rasterizer = rc.open_rasterizer(MESH, CAMERA, "cpu", threads=1)
    coverage = rc.evaluate(MESH, CAMERA, POSES, threads=1)
    covered = rc.regions(MESH, CAMERA, POSES, threads=1)
    segments = segment(MESH, 15, 25)
    candidates = on_sphere(MESH, CAMERA, count=4)
    matrix = build_matrix(scene_of := (MESH, CAMERA), POSES)
    problem = problem_of(matrix, MESH, BestCoverage(cameras=1))
    on_bits = BitProblem(
        bits=CoveredBits.from_dense(np.eye(2, MESH.n_faces)),
        **{field.name: getattr(problem, field.name) for field in fields(AnyProblem)},
    )
    objective = Objective.of(observer, TASK)
    placed = scene | {"framing": Framing()}
    found = [
        Call("Camera", rc.Camera, lens | whole | {"distortion": ()}),
        Call(
            "Camera of a lens",
            rc.Camera,
            lens
            | {"model": "opencv", "distortion": (0.1, 0, 0, 0), "skew": 1.0, "max_angle_deg": 60.0},
        ),
        Call("Camera in focus", rc.Camera, lens | {"focus_range": (0.1, 2.0)}),
        Call(
            "Camera.from_lens",
            rc.Camera.from_lens,
            {"width": 32, "height": 24, "focal_length": 0.01, "pixel_size": 1e-5}
            | {"principal_point": (1e-4, 1e-4), "f_number": 2.0, "focus_distance": 1.0},
        ),
        Call(
            "Camera.from_opencv",
            rc.Camera.from_opencv,
            {"K": CAMERA.opencv_K, "width": 32, "height": 24, "distortion": (0, 0)},
        ),
        Call("Camera.preset", rc.Camera.preset, {"name": "khepra"}),
        Call("Camera.load", rc.Camera.load, {"path": FOLDER / "none.json"}),
        Call("Camera.from_dict", rc.Camera.from_dict, {"entries": lens}),
        Call("Camera.save", CAMERA.save, {"path": FOLDER / "camera.json"}),
        Call("Camera.resized", CAMERA.resized, {"scale": 0.5}),
        Call("Camera.depth_of_field", CAMERA.depth_of_field, {"max_blur": 1.0}),
        Call("Task", rc.Task, thresholds),
        Call("Task.thesis", rc.Task.thesis, thresholds),
        Call(
            "Group",
            rc.Group,
            {"name": "a", "is_occluder": False, "is_two_sided": True, "is_target": False},
        ),
        Call("Mesh", rc.Mesh, arrays),
        Call(
            "Mesh in groups",
            rc.Mesh,
            {"vertices": MESH.vertices, "faces": MESH.faces, "groups": groups}
            | {"face_group": np.arange(12) % 2},
        ),
        Call(
            "Mesh.load",
            rc.Mesh.load,
            {"path": FOLDER / "none.stl", "unit": "mm", "occluders": (), "two_sided": ()}
            | {"targets": ()},
        ),
        Call(
            "audit",
            rc.audit,
            seen
            | {"task": TASK, "names": ["a", "b"], "by": "face", "resolution_of_result": None}
            | {"method": "certified", "skip_bad_poses": False},
        ),
        Call(
            "check",
            rc.check,
            {"plan": PLAN, "poses": POSES, "camera": CAMERA, "min_coverage": 0.5}
            | {"groups": {"mesh": 0.2}, "views": 1},
        ),
        Call("place", rc.place, {"plan": PLAN, "camera": CAMERA}),
        Call("sheet_above", sheet_above, {"mesh": MESH, "group": "mesh", "height": 1.6}),
        Call(
            "box_grid",
            box_grid,
            {"low": (0, 0, 0), "high": (1, 1, 1), "count": (1, 2, 1), "size": 0.1},
        ),
        Call("count_for", count_for, {"low": (0, 0, 0), "high": (1, 1, 1), "spacing": 0.5}),
        Call(
            "with_target",
            with_target,
            {"mesh": MESH, "target": MESH, "name": "sheet", "two_sided": True},
        ),
        Call(
            "Mesh.with_groups",
            MESH.with_groups,
            {"occluders": (), "two_sided": "all", "targets": ()},
        ),
        Call(
            "look_at",
            rc.look_at,
            {"eyes": (0, 0, 3), "targets": (0, 0, 0), "up": (0, 0, 1)},
        ),
        Call(
            "sphere_of_poses",
            rc.sphere_of_poses,
            {"centre": (0, 0, 0), "distance": 1, "count": 3},
        ),
        Call("read_poses", rc.read_poses, {"path": FOLDER / "none.npy"}),
        Call("write_poses", rc.write_poses, {"path": FOLDER / "poses.npy", "poses": POSES}),
        Call(
            "write_poses, named",
            rc.write_poses,
            {"path": FOLDER / "poses.json", "poses": POSES, "camera": ["a", "b"]},
        ),
        Call(
            "read_views",
            rc.read_views,
            {"path": FOLDER / "none.json", "format": "colmap", "conventions": rc.Conventions()},
        ),
        Call(
            "write_views",
            rc.write_views,
            {
                "path": FOLDER / "views.json",
                "views": rc.Views(rc.Rig([CAMERA]), rc.Poses.of(POSES), ("a",) * len(POSES)),
                "format": "rastercov",
                "overwrite": True,
            },
        ),
        Call("visibility", rc.visibility, seen | {"method": "certified", "threads": 1}),
        Call("visibility, sampled", rc.visibility, seen | sampled),
        Call("evaluate", rc.evaluate, seen | exact | {"task": TASK, "skip_bad_poses": False}),
        Call("evaluate, sampled", rc.evaluate, seen | sampled | {"task": TASK}),
        Call(
            "evaluate_batches",
            lambda **named: list(rc.evaluate_batches(**named)),
            {"observer": observer, "poses": POSES, "task": TASK, "skip_bad_poses": False},
        ),
        Call("open_observer", lambda **named: closed(rc.open_observer(**named)), scene | exact),
        Call("Observer.observe", observer.observe, {"poses": POSES}),
        Call(
            "open_rasterizer",
            lambda **named: closed(rc.open_rasterizer(**named)),
            scene | {"backend": "cpu", "supersample": 1, "roll": 0.1, "threads": 1},
        ),
        Call(
            "open_rasterizer, OpenGL",
            lambda **named: closed(rc.open_rasterizer(**named)),
            scene
            | {"device": "auto", "plan": "auto", "require_hardware": False}
            | {"max_tile": 64, "max_faces_a_draw": 100, "image_budget": 1 << 20, "backend": "gl"},
        ),
        Call(
            "Engine",
            rc.Engine,
            {"method": "sampled", "device": "cpu", "supersample": 1, "threads": 1},
        ),
        Call(
            "Rig",
            rc.Rig,
            {"cameras": [CAMERA, CAMERA], "names": ["a", "b"], "rig_from_camera": POSES},
        ),
        Call("Rig.poses", rc.Rig([CAMERA]).poses, {"world_from_rig": POSES}),
        Call(
            "Poses.of",
            rc.Poses.of,
            {"poses": POSES, "camera": [0, 1], "skip_bad": False},
        ),
        Call("Rasterizer.count", rasterizer.count, {"poses": POSES, "drawn": True}),
        Call("Rasterizer.render", rasterizer.render, {"pose": POSES[0]}),
        Call("regions", rc.regions, seen | {"task": TASK, "method": "certified", "threads": 1}),
        Call("unite", rc.unite, {"regions": covered, "views": 2}),
        Call("dead_zones", rc.dead_zones, {"covered": rc.unite(covered, 2), "views": 2}),
        Call("RegionUnion", rc.RegionUnion, {"mesh": MESH, "views": 2}),
        Call("RegionUnion.add", rc.RegionUnion(MESH).add, {"regions": covered}),
        Call("Covered.share", rc.unite(covered).share, {"views": 1}),
        Call("cells", rc.cells, {"mesh": MESH, "size": 0.5}),
        Call("Cells.share", rc.cells(MESH, 0.5).share, {"regions": covered}),
        Call("Network", rc.Network, {"mesh": MESH, "task": TASK}),
        Call("Network.add", rc.Network(MESH, TASK).add, {"coverage": coverage}),
        # Placement
        Call(
            "Framing",
            Framing,
            {"stand_off": (0.1, 9.0), "fit": "vertices", "margin": 1.1, "rolls_deg": (0.0,)}
            | {"up": (0, 0, 1)},
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
        Call("on_hemisphere", on_hemisphere, placed | {"count": 3, "distances": (2.0, 3.0)}),
        Call(
            "on_box",
            on_box,
            placed | {"spacing": 0.7, "bounds": [(-2, -2, -2), (2, 2, 2)], "outward": 0.0},
        ),
        Call("on_walls", on_walls, placed | {"spacing": 0.4, "inset": 0.1, "heights": (0.1, 0.9)}),
        Call("on_ceiling", on_ceiling, placed | {"spacing": 0.4, "inset": 0.1}),
        Call("at_point", at_point, {"point": (0, 0, 0)}),
        Call("along", along, {"direction": (0, 0, 1)}),
        Call("at_nearest_surface", at_nearest_surface, {"groups": None}),
        Call("KeepOutBox", KeepOutBox, {"low": (0, 0, 0), "high": (1, 1, 1), "name": "table"}),
        Call("KeepOutSphere", KeepOutSphere, {"centre": (0, 0, 0), "radius": 1.0, "name": "ball"}),
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
        Call("select_greedy", select_greedy, {"problem": problem, "effort": 10, "seed": 0}),
        Call(
            "select_lazy",
            select_lazy,
            {"problem": on_bits, "effort": 10, "seed": 0, "core_pairs": 1000},
        ),
        Call(
            "PoseSpace",
            PoseSpace,
            {"mesh": MESH, "stand_off": (0.5, 3.0), "clearance": 0.1, "keep_out": ()},
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
    return {call.name: call for call in found}


SLOW = {
    ("on_sphere", "count"),
    ("on_hemisphere", "count"),
    ("on_box", "spacing"),
    ("on_walls", "spacing"),
    ("on_ceiling", "spacing"),
    ("select_greedy", "effort"),
    ("select_lazy", "effort"),
    ("tolerance", "draws"),
}
"""Arguments that ask for work: a large number is an honest wish for much of it."""


def is_wish_for_much_work(name, argument, value):
    is_number = isinstance(value, int | float | np.integer | np.floating)
    is_asked = (name, argument) in SLOW and is_number and not isinstance(value, bool)
    return bool(is_asked and (abs(value) > 1e3 or 0 < value < 1e-3))
