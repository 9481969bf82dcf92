"""Shadows that are swept over directions or places: what all of them leave, and what some do."""

from dataclasses import replace
from typing import Any

import numpy as np

from rastercov.base import BoolArray, FloatArray, read_only
from rastercov.core.area.regions import GAP_REL, RegionPass
from rastercov.core.area.table import Criteria, Regions
from rastercov.core.camera import Poses
from rastercov.core.camera.pose import pinhole_numbers
from rastercov.core.coverage.task import Task
from rastercov.core.mesh import Mesh
from rastercov.engine import solver_tolerance

MARGINS = read_only(np.ones(6))
"""Factors on the margins of the criteria, by `engine::Margins`: tests lessen them, to see that
draws then find violations."""


def swept(
    finder: RegionPass, poses: Poses, seen: Regions, is_asked: BoolArray, tangent: float
) -> FloatArray:
    """Areas of faces by discs of parallel rays about the axes of poses, (P, F, 3), m^2.

    What all of a disc lights, at least and at most, and what some of it may light; 0 for faces that
    are not asked for. `finder` is of all faces `from_both_sides`, and `seen` are its regions;
    `tangent` is that of half the angle of the disc.
    """
    camera = finder.cameras[0]
    criteria = Criteria(pinhole_numbers(camera), Task().rules(camera), GAP_REL)
    matrices = read_only(poses.world_from_camera, np.float64)
    mounts = matrices, read_only(np.zeros((len(poses), 3))), 0.0, MARGINS
    planes, table = finder._planes(is_asked), table_of(seen)
    values: FloatArray = solver_tolerance.sweep(
        finder._surface, planes, criteria, mounts, table, tangent, finder.threads
    )
    return values.reshape(len(poses), finder.mesh.n_faces, 3)


def table_of(regions: Regions) -> tuple[Any, ...]:
    """Regions as a record of the engine."""
    every = np.arange(len(regions.pose_ids) + 1)
    return (
        read_only(regions.xy, np.float64),
        read_only(regions.starts, np.int64),
        read_only(regions.face, np.int32),
        read_only(np.searchsorted(regions.pose, every), np.int64),
        read_only(regions.pair_face, np.int32),
        read_only(regions.excess, np.float64),
        read_only(np.searchsorted(regions.pair_pose, every), np.int64),
    )


def from_both_sides(mesh: Mesh) -> Mesh:
    """The mesh with all faces evaluated, from both sides; targets still occlude nothing."""
    groups = tuple(replace(each, is_occluder=False, is_two_sided=True) for each in mesh.groups)
    return mesh._with_flags(groups)
