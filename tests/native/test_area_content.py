"""No content of an array crashes the loops by area: real calls, of which one array is spoilt."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from scenes import joined, square

import rastercov as rc
from rastercov.core.area import cells, point_pass, polygons, regions, stages
from rastercov.engine import area_cell, area_point

pytestmark = pytest.mark.native

CALLS = {
    area_cell: (cells, ("fill_cells", "find_shares")),
    area_point: (point_pass, ("judge_points",)),
}
NAMES = "find_covering", *(name for _, names in CALLS.values() for name in names)
VALUES = {
    "f": (0.0, -0.0, 1.0, -2.5, 1e-300, 1e300, np.inf, -np.inf, np.nan),
    "i": (0, 1, 3, -1, 7, 40, 2**31 - 1, -(2**31), 2**62, -(2**63)),
    "u": (0, 1, 3, 255),
    "b": (0, 1),
}
PINHOLE = rc.Camera(width=200, height=150, fx=150, fy=150)
WIDE = rc.Camera(
    width=320, height=240, fx=170, fy=170, model="opencv", distortion=(-0.28, 0.09, 0, 0),
    focus_range=(0.2, 5.0),
)  # fmt: skip
ROUND = rc.Camera(width=256, height=128, fx=256 / (2 * np.pi), fy=256 / (2 * np.pi),
                  model="equirectangular", focus_range=(0.2, 2.5))  # fmt: skip
TASKS = (
    rc.Task(max_incidence_deg=40, min_pixel_density=60),
    rc.Task(min_pixels_per_m2=2000, max_incidence_deg=60),
    rc.Task(min_facing_density=40),
)


def copied(argument):
    """Arguments of a call, with memory of their own."""
    if isinstance(argument, tuple):
        return tuple(map(copied, argument))
    return argument.copy() if isinstance(argument, np.ndarray) else argument


class Spy:
    """A module that keeps the arguments of its calls."""

    def __init__(self, module, names, kept):
        self.module, self.names, self.kept = module, names, kept

    def __getattr__(self, name):
        function = getattr(self.module, name)
        if name not in self.names:
            return function

        def spied(*arguments):
            self.kept.setdefault(name, []).append((function, copied(arguments)))
            return function(*arguments)

        return spied


@pytest.fixture(scope="module")
def calls():
    """Real calls of each function: a wall behind another one, by three kinds of lenses."""
    kept = {}
    mesh = joined(square(0.5, 2), square(0.2, 1.2))
    poses = np.repeat(np.eye(4)[None], 3, axis=0)
    poses[:, 0, 3] = -0.2, 0.0, 0.3
    with pytest.MonkeyPatch.context() as patch:
        for module, (user, names) in CALLS.items():
            patch.setattr(user, module.__name__.rsplit(".")[-1], Spy(module, names, kept))
        patch.setattr(polygons, "area_point", Spy(area_point, ("find_covering",), kept))
        parts = rc.cells(mesh, 0.4)
        for task in TASKS:
            for camera in (PINHOLE, WIDE, ROUND):
                result = rc.regions(mesh, camera, poses, task, threads=1)
                parts.share(result)
                points, face = parts.vertices[parts.faces].mean(axis=1), parts.source_face
                regions.covering_poses(result, face, points)
                list(stages.first_failures(mesh, camera, task, poses[:1], points, face))
    assert set(kept) == set(NAMES)
    return kept


def arrays_of(argument, at=()):
    """Places of the arrays among nested arguments."""
    if isinstance(argument, tuple):
        for k, part in enumerate(argument):
            yield from arrays_of(part, (*at, k))
    elif isinstance(argument, np.ndarray) and argument.size:
        yield at


def spoil(array, rng, share):
    """Put hostile values into a part of an array; half of them are its own, elsewhere."""
    flat = array.reshape(-1)
    rows = rng.random(len(flat)) < share
    few = np.array(VALUES[array.dtype.kind])
    with np.errstate(over="ignore"):
        values = few.astype(array.dtype)[rng.integers(0, len(few), len(flat))]
    flat[rows] = np.where(rng.random(len(flat)) < 0.5, values, rng.permutation(flat))[rows]


@pytest.mark.parametrize("name", NAMES)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from((0.02, 0.2, 1.0)))
@examples(50, at_night=150)
def test_no_content_of_an_array_crashes(calls, name, seed, share):
    rng = np.random.default_rng(seed)
    function, real = calls[name][rng.integers(len(calls[name]))]
    arguments = copied(real)
    places = list(arrays_of(arguments))
    for place in rng.permutation(len(places))[: rng.integers(1, 4)]:
        array = arguments
        for k in places[place]:
            array = array[k]
        spoil(array, rng, share)
    with suppress(ValueError):
        function(*arguments)
