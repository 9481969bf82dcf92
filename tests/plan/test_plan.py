"""Plan files: what is read, what is refused and how, and what becomes of their entries."""

import json
import re
import runpy
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from commands import write_part
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples
from pydantic import ValidationError

import rastercov as rc
from rastercov.base.features import hooks_of
from rastercov.base.format import distinct_percents
from rastercov.core.camera.conventions import write_poses
from rastercov.core.camera.viewpoints import sphere_of_poses
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import shapes
from rastercov.placement.plan import entries as plan_entry
from rastercov.placement.plan import generators as plan_generators
from rastercov.placement.plan import sections as plan_model
from rastercov.placement.plan.file import Plan, PlanError, lines_of, read_plan, schema
from rastercov.placement.plan.generator import Generator
from rastercov.placement.plan.network import classify_network, percent
from rastercov.placement.plan.rig_parts import certain_and_possible
from rastercov.placement.plan.scene import candidate_pool, framing_of, name_scene, scene
from rastercov.placement.plan.sections import PlanModel

ROOT = Path(__file__).parents[2]
BOX = '[[meshes]]\nbuilt_in = "box"\n'
BASE = BOX + '[camera]\npreset = "khepra"\n'
ENTRY = BASE + "[[candidates]]\ngenerator = "
CAMERA = "[camera]\nwidth = 64\nheight = 48\nfx = 64\nfy = 64\n"


def plan_of(text, name="plan.toml"):
    Path(name).write_text(text, encoding="utf-8")
    return read_plan(name)


def errors(text):
    """The lines that a bad plan gets, without the name of the file."""
    with pytest.raises(PlanError) as caught:
        plan_of(text)
    for line in caught.value.lines:
        assert line.startswith("plan.toml: ")
        assert line.isprintable()
    return [line.removeprefix("plan.toml: ") for line in caught.value.lines]


# --- reading --------------------------------------------------------------------------------------


def test_the_least_plan_has_a_mesh_and_a_camera():
    plan = plan_of(BASE)
    assert plan.rig.cameras[0] == rc.Camera.preset("khepra")
    assert plan.build_task() == rc.Task()
    assert plan.folder == Path()
    assert scene(plan).n_faces == 12


WRONG = {
    "meshs": "meshs = 1",
    "meshes[0].path": '[[meshes]]\npath = "no.stl"',
    "meshes[0].unit": 'unit = "miles"',
    "meshes[1].built_in": '[[meshes]]\nbuilt_in = "teapt"',
    "meshes[1].colour": 'colour = "red"',
    "camera.fx": '[camera]\npreset = "khepra"\nfx = "a"',
    "task.min_pixels": "[task]\nmin_pixels = -3",
    "task.views": 'views = "two"',
    "candidates[0].generator": '[[candidates]]\ngenerator = "per_segmnt"',
    "candidates[1].stand_off": '[[candidates]]\ngenerator = "per_face"\nstand_off = [3, 1]',
    "candidates[2].generator": "[[candidates]]\ncount = 3",
    "candidates[3].spacing": '[[candidates]]\ngenerator = "on_walls"',
    "candidates[3].aim[0]": "aim = [{ middle = true, point = [1, 2, 3] }]",
    "candidates[4].count": '[[candidates]]\ngenerator = "on_sphere"\ncount = 1000000000',
    "constraints.keep_out[0]": '[constraints]\nkeep_out = [{ name = "x" }]',
    "selection.coverage": '[selection]\ngoal = "best_coverage"\ncoverage = 0.98',
}


def test_all_errors_come_at_once_each_with_its_path():
    result = errors("\n".join(WRONG.values()))
    assert sorted(line.partition(": ")[0] for line in result) == sorted(WRONG)
    assert sum("; correct the name" in line for line in result) == 4
    assert any(
        line.endswith(
            " for best_coverage, got 'coverage', which goes with fewest_cameras; leave it out"
        )
        for line in result
    )


