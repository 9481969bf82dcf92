"""Camera placement: from a mesh to candidate poses, and from many poses to a few.

    segment -> per_segment, on_walls, ... -> filter_candidates -> build_matrix -> problem_of
    -> select_greedy -> optimise, refine -> tolerance, what_is_left -> openings

`rastercov.place` takes all these steps from a plan.
"""

from rastercov.base.typed import guard as _guard
from rastercov.core.mesh.solids import in_solid
from rastercov.placement.bits import CoveredBits
from rastercov.placement.candidates.cavities import Access, Openings, openings
from rastercov.placement.candidates.clearance import (
    KeepOut,
    KeepOutBox,
    KeepOutSphere,
    NearestSurface,
    Place,
    filter_candidates,
)
from rastercov.placement.candidates.mounting import (
    along,
    at_middle,
    at_nearest_surface,
    at_point,
    in_room,
    on_box,
    on_ceiling,
    on_hemisphere,
    on_sphere,
    on_walls,
)
from rastercov.placement.candidates.pool import (
    Candidates,
    Framing,
    from_poses,
    per_face,
    per_segment,
)
from rastercov.placement.candidates.rooms import Room
from rastercov.placement.candidates.segments import Segmentation, segment
from rastercov.placement.improve.objective import CellObjective, Objective
from rastercov.placement.improve.pose_space import PoseSpace
from rastercov.placement.improve.refine import Refined, refine
from rastercov.placement.improve.search import Optimised, optimise
from rastercov.placement.matrix import VisibilityMatrix, build_matrix
from rastercov.placement.select.greedy import select_greedy
from rastercov.placement.select.integer import select_integer
from rastercov.placement.select.problem import (
    BestCoverage,
    FewestCameras,
    Problem,
    Selection,
    problem_of,
    problem_of_matrix,
)
from rastercov.placement.uncovered import Leftover, Sight, what_is_left
from rastercov.robots.arm import Arm, on_arm
from rastercov.survey.facade import facade
from rastercov.survey.orbit import Circles, orbit
from rastercov.survey.strips import Survey, strips
from rastercov.tolerances.installation import InstallationError
from rastercov.tolerances.placement import Tolerance, tolerance

__all__ = [
    "Access",
    "Arm",
    "BestCoverage",
    "Candidates",
    "CellObjective",
    "Circles",
    "CoveredBits",
    "FewestCameras",
    "Framing",
    "InstallationError",
    "KeepOut",
    "KeepOutBox",
    "KeepOutSphere",
    "Leftover",
    "NearestSurface",
    "Objective",
    "Openings",
    "Optimised",
    "Place",
    "PoseSpace",
    "Problem",
    "Refined",
    "Room",
    "Segmentation",
    "Selection",
    "Sight",
    "Survey",
    "Tolerance",
    "VisibilityMatrix",
    "along",
    "at_middle",
    "at_nearest_surface",
    "at_point",
    "build_matrix",
    "facade",
    "filter_candidates",
    "from_poses",
    "in_room",
    "in_solid",
    "on_arm",
    "on_box",
    "on_ceiling",
    "on_hemisphere",
    "on_sphere",
    "on_walls",
    "openings",
    "optimise",
    "orbit",
    "per_face",
    "per_segment",
    "problem_of",
    "problem_of_matrix",
    "refine",
    "segment",
    "select_greedy",
    "select_integer",
    "strips",
    "tolerance",
    "what_is_left",
]

_guard(__name__)


_RETIRED = {
    "BitMatrix": "use VisibilityMatrix, which leaves the pairs of a folder on disk",
    "measure_matrix": "use build_matrix with a folder, which leaves the pairs on disk",
    "read_spaces": "use Mesh.load(path).spaces",
}
"""Names of the last version, and what to call instead."""


def __getattr__(name: str) -> object:
    if name in _RETIRED:
        raise ImportError(
            f"expected a name of rastercov.placement, got {name}, retired; {_RETIRED[name]}"
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
