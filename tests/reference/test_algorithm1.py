"""Algorithm 1 of the thesis and its eight defects: the exact answer beside what comes out of it.

The camera sits at the origin and looks along +z, f = 100 px. Exact answers are of
`rastercov.reference.rational`, which shares nothing with Algorithm 1 but the mesh. Faces here are
(3, 3) arrays of corners; unless a test is about back faces, they are turned to face the camera.
"""

from itertools import permutations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov.core.camera.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.reference import rational
from rastercov.reference.algorithm1 import image_triangles, occlusion, self_occluding

CAMERA = Camera(width=200, height=200, fx=100, fy=100)
ORIGIN = np.eye(4)
READINGS = ("literal", "semi", "charitable")


def scene(*triangles):
    return Mesh(
        vertices=np.concatenate(triangles).astype(float),
        faces=np.arange(3 * len(triangles)).reshape(-1, 3),
    )


def facing(*corners):
    """The triangle with its corners in the order that faces the origin."""
    a, b, c = np.array(corners, dtype=float)
    return np.array([a, b, c] if np.cross(b - a, c - a) @ a < 0 else [a, c, b])


def turned(triangle, degrees):
    """About the optical axis."""
    x, y, z = np.transpose(triangle)
    cos, sin = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return facing(*np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1))


def exact(mesh, camera=CAMERA):
    """Hidden fraction of each face, two-sided."""
    drawn = rational.image_area(mesh, camera, ORIGIN)
    seen = rational.visible_area(mesh, camera, ORIGIN, exact=True)
    return np.array([float(1 - part / whole) for part, whole in zip(seen, drawn, strict=True)])


def algorithm1(mesh, reading, self_occlusion=None):
    return occlusion(mesh, CAMERA, ORIGIN, reading, self_occlusion=self_occlusion)


def same(value, *expected):
    return value == pytest.approx(expected, abs=1e-9, nan_ok=True)


# 1 -----------------------------------------------------------------------------------------------


def test_depth_of_the_centroid_is_no_order_of_occlusion():
    large = facing((-1, -1, 2), (1, -1, 2), (0, 12, 16))
    small = facing((-0.2, 5, 8), (0.2, 5, 8), (0, 5.5, 8))  # before the far end of the large one
    mesh = scene(large, small)
    assert same(exact(mesh), 1 / 400, 0)
    for reading in READINGS:
        assert same(algorithm1(mesh, reading), 0, 1)

    # The same image, with the small face moved before the centroid of the other.
    mesh = scene(large, small * 6 / 8)
    assert same(exact(mesh), 1 / 400, 0)
    for reading in ("semi", "charitable"):
        assert same(algorithm1(mesh, reading), 1 / 400, 0)


# 2 -----------------------------------------------------------------------------------------------


def test_no_order_is_right_for_faces_that_interpenetrate():
    one = facing((-2, -2, 4), (-2, 2, 4), (2.5, 0, 6))
    other = facing(*one * (-1, 1, 1))
    both, backwards = scene(one, other), scene(other, one)
    assert same(exact(both), 25 / 121, 25 / 121)
    assert same(exact(backwards), 25 / 121, 25 / 121)
    for mesh in (both, backwards):  # equal centroids: whichever comes first is in front
        assert same(algorithm1(mesh, "charitable"), 0, 50 / 121)
        assert same(algorithm1(mesh, "semi"), 0, 50 / 121)
        assert same(algorithm1(mesh, "literal"), 0, 1)


# 3 -----------------------------------------------------------------------------------------------


def test_no_order_is_right_for_faces_that_overlap_in_a_cycle():
    bar = [(-3, -1, 5), (3, -0.7, 7), (-3, -0.4, 5)]
    mesh = scene(*(turned(bar, degrees) for degrees in (0, 120, 240)))
    hidden = 0.03521082551178695
    assert same(exact(mesh), hidden, hidden, hidden)
    for reading in ("semi", "charitable"):
        assert same(algorithm1(mesh, reading), 0, hidden, 2 * hidden)
    assert same(algorithm1(mesh, "literal"), 0, 1, 1)


# 4 -----------------------------------------------------------------------------------------------

