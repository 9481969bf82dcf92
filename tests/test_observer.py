"""Visible fractions: exact where nothing or all is hidden, within their bound elsewhere."""

import math

import numpy as np
import pytest
from scenes import joined, sheet, square
from visible_fractions import visibility

from rastercov.base.errors import ConfigError
from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import Poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.coverage import open_observer
from rastercov.core.coverage.face_pass import FacePass
from rastercov.core.coverage.task import METHODS
from rastercov.core.mesh import Mesh, shapes
from rastercov.core.raster.contract import BoundKind, Observation
from rastercov.gl import GLRasterizer
from rastercov.reference.methods.convergence import fractions

CAMERA = Camera(width=200, height=200, fx=100, fy=100)
AHEAD = np.eye(4)  # at the origin, looking along +z
C, S = math.cos(0.4), math.sin(0.4)
# The same view on a rolled sample grid: no edge of an upright square runs along a row of it.
ROLLED = np.array([(C, -S, 0, 0), (S, C, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)])


KINDS = "CERTIFIED", "EXACT", "STATISTICAL"
"""Kinds of the bounds of `METHODS`, of faces that nothing hides."""


@pytest.fixture
def see(device):
    """Visible fractions of one pose: value, bound, kind; and the counts they come from."""

    def see_one(mesh, camera, pose, supersample=1):
        with GLRasterizer(mesh, camera, device=device, supersample=supersample) as rasterizer:
            counts = rasterizer.count(pose)
        seen = Observation.of_counts(counts)
        result = fractions(FacePass(mesh, camera, 1), seen, Poses.of(pose))
        return *(figure[0] for figure in result), counts

    return see_one


# --- exactly 0 and 1 ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("size", [8, 9, 33, 128])
@pytest.mark.parametrize("pose", [AHEAD, ROLLED], ids=["upright", "rolled"])
def test_unhidden_is_exactly_1_and_hidden_exactly_0_at_any_resolution(see, size, pose):
    mesh = joined(square(1, 1), square(1, 2))
    camera = Camera(width=size, height=size, fx=size / 3, fy=size / 3)
    value, _, kind, counts = see(mesh, camera, pose)
    assert (counts.drawn > 0).all()
    assert value.tolist() == [1, 1, 0, 0]
    assert (kind == BoundKind.STATISTICAL).all()


# --- known fractions ------------------------------------------------------------------------------


# --- the bound ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("size", [64, 160, 320])
def test_the_bound_holds_for_nearly_all_partly_hidden_faces(see, size):
    # The truth is the same view with 16 x 16 samples a pixel, whose own error is about a sixtieth
    # (samples fall as S^2, their error as S^-1.5); faces below 64 of those samples are left out.
    mesh = shapes.teapot(5)
    camera = Camera(width=size, height=size * 3 // 4, fx=1.1 * size, fy=1.1 * size)
    held = partial = 0
    for pose in sphere_of_poses((0, 0, 0.08), 0.45, 5):
        value, bound, kind, _ = see(mesh, camera, pose)
        truth, _, _, fine = see(mesh, camera, pose, 16)
        partly = (kind == BoundKind.STATISTICAL) & (truth > 0) & (truth < 1) & (fine.drawn[0] >= 64)
        held += np.count_nonzero(np.abs(value - truth)[partly] <= bound[partly])
        partial += np.count_nonzero(partly)
    assert partial > 200
    assert held >= 0.995 * partial


# --- the public function --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "kind"),
    [(method, BoundKind[kind]) for method, kind in zip(METHODS, KINDS, strict=True)],
)
def test_back_faces_and_faces_outside_are_exactly_0(method, kind):
    away = sheet((1, -1), (-1, 1), 2)  # wound the other way
    mesh = joined(square(0.2, 1), away, sheet((9, 0), (10, 1), 2), square(1, -2))
    seen = visibility(mesh, CAMERA, AHEAD, method)
    assert seen.visibility.tolist() == [[1, 1] + [0] * 6]
    assert seen.visibility_kind.tolist() == [[kind] * 2 + [BoundKind.EXACT] * 6]
    assert (seen.visibility_bound[0, 2:] == 0).all()
    assert seen.visibility.dtype == seen.visibility_bound.dtype == np.float64
    assert seen.visibility_kind.dtype == np.uint8
    assert seen.info.backend in (("cpu", "gl") if method == "sampled" else ("analytic",))


@pytest.mark.parametrize("method", METHODS)
def test_a_face_whose_image_rounds_to_nothing_is_unknown(method):
    x = 0.5
    right = np.nextafter(x, 1)
    mesh = Mesh(vertices=[(x, x, 1), (x, right, 1), (right, right, 1)], faces=[(0, 1, 2)])
    seen = visibility(mesh, CAMERA, AHEAD, method)
    assert (seen.visibility, seen.visibility_bound) == ([[0]], [[1]])


@pytest.mark.slow
def test_edges_along_the_rows_of_the_image_are_sampled_without_bias():
    # Upright on an upright grid all errors of a row add up; the bound is for generic position.
    held = 0
    for x in np.linspace(0.1, 0.9, 41):
        mesh = joined(square(0.9, 4), sheet((-1, -1), (x - 0.5, 1), 2))
        truth, counted = (visibility(mesh, CAMERA, AHEAD, name) for name in ("exact", "sampled"))
        held += (np.abs(truth.visibility - counted.visibility) <= counted.visibility_bound)[
            0, :2
        ].sum()
    assert held == 82


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "seen"}, "method to be certified, exact or sampled, got 'seen'"),
        ({"method": None}, "method to be certified, exact or sampled, got None"),
        ({"threads": 0}, "expected threads to be a whole number from 1 to 1024, got 0"),
    ],
)
def test_what_a_method_has_not_is_refused(options, words):
    with pytest.raises(ConfigError, match=words):
        open_observer(square(1, 2), CAMERA, **options)
