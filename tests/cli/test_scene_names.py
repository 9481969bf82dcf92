"""A name of a mesh file or group means the same in every option, in plans and in functions."""

import json
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from commands import write_part
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples

from rastercov.base.errors import ConfigError, MeshError, RastercovError
from rastercov.cli.inputs import SceneOptions, are_arguments
from rastercov.core.mesh import Mesh
from rastercov.core.mesh.groups import FileGroups, Names, names_beside
from rastercov.placement.plan.file import PlanError, plan_of
from rastercov.placement.plan.scene import name_scene, scene

FILES = ["part.obj", "deep/fixture.obj", "deep/table.obj"]
FIXTURE = [
    *("deep/fixture.obj", "fixture.obj", "fixture", "./deep/fixture.obj", "fixture/*", "fix*"),
    *("*/fixture.???", "[f]ixture", "f?xture", "link.obj", "hard.obj", "fixture/[lr]*"),
]
"""Names of the second file: its path, name, stem, all of its groups, and links to it."""


@pytest.fixture(autouse=True)
def files():
    Path("deep").mkdir()
    for row, name in enumerate(FILES):
        write_part(name, side=1.0 + row)
    Path("link.obj").symlink_to("deep/fixture.obj")
    Path("hard.obj").hardlink_to("deep/fixture.obj")


def loaded(unit=(), transform=(), occluder=(), target=(), two_sided=(), meshes=FILES):
    given = [list(each) for each in (unit or ["m"], transform, occluder, two_sided)]
    return SceneOptions(*given, False, list(target)).read([Path(name) for name in meshes])


def flagged(mesh, flag):
    return [group.name for group in mesh.groups if getattr(group, flag)]


BOTH = ["fixture/lid", "fixture/rest"]
NAMES = ["lid", "arm/bolt", "arm/tip", "arm", "rest", "x/lid"]


@pytest.mark.parametrize("name", FIXTURE)
def test_a_name_means_the_same_in_every_option(name):
    for option in ("occluder", "target", "two_sided"):
        assert flagged(loaded(**{option: [name]}), f"is_{option}") == BOTH
    factor = np.where(np.isin(loaded().face_group, [2, 3]), 1e-6, 1)
    if not name.startswith("fixture/"):  # units and places are of whole files here
        for changed in (loaded(unit=[f"{name}:mm"]), loaded(transform=[f"{name}: scale = 0.001"])):
            np.testing.assert_allclose(changed.areas, loaded().areas * factor)


@pytest.mark.parametrize("name", FIXTURE)
def test_a_name_means_the_same_in_functions(name):
    for flag in ("occluders", "two_sided", "targets"):
        attribute = f"is_{flag.removesuffix('s')}"
        assert flagged(Mesh.load(FILES, **{flag: [name]}), attribute) == BOTH
    if "/fixture" not in name and name not in ("link.obj", "hard.obj"):  # a mesh has no folders
        assert flagged(Mesh.load(FILES).with_groups(occluders=[name]), "is_occluder") == BOTH
        moved = Mesh.load(FILES).moved(scale=10, groups=[name])
        assert moved.areas.sum() == pytest.approx(6 * (1 + 100 * 4 + 9))
    if not name.startswith("fixture/"):
        units = Mesh.load(FILES, {"*": "cm", name: "mm"})
        np.testing.assert_allclose(units.vertices[:8], 1e-2 * Mesh.load(FILES).vertices[:8])


@pytest.mark.parametrize("name", FIXTURE)
def test_a_name_means_the_same_in_plans(name):
    if name in ("link.obj", "hard.obj"):
        pytest.skip("of a file that is there, which a plan names as the user does")
    table = {
        "meshes": [{"path": path} for path in FILES],
        "task": {"views": {name: 2}},
        "candidates": [{"generator": "per_face", "groups": [name]}],
        "selection": {"goal": "fewest_cameras", "groups": {name: 0.5}},
        "targets": [{"above": name, "height": 9.0, "name": "sheet"}],
    }
    mesh, plan, _ = name_scene(plan_of(table))
    assert plan.task.views == dict.fromkeys(BOTH, 2)
    assert plan.candidates[0].groups == BOTH
    whole = ["fixture"] if not name.startswith("fixture/") else BOTH
    assert plan.selection.groups == dict.fromkeys(whole, 0.5)
    assert mesh.target_mask.sum() == 2


@pytest.mark.parametrize("name", ["lid", "part/lid", "l*", "*lid"])
@pytest.mark.parametrize("field", ["groups", "two_sided"])
def test_an_entry_of_a_plan_takes_names_in_its_file_and_those_of_reports(name, field):
    table = {"meshes": [{"path": "part.obj", field: [name]}, {"path": "deep/table.obj"}]}
    mesh = scene(plan_of(table))
    flag = "is_two_sided" if field == "two_sided" else "is_occluder"
    assert flagged(mesh, flag) == (["lid"] if field == "two_sided" else ["rest"])


def test_a_file_of_the_list_is_not_read_again_and_a_further_one_once():
    for option in ({"occluder": ["deep/fixture.obj"]}, {"target": ["link.obj", "hard.obj"]}):
        assert loaded(**option).n_faces == loaded().n_faces
    both = loaded(occluder=["deep/fixture.obj"], two_sided=["fixture"], meshes=FILES[:1])
    assert both.n_faces == 24
    assert flagged(both, "is_occluder") == flagged(both, "is_two_sided") == BOTH


