"""Records of `rastercov.native.area_region`: faces in their planes, criteria, and what is found."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rastercov.base.memory import BoolArray, FloatArray
from rastercov.coverage.task import Rules


class Planes(NamedTuple):
    """Frames of the faces of a mesh; `is_asked` are those to be measured."""

    origin: FloatArray
    x_axis: FloatArray
    y_axis: FloatArray
    normal: FloatArray
    corners: FloatArray
    areas: FloatArray
    two_sided: BoolArray
    is_asked: BoolArray


class Seen(NamedTuple):
    """A solved pose of `HalfPlaneSolver`; `rows` are those of the faces of the mesh in it."""

    rotation: FloatArray  # world_from_camera
    centre: FloatArray
    near: float
    rows: NDArray[np.int64]
    state: NDArray[np.uint16]
    visible: FloatArray
    area: FloatArray
    area_error: FloatArray
    is_certified: BoolArray
    kept: Any


class Criteria(NamedTuple):
    """Pointwise criteria of a task in the image of a pinhole.

    Attributes
    ----------
    lens : Lens
    rules : Rules
    gap : float
        Largest distance between the arc of the incidence criterion and its chords, and mean width
        of the strips that no test decides, metres.
    pixel_error : float
        Largest error of a position in the image, px.
    """

    lens: Any
    rules: Rules
    gap: float
    pixel_error: float


class LensCriteria(NamedTuple):
    """Pointwise criteria of a task in one ideal plane of a lens.

    Attributes
    ----------
    pinhole : Criteria
        What a surface must meet in the plane itself: to be in its image, the angle of incidence.
    rules : Rules
        All.
    by_distance : bool
        Distances are in focus; if not, depths along `axis` are.
    axis : (3,) float64
        Of the lens, in the axes of the plane.
    gap : float
        Mean width of the strips that no test decides, metres.
    tree : Tree
        The field of view.
    code, params, frame
        The lens.
    slopes : Slopes
        Bounds of its derivatives.
    """

    pinhole: Criteria
    rules: Rules
    by_distance: bool
    axis: FloatArray
    gap: float
    tree: Any
    code: int
    params: FloatArray
    frame: FloatArray
    slopes: Any


class Found(NamedTuple):
    """Regions of a pose, and the area and bound of each face.

    Attributes
    ----------
    xy, starts, face : (C, 2) float64, (N + 1,) int64, (N,) int32
        Corners and faces of N pieces.
    used : (2,) int64
        Pieces and corners so far, also where there is no room for them.
    area, bound : (F,) float64
        m^2.
    """

    xy: FloatArray
    starts: NDArray[np.int64]
    face: NDArray[np.int32]
    used: NDArray[np.int64]
    area: FloatArray
    bound: FloatArray

    @classmethod
    def of_room(cls, n: int, corners: int, n_faces: int) -> "Found":
        """Memory for the regions of a pose: n pieces."""
        starts, used = np.zeros(n + 1, np.int64), np.zeros(2, np.int64)
        area, bound = np.empty((2, n_faces))
        return cls(np.empty((corners, 2)), starts, np.empty(n, np.int32), used, area, bound)
