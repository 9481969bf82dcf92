"""Driving the exact paths one pose at a time."""

from fractions import Fraction

import numpy as np
import pytest
from exact_cases import triangles
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import surface_of

from rastercov.core.camera.camera import Camera
from rastercov.core.camera.pose import engine_camera, near_limit
from rastercov.core.camera.viewpoints import look_at
from rastercov.engine import solver_parts
from rastercov.engine.solver_parts import BLOCK, LIVE, MIXED
from rastercov.reference import rational


class HalfPlanes:
    """Solver of a surface through a camera, one pose at a time: every face is measured.

    Its figures, and what else the engine tells of the last pose, are attributes.
    """

    is_certifying = False

    def __init__(self, surface, camera, keeps_pieces=False):
        self.surface, self.camera = surface, engine_camera(camera)
        keeps_pieces = keeps_pieces or not camera.is_pinhole
        self._own = solver_parts.Solver(surface.native, self.is_certifying, keeps_pieces)

    def solve(self, pose, near, front_only):
        """Measure all faces of a pose."""
        matrix = np.ascontiguousarray(pose, np.float64)
        self._own.solve(self.camera, matrix, float(near), bool(front_only))

    def __getattr__(self, name):
        own = object.__getattribute__(self, "_own")
        return own.counts[name] if name.startswith("n_") else getattr(own, name)


class Certificate(HalfPlanes):
    """The same by a certificate."""

    is_certifying = True


PATHS = (HalfPlanes, Certificate)
"""Every face measured, and regions of faces decided together."""
SEEDS = st.integers(0, 2**32 - 1)
on_both_paths = pytest.mark.parametrize("path", PATHS, ids=lambda path: path.__name__)
ALL_OR_NOTHING = 1e-9
"""A fraction may be this far from 0 or 1 where it is certified to be that: rounding."""


def for_seeds_on_both_paths(test):
    """Run a test of a path and a seed on both paths, for ten seeds each."""
    return on_both_paths(given(seed=SEEDS)(settings(max_examples=10)(test)))


def soup(rng, n=60, size=0.6):
    """Triangles across one another before the camera; some reach out of the image."""
    faces = rng.normal(size=(n, 1, 3)) + rng.normal(size=(n, 3, 3)) * size
    return triangles(*(faces + np.array((0, 0, 5))))


def look(mesh, camera, pose, path=Certificate, *, front_only=False):
    """Solver of a mesh after a pose."""
    view = path(surface_of(mesh), camera)
    see_again(view, mesh, camera, pose, front_only=front_only)
    return view


def see_again(view, mesh, camera, pose, *, front_only=False):
    """Measure all with a view that may have looked elsewhere before."""
    near = float(near_limit(camera, mesh.bounds, pose[None])[0])
    view.solve(pose, near, front_only)


def assert_agree(mesh, camera, pose, *, front_only=False):
    """Both paths have the same areas, to their bounds; returns the view with a certificate."""
    view = look(mesh, camera, pose, front_only=front_only)
    other = look(mesh, camera, pose, HalfPlanes, front_only=front_only)
    bound = np.where(view.is_certified, 0.0, view.area_error) + other.area_error
    assert (np.abs(view.visible - other.visible) <= bound + 1e-12).all()
    assert ((view.visible == 0) | (view.visible == view.area))[view.is_certified].all()
    return view


def fractions(mesh, camera, pose, faces=None):
    """Visible fractions in exact arithmetic, 0 of faces without an image; and image areas, px^2."""
    area = rational.image_area(mesh, camera, pose, faces)
    visible = rational.visible_area(mesh, camera, pose, faces)
    return np.divide(visible, area, out=np.zeros(len(area)), where=area > 0), area


def exact_sides(mesh, pose):
    """Side of each face that the camera sees, in exact arithmetic: 1 front, 0 edge-on, -1 back."""
    eye, items = [Fraction(x) for x in pose[:3, 3].tolist()], []
    for corners in mesh.vertices[mesh.faces].tolist():
        a, b, c = ([Fraction(x) - e for x, e in zip(p, eye, strict=True)] for p in corners)
        volume = sum(a[k] * (b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2]) for k in range(3))
        items.append((volume < 0) - (volume > 0))
    return np.array(items)


def assert_within_bounds(mesh, camera, pose, faces=None, paths=PATHS):
    """Computed areas are as good as `area_error` says, certified ones all or nothing; the views."""
    faces = np.arange(mesh.n_faces) if faces is None else faces
    visible = rational.visible_area(mesh, camera, pose, faces)
    area = rational.image_area(mesh, camera, pose, faces)
    views = [look(mesh, camera, pose, path) for path in paths]
    for view in views:
        off = np.abs(view.visible[faces] - visible) + np.abs(view.area[faces] - area)
        sure = view.is_certified[faces]
        whole = np.where(view.visible[faces] > 0, area, 0.0)
        assert np.abs(visible - whole)[sure].max(initial=0) <= 1e-12
        assert (off <= view.area_error[faces] + 1e-12)[~sure].all()
        is_drawn = view.area[faces] > 0  # the others are left out, or outside
        own = np.abs(view.area[faces] - area)
        assert (own <= view.area_error[faces])[sure & is_drawn].all()
    return views


