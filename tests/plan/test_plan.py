"""Plan files: what is read, what is refused and how, and what becomes of their entries."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from commands import write_part
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import examples
from pydantic import ValidationError

import rastercov as rc
from rastercov.camera.pose_file import write_poses
from rastercov.camera.viewpoints import sphere_of_poses
from rastercov.coverage.coverage import Coverage
from rastercov.coverage.task import Reason
from rastercov.mesh import shapes
from rastercov.placement.improve.objective import Objective
from rastercov.placement.plan import sections as plan_entry
from rastercov.placement.plan import sections as plan_generators
from rastercov.placement.plan import sections as plan_model
from rastercov.placement.plan.file import Plan, PlanError, lines_of, read_plan, schema
from rastercov.placement.plan.network import certain_and_possible, judge, measured, percent
from rastercov.placement.plan.scene import candidate_pool, framing_of, scene
from rastercov.placement.plan.sections import PlanModel, TaskSection

ROOT = Path(__file__).parents[2]
BASE = '[[meshes]]\nbuilt_in = "box"\n[camera]\npreset = "khepra"\n'
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
    "constraints.keep_out[0]": '[constraints]\nkeep_out = [{ name = "x" }]',
    "selection.coverage": '[selection]\ngoal = "best_coverage"\ncoverage = 0.98',
}


def test_all_errors_come_at_once_each_with_its_path():
    found = errors("\n".join(WRONG.values()))
    assert sorted(line.partition(": ")[0] for line in found) == sorted(WRONG)
    assert sum("did you mean" in line for line in found) == 2


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
        found = lines_of(error, table, PlanModel)
        assert found
        assert all(line.startswith(section) for line in found)
        assert all("\n" not in line for line in found)


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


def test_the_task_section_holds_what_a_task_does_with_the_same_defaults():
    task = {field.name: field.default for field in fields(rc.Task)}
    section = {name: entry.default for name, entry in TaskSection.model_fields.items()}
    assert task.items() <= section.items()


def test_the_camera_section_holds_what_a_camera_file_does():
    known = {field.name for field in fields(rc.Camera)}
    known |= {"preset", "file", "principal_point", "f_number"}
    known |= {"hfov_deg", "vfov_deg"}
    known |= {"name", "pixel_centre", "lens_model", "image_size"}  # of files of other programs
    assert known == set(plan_model.CameraSection.model_fields)


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


def test_every_field_says_what_it_is_in_the_schema_and_in_the_page():
    page = (ROOT / "docs" / "plan.md").read_text(encoding="utf-8")
    for model in models():
        for name, entry in model.model_fields.items():
            assert entry.description or name in ("generator", "goal"), (model, name)
            assert re.search(rf"`[^`\n]*\b{name}\b[^`\n]*`", page), (model, name)


# --- the scene ------------------------------------------------------------------------------------


def test_groups_have_the_role_of_their_entry_and_the_others_the_other_one():
    write_part("part.obj")
    base = '[[meshes]]\npath = "part.obj"\n'

    def occluders(entry):
        mesh = scene(plan_of(base + entry + CAMERA))
        return [group.name for group in mesh.groups if group.is_occluder]

    assert occluders("") == []
    assert occluders('groups = ["lid"]\n') == ["rest"]
    assert occluders('role = "occluder"\ngroups = ["lid"]\n') == ["lid"]
    two_sided = scene(plan_of(base + 'two_sided = ["rest"]\n' + CAMERA)).two_sided_mask
    assert two_sided.sum() == 10


def test_several_meshes_are_one_scene_each_with_its_unit():
    write_part("part.obj")
    write_part("arm.obj", names={})
    text = (
        '[[meshes]]\npath = "part.obj"\nunit = "mm"\n'
        '[[meshes]]\npath = "arm.obj"\nrole = "occluder"\ntransform = { scale = 2 }\n'
        '[[meshes]]\nbuilt_in = "box"\nrole = "occluder"\ntwo_sided = true\n'
        "transform = { scale = 3 }\n"
        '[[meshes]]\nbuilt_in = "box"\nrole = "occluder"\n' + CAMERA
    )
    mesh = scene(plan_of(text))
    names = ["part/lid", "part/rest", "arm", "box", "box #2"]
    assert [group.name for group in mesh.groups] == names
    assert [group.is_occluder for group in mesh.groups] == [False, False, True, True, True]
    assert [group.is_two_sided for group in mesh.groups] == [False, False, False, True, False]
    lid = mesh.vertices[mesh.faces[mesh.face_group <= 1]]
    assert np.ptp(lid.reshape(-1, 3), axis=0) == pytest.approx([1e-3] * 3)
    assert mesh.n_faces == 4 * 12


def test_groups_that_are_not_there_are_told_at_once():
    write_part("part.obj")
    text = (
        '[[meshes]]\npath = "part.obj"\n'
        + CAMERA
        + "[task]\nviews = { led = 2 }\n"
        + '[[candidates]]\ngenerator = "per_face"\ngroups = ["lit"]\n'
        + '[[candidates]]\ngenerator = "on_walls"\nspacing = 1\naim = [{nearest = ["let"]}]\n'
        + '[selection]\ngoal = "fewest_cameras"\ngroups = { lad = 1.0 }\n'
    )
    with pytest.raises(PlanError) as caught:
        scene(plan_of(text))
    paths = [line.split(": ")[1] for line in caught.value.lines]
    assert paths == [
        "task.views",
        "selection.groups",
        "candidates[0].groups",
        "candidates[1].aim[0].nearest",
    ]
    assert all("groups are lid, rest" in line for line in caught.value.lines)


def test_broken_meshes_are_told_at_once():
    for name in ("one.obj", "two.stl"):
        Path(name).write_text("nonsense")
    text = '[[meshes]]\npath = "one.obj"\n[[meshes]]\npath = "two.stl"\n' + CAMERA
    with pytest.raises(PlanError) as caught:
        scene(plan_of(text))
    assert [line.split(": ")[1] for line in caught.value.lines] == ["meshes[0]", "meshes[1]"]


# --- candidates -----------------------------------------------------------------------------------

ENTRIES = {
    "per_segment": ("", "segment", 6),
    "per_face": ("", "face", 12),
    "per_convex_region": ("", "convex_region", 8),
    "on_sphere": ("count = 7\n", "sphere", 7),
    "on_hemisphere": ("count = 7\n", "hemisphere", 7),
    "on_box": ('spacing = 9\noutward = 1.0\nsides = ["+z", "-z"]\n', "box", 8),
    "on_walls": ("spacing = 9\ninset = -1.0\n", "walls", 8),
    "on_ceiling": ("spacing = 9\ninset = -1.0\n", "ceiling", 4),
    "poses": ('file = "rig.json"\n', "poses", 5),
}


def test_every_generator_has_an_entry():
    tags = set()
    for model in models():
        if "generator" in model.model_fields:
            tags |= set(model.model_fields["generator"].annotation.__args__)
    assert tags == {*ENTRIES, "per_cavity"}


@pytest.mark.parametrize("generator", ENTRIES)
def test_an_entry_makes_the_candidates_of_its_generator(generator):
    own, source, count = ENTRIES[generator]
    write_poses("rig.json", sphere_of_poses((0, 0, 0), 3, 5))
    plan = plan_of(ENTRY + f'"{generator}"\ncost = 2.5\nrolls_deg = [0, 90]\n{own}')
    mesh = scene(plan)
    made = candidate_pool(plan, mesh)
    assert made.made == {source: 2 * count}
    assert (made.costs == 2.5).all()
    assert made.space.allows(made.candidates.poses[:, :3, 3]).all()


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
    told = made.summary()
    assert told["made"] == {"sphere": 120}
    assert told["dropped"]["in_solid"] == 30
    assert told["dropped"]["kept_out"]["table"] > 0
    assert told["misplaced"]["outside"] > 0
    assert told["misplaced"]["too_far"] > 0
    n_dropped = 120 - told["dropped"]["kept"] + sum(told["misplaced"].values())
    assert n_dropped + len(made.candidates) == len(made.costs) + n_dropped == 120
    text = " ".join(made.lines())
    assert "table" in text
    assert "outside the spaces" in text
    eyes = made.candidates.poses[:, :3, 3]
    assert (eyes[:, 0] <= 1.5).all()
    assert (eyes[:, 2] > -1).all()


def test_mounts_stay_on_their_walls_unless_the_plan_says_where_cameras_may_stand():
    entry = '[[candidates]]\ngenerator = "on_walls"\nspacing = 2\ninset = 0.25\n'
    base = BASE.replace("box", "room")
    plan = plan_of(base + entry)
    space = candidate_pool(plan, scene(plan)).space
    on_wall, in_air = [2.75, 1.0, 1.0], [0.5, 0.5, 2.5]
    assert space.allows([on_wall, in_air]).tolist() == [True, False]
    plan = plan_of(
        base + entry + "[[constraints.spaces]]\nlow = [-3, -2.5, 0]\nhigh = [3, 2.5, 2.8]\n"
    )
    space = candidate_pool(plan, scene(plan)).space
    assert space.allows([on_wall, in_air]).tolist() == [True, True]


# --- requirements and bounds ----------------------------------------------------------------------


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
    (found,) = judge(mesh, integer_weights, {None: limit}, covered, certain, possible)
    assert found.low <= found.share <= found.high
    assert found.uncovered == 12 - covered.sum()
    wanted = "holds" if found.low >= limit - 1e-9 else "fails"
    if found.low < limit - 1e-9 <= found.high:
        wanted = "undecided"
    assert found.status == wanted
    assert (found.status == "undecided") == ("not decided" in found.words())


def altered(coverage, visibility):
    """The same coverage with other visibilities, judged again by the letter of the task."""
    task = coverage.task
    enough = np.minimum(coverage.resolution, 1.0)
    product = np.where(visibility >= task.min_visibility, visibility, 0.0) * enough
    gates = ~np.isin(
        coverage.reason,
        [Reason.DEGENERATE, Reason.BACK_FACING, Reason.OUTSIDE, Reason.OUT_OF_FOCUS],
    )
    gates &= coverage.pixel_density >= task.min_pixel_density
    gates &= coverage.incidence <= np.radians(task.max_incidence_deg)
    return gates & (product >= task.min_coverage) & (product > 0)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.integers(0, 10_000),
    st.floats(0, 0.4),
    st.floats(0, 1),
    st.floats(20, 90),
    st.floats(0, 15),
)
def test_what_is_certain_and_possible_encloses_every_visibility_within_the_bound(
    seed, size, least, angle, density
):
    rng = np.random.default_rng(seed)
    mesh = shapes.room(2)
    poses = rc.look_at(rng.uniform((-1, -1, 0.5), (1, 1, 2.5), (3, 3)), (0, 0, 0.4))
    camera = rc.Camera(width=64, height=48, fx=30, fy=30)
    task = rc.Task(
        min_pixels=20,
        min_visibility=least,
        max_incidence_deg=angle,
        min_pixel_density=density,
        min_coverage=0.3,
    )
    coverage = rc.evaluate(mesh, camera, poses, task)
    bound = rng.uniform(0, size, coverage.visibility.shape)
    widened: Coverage = replace(coverage, visibility_bound=bound)
    certain, possible = certain_and_possible(widened)
    covered = coverage.reason == Reason.COVERED
    assert (certain <= covered).all()
    assert (covered <= possible).all()
    low = np.maximum(coverage.visibility - bound, 0)
    high = np.minimum(coverage.visibility + bound, 1)
    assert (certain == altered(coverage, low)).all()
    assert (possible == altered(coverage, high)).all()


def test_a_network_is_measured_as_an_objective_counts_it():
    mesh, camera = shapes.room(4), rc.Camera(width=64, height=48, fx=30, fy=30)
    poses = rc.look_at([(2, 2, 2.5), (-2, -2, 2.5), (2, -2, 2.5)], (0, 0, 0.5))
    with rc.open_observer(mesh, camera) as observer:
        objective = Objective.of(observer, rc.Task(min_pixels=1), views={"crates": 2})
        found = measured(objective, poses)
        assert found.share == objective.share_of(poses)
        assert found.curve[-1] == found.share
        assert (np.diff(found.curve) >= 0).all()
        assert (found.certain <= found.covered).all()
        assert (found.covered <= found.possible).all()
        told = found.network.summary()
        assert told["covered"]["faces"] == found.covered.sum()
        nothing = measured(objective, poses[:0])
    assert nothing.share == 0


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


def test_a_plan_without_a_transform_keeps_every_bit():
    np.testing.assert_array_equal(placed("").vertices, shapes.by_name("box").vertices)
