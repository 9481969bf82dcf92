"""Attack on the page: what it computes of a rig is what the program says of it.

Texts of numbers are those of `attack_texts`, and files of meshes are whole and cut short. Rigs of
random scenes are edited by the modules of the page, in Node with its engine, and by Python:
pinholes, lenses and panoramas, rigs with a rule, plans with goals, and lamps, for which the page
asks the program. Covered area with its bound, figures of each camera, states of goals, dead zones
with their reasons and words, reasons of faces in words, and advice: none may differ. Both have the
pieces of one engine; sums in another order, and roots of another library, may differ by `REL`.
"""

import base64
import json
import math
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import attack_texts
import numpy as np
from attack_reasons import placed_by, scene
from edited import NODE, Session
from goals_to_view import session_in
from mesh_files import VALID
from page_in_node import PAGE, runner_in
from rigs_to_view import acted, moved
from rows import Report

import rastercov as rc
from rastercov.base.errors import RastercovError
from rastercov.core.area.network import AreaNetwork
from rastercov.core.camera.rig import Rig
from rastercov.page import measurements
from rastercov.page.live import open_live, record_cause
from rastercov.page.rig_state import RigState
from rastercov.page.scene import Scene
from rastercov.page.session import remove_head

RIGS = 500
TEXTS = 20_000
PARTS_OF_FILE = 9
"""Each file is read at each of these ends."""
ONCE_WRONG = (13, 16, 17, 63)
"""Seeds of a small part: heads that do not count, closed bodies, a rule with bounds, and advice."""
EDITS = 2
"""Edits of each rig, after which it is compared again."""
FACES = 4
"""Faces of each rig whose reasons and advice are compared."""
REL = 1e-12
"""Part of a figure, and of the area, that is rounding of a sum of some thousand terms."""


class OneByOne(AreaNetwork):
    """Area by all cameras, added one by one, as `check` and the page add them."""

    def add(self, regions: rc.Regions) -> None:
        """Add the regions of further poses."""
        for own in np.eye(len(regions.pose_ids), dtype=np.bool_):
            super().add(regions.of_poses(own))