@pytest.mark.slow
@examples(10)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=5), part),
    ),
    st.sampled_from([*PlanModel.model_fields]),
)
def test_whatever_stands_in_a_section_is_judged_in_lines(value, section):
    table = {
        "meshes": [{"built_in": "box"}],
        "camera": {"preset": "khepra"},
        "candidates": [{"generator": "per_face"}],
        section: value,
    }
    try:
        Plan.model_validate(table)
    except ValidationError as error:
        lines = lines_of(error, table, PlanModel)
        assert lines
        assert all(line.startswith(section) for line in lines)
        assert all("\n" not in line for line in lines)


def test_files_are_relative_to_the_plan():
    Path("deep").mkdir()
    write_part("deep/part.obj", names={})
    write_poses("deep/rig.json", sphere_of_poses((0, 0, 0), 3, 4))
    Path("deep/camera.toml").write_text("width = 64\nheight = 48\nfx = 64\nfy = 64\n")
    text = (
        '[[meshes]]\npath = "part.obj"\nunit = "mm"\n[camera]\nfile = "camera.toml"\n'
        '[[candidates]]\ngenerator = "poses"\nfile = "rig.json"\n'
    )
    plan = plan_of(text, "deep/plan.toml")
    mesh = scene(plan)
    assert np.ptp(mesh.bounds, axis=0) == pytest.approx([1e-3] * 3)
    assert plan.rig.cameras[0].width == 64
    assert len(candidate_pool(plan, mesh).candidates) == 4


# --- schema and documentation ---------------------------------------------------------------------


def test_the_schema_in_docs_is_that_of_the_model():
    text = (ROOT / "docs" / "plan.schema.json").read_text(encoding="utf-8")
    assert json.loads(text) == schema()
    assert json.dumps(schema(), allow_nan=False)


def models():
    for module in (plan_generators, plan_model, plan_entry):
        for value in vars(module).values():
            if isinstance(value, type) and issubclass(value, plan_entry.Entry):
                yield value
    for each in hooks_of(plan_entry.PlanSections):
        yield from (*each.generators(), *each.carried())


def test_every_field_says_what_it_is_in_the_schema_and_in_the_page():
    made = runpy.run_path(str(ROOT / "docs" / "made_from_code.py"))
    page = made["_plan"]()
    for model in models():
        for name, entry in model.model_json_schema().get("properties", {}).items():
            said = entry.get("description", "")
            assert said or name in ("generator", "goal"), (model, name)
            words = re.escape(made["_cell"](said))
            row = rf"\| `{name}` \|.*\| {words} \|"
            if model is plan_model.PlanModel:  # a heading, whose words may be those of its table
                row = rf"\| \[?`\[*{name}\b.*\w\. \|"
            assert re.search(f"^{row}$", page, re.MULTILINE), (model, name)


# --- the scene ------------------------------------------------------------------------------------


PART = '[[meshes]]\npath = "part.obj"\n'
FIXTURE = 'role = "occluder"\n'
TARGETS = '[[targets]]\nfile = "part.obj"\n'
GROUPS = {
    PART: ["lid task", "rest task"],
    PART + 'groups = ["lid"]\n': ["lid task", "rest occluder"],
    PART + FIXTURE + 'groups = ["lid"]\n': ["lid occluder", "rest task"],
    PART + 'role = "target"\n': ["lid target", "rest target"],
    PART + 'role = "target"\ngroups = ["lid"]\n': ["lid target", "rest task"],
    PART
    + '[[meshes]]\npath = "arm.obj"\n'
    + FIXTURE
    + BOX
    + FIXTURE
    + BOX
    + 'role = "occluder"\ntransform = { scale = 3 }\n': [
        *("lid task", "rest task", "arm occluder"),
        *("box occluder", "box #2 occluder"),
    ],
    # All groups of a file are one target.
    BOX.replace("box", "room") + f'{TARGETS}name = "crates"\n' + TARGETS: [
        *("room task", "crates task", "crates #2 target", "part target"),
    ],
}
"""Entries of a plan: the groups of its scene with their roles."""


