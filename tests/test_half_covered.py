"""The line about parts of faces that a count of whole faces leaves out."""

import re

import pytest
from lens_cameras import CAMERAS
from surface_cases import room

import rastercov as rc
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.doubts import half_covered, share_in_parts
from rastercov.mesh import shapes

MESH, CAMERA, POSES = room()


def network_of(mesh, camera, poses, task, method="certified"):
    network = rc.Network(mesh, task)
    network.add(rc.evaluate(mesh, camera, poses, task, method=method))
    return network


@pytest.mark.parametrize("views", [1, 2])
def test_the_share_is_what_the_exact_area_has_and_whole_faces_have_not(views):
    task = rc.Task(max_incidence_deg=75, min_pixels_per_m2=4000, views=views)
    network = network_of(MESH, CAMERA, POSES, task)
    covered = rc.unite(rc.regions(MESH, CAMERA, POSES, task), views).area[-1]
    left = network.views < views
    expected = covered[left].sum() / MESH.areas.sum()
    assert share_in_parts(network, CAMERA, POSES) == pytest.approx(expected, abs=0.02)
    (line,) = half_covered(network, CAMERA, POSES)
    share = float(re.match(r"about ([\d.]+) % of the area", line)[1])
    assert share == pytest.approx(100 * expected, abs=2.5)
    assert line.endswith("use --by area")


@pytest.mark.slow
def test_the_share_is_that_of_the_exact_area_through_a_lens():
    lens = CAMERAS["brown"]
    task = rc.Task(max_incidence_deg=75, min_pixels=2000)
    network = network_of(MESH, lens, POSES, task)
    covered = rc.unite(rc.regions(MESH, lens, POSES, rc.Task(max_incidence_deg=75))).area[-1]
    left = network.views < 1
    # Points with fewer pixels than a face needs do not count: at most the covered area.
    share = share_in_parts(network, lens, POSES)
    assert 0.1 < share <= covered[left].sum() / MESH.areas.sum() + 0.02
    (line,) = half_covered(network, lens, POSES)
    assert "--by area" in line


@pytest.mark.parametrize(("min_pixels", "n"), [(3, 12), (1e5, 12), (3, 0)])
def test_nothing_is_said_where_whole_faces_or_too_few_pixels_or_no_cameras_tell_it_all(
    min_pixels, n
):
    mesh, camera = shapes.by_name("torus"), rc.Camera(width=640, height=480, fx=600, fy=600)
    poses = sphere_of_poses(mesh.bounds.mean(axis=0), 8.0, 12)
    network = network_of(mesh, camera, poses[:n], rc.Task(min_pixels=min_pixels))
    assert half_covered(network, camera, poses[:n]) == []


def test_what_prevents_a_result_by_area_is_named():
    network = network_of(MESH, CAMERA, POSES, rc.Task(min_pixels=10))
    (line,) = half_covered(network, CAMERA, POSES)
    assert "use --by area (min_pixels is of a face; give min_pixels_per_m2" in line
    network = network_of(MESH, CAMERA, POSES, rc.Task())
    assert "method sampled counts whole" in half_covered(network, CAMERA, POSES, "sampled")[0]