@pytest.mark.parametrize("other", ["part.obj", "./part.obj", "copy.obj", "soft.obj", "hard.obj"])
def test_a_mesh_that_is_there_twice_is_an_error(other):
    Path("copy.obj").write_bytes(Path("part.obj").read_bytes())
    Path("soft.obj").symlink_to("part.obj")
    Path("hard.obj").unlink()
    Path("hard.obj").hardlink_to("part.obj")
    meshes = ["part.obj", other, "deep/table.obj"]
    table = {"meshes": [{"path": path} for path in meshes]}
    for read in (
        lambda: Mesh.load(meshes), lambda: loaded(meshes=meshes), lambda: scene(plan_of(table))
    ):  # fmt: skip
        with pytest.raises((MeshError, PlanError), match="in the same place"):
            read()
    table["meshes"][1]["transform"] = {"translation": [9.0, 0.0, 0.0]}
    assert scene(plan_of(table)).n_faces == 36
    if other == "copy.obj":
        assert loaded(meshes=meshes, transform=["copy: translation = [9, 0, 0]"]).n_faces == 36


@pytest.mark.parametrize(
    ("option", "words"),
    [({"unit": ["part:mm"]}, "expected one file of the name 'part', got 2"),
     ({"transform": ["part.obj: scale = 2"]}, "expected one file of the name 'part.obj', got 2"),
     ({"occluder": ["part"]}, "expected one file of the name 'part', got 2"),
     ({"target": ["part"]}, "expected one file of the name 'part', got 2"),
     ({"unit": ["p*:mm", "pa*:cm"]}, "expected --unit once for part.obj")],
)  # fmt: skip
def test_a_name_of_two_files_is_refused(option, words):
    Path("other").mkdir()
    Path("part.obj").rename("deep/part.obj")
    write_part("other/part.obj", side=8.0)
    with pytest.raises(RastercovError, match=re.escape(words)):
        loaded(meshes=["deep/part.obj", "other/part.obj"], **option)


def test_a_file_here_is_not_taken_for_one_of_its_name_elsewhere():
    write_part("table.obj", side=7.0)
    with pytest.raises(ConfigError, match=r"got deep/table.obj and ./table.obj"):
        loaded(occluder=["table.obj"])
    assert loaded(occluder=["./table.obj"]).n_faces == 48


@pytest.mark.parametrize(
    "read",
    [lambda name: loaded(occluder=[name], meshes=["cad.obj"]),
     lambda name: loaded(unit=[f"{name}:mm"], meshes=["cad.obj"]),
     lambda name: Mesh.load("cad.obj", two_sided=[name]),
     lambda name: Mesh.load("cad.obj").with_groups(targets=[name]),
     lambda name: scene(plan_of({"meshes": [{"path": "cad.obj"}], "task": {"views": {name: 2}}}))],
)  # fmt: skip
def test_an_unknown_name_is_a_short_line(read):
    """Of a STEP file with hundreds of faces, say."""
    lines = [f"v {x} {y} {z}" for x, y, z in product((0, 1), repeat=3)]
    lines += [f"g face {row}\nf {1 + row % 5} 2 {4 + row % 5}" for row in range(400)]
    Path("cad.obj").write_text("\n".join(lines) + "\n")
    with pytest.raises(RastercovError) as caught:
        read("fase 17" + 3000 * "x")
    assert len(str(caught.value)) < 500
    with pytest.raises(MeshError, match=r"groups: face 17,.* and 39\d more"):
        loaded(occluder=["fase 17"], meshes=["cad.obj"])


@settings(examples(20, at_night=300))
@given(st.lists(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True), max_size=4))
def test_groups_keep_their_names_whatever_files_follow(files):
    """And each is found by its name in the scene, and by "stem/name"."""
    paths = [f"f{row}.obj" for row in range(len(files))]
    for last in range(1, len(files) + 1):
        names = names_beside(paths[:last], files[:last])
        assert names == names_beside(paths, files)[: len(names)]
        assert len(set(names)) == len(names)
    rows = np.repeat(np.arange(len(files)), [len(each) for each in files])
    names, own = names_beside(paths, files), [name for each in files for name in each]
    scenes = [FileGroups(p, [n for n, r in zip(names, rows, strict=True) if r == row])
              for row, p in enumerate(paths)]  # fmt: skip
    result = Names(names, scenes)
    for name, short, row in zip(names, own, rows.tolist(), strict=True):
        assert result.groups_of(f"f{row}/{short}") == [name]
        assert Names(names, scenes, group_first=True).groups_of(name) == [name]
        if own.count(short) > 1:
            with pytest.raises(MeshError, match="expected one file with a group"):
                result.groups_of(short)


@pytest.mark.parametrize("deflection_mm", [None, 0.02, 1])
def test_options_of_a_scene_are_read_again_from_a_result(deflection_mm, tmp_path):
    options = SceneOptions(unit=["mm"], deflection_mm=deflection_mm)
    entries = json.loads(json.dumps(options.entries(tmp_path, [Path("a.step")])))
    assert are_arguments(entries)
    assert not are_arguments(entries | {"deflection_mm": "fine"})
    kept = {name: entries[name] for name in SceneOptions._fields if name in entries}
    assert SceneOptions(**kept) == options
