"""Targets as groups of a mesh, and the opaque part that is left without them."""

import numpy as np
import pytest
from target_scenes import beside, only, sheet_at

from rastercov.base.errors import ConfigError, MeshError
from rastercov.core.mesh import Group, Mesh, shapes

BOX, SHEET = shapes.box(), sheet_at((-2, -2), (2, 2), 1.5)
SCENE = beside(BOX, SHEET)


def test_no_group_is_both_occluder_and_target():
    with pytest.raises(
        MeshError, match="expected one role of group 'jig', got occluder and target"
    ):
        Group("jig", is_occluder=True, is_target=True)
    with pytest.raises(
        MeshError, match="expected one role of group 'target 0', got occluder and target"
    ):
        SCENE.with_groups(occluders=["target 0"])
    with pytest.raises(ConfigError, match="is_target to be True or False"):
        Group("jig", is_target="yes")


def test_with_groups_sets_exactly_the_named_targets():
    mesh = SCENE.with_groups(targets=["mesh"])
    assert [group.is_target for group in mesh.groups] == [True, False]
    assert mesh.opaque.n_faces == 2
    assert not SCENE.with_groups(targets=[]).has_targets
    assert SCENE.with_groups(two_sided="all").target_mask.any()
    assert SCENE.with_groups(occluders=["target 0"], targets=[]).groups[1].is_occluder
    with pytest.raises(MeshError, match=r"expected a mesh file or a group, got"):
        SCENE.with_groups(targets=["sheet"])


def test_the_opaque_part_is_the_mesh_without_targets():
    opaque, expected = SCENE.opaque, only(SCENE, ~SCENE.target_mask)
    np.testing.assert_array_equal(opaque.vertices, expected.vertices)
    np.testing.assert_array_equal(opaque.faces, expected.faces)
    assert opaque.groups == SCENE.groups
    assert opaque.opaque is opaque
    assert opaque.can_cull_back_faces  # a closed box, though the sheet is open
    assert BOX.opaque is BOX


def test_the_opaque_part_of_targets_alone_has_their_bounds_and_hides_nothing():
    mesh = SHEET.with_groups(targets=["mesh"])
    np.testing.assert_array_equal(mesh.opaque.bounds, mesh.bounds)
    assert mesh.opaque.degenerate_mask.all()


def test_properties_do_not_outlive_a_change_of_targets():
    mesh = beside(BOX, SHEET)
    assert (mesh.is_closed, mesh.opaque.n_faces) == (False, 12)
    assert mesh.topology.n_boundary_edges == 4
    mixed = mesh.with_groups(targets=[])
    assert (mixed.opaque.n_faces, mixed.task_mask.sum()) == (14, 14)
    assert mixed.warnings == ("open surface: 4 edges with a face on one side only",)
    assert mesh.warnings == ()


def test_targets_share_no_edge_with_other_faces():
    lid = Mesh(BOX.vertices, BOX.faces[:2])  # on two faces of the box, edge on edge
    mesh = beside(BOX, lid)
    assert mesh.topology.n_nonmanifold_edges == 0
    assert mesh.with_groups(targets=[]).topology.n_nonmanifold_edges > 0
    parts = mesh.topology.components()
    assert not np.isin(parts[12:], parts[:12]).any()


def test_targets_without_area_are_named():
    flat = Mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])
    assert beside(BOX, flat).warnings == ("1 degenerate faces of targets, without area",)


def test_scenes_without_targets_are_written_as_before():
    assert Group("part").to_json() == {"name": "part", "is_occluder": False, "is_two_sided": False}
    assert Group("sheet", is_target=True).to_json()["is_target"] is True
