"""The cross table: rules x equipment x motion, by area and points, in memory, shards and callers.

Small random scenes are held against the judge of points in `rastercov.reference.regions`, and the
callers against each other to the bit. A case of the test is a rule, equipment and a motion; in each
scene of it, every way to the same figures is taken.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from nightly import IS_NIGHTLY, examples
from of_features import of_features
from plans import write_obj
from scenes import joined
from surface_cases import NO_POINTS, in_regions, moved

import rastercov as rc
from rastercov.core.area import remedies
from rastercov.core.area.cells import cells
from rastercov.core.area.network import AreaNetwork
from rastercov.core.area.rows import with_rule
from rastercov.core.area.stages import CentrePass, failures_of_rows
from rastercov.core.area.table import join as joined_regions
from rastercov.core.camera.rig import Rig
from rastercov.core.coverage import shards
from rastercov.core.coverage import task as surface
from rastercov.core.coverage.shards import EvaluationShards, Wanted, open_for
from rastercov.core.coverage.task import Reason
from rastercov.core.mesh import Mesh
from rastercov.motion.over_time import TimeAreas
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.page.session import Session
from rastercov.placement.plan.file import Plan, plan_of
from rastercov.placement.plan.phases import PlanPhases, phases_of
from rastercov.placement.plan.scene import name_scene
from rastercov.reference.regions import points_on, rig_covers_points
from rastercov.shards import Staff

RULES, MOTIONS = ("any", "all", "at_least"), ("still", "moving")
CROSSED = {"none": lambda rng: {}} | of_features("CROSSED")
"""Entries of equipment of a plan, by its kind."""
N_POINTS = 300
PER_CASE, AT_NIGHT = 5, 277
"""Scenes of each of 18 cases beside that of all: some 100 by day, 5,000 at night."""
PLACED = 1 if IS_NIGHTLY else 3
"""One scene in so many is placed: the search is most of the time of a scene."""
ROUNDING_REL = 1e-12
"""Of the square of the diagonal, that areas of unions in other batches may differ by."""
MOST_BORDER_POINTS = 1
"""Points that lie on a border to rounding, besides those within the bound."""


class Case(NamedTuple):
    """A scene as a plan has it, the places of its rig, and its phases where bodies move."""

    plan: Plan
    mesh: Mesh
    places: np.ndarray
    phases: PlanPhases | None

    @property
    def motion(self):
        """Motion of bodies that move."""
        return None if self.phases is None else self.phases.motion

    @property
    def given(self):
        """Arguments of calls for a scene of several phases."""
        return (
            {} if self.phases is None else {"motion": rc.MotionQuery(self.motion, self.phases.over)}
        )

    @property
    def rig(self) -> Rig:
        """The rig alone: the first camera of the plan is the kind that it is made of."""
        return self.plan.rig._only(range(1, len(self.plan.rig)))

    @property
    def placed(self):
        """Poses of its cameras among those of the plan."""
        poses = self.rig.poses(self.places)
        return rc.Poses.of(poses.world_from_camera, camera=poses.camera + 1)

    @property
    def scene(self):
        """Camera, poses and task, as the calls take them."""
        return self.rig, self.rig.poses(self.places), self.plan.build_task()


def rotation(rng):
    result = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return result * np.sign(np.linalg.det(result))


def parts(rng):
    """A turned box, a sheet with two sides, often seen edge-on, and a plate before them."""
    box = rc.shapes.box(rng.uniform(0.4, 1.2, 3))
    sheet = Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    plate = rc.shapes.box((*rng.uniform(0.3, 1.2, 2), 0.02))
    centres = rng.uniform(-0.6, 0.6, (2, 3)), rng.normal(size=3)
    centres = [*centres[0], 1.6 * centres[1] / np.linalg.norm(centres[1])]
    return [
        Mesh(each.vertices @ rotation(rng).T + at, each.faces)
        for each, at in zip((box, sheet, plate), centres, strict=True)
    ]


def table_of(rng, rule, equipment, motion):
    """Entries of a plan: a rig of two or three cameras, equipment, and two or three frames."""
    n = int(rng.integers(2, 4))
    across = np.linspace(-0.5, 0.5, n) * rng.uniform(0.3, 2.5)
    cameras = [
        {"camera": "cam", "name": f"c{row}", "translation": [x, float(rng.uniform(-0.2, 0.2)), 0.0],
         "angle_deg": -float(np.degrees(np.arctan2(x, 3.5)))}
        for row, x in enumerate(across.tolist())
    ]  # fmt: skip
    own = {"k": int(rng.integers(1, n + 1))} if rule == "at_least" else {}
    own |= {"needs": ["c1"]} if rule == "at_least" and rng.random() < 0.3 else {}
    table = {
        "meshes": [{"path": "cell.obj", "groups": ["part", "sheet"], "two_sided": ["sheet"]}],
        "cameras": {"cam": {"width": 200, "height": 160, "fx": 190, "fy": 190}},
        "rigs": {"head": {"rule": rule, "cameras": cameras, **own}},
        "task": {"max_incidence_deg": 80.0, "resolution_of_result": 0.6, "by": "area"},
        "candidates": [{"generator": "poses", "file": "rig.json", "cameras": ["head"]}],
        "selection": {"goal": "best_coverage", "cameras": 2 * n},
        "outputs": {"page": False},
    }
    table |= CROSSED[equipment](rng)
    if motion == "moving":
        steps, (degrees, way) = int(rng.integers(2, 4)), rng.uniform((20, -2), (300, 2)).tolist()
        table["task"]["over"] = str(rng.choice(["some", "all"]))
        table["motion"] = {
            "turntable": {"body": str(rng.choice(["part", "sheet"])), "steps": steps,
                          "axis": rng.normal(size=3).tolist(), "degrees": degrees},
            "conveyor": {"body": "plate", "steps": steps,
                         "direction": rng.normal(size=3).tolist(), "distance": way},
        }  # fmt: skip
    return table


def case_of(rng, folder, *kinds):
    part, sheet, plate = parts(rng)
    firsts = {"part": 0, "sheet": part.n_faces, "plate": part.n_faces + sheet.n_faces}
    write_obj(folder / "cell.obj", joined(part, sheet, plate), firsts)
    eyes = rng.normal(size=(2, 3))
    eyes *= 3.5 / np.linalg.norm(eyes, axis=1)[:, None]
    places = rc.look_at(eyes, rng.uniform(-0.2, 0.2, (2, 3)), up=(0.1, 0.2, 1))
    rc.write_poses(folder / "rig.json", places)
    plan = plan_of(table_of(rng, *kinds), folder / "plan.toml")
    mesh, plan, _ = name_scene(plan)
    return Case(plan, mesh, places, phases_of(plan, mesh))


def is_near_level(task, mesh):
    """A criterion of the surface itself: where it is up to 60 degrees off level, it fails."""
    return np.abs(mesh.normals[:, 2]) > 0.5


# The answer, once for all callers.


def evaluated(case, scene, folder=None):
    """Coverage over time, or of bodies at rest, as `rc` has it: its exact area."""
    if case.motion is None:
        return rc.evaluate(case.mesh, *scene, by="area", fields=()).areas
    own = {"fields": (), "shards": folder} | case.given
    return rc.evaluate(case.mesh, *scene, **own).over_time.areas


def in_shards(case, folder):
    """Regions of rows by way of shards of one pose of the rig, and their area in those batches."""
    rig, poses, task = case.scene
    wanted, areas, parts = Wanted(rc.Engine(), by_area=True), AreaNetwork(case.mesh, task), []
    with open_for(case.mesh, rig, task, wanted) as observer:
        evaluation_shards = EvaluationShards(folder, observer, poses, task, wanted)
        for batch in evaluation_shards.parts(Staff()):
            parts.append(with_rule(batch.regions, rig, batch.poses))
            areas.add(parts[-1])
    assert len(parts) == len(case.places)
    return joined_regions(parts), areas


def regions_of(case):
    return rc.regions(case.mesh, *case.scene, **case.given)


def pieces_of(regions):
    """Rows, faces and polygons of pieces; their order is by sides of the faces in a batch."""
    ends = zip(regions.pose, regions.face, regions.starts[:-1], regions.starts[1:], strict=True)
    return sorted((row, face, regions.xy[at:end].tobytes()) for row, face, at, end in ends)


def assert_same(one, other):
    """Covered areas of faces, equal to the bit."""
    assert one.covered.area.tobytes() == other.covered.area.tobytes()


def assert_same_in_batches(one, other):
    """The same where rows were united in other batches: corners of unions are rounded in turn."""
    off = np.abs(one.covered.area - other.covered.area)
    assert (off <= ROUNDING_REL * one.mesh.diagonal**2).all(), off.max()


def frames_of(case, points, face):
    """Mesh and points of each frame, moved by hand."""
    if case.motion is None:
        return [(case.mesh, points)]
    return [moved(case.motion, row, points, face) for row in range(len(case.motion))]


def assert_regions_are_as_judged(case):
    points, face = points_on(case.mesh, N_POINTS)
    rig, _, task = case.scene
    regions = regions_of(case)
    truth = np.concatenate([
        rig_covers_points(mesh, rig, case.places, task, own, face)
        for mesh, own in frames_of(case, points, face)
    ])  # fmt: skip
    assert len(regions.pose_ids) == len(truth)
    bounds = regions.bounds().sum(axis=1) / case.mesh.areas.sum() * N_POINTS
    for row, (covered, expected) in enumerate(zip(truth, bounds, strict=True)):
        wrong = int((in_regions(regions, row, points, face) != covered).sum())
        most = MOST_BORDER_POINTS + expected + 6 * np.sqrt(expected)
        assert wrong <= most, f"row {row}: {wrong} points differ, {most:.2g} within the bound"


def assert_points_are_as_judged(case):
    """Centres of cells, which searches go by, and reasons of points, which reports go by."""
    rig, poses, task = case.scene
    for mesh, _ in frames_of(case, *NO_POINTS):
        own = cells(mesh, 0.35)
        points, face = own.vertices.reshape(-1, 3, 3).mean(axis=1), own.source_face
        truth = rig_covers_points(mesh, rig, case.places, task, points, face)
        result = CentrePass(own, rig, task).find(poses)
        reasons = failures_of_rows(mesh, rig, task, poses, points, face)
        for row, (covered, (_, reason, _)) in enumerate(zip(truth, reasons, strict=True)):
            assert np.flatnonzero(covered).tolist() == result.row(row).tolist(), f"row {row}"
            assert np.array_equal(reason == Reason.COVERED, covered), f"reasons of row {row}"


def assert_callers_agree(case, folder, is_placed):
    result, checked = (
        evaluated(case, case.scene),
        rc.check(case.plan, case.placed, min_coverage=0.5),
    )
    if case.motion is None:
        regions, areas = in_shards(case, folder / "shards")
        assert pieces_of(regions) == pieces_of(regions_of(case))
        assert_same_in_batches(result, areas)
        assert_same_in_batches(result, checked.cameras.areas)
    else:
        assert_same(result, evaluated(case, case.scene, folder / "shards"))
        assert_same(result, checked.cameras.areas)
    assert_viewer_agrees(case)
    if is_placed and checked.cameras.areas.summary()["m2"] > 0:
        placed = rc.place(case.plan).cameras
        again = rc.check(case.plan, placed.placed, min_coverage=0.5)
        assert_same(placed.areas, again.cameras.areas)


def assert_viewer_agrees(case):
    """The page counts by the rule of the rig, in each frame by itself."""
    rig, poses, task = case.scene
    state = RigState.of(rig, poses, task=task)
    session = Session(Scene("cell", case.mesh, state, phases=case.phases))
    for row in range(1 if case.motion is None else len(case.motion)):
        mesh = case.mesh if case.motion is None else case.motion.frame(row)[0]
        shown = session.of(at=() if case.motion is None else (float(row),))
        assert_same(shown.areas().network, rc.evaluate(mesh, rig, poses, task, by="area").areas)
    session.close()


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("equipment", CROSSED)
@pytest.mark.parametrize("rule", RULES)
@settings(examples(PER_CASE, AT_NIGHT), phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(seed=st.integers(0, 2**32 - 1))
@example(seed=71552)  # rows seen from one side, among others seen from both
def test_all_ways_to_a_figure_agree_with_points_and_with_each_other(rule, equipment, motion, seed):
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        case = case_of(np.random.default_rng(seed), folder, rule, equipment, motion)
        # A shard has one pose of the rig, or one frame.
        n_poses = len(case.rig) * (1 if case.motion is None else len(case.places))
        patch.setattr(shards, "PAIRS_A_SHARD", n_poses * case.mesh.n_faces)
        # Zones and advice are most of a check, and are not judged here.
        patch.setattr(remedies, "PLACES", 4)
        for kind in () if IS_NIGHTLY else (AreaNetwork, TimeAreas):
            patch.setattr(kind, "dead_zones", lambda *network: {})
        if seed % 3 == 0:
            patch.setitem(surface.OWN_CRITERIA, "out_of_focus", is_near_level)
        assert_regions_are_as_judged(case)
        assert_points_are_as_judged(case)
        assert_callers_agree(case, folder, is_placed=seed % PLACED == 0)
