"""Every public function with every argument, and values that none of them is meant for.

Used by `test_misuse`, which tries each value alone, and by `benchmarks/attack_misuse`, which spoils
several arguments at once. The arguments of a call come from the signature: those that `OWN` names,
those of an object that the constructor has made, the `usual` ones of that name, and defaults. A
call is named for what it calls, and for what is special after a comma.
"""

import inspect
import sys
import warnings
from dataclasses import dataclass, replace
from enum import Enum
from importlib import import_module
from typing import Any

import numpy as np
from misuse_values import CAMERA, FOLDER, MESH, PLAN, POSES, TASK
from of_features import of_features

import rastercov as rc
from rastercov import placement
from rastercov.base.typed import VARIADIC, public_names
from rastercov.core.camera.rig import equipment_words, phased_features
from rastercov.core.coverage.coverage import evaluate_batches
from rastercov.placement.candidates.segments import segment

MODULES = (
    "rastercov",
    "rastercov.core.mesh.shapes",
    "rastercov.placement.targets",
    "rastercov.placement",
)
"""Documented modules."""
SIZE = {"width": 32, "height": 24}
LENS = SIZE | {"fx": 30.0, "fy": 30.0}
SAMPLED = {"method": "sampled:cpu", "threads": 1}
EXACT = {"method": "exact", "threads": 1}
ALONE = {"method": rc.Engine("exact", threads=1)}
STILL = dict.fromkeys([*equipment_words(), *(each.word for each in phased_features())])
SHEETS = {"spacing": 0.4, "inset": 0.1}
VIEWS = rc.Views(rc.Rig([CAMERA], ["a"]), rc.Poses.of(POSES), ("a", "b"))
WALL = rc.Mesh([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], [(0, 1, 2), (0, 2, 3)])
SQUARE = [(-2, -2), (2, -2), (2, 2), (-2, 2)]
ROOM = placement.Room.of_polygon(SQUARE, (-2, 2))
OWN: dict[str, dict[str, Any]] = {
    "Camera": LENS
    | {"cx": 1.0, "cy": 1.0, "near": 0.1, "focal_length": 0.01, "pixel_size": (1e-5, 1e-5)}
    | {"aperture": 1e-3, "focus_distance": 1.0},
    "Camera, of a lens": LENS
    | {"model": "opencv", "distortion": (0.1, 0, 0, 0), "skew": 1.0, "max_angle_deg": 60.0},
    "Camera, in focus": LENS | {"focus_range": (0.1, 2.0)},
    "Camera.from_lens": SIZE
    | {"focal_length": 0.01, "pixel_size": 1e-5, "principal_point": (1e-4, 1e-4)}
    | {"f_number": 2.0, "focus_distance": 1.0},
    "Camera.from_lens, aperture": SIZE
    | {"focal_length": 0.01, "pixel_size": (1e-5, 1e-5), "aperture": 0.001, "focus_distance": 1.0},
    "Camera.from_fov": SIZE | {"hfov_deg": 60.0, "near": 0.1},
    "Camera.from_fov, down": SIZE | {"vfov_deg": 60.0},
    "Camera.telecentric": SIZE
    | {"magnification": 0.1, "pixel_size": 5e-6, "working_distance": 0.3, "f_number": 8.0},
    "Camera.line_scan": {"width": 64, "lines": 48, "magnification": 0.1, "pixel_size": 5e-6}
    | {"vy": 5e-5, "vx": 0.0, "vz": 0.0},
    "Camera.orthographic": SIZE | {"px_per_m": 100.0, "near": 0.1},
    "Camera.from_opencv": SIZE | {"K": CAMERA.opencv_K, "distortion": (0, 0, 0, 0)},
    "Camera.preset": {"name": "khepra"},
    "Camera.with_optics": {"entries": {"near": 0.01}},
    "Camera.load": {"path": FOLDER / "camera.json"},
    "CoverageBits.open": {"folder": FOLDER},
    "CoverageBits.dense": {"poses": slice(None)},
    "Camera.save": {"path": FOLDER / "saved.json"},
    "Camera.from_dict": {"entries": LENS},
    "Camera.resized": {"scale": 0.5},
    "Task.thesis": {"min_pixels": 1, "max_incidence_deg": 80, "min_coverage": 0.5, "views": 1},
    "Mesh, in groups": {"groups": [rc.Group("a"), rc.Group("b")], "face_group": np.arange(12) % 2},
    "Mesh.joined": {"parts": [MESH, MESH], "names": ["a", "b"]},
    "Mesh.terrain": {"heights": [[1, 2], [3, 4]], "spacing": (2.0, 3.0), "origin": (1.0, 2.0)},
    "Mesh.load": {"path": FOLDER / "triangle.off", "max_bytes": 1000, "memory_budget": 1 << 20},
    "Mesh.load, built in": {"path": "box", "two_sided": ()},
    "audit": {"names": ["a", "b"], "by": "face"},
    "check": {"min_coverage": 0.5, "groups": {"mesh": 0.2}, "baseline": FOLDER / "check.json"},
    "show": {"path": FOLDER / "page.html"},
    "table": {"name": "faces"},
    "look_at": {"eyes": (0, 0, 3), "targets": (0, 0, 0)},
    "sphere_of_poses": {"distance": 1},
    "read_poses": {"path": FOLDER / "poses.npy"},
    "write_poses": {"path": FOLDER / "written.npy", "camera": None},
    "write_poses, named": {"path": FOLDER / "written.json", "camera": ["a", "b"]},
    "read_views": {"path": FOLDER / "views.json", "conventions": rc.Conventions()},
    "write_views": {"views": VIEWS, "path": FOLDER / "written_views.json", "overwrite": True},
    "evaluate": ALONE | STILL,
    "evaluate, by area": ALONE | STILL | {"by": "area", "fields": []},
    "evaluate, sampled": {"method": rc.Engine("sampled", "cpu", threads=1)} | STILL,
    "regions, at rest": STILL,
    "open_observer": EXACT,
    "open_observer, sampled": SAMPLED,
    "visibility, sampled": SAMPLED,
    "open_rasterizer": {"backend": "cpu", "roll": 0.1, "threads": 1},
    "open_rasterizer, OpenGL": {
        "device": "auto",
        "plan": "auto",
        "backend": "gl",
    },
    "Engine.of": {"method": "certified"},
    "Engine.parse": {"text": "sampled:cpu@2"},
    "Workers, elsewhere": {"number": None, "scheduler": "tls://host:1"},
    "Poses.of": {"camera": [0, 1]},
    "Poses.check_cameras": {"n_cameras": 1},
    "Views.through": {"cameras": VIEWS},
    "Rasterizer.render": {"pose": POSES[0]},
    "Regions.at_least": {"k": 1, "of": [0, 0]},
    "Rig.preset": {"name": "stereo:0.12"},
    "Rig.line_scan": {"width": 64, "lines": 48, "focal_length": 0.05, "pixel_size": 5e-6}
    | {"vy": 1e-4, "depths": (0.4, 0.5), "strips": 4},
    "RayAngle": {"eyes": [(0, 0, 1), (1, 0, 1)], "degrees": 20.0},
    "BeamDensity": {"centres": (0, 0, 1), "axes": (0, 0, 1), "step_deg": 0.5, "limit": 100.0},
    "Uncertainty": {"eyes": [(0, 0, 1), (1, 0, 1)], "limit": 1e-4, "noise": 1e-4}
    | {"along": "normal"},
    "Regions.by_devices": {"of": [0, 0], "needs": [0]},
    "Regions.where": {"criterion": rc.RayAngle([(0, 0, 1), (1, 0, 1)], 20.0)},
    "Rig.of_several": {"rigs": [VIEWS.rig], "names": ["a"]},
    "Camera.check_pinhole": {"what": "this test"},
    "Camera.check_central": {"what": "this test"},
    "RegionUnion.fill": {"chosen": np.arange(12) < 3},
    "RegionUnion.add_parts": {"chosen": np.ones(4, np.bool_)},
    "Network.judge": {"poses": rc.Poses.of(POSES)},
    "box": {"size": (1, 1, 1)},
    "DeadZones.places": {"n": 2},
    "DeadZones.reasons": {"n": 2},
    "by_name": {"name": "box"},
    "sheet_above": {"group": "mesh", "height": 1.6},
    "faces_on": {"sheet": rc.shapes.box(), "facing": 4, "spacing": 0.5, "size": 0.2},
    "faces_on, directions": {"sheet": rc.shapes.box(), "facing": [(1, 0, 0)]},
    "box_grid": {"count": (1, 2, 1), "size": 0.1},
    "count_for": {"spacing": 0.5},
    "with_target": {"name": "sheet", "two_sided": True},
    "Framing": {"stand_off": (0.1, 9.0), "fit": "vertices", "margin": 1.1},
    "on_box": {"spacing": 0.7, "bounds": [(-2, -2, -2), (2, 2, 2)]},
    "on_walls": SHEETS | {"heights": (0.1, 0.9)},
    "on_ceiling": SHEETS,
    "Survey": {"height": 4.0, "tilt_deg": 10.0},
    "Circles": {"radius": 3.0, "heights": [0.5, 1.0], "count": 4},
    "strips": {"survey": placement.Survey(height=4.0)},
    "orbit": {"circles": placement.Circles(radius=3.0, heights=[0.5, 1.0], count=4)},
    "facade": {"mesh": WALL, "distance": 2.0, "groups": ["mesh"]},
    "in_room": SHEETS | {"heights": (0.1, 0.9), "room": ROOM},
    "KeepOutBox": {"name": "table"},
    "KeepOutSphere": {"radius": 1.0, "name": "ball"},
    "problem_of": {"costs": [1.0, 2.0], "min_coverage": 0.5},
    "FewestCameras": {"coverage": 0.9, "of_reachable": True},
    "BestCoverage": {"cameras": 1, "budget": 2.0},
    "select_thesis": {"mean_coverage": [0.5, 0.5]},
    "optimise": {"cameras": 1, "budget": 8, "camera": 0},
    "refine": {"step": 0.1, "turn_deg": 10.0, "halvings": 0, "budget": 2},
    "what_is_left": {"candidates": None, "covered": None},
    "PoseSpace": {"stand_off": (0.5, 3.0), "clearance": 0.1},
}
OWN |= of_features("CALLS")
"""Arguments of calls whose defaults, or those that are usual under the name, are not right."""
OF_PLACEMENT = {name for name in placement.__all__ if inspect.isclass(getattr(placement, name))}
"""Classes of placement: most are results, and their methods take what its functions make. Their
signatures are tried, and the values of those in `OWN`."""
UNTRIED = of_features("UNTRIED")
"""Classes, each with the reason why it is not tried."""


