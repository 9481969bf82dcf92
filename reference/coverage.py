"""Coverage with whole arrays: the twin of `rastercov.coverage_kernels`.

E. S. Eissa. Image Space Coverage Model. 2020, section 3.3.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rastercov.camera import Camera
from rastercov.coverage import FIGURES, Coverage
from rastercov.coverage_kernels import ROW_TYPES, PairRows
from rastercov.criteria import in_focus
from rastercov.mesh import Mesh
from rastercov.observation import Observation, visible_fraction
from rastercov.reference.criteria import face_geometry
from rastercov.task import Reason, Task

LARGEST_RESOLUTION = 1e300
"""Of one face; a smaller R_min gives no more."""


def figures_of_pose(
    mesh: Mesh,
    camera: Camera,
    task: Task,
    pose: NDArray[np.float64],
    seen: Observation,
    row: int,
) -> dict[str, NDArray[Any]]:
    """Every figure of one pose, by the names of `rastercov.coverage.FIGURES`."""
    geometry = face_geometry(mesh, camera, pose)
    visibility, bound, kind = visible_fraction(geometry, seen, row)
    drawn = seen.drawn_pixels[row]
    with np.errstate(over="ignore"):  # for the least R_min; sums over faces stay finite
        resolution = np.minimum(drawn / task.min_pixels, LARGEST_RESOLUTION)
    limits = camera.depth_of_field(task.max_blur)
    figures: dict[str, NDArray[Any]] = {
        "in_view": geometry.in_view,
        "in_view_fraction": geometry.in_view_fraction,
        "projected_area": geometry.projected_area,
        "visible_pixels": seen.visible_pixels[row],
        "drawn_pixels": drawn,
        "resolution": resolution,
        "pixel_density": geometry.pixel_density,
        "in_focus": in_focus(geometry.depth, limits, task.focus_rule),
        "visibility": visibility,
        "visibility_bound": bound,
        "visibility_kind": kind,
        "incidence": geometry.incidence,
    }
    coverage, reason = task.judge(mesh.degenerate_mask, geometry, figures)
    return figures | {"coverage": coverage, "reason": reason}


def rows_of(coverage: Coverage, choice: str) -> PairRows:
    """Rows of the pairs of a table, of the choices of `rastercov.pairs`."""
    is_seen = (coverage.in_view_fraction > 0) & (coverage.reason > Reason.BACK_FACING)
    chosen = {
        "none": np.zeros(is_seen.shape, np.bool_),
        "covered": coverage.reason == Reason.COVERED,
        "seen": is_seen,
        "all": np.ones(is_seen.shape, np.bool_),
    }[choice]
    pose, face = np.nonzero(chosen)
    figures = {name: getattr(coverage, name)[chosen] for name in FIGURES}
    with np.errstate(over="ignore"):  # values beyond float32 become inf
        columns = {name: values.astype(ROW_TYPES[name]) for name, values in figures.items()}
    # The bound includes the rounding of the visible fraction, so that it still holds.
    off = np.abs(columns["visibility"] - figures["visibility"])
    bound = figures["visibility_bound"] + off
    short = bound.astype(np.float32)
    up = np.nextafter(short, np.float32(np.inf))
    columns["visibility_bound"] = np.where(short < bound, up, short)
    ids = coverage.pose_ids[pose].astype(np.int32)
    return PairRows(pose=ids, face=face.astype(np.int32), **columns)
