"""The two references: right where the answer is known, of one mind everywhere else."""

import importlib.util
import sys
from fractions import Fraction

import exact_cases
import numpy as np
import pytest
import shapely
from exact_cases import AHEAD, Case, hostile, known_cases, triangles, window
from exact_views import exact_sides
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square

from rastercov import reference
from rastercov.core.camera.camera import Camera
from rastercov.core.mesh import Mesh
from rastercov.reference import polygons, rational, samples

AGREE = 1e-7  # px^2
KNOWN = known_cases()

seeds = st.integers(0, 10**6)
some = examples(6, at_night=60)


def union_area(case, cull=False):
    """Area of the image that any face covers, px^2: what all visible areas must add up to."""
    view = rational.RationalView(case.mesh, case.camera, case.pose, cull, None)
    empty = [view.rectangle]
    for index in range(case.mesh.n_faces):
        if face := view.face(index):
            empty = rational.minus(empty, face.half_planes)
    area = rational.area_of([view.rectangle]) - rational.area_of(empty)
    return Fraction(int(area.numerator), int(area.denominator))


def of_kind(*kinds):
    """Hostile scenes of some kinds only."""
    numbers = [exact_cases.KINDS.index(kind) for kind in kinds]
    count = len(exact_cases.KINDS)
    return st.builds(
        lambda k, i: hostile(count * k + i), st.integers(0, 10**5), st.sampled_from(numbers)
    )


GENERIC = (
    *(exact_cases.soup, exact_cases.interpenetrating, exact_cases.inside, exact_cases.near_plane),
    *(exact_cases.needles, exact_cases.self_intersecting, exact_cases.sub_pixel),
    *(exact_cases.grazing, exact_cases.borders),
)
"""Kinds without faces at one depth, so that the order of faces does not matter."""


def exact(case, mesh=None, **options):
    return rational.visible_area(
        mesh or case.mesh, case.camera, case.pose, exact=True, **options
    ).tolist()