CHAIN = {  # A hides part of B, B hides part of C, A and C do not overlap
    "A": facing((-1, -1, 4), (0, -1, 4), (-1, 1, 4)),
    "B": facing((-1.2, -1, 5), (1.2, -1, 5), (0, 1, 5)),
    "C": facing((0.35, -1.1, 6), (1.4, -1.1, 6), (0.9, 0.5, 6)),
}
CHAIN_HIDDEN = {"A": 0, "B": 1849 / 8448, "C": 10609 / 15855}


def chain(order):
    return scene(*(CHAIN[name] for name in order))


@pytest.mark.parametrize("order", ["".join(order) for order in permutations("ABC")])
def test_line_11_wipes_the_result_of_a_face_that_was_done_before(order):
    mesh = chain(order)
    right = [CHAIN_HIDDEN[name] for name in order]
    assert same(exact(mesh), *right)
    assert same(algorithm1(mesh, "charitable"), *right)
    # The list of C starts with B and gives it 0: for good, unless A or B has a later turn.
    is_wiped = order.endswith("C")
    wiped = [0 if is_wiped and name == "B" else CHAIN_HIDDEN[name] for name in order]
    assert same(algorithm1(mesh, "semi"), *wiped)


# 5 -----------------------------------------------------------------------------------------------

OBLIQUE = facing((1.9, -0.3, 4), (1.96, 0.3, 4.3), (2.1, -0.3, 5))


def test_definition_3_hides_a_face_that_the_camera_sees():
    mesh = scene(OBLIQUE)
    columns = shapely.bounds(image_triangles(mesh, CAMERA, ORIGIN))[0, ::2]
    assert same(columns, 142, 147.5)
    assert np.degrees(np.arccos(mesh.normals[0, 2])) == pytest.approx(78.690, abs=1e-3)
    assert mesh.normals[0] @ mesh.vertices[0] == pytest.approx(-1.0786, abs=1e-4)  # towards the eye
    assert same(exact(mesh), 0)
    for reading in READINGS:
        assert same(algorithm1(mesh, reading, "definition3"), 1)
        assert same(algorithm1(mesh, reading, "perspective"), 0)


def test_definition_3_shows_a_face_that_is_seen_from_behind():
    mesh = scene(OBLIQUE[::-1])
    assert rational.visible_area(mesh, CAMERA, ORIGIN, cull=True)[0] == 0
    for reading in READINGS:
        assert same(algorithm1(mesh, reading, "definition3"), 0)
        assert same(algorithm1(mesh, reading, "perspective"), 1)


# 6 -----------------------------------------------------------------------------------------------


def test_back_face_loses_its_result_by_numbering():
    back = facing((-1, -1, 4), (1, -1, 4), (0, 1, 4))[::-1]
    front = facing((-1, -1, 5), (1, -1, 5), (0, 1, 5))
    there_and_back = scene(back, front), scene(front, back)
    assert same(exact(there_and_back[0]), 0, 1)
    assert same(exact(there_and_back[1]), 1, 0)
    # By (3.13c) the back face has 1, whatever else is there; line 11 of the other's turn says 0.
    assert same(algorithm1(there_and_back[0], "semi", "definition3"), 0, 1)
    assert same(algorithm1(there_and_back[1], "semi", "definition3"), 1, 1)
    for mesh in there_and_back:
        assert same(algorithm1(mesh, "charitable", "definition3"), 1, 1)


# 7 -----------------------------------------------------------------------------------------------


def test_projection_without_clipping_mirrors_what_is_behind_the_camera():
    face = facing((-0.5, 0.2, 3), (0.5, 0.2, 3), (0, 0.2, -1))
    camera = Camera(width=400, height=400, fx=100, fy=100, near=0.1)
    mesh = scene(face)
    area = 29805 + 5 / 9
    assert rational.visible_area(mesh, camera, ORIGIN)[0] == pytest.approx(area)
    assert shapely.area(image_triangles(mesh, camera, ORIGIN))[0] == pytest.approx(area)
    naive = shapely.area(image_triangles(mesh, camera, ORIGIN, clip=False))[0]
    assert naive == pytest.approx(444 + 4 / 9)

    # Where the mirrored image lies, there is nothing: it hides a face that is wholly visible.
    behind = facing((-0.05, -0.6, 5), (0.05, -0.6, 5), (0, -0.5, 5))
    mesh = scene(face, behind)
    assert same(exact(mesh, camera), 0, 0)
    for reading in READINGS:
        hidden = occlusion(mesh, camera, ORIGIN, reading, self_occlusion=None, clip=False)
        assert same(hidden, 0, 1)


