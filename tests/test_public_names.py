"""The public surface: small, sorted, documented, and all there."""

import ast
import dataclasses
import importlib
import inspect
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from processes import python

import rastercov
import rastercov.mesh.shapes

ROOT = Path(rastercov.__file__).parent
# Modules whose public classes and functions are the package's own names, and what they keep to
# themselves: the links between the modules, which a caller of the package does not need.
SURFACE = {
    "coverage.area.cells": {"FINEST_REL", "MOST_CELLS", "USUAL_CELLS", "rounded_up", "usual_size"},
    "coverage.area.regions": {
        *("GAP_REL", "OF_A_FACE", "RegionObservation", "RegionObserver", "RegionPass"),
        *("STRIP_REL", "check_pointwise"),
    },
    "coverage.area.union": {
        "FLOOR_REL",
        "MOST_VIEWS",
        "WHOLE_PAIR_REL",
        "diagonal_floor",
        "polygon_areas",
        "with_rest",
    },
    "coverage.area.zones": {
        *("LEAST_REL", "MOST_ZONES", "OPEN_TOLERANCE_REL", "SLIVER_REL", "SWEEP"),
        *("LEAST_PERCENT", "MOST_LINES", "PAIRS", "TOLERANCE_REL", "ZONES"),
        *("summary_of", "zone_line", "zone_lines"),
    },
    "camera.camera": {
        *("ANGLES", "MOST_DIFFERENCE_REL", "OF_LENS", "OPTICS", "PRESETS", "check_optics"),
        *("CENTRES", "CHECKS", "border_of"),
    },
    "camera.formats.__init__": {
        *("IN_FOLDERS", "IN_METRES", "OF_ONE_CAMERA", "READERS", "WRITERS", "format_of"),
        *("BY_SUFFIX", "PARTS_OF_COLMAP", "TABLES"),
        *("Reader", "read_through"),
    },
    "camera.formats.conventions": {
        *("Border", "DRIFT_OF_FILES", "LENS_MODELS", "OPENGL_AXES", "POSE_CONVENTIONS"),
        *("inverse_of", "metres_per", "unique_names"),
        *("from_quaternions", "from_vectors", "motions", "to_quaternions"),
        *("forms_of", "is_whole_panorama", "lens_camera", "lost", "model_in"),
        *("in_convention", "no_model", "opencv_terms", "panorama", "yaml_matrix"),
    },
    "coverage.coverage": {
        *("FIGURES", "PAIRS_A_BATCH", "POSES_A_BATCH", "UNITS", "arrays_for", "batch_size"),
        *("check_observer", "checked_fields", "checked_task", "judged", "measurements"),
    },
    "coverage.evaluation": set(),
    "coverage.job": {"ALONE", "EVALUATE_BUDGET", "LOG", "Staff", "measure"},
    "coverage.engine": {"METHODS", "settled"},
    "cluster.workers": {
        *("ASK_SECONDS", "CONNECT_SECONDS", "ENVIRONMENT", "LOGS", "MOST_WORKERS", "OfScheduler"),
        *("Pool", "SchedulerLostError", "check_address", "risk"),
    },
    "base.errors": set(),
    "report.jobs": set(),
    "coverage.network": {
        *("CHOICES", "JudgedPoses", "OF_POSES", "PairBuffer", "Part", "SUMMED", "ViewSpread"),
        *("check_choice", "from_arrays", "joined", "least_cosine", "share_of_faces", "to_arrays"),
    },
    "camera.pose": {
        *("DRIFT_TOLERANCE", "as_matrices", "check_poses", "inverse", "real_numbers"),
        *("renumbered", "valid_poses"),
    },
    "camera.pose_file": set(),
    "raster.__init__": {"BACKENDS", "backend_of"},
    "camera.rig": {
        "Cameras",
        "MOST_CAMERAS",
        "MOST_NAMES",
        "cameras_of",
        "check_scene",
        "names_of",
        "only_camera",
    },
    "raster.contract": {"MAX_RENDERED", "MAX_SUPERSAMPLE", "check_counts", "check_picture"},
    "raster.observation": set(),
    "coverage.observer": {"ExactObserver", "ROLL", "SampledObserver"},
    "coverage.task": {"THESIS", "Rules"},
    "camera.viewpoints": {
        *("LARGEST_ANGLE", "WIDEST_DEG", "enclosing_distance", "fibonacci_sphere", "half_angles"),
    },
}
MESH = {"Group", "Mesh"}


