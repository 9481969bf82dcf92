"""Targets of a plan: sections, roles, and what is refused."""

import numpy as np
import pytest
from test_plan import BASE, plan_of

from rastercov.placement.plan.scene import scene

ROOM = BASE.replace('"box"', '"room"')


def target(entries):
    return f"{ROOM}[[targets]]\n{entries}\n"


def test_a_sheet_above_a_group():
    mesh = scene(plan_of(target('above = "room"\nheight = 1.6')))
    group = mesh.groups[-1]
    assert (group.name, group.role, group.is_two_sided) == ("room + 1.6 m", "target", False)
    sheet = mesh.faces[mesh.target_mask]
    assert np.allclose(mesh.vertices[sheet][..., 2], 1.6)
    assert (mesh.normals[mesh.target_mask, 2] == 1).all()


def test_a_grid_of_boxes_by_count_or_by_spacing():
    box = "box = [[0, 0, 0], [1.0, 2.0, 1.0]]\n".replace("0, 0, 0", "0.0, 0.0, 0.0")
    for entries, n_boxes in (("", 1), ("count = [1, 4, 2]", 8), ("spacing = 0.5", 16)):
        mesh = scene(plan_of(target(box + entries)))
        assert mesh.target_mask.sum() == 12 * n_boxes
        assert mesh.groups[-1].is_two_sided
        assert mesh.groups[-1].name == "volume"
    mesh = scene(plan_of(target(box + "count = [2, 4, 2]\nsize = 0.25\ntwo_sided = false")))
    assert not mesh.groups[-1].is_two_sided
    assert mesh.areas[mesh.target_mask].sum() == pytest.approx(16 * 6 * 0.25**2)


def test_faces_of_people_are_upright_squares_on_the_sheet():
    text = 'above = "room"\nheight = 1.6\nname = "faces"\n'
    mesh = scene(plan_of(target(text + "facing = 8\nspacing = 1.0\nsize = 0.3")))
    assert mesh.target_mask.sum() == 2 * 8 * 30
    assert not mesh.groups[-1].is_two_sided
    assert np.allclose(mesh.normals[mesh.target_mask, 2], 0)
    assert mesh.areas[mesh.target_mask].sum() == pytest.approx(8 * 30 * 0.3**2)
    mesh = scene(plan_of(target(text + "facing = [[0, -1, 0]]")))
    assert (mesh.normals[mesh.target_mask].round(9) == (0, -1, 0)).all()


def test_views_and_requirements_may_name_a_target():
    text = target('above = "room"\nheight = 1.6\nname = "eyes"')
    text += '[task]\nviews = { eyes = 2 }\n[selection]\ngoal = "fewest_cameras"\ncoverage = 0.5\n'
    assert scene(plan_of(text + "groups = { eyes = 0.9 }\n")).has_targets
