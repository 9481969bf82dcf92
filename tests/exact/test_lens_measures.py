"""Vertices and faces that are measured eight at a time have the bits of those measured alone.

Edges take the rule that the longest of eight needs, so theirs agree within their tolerance.
"""

import numpy as np
import pytest
from lens_cameras import CAMERAS

from rastercov import look_at
from rastercov.camera.lenses.of_camera import planes_of
from rastercov.camera.lenses.quadrature import MOST
from rastercov.exact.certificate import CertificateSolver
from rastercov.exact.lens_solver import LensSolver
from rastercov.exact.surface import surface_of
from rastercov.kernels import exact_lens
from rastercov.kernels.exact_lens_edges import edge_bulges, edge_lists, vertex_images, whole_groups
from rastercov.kernels.exact_lens_measures import AT_A_TIME
from rastercov.kernels.lens_edges import bulge, edge_values
from rastercov.mesh import shapes

MESHES = {"torus": shapes.by_name("torus"), "room": shapes.by_name("room")}
EYES = {"torus": (2.2, 1.4, 1.5), "room": (0.2, 0.1, 1.5)}


def solved(name, camera):
    """Solver of a mesh through a camera."""
    mesh = MESHES[name]
    solver = LensSolver(surface_of(mesh), CAMERAS[camera], CertificateSolver)
    target = mesh.bounds.mean(axis=0) if name == "torus" else (1, 1, 1.2)
    solver.set_pose(look_at([EYES[name]], [target])[0], 1e-3, False)
    solver.solve_all()
    return solver


def figures(n):
    return exact_lens.Figures(*np.zeros((3, n)), *np.zeros((3, n), np.int8))


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", MESHES)
def test_eight_at_a_time_have_the_same_bits_as_one(name, camera):
    solver = solved(name, camera)
    surface, seen = solver.surface, solver._seen
    n, rng = len(surface.faces), np.random.default_rng(1)
    state = rng.choice(np.array([0, 1, exact_lens.THIN], np.uint16), n)
    flat = rng.random(n) < 0.05
    measured = 0
    for plane, record in planes_of(CAMERAS[camera]):
        if not len(record.window):
            continue
        solver._solve(plane.camera, plane.frame)
        solver._measure(record)
        uvw = solver._solver.image_of_all.uvw[: len(surface.vertices)]
        for i in rng.integers(0, len(uvw), 60):
            one, inside = np.empty((1, 4)), np.empty(1, np.bool_)
            vertex_images(uvw[i : i + 1], record, one, inside, edge_lists())
            assert inside[0] == seen.is_inside[i]
            if inside[0]:
                assert (one[0] == seen.places[i]).all()
            assert np.isnan(one[0, 2:]).all() == (not inside[0])
        own, is_done, out = np.empty(n), np.empty(n, np.bool_), figures(n)
        exact_lens.measure_simple(
            surface.faces, solver._sides, flat, state, seen, record, own, is_done, out
        )
        for f in rng.integers(0, n // AT_A_TIME * AT_A_TIME, 200):
            part, alone = slice(f, f + 1), figures(1)
            own_1, done_1 = np.empty(1), np.empty(1, np.bool_)
            exact_lens.measure_simple(
                *(surface.faces[part], solver._sides[part], flat[part], state[part], seen),
                *(record, own_1, done_1, alone),
            )
            assert (own_1[0], done_1[0]) == (own[f], is_done[f])
            assert (alone.area[0], alone.area_error[0]) == (out.area[f], out.area_error[f])
        measured += (own > 0).sum()
    assert measured > 0 or name == "room"


@pytest.mark.slow
@pytest.mark.parametrize("camera", CAMERAS)
def test_edges_of_any_lengths_agree_with_the_best_rule(camera):
    """Random places: neighbours in a list need other rules, have no image or are too long."""
    rng, lists = np.random.default_rng(2), edge_lists()
    rules, n_taken = set(), 0
    for _, record in planes_of(CAMERAS[camera]):
        if not len(record.window) or len(record.hole) or record.is_graded:
            continue
        limits = record.longest[record.longest > 0]
        if not limits[-1] < np.inf:
            continue
        half = np.exp(rng.uniform(np.log(limits[0]) - 2, np.log(limits[-1]) + 0.5, 900))
        middle = record.window.min(axis=0) + rng.random((900, 2)) * np.ptp(record.window, axis=0)
        turn = rng.uniform(0, 2 * np.pi, 900)
        step = half[:, None] * np.column_stack((np.cos(turn), np.sin(turn)))
        both = np.concatenate((middle - step, middle + step))
        uvw = np.ones((len(both), 3))
        uvw[:, :2] = both * (record.fx, record.fy) + (record.cx, record.cy)
        places, inside = np.empty((len(both), 4)), np.empty(len(both), np.bool_)
        vertex_images(uvw, record, places, inside, lists)
        ends = whole_groups(np.arange(len(both), dtype=np.int32).reshape(2, -1).T.copy())
        found, longer = np.empty(len(ends)), np.empty(len(ends), np.int32)
        n_longer = edge_bulges(record, ends, places, lists, found, longer)
        length = np.linalg.norm(places[ends[:, 0], :2] - places[ends[:, 1], :2], axis=1)
        known = inside[ends].all(axis=1)
        assert set(longer[:n_longer]) == set(np.flatnonzero(known & (length / 2 > limits[-1])))
        assert (np.isnan(found) == (~known | (length / 2 > limits[-1]))).all()
        rounding = exact_lens.EDGE_ROUNDING * (record.width + record.height)
        for e in np.flatnonzero(~np.isnan(found)):
            (ax, ay), (bx, by) = places[ends[e, 0], :2], places[ends[e, 1], :2]
            values = np.empty((2, MOST + 1))
            edge_values(record.code, record.params, record.frame, ax, ay, bx, by, MOST, *values)
            size = np.abs(np.diff(values)).sum() + 1
            error = abs(found[e] - bulge.py_func(MOST, *values))
            assert error <= 2 * record.tolerance + rounding * size
            rules.add(int(np.searchsorted(record.longest, length[e] / 2)))
            n_taken += 1
    assert (n_taken > 100 and len(rules) > 3) or camera in ("skew", "equirectangular")
