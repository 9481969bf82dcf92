"""Camera placement: from a mesh to candidate poses, and from many poses to a few.

    segment -> per_segment, on_walls, ... -> filter_candidates -> build_matrix -> problem_of
    -> select_greedy -> optimise, refine -> tolerance, what_is_left -> openings

`rastercov.place` takes all these steps from a plan.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING

if _TYPE_CHECKING:
    from rastercov.core.mesh.solids import in_solid as in_solid
    from rastercov.placement.bits import CoveredBits as CoveredBits
    from rastercov.placement.candidates.cavities import (
        Access as Access,
        Openings as Openings,
        openings as openings,
    )
    from rastercov.placement.candidates.rooms import (
        KeepOut as KeepOut,
        KeepOutBox as KeepOutBox,
        KeepOutSphere as KeepOutSphere,
        NearestSurface as NearestSurface,
        Place as Place,
        filter_candidates as filter_candidates,
    )
    from rastercov.placement.candidates.mounting import (
        along as along,
        at_middle as at_middle,
        at_nearest_surface as at_nearest_surface,
        at_point as at_point,
        in_room as in_room,
        on_box as on_box,
        on_ceiling as on_ceiling,
        on_hemisphere as on_hemisphere,
        on_sphere as on_sphere,
        on_walls as on_walls,
    )
    from rastercov.placement.candidates.pool import (
        Candidates as Candidates,
        Framing as Framing,
        from_poses as from_poses,
        per_face as per_face,
        per_segment as per_segment,
    )
    from rastercov.placement.candidates.rooms import Room as Room
    from rastercov.placement.candidates.segments import (
        Segmentation as Segmentation,
        segment as segment,
    )
    from rastercov.placement.improve.objective import (
        CellObjective as CellObjective,
        Objective as Objective,
    )
    from rastercov.placement.improve.pose_space import PoseSpace as PoseSpace
    from rastercov.placement.improve.refine import Refined as Refined, refine as refine
    from rastercov.placement.improve.refine import Optimised as Optimised, optimise as optimise
    from rastercov.placement.matrix import (
        VisibilityMatrix as VisibilityMatrix,
        build_matrix as build_matrix,
    )
    from rastercov.placement.select.methods import select_greedy as select_greedy
    from rastercov.placement.select.methods import select_integer as select_integer
    from rastercov.placement.select.problem import (
        BestCoverage as BestCoverage,
        FewestCameras as FewestCameras,
        Problem as Problem,
        Selection as Selection,
        problem_of as problem_of,
        problem_of_matrix as problem_of_matrix,
    )
    from rastercov.placement.uncovered import (
        Leftover as Leftover,
        Sight as Sight,
        what_is_left as what_is_left,
    )
    from rastercov.robots.arm import Arm as Arm, on_arm as on_arm
    from rastercov.survey.patterns import facade as facade
    from rastercov.survey.patterns import Circles as Circles, orbit as orbit
    from rastercov.survey.patterns import Survey as Survey, strips as strips
    from rastercov.tolerances.installation import InstallationError as InstallationError
    from rastercov.tolerances.placement import Tolerance as Tolerance, tolerance as tolerance

_NAMES = {
    "core.mesh.solids": "in_solid",
    "placement.bits": "CoveredBits",
    "placement.candidates.cavities": "Access Openings openings",
    "placement.candidates.mounting": "along at_middle at_nearest_surface at_point in_room on_box "
    "on_ceiling on_hemisphere on_sphere on_walls",
    "placement.candidates.pool": "Candidates Framing from_poses per_face per_segment",
    "placement.candidates.rooms": "KeepOut KeepOutBox KeepOutSphere NearestSurface Place Room "
    "filter_candidates",
    "placement.candidates.segments": "Segmentation segment",
    "placement.improve.objective": "CellObjective Objective",
    "placement.improve.pose_space": "PoseSpace",
    "placement.improve.refine": "Optimised Refined optimise refine",
    "placement.matrix": "VisibilityMatrix build_matrix",
    "placement.select.methods": "select_greedy select_integer",
    "placement.select.problem": "BestCoverage FewestCameras Problem Selection problem_of "
    "problem_of_matrix",
    "placement.uncovered": "Leftover Sight what_is_left",
    "robots.arm": "Arm on_arm",
    "survey.patterns": "Circles Survey facade orbit strips",
    "tolerances.installation": "InstallationError",
    "tolerances.placement": "Tolerance tolerance",
}
"""Modules and their public names; those of features are imported when they are asked for."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name in _HOME:
        from rastercov.base.typed import guarded_name

        result = globals()[name] = guarded_name(_import_module(f"rastercov.{_HOME[name]}"), name)
        return result
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
