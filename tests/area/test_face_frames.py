"""Frames of faces: those of the loop in C++ are those of numpy, bit for bit, and orthonormal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rastercov.core.area.polygons import Frames, frames_of
from rastercov.core.mesh import Mesh, shapes

pytestmark = pytest.mark.native


def dot(a, b):
    """Scalar products of rows, added in the order of the loop."""
    p = a * b
    return (p[:, 0] + p[:, 2]) + p[:, 1]


def twin(mesh):
    """Frames by numpy."""
    points, rows = mesh.vertices[mesh.faces], np.arange(mesh.n_faces)
    sides = np.roll(points, -1, axis=1) - points
    with np.errstate(invalid="ignore", divide="ignore"):
        lengths = np.sqrt(np.stack([dot(sides[:, k], sides[:, k]) for k in range(3)], axis=1))
        first = lengths.argmax(axis=1)
        origin, longest = points[rows, first], lengths[rows, first]
        x_axis = sides[rows, first] / longest[:, None]
        away = points[rows, (first + 2) % 3] - origin
        x = dot(away, x_axis)
        across = away - x[:, None] * x_axis
        across -= dot(across, x_axis)[:, None] * x_axis
        y = np.sqrt(dot(across, across))
        y_axis = across / y[:, None]
    corners = np.zeros((mesh.n_faces, 3, 2))
    corners[:, 1, 0], corners[:, 2, 0], corners[:, 2, 1] = longest, x, y
    normal, areas = np.cross(x_axis, y_axis), longest * y / 2
    frames = Frames(origin.copy(), x_axis, y_axis, normal, corners, areas)
    for array in frames:
        array[mesh.degenerate_mask | ~(areas > 0)] = 0.0
    return frames


@given(seed=st.integers(0, 2**32 - 1))
def test_frames_are_those_of_numpy_bit_for_bit(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 3)) * 10.0 ** rng.integers(-12, 12) + rng.choice([0.0, 1e3])
    points[::5] = points[1::5] + 1e-9 * points[2::5]  # needles, and points of files in float32
    points[3::7] = points[3::7].round(2)
    mesh = Mesh(points, rng.integers(0, 30, (40, 3)))
    for pair, expected in zip(frames_of(mesh), twin(mesh), strict=True):
        assert pair.tobytes() == expected.tobytes()
        assert not pair.flags.writeable


def test_axes_are_orthonormal_and_the_face_is_where_it_was():
    mesh = shapes.torus(9, 7)
    frames = frames_of(mesh)
    axes = np.stack(frames[1:4], axis=1)
    np.testing.assert_allclose(
        axes @ axes.swapaxes(1, 2), np.tile(np.eye(3), (126, 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(frames.normal, mesh.normals, atol=1e-14)
    np.testing.assert_allclose(frames.areas, mesh.areas, rtol=1e-14)
    corners = frames.origin[:, None] + frames.corners @ axes[:, :2]
    nearest = (
        np.abs(corners[:, :, None] - mesh.vertices[mesh.faces][:, None]).sum(axis=3).min(axis=2)
    )
    assert nearest.max() < 1e-14