# --- known answers -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("case", KNOWN, ids=repr)
def test_rational_answers_are_exact_and_add_up(case):
    assert exact(case) == list(case.expected)
    assert sum(case.expected) == union_area(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", KNOWN, ids=repr)
def test_polygons_answers_are_right(case):
    area = reference.visible_area(case.mesh, case.camera, case.pose)
    assert area.dtype == np.float64
    np.testing.assert_allclose(area, np.array(case.expected, float), rtol=0, atol=AGREE)


def test_the_lower_index_wins_only_where_depths_are_tied():
    near, far = square(1, 2), square(2, 4)
    nearer = joined(far, near)
    tied = joined(far, Mesh(vertices=near.vertices * 2, faces=near.faces))
    assert exact(Case("nearer", nearer)) == [0, 0, 5000, 5000]
    assert exact(Case("tied", tied)) == [5000, 5000, 0, 0]


@pytest.mark.parametrize("module", [polygons, rational])
def test_near_takes_the_place_of_the_camera_s(module):
    (case,) = (case for case in KNOWN if case.name == "through the near plane")
    camera = window(1000, 1000)
    area = module.visible_area(case.mesh, camera, case.pose, near=0.125)
    assert area[0] == pytest.approx(float(case.expected[0]), rel=1e-12)
    default = module.visible_area(case.mesh, camera, case.pose)
    assert default[0] > area[0] * 1.1


# --- the references agree ------------------------------------------------------------------------


@pytest.mark.slow
@given(seeds, st.booleans())
@examples(4, at_night=100)
def test_polygons_agree_with_exact_arithmetic(seed, cull):
    case = hostile(seed)
    scene = case.mesh, case.camera, case.pose
    for by_polygons, by_fractions in (
        (polygons.visible_area, rational.visible_area),
        (polygons.image_area, rational.image_area),
    ):
        difference = by_polygons(*scene, cull=cull) - by_fractions(*scene, cull=cull)
        assert np.abs(difference).max() <= AGREE


# Scenes on which GEOS without a grid gave a triangle whole, or nothing, for its intersection with
# one that shares a corner, and said nothing; and one with an image so thin that the grid fails.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [214, 303, 1013, 1102, 1603, 6774, 7273, 7402, 16532])
def test_polygons_agree_where_geos_went_wrong(seed):
    case = hostile(seed)
    area = polygons.visible_area(case.mesh, case.camera, case.pose)
    np.testing.assert_allclose(area, np.array(exact(case), float), rtol=0, atol=AGREE)


@pytest.mark.slow
def test_a_large_image_is_as_good_for_its_size():
    for seed in range(8):
        case = hostile(seed)
        camera = case.camera
        names = ("width", "height", "fx", "fy", "cx", "cy")
        large = Camera(**{name: 256 * getattr(camera, name) for name in names}, near=camera.near)
        area = polygons.visible_area(case.mesh, large, case.pose)
        error = np.abs(area - np.array(exact(case), float) * 2**16).max()
        assert error <= 1e-13 * large.width * large.height


def sampling_bound(polygon, spacing):
    """Largest error of an area counted on a square grid: h^2 times the sum of L/(2h) + 1.25."""
    bound = 0.0
    for ring in shapely.get_rings(shapely.get_parts(polygon)):
        steps = np.abs(np.diff(shapely.get_coordinates(ring), axis=0)).max(axis=1)
        bound += (spacing**2 * (steps / (2 * spacing) + 1.25)).sum()
    return bound


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_counted_samples_are_within_the_sampling_bound(seed):
    case = hostile(seed)
    scene = case.mesh, case.camera, case.pose
    visible, _ = samples.count(*scene)
    for face, polygon in enumerate(polygons.visible_polygons(*scene)):
        assert abs(visible[face] - polygon.area) <= sampling_bound(polygon, 1.0) + 1e-6


# --- laws, in exact arithmetic -------------------------------------------------------------------


@pytest.mark.slow
@given(seeds, st.booleans())
@some
def test_visible_areas_are_parts_of_images_and_add_up_to_all_that_is_covered(seed, cull):
    case = hostile(seed)
    seen = exact(case, cull=cull)
    covered = union_area(case, cull)
    # Where rounding parts coplanar faces, "equal" does not carry over from pair to pair.
    assert abs(sum(seen) - covered) <= covered / 10**12
    images = rational.image_area(case.mesh, case.camera, case.pose, exact=True)
    limit = case.camera.width * case.camera.height
    assert all(0 <= area <= image <= limit for area, image in zip(seen, images, strict=True))


def quartered(mesh):
    """Each face cut into four at the middles of its edges, one after the other."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return triangles(
        *np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)
    )


@pytest.mark.slow
@given(seeds)
@some
def test_parts_of_a_face_show_what_the_face_shows(seed):
    case = hostile(seed)
    coarse = Mesh(vertices=np.round(case.mesh.vertices * 1024) / 1024, faces=case.mesh.faces)
    parts = exact(case, quartered(coarse))  # middles are exact
    assert [sum(parts[i : i + 4]) for i in range(0, len(parts), 4)] == exact(case, coarse)


@pytest.mark.slow
@given(of_kind(*GENERIC), seeds)
@some
def test_neither_order_nor_first_corner_nor_winding_matters(case, seed):
    rng = np.random.default_rng(seed)
    order = rng.permutation(case.mesh.n_faces)
    faces = case.mesh.faces[order]
    faces = np.roll(faces, rng.integers(3), axis=1)[:, :: int(rng.choice((-1, 1)))]
    shuffled = exact(case, Mesh(vertices=case.mesh.vertices, faces=faces))
    before = exact(case)
    assert shuffled == [before[i] for i in order]


@pytest.mark.slow
@given(seeds)
@some
def test_a_rolled_camera_sees_the_same(seed):
    case = hostile(seed)
    camera = case.camera
    # A quarter turn: what was right is down, and the image stands on its side.
    size = {"width": camera.height, "height": camera.width, "fx": camera.fy, "fy": camera.fx}
    turned = Camera(**size, cx=camera.height - camera.cy, cy=camera.cx, near=camera.near)
    pose = case.pose @ np.array([(0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1.0)])
    after = rational.visible_area(case.mesh, turned, pose)
    # camera.height - camera.cy is rounded
    np.testing.assert_allclose(after, np.array(exact(case), float), rtol=0, atol=1e-9)


@pytest.mark.slow
@given(seeds, st.integers(-30, 30))
@some
def test_size_does_not_show(seed, power):
    case, scale, near = hostile(seed), 2.0**power, 2.0**-8
    pose = case.pose.copy()
    pose[:3, 3] *= scale
    mesh = Mesh(vertices=case.mesh.vertices * scale, faces=case.mesh.faces)
    larger = rational.visible_area(mesh, case.camera, pose, near=near * scale, exact=True)
    assert larger.tolist() == exact(case, near=near)


@pytest.mark.slow
@given(seeds, seeds)
@some
def test_more_faces_never_show_more_of_the_others(seed, other):
    case = hostile(seed)
    near = 2.0**-8  # the default grows with the mesh
    before = exact(case, near=near)
    more = Mesh(
        vertices=np.random.default_rng(other).normal(size=(12, 3)),
        faces=np.arange(12).reshape(-1, 3),
    )
    after = exact(case, joined(case.mesh, more), near=near)
    assert all(b <= a for a, b in zip(before, after, strict=False))


@pytest.mark.slow
@given(of_kind(*exact_cases.KINDS[:6], exact_cases.near_plane, exact_cases.flipped))
@some
def test_culling_is_leaving_back_faces_out(case):
    front = exact_sides(case.mesh, case.pose) > 0
    culled = np.array(exact(case, cull=True))
    assert not culled[~front].any()
    if front.any():
        fewer = Mesh(vertices=case.mesh.vertices, faces=case.mesh.faces[front])
        limit = polygons.near_limit(case.camera, case.mesh.bounds, case.pose[None])[0]
        assert exact(case, fewer, near=float(limit)) == culled[front].tolist()


# --- arguments -----------------------------------------------------------------------------------


@pytest.mark.parametrize("module", [polygons, rational])
def test_faces_come_in_the_order_asked(module):
    case, asked = hostile(0), [3, 0, 3, 7]
    for area in (module.visible_area, module.image_area):
        everything = area(case.mesh, case.camera, case.pose)
        some_faces = area(case.mesh, case.camera, case.pose, asked)
        np.testing.assert_array_equal(some_faces, everything[asked])
        assert area(case.mesh, case.camera, case.pose, []).shape == (0,)


@pytest.mark.slow
def test_blocks_of_faces_do_not_show(monkeypatch):
    case = hostile(2)
    everything = polygons.visible_area(case.mesh, case.camera, case.pose)
    monkeypatch.setattr(polygons, "BLOCK", 7)
    np.testing.assert_array_equal(
        polygons.visible_area(case.mesh, case.camera, case.pose), everything
    )


@pytest.mark.parametrize("module", [polygons, rational])
def test_faces_that_are_not_there_and_a_near_plane_behind_are_refused(module):
    for face in (-1, 2):
        with pytest.raises(IndexError, match=r"expected faces of 0 to 1"):
            module.visible_area(square(1, 2), window(), AHEAD, [0, face])
    for near in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="expected near above 0 m"):
            module.visible_area(square(1, 2), window(), AHEAD, near=near)


@pytest.mark.slow
def test_without_gmpy2_the_answers_are_the_same(monkeypatch):
    monkeypatch.setitem(sys.modules, "gmpy2", None)
    spec = importlib.util.spec_from_file_location("rational_without_gmpy2", rational.__file__)
    plain = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, plain)  # dataclass looks its module up
    spec.loader.exec_module(plain)
    assert plain.mpq is Fraction
    for seed in range(8):
        case = hostile(seed)
        area = plain.visible_area(case.mesh, case.camera, case.pose, exact=True)
        assert area.tolist() == exact(case)


# --- when GEOS fails -----------------------------------------------------------------------------


BOOLEANS = "union_all", "difference", "intersection"


@pytest.fixture
def screens():
    return joined(square(2, 4), square(0.5, 2)), window(), AHEAD


def failing(function, times):
    """Stand-in for a shapely function that fails the first few times."""
    calls = []

    def stand_in(*args, **options):
        calls.append(args)
        if len(calls) <= times:
            raise shapely.GEOSException("side location conflict")
        return function(*args, **options)

    return stand_in


@pytest.mark.parametrize(
    ("name", "times"), [("union_all", 1), ("difference", 1), ("intersection", 2)]
)
def test_a_failed_boolean_is_repeated_on_repaired_polygons(monkeypatch, screens, name, times):
    monkeypatch.setattr(shapely, name, failing(getattr(shapely, name), times))
    np.testing.assert_allclose(
        reference.visible_area(*screens), [3750] * 2 + [1250] * 2, atol=AGREE
    )


UNION_ALL = shapely.union_all
ALWAYS = {name: failing(getattr(shapely, name), 1000) for name in BOOLEANS}
KEEPS_FAILING = r"face.* 0 .*[23].*side location conflict"


@pytest.mark.parametrize(
    ("stand_ins", "words"),
    [
        *(({name: ALWAYS[name]}, KEEPS_FAILING) for name in BOOLEANS),
        (
            {"union_all": lambda parts, **options: UNION_ALL(parts, **options).buffer(1)},
            r"face 0 .* parts add up to 72",
        ),
        (
            {"union_all": ALWAYS["union_all"], "make_valid": lambda polygon: polygon.buffer(-1)},
            r"5000.0 px.* of face 0",
        ),
    ],
)
def test_areas_that_cannot_be_right_are_an_error_that_names_the_faces(
    monkeypatch, screens, stand_ins, words
):
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(shapely, name, stand_in)
    with pytest.raises(polygons.PolygonError, match=words):
        reference.visible_area(*screens, faces=[0] if "add up" in words else None)


def overlapping():
    """A square behind three triangles that overlap, and its camera."""
    behind = [(-1, -1, 5), (1, -1, 5), (1, 1, 5), (-1, 1, 5)]
    before = [
        [(-0.8, -0.8, 4), (0.4, -0.7, 4), (-0.3, 0.5, 4)],
        [(-0.2, -0.6, 3.5), (0.7, -0.2, 3.5), (0.1, 0.6, 3.5)],
        [(-0.6, 0.0, 3), (0.3, -0.1, 3), (0.2, 0.6, 3)],
    ]
    vertices = np.concatenate([behind, *before])
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (7, 8, 9), (10, 11, 12)]
    camera = Camera(width=640, height=480, fx=600, fy=600, cx=320, cy=240)
    return Mesh(vertices, faces), camera


@pytest.mark.parametrize("has_clipper2", [True, False])
@pytest.mark.parametrize("lost", [0, 1, -1])
def test_a_union_that_loses_a_piece_is_an_error(monkeypatch, has_clipper2, lost):
    mesh, camera = overlapping()
    if not has_clipper2:
        monkeypatch.setattr(polygons, "clipper2", None)
    true = polygons.visible_area(mesh, camera, np.eye(4), [0, 1])
    assert true == pytest.approx(rational.visible_area(mesh, camera, np.eye(4), [0, 1]), abs=1e-7)
    union_all = shapely.union_all

    def losing(parts, **options):
        parts = list(parts)
        del parts[lost]
        return union_all(parts, **options)

    monkeypatch.setattr(shapely, "union_all", losing)
    with pytest.raises(polygons.PolygonError, match=r"face [01] .*more than a second way"):
        polygons.visible_area(mesh, camera, np.eye(4), [0, 1])


def test_an_intersection_that_is_wrong_is_an_error(monkeypatch):
    mesh, camera = overlapping()
    monkeypatch.setattr(shapely, "intersection", lambda one, other, **options: one)
    with pytest.raises(polygons.PolygonError, match="too much"):
        polygons.visible_area(mesh, camera, np.eye(4), [0, 1])
