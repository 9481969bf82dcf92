"""Valid regions: nothing outside is answered, and the proof reaches the fold and not beyond."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lens_cases import HEIGHT, WIDTH, make_lens, of_all_kinds, rays
from nightly import examples

from rastercov.base.errors import CameraError
from rastercov.core.camera.camera import border_of
from rastercov.core.camera.lenses import BASES, LensModel
from rastercov.engine.lens_proof import base_limit, certified_radius, is_positive
from rastercov.reference.lenses import image_of_base, project

LENSES = of_all_kinds()
SIDE = {"width": WIDTH, "height": HEIGHT}


def square(base, f, *radial, **others):
    return make_lens(base, **SIDE, fx=f, fy=f, radial=radial, **others)


# Lens, the radius in the plane of the base at which it folds, and whether corners have a ray.
FOLDING = {
    "k1 k2 k3": (square("pinhole", 900, -0.28, 0.09, -0.01), 2.1102, True),
    "monotone": (square("pinhole", 640, -0.45, 0.25), math.inf, True),
    "simple radial": (square("pinhole", 900, -0.2), math.sqrt(1 / 0.6), False),
    "wide": (square("pinhole", 600, -0.35), math.sqrt(1 / 1.05), False),
    "fisheye": (square("equidistant", 600, -0.05, 0.01, -0.03, 0.005), 1.3933, False),
}


@pytest.fixture(params=FOLDING)
def folding(request):
    return FOLDING[request.param]


def slope_of(lens, r):
    """Derivative of the radial part at radius r, by numpy."""
    p = lens.params
    numerator = np.polynomial.Polynomial([0, 1, 0, p[5], 0, p[6], 0, p[7], 0, p[8]])
    return numerator.deriv()(r)


def test_proof_reaches_the_fold(folding):
    lens, fold, _ = folding
    result = certified_radius(lens.params, 50.0)
    if math.isfinite(fold):
        assert 0.999 * fold <= result
        assert slope_of(lens, result) > 0
        assert slope_of(lens, 1.001 * result) < 0
    else:
        assert result == 50.0


def test_region_ends_at_the_fold_or_at_the_image(folding):
    lens, fold, is_whole = folding
    plane = lens.valid_angle if BASES[lens.code] == "equidistant" else math.tan(lens.valid_angle)
    assert plane <= fold
    assert lens.is_whole == is_whole
    if not is_whole:
        assert plane >= 0.99 * fold
    else:
        border = lens.unproject(border_of(WIDTH, HEIGHT, 257).reshape(-1, 2))
        assert plane <= 1.021 * np.hypot(*(border[:, :2] / border[:, 2:]).T).max()


@pytest.mark.slow
def test_no_ray_outside_the_region_is_answered(folding):
    lens, fold, _ = folding
    given = rays(200_000)
    angle = np.arctan2(np.hypot(given[:, 0], given[:, 1]), given[:, 2])
    answered = np.isfinite(lens.project(given)).all(axis=1)
    assert not answered[angle > lens.valid_angle].any()
    assert answered[angle < 0.999 * lens.valid_angle].all()
    limit = fold if BASES[lens.code] == "equidistant" else math.atan(fold)
    assert not answered[angle > limit].any()
    # The equations alone would put some of those into the image.
    if math.isfinite(fold):
        with np.errstate(all="ignore"):
            u, v = project(lens.code, lens.params, *given[given[:, 2] > 0.02].T)
        folded = angle[given[:, 2] > 0.02] > limit
        inside = (u >= 0) & (v >= 0) & (u <= WIDTH) & (v <= HEIGHT)
        assert (folded & inside).mean() > 0.02


def test_region_is_no_larger_than_it_is_allowed():
    lens = square("pinhole", 900, -0.2, max_angle_deg=30)
    assert lens.valid_angle == pytest.approx(math.radians(30))
    assert np.isnan(lens.project([math.tan(math.radians(30.1)), 0, 1])).all()
    assert np.isfinite(lens.project([math.tan(math.radians(29.9)), 0, 1])).all()
    assert not lens.is_whole


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_map_is_injective_on_the_region(name):
    check_injective(LENSES[name])


@settings(max_examples=25)
@example("double_sphere", 1.0, -0.5, 1.0)  # the paper's region reaches beyond its fold
@example("double_sphere", 0.0, -0.5, 1.0)
@example("unified", 1.0, 0.0, 1.0)
@given(
    st.sampled_from(["unified", "double_sphere", "division"]),
    st.floats(0.0, 1.0),
    st.floats(-0.99, 1.0),
    st.floats(0.3, 3.0),
)
def test_base_rises_up_to_its_limit(base, alpha, xi, beta):
    parameters = {
        "unified": (alpha, 1 - alpha, beta),
        "double_sphere": (xi, alpha),
        "division": (xi,),
    }[base]
    lens = square(base, 400.0, of_base=parameters)
    limit = base_limit(lens.code, lens.params)
    angle = np.linspace(0, limit, 20_001)
    with np.errstate(all="ignore"):
        radius, _ = image_of_base(lens.code, lens.params, np.sin(angle), 0 * angle, np.cos(angle))
    radius = radius[:-2]  # the last may be rounded
    assert (np.diff(radius) > 0).all()


COEFFICIENT = st.one_of(
    st.floats(-0.5, 0.5), st.floats(-1e3, 1e3), st.sampled_from([1e12, -1e12, 1e-300, 0.0])
)


@pytest.mark.slow
@examples(8, at_night=25)
@example("pinhole", [-0.2], [], [0.02, -0.01], [0.01, -0.02, 0.015, 0.005], (0, 0), False, 500.0)
@example("pinhole", [-0.2], [], [0.02, -0.01], [], (0, 0), True, 500.0)
@given(
    st.sampled_from(["pinhole", "equidistant", "equisolid"]),
    st.lists(COEFFICIENT, max_size=6),
    st.lists(COEFFICIENT, max_size=3),
    st.lists(COEFFICIENT, max_size=2),
    st.lists(COEFFICIENT, max_size=4),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    st.booleans(),
    st.floats(50, 5000),
)
def test_any_coefficients_give_an_injective_lens_or_one_line(
    base, radial, denominator, tangential, prism, tilt, is_late, focal
):
    terms = {"radial": radial, "denominator": denominator, "tangential": tangential}
    terms |= {"prism": prism, "tilt": tilt, "is_late": is_late}
    try:
        lens = make_lens(base, 640, 480, fx=focal, fy=0.9 * focal, **terms)
    except CameraError as error:
        assert "\n" not in str(error)  # noqa: PT017 - some coefficients are a lens
    else:
        check_injective(lens)


def check_injective(lens: LensModel) -> None:
    """Each pixel has a ray that is projected to it, and each valid ray is that of its pixel."""
    turn = np.random.default_rng(1).uniform(0, 2 * np.pi, 300)
    angle = lens.valid_angle * np.sqrt(np.random.default_rng(2).uniform(0, 1, 300))
    sine = np.sin(angle)
    values = np.column_stack((sine * np.cos(turn), sine * np.sin(turn), np.cos(angle)))
    seen = lens.project(values)
    is_valid = np.isfinite(seen).all(axis=1)
    back = lens.unproject(seen[is_valid])
    slopes = lens.jacobian(values[is_valid])
    det = np.linalg.det(np.concatenate((slopes, values[is_valid][:, None]), axis=1))
    norm = np.sqrt((slopes**2).sum(axis=(1, 2)))
    assert (det > -1e-9 * norm**2).all()
    # Rays next to the border of the region may be rounded across it.
    is_found = np.isfinite(back).all(axis=1)
    inner = angle[is_valid] < lens.valid_angle * (1 - 1e-6)
    assert is_found[inner].all()
    error = np.abs(lens.project(back[is_found]) - seen[is_valid][is_found])
    size = np.abs(seen[is_valid][is_found]) + norm[is_found, None] + 1000
    assert (np.nan_to_num(error) <= 1e-8 * size).all()


@pytest.mark.parametrize(
    ("terms", "limit"),
    [
        ({"fx": 900, "fy": 900, "radial": (0.1,), "denominator": (-3.0,)}, 1 / math.sqrt(3)),
        ({"fx": 400, "fy": 400, "tilt": (0.9, 0.0)}, 1 / math.tan(0.9)),
        ({"fx": 300, "fy": 300, "tangential": (0.3, 0.2)}, 1 / (6 * math.hypot(0.3, 0.2)) + 1e-9),
    ],
    ids=["a pole", "the horizon of a tilt", "tangential terms"],
)
def test_what_is_no_lens_ends_the_region(terms, limit):
    lens = make_lens("pinhole", **SIDE, **terms)
    assert math.tan(lens.valid_angle) < limit
    check_injective(lens)


def test_wide_region_is_all_but_a_cone_behind():
    lens = square("equidistant", 300, 0.01)
    assert math.degrees(lens.valid_angle) > 140
    behind = math.pi - lens.valid_angle
    assert np.isnan(lens.project([math.sin(0.99 * behind), 0, -math.cos(0.99 * behind)])).all()
    assert np.isfinite(lens.project([math.sin(1.001 * behind), 0, -math.cos(1.001 * behind)])).all()
    assert np.isfinite(lens.project([1, 0, 0.0])).all()


@settings(max_examples=25)
@given(st.lists(st.floats(-10, 10), min_size=1, max_size=12), st.floats(0, 3), st.floats(1e-6, 2))
def test_what_is_proved_to_be_positive_is(coefficients, low, width):
    values = np.polynomial.Polynomial(coefficients)(np.linspace(low, low + width, 1000))
    is_proved = is_positive(np.array(coefficients), low, low + width)
    assert not is_proved or (values > 0).all()
    assert is_proved or width > 1e-3 or values.min() < 1e3


def test_a_polynomial_is_proved_to_be_positive_next_to_its_root():
    terms = np.array([6.0, -5.0, 1.0])  # 2 and 3
    assert is_positive(terms, 1.9999, 1.99999)
    assert not is_positive(terms, 1.9999, 2.00001)
    assert is_positive(terms, 3.00001, 3.0001)