def opened_and_closed(function):
    """The function, whose result is closed."""
    return lambda **named: function(**named).close()


def listed(function):
    """The function, whose results are all taken."""
    return lambda **named: list(function(**named))


def in_words(function):
    """The function, whose result is printed."""
    return lambda **named: f"{function(**named)} {function(**named)!r}"


MADE = {"open_observer": opened_and_closed, "open_rasterizer": opened_and_closed}
MADE |= dict.fromkeys(("Coverage", "Evaluation", *of_features("IN_WORDS")), in_words)
MADE |= {"Network.judge": listed}
"""Functions whose results have to be closed or taken."""


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
        """Fault of the call, empty if there is none; see `fault_of`."""
        return fault_of(lambda: self.function(**self.arguments))


def fault_of(function):
    """Fault of a call, empty if there is none.

    It must return, or raise one of our errors with one printable line, warn of nothing, and leave
    nothing open.
    """
    unraised = []
    hook, sys.unraisablehook = sys.unraisablehook, lambda result: unraised.append(result.exc_value)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            function()
    except rc.RastercovError as error:
        text = str(error)
        if not text or not text.isprintable() or len(text) > 700:
            return f"no line for people: {text[:200]!r}"
        if "defect of rastercov" in text:
            return "calls itself a defect"
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:200]
    finally:
        sys.unraisablehook = hook
    return "; ".join(map(repr, unraised))[:200]