def defined(module):
    """Public names that a module defines itself, as opposed to imports and type aliases."""
    tree = ast.parse((ROOT / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8"))
    names = set()
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    return {name for name in names if not name.startswith("_") and not name.endswith("Array")}


def test_all_is_sorted_and_without_repeats():
    assert rastercov.__all__ == sorted(set(rastercov.__all__))


def test_every_name_is_there_and_nothing_public_is_left_out():
    for name in rastercov.__all__:
        getattr(rastercov, name)  # imported at its first use
    found = {
        name
        for name, value in vars(rastercov).items()
        if not name.startswith("_") and not inspect.ismodule(value)
    }
    assert found == set(rastercov.__all__)


def test_dir_has_public_names_only():
    assert dir(rastercov) == rastercov.__all__
    assert rastercov.shapes is rastercov.mesh.shapes  # by its name, as any module
    assert rastercov.__version__


CAMERA = rastercov.Camera(width=24, height=18, fx=20, fy=20)
POSES = rastercov.sphere_of_poses((0, 0, 0), 4, 3)


def values():
    """A value of every public class but errors."""
    mesh = rastercov.mesh.shapes.box()
    regions = rastercov.regions(mesh, CAMERA, POSES)
    covered, cells = rastercov.unite(regions), rastercov.cells(mesh, 0.5)
    found = rastercov.evaluate(mesh, CAMERA, POSES, by="area", fields=["coverage"])
    rig = rastercov.Rig([CAMERA] * 20)
    with (
        rastercov.open_observer(mesh, CAMERA) as observer,
        rastercov.open_rasterizer(mesh, CAMERA, "cpu") as rasterizer,
    ):
        seen, counts, picture = (
            observer.observe(POSES), rasterizer.count(POSES), rasterizer.render(POSES[0])
        )  # fmt: skip
        fractions, part = (
            observer.visibility(POSES),
            next(rastercov.evaluate_batches(observer, POSES)),
        )
        return [
            *(mesh, regions, covered, cells, found, rig, observer, rasterizer, seen, counts),
            *(picture, fractions, part, found.network, rasterizer.info, CAMERA, rastercov.Task()),
            *(cells.share(regions), rastercov.dead_zones(covered), rastercov.Poses.of(POSES)),
            rastercov.Mesh(mesh.vertices, mesh.faces, [rastercov.Group("two\nlines")]),
            rastercov.Views(rig=rig, poses=rastercov.Poses.of(POSES), images=("a", "b\n", "c")),
            *(rastercov.RegionUnion(mesh), rastercov.Engine(), rastercov.Workers(2)),
            *(rastercov.Conventions(), mesh.groups[0], rastercov.Reason(0), rastercov.BoundKind(0)),
        ]


def test_every_repr_is_one_line():
    found = values()
    for value in found:
        text = repr(value)
        assert "\n" not in text
        assert len(text) < 500, text
    classes = {n for n in rastercov.__all__ if inspect.isclass(getattr(rastercov, n))}
    shown = {kind.__name__ for value in found for kind in type(value).__mro__}
    assert {n for n in classes - shown if not n.endswith("Error")} == {"Rasterizer"}  # a protocol


def test_the_modules_offer_these_names_and_no_others():
    offered = MESH | {name for module, own in SURFACE.items() for name in defined(module) - own}
    assert offered == set(rastercov.__all__)


@pytest.mark.parametrize("module", SURFACE)
def test_what_a_module_keeps_to_itself_exists(module):
    assert SURFACE[module] <= defined(module)


@pytest.mark.parametrize("name", rastercov.__all__)
def test_every_name_says_what_it_is(name):
    first = inspect.getdoc(getattr(rastercov, name)).splitlines()[0]
    assert len(first) > 20
    assert first.endswith((".", ":"))
    # Not the signature that dataclass writes in place of a docstring.
    assert not first.startswith(f"{name}(")


@pytest.mark.parametrize(
    "name", [n for n in rastercov.__all__ if inspect.isclass(getattr(rastercov, n))]
)
def test_every_method_says_what_it_does(name):
    for member, value in vars(getattr(rastercov, name)).items():
        if not member.startswith("_") and (callable(value) or isinstance(value, property)):
            assert inspect.getdoc(value), f"{name}.{member}"


@pytest.mark.parametrize(
    "name", [n for n in rastercov.__all__ if inspect.isfunction(getattr(rastercov, n))]
)
def test_every_parameter_of_a_function_is_documented_and_typed(name):
    function = getattr(rastercov, name)
    text = inspect.getdoc(function)
    signature = inspect.signature(function)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter.name
        if "Parameters\n---" in text:
            assert parameter.name in text, parameter.name


VALUES = [
    "Camera",
    "Coverage",
    "Engine",
    "Evaluation",
    "FaceCounts",
    "Group",
    "Mesh",
    "Observation",
    "Poses",
]
VALUES += ["RasterizerInfo", "Rig", "Task", "Visibility", "VisibilityBuffer"]
VALUES += ["CellShares", "Cells", "Covered", "DeadZones", "Regions"]
VALUES += ["Conventions", "Views", "Workers"]


@pytest.mark.parametrize("name", VALUES)
def test_values_are_frozen(name):
    kind = getattr(rastercov, name)
    assert dataclasses.is_dataclass(kind)
    assert kind.__dataclass_params__.frozen
    thing = object.__new__(kind)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(thing, dataclasses.fields(kind)[0].name, None)


RESULTS = [
    "Coverage",
    "Evaluation",
    "FaceCounts",
    "Observation",
    "Poses",
    "Visibility",
    "VisibilityBuffer",
]
RESULTS += ["CellShares", "Cells", "Covered", "DeadZones", "Regions", "Views"]


def test_every_dataclass_in_the_surface_is_listed():
    found = {n for n in rastercov.__all__ if dataclasses.is_dataclass(getattr(rastercov, n))}
    assert found == set(VALUES)


@pytest.mark.parametrize("name", RESULTS)
def test_values_of_arrays_are_compared_by_identity(name):
    # Field by field, == would be an array and its truth an error.
    assert getattr(rastercov, name).__eq__ is object.__eq__
    assert getattr(rastercov, name).__hash__ is object.__hash__


@pytest.mark.parametrize("name", RESULTS)
def test_every_array_of_a_result_is_documented(name):
    kind = getattr(rastercov, name)
    text = " ".join(map(inspect.getdoc, kind.__mro__))
    own = {"mesh", "camera", "task", "info"}
    for field in dataclasses.fields(kind):
        assert field.name in own or field.name in text, field.name


@pytest.mark.parametrize("name", [n for n in rastercov.__all__ if n.endswith("Error")])
def test_every_error_is_one_of_ours(name):
    assert issubclass(getattr(rastercov, name), rastercov.RastercovError)


def test_the_version_is_that_of_the_distribution():
    assert rastercov.__version__ == version("rastercov")


@pytest.mark.slow
def test_importing_the_package_opens_no_graphics():
    code = "import sys, rastercov; print({'moderngl', 'trimesh', 'rich'} & set(sys.modules))"
    found = python("-c", code)
    assert found.stdout.strip() == "set()"


@pytest.mark.parametrize("kind", [rastercov.BoundKind, rastercov.Reason])
def test_codes_fit_the_arrays_that_hold_them_and_each_is_explained(kind):
    codes = np.array(list(kind))
    assert codes.tolist() == list(range(len(codes)))
    assert codes.max() <= np.iinfo(np.uint8).max
    source = inspect.getsource(importlib.import_module(kind.__module__))
    body = next(n for n in ast.parse(source).body if getattr(n, "name", "") == kind.__name__).body
    for entry, text in zip(body[1::2], body[2::2], strict=True):
        assert isinstance(entry, ast.Assign)
        assert isinstance(text, ast.Expr)
