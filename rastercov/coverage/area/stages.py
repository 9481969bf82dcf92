"""Parts that no camera covers, divided by the criterion that fails last in any camera: exact.

A point passes a criterion where a camera, or the cameras of a rig with a rule, meet it and all
before it, in the order of `rastercov.coverage.reasons.ORDER`. What passes is the union of regions
without the later criteria, so that reasons have borders like covered areas, with bounds. The order
of cameras does not matter.

`rastercov.reference.reasons` has the same for single points.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rastercov.base.memory import BoolArray, ByteArray, FloatArray, Int32Array, IntArray
from rastercov.camera.pose import Poses
from rastercov.camera.rig import (
    Cameras,
    by_gate,
    cameras_of,
    eyes_of,
    rows_of_result,
)
from rastercov.coverage.area import polygons
from rastercov.coverage.area.features import FEATURES
from rastercov.coverage.area.frames import frames_of, sides_of
from rastercov.coverage.area.overlay import Overlay
from rastercov.coverage.area.regions import RegionPass
from rastercov.coverage.area.rows import gated, tasks_of
from rastercov.coverage.area.union import Covered, RegionUnion
from rastercov.coverage.coverage import in_batches
from rastercov.coverage.reasons import Reason
from rastercov.coverage.surface import own_reasons
from rastercov.coverage.task import Task
from rastercov.mesh import Mesh

INCIDENCE = {"max_incidence": np.pi / 2, "cos_incidence": 0.0, "tan_incidence": 0.0}
DENSITIES = dict.fromkeys(("min_pixel_density", "min_facing_density", "min_pixels_per_m2"), 0.0)
FOCUS = {"z_n": 0.0, "z_f": np.inf}
OF_SURFACE = 255
"""In place of the criteria of the surface itself, see `rastercov.coverage.surface`."""
SLIVER_REL = 1e-9
"""Part of a face below which a reason is rounding, and takes that of most of the face."""


COLUMNS = ("xy", "face", "views", "reason")


class Parts(NamedTuple):
    """Convex pieces of faces in their planes, with the reason of each.

    Attributes
    ----------
    xy, starts, face, views
        As in `Covered`.
    reason : (N,) uint8
        Row of `REASONS`.
    """

    xy: FloatArray
    starts: IntArray
    face: Int32Array
    views: Int32Array
    reason: ByteArray

    def joined(self, other: "Parts") -> "Parts":
        """These pieces, then those of another."""
        counts = np.concatenate([np.diff(self.starts), np.diff(other.starts)])
        own = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in COLUMNS
        }
        return Parts(starts=polygons.starts_of(counts), **own)


class Stage(NamedTuple):
    """Criteria that come before a reason: what passes them has this reason, or a later one."""

    reason: int
    camera: Cameras
    task: Task
    relaxed: Mapping[str, float] | None
    hides: bool


def divided(
    mesh: Mesh,
    rest: Parts,
    stages: Iterator[Stage],
    passes: Callable[[Stage, BoolArray], Covered],
    of_surface: ByteArray,
) -> tuple[Parts, FloatArray]:
    """Pieces that no camera covers, (N,), in parts of one reason, and (F,) bounds of their areas.

    `rest` are these pieces, ordered by face, as of `with_rest`; `passes` gives what passes a stage
    of some faces, (F,), and `of_surface` the reasons of the surface itself, (F,).
    """
    frames = frames_of(mesh)
    own = polygons.polygon_areas(rest.xy, rest.starts)
    missing: FloatArray = np.bincount(rest.face, own, mesh.n_faces).astype(np.float64)
    overlay, number = Overlay(frames.corners, frames.areas, mesh.diagonal), 0
    faces = np.flatnonzero(missing).astype(np.int32)
    _add(overlay, number, (rest.xy, rest.starts, rest.face), faces, missing[faces])
    reasons, doubt = [int(Reason.BACK_FACING)], np.zeros(mesh.n_faces)
    is_open = missing > 0
    for stage in stages:
        passed = passes(stage, is_open)
        doubt += passed.bound
        rows = np.flatnonzero(is_open[passed.face])
        pieces = *polygons.chosen(passed.xy, passed.starts, rows), passed.face[rows]
        listed = np.flatnonzero(is_open & (passed.area[0] > 0)).astype(np.int32)
        number += 1
        _add(overlay, number, pieces, listed, passed.area[0][listed])
        reasons.append(stage.reason)
        # A face that passes as a whole has this reason, or a later one, all over.
        is_open &= passed.area[0] < (1 - SLIVER_REL) * frames.areas
    whole = overlay.partition()
    kept = np.flatnonzero((whole.tag & 1 > 0) & (whole.area > 0))
    # The latest stage is the first that was added, of the lowest bit above that of the rest.
    bits = whole.tag[kept] >> 1
    latest = np.zeros(len(kept), np.int64)
    for row in range(number, 0, -1):
        latest[(bits >> (row - 1)) & 1 > 0] = row
    xy, starts = polygons.chosen(whole.xy, whole.starts, kept)
    none = np.zeros(len(kept), np.int32)
    why, face = np.array(reasons, np.uint8)[latest], whole.face[kept]
    of_surface = np.maximum(of_surface[face], Reason.OCCLUDED)
    of_surface[of_surface == Reason.COVERED] = Reason.OCCLUDED
    found = Parts(
        xy, starts, face, none, np.where(why == OF_SURFACE, of_surface, why).astype(np.uint8)
    )
    return _without_slivers(found, doubt + SLIVER_REL * frames.areas), doubt


def _add(
    overlay: Overlay,
    number: int,
    pieces: tuple[FloatArray, IntArray, Int32Array],
    faces: Int32Array,
    areas: FloatArray,
) -> None:
    """Add pieces, ordered by face, as those of the camera of a number."""
    zero, row = np.zeros(len(faces)), np.zeros(len(pieces[2]), np.int32)
    pairs = np.zeros(len(faces), np.int32), faces, areas, zero, zero
    overlay.add((*pieces, row), pairs, np.array([number]))


def _without_slivers(parts: Parts, doubt: FloatArray) -> Parts:
    """Parts in which reasons that are less of a face than is certain, (F,), are that of most."""
    areas = polygons.polygon_areas(parts.xy, parts.starts)
    keys, own = np.unique(parts.face * np.int64(256) + parts.reason, return_inverse=True)
    size, face = np.bincount(own, areas, len(keys)), keys // 256
    order = np.lexsort((size, face))
    last = np.flatnonzero(np.diff(face[order], append=-1))
    most = np.repeat(keys[order][last] % 256, np.diff(last, prepend=-1))
    reason = np.empty(len(keys), np.uint8)
    reason[order] = np.where(size[order] > doubt[face[order]], keys[order] % 256, most)
    return parts._replace(reason=reason[own])


def stages_of(mesh: Mesh, camera: Cameras, task: Task) -> Iterator[Stage]:
    """Stages of the criteria that are asked for, the latest reason first."""
    for each in reversed(FEATURES):
        for reason, camera, task in each.stages(camera, task):  # noqa: B020 - the rest
            yield Stage(reason, camera, task, None, hides=True)
    tasks = tasks_of(camera, task)
    if any((own_reasons(mesh, each) > Reason.COVERED).any() for each in tasks):
        yield Stage(OF_SURFACE, camera, task, {}, hides=True)
    rules = [each.rules(own) for own, each in zip(cameras_of(camera), tasks, strict=True)]
    if any(each.cos_incidence > 0 for each in rules):
        yield Stage(Reason.TOO_OBLIQUE, camera, task, INCIDENCE, hides=True)
    relaxed = INCIDENCE
    yield Stage(Reason.OCCLUDED, camera, task, relaxed, hides=False)
    if any(getattr(each, name) > 0 for each in rules for name in DENSITIES):
        relaxed = relaxed | DENSITIES
        yield Stage(Reason.TOO_COARSE, camera, task, relaxed, hides=False)
    if any(each.z_n > 0 or each.z_f < np.inf for each in rules):
        yield Stage(Reason.OUT_OF_FOCUS, camera, task, relaxed | FOCUS, hides=False)
    yield Stage(Reason.OUTSIDE, camera, task, None, hides=False)


def passes(mesh: Mesh, poses: Poses, stage: Stage, asked: BoolArray) -> Covered:
    """Area of faces, (F,), that passes all criteria before the reason of a stage."""
    if stage.reason == Reason.OUTSIDE:
        union = RegionUnion(mesh)
        union.fill(any_in_front(mesh, stage.camera, poses, asked))
        return union.covered()
    scene = mesh if stage.hides else without_occlusion(mesh)
    own = stage.camera, stage.task
    return united(RegionPass(scene, *own, only_task=True, relaxed=stage.relaxed), poses, asked)


def without_occlusion(mesh: Mesh) -> Mesh:
    """The mesh, of which nothing hides anything."""
    groups = (replace(group, is_occluder=False, is_target=True) for group in mesh.groups)
    return mesh._with_flags(tuple(groups))


def united(finder: RegionPass, poses: Poses, asked: BoolArray) -> Covered:
    """Area of faces, (F,), that any row of the result covers; the pass is closed."""
    union, mesh, camera = RegionUnion(finder.mesh), finder.mesh, finder.camera
    rows = rows_of_result(camera, poses)
    with closing(finder):
        for part in in_batches(poses, mesh.n_faces, finder.threads, rows):
            union.add(gated(finder.find(part, closed=union.closed | ~asked), camera, part))
    return union.covered()


def any_in_front(mesh: Mesh, camera: Cameras, poses: Poses, asked: BoolArray) -> BoolArray:
    """(F,) faces of which enough cameras of a row of the result are in front, not edge-on."""
    frames, eyes = frames_of(mesh), eyes_of(camera, poses)
    found = np.zeros(mesh.n_faces, np.bool_)
    for gate, own, _ in by_gate(camera, poses):
        for rows in own:
            left = np.flatnonzero(asked & ~found)
            sides = sides_of(eyes[rows], frames.origin[left], frames.normal[left])
            front, rear = (side[0] if gate is None else gate.holds(side) for side in sides)
            found[left] = front | (rear & mesh.two_sided_mask[left])
    return found