def public_callables():
    """Functions, constructors and methods of the documented modules, by their names.

    Not the errors, which are raised; nor the enumerations and protocols, which users do not make.
    """
    table = {}
    for name in MODULES:
        module = import_module(name)
        for thing in (getattr(module, name) for name in public_names(module)):
            if inspect.isfunction(thing):
                table[thing.__name__] = thing
            elif inspect.isclass(thing) and not issubclass(thing, Exception | Enum):
                table |= methods_of(thing)
                if not (getattr(thing, "_is_protocol", False) or inspect.isabstract(thing)):
                    table[thing.__name__] = thing
    return table


def methods_of(kind):
    """Public methods of a class that are our own, by their names."""
    names = set(dir(kind)) - set(getattr(kind, "__dataclass_fields__", ()))
    methods = {name: getattr(kind, name) for name in sorted(names) if not name.startswith("_")}
    return {
        f"{kind.__name__}.{name}": method
        for name, method in methods.items()
        # From Python 3.13 on, a cached property is a routine.
        if inspect.isroutine(method)
        and callable(method)
        and method.__module__.startswith("rastercov.")
    }


def parameters_of(function):
    """Parameters of a callable that a person gives."""
    values = inspect.signature(function).parameters.values()
    return [each for each in values if each.name != "self"]


