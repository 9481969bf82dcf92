"""Targets of a plan: sections, roles, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from commands import write_part
from test_plan import BASE, errors, plan_of

from rastercov.placement.plan.file import PlanError
from rastercov.placement.plan.scene import scene

ROOM = BASE.replace('"box"', '"room"')


def scene_errors(text):
    plan = plan_of(text)
    with pytest.raises(PlanError) as caught:
        scene(plan)
    return [line.removeprefix("plan.toml: ") for line in caught.value.lines]


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


def test_a_file_and_names_that_are_taken():
    write_part("lid.obj", side=1000.0)
    text = (
        target('file = "lid.obj"\nunit = "mm"\nname = "crates"') + '[[targets]]\nfile = "lid.obj"'
    )
    mesh = scene(plan_of(text))
    assert [group.name for group in mesh.groups] == ["room", "crates", "crates #2", "lid"]
    assert [group.role for group in mesh.groups] == ["task", "task", "target", "target"]
    assert mesh.target_mask.sum() == 24  # all groups of a file are one target
    assert mesh.sources[-1].name == "lid.obj"


def test_a_mesh_with_the_role_of_a_target():
    write_part("part.obj")
    text = BASE + '[[meshes]]\npath = "part.obj"\nunit = 2\nrole = "target"\n'
    mesh = scene(plan_of(text))
    assert [group.role for group in mesh.groups] == ["task", "target", "target"]
    mesh = scene(plan_of(text + 'groups = ["lid"]\n'))
    assert [group.role for group in mesh.groups] == ["task", "target", "task"]


def test_views_and_requirements_may_name_a_target():
    text = target('above = "room"\nheight = 1.6\nname = "eyes"')
    text += '[task]\nviews = { eyes = 2 }\n[selection]\ngoal = "fewest_cameras"\ncoverage = 0.5\n'
    assert scene(plan_of(text + "groups = { eyes = 0.9 }\n")).has_targets


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ("", "wanted one of above, box, file, got none"),
        ('above = "room"\nbox = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]', "above and box"),
        ('above = "room"', "above and height come together"),
        ("box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\nheight = 1.0", "above and height"),
        ("box = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]", "wanted low < high"),
        ("box = [[0.0, 0.0, 0.0]]", "2 or more"),
        ("box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\ncount = [1, 1]", "3 or more"),
        ("box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\ncount = [1, 1, 0]", "1 or more"),
        (
            "box = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\ncount = [1, 1, 1]\nspacing = 0.1",
            "count and spacing exclude each other",
        ),
        ('above = "room"\nheight = 1.0\nspacing = 0.5', "spacing is of a box"),
        ('above = "room"\nheight = -1.0', "0 or more"),
        ('above = "room"\nheight = 1.0\nunit = "mm"', "unit is of a file"),
        ('file = "no.stl"', "there is no no.stl"),
        ('above = "room"\nheight = 1.0\ncolour = "red"', "colour"),
    ],
)
def test_bad_entries_get_a_line(entries, words):
    found = errors(target(entries))
    assert len(found) == 1
    assert found[0].startswith("targets[0]")
    assert words in found[0]


def test_targets_that_do_not_fit_the_scene_get_a_line_each():
    Path("bad.obj").write_text("v 1 2\n")
    text = target('above = "flor"\nheight = 1.6')
    text += '[[targets]]\nfile = "bad.obj"\n'
    text += "[[targets]]\nbox = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\nspacing = 0.001\n"
    text += "[[targets]]\nbox = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]\nsize = 2.0\n"
    found = scene_errors(text)
    assert found[0].startswith("targets[0].above: there is no group 'flor'")
    assert found[0].endswith("groups are room, crates")
    assert found[1].startswith("targets[1].file: bad.obj")
    assert "at most 100,000 boxes" in found[2]
    assert "at most that of a cell" in found[3]


def test_a_sheet_is_above_groups_of_meshes_only():
    text = target('above = "room"\nheight = 1.6\nname = "eyes"')
    found = scene_errors(text + '[[targets]]\nabove = "eyes"\nheight = 1.0\n')
    assert [line.partition(",")[0] for line in found] == [
        "targets[1].above: there is no group 'eyes'"
    ]