# 8 -----------------------------------------------------------------------------------------------


def test_printed_indices_give_each_face_the_number_of_another():
    mesh = chain("ABC")
    assert same(exact(mesh), 0, 1849 / 8448, 10609 / 15855)
    assert same(algorithm1(mesh, "literal"), 0, 0, 1)


def frontal(images):
    """Triangles parallel to the image; corners in 12.5 px from its centre, by depth."""
    return scene(*(facing(*((x * z / 8, y * z / 8, z) for x, y in images[z])) for z in images))


def test_printed_indices_as_worked_by_hand():
    one, two = [(-6, -6), (6, 4), (-4, -6)], [(0, 2), (0, 0), (-4, 4)]
    three, four = [(2, 6), (-6, -4), (-6, 0)], [(-6, 4), (-4, -4), (4, -6)]
    mesh = frontal({4: one, 6: two, 7: three, 5: four})
    assert same(exact(mesh), 0, 0, 643 / 1596, 837 / 7150)
    # j  sorted  O_1  O_2  O_3  O_4       what line 14, 18 or 20 makes of the printed j
    # 1  1 4      0              0        T_1 less nothing; VA_4 = T_1
    # 2  2 3           0    1             T_2 less T_2; VA_3 is empty
    # 3  4 2 3         1    1    0        VA_3 is empty, for i = 2 and i = 3
    # 4  1 4 3    0              1        T_4 is one of the first three
    assert same(algorithm1(mesh, "literal"), 0, 1, 1, 1)


# Further -----------------------------------------------------------------------------------------


def test_face_without_area_divides_by_nothing():
    edge_on = np.array([(-1, 0, 4), (1, 0, 4), (0, 0, 5)])
    point = np.array([(1, 1, 4)] * 3)
    mesh = scene(edge_on, point, CHAIN["B"])
    for reading in READINGS:
        assert same(algorithm1(mesh, reading), np.nan, np.nan, 0)


# What is right about it --------------------------------------------------------------------------


@st.composite
def frontal_sheets(draw):
    """Triangles parallel to the image, each at a depth of its own: centroids tell their order."""
    corner = st.tuples(st.integers(-8, 8), st.integers(-8, 8))
    corners = st.lists(corner, min_size=3, max_size=3).filter(lambda p: area_of(p) > 0)
    images = draw(st.lists(corners, min_size=1, max_size=6))
    depths = draw(st.permutations(range(4, 4 + len(images))))
    return scene(
        *(
            facing(*((x * z / 8, y * z / 8, z) for x, y in image))
            for image, z in zip(images, depths, strict=True)
        )
    )


def area_of(points):
    (ax, ay), (bx, by), (cx, cy) = points
    return abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / 2


@pytest.mark.slow
@examples(10, at_night=30)
@given(mesh=frontal_sheets(), self_occlusion=st.sampled_from(["definition3", "perspective", None]))
def test_centroid_sort_is_right_for_sheets_parallel_to_the_image(mesh, self_occlusion):
    hidden = occlusion(mesh, CAMERA, ORIGIN, self_occlusion=self_occlusion)
    assert same(hidden, *exact(mesh))


def test_only_what_lies_in_the_image_counts():
    inside, outside = (-0.5, -0.5, 1), (-3, -3, 1)
    mesh = scene(facing(inside, (0.5, -0.5, 1), outside), facing(outside, (-4, -3, 1), (-3, -4, 1)))
    picture = image_triangles(mesh, CAMERA, ORIGIN)
    assert shapely.area(picture) == pytest.approx(rational.visible_area(mesh, CAMERA, ORIGIN))
    assert picture[1].is_empty
    assert np.isnan(algorithm1(mesh, "charitable")[1])


def test_unknown_names_are_refused():
    mesh = scene(CHAIN["A"])
    with pytest.raises(
        ValueError, match="expected reading literal, semi or charitable, got 'good'"
    ):
        occlusion(mesh, CAMERA, ORIGIN, "good")
    with pytest.raises(ValueError, match="expected definition3, perspective or None"):
        self_occluding(mesh, ORIGIN, "always")
