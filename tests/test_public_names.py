"""The public surface: small, sorted, documented, and all there."""

import ast
import dataclasses
import importlib
import inspect

import numpy as np
import pytest
from of_features import of_features
from processes import python

import rastercov
import rastercov.core.mesh.shapes

SURFACE = """
    BeamDensity BoundKind Camera CameraError CellShares Cells
    ConfigError Conventions Coverage CoverageBits Covered DeadZones DeviceError Engine Evaluation
    FaceCounts Group Mesh MeshError
    Network Observation Observer PoseError Poses RastercovError Rasterizer
    RasterizerInfo RayAngle Reason RegionUnion Regions ResourceError Rig Task Uncertainty
    Views Visibility VisibilityBuffer Workers audit cells check dead_zones evaluate
    look_at open_observer open_rasterizer place read_poses read_views
    regions show sphere_of_poses table unite visibility write_poses write_views"""
"""A name that is added or goes is added or goes here, and in CHANGELOG.md."""


def test_the_surface_is_these_names():
    assert SURFACE.split() == sorted(set(SURFACE.split()))
    assert rastercov.__all__ == sorted({*SURFACE.split(), *of_features("NAMES")})


def test_every_name_is_there_and_nothing_public_is_left_out():
    for name in rastercov.__all__:
        getattr(rastercov, name)  # imported at its first use
    names = {n for n, value in vars(rastercov).items() if not inspect.ismodule(value)}
    assert {name for name in names if not name.startswith("_")} == set(rastercov.__all__)


def test_dir_has_public_names_only():
    assert dir(rastercov) == rastercov.__all__
    assert rastercov.shapes is rastercov.core.mesh.shapes  # by its name, as any module
    assert rastercov.__version__


CAMERA = rastercov.Camera(width=24, height=18, fx=20, fy=20)
POSES = rastercov.sphere_of_poses((0, 0, 0), 4, 3)


def values():
    """A value of every public class but errors."""
    mesh = rastercov.core.mesh.shapes.box()
    regions = rastercov.regions(mesh, CAMERA, POSES)
    covered, cells = rastercov.unite(regions), rastercov.cells(mesh, 0.5)
    result = rastercov.evaluate(mesh, CAMERA, POSES, by="area", fields=["coverage"])
    rig = rastercov.Rig([CAMERA] * 20)
    bits = rastercov.evaluate(mesh, CAMERA, POSES, by="face", fields=["covered"]).bits
    with (
        rastercov.open_observer(mesh, CAMERA) as observer,
        rastercov.open_rasterizer(mesh, CAMERA, "cpu") as rasterizer,
    ):
        seen, counts = observer.observe(POSES), rasterizer.count(POSES)
        picture, fractions = rasterizer.render(POSES[0]), rastercov.visibility(mesh, CAMERA, POSES)
        return [
            *(mesh, regions, covered, cells, result, bits, rig, observer, rasterizer, seen, counts),
            *(picture, fractions, result.network, rasterizer.info, CAMERA, rastercov.Task()),
            *(cells.share(regions), rastercov.dead_zones(covered), rastercov.Poses.of(POSES)),
            rastercov.Mesh(mesh.vertices, mesh.faces, [rastercov.Group("two\nlines")]),
            rastercov.Views(rig=rig, poses=rastercov.Poses.of(POSES), images=("a", "b\n", "c")),
            *(rastercov.RegionUnion(mesh), rastercov.Engine(), rastercov.Workers(2)),
            rastercov.RayAngle(np.eye(3)[:2], 20),
            rastercov.Uncertainty(np.eye(3), 1e-4, 1e-4),
            rastercov.BeamDensity((0, 0, 0), (0, 0, 1), 0.2, 100),
            *of_features("SHOWN"),
            *(rastercov.Conventions(), mesh.groups[0], rastercov.Reason(0), rastercov.BoundKind(0)),
        ]


def test_every_repr_is_one_line():
    result = values()
    for value in result:
        text = repr(value)
        assert "\n" not in text
        assert len(text) < 600, text
    classes = {n for n in rastercov.__all__ if inspect.isclass(getattr(rastercov, n))}
    shown = {kind.__name__ for value in result for kind in type(value).__mro__}
    assert {n for n in classes - shown if not n.endswith("Error")} == set()


@pytest.mark.parametrize("name", rastercov.__all__)
def test_every_name_and_its_members_are_documented(name):
    value = getattr(rastercov, name)
    first = inspect.getdoc(value).splitlines()[0]
    assert len(first) > 20
    assert first.endswith((".", ":"))
    # Not the signature that dataclass writes in place of a docstring.
    assert not first.startswith(f"{name}(")
    for member, of_class in vars(value).items() if inspect.isclass(value) else ():
        if not member.startswith("_") and (callable(of_class) or isinstance(of_class, property)):
            assert inspect.getdoc(of_class), f"{name}.{member}"
    if not inspect.isfunction(value):
        return
    signature, text = inspect.signature(value), inspect.getdoc(value)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter.name
        if "Parameters\n---" in text:
            assert parameter.name in text, parameter.name


VALUES = [n for n in rastercov.__all__ if dataclasses.is_dataclass(getattr(rastercov, n))]


@pytest.mark.parametrize("name", VALUES)
def test_values_are_frozen(name):
    kind = getattr(rastercov, name)
    assert kind.__dataclass_params__.frozen
    thing = object.__new__(kind)
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(thing, [*(each.name for each in dataclasses.fields(kind)), "new"][0], None)


RESULTS = [
    *("CellShares", "Cells", "Coverage", "Covered", "DeadZones", "Evaluation", "FaceCounts"),
    *("Observation", "Poses", "Regions", "Views", "Visibility", "VisibilityBuffer"),
]


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


@pytest.mark.slow
def test_importing_the_package_opens_no_graphics():
    code = "import sys, rastercov; print({'moderngl', 'trimesh', 'rich'} & set(sys.modules))"
    assert python("-c", code).stdout.strip() == "set()"


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