@pytest.mark.parametrize("text", GROUPS)
def test_groups_have_the_names_and_roles_of_their_entries(text):
    write_part("part.obj", 1.5)
    write_part("arm.obj", 2.0, {})
    mesh = scene(plan_of(text + CAMERA))
    assert [f"{group.name} {group.role}" for group in mesh.groups] == GROUPS[text]


def test_each_mesh_has_its_unit_and_its_sides():
    write_part("part.obj")
    text = (
        PART + 'unit = "mm"\ntwo_sided = ["rest"]\n[[meshes]]\nbuilt_in = "box"\ntwo_sided = true\n'
    )
    mesh = scene(plan_of(text + CAMERA))
    assert (mesh.n_faces, mesh.two_sided_mask.sum()) == (24, 10 + 12)
    part = mesh.vertices[mesh.faces[mesh.face_group <= 1]]
    assert np.ptp(part.reshape(-1, 3), axis=0) == pytest.approx([1e-3] * 3)


FILE = '[[meshes]]\npath = "{}"\n'
AT_ONCE = {
    FILE.format("part.obj")
    + CAMERA
    + "[task]\nviews = { led = 2 }\n"
    + '[[candidates]]\ngenerator = "per_face"\ngroups = ["lit"]\n'
    + '[[candidates]]\ngenerator = "on_walls"\nspacing = 1\naim = [{nearest = ["let"]}]\n'
    + '[selection]\ngoal = "fewest_cameras"\ngroups = { lad = 1.0 }\n': (
        ["task.views", "selection.groups", "candidates[0].groups", "candidates[1].aim[0].nearest"],
        "(groups: lid, rest)",
    ),
    FILE.format("one.obj") + FILE.format("two.stl") + CAMERA: (["meshes[0]", "meshes[1]"], ""),
}
"""Plans that only their meshes prove wrong: the paths of the lines, and words of each."""


@pytest.mark.parametrize("text", AT_ONCE)
def test_broken_meshes_and_unknown_groups_are_told_at_once(text):
    write_part("part.obj")
    for name in ("one.obj", "two.stl"):
        Path(name).write_text("nonsense")
    with pytest.raises(PlanError) as caught:
        scene(plan_of(text))
    paths, words = AT_ONCE[text]
    assert [line.split(": ")[1] for line in caught.value.lines] == paths
    assert all(words in line for line in caught.value.lines)


# --- candidates -----------------------------------------------------------------------------------

ENTRIES = {
    "per_segment": ("", "segment", 6),
    "per_face": ("", "face", 12),
    "on_sphere": ("count = 7\n", "sphere", 7),
    "on_hemisphere": ("count = 7\n", "hemisphere", 7),
    "on_box": ('spacing = 9\noutward = 1.0\nsides = ["+z", "-z"]\n', "box", 8),
    "on_walls": ("spacing = 9\ninset = -1.0\n", "walls", 8),
    "on_ceiling": ("spacing = 9\ninset = -1.0\n", "ceiling", 4),
    "in_room": (
        'room = "r"\nspacing = 9\n[rooms.r]\nz = [-9, 9]\n'
        "polygon = [[-9, -9], [9, -9], [9, 9], [-9, 9]]\n",
        "in r",
        1,
    ),
    "strips": ("height = 3\nfront = 0.5\nside = 0.5\n", "strips", 4),
    "orbit": ("radius = 4\nheights = [0, 1]\ncount = 6\n", "orbit", 12),
    "facade": (
        'distance = 2\nfront = 0.5\ngroups = ["wall"]\n[[targets]]\nfile = "wall.obj"\n',
        "facade",
        20,
    ),
    "poses": ('file = "rig.json"\n', "poses", 5),
}


