"""Records of regions for the engine: faces in their planes, and criteria."""

from typing import Any, NamedTuple

from rastercov.base import BoolArray, FloatArray
from rastercov.core.coverage.task import Rules


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


class Criteria(NamedTuple):
    """Pointwise criteria of a task in the image of a pinhole.

    Attributes
    ----------
    lens : Lens
    rules : Rules
    gap : float
        Largest distance between the arc of the incidence criterion and its chords, and mean width
        of the strips that no test decides, relative to the diagonal of the mesh.
    """

    lens: Any
    rules: Rules
    gap: float


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
        Mean width of the strips that no test decides, relative to the diagonal of the mesh.
    tree : Tree
        The field of view.
    code, params, frame
        The lens.
    slopes : Slopes
        Bounds of its derivatives.
    has_border : bool
        The image may show the border of its valid region in the plane.
    unit : float
        Length of a unit of the plane of parallel rays, metres; 0 of rays through a point.
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
    has_border: bool
    unit: float