def names_of_calls():
    """Names of all calls, without making one."""
    plain = [
        name
        for name, function in public_callables().items()
        if parameters_of(function)
        and name not in UNTRIED
        and (name in OWN or name.partition(".")[0] not in OF_PLACEMENT)
    ]
    return plain + [name for name in OWN if name not in plain]


def calls():
    """Every public call with arguments that are right, by name; what a folder must have is made."""
    (FOLDER / "triangle.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    CAMERA.save(FOLDER / "camera.json")
    for name, text in of_features("FILES").items():
        (FOLDER / name).write_text(text)
    rc.write_poses(FOLDER / "poses.npy", POSES)
    rc.check(PLAN, POSES, min_coverage=0.5, out=FOLDER)
    for name in ("packed", "area_units", "views"):
        np.save(FOLDER / f"{name}.npy", np.zeros((1, 1), np.uint8))
    (FOLDER / "bits.json").write_text('{"unit_m2": 1.0}')
    public = public_callables() | {"select_thesis": thesis()}
    objects, usual = right_objects()
    rc.write_views(FOLDER / "views.json", VIEWS, overwrite=True)
    table = {}
    for name in names_of_calls():
        called = name.partition(",")[0]
        owner, _, method = called.partition(".")
        function = public[called]
        made = objects.get(called)
        known = {each.name: each.default for each in parameters_of(function)} | usual
        arguments = {
            each.name: getattr(made, each.name, known[each.name])
            for each in parameters_of(function)
            if each.kind not in VARIADIC and f"{called} {each.name}" not in UNTRIED
        } | OWN.get(name, {})
        assert not any(each is inspect.Parameter.empty for each in arguments.values()), name
        if method and owner in objects:
            function = getattr(objects[owner], method)
        table[name] = Call(name, MADE.get(called, lambda f: f)(function), arguments)
    return table


def thesis():
    """A function of the laboratory that is documented beside those of placement."""
    return import_module("rastercov.reference.thesis").select_thesis


def right_objects():
    """Objects of public classes by their names, and arguments that are right under any function."""
    observer = rc.open_observer(MESH, CAMERA, threads=1)
    rasterizer = rc.open_rasterizer(MESH, CAMERA, "cpu", threads=1)
    counts, poses = rasterizer.count(POSES), rc.Poses.of(POSES)
    regions = rc.regions(MESH, CAMERA, POSES, threads=1)
    covered, cells = rc.unite(regions, 2), rc.cells(MESH, 0.5)
    made = [
        CAMERA, MESH, TASK, VIEWS, observer, counts, counts.info, poses, regions, covered, cells,
        rc.dead_zones(covered, 2), rc.RegionUnion(MESH, 2), rc.Network(MESH, TASK),
        rc.Rig([CAMERA, CAMERA], ["a", "b"], POSES), cells.share(regions),
        observer.observe(POSES), rasterizer.render(POSES[0]), rc.Workers(1),
        rc.evaluate(MESH, CAMERA, POSES), rc.visibility(MESH, CAMERA, POSES),
        rc.evaluate(MESH, CAMERA, POSES, method="sampled", fields=("covered",)).bits,
        next(evaluate_batches(observer, POSES)),
    ]  # fmt: skip
    objects = {type(each).__name__.lstrip("_"): each for each in [*made, *of_features("OBJECTS")]}
    objects |= {"Observer": observer, "Rasterizer": rasterizer}
    matrix = placement.build_matrix((MESH, CAMERA), POSES)
    goal = placement.BestCoverage(cameras=1)
    usual = {
        "mesh": MESH, "camera": CAMERA, "poses": POSES, "task": TASK, "threads": 1, "plan": PLAN,
        "name": "a", "value": rc.evaluate(MESH, CAMERA, POSES, fields=()),
        **dict.fromkeys(equipment_words()),
        **of_features("USUAL"), "observer": observer, "regions": regions,
        "covered": covered, "coverage": made[-1],
        "counts": counts, "views": 1, "size": 0.5, "world_from_rig": POSES, "rig": objects["Rig"],
        "chosen": np.ones(2, np.bool_), "tri": MESH.to_trimesh(), "max_blur": 1.0, "count": 3,
        "centre": (0, 0, 0), "low": (0, 0, 0), "high": (1, 1, 1), "target": MESH, "faces": [0, 1],
        "alpha_deg": 15, "beta_deg": 25, "segmentation": segment(MESH, 15, 25), "point": (0, 0, 0),
        "direction": (0, 0, 1), "points": [(0, 0, 0)], "view": (MESH, CAMERA), "matrix": matrix,
        "candidates": placement.on_sphere(MESH, CAMERA, count=4), "goal": goal,
        "covers": np.eye(3, dtype=bool), "problem": placement.problem_of(matrix, MESH, goal),
        "objective": placement.Objective.of(observer, TASK), "number": 1, "scheduler": None,
        "space": placement.PoseSpace(mesh=MESH, stand_off=(0.5, 9.0)),
        "error": placement.InstallationError(position_mm=1.0),
    }  # fmt: skip
    return objects, usual


SLOW = {
    "optimise": ("budget", "cameras"),
    "refine": ("budget", "halvings"),
    **dict.fromkeys(("on_sphere", "on_hemisphere"), ("count",)),
    **dict.fromkeys(("on_box", "on_walls", "on_ceiling", "in_room"), ("spacing",)),
    "facade": ("gsd", "front", "side"),
    "select_greedy": ("effort",),
    "tolerance": ("draws",),
}
"""Arguments that ask for work: a large number is an honest wish for much of it."""


def is_wish_for_much_work(name, argument, value):
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if argument == "open_browser":
        return True
    if argument in ("progress", "aim") and callable(value):
        return True  # a function of the caller's own, which fails as it likes
    is_asked = argument in SLOW.get(name, ()) and is_number and not isinstance(value, bool)
    return bool(is_asked and (abs(value) > 1e3 or 0 < value < 1e-3))