def hard_poses(mesh, n, rng):
    """Poses (n, 4, 4) and fields of view (n,) in radians: the kinds take turns.

    Around the mesh; within its bounding box; close to a face; as close as the near plane; along
    a face; far away at 100 and at 10,000 diagonals, where the field of view shrinks accordingly.
    """
    low, high = mesh.bounds
    centre, diagonal = (low + high) / 2, float(np.linalg.norm(high - low))
    poses, fields = [], []
    for number in range(n):
        kind = number % 7
        face = rng.integers(mesh.n_faces)
        there = rng.dirichlet((1, 1, 1)) @ mesh.vertices[mesh.faces[face]]
        out = mesh.normals[face] * rng.choice((1, -1))
        away = rng.normal(size=3)
        away /= np.linalg.norm(away)
        field = rng.uniform(0.2, 2.0)
        if kind == 0:
            eye, target = centre + away * diagonal * rng.uniform(0.6, 3), centre
        elif kind == 1:
            eye, target = rng.uniform(low, high), rng.uniform(low, high)
        elif kind == 2:
            eye = there + diagonal * (out * 10 ** rng.uniform(-3, -1) + away * 1e-3)
            target = eye + away if rng.random() < 0.5 else there
        elif kind == 3:
            eye = there + diagonal * (out + away / 2) * 10 ** rng.uniform(-7, -4)
            target = eye + away
        elif kind == 4:
            along = np.cross(out + 1e-9, away)
            along /= np.linalg.norm(along)
            eye = there + diagonal * (along * rng.uniform(0.1, 2) + out * 10 ** rng.uniform(-9, -2))
            target = there
        else:
            distance = diagonal * (100 if kind == 5 else 10_000)
            eye, target = centre + away * distance, there
            field = 2 * np.arctan(diagonal / distance * rng.uniform(0.05, 0.7))
        poses.append(look_at(eye, target, rng.normal(size=3))[0])
        fields.append(field)
    return np.array(poses), np.array(fields)


def seen_with(field, rng):
    """Camera of a field of view, image size and aspect drawn at random."""
    width, height = (int(side) for side in rng.integers(40, 1500, 2))
    fx = width / 2 / np.tan(field / 2)
    return Camera(width=width, height=height, fx=fx, fy=fx * rng.uniform(0.9, 1.1))


def wrong_certificates(mesh, n_poses, rng):
    """Certified figures that the analytic path contradicts, all certified ones, all figures."""
    wrong, certified, figures = [], 0, 0
    for number, (pose, field) in enumerate(zip(*hard_poses(mesh, n_poses, rng), strict=True)):
        camera = seen_with(field, rng)
        front_only = bool(mesh.can_cull_back_faces and number % 14 == 0)
        truth = look(mesh, camera, pose, HalfPlanes, front_only=front_only)
        view = look(mesh, camera, pose, front_only=front_only)
        sure = view.is_certified
        assert np.array_equal(view.area, truth.area)
        assert ((view.visible == 0) | (view.visible == view.area))[sure].all()
        # Areas of far less than a pixel are known to rounding, not to a billionth of themselves.
        tolerance = np.maximum(ALL_OR_NOTHING * truth.area, 1e-12)
        doubted = np.flatnonzero(sure & (np.abs(view.visible - truth.visible) > tolerance))
        if len(doubted):  # one of the two is wrong
            exact = rational.visible_area(mesh, camera, pose, doubted, cull=front_only)
            whole = rational.image_area(mesh, camera, pose, doubted, cull=front_only)
            off = np.abs(np.where(view.visible[doubted] > 0, whole, 0) - exact)
            for face, by in zip(doubted.tolist(), off.tolist(), strict=True):
                if by > tolerance[face]:
                    wrong.append((number, face, by, float(view.area[face])))
        certified += int(sure.sum())
        figures += mesh.n_faces
    return wrong, certified, figures


def regions_of(view):
    """(F,) number of the region that decides over each face, -1 for none."""
    blocks = view.surface.blocks
    is_whole = (view.block_state == LIVE) & (view.block_side != MIXED)
    is_whole = is_whole.repeat(BLOCK)[: len(blocks.patch)]
    by_patch, by_face = np.split(view.regions, [len(blocks.lowest)])
    values = np.where(is_whole, by_patch[blocks.patch], by_face)
    return np.where(view.is_certified[: len(values)], values, -1)
