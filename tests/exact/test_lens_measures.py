"""Vertices and faces that are measured eight at a time have the bits of those measured alone."""

import numpy as np
import pytest
from lens_cameras import CAMERAS

from rastercov import look_at, shapes
from rastercov.exact import lens_kernels
from rastercov.exact.certificate import CertificateSolver
from rastercov.exact.lens_measures import AT_A_TIME
from rastercov.exact.lens_solver import LensSolver
from rastercov.exact.surface import surface_of
from rastercov.lenses.of_camera import planes_of

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
    return lens_kernels.Figures(*np.zeros((3, n)), *np.zeros((3, n), np.int8))


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("name", MESHES)
def test_eight_at_a_time_have_the_same_bits_as_one(name, camera):
    solver = solved(name, camera)
    surface, seen = solver.surface, solver._seen
    n, rng = len(surface.faces), np.random.default_rng(1)
    state = rng.choice(np.array([0, 1, lens_kernels.THIN], np.uint16), n)
    flat = rng.random(n) < 0.05
    measured = 0
    for plane, record in planes_of(CAMERAS[camera]):
        if not len(record.window):
            continue
        solver._solve(plane.camera, plane.frame)
        solver._measure(record)
        uvw = solver._solver.image_of_all.uvw[: len(surface.vertices)]
        call = lens_kernels.vertices_in_plane
        places, is_inside = seen.places.copy(), np.empty(len(uvw), np.bool_)
        call(uvw, solver._solver.camera, record, places, is_inside)
        assert (is_inside == seen.is_inside).all()
        for i in rng.integers(0, len(uvw), 60):
            one, inside = np.empty((1, 4)), np.empty(1, np.bool_)
            call(uvw[i : i + 1], solver._solver.camera, record, one, inside)
            assert inside[0] == is_inside[i]
            if inside[0]:
                assert (one[0, :2] == places[i, :2]).all()
        own, is_done, out = np.empty(n), np.empty(n, np.bool_), figures(n)
        lens_kernels.measure_simple(
            surface.faces, solver._sides, flat, state, seen, record, own, is_done, out
        )
        for f in rng.integers(0, n // AT_A_TIME * AT_A_TIME, 200):
            part, alone = slice(f, f + 1), figures(1)
            own_1, done_1 = np.empty(1), np.empty(1, np.bool_)
            lens_kernels.measure_simple(
                *(surface.faces[part], solver._sides[part], flat[part], state[part], seen),
                *(record, own_1, done_1, alone),
            )
            assert (own_1[0], done_1[0]) == (own[f], is_done[f])
            assert (alone.area[0], alone.area_error[0]) == (out.area[f], out.area_error[f])
        measured += (own > 0).sum()
    assert measured > 0 or name == "room"
