"""Copies of a surface that nearly coincide: what one of them loses, another one gains."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from exact_views import PATHS, HalfPlanes, look
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from surfaces import surface_of

import rastercov as rc
from rastercov.reference import rational
from rastercov.reference.rational import clip, dot

pytestmark = pytest.mark.native
CAMERA = rc.Camera(width=640, height=480, fx=600, fy=600, cx=320, cy=240)
TRIANGLE = np.array([(-1.0, -0.7, 0.1), (1.1, -0.6, -0.2), (0.1, 0.9, 0.3)])


def copies(n, moved, seed, offset=0.0):
    """A triangle n times, each corner moved at random."""
    random = np.random.default_rng(seed)
    corners = TRIANGLE + offset + moved * random.standard_normal((n, 3, 3))
    return rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))


def solved(mesh, offset=0.0):
    """Visible areas and their bounds, px^2."""
    solver = HalfPlanes(surface_of(mesh), CAMERA)
    eye, target = np.array([[0.3, -0.4, 3.0]]) + offset, np.zeros((1, 3)) + offset
    solver.solve(rc.look_at(eye, target)[0], 1e-3, False)
    return solver.visible, solver.area_error, solver.area


@settings(max_examples=25, deadline=None)
@given(
    n=st.integers(3, 150), exponent=st.floats(-16, -6), seed=st.integers(0, 2**32 - 1),
    offset=st.sampled_from([0.0, 100.0]),
)  # fmt: skip
def test_copies_together_are_seen_as_the_face(n, exponent, seed, offset):
    """Whatever the distance: ties are not transitive, so that indices alone hid a part from all.

    Two alone may be as far apart as just counts as one, which only the bound says.
    """
    moved = 10**exponent
    visible, error, area = solved(copies(n, moved, seed, offset), offset)
    # Borders move by some deviations, px; the bounds are of rounding.
    border = 2000 * 6 * moved * 600 / 2
    assert abs(visible.sum() - area.max()) <= 1e-6 * area.max() + border
    assert error.sum() <= 1e-6 * area.max() * n


@pytest.mark.parametrize("moved", [1e-12, 3e-11, 1e-10, 1e-9, 1e-7])
def test_many_copies_leave_few_pieces(moved):
    visible, error, area = solved(copies(600, moved, 1))
    assert abs(visible.sum() - area.max()) <= 1e-6 * area.max() + 2000 * 6 * moved * 300
    assert error.sum() <= 1e-6 * area.max()


@pytest.mark.parametrize("moved", [0.0, 1e-16, 1e-15, 1e-14, 1e-13])
def test_the_lowest_of_copies_that_coincide_is_seen(moved):
    visible, _, area = solved(copies(20, moved, 2))
    np.testing.assert_allclose(visible[0], area[0], rtol=1e-9)
    assert visible[1:].max() <= 1e-6


NEVER, TIE = 10**40, 1e-10
"""No two depths differ by so little, relative to them, that they count as one; those that do."""
NEAR, NEARLY = 2.01, 1e4
"""Ties that a face comes near to those that coincide, and that it is apart at most, to be one."""


def gaps(view):
    """Least and greatest difference of depth, in ties, where two faces overlap in the image."""
    for b, a in combinations(range(view.mesh.n_faces), 2):
        face, other = view.face(a), view.face(b)
        if face and other and (common := clip(face.image, other.half_planes)):
            pairs = [
                (face.d * dot(other.n, corner), other.d * dot(face.n, corner))
                for corner in common.corners
            ]
            apart = [float(Fraction(int(m - t), int(max(m, t)))) / TIE for m, t in pairs]
            yield (a, b), min(apart), max(apart)


def seen_by_the_rule(mesh, pose):
    """Visible areas: by index where faces coincide, by depth where one that does not is near.

    None where rounding may decide which of these holds.
    """
    view = rational.RationalView(mesh, CAMERA, pose, False, None)
    alike, near = {face: {face} for face in range(mesh.n_faces)}, set()
    for pair, least, most in gaps(view):
        farthest, nearest = max(-least, most), max(least, -most)
        limits = ((farthest, 1), (nearest, NEAR), (farthest, NEARLY))
        if any(abs(value / limit - 1) < 1e-3 for value, limit in limits):
            return None
        if farthest < 1:
            both = alike[pair[0]] | alike[pair[1]]
            alike |= dict.fromkeys(both, both)
        elif nearest < NEAR and farthest < NEARLY:
            near |= set(pair)
    is_loose = [len(own) > 1 and bool(own & near) for own in alike.values()]
    by_index = rational.visible_area(mesh, CAMERA, pose)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rational, "TIE", NEVER)
        by_depth = rational.visible_area(mesh, CAMERA, pose)
    return np.where(is_loose, by_depth, by_index)


def layers(random, corners, eye):
    """Copies moved along the rays of their corners: in a layer by some 0.5 ties, layers by 5."""
    n = len(corners)
    apart = random.integers(0, 3, (n, 1, 1)) * random.uniform(1, 5)
    apart = apart + random.uniform(-0.6, 0.6, (n, 3, 1)) * random.choice((0.5, 1.0, 2.0))
    return eye + (corners - eye) * (1 + TIE * apart)


@settings(max_examples=150, deadline=None)
@given(
    n=st.integers(2, 7), exponent=st.floats(-11.5, -7.5), seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["copies", "sizes", "shifted"]), is_layered=st.booleans(),
    distance=st.floats(0.2, 3.0),
)  # fmt: skip
def test_copies_are_within_their_bounds_of_exact_fractions(
    n, exponent, seed, kind, is_layered, distance
):
    """From afar, and so close that the image clips them and 1/z differs severalfold within one."""
    random = np.random.default_rng(seed)
    corners = TRIANGLE + np.zeros((n, 1, 1))
    if kind == "sizes":
        corners = TRIANGLE * random.uniform(0.2, 1.2, (n, 1, 1))
    elif kind == "shifted":
        corners[..., :2] += random.uniform(-0.5, 0.5, (n, 1, 2))
        corners[..., 2] = corners[..., :2] @ (0.1, -0.2)
    eye = random.normal(size=3)
    eye *= distance / np.linalg.norm(eye)
    if is_layered:
        corners = layers(random, corners, eye)
    else:
        corners = corners + 10**exponent * random.standard_normal((n, 3, 3))
    mesh = rc.Mesh(vertices=corners.reshape(-1, 3), faces=np.arange(3 * n).reshape(n, 3))
    pose = rc.look_at(eye[None], 0.3 * random.normal(size=(1, 3)))[0]
    area = rational.image_area(mesh, CAMERA, pose)
    visible = seen_by_the_rule(mesh, pose)
    assume(visible is not None)
    for path in PATHS:
        view = look(mesh, CAMERA, pose, path)
        off = np.abs(view.visible - visible) + np.abs(view.area - area)
        assert (off <= view.area_error + 1e-12).all()
