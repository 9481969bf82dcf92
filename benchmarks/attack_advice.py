"""Attack on advice: what is said to help is carried out, and helps.

Advice of the zones of random scenes is read from its text, and done: the camera is turned, focused,
given a longer lens or moved, or another one is added. It must cover half of the zone, by the points
of `rastercov.reference.regions`; the area that all cameras cover together must not fall. And where
a search of `POSES` poses finds one that covers half of a zone above 1 % of the task, there must be
advice. Scenes are those of `attack_reasons`, without rigs.
"""

import re
from dataclasses import dataclass, field, replace

import numpy as np
from attack_reasons import scene
from rows import Report

import rastercov as rc
from rastercov.core.area.polygons import rows_at
from rastercov.core.area.stages import first_failures
from rastercov.core.coverage.task import Reason
from rastercov.reference.regions import covers_points, points_on

SCENES, POINTS, POSES = 80, 4_000, 1_000
ENOUGH, LEAST_PERCENT = 0.5, 1.0
SECOND = "add a second camera at the same place"
PLACE = r"\((-?[\d.]+), (-?[\d.]+), (-?[\d.]+)\) m"
SAID = (
    (rf"aim the camera at {PLACE}", "turn"),
    (rf"focus the camera at ([\d.]+) (m|mm) and aim it at {PLACE}", "focus"),
    (rf"give the camera ([\d.e+]+) times the focal length and aim it at {PLACE}", "longer"),
    (rf"move the camera [\d.]+ m?m to {PLACE} and aim it at {PLACE}", "move"),
    (rf"{SECOND}, aimed at {PLACE}", "turn"),
    (rf"{SECOND}, focused at ([\d.]+) (m|mm), aimed at {PLACE}", "focus"),
    (
        rf"{SECOND} with ([\d.e+]+) times the focal length, aimed at {PLACE}",
        "longer",
    ),
    (rf"add a camera at {PLACE}, aimed at {PLACE}", "move"),
)
"""Words of advice, and what is done."""


@dataclass
class Score:
    """Pieces of advice, and those that were wrong."""

    pieces: int = 0
    short: list[tuple[int, int]] = field(default_factory=list)
    """Seed and zone of those that cover less than half."""
    fell: list[tuple[int, int]] = field(default_factory=list)
    unread: list[tuple[int, int]] = field(default_factory=list)
    findable: int = 0
    silent: list[tuple[int, int]] = field(default_factory=list)
    """Zones for which a search finds a pose, and without advice."""


def attack(report: Report, effort: float) -> None:
    """Add the rows of this campaign; `effort` 1 is 80 scenes."""
    score = Score()
    for seed in range(max(3, round(SCENES * effort))):
        carry_out(seed, score)
    report.add("advice: pieces carried out", score.pieces, "pieces")
    share = len(score.short) / max(score.pieces, 1)
    report.add("advice: share that covers less than half of its zone", share, "", at_most=0.05)
    report.add("advice: makes the covered area smaller", len(score.fell), "", at_most=0)
    report.add("advice: cannot be read", len(score.unread), "", at_most=0)
    report.add("advice: zones for which a search finds a pose", score.findable, "zones")
    share = len(score.silent) / max(score.findable, 1)
    report.add("advice: share of these without", share, "", at_most=0.1)


def carry_out(seed: int, score: Score) -> None:
    """Do what is said for each zone of a scene, and search where nothing is."""
    rng = np.random.default_rng([seed, 59])
    mesh, camera, poses, task = scene(rng)
    if isinstance(camera, rc.Rig):
        camera = camera.cameras[0]
    result = rc.evaluate(mesh, camera, poses, task, by="area", fields=())
    zones, said = result.areas.zones(camera, poses), result.summary()["dead_zones"]
    points, face = points_on(mesh, POINTS, seed)
    n = sum(zone["percent"] >= LEAST_PERCENT for zone in said)
    rows = rows_at(zones, np.minimum(zones.zone, n).astype(np.int32), n + 1, face, points)
    before = float(result.covered.area[0][mesh.task_mask].sum())
    for row, zone in enumerate(said[:n]):
        own = np.flatnonzero(rows[:, row])
        if len(own) < 20:
            continue
        if zone["tried"] is None:
            poses_of = random_poses(mesh, zone, rng)
            if best_share(mesh, camera, task, poses_of, points[own], face[own]) >= ENOUGH:
                score.findable += 1
                score.silent.append((seed, row))
            continue
        score.pieces += 1
        score.findable += 1
        done = read(zone, camera, poses)
        if done is None:
            score.unread.append((seed, row))
            continue
        other, pose, replaced = done
        covers = covers_points(mesh, other, pose, task, points[own], face[own])
        if covers.mean() < ENOUGH:
            score.short.append((seed, row))
        if replaced is not None:
            kept = np.delete(poses, replaced, axis=0)
            parts = [rc.regions(mesh, other, pose, task)]
            parts += [rc.regions(mesh, camera, kept, task)] if len(kept) else []
            after = rc.unite(parts)
            loss = before - float(after.area[0][mesh.task_mask].sum())
            if loss > result.covered.bound.sum() + after.bound.sum() + 1e-9 * before:
                score.fell.append((seed, row))


def read(zone, camera: rc.Camera, poses):
    """Camera and pose of what is said for a zone, and the row of the pose that it replaces."""
    words = zone["tried"]["change"]
    for pattern, what in SAID:
        match = re.match(pattern, words)
        if match is None:
            continue
        named = zone["nearest"] and zone["nearest"]["pose"]
        is_moved = not words.startswith("add ")
        values = [float(each) for each in match.groups() if each not in ("m", "mm")]
        if what == "focus":
            camera = replace(camera, focus_distance=values[0] * (1e-3 if "mm" in match[0] else 1))
        elif what == "longer":
            camera = replace(camera, fx=camera.fx * values[0], fy=camera.fy * values[0])
        eye = values[:3] if what == "move" else poses[named, :3, 3]
        return camera, rc.look_at(eye, values[-3:]), named if is_moved else None
    return None


def random_poses(mesh: rc.Mesh, zone, rng: np.random.Generator):
    """Poses around a scene and within it that look at a zone."""
    low, high = mesh.bounds
    reach = 0.5 * (high - low).max()
    eyes = rng.uniform(low - reach, high + reach, (POSES, 3))
    eyes[::2] = rng.uniform(low, high, (len(eyes[::2]), 3))
    return rc.look_at(eyes, zone["centroid"])


def best_share(mesh, camera, task, poses, points, face) -> float:
    """Largest share of points that any pose covers."""
    some = np.unique(np.linspace(0, len(face) - 1, 40).astype(int))
    shares = (
        float((reason == Reason.COVERED).mean())
        for reason, _ in first_failures(mesh, camera, task, poses, points[some], face[some])
    )
    return max(shares)