class Own(Session):
    """A session whose page has its engine."""

    def __init__(self, of_scene: Scene) -> None:
        super().__init__(of_scene)
        self.is_own = not record_cause(self, of_scene.start)
        self.more = {"engine": open_live(self).get("engine", "")} if self.is_own else {}


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 500 rigs."""
    if NODE is None:
        return
    attack_texts.attack(report, effort * TEXTS / attack_texts.CASES)
    compare_files(report)
    wrong, seen = Counter[str](), Counter[str]()
    one_by_one = patch.object(measurements, "AreaNetwork", OneByOne)
    with TemporaryDirectory() as folder, one_by_one:
        for seed in dict.fromkeys((*ONCE_WRONG, *range(round(RIGS * effort)))):
            compare(seed, Path(folder), wrong, seen)
    for name, n in sorted(seen.items()):
        report.add(f"page: {name}", n, "")
    for name in ("area", "cameras", "goals", "zones", "words of zones", "reasons", "advice"):
        report.add(f"page: {name} that differ", wrong[name], "", at_most=0)


def compare_files(report: Report) -> None:
    """Add what differs of files that the page and the program read."""
    ends = range(PARTS_OF_FILE + 1)
    cases = [
        (name, data[: len(data) * end // PARTS_OF_FILE])
        for name, data in VALID.items()
        if not name.endswith(("glb", "gltf"))
        for end in ends
    ]
    wrong = 0
    with TemporaryDirectory() as folder:
        node, path = runner_in(Path(folder)), Path(folder) / "files.json"
        path.write_text(json.dumps([(n, base64.b64encode(data).decode()) for n, data in cases]))
        for (name, data), said in zip(
            cases, node("readers.mjs", PAGE / "readers.wasm", path), strict=True
        ):
            target = Path(folder) / name
            target.write_bytes(data)
            try:
                mesh = rc.Mesh.load(target)
            except RastercovError as error:
                is_same = said == {"fault": name + str(error).partition(name)[2], "status": 400}
            else:
                corners = np.array(said.get("corners", []), float).reshape(-1, 3, 3)
                notes = [note.partition(f"{name}: ")[2] for note in mesh.notes]
                is_same = (
                    np.array_equal(corners, mesh.vertices[mesh.faces])
                    and said["groupOf"] == mesh.face_group.tolist()
                    and said["groups"] == [group.name for group in mesh.groups]
                    and said["notes"] == notes
                )
            wrong += not is_same
            if not is_same:
                print(f"file {name} of {len(data)} bytes: {said}")
    report.add("page: mesh files", len(cases), "")
    report.add("page: mesh files that differ", wrong, "", at_most=0)


def compare(seed: int, folder: Path, wrong: Counter[str], seen: Counter[str]) -> None:
    """Count what differs of one rig, and of the same after edits."""
    rng = np.random.default_rng([seed, 76])
    session = _session(rng, folder / str(seed))
    try:
        session.call("scene")
        for step in range(1 + EDITS):
            if step:
                _edit(session, rng)
            for name in _differences(session, rng, seen):
                wrong[name] += 1
                print(f"seed {seed}, step {step}: {name}")
        seen["rigs"] += 1
        seen["rigs that the program answers"] += not session.is_own
    finally:
        session.close()


def _session(rng: np.random.Generator, folder: Path) -> Own:
    """A session on a random rig."""
    if rng.random() < 0.2:
        folder.mkdir()
        eyes = rng.uniform((0.2, 0.2, 0.5), (3.8, 3.5, 2.5), (int(rng.integers(1, 4)), 3))
        made, _ = session_in(folder, eyes)
        made.close()
        return Own(made.scene)
    mesh, camera, poses, task = scene(rng)
    if rng.random() < 0.4:
        task = rc.Task(**{name: getattr(task, name) for name in _LIMITS}, views=2)
    rig = camera if isinstance(camera, Rig) else Rig([camera], ["eye"])
    if rng.random() < 0.1 and not rig.gates:
        lamps = rc.Lamps([rc.Lamp.spot(12, intensity=float(rng.uniform(20, 200)))], poses[:1])
        rig = rig._equip("lamps", lamps)
        task = rc.Task(min_illuminance=float(rng.uniform(1, 20)))
    return Own(Scene("scene", mesh, RigState.of(rig, placed_by(camera, poses), task=task)))


_LIMITS = ("max_incidence_deg", "min_facing_density", "min_pixels_per_m2")


def _edit(session: Own, rng: np.random.Generator) -> None:
    """A random edit by the page."""
    state = session.call("state")
    station = state["stations"][rng.integers(len(state["stations"]))]
    kind = rng.integers(3)
    if kind == 0:
        size = 0.05 * session.scene.mesh.diagonal
        pose = moved(station["pose"], rng.normal(0, size, 3))
        acted(session, do="pose", station=station["id"], pose=pose)
    elif kind == 1:
        acted(session, do="switch", station=station["id"], is_on=not station["is_on"])
    else:
        angle = round(float(rng.uniform(40, 85)), 1)
        acted(session, do="task", changes={"max_incidence_deg": angle})


def _differences(session: Own, rng: np.random.Generator, seen: Counter[str]) -> set[str]:
    """Names of what differs."""
    head, _ = acted(session)
    answers = session.now()
    told = answers.answer("frame", mode="reason", options={}, station=None)
    summary, expected = head["summary"], remove_head(told)[0]["summary"]
    total, found = float(np.asarray(session.scene.mesh.areas).sum()), set()
    for name, of in (("area", "covered_area"), ("cameras", "by_camera"), ("goals", "required")):
        one, same = (_stripped(own[of]) for own in (summary, expected))
        if not _alike(one, same, total):
            found.add(name)
            print(f"  page:    {one}\n  program: {same}")
    zones, wanted = session.call("zones"), session.zones()
    seen["zones"] += len(wanted)
    if len(zones) != len(wanted):
        found.add("zones")
    for one, same in zip(zones, wanted, strict=False):
        words = one.pop("words"), same.pop("words")
        if words[0] != words[1]:
            found.add("words of zones")
            print(f"  page:    {words[0]}\n  program: {words[1]}")
        if not _alike(one, same, total):
            found.add("zones")
            print(f"  page:    {one}\n  program: {same}")
    return found | _of_faces(session, rng, seen)


def _stripped(entries: object) -> object:
    """Entries of a summary without those of results by face, which a page has none of."""
    if isinstance(entries, list):
        return [_stripped(each) for each in entries]
    assert isinstance(entries, dict)
    return {name: each for name, each in entries.items() if name not in ("faces", "asked")}


def _of_faces(session: Own, rng: np.random.Generator, seen: Counter[str]) -> set[str]:
    """Differences of reasons, words and advice of faces."""
    mesh, found = session.moment.mesh, set()
    faces = np.flatnonzero(mesh.task_mask & (np.asarray(mesh.areas) > 0))
    for face in rng.choice(faces, min(FACES, len(faces)), replace=False).tolist():
        told, served = session.call("why", face), session.why(face)
        seen["faces"] += 1
        if told["words"] != served["words"]:
            found.add("reasons")
            print(f"  page:    {told['words']}\n  program: {served['words']}")
        for one, same in zip(told["cameras"], served["cameras"], strict=True):
            seen["reasons of faces"] += 1
            for name, kind in (("reason", "reasons"), ("words", "reasons"), ("help", "advice")):
                if one[name] != same[name]:
                    found.add(kind)
                    print(f"  page:    {one[name]}\n  program: {same[name]} of face {face}")
    return found


def _alike(one: object, same: object, total: float) -> bool:
    """True of equal entries; numbers may differ by the rounding of sums and of roots."""
    if isinstance(same, dict) and isinstance(one, dict):
        return one.keys() >= same.keys() and all(
            _alike(one[name], each, total) for name, each in same.items()
        )
    if isinstance(same, list) and isinstance(one, list):
        return len(one) == len(same) and all(
            _alike(*each, total) for each in zip(one, same, strict=True)
        )
    if isinstance(same, float) and isinstance(one, float | int):
        return math.isclose(one, same, rel_tol=REL, abs_tol=REL * max(1.0, total))
    return one == same