@pytest.mark.parametrize("generator", ENTRIES)
def test_an_entry_makes_the_candidates_of_its_generator(generator):
    own, source, count = ENTRIES[generator]
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 3, 5))
    corners = "v 3 -2 0\nv 3 2 0\nv 3 2 3\nv 3 -2 3\n"
    Path("wall.obj").write_text(f"{corners}f 1 2 3\nf 1 3 4\n", encoding="utf-8")
    plan = plan_of(ENTRY + f'"{generator}"\ncost = 2.5\nrolls_deg = [0, 90]\n{own}')
    mesh, plan, _ = name_scene(plan)
    made = candidate_pool(plan, mesh)
    assert made.made == {source: 2 * count}
    assert (made.costs == 2.5).all()
    assert made.space.allows(made.candidates.poses[:, :3, 3]).all()
    own = (each for each in models() if issubclass(each, Generator))
    tags = (model.model_fields.get("generator") for model in own)
    assert {*ENTRIES, "per_cavity", "on_arm"} == {
        tag for each in tags if each for tag in get_args(each.annotation)
    }


def test_an_entry_without_a_stand_off_has_that_of_the_constraints():
    own = '[[candidates]]\ngenerator = "per_face"\nstand_off = [1, inf]\n'
    both = plan_of(
        BASE + own + '[[candidates]]\ngenerator = "per_face"\n[constraints]\nstand_off = [2, 3]\n'
    )
    assert framing_of(both, both.candidates[0]).stand_off == (1, np.inf)
    assert framing_of(both, both.candidates[1]).stand_off == (2, 3)


def test_candidates_are_dropped_with_their_reasons():
    plan = plan_of(
        BASE + '[[candidates]]\ngenerator = "on_sphere"\ncount = 30\ndistances = [0.3, 2, 3, 9]\n'
        "[constraints]\nstand_off = [0.1, 5]\nclearance = 0.2\n"
        '[[constraints.keep_out]]\nname = "table"\nlow = [-9, -9, -9]\nhigh = [9, 9, -1]\n'
        "[[constraints.spaces]]\nlow = [-9, -9, -9]\nhigh = [1.5, 9, 9]\n"
    )
    made = candidate_pool(plan, scene(plan))
    dropped = made.summary()["dropped"]
    assert made.summary()["made"] == {"sphere": 120}
    assert dropped["in_solid"] == 30
    assert min(dropped["kept_out"], dropped["outside"], dropped["too_far"]) > 0
    assert 120 - sum(dropped.values()) == len(made.candidates) == len(made.costs)
    text = " ".join(made.lines())
    assert "inside keep-out volume 'table'" in text
    assert "outside the spaces" in text
    x, _, z = made.candidates.poses[:, :3, 3].T
    assert x.max() <= 1.5
    assert z.min() > -1


def test_mounts_stay_on_their_walls_unless_the_plan_says_where_cameras_may_stand():
    text = '[[candidates]]\ngenerator = "on_walls"\nspacing = 2\ninset = 0.25\n'
    anywhere = "[[constraints.spaces]]\nlow = [-3, -2.5, 0]\nhigh = [3, 2.5, 2.8]\n"
    on_wall, in_air = [2.75, 1.0, 1.0], [0.5, 0.5, 2.5]
    for spaces, allowed in (("", [True, False]), (anywhere, [True, True])):
        plan = plan_of(BASE.replace("box", "room") + text + spaces)
        space = candidate_pool(plan, scene(plan)).space
        assert space.allows([on_wall, in_air]).tolist() == allowed


def test_walls_of_the_bounding_box_are_told_from_those_of_the_mesh():
    text = '[[candidates]]\ngenerator = "on_walls"\nspacing = 1\ninset = 0.01\n'
    told = []
    for shape in ("box", "room"):
        plan = plan_of(BASE.replace("box", shape) + text)
        told.append("generator in_room" in candidate_pool(plan, scene(plan)).lines()[0])
    assert told == [True, False]


# --- requirements and bounds ----------------------------------------------------------------------


def test_percentages_that_differ_are_told_apart():
    assert distinct_percents(0.2819, 0.28168, 0.28168) == ["28.19 %", "28.17 %", "28.17 %"]
    assert distinct_percents(0.9, 0.873, 0.85) == ["90.0 %", "87.3 %", "85.0 %"]
    assert distinct_percents(0.5, 0.5) == ["50.0 %", "50.0 %"]


