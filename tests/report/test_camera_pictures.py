"""Pictures of what single cameras see and cover."""

import numpy as np
import pytest
from lens_cameras import CAMERAS
from scenes import joined
from surface_cases import room
from target_scenes import beside, sheet_at

import rastercov as rc
from rastercov.core.camera.projection import to_camera, to_image
from rastercov.core.coverage.task import NAMES, REASONS, Reason
from rastercov.core.mesh import Group, Mesh, shapes
from rastercov.reference.regions import covers_points
from rastercov.report import theme
from rastercov.report.overview import (
    by_faces,
    by_points,
    camera_keys,
    camera_pixels,
    camera_scene,
)
from rastercov.report.panorama import FEW_REL, points_of_pixels

MESH, CAMERA, POSES = room()


def camera_image(mesh, camera, pose, task, side=720):
    """Image of a camera by whole faces, at most that wide and high."""
    small = camera.resized(min(1.0, side / max(camera.width, camera.height)))
    reasons = rc.evaluate(mesh, camera, pose[None], task, fields=("reason",), by="face").reason[0]
    return by_faces(camera_scene(mesh, small, pose), reasons)


def scene():
    """A wall with a plate before its middle, which only hides, and a target before both."""
    wall, plate = shapes.box((4, 0.1, 4), 1), shapes.box((1, 0.1, 1), 1, (0, -1, 0))
    whole = joined(wall, plate)
    groups = (Group("wall"), Group("plate", is_occluder=True))
    mesh = Mesh(whole.vertices, whole.faces, groups, np.repeat([0, 1], [12, 12]))
    return beside(mesh, sheet_at((-0.4, -2.5), (0.4, -2.0), 0.0), is_two_sided=True)


@pytest.mark.slow
def test_an_occluder_is_marked_where_it_hides_the_task_and_a_target_where_it_is():
    mesh = scene()
    camera = rc.Camera(width=320, height=240, fx=200, fy=200)
    pose = rc.look_at((0, -5, 0.5), (0, 0, 0))[0]
    image = camera_image(mesh, camera, pose, rc.Task())
    is_plate = np.append(~mesh.task_mask, False)[image.scene.face]
    targets = image.scene.targets
    assert (image.hidden == is_plate & (targets < 0)).mean() > 0.995
    assert (image.targets[targets >= 0] == Reason.COVERED).all()
    names = {key.name for key in camera_keys(image)}
    assert {"covered", "occluder", "occluder that hides the evaluated surface"} <= names
    pixels = camera_pixels(image)
    bare = camera_pixels(camera_image(mesh.opaque, camera, pose, rc.Task()))
    beyond = targets < 0
    assert (pixels[beyond] == bare[beyond]).all()
    is_same = (pixels[~beyond] == bare[~beyond]).all(axis=1)
    assert is_same.mean() > 0.15  # a thin one: outlines


def test_the_back_of_a_face_is_never_covered():
    mesh = Mesh([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], [(0, 2, 1), (0, 3, 2)])
    camera = rc.Camera(width=160, height=120, fx=100, fy=100)
    image = camera_image(mesh, camera, rc.look_at((0, -3, 0), (0, 0, 0))[0], rc.Task())
    colours = camera_pixels(image)[image.scene.face >= 0]
    assert not (colours == REASONS["covered"].colour).all(axis=1).any()
    assert theme.OF_CAMERA.back[0] >= colours.max() - 60


# Through lenses

DENSE = rc.Task(max_incidence_deg=70, min_pixel_density=60)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, CAMERAS["brown"], CAMERAS["equirectangular"]])
def test_a_pixel_of_a_camera_picture_has_the_colour_of_the_face_that_its_ray_meets(camera):
    pose = POSES[4]
    image = camera_image(MESH, camera, pose, DENSE, side=200)
    face, small = image.scene.face, image.scene.camera
    assert max(small.width, small.height) == 200
    reason = rc.evaluate(MESH, camera, pose[None], DENSE, by="face").reason[0]
    rows, columns = np.nonzero(face >= 0)
    assert len(rows) > 0.98 * face.size
    pixels = camera_pixels(image)[rows, columns].astype(int)
    is_covered = reason[face[rows, columns]] == Reason.COVERED
    assert ((np.ptp(pixels, axis=1) <= 12) == is_covered).all()
    assert (image.surface[rows, columns] == reason[face[rows, columns]]).all()
    words = {key.name for key in camera_keys(image)}
    pixels_of = np.bincount(reason[face[rows, columns]], minlength=Reason.COVERED)
    pixels_of[Reason.COVERED] = 0
    states = np.flatnonzero(pixels_of > FEW_REL * face.size)
    assert len(words) == 1 + len(states) + bool((face < 0).any())
    points = points_of_pixels(MESH, small, pose, face[rows, columns], rows, columns)
    places = to_image(to_camera(points, pose), small)
    np.testing.assert_allclose(places, np.column_stack((columns, rows)) + 0.5, atol=1e-6)
    beyond = np.maximum(-points, points - np.array((8, 5, 3))).max(axis=1)
    assert (beyond < 1e-9).mean() > 0.995  # pixels at an edge may show either side
    assert beyond.max() < 0.7


@pytest.mark.slow
@pytest.mark.parametrize("camera", [CAMERA, CAMERAS["brown"]])
def test_by_area_a_pixel_of_a_camera_picture_is_judged_by_its_own_point(camera):
    """Not by its face: the whole floor of a room is never in one image."""
    pose, task = POSES[4], rc.Task(max_incidence_deg=55, min_pixel_density=130)
    small = camera.resized(160 / camera.width)
    seen = camera_scene(MESH, small, pose)
    image = by_points(seen, camera, task, rc.regions(MESH, camera, pose[None], task))
    rows, columns = np.nonzero(seen.face >= 0)
    face = seen.face[rows, columns]
    points = points_of_pixels(MESH, small, pose, face, rows, columns)
    is_covered = image.surface[rows, columns] == Reason.COVERED
    covers = covers_points(MESH, camera, pose[None], task, points, face.astype(np.int64))[0]
    assert (is_covered == covers).mean() > 0.99  # the rest is on the border of a zone
    assert 0.05 < is_covered.mean() < 0.95
    why = set(np.unique(image.surface[rows, columns]).tolist())
    allowed = {"covered", "too_coarse", "too_oblique", "back_facing", "too_oblique+too_coarse"}
    assert {NAMES[row] for row in why} <= allowed
    words = {REASONS[NAMES[row]].label for row in why}
    assert {key.name for key in camera_keys(image)} <= words | {"background"}