@given(st.floats(0, 1))
def test_a_percentage_is_never_rounded_to_all_or_nothing(share):
    value = float(percent(share).removesuffix(" %"))
    assert abs(value - 100 * share) <= 0.05 + 1e-9
    assert value < 100 or share > 1 - 1e-8
    assert value > 0 or share < 1e-8


def masks():
    return st.lists(st.tuples(*[st.booleans()] * 3), min_size=12, max_size=12)


@pytest.mark.slow
@given(masks(), st.floats(0, 1))
def test_a_requirement_holds_fails_or_is_not_decided(rows, limit):
    mesh = shapes.box()
    a, b, c = np.array(rows).T
    certain, covered, possible = a & b & c, a & b, a
    integer_weights = np.ones(12, np.int64)
    (result,) = classify_network(mesh, integer_weights, {None: limit}, covered, certain, possible)
    assert result.low <= result.share <= result.high
    assert result.uncovered == 12 - covered.sum()
    wanted = "holds" if result.low >= limit - 1e-9 else "fails"
    if result.low < limit - 1e-9 <= result.high:
        wanted = "undecided"
    assert result.status == wanted
    assert (result.status == "undecided") == ("undecided" in result.words())


def altered(coverage, visibility):
    """Covered pairs with other visibilities, judged again by the letter of the task."""
    task = coverage.task
    is_enough = visibility >= task.min_visibility
    product = np.where(is_enough, visibility, 0.0) * np.minimum(coverage.resolution, 1.0)
    barred = (Reason.DEGENERATE, Reason.BACK_FACING, Reason.OUTSIDE, Reason.OUT_OF_FOCUS)
    return (
        ~np.isin(coverage.reason, barred)
        & (coverage.pixel_density >= task.min_pixel_density)
        & (coverage.incidence <= np.radians(task.max_incidence_deg))
        & (product >= task.min_coverage)
        & (product > 0)
    )


@pytest.mark.slow
@examples(8, at_night=25)
@given(
    seed=st.integers(0, 10_000),
    size=st.floats(0, 0.4),
    limits=st.fixed_dictionaries(
        {
            "min_visibility": st.floats(0, 1),
            "max_incidence_deg": st.floats(20, 90),
            "min_pixel_density": st.floats(0, 15),
        }
    ),
)
def test_what_is_certain_and_possible_encloses_every_visibility_within_the_bound(
    seed, size, limits
):
    rng = np.random.default_rng(seed)
    poses = rc.look_at(rng.uniform((-1, -1, 0.5), (1, 1, 2.5), (3, 3)), (0, 0, 0.4))
    camera = rc.Camera(width=64, height=48, fx=30, fy=30)
    task = rc.Task(min_pixels=20, min_coverage=0.3, **limits)
    coverage = rc.evaluate(shapes.room(2), camera, poses, task, by="face")
    value, bound = coverage.visibility, rng.uniform(0, size, coverage.visibility.shape)
    certain, possible = certain_and_possible(replace(coverage, visibility_bound=bound))
    assert (certain <= (coverage.reason == Reason.COVERED)).all()
    assert ((coverage.reason == Reason.COVERED) <= possible).all()
    assert (certain == altered(coverage, np.maximum(value - bound, 0))).all()
    assert (possible == altered(coverage, np.minimum(value + bound, 1))).all()


# ---- transforms of meshes


def placed(transform):
    text = BASE.replace('"box"\n', f'"box"\ntransform = {{ {transform} }}\n')
    return scene(plan_of(text))


def test_a_mesh_is_scaled_then_turned_then_translated():
    box = shapes.by_name("box")
    mesh = placed("scale = 2, axis = [0, 0, 5], angle_deg = 90, translation = [10, 0, 1]")
    x, y, z = 2 * box.vertices.T
    np.testing.assert_allclose(mesh.vertices, np.stack([10 - y, x, 1 + z], axis=1), atol=1e-15)
    np.testing.assert_array_equal(mesh.faces, box.faces)
    assert mesh.groups == box.groups
    np.testing.assert_array_equal(placed("").vertices, box.vertices)
